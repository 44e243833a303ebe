//! Subrays that meet one plane, as the whole beam meets it.
//!
//! A beam that falls on a slope returns a pulse that is stretched by the depth of its footprint, w/2·tan θ of standard deviation
//! for a Gaussian beam of radius w. A few subrays have this depth as their standard deviation, too
//! ([`super::footprint`]), but once the slope pulls them farther apart than the pulse is long, each becomes an echo of its
//! own. So those that lie on one plane give way to what they sample: light whose ranges are normally distributed with their
//! mean and variance, in steps of one bin.

use super::facet::Facets;
use super::instrument::Instrument;
use super::light::Light;
use super::reflect::View;
use super::reflections::Reflections;
use super::sight::{Shot, Sight};
use crate::geom::DVec3;
use crate::tree::Hits;

/// Subrays are on one plane that are not farther off it than this share of the pulse's length in range.
const MAX_DISTANCE: f64 = 0.05;
/// Their own planes are turned against it by less than 25°.
const MIN_COSINE: f64 = 0.906;
/// Depths, as a share of the pulse's length in range, from which on the subrays' pulses no longer flow into one another.
const MIN_DEPTH: f64 = 0.1;
/// Three subrays at least tell a plane from chance.
const MIN_SUBRAYS: usize = 3;
/// The distribution is cut off at so many standard deviations, where 6e-5 of it is left.
const CUT_OFF: f64 = 4.0;
/// Most steps on either side of the mean; steps of longer slopes are longer.
const MAX_STEPS: f64 = 4096.0;

/// Memory for the slopes of a pulse.
#[derive(Clone, Debug, Default)]
pub(super) struct Slopes {
    points: Vec<Point>,
    light: Vec<(f64, f64)>,
}

/// Where a subray met a steep surface.
#[derive(Clone, Copy, Debug)]
struct Point {
    /// Position among the reflections.
    reflection: usize,
    /// m, relative to the pulse's origin.
    at: DVec3,
    normal: DVec3,
    range: f64,
    intensity: f64,
    is_merged: bool,
}

impl Slopes {
    /// Replaces the light of subrays that lie on steep planes. Of pulses that meet anything but opaque triangles, nothing is.
    #[inline(always)]
    pub fn merge(
        &mut self,
        view: &View,
        instrument: &Instrument,
        (shot, sight): (Shot, Sight),
        reflections: &Reflections,
        facets: &mut Facets,
        light: &mut Light,
    ) {
        let pulse_depth = instrument.light_speed * instrument.shape.length;
        let (Some(first), Some(last)) = (light.ranges().first(), light.ranges().last()) else { return };
        if last - first < 2.0 * MIN_DEPTH * pulse_depth || !reflections.is_plain() {
            return;
        }
        // Half the beam's radius times the slope is the depth of a footprint that lies on it as a whole.
        let slope = MIN_DEPTH * pulse_depth / (0.5 * instrument.footprint_angle * last);
        let steep = 1.0 / (1.0 + slope * slope).sqrt();
        let mut count = 0;
        for cosine in reflections.cosines() {
            count += usize::from(*cosine <= steep);
        }
        if count >= MIN_SUBRAYS {
            self.merge_steep(view, instrument, (shot, sight), (reflections, steep), facets, light);
        }
    }

    /// Merges those that are met at cosines of at most `steep`.
    #[inline(never)]
    fn merge_steep(
        &mut self,
        view: &View,
        instrument: &Instrument,
        (shot, sight): (Shot, Sight),
        (reflections, steep): (&Reflections, f64),
        facets: &mut Facets,
        light: &mut Light,
    ) {
        self.points.clear();
        // The subrays that reflect something come in the order of the reflections.
        let mut reflection = 0;
        for (subray, primitive) in shot.primitive.iter().enumerate() {
            let range = sight.ranges[subray];
            if *primitive == Hits::MISS || !(range >= instrument.range_min && range <= instrument.range_max) {
                continue;
            }
            if reflections.cosines()[reflection] <= steep
                && let Some(facet) = facets.look_up(view, *primitive)
            {
                let (at, normal) = (shot.direction(subray) * range, facet.normal());
                let intensity = reflections.intensities()[reflection];
                self.points.push(Point { reflection, at, normal, range, intensity, is_merged: false });
            }
            reflection += 1;
        }
        self.light.clear();
        let pulse_depth = instrument.light_speed * instrument.shape.length;
        for i in 0..self.points.len() {
            self.merge_plane_of(i, pulse_depth, instrument.light_speed * instrument.shape.bin);
        }
        if self.light.is_empty() {
            return;
        }
        let mut merged = self.points.iter().filter(|p| p.is_merged).map(|p| p.reflection).peekable();
        let all = reflections.ranges().iter().zip(reflections.intensities()).enumerate();
        for (i, (range, intensity)) in all {
            if merged.next_if_eq(&i).is_none() {
                self.light.push((*range, *intensity));
            }
        }
        self.light.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        light.set(&self.light);
    }

    /// Merges the subrays on the plane of point `i` if they are many and deep enough.
    fn merge_plane_of(&mut self, i: usize, pulse_depth: f64, bin_depth: f64) {
        let seed = self.points[i];
        if seed.is_merged {
            return;
        }
        let on_plane = |p: &Point| {
            !p.is_merged
                && (p.at - seed.at).dot(seed.normal).abs() <= MAX_DISTANCE * pulse_depth
                && p.normal.dot(seed.normal).abs() >= MIN_COSINE
        };
        let (mut count, mut sum, mut first, mut second) = (0, 0.0, 0.0, 0.0);
        for p in self.points.iter().filter(|p| on_plane(p)) {
            let by = p.range - seed.range;
            count += 1;
            sum += p.intensity;
            first += p.intensity * by;
            second += p.intensity * by * by;
        }
        let mean = first / sum;
        let deviation = (second / sum - mean * mean).max(0.0).sqrt();
        let is_deep = deviation >= MIN_DEPTH * pulse_depth && deviation.is_finite();
        if count < MIN_SUBRAYS || !is_deep {
            return;
        }
        self.points.iter_mut().filter(|p| on_plane(p)).for_each(|p| p.is_merged = true);
        self.spread(seed.range + mean, deviation, sum, bin_depth);
    }

    /// Adds light of an energy whose ranges are normally distributed.
    fn spread(&mut self, mean: f64, deviation: f64, energy: f64, bin_depth: f64) {
        let step = bin_depth * (CUT_OFF * deviation / bin_depth / MAX_STEPS).ceil().max(1.0);
        let steps = (CUT_OFF * deviation / step).ceil() as i64;
        let first = self.light.len();
        let mut sum = 0.0;
        for k in -steps..=steps {
            let by = k as f64 * step / deviation;
            let share = libm::exp(-0.5 * by * by);
            sum += share;
            // Light does not come from behind the instrument.
            self.light.push(((mean + k as f64 * step).max(0.0), share));
        }
        self.light[first..].iter_mut().for_each(|(_, share)| *share *= energy / sum);
    }
}
