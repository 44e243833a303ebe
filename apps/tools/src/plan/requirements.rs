//! Requirements of airborne surveys.

use crate::args;
use vlscan_survey::Mount;

/// Requirements of an airborne survey. Of speed, overlap and density at least one is given besides those with
/// defaults; density with overlap yields the speed, density with speed the distance of the lines, all three
/// the pulse rate.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct AirborneOptions {
    /// Height above the ground, m.
    #[arg(long, value_name = "M", value_parser = args::positive)]
    pub height: f64,
    /// Speed, m/s.
    #[arg(long, value_name = "M/S", value_parser = args::positive)]
    pub speed: Option<f64>,
    /// Mean pulses per m².
    #[arg(long, value_name = "N", value_parser = args::positive)]
    pub density: Option<f64>,
    /// Pulses with a return per m² that --min-share of the cells of the area have at least: the plan is made
    /// denser until a sample of the flight over the scene has them.
    #[arg(long, value_name = "N", value_parser = args::positive, conflicts_with = "density")]
    pub min_density: Option<f64>,
    /// Share of the cells within the area that have --min-density, percent. [default: 95]
    #[arg(long, value_name = "PERCENT", value_parser = args::share, requires = "min_density")]
    pub min_share: Option<f64>,
    /// Side of these cells, m. [default: 10]
    #[arg(long, value_name = "M", value_parser = args::positive, requires = "min_density")]
    pub min_cell: Option<f64>,
    /// Overlap of neighbouring strips, percent of the swath. [default: 30]
    #[arg(long, value_name = "PERCENT", value_parser = args::overlap)]
    pub overlap: Option<f64>,
    /// Half opening angle, degrees; not for spinning heads and wedge prisms. [default: 30, or the scanner's
    /// maximum]
    #[arg(long, value_name = "DEG", value_parser = args::positive)]
    pub scan_angle: Option<f64>,
    /// Scan frequency in Hz; for spinning scanners revolutions per second. [default: equal spacing along and
    /// across; 10]
    #[arg(long, value_name = "HZ", value_parser = args::positive)]
    pub scan_freq: Option<f64>,
    /// Direction of the lines, degrees clockwise from +y. [default: the one with the fewest lines]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = args::heading)]
    pub heading: Option<f64>,
    /// Cross lines, perpendicular to the others and evenly spread.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        value_parser = clap::value_parser!(u32).range(..=10_000),
    )]
    pub cross_lines: u32,
    /// Length by which lines begin before the area and end after it, m. [default: as far as the scanner looks
    /// ahead and behind, plus a scan line]
    #[arg(long, value_name = "M", value_parser = args::positive)]
    pub run_in: Option<f64>,
    /// Fly turns of this radius between lines, m. [default: straight to the next line]
    #[arg(long, value_name = "M", value_parser = args::positive)]
    pub turn_radius: Option<f64>,
    /// Keep the height above the scene's ground instead of above its mean.
    #[arg(long, requires = "scene")]
    pub follow_terrain: bool,
    /// Steepest climb with --follow-terrain, degrees. [default: 10]
    #[arg(
        long,
        value_name = "DEG",
        requires = "follow_terrain",
        allow_negative_numbers = true,
        value_parser = args::climb,
    )]
    pub climb: Option<f64>,
}

/// How a platform carries the instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carrier {
    /// Mount of the scanner on the platform.
    pub mount: Mount,
    /// True if the plan may turn the scanner where that mount does not point it at the ground.
    pub may_turn: bool,
}
