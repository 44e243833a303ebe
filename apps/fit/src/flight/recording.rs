//! The pulses of one flight line of a recorded cloud.

use super::flight_lines::{FLIGHT_PAUSE, FlightLine, FlightLineName, warn_of_others};
use super::grouping::{Grouped, pulses_of};
use super::outliers::remove_outliers;
use super::points::{LineRows, Outline};
use super::pulses::{Pulse, Pulses};
use super::search::median_of;
use super::windows::Windows;
use crate::rows::Rows;
use std::ops::Range;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::{amount_of, fixed};
use vlscan_geom::{DVec3, degrees, radians};

/// Intervals longer than the short ones of their line by this factor contain pulses without a return.
pub(super) const LOST: f64 = 1.6;
/// A gap of this many median intervals between pulses ends a line.
const GAP_INTERVALS: f64 = 100.0;
/// Minimum number of pulses of a flight line.
const MIN_PULSES: usize = 500;
/// Minimum extent of the points of a flight line, m.
const MIN_EXTENT: f64 = 1.0;

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
    pub pulses: Pulses,
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
    /// Windows of time of the pulses, if only some of the flight line are used.
    pub(super) windows: Windows,
}

impl Recording {
    /// Reads one flight line of a cloud: of those with the name `line`, or of all, the one with the most
    /// points. Warnings, also of lines that are left out, are added to `found`.
    ///
    /// Points may take `max_memory`, bytes; of more points those of some windows of time are used.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] for clouds without GPS times or scan angles, with too few pulses, or
    /// if the memory allows hardly any points.
    pub(crate) fn read(
        path: &Path,
        line: Option<FlightLineName>,
        max_memory: u64,
        found: &mut Diagnostics,
    ) -> Result<Recording> {
        let mut outline = Outline::read(path, Some(max_memory), found)?;
        let name = path.display();
        let mut lines = std::mem::take(&mut outline.lines);
        if let Some(line) = line {
            lines = line.select(&lines, path)?;
        }
        let Some(longest) = lines.iter().copied().max_by_key(|line: &FlightLine| line.points) else {
            return Err(Error::input(format!("{name} has no points with times and scan angles")));
        };
        let wkt = outline.wkt.take();
        // A line that is chosen by its number has no turns.
        let is_numbered = line.is_some_and(|line| line.number.is_some());
        if let Some(points) = outline.turns.get(&longest.source).filter(|_| !is_numbered) {
            let message = format!(
                "the flight of point source {} has turns: each straight part is a flight line, and {points} \
                 points of the turns are ignored",
                longest.source
            );
            found.warn(Some(Place::of_file(path)), message);
        }
        let LineRows { rows, windows, limit } = outline.rows_of(longest, path)?;
        if windows != Windows::ALL {
            let message = format!(
                "{} of the flight line take more memory than --max-memory {}: {} are fitted, {}",
                amount_of(longest.points as f64, "point"),
                limit.memory(),
                windows.described(),
                amount_of(rows.len() as f64, "point")
            );
            found
                .warn(Some(Place::of_file(path)), message)
                .help("the attitude of the flight is interpolated between; a larger limit allows all points");
        }
        let recording = Recording { wkt, windows, ..Recording::of(rows, path, found)? };
        if lines.len() > 1 {
            warn_of_others(path, &lines, longest, found);
        }
        Ok(recording)
    }

    /// The pulses of the points of a flight line, by time.
    fn of(rows: Rows, path: &Path, found: &mut Diagnostics) -> Result<Recording> {
        let name = path.display();
        let points = rows.len();
        let (source, start) = (rows.get(0).source, rows.get(0).time);
        let origin = rows.get(points / 2).position.floor();
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
                "a fit needs the pulses of one flight line, whose times differ: fit the cloud with the times \
                 before they were rounded; points that are in the file twice, flight lines with the same \
                 point source, and beams that fire together without a number of their channel have to be \
                 taken apart before",
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
        let recording = Recording::of_pulses(pulses).ok_or_else(|| {
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
            let angle = degrees(self.pulses.angle(0));
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
        Recording::of_pulses(pulses.into_iter().collect())
    }

    /// A recording of these pulses, see [`Recording::new`].
    pub(crate) fn of_pulses(pulses: Pulses) -> Option<Recording> {
        if pulses.len() < MIN_PULSES {
            return None;
        }
        let channels: Vec<Range<usize>> = pulses.by_file_channel().collect();
        let steps = |i: usize| pulses.time(i) - pulses.time(i - 1);
        let interval = median_of(|| channels.iter().flat_map(|of| of.clone().skip(1)).map(steps));
        let interval = interval.unwrap_or(0.0);
        let mut lines = Vec::new();
        for Range { mut start, end } in channels {
            for i in start + 1..end {
                if steps(i) > GAP_INTERVALS * interval {
                    lines.push(start..i);
                    start = i;
                }
            }
            lines.push(start..end);
        }
        // Files of LAS 1.4 have steps of 0.006 degrees, also of angles that were rounded before.
        let is_whole = pulses.angles().all(|angle| {
            let angle = degrees(angle);
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
            windows: Windows::ALL,
        })
    }

    /// Leaves out lines that the ends of windows may have cut, unless all are cut.
    pub(super) fn leave_out_cut_lines(&mut self) {
        let gap = GAP_INTERVALS * self.interval;
        let to_end = |i: usize| self.windows.to_end(self.start + self.pulses.time(i));
        let is_whole = |line: &&Range<usize>| to_end(line.start).min(to_end(line.end - 1)) > gap;
        let whole: Vec<Range<usize>> = self.lines.iter().filter(is_whole).cloned().collect();
        if !whole.is_empty() {
            self.lines = whole;
        }
    }

    /// Number of windows of time in which there are pulses, at most.
    pub(super) fn max_windows(&self) -> usize {
        self.windows.count(self.duration())
    }

    /// Contents of the recording, in the assumed units.
    pub fn description(&self) -> String {
        let (low, high) = ends(self.pulses.angles().map(degrees));
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
        let mean = self.pulses.angles().sum::<f64>() / count;
        (self.pulses.angles().map(|angle| (angle - mean).powi(2)).sum::<f64>() / count).sqrt()
    }

    /// Number of channels of the file if it has several and each has one scan angle.
    fn fixed_channels(&self) -> Option<usize> {
        let is_fixed = |channel: Range<usize>| {
            let (low, high) = ends(channel.map(|i| self.pulses.angle(i)));
            high - low < 0.5 * self.angle_step
        };
        let channels = self.pulses.by_file_channel().count();
        (channels > 1 && self.pulses.by_file_channel().all(is_fixed)).then_some(channels)
    }

    /// True if the scan angles are rounded to degrees.
    pub fn has_whole_angles(&self) -> bool {
        self.angle_step > radians(0.5)
    }

    /// Time from the pulse before `i` to this one, s.
    pub fn interval_before(&self, i: usize) -> f64 {
        self.pulses.time(i) - self.pulses.time(i - 1)
    }

    /// Duration of the flight line, s.
    pub fn duration(&self) -> f64 {
        let last = |channel: Range<usize>| self.pulses.time(channel.end - 1);
        self.pulses.by_file_channel().map(last).fold(0.0, f64::max)
    }
}

/// The smallest and the largest of some values.
pub(super) fn ends(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    values.fold(none, |(low, high), value| (low.min(value), high.max(value)))
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn lines_that_windows_cut_are_left_out() {
        // Scan lines of 90 ms in every 100 ms, in every third second.
        let pulse = |k: u32| {
            let position = DVec3::new(f64::from(k), 0.0, 0.0);
            Pulse::on_ground(1e-4 * f64::from(k), position, radians(0.006 * f64::from(k % 1000)))
        };
        let windows = Windows::one_of(3);
        let is_recorded = |k: &u32| windows.has(1e-4 * f64::from(*k)) && (*k + 250) % 1000 < 900;
        let recording = Recording::new((0..200_000).filter(is_recorded).map(pulse).collect()).unwrap();
        let mut all = recording.clone();
        all.leave_out_cut_lines();
        assert_eq!(all.lines, recording.lines);
        let mut some = Recording { windows, ..recording };
        let count = some.lines.len();
        some.leave_out_cut_lines();
        // The last window is cut at its beginning and its end, too.
        assert_eq!((count - some.lines.len(), some.lines.iter().all(|line| line.len() == 900)), (14, true));
        assert!((7..10).contains(&some.max_windows()) && all.max_windows() == 1);
    }
}
