//! Light that water scatters back along the ways of subrays.
//!
//! A metre of the way l returns π·β·T²·e^(−2K·l) of a perfect Lambert surface at the effective range, with
//! the volume scattering function β at 180°. The light of a pulse is collected in range cells that all of its
//! subrays share, as that of foliage.
//!
//! Light from behind the last surface of a pulse only fades: it makes no echo, and changes none. So a column
//! ends a few lengths of the pulse behind the last surface, unless something else depends on its light:
//! noise, photons, recorded waveforms. There it ends where the waveform is below a small part of the
//! threshold.

use super::continuum::{cell_width, centroid};
use super::instrument::Instrument;
use super::reflections::{PathEnd, Reflections};
use super::water::effective_range_squared;
use libm::{exp, expm1};
use std::f64::consts::PI;
use vlscan_geom::DVec3;
use vlscan_scene::Water;

/// Optical depth of the way there and back behind which light no longer counts.
pub(super) const MAX_DEPTH: f64 = 18.4;
/// Lengths of the pulse by which a column goes on behind the last surface.
const LENGTHS_BEHIND: f64 = 4.0;
/// Share of the detection threshold below which a waveform no longer counts: of echoes, and of photons, whose
/// numbers add up over the column.
const MIN_ECHO: f64 = 1e-3;
const MIN_PHOTONS: f64 = 1e-6;
/// Maximum number of cells of a subray, for water that hardly attenuates.
const MAX_CELLS: u64 = 1 << 14;

/// Way of a subray through water.
#[derive(Clone, Copy, Debug)]
pub(super) struct ColumnRay {
    pub water: Water,
    /// Attenuation that the receiver sees, 1/m.
    pub attenuation: f64,
    /// The surface of the water.
    pub primitive: u32,
    /// Cosine of the angle of incidence on the surface.
    pub cosine: f64,
    /// Subray and its ring.
    pub source: (u32, u32),
    /// Label and plane of the echoes; the surface is filled in for each of them.
    pub end: PathEnd,
    /// Entry into the water, m.
    pub from: DVec3,
    /// Length in air, m.
    pub air: f64,
    /// Length in water up to the bottom, m; infinite without one.
    pub way: f64,
    /// Cosines at the facet, in air and in water.
    pub cosines: [f64; 2],
    /// Square of the share of the light of the subray that enters the water.
    pub share: f64,
}

/// Light of a cell.
#[derive(Clone, Copy, Debug)]
struct Cell {
    number: u64,
    intensity: f64,
    /// Intensity times range.
    moment: f64,
    /// Index of the ray that adds most, how much it adds, and its way in water.
    strongest: (usize, f64, f64),
}

/// Amplitude of waveforms below which the light of a column no longer counts, if it counts behind the last
/// surface of a pulse.
pub(super) fn lowest_amplitude(threshold: f64, counts_photons: bool) -> f64 {
    threshold * if counts_photons { MIN_PHOTONS } else { MIN_ECHO }
}

/// Bounds of the columns of a pulse.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    /// Width of a cell, m of range.
    width: f64,
    /// Range at which columns end, m.
    reach: f64,
    /// Light of a subray, per metre of range, at which its column ends.
    lowest: f64,
}

impl Bounds {
    /// The bounds for `rays` subrays that enter the water up to the range `air`; `last` is the range of the
    /// last surface.
    fn new(instrument: &Instrument, rays: usize, air: f64, last: f64) -> Bounds {
        let detector = &instrument.detector;
        let shape = &detector.shape;
        let behind = LENGTHS_BEHIND * detector.light_speed * shape.duration;
        let (reach, lowest) = match instrument.lowest_of_column {
            None => (last.max(air) + behind, 0.0),
            Some(amplitude) => {
                // The amplitude of light of 1 per metre.
                let depth = shape.samples.iter().sum::<f64>() * shape.bin * detector.light_speed;
                (f64::INFINITY, amplitude / (depth * rays as f64))
            }
        };
        Bounds { width: cell_width(detector), reach: reach.min(detector.range_max), lowest }
    }
}

/// The light of a pulse from the water on its way.
#[derive(Clone, Debug, Default)]
pub(super) struct WaterColumn {
    rays: Vec<ColumnRay>,
    /// By ascending number.
    cells: Vec<Cell>,
    ranges: Vec<f64>,
    rings: Vec<u32>,
    gains: Vec<f64>,
}

impl WaterColumn {
    pub fn clear(&mut self) {
        self.rays.clear();
    }

    /// Adds the way of a subray.
    pub fn push(&mut self, ray: ColumnRay) {
        self.rays.push(ray);
    }

    /// Appends a reflection for each cell with light, and to `hits` if they differ from `out`.
    pub fn emit(&mut self, instrument: &Instrument, hits: &mut Option<Reflections>, out: &mut Reflections) {
        if self.rays.is_empty() {
            return;
        }
        self.ranges.clear();
        self.ranges.extend(self.rays.iter().map(|ray| ray.air));
        self.rings.clear();
        self.rings.extend(self.rays.iter().map(|ray| ray.source.1));
        self.gains.clear();
        self.gains.resize(self.rays.len(), 1.0);
        instrument.energy.apply(&self.rings, &self.ranges, &mut self.gains);
        self.cells.clear();
        let farthest = |ranges: &[f64]| ranges.iter().copied().fold(0.0, f64::max);
        let (air, last) = (farthest(&self.ranges), farthest(out.ranges()));
        let bounds = Bounds::new(instrument, self.rays.len(), air, last);
        for i in 0..self.rays.len() {
            self.scatter(i, &bounds, instrument);
        }
        for cell in &self.cells {
            let (ray, _, way) = cell.strongest;
            let ray = &self.rays[ray];
            let end = PathEnd { surface: ray.from + ray.end.direction * way, ..ray.end };
            let range = cell.moment / cell.intensity;
            out.push_end(ray.source, end, range, (ray.primitive, ray.cosine), cell.intensity);
            if let Some(hits) = hits {
                hits.push_end(ray.source, end, range, (ray.primitive, ray.cosine), cell.intensity);
            }
        }
    }

    /// Adds the light of a ray to its cells.
    fn scatter(&mut self, i: usize, bounds: &Bounds, instrument: &Instrument) {
        let (ray, width) = (self.rays[i], bounds.width);
        let (n, k) = (ray.water.group_index, ray.attenuation);
        let beyond = if k > 0.0 { 0.5 * MAX_DEPTH / k } else { f64::INFINITY };
        let limit = ray.way.min(beyond);
        let first = (ray.air / width) as u64;
        let whole = WholeCell::new(&ray, width / n);
        let (mut from, mut at, mut kept) = (0.0, 0, 1.0);
        for number in first..first.saturating_add(MAX_CELLS) {
            // The light of this cell and of all behind it comes from beyond the reach, or does not count.
            let is_last = ray.air + n * from > bounds.reach
                || self.gains[i] * whole.density(&ray, from, kept) < n * bounds.lowest;
            if is_last {
                return;
            }
            let border = ((number + 1) as f64 * width - ray.air) / n;
            let to = border.min(limit);
            if to > from {
                let is_whole = from > 0.0 && border <= limit;
                let (factor, way) =
                    if is_whole { whole.light(&ray, from, kept) } else { light(&ray, from, to) };
                kept = if is_whole { kept * whole.kept } else { exp(-2.0 * k * to) };
                let (range, intensity) = (ray.air + n * way, factor * self.gains[i]);
                // Cells without light have no range.
                if intensity > 0.0 && instrument.detector.is_in_range(range) {
                    at = self.add(at, number, range, (i, intensity, way));
                }
                from = to;
            }
            if border >= limit {
                return;
            }
        }
    }

    /// Adds light to a cell that is not before position `at` of the list. Returns its position.
    fn add(&mut self, at: usize, number: u64, range: f64, added: (usize, f64, f64)) -> usize {
        let intensity = added.1;
        let found = self.cells[at..].iter().position(|cell| cell.number >= number);
        let at = found.map_or(self.cells.len(), |offset| at + offset);
        if self.cells.get(at).is_none_or(|cell| cell.number != number) {
            self.cells.insert(at, Cell { number, intensity: 0.0, moment: 0.0, strongest: added });
        }
        let cell = &mut self.cells[at];
        cell.intensity += intensity;
        cell.moment += intensity * range;
        if intensity > cell.strongest.1 {
            cell.strongest = added;
        }
        at
    }
}

/// Cells of a ray that lie in water with their whole width: from one to the next the light is dimmed by the
/// same share.
#[derive(Clone, Copy, Debug)]
struct WholeCell {
    /// Length of way, m.
    step: f64,
    /// Mean place of the light, as a share of the length.
    centre: f64,
    /// Length without attenuation from which as much light returns, m.
    passed: f64,
    /// Share of the light there and back that is left behind the cell.
    kept: f64,
}

impl WholeCell {
    fn new(ray: &ColumnRay, step: f64) -> WholeCell {
        let depth = 2.0 * ray.attenuation * step;
        let passed = if depth > 0.0 { -expm1(-depth) / (2.0 * ray.attenuation) } else { step };
        WholeCell { step, centre: centroid(depth), passed, kept: exp(-depth) }
    }

    /// Light that a metre of way returns at `way`, where the share `kept` of the light is left.
    fn density(&self, ray: &ColumnRay, way: f64, kept: f64) -> f64 {
        let squared = effective_range_squared(&ray.water, ray.air, way, ray.cosines);
        PI * ray.water.backscatter * ray.share * ray.air * ray.air / squared * kept
    }

    /// As [`light`], for the cell from `from` on, where the share `kept` of the light is left.
    fn light(&self, ray: &ColumnRay, from: f64, kept: f64) -> (f64, f64) {
        let way = from + self.step * self.centre;
        (self.density(ray, way, kept) * self.passed, way)
    }
}

/// Light that the water between two ways returns, relative to the gain at the length in air, and the mean of
/// its way, m.
fn light(ray: &ColumnRay, from: f64, to: f64) -> (f64, f64) {
    let (k, step) = (ray.attenuation, to - from);
    let depth = 2.0 * k * step;
    let passed = if depth > 0.0 { -expm1(-depth) / (2.0 * k) } else { step };
    let way = from + step * centroid(depth);
    let squared = effective_range_squared(&ray.water, ray.air, way, ray.cosines);
    let factor = PI * ray.water.backscatter * ray.share * ray.air * ray.air / squared;
    (factor * exp(-2.0 * k * from) * passed, way)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::PhysicsOptions;
    use crate::pulse::echo::{EchoPath, PathKind};
    use crate::pulse::instrument::InstrumentTable;
    use crate::pulse::testkit::{survey, tls_device, tls_instrument};
    use crate::pulse::water::tests::water;
    use vlscan_survey::Overlap;

    fn ray(water: Water, way: f64) -> ColumnRay {
        let path = EchoPath { kind: PathKind::WaterColumn, order: 1 };
        let direction = DVec3::NEG_Z;
        ColumnRay {
            water,
            attenuation: water.attenuation,
            primitive: 3,
            cosine: 1.0,
            source: (0, 0),
            end: PathEnd { surface: DVec3::ZERO, direction, path, plane: None },
            from: DVec3::ZERO,
            air: 75.0,
            way,
            cosines: [libm::cos(0.3), (1.0 - (libm::sin(0.3) / 1.34).powi(2)).sqrt()],
            share: 0.9,
        }
    }

    fn emitted_by(instrument: &Instrument, rays: &[ColumnRay]) -> Reflections {
        let (mut column, mut out) = (WaterColumn::default(), Reflections::default());
        column.clear();
        rays.iter().for_each(|ray| column.push(*ray));
        out.clear(1);
        column.emit(instrument, &mut None, &mut out);
        out
    }

    /// An instrument for which all light of a column counts.
    fn sensitive() -> Instrument {
        Instrument { lowest_of_column: Some(0.0), ..tls_instrument(5.0) }
    }

    fn emitted(rays: &[ColumnRay]) -> Reflections {
        emitted_by(&sensitive(), rays)
    }

    #[test]
    fn a_column_ends_behind_the_last_surface_unless_its_light_counts() {
        let clear = ray(Water { attenuation: 1e-6, ..water() }, f64::INFINITY);
        let all = emitted(&[clear]);
        let instrument = tls_instrument(5.0);
        assert_eq!(instrument.lowest_of_column, None);
        let detector = &instrument.detector;
        let behind = LENGTHS_BEHIND * detector.light_speed * detector.shape.duration;
        for last in [0.0, 75.0, 90.0] {
            let (mut column, mut out) = (WaterColumn::default(), Reflections::default());
            column.push(clear);
            out.clear(1);
            out.push_lit(last, 0, 1.0, 1.0);
            column.emit(&instrument, &mut None, &mut out);
            let count = out.count() - 1;
            assert_eq!(out.ranges()[1..], all.ranges()[..count], "{last} m");
            assert_eq!(out.intensities()[1..], all.intensities()[..count], "{last} m");
            let end = out.ranges()[count] - last.max(75.0);
            assert!((end - behind).abs() < 2.0 * cell_width(detector), "{last} m: {end}");
        }
    }

    #[test]
    fn light_ends_where_a_pulse_of_it_is_below_the_lowest_amplitude() {
        let clear = ray(Water { attenuation: 1e-3, ..water() }, f64::INFINITY);
        let all = emitted(&[clear, clear]);
        let instrument = sensitive();
        let detector = &instrument.detector;
        let in_pulse = detector.shape.samples.iter().sum::<f64>() * detector.shape.bin * detector.light_speed
            / cell_width(detector);
        // The amplitude of the 400th cell and its neighbours, of both subrays.
        let lowest = all.intensities()[400] * in_pulse;
        let bounded = emitted_by(&Instrument { lowest_of_column: Some(lowest), ..sensitive() }, &[clear; 2]);
        assert!((399..=402).contains(&bounded.count()), "{}", bounded.count());
        assert_eq!(bounded.intensities(), &all.intensities()[..bounded.count()]);
        assert_eq!((lowest_amplitude(2.0, false), lowest_amplitude(2.0, true)), (2e-3, 2e-6));
    }

    #[test]
    fn light_that_misses_the_detector_is_in_no_cell() {
        let of = |baseline: f64| {
            let mut device = tls_device(5.0);
            device.beam.overlap = Some(Overlap { field_of_view: 1e-2, baseline, focus: 0.0 });
            let table = InstrumentTable::new(&survey(vec![device]), &PhysicsOptions::refined()).unwrap();
            emitted_by(table.instrument(0, 0).unwrap(), &[ray(water(), 5.0)]).count()
        };
        assert!(of(0.0) > 10);
        assert_eq!(of(5.0), 0);
    }

    #[test]
    fn light_fades_with_twice_the_attenuation_along_the_slanted_way() {
        let ray = ray(water(), 20.0);
        let gain = sensitive().energy.of_beam(1, ray.air);
        let out = emitted(&[ray]);
        let width = cell_width(&tls_instrument(5.0).detector);
        let inner = 1..out.count() - 1;
        let mut last: Option<(f64, f64)> = None;
        for i in inner {
            let way = (out.ranges()[i] - ray.air) / 1.365;
            let squared = effective_range_squared(&ray.water, ray.air, way, ray.cosines);
            let of_metre = out.intensities()[i] * squared;
            if let Some((before, of_last)) = last {
                assert!((way - before - width / 1.365).abs() < 1e-9);
                let slope = libm::log(of_metre / of_last) / (way - before);
                assert!((slope + 0.2).abs() < 1e-9, "{slope}");
                // Over the depth it is steeper by the secant of the angle in water.
                let inner = ray.cosines[1];
                let over_depth = libm::log(of_metre / of_last) / ((way - before) * inner);
                assert!((over_depth + 0.2 / inner).abs() < 1e-9, "{over_depth}");
            }
            last = Some((way, of_metre));
            let (thin, at) = light(&ray, way - 5e-7, way + 5e-7);
            let density = PI * Water::BACKSCATTER * 0.9 * 75.0 * 75.0 / squared * exp(-0.2 * at);
            assert!((thin / 1e-6 / density - 1.0).abs() < 1e-6);
        }
        // The whole column.
        let total: f64 = out.intensities().iter().sum();
        let steps: f64 =
            (0..20_000).map(|i| light(&ray, f64::from(i) * 1e-3, f64::from(i + 1) * 1e-3).0).sum();
        assert!((total / (steps * gain) - 1.0).abs() < 1e-5, "{}", total / steps / gain);
    }

    #[test]
    fn the_maximum_range_ends_a_column_without_a_change_of_what_is_nearer() {
        // Clear water without a bottom: the cells would end at their maximum number.
        let clear = ray(Water { attenuation: 1e-6, ..water() }, f64::INFINITY);
        let mut instrument = sensitive();
        let all = emitted_by(&instrument, &[clear]);
        assert!(all.count() as u64 > MAX_CELLS - 2 && all.count() as u64 <= MAX_CELLS, "{}", all.count());
        for range_max in [75.0, 75.5, 90.0] {
            instrument.detector.range_max = range_max;
            let near = emitted_by(&instrument, &[clear]);
            let count = all.ranges().iter().filter(|range| **range <= range_max).count();
            assert_eq!(near.ranges(), &all.ranges()[..count], "{range_max} m");
            assert_eq!(near.intensities(), &all.intensities()[..count], "{range_max} m");
        }
    }

    #[test]
    fn cells_are_shared_by_subrays_and_end_in_the_dark() {
        let (one, other) = (ray(water(), 3.0), ColumnRay { air: 75.01, ..ray(water(), 5.0) });
        let [alone, both] = [emitted(&[other]), emitted(&[one, other])];
        assert!(both.count() <= alone.count() + 1, "{} {}", both.count(), alone.count());
        assert!(both.ranges().is_sorted_by(|a, b| a < b));
        let sum = |out: &Reflections| out.intensities().iter().sum::<f64>();
        assert!((sum(&both) - sum(&alone) - sum(&emitted(&[one]))).abs() < 1e-12 * sum(&both));
        let deep = emitted(&[ray(water(), f64::INFINITY)]);
        let last = (deep.ranges()[deep.count() - 1] - 75.0) / 1.365;
        assert!((90.0..92.1).contains(&last), "{last}");
        assert_eq!(emitted(&[ray(Water { backscatter: 0.0, ..water() }, 5.0)]).count(), 0);
    }
}
