//! Dimensions of columns, and their units.

use vlscan_crs::LengthUnit;

/// Dimension of the values of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// Seconds.
    Time,
    /// Metres.
    Length,
    /// Radians.
    Angle,
    /// A plain number.
    Ratio,
    /// An integer of at least 0.
    Count,
    /// Words.
    Text,
}

impl Dimension {
    /// The dimensions with units.
    pub(super) const MEASURED: [Dimension; 3] = [Dimension::Time, Dimension::Length, Dimension::Angle];

    /// Factor from `unit` to seconds, metres or radians; `None` for units of other dimensions.
    pub fn factor(self, unit: &str) -> Option<f64> {
        Some(match (self, unit) {
            (Dimension::Time, "s" | "sec" | "secs" | "second" | "seconds") => 1.0,
            (Dimension::Time, "ms" | "msec" | "milliseconds") => 1e-3,
            (Dimension::Time, "us" | "µs" | "μs" | "usec" | "microseconds") => 1e-6,
            (Dimension::Time, "ns" | "nsec" | "nanosec" | "nanoseconds") => 1e-9,
            (Dimension::Length, name) => LengthUnit::of_name(name)?.metres,
            (Dimension::Angle, "deg" | "degs" | "degree" | "degrees" | "°" | "d" | "dd") => {
                std::f64::consts::PI / 180.0
            }
            (Dimension::Angle, "mrad") => 1e-3,
            (Dimension::Angle, "rad" | "rads" | "radian" | "radians") => 1.0,
            (Dimension::Ratio | Dimension::Count, "1" | "-") => 1.0,
            _ => return None,
        })
    }

    /// The units that [`Dimension::factor`] accepts, for messages.
    pub fn units(self) -> &'static str {
        match self {
            Dimension::Time => "s, ms, us or ns",
            Dimension::Length => LengthUnit::USUAL,
            Dimension::Angle => "rad, mrad or deg",
            Dimension::Ratio | Dimension::Count | Dimension::Text => "no unit",
        }
    }
}
