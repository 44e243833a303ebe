//! `vlscan completions`: the shell's completion script for the command line.

use super::args::CompletionsArgs;
use super::manual;
use vlscan_base::error::Result;
use vlscan_base::files::{FileWriter, Patched};

pub fn run(args: &CompletionsArgs) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut manual::command(), "vlscan", &mut script);
    FileWriter::stdout(Patched::Never)?.append(&script)
}
