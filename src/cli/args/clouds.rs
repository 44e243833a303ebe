//! The command line of `vlscan info`, `vlscan raster` and `vlscan frames`.

use clap::Args;
use std::path::PathBuf;
use vlscan_options::{Bytes, Crs};
use vlscan_tools::frames::FrameOptions;
use vlscan_tools::raster::{RasterFiles, RasterOptions};

/// `vlscan info`.
#[derive(Debug, Args)]
pub struct CloudInfoArgs {
    /// Point clouds: LAS, LAZ, COPC, PLY, PCD, E57, PTS, MCAP, text, Arrow or Parquet, - for stdin. Several
    /// are described as one.
    #[arg(required = true, value_name = "CLOUD")]
    pub clouds: Vec<PathBuf>,
    /// As JSON.
    #[arg(long)]
    pub json: bool,
}

/// Memory of commands that hold the points of clouds.
#[derive(Clone, Debug, Default, Args)]
pub struct PointMemory {
    /// Memory for points, e.g. 2G; points beyond it are kept in temporary files (TMPDIR). Does not change the
    /// result. [default: 128M for each cloud]
    #[arg(long, value_name = "SIZE")]
    pub max_memory: Option<Bytes>,
}

impl PointMemory {
    /// The memory of each of some clouds, bytes; `None` for the default.
    pub fn of_each(&self, clouds: u64) -> Option<u64> {
        self.max_memory.map(|bytes| bytes.0 / clouds.max(1))
    }
}

/// `vlscan raster`.
#[derive(Debug, Args)]
pub struct RasterArgs {
    /// Point clouds: LAS, LAZ, COPC, PLY, PCD, E57, PTS, MCAP, text, Arrow or Parquet, - for stdin. Several
    /// are rasterised as one.
    #[arg(required = true, value_name = "CLOUD")]
    pub clouds: Vec<PathBuf>,
    /// The rasters.
    #[command(flatten)]
    pub files: RasterFiles,
    /// How they are made.
    #[command(flatten)]
    pub options: RasterOptions,
    /// Coordinate reference system of clouds that name none: EPSG:25832, WKT, or a file with either.
    #[arg(long, value_name = "CRS")]
    pub crs: Option<Crs>,
    /// Reject cells that need more memory than this, e.g. 2G. [default: half the memory of the machine]
    #[arg(long, value_name = "SIZE")]
    pub max_memory: Option<Bytes>,
    /// Replace existing files, and write a raster to a terminal.
    #[arg(long)]
    pub force: bool,
}

/// `vlscan frames`.
#[derive(Debug, Args)]
pub struct FramesArgs {
    /// MCAP that vlscan run has written, - for stdin.
    pub points: PathBuf,
    /// The folder of the data set; its sequence or tables must not exist.
    #[arg(short = 'o', long, value_name = "DIR", value_parser = super::files())]
    pub out: PathBuf,
    /// Rasters to write.
    #[command(flatten)]
    pub options: FrameOptions,
}
