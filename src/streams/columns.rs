//! The columns of a stream of pulses: names, units, what they mean and which of them may be missing.

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
    /// What it counts in.
    pub quantity: Quantity,
}

/// What a column counts in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Time; ns inside.
    Time,
    /// Metres.
    Length,
    /// Radians.
    Angle,
    /// A plain number.
    Ratio,
    /// A whole number of at least 0.
    Count,
}

const fn entry(
    column: Column,
    name: &'static str,
    aliases: &'static [&'static str],
    quantity: Quantity,
) -> Entry {
    Entry { column, name, aliases, quantity }
}

/// All columns by their numbers.
pub static ENTRIES: [Entry; COLUMNS] = [
    entry(Column::Time, "time", &["t", "gps_time", "gpstime"], Quantity::Time),
    entry(Column::X, "x", &["origin_x", "ox"], Quantity::Length),
    entry(Column::Y, "y", &["origin_y", "oy"], Quantity::Length),
    entry(Column::Z, "z", &["origin_z", "oz"], Quantity::Length),
    entry(Column::DirectionX, "dx", &["direction_x", "dir_x"], Quantity::Ratio),
    entry(Column::DirectionY, "dy", &["direction_y", "dir_y"], Quantity::Ratio),
    entry(Column::DirectionZ, "dz", &["direction_z", "dir_z"], Quantity::Ratio),
    entry(Column::Leg, "leg", &[], Quantity::Count),
    entry(Column::Device, "device", &["channel"], Quantity::Count),
    entry(Column::Pulse, "pulse", &["pulse_number", "number"], Quantity::Count),
    entry(Column::Step, "step", &[], Quantity::Count),
    entry(Column::AttitudeW, "qw", &[], Quantity::Ratio),
    entry(Column::AttitudeX, "qx", &[], Quantity::Ratio),
    entry(Column::AttitudeY, "qy", &[], Quantity::Ratio),
    entry(Column::AttitudeZ, "qz", &[], Quantity::Ratio),
    entry(Column::ScanAngle, "scan_angle", &["scanangle"], Quantity::Angle),
    entry(Column::LowX, "x_low", &[], Quantity::Length),
    entry(Column::LowY, "y_low", &[], Quantity::Length),
    entry(Column::LowZ, "z_low", &[], Quantity::Length),
    entry(Column::ExactW, "exact_qw", &[], Quantity::Ratio),
    entry(Column::ExactX, "exact_qx", &[], Quantity::Ratio),
    entry(Column::ExactY, "exact_qy", &[], Quantity::Ratio),
    entry(Column::ExactZ, "exact_qz", &[], Quantity::Ratio),
    entry(Column::RangeError, "range_error", &[], Quantity::Length),
    entry(Column::Divergence, "divergence", &["beam_divergence"], Quantity::Angle),
    entry(Column::StartDivergence, "start_divergence", &[], Quantity::Angle),
    entry(Column::Play, "play", &[], Quantity::Count),
    entry(Column::ReportedW, "reported_qw", &[], Quantity::Ratio),
    entry(Column::ReportedX, "reported_qx", &[], Quantity::Ratio),
    entry(Column::ReportedY, "reported_qy", &[], Quantity::Ratio),
    entry(Column::ReportedZ, "reported_qz", &[], Quantity::Ratio),
    entry(Column::OriginErrorX, "x_error", &[], Quantity::Length),
    entry(Column::OriginErrorY, "y_error", &[], Quantity::Length),
    entry(Column::OriginErrorZ, "z_error", &[], Quantity::Length),
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
        match self.quantity {
            Quantity::Time => "ns",
            Quantity::Length => "m",
            Quantity::Angle => "rad",
            Quantity::Ratio | Quantity::Count => "",
        }
    }

    /// Name and unit as a header has them: `x[m]`.
    pub fn heading(&self) -> String {
        if self.unit().is_empty() { self.name.to_owned() } else { format!("{}[{}]", self.name, self.unit()) }
    }
}

/// The column of a name such as `time[s]`, `X (m)` or `scan_angle[deg]`, and the factor that takes its values to the unit
/// inside. Without a unit times are seconds.
///
/// # Errors
/// What is wrong with it, and advice.
pub fn named(text: &str) -> Result<(Column, f64), (String, String)> {
    let lower = text.trim().trim_matches(['"', '\'']).trim().to_ascii_lowercase();
    let (name, unit) = match lower.find(['[', '(']) {
        Some(i) => (lower[..i].trim_end(), lower[i..].trim_matches(['[', ']', '(', ')', ' '])),
        None => (lower.as_str(), ""),
    };
    let known = ENTRIES.iter().find(|e| e.name == name || e.aliases.contains(&name));
    let Some(entry) = known else {
        let names = ENTRIES.iter().flat_map(|e| std::iter::once(e.name).chain(e.aliases.iter().copied()));
        let help = match nearest(name, names) {
            Some(near) => format!("did you mean `{near}`?"),
            None => {
                format!("the columns are {}", ENTRIES.iter().map(|e| e.name).collect::<Vec<_>>().join(", "))
            }
        };
        return Err((format!("unknown column `{}`", text.trim()), help));
    };
    match factor(entry.quantity, unit) {
        Some(factor) => Ok((entry.column, factor)),
        None => {
            let expected = match entry.quantity {
                Quantity::Time => "s, ms, us or ns",
                Quantity::Length => "m",
                Quantity::Angle => "rad, mrad or deg",
                Quantity::Ratio | Quantity::Count => "no unit",
            };
            Err((format!("column `{}` is in `{unit}`", text.trim()), format!("expected {expected}")))
        }
    }
}

fn factor(quantity: Quantity, unit: &str) -> Option<f64> {
    Some(match (quantity, unit) {
        (Quantity::Time, "" | "s" | "sec" | "seconds") => 1e9,
        (Quantity::Time, "ms") => 1e6,
        (Quantity::Time, "us" | "µs") => 1e3,
        (Quantity::Time, "ns") => 1.0,
        (Quantity::Angle, "deg" | "degrees" | "°") => std::f64::consts::PI / 180.0,
        (Quantity::Angle, "mrad") => 1e-3,
        (Quantity::Angle, "" | "rad" | "radians") => 1.0,
        (Quantity::Length, "" | "m" | "metres" | "meters") => 1.0,
        (Quantity::Ratio | Quantity::Count, "" | "1" | "-") => 1.0,
        _ => return None,
    })
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
        assert_eq!(named("divergence (mrad)").unwrap(), (Column::Divergence, 1e-3));
        assert!(named("divergense").unwrap_err().1.contains("did you mean `divergence`"));
        assert!(named("x[ft]").unwrap_err().0.contains("is in `ft`"));
        assert!(named("colour_of_the_sky").unwrap_err().1.contains("the columns are time, x"));
    }
}
