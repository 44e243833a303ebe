//! Scan patterns of tables (`optics = "pattern"`), and correction files of spinning sensors.
//!
//! | file | what it does |
//! |---|---|
//! | `columns` | names and units of columns |
//! | `sink` | readers of rows, and their problems |
//! | `rows` | rows of a pattern, checked one by one, as beams by channel |
//! | `npy` | arrays of NumPy |
//! | `table` | files of rows: text, Parquet, NumPy |
//! | `corrections` | angles and firing times of channels |

mod columns;
mod corrections;
mod npy;
mod rows;
mod sink;
mod table;

pub(super) use corrections::corrected_channels;

use super::fields::Fields;
use super::keys::InstrumentKeys;
use super::{Deflector, Device, Mount, PatternTable, PulseTimes, Scanner};
use rows::{Pattern, PatternChannel, PatternRows, pulse_times};
use sink::AngleRange;
use std::sync::Arc;
use table::{TableFile, add_listed};
use vlscan_base::diag::Place;
use vlscan_geom::DVec3;

const K: InstrumentKeys = InstrumentKeys::KEYS;

/// Columns of a pattern, as help.
const HELP: &str = "a row is azimuth_deg and elevation_deg (or zenith_deg), after time_s or index if there \
                    is one; channel, origin_x_m, origin_y_m, origin_z_m and divergence_rad may follow; \
                    headings name the columns";

/// The deflector of a device whose pattern has not been read.
pub(super) fn unread() -> Deflector {
    Deflector::Pattern(Arc::new(PatternTable::default()))
}

/// Applies the pattern of `[scanner]`, which replaces all channels: one device for each channel of the table.
/// `None` after an error.
pub(super) fn apply_pattern(fields: &mut Fields, scanner: &mut Scanner) -> Option<()> {
    if !matches!(scanner.devices[0].deflector, Deflector::Pattern(_)) {
        return Some(());
    }
    let repeats = fields.flag(K.pattern_repeat, true);
    let senses = [("clockwise", false), ("counterclockwise", true)];
    let sense = fields.choice(K.pattern_azimuth, &senses, None);
    let mut rows = PatternRows::new(sense, fields.has(K.pulse_freqs_hz));
    if !fields.has(K.pattern) {
        fields.missing(K.pattern);
        return None;
    }
    let place = fields.place(K.pattern);
    read_rows(fields, &place, &mut rows)?;
    if let Some(message) = rows.warning() {
        fields.context.warn_help(place.clone(), message, AngleRange::HELP);
    }
    let pattern = match rows.finish(repeats) {
        Ok(pattern) => pattern,
        Err(problem) => {
            fields.context.error_help(place, problem.to_string(), HELP);
            return None;
        }
    };
    let Pattern { channels, times, has_times } = pattern;
    scanner.pulse_times = when(fields, scanner, (times, has_times), repeats)?;
    let mut base = scanner.devices[0].clone();
    // Directions count from the axes of the scanner. An entry of the catalogue has the pose of its channel,
    // or of the middle of its field.
    if !fields.has(K.beam_origin) {
        let offset = if scanner.multi_channel { DVec3::ZERO } else { base.beam_origin.offset };
        base.beam_origin = Mount { offset, ..Mount::IDENTITY };
    }
    if !fields.has(K.firing_offset_us) {
        base.firing_offset = 0.0;
    }
    (base.scan_angle_max, base.scan_freq) = (0.0, (0.0, 0.0));
    scanner.multi_channel = channels.iter().any(|channel| channel.number.is_some());
    let device = |channel: PatternChannel| {
        let mut device = base.clone();
        device.id = channel.number.map_or_else(|| scanner.id.clone(), |number| number.to_string());
        device.beam.divergence = channel.divergence.unwrap_or(device.beam.divergence);
        device.deflector = Deflector::Pattern(Arc::new(channel.table));
        device
    };
    let devices: Vec<Device> = channels.into_iter().map(device).collect();
    scanner.devices = devices;
    Some(())
}

/// Reads the file of the pattern, or its rows in brackets.
fn read_rows(fields: &mut Fields, place: &Place, rows: &mut PatternRows) -> Option<()> {
    if fields.has_list(K.pattern) {
        let listed = fields.rows(K.pattern, "a file, or rows in brackets such as [[0, 10], [1, 10]]")?;
        return match add_listed(&listed, rows) {
            Ok(()) => Some(()),
            Err(problem) => {
                fields.context.error_help(place.clone(), problem.to_string(), HELP);
                None
            }
        };
    }
    let name = fields.near_name(K.pattern)?;
    let file = TableFile { context: fields.context, name: &name, folder: fields.folder(), place, help: HELP };
    file.read(rows)
}

/// The times at which the pulses of a pattern leave; inner `None` if a pulse rate is given. `None` after an
/// error.
fn when(
    fields: &Fields,
    scanner: &mut Scanner,
    (times, has_times): (Vec<f64>, bool),
    repeats: bool,
) -> Option<Option<PulseTimes>> {
    let place = fields.place(K.pattern);
    if fields.has(K.pulse_freqs_hz) {
        if has_times {
            let message = "the times of `pattern` have no effect beside `pulse_freqs_hz`: each pulse takes \
                           the next row";
            fields.context.warn_help(place, message, "leave out `pulse_freqs_hz` to fire at these times");
        }
        return Some(None);
    }
    if !has_times {
        if scanner.pulse_freqs.is_empty() {
            let message = match times.is_empty() {
                true => "the rows of `pattern` have no times: `pulse_freqs_hz` is needed",
                false => "the times of `pattern` count its rows: `pulse_freqs_hz` is needed",
            };
            let help = "pulse_freqs_hz = [200000], each pulse takes the next row";
            fields.context.error_help(place, message, help);
            return None;
        }
        return Some(None);
    }
    match pulse_times(times, repeats) {
        Ok(times) => {
            scanner.pulse_freqs = vec![times.mean_rate().round().max(1.0) as u32];
            Some(Some(times))
        }
        Err(problem) => {
            fields.context.error_help(place, problem.to_string(), HELP);
            None
        }
    }
}
