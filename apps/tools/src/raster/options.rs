//! Options for the rasters of a point cloud.

use crate::args;
use std::path::{Path, PathBuf};
use vlscan_base::error::Result;
use vlscan_base::quantity::POSITIVE;

/// A raster.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RasterKind {
    /// Height of the ground, m.
    Dtm,
    /// Height of the highest point, m.
    Dsm,
    /// Height of the highest point above the ground, m.
    Chm,
    /// Points per m².
    Density,
    /// First returns per m².
    PulseDensity,
}

impl RasterKind {
    /// All rasters.
    pub const ALL: [RasterKind; 5] =
        [RasterKind::Dtm, RasterKind::Dsm, RasterKind::Chm, RasterKind::Density, RasterKind::PulseDensity];

    /// The name, which is that of its option.
    pub fn name(self) -> &'static str {
        match self {
            RasterKind::Dtm => "dtm",
            RasterKind::Dsm => "dsm",
            RasterKind::Chm => "chm",
            RasterKind::Density => "density",
            RasterKind::PulseDensity => "pulse-density",
        }
    }

    /// True if the raster is made of ground points.
    pub fn needs_ground(self) -> bool {
        matches!(self, RasterKind::Dtm | RasterKind::Chm)
    }
}

/// The files of rasters.
#[derive(Clone, Debug, Default, PartialEq, clap::Args)]
pub struct RasterFiles {
    /// Terrain: height of the ground at the centre of each cell, of the plane through the nearest ground
    /// points (class 2), averaged by cell, m; - for stdout.
    #[arg(long, value_name = "FILE.tif")]
    pub dtm: Option<PathBuf>,
    /// Surface: height of the highest point of each cell, m.
    #[arg(long, value_name = "FILE.tif")]
    pub dsm: Option<PathBuf>,
    /// Canopy height: surface minus terrain, m.
    #[arg(long, value_name = "FILE.tif")]
    pub chm: Option<PathBuf>,
    /// Points per m².
    #[arg(long, value_name = "FILE.tif")]
    pub density: Option<PathBuf>,
    /// Pulses with a return per m²: first returns.
    #[arg(long, value_name = "FILE.tif")]
    pub pulse_density: Option<PathBuf>,
}

impl RasterFiles {
    /// The rasters that are wanted, with their files.
    pub fn requested(&self) -> Vec<(RasterKind, &Path)> {
        let RasterFiles { dtm, dsm, chm, density, pulse_density } = self;
        let files = RasterKind::ALL.into_iter().zip([dtm, dsm, chm, density, pulse_density]);
        files.filter_map(|(kind, file)| Some((kind, file.as_deref()?))).collect()
    }
}

/// How rasters are made.
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct RasterOptions {
    /// Side of a cell, m. Corners of cells are at multiples of it.
    #[arg(long, value_name = "M", default_value = "1", value_parser = args::positive)]
    pub cell: f64,
    /// Largest distance from a ground point at which there is terrain, m; cells beyond it, and outside of the
    /// convex hull of the points, have no value.
    #[arg(long, value_name = "M", default_value = "30", value_parser = args::positive)]
    pub fill: f64,
}

impl Default for RasterOptions {
    fn default() -> RasterOptions {
        RasterOptions { cell: 1.0, fill: 30.0 }
    }
}

impl RasterOptions {
    /// Checks the bounds of values that programs may break.
    pub(super) fn check(&self) -> Result<()> {
        Ok(args::check([("cell", Some(self.cell), POSITIVE), ("fill", Some(self.fill), POSITIVE)])?)
    }
}
