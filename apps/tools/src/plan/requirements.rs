//! Requirements of airborne surveys.

use super::error::PlanError;
use crate::args;
use vlscan_base::quantity::POSITIVE;
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

impl AirborneOptions {
    /// Checks bounds and combinations of options, as the command line does.
    ///
    /// # Errors
    /// [`PlanError::Option`], [`PlanError::TwoDensities`], [`PlanError::Without`].
    pub fn check(&self) -> Result<(), PlanError> {
        args::check([
            ("height", Some(self.height), POSITIVE),
            ("speed", self.speed, POSITIVE),
            ("density", self.density, POSITIVE),
            ("min-density", self.min_density, POSITIVE),
            ("min-share", self.min_share, args::SHARE),
            ("min-cell", self.min_cell, POSITIVE),
            ("overlap", self.overlap, args::OVERLAP),
            ("scan-angle", self.scan_angle, POSITIVE),
            ("scan-freq", self.scan_freq, POSITIVE),
            ("heading", self.heading, args::HEADING),
            ("run-in", self.run_in, POSITIVE),
            ("turn-radius", self.turn_radius, POSITIVE),
            ("climb", self.climb, args::CLIMB),
        ])?;
        if self.density.is_some() && self.min_density.is_some() {
            return Err(PlanError::TwoDensities);
        }
        for (option, is_given) in
            [("--min-share", self.min_share.is_some()), ("--min-cell", self.min_cell.is_some())]
        {
            if is_given && self.min_density.is_none() {
                return Err(PlanError::Without(option, "--min-density"));
            }
        }
        match self.climb.is_some() && !self.follow_terrain {
            true => Err(PlanError::Without("--climb", "--follow-terrain")),
            false => Ok(()),
        }
    }
}

/// How a platform carries the instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carrier {
    /// Mount of the scanner on the platform.
    pub mount: Mount,
    /// True if the plan may turn the scanner where that mount does not point it at the ground.
    pub may_turn: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_without_those_that_they_need_are_refused() {
        let fine = AirborneOptions { height: 60.0, min_density: Some(4.0), ..AirborneOptions::default() };
        let said = |options: AirborneOptions| options.check().unwrap_err().to_string();
        let all = AirborneOptions { min_share: Some(98.0), min_cell: Some(5.0), ..fine.clone() };
        assert!(fine.check().is_ok() && all.check().is_ok());
        assert_eq!(
            said(AirborneOptions { density: Some(4.0), ..fine.clone() }),
            "--density and --min-density exclude each other: give one of them"
        );
        let none = AirborneOptions { min_density: None, ..fine };
        for (options, expected) in [
            (AirborneOptions { min_share: Some(98.0), ..none.clone() }, "--min-share needs --min-density"),
            (AirborneOptions { min_cell: Some(5.0), ..none.clone() }, "--min-cell needs --min-density"),
            (AirborneOptions { climb: Some(5.0), ..none.clone() }, "--climb needs --follow-terrain"),
        ] {
            assert_eq!(said(options), expected);
        }
        assert!(said(AirborneOptions { min_cell: Some(0.0), ..all }).contains("min-cell"));
        assert!(none.check().is_ok());
    }
}
