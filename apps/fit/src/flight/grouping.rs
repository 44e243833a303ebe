//! The points of a flight line as pulses.

use super::pulses::{PulseColumns, Pulses};
use crate::columns::shorten;
use crate::marks::Marks;
use crate::rows::Rows;
use vlscan_geom::{DVec3, radians};

/// Points of a flight line, grouped into pulses.
pub(super) struct Grouped {
    pub pulses: Pulses,
    /// Number of points that have the time of another pulse.
    pub others: usize,
    /// Number of pulses without their first return.
    pub partial: usize,
}

/// The pulses of points in the order of time and return number, in the memory of the points. Positions become
/// relative to `origin`, m, times to `start`, s.
pub(super) fn pulses_of(mut rows: Rows, origin: DVec3, start: f64) -> Grouped {
    rows.sort_by_channel();
    let (mut others, mut partial) = (0, 0);
    let (mut count, mut places, mut from) = (0, 0, 0);
    let (mut has_last, mut file_channels) = (Marks::default(), Vec::<(usize, u16)>::new());
    while from < rows.len() {
        let (time, channel, number) = (rows.times[from], rows.channels.get(from), rows.numbers[from]);
        let is_other = |i: &usize| rows.times[*i] != time || rows.channels.get(*i) != channel;
        let end = (from + 1..rows.len()).find(is_other).unwrap_or(rows.len());
        let is_repeated = |i: &usize| rows.numbers[*i - 1].max(1) == rows.numbers[*i].max(1);
        others += (from + 1..end).filter(is_repeated).count();
        partial += usize::from(number > 1);
        let has_several = rows.numbers[end - 1] > number;
        if file_channels.last().is_none_or(|(_, last)| *last != channel) {
            file_channels.push((count, channel));
        }
        // A pulse has at most as many places as points, so that none is overwritten before it is read.
        rows.times[count] = time - start;
        rows.angles.copy(from, count);
        rows.returns[count] = rows.returns[from].max(1);
        rows.classes[count] = rows.classes[from];
        rows.places.copy(from, places);
        places += 1;
        if has_several {
            rows.places.copy(end - 1, places);
            places += 1;
        }
        has_last.push(has_several);
        (count, from) = (count + 1, end);
    }
    shorten(&mut rows.times, count);
    rows.places.truncate(places);
    rows.angles.truncate(count);
    rows.angles.change(radians);
    shorten(&mut rows.returns, count);
    shorten(&mut rows.classes, count);
    let Rows { times, places, angles, returns, classes, .. } = rows;
    let columns = PulseColumns { origin, times, places, has_last, angles, returns, classes, file_channels };
    Grouped { pulses: Pulses::from(columns), others, partial }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rows::{Row, Within};

    fn row(channel: u16, time: f64, number: u8) -> Row {
        let position = DVec3::new(0.0, f64::from(channel), f64::from(number));
        Row { time, position, angle: 0.0, source: 1, number, returns: 3, class: 2, channel }
    }

    fn grouped(all: &[Row], start: f64) -> Grouped {
        let mut rows = Rows::default();
        all.iter().for_each(|row| rows.push(row));
        rows.sort_by_time(Within::Numbers);
        pulses_of(rows, DVec3::ZERO, start)
    }

    #[test]
    fn pulses_without_their_first_return_are_counted() {
        let rows = [(0.0, 1), (0.0, 2), (1.0, 2), (2.0, 1), (3.0, 0)];
        let found = grouped(&rows.map(|(time, number)| row(0, time, number)), 0.0);
        assert_eq!((found.pulses.len(), found.others, found.partial), (4, 0, 1));
    }

    #[test]
    fn pulses_are_the_returns_of_one_channel_and_time_in_any_order() {
        let values = [(1, 5.0, 1), (0, 6.0, 1), (1, 5.0, 3), (0, 5.0, 2), (0, 5.0, 2), (0, 6.0, 0)];
        let mut rows = values.map(|(channel, time, number)| row(channel, time, number));
        for _ in 0..2 {
            let found = grouped(&rows, 1.0);
            let pulses = found.pulses.iter();
            let pulses = pulses.map(|pulse| (pulse.file_channel, pulse.time, pulse.last.map(|last| last.z)));
            let pulses: Vec<(u16, f64, Option<f64>)> = pulses.collect();
            assert_eq!(pulses, [(0, 4.0, None), (0, 5.0, Some(1.0)), (1, 4.0, Some(3.0))]);
            assert_eq!((found.others, found.partial), (2, 1));
            rows.reverse();
        }
    }

    #[test]
    fn pulses_keep_the_values_of_their_points() {
        let returns = |k: usize| 1 + k % 4;
        let point = |(k, number): (usize, usize)| Row {
            position: DVec3::new(k as f64, 0.1, 10.0 * number as f64),
            angle: 0.006 * k as f64,
            returns: returns(k) as u8,
            class: (k % 7) as u8,
            ..row(0, 1e-5 * k as f64, number as u8)
        };
        let points = (0..500).flat_map(|k| (1..=returns(k)).map(move |number| (k, number)));
        let found = grouped(&points.map(point).collect::<Vec<_>>(), 0.0);
        assert_eq!((found.pulses.len(), found.others, found.partial), (500, 0, 0));
        for (k, pulse) in found.pulses.iter().enumerate() {
            let first = point((k, 1));
            assert_eq!((pulse.position, pulse.angle), (first.position, radians(first.angle)));
            assert_eq!((pulse.returns, pulse.class), (first.returns, first.class));
            let last = (returns(k) > 1).then(|| point((k, returns(k))).position);
            assert_eq!((pulse.time, pulse.last), (first.time, last));
        }
    }
}
