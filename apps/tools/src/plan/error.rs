//! Problems of plans.

use super::area::AreaError;
use crate::args::OptionError;
use vlscan_base::error::Error;
use vlscan_base::quantity::{metres, number};

/// Requirements of a survey that contradict each other, or that an instrument cannot meet.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// An option beyond its bounds.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// An option without another one that it needs.
    #[error("{0} needs {1}")]
    Without(&'static str, &'static str),
    /// A mean and a minimum density.
    #[error("--density and --min-density exclude each other: give one of them")]
    TwoDensities,
    /// A minimum density, which needs samples of the flight, in a plan without them.
    #[error("--min-density is reached by sampling flights, as `plan_survey` does")]
    NoSample,
    /// An instrument without a pulse rate.
    #[error("the instrument lists no pulse rate: give --pulse-rate")]
    NoPulseRate,
    /// A field of view that cannot be narrowed.
    #[error(
        "--scan-angle {angle}: the field of {instrument} cannot be narrowed; leave it out, and set the \
         distance of lines with --overlap",
        angle = number(*.angle)
    )]
    FixedField {
        /// The requested half opening angle, degrees.
        angle: f64,
        /// Name of the instrument.
        instrument: String,
    },
    /// A half opening angle beyond the instrument's.
    #[error(
        "half opening angle {angle}°, expected above 0 and at most {max}°",
        angle = number(*.angle),
        max = number(*.max)
    )]
    HalfAngle {
        /// The requested angle, degrees.
        angle: f64,
        /// The maximum, degrees.
        max: f64,
    },
    /// A scan frequency for an instrument without scan lines.
    #[error("--scan-freq {frequency}: {instrument} has no scan lines", frequency = number(*.frequency))]
    NoScanLines {
        /// The requested frequency, Hz.
        frequency: f64,
        /// Name of the instrument.
        instrument: String,
    },
    /// A scan frequency beyond the limits.
    #[error(
        "scan frequency {frequency} Hz, expected {limits} Hz",
        frequency = number(*.frequency),
        limits = span(*.limits)
    )]
    ScanFrequency {
        /// The requested frequency, Hz.
        frequency: f64,
        /// Minimum and maximum, Hz; the maximum is infinite if there is none.
        limits: [f64; 2],
    },
    /// A speed of a spinning scanner beyond its limit.
    #[error(
        "{turns} turns per second, expected above 0, at most {max}",
        turns = number(*.turns),
        max = number(*.max)
    )]
    Turns {
        /// The requested turns per second.
        turns: f64,
        /// The maximum.
        max: f64,
    },
    /// An angle to which an oscillating mirror swings more slowly than its minimum frequency.
    #[error(
        "{angle} degrees to either side: the mirror of {instrument} swings that far at most {max} times a \
         second, and at least {min} times by its limits; narrow it to {possible} degrees with --scan-angle",
        angle = number(*.angle),
        max = number(*.max),
        min = number(*.min),
        possible = number(*.possible)
    )]
    Swing {
        /// The requested half opening angle, degrees.
        angle: f64,
        /// Name of the instrument.
        instrument: String,
        /// Maximum frequency at that angle, Hz.
        max: f64,
        /// Minimum frequency of the mirror, Hz.
        min: f64,
        /// The largest possible angle, degrees.
        possible: f64,
    },
    /// Settings with which the instrument emits nothing.
    #[error("the instrument emits no pulse with these settings")]
    NoPulses,
    /// Optics that have no direction for a pulse.
    #[error("{0}")]
    Optics(Box<Error>),
    /// A line with too many positions on the ground.
    #[error("a line of {count:.0} waypoints, expected at most {max}")]
    LineWaypoints {
        /// Number of positions.
        count: f64,
        /// The maximum.
        max: f64,
    },
    /// A flight below the minimum range.
    #[error(
        "the ground is {distance} m away, but {instrument} measures from {near} m; fly higher than \
         {height:.0} m",
        distance = number(*.distance),
        near = number(*.near)
    )]
    Low {
        /// Distance of the ground, m.
        distance: f64,
        /// Name of the instrument.
        instrument: String,
        /// Minimum range, m.
        near: f64,
        /// Height above which the ground is measured, m.
        height: f64,
    },
    /// A level flight below the minimum range at the highest place of the ground.
    #[error(
        "the ground is {distance} m away at the highest place, {relief} above the mean ground, but \
         {instrument} measures from {near} m; fly higher than {height:.0} m, or keep the height above the \
         ground with --follow-terrain",
        distance = number(*.distance),
        relief = metres(*.relief),
        near = number(*.near)
    )]
    LowAtTop {
        /// Distance of the ground, m.
        distance: f64,
        /// Height of the highest place above the mean ground, m.
        relief: f64,
        /// Name of the instrument.
        instrument: String,
        /// Minimum range, m.
        near: f64,
        /// Height above which the ground is measured, m.
        height: f64,
    },
    /// Density, speed and overlap together.
    #[error("--density, --speed and --overlap determine each other: leave one out")]
    Overdetermined,
    /// A line of fewer than two positions.
    #[error("a line of one position, expected at least 2")]
    NoLine,
    /// A corridor without an area.
    #[error(transparent)]
    Area(#[from] AreaError),
    /// A bend of a corridor that is too sharp for its lines.
    #[error(
        "--follow-line: the line turns too sharply at x {:.1} y {:.1}, where a bend of {radius:.0} m fits \
         and the lines need {needed:.0} m; leave out its short pieces, divide it there into two plans, or \
         leave out --follow-line",
        .place[0],
        .place[1]
    )]
    SharpBend {
        /// The corner, m.
        place: [f64; 2],
        /// The largest radius that fits, m.
        radius: f64,
        /// Radius that the outermost line needs, m.
        needed: f64,
    },
    /// Density, speed and overlap together, with which no pulse rate of the instrument is high enough.
    #[error(
        "at this speed and overlap the highest usable pulse rate, {rate} kHz, gives {found:.2} pulses/m² \
         instead of {density}; leave out --speed or --overlap",
        rate = number(f64::from(*.rate) / 1e3),
        density = number(*.density)
    )]
    PulseRates {
        /// The pulse rate, Hz.
        rate: u32,
        /// Density with it, pulses/m².
        found: f64,
        /// The requested density, pulses/m².
        density: f64,
    },
    /// Neither density nor speed.
    #[error("give --speed, or --density or --min-density to derive the speed from it")]
    NoSpeed,
    /// No round in which a scan is chosen.
    #[error("no scan was tried")]
    NoScan,
    /// A flight beyond the maximum range.
    #[error(
        "the ground is {height} m away, but {instrument} measures up to {far} m only; fly lower",
        height = number(*.height),
        far = number(*.far)
    )]
    High {
        /// Height above the ground, m.
        height: f64,
        /// Name of the instrument.
        instrument: String,
        /// Maximum range, m.
        far: f64,
    },
    /// An instrument whose beams never point down.
    #[error("no mount points the beams of {instrument} at the ground")]
    NoMount {
        /// Name of the instrument.
        instrument: String,
    },
    /// A platform whose mount does not point the beams down.
    #[error(
        "the mount of --platform does not point the beams of {instrument} at the ground; leave out \
         --platform for a mount that does, or use one that is {turns}"
    )]
    Mount {
        /// Name of the instrument.
        instrument: String,
        /// Rotation of a mount that does.
        turns: String,
    },
    /// A platform whose mount turns all beams into a plane along the direction of travel.
    #[error(
        "on the mount of --platform {instrument} scans along the road only: a drive measures a single line; \
         leave out --platform for a mount that scans across, or use one that is {turns}"
    )]
    AlongRoad {
        /// Name of the instrument.
        instrument: String,
        /// Rotation of a mount with which it scans across.
        turns: String,
    },
    /// Ground within the minimum range.
    #[error(
        "the ground is {height} m away, but {instrument} measures from {near} m; fly higher",
        height = number(*.height),
        near = number(*.near)
    )]
    TooNear {
        /// Height above the ground, m.
        height: f64,
        /// Name of the instrument.
        instrument: String,
        /// Minimum range, m.
        near: f64,
    },
    /// Ground whose echo is below the threshold everywhere.
    #[error(
        "the ground is {height} m away, where {instrument} does not detect ground that reflects {percent} %; \
         fly lower, or lower the pulse rate",
        height = number(*.height)
    )]
    TooWeak {
        /// Height above the ground, m.
        height: f64,
        /// Name of the instrument.
        instrument: String,
        /// Reflectance of the ground, percent.
        percent: f64,
    },
    /// Ground that no beam reaches.
    #[error("{instrument} does not reach ground {height} m below", height = number(*.height))]
    OutOfReach {
        /// Height above the ground, m.
        height: f64,
        /// Name of the instrument.
        instrument: String,
    },
    /// A field of view up to the horizon without a maximum range.
    #[error(
        "{instrument} has no maximum range, and its field of view reaches the horizon {height} m above the \
         ground and cannot be narrowed; state rangeMax_m or <maxRange> in its <scanner>",
        height = number(*.height)
    )]
    Horizon {
        /// Height above the ground, m.
        height: f64,
        /// Name of the instrument.
        instrument: String,
    },
    /// A swath whose edge is beyond the maximum range.
    #[error(
        "the edge of the swath is farther away than the {far} m that {instrument} measures; fly lower, or \
         narrow it with --scan-angle",
        far = number(*.far)
    )]
    EdgeTooFar {
        /// Name of the instrument.
        instrument: String,
        /// Maximum range, m.
        far: f64,
    },
    /// A swath at whose edge the echo is below the threshold.
    #[error(
        "at the edge of the swath {instrument} detects no ground that reflects {percent} %; fly lower, \
         narrow it with --scan-angle, or lower the pulse rate"
    )]
    EdgeTooWeak {
        /// Name of the instrument.
        instrument: String,
        /// Reflectance of the ground, percent.
        percent: f64,
    },
    /// A speed that no platform has, m/s.
    #[error(
        "the speed would be {speed} m/s, expected 0.001 to 1000 m/s; change --speed, --density (or \
         --min-density), --pulse-rate or --height",
        speed = number(*.0)
    )]
    Speed(f64),
    /// A density that one strip exceeds.
    #[error(
        "at {speed} m/s one strip has {found:.2} pulses/m² already, more than {density}; increase --height \
         or --speed, or lower --pulse-rate",
        speed = number(*.speed),
        density = number(*.density)
    )]
    Dense {
        /// The requested speed, m/s.
        speed: f64,
        /// Density of one strip, pulses/m².
        found: f64,
        /// The requested density, pulses/m².
        density: f64,
    },
    /// Too many flight lines.
    #[error("{count:.0} flight lines, expected at most {max}")]
    FlightLines {
        /// Number of lines.
        count: f64,
        /// The maximum.
        max: f64,
    },
    /// A drive with more waypoints than this maximum.
    #[error("more than {0} waypoints; choose a larger --step")]
    Waypoints(f64),
    /// An instrument without a turning head.
    #[error("the head of {instrument} does not turn; it is not a terrestrial scanner")]
    NoHead {
        /// Name of the instrument.
        instrument: String,
    },
    /// An instrument that draws no lines.
    #[error("{instrument} has neither a mirror nor channels that draw lines")]
    NoLines {
        /// Name of the instrument.
        instrument: String,
    },
    /// A mirror for which resolutions are undefined.
    #[error("{instrument} has no polygon mirror, for which resolutions are defined")]
    NoPolygon {
        /// Name of the instrument.
        instrument: String,
    },
    /// A resolution for which the head of channels would turn too fast.
    #[error(
        "{resolution}: the head would turn at {rate}°/s, and that of {instrument} at most at {max}°/s; at \
         most {possible}° is possible",
        rate = number(*.rate),
        max = number(*.max),
        possible = number(*.possible)
    )]
    ChannelHead {
        /// The requested resolution.
        resolution: Resolution,
        /// Name of the instrument.
        instrument: String,
        /// Speed of the head, degrees per second.
        rate: f64,
        /// Its maximum, degrees per second.
        max: f64,
        /// Resolution at the maximum, degrees.
        possible: f64,
    },
    /// A resolution for which the head beside a mirror would turn too fast.
    #[error(
        "{resolution}: the head would turn at {rate}°/s, and that of {instrument} at most at {max}°/s; \
         choose a finer resolution or a lower pulse rate",
        rate = number(*.rate),
        max = number(*.max)
    )]
    MirrorHead {
        /// The requested resolution.
        resolution: Resolution,
        /// Name of the instrument.
        instrument: String,
        /// Speed of the head, degrees per second.
        rate: f64,
        /// Its maximum, degrees per second.
        max: f64,
    },
    /// A resolution for which the mirror would turn too fast or too slowly.
    #[error(
        "{resolution}: the mirror would draw {lines} lines a second, and that of {instrument} draws \
         {limits}; resolutions of {possible}° are possible",
        lines = number(*.lines),
        limits = span(*.limits),
        possible = span(*.possible)
    )]
    MirrorLines {
        /// The requested resolution.
        resolution: Resolution,
        /// Name of the instrument.
        instrument: String,
        /// Lines per second.
        lines: f64,
        /// Minimum and maximum of the mirror, lines per second.
        limits: [f64; 2],
        /// The finest and the coarsest resolution, degrees.
        possible: [f64; 2],
    },
    /// Positions of a tripod without a place.
    #[error("give --spacing and an area, --around and --radius, or --at")]
    NoPlace,
    /// Several kinds of positions of a tripod.
    #[error("--spacing, --around with its options, and --at exclude each other: give one of them")]
    SeveralPlaces,
    /// An area between the positions of the grid.
    #[error("no position is inside the area; choose a smaller --spacing")]
    NoPosition,
    /// Too many positions of a tripod.
    #[error("{count} positions, expected at most {max}")]
    Positions {
        /// Number of positions.
        count: usize,
        /// The maximum.
        max: usize,
    },
    /// A grid of too many positions.
    #[error("a grid of {columns} by {rows} positions, expected at most {max}")]
    Grid {
        /// Positions along x.
        columns: usize,
        /// Positions along y.
        rows: usize,
        /// Maximum number of positions.
        max: usize,
    },
}

/// A resolution at a pulse rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resolution {
    /// Angle between points, degrees.
    pub degrees: f64,
    /// Pulse rate, Hz.
    pub pulse_rate: f64,
}

impl std::fmt::Display for Resolution {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "--resolution {} at {} kHz", number(self.degrees), number(self.pulse_rate / 1e3))
    }
}

impl From<PlanError> for Error {
    fn from(error: PlanError) -> Error {
        match error {
            PlanError::Optics(error) => *error,
            PlanError::NoScan => Error::Internal(error.to_string()),
            error => Error::input(error.to_string()),
        }
    }
}

/// Limits in words; the upper one is infinite if there is none.
fn span([least, most]: [f64; 2]) -> String {
    match most.is_finite() {
        true => format!("{} to {}", number(least), number(most)),
        false => format!("at least {}", number(least)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_base::diag::ProblemKind;

    #[test]
    fn limits_without_a_maximum_have_a_minimum_only() {
        assert_eq!([span([10.0, 200.0]), span([10.0, f64::INFINITY])], ["10 to 200", "at least 10"]);
    }

    #[test]
    fn problems_of_plans_are_invalid_input_and_those_of_optics_keep_their_kind() {
        let error = Error::from(PlanError::Speed(2e3));
        assert!(error.to_string().starts_with("the speed would be 2000 m/s") && error.exit_status() == 2);
        let missing = || Error::input_of(ProblemKind::NotFound, "no table");
        let error = Error::from(PlanError::Optics(Box::new(missing())));
        assert!(matches!(&error, Error::Input(found) if found.has(ProblemKind::NotFound)), "{error}");
        assert!(matches!(Error::from(PlanError::NoScan), Error::Internal(_)));
    }
}
