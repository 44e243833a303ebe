//! The pulses of one flight line of a recorded cloud.

use super::points::{FLIGHT_PAUSE, FlightLine, Outline, Row, warn_of_others};
use crate::limit::PointLimit;
use std::ops::Range;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::fixed;
use vlscan_geom::{DVec3, degrees, median, radians};

/// A gap of this many median intervals between pulses ends a line.
const GAP_INTERVALS: f64 = 100.0;
/// Number of pulses before and after a pulse with whose heights it is compared.
const NEIGHBOURS: usize = 12;
/// Points farther from the median height of their neighbours are noise: m, and multiples of the distance
/// within which 95 % of the points lie.
const MIN_OUTLIER: f64 = 50.0;
const OUTLIER: f64 = 6.0;
/// Minimum number of pulses of a flight line.
const MIN_PULSES: usize = 500;
/// Minimum extent of the points of a flight line, m.
const MIN_EXTENT: f64 = 1.0;
/// Number of points that are released together.
const RELEASED_ROWS: usize = if cfg!(test) { 2 } else { 1 << 20 };

/// A pulse with at least one return.
#[derive(Clone, Copy, Debug)]
pub struct Pulse {
    /// s after [`Recording::start`].
    pub time: f64,
    /// Position of its first return, m, relative to [`Recording::origin`].
    pub position: DVec3,
    /// Scan angle, rad, positive to the right of the flight.
    pub angle: f64,
    /// Number of its returns.
    pub returns: u8,
    /// Class of its first return.
    pub class: u8,
    /// Position of its last return, if it has several.
    pub last: Option<DVec3>,
    /// Number of its channel in the file.
    pub file_channel: u16,
    /// Number of its channel by the directions of lines, from 0.
    pub channel: u8,
}

#[cfg(test)]
impl Pulse {
    /// A pulse of the only channel with one return, which is from the ground.
    pub fn on_ground(time: f64, position: DVec3, angle: f64) -> Pulse {
        Pulse { time, position, angle, returns: 1, class: 2, last: None, file_channel: 0, channel: 0 }
    }
}

/// The pulses of one flight line in the order of time.
#[derive(Clone, Debug)]
pub struct Recording {
    /// World position of the origin of all positions, whole metres.
    pub origin: DVec3,
    /// Coordinate system of the positions as WKT, if the file names it.
    pub wkt: Option<String>,
    /// GPS time of the first pulse, s.
    pub start: f64,
    /// Number of the flight line (point source).
    pub source: u16,
    /// Pulses by channel of the file, then by time; no two of a channel have the same time.
    pub pulses: Vec<Pulse>,
    /// Number of channels whose lines differ in direction.
    pub channels: usize,
    /// Runs of pulses without longer gaps: the lines or arcs of the scanner.
    pub lines: Vec<Range<usize>>,
    /// Median interval between pulses, s.
    pub interval: f64,
    /// Smallest step between scan angles, rad.
    pub angle_step: f64,
    /// Share of the pulses whose first return is not in the cloud: others have been removed from it.
    pub partial: f64,
}

impl Recording {
    /// Reads one flight line of a cloud: that of the point source `source`, else the one with the most
    /// pulses. Warnings, also of lines that are left out, are added to `found`.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] for clouds without GPS times or scan angles, with too few pulses, or
    /// with more points than `limit` allows.
    pub(crate) fn read(
        path: &Path,
        source: Option<u16>,
        limit: PointLimit,
        found: &mut Diagnostics,
    ) -> Result<Recording> {
        let mut outline = Outline::read(path, limit, found)?;
        let name = path.display();
        let mut lines = std::mem::take(&mut outline.lines);
        if let Some(source) = source {
            let mut sources: Vec<String> = lines.iter().map(|line| line.source.to_string()).collect();
            sources.dedup();
            lines.retain(|line| line.source == source);
            if lines.is_empty() {
                let message = format!("--flight-line {source}: {name} has no points of this point source");
                return Err(Error::input_with_help(message, format!("it has {}", sources.join(", "))));
            }
        }
        let Some(longest) = lines.iter().copied().max_by_key(|line: &FlightLine| line.points) else {
            return Err(Error::input(format!("{name} has no points with times and scan angles")));
        };
        let wkt = outline.wkt.take();
        if let Some(points) = outline.turns.get(&longest.source) {
            let message = format!(
                "the flight of point source {} has turns: each straight part is a flight line, and {points} \
                 points of the turns are ignored",
                longest.source
            );
            found.warn(Some(Place::of_file(path)), message);
        }
        let rows = outline.rows_of(longest, path)?;
        let recording = Recording { wkt, ..Recording::of(rows, path, found)? };
        if lines.len() > 1 {
            warn_of_others(path, &lines, longest, found);
        }
        Ok(recording)
    }

    /// The pulses of the points of a flight line, by time.
    fn of(rows: Vec<Row>, path: &Path, found: &mut Diagnostics) -> Result<Recording> {
        let name = path.display();
        let (points, source) = (rows.len(), rows[0].source);
        let origin = rows[points / 2].position.floor();
        let start = rows.iter().map(|row| row.time).fold(f64::INFINITY, f64::min);
        let Grouped { mut pulses, others, partial } = pulses_of(rows, origin, start);
        if pulses.len() == 1 && points > 1 {
            return Err(Error::input_with_help(
                format!("{name}: all points of the flight line have the GPS time {start}"),
                "a flight is estimated from the time of each pulse, which is missing here",
            ));
        }
        if others > pulses.len() / 10 {
            return Err(Error::input_with_help(
                format!(
                    "{name}: {others} points have the time of another pulse ({} times in all)",
                    pulses.len()
                ),
                "a fit needs the pulses of one flight line, whose times differ; points that are in the file \
                 twice, flight lines with the same point source, and beams that fire together without a \
                 number of their channel have to be taken apart before",
            ));
        }
        let (outliers, distance) = remove_outliers(&mut pulses);
        if outliers > 0 {
            let message = format!(
                "{outliers} points of {name} lie more than {distance:.0} m above or below the points \
                 recorded before and after them; they are ignored as noise"
            );
            found.warn(Some(Place::of_file(path)), message);
        }
        let count = pulses.len();
        let recording = Recording::new(pulses).ok_or_else(|| {
            Error::input(format!(
                "{name}: {count} pulses within a flight line are too few to estimate a flight, which needs \
                 {MIN_PULSES}; points of one pulse have the same GPS time, and pauses of more than \
                 {FLIGHT_PAUSE} s in the GPS times, which are seconds, separate flight lines",
            ))
        })?;
        recording.check(path)?;
        let partial = partial as f64 / count as f64;
        Ok(Recording { origin, start, source, partial, ..recording })
    }

    /// Rejects points that lie together, and scan angles that do not change across the track.
    fn check(&self, path: &Path) -> Result<()> {
        let name = path.display();
        let (low, high) =
            self.pulses.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), pulse| {
                (low.min(pulse.position), high.max(pulse.position))
            });
        let extent = (high.x - low.x).max(high.y - low.y);
        if extent < MIN_EXTENT {
            return Err(Error::input(format!(
                "{name}: the points of the flight line lie within {extent:.3} m, which is no flight line (or \
                 coordinates that are not lengths)"
            )));
        }
        if self.angle_spread() == 0.0 {
            let angle = degrees(self.pulses[0].angle);
            return Err(Error::input_with_help(
                format!("{name}: all scan angles are {angle}°, but a flight is estimated from their changes"),
                "programs that convert clouds often lose them; fit the cloud as it was delivered",
            ));
        }
        if let Some(channels) = self.fixed_channels() {
            return Err(Error::input_with_help(
                format!(
                    "{name}: each of its {channels} channels has one scan angle, as those of a sensor that \
                     spins: no flight is fitted"
                ),
                "a flight and its scanner are estimated from scan angles that change across the track",
            ));
        }
        Ok(())
    }

    /// A recording of pulses in ascending order of channel of the file and time, at the origin of coordinates
    /// and of times; `None` for fewer than 500.
    pub fn new(pulses: Vec<Pulse>) -> Option<Recording> {
        if pulses.len() < MIN_PULSES {
            return None;
        }
        let is_same = |pair: &&[Pulse]| pair[0].file_channel == pair[1].file_channel;
        let steps = pulses.windows(2).filter(is_same).map(|pair| pair[1].time - pair[0].time);
        let interval = median(steps).unwrap_or(0.0);
        let is_end = |i: &usize| {
            pulses[*i].file_channel != pulses[i - 1].file_channel
                || pulses[*i].time - pulses[i - 1].time > GAP_INTERVALS * interval
        };
        let mut borders = vec![0];
        borders.extend((1..pulses.len()).filter(is_end));
        borders.push(pulses.len());
        let lines = borders.windows(2).map(|pair| pair[0]..pair[1]).collect();
        // Files of LAS 1.4 have steps of 0.006 degrees, also of angles that were rounded before.
        let is_whole = pulses.iter().all(|pulse| {
            let angle = degrees(pulse.angle);
            (angle - angle.round()).abs() < 0.005
        });
        let angle_step = radians(if is_whole { 1.0 } else { 0.006 });
        Some(Recording {
            origin: DVec3::ZERO,
            wkt: None,
            start: 0.0,
            source: 0,
            pulses,
            channels: 1,
            lines,
            interval,
            angle_step,
            partial: 0.0,
        })
    }

    /// Contents of the recording, in the assumed units.
    pub fn description(&self) -> String {
        let (low, high) = self
            .pulses
            .iter()
            .map(|pulse| degrees(pulse.angle))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), angle| (low.min(angle), high.max(angle)));
        format!(
            "{} pulses of {:.3} s, {:.0} a second within their {} scan lines, with scan angles from {}° to \
             {}°",
            self.pulses.len(),
            self.duration(),
            1.0 / self.interval,
            self.lines.len(),
            fixed(low, 2),
            fixed(high, 2)
        )
    }

    /// Standard deviation of the scan angles, rad: by how much they change across the track.
    pub fn angle_spread(&self) -> f64 {
        let count = self.pulses.len() as f64;
        let mean = self.pulses.iter().map(|pulse| pulse.angle).sum::<f64>() / count;
        (self.pulses.iter().map(|pulse| (pulse.angle - mean).powi(2)).sum::<f64>() / count).sqrt()
    }

    /// Number of channels of the file if it has several and each has one scan angle.
    fn fixed_channels(&self) -> Option<usize> {
        let is_fixed = |channel: &&[Pulse]| {
            let angles = channel.iter().map(|pulse| pulse.angle);
            let ends = (f64::INFINITY, f64::NEG_INFINITY);
            let (low, high) = angles.fold(ends, |(low, high), angle| (low.min(angle), high.max(angle)));
            high - low < 0.5 * self.angle_step
        };
        let channels: Vec<&[Pulse]> = self.pulses.chunk_by(|a, b| a.file_channel == b.file_channel).collect();
        (channels.len() > 1 && channels.iter().all(is_fixed)).then_some(channels.len())
    }

    /// True if the scan angles are rounded to degrees.
    pub fn has_whole_angles(&self) -> bool {
        self.angle_step > radians(0.5)
    }

    /// Time from the pulse before `i` to this one, s.
    pub fn interval_before(&self, i: usize) -> f64 {
        self.pulses[i].time - self.pulses[i - 1].time
    }

    /// Duration of the flight line, s.
    pub fn duration(&self) -> f64 {
        self.pulses.iter().map(|pulse| pulse.time).fold(0.0, f64::max)
    }
}

/// Points of a flight line, grouped into pulses.
struct Grouped {
    /// In the order of channel of the file and time.
    pulses: Vec<Pulse>,
    /// Number of points that have the time of another pulse.
    others: usize,
    /// Number of pulses without their first return.
    partial: usize,
}

/// Pulses of the points of a flight line. Points are released while pulses are made, from the last to the
/// first.
fn pulses_of(mut rows: Vec<Row>, origin: DVec3, start: f64) -> Grouped {
    let order = |a: &Row, b: &Row| {
        let by_time = a.channel.cmp(&b.channel).then(a.time.total_cmp(&b.time));
        by_time.then(a.number.cmp(&b.number))
    };
    // Points of one channel are in this order.
    if !rows.is_sorted_by(|a, b| order(a, b).is_le()) {
        rows.sort_by(order);
    }
    let is_pulse = |a: &Row, b: &Row| a.channel == b.channel && a.time == b.time;
    let count = rows.chunk_by(is_pulse).count();
    let mut grouped = Grouped { pulses: Vec::with_capacity(count), others: 0, partial: 0 };
    while !rows.is_empty() {
        let mut from = rows.len().saturating_sub(RELEASED_ROWS);
        while from > 0 && is_pulse(&rows[from - 1], &rows[from]) {
            from -= 1;
        }
        for returns in rows[from..].chunk_by(is_pulse).rev() {
            let (row, last) = (&returns[0], &returns[returns.len() - 1]);
            let is_repeated = |pair: &&[Row]| pair[0].number.max(1) == pair[1].number.max(1);
            grouped.others += returns.windows(2).filter(is_repeated).count();
            grouped.partial += usize::from(row.number > 1);
            grouped.pulses.push(Pulse {
                time: row.time - start,
                position: row.position - origin,
                angle: radians(row.angle),
                returns: row.returns.max(1),
                class: row.class,
                last: (last.number > row.number).then(|| last.position - origin),
                file_channel: row.channel,
                channel: 0,
            });
        }
        rows.truncate(from);
        rows.shrink_to_fit();
    }
    grouped.pulses.reverse();
    grouped
}

/// Removes pulses, and last returns of pulses, far above or below the others around their time. Returns their
/// number, and the distance that is too far, m.
fn remove_outliers(pulses: &mut Vec<Pulse>) -> (usize, f64) {
    let mut near = Vec::with_capacity(2 * NEIGHBOURS + 1);
    let medians: Vec<f64> = (0..pulses.len())
        .map(|i| {
            let around = i.saturating_sub(NEIGHBOURS)..(i + NEIGHBOURS + 1).min(pulses.len());
            near.clear();
            near.extend(pulses[around].iter().map(|pulse| pulse.position.z));
            let middle = near.len() / 2;
            *near.select_nth_unstable_by(middle, f64::total_cmp).1
        })
        .collect();
    let mut distances: Vec<f64> =
        pulses.iter().zip(&medians).map(|(pulse, median)| (pulse.position.z - median).abs()).collect();
    let most = distances.len() * 95 / 100;
    if distances.is_empty() {
        return (0, MIN_OUTLIER);
    }
    let usual = *distances.select_nth_unstable_by(most, f64::total_cmp).1;
    let limit = MIN_OUTLIER.max(OUTLIER * usual);
    let mut removed = 0;
    let mut medians = medians.into_iter();
    pulses.retain_mut(|pulse| {
        let median = medians.next().unwrap_or(pulse.position.z);
        if pulse.last.is_some_and(|last| (last.z - median).abs() > limit) {
            pulse.last = None;
            removed += 1;
        }
        let is_near = (pulse.position.z - median).abs() <= limit;
        removed += usize::from(!is_near);
        is_near
    });
    (removed, limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pulses_without_their_first_return_are_counted() {
        let row = |(time, number): (f64, u8)| Row {
            time,
            position: DVec3::ZERO,
            angle: 0.0,
            source: 1,
            number,
            returns: 2,
            class: 2,
            channel: 0,
        };
        let rows: Vec<Row> =
            [(0.0, 1), (0.0, 2), (1.0, 2), (2.0, 1), (3.0, 0)].into_iter().map(row).collect();
        let grouped = pulses_of(rows, DVec3::ZERO, 0.0);
        assert_eq!((grouped.pulses.len(), grouped.others, grouped.partial), (4, 0, 1));
    }

    #[test]
    fn pulses_are_the_returns_of_one_channel_and_time_in_any_order() {
        let row = |(channel, time, number): (u16, f64, u8)| Row {
            time,
            position: DVec3::new(0.0, f64::from(channel), f64::from(number)),
            angle: 0.0,
            source: 1,
            number,
            returns: 3,
            class: 2,
            channel,
        };
        let values = [(1, 5.0, 1), (0, 6.0, 1), (1, 5.0, 3), (0, 5.0, 2), (0, 5.0, 2), (0, 6.0, 0)];
        let mut rows: Vec<Row> = values.into_iter().map(row).collect();
        for _ in 0..2 {
            let grouped = pulses_of(rows.clone(), DVec3::ZERO, 1.0);
            let pulse = |pulse: &Pulse| (pulse.file_channel, pulse.time, pulse.last.map(|last| last.z));
            let pulses: Vec<(u16, f64, Option<f64>)> = grouped.pulses.iter().map(pulse).collect();
            assert_eq!(pulses, [(0, 4.0, None), (0, 5.0, Some(1.0)), (1, 4.0, Some(3.0))]);
            assert_eq!((grouped.others, grouped.partial), (2, 1));
            rows.reverse();
        }
    }

    #[test]
    fn several_channels_with_one_scan_angle_each_are_those_of_a_sensor_that_spins() {
        let recorded = |channels: u16, angle: &dyn Fn(u16, u16) -> f64| {
            let pulse = |channel: u16, k: u16| {
                let turn = 0.1 * f64::from(k);
                Pulse {
                    time: 1e-4 * f64::from(k) + 1e-6 * f64::from(channel),
                    position: DVec3::new(20.0 * libm::cos(turn), 20.0 * libm::sin(turn), 0.0),
                    angle: radians(angle(channel, k)),
                    returns: 1,
                    class: 1,
                    last: None,
                    file_channel: channel,
                    channel: 0,
                }
            };
            let pulses = (0..channels).flat_map(|channel| (0..600).map(move |k| pulse(channel, k)));
            Recording::new(pulses.collect()).unwrap().fixed_channels()
        };
        let of_channel = |channel: u16, _: u16| 75.0 + 2.0 * f64::from(channel);
        assert_eq!(recorded(8, &of_channel), Some(8));
        assert_eq!(recorded(1, &of_channel), None);
        // Steps of LAS across the track of one channel, and whole degrees.
        let changing = |channel: u16, k: u16| if channel == 1 { 0.006 * f64::from(k % 2) } else { 5.0 };
        assert_eq!(recorded(2, &changing), None);
        assert_eq!(recorded(2, &|_, k| f64::from(k % 2)), None);
    }

    #[test]
    fn points_far_from_those_around_them_are_noise() {
        let pulse = |k: usize| {
            let position = DVec3::new(k as f64, 0.0, 0.3 * k as f64);
            let last = (k % 10 == 3).then_some(position);
            Pulse {
                time: 1e-5 * k as f64,
                position,
                angle: 0.0,
                returns: 1,
                class: 1,
                last,
                file_channel: 0,
                channel: 0,
            }
        };
        let mut pulses: Vec<Pulse> = (0..2000).map(pulse).collect();
        assert_eq!(remove_outliers(&mut pulses).0, 0);
        for k in (0..2000).step_by(50) {
            pulses[k].position.z += if k % 100 == 0 { 500.0 } else { -300.0 };
        }
        pulses[3].last = Some(DVec3::new(3.0, 0.0, -400.0));
        let (removed, limit) = remove_outliers(&mut pulses);
        assert_eq!((removed, pulses.len(), limit), (41, 1960, MIN_OUTLIER));
        assert!(pulses.iter().all(|pulse| (pulse.position.z - 0.3 * pulse.position.x).abs() < 1e-9));
        assert!(
            pulses[2].last.is_none() && pulses.iter().filter(|pulse| pulse.last.is_some()).count() == 199
        );
    }
}
