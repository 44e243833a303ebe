//! Times of pulses: their mean rate, its dependence on the phase of the mirror, its deviations from line to
//! line, and intervals that repeat.

use super::clock::{Clock, thinned_clock};
use super::finer_times::{FinerTimes, finer_times};
use super::model::Model;
use super::recording::{LOST, Recording};
use super::repeat::{LinePattern, interval_pattern};
use super::search::{OrderSearch, median_of, search};
use super::solution::Solution;
use crate::marks::Marks;
use libm::{atan2, cos, sin};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::ops::Range;
use vlscan_geom::median;

/// Bins over a revolution of the mirror.
const BINS: usize = 720;
/// Minimum number of intervals in a bin.
const MIN_INTERVALS: usize = 30;
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
        let interval_before = |i: usize| match finer.coarse {
            Some(_) => finer.time(recording, i) - finer.time(recording, i - 1),
            None => recording.interval_before(i),
        };
        let (neighbours, losses) = neighbour_pairs(recording, &interval_before);
        let pairs = || pairs_of(recording, &neighbours, &interval_before);
        let (lost, lost_deviation) = share_lost(&losses);
        let mean = pairs().map(|pair| pair.interval).sum::<f64>() / pairs().count().max(1) as f64;
        let by_phase = intervals_by_phase(recording, model, pairs());
        let lines = factors_of_lines(recording, model, pairs(), &by_phase);
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
        let each_run = |visit: &mut dyn FnMut(&[Option<f64>])| {
            rate.for_each_run(recording, solution, &finer, visit);
        };
        rate.dither = interval_pattern(&each_run);
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

    /// Passes relative deviations of intervals from those of their place and line to `visit`: runs of
    /// neighbouring pulses, `None` where a pulse is missing.
    fn for_each_run(
        &self,
        recording: &Recording,
        solution: &Solution,
        finer: &FinerTimes,
        visit: &mut dyn FnMut(&[Option<f64>]),
    ) {
        let mut run: Vec<Option<f64>> = Vec::new();
        for range in &recording.lines {
            let intervals: Vec<f64> = range.clone().skip(1).map(|i| recording.interval_before(i)).collect();
            let local = local_usual(&intervals, usual(&intervals));
            for ((i, interval), usual) in range.clone().zip(intervals).zip(local) {
                let pulse = recording.pulses.get(i);
                let place =
                    self.by_phase[bin(solution.model.fraction(usize::from(pulse.channel), pulse.time))];
                let expected = place.map(|interval| interval * self.factor(solution, pulse.time));
                let pulses = (interval / usual).round().max(1.0);
                match expected {
                    Some(expected) if pulses == 1.0 => {
                        let interval = finer.time(recording, i + 1) - finer.time(recording, i);
                        run.push(Some(interval / expected - 1.0));
                    }
                    _ if pulses <= MAX_LOST => run.extend(std::iter::repeat_n(None, pulses as usize)),
                    _ => {
                        visit(&run);
                        run.clear();
                    }
                }
            }
            visit(&run);
            run.clear();
        }
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
    /// line next to them.
    pub fn times<'r>(&'r self, solution: &'r Solution, duration: f64) -> impl Iterator<Item = f64> + 'r {
        let rate = solution.model.parameters.mirror.rate.abs();
        let is_backward = solution.model.parameters.mirror.rate < 0.0;
        let (mut count, mut time) = (0, 0.0);
        std::iter::from_fn(move || {
            while time <= duration {
                let (before, part) = (time, solution.model.fraction(0, time));
                let bin = bin(part);
                let found = self.by_phase[bin].map(|interval| {
                    let dither = self.dither.get(count % self.dither.len().max(1)).unwrap_or(&1.0);
                    interval * self.factor(solution, before) * dither
                });
                time += found.unwrap_or_else(|| {
                    // To the next bin.
                    let place = part * BINS as f64;
                    let rest = if is_backward { place - bin as f64 } else { (bin + 1) as f64 - place };
                    (rest + 1e-6) / (BINS as f64 * rate)
                });
                // A step may be smaller than the rounding of a late time.
                if time == before {
                    time = before.next_up();
                }
                if found.is_some() {
                    count += 1;
                    return Some(before);
                }
            }
            None
        })
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

/// Marks of the pulses of all lines, one line after the other, that are the first of two neighbouring ones,
/// and the pulses of each line. `interval_before` is the time from the pulse before to a pulse, s.
fn neighbour_pairs(recording: &Recording, interval_before: &impl Fn(usize) -> f64) -> (Marks, Vec<Losses>) {
    let mut neighbours = Marks::default();
    let mut losses = vec![Losses::default(); recording.lines.len()];
    let all = || recording.lines.iter().flat_map(|line| line.clone().skip(1)).map(interval_before);
    let of_all = usual_of(all);
    for (line, range) in recording.lines.iter().enumerate() {
        let intervals: Vec<f64> = range.clone().skip(1).map(interval_before).collect();
        // Of thinned lines, few intervals are those of neighbouring pulses.
        let usual = Some(usual(&intervals)).filter(|usual| *usual < LOST * of_all).unwrap_or(of_all);
        let local = local_usual(&intervals, usual);
        let of_line = &mut losses[line];
        for (interval, usual) in intervals.into_iter().zip(local) {
            let missing = (interval / usual).round() - 1.0;
            neighbours.push(missing < 1.0);
            if missing <= MAX_LOST {
                of_line.recorded += 1.0;
                of_line.lost += missing.max(0.0);
            }
        }
        // The last pulse of a line.
        range.clone().take(1).for_each(|_| neighbours.push(false));
    }
    (neighbours, losses)
}

/// The pairs of pulses of which the first is marked, see [`neighbour_pairs`].
fn pairs_of<'r>(
    recording: &'r Recording,
    neighbours: &'r Marks,
    interval_before: &'r impl Fn(usize) -> f64,
) -> impl Iterator<Item = Pair> + 'r {
    let of_line = |(line, range): (usize, &'r Range<usize>)| range.clone().map(move |first| (line, first));
    let pulses = recording.lines.iter().enumerate().flat_map(of_line).enumerate();
    pulses.filter(move |(place, _)| neighbours.has(*place)).map(move |(_, (line, first))| {
        let interval = interval_before(first + 1);
        Pair { first, interval, line }
    })
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
    let pulse = recording.pulses.get(pair.first);
    bin(model.fraction(usize::from(pulse.channel), pulse.time))
}

/// Mean interval by phase of the mirror, s; `None` for bins of few intervals.
fn intervals_by_phase(
    recording: &Recording,
    model: &Model,
    pairs: impl Iterator<Item = Pair>,
) -> Vec<Option<f64>> {
    let mut sums = vec![(0.0, 0usize); BINS];
    for pair in pairs {
        let sum = &mut sums[bin_of(recording, model, &pair)];
        *sum = (sum.0 + pair.interval, sum.1 + 1);
    }
    sums.iter().map(|(sum, count)| (*count >= MIN_INTERVALS).then(|| sum / *count as f64)).collect()
}

/// Times of the middles of lines, s, and the factors of their intervals to those of their phase; without
/// lines of few intervals.
fn factors_of_lines(
    recording: &Recording,
    model: &Model,
    pairs: impl Iterator<Item = Pair>,
    by_phase: &[Option<f64>],
) -> Vec<(f64, f64)> {
    let mut sums = vec![(0.0, 0usize); recording.lines.len()];
    for pair in pairs {
        if let Some(usual) = by_phase[bin_of(recording, model, &pair)] {
            let sum = &mut sums[pair.line];
            *sum = (sum.0 + pair.interval / usual, sum.1 + 1);
        }
    }
    let times = recording.lines.iter().map(|line| recording.pulses.time((line.start + line.end) / 2));
    times
        .zip(&sums)
        .filter(|(_, (_, count))| *count >= MIN_INTERVALS)
        .map(|(time, (sum, count))| (time, sum / *count as f64))
        .collect()
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

/// [`usual`] of very many intervals, which are computed several times.
fn usual_of<I: Iterator<Item = f64>>(intervals: impl Fn() -> I) -> f64 {
    let short = search(OrderSearch::of(|count| [count / 20; 2]), &intervals).unwrap_or(0.0);
    median_of(|| intervals().filter(move |interval| *interval < LOST * short)).unwrap_or(0.0)
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
