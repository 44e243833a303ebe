//! The clock of a thinned cloud: its pulses leave at multiples of a part of the interval between neighbours.

use super::recording::Recording;
use super::search::median_of;
use libm::cos;
use std::f64::consts::TAU;

/// Intervals that differ by less from the usual one, as a share, determine its mean.
const SAME: f64 = 0.01;
/// Steps that differ by less from a whole number of intervals are pulses of the same train.
const WHOLE: f64 = 0.1;
/// Gaps of more usual intervals are the edge of a reflecting area, not lost pulses.
const MAX_GAP: f64 = 20.0;
/// Maximum step from pulse to pulse, in usual intervals: the error of the interval adds up.
const MAX_STEP: f64 = 2000.0;
/// Minimum number of steps that are compared.
const MIN_STEPS: usize = 20;
/// Number of steps that are kept; more are computed whenever they are used.
const MAX_KEPT: usize = if cfg!(test) { 100 } else { 1 << 20 };
/// Maximum number of pulses of the clock in a usual interval.
const MAX_PULSES: u32 = 64;
/// Minimum mean cosine of the phases of steps.
const MIN_COHERENCE: f64 = 0.9;
/// Maximum share of the steps with one remainder: lines that start in step with the mirror have a clock each.
const MAX_ALIKE: f64 = 0.9;
/// Maximum error of times, in intervals of the clock: a larger one is the rounding of times, whose steps look
/// like a clock.
const MAX_ERROR: f64 = 0.1;

/// Decimal steps to which times may be rounded, s, and the maximum difference from a multiple, in steps.
const DECIMALS: [f64; 5] = [1e-3, 1e-4, 1e-5, 1e-6, 1e-7];
const MAX_OFF: f64 = 1e-3;

/// The clock of the pulses of a thinned cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    /// Interval of pulses that left, s.
    pub interval: f64,
    /// Share of the pulses that are not in the cloud, of those within lines.
    pub lost: f64,
}

/// The clock of a thinned cloud; `None` if the usual interval is that of the pulses that left, as far as is
/// known. `error` is the standard deviation of times, s, as far as they differ from pulse to pulse.
///
/// If every tenth pulse is in the cloud, intervals within lines are constant. But the remainder of the steps
/// from line to line is any number of tenths.
pub fn thinned_clock(recording: &Recording, error: f64) -> Option<Clock> {
    let pulses = &recording.pulses;
    let intervals = || {
        let within = recording.lines.iter().flat_map(|line| line.clone().skip(1));
        within.map(|i| recording.interval_before(i))
    };
    let usual = median_of(intervals).filter(|usual| *usual > 0.0)?;
    let alike = || intervals().filter(|interval| (interval / usual - 1.0).abs() < SAME);
    let usual = alike().sum::<f64>() / alike().count().max(1) as f64;
    let between = || {
        let pairs = recording.lines.windows(2).map(|pair| (pair[0].end - 1, pair[1].start));
        pairs
            .filter(|(last, first)| pulses.file_channel(*last) == pulses.file_channel(*first))
            .map(|(last, first)| (pulses.time(first) - pulses.time(last)) / usual)
    };
    let inner = || {
        let steps = intervals().map(|interval| interval / usual);
        steps.filter(|step| (step - step.round()).abs() > WHOLE)
    };
    let steps = || between().chain(inner()).filter(|step| (0.0..MAX_STEP).contains(step));
    let error = error.max(rounding(recording));
    let kept: Vec<f64> = steps().take(MAX_KEPT).collect();
    if kept.len() < MIN_STEPS {
        return None;
    }
    let each_step = |visit: &mut dyn FnMut(f64)| match kept.len() < MAX_KEPT {
        true => kept.iter().copied().for_each(visit),
        false => steps().for_each(visit),
    };
    let is_clock = |number: &u32| {
        error < MAX_ERROR * usual / f64::from(*number)
            && coherence(&each_step, *number) > MIN_COHERENCE
            && largest_share(&each_step, *number) < MAX_ALIKE
    };
    let number = (2..=MAX_PULSES).find(is_clock)?;
    let interval = usual / f64::from(number);
    let gaps = || intervals().filter(|gap| *gap <= MAX_GAP * usual);
    let left: f64 = gaps().map(|gap| (gap / interval).round().max(1.0)).sum();
    Some(Clock { interval, lost: 1.0 - gaps().count() as f64 / left })
}

/// Standard deviation of the rounding of times, s: to the numbers of a file, such as those of 60 ns of
/// seconds since 1980, or to a decimal. The rounding of successive pulses may be nearly the same.
fn rounding(recording: &Recording) -> f64 {
    let latest = recording.start.abs() + recording.duration();
    let of_numbers = latest.next_up() - latest;
    let start = recording.pulses.time(0);
    let is_rounded = |step: &f64| {
        let is_multiple = |time: f64| {
            let count = (time - start) / step;
            (count - count.round()).abs() < MAX_OFF + of_numbers / step
        };
        of_numbers < 0.25 * step && recording.pulses.times().all(is_multiple)
    };
    let of_decimals = DECIMALS.into_iter().find(is_rounded).unwrap_or(0.0);
    of_numbers.max(of_decimals) / 12f64.sqrt()
}

/// Passes each step to a function.
type Steps<'s> = dyn Fn(&mut dyn FnMut(f64)) + 's;

/// Mean cosine of the phases of steps, of a clock with this number of pulses in a usual interval: 1 if all
/// steps are whole numbers of its intervals.
fn coherence(steps: &Steps, pulses: u32) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    steps(&mut |step| {
        sum += cos(TAU * f64::from(pulses) * step);
        count += 1;
    });
    sum / count as f64
}

/// Share of the steps that have the most frequent remainder.
fn largest_share(steps: &Steps, pulses: u32) -> f64 {
    let mut counts = vec![0usize; pulses as usize];
    steps(&mut |step| {
        let number = (step * f64::from(pulses)).round() as i64;
        counts[number.rem_euclid(i64::from(pulses)) as usize] += 1;
    });
    let count: usize = counts.iter().sum();
    counts.into_iter().max().unwrap_or(0) as f64 / count as f64
}

#[cfg(test)]
mod tests {
    use super::super::pulses::Pulse;
    use super::*;
    use vlscan_geom::DVec3;

    /// Lines of 60 to 99 pulses of 1000, at these times, s; of the pulses of all lines every n-th is kept.
    fn recorded(every: usize, time: impl Fn(usize, usize) -> f64) -> Recording {
        let of_line = |line: usize| (0..60 + line * 7 % 40).map(move |k| (line, k));
        let pulses = (0..200)
            .flat_map(of_line)
            .step_by(every)
            .map(|(line, k)| Pulse::on_ground(time(line, k), DVec3::new(k as f64, line as f64, 0.0), 0.0));
        Recording::new(pulses.collect()).unwrap()
    }

    #[test]
    fn the_clock_of_every_tenth_pulse_is_found() {
        let clock = |every| thinned_clock(&recorded(every, |line, k| 5e-6 * (1000 * line + k) as f64), 1e-8);
        for every in [3, 10] {
            let found = clock(every).unwrap();
            assert!((found.interval / 5e-6 - 1.0).abs() < 1e-6, "{found:?}");
            assert!((found.lost - (1.0 - 1.0 / every as f64)).abs() < 0.01, "{found:?}");
        }
        assert_eq!(clock(1), None);
    }

    #[test]
    fn lines_that_start_with_the_mirror_and_rounded_times_are_no_clock() {
        // Each line has a train of its own, half an interval off the one before, or anywhere.
        let halves = recorded(1, |line, k| 5e-6 * ((1000 * line + k) as f64 + 0.5 * line as f64));
        assert_eq!(thinned_clock(&halves, 1e-8), None);
        let shift = |line: usize| ((line * line) as f64 * 0.618_033_988_75).fract();
        let anywhere = recorded(1, |line, k| 5e-6 * ((1000 * line + k) as f64 + shift(line)));
        assert_eq!(thinned_clock(&anywhere, 1e-8), None);
        // Steps of 1 µs in intervals of 5.3 µs, of which the places of points show nothing.
        let rounded = recorded(1, |line, k| 1e-6 * (5.3 * (1000 * line + k) as f64).round());
        assert_eq!(thinned_clock(&rounded, 0.0), None);
        assert!((rounding(&rounded) / 0.2887e-6 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn the_rounding_of_seconds_since_1980_is_no_clock() {
        // Steps of 60 ns, 55.92 of them in an interval: the rounding hardly differs from pulse to pulse.
        let start = 3.2e8 + 0.123_456_789;
        let shift = |line: usize| ((line * line) as f64 * 0.618_033_988_75).fract();
        let time = |line: usize, k: usize| (1000 * line + k) as f64 / 3e5 + 1e-6 * shift(line);
        let late = |every| {
            let recording = recorded(every, |line, k| (start + time(line, k)) - start);
            Recording { start, ..recording }
        };
        assert_eq!(thinned_clock(&late(1), 0.0), None);
        assert!((rounding(&late(1)) / 17.2e-9 - 1.0).abs() < 1e-2);
        // That of every tenth pulse of an even train is found.
        let even = recorded(10, |line, k| (start + (1000 * line + k) as f64 / 3e5) - start);
        let found = thinned_clock(&Recording { start, ..even }, 0.0).unwrap();
        assert!((found.interval * 3e5 - 1.0).abs() < 1e-4, "{found:?}");
    }
}
