//! The command line of `vlscan compare`.

use crate::options::{Count, Positive};
use clap::Args;
use std::path::PathBuf;

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
    /// Write a page with pictures and histograms, too.
    #[arg(long, value_name = "FILE.html")]
    pub page: Option<PathBuf>,
    /// Side of the cells of density and canopy height, m.
    #[arg(long, value_name = "M", default_value = "1")]
    pub cell: Positive,
    /// Side of the voxels whose occupancy is compared, m.
    #[arg(long, value_name = "M", default_value = "0.5")]
    pub voxel: Positive,
    /// Most points of each cloud whose distance to the other is measured, evenly chosen.
    #[arg(long, value_name = "N", default_value = "200k")]
    pub most_distances: Count<1>,
    /// Overwrite a page that exists.
    #[arg(long)]
    pub force: bool,
}
