//! The command line of `vlscan plan`.

use crate::options::Positive;
use clap::{Args, Subcommand};
use std::path::PathBuf;
use vlscan_base::quantity::{Bounds, COORDINATE, number};

/// `vlscan plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// What kind of survey.
    #[command(subcommand)]
    pub command: PlanCommand,
}

/// Subcommands of `vlscan plan`.
#[derive(Debug, Subcommand)]
pub enum PlanCommand {
    /// Parallel flight lines over an area.
    ///
    /// The swath W at that height above the ground and the N pulses per second that reach it are sampled from the instrument's
    /// own optics. With the speed v, f scan lines per second and the distance S of the lines: overlap 1 − S/W, density N/(v·S),
    /// spacing v/f along and W·f/N across. Density is the mean number of pulses per m² of flat ground; without --speed the speed
    /// follows from it, with --speed the distance of the lines. The area is covered to its edges as often as within. Where the
    /// mount of the default platform does not point the scanner at the ground, the plan turns it. Before it is written, a sample
    /// of the flight is flown over flat ground and over the scene; what the instrument cannot do is refused.
    Airborne(Box<AirborneArgs>),
    /// Positions of a tripod on a grid over an area, or around a plot.
    ///
    /// The head turns once at each position. Points are resolution × range apart.
    Terrestrial(TerrestrialArgs),
    /// A vehicle along a line.
    Mobile(MobileArgs),
}

/// What all plans need.
#[derive(Debug, Args)]
pub struct CommonPlanArgs {
    /// The scanner: an id of `vlscan catalogue`, or file.xml#id.
    #[arg(long, value_name = "SCANNER")]
    pub scanner: String,
    /// The platform: an id of `vlscan catalogue`, or file.xml#id.
    #[arg(long, value_name = "PLATFORM")]
    pub platform: Option<String>,
    /// The scene, which the plan names; it tells the ground and, where no area is given, the area.
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<String>,
    /// Height of the ground where no scene tells it, m; tripods and vehicles stand on it even if a scene does. [default: 0]
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = ground)]
    pub ground: Option<f64>,
    /// Pulses per second. [default: the scanner's first]
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(1..))]
    pub pulse_rate: Option<u32>,
    /// Folder to look for files in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// The pipeline file. [default: stdout]
    #[arg(short = 'o', long, value_name = "PATH")]
    pub out: Option<PathBuf>,
    /// Overwrite a file that exists.
    #[arg(long)]
    pub force: bool,
}

impl CommonPlanArgs {
    /// Height of the ground where no scene tells it, m.
    pub fn level(&self) -> f64 {
        self.ground.unwrap_or(0.0)
    }
}

/// `vlscan plan airborne`.
#[derive(Debug, Args)]
pub struct AirborneArgs {
    /// The area in the scene's coordinates: a file of GeoJSON, KML or well-known text, or "POLYGON ((x y, …))". Longitudes and
    /// latitudes are projected to the scene's UTM zone. [default: the box of the scene's ground]
    #[arg(long, value_name = "AREA")]
    pub area: Option<String>,
    /// The area is a line, and what is no farther from it than this, m.
    #[arg(long, value_name = "M", requires = "area")]
    pub buffer: Option<Positive>,
    #[command(flatten)]
    pub common: CommonPlanArgs,
    /// Height above the ground, m.
    #[arg(long, value_name = "M")]
    pub height: Positive,
    /// Speed, m/s.
    #[arg(long, value_name = "M/S")]
    pub speed: Option<Positive>,
    /// Mean pulses per m².
    #[arg(long, value_name = "N")]
    pub density: Option<Positive>,
    /// Overlap of neighbouring strips, percent of the swath. [default: 30]
    #[arg(long, value_name = "PERCENT", value_parser = overlap)]
    pub overlap: Option<f64>,
    /// Half opening angle, degrees; not of spinning heads and wedge prisms. [default: 30, or what the scanner reaches]
    #[arg(long, value_name = "DEG")]
    pub scan_angle: Option<Positive>,
    /// Scan frequency; of spinning scanners turns per second. [default: points as far apart along as across; 10]
    #[arg(long, value_name = "HZ")]
    pub scan_freq: Option<Positive>,
    /// Direction of the lines, degrees clockwise from +y. [default: the one with the fewest lines]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = heading)]
    pub heading: Option<f64>,
    /// Cross lines, perpendicular to the others and evenly spread.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=10_000))]
    pub cross_lines: u32,
    /// Length by which lines begin before the area and end behind it, m. [default: as far as the scanner looks ahead and
    /// behind, and a scan line]
    #[arg(long, value_name = "M")]
    pub run_in: Option<Positive>,
    /// Fly turns of this radius between lines, m. [default: straight to the next line]
    #[arg(long, value_name = "M")]
    pub turn_radius: Option<Positive>,
    /// Keep the height above the scene's ground instead of above its mean.
    #[arg(long, requires = "scene")]
    pub follow_terrain: bool,
    /// Steepest climb with --follow-terrain, degrees. [default: 10]
    #[arg(long, value_name = "DEG", requires = "follow_terrain", allow_negative_numbers = true, value_parser = climb)]
    pub climb: Option<f64>,
}

/// `vlscan plan terrestrial`.
#[derive(Debug, Args)]
pub struct TerrestrialArgs {
    /// The area in the scene's coordinates: a file of GeoJSON, KML or well-known text, or "POLYGON ((x y, …))". [default: the
    /// scene's box]
    #[arg(long, value_name = "AREA", conflicts_with = "around")]
    pub area: Option<String>,
    #[command(flatten)]
    pub common: CommonPlanArgs,
    /// Distance of the positions on a square grid over the area, m.
    #[arg(long, value_name = "M", required_unless_present = "around", conflicts_with = "around")]
    pub spacing: Option<Positive>,
    /// Centre of a plot, around which the positions stand.
    #[arg(long, value_name = "X,Y", requires = "radius", allow_hyphen_values = true, value_parser = place)]
    pub around: Option<[f64; 2]>,
    /// Radius on which the positions stand, m.
    #[arg(long, value_name = "M", requires = "around")]
    pub radius: Option<Positive>,
    /// Positions around the plot. [default: 4]
    #[arg(short = 'n', long, value_name = "N", conflicts_with = "spacing", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub positions: Option<u32>,
    /// One position at the plot's centre as well.
    #[arg(long, requires = "around")]
    pub at_centre: bool,
    /// Angle from point to point, degrees.
    #[arg(long, value_name = "DEG", default_value = "0.04")]
    pub resolution: Positive,
}

/// `vlscan plan mobile`.
#[derive(Debug, Args)]
pub struct MobileArgs {
    /// The line in the scene's coordinates: a file of GeoJSON, KML or well-known text, or "LINESTRING (x y, …)".
    #[arg(long, value_name = "LINE")]
    pub along: String,
    #[command(flatten)]
    pub common: CommonPlanArgs,
    /// Speed, m/s.
    #[arg(long, value_name = "M/S", default_value = "10")]
    pub speed: Positive,
    /// Half opening angle, degrees. [default: the scanner's]
    #[arg(long, value_name = "DEG")]
    pub scan_angle: Option<Positive>,
    /// Scan frequency; of spinning scanners turns per second. [default: points at 10 m as far apart along as on a line; 10]
    #[arg(long, value_name = "HZ")]
    pub scan_freq: Option<Positive>,
    /// Most metres between waypoints, at which the vehicle is set on the scene's ground.
    #[arg(long, value_name = "M", default_value = "20")]
    pub step: Positive,
}

fn ground(text: &str) -> Result<f64, String> {
    bounded(text, COORDINATE)
}

fn heading(text: &str) -> Result<f64, String> {
    bounded(text, Bounds::new(-360.0, 360.0, "degrees from -360 to 360"))
}

fn climb(text: &str) -> Result<f64, String> {
    bounded(text, Bounds::new(0.01, 89.0, "degrees from 0.01 to 89"))
}

fn bounded(text: &str, bounds: Bounds) -> Result<f64, String> {
    let value = text.trim().parse::<f64>().ok().filter(|value| bounds.contains(*value));
    value.ok_or_else(|| format!("expected {}", bounds.expected))
}

fn overlap(text: &str) -> Result<f64, String> {
    let is_marked = text.trim_end().ends_with('%');
    match text.trim_end_matches('%').trim().parse::<f64>() {
        Ok(part) if !is_marked && part != 0.0 && part.abs() < 1.0 => Err(format!(
            "it is in percent: {} for that part of the swath, or \"{part}%\" if less than one percent is meant",
            number(part * 100.0)
        )),
        Ok(percent) if (-1000.0..=99.0).contains(&percent) => Ok(percent / 100.0),
        _ => Err("expected percent of the swath, at most 99; below 0 leaves gaps".to_owned()),
    }
}

fn place(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.map(<[f64; 2]>::try_from) {
        Some(Ok(place)) if place.iter().all(|v| COORDINATE.contains(*v)) => Ok(place),
        _ => Err("expected x,y in metres, such as 120.5,-30".to_owned()),
    }
}
