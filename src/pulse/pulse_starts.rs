//! Where pulses begin in the bins of a waveform, when they may begin within one.

use super::detector::DetectorSettings;
use super::lanes::{Block, LANES};
use super::return_profile::ReturnProfile;

/// What rounding left that little before the beginning of a bin begins there, bins.
const SNAP: f64 = 1e-9;

/// The beginnings of the pulses of some light, in its order.
#[derive(Clone, Debug, Default)]
pub(super) struct PulseStarts {
    /// Whole numbers.
    bins: Vec<Block>,
    /// See [`super::shape::PulseShape::late`].
    late: Vec<[Block; 3]>,
}

impl PulseStarts {
    /// Computes those of `light` in a waveform whose first pulse begins `first` bins behind the beginning of bin 0.
    #[inline(always)]
    pub fn compute(&mut self, light: &ReturnProfile, detector: &DetectorSettings, first: f64) {
        let Some(nearest) = light.ranges().first() else { return };
        let shape = &detector.shape;
        let bins_per_metre = 1.0 / (detector.light_speed * shape.bin);
        let blocks = light.blocks().len();
        self.bins.resize(blocks, [0.0; LANES]);
        self.late.resize(blocks, [[0.0; LANES]; 3]);
        for ((range, bins), late) in light.blocks().iter().zip(&mut self.bins).zip(&mut self.late) {
            let mut by = [0.0; LANES];
            for i in 0..LANES {
                let position = (range[i] - nearest) * bins_per_metre + first;
                bins[i] = (position + SNAP).floor();
                by[i] = position - bins[i];
            }
            *late = shape.late(&by);
        }
    }

    /// The bin that pulse `i` begins in.
    #[inline(always)]
    pub fn bin(&self, i: usize) -> i64 {
        self.bins.as_flattened()[i] as i64
    }

    /// The factors of the pulses of those intensities that begin in the same bin as pulse `i`, and the first of the next bin,
    /// at most `count`.
    #[inline(always)]
    pub fn of_one_bin(&self, mut i: usize, count: usize, intensities: &[f64]) -> (usize, [f64; 3]) {
        let bins = self.bins.as_flattened();
        let (bin, mut sums) = (bins[i], [0.0; 3]);
        while i < count && bins[i] == bin {
            let late = &self.late[i / LANES];
            for (sum, late) in sums.iter_mut().zip(late) {
                *sum += intensities[i] * late[i % LANES];
            }
            i += 1;
        }
        (i, sums)
    }
}
