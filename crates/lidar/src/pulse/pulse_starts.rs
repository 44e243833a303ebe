//! Starts of the pulses of reflections in a waveform, for pulses that may start between two bins.

use super::detector_settings::DetectorSettings;
use super::lanes::{Block, LANES};
use super::return_profile::ReturnProfile;

/// Starts that are this close before a bin, by rounding, count as its start, bins.
const SNAP: f64 = 1e-9;

/// The starts of the pulses of a profile, in its order.
#[derive(Clone, Debug, Default)]
pub(super) struct PulseStarts {
    /// Bin in which each pulse starts; integers.
    bins: Vec<Block>,
    /// Factors for the fraction of a bin by which each pulse starts late, see
    /// [`super::shape::PulseShape::late`].
    late: Vec<[Block; 3]>,
}

impl PulseStarts {
    /// Computes the starts of `profile` in a waveform whose first pulse starts `first` bins after the start
    /// of bin 0.
    #[inline(always)]
    pub fn compute(&mut self, profile: &ReturnProfile, detector: &DetectorSettings, first: f64) {
        let Some(nearest) = profile.ranges().first() else { return };
        let shape = &detector.shape;
        let bins_per_metre = 1.0 / (detector.light_speed * shape.bin);
        let blocks = profile.blocks().len();
        self.bins.resize(blocks, [0.0; LANES]);
        self.late.resize(blocks, [[0.0; LANES]; 3]);
        for ((range, bins), late) in profile.blocks().iter().zip(&mut self.bins).zip(&mut self.late) {
            let mut by = [0.0; LANES];
            for i in 0..LANES {
                let position = (range[i] - nearest) * bins_per_metre + first;
                bins[i] = (position + SNAP).floor();
                by[i] = position - bins[i];
            }
            *late = shape.late(&by);
        }
    }

    #[inline(always)]
    pub fn bin(&self, i: usize) -> i64 {
        self.bins.as_flattened()[i] as i64
    }

    /// The first pulse after `i` that starts in another bin, at most `count`, and the sum of the factors of
    /// the pulses before it, weighted with their intensities.
    #[inline(always)]
    pub fn sum_of_bin(&self, mut i: usize, count: usize, intensities: &[f64]) -> (usize, [f64; 3]) {
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
