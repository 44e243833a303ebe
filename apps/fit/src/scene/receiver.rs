//! The receiver and the size of foliage elements, from the number of returns of pulses through foliage.
//!
//! The resolution is the minimum distance between two returns of a pulse in the recording. The threshold is
//! the minimum share of the energy that makes a return. The size of the elements of foliage (shoots, clusters
//! of leaves) decides how often a beam is divided: an element intercepts a narrower beam as a whole.
//!
//! Threshold and size of the elements are estimated together, in turn with factors on the extinctions by
//! height above the ground. The factors are needed since a first return is the nearest element in the beam,
//! not the mean of all elements. Recorded beams are sent through the estimated foliage by the rules of the
//! simulator: elements intercept columns of the footprint at an exponentially distributed optical depth. The
//! random numbers are the same for every trial. The fit matches the shares of pulses with one, two, three and
//! more returns, of pulses whose first or last return is from foliage, and the heights of first returns. The
//! extinctions come from the other pulses: foliage that was estimated by a pulse fits that pulse too well.

use super::echoes::{LAYERS, SHARES, SUBRAYS, Sample, Segment, Simulator, path_places};
use super::foliage::{Beam, Extinctions, beam};
use super::recording::Recording;
use super::sensor::SensorPath;
use super::terrain::Terrain;
use rayon::prelude::*;
use vlscan_geom::DVec3;

/// Pulses that are simulated.
const MAX_SAMPLES: usize = 4000;
/// Minimum number of pulses through foliage for an estimate.
const MIN_SAMPLES: usize = 200;
/// Optical depth from which on a beam counts as one through foliage.
const MIN_DEPTH: f64 = 0.01;
/// Rounds in which the receiver and the layers are estimated in turn, and steps of the latter in each.
const ROUNDS: usize = 3;
const LAYER_STEPS: usize = 6;
/// Usual threshold, and the factor by which one standard deviation of thresholds differs from it. The returns
/// of foliage tell threshold and size of the elements badly from each other; these values were chosen after
/// trials with four recordings (docs/dev/proof.md).
const USUAL_THRESHOLD: [f64; 2] = [0.1, 1.25];
/// Bounds of the threshold: two rays of a beam, below which it depends on where single rays pass, and half of
/// them.
const THRESHOLDS: [f64; 2] = [2.0 / SUBRAYS as f64, 0.5];
/// Bounds of the size of elements over the mean radius of the footprint.
const SIZES: [f64; 2] = [0.05, 16.0];
/// Bounds of the factor of a layer.
const FACTORS: [f64; 2] = [0.2, 5.0];
/// Quantile of the distances between consecutive returns that counts as their minimum.
const LEAST_DISTANCE_QUANTILE: f64 = 0.02;
/// Minimum number of pairs of returns for that distance.
const MIN_PAIRS: usize = 100;
/// Default resolution for recordings with too few pairs, m: that of pulses of 4 ns.
const USUAL_RESOLUTION: f64 = 0.6;

/// Estimates about the receiver and foliage.
#[derive(Clone, Debug, PartialEq)]
pub struct Receiver {
    /// Minimum distance between two returns, m.
    pub resolution: f64,
    /// Pairs of returns by which it is known; 0: it is assumed.
    pub pairs: usize,
    /// Minimum share of the beam's energy that makes a return.
    pub threshold: f64,
    /// Size of the elements of foliage, m.
    pub element_size: f64,
    /// Factors on the extinctions by height over the ground; the last one holds above, too.
    pub layers: Vec<Layer>,
    /// Most returns of a pulse.
    pub max_returns: u8,
    /// Pulses through foliage by which threshold, size and factor were estimated; 0: they are assumed.
    pub samples: usize,
    /// Of these the share with one, two, three, more returns, with a first return from foliage, with a last
    /// one from foliage.
    pub recorded: [f64; SHARES],
    /// The same as simulated.
    pub simulated: [f64; SHARES],
}

/// The factor on extinctions of a layer of foliage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// Upper end, m over the ground.
    pub top: f64,
    /// The factor.
    pub factor: f64,
}

impl Receiver {
    /// The factor on extinctions at a height over the ground, m.
    pub fn factor_at(&self, height: f64) -> f64 {
        let layer = self.layers.iter().find(|layer| height < layer.top).or(self.layers.last());
        layer.map_or(1.0, |layer| layer.factor)
    }
}

/// The receiver and the grain of foliage; beams have the full `divergence` (1/e², rad).
pub(super) fn receiver(
    recording: &Recording,
    (paths, divergence): (&[SensorPath], f64),
    extinctions: Option<&Extinctions>,
    is_leaf: &[bool],
    terrain: &Terrain,
) -> Receiver {
    let (resolution, pairs) = resolution(recording);
    let mut found = Receiver {
        resolution,
        pairs,
        threshold: USUAL_THRESHOLD[0],
        element_size: 0.0,
        layers: Vec::new(),
        max_returns: recording.returns.iter().map(|r| r.of).max().unwrap_or(1),
        samples: 0,
        recorded: [0.0; SHARES],
        simulated: [0.0; SHARES],
    };
    let Some(extinctions) = extinctions else { return found };
    let mut samples = samples(recording, (paths, divergence), extinctions, is_leaf, terrain);
    if samples.len() < MIN_SAMPLES {
        return found;
    }
    let tops = divide_into_layers(&mut samples);
    let recorded = recorded_shares(&samples);
    let radius = samples.iter().map(|s| s.radius).sum::<f64>() / samples.len() as f64;
    // Size of elements over the radius of the footprint, and threshold.
    let settings = |x: &[f64; 2]| (libm::exp(x[0]) * radius, libm::exp(x[1]));
    let mut simulator = Simulator::new(&samples, resolution);
    let mut factors = [1.0; LAYERS];
    let mut best = [0.0; 2];
    let [usual, usual_factor] = USUAL_THRESHOLD;
    for _ in 0..ROUNDS {
        let cost = |x: &[f64; 2]| -> f64 {
            let (shares, _) = simulator.shares(settings(x));
            let deviations = (x[1] - libm::log(usual)) / libm::log(usual_factor);
            samples.len() as f64 * misfit(shares, recorded) + deviations * deviations
        };
        best = minimise(cost, [SIZES, THRESHOLDS].map(|range| range.map(libm::log)));
        for _ in 0..LAYER_STEPS {
            let (_, simulated) = simulator.shares(settings(&best));
            let mut counts = [0.0; LAYERS];
            samples.iter().filter_map(|s| s.first_layer).for_each(|layer| counts[layer] += 1.0);
            for layer in 0..LAYERS {
                let ratio: f64 = (counts[layer] + 1.0) / (simulated[layer] + 1.0);
                factors[layer] = (factors[layer] * ratio.sqrt()).clamp(FACTORS[0], FACTORS[1]);
            }
            simulator.set_factors(factors);
        }
    }
    (found.element_size, found.threshold) = settings(&best);
    found.layers = tops.into_iter().zip(factors).map(|(top, factor)| Layer { top, factor }).collect();
    let (simulated, _) = simulator.shares(settings(&best));
    (found.samples, found.recorded, found.simulated) = (samples.len(), recorded, simulated);
    found
}

/// Difference of shares of two samples of one pulse each, in variances: a share of few pulses counts as much
/// as one of many.
fn misfit(simulated: [f64; SHARES], recorded: [f64; SHARES]) -> f64 {
    let weighed = |a: f64, b: f64| if a + b > 0.0 { (a - b).powi(2) / (a + b) } else { 0.0 };
    let term = |(i, (s, r)): (usize, (f64, f64))| match i {
        // Of the first four shares each pulse is in one; the others are in or out.
        0..4 => weighed(s, r),
        _ => weighed(s, r) + weighed(1.0 - s, 1.0 - r),
    };
    simulated.into_iter().zip(recorded).enumerate().map(term).sum()
}

/// Numbers the layers of all segments and first returns; returns where each layer ends, m over the ground.
fn divide_into_layers(samples: &mut [Sample]) -> Vec<f64> {
    let is_leaf = |s: &&Sample| s.first_is_leaf == Some(true);
    let mut heights: Vec<f64> = samples.iter().filter(is_leaf).map(|s| s.first_height).collect();
    heights.sort_by(f64::total_cmp);
    let top =
        |layer: usize| heights.get(heights.len() * (layer + 1) / LAYERS).copied().unwrap_or(f64::INFINITY);
    let tops: Vec<f64> =
        (0..LAYERS).map(|layer| if layer + 1 == LAYERS { f64::INFINITY } else { top(layer) }).collect();
    let layer_of = |height: f64| tops.iter().position(|top| height < *top).unwrap_or(LAYERS - 1);
    for sample in samples {
        let segments = sample.paths.iter_mut().flatten();
        segments.for_each(|s| s.layer = layer_of(s.height.into()) as u8);
        sample.first_layer = (sample.first_is_leaf == Some(true)).then(|| layer_of(sample.first_height));
    }
    // The last one has no end; a report needs a number.
    let highest = heights.last().copied().unwrap_or(0.0);
    tops.into_iter().map(|top| if top.is_finite() { top } else { highest }).collect()
}

/// Minimum distance between consecutive returns of a pulse, m, and the number of pairs.
fn resolution(recording: &Recording) -> (f64, usize) {
    let mut distances: Vec<f64> = Vec::new();
    for pulse in 0..recording.pulses() {
        let pairs = recording.of_pulse(pulse).windows(2).filter(|pair| pair[1].number == pair[0].number + 1);
        distances.extend(pairs.map(|pair| (pair[1].position - pair[0].position).length()));
    }
    if distances.len() < MIN_PAIRS {
        return (USUAL_RESOLUTION, 0);
    }
    let at = (LEAST_DISTANCE_QUANTILE * distances.len() as f64) as usize;
    (*distances.select_nth_unstable_by(at, f64::total_cmp).1, distances.len())
}

/// Some of the pulses through foliage by which the extinctions were not estimated.
fn samples(
    recording: &Recording,
    (paths, divergence): (&[SensorPath], f64),
    extinctions: &Extinctions,
    is_leaf: &[bool],
    terrain: &Terrain,
) -> Vec<Sample> {
    // The beam of a pulse, and the distance along it to the surface.
    let beam_to_surface = |pulse: usize, path: &SensorPath| {
        let beam = beam(recording, pulse, path);
        let surface = match is_leaf[recording.range(pulse).end - 1] {
            true => surface_distance(&beam, terrain).max(beam.length),
            false => beam.length,
        };
        (beam, surface)
    };
    let is_through_foliage = |pulse: usize, path: &SensorPath| {
        let (beam, surface) = beam_to_surface(pulse, path);
        let mut depth = 0.0;
        extinctions.grid.along(beam.origin, beam.direction, surface, |voxel, from, to| {
            depth += f64::from(extinctions.sigma[voxel]) * (to - from);
        });
        depth > MIN_DEPTH
    };
    let over_ground = |p: DVec3| p.z - terrain.height(p.x, p.y);
    let sample = |chosen: &(usize, &SensorPath)| {
        let (pulse, path) = *chosen;
        let range = recording.range(pulse);
        let (first, last) = (&recording.returns[range.start], &recording.returns[range.end - 1]);
        let (beam, surface) = beam_to_surface(pulse, path);
        let radius = 0.5 * divergence * beam.length;
        let across = beam.direction.any_orthonormal_pair();
        let along = |[u, v]: [f64; 2]| {
            let origin = beam.origin + (across.0 * u + across.1 * v) * radius;
            let mut segments = Vec::new();
            extinctions.grid.along(origin, beam.direction, surface, |voxel, from, to| {
                let sigma = extinctions.sigma[voxel];
                if sigma > 0.0 {
                    let height = over_ground(origin + beam.direction * (0.5 * (from + to))) as f32;
                    let [from, to] = [from, to].map(|t| (t - surface) as f32);
                    segments.push(Segment { from, to, sigma, height, layer: 0 });
                }
            });
            segments
        };
        Sample {
            paths: path_places().map(along),
            first_layer: None,
            first_height: over_ground(first.position),
            radius,
            number: pulse as u64,
            returns: last.of,
            first_is_leaf: (first.number == 1).then_some(is_leaf[range.start]),
            last_is_leaf: (last.number == last.of).then_some(is_leaf[range.end - 1]),
        }
    };
    let mut all: Vec<(usize, &SensorPath)> = Vec::new();
    for (line, path) in recording.lines.iter().zip(paths) {
        let held_out = line.pulses.clone().into_par_iter().filter(|pulse| recording.is_held_out[*pulse]);
        let through: Vec<usize> = held_out.filter(|pulse| is_through_foliage(*pulse, path)).collect();
        all.extend(through.into_iter().map(|pulse| (pulse, path)));
    }
    // Every n-th pulse, so that as many as are needed are left; all of them take gigabytes.
    let step = all.len().div_ceil(MAX_SAMPLES).max(1);
    let chosen: Vec<(usize, &SensorPath)> = all.into_iter().step_by(step).collect();
    chosen.par_iter().map(sample).collect()
}

/// Distance along a beam to the terrain, m.
fn surface_distance(beam: &Beam, terrain: &Terrain) -> f64 {
    let mut t = beam.length;
    for _ in 0..5 {
        let p = beam.origin + beam.direction * t;
        t += (terrain.height(p.x, p.y) - p.z) / beam.direction.z.min(-0.2);
    }
    t
}

fn recorded_shares(samples: &[Sample]) -> [f64; SHARES] {
    let mut counts = [0.0; SHARES];
    let (mut firsts, mut lasts) = (0.0f64, 0.0f64);
    for sample in samples {
        counts[usize::from(sample.returns.clamp(1, 4)) - 1] += 1.0;
        firsts += f64::from(u8::from(sample.first_is_leaf.is_some()));
        lasts += f64::from(u8::from(sample.last_is_leaf.is_some()));
        counts[4] += f64::from(u8::from(sample.first_is_leaf == Some(true)));
        counts[5] += f64::from(u8::from(sample.last_is_leaf == Some(true)));
    }
    let n = samples.len() as f64;
    [
        counts[0] / n,
        counts[1] / n,
        counts[2] / n,
        counts[3] / n,
        counts[4] / firsts.max(1.0),
        counts[5] / lasts.max(1.0),
    ]
}

/// Minimum of a function within bounds: a coarse grid, then steps along each axis that shrink.
fn minimise(mut cost: impl FnMut(&[f64; 2]) -> f64, bounds: [[f64; 2]; 2]) -> [f64; 2] {
    const COARSE: usize = 9;
    let at = |axis: usize, i: usize| {
        let [low, high] = bounds[axis];
        low + (high - low) * (i as f64 + 0.5) / COARSE as f64
    };
    let mut best = ([0.0; 2], f64::INFINITY);
    for i in 0..COARSE * COARSE {
        let x = [at(0, i % COARSE), at(1, i / COARSE)];
        let c = cost(&x);
        if c < best.1 {
            best = (x, c);
        }
    }
    let mut step = bounds.map(|[low, high]| 0.5 * (high - low) / COARSE as f64);
    for _ in 0..6 {
        for axis in 0..2 {
            for sign in [-1.0, 1.0] {
                let mut x = best.0;
                x[axis] = (x[axis] + sign * step[axis]).clamp(bounds[axis][0], bounds[axis][1]);
                let c = cost(&x);
                if c < best.1 {
                    best = (x, c);
                }
            }
        }
        step = step.map(|s| s * 0.6);
    }
    best.0
}
