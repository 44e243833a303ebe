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
    /// Write a page with pictures and histograms, too.
    #[arg(long, value_name = "FILE.html")]
    pub page: Option<PathBuf>,
    /// How the clouds are compared.
    #[command(flatten)]
    pub options: CompareOptions,
    /// Overwrite a page that exists.
    #[arg(long)]
    pub force: bool,
}
