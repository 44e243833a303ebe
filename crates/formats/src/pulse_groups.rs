//! Returns of a cloud grouped into pulses: by their times, or by their order in the file where times are too
//! coarse to distinguish pulses.

use std::ops::Range;

/// Maximum number of returns, per pulse, that share flight line, channel, time and number with another
/// return.
const MAX_AMBIGUOUS: f64 = 0.01;
/// Minimum share of returns whose pulse is complete in the order of the file.
const MIN_COMPLETE: f64 = 0.9;

/// Values of a return by which it belongs to a pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PulseKey {
    /// Flight line: point source id or leg.
    pub source: u16,
    /// Number of the scanner's device.
    pub channel: u16,
    /// Time of the pulse, s.
    pub time: f64,
    /// Number of the return, from 1; 0 if unknown.
    pub number: u8,
    /// Returns of the pulse; 0 if unknown.
    pub of: u8,
}

impl PulseKey {
    fn has_time_of(&self, other: &PulseKey) -> bool {
        self.source == other.source && self.channel == other.channel && self.time == other.time
    }

    /// True if the return follows `last` within a pulse, in the order of the file.
    fn continues(&self, last: &PulseKey) -> bool {
        self.has_time_of(last) && self.of == last.of && self.number > last.number && self.number <= self.of
    }
}

/// Source of the grouping.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroupedBy {
    /// Times: returns of one flight line, channel and time.
    Time,
    /// The order of the returns in the file, and their numbers.
    Order,
}

/// Reason why returns cannot be grouped into pulses.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PulseGroupsError {
    /// Pulses share times, and their returns are not in order. The number of returns that share flight line,
    /// channel, time and number with another one.
    #[error(
        "{0} returns have the flight line, channel, time and number of another one, and the returns of a \
         pulse do not follow each other in the file: its pulses cannot be told"
    )]
    CoarseTimes(usize),
    /// Returns share times, and none has a number above 1. The number of returns that have the flight line,
    /// channel and time of another one.
    #[error(
        "{0} returns have the flight line, channel and time of another one, but all are the only return of \
         their pulse: the return numbers are lost, or the times are too coarse"
    )]
    NoNumbers(usize),
}

/// The returns of a cloud, by pulse.
#[derive(Clone, Debug, PartialEq)]
pub struct PulseGroups {
    /// Indices of the returns: by flight line, time, channel and number, else in the order of the file.
    pub order: Vec<usize>,
    /// The returns of each pulse, as ranges of `order`.
    pub pulses: Vec<Range<usize>>,
    /// Source of the grouping.
    pub by: GroupedBy,
    /// Number of returns that share flight line, channel, time and number with another one.
    pub ambiguous: usize,
}

impl PulseGroups {
    /// Groups returns in the order of the file by their `key`: by time if times distinguish pulses, else by
    /// the order in the file.
    ///
    /// # Errors
    /// Times that several pulses share, in files whose returns are not in the order of pulses or have no
    /// numbers.
    pub fn of<R>(returns: &[R], key: impl Fn(&R) -> PulseKey) -> Result<PulseGroups, PulseGroupsError> {
        let by_time = PulseGroups::by_time(returns, &key);
        if PulseGroups::are_distinct(by_time.ambiguous, by_time.pulses.len()) {
            return Ok(by_time);
        }
        let ambiguous = by_time.ambiguous;
        let key = |i: usize| key(&returns[i]);
        if (0..returns.len()).map(key).all(|key| key.number <= 1 && key.of <= 1) {
            return Err(PulseGroupsError::NoNumbers(ambiguous));
        }
        let is_first = |i: &usize| *i == 0 || !key(*i).continues(&key(*i - 1));
        let starts: Vec<usize> = (0..returns.len()).filter(is_first).collect();
        let ends = starts.iter().skip(1).copied().chain([returns.len()]);
        let mut pulses: Vec<Range<usize>> =
            starts.iter().copied().zip(ends).map(|(start, end)| start..end).collect();
        let is_complete = |pulse: &&Range<usize>| {
            let first = key(pulse.start);
            first.number == 1 && usize::from(first.of) == pulse.len()
        };
        let complete: usize = pulses.iter().filter(is_complete).map(|pulse| pulse.len()).sum();
        if (complete as f64) < MIN_COMPLETE * returns.len() as f64 {
            return Err(PulseGroupsError::CoarseTimes(ambiguous));
        }
        // Pulses of one time stay in the order of the file.
        pulses.sort_by(|a, b| by_line_and_time(&key(a.start), &key(b.start)));
        let order: Vec<usize> = pulses.iter().flat_map(|pulse| pulse.clone()).collect();
        let mut start = 0;
        for pulse in &mut pulses {
            let end = start + pulse.len();
            *pulse = start..end;
            start = end;
        }
        Ok(PulseGroups { order, pulses, by: GroupedBy::Order, ambiguous })
    }

    /// True if times distinguish pulses: few returns share flight line, channel, time and number with another
    /// one.
    pub fn are_distinct(ambiguous: usize, pulses: usize) -> bool {
        ambiguous as f64 <= MAX_AMBIGUOUS * pulses as f64
    }

    /// Groups returns by the time of their `key` alone. `ambiguous` describes how well times distinguish
    /// pulses.
    pub fn by_time<R>(returns: &[R], key: impl Fn(&R) -> PulseKey) -> PulseGroups {
        let key = |i: usize| key(&returns[i]);
        let compare = |a: &usize, b: &usize| {
            let (a, b) = (key(*a), key(*b));
            by_line_and_time(&a, &b).then(a.number.cmp(&b.number))
        };
        let mut order: Vec<usize> = (0..returns.len()).collect();
        // Most recordings are in order, and sorting takes half as much memory again.
        if !order.is_sorted_by(|a, b| compare(a, b).is_le()) {
            order.sort_by(compare);
        }
        let (mut pulses, mut start, mut ambiguous) = (Vec::new(), 0, 0);
        for pulse in order.chunk_by(|a, b| key(*a).has_time_of(&key(*b))) {
            let numbers = pulse.windows(2).map(|pair| (key(pair[0]).number, key(pair[1]).number));
            ambiguous += numbers.filter(|(number, next)| number == next && *number > 0).count();
            pulses.push(start..start + pulse.len());
            start += pulse.len();
        }
        PulseGroups { order, pulses, by: GroupedBy::Time, ambiguous }
    }
}

fn by_line_and_time(a: &PulseKey, b: &PulseKey) -> std::cmp::Ordering {
    a.source.cmp(&b.source).then(a.time.total_cmp(&b.time)).then(a.channel.cmp(&b.channel))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns of pulses of one to three returns, with these steps of time; every other one of two lines.
    fn keys(step: f64) -> Vec<PulseKey> {
        let mut keys = Vec::new();
        for pulse in 0..3000_u16 {
            let of = 1 + (pulse % 3) as u8;
            let time = libm::floor(f64::from(pulse) * 1e-5 / step) * step;
            let source = 706 + pulse / 1500;
            keys.extend((1..=of).map(|number| PulseKey { source, channel: 0, time, number, of }));
        }
        keys
    }

    fn of(keys: &[PulseKey]) -> Result<PulseGroups, PulseGroupsError> {
        PulseGroups::of(keys, |key| *key)
    }

    fn sizes(groups: &PulseGroups) -> Vec<usize> {
        groups.pulses.iter().map(|pulse| pulse.len()).collect()
    }

    #[test]
    fn pulses_are_those_of_their_times_or_of_the_order_where_times_are_coarse() {
        let expected: Vec<usize> = (0..3000).map(|pulse| 1 + pulse % 3).collect();
        let fine = of(&keys(1e-7)).unwrap();
        assert_eq!((fine.by, fine.ambiguous), (GroupedBy::Time, 0));
        assert_eq!(sizes(&fine), expected);
        let coarse = of(&keys(5e-3)).unwrap();
        assert_eq!(coarse.by, GroupedBy::Order);
        assert!(coarse.ambiguous > 1000);
        assert_eq!(sizes(&coarse), expected);
        assert_eq!(coarse.order, (0..6000).collect::<Vec<usize>>());
    }

    #[test]
    fn the_order_of_a_file_with_fine_times_does_not_matter() {
        let mut keys = keys(1e-7);
        keys.reverse();
        let groups = of(&keys).unwrap();
        assert_eq!(groups.by, GroupedBy::Time);
        assert_eq!(groups.pulses.len(), 3000);
        let numbers = groups.pulses.iter().map(|pulse| keys[groups.order[pulse.start]].number);
        assert!(numbers.into_iter().all(|number| number == 1));
    }

    #[test]
    fn coarse_times_without_the_order_of_pulses_are_an_error() {
        let mut keys = keys(5e-3);
        keys.sort_by_key(|key| (key.source, key.number));
        assert!(matches!(of(&keys), Err(PulseGroupsError::CoarseTimes(1001..))));
    }

    /// The only returns of pulses that share times, or several returns that have lost their numbers.
    #[test]
    fn only_returns_that_share_times_are_an_error() {
        let keys = |step: f64| -> Vec<PulseKey> {
            let time = |i: u16| libm::floor(f64::from(i) / step);
            (0..1000).map(|i| PulseKey { time: time(i), number: 1, of: 1, ..PulseKey::default() }).collect()
        };
        assert_eq!(of(&keys(1.0)).unwrap().pulses.len(), 1000);
        assert_eq!(of(&keys(2.0)), Err(PulseGroupsError::NoNumbers(500)));
    }

    #[test]
    fn returns_without_numbers_are_pulses_by_time() {
        let keys: Vec<PulseKey> =
            (0..100).map(|i| PulseKey { time: f64::from(i / 2), ..PulseKey::default() }).collect();
        let groups = of(&keys).unwrap();
        assert_eq!((groups.by, groups.pulses.len()), (GroupedBy::Time, 50));
        assert_eq!(of(&[]).unwrap().pulses.len(), 0);
    }
}
