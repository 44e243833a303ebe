//! The command line of `vlscan plan`.

use clap::Args;
use vlscan_tools::plan::PlanRequest;

/// `vlscan plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// What kind of survey.
    #[command(subcommand)]
    pub request: PlanRequest,
}
