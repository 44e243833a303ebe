//! Points in columns: 25 bytes each in a file of LAS with one channel, 27 with several. They are sorted in
//! their memory.

use crate::columns::{Angles, Numbers, Places, shorten};
use std::cmp::Ordering;
use vlscan_formats::PositionSteps;
use vlscan_geom::DVec3;

/// Number of intervals of time into which points are sorted first.
const BUCKETS: usize = if cfg!(test) { 8 } else { 1 << 16 };

/// Memory that an estimate takes for a point, bytes, with a share of that of the program: of a file whose
/// positions are in steps, and of another one.
const STEP_BYTES: u64 = 36;
const METRE_BYTES: u64 = 56;

/// Memory that an estimate takes for a point of a file with these steps, bytes.
pub(crate) fn point_bytes(steps: Option<&PositionSteps>) -> u64 {
    if steps.is_some() { STEP_BYTES } else { METRE_BYTES }
}

/// Values that are read of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Row {
    /// s.
    pub time: f64,
    /// World position, m.
    pub position: DVec3,
    /// Scan angle, degrees.
    pub angle: f64,
    /// Number of the flight line.
    pub source: u16,
    /// Number of the return.
    pub number: u8,
    /// Number of returns of its pulse.
    pub returns: u8,
    pub class: u8,
    pub channel: u16,
}

/// Points of a recording.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rows {
    pub times: Vec<f64>,
    pub places: Places,
    /// Degrees.
    pub angles: Angles,
    pub numbers: Vec<u8>,
    pub returns: Vec<u8>,
    pub classes: Vec<u8>,
    pub channels: Numbers,
    sources: Numbers,
}

/// Order of points of the same time; points that are equal then stay in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Within {
    /// By return number.
    Numbers,
    /// By channel, then by return number.
    ChannelsAndNumbers,
}

impl Rows {
    /// No points yet, with room for some; those of a file in `steps` are probably in them.
    pub fn with_room(count: usize, steps: Option<PositionSteps>) -> Rows {
        Rows {
            times: Vec::with_capacity(count),
            places: Places::with_room(count, steps),
            angles: Angles::with_room(count),
            numbers: Vec::with_capacity(count),
            returns: Vec::with_capacity(count),
            classes: Vec::with_capacity(count),
            channels: Numbers::default(),
            sources: Numbers::default(),
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.times.len()
    }

    /// True without points.
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    /// Adds a point.
    pub fn push(&mut self, row: &Row) {
        self.times.push(row.time);
        self.places.push(row.position);
        self.angles.push(row.angle);
        self.numbers.push(row.number);
        self.returns.push(row.returns);
        self.classes.push(row.class);
        self.channels.push(row.channel);
        self.sources.push(row.source);
    }

    /// The point of an index below their number.
    pub fn get(&self, i: usize) -> Row {
        Row {
            time: self.times[i],
            position: self.places.get(i),
            angle: self.angles.get(i),
            source: self.sources.get(i),
            number: self.numbers[i],
            returns: self.returns[i],
            class: self.classes[i],
            channel: self.channels.get(i),
        }
    }

    /// All points.
    pub fn iter(&self) -> impl Iterator<Item = Row> + '_ {
        (0..self.len()).map(move |i| self.get(i))
    }

    /// Keeps some points.
    pub fn retain(&mut self, mut is_kept: impl FnMut(&Row) -> bool) {
        let mut kept = 0;
        for i in 0..self.len() {
            if is_kept(&self.get(i)) {
                self.copy(i, kept);
                kept += 1;
            }
        }
        self.truncate(kept);
    }

    /// Copies a point to another index.
    pub fn copy(&mut self, from: usize, to: usize) {
        self.times[to] = self.times[from];
        self.places.copy(from, to);
        self.angles.copy(from, to);
        self.numbers[to] = self.numbers[from];
        self.returns[to] = self.returns[from];
        self.classes[to] = self.classes[from];
        self.channels.copy(from, to);
        self.sources.copy(from, to);
    }

    /// Adds a copy of the first point.
    fn repeat_first(&mut self) {
        self.times.extend(self.times.first().copied());
        self.places.repeat(0);
        self.angles.repeat(0);
        self.numbers.extend(self.numbers.first().copied());
        self.returns.extend(self.returns.first().copied());
        self.classes.extend(self.classes.first().copied());
        self.channels.repeat(0);
        self.sources.repeat(0);
    }

    /// Keeps the first points, and releases the memory of the others.
    pub fn truncate(&mut self, count: usize) {
        shorten(&mut self.times, count);
        self.places.truncate(count);
        self.angles.truncate(count);
        shorten(&mut self.numbers, count);
        shorten(&mut self.returns, count);
        shorten(&mut self.classes, count);
        self.channels.truncate(count);
        self.sources.truncate(count);
    }

    /// Sorts points by time.
    pub fn sort_by_time(&mut self, within: Within) {
        // Most recordings are in order.
        if !(1..self.len()).all(|i| self.compare(i - 1, i, within).is_le()) {
            let order = self.order_of_times(within);
            self.put_in_order(order);
        }
    }

    fn compare(&self, a: usize, b: usize, within: Within) -> Ordering {
        let by_time = self.times[a].total_cmp(&self.times[b]);
        let by_channel = match within {
            Within::Numbers => Ordering::Equal,
            Within::ChannelsAndNumbers => self.channels.get(a).cmp(&self.channels.get(b)),
        };
        by_time.then(by_channel).then(self.numbers[a].cmp(&self.numbers[b]))
    }

    /// The indices of points in their order. Points of an interval of time are sorted together, so that
    /// comparisons stay near each other in memory.
    fn order_of_times(&self, within: Within) -> Vec<u32> {
        let first = self.times.iter().copied().fold(f64::INFINITY, f64::min);
        let last = self.times.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let scale = BUCKETS as f64 / (last - first);
        // All in one where all times are equal.
        let bucket = |time: &f64| (((time - first) * scale) as usize).min(BUCKETS - 1);
        let mut ends = starts_of(self.times.iter().map(bucket), BUCKETS);
        let mut order = vec![0; self.len()];
        for (i, time) in (0..).zip(&self.times) {
            let end = &mut ends[bucket(time)];
            order[*end as usize] = i;
            *end += 1;
        }
        let mut start = 0;
        for end in ends {
            let compare = |a: &u32, b: &u32| self.compare(*a as usize, *b as usize, within).then(a.cmp(b));
            order[start..end as usize].sort_unstable_by(compare);
            start = end as usize;
        }
        order
    }

    /// Sorts points by channel; those of a channel stay in their order.
    pub fn sort_by_channel(&mut self) {
        if (1..self.len()).all(|i| self.channels.get(i - 1) <= self.channels.get(i)) {
            return;
        }
        let channel = |i: usize| usize::from(self.channels.get(i));
        let mut ends = starts_of((0..self.len()).map(channel), 1 << 16);
        let mut order = vec![0; self.len()];
        for (number, i) in (0..).zip(0..self.len()) {
            let end = &mut ends[channel(i)];
            order[*end as usize] = number;
            *end += 1;
        }
        self.put_in_order(order);
    }

    /// Moves points to the places of which `order` has their indices.
    fn put_in_order(&mut self, mut order: Vec<u32>) {
        let spare = self.len();
        self.repeat_first();
        for first in 0..order.len() {
            self.copy(first, spare);
            let mut place = first;
            loop {
                // A place that is filled is its own source.
                let source = std::mem::replace(&mut order[place], place as u32) as usize;
                if source == first || source == place {
                    self.copy(spare, place);
                    break;
                }
                self.copy(source, place);
                place = source;
            }
        }
        self.truncate(spare);
    }
}

/// The number of items of smaller keys, for each key.
fn starts_of(keys: impl Iterator<Item = usize>, count: usize) -> Vec<u32> {
    let mut starts = vec![0; count];
    keys.for_each(|key| starts[key] += 1);
    let mut sum = 0;
    for start in &mut starts {
        (*start, sum) = (sum, sum + *start);
    }
    starts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(channel: u16, time: f64, number: u8) -> Row {
        let position = DVec3::new(0.0, f64::from(channel), f64::from(number));
        Row { time, position, angle: 0.0, source: 1, number, returns: 3, class: 2, channel }
    }

    fn rows_of(all: &[Row]) -> Rows {
        let mut rows = Rows::default();
        all.iter().for_each(|row| rows.push(row));
        rows
    }

    #[test]
    fn points_are_sorted_as_a_stable_sort_does() {
        let times = [0.0, 3.5, 0.25, 7.0, 1e-9, -0.0];
        for count in [0, 1, 2, 6, 7, 500] {
            for step in [1, 5, 7, 101] {
                let point = |k: usize| {
                    let k = (k * step) % 503;
                    // Equal times and numbers differ by their class.
                    Row {
                        class: (k % 100) as u8,
                        angle: 0.5 * (k % 11) as f64,
                        ..row((k % 13 / 6) as u16, times[k % 6], (k % 3) as u8)
                    }
                };
                let mut expected: Vec<Row> = (0..count).map(point).collect();
                let by_time = |a: &Row, b: &Row| a.time.total_cmp(&b.time);
                let mut rows = rows_of(&expected);
                rows.sort_by_time(Within::ChannelsAndNumbers);
                let mut by_channel = expected.clone();
                by_channel.sort_by(|a, b| {
                    by_time(a, b).then(a.channel.cmp(&b.channel)).then(a.number.cmp(&b.number))
                });
                assert!(rows.iter().eq(by_channel), "{count} {step}");
                let mut rows = rows_of(&expected);
                rows.sort_by_time(Within::Numbers);
                expected.sort_by(|a, b| by_time(a, b).then(a.number.cmp(&b.number)));
                assert!(rows.iter().eq(expected.iter().copied()), "{count} {step}");
                rows.sort_by_channel();
                expected.sort_by_key(|row| row.channel);
                assert!(rows.iter().eq(expected.iter().copied()), "{count} {step}");
            }
        }
    }

    #[test]
    fn points_that_are_kept_stay_in_order() {
        let all: Vec<Row> = (0..50).map(|k| row(u16::from(k > 20), f64::from(k), k % 4)).collect();
        let mut rows = rows_of(&all);
        rows.retain(|row| row.number == 2);
        let expected = all.iter().filter(|row| row.number == 2).copied();
        assert!(rows.iter().eq(expected) && rows.len() == 12);
    }
}
