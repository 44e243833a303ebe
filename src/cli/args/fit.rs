//! The command line of `vlscan fit`.

use clap::Args;
use std::path::PathBuf;

/// `vlscan fit`.
#[derive(Debug, Args)]
pub struct FitArgs {
    /// The recorded cloud: LAS or LAZ, or another format with GPS times and scan angles; - for stdin.
    pub cloud: PathBuf,
    /// The pipeline file to write; the trajectory gets its name with .trajectory.csv, the mirror's wander
    /// with .wander.txt, pulse times with .pulses.txt.
    #[arg(short, long = "output", value_name = "FILE.toml")]
    pub out: PathBuf,
    /// Fit the flight line of this point source; the one with the most points if it is not given.
    #[arg(long, value_name = "N")]
    pub flight_line: Option<u16>,
    /// Write the table of what was estimated as JSON.
    #[arg(long)]
    pub json: bool,
    /// Overwrite files that exist.
    #[arg(long)]
    pub force: bool,
}
