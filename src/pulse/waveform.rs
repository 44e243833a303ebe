//! The received waveform (spec pulse-physics §4.2, §4.3).

use super::instrument::Instrument;

/// Bins without any light that are still stored when light surrounds them; longer gaps only exist as a difference of
/// bin numbers, so that a leaf at 5 m and a wall at 5 km take no more memory than two leaves.
const LONGEST_STORED_GAP: u64 = 64;

/// A waveform: bins of amplitude over one-way travel time, from bin 0 at [`Waveform::start`]. Bins outside the segments
/// hold zero.
#[derive(Clone, Debug, Default)]
pub(super) struct Waveform {
    /// Travel time of bin 0, ns.
    pub start: f64,
    /// Number of bins.
    pub bins: u64,
    segments: Vec<Segment>,
    samples: Vec<f64>,
}

/// A run of stored bins.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    /// Number of its first bin.
    pub first: u64,
    at: usize,
    len: usize,
}

impl Waveform {
    /// Adds up the pulses that `returns` (range, intensity), ascending, send back. `false` when a return lies so near
    /// that nothing of this pulse is received.
    pub fn receive(&mut self, returns: &[(f64, f64)], instrument: &Instrument) -> bool {
        self.segments.clear();
        self.samples.clear();
        self.bins = 0;
        let (Some(&(nearest, _)), Some(&(farthest, _))) = (returns.first(), returns.last()) else {
            return true;
        };
        let shape = &instrument.shape;
        let (c, bin) = (instrument.light_speed, shape.bin);
        let lead = shape.peak as f64 * bin;
        let mut start = nearest / c - lead;
        let mut end = farthest / c + shape.length - lead + bin;
        let mut limit = farthest;
        if instrument.longest > 0.0 && end - start > instrument.longest {
            end = start + instrument.longest;
            limit =
                c * instrument.longest + if instrument.corrections.limit_from_first { nearest } else { 0.0 };
        }
        let blind = instrument.range_min / c;
        if blind > start {
            if !instrument.corrections.clip_dead_zone {
                return false;
            }
            // Rounding must not put the first bin before the minimum range.
            start = if c * blind < instrument.range_min { blind.next_up() } else { blind };
        }
        self.start = start;
        self.bins = ((end / bin).ceil() - (start / bin).ceil()) as u64;
        for run in Starts::of(returns, limit, start, instrument) {
            self.add(&shape.samples, run.bin, run.intensity);
            if instrument.corrections.fractional_bins {
                self.add(&shape.lateness[0], run.bin, run.late[0]);
                self.add(&shape.lateness[1], run.bin, run.late[1]);
            }
        }
        self.store_tail();
        true
    }

    /// Adds `intensity` times the pulse from bin `from` on; what lies before bin 0 or behind the last is cut off. Later
    /// calls do not begin earlier.
    fn add(&mut self, pulse: &[f64], from: i64, intensity: f64) {
        let skip = (-from).max(0) as usize;
        let from = from.max(0) as u64;
        let Some(pulse) = pulse.get(skip..) else { return };
        let room = usize::try_from(self.bins.saturating_sub(from)).unwrap_or(usize::MAX);
        let pulse = &pulse[..pulse.len().min(room)];
        if pulse.is_empty() {
            return;
        }
        let segment = self.segment_for(from, pulse.len());
        let offset = segment.at + (from - segment.first) as usize;
        for (sample, power) in self.samples[offset..offset + pulse.len()].iter_mut().zip(pulse) {
            *sample += power * intensity;
        }
    }

    /// The segment that stores `len` bins from `from` on: the last one, made longer, or a new one.
    fn segment_for(&mut self, from: u64, len: usize) -> Segment {
        let stored = self.samples.len();
        let first = match self.segments.last() {
            Some(s) if from <= s.first + s.len as u64 + LONGEST_STORED_GAP => None,
            None if from <= LONGEST_STORED_GAP => Some(0),
            _ => Some(from),
        };
        if let Some(first) = first {
            self.segments.push(Segment { first, at: stored, len: 0 });
        }
        let s = self.segments.last_mut().expect("there is one now");
        s.len = s.len.max((from - s.first) as usize + len);
        self.samples.resize(s.at + s.len, 0.0);
        *s
    }

    /// Stores the bins behind the last light if they are few.
    fn store_tail(&mut self) {
        let Some(s) = self.segments.last_mut() else { return };
        let tail = self.bins - (s.first + s.len as u64);
        if tail <= LONGEST_STORED_GAP {
            s.len += tail as usize;
            self.samples.resize(s.at + s.len, 0.0);
        }
    }

    /// Stored runs, ascending and apart from each other.
    pub fn segments(&self) -> impl Iterator<Item = (u64, &[f64])> {
        self.segments.iter().map(|s| (s.first, &self.samples[s.at..s.at + s.len]))
    }

    /// Number of segments.
    pub fn segment_count(&self) -> usize {
        self.segments.len()
    }

    /// Segment `i`: the number of its first bin, and its bins.
    pub fn segment(&self, i: usize) -> (u64, &[f64]) {
        let s = self.segments[i];
        (s.first, &self.samples[s.at..s.at + s.len])
    }

    /// Amplitude of bin `i`.
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

    /// Appends all bins, gaps included.
    pub fn append_to(&self, samples: &mut Vec<f64>) {
        let base = samples.len();
        samples.resize(base + self.bins as usize, 0.0);
        for (first, bins) in self.segments() {
            let at = base + first as usize;
            samples[at..at + bins.len()].copy_from_slice(bins);
        }
    }
}

/// Returns that begin in the same bin, added up.
#[derive(Clone, Copy, Debug)]
struct Start {
    /// First bin of their pulses; negative where the blind zone cuts them.
    bin: i64,
    /// Their intensities together.
    intensity: f64,
    /// The same times what `PulseShape::late` says of starts between bins.
    late: [f64; 2],
}

/// Groups ascending returns by the bin in which they begin.
struct Starts<'a> {
    returns: std::iter::Peekable<std::slice::Iter<'a, (f64, f64)>>,
    limit: f64,
    start: f64,
    instrument: &'a Instrument,
}

impl<'a> Starts<'a> {
    fn of(returns: &'a [(f64, f64)], limit: f64, start: f64, instrument: &'a Instrument) -> Starts<'a> {
        Starts { returns: returns.iter().peekable(), limit, start, instrument }
    }

    /// First bin of the pulse from `range`, and how much later than that bin it begins.
    fn place(&self, range: f64) -> (i64, f64) {
        let Instrument { shape, corrections, .. } = self.instrument;
        let peak = shape.peak as f64;
        let mut position = (range / self.instrument.light_speed - self.start) / shape.bin;
        // Only the blind zone may cut off a pulse's front; otherwise rounding must not.
        if !corrections.clip_dead_zone && position < peak {
            position = peak;
        }
        ((position as i64).saturating_sub(shape.peak as i64), position.fract())
    }
}

impl Iterator for Starts<'_> {
    type Item = Start;

    fn next(&mut self) -> Option<Start> {
        let mut run: Option<Start> = None;
        while let Some(&&(range, intensity)) = self.returns.peek() {
            if range > self.limit {
                return run;
            }
            let (bin, by) = self.place(range);
            let start = run.get_or_insert(Start { bin, intensity: 0.0, late: [0.0; 2] });
            if start.bin != bin {
                return run;
            }
            if self.instrument.corrections.fractional_bins {
                let [now, late, later] = self.instrument.shape.late(by);
                start.intensity += intensity * now;
                start.late[0] += intensity * late;
                start.late[1] += intensity * later;
            } else {
                start.intensity += intensity;
            }
            self.returns.next();
        }
        run
    }
}
