//! The command line of `vlscan campaign`.

use clap::Args;
use std::path::PathBuf;
use vlscan_campaign::CampaignOptions;

/// `vlscan campaign`.
#[derive(Debug, Args)]
pub struct CampaignArgs {
    /// The campaign (.toml).
    pub file: PathBuf,
    /// Selection of the cells, and how they are computed.
    #[command(flatten)]
    pub options: CampaignOptions,
    /// List the cells that are neither complete nor failed, and compute nothing.
    #[arg(long)]
    pub list: bool,
}
