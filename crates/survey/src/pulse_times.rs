//! Emission times of pulses: a file of times, or repeating intervals.

use super::PulseTimes;
use super::fields::Fields;
use super::keys::SettingsKeys;
use super::rows::{MAX_LONG_FILE_BYTES, RowLayout, RowProblem, read_rows};
use vlscan_base::quantity::{Bounds, MAX_DURATION, PULSE_FREQ, number};

const K: SettingsKeys = SettingsKeys::KEYS;

/// Interval between two pulses, µs.
const INTERVAL_US: Bounds = Bounds::new(1e-3, 1e12, "a number from 1e-3 to 1e12 µs");
/// Maximum number of repeating intervals.
const MAX_INTERVALS: usize = 65_536;

/// Applies the keys of pulse times. A pulse frequency in the same table has no effect; one in another table
/// replaces inherited times.
pub(super) fn change_pulse_times(fields: &mut Fields, times: &mut Option<PulseTimes>) {
    fields.either(K.pulse_times, K.pulse_intervals_us);
    let given = [K.pulse_times, K.pulse_intervals_us].into_iter().find(|key| fields.has(*key));
    match given {
        Some(key) if fields.has(K.pulse_freq_hz) => {
            fields.warn_of_effect(
                K.pulse_freq_hz,
                &format!("beside `{}`, which says when pulses leave", fields.name(key)),
            );
        }
        None if fields.has(K.pulse_freq_hz) => *times = None,
        _ => {}
    }
    if let Some(name) = fields.near_name(K.pulse_times) {
        *times = read_times(fields, &name).or(times.take());
    }
    let expected = "up to 65536 numbers of µs from 1e-3 to 1e12";
    let are_usable = |list: &[f64]| {
        (1..=MAX_INTERVALS).contains(&list.len()) && list.iter().all(|us| INTERVAL_US.contains(*us))
    };
    if let Some(intervals) = fields.numbers(K.pulse_intervals_us, are_usable, expected) {
        let seconds: Vec<f64> = intervals.iter().map(|us| us / 1e6).collect();
        *times = Some(PulseTimes::of_intervals(&seconds));
    }
}

/// Lines with a time, s, from 0 on, each later than the previous one.
fn read_times(fields: &Fields, name: &str) -> Option<PulseTimes> {
    let mut times: Vec<f64> = Vec::new();
    let row = |&[time]: &[f64; 1]| {
        if !(0.0..=MAX_DURATION).contains(&time) {
            return Err(RowProblem::OutsideLeg { max: MAX_DURATION });
        }
        if times.last().is_some_and(|last| time <= *last) {
            return Err(RowProblem::NotLater);
        }
        times.push(time);
        Ok(())
    };
    let place = fields.place(K.pulse_times);
    let help = "a line is the time of a pulse in s after the start of the leg, such as `0.00000054`";
    let columns = "a finite number: the time of a pulse in s";
    let format = RowLayout { columns, help, headings: ["time_s"] };
    read_rows(fields.context, name, (fields.folder(), MAX_LONG_FILE_BYTES), &place, &format, row)?;
    let (Some(first), Some(last)) = (times.first(), times.last().filter(|_| times.len() > 1)) else {
        fields.context.error_help(place, format!("`{name}` has fewer than two times"), help);
        return None;
    };
    let rate = (times.len() - 1) as f64 / (last - first);
    if rate > PULSE_FREQ.high {
        let message = format!(
            "`{name}` has {} pulses per second on average, expected at most {}",
            number(rate),
            number(PULSE_FREQ.high)
        );
        fields.context.error_help(place, message, "times are in seconds");
        return None;
    }
    Some(PulseTimes::Recorded(times.into()))
}
