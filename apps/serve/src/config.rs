//! The command line of the service, and what it allows.

#![allow(
    rustdoc::broken_intra_doc_links,
    reason = "comments are shown as help, where defaults stand in brackets"
)]

use clap::{Args, Parser, Subcommand};
use std::net::SocketAddr;
use std::path::PathBuf;

/// vlscan as a service: an interface for programs (OGC API - Processes) and pages for a browser.
///
/// Listens on the loopback address unless --listen names another one, for which tokens are compulsory.
/// docs/service.md describes the interface, its limits and what protects it.
#[derive(Debug, Parser)]
#[command(name = "vlscan serve", bin_name = "vlscan serve", version, max_term_width = 110)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Cli {
    /// Command instead of serving.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Options of the service.
    #[command(flatten)]
    pub serve: ServeArgs,
}

/// Subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make a token: prints it to stderr, once, and the line for the token file to stdout.
    Token {
        /// Owner of the token: letters, digits, - and _.
        owner: String,
        /// Pulses that the owner may have computed within 24 hours; 10M and 2G are understood. [default:
        /// --quota]
        #[arg(long, value_name = "PULSES", value_parser = amount)]
        quota: Option<u64>,
    },
    /// Check the folder, database and bucket of a service that does not run, and change nothing: integrity,
    /// version, ids, files that are missing, and files that the database does not list. Exits with status 1
    /// if there is a problem.
    Check(CheckArgs),
    /// Restrict this process and execute a program in its place: how the service starts vlscan.
    Confine(ConfineArgs),
    /// Compute a task of a job that an engine was given: what the service hands in.
    Task(TaskArgs),
    /// Expand a zip archive within limits: what the service starts for archives among uploads.
    #[command(hide = true)]
    Expand(ExpandArgs),
}

/// Subject of the check.
#[derive(Clone, Debug, Args)]
pub struct CheckArgs {
    /// Folder of the service.
    #[arg(long, value_name = "DIR", default_value = "vlscan-service")]
    pub data: PathBuf,
    /// Bucket of the service, if it has one: s3://BUCKET/PREFIX.
    #[arg(long, value_name = "URL")]
    pub store: Option<String>,
}

/// A task of a job.
#[derive(Clone, Debug, Args)]
pub struct TaskArgs {
    /// The file with what the engine was given.
    pub submission: PathBuf,
    /// Number of the task, from 0. [default: SLURM_ARRAY_TASK_ID, JOB_COMPLETION_INDEX, PBS_ARRAY_INDEX or
    /// AWS_BATCH_JOB_ARRAY_INDEX, else 0]
    #[arg(long, value_name = "K")]
    pub number: Option<u32>,
}

/// An archive and its limits.
#[derive(Clone, Debug, Args)]
pub struct ExpandArgs {
    /// The archive.
    pub archive: PathBuf,
    /// The folder of its files.
    pub folder: PathBuf,
    /// Bytes of all files.
    #[arg(long, value_name = "BYTES")]
    pub max_bytes: u64,
    /// Number of files.
    #[arg(long, value_name = "N")]
    pub max_files: usize,
    /// Only print the size that the directory of the archive states, as JSON.
    #[arg(long)]
    pub size: bool,
}

/// Options of the service.
#[derive(Clone, Debug, Args)]
pub struct ServeArgs {
    /// Folder of uploads, jobs and their database; made if it does not exist.
    #[arg(long, value_name = "DIR", default_value = "vlscan-service")]
    pub data: PathBuf,
    /// Address and port; port 0 is any free one. An address other than the loopback needs tokens.
    #[arg(long, value_name = "ADDR:PORT", default_value = "127.0.0.1:8080")]
    pub listen: SocketAddr,
    /// File with a line per token, as `vlscan serve token OWNER` prints it. The environment variable
    /// VLSCAN_TOKEN is a single token instead, that of the owner `admin`.
    #[arg(long, value_name = "FILE")]
    pub token_file: Option<PathBuf>,
    /// Names under which browsers reach the service, if it is behind a proxy or has no tokens; may be given
    /// more than once. Names other than localhost need tokens, or --open.
    #[arg(long, value_name = "NAME", value_parser = clap::builder::NonEmptyStringValueParser::new())]
    pub host: Vec<String>,
    /// Serve everybody who reaches the names of --host, without tokens.
    #[arg(long, requires = "host", conflicts_with = "token_file")]
    pub open: bool,
    /// Jobs that are computed at the same time, besides two plans, forecasts or other jobs that answer
    /// requests; 0 only queues them. Owners take turns.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub workers: usize,
    /// Threads of a job; 0 = all.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub threads: usize,
    /// Address space of a job.
    #[arg(long, value_name = "BYTES", default_value = "8G", value_parser = amount)]
    pub max_memory: u64,
    /// Time of a job, seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 3600)]
    pub max_time: u64,
    /// Files of a job.
    #[arg(long, value_name = "BYTES", default_value = "20G", value_parser = amount)]
    pub max_disk: u64,
    /// An upload, before and after archives are expanded.
    #[arg(long, value_name = "BYTES", default_value = "2G", value_parser = amount)]
    pub max_upload: u64,
    /// Files of an upload.
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    pub max_files: usize,
    /// Disk space of the uploads and jobs of an owner, failed jobs and the database included; 4 KiB for each
    /// file besides its content.
    #[arg(long, value_name = "BYTES", default_value = "100G", value_parser = amount)]
    pub max_stored: u64,
    /// Remove finished jobs and their results after so many days. [default: keep them]
    #[arg(long, value_name = "DAYS", value_parser = days)]
    pub keep: Option<f64>,
    /// Jobs of an owner that wait or run.
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    pub max_queued: usize,
    /// Pulses that an owner may have computed within 24 hours. Runs are priced by a dry run before they
    /// start. [default: unlimited]
    #[arg(long, value_name = "PULSES", value_parser = amount)]
    pub quota: Option<u64>,
    /// Run jobs without the sandbox of the system, on the loopback address only: their files can then name
    /// any file that this user can read.
    #[arg(long)]
    pub no_sandbox: bool,
    /// Keep the files of uploads and results in a bucket of an S3-compatible store: s3://BUCKET/PREFIX. The
    /// variables AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION and AWS_ENDPOINT tell the rest.
    /// [default: in the folder --data]
    #[arg(long, value_name = "URL")]
    pub store: Option<String>,
    /// Have runs and campaigns computed by an existing engine, such as Slurm: the command that hands a job
    /// in, executed without a shell. Placeholders: {name}, {tasks}, {last} (= tasks - 1), {command},
    /// {folder}, {minutes}, {megabytes}. Needs --poll and --cancel.
    #[arg(long, value_name = "COMMAND", requires_all = ["poll", "cancel"], help_heading = "Engine")]
    pub submit: Option<String>,
    /// The command that prints something while the engine has the job {name}, and nothing otherwise.
    #[arg(long, value_name = "COMMAND", requires = "submit", help_heading = "Engine")]
    pub poll: Option<String>,
    /// The command that cancels the job {name}.
    #[arg(long, value_name = "COMMAND", requires = "submit", help_heading = "Engine")]
    pub cancel: Option<String>,
    /// Parts of a run or campaign, each computed by a task of the engine.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=10_000), help_heading = "Engine")]
    pub parts: u32,
    /// The program vlscan. [default: beside this one, else in the folders of PATH]
    #[arg(long, value_name = "PATH", env = "VLSCAN_PROGRAM", hide_env = true)]
    pub program: Option<PathBuf>,
}

/// Restrictions of a process, and the program that it then becomes.
#[derive(Clone, Debug, Default, Args, serde::Serialize, serde::Deserialize)]
pub struct ConfineArgs {
    /// File or folder that may be read; may be given more than once.
    #[arg(long, value_name = "PATH")]
    pub read: Vec<PathBuf>,
    /// Folder that may be read and written; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub write: Vec<PathBuf>,
    /// Address space.
    #[arg(long, value_name = "BYTES", value_parser = amount)]
    pub memory: Option<u64>,
    /// Processor time of all threads, seconds.
    #[arg(long, value_name = "SECONDS")]
    pub time: Option<u64>,
    /// Size of a file.
    #[arg(long, value_name = "BYTES", value_parser = amount)]
    pub file_size: Option<u64>,
    /// Only the limits, without the sandbox of the system.
    #[arg(long)]
    pub no_sandbox: bool,
    /// The program and its arguments. Without one, prints what this system allows.
    #[arg(last = true, value_name = "PROGRAM")]
    pub program: Vec<std::ffi::OsString>,
}

/// A text that is not a value of an option.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AmountError {
    /// A text that is not an amount.
    #[error("`{0}`: expected a whole number such as 500k, 10M, 2G or 1T")]
    Amount(String),
    /// A text that is not a number of days.
    #[error("`{0}`: expected a number of days above 0")]
    Days(String),
}

/// A number, perhaps with k, M, G or T for thousands, millions, billions, trillions.
///
/// # Errors
/// Expected value.
pub fn amount(text: &str) -> Result<u64, AmountError> {
    let (digits, factor) = match text.char_indices().last() {
        Some((at, 'k')) => (&text[..at], 1_000),
        Some((at, 'M')) => (&text[..at], 1_000_000),
        Some((at, 'G')) => (&text[..at], 1_000_000_000),
        Some((at, 'T')) => (&text[..at], 1_000_000_000_000),
        _ => (text, 1),
    };
    let number: Option<u64> = digits.parse().ok();
    let number = number.and_then(|number| number.checked_mul(factor));
    number.ok_or_else(|| AmountError::Amount(text.to_owned()))
}

/// A number of days above 0.
///
/// # Errors
/// Expected value.
fn days(text: &str) -> Result<f64, AmountError> {
    let days: Option<f64> = text.parse().ok().filter(|days: &f64| *days > 0.0 && *days <= 100_000.0);
    days.ok_or_else(|| AmountError::Days(text.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[test]
    fn the_command_line_holds_together() {
        Cli::command().debug_assert();
        assert!(
            Cli::try_parse_from(["vlscan serve", "--quota", "2G"]).unwrap().serve.quota
                == Some(2_000_000_000)
        );
        assert!(Cli::try_parse_from(["vlscan serve", "--max-disk", "2 GB"]).is_err());
        assert!(amount("99999999999T").is_err() && amount("").is_err() && amount("k").is_err());
    }
}
