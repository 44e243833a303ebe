//! The command line: one file per subcommand, and the conversion of errors to reports and exit statuses.
//!
//! Data goes to stdout; messages, warnings and progress go to stderr, as text or as JSON.
//!
//! | file | contents |
//! |---|---|
//! | `args` | the command line of every subcommand |
//! | `helios` | command lines of HELIOS++ |
//! | `run` | `vlscan run`; conversion of arguments and files to a session's settings |
//! | `dry_run`, `coverage` | `vlscan run --dry-run`, and its `--coverage` |
//! | `stages` | `vlscan trajectory`, `pulses` and `trace` |
//! | `rig` | several scanners on one platform: their runs, the scene that they share |
//! | `shared_logs` | MCAP files that several scanners share |
//! | `companions` | what surrounds the work of a command: progress, files beside the points |
//! | `shards` | `vlscan run --shard`, `vlscan index-shards`, `vlscan merge` |
//! | `plan` | `vlscan plan` |
//! | `campaign` | `vlscan campaign` |
//! | `bench` | `vlscan bench` |
//! | `scene`, `info`, `map`, `pack` | `vlscan scene make` and `stand`, `info`, `map` and `pack` |
//! | `preview`, `compare`, `fit`, `unzip`, `catalogue` | the subcommands of these names |
//! | `cloud_info`, `raster`, `frames` | `vlscan info`, `vlscan raster` and `vlscan frames` |
//! | `serve` | `vlscan serve`, which starts vlscan-serve |
//! | `manual` | help, man pages, shell completions |
//! | `console`, `messages` | messages on stderr, and their form in JSON |
//! | `watch`, `interrupt` | progress, Ctrl-C |

mod args;
mod bench;
mod campaign;
mod catalogue;
mod cloud_info;
mod companions;
mod compare;
mod console;
mod coverage;
mod dry_run;
mod fit;
mod frames;
mod helios;
mod info;
mod interrupt;
mod manual;
mod map;
mod messages;
mod pack;
mod plan;
mod preview;
mod raster;
mod rig;
mod run;
mod scene;
mod serve;
mod shards;
mod shared_logs;
mod stages;
mod unzip;
mod watch;

pub use args::{Cli, Command};
pub use console::{Console, LogTo, Verbosity};
pub use info::scene_json;
pub use manual::command as command_line;
pub use messages::MessageFormat;

use clap::{ArgMatches, FromArgMatches};
use std::ffi::OsString;
use std::io::Write as _;
use std::path::Path;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::ReadGuard;
use vlscan_base::machine;
use vlscan_messages::{ProblemClass, ProblemMessage};

/// Runs the program with these arguments and returns its exit status: 0 success, 1 system error, 2 invalid
/// input or usage, 3 a scan frequency outside the scanner's limits, 4 a run that cannot be divided or
/// continued, 5 a folder that is in use, 130 interrupted.
pub fn main(args: impl IntoIterator<Item = OsString>) -> u8 {
    let args: Vec<OsString> = args.into_iter().collect();
    let console = Console::new(Verbosity::Normal).formatted(requested_format(&args), "");
    let mut repeated = Diagnostics::default();
    let words = match helios::translate_helios_args(args, &mut repeated) {
        Ok(words) => words,
        Err(error) => return status(Err(error), &console),
    };
    if words.len() < 2 {
        return status(printed(manual::command().print_help()), &console);
    }
    let (cli, name) = match parsed(&words) {
        Ok(parsed) => parsed,
        Err(message) if message.use_stderr() && console.is_json() => {
            console.problem(messages::of_usage(&message));
            return 2;
        }
        Err(message) => {
            // Help and version are output, not errors.
            let outcome = printed(message.print());
            return if message.use_stderr() { 2 } else { status(outcome, &console) };
        }
    };
    let console = match Console::new(cli.verbosity()).logging(cli.log()) {
        Ok(console) => console.strict(cli.strict.is_on()).formatted(cli.message_format, &name),
        Err(error) => return status(Err(error), &console),
    };
    console.start();
    report_panics(&console);
    interrupt::listen(&console);
    let _guard = ReadGuard::start();
    let outcome = console
        .warnings(&repeated)
        .and_then(|()| machine::start_pool())
        .and_then(|()| dispatch(&cli.command, &console));
    let outcome = match outcome {
        // A stopped run has given up a stream whose reader takes nothing.
        Err(Error::ClosedPipe) if interrupt::is_signalled() => Err(Error::Interrupted),
        outcome => outcome,
    };
    console.finish(outcome.is_ok());
    status(outcome, &console)
}

/// Parses a command line, and returns it with the full name of its command.
///
/// Examples and lists of the manual are only composed where help or an error is the result: composing them
/// takes longer than parsing.
fn parsed(words: &[OsString]) -> Result<(Cli, String), clap::Error> {
    let found = Cli::definition()
        .try_get_matches_from(words)
        .or_else(|_| manual::command().try_get_matches_from(words))?;
    Ok((Cli::from_arg_matches(&found)?, name_of(&found)))
}

/// The format of messages that the words of a command line request, before they are parsed.
fn requested_format(words: &[OsString]) -> MessageFormat {
    if messages::request_json(words) { MessageFormat::Json } else { MessageFormat::Text }
}

/// The full name of the command: `scene make`.
fn name_of(found: &ArgMatches) -> String {
    let mut names = Vec::new();
    let mut at = found;
    while let Some((name, inner)) = at.subcommand() {
        names.push(name);
        at = inner;
    }
    names.join(" ")
}

/// Writes panics as messages, if these are in JSON.
fn report_panics(console: &Console) {
    if console.is_json() {
        let console = console.clone();
        std::panic::set_hook(Box::new(move |panic| {
            console.problem(ProblemMessage {
                problem: ProblemClass::Internal,
                message: panic.to_string(),
                ..ProblemMessage::default()
            });
        }));
    }
}

/// Shows the error and returns the exit status. A reader that has closed its pipe causes no message.
fn status(outcome: Result<(), Error>, console: &Console) -> u8 {
    match outcome {
        Ok(()) => 0,
        Err(error) => {
            if !matches!(error, Error::ClosedPipe) {
                console.failure(&error);
            }
            error.exit_status()
        }
    }
}

fn dispatch(command: &Command, console: &Console) -> Result<()> {
    match command {
        Command::Run(args) => run::run(args, console),
        Command::IndexShards(args) => shards::index(args, console),
        Command::Merge(args) => shards::merge(args, console),
        Command::Campaign(args) => campaign::run(args, console),
        Command::Bench(args) => bench::run(args, console),
        Command::Trajectory(args) => stages::trajectory(args, console),
        Command::Pulses(args) => stages::pulses(args, console),
        Command::Trace(args) => stages::trace(args, console),
        Command::Scene(args) => scene::run(args, console),
        Command::Plan(args) => plan::run(args, console),
        Command::Catalogue(args) => catalogue::run(args, console),
        Command::Unzip(args) => unzip::run(args, console),
        Command::Fit(args) => fit::run(args, console),
        Command::Compare(args) => compare::run(args, console),
        Command::Info(args) => cloud_info::run(args, console),
        Command::Raster(args) => raster::run(args, console),
        Command::Frames(args) => frames::run(args, console),
        Command::Preview(args) => preview::run(args, console),
        Command::Serve(args) => serve::run(args, console),
        Command::Completions(args) => manual::completions(args),
        Command::Man(args) => manual::run(args, console),
    }
}

/// The outcome of printing something to standard output through its buffer.
fn printed(outcome: std::io::Result<()>) -> Result<(), Error> {
    let flushed = outcome.and_then(|()| std::io::stdout().flush());
    flushed.map_err(|e| Error::io("write", Path::new("standard output"), e))
}
