//! Recorded pulses sent through foliage again: the returns that a receiver finds, by the rules of the
//! simulator.
//!
//! Elements of foliage intercept columns of the footprint at an exponentially distributed optical depth. What
//! the rays of a beam meet returns a Gaussian pulse each, as narrow as the resolution allows, and returns are
//! the maxima of their sum that reach the threshold.

use rayon::prelude::*;
use std::collections::HashMap;
use vlscan_base::rng::{Purpose, Stream};

/// Rays of a beam, as many as the simulator sends at the quality that the scene has.
pub(super) const SUBRAYS: usize = 40;
/// Paths of a beam through voxels, of which each ray takes the nearest one: a footprint is as wide as voxels,
/// or wider, and foliage is not the same across it.
pub(super) const PATHS: usize = 16;
/// Layers of heights over the ground, each with as many first returns.
pub(super) const LAYERS: usize = 10;
/// Shares that are compared: pulses with one, two, three, more returns; first return from foliage, last
/// return from foliage.
pub(super) const SHARES: usize = 6;
/// Samples of the received light within the resolution, and within half the length of a pulse, which is four
/// standard deviations.
const BINS: usize = 16;
const REACH: usize = 2 * BINS;
/// Minimum distance between two returns that is resolved, m.
const MIN_RESOLUTION: f64 = 0.01;

/// A part of a path within a voxel of foliage.
pub(super) struct Segment {
    /// Entry and exit, m from the surface, which is at 0.
    pub from: f32,
    pub to: f32,
    /// Extinction, 1/m.
    pub sigma: f32,
    /// Height of its middle over the ground, m.
    pub height: f32,
    pub layer: u8,
}

/// A recorded pulse through foliage.
pub(super) struct Sample {
    /// The foliage along the paths of [`path_places`].
    pub paths: [Vec<Segment>; PATHS],
    /// Layer of the recorded first return, if that is known and from foliage.
    pub first_layer: Option<usize>,
    pub first_height: f64,
    /// Radius of the footprint at 1/e² of the intensity, m.
    pub radius: f64,
    pub number: u64,
    pub returns: u8,
    pub first_is_leaf: Option<bool>,
    pub last_is_leaf: Option<bool>,
}

/// The ranges of the rays of a beam, m from the surface, ascending, with the layer of the foliage that each
/// met, or [`SURFACE`].
type Ranges = [(f32, u8); SUBRAYS];

/// In place of a layer: the surface below the foliage.
const SURFACE: u8 = u8::MAX;

/// Places in the footprint of a Gaussian beam, exp(−2r²/w²), over its radius w: equal shares of the energy.
fn places<const N: usize>() -> [[f64; 2]; N] {
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    std::array::from_fn(|i| {
        let inner = (i as f64 + 0.5) / N as f64;
        let (sin, cos) = libm::sincos(i as f64 * GOLDEN_ANGLE);
        let distance = (-0.5 * libm::log1p(-inner)).sqrt();
        [distance * cos, distance * sin]
    })
}

/// Places at which the paths of a beam cross its footprint, over the radius of that.
pub(super) fn path_places() -> [[f64; 2]; PATHS] {
    places()
}

/// A maximum of the light that a beam returns.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Echo {
    /// Over that of a surface across the whole beam.
    amplitude: f32,
    /// Layer of what reflects it, or [`SURFACE`].
    layer: u8,
}

/// The light that rays return, along the beam.
struct Waveform {
    /// Distance between two samples, m.
    bin: f32,
    /// The pulse.
    shape: [f32; 2 * REACH + 1],
}

impl Waveform {
    /// Light in pulses of which two of the same strength have two maxima from `resolution` m on: their
    /// standard deviation is half of it.
    fn new(resolution: f64) -> Waveform {
        let shape = |i: usize| {
            let deviations = 2.0 * (i as f64 - REACH as f64) / BINS as f64;
            libm::exp(-0.5 * deviations * deviations) as f32
        };
        let bin = (resolution.max(MIN_RESOLUTION) / BINS as f64) as f32;
        Waveform { bin, shape: std::array::from_fn(shape) }
    }

    /// The maxima of the light that rays of these ranges return, nearest first.
    fn echoes(&self, ranges: &Ranges) -> Vec<Echo> {
        let (mut found, mut light) = (Vec::new(), Vec::new());
        let length = (2 * REACH + 1) as f32 * self.bin;
        for group in ranges.chunk_by(|a, b| b.0 - a.0 < length) {
            let (nearest, farthest) = (group[0].0, group[group.len() - 1].0);
            let place = |range: f32| ((range - nearest) / self.bin).round() as usize;
            light.clear();
            light.resize(place(farthest) + self.shape.len(), 0.0f32);
            for rays in group.chunk_by(|a, b| place(a.0) == place(b.0)) {
                let (at, count) = (place(rays[0].0), rays.len() as f32 / SUBRAYS as f32);
                light[at..].iter_mut().zip(&self.shape).for_each(|(sum, shape)| *sum += count * shape);
            }
            let is_maximum = |around: &[f32]| around[1] > around[0] && around[1] >= around[2];
            for (i, around) in light.windows(3).enumerate().filter(|(_, around)| is_maximum(around)) {
                let range = nearest + (i as f32 + 1.0 - REACH as f32) * self.bin;
                let by_distance =
                    |a: &&(f32, u8), b: &&(f32, u8)| (a.0 - range).abs().total_cmp(&(b.0 - range).abs());
                let layer = group.iter().min_by(by_distance).map_or(SURFACE, |ray| ray.1);
                found.push(Echo { amplitude: around[1], layer });
            }
        }
        found
    }
}

/// Sends the beams of samples through foliage. Trials differ in few settings, so results that several of them
/// share are computed once.
pub(super) struct Simulator<'s> {
    samples: &'s [Sample],
    waveform: Waveform,
    /// Of each ray its place in the footprint, over the radius of that.
    rays: [[f64; 2]; SUBRAYS],
    /// The path that each ray takes.
    paths: [usize; SUBRAYS],
    /// Optical depths of the rays of each sample, by the bits of the size of elements.
    depths: HashMap<u64, Vec<[f64; SUBRAYS]>>,
    /// Maxima of the light from each sample for the present factors, by the bits of the size of elements.
    echoes: HashMap<u64, Vec<Vec<Echo>>>,
    factors: [f64; LAYERS],
}

impl<'s> Simulator<'s> {
    /// A simulator of `samples`; `resolution` is the minimum distance between two returns, m.
    pub fn new(samples: &'s [Sample], resolution: f64) -> Simulator<'s> {
        let (rays, places) = (places::<SUBRAYS>(), path_places());
        let square = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
        let path = |ray: [f64; 2]| {
            let nearest = |a: &usize, b: &usize| square(ray, places[*a]).total_cmp(&square(ray, places[*b]));
            (0..PATHS).min_by(nearest).unwrap_or(0)
        };
        Simulator {
            samples,
            waveform: Waveform::new(resolution),
            rays,
            paths: rays.map(path),
            depths: HashMap::new(),
            echoes: HashMap::new(),
            factors: [1.0; LAYERS],
        }
    }

    /// Changes the factors on the extinctions of layers.
    pub fn set_factors(&mut self, factors: [f64; LAYERS]) {
        if self.factors != factors {
            (self.factors, self.echoes) = (factors, HashMap::new());
        }
    }

    /// The shares of simulated pulses for a size of elements and a threshold, and first returns from foliage
    /// by layer.
    pub fn shares(&mut self, (size, threshold): (f64, f64)) -> ([f64; SHARES], [f64; LAYERS]) {
        let Simulator { samples, waveform, rays, paths, depths, echoes, factors } = self;
        let echoes = echoes.entry(size.to_bits()).or_insert_with(|| {
            let depths = depths
                .entry(size.to_bits())
                .or_insert_with(|| samples.par_iter().map(|sample| sample.depths(rays, size)).collect());
            let pairs = samples.par_iter().zip(&*depths);
            pairs.map(|(sample, depths)| waveform.echoes(&sample.ranges(depths, paths, factors))).collect()
        });
        shares_of(echoes, samples, threshold as f32)
    }
}

/// The shares of pulses by their echoes that reach a threshold, and first returns from foliage by layer.
fn shares_of(all: &[Vec<Echo>], samples: &[Sample], threshold: f32) -> ([f64; SHARES], [f64; LAYERS]) {
    let (mut counts, mut layers) = ([0.0; SHARES], [0.0; LAYERS]);
    let (mut n, mut firsts, mut lasts) = (0.0f64, 0.0f64, 0.0f64);
    for (echoes, sample) in all.iter().zip(samples) {
        let mut returns = echoes.iter().filter(|echo| echo.amplitude >= threshold);
        // A pulse without a return is not in a recording. First and last returns count only where the
        // recorded pulse has them, so that both are shares of the same pulses.
        let Some(first) = returns.next() else { continue };
        let (last, more) = returns.fold((first, 0), |(_, count), echo| (echo, count + 1));
        n += 1.0;
        counts[usize::min(more, 3)] += 1.0;
        if sample.first_is_leaf.is_some() {
            firsts += 1.0;
            if first.layer != SURFACE {
                counts[4] += 1.0;
                layers[usize::from(first.layer)] += 1.0;
            }
        }
        if sample.last_is_leaf.is_some() {
            lasts += 1.0;
            counts[5] += f64::from(u8::from(last.layer != SURFACE));
        }
    }
    let of = [n, n, n, n, firsts, lasts];
    (std::array::from_fn(|i| counts[i] / of[i].max(1.0)), layers)
}

impl Sample {
    /// The optical depths at which elements of a size intercept rays.
    fn depths(&self, rays: &[[f64; 2]; SUBRAYS], size: f64) -> [f64; SUBRAYS] {
        let draws = Stream::new(0, Purpose::FreePath);
        let shift = [0u32, 1].map(|axis| draws.uniform(1, self.number, axis));
        rays.map(|[x, y]| {
            let [u, v] = [x, y].map(|along| self.radius * along / size);
            let [u, v] = [u + shift[0], v + shift[1]].map(|q| q.floor() as i32);
            let column = (u as u32 & 0x7fff) << 15 | (v as u32 & 0x7fff);
            -libm::log(draws.uniform(2, self.number, column))
        })
    }

    /// The ranges at which rays have passed these optical depths of foliage.
    fn ranges(&self, depths: &[f64; SUBRAYS], paths: &[usize; SUBRAYS], factors: &[f64; LAYERS]) -> Ranges {
        let range = |ray: usize| {
            let mut depth = depths[ray] as f32;
            for segment in &self.paths[paths[ray]] {
                let sigma = segment.sigma * factors[usize::from(segment.layer)] as f32;
                let lost = sigma * (segment.to - segment.from);
                if lost >= depth {
                    return (segment.from + depth / sigma, segment.layer);
                }
                depth -= lost;
            }
            (0.0, SURFACE)
        };
        let mut ranges = std::array::from_fn(range);
        ranges.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranges
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RESOLUTION: f64 = 0.7;

    /// The echoes of a beam of which `share` rays meet layer 3, `distance` m before the others meet the
    /// surface.
    fn echoes(share: usize, distance: f32) -> Vec<Echo> {
        let ranges = std::array::from_fn(|i| if i < share { (-distance, 3) } else { (0.0, SURFACE) });
        Waveform::new(RESOLUTION).echoes(&ranges)
    }

    #[test]
    fn a_beam_is_divided_into_its_shares() {
        let found = echoes(10, 5.0);
        assert_eq!(found.iter().map(|e| e.layer).collect::<Vec<_>>(), [3, SURFACE]);
        assert!((found[0].amplitude - 0.25).abs() < 1e-5 && (found[1].amplitude - 0.75).abs() < 1e-5);
        assert_eq!(echoes(0, 5.0).len(), 1);
    }

    #[test]
    fn echoes_of_one_strength_are_two_from_the_resolution_on() {
        assert_eq!(echoes(20, 0.9 * RESOLUTION as f32).len(), 1);
        assert_eq!(echoes(20, 1.15 * RESOLUTION as f32).len(), 2);
        // A weak one beside a strong one needs more.
        assert_eq!(echoes(4, 1.15 * RESOLUTION as f32).len(), 1);
    }

    /// A chain of rays, each within the resolution of the next one, is no echo of the strength of all of
    /// them: light from 3 m is spread over as much.
    #[test]
    fn light_from_along_a_beam_is_spread_along_it() {
        let ranges = std::array::from_fn(|i| (i as f32 * 3.0 / SUBRAYS as f32, 0));
        let found = Waveform::new(RESOLUTION).echoes(&ranges);
        assert!(found.iter().all(|e| e.amplitude < 0.35), "{found:?}");
    }

    #[test]
    fn more_foliage_on_one_side_of_a_beam_makes_more_returns() {
        let sample = |is_within: fn([f64; 2]) -> bool| Sample {
            paths: path_places().map(|place| {
                let sigma = if is_within(place) { 20.0 } else { 0.0 };
                vec![Segment { from: -5.0, to: -4.0, sigma, height: 4.5, layer: 0 }]
            }),
            first_layer: None,
            first_height: 4.5,
            radius: 0.2,
            number: 7,
            returns: 1,
            first_is_leaf: Some(true),
            last_is_leaf: Some(false),
        };
        let singles = |is_within: fn([f64; 2]) -> bool| {
            let samples = [sample(is_within)];
            Simulator::new(&samples, RESOLUTION).shares((50.0, 0.05)).0[0]
        };
        assert_eq!(singles(|_| true), 1.0);
        assert_eq!(singles(|[x, _]| x > 0.0), 0.0, "the other half reaches the ground");
    }
}
