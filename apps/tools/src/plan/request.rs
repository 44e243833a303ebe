//! Request for a planned survey.

use super::{AirborneOptions, Area, MobileOptions, TerrestrialOptions};
use crate::args;
use std::path::{Path, PathBuf};

/// A survey that is to be planned.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum PlanRequest {
    /// Parallel flight lines over an area.
    ///
    /// The swath W at that height above ground and the N pulses per second that reach it are sampled from the
    /// instrument's optics. With the speed v, f scan lines per second and the line distance S: overlap 1 −
    /// S/W, density N/(v·S), spacing v/f along and W·f/N across. Density is the mean number of pulses per m²
    /// of flat ground; it determines the speed or, with --speed, the distance of the lines, or, with --speed
    /// and --overlap, the pulse rate. Coverage is uniform up to the edges of the area. If the mount of the
    /// default platform does not point the scanner at the ground, the plan rotates it. Before the plan is
    /// written, a sample of the flight is flown over flat ground and over the scene; plans that the
    /// instrument cannot fly are rejected.
    Airborne(Box<AirborneRequest>),
    /// Tripod positions on a grid over an area, or around a plot.
    ///
    /// The head makes one revolution at each position. Points are resolution × range apart.
    Terrestrial(Box<TerrestrialRequest>),
    /// A vehicle along a line.
    ///
    /// If the scanner would scan along the road on the default platform, the plan rotates it to scan across.
    Mobile(Box<MobileRequest>),
}

impl PlanRequest {
    /// Setup that all requests have.
    pub fn common(&self) -> &PlanSetup {
        match self {
            PlanRequest::Airborne(request) => &request.common,
            PlanRequest::Terrestrial(request) => &request.common,
            PlanRequest::Mobile(request) => &request.common,
        }
    }

    /// Setup that all requests have, mutable.
    pub fn common_mut(&mut self) -> &mut PlanSetup {
        match self {
            PlanRequest::Airborne(request) => &mut request.common,
            PlanRequest::Terrestrial(request) => &mut request.common,
            PlanRequest::Mobile(request) => &mut request.common,
        }
    }

    /// Plans within an area if the request names no place of its own and is not one along a line.
    pub fn within(&mut self, area: &Area) {
        let place = match self {
            PlanRequest::Airborne(request) => &mut request.area,
            PlanRequest::Terrestrial(request)
                if request.options.around.is_none() && request.options.at.is_empty() =>
            {
                &mut request.area
            }
            _ => return,
        };
        place.get_or_insert_with(|| AreaSource::Given(area.clone()));
    }
}

/// Source of the polygon or line of an area.
#[derive(Clone, Debug, PartialEq)]
pub enum AreaSource {
    /// A file of GeoJSON, KML, KMZ, GPX or well-known text, a shapefile, a GeoPackage, or well-known text
    /// itself.
    Named(String),
    /// A polygon in the scene's coordinates.
    Given(Area),
}

impl From<String> for AreaSource {
    fn from(name: String) -> AreaSource {
        AreaSource::Named(name)
    }
}

/// Setup of plans of all kinds.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct PlanSetup {
    /// The scanner: an id of `vlscan catalogue`, or file.xml#id.
    #[arg(long, value_name = "SCANNER")]
    pub scanner: String,
    /// The platform: an id of `vlscan catalogue`, or file.xml#id.
    #[arg(long, value_name = "PLATFORM")]
    pub platform: Option<String>,
    /// The scene of the plan; it gives the ground height and, without --area, the area.
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<String>,
    /// Height of the ground where the scene has none, m; tripods and vehicles stand at this height in any
    /// case. [default: 0]
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = args::coordinate)]
    pub ground: Option<f64>,
    /// Pulses per second. [default: the scanner's first]
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(1..))]
    pub pulse_rate: Option<u32>,
    /// Folder to look for files in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// Coordinate reference system of the plan's coordinates if no file of its scene names it: EPSG:25832,
    /// WKT, or a file with either.
    #[arg(long, value_name = "CRS")]
    pub crs: Option<String>,
    /// Also write the flight lines, the drive or the positions as .geojson, .kml (both in longitude and
    /// latitude) or .csv (in the plan's coordinates, too); may be given more than once.
    #[arg(long, value_name = "FILE")]
    pub lines: Vec<PathBuf>,
    /// The pipeline file. [default: stdout]
    #[arg(short = 'o', long, value_name = "PATH")]
    pub out: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(id = "force", long = "force")]
    pub overwrite: bool,
}

impl PlanSetup {
    /// Height of the ground where no scene tells it, m.
    pub fn level(&self) -> f64 {
        self.ground.unwrap_or(0.0)
    }

    /// The pipeline file; `None` for standard output.
    pub fn file(&self) -> Option<&Path> {
        self.out.as_deref().filter(|path| path.as_os_str() != "-")
    }
}

/// A flight that is to be planned.
#[derive(Clone, Debug, clap::Args)]
pub struct AirborneRequest {
    /// The area in the scene's coordinates: a file (GeoJSON, KML, KMZ, GPX, shapefile, GeoPackage, WKT), or
    /// "POLYGON ((x y, …))". Longitudes and latitudes are projected to the scene's UTM zone. [default: the
    /// box of the scene's ground]
    #[arg(long, value_name = "AREA")]
    pub area: Option<AreaSource>,
    /// Make the area a corridor: everything within this distance of the line, m.
    #[arg(long, value_name = "M", requires = "area", value_parser = args::positive)]
    pub buffer: Option<f64>,
    /// Fly lines that follow the bends of the corridor's line, with corners as arcs, instead of straight
    /// lines over all of it.
    #[arg(long, requires = "buffer", conflicts_with_all = ["heading", "cross_lines"])]
    pub follow_line: bool,
    /// Instrument, scene and output.
    #[command(flatten)]
    pub common: PlanSetup,
    /// The flight.
    #[command(flatten)]
    pub options: AirborneOptions,
}

/// Positions of a tripod that are to be planned.
#[derive(Clone, Debug, clap::Args)]
pub struct TerrestrialRequest {
    /// The area in the scene's coordinates: a file (GeoJSON, KML, KMZ, GPX, shapefile, GeoPackage, WKT), or
    /// "POLYGON ((x y, …))". [default: the scene's box]
    #[arg(long, value_name = "AREA", conflicts_with_all = ["around", "at"])]
    pub area: Option<AreaSource>,
    /// Instrument, scene and output.
    #[command(flatten)]
    pub common: PlanSetup,
    /// The positions.
    #[command(flatten)]
    pub options: TerrestrialOptions,
}

/// A drive that is to be planned.
#[derive(Clone, Debug, clap::Args)]
pub struct MobileRequest {
    /// The line in the scene's coordinates: a file (GeoJSON, KML, KMZ, GPX, shapefile, GeoPackage, WKT), or
    /// "LINESTRING (x y, …)".
    #[arg(long, value_name = "LINE")]
    pub along: String,
    /// Instrument, scene and output.
    #[command(flatten)]
    pub common: PlanSetup,
    /// The drive.
    #[command(flatten)]
    pub options: MobileOptions,
}
