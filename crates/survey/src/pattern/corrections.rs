//! Angle correction files of spinning sensors as channels: those of Hesai, and beam intrinsics of Ouster.
//!
//! A file of Hesai has the columns channel (from 1), elevation and azimuth, degrees, the latter clockwise
//! seen from above; a line `EEFF,1,1` may stand before them, and a checksum behind. Another file has the
//! firing times of the channels, µs, relative to each other.

use super::columns::{Column, Row};
use super::sink::{AngleRange, MAX_CHANNEL, MAX_CHANNELS, PatternProblem, RowResult, RowSink, check_columns};
use super::table::TableFile;
use crate::beams::{Beams, beam_pose, channels_of_beams, level};
use crate::context::Context;
use crate::fields::Fields;
use crate::keys::{InstrumentKeys, Key};
use crate::{Device, Scanner};
use std::collections::BTreeMap;
use std::path::Path;
use vlscan_base::diag::Place;
use vlscan_base::quantity::{FIRING_OFFSET_US, number};

const K: InstrumentKeys = InstrumentKeys::KEYS;

/// Reads the beams of a calibration file of Ouster, searched from a folder; the place is that of its name.
pub(crate) type ReadBeams = fn(&Context, &str, &Path, Place) -> Option<Beams>;

const ANGLES_HELP: &str = "a row is the channel, its elevation and its azimuth in degrees, such as `1, \
                           14.9, -1.04`; a column `firing_time_us` may follow";
const TIMES_HELP: &str = "a row is the channel and its firing time in µs, such as `1, 5.6`";
/// Minimum length of a checksum, characters.
const MIN_CHECKSUM: usize = 16;

/// Rows by channel: of firing times if `TIMES` is set, else of angles.
struct ByChannel<const TIMES: bool> {
    columns: Vec<Column>,
    rows: BTreeMap<u32, Row>,
    angles: AngleRange,
}

impl<const TIMES: bool> ByChannel<TIMES> {
    /// Numbers of the channels from 0, if they count them from 0 or 1 without gaps; else as they are.
    fn numbers(&self) -> Vec<u32> {
        let numbers: Vec<u32> = self.rows.keys().copied().collect();
        let is_counted = numbers.windows(2).all(|pair| pair[1] == pair[0] + 1);
        match numbers.first() {
            Some(1) if is_counted => (0..numbers.len() as u32).collect(),
            _ => numbers,
        }
    }
}

/// Columns of a table of angles, or of firing times.
const fn columns_of(is_times: bool) -> &'static [Column] {
    match is_times {
        true => &[Column::Channel, Column::FiringTime],
        false => &[Column::Channel, Column::Elevation, Column::Azimuth],
    }
}

impl<const TIMES: bool> RowSink for ByChannel<TIMES> {
    fn unnamed(count: usize) -> Option<&'static [Column]> {
        Some(columns_of(TIMES)).filter(|columns| columns.len() == count)
    }

    fn begin(&mut self, columns: &[Column], has_units: bool) -> Result<(), PatternProblem> {
        self.columns = columns.to_vec();
        self.angles = AngleRange::new(has_units);
        check_columns(columns, columns_of(TIMES))
    }

    fn add(&mut self, row: &Row) -> RowResult {
        let within = |column: Column, low: f64, high: f64| {
            let value = row[column as usize];
            match !self.columns.contains(&column) || (low..=high).contains(&value) {
                true => Ok(()),
                false => {
                    let expected = format!("a number from {} to {}", number(low), number(high));
                    Err((column, PatternProblem::Value(expected)))
                }
            }
        };
        within(Column::Channel, 0.0, MAX_CHANNEL)?;
        within(Column::Elevation, -90.0, 90.0)?;
        within(Column::Azimuth, -360.0, 360.0)?;
        within(Column::FiringTime, -FIRING_OFFSET_US.high, FIRING_OFFSET_US.high)?;
        self.angles.add(row);
        let channel = row[Column::Channel as usize];
        if channel.fract() != 0.0 {
            return Err((Column::Channel, PatternProblem::Value("a whole number".to_owned())));
        }
        if self.rows.insert(channel as u32, *row).is_some() {
            return Err((Column::Channel, PatternProblem::Value("each channel once".to_owned())));
        }
        match self.rows.len() > MAX_CHANNELS {
            true => {
                let problem = PatternProblem::TooMany { max: MAX_CHANNELS as u64, what: "channels" };
                Err((Column::Channel, problem))
            }
            false => Ok(()),
        }
    }

    fn skips(first: &str) -> bool {
        let is_checksum = first.len() >= MIN_CHECKSUM && first.chars().all(|c| c.is_ascii_hexdigit());
        first.eq_ignore_ascii_case("eeff") || is_checksum
    }
}

/// The channels that `corrections` and `firing_times` state, or `None` where they cannot be read. Outer
/// `None` without them.
pub(crate) fn corrected_channels(
    fields: &mut Fields,
    scanner: &Scanner,
    ouster: ReadBeams,
) -> Option<Option<Vec<Device>>> {
    if !fields.has(K.corrections) && !fields.has(K.firing_times) {
        return None;
    }
    fields.either(K.corrections, K.elevations_deg);
    fields.either(K.firing_times, K.firing_offset_us);
    Some(channels_of(fields, scanner, ouster))
}

fn channels_of(fields: &mut Fields, scanner: &Scanner, ouster: ReadBeams) -> Option<Vec<Device>> {
    let Corrected { mut devices, numbers, has_times } = match fields.has(K.corrections) {
        true => corrected(fields, scanner, ouster)?,
        false => Corrected::counted(scanner.devices.clone()),
    };
    if fields.has(K.firing_times) {
        if has_times {
            fields
                .error(K.firing_times, "and a column of firing times in `corrections` contradict each other");
            return None;
        }
        let table = by_channel::<true>(fields, K.firing_times, TIMES_HELP)?;
        let times: Vec<f64> = table.rows.values().map(|row| row[Column::FiringTime as usize]).collect();
        if times.len() != devices.len() {
            let message =
                format!("must have a row for each of the {} channels, found {}", devices.len(), times.len());
            fields.error(K.firing_times, &message);
            return None;
        }
        if table.numbers() != numbers {
            let message = match fields.has(K.corrections) {
                true => "must have the channels of `corrections`",
                false => "must count the channels of the scanner from 0 or 1 without gaps",
            };
            fields.error(K.firing_times, message);
            return None;
        }
        set_times(&mut devices, &times);
    }
    Some(devices)
}

/// Channels with the angles of a file.
struct Corrected {
    devices: Vec<Device>,
    /// Their numbers in the file, see [`ByChannel::numbers`].
    numbers: Vec<u32>,
    /// True if the file has firing times, too.
    has_times: bool,
}

impl Corrected {
    /// Channels that are counted from 0.
    fn counted(devices: Vec<Device>) -> Corrected {
        let numbers = (0..devices.len() as u32).collect();
        Corrected { devices, numbers, has_times: false }
    }
}

/// Reads a table of `[scanner]`.
fn by_channel<const TIMES: bool>(
    fields: &mut Fields,
    key: Key,
    help: &'static str,
) -> Option<ByChannel<TIMES>> {
    let place = fields.place(key);
    let name = fields.near_name(key)?;
    let mut table = ByChannel { columns: Vec::new(), rows: BTreeMap::new(), angles: AngleRange::new(false) };
    let file =
        TableFile { context: fields.context, name: &name, folder: fields.folder(), place: &place, help };
    file.read(&mut table)?;
    let known = [Column::Channel, Column::Elevation, Column::Azimuth, Column::FiringTime];
    let others = table.columns.iter().filter(|column| !known.contains(column));
    let others: Vec<&str> = others.map(|column| column.name()).collect();
    if !others.is_empty() {
        fields.warn(key, &format!("has columns that are not read: {}", others.join(", ")));
    }
    if let Some(message) = table.angles.warning() {
        fields.context.warn_help(place.clone(), message, AngleRange::HELP);
    }
    if table.rows.is_empty() {
        fields.context.error_help(place, PatternProblem::Empty.to_string(), help);
        return None;
    }
    Some(table)
}

/// The channels of the scanner with the angles of a file: its own, if there are as many, or copies of its
/// only one.
fn corrected(fields: &mut Fields, scanner: &Scanner, ouster: ReadBeams) -> Option<Corrected> {
    let place = fields.place(K.corrections);
    let name = fields.near_name(K.corrections)?;
    let is_json = Path::new(&name).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json"));
    let (elevations, azimuths, origin, times, numbers) = if is_json {
        let beams = ouster(fields.context, &name, fields.folder(), place)?;
        let numbers = (0..beams.altitudes.len() as u32).collect();
        (beams.altitudes, beams.azimuths, Some(beams.origin), Vec::new(), numbers)
    } else {
        let table = by_channel::<false>(fields, K.corrections, ANGLES_HELP)?;
        let column =
            |column: Column| -> Vec<f64> { table.rows.values().map(|row| row[column as usize]).collect() };
        let has_times = table.columns.contains(&Column::FiringTime);
        let times = if has_times { column(Column::FiringTime) } else { Vec::new() };
        (column(Column::Elevation), column(Column::Azimuth), None, times, table.numbers())
    };
    let mut devices = match scanner.devices.len() {
        1 => {
            let base = &scanner.devices[0];
            channels_of_beams(base, &elevations, &azimuths, &[0.0], &[base.firing_offset * 1e6])
        }
        count if count == elevations.len() => {
            // Rows belong to the channels by their order.
            if let [first, .., last] = numbers[..]
                && (first, last) != (0, count as u32 - 1)
            {
                let message = format!(
                    "must count the {count} channels of the scanner from 0 or 1 without gaps, found {first} \
                     to {last}"
                );
                fields.error(K.corrections, &message);
                return None;
            }
            let angles = elevations.iter().zip(&azimuths);
            let states_pose = fields.has(K.beam_origin);
            let turned = |(device, (elevation, azimuth)): (&Device, (&f64, &f64))| {
                let base = if states_pose { device.beam_origin } else { level(&device.beam_origin) };
                Device { beam_origin: beam_pose(&base, *elevation, *azimuth), ..device.clone() }
            };
            scanner.devices.iter().zip(angles).map(turned).collect()
        }
        count => {
            let message = format!("has {} channels, but the scanner has {count}", elevations.len());
            fields.error(K.corrections, &message);
            return None;
        }
    };
    if let Some(origin) = origin {
        devices.iter_mut().for_each(|device| device.beam_origin.offset = origin);
    }
    let has_times = !times.is_empty();
    if has_times {
        if fields.has(K.firing_offset_us) {
            let message = "and a column of firing times in `corrections` contradict each other";
            fields.error(K.firing_offset_us, message);
        }
        set_times(&mut devices, &times);
    }
    Some(Corrected { devices, numbers, has_times })
}

/// Sets the firing times, µs, from that of the first pulse on.
fn set_times(devices: &mut [Device], times: &[f64]) {
    let first = times.iter().copied().fold(f64::INFINITY, f64::min);
    for (device, time) in devices.iter_mut().zip(times) {
        device.firing_offset = (time - first) * 1e-6;
    }
}
