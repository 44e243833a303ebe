//! `vlscan completions`: the shell's completion script for the command line.

use super::args::CompletionsArgs;
use super::manual;
use crate::error::{Error, Result};
use std::io::Write;

pub fn run(args: &CompletionsArgs) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut manual::command(), "vlscan", &mut script);
    let written = std::io::stdout().lock().write_all(&script);
    written.map_err(|e| Error::io("write", "<stdout>", e))
}
