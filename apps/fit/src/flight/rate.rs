//! Times of pulses: their mean rate, its dependence on the phase of the mirror, its deviations from line to
//! line, and intervals that repeat.

use super::clock::{Clock, thinned_clock};
use super::model::Model;
use super::recording::Recording;
use super::repeat::{LinePattern, interval_pattern};
use super::solution::Solution;
use libm::{atan2, cos, sin};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;
use vlscan_geom::median;

/// Bins over a revolution of the mirror.
const BINS: usize = 720;
/// Minimum number of intervals in a bin.
const MIN_INTERVALS: usize = 30;
/// Intervals longer than the short ones of their line by this factor contain pulses without a return.
const LOST: f64 = 1.6;
/// Gaps of more pulses are the edge of a reflecting area (beside water, say), not lost pulses.
const MAX_LOST: f64 = 20.0;
/// Intervals before and after an interval that determine the usual one there, and the step between the
/// intervals for which it is determined: the rate may change along a line.
const WINDOW: usize = 32;
const WINDOW_STEP: usize = 16;
/// Minimum share of a window's intervals that are about as long as its usual one. Thinned clouds have fewer,
/// because their windows have too few neighbouring pulses.
const MIN_USUAL_SHARE: f64 = 0.5;
/// Plausible pulse rates, 1/s.
const RATES: std::ops::RangeInclusive<f64> = 100.0..=2e7;
/// Maximum plausible ratio of the highest to the lowest rate in a revolution.
const MAX_RATE_RATIO: f64 = 10.0;
/// Share of lost pulses above which the cloud counts as thinned.
pub const MAX_LOST_SHARE: f64 = 0.2;
/// A rate that changes less over the revolution, and from line to line, counts as constant.
const CONSTANT: f64 = 0.003;

/// Maximum rounding of times, as a share of the interval between pulses, at which the times determine it.
const MAX_TIME_STEP: f64 = 0.2;

/// Times of pulses.
#[derive(Clone, Debug)]
pub struct PulseRate {
    /// Pulses per second: the reciprocal of the mean interval between neighbouring pulses.
    pub mean: f64,
    /// Standard deviation of the mean, 1/s; NaN unless two lines have enough pulses.
    pub deviation: f64,
    /// Largest and smallest rate over the recorded part of the revolution, 1/s.
    pub range: (f64, f64),
    /// Standard deviation of the rates of single lines from that of their place, as a share.
    pub of_lines: f64,
    /// Share of the pulses that have no return.
    pub lost: f64,
    /// Standard deviation of this share, by its differences between lines; NaN for a single line.
    pub lost_deviation: f64,
    /// Step of the times, s, if it is too large to determine the intervals of pulses, and if the positions of
    /// the points do not determine them, either.
    pub coarse_step: Option<f64>,
    /// Factors of the intervals of successive pulses, which repeat; empty if they do not.
    pub dither: Vec<f64>,
    /// Factors of the intervals of lines by their number, if they repeat.
    pub pattern: Option<LinePattern>,
    /// Mean interval by place of the mirror, s; `None` where nothing was recorded.
    by_phase: Vec<Option<f64>>,
    /// Factors of the intervals of the recorded lines, by their number.
    factors: BTreeMap<i64, f64>,
    /// Place of the mirror in the middle of lines, as a share of the revolution.
    middle: f64,
}

/// The bin of a place of the mirror.
fn bin(part: f64) -> usize {
    ((part * BINS as f64) as usize).min(BINS - 1)
}

/// Number of the line at `time`, whose middle has the place `middle`.
fn number(solution: &Solution, middle: f64, time: f64) -> i64 {
    let p = &solution.model.parameters;
    (p.mirror.rate * time + p.channels[0].phase / TAU - middle).round() as i64
}

impl PulseRate {
    /// Estimates the rate.
    pub fn of(recording: &Recording, solution: &Solution) -> PulseRate {
        let model = &solution.model;
        let finer = finer_times(recording, solution);
        let interval_before = |i: usize| match finer.coarse.is_some() && finer.step == 0.0 {
            true => finer.times[i] - finer.times[i - 1],
            false => recording.interval_before(i),
        };
        let (pairs, losses) = neighbour_pairs(recording, &interval_before);
        let (lost, lost_deviation) = share_lost(&losses);
        let mean = pairs.iter().map(|pair| pair.interval).sum::<f64>() / pairs.len().max(1) as f64;
        let by_phase = intervals_by_phase(recording, model, &pairs);
        let lines = factors_of_lines(recording, model, &pairs, &by_phase);
        let middle = mean_part(lines.iter().map(|(time, _)| model.fraction(0, *time)));
        let factors: BTreeMap<i64, f64> =
            lines.iter().map(|(time, factor)| (number(solution, middle, *time), *factor)).collect();
        let of_lines = spread(&lines.iter().map(|(_, factor)| *factor).collect::<Vec<_>>());
        let known: Vec<f64> = by_phase.iter().flatten().copied().collect();
        let shortest = known.iter().copied().fold(mean, f64::min);
        let longest = known.iter().copied().fold(mean, f64::max);
        let mut rate = PulseRate {
            mean: 1.0 / mean,
            deviation: match lines.len() {
                0 | 1 => f64::NAN,
                count => of_lines / (count as f64).sqrt() / mean,
            },
            range: (1.0 / longest, 1.0 / shortest),
            of_lines,
            lost,
            lost_deviation,
            coarse_step: finer.coarse.filter(|_| finer.step > 0.0),
            dither: Vec::new(),
            // Lines of several channels have numbers of their own.
            pattern: (!model.has_channels()).then(|| LinePattern::of(&factors)).flatten(),
            by_phase,
            factors,
            middle,
        };
        if rate.of_lines < CONSTANT {
            rate.pattern = None;
        }
        let deviations = rate.deviations(recording, solution, &finer.times);
        rate.dither = interval_pattern(&deviations);
        // Smaller deviations are insignificant, or a residue of the rounding of times.
        let smallest = CONSTANT.max(0.5 * finer.step / mean);
        if rate.dither.iter().all(|factor| (factor - 1.0).abs() < smallest) {
            rate.dither.clear();
        }
        // Intervals that repeat are those of the instrument, also where they are multiples of a clock's.
        let has_pattern = !rate.dither.is_empty() || rate.pattern.is_some();
        if let Some(clock) = thinned_clock(recording, finer.error).filter(|_| !has_pattern) {
            rate.take_clock(clock);
        }
        rate
    }

    /// Replaces the rate of neighbouring pulses of a thinned cloud by that of the pulses that left.
    fn take_clock(&mut self, clock: Clock) {
        self.mean = 1.0 / clock.interval;
        (self.deviation, self.range, self.of_lines) = (f64::NAN, (self.mean, self.mean), 0.0);
        (self.lost, self.lost_deviation) = (clock.lost, f64::NAN);
        self.dither.clear();
        self.pattern = None;
        self.by_phase.fill(None);
        self.factors.clear();
    }

    /// Relative deviations of intervals from those of their place and line: runs of neighbouring pulses,
    /// `None` where a pulse is missing. `times` are those of the pulses, s.
    fn deviations(&self, recording: &Recording, solution: &Solution, times: &[f64]) -> Vec<Vec<Option<f64>>> {
        let mut runs = vec![Vec::new()];
        for range in &recording.lines {
            let intervals: Vec<f64> = range.clone().skip(1).map(|i| recording.interval_before(i)).collect();
            let local = local_usual(&intervals, usual(&intervals));
            runs.push(Vec::new());
            for ((i, interval), usual) in range.clone().zip(intervals).zip(local) {
                let pulse = &recording.pulses[i];
                let place =
                    self.by_phase[bin(solution.model.fraction(usize::from(pulse.channel), pulse.time))];
                let expected = place.map(|interval| interval * self.factor(solution, pulse.time));
                let pulses = (interval / usual).round().max(1.0);
                match (runs.last_mut(), expected) {
                    (Some(run), Some(expected)) if pulses == 1.0 => {
                        run.push(Some((times[i + 1] - times[i]) / expected - 1.0));
                    }
                    (Some(run), _) if pulses <= MAX_LOST => run.extend(vec![None; pulses as usize]),
                    _ => runs.push(Vec::new()),
                }
            }
        }
        runs
    }

    /// True if the rate depends neither on the phase of the mirror nor on the line, or if the recording has
    /// too few pulses for a dependence.
    pub fn is_constant(&self) -> bool {
        let known: Vec<f64> = self.by_phase.iter().flatten().copied().collect();
        if known.is_empty() {
            return true;
        }
        let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
        spread(&known) / mean < CONSTANT && self.of_lines < CONSTANT
    }

    /// True if the mean rate is one that an instrument may have.
    pub fn is_plausible(&self) -> bool {
        RATES.contains(&self.mean)
    }

    /// True if the rates in a revolution are some that an instrument may have.
    pub fn has_plausible_range(&self) -> bool {
        let (low, high) = self.range;
        RATES.contains(&low) && RATES.contains(&high) && high <= MAX_RATE_RATIO * low
    }

    /// Times of pulses from 0 to `duration` in the part of the revolution that was recorded, s. Lines that
    /// were not recorded have the level of their place in the pattern of lines, or else that of the recorded
    /// line next to them. `None` if there are fewer than two, or more than `max`.
    pub fn times(&self, solution: &Solution, duration: f64, max: usize) -> Option<Vec<f64>> {
        let rate = solution.model.parameters.mirror.rate.abs();
        let is_backward = solution.model.parameters.mirror.rate < 0.0;
        let mut times = Vec::new();
        let mut time = 0.0;
        while time <= duration {
            let (before, part) = (time, solution.model.fraction(0, time));
            let bin = bin(part);
            match self.by_phase[bin] {
                Some(interval) => {
                    let dither = self.dither.get(times.len() % self.dither.len().max(1)).unwrap_or(&1.0);
                    times.push(time);
                    time += interval * self.factor(solution, time) * dither;
                }
                None => {
                    // To the next bin.
                    let place = part * BINS as f64;
                    let rest = if is_backward { place - bin as f64 } else { (bin + 1) as f64 - place };
                    time += (rest + 1e-6) / (BINS as f64 * rate);
                }
            }
            // A step may be smaller than the rounding of a late time.
            if time == before {
                time = before.next_up();
            }
            if times.len() > max {
                return None;
            }
        }
        (times.len() > 1).then_some(times)
    }

    /// Factor of the intervals of the line at `time`.
    fn factor(&self, solution: &Solution, time: f64) -> f64 {
        let number = number(solution, self.middle, time);
        if let Some(factor) = self.factors.get(&number) {
            return *factor;
        }
        if let Some(factor) = self.pattern.as_ref().and_then(|pattern| pattern.value(number)) {
            return factor;
        }
        let before = self.factors.range(..number).next_back();
        let after = self.factors.range(number..).next();
        let near = before.into_iter().chain(after).min_by_key(|(other, _)| (*other - number).abs());
        near.map_or(1.0, |(_, factor)| *factor)
    }
}

/// Neighbouring pulses of a line, without missing pulses between them.
struct Pair {
    /// Index of the first pulse.
    first: usize,
    /// s.
    interval: f64,
    /// Index of the line.
    line: usize,
}

/// Pulses of a line.
#[derive(Clone, Copy, Default)]
struct Losses {
    /// Pulses with a point.
    recorded: f64,
    /// Pulses without a point, between others.
    lost: f64,
}

/// Pairs of neighbouring pulses, and the pulses of each line. `interval_before` is the time from the pulse
/// before to a pulse, s.
fn neighbour_pairs(
    recording: &Recording,
    interval_before: &impl Fn(usize) -> f64,
) -> (Vec<Pair>, Vec<Losses>) {
    let mut pairs = Vec::new();
    let mut losses = vec![Losses::default(); recording.lines.len()];
    let all = recording.lines.iter().flat_map(|line| line.clone().skip(1));
    let of_all = usual(&all.map(interval_before).collect::<Vec<_>>());
    for (line, range) in recording.lines.iter().enumerate() {
        let intervals: Vec<f64> = range.clone().skip(1).map(interval_before).collect();
        // Of thinned lines, few intervals are those of neighbouring pulses.
        let usual = Some(usual(&intervals)).filter(|usual| *usual < LOST * of_all).unwrap_or(of_all);
        let local = local_usual(&intervals, usual);
        let of_line = &mut losses[line];
        for ((first, interval), usual) in range.clone().zip(intervals).zip(local) {
            let missing = (interval / usual).round() - 1.0;
            if missing < 1.0 {
                pairs.push(Pair { first, interval, line });
            }
            if missing <= MAX_LOST {
                of_line.recorded += 1.0;
                of_line.lost += missing.max(0.0);
            }
        }
    }
    (pairs, losses)
}

/// Share of the pulses that are lost, and its standard deviation by the differences between lines (that of a
/// ratio of sums); NaN for fewer than two lines.
fn share_lost(losses: &[Losses]) -> (f64, f64) {
    let (recorded, lost) =
        losses.iter().fold((1.0, 0.0), |(recorded, lost), of| (recorded + of.recorded, lost + of.lost));
    let share = lost / (recorded + lost);
    let squares: f64 = losses.iter().map(|of| (of.lost - share * (of.recorded + of.lost)).powi(2)).sum();
    let used = losses.iter().filter(|of| of.recorded > 0.0).count() as f64;
    let deviation = match used > 1.0 {
        true => (squares * used / (used - 1.0)).sqrt() / (recorded + lost),
        false => f64::NAN,
    };
    (share, deviation)
}

/// The usual interval at each of the intervals of a line, s: that of the intervals around, if most of them
/// are about as long, else `of_line`, that of the whole line.
fn local_usual(intervals: &[f64], of_line: f64) -> Vec<f64> {
    let at = |middle: usize| {
        let around = &intervals[middle.saturating_sub(WINDOW)..(middle + WINDOW + 1).min(intervals.len())];
        let usual = usual(around);
        let near = around.iter().filter(|interval| (usual / LOST..usual * LOST).contains(*interval)).count();
        // Some intervals of a thinned cloud may be alike by chance.
        let is_large = around.len() > WINDOW;
        let is_known = is_large && usual > 0.0 && near as f64 >= MIN_USUAL_SHARE * around.len() as f64;
        if is_known { usual } else { of_line }
    };
    let known: Vec<f64> = (0..intervals.len()).step_by(WINDOW_STEP).map(at).collect();
    let nearest = |i: usize| known[((i + WINDOW_STEP / 2) / WINDOW_STEP).min(known.len() - 1)];
    (0..intervals.len()).map(nearest).collect()
}

/// Bin of the mirror's phase at the first pulse of a pair.
fn bin_of(recording: &Recording, model: &Model, pair: &Pair) -> usize {
    let pulse = &recording.pulses[pair.first];
    bin(model.fraction(usize::from(pulse.channel), pulse.time))
}

/// Mean interval by phase of the mirror, s; `None` for bins of few intervals.
fn intervals_by_phase(recording: &Recording, model: &Model, pairs: &[Pair]) -> Vec<Option<f64>> {
    let mut sums = vec![(0.0, 0usize); BINS];
    for pair in pairs {
        let sum = &mut sums[bin_of(recording, model, pair)];
        *sum = (sum.0 + pair.interval, sum.1 + 1);
    }
    sums.iter().map(|(sum, count)| (*count >= MIN_INTERVALS).then(|| sum / *count as f64)).collect()
}

/// Times of the middles of lines, s, and the factors of their intervals to those of their phase; without
/// lines of few intervals.
fn factors_of_lines(
    recording: &Recording,
    model: &Model,
    pairs: &[Pair],
    by_phase: &[Option<f64>],
) -> Vec<(f64, f64)> {
    let mut sums = vec![(0.0, 0usize); recording.lines.len()];
    for pair in pairs {
        if let Some(usual) = by_phase[bin_of(recording, model, pair)] {
            let sum = &mut sums[pair.line];
            *sum = (sum.0 + pair.interval / usual, sum.1 + 1);
        }
    }
    let times = recording.lines.iter().map(|line| recording.pulses[(line.start + line.end) / 2].time);
    times
        .zip(&sums)
        .filter(|(_, (_, count))| *count >= MIN_INTERVALS)
        .map(|(time, (sum, count))| (time, sum / *count as f64))
        .collect()
}

/// Times of pulses, of which only differences between neighbours are of use.
struct FinerTimes {
    /// The step to which they are rounded, s.
    step: f64,
    /// s.
    times: Vec<f64>,
    /// The step of the times in the file, s, if it is too large to determine the intervals of pulses.
    coarse: Option<f64>,
    /// Standard deviation of the times in the file from those of the positions, s, without slow changes.
    error: f64,
}

/// Times of pulses from the positions of their points, where these are finer than the times in the file:
/// the time at which the beam of the model passes the point.
fn finer_times(recording: &Recording, solution: &Solution) -> FinerTimes {
    const STEP: f64 = 1e-7;
    /// Median of the squared second differences of normal deviates of variance 1.
    const OF_ROUGHNESS: f64 = 6.0 * 0.4549;
    let by_time: Vec<f64> = recording.pulses.iter().map(|pulse| pulse.time).collect();
    let by_place: Vec<f64> = recording
        .pulses
        .iter()
        .map(|pulse| {
            let attitude = solution.attitude(pulse.time);
            let channel = usize::from(pulse.channel);
            let at = |time| solution.model.footprint(&attitude, channel, time, pulse.position.z);
            let (before, after) = (at(pulse.time - STEP), at(pulse.time + STEP));
            let (x, y) = ((after.x - before.x) / (2.0 * STEP), (after.y - before.y) / (2.0 * STEP));
            let (off_x, off_y) = (
                0.5 * (before.x + after.x) - pulse.position.x,
                0.5 * (before.y + after.y) - pulse.position.y,
            );
            pulse.time - (off_x * x + off_y * y) / (x * x + y * y).max(1e-12)
        })
        .collect();
    // Changes of the interval from pulse to pulse: rounding makes them large.
    let roughness = |times: &[f64]| {
        let changes = recording.lines.iter().flat_map(|line| line.clone().skip(2)).filter_map(|i| {
            let is_near = recording.interval_before(i).max(recording.interval_before(i - 1))
                < LOST * recording.interval;
            is_near.then(|| (times[i] - 2.0 * times[i - 1] + times[i - 2]).powi(2))
        });
        median(changes).unwrap_or(0.0)
    };
    let differences: Vec<f64> = by_place.iter().zip(&by_time).map(|(place, time)| place - time).collect();
    let error = (roughness(&differences) / OF_ROUGHNESS).sqrt();
    let step = time_step(recording);
    let coarse = coarse_step(recording, step, &by_place);
    // Few intervals differ from the most frequent one where the steps are large.
    let of_times = coarse.map_or_else(|| roughness(&by_time), |step| 0.5 * step * step);
    match roughness(&by_place) < of_times {
        true => FinerTimes { step: 0.0, times: by_place, coarse, error },
        false => FinerTimes { step: coarse.unwrap_or(step), times: by_time, coarse, error },
    }
}

/// The step of times that is too large to determine the intervals of pulses, s; `None` if the times do.
///
/// If it is nearly an interval, most intervals have one value, which differs from that of the positions of
/// the points.
fn coarse_step(recording: &Recording, step: f64, by_place: &[f64]) -> Option<f64> {
    const MAX_DIFFERENCE: f64 = 0.05;
    if step > MAX_TIME_STEP * recording.interval {
        return Some(step);
    }
    let (mut of_times, mut of_places) = (0.0, 0.0);
    for i in recording.lines.iter().flat_map(|line| line.clone().skip(1)) {
        if recording.interval_before(i) < LOST * recording.interval {
            of_times += recording.interval_before(i);
            of_places += by_place[i] - by_place[i - 1];
        }
    }
    // False for NaN.
    ((of_places - of_times).abs() > MAX_DIFFERENCE * of_times).then_some(recording.interval)
}

/// The step to which times are rounded, s, by the few values that intervals have then; 0 if they have many.
fn time_step(recording: &Recording) -> f64 {
    const MAX_VALUES: usize = 40;
    // In units of 10 ns: times since 1980 are stored to 60 ns, seconds of the week to 0.1 ns.
    let near =
        recording.lines.iter().flat_map(|line| line.clone().skip(1)).map(|i| recording.interval_before(i));
    let near = near.filter(|interval| *interval < LOST * recording.interval);
    let values: BTreeSet<i64> = near.map(|interval| (interval * 1e8).round() as i64).collect();
    let smallest = values.iter().zip(values.iter().skip(1)).map(|(a, b)| b - a).min().unwrap_or(0);
    if values.len() > MAX_VALUES { 0.0 } else { 1e-8 * smallest as f64 }
}

/// The usual interval between neighbouring pulses, s, of intervals of which some hold pulses without a
/// return.
fn usual(intervals: &[f64]) -> f64 {
    let mut sorted = intervals.to_vec();
    sorted.sort_by(f64::total_cmp);
    let short = sorted.get(sorted.len() / 20).copied().unwrap_or(0.0);
    sorted.retain(|interval| *interval < LOST * short);
    median(sorted).unwrap_or(0.0)
}

/// Standard deviation.
fn spread(values: &[f64]) -> f64 {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    values.iter().fold(0.0, |sum, value| sum + (value - mean).powi(2) / count).sqrt()
}

/// Mean of places in the revolution, from 0 to 1.
fn mean_part(parts: impl Iterator<Item = f64>) -> f64 {
    let (x, y) = parts.fold((0.0, 0.0), |(x, y), part| (x + cos(TAU * part), y + sin(TAU * part)));
    atan2(y, x) / TAU
}
