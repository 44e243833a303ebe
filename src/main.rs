//! The program: parse, dispatch, exit status.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(vlscan::cli::main(std::env::args_os()))
}
