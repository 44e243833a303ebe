//! The columns of a stream of pulses: names, units, what they mean and which of them may be missing.

use crate::columns::{Dimension, Heading, HeadingError, parse_heading};
use crate::diag::nearest;

/// A column of a stream of pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Column {
    /// Emission time; written in ns, read in any unit.
    Time,
    /// World coordinates of the origin, m.
    X,
    /// See [`Column::X`].
    Y,
    /// See [`Column::X`].
    Z,
    /// Direction of the beam; any length when read.
    DirectionX,
    /// See [`Column::DirectionX`].
    DirectionY,
    /// See [`Column::DirectionX`].
    DirectionZ,
    /// Number of the leg, from 0.
    Leg,
    /// Index of the device, from 0.
    Device,
    /// Number of the pulse among those of its device, from 1; all noise is drawn by it.
    Pulse,
    /// Simulation steps since the play began; moving parts of the scene go by it.
    Step,
    /// Quaternion that takes the beam frame to the world (the beam leaves along +y): it tells, beyond the direction, how
    /// the subrays lie about the beam.
    AttitudeW,
    /// See [`Column::AttitudeW`].
    AttitudeX,
    /// See [`Column::AttitudeW`].
    AttitudeY,
    /// See [`Column::AttitudeW`].
    AttitudeZ,
    /// Deflection of the beam, rad: the scan angle of LAS.
    ScanAngle,
    /// What the world coordinate lost by rounding, m: the last bits of the scene coordinates that `run` computes with.
    LowX,
    /// See [`Column::LowX`].
    LowY,
    /// See [`Column::LowX`].
    LowZ,
    /// The quaternion without mechanical errors: points are reported along it.
    ExactW,
    /// See [`Column::ExactW`].
    ExactX,
    /// See [`Column::ExactW`].
    ExactY,
    /// See [`Column::ExactW`].
    ExactZ,
    /// Metres that a mechanical error adds to every range.
    RangeError,
    /// Divergence of the beam of device 0, rad.
    Divergence,
    /// Divergence when the survey began, rad: the reference traces with it for ever.
    StartDivergence,
    /// Number of the play, from 0, in surveys with swapped parts.
    Play,
    /// The quaternion from the pose that is reported, mechanical errors left out: points are reported along it.
    ReportedW,
    /// See [`Column::ReportedW`].
    ReportedX,
    /// See [`Column::ReportedW`].
    ReportedY,
    /// See [`Column::ReportedW`].
    ReportedZ,
    /// Reported minus true origin, m.
    OriginErrorX,
    /// See [`Column::OriginErrorX`].
    OriginErrorY,
    /// See [`Column::OriginErrorX`].
    OriginErrorZ,
}

/// Number of columns.
pub const COLUMNS: usize = 34;

/// What is known of a column.
#[derive(Debug)]
pub struct Entry {
    /// The column.
    pub column: Column,
    /// Its name.
    pub name: &'static str,
    /// Other names by which it is read.
    aliases: &'static [&'static str],
    /// What it measures. Times are ns inside.
    pub(crate) dimension: Dimension,
}

const fn entry(
    column: Column,
    name: &'static str,
    aliases: &'static [&'static str],
    dimension: Dimension,
) -> Entry {
    Entry { column, name, aliases, dimension }
}

/// All columns by their numbers.
pub static ENTRIES: [Entry; COLUMNS] = [
    entry(Column::Time, "time", &["t", "gps_time", "gpstime"], Dimension::Time),
    entry(Column::X, "x", &["origin_x", "ox"], Dimension::Length),
    entry(Column::Y, "y", &["origin_y", "oy"], Dimension::Length),
    entry(Column::Z, "z", &["origin_z", "oz"], Dimension::Length),
    entry(Column::DirectionX, "dx", &["direction_x", "dir_x"], Dimension::Ratio),
    entry(Column::DirectionY, "dy", &["direction_y", "dir_y"], Dimension::Ratio),
    entry(Column::DirectionZ, "dz", &["direction_z", "dir_z"], Dimension::Ratio),
    entry(Column::Leg, "leg", &[], Dimension::Count),
    entry(Column::Device, "device", &["channel"], Dimension::Count),
    entry(Column::Pulse, "pulse", &["pulse_number", "number"], Dimension::Count),
    entry(Column::Step, "step", &[], Dimension::Count),
    entry(Column::AttitudeW, "qw", &[], Dimension::Ratio),
    entry(Column::AttitudeX, "qx", &[], Dimension::Ratio),
    entry(Column::AttitudeY, "qy", &[], Dimension::Ratio),
    entry(Column::AttitudeZ, "qz", &[], Dimension::Ratio),
    entry(Column::ScanAngle, "scan_angle", &["scanangle"], Dimension::Angle),
    entry(Column::LowX, "x_low", &[], Dimension::Length),
    entry(Column::LowY, "y_low", &[], Dimension::Length),
    entry(Column::LowZ, "z_low", &[], Dimension::Length),
    entry(Column::ExactW, "exact_qw", &[], Dimension::Ratio),
    entry(Column::ExactX, "exact_qx", &[], Dimension::Ratio),
    entry(Column::ExactY, "exact_qy", &[], Dimension::Ratio),
    entry(Column::ExactZ, "exact_qz", &[], Dimension::Ratio),
    entry(Column::RangeError, "range_error", &[], Dimension::Length),
    entry(Column::Divergence, "divergence", &["beam_divergence"], Dimension::Angle),
    entry(Column::StartDivergence, "start_divergence", &[], Dimension::Angle),
    entry(Column::Play, "play", &[], Dimension::Count),
    entry(Column::ReportedW, "reported_qw", &[], Dimension::Ratio),
    entry(Column::ReportedX, "reported_qx", &[], Dimension::Ratio),
    entry(Column::ReportedY, "reported_qy", &[], Dimension::Ratio),
    entry(Column::ReportedZ, "reported_qz", &[], Dimension::Ratio),
    entry(Column::OriginErrorX, "x_error", &[], Dimension::Length),
    entry(Column::OriginErrorY, "y_error", &[], Dimension::Length),
    entry(Column::OriginErrorZ, "z_error", &[], Dimension::Length),
];

impl Column {
    /// What is known of it.
    pub fn entry(self) -> &'static Entry {
        &ENTRIES[self as usize]
    }
}

impl Entry {
    /// The unit in which it is written; empty for plain numbers.
    pub fn unit(&self) -> &'static str {
        match self.dimension {
            Dimension::Time => "ns",
            Dimension::Length => "m",
            Dimension::Angle => "rad",
            Dimension::Ratio | Dimension::Count => "",
        }
    }

    /// Name and unit as a header has them: `x[m]`.
    pub fn heading(&self) -> String {
        if self.unit().is_empty() { self.name.to_owned() } else { format!("{}[{}]", self.name, self.unit()) }
    }
}

/// The column of a heading such as `time[s]`, `X (m)` or `scan_angle[deg]`, and the factor that takes its values to the unit
/// inside. Without a unit times are seconds.
///
/// # Errors
/// What is wrong with it, and advice.
pub fn named(text: &str) -> Result<(Column, f64), (String, String)> {
    let known = |name: &str| {
        let entry = ENTRIES.iter().find(|e| e.name == name || e.aliases.contains(&name))?;
        Some((entry, entry.dimension))
    };
    match parse_heading(text, known) {
        Ok(Heading { column: entry, factor }) => {
            let inside = if entry.dimension == Dimension::Time { 1e9 } else { 1.0 };
            Ok((entry.column, inside * factor.unwrap_or(1.0)))
        }
        Err(HeadingError::WrongUnit(found, expected)) => Err((found, expected)),
        Err(HeadingError::UnknownName(name)) => {
            let names = ENTRIES.iter().flat_map(|e| std::iter::once(e.name).chain(e.aliases.iter().copied()));
            let help = nearest(&name, names).map_or_else(
                || {
                    let names: Vec<&str> = ENTRIES.iter().map(|e| e.name).collect();
                    format!("the columns are {}", names.join(", "))
                },
                |near| format!("did you mean `{near}`?"),
            );
            Err((format!("unknown column `{}`", text.trim()), help))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_stands_at_its_number_and_is_read_as_written() {
        for (i, e) in ENTRIES.iter().enumerate() {
            assert_eq!(e.column as usize, i, "{}", e.name);
            assert_eq!(named(&e.heading()).unwrap(), (e.column, 1.0));
        }
    }

    #[test]
    fn units_are_understood_and_slips_are_named() {
        assert_eq!(named("time").unwrap(), (Column::Time, 1e9));
        assert_eq!(named(" Direction_X ").unwrap(), (Column::DirectionX, 1.0));
        for (unit, factor) in [("ns", 1.0), ("us", 1e3), ("ms", 1e6), ("s", 1e9)] {
            assert_eq!(named(&format!("t[{unit}]")).unwrap(), (Column::Time, factor));
        }
        assert_eq!(named("divergence (mrad)").unwrap(), (Column::Divergence, 1e-3));
        assert!(named("divergense").unwrap_err().1.contains("did you mean `divergence`"));
        assert!(named("x[ft]").unwrap_err().0.contains("is in `ft`"));
        assert!(named("colour_of_the_sky").unwrap_err().1.contains("the columns are time, x"));
    }
}
