//! `vlscan serve`: starts the program of the service, which has the network that this program lacks.

use super::Console;
use super::args::ServeArgs;
use std::path::{Path, PathBuf};
use std::process::Command;
use vlscan_base::error::{Error, Result};

/// Name of the program of the service.
const PROGRAM: &str = if cfg!(windows) { "vlscan-serve.exe" } else { "vlscan-serve" };

pub fn run(args: &ServeArgs, console: &Console) -> Result<()> {
    if console.is_json() {
        return Err(Error::input(
            "--message-format cannot be used with vlscan serve, which has a log of its own",
        ));
    }
    let Some(program) = program() else {
        return Err(Error::input_with_help(
            "vlscan serve needs the program vlscan-serve, which is neither beside vlscan nor in a folder of \
             PATH",
            "install it with `cargo install --locked --path apps/serve`",
        ));
    };
    let mut command = Command::new(&program);
    command.args(&args.options);
    if let Ok(own) = std::env::current_exe() {
        command.env("VLSCAN_PROGRAM", own);
    }
    execute(command, &program)
}

/// The program next to this one, otherwise the first in the folders of PATH.
fn program() -> Option<PathBuf> {
    let own = std::env::current_exe().ok();
    let own_folder = own.as_deref().and_then(Path::parent).map(Path::to_path_buf);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = own_folder.into_iter().chain(std::env::split_paths(&path));
    folders.map(|folder| folder.join(PROGRAM)).find(|program| program.is_file())
}

/// Replaces this process by the service, so that signals reach it.
#[cfg(unix)]
fn execute(mut command: Command, program: &Path) -> Result<()> {
    use std::os::unix::process::CommandExt as _;
    Err(Error::io("start", program, command.exec()))
}

/// Runs the service and ends with its status.
#[cfg(not(unix))]
fn execute(mut command: Command, program: &Path) -> Result<()> {
    let status = command.status().map_err(|e| Error::io("start", program, e))?;
    std::process::exit(status.code().unwrap_or(1))
}
