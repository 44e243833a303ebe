//! When pulses leave: their mean rate, its dependence on the place of the mirror, and its deviations from line to line.

use super::model::Model;
use super::recording::Recording;

/// Bins over a revolution of the mirror.
const BINS: usize = 720;
/// Fewer intervals say nothing of a bin.
const MIN_INTERVALS: usize = 30;
/// Intervals longer than the short ones of their line by this factor hold pulses without a return.
const LOST: f64 = 1.6;
/// A rate that changes less over the revolution, and from line to line, counts as constant.
const CONSTANT: f64 = 0.003;

/// When pulses leave.
#[derive(Clone, Debug)]
pub struct PulseRate {
    /// Pulses per second: the reciprocal of the mean interval between neighbouring pulses.
    pub mean: f64,
    /// Its standard deviation, 1/s.
    pub deviation: f64,
    /// Largest and smallest rate over the recorded part of the revolution, 1/s.
    pub range: (f64, f64),
    /// Standard deviation of the rates of single lines from that of their place, as a share.
    pub of_lines: f64,
    /// Share of intervals in which a pulse or more had no return.
    pub lost: f64,
    /// Mean interval by place of the mirror, s; `None` where nothing was recorded.
    by_phase: Vec<Option<f64>>,
    /// Mean time of each line, s, and its intervals as a multiple of those of their place.
    factors: Vec<(f64, f64)>,
}

impl PulseRate {
    /// Estimates the rate.
    pub fn of(recording: &Recording, model: &Model) -> PulseRate {
        let bin = |time: f64| {
            let phase = model.mirror.phase(model.of_mirror(), time);
            ((phase * BINS as f64) as usize).min(BINS - 1)
        };
        // Place, interval and line of each pair of neighbouring pulses.
        let mut pairs = Vec::new();
        let mut lost = 0usize;
        for (number, line) in recording.lines.iter().enumerate() {
            let pulses = &recording.pulses[line.clone()];
            let intervals: Vec<f64> = pulses.windows(2).map(|pair| pair[1].time - pair[0].time).collect();
            let usual = short(intervals.clone());
            for (k, interval) in intervals.into_iter().enumerate() {
                match interval < LOST * usual {
                    true => pairs.push((bin(pulses[k].time), interval, number)),
                    false => lost += 1,
                }
            }
        }
        let count = pairs.len().max(1) as f64;
        let mean = pairs.iter().map(|pair| pair.1).sum::<f64>() / count;
        let mut sums = vec![(0.0, 0usize); BINS];
        for (bin, interval, _) in &pairs {
            sums[*bin].0 += interval;
            sums[*bin].1 += 1;
        }
        let by_phase: Vec<Option<f64>> =
            sums.iter().map(|(sum, count)| (*count >= MIN_INTERVALS).then(|| sum / *count as f64)).collect();
        let mut of_line = vec![(0.0, 0.0); recording.lines.len()];
        for (bin, interval, line) in &pairs {
            if let Some(usual) = by_phase[*bin] {
                of_line[*line].0 += interval / usual;
                of_line[*line].1 += 1.0;
            }
        }
        let mut factors = Vec::new();
        for (line, (sum, count)) in recording.lines.iter().zip(of_line) {
            if count >= MIN_INTERVALS as f64 {
                let middle = recording.pulses[(line.start + line.end) / 2].time;
                factors.push((middle, sum / count));
            }
        }
        let spread = |values: &[f64]| {
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len().max(1) as f64)
                .sqrt()
        };
        let of_lines = spread(&factors.iter().map(|(_, factor)| *factor).collect::<Vec<_>>());
        let known: Vec<f64> = by_phase.iter().flatten().copied().collect();
        let shortest = known.iter().copied().fold(mean, f64::min);
        let longest = known.iter().copied().fold(mean, f64::max);
        let deviation = of_lines / (factors.len().max(1) as f64).sqrt() / mean;
        PulseRate {
            mean: 1.0 / mean,
            deviation,
            range: (1.0 / longest, 1.0 / shortest),
            of_lines,
            lost: lost as f64 / (count + lost as f64),
            by_phase,
            factors,
        }
    }

    /// Whether the rate depends neither on the place of the mirror nor on the line.
    pub fn is_constant(&self) -> bool {
        let known: Vec<f64> = self.by_phase.iter().flatten().copied().collect();
        let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
        let spread = known.iter().map(|t| (t / mean - 1.0).powi(2)).sum::<f64>() / known.len().max(1) as f64;
        spread.sqrt() < CONSTANT && self.of_lines < CONSTANT
    }

    /// Times of pulses from 0 to `duration` in the part of the revolution that was recorded, s; each line has the deviation of
    /// the recorded line next to it. `None` if there are more than `max`.
    pub fn times(&self, model: &Model, duration: f64, max: usize) -> Option<Vec<f64>> {
        let rate = model.of_mirror()[1].abs();
        let is_backward = model.of_mirror()[1] < 0.0;
        let mut times = Vec::new();
        let mut time = 0.0;
        while time <= duration {
            let phase = model.mirror.phase(model.of_mirror(), time);
            let bin = ((phase * BINS as f64) as usize).min(BINS - 1);
            match self.by_phase[bin] {
                Some(interval) => {
                    times.push(time);
                    time += interval * self.factor(time);
                }
                None => {
                    // To the next bin.
                    let place = phase * BINS as f64;
                    let rest = if is_backward { place - bin as f64 } else { (bin + 1) as f64 - place };
                    time += (rest + 1e-6) / (BINS as f64 * rate);
                }
            }
            if times.len() > max {
                return None;
            }
        }
        Some(times)
    }

    /// The factor of the line nearest to `time`.
    fn factor(&self, time: f64) -> f64 {
        let after = self.factors.partition_point(|(t, _)| *t < time);
        let near =
            [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|i| self.factors.get(i));
        near.min_by(|a, b| (a.0 - time).abs().total_cmp(&(b.0 - time).abs()))
            .map_or(1.0, |(_, factor)| *factor)
    }
}

/// The interval that a tenth of these is shorter than.
fn short(mut intervals: Vec<f64>) -> f64 {
    intervals.sort_by(f64::total_cmp);
    intervals.get(intervals.len() / 10).copied().unwrap_or(0.0)
}
