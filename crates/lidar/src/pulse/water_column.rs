//! Light that water scatters back along the ways of subrays.
//!
//! A metre of the way l returns π·β·T²·e^(−2K·l) of a perfect Lambert surface at the effective range, with
//! the volume scattering function β at 180°. The light of a pulse is collected in range cells that all of its
//! subrays share, as that of foliage.

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
        let width = cell_width(&instrument.detector);
        for i in 0..self.rays.len() {
            self.scatter(i, width, instrument);
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

    /// Adds the light of a ray to its cells, which are `width` m of range wide.
    fn scatter(&mut self, i: usize, width: f64, instrument: &Instrument) {
        let ray = self.rays[i];
        let (n, k) = (ray.water.group_index, ray.attenuation);
        let beyond = if k > 0.0 { 0.5 * MAX_DEPTH / k } else { f64::INFINITY };
        let limit = ray.way.min(beyond);
        let first = (ray.air / width) as u64;
        let (mut from, mut at) = (0.0, 0);
        for number in first..first.saturating_add(MAX_CELLS) {
            if ray.air + n * from > instrument.detector.range_max {
                // The light of this cell and of all behind it comes from beyond the maximum range.
                return;
            }
            let border = ((number + 1) as f64 * width - ray.air) / n;
            let to = border.min(limit);
            if to > from {
                let (factor, way) = light(&ray, from, to);
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

    fn emitted(rays: &[ColumnRay]) -> Reflections {
        emitted_by(&tls_instrument(5.0), rays)
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
        let gain = tls_instrument(5.0).energy.of_beam(1, ray.air);
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
        let mut instrument = tls_instrument(5.0);
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
