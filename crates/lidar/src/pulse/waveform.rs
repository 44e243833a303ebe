//! The received waveform (spec pulse-physics §4.2, §4.3).

use super::detector_settings::DetectorSettings;
use super::lanes::{Block, LANES};
use super::pulse_starts::PulseStarts;
use super::return_profile::ReturnProfile;

/// Maximum length of a recorded waveform, samples (1,250 km of 0.25 ns bins).
pub(super) const MAX_RECORD_SAMPLES: u64 = 1 << 24;

/// Longest gap without light that is stored, bins; longer gaps exist as differences of bin numbers only, so
/// that a leaf at 5 m and a wall at 5 km need only the memory of two leaves.
const MAX_STORED_GAP: u64 = 64;

/// A waveform: bins of amplitude over one-way travel time, from bin 0 at [`Waveform::start`]. Bins outside
/// the segments hold zero.
#[derive(Clone, Debug, Default)]
pub(super) struct Waveform {
    /// Travel time of bin 0, ns.
    pub start: f64,
    pub bins: u64,
    segments: Vec<Segment>,
    /// Zero after the last segment.
    samples: Vec<f64>,
    /// Positions of the peaks of the reflections' pulses, bins.
    positions: Vec<Block>,
    starts: PulseStarts,
}

/// Samples that are appended at a time.
const SAMPLES_PER_RESIZE: usize = 128;

/// A run of stored bins.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    /// Number of its first bin.
    pub first: u64,
    /// Index of its first sample.
    at: usize,
    len: usize,
}

impl Waveform {
    /// Replaces the waveform by the sum of the pulses of `profile`; `false` if a reflection in the dead zone
    /// discards it.
    #[inline(always)]
    pub fn receive(&mut self, profile: &ReturnProfile, detector: &DetectorSettings) -> bool {
        self.segments.clear();
        self.samples.clear();
        self.bins = 0;
        let (Some(&nearest), Some(&farthest)) = (profile.ranges().first(), profile.ranges().last()) else {
            return true;
        };
        let (shape, corrections) = (&detector.shape, &detector.corrections);
        let (c, bin) = (detector.light_speed, shape.bin);
        let lead = shape.lead(corrections.fractional_bins);
        let (start, first) = detector.waveform_start(nearest);
        let mut end = farthest / c + shape.duration - lead + bin;
        let mut count = profile.ranges().len();
        if detector.max_duration > 0.0 && end - start > detector.max_duration {
            end = start + detector.max_duration;
            let limit = c * detector.max_duration + if corrections.limit_from_first { nearest } else { 0.0 };
            count = profile.ranges().iter().take_while(|range| **range <= limit).count();
        }
        if detector.is_in_dead_zone(start) {
            return false;
        }
        self.start = start;
        self.bins = ((end / bin).ceil() - (start / bin).ceil()) as u64;
        if corrections.fractional_bins {
            self.add_between_bins(count, profile, first, detector);
        } else {
            self.place(profile.blocks(), detector);
            self.add_in_bins(count, profile.intensities(), detector);
        }
        self.store_tail();
        true
    }

    /// Computes the position of the peak of each reflection's pulse, bins.
    #[inline(always)]
    fn place(&mut self, ranges: &[Block], detector: &DetectorSettings) {
        let (c, bin, start) = (detector.light_speed, detector.shape.bin, self.start);
        // Rounding must not cut off the start of the first pulse.
        let min = detector.shape.peak as f64;
        self.positions.resize(ranges.len(), [0.0; LANES]);
        let positions = self.positions.iter_mut().zip(ranges);
        match detector.shape.bins_per_ns {
            Some(scale) => positions.for_each(|(to, from)| {
                for i in 0..LANES {
                    let position = (from[i] / c - start) * scale;
                    to[i] = if position < min { min } else { position };
                }
            }),
            None => positions.for_each(|(to, from)| {
                for i in 0..LANES {
                    let position = (from[i] / c - start) / bin;
                    to[i] = if position < min { min } else { position };
                }
            }),
        }
    }

    /// Adds pulses that start with their bin, summing the pulses of each bin first.
    #[inline(always)]
    fn add_in_bins(&mut self, count: usize, intensities: &[f64], detector: &DetectorSettings) {
        let shape = &detector.shape;
        let mut i = 0;
        while i < count {
            let bin = self.positions.as_flattened()[i] as i64;
            let mut intensity = 0.0;
            while i < count && self.positions.as_flattened()[i] as i64 == bin {
                intensity += intensities[i];
                i += 1;
            }
            self.add(&shape.samples, bin.saturating_sub(shape.peak as i64), intensity);
        }
    }

    /// Adds pulses that start within bins, the first one `first` bins after the start of bin 0, summing the
    /// pulses of each bin first.
    #[inline(always)]
    fn add_between_bins(
        &mut self,
        count: usize,
        profile: &ReturnProfile,
        first: f64,
        detector: &DetectorSettings,
    ) {
        let shape = &detector.shape;
        let mut starts = std::mem::take(&mut self.starts);
        starts.compute(profile, detector, first);
        let mut i = 0;
        while i < count {
            let (next, late) = starts.sum_of_bin(i, count, profile.intensities());
            let bin = starts.bin(i);
            let max_len = usize::try_from(self.bins.saturating_sub(bin as u64)).unwrap_or(usize::MAX);
            let len = shape.samples.len().min(max_len);
            if len > 0 {
                let segment = self.segment_for(bin as u64, len);
                let offset = segment.at + (bin as u64 - segment.first) as usize;
                shape.add_late(&late, &mut self.samples[offset..offset + len]);
            }
            i = next;
        }
        self.starts = starts;
    }

    /// Adds `intensity` times the pulse from bin `from` on, clipped to bins from 0 to the last. Successive
    /// calls must not start earlier.
    #[inline(always)]
    fn add(&mut self, pulse: &[f64], from: i64, intensity: f64) {
        let skip = (-from).max(0) as usize;
        let from = from.max(0) as u64;
        let Some(pulse) = pulse.get(skip..) else { return };
        let max_len = usize::try_from(self.bins.saturating_sub(from)).unwrap_or(usize::MAX);
        let pulse = &pulse[..pulse.len().min(max_len)];
        if pulse.is_empty() {
            return;
        }
        let segment = self.segment_for(from, pulse.len());
        let offset = segment.at + (from - segment.first) as usize;
        let (blocks, rest) = self.samples[offset..offset + pulse.len()].as_chunks_mut::<LANES>();
        let (of_pulse, of_rest) = pulse.as_chunks::<LANES>();
        for (samples, power) in blocks.iter_mut().zip(of_pulse) {
            for i in 0..LANES {
                samples[i] += power[i] * intensity;
            }
        }
        for (sample, power) in rest.iter_mut().zip(of_rest) {
            *sample += power * intensity;
        }
    }

    /// Makes the last segment longer, or appends one, so that it stores `len` bins from `from` on, and
    /// returns it.
    #[inline(always)]
    fn segment_for(&mut self, from: u64, len: usize) -> Segment {
        let stored = self.segments.last().map_or(0, |s| s.at + s.len);
        let first = match self.segments.last() {
            Some(s) if from <= s.first + s.len as u64 + MAX_STORED_GAP => None,
            None if from <= MAX_STORED_GAP => Some(0),
            _ => Some(from),
        };
        if let Some(first) = first {
            self.segments.push(Segment { first, at: stored, len: 0 });
        }
        let s = self.segments.last_mut().expect("there is one now");
        s.len = s.len.max((from - s.first) as usize + len);
        let s = *s;
        self.fill_to(s.at + s.len);
        s
    }

    /// Appends zeros up to `stored` samples.
    #[inline(always)]
    fn fill_to(&mut self, stored: usize) {
        if self.samples.len() < stored {
            self.samples.resize(stored.next_multiple_of(SAMPLES_PER_RESIZE), 0.0);
        }
    }

    /// Stores the bins after the last light if they are few.
    fn store_tail(&mut self) {
        let Some(s) = self.segments.last_mut() else { return };
        let tail = self.bins - (s.first + s.len as u64);
        if tail <= MAX_STORED_GAP {
            s.len += tail as usize;
            let stored = s.at + s.len;
            self.fill_to(stored);
        }
    }

    /// Stores all bins without gaps if there are at most `max`.
    pub fn store_gaps(&mut self, max: u64) {
        let stored: usize = self.segments.iter().map(|s| s.len).sum();
        if self.bins > max || self.bins == stored as u64 {
            return;
        }
        let mut samples = Vec::new();
        self.append_to(&mut samples, 0);
        self.segments.clear();
        self.segments.push(Segment { first: 0, at: 0, len: samples.len() });
        self.samples = samples;
    }

    /// Calls `change` with each segment: the number of its first bin, and its bins.
    pub fn change_segments(&mut self, mut change: impl FnMut(u64, &mut [f64])) {
        for s in &self.segments {
            change(s.first, &mut self.samples[s.at..s.at + s.len]);
        }
    }

    pub fn of_samples(samples: &[f64]) -> Waveform {
        let whole = Segment { first: 0, at: 0, len: samples.len() };
        Waveform {
            start: 0.0,
            bins: samples.len() as u64,
            segments: vec![whole],
            samples: samples.to_vec(),
            ..Waveform::default()
        }
    }

    /// The segments, ascending and disjoint: the number of their first bin, and their bins.
    pub fn segments(&self) -> impl Iterator<Item = (u64, &[f64])> {
        self.segments.iter().map(|s| (s.first, &self.samples[s.at..s.at + s.len]))
    }

    pub fn segment_count(&self) -> usize {
        self.segments.len()
    }

    /// Segment `i`, see [`Waveform::segments`].
    pub fn segment(&self, i: usize) -> (u64, &[f64]) {
        let s = self.segments[i];
        (s.first, &self.samples[s.at..s.at + s.len])
    }

    pub fn at(&self, i: u64) -> f64 {
        self.segments()
            .find_map(|(first, bins)| bins.get(usize::try_from(i.checked_sub(first)?).ok()?))
            .copied()
            .unwrap_or(0.0)
    }

    /// Travel time of the last bin, ns, in bins of `bin` ns.
    pub fn end(&self, bin: f64) -> f64 {
        self.start + (self.bins as f64 - 1.0) * bin
    }

    /// Appends all bins from number `skipped` on, gaps included.
    pub fn append_to(&self, samples: &mut Vec<f64>, skipped: u64) {
        let base = samples.len();
        samples.resize(base + self.bins.saturating_sub(skipped) as usize, 0.0);
        for (first, bins) in self.segments() {
            let cut = skipped.saturating_sub(first).min(bins.len() as u64);
            let at = base + (first + cut).saturating_sub(skipped) as usize;
            let bins = &bins[cut as usize..];
            samples[at..at + bins.len()].copy_from_slice(bins);
        }
    }

    /// Number of the first bin that is not nearer than `range_min`, m.
    pub fn first_beyond(&self, range_min: f64, detector: &DetectorSettings) -> u64 {
        let bins = (range_min / detector.light_speed - self.start) / detector.shape.bin;
        bins.ceil().max(0.0) as u64
    }
}
