//! Pulses of two clouds at the same time.
//!
//! Equal GPS times mean the same instant only if both clouds have one clock: that of a recording and of its
//! simulation along the recorded flight, or of two runs of a survey. Runs of different surveys start at the
//! same default time, and times of the GPS week repeat every week. File headers do not distinguish these
//! cases. Therefore clocks count as one if the clouds are at the same places at the same times.

use super::pulses::{Pulse, Pulses, distance};
use super::quantity::{MAX_VALUES, evenly};
use rayon::prelude::*;

/// Maximum number of parts of a recording whose places are compared.
const MAX_PARTS: usize = 64;
/// Minimum number of scan lines of a part, so that its centre does not depend on their phase.
const MIN_LINES: usize = 4;
/// Minimum number of pulses of a part without scan lines.
const MIN_PULSES: usize = 20;
/// Minimum number of pulses of the other cloud in a part, as a fraction of the first cloud's.
const MIN_SHARE: f64 = 0.05;
/// Number of pulses that one task compares.
const PART_PULSES: usize = 1 << 14;
/// Number of such tasks after which the memory of their points is released.
const PARTS_IN_MEMORY: usize = 64;
/// Number of parts of which the places are compared, after which the memory of their points is released.
const CLOCK_PARTS_IN_MEMORY: usize = 8;
/// Maximum distance of the centres of both clouds, as a fraction of the spread of their pulses.
const MAX_DISTANCE: f64 = 0.25;

/// Reason why times of two clouds do not mean the same instants.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub(super) enum ClockError {
    /// Clouds of different times.
    #[error("the clouds share no GPS times")]
    NoCommonTimes,
    /// Clouds at different places at the same times, with their distance, m.
    #[error("at the same GPS times the clouds are {0:.1} m apart: their clocks or flights differ")]
    Apart(f64),
}

/// Checks that two clouds are at the same places at the same times: of parts of the first cloud by time, the
/// median distance of both centres is small against the spread of the pulses.
///
/// # Errors
/// No common times, or other places.
pub(super) fn check_clocks([first, second]: [&Pulses; 2]) -> Result<(), ClockError> {
    let [by_time, others] = [first, second].map(by_time);
    let parts = match first.has_lines {
        true => first.lines.len() / MIN_LINES,
        false => first.count() / MIN_PULSES,
    };
    let size = by_time.len().div_ceil(parts.clamp(1, MAX_PARTS)).max(1);
    let of_part = |part: &[u32]| {
        let [from, to] = [part[0], part[part.len() - 1]].map(|i| first.time(i as usize));
        let time_of = |i: &u32| second.time(*i as usize);
        let begin = others.partition_point(|i| time_of(i) < from);
        let end = others.partition_point(|i| time_of(i) <= to);
        let other = &others[begin..end];
        if other.is_empty() || (other.len() as f64) < MIN_SHARE * part.len() as f64 {
            return None;
        }
        let (centre, spread) = centre_of(part.iter().map(|i| first.place(*i as usize)));
        let (other_centre, other_spread) = centre_of(other.iter().map(|i| second.place(*i as usize)));
        Some((distance(centre, other_centre), spread.max(other_spread)))
    };
    let release = || [first, second].into_iter().for_each(Pulses::release);
    release();
    let mut distances: Vec<(f64, f64)> = Vec::new();
    for parts in by_time.chunks(size * CLOCK_PARTS_IN_MEMORY) {
        distances.par_extend(parts.par_chunks(size).filter_map(of_part));
        release();
    }
    let ratio = |(distance, spread): &(f64, f64)| distance / spread.max(f64::MIN_POSITIVE);
    distances.sort_unstable_by(|a, b| ratio(a).total_cmp(&ratio(b)));
    match distances.get(distances.len() / 2) {
        None => Err(ClockError::NoCommonTimes),
        Some((distance, spread)) if *distance <= MAX_DISTANCE * spread => Ok(()),
        Some((distance, _)) => Err(ClockError::Apart(*distance)),
    }
}

/// The mean of places and their root mean square distance from it.
fn centre_of(places: impl Iterator<Item = [f64; 2]> + Clone) -> ([f64; 2], f64) {
    let count = places.clone().count() as f64;
    let sum = places.clone().fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]);
    let centre = sum.map(|sum| sum / count);
    let squares: f64 = places.map(|p| distance(p, centre).powi(2)).sum();
    (centre, (squares / count).sqrt())
}

/// Numbers of pulses by ascending time.
fn by_time(pulses: &Pulses) -> Vec<u32> {
    let time = |i: &u32| pulses.time(*i as usize);
    let mut order: Vec<u32> = (0..pulses.count() as u32).collect();
    order.par_sort_by(|a, b| time(a).total_cmp(&time(b)));
    order
}

/// Scan angles of some pulses minus those of a cloud at the same time.
pub(super) struct Angles<'p> {
    pulses: &'p Pulses<'p>,
    by_time: Vec<u32>,
    /// Maximum time between the pulses before and after, s.
    reach: f64,
}

impl<'p> Angles<'p> {
    /// The scan angles of a cloud; `None` without any.
    pub fn of(pulses: &'p Pulses<'p>) -> Option<Angles<'p>> {
        /// Usual intervals between the pulses before and after.
        const REACH: f64 = 3.0;
        let mut intervals = evenly(pulses.intervals().map(|(time, _)| time), MAX_VALUES);
        if intervals.is_empty() || !pulses.has_angles {
            return None;
        }
        let middle = intervals.len() / 2;
        let usual = *intervals.select_nth_unstable_by(middle, f64::total_cmp).1;
        Some(Angles { pulses, by_time: by_time(pulses), reach: REACH * usual })
    }

    /// Scan angles of `count` other pulses, by their number, minus those of the cloud, degrees, with the
    /// cloud's scan lines: of the pulse of the same time, if possible of the same source, or else
    /// interpolated. `keep` chooses what is returned.
    pub fn differences<T: Send>(
        &self,
        count: usize,
        pulse: &(dyn Fn(usize) -> Pulse + Sync),
        keep: impl Fn((f64, u32)) -> T + Sync,
    ) -> Vec<T> {
        let difference = |(pulse, begin): (&Pulse, usize)| {
            let at_time = || {
                let from_begin = self.by_time[begin..].iter();
                from_begin.map(|i| *i as usize).take_while(|i| self.pulses.time(*i) == pulse.time)
            };
            let of_source = at_time().find(|i| self.pulses.pulse(*i).source == pulse.source);
            match of_source.or_else(|| at_time().next()) {
                Some(i) => Some((pulse.angle - self.pulses.pulse(i).angle, self.pulses.line_of[i])),
                None => self.interpolated(pulse, begin),
            }
        };
        self.of_each(count, pulse, |pulse| difference(pulse).map(&keep))
    }

    /// Scan angles of the cloud's pulses minus those that follow from the pulses before and after, degrees,
    /// with their scan lines.
    pub fn errors(&self) -> Vec<(f64, u32)> {
        let pulse = |i: usize| self.pulses.pulse(i);
        self.of_each(self.pulses.count(), &pulse, |(pulse, begin)| self.interpolated(pulse, begin))
    }

    /// The values of some pulses in their order, of at most [`MAX_VALUES`], evenly chosen; `value` gets also
    /// the place of the cloud's first pulse that is not earlier.
    fn of_each<T: Send>(
        &self,
        count: usize,
        pulse: &(dyn Fn(usize) -> Pulse + Sync),
        value: impl Fn((&Pulse, usize)) -> Option<T> + Sync,
    ) -> Vec<T> {
        let step = count.div_ceil(MAX_VALUES).max(1);
        let of_part = |part: usize| -> Vec<T> {
            let mut begin = 0;
            let of_pulse = |i: usize| {
                let pulse = pulse(i);
                begin = self.first_not_before(pulse.time, begin);
                value((&pulse, begin))
            };
            let end = count.min((part + 1) * PART_PULSES);
            let chosen = (part * PART_PULSES..end).filter(|i| i.is_multiple_of(step));
            chosen.filter_map(of_pulse).collect()
        };
        let parts = count.div_ceil(PART_PULSES);
        let mut values = Vec::new();
        for first in (0..parts).step_by(PARTS_IN_MEMORY) {
            let some = first..parts.min(first + PARTS_IN_MEMORY);
            values.par_extend(some.into_par_iter().flat_map_iter(&of_part));
            self.pulses.release();
        }
        values
    }

    /// The place in `by_time` of the first pulse at or after a time, which is probably near the place
    /// `guess`.
    fn first_not_before(&self, time: f64, guess: usize) -> usize {
        let is_before = |place: usize| self.pulses.time(self.by_time[place] as usize) < time;
        let count = self.by_time.len();
        let (mut low, mut high, mut step) = (guess.min(count), guess.min(count), 1);
        while low > 0 && !is_before(low - 1) {
            (low, step) = (low.saturating_sub(step), 2 * step);
        }
        step = 1;
        while high < count && is_before(high) {
            (low, high, step) = (high, (high + step).min(count), 2 * step);
        }
        let range = &self.by_time[low..high];
        low + range.partition_point(|i| self.pulses.time(*i as usize) < time)
    }

    /// The scan angle of a pulse minus that between the cloud's pulses before and after; `begin` is the place
    /// of the first pulse that is not earlier.
    fn interpolated(&self, pulse: &Pulse, begin: usize) -> Option<(f64, u32)> {
        let is_at_time = |i: &&u32| self.pulses.time(**i as usize) <= pulse.time;
        let end = begin + self.by_time[begin..].iter().take_while(is_at_time).count();
        let [before, after] = [self.by_time.get(begin.checked_sub(1)?)?, self.by_time.get(end)?];
        let [before, after] = [*before as usize, *after as usize];
        let [a, b] = [before, after].map(|i| self.pulses.pulse(i));
        let line = self.pulses.line_of[before];
        let is_near = b.time - a.time <= self.reach && line == self.pulses.line_of[after];
        let share = (pulse.time - a.time) / (b.time - a.time);
        is_near.then_some((pulse.angle - (a.angle + share * (b.angle - a.angle)), line))
    }
}

#[cfg(test)]
mod tests {
    use super::super::pulses::tests::{cut, recording};
    use super::*;
    use crate::cloud::Points;
    use vlscan_formats::{AttributeSet, PointRow};

    #[test]
    fn scan_angles_are_compared_at_the_same_time() {
        let points = recording(false, 0.01);
        let cut = cut(&points);
        let found = Pulses::of(&cut).unwrap();
        let angles = Angles::of(&found).unwrap();
        let own = angles.differences(found.count(), &|i| found.pulse(i), |(d, _)| d);
        assert!(own.iter().all(|d| *d == 0.0));
        // Between neighbours the angle is linear, but for the steps of the times.
        let errors = angles.errors();
        assert!(errors.len() == 98 * 40 && errors.iter().all(|(d, _)| d.abs() < 0.02), "{}", errors.len());
        let shifted: Vec<Pulse> =
            found.iter().map(|pulse| Pulse { angle: pulse.angle + 0.03, ..pulse }).collect();
        let differences = angles.differences(shifted.len(), &|i| shifted[i], |(d, _)| d);
        assert!(differences.iter().all(|d| (d - 0.03).abs() < 1e-9), "{:?}", differences[0]);
    }

    #[test]
    fn clocks_are_one_where_clouds_are_at_the_same_places_at_the_same_times() {
        let points = recording(false, 0.01);
        let changed = |change: &dyn Fn(&mut PointRow)| {
            let mut changed = Points::new(AttributeSet::of(|_| true));
            for i in 0..points.len() {
                let mut row = PointRow {
                    position: points.position(i),
                    time: points.time_of(i).unwrap(),
                    scan_angle: f64::from(points.scan_angle_of(i).unwrap()),
                    return_number: points.return_number_of(i).unwrap(),
                    number_of_returns: points.number_of_returns_of(i).unwrap(),
                    leg: 706,
                    ..PointRow::default()
                };
                change(&mut row);
                changed.push(&row, None);
            }
            changed
        };
        let check = |other: &Points| {
            let cuts = [&cut(&points), &cut(other)];
            let pulses = cuts.map(|cut| Pulses::of(cut).unwrap());
            check_clocks([&pulses[0], &pulses[1]])
        };
        assert_eq!(check(&points), Ok(()));
        // Another instrument on the same flight: a few metres of 50 m of swath.
        assert_eq!(check(&changed(&|row| row.position.x += 2.0)), Ok(()));
        // The same strip, flown from the other end or later.
        let refused = |change: &dyn Fn(&mut PointRow)| check(&changed(change)).unwrap_err();
        let why = refused(&|row| row.position.y = 80.0 - row.position.y);
        assert!(matches!(why, ClockError::Apart(_)), "{why}");
        assert!(why.to_string().contains("clocks or flights differ"), "{why}");
        assert!(matches!(refused(&|row| row.time += 0.2), ClockError::Apart(_)));
        assert_eq!(refused(&|row| row.time += 604_800.0), ClockError::NoCommonTimes);
    }
}
