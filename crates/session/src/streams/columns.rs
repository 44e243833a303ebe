//! The columns of a stream of pulses: names, dimensions and meanings.

use vlscan_tables::{Dimension, HeadingError, ParsedHeading, Quantity, parse_heading, plain, similar_name};

macro_rules! columns {
    ($($column:ident $quantity:ident, $meaning:literal;)*) => {
        /// A column of a stream of pulses.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(usize)]
        pub enum PulseColumn {
            $(#[doc = $meaning] $column,)*
        }

        /// All columns in the order of their numbers.
        pub static ENTRIES: &[ColumnEntry] = &[$(ColumnEntry {
            column: PulseColumn::$column,
            quantity: Quantity::$quantity,
        }),*];
    };
}

columns! {
    Time Time, "Emission time; written in ns, read in any unit.";
    X X, "World coordinate of the origin.";
    Y Y, "World coordinate of the origin.";
    Z Z, "World coordinate of the origin.";
    DirectionX DirectionX, "Direction of the beam; any length when read.";
    DirectionY DirectionY, "Direction of the beam; any length when read.";
    DirectionZ DirectionZ, "Direction of the beam; any length when read.";
    Leg Leg, "Number of the leg, from 0.";
    Device Device, "Index of the device, from 0.";
    Pulse Pulse, "Number of the pulse among those of its device, from 1; determines its random numbers.";
    Step Step, "Simulation steps since the epoch began, by which parts of the scene move.";
    AttitudeW QuaternionW, "Quaternion from the beam frame (the beam leaves along +y) to the world: orients \
                            the subrays about the beam.";
    AttitudeX QuaternionX, "See AttitudeW.";
    AttitudeY QuaternionY, "See AttitudeW.";
    AttitudeZ QuaternionZ, "See AttitudeW.";
    ScanAngle ScanAngle, "The scan angle of LAS: of the beam from straight down across the track, negative \
                          to the left.";
    LowX LowX, "Rounding error of the world coordinate, which restores the last bits of the scene \
                coordinate.";
    LowY LowY, "See LowX.";
    LowZ LowZ, "See LowX.";
    ExactW ExactW, "The quaternion without mechanical errors: points are reported along it.";
    ExactX ExactX, "See ExactW.";
    ExactY ExactY, "See ExactW.";
    ExactZ ExactZ, "See ExactW.";
    RangeError RangeError, "Mechanical error that is added to every range.";
    Divergence Divergence, "Divergence of the beam of device 0.";
    StartDivergence StartDivergence, "Divergence at the beginning of the survey, with which the reference \
                                      traces all legs.";
    Epoch Epoch, "Number of the epoch, from 0, in surveys with swapped parts.";
    ReportedW ReportedW, "The quaternion computed with the reported pose, without mechanical errors: points \
                          are reported along it.";
    ReportedX ReportedX, "See ReportedW.";
    ReportedY ReportedY, "See ReportedW.";
    ReportedZ ReportedZ, "See ReportedW.";
    OriginErrorX OriginErrorX, "Reported minus true origin.";
    OriginErrorY OriginErrorY, "Reported minus true origin.";
    OriginErrorZ OriginErrorZ, "Reported minus true origin.";
    Azimuth BeamAzimuth, "Angle of the beam from +y, clockwise seen from above, in place of a direction; \
                          only read.";
    Elevation BeamElevation, "Angle of the beam above the horizontal plane; only read.";
}

pub const COLUMNS: usize = ENTRIES.len();

/// Pulses hold times in ns, angles in rad, lengths in m.
#[derive(Debug)]
pub struct ColumnEntry {
    pub column: PulseColumn,
    quantity: Quantity,
}

impl PulseColumn {
    /// Name, dimension and meaning of the column.
    pub fn entry(self) -> &'static ColumnEntry {
        &ENTRIES[self as usize]
    }
}

impl ColumnEntry {
    /// The name that is written.
    pub fn name(&self) -> &'static str {
        self.quantity.name()
    }

    /// The measured quantity.
    pub(crate) fn dimension(&self) -> Dimension {
        self.quantity.dimension()
    }

    /// The unit of written values; empty for plain numbers.
    pub fn unit(&self) -> &'static str {
        match self.dimension() {
            Dimension::Time => "ns",
            Dimension::Length => "m",
            Dimension::Angle => "rad",
            Dimension::Ratio | Dimension::Count | Dimension::Text => "",
        }
    }

    /// Name and unit as in a header: `x[m]`.
    pub fn heading(&self) -> String {
        let (name, unit) = (self.name(), self.unit());
        if unit.is_empty() { name.to_owned() } else { format!("{name}[{unit}]") }
    }
}

/// Parses a heading such as `time[s]`, `X (m)` or `scan_angle[deg]` to the column and the factor that
/// converts its values to ns, rad or m. Without a unit, times are seconds. An `elevation` is a height, unless
/// its unit is one of angles.
///
/// # Errors
/// The problem and a hint.
pub fn parse_pulse_heading(text: &str) -> Result<(PulseColumn, f64), (String, String)> {
    let parsed = match parse_heading(text, ENTRIES.iter().map(|entry| entry.quantity)) {
        Err(HeadingError::WrongUnit(Quantity::Z, found, expected)) => {
            parse_heading(text, [Quantity::BeamElevation])
                .map_err(|_| HeadingError::WrongUnit(Quantity::Z, found, expected))
        }
        parsed => parsed,
    };
    match parsed {
        Ok(ParsedHeading { quantity, factor }) => {
            let Some(entry) = ENTRIES.iter().find(|entry| entry.quantity == quantity) else {
                return Err((format!("unknown column `{}`", text.trim()), String::new()));
            };
            let column = entry.column;
            let inside = if quantity.dimension() == Dimension::Time { 1e9 } else { 1.0 };
            Ok((column, inside * factor.unwrap_or(1.0)))
        }
        Err(HeadingError::WrongUnit(_, found, expected)) => Err((found, expected)),
        Err(HeadingError::UnknownName(name)) => {
            let names = ENTRIES.iter().flat_map(|entry| entry.quantity.names());
            let help = similar_name(&plain(&name), names).map_or_else(
                || {
                    let names: Vec<&str> = ENTRIES.iter().map(ColumnEntry::name).collect();
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
        let degree = std::f64::consts::PI / 180.0;
        assert_eq!(parse_pulse_heading("azimuth_deg").unwrap(), (PulseColumn::Azimuth, degree));
        assert_eq!(parse_pulse_heading("elevation_deg").unwrap(), (PulseColumn::Elevation, degree));
        assert_eq!(parse_pulse_heading("elevation").unwrap(), (PulseColumn::Z, 1.0));
        assert!(parse_pulse_heading("elevation[s]").unwrap_err().0.contains("is in `s`"));
        assert!(parse_pulse_heading("nx").unwrap_err().1.contains("the columns are time, x"));
        assert!(parse_pulse_heading("divergense").unwrap_err().1.contains("did you mean `divergence`"));
        assert_eq!(parse_pulse_heading("x[ft]").unwrap(), (PulseColumn::X, 0.3048));
        assert!(parse_pulse_heading("x[furlong]").unwrap_err().0.contains("is in `furlong`"));
        assert!(parse_pulse_heading("colour_of_the_sky").unwrap_err().1.contains("the columns are time, x"));
    }
}
