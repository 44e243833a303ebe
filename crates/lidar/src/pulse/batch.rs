//! The records of one chunk of pulses.

use super::echo::{Echo, EchoTruth, EchoVelocity, PulseRecord, WaveformRecord};
use crate::flight::PoseSample;

/// Everything that a chunk measured, in the order of emission.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    /// Index of the leg among the survey's legs.
    pub leg: u32,
    /// Epoch of the scene, from 0; kept by [`Batch::clear`].
    pub epoch: u32,
    /// Number of pulses emitted.
    pub emitted: u32,
    /// Leg number in records, if it differs from the survey leg's number: for streamed pulses.
    pub leg_number: Option<u32>,
    /// Pulses that hit and gave no echo because their light was too weak.
    pub weak: WeakPulses,
    /// Pulses that hit and gave no echo because their light came from too near.
    pub near: NearPulses,
    /// Echoes, pulse by pulse, by return number within a pulse.
    pub echoes: Vec<Echo>,
    /// True causes of echoes, if they are recorded or differ from the reported values; see
    /// [`Echo::truth_index`].
    pub truths: Vec<EchoTruth>,
    /// Radial velocities of echoes, if they are recorded, by [`Echo::truth_index`]; the last ones may be
    /// missing.
    pub velocities: Vec<EchoVelocity>,
    /// Waveforms, when they are recorded.
    pub waveforms: Vec<WaveformRecord>,
    /// Samples of all waveforms.
    pub samples: Vec<f64>,
    /// Pulses, when they are recorded.
    pub pulses: Vec<PulseRecord>,
    /// Samples of the platform's trajectory.
    pub poses: Vec<PoseSample>,
}

/// Records of pulses in a batch at some time.
#[derive(Clone, Copy, Debug)]
pub(super) struct BatchMark {
    weak: WeakPulses,
    near: NearPulses,
    echoes: usize,
    truths: usize,
    waveforms: usize,
    samples: usize,
    pulses: usize,
}

/// Pulses whose light came back, but too weak to be detected.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WeakPulses {
    /// Number of these pulses.
    pub count: u64,
    /// Largest amplitude that one of them had at the detector, at most its threshold, nW.
    pub strongest: f64,
    /// Detection threshold of that one, nW.
    pub threshold: f64,
}

impl WeakPulses {
    /// Adds the count of `other`, and its strongest amplitude and threshold if higher.
    pub fn add(&mut self, other: &WeakPulses) {
        if other.count > 0 && (self.count == 0 || other.strongest > self.strongest) {
            (self.strongest, self.threshold) = (other.strongest, other.threshold);
        }
        self.count += other.count;
    }
}

/// Pulses that were discarded because their first light came from the dead zone: without the correction
/// `clip_dead_zone`, the part of a pulse before its peak must come from beyond the minimum range.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NearPulses {
    /// Number of these pulses.
    pub count: u64,
    /// Smallest range of their light, m.
    pub nearest: f64,
    /// End of the dead zone, m: the largest among the devices of these pulses.
    pub dead_zone: f64,
    /// Minimum range of the device with that dead zone, m.
    pub range_min: f64,
}

impl NearPulses {
    /// Adds the count of `other`, its range if smaller, and its dead zone if larger.
    pub fn add(&mut self, other: &NearPulses) {
        if other.count == 0 {
            return;
        }
        if self.count == 0 {
            *self = *other;
            return;
        }
        self.count += other.count;
        self.nearest = self.nearest.min(other.nearest);
        if other.dead_zone > self.dead_zone {
            (self.dead_zone, self.range_min) = (other.dead_zone, other.range_min);
        }
    }
}

impl Batch {
    /// The records so far.
    pub(super) fn mark(&self) -> BatchMark {
        BatchMark {
            weak: self.weak,
            near: self.near,
            echoes: self.echoes.len(),
            truths: self.truths.len(),
            waveforms: self.waveforms.len(),
            samples: self.samples.len(),
            pulses: self.pulses.len(),
        }
    }

    /// Removes the records of pulses since `mark`.
    pub(super) fn truncate(&mut self, mark: &BatchMark) {
        self.weak = mark.weak;
        self.near = mark.near;
        self.echoes.truncate(mark.echoes);
        self.truths.truncate(mark.truths);
        self.velocities.truncate(mark.truths);
        self.waveforms.truncate(mark.waveforms);
        self.samples.truncate(mark.samples);
        self.pulses.truncate(mark.pulses);
    }

    /// Sets the radial velocity of the echo with the last truth.
    pub(super) fn push_velocity(&mut self, velocity: EchoVelocity) {
        self.velocities.resize(self.truths.len().saturating_sub(1), EchoVelocity::UNKNOWN);
        self.velocities.push(velocity);
    }

    /// Empties the batch for the next chunk; memory is kept.
    pub fn clear(&mut self, leg: u32) {
        self.leg = leg;
        self.emitted = 0;
        self.leg_number = None;
        self.weak = WeakPulses::default();
        self.near = NearPulses::default();
        self.echoes.clear();
        self.truths.clear();
        self.velocities.clear();
        self.waveforms.clear();
        self.samples.clear();
        self.pulses.clear();
        self.poses.clear();
    }
}
