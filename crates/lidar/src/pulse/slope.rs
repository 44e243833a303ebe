//! Replaces the subrays that hit one plane by the continuous light of the beam.
//!
//! A beam that falls on a slope returns a pulse that is stretched by the depth of its footprint, w/2·tan θ of
//! standard deviation for a Gaussian beam of radius w. A few subrays have this depth as their standard
//! deviation, too ([`super::footprint`]), but once the slope puts them farther apart than the pulse is long,
//! each becomes a separate echo. So the subrays on one plane are replaced by the light that they sample: its
//! ranges are normally distributed with their mean and variance, in steps of one bin.

use super::instrument::Instrument;
use super::reflections::Reflections;
use super::return_profile::ReturnProfile;
use super::traced::{SubrayGains, TracedPulse};
use super::triangle_cache::TriangleCache;
use super::view::SceneView;
use vlscan_geom::DVec3;
use vlscan_trace::Hits;

/// Largest distance of subrays from a plane that they lie on, as a share of the pulse's length in range.
const MAX_DISTANCE: f64 = 0.05;
/// Minimum cosine between the normal of the plane and the normals at the hits: 25°.
const MIN_COSINE: f64 = 0.906;
/// Smallest depth, as a share of the pulse's length in range, at which the subrays' pulses no longer merge.
const MIN_DEPTH: f64 = 0.1;
/// Minimum number of subrays of a plane; fewer may lie on one by chance.
const MIN_SUBRAYS: usize = 3;
/// The distribution is cut off at this many standard deviations, where 6e-5 of it is left.
const CUT_OFF: f64 = 4.0;
/// Maximum number of steps on either side of the mean; longer slopes have longer steps.
const MAX_STEPS: f64 = 4096.0;

#[derive(Clone, Debug, Default)]
pub(super) struct SlopeMerger {
    points: Vec<Point>,
    light: Vec<(f64, f64)>,
}

/// Hit of a subray on a steep surface.
#[derive(Clone, Copy, Debug)]
struct Point {
    reflection: usize,
    /// m, relative to the pulse's origin.
    at: DVec3,
    normal: DVec3,
    range: f64,
    intensity: f64,
    is_merged: bool,
}

impl SlopeMerger {
    /// Replaces the light of subrays on steep planes. Only pulses that hit opaque triangles alone change.
    #[inline(always)]
    pub fn merge(
        &mut self,
        view: &SceneView,
        instrument: &Instrument,
        pulse: (TracedPulse, SubrayGains),
        reflections: &Reflections,
        triangles: &mut TriangleCache,
        profile: &mut ReturnProfile,
    ) {
        let pulse_depth = instrument.detector.light_speed * instrument.detector.shape.length;
        let (Some(first), Some(last)) = (profile.ranges().first(), profile.ranges().last()) else { return };
        if last - first < 2.0 * MIN_DEPTH * pulse_depth || !reflections.is_opaque_only() {
            return;
        }
        // The depth of a footprint that lies on one slope is half the beam's radius times the slope.
        let slope = MIN_DEPTH * pulse_depth / (0.5 * instrument.footprint_angle * last);
        let max_cosine = 1.0 / (1.0 + slope * slope).sqrt();
        let mut count = 0;
        for cosine in reflections.cosines() {
            count += usize::from(*cosine <= max_cosine);
        }
        if count >= MIN_SUBRAYS {
            self.merge_steep(view, instrument, pulse, (reflections, max_cosine), triangles, profile);
        }
    }

    /// Merges subrays with incidence cosines of at most `max_cosine`.
    #[inline(never)]
    fn merge_steep(
        &mut self,
        view: &SceneView,
        instrument: &Instrument,
        (traced, gains): (TracedPulse, SubrayGains),
        (reflections, max_cosine): (&Reflections, f64),
        triangles: &mut TriangleCache,
        profile: &mut ReturnProfile,
    ) {
        let detector = &instrument.detector;
        self.points.clear();
        // Reflections are in the order of the subrays that have one.
        let mut reflection = 0;
        for (subray, primitive) in traced.primitives.iter().enumerate() {
            let range = gains.ranges[subray];
            if *primitive == Hits::MISS || !detector.is_in_range(range) {
                continue;
            }
            if reflections.cosines()[reflection] <= max_cosine
                && let Some(triangle) = triangles.look_up(view, *primitive)
            {
                let from = traced.start(subray) - traced.origin;
                let (at, normal) = (from + traced.direction(subray) * range, triangle.normal);
                let intensity = reflections.intensities()[reflection];
                self.points.push(Point { reflection, at, normal, range, intensity, is_merged: false });
            }
            reflection += 1;
        }
        self.light.clear();
        let pulse_depth = detector.light_speed * detector.shape.length;
        for i in 0..self.points.len() {
            self.merge_plane_of(i, pulse_depth, detector.light_speed * detector.shape.bin);
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
        profile.set(&self.light);
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

    /// Adds light of energy `energy` whose ranges are normally distributed.
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
