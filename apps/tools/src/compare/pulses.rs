//! Pulses and scan lines of a recording: points of one time and source are one pulse; lines end where times
//! have a gap or the scan angle turns.

mod distances;

pub(super) use distances::distance;

use super::cut::Cut;
use distances::distance_to_line;
use rayon::prelude::*;
use std::ops::Range;
use vlscan_formats::PulseGroups;

/// Minimum number of pulses of a line whose figures are used.
const MIN_LINE_PULSES: usize = 5;
/// Number of pulses after which the memory of their points is released.
const PULSES_IN_MEMORY: usize = 1 << 20;
/// Minimum number of lines for recognising a pattern.
const MIN_LINES: usize = 10;
/// Largest ratio of the time between two lines to the usual one; a longer one lies between strips.
const MAX_LINE_GAP: f64 = 3.0;

/// A pulse with echoes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pulse {
    /// Leg (point source) and channel.
    pub source: (u16, u8),
    /// Time, s.
    pub time: f64,
    /// Scan angle, degrees; 0 if unknown.
    pub angle: f64,
}

/// The pulses of a cloud by source and time, and its scan lines. Of a pulse only its first echo is kept,
/// which has its time, source and scan angle.
pub(super) struct Pulses<'a> {
    cut: &'a Cut<'a>,
    /// The first echo of each pulse: number of the point in the cut.
    first: Vec<u32>,
    /// Number of returns of each pulse, by the file or, if it has none, of those that are in it.
    returns: Vec<u8>,
    /// The line of each pulse.
    pub line_of: Vec<u32>,
    /// Pulses of each line.
    pub lines: Vec<Range<usize>>,
    /// The pulse of each point of the cut, until it is taken.
    pulse_of: Vec<u32>,
    /// True if the lines are those of a scanner; otherwise there is one for each source.
    pub has_lines: bool,
    pub has_angles: bool,
}

/// Reason why the points of a cloud have no pulses.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum PulsesError {
    /// Points that were left out, and pulses with them.
    #[error("it has too many points for the memory limit; divide it into parts")]
    Thinned,
    /// Points without times.
    #[error("it has no GPS times")]
    NoTimes,
    /// Points of one time.
    #[error("all its GPS times are equal")]
    EqualTimes,
    /// Times that different pulses share, with the number of their points.
    #[error(
        "{0} of its points have the source, time and return number of another one: its times are too coarse \
         to tell pulses"
    )]
    CoarseTimes(usize),
}

/// A cloud without pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the {cloud} cloud: {reason}")]
pub(super) struct MissingPulses {
    /// Name of the cloud: first or second.
    pub cloud: &'static str,
    pub reason: PulsesError,
}

/// The first echo and the number of returns of a pulse with some points by the number of their return, of
/// which there is at least one.
fn first_echo(cut: &Cut, points: &[u32]) -> (u32, u8) {
    let (mut first, mut least, mut stated) = (points[0], u8::MAX, 0);
    for i in points {
        let Some((number, count)) = cut.returns(*i as usize) else { continue };
        stated = stated.max(count);
        if number < least {
            (first, least) = (*i, number);
        }
    }
    (first, if stated > 0 { stated } else { points.len().min(255) as u8 })
}

impl<'a> Pulses<'a> {
    /// The pulses of the points of a cut.
    ///
    /// # Errors
    /// Points without times, or with too coarse ones.
    pub fn of(cut: &'a Cut<'a>) -> Result<Pulses<'a>, PulsesError> {
        if cut.points.is_thinned() {
            return Err(PulsesError::Thinned);
        }
        let order = order_by_pulse(cut)?;
        let (mut first, mut returns) = (Vec::new(), Vec::new());
        let (mut pulse_of, mut ambiguous) = (vec![0; cut.len()], 0);
        for points in order.chunk_by(|a, b| key(cut, *a) == key(cut, *b)) {
            let numbers = points.windows(2).map(|pair| (number(cut, pair[0]), number(cut, pair[1])));
            ambiguous += numbers.filter(|(number, next)| number == next && *number > 0).count();
            points.iter().for_each(|i| pulse_of[*i as usize] = first.len() as u32);
            let (echo, count) = first_echo(cut, points);
            if first.len().is_multiple_of(PULSES_IN_MEMORY) {
                cut.points.release();
            }
            first.push(echo);
            returns.push(count);
        }
        drop(order);
        if !PulseGroups::are_distinct(ambiguous, first.len()) {
            return Err(PulsesError::CoarseTimes(ambiguous));
        }
        first.shrink_to_fit();
        returns.shrink_to_fit();
        let mut found = Pulses {
            cut,
            first,
            returns,
            line_of: Vec::new(),
            lines: Vec::new(),
            pulse_of,
            has_lines: false,
            has_angles: false,
        };
        let has_angles = (1..found.count()).any(|number| found.angle(number) != found.angle(0));
        found.has_angles = has_angles;
        found.find_lines();
        cut.points.release();
        Ok(found)
    }

    /// Number of pulses.
    pub fn count(&self) -> usize {
        self.first.len()
    }

    /// A pulse by its number.
    pub fn pulse(&self, number: usize) -> Pulse {
        Pulse { source: self.source(number), time: self.time(number), angle: self.angle(number) }
    }

    /// Number of returns and first echo of each pulse.
    pub fn echoes(&self) -> impl Iterator<Item = (u8, u32)> + '_ {
        self.returns.iter().copied().zip(self.first.iter().copied())
    }

    /// Scan angle of each pulse, degrees, with its line.
    pub fn angles(&self) -> impl Iterator<Item = (f64, u32)> + '_ {
        (0..self.count()).map(move |number| (self.angle(number), self.line_of[number]))
    }

    /// All pulses in their order.
    #[cfg(test)]
    pub fn iter(&self) -> impl Iterator<Item = Pulse> + '_ {
        (0..self.count()).map(move |number| self.pulse(number))
    }

    /// The time of a pulse, s.
    pub fn time(&self, number: usize) -> f64 {
        self.cut.points.time_of(self.index(number)).unwrap_or(0.0)
    }

    /// The scan angle of a pulse, degrees; 0 if unknown.
    fn angle(&self, number: usize) -> f64 {
        self.cut.points.scan_angle_of(self.index(number)).map_or(0.0, f64::from)
    }

    /// The leg and channel of a pulse.
    fn source(&self, number: usize) -> (u16, u8) {
        self.cut.points.source_of(self.index(number))
    }

    /// The index of the first echo of a pulse among the points of the cloud.
    fn index(&self, number: usize) -> usize {
        self.cut.index(self.first[number] as usize)
    }

    /// Releases the memory of points in temporary files.
    pub fn release(&self) {
        self.cut.points.release();
    }

    /// Frees the memory of all pulses and lines.
    pub fn free(&mut self) {
        (self.first, self.returns) = (Vec::new(), Vec::new());
        (self.line_of, self.lines) = (Vec::new(), Vec::new());
    }

    /// The line of each point of the cut. The pulses of points are dropped.
    pub fn take_lines_of_points(&mut self) -> Vec<u32> {
        let pulse_of = std::mem::take(&mut self.pulse_of);
        pulse_of.into_iter().map(|pulse| self.line_of[pulse as usize]).collect()
    }

    fn find_lines(&mut self) {
        let (mut start, mut sources) = (0, 0);
        while start < self.count() {
            let source = self.source(start);
            let end = start + (start..self.count()).take_while(|i| self.source(*i) == source).count();
            // Copies of a source at a time: they are used often, and columns are slower.
            let angles = match self.has_angles {
                true => (start..end).into_par_iter().map(|i| self.angle(i) as f32).collect(),
                false => Vec::new(),
            };
            let times = (start..end).into_par_iter().map(|i| self.time(i)).collect();
            self.cut.points.release();
            let lines = lines_of(&Track { times, angles });
            self.lines.extend(lines.into_iter().map(|line| start + line.start..start + line.end));
            (start, sources) = (end, sources + 1);
        }
        let long = self.lines.iter().filter(|line| line.len() >= MIN_LINE_PULSES).count();
        self.has_lines = long >= MIN_LINES && long > sources;
        for (number, line) in self.lines.iter().enumerate() {
            self.line_of.extend(std::iter::repeat_n(number as u32, line.len()));
        }
    }

    /// Times between successive pulses of a line, s, with the line.
    pub fn intervals(&self) -> impl Iterator<Item = (f64, u32)> + '_ {
        self.neighbours().map(move |(i, line)| (self.time(i + 1) - self.time(i), line))
    }

    /// Horizontal distances between the first echoes of successive pulses of a line, m, with the line.
    pub fn spacings(&self) -> impl Iterator<Item = (f64, u32)> + '_ {
        self.neighbours().map(move |(i, line)| (distance(self.place(i), self.place(i + 1)), line))
    }

    /// Pulses that are followed by another one of their line, with the line.
    fn neighbours(&self) -> impl Iterator<Item = (usize, u32)> + '_ {
        let lines = self.lines.iter().zip(0..);
        lines.flat_map(|(line, number)| (line.start..line.end.saturating_sub(1)).map(move |i| (i, number)))
    }

    /// Horizontal position of the first echo of a pulse, m.
    pub fn place(&self, pulse: usize) -> [f64; 2] {
        let [x, y, _] = self.cut.offset(self.first[pulse] as usize);
        [x, y]
    }

    /// Numbers of the lines that count, without short ones.
    fn long_lines(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.lines.len()).filter(|i| self.lines[*i].len() >= MIN_LINE_PULSES)
    }

    /// Numbers of pulses of the lines.
    pub fn line_lengths(&self) -> impl Iterator<Item = (f64, u32)> + '_ {
        self.long_lines().map(|i| (self.lines[i].len() as f64, i as u32))
    }

    /// The time of each line of some, s: when its scan angle passes the median one of its source, so that the
    /// margin of the cloud, which cuts lines at other angles, does not move it; without scan angles the
    /// middle of the line. `None` of lines that do not pass it.
    fn line_times(&self, lines: &[usize]) -> Vec<Option<f64>> {
        /// Less than the steps of angles in files, so that no pulse is at the angle itself.
        const BETWEEN_STEPS: f64 = 1e-3;
        let source = |line: usize| self.source(self.lines[line].start);
        let mut times = Vec::with_capacity(lines.len());
        for lines in lines.chunk_by(|a, b| source(*a) == source(*b)) {
            let numbers = lines.iter().flat_map(|line| self.lines[*line].clone());
            let mut angles: Vec<f64> = numbers.map(|i| self.angle(i)).collect();
            let middle = angles.len() / 2;
            let angle = *angles.select_nth_unstable_by(middle, f64::total_cmp).1 + BETWEEN_STEPS;
            let time = |line: &usize| {
                let line = self.lines[*line].clone();
                if !self.has_angles {
                    return Some(0.5 * (self.time(line.start) + self.time(line.end - 1)));
                }
                let passes = |i: &usize| (self.angle(*i) - angle) * (self.angle(i + 1) - angle) < 0.0;
                let before = (line.start..line.end - 1).find(passes)?;
                let [a, b] = [before, before + 1].map(|i| self.pulse(i));
                let share = (angle - a.angle) / (b.angle - a.angle);
                Some(a.time + share * (b.time - a.time))
            };
            times.par_extend(lines.par_iter().map(time));
        }
        times
    }

    /// Times from one line to the next of its source, s, with the first of them; the next one follows within
    /// [`MAX_LINE_GAP`] times the usual time, in other cases strips end.
    pub fn line_intervals(&self) -> Vec<(f64, u32)> {
        let lines: Vec<usize> = self.long_lines().collect();
        let source = |line: usize| self.source(self.lines[line].start);
        let line_times = self.line_times(&lines);
        let pairs = lines.windows(2).zip(line_times.windows(2));
        let of_source = pairs.filter(|(lines, _)| source(lines[0]) == source(lines[1]));
        let interval =
            |(lines, times): (&[usize], &[Option<f64>])| Some((times[1]? - times[0]?, lines[0] as u32));
        let all: Vec<(f64, u32)> = of_source.filter_map(interval).collect();
        self.release();
        let mut times: Vec<f64> = all.iter().map(|(time, _)| *time).collect();
        times.sort_unstable_by(f64::total_cmp);
        let Some(usual) = times.get(times.len() / 2) else { return Vec::new() };
        all.into_iter().filter(|(time, _)| *time <= MAX_LINE_GAP * usual).collect()
    }

    /// Horizontal distances from pulses of a line to the nearest of the next three lines of its source, m,
    /// with the line: two arcs of one revolution of a conic scanner lie far apart, and the next but one is
    /// the neighbour. At most 25 pulses of each of at most 2000 lines, evenly chosen.
    pub fn line_spacings(&self) -> Vec<(f64, u32)> {
        const NEXT: usize = 3;
        const MAX_PULSES: usize = 25;
        const MAX_LINES: usize = 2000;
        let usual: Vec<(f64, u32)> = self.line_intervals();
        let lines: Vec<usize> = self.long_lines().collect();
        let step = lines.len().div_ceil(MAX_LINES).max(1);
        let of_line = |i: usize| {
            let line = lines[i];
            let is_followed = usual.binary_search_by_key(&(line as u32), |(_, line)| *line).is_ok();
            let next = lines[i + 1..].iter().take(NEXT).filter(|_| is_followed);
            let next: Vec<Vec<[f64; 2]>> = next.map(|line| self.places(&self.lines[*line])).collect();
            let range = self.lines[line].clone();
            let step = range.len().div_ceil(MAX_PULSES).max(1);
            let pulses = range.step_by(step).filter(|_| next.len() == NEXT);
            let nearest = |pulse| {
                let place = self.place(pulse);
                next.iter().filter_map(|line| distance_to_line(place, line)).min_by(f64::total_cmp)
            };
            pulses.filter_map(nearest).map(|nearest| (nearest, line as u32)).collect::<Vec<_>>()
        };
        let spacings = (0..lines.len()).into_par_iter().step_by(step).flat_map_iter(of_line).collect();
        self.release();
        spacings
    }

    /// The places of the first echoes of a line.
    fn places(&self, line: &Range<usize>) -> Vec<[f64; 2]> {
        line.clone().map(|pulse| self.place(pulse)).collect()
    }
}

/// The source and the time of a point, which are those of its pulse.
fn key(cut: &Cut, point: u32) -> ((u16, u8), f64) {
    let index = cut.index(point as usize);
    (cut.points.source_of(index), cut.points.time_of(index).unwrap_or(0.0))
}

/// The number of a return; 0 if unknown.
fn number(cut: &Cut, point: u32) -> u8 {
    cut.returns(point as usize).map_or(0, |(number, _)| number)
}

/// The points of a cut by source, time and number of the return, else in the order of the file.
///
/// # Errors
/// Points without times, or of one time.
fn order_by_pulse(cut: &Cut) -> Result<Vec<u32>, PulsesError> {
    let mut times = cut.map(|points, i| points.time_of(i));
    let first = times.next().flatten().ok_or(PulsesError::NoTimes)?;
    if times.all(|time| time == Some(first)) {
        return Err(PulsesError::EqualTimes);
    }
    let by_pulse = |a: &u32, b: &u32| {
        let ((source_a, time_a), (source_b, time_b)) = (key(cut, *a), key(cut, *b));
        let by_time = source_a.cmp(&source_b).then(time_a.total_cmp(&time_b));
        by_time.then_with(|| number(cut, *a).cmp(&number(cut, *b)))
    };
    let mut order: Vec<u32> = (0..cut.len() as u32).collect();
    let is_in_order = |i: u32| by_pulse(&(i - 1), &i).is_le();
    if !(1..cut.len() as u32).into_par_iter().all(is_in_order) {
        order.par_sort_by(by_pulse);
    }
    Ok(order)
}

/// The pulses of one source.
struct Track {
    /// s.
    times: Vec<f64>,
    /// Scan angles, degrees; empty without any.
    angles: Vec<f32>,
}

/// The lines of the pulses of one source.
fn lines_of(track: &Track) -> Vec<Range<usize>> {
    let Track { times, angles } = track;
    let gap = gap_between_lines(times);
    let turn = if angles.is_empty() { None } else { smallest_turn(angles) };
    let mut lines = Vec::new();
    let mut start = 0;
    for end in 1..=times.len() {
        let is_end = end == times.len() || times[end] - times[end - 1] > gap;
        if is_end {
            match turn {
                Some(turn) => between_turns(angles, start..end, turn, &mut lines),
                None => lines.push(start..end),
            }
            start = end;
        }
    }
    lines
}

/// The shortest time between two lines, s: intervals fall into those of pulses, with a few lost ones, and
/// those of lines. Their limit is the widest step of the ascending intervals on a logarithmic scale, weighted
/// by the logarithm of the number of intervals beyond, so that a few pauses between strips are not taken for
/// lines. Infinite without such a step.
fn gap_between_lines(times: &[f64]) -> f64 {
    /// Ratio beyond which a wider step says nothing more.
    const CLEAR: f64 = 10.0;
    /// Least ratio of a step.
    const LEAST: f64 = 2.0;
    /// Minimum ratio of the time between lines to the usual interval.
    const BEYOND: f64 = 10.0;
    let mut intervals: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    intervals.retain(|interval| *interval > 0.0);
    intervals.par_sort_unstable_by(f64::total_cmp);
    let Some(usual) = intervals.get(intervals.len() / 2).copied() else { return f64::INFINITY };
    let first = intervals.partition_point(|interval| *interval <= BEYOND * usual).max(1);
    let (mut best, mut gap) = (0.0, f64::INFINITY);
    for i in first..intervals.len() {
        let ratio = intervals[i] / intervals[i - 1].max(BEYOND * usual);
        let weight = libm::log(ratio.min(CLEAR)) * libm::log1p((intervals.len() - i) as f64);
        if ratio >= LEAST && weight > best {
            (best, gap) = (weight, libm::sqrt(intervals[i] * intervals[i - 1].max(BEYOND * usual)));
        }
    }
    gap
}

/// The smallest change of the scan angle against its sense that is a turn: a twentieth of its range, and more
/// than one step of the file; `None` if the angle does not vary by more than a few steps.
fn smallest_turn(angles: &[f32]) -> Option<f64> {
    let mut angles = angles.to_vec();
    angles.par_sort_unstable_by(f32::total_cmp);
    let range = f64::from(angles[angles.len() - 1]) - f64::from(angles[0]);
    let steps =
        angles.windows(2).map(|pair| f64::from(pair[1]) - f64::from(pair[0])).filter(|step| *step > 1e-5);
    let step = steps.min_by(f64::total_cmp)?;
    (range >= 4.0 * step).then(|| (0.05 * range).max(1.5 * step))
}

/// Appends the lines of a range of pulses: they end where the scan angle turns, or jumps back by half its
/// range.
fn between_turns(angles: &[f32], range: Range<usize>, turn: f64, lines: &mut Vec<Range<usize>>) {
    let angle_of = |i: usize| f64::from(angles[i]);
    let jump = 10.0 * turn;
    let mut start = range.start;
    // The farthest pulse in the present sense, from which a turn is measured.
    let mut farthest = start;
    let mut sense = 0.0;
    for i in range.start + 1..range.end {
        let angle = angle_of(i);
        let step = angle - angle_of(i - 1);
        if step.abs() >= jump {
            lines.push(start..i);
            (start, farthest, sense) = (i, i, 0.0);
            continue;
        }
        let ahead = angle - angle_of(farthest);
        if sense == 0.0 {
            let since_start = angle - angle_of(start);
            if since_start.abs() >= turn {
                (farthest, sense) = (i, since_start.signum());
            }
        } else if ahead * sense >= 0.0 {
            farthest = i;
        } else if -ahead * sense >= turn {
            lines.push(start..farthest + 1);
            (start, farthest, sense) = (farthest + 1, i, -sense);
        }
    }
    lines.push(start..range.end);
}

#[cfg(test)]
pub(super) mod tests;
