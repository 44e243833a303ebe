//! The program vlscan-serve, which `vlscan serve` starts.

use clap::Parser as _;
use std::error::Error;
use std::process::ExitCode;
use vlscan_serve::config::{Cli, Command};
use vlscan_serve::{archives, confine, inspect, server, tasks, tokens};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let done: Result<(), Box<dyn Error>> = match &cli.command {
        None => server::serve(&cli.serve).map_err(Into::into),
        Some(Command::Token { owner, quota }) => tokens::make(owner, *quota)
            .map(|(token, line)| {
                eprintln!("the token of {owner}, which is shown only now: {token}");
                println!("{line}");
            })
            .map_err(Into::into),
        Some(Command::Check(args)) => match inspect::inspect(args) {
            Ok(report) => {
                print!("{}", report.text);
                if report.problems > 0 {
                    return ExitCode::FAILURE;
                }
                Ok(())
            }
            Err(error) => Err(error.into()),
        },
        Some(Command::Task(args)) => tasks::run(args).map_err(Into::into),
        Some(Command::Expand(args)) => archives::expand(args).map_err(Into::into),
        Some(Command::Confine(args)) => confine::confine(args).map_err(Into::into),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}
