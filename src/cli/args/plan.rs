//! The command line of `vlscan plan`.

use clap::Args;
use vlscan_tools::plan::PlanRequest;

/// `vlscan plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// Kind of the survey.
    #[command(subcommand)]
    pub request: PlanRequest,
}
