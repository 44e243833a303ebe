//! Rows of a scan pattern, checked one by one and converted to beams.

use super::columns::{Column, Row};
use super::sink::{AngleRange, MAX_CHANNEL, MAX_CHANNELS, PatternProblem, RowResult, RowSink, check_columns};
use crate::{PatternBeam, PatternTable, PulseTimes};
use std::collections::BTreeMap;
use vlscan_base::quantity::{DIVERGENCE, MAX_DURATION, PULSE_FREQ, number};
use vlscan_geom::{DVec3, radians};

/// Maximum number of rows.
const MAX_ROWS: usize = 1 << 24;
/// Maximum number of steps of a pattern, and of steps of all its channels that not every step fires.
const MAX_STEPS: u64 = 1 << 25;
/// Largest azimuth, degrees.
const MAX_AZIMUTH: f64 = 360.0;
/// Largest time and number of a row.
const MAX_KEY: f64 = 1e12;
/// Largest distance of the origin of a beam from that of the emitter along an axis, m.
const MAX_ORIGIN: f64 = 10.0;

/// Order of the rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    /// Its place in the table.
    Row,
    Time,
    Index,
}

/// A channel while its rows are read.
#[derive(Debug)]
struct Channel {
    beams: Vec<PatternBeam>,
    /// rad; NaN without a column.
    divergence: f64,
}

/// The rows of a pattern while they are read.
#[derive(Debug)]
pub(super) struct PatternRows {
    order: Order,
    /// True if the azimuths are counterclockwise.
    is_mirrored: Option<bool>,
    /// True if rows of tables without channels are in the order of the table, whatever their times.
    ignores_times: bool,
    /// Time of the last row if times are ignored, and true if all times so far are row numbers.
    ignored: Option<(f64, bool)>,
    has_zenith: bool,
    has_channels: bool,
    channels: BTreeMap<u32, Channel>,
    /// Times or numbers of the first and the last step.
    first: f64,
    last: f64,
    steps: u64,
    /// Times of the steps since the first one, s.
    times: Vec<f64>,
    rows: usize,
    angles: AngleRange,
}

/// A channel of a pattern.
#[derive(Debug)]
pub(super) struct PatternChannel {
    /// Number in the file; `None` if it has no channels.
    pub number: Option<u32>,
    pub table: PatternTable,
    /// Divergence of its beams, rad.
    pub divergence: Option<f64>,
}

/// A complete pattern.
#[derive(Debug)]
pub(super) struct Pattern {
    pub channels: Vec<PatternChannel>,
    /// Times of the steps since the first one, s; empty if the rows have none, or they are ignored.
    pub times: Vec<f64>,
    /// True if the rows have times, and not only their numbers as times, as in tables of Livox.
    pub has_times: bool,
}

impl PatternRows {
    /// No rows. Azimuths are counterclockwise if `is_mirrored` is set; by default in tables with zenith
    /// angles only, as those of Livox. With `ignores_times`, times only say which channels fire together.
    pub fn new(is_mirrored: Option<bool>, ignores_times: bool) -> PatternRows {
        PatternRows {
            order: Order::Row,
            is_mirrored,
            ignores_times,
            ignored: None,
            has_zenith: false,
            has_channels: false,
            channels: BTreeMap::new(),
            first: 0.0,
            last: 0.0,
            steps: 0,
            times: Vec::new(),
            rows: 0,
            angles: AngleRange::new(false),
        }
    }

    /// A warning about angles that look like radians.
    pub fn warning(&self) -> Option<String> {
        self.angles.warning()
    }

    /// The step of a row, and true if it is the first row of that step.
    fn step_of(&self, row: &Row) -> Result<(u64, bool), (Column, PatternProblem)> {
        let (column, name) = match self.order {
            Order::Row => return Ok((self.steps, true)),
            Order::Time => (Column::Time, "a time"),
            Order::Index => (Column::Index, "a number"),
        };
        let value = row[column as usize];
        let value_error = |expected: String| Err((column, PatternProblem::Value(expected)));
        if self.order == Order::Index && (value.fract() != 0.0 || !(0.0..=MAX_KEY).contains(&value)) {
            return value_error(format!("a whole number from 0 to {}", number(MAX_KEY)));
        }
        if !value.is_finite() {
            return value_error("a finite time".to_owned());
        }
        if value.abs() > MAX_KEY {
            return value_error(format!("a time of at most {} s", number(MAX_KEY)));
        }
        if self.rows == 0 {
            return Ok((0, true));
        }
        if value < self.last {
            return Err((column, PatternProblem::Back(name)));
        }
        if value == self.last {
            return Ok((self.steps - 1, false));
        }
        let since = value - self.first;
        match self.order {
            Order::Index if since >= MAX_STEPS as f64 => {
                value_error(format!("a number less than {MAX_STEPS} above the first one"))
            }
            Order::Index => Ok((since as u64, true)),
            _ if since > MAX_DURATION => {
                value_error(format!("a time at most {MAX_DURATION} s after the first one"))
            }
            _ => Ok((self.steps, true)),
        }
    }

    fn channel_of(&self, row: &Row) -> Result<u32, (Column, PatternProblem)> {
        if !self.has_channels {
            return Ok(0);
        }
        let value = row[Column::Channel as usize];
        if value.fract() != 0.0 || !(0.0..=MAX_CHANNEL).contains(&value) {
            let expected = format!("a whole number from 0 to {MAX_CHANNEL}");
            return Err((Column::Channel, PatternProblem::Value(expected)));
        }
        let channel = value as u32;
        if self.channels.len() == MAX_CHANNELS && !self.channels.contains_key(&channel) {
            let problem = PatternProblem::TooMany { max: MAX_CHANNELS as u64, what: "channels" };
            return Err((Column::Channel, problem));
        }
        Ok(channel)
    }

    /// Azimuth, clockwise, and elevation of a row, rad.
    fn angles_of(&self, row: &Row) -> Result<(f64, f64), (Column, PatternProblem)> {
        let angle = |column: Column, low: f64, high: f64| {
            let value = row[column as usize];
            match (low..=high).contains(&value) {
                true => Ok(value),
                false => {
                    let expected = format!("an angle from {} to {} degrees", number(low), number(high));
                    Err((column, PatternProblem::Value(expected)))
                }
            }
        };
        let azimuth = angle(Column::Azimuth, -MAX_AZIMUTH, MAX_AZIMUTH)?;
        let elevation = match self.has_zenith {
            true => 90.0 - angle(Column::Zenith, 0.0, 180.0)?,
            false => angle(Column::Elevation, -90.0, 90.0)?,
        };
        let is_mirrored = self.is_mirrored.unwrap_or(self.has_zenith);
        Ok((radians(if is_mirrored { -azimuth } else { azimuth }), radians(elevation)))
    }

    fn origin_of(row: &Row) -> Result<DVec3, (Column, PatternProblem)> {
        let mut origin = DVec3::ZERO;
        for (i, column) in [Column::OriginX, Column::OriginY, Column::OriginZ].into_iter().enumerate() {
            let value = row[column as usize];
            // A table without the column has NaN; a field is never NaN.
            if value.is_nan() {
                continue;
            }
            if value.abs() > MAX_ORIGIN {
                let expected = format!("a length of at most {} m", number(MAX_ORIGIN));
                return Err((column, PatternProblem::Value(expected)));
            }
            origin[i] = value;
        }
        Ok(origin)
    }

    /// The beams by channel, repeated if `repeats` is set.
    ///
    /// # Errors
    /// An empty table, or one with too many steps of too many channels.
    pub fn finish(self, repeats: bool) -> Result<Pattern, PatternProblem> {
        if self.rows == 0 {
            return Err(PatternProblem::Empty);
        }
        let steps = self.steps as u32;
        let sparse = self.channels.values().filter(|channel| (channel.beams.len() as u64) < self.steps);
        if sparse.count() as u64 * self.steps > MAX_STEPS {
            return Err(PatternProblem::TooMany { max: MAX_STEPS, what: "pulses of all channels together" });
        }
        let has_channels = self.has_channels;
        let has_times = match self.ignored {
            Some((_, are_counts)) => !are_counts,
            None => !self.times.is_empty() && !are_counts(&self.times),
        };
        let channel = |(number, channel): (u32, Channel)| PatternChannel {
            number: has_channels.then_some(number),
            table: PatternTable::new(&channel.beams, steps, repeats),
            divergence: Some(channel.divergence).filter(|divergence| !divergence.is_nan()),
        };
        let channels = self.channels.into_iter().map(channel).collect();
        Ok(Pattern { channels, times: self.times, has_times })
    }
}

impl RowSink for PatternRows {
    fn unnamed(count: usize) -> Option<&'static [Column]> {
        const ALL: &[Column] = &[Column::Time, Column::Azimuth, Column::Elevation, Column::Channel];
        match count {
            2 => Some(&ALL[1..3]),
            3 | 4 => Some(&ALL[..count]),
            _ => None,
        }
    }

    fn begin(&mut self, columns: &[Column], has_units: bool) -> Result<(), PatternProblem> {
        self.angles = AngleRange::new(has_units);
        let has = |column: Column| columns.contains(&column);
        let up = if has(Column::Zenith) { Column::Zenith } else { Column::Elevation };
        check_columns(columns, &[Column::Azimuth, up])?;
        for (one, other) in [(Column::Elevation, Column::Zenith), (Column::Time, Column::Index)] {
            if has(one) && has(other) {
                return Err(PatternProblem::Either(one.name(), other.name()));
            }
        }
        if has(Column::FiringTime) {
            return Err(PatternProblem::NotHere(Column::FiringTime.name()));
        }
        let is_ignored = self.ignores_times && !has(Column::Channel);
        self.order = match (has(Column::Time), has(Column::Index)) {
            (true, _) if !is_ignored => Order::Time,
            (_, true) => Order::Index,
            _ => Order::Row,
        };
        (self.has_zenith, self.has_channels) = (has(Column::Zenith), has(Column::Channel));
        Ok(())
    }

    fn add(&mut self, row: &Row) -> RowResult {
        if self.rows == MAX_ROWS {
            return Err((Column::Azimuth, PatternProblem::TooMany { max: MAX_ROWS as u64, what: "rows" }));
        }
        let time = row[Column::Time as usize];
        if self.order == Order::Row && !time.is_nan() {
            self.ignored = match self.ignored {
                None => Some((time, true)),
                Some((last, are_counts)) => Some((time, are_counts && time - last == 1.0)),
            };
        }
        let (step, is_new) = self.step_of(row)?;
        let channel = self.channel_of(row)?;
        let (azimuth, elevation) = self.angles_of(row)?;
        self.angles.add(row);
        let origin = PatternRows::origin_of(row)?;
        let divergence = row[Column::Divergence as usize];
        if !divergence.is_nan() && !DIVERGENCE.contains(divergence) {
            return Err((Column::Divergence, PatternProblem::Value(DIVERGENCE.expected.to_owned())));
        }
        let entry = self.channels.entry(channel).or_insert_with(|| Channel { beams: Vec::new(), divergence });
        if !divergence.is_nan() && divergence != entry.divergence {
            let expected = format!("{}, the divergence of its channel", number(entry.divergence));
            return Err((Column::Divergence, PatternProblem::Value(expected)));
        }
        let step = step as u32;
        if entry.beams.last().is_some_and(|last| last.step == step) {
            let (column, name) = match self.order {
                Order::Index => (Column::Index, "number"),
                _ => (Column::Time, "time"),
            };
            return Err((column, PatternProblem::Again(name)));
        }
        entry.beams.push(PatternBeam { step, azimuth, elevation, origin });
        let key = match self.order {
            Order::Row => 0.0,
            Order::Time => row[Column::Time as usize],
            Order::Index => row[Column::Index as usize],
        };
        if self.rows == 0 {
            self.first = key;
        }
        if is_new {
            (self.last, self.steps) = (key, u64::from(step) + 1);
            if self.order == Order::Time {
                self.times.push(key - self.first);
            }
        }
        self.rows += 1;
        Ok(())
    }
}

/// True if times are consecutive integers, as in tables of Livox, where they are row numbers.
fn are_counts(times: &[f64]) -> bool {
    times.len() > 1 && times.windows(2).all(|pair| pair[1] - pair[0] == 1.0)
}

/// Emission times of the pulses of a pattern whose steps have these times, s, from 0 on.
///
/// # Errors
/// Times from which no rate of pulses follows.
pub(super) fn pulse_times(times: Vec<f64>, repeats: bool) -> Result<PulseTimes, PatternProblem> {
    let Some(last) = times.last().copied().filter(|_| times.len() > 1) else {
        return Err(PatternProblem::OneTime);
    };
    let rate = (times.len() - 1) as f64 / last;
    if rate > PULSE_FREQ.high {
        return Err(PatternProblem::TooFast { rate: number(rate), max: number(PULSE_FREQ.high) });
    }
    let duration = last + last / (times.len() - 1) as f64;
    let times = times.into();
    Ok(if repeats { PulseTimes::Cycle { times, duration } } else { PulseTimes::Recorded(times) })
}

#[cfg(test)]
mod tests {
    use super::super::columns::COLUMNS;
    use super::*;

    fn row(values: &[(Column, f64)]) -> Row {
        let mut row = [f64::NAN; COLUMNS];
        values.iter().for_each(|(column, value)| row[*column as usize] = *value);
        row
    }

    fn read(columns: &[Column], rows: &[&[f64]]) -> Result<PatternRows, (usize, Column, PatternProblem)> {
        let mut read = PatternRows::new(None, false);
        read.begin(columns, false).unwrap();
        for (i, values) in rows.iter().enumerate() {
            let values: Vec<(Column, f64)> = columns.iter().copied().zip(values.iter().copied()).collect();
            read.add(&row(&values)).map_err(|(column, problem)| (i, column, problem))?;
        }
        Ok(read)
    }

    use Column::{Azimuth, Channel as Number, Divergence, Elevation, Index, OriginY, Time, Zenith};

    #[test]
    fn rows_without_times_are_steps() {
        let pattern =
            read(&[Azimuth, Elevation], &[&[90.0, 0.0], &[0.0, 30.0]]).unwrap().finish(true).unwrap();
        let table = &pattern.channels[0].table;
        assert_eq!((table.steps(), pattern.times.len(), pattern.channels[0].number), (2, 0, None));
        assert!((table.attitude(0).forward() - DVec3::X).length() < 1e-15);
        assert!((table.attitude(1).forward() - DVec3::new(0.0, 0.75f64.sqrt(), 0.5)).length() < 1e-15);
    }

    #[test]
    fn zeniths_come_with_azimuths_to_the_left() {
        let read = read(&[Azimuth, Zenith], &[&[90.0, 120.0]]).unwrap();
        let table = &read.finish(true).unwrap().channels[0].table;
        let expected = DVec3::new(-(0.75f64.sqrt()), 0.0, -0.5);
        assert!((table.attitude(0).forward() - expected).length() < 1e-15);
    }

    #[test]
    fn channels_of_one_time_fire_together() {
        let rows: [&[f64]; 4] =
            [&[5.0, 3.0, 0.0, 0.0], &[5.0, 1.0, 1.0, 0.0], &[5.5, 1.0, 2.0, 0.0], &[6.5, 3.0, 3.0, 0.0]];
        let pattern = read(&[Time, Number, Azimuth, Elevation], &rows).unwrap().finish(false).unwrap();
        assert_eq!(pattern.times, [0.0, 0.5, 1.5]);
        let rows = |i: usize| (0..3).map(|step| pattern.channels[i].table.row(step)).collect::<Vec<_>>();
        assert_eq!((rows(0), rows(1)), (vec![Some(0), Some(1), None], vec![Some(0), None, Some(1)]));
        assert_eq!(pattern.channels.iter().map(|c| c.number).collect::<Vec<_>>(), [Some(1), Some(3)]);
    }

    #[test]
    fn numbers_without_a_row_have_no_beam() {
        let pattern = read(&[Index, Azimuth, Elevation], &[&[7.0, 0.0, 0.0], &[9.0, 0.0, 0.0]]).unwrap();
        let table = &pattern.finish(true).unwrap().channels[0].table;
        assert_eq!((0..3).map(|step| table.row(step)).collect::<Vec<_>>(), [Some(0), None, Some(1)]);
    }

    #[test]
    fn rows_that_cannot_be_are_named() {
        let nan = f64::NAN;
        type Case<'a> = (&'a [Column], &'a [&'a [f64]], usize, Column, &'a str);
        let cases: [Case; 14] = [
            (&[Azimuth, Elevation], &[&[0.0, 0.0], &[nan, 0.0]], 1, Azimuth, "from -360 to 360"),
            (&[Azimuth, Elevation], &[&[1e300, 0.0]], 0, Azimuth, "from -360 to 360"),
            (&[Azimuth, Elevation], &[&[0.0, 90.1]], 0, Elevation, "from -90 to 90"),
            (&[Azimuth, Zenith], &[&[0.0, -1.0]], 0, Zenith, "from 0 to 180"),
            (&[Time, Azimuth, Elevation], &[&[1.0, 0.0, 0.0], &[0.5, 0.0, 0.0]], 1, Time, "not below"),
            (&[Time, Azimuth, Elevation], &[&[1.0, 0.0, 0.0], &[1.0, 0.0, 0.0]], 1, Time, "a second beam"),
            (&[Time, Azimuth, Elevation], &[&[nan, 0.0, 0.0]], 0, Time, "a finite time"),
            (&[Time, Azimuth, Elevation], &[&[0.0, 0.0, 0.0], &[1e9, 0.0, 0.0]], 1, Time, "after the first"),
            (&[Time, Azimuth, Elevation], &[&[-1e300, 0.0, 0.0]], 0, Time, "a time of at most"),
            (&[Index, Azimuth, Elevation], &[&[0.5, 0.0, 0.0]], 0, Index, "a whole number"),
            (&[Index, Azimuth, Elevation], &[&[1e15, 0.0, 0.0]], 0, Index, "a whole number from 0 to"),
            (&[Index, Azimuth, Elevation], &[&[0.0, 0.0, 0.0], &[1e9, 0.0, 0.0]], 1, Index, "less than"),
            (&[Number, Azimuth, Elevation], &[&[-1.0, 0.0, 0.0]], 0, Number, "from 0 to 65535"),
            (&[Azimuth, Elevation, OriginY], &[&[0.0, 0.0, 11.0]], 0, OriginY, "at most 10 m"),
        ];
        for (columns, rows, at, column, words) in cases {
            let (i, found, problem) = read(columns, rows).map(|_| ()).unwrap_err();
            assert_eq!((i, found), (at, column), "{problem}");
            assert!(problem.to_string().contains(words), "{problem} does not say {words}");
        }
        let rows: [&[f64]; 2] = [&[0.0, 0.0, 0.001], &[1.0, 0.0, 0.002]];
        let (.., problem) = read(&[Azimuth, Elevation, Divergence], &rows).map(|_| ()).unwrap_err();
        assert_eq!(problem.to_string(), "expected 0.001, the divergence of its channel");
        assert_eq!(
            read(&[Azimuth, Elevation], &[]).unwrap().finish(true).unwrap_err(),
            PatternProblem::Empty
        );
    }

    #[test]
    fn columns_that_are_missing_or_contradict_are_named() {
        let begin =
            |columns: &[Column]| PatternRows::new(None, false).begin(columns, false).unwrap_err().to_string();
        assert_eq!(begin(&[Azimuth]), "no column `elevation`");
        assert_eq!(begin(&[Elevation]), "no column `azimuth`");
        assert_eq!(begin(&[Azimuth, Azimuth, Elevation]), "two columns `azimuth`");
        assert_eq!(begin(&[Azimuth, Elevation, Zenith]), "give either `elevation` or `zenith`, not both");
        assert_eq!(begin(&[Time, Index, Azimuth, Zenith]), "give either `time` or `index`, not both");
        assert!(begin(&[Azimuth, Zenith, Column::FiringTime]).contains("`firing_time` has no meaning"));
    }

    #[test]
    fn times_beside_a_rate_may_have_any_order() {
        for (times, is_time) in [([5.0, 5.0, 4.0], true), ([1.0, 2.0, 3.0], false)] {
            let mut read = PatternRows::new(None, true);
            read.begin(&[Time, Azimuth, Elevation], false).unwrap();
            for time in times {
                read.add(&row(&[(Time, time), (Azimuth, 1.0), (Elevation, 2.0)])).unwrap();
            }
            let pattern = read.finish(true).unwrap();
            assert_eq!((pattern.channels[0].table.steps(), pattern.times.len()), (3, 0));
            assert_eq!(pattern.has_times, is_time);
        }
    }

    #[test]
    fn times_repeat_after_their_mean_interval() {
        let times = pulse_times(vec![0.0, 0.5, 2.0], true).unwrap();
        assert_eq!((0..5).map(|k| times.at(k)).collect::<Vec<_>>(), [0.0, 0.5, 2.0, 3.0, 3.5]);
        assert_eq!(pulse_times(vec![0.0], true), Err(PatternProblem::OneTime));
        assert!(pulse_times(vec![0.0, 1e-12], true).is_err());
        assert!(are_counts(&[0.0, 1.0, 2.0]) && !are_counts(&[0.0, 1.0, 2.5]) && !are_counts(&[0.0]));
    }
}
