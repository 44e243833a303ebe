//! The command line of `vlscan campaign`.

use crate::options::OneOf;
use clap::Args;
use std::path::PathBuf;

/// `vlscan campaign`.
#[derive(Debug, Args)]
pub struct CampaignArgs {
    /// The campaign (.toml).
    pub file: PathBuf,
    /// Compute every N-th cell only, from cell K on, with K from 0 to N-1: for arrays of tasks, and where processes share a file
    /// system without locks.
    #[arg(long, value_name = "K/N")]
    pub task: Option<OneOf>,
    /// Compute this cell only; may be given more than once.
    #[arg(long, value_name = "NAME", conflicts_with = "task")]
    pub cell: Vec<String>,
    /// Write the names of the cells that are neither complete nor failed to stdout, and compute nothing.
    #[arg(long)]
    pub list: bool,
    /// Compute cells that have failed once more.
    #[arg(long)]
    pub retry: bool,
    /// Compare the checksums of all files of complete cells, too; at every start only sizes and times are. Cells with damaged files
    /// are computed again.
    #[arg(long)]
    pub verify: bool,
    /// Threads of this process; 0 or nothing = all.
    #[arg(short = 'j', long, value_name = "N")]
    pub threads: Option<usize>,
}
