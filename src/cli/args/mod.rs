//! The command line as typed: nothing here touches the world.
//!
//! | file | what it holds |
//! |---|---|
//! | `groups` | options that several commands take |
//! | `poses` | how a recorded trajectory is read |
//! | `river` | `run` and its stages: `trajectory`, `pulses`, `trace` |
//! | `scenes` | `scene make`, `scene info`, `scene pack` |
//! | `tools` | everything else |

mod groups;
mod poses;
mod river;
mod scenes;
mod tools;

pub use groups::{
    FlightArgs, InputArgs, InstrumentArgs, OriginArgs, OutputArgs, PhysicsArgs, PhysicsProfile, ProfileArgs,
    ScheduleArgs, ScheduleKind, TreeArgs, TreeKind,
};
pub use poses::PoseArgs;
pub use river::{
    CommonArgs, EmitArgs, EmitFormat, PulsesArgs, RunArgs, SurveyArgs, TraceArgs, TrajectoryArgs,
};
pub use scenes::{InfoArgs, MakeArgs, PackArgs, SceneArgs, SceneCommand, SceneKind};
pub use tools::{BenchArgs, CatalogueArgs, Colour, CompletionsArgs, ManArgs, PreviewArgs, UnzipArgs};

use super::{LogTo, Verbosity};
use clap::{ArgAction, Parser, Subcommand};

/// Virtual laser scanning for Unix pipes.
///
/// Flies a LiDAR instrument over a virtual scene and emits the point cloud that it would have measured. Points go to files
/// or stdout, messages and progress to stderr.
#[derive(Debug, Parser)]
#[command(name = "vlscan", version, propagate_version = true, max_term_width = 110)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Say what each stage does and how long it takes.
    #[arg(short, long, global = true, action = ArgAction::Count)]
    pub verbose: u8,
    /// Say nothing but errors.
    #[arg(short, long, global = true)]
    pub quiet: bool,
    /// Say nothing at all.
    #[arg(long, global = true, hide = true)]
    pub silent: bool,
    /// Say how long each stage takes, and errors.
    #[arg(long, global = true, hide = true)]
    pub times: bool,
    /// Write all messages to helios_TIME.log in the working folder, too.
    #[arg(long, global = true, hide = true)]
    pub log_file: bool,
    /// Write all messages to helios_TIME.log in the working folder and none to stderr.
    #[arg(long, global = true, hide = true)]
    pub log_file_only: bool,
}

impl Cli {
    /// The verbosity that the flags ask for.
    pub fn verbosity(&self) -> Verbosity {
        match (self.silent, self.quiet, self.verbose, self.times) {
            (true, ..) => Verbosity::Silent,
            (_, true, ..) => Verbosity::Errors,
            (_, _, 0 | 1, true) => Verbosity::Times,
            (_, _, 0, _) => Verbosity::Normal,
            _ => Verbosity::Verbose,
        }
    }

    /// Where messages go.
    pub fn log(&self) -> LogTo {
        match (self.log_file, self.log_file_only) {
            (_, true) => LogTo::File,
            (true, _) => LogTo::Both,
            _ => LogTo::Stderr,
        }
    }
}

/// Subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Fly a HELIOS++ survey (.xml) or a pipeline (.toml) and write its point cloud.
    Run(Box<RunArgs>),
    /// Compare trees, schedules, chunk sizes and numbers of threads on a survey.
    Bench(Box<BenchArgs>),
    /// Fly a survey or pipeline and write the platform's poses to stdout.
    Trajectory(Box<TrajectoryArgs>),
    /// Fly a survey or pipeline and write every pulse to stdout instead of tracing it.
    Pulses(Box<PulsesArgs>),
    /// Read pulses, trace them through a scene and write the echoes.
    Trace(Box<TraceArgs>),
    /// Make scenes to try things with.
    Scene(SceneArgs),
    /// List the scanners and platforms that ship.
    Catalogue(CatalogueArgs),
    /// Expand compressed text (.bin) to the text that it holds.
    Unzip(UnzipArgs),
    /// Draw a point cloud: a picture from above and from the side, or a page to turn around.
    Preview(PreviewArgs),
    /// Write what a shell needs to complete this command line to stdout.
    Completions(CompletionsArgs),
    /// Write the manual pages.
    #[command(hide = true)]
    Man(ManArgs),
}
