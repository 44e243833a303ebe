//! Times of pulses by the positions of their points, where these are finer than the times in the file.

use super::recording::{LOST, Recording};
use super::search::{OrderSearch, median_of};
use super::solution::Solution;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::ops::Range;

/// Maximum rounding of times, as a share of the interval between pulses, at which the times determine it.
const MAX_TIME_STEP: f64 = 0.2;
/// Number of pulses, about, whose times by position are in memory together.
const BATCH_PULSES: usize = 1 << 18;

/// Times of pulses, of which only differences between neighbours are of use.
pub(super) struct FinerTimes {
    /// The step to which they are rounded, s.
    pub step: f64,
    /// Times by the positions of points, s; `None` if those of the file are finer.
    by_place: Option<Vec<f64>>,
    /// The step of the times in the file, s, if it is too large to determine the intervals of pulses.
    pub coarse: Option<f64>,
    /// Standard deviation of the times in the file from those of the positions, s, without slow changes.
    pub error: f64,
}

impl FinerTimes {
    /// The time of a pulse, s.
    pub fn time(&self, recording: &Recording, i: usize) -> f64 {
        self.by_place.as_ref().map_or_else(|| recording.pulses.time(i), |times| times[i])
    }
}

/// Times of pulses from the positions of their points, where these are finer than the times in the file:
/// the time at which the beam of the model passes the point.
pub(super) fn finer_times(recording: &Recording, solution: &Solution) -> FinerTimes {
    /// Median of the squared second differences of normal deviates of variance 1.
    const OF_ROUGHNESS: f64 = 6.0 * 0.4549;
    let time = |i: usize| recording.pulses.time(i);
    // They are computed in each pass: to keep them takes a third of the memory of the pulses.
    let mut of_places = OrderSearch::median();
    let mut of_differences = OrderSearch::median();
    let mut durations = None;
    while of_places.result().is_none() || of_differences.result().is_none() {
        let mut sums = Durations::default();
        for_each_line(recording, solution, |line, times| {
            let place = |i: usize| times[i - line.start];
            for i in near_pulses(recording, line) {
                of_places.add(roughness(i, place));
                of_differences.add(roughness(i, |i| place(i) - time(i)));
            }
            sums.add(recording, line, place);
        });
        of_places.end_pass();
        of_differences.end_pass();
        durations.get_or_insert(sums);
    }
    let [of_places, of_differences] =
        [of_places, of_differences].map(|search| search.result().flatten().unwrap_or(0.0));
    let error = (of_differences / OF_ROUGHNESS).sqrt();
    let step = time_step(recording);
    let coarse = coarse_step(recording, step, &durations.unwrap_or_default());
    // Few intervals differ from the most frequent one where the steps are large.
    let of_times = || {
        let near = || recording.lines.iter().flat_map(|line| near_pulses(recording, line));
        median_of(|| near().map(|i| roughness(i, time))).unwrap_or(0.0)
    };
    if of_places < coarse.map_or_else(of_times, |step| 0.5 * step * step) {
        let by_place = Some(times_by_place(recording, solution));
        return FinerTimes { step: 0.0, by_place, coarse, error };
    }
    FinerTimes { step: coarse.unwrap_or(step), by_place: None, coarse, error }
}

/// Change of the interval before a pulse from that before, squared, s²: rounding makes it large.
fn roughness(i: usize, time: impl Fn(usize) -> f64) -> f64 {
    (time(i) - 2.0 * time(i - 1) + time(i - 2)).powi(2)
}

/// The pulses of a line before which two intervals have no pulse without a return.
fn near_pulses<'r>(recording: &'r Recording, line: &Range<usize>) -> impl Iterator<Item = usize> + use<'r> {
    line.clone().skip(2).filter(move |i| {
        recording.interval_before(*i).max(recording.interval_before(*i - 1)) < LOST * recording.interval
    })
}

/// Passes the times by position of the pulses of each line to `visit`, in the order of lines.
fn for_each_line(recording: &Recording, solution: &Solution, mut visit: impl FnMut(&Range<usize>, &[f64])) {
    let mut lines = &recording.lines[..];
    while !lines.is_empty() {
        let mut count = 0;
        let is_full = |line: &Range<usize>| {
            count += line.len();
            count > BATCH_PULSES
        };
        let batch = lines.iter().position(is_full).unwrap_or(lines.len()).max(1);
        let (first, others) = lines.split_at(batch);
        let of_line = |line: &Range<usize>| -> Vec<f64> {
            line.clone().map(|i| time_by_place(recording, solution, i)).collect()
        };
        let times: Vec<Vec<f64>> = first.par_iter().map(of_line).collect();
        first.iter().zip(&times).for_each(|(line, times)| visit(line, times));
        lines = others;
    }
}

/// Times of all pulses of lines by their positions, s.
fn times_by_place(recording: &Recording, solution: &Solution) -> Vec<f64> {
    let mut all = vec![0.0; recording.pulses.len()];
    for_each_line(recording, solution, |line, times| all[line.clone()].copy_from_slice(times));
    all
}

/// The time at which the beam passes the point of a pulse, s.
fn time_by_place(recording: &Recording, solution: &Solution, i: usize) -> f64 {
    const STEP: f64 = 1e-7;
    let pulse = recording.pulses.get(i);
    let attitude = solution.attitude(pulse.time);
    let channel = usize::from(pulse.channel);
    let at = |time| solution.model.footprint(&attitude, channel, time, pulse.position.z);
    let (before, after) = (at(pulse.time - STEP), at(pulse.time + STEP));
    let (x, y) = ((after.x - before.x) / (2.0 * STEP), (after.y - before.y) / (2.0 * STEP));
    let (off_x, off_y) =
        (0.5 * (before.x + after.x) - pulse.position.x, 0.5 * (before.y + after.y) - pulse.position.y);
    pulse.time - (off_x * x + off_y * y) / (x * x + y * y).max(1e-12)
}

/// Sums of the intervals between neighbouring pulses, s.
#[derive(Clone, Copy, Default)]
struct Durations {
    of_times: f64,
    of_places: f64,
}

impl Durations {
    fn add(&mut self, recording: &Recording, line: &Range<usize>, place: impl Fn(usize) -> f64) {
        for i in line.clone().skip(1) {
            if recording.interval_before(i) < LOST * recording.interval {
                self.of_times += recording.interval_before(i);
                self.of_places += place(i) - place(i - 1);
            }
        }
    }
}

/// The step of times that is too large to determine the intervals of pulses, s; `None` if the times do.
///
/// If it is nearly an interval, most intervals have one value, which differs from that of the positions of
/// the points.
fn coarse_step(recording: &Recording, step: f64, durations: &Durations) -> Option<f64> {
    const MAX_DIFFERENCE: f64 = 0.05;
    if step > MAX_TIME_STEP * recording.interval {
        return Some(step);
    }
    let Durations { of_times, of_places } = *durations;
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
