//! The command line of `vlscan compare`.

use clap::Args;
use std::path::PathBuf;
use vlscan_tools::compare::CompareOptions;

/// `vlscan compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The first cloud, usually the measured one: LAS, LAZ, PLY, PCD, E57, PTS, text, Arrow or Parquet, - for stdin.
    pub first: PathBuf,
    /// The second cloud, usually the simulated one.
    pub second: PathBuf,
    /// Write the result as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// Write a page with tables, charts and pictures, too.
    #[arg(long, value_name = "FILE.html")]
    pub page: Option<PathBuf>,
    /// Write what changed from the first to the second cloud, too: the difference of the ground in each cell, m, as GeoTIFF.
    #[arg(long, value_name = "FILE.tif")]
    pub change: Option<PathBuf>,
    /// Write the points that are new (class 64) or gone (class 65) in the second cloud, too, for example as LAZ.
    #[arg(long, value_name = "FILE")]
    pub changed: Option<PathBuf>,
    /// How the clouds are compared.
    #[command(flatten)]
    pub options: CompareOptions,
    /// Overwrite files that exist.
    #[arg(long)]
    pub force: bool,
}
