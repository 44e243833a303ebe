//! The command line of `vlscan compare`.

use super::PointMemory;
use clap::Args;
use std::path::PathBuf;
use vlscan_tools::compare::CompareOptions;

/// `vlscan compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The first cloud, usually the measured one: LAS, LAZ, PLY, PCD, E57, PTS, MCAP, text, Arrow or
    /// Parquet, - for stdin.
    pub first: PathBuf,
    /// The second cloud, usually the simulated one.
    pub second: PathBuf,
    /// Write the result as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// Also write a page with tables, charts and pictures.
    #[arg(long, value_name = "FILE.html", value_parser = super::besides_report())]
    pub page: Option<PathBuf>,
    /// Also write the change from the first to the second cloud as GeoTIFF: the difference of the ground in
    /// each cell, m.
    #[arg(long, value_name = "FILE.tif", value_parser = super::besides_report())]
    pub change: Option<PathBuf>,
    /// Also write the points that are new (class 64) or gone (class 65) in the second cloud, for example as
    /// LAZ.
    #[arg(long, value_name = "FILE", value_parser = super::besides_report())]
    pub changed: Option<PathBuf>,
    /// How the clouds are compared.
    #[command(flatten)]
    pub options: CompareOptions,
    /// Memory of both clouds.
    #[command(flatten)]
    pub memory: PointMemory,
    /// Replace existing files.
    #[arg(long)]
    pub force: bool,
}
