//! Light that fog, rain, snow and dust scatter back on the straight way to the surfaces.
//!
//! A metre of the way at range r returns π·β·e^(−2α·r) of a perfect Lambert surface there, with the
//! backscatter β of the air. The light is collected in range cells. Where the beam holds few large drops,
//! each of them is a reflection of its own instead. A drop of radius a in a beam of radius w returns f·(a/w)²
//! of the light of a perfect surface, times its brightness in the profile of the beam
//! ([`super::weather_drops`]).

use super::echo::{EchoPath, PathKind};
use super::instrument::Instrument;
use super::reflections::{PathEnd, Reflections};
use super::traced::{SubrayGains, TracedPulse};
use super::view::SceneView;
use super::water_column::MAX_DEPTH;
use super::weather::Air;
use super::weather_drops::{SingleDrop, WeatherModel, draw_drops};
use crate::flight::Pulse;
use libm::{exp, sqrt};
use std::f64::consts::PI;
use vlscan_base::rng::Stream;
use vlscan_geom::DVec3;
use vlscan_trace::Hits;

/// Maximum number of cells, for air that hardly attenuates.
const MAX_CELLS: usize = 1 << 14;
/// Share of the detection threshold below which the light of further cells no longer counts.
const MIN_SHARE: f64 = 1e-4;
/// Cells per full width of the pulse at half maximum near the instrument.
const CELLS_PER_WIDTH: f64 = 16.0;
/// Steps of the integral within cells, and cells that are longer far away, are at most this share of their
/// range long.
const MAX_STEP: f64 = 1.0 / 64.0;
/// Mean number of drops of a pulse that are drawn one by one; those beyond are a continuum.
const MAX_DROPS: f64 = 64.0;

/// A cell of scattered light.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cell {
    /// Mean range of the light, m.
    range: f64,
    intensity: f64,
}

/// The light of a pulse that the air scatters back.
#[derive(Clone, Debug, Default)]
pub(super) struct WeatherLight {
    /// Ranges at which subrays end, m.
    ends: Vec<f64>,
    /// These ranges in ascending order.
    sorted: Vec<f64>,
    drops: Vec<SingleDrop>,
    cells: Vec<Cell>,
    /// Range and intensity of all that was added to the reflections, ascending.
    pub light: Vec<(f64, f64)>,
}

impl WeatherLight {
    /// Appends the light that the air scatters back to `out`, and to `hits` if they differ from it. Mirrors,
    /// panes and water end the way through the air; foliage does not, up to the last reflection.
    #[inline(never)]
    pub fn add(
        &mut self,
        (view, instrument): (&SceneView, &Instrument),
        (model, air): (&WeatherModel, &Air),
        (traced, gains): (&TracedPulse, &SubrayGains),
        (pulse, stream): (&Pulse, &Stream),
        hits: &mut Option<Reflections>,
        out: &mut Reflections,
    ) {
        let detector = &instrument.detector;
        self.find_ends(view, instrument, (traced, gains), out);
        let is_reflected =
            |i: &usize| traced.primitives[*i] != Hits::MISS && detector.is_in_range(gains.ranges[*i]);
        out.complete((0..traced.primitives.len()).filter(is_reflected), &instrument.subrays.ring);
        let farthest = self.sorted.last().copied().unwrap_or(0.0).min(detector.range_max);
        let number = air.large_drops();
        let few = if number > 0.0 { model.range_of_volume(MAX_DROPS / number) } else { 0.0 };
        // A beam without width meets no drop.
        let of_few = if few.is_finite() { few.min(farthest) } else { 0.0 };
        scatter(instrument, model, air, &self.sorted, of_few, &mut self.cells);
        self.light.clear();
        let axis = pulse.attitude.forward();
        let mut push = |subray: u32, kind: PathKind, direction: DVec3, cell: Cell| {
            if !(cell.intensity > 0.0 && detector.is_in_range(cell.range)) {
                return;
            }
            let surface = pulse.origin + direction * cell.range;
            let end = PathEnd { surface, direction, path: EchoPath { kind, order: 0 }, plane: None };
            let source = (subray, instrument.subrays.ring[subray as usize]);
            out.push_end(source, end, cell.range, (Hits::MISS, 1.0), cell.intensity);
            if let Some(hits) = hits.as_mut() {
                hits.push_end(source, end, cell.range, (Hits::MISS, 1.0), cell.intensity);
            }
            self.light.push((cell.range, cell.intensity));
        };
        self.cells.iter().for_each(|cell| push(0, PathKind::Air, axis, *cell));
        draw_drops(model, air, stream, (pulse.device, pulse.number), of_few, &mut self.drops);
        for drop in &self.drops {
            let direction = pulse.attitude.apply(model.direction_of(drop));
            let subray = nearest_subray(traced, pulse.origin + direction * drop.range, drop.range);
            if self.ends[subray] > drop.range {
                let intensity = of_drop(instrument, model, air, drop);
                push(subray as u32, PathKind::Drop, direction, Cell { range: drop.range, intensity });
            }
        }
        self.light.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    }

    /// Finds the ranges at which the subrays end: at the first surface, or in foliage at the last reflection
    /// of the pulse.
    fn find_ends(
        &mut self,
        view: &SceneView,
        instrument: &Instrument,
        (traced, gains): (&TracedPulse, &SubrayGains),
        reflections: &Reflections,
    ) {
        let last = reflections.ranges().iter().copied().fold(0.0, f64::max);
        let limit = instrument.detector.range_max;
        let end = |(primitive, range): (&u32, &f64)| match *primitive {
            Hits::MISS => limit,
            primitive if view.is_triangle(primitive) => range.min(limit),
            _ => last.max(*range).min(limit),
        };
        self.ends.clear();
        self.ends.extend(traced.primitives.iter().zip(gains.ranges).map(end));
        self.sorted.clone_from(&self.ends);
        self.sorted.sort_unstable_by(f64::total_cmp);
    }
}

/// Replaces `out` by the cells of the light that the air scatters back to subrays that end at the ranges
/// `ends`, ascending. Drops are a part of it from the range `of_few` on.
fn scatter(
    instrument: &Instrument,
    model: &WeatherModel,
    air: &Air,
    ends: &[f64],
    of_few: f64,
    out: &mut Vec<Cell>,
) {
    out.clear();
    // Raindrops of the factor 0 dim the light alone.
    if air.scattered <= 0.0 {
        return;
    }
    let detector = &instrument.detector;
    let shape = &detector.shape;
    let least = detector.light_speed * shape.width() / CELLS_PER_WIDTH;
    let depth = detector.light_speed * shape.samples.iter().sum::<f64>() * shape.bin;
    let Some(&last) = ends.last() else { return };
    let last = last.min(0.5 * MAX_DEPTH / air.extinction);
    let mut from = model.nearest().max(detector.range_min);
    let mut before = 0.0;
    while from < last && out.len() < MAX_CELLS {
        let to = (from + least * growth_at(from, least)).min(last);
        if to <= from {
            return;
        }
        let cell = cell_between(instrument, (model, air), (ends, of_few), from, to);
        out.push(cell);
        let density = cell.intensity / (to - from);
        // Drops may become a part of the light farther away.
        let greatest =
            if from < of_few { density * (air.scattered / air.scattered_by_small) } else { density };
        if density < before && greatest * depth < MIN_SHARE * detector.rule.threshold {
            return;
        }
        (from, before) = (to, density);
    }
}

/// Factor by which cells at a range are longer than the least. Pulses that are a whole fraction of their
/// width apart have an even sum; others have ripples, which look like returns.
fn growth_at(range: f64, least: f64) -> f64 {
    match range * MAX_STEP / least {
        ratio if ratio >= 4.0 => 4.0,
        ratio if ratio >= 2.0 => 2.0,
        _ => 1.0,
    }
}

/// The light from between two ranges.
fn cell_between(
    instrument: &Instrument,
    (model, air): (&WeatherModel, &Air),
    (ends, of_few): (&[f64], f64),
    from: f64,
    to: f64,
) -> Cell {
    let (mut intensity, mut moment) = (0.0, 0.0);
    let mut piece = |from: f64, to: f64, rays: usize| {
        let steps = ((to - from) / (from * MAX_STEP)).ceil().clamp(1.0, 64.0);
        let scattered = if from < of_few { air.scattered_by_small } else { air.scattered };
        for i in 0..steps as u32 {
            let step = (to - from) / steps;
            let begin = from + step * f64::from(i);
            // The light over the square of the range is exact at the geometric mean.
            let range = sqrt(begin * (begin + step));
            let gain = rays as f64 * gain_at(instrument, range) * model.overlap(range);
            let light = gain * PI * scattered * exp(-2.0 * air.extinction * range) * step;
            intensity += light;
            moment += light * range;
        }
    };
    let next = |range: f64| ends.partition_point(|end| *end <= range);
    let inner = ends[next(from)..next(to)].iter().copied();
    let corners = model.crossover().into_iter().flatten().chain([of_few]).chain(inner);
    let mut bounds: Vec<f64> = corners.filter(|corner| from < *corner && *corner < to).collect();
    bounds.push(to);
    bounds.sort_unstable_by(f64::total_cmp);
    let mut begin = from;
    for end in bounds {
        if end > begin {
            piece(begin, end, ends.len() - next(begin));
            begin = end;
        }
    }
    Cell { range: if intensity > 0.0 { moment / intensity } else { from }, intensity }
}

/// Intensity of a perfect surface at a range, m, in one subray; all have equal shares of the light.
fn gain_at(instrument: &Instrument, range: f64) -> f64 {
    let mut gain = [1.0];
    instrument.energy.apply(&[0], &[range], &mut gain);
    gain[0]
}

/// Intensity of a drop.
fn of_drop(instrument: &Instrument, model: &WeatherModel, air: &Air, drop: &SingleDrop) -> f64 {
    let radius = 0.5e-3 * drop.diameter;
    let lit = radius * radius * model.brightness(drop.place.0) / model.square(drop.range);
    let gain = instrument.subrays.len() as f64 * gain_at(instrument, drop.range) * model.overlap(drop.range);
    gain * drop.backscatter * lit.min(1.0) * exp(-2.0 * air.extinction * drop.range)
}

/// The subray that is nearest to a point at a range.
fn nearest_subray(traced: &TracedPulse, point: DVec3, range: f64) -> usize {
    let off = |i: &usize| (traced.start(*i) + traced.direction(*i) * range - point).length_squared();
    let nearest = (0..traced.primitives.len()).min_by(|a, b| off(a).total_cmp(&off(b)));
    nearest.unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::PhysicsOptions;
    use crate::pulse::instrument::InstrumentTable;
    use crate::pulse::testkit::{survey, tls_device};
    use crate::pulse::weather_drops::tests::{air, model, near, rain};
    use libm::sin;
    use vlscan_base::rng::Purpose;
    use vlscan_survey::AirState;

    /// An instrument in air without haze.
    fn clear_instrument() -> Instrument {
        let mut device = tls_device(4.0);
        (device.beam.visibility, device.detector.range_min) = (1e30, 0.0);
        let table = InstrumentTable::new(&survey(vec![device]), &PhysicsOptions::refined()).unwrap();
        table.instrument(0, 0).unwrap().clone()
    }

    /// Integral of the pulse sin²(π·t/2τ) of 0 to 2τ over the light of fog between 0.9 m and a wall at 30 m,
    /// as waveforms have it at the range `range`, s/m².
    fn fog_integral(extinction: f64, range: f64) -> f64 {
        const WIDTH_NS: f64 = 20.0;
        let (instrument, model) = (clear_instrument(), model(1.5e-4, 0.0));
        let air = air(AirState { fog: extinction, ..AirState::default() });
        let ends = vec![30.0; instrument.subrays.len()];
        let depth = vlscan_geom::LIGHT_SPEED * WIDTH_NS;
        let (first, last) = ((range - depth).max(0.9), range.min(30.0));
        let count = 12_000;
        let bound = |i: u32| first + (last - first) * f64::from(i) / f64::from(count);
        let light = |i: u32| {
            let cell = cell_between(&instrument, (&model, &air), (&ends, 0.0), bound(i), bound(i + 1));
            let power = sin(PI * (range - cell.range) / depth);
            cell.intensity * power * power
        };
        let sum: f64 = (0..count).map(light).sum();
        let at_1_m = ends.len() as f64 * gain_at(&instrument, 1.0);
        sum / (at_1_m * PI * air.scattered) * 2e-9 / vlscan_geom::LIGHT_SPEED
    }

    #[test]
    fn fog_scatters_the_light_of_the_integral() {
        for (extinction, expected) in [
            (0.06, [3.707576150e-9, 3.482481530e-11, 3.609938494e-13]),
            (0.02, [4.254281648e-9, 8.886453465e-11, 3.688433830e-12]),
            (0.12, [3.032477768e-9, 8.662163311e-12, 1.110721194e-14]),
        ] {
            for (range, expected) in [5.0, 15.0, 33.0].into_iter().zip(expected) {
                near(fog_integral(extinction, range), expected, 1e-6);
            }
        }
    }

    #[test]
    fn cells_have_all_the_light_and_end_where_subrays_do() {
        let (instrument, model) = (clear_instrument(), model(1.5e-4, 0.0));
        let air = air(AirState { fog: 0.06, ..AirState::default() });
        let count = instrument.subrays.len();
        let mut ends = vec![7.3; count];
        let mut cells = Vec::new();
        let mut light = |ends: &[f64]| {
            scatter(&instrument, &model, &air, ends, 0.0, &mut cells);
            assert!(cells.windows(2).all(|pair| pair[0].range < pair[1].range));
            assert!(cells.iter().all(|cell| (0.9..=ends[count - 1]).contains(&cell.range)));
            cells.iter().map(|cell| cell.intensity).sum::<f64>()
        };
        let near_wall = light(&ends);
        let fine = (0..6400).map(|i| {
            let from = 0.9 + 1e-3 * f64::from(i);
            cell_between(&instrument, (&model, &air), (&[7.3], 0.0), from, from + 1e-3).intensity
        });
        near(near_wall, count as f64 * fine.sum::<f64>(), 2e-4);
        ends[1..].fill(11.0);
        let (far, mixed) = (light(&vec![11.0; count]), light(&ends));
        let expected = (near_wall + (count - 1) as f64 * far) / count as f64;
        near(mixed, expected, 1e-3);
        assert!(light(&vec![f64::MAX; count]) > far);
    }

    /// Rain of 10 mm/h from 20 to 30 m.
    #[test]
    fn drops_have_the_light_of_the_continuum_on_average() {
        let (instrument, model, air) = (clear_instrument(), model(1.5e-3, 0.0), rain());
        let ends = vec![100.0; instrument.subrays.len()];
        let continuum = |of_few: f64| {
            let cells = (0..100).map(|i| {
                let from = 20.0 + 0.1 * f64::from(i);
                cell_between(&instrument, (&model, &air), (&ends, of_few), from, from + 0.1).intensity
            });
            cells.sum::<f64>()
        };
        let of_large_drops = continuum(0.0) - continuum(100.0);
        let (stream, mut drops) = (Stream::new(9, Purpose::WeatherDrop), Vec::new());
        let mut sum = 0.0;
        for pulse in 0..3000 {
            draw_drops(&model, &air, &stream, (0, pulse), 30.0, &mut drops);
            let far = drops.iter().filter(|drop| drop.range >= 20.0);
            sum += far.map(|drop| of_drop(&instrument, &model, &air, drop)).sum::<f64>();
        }
        near(sum / 3000.0, of_large_drops, 0.03);
    }
}
