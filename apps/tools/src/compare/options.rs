//! How clouds are compared.

use crate::args::{self, OptionError};
use std::path::PathBuf;
use vlscan_base::error::Error;
use vlscan_base::quantity::POSITIVE;

/// How clouds are compared.
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct CompareOptions {
    /// Side of the cells of density, canopy height and change, m.
    #[arg(long, value_name = "M", default_value = "1", value_parser = args::positive)]
    pub cell: f64,
    /// Side of the voxels whose occupancy is compared, m.
    #[arg(long, value_name = "M", default_value = "0.5", value_parser = args::positive)]
    pub voxel: f64,
    /// Maximum number of points of each cloud, evenly sampled, whose distance to the other cloud and height
    /// above the terrain are computed.
    #[arg(
        long,
        alias = "most-distances",
        value_name = "N",
        default_value = "200k",
        value_parser = args::number_of_points,
    )]
    pub max_distances: usize,
    /// Show what chance alone gives: beside each figure the largest difference between random halves of the
    /// first cloud's scan lines, or of square cells if it has none.
    #[arg(long)]
    pub chance: bool,
    /// Terrain that heights and residuals refer to: a raster (.tif, .asc, .vrt, a folder of tiles) or a mesh
    /// (.obj, .ply, .stl, .off). [default: the ground points of the first cloud (class 2)]
    #[arg(long, value_name = "FILE")]
    pub terrain: Option<PathBuf>,
    /// Standard deviation of the registration of the clouds to each other, m, in the level of detection of
    /// change and the uncertainty of volumes. [default: the median difference of the cells that did not
    /// change]
    #[arg(long, value_name = "M", value_parser = args::deviation)]
    pub registration: Option<f64>,
}

/// Options or clouds that cannot be compared.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(super) enum CompareError {
    /// An option beyond its bounds.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// No distances to measure.
    #[error("--max-distances 0: expected at least 1")]
    NoDistances,
    /// Clouds whose boxes do not overlap.
    #[error(
        "the clouds do not overlap: their boxes are {gap:.1} m apart ({:.1} {:.1} and {:.1} {:.1} are their \
         lower corners)",
        .corners[0][0], .corners[0][1], .corners[1][0], .corners[1][1]
    )]
    Apart {
        /// Distance of the boxes along an axis, m.
        gap: f64,
        /// Their lower corners, x and y, m.
        corners: [[f64; 2]; 2],
    },
}

impl From<CompareError> for Error {
    fn from(error: CompareError) -> Error {
        Error::input(error.to_string())
    }
}

impl Default for CompareOptions {
    fn default() -> CompareOptions {
        CompareOptions {
            cell: 1.0,
            voxel: 0.5,
            max_distances: 200_000,
            chance: false,
            terrain: None,
            registration: None,
        }
    }
}

impl CompareOptions {
    /// Checks the bounds of values that programs may break.
    pub(super) fn check(&self) -> Result<(), CompareError> {
        args::check([
            ("cell", Some(self.cell), POSITIVE),
            ("voxel", Some(self.voxel), POSITIVE),
            ("registration", self.registration, args::DEVIATION),
        ])?;
        match self.max_distances {
            0 => Err(CompareError::NoDistances),
            _ => Ok(()),
        }
    }
}
