//! The program: parse, dispatch, exit status.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(vlscan::main(std::env::args_os()))
}
