//! The columns of a stream of pulses: names, dimensions and meanings.

use vlscan_base::columns::{Dimension, Heading, HeadingError, parse_heading};
use vlscan_base::diag::nearest;

macro_rules! columns {
    ($($column:ident $name:literal $aliases:expr, $dimension:ident, $meaning:literal;)*) => {
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(usize)]
        pub enum PulseColumn {
            $(#[doc = $meaning] $column,)*
        }

        /// All columns in the order of their numbers.
        pub static ENTRIES: &[ColumnEntry] = &[$(ColumnEntry {
            column: PulseColumn::$column,
            name: $name,
            aliases: &$aliases,
            dimension: Dimension::$dimension,
        }),*];
    };
}

columns! {
    Time "time" ["t", "gps_time", "gpstime"], Time, "Emission time; written in ns, read in any unit.";
    X "x" ["origin_x", "ox"], Length, "World coordinate of the origin.";
    Y "y" ["origin_y", "oy"], Length, "World coordinate of the origin.";
    Z "z" ["origin_z", "oz"], Length, "World coordinate of the origin.";
    DirectionX "dx" ["direction_x", "dir_x"], Ratio, "Direction of the beam; any length when read.";
    DirectionY "dy" ["direction_y", "dir_y"], Ratio, "Direction of the beam; any length when read.";
    DirectionZ "dz" ["direction_z", "dir_z"], Ratio, "Direction of the beam; any length when read.";
    Leg "leg" [], Count, "Number of the leg, from 0.";
    Device "device" ["channel"], Count, "Index of the device, from 0.";
    Pulse "pulse" ["pulse_number", "number"], Count, "Number of the pulse among those of its device, from 1; determines its random numbers.";
    Step "step" [], Count, "Simulation steps since the epoch began, by which parts of the scene move.";
    AttitudeW "qw" [], Ratio, "Quaternion from the beam frame (the beam leaves along +y) to the world: orients the subrays about the beam.";
    AttitudeX "qx" [], Ratio, "See AttitudeW.";
    AttitudeY "qy" [], Ratio, "See AttitudeW.";
    AttitudeZ "qz" [], Ratio, "See AttitudeW.";
    ScanAngle "scan_angle" ["scanangle"], Angle, "The scan angle of LAS: of the beam from straight down across the track, negative to the left.";
    LowX "x_low" [], Length, "Rounding error of the world coordinate, which restores the last bits of the scene coordinate.";
    LowY "y_low" [], Length, "See LowX.";
    LowZ "z_low" [], Length, "See LowX.";
    ExactW "exact_qw" [], Ratio, "The quaternion without mechanical errors: points are reported along it.";
    ExactX "exact_qx" [], Ratio, "See ExactW.";
    ExactY "exact_qy" [], Ratio, "See ExactW.";
    ExactZ "exact_qz" [], Ratio, "See ExactW.";
    RangeError "range_error" [], Length, "Mechanical error that is added to every range.";
    Divergence "divergence" ["beam_divergence"], Angle, "Divergence of the beam of device 0.";
    StartDivergence "start_divergence" [], Angle, "Divergence at the beginning of the survey, with which the reference traces all legs.";
    Epoch "epoch" ["play"], Count, "Number of the epoch, from 0, in surveys with swapped parts.";
    ReportedW "reported_qw" [], Ratio, "The quaternion computed with the reported pose, without mechanical errors: points are reported along it.";
    ReportedX "reported_qx" [], Ratio, "See ReportedW.";
    ReportedY "reported_qy" [], Ratio, "See ReportedW.";
    ReportedZ "reported_qz" [], Ratio, "See ReportedW.";
    OriginErrorX "x_error" [], Length, "Reported minus true origin.";
    OriginErrorY "y_error" [], Length, "Reported minus true origin.";
    OriginErrorZ "z_error" [], Length, "Reported minus true origin.";
}

pub const COLUMNS: usize = ENTRIES.len();

#[derive(Debug)]
pub struct ColumnEntry {
    pub column: PulseColumn,
    pub name: &'static str,
    /// Further names that are accepted in headings.
    aliases: &'static [&'static str],
    /// The measured quantity. Pulses hold times in ns, angles in rad, lengths in m.
    pub(crate) dimension: Dimension,
}

impl PulseColumn {
    pub fn entry(self) -> &'static ColumnEntry {
        &ENTRIES[self as usize]
    }
}

impl ColumnEntry {
    /// The unit of written values; empty for plain numbers.
    pub fn unit(&self) -> &'static str {
        match self.dimension {
            Dimension::Time => "ns",
            Dimension::Length => "m",
            Dimension::Angle => "rad",
            Dimension::Ratio | Dimension::Count => "",
        }
    }

    /// Name and unit as in a header: `x[m]`.
    pub fn heading(&self) -> String {
        if self.unit().is_empty() { self.name.to_owned() } else { format!("{}[{}]", self.name, self.unit()) }
    }
}

/// Parses a heading such as `time[s]`, `X (m)` or `scan_angle[deg]` to the column and the factor that converts its
/// values to ns, rad or m. Without a unit, times are seconds.
///
/// # Errors
/// The problem and a hint.
pub fn parse_pulse_heading(text: &str) -> Result<(PulseColumn, f64), (String, String)> {
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
    fn every_column_is_read_as_written() {
        for e in ENTRIES {
            assert_eq!(parse_pulse_heading(&e.heading()).unwrap(), (e.column, 1.0));
        }
    }

    #[test]
    fn units_are_parsed_and_misspelt_names_are_reported() {
        assert_eq!(parse_pulse_heading("time").unwrap(), (PulseColumn::Time, 1e9));
        assert_eq!(parse_pulse_heading(" Direction_X ").unwrap(), (PulseColumn::DirectionX, 1.0));
        for (unit, factor) in [("ns", 1.0), ("us", 1e3), ("ms", 1e6), ("s", 1e9)] {
            assert_eq!(parse_pulse_heading(&format!("t[{unit}]")).unwrap(), (PulseColumn::Time, factor));
        }
        assert_eq!(parse_pulse_heading("divergence (mrad)").unwrap(), (PulseColumn::Divergence, 1e-3));
        assert!(parse_pulse_heading("divergense").unwrap_err().1.contains("did you mean `divergence`"));
        assert_eq!(parse_pulse_heading("x[ft]").unwrap(), (PulseColumn::X, 0.3048));
        assert!(parse_pulse_heading("x[furlong]").unwrap_err().0.contains("is in `furlong`"));
        assert!(parse_pulse_heading("colour_of_the_sky").unwrap_err().1.contains("the columns are time, x"));
    }
}
