//! The command line as typed: nothing here touches the world.
//!
//! | file | what it holds |
//! |---|---|
//! | `simulate` | `run` and its stages: `trajectory`, `pulses`, `trace` |
//! | `plan` | `plan` |
//! | `campaign`, `compare`, `fit` | `campaign`, `compare`, `fit` |
//! | `clouds` | `info`, `raster`, `frames` |
//! | `scenes` | `scene make`, `scene stand`, `scene info`, `scene map`, `scene pack` |
//! | `tools` | everything else |

#![allow(
    rustdoc::broken_intra_doc_links,
    reason = "comments are shown as help, where units stand in brackets"
)]

mod campaign;
mod clouds;
mod compare;
mod fit;
mod plan;
mod scenes;
mod simulate;
mod tools;

pub use campaign::CampaignArgs;
pub use clouds::{CloudInfoArgs, FramesArgs, PointMemory, RasterArgs};
pub use compare::CompareArgs;
pub use fit::{FitArgs, FittedHalf};
pub use plan::PlanArgs;
pub use scenes::{
    InfoArgs, MakeArgs, MapArgs, PackArgs, ReconstructArgs, SceneArgs, SceneCommand, StandArgs,
};
pub use simulate::{
    DryRunArgs, EmitArgs, EmitFormat, IndexShardsArgs, InstrumentArgs, MergeArgs, PulsesArgs, RunArgs,
    SurveyArgs, TraceArgs, TrajectoryArgs,
};
pub use tools::{
    BenchArgs, CatalogueArgs, CatalogueCommand, CompletionsArgs, ListArgs, ManArgs, PreviewArgs, ServeArgs,
    ShowArgs, UnzipArgs,
};

use super::{LogTo, MessageFormat, Verbosity};
use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::{ArgAction, CommandFactory as _, Parser, Subcommand};
use std::path::PathBuf;
use vlscan_base::files::means_stdout;
use vlscan_options::{Switch, with_negative_numbers};

/// Returns a parser of the names of folders and of groups of files, which do not fit into one stream.
fn files() -> impl TypedValueParser<Value = PathBuf> {
    except_stdout("stdout cannot hold several files; name a file or folder")
}

/// Returns a parser of the names of files that are written besides points.
fn besides_points() -> impl TypedValueParser<Value = PathBuf> {
    except_stdout("stdout is for points; name a file")
}

/// Returns a parser of the names of files that are written besides a report on stdout.
fn besides_report() -> impl TypedValueParser<Value = PathBuf> {
    except_stdout("stdout holds the report; name a file")
}

/// Returns a parser of the names of files that are written at any place, which a stream cannot be.
fn on_disk() -> impl TypedValueParser<Value = PathBuf> {
    except_stdout("the file cannot be written sequentially, as stdout is; name a file")
}

fn except_stdout(reason: &'static str) -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(move |path| if means_stdout(&path) { Err(reason) } else { Ok(path) })
}

/// Virtual laser scanning for Unix pipes.
///
/// Flies a LiDAR instrument over a virtual scene and writes the point cloud that it would have measured.
/// Points go to files or stdout, messages and progress to stderr.
#[derive(Debug, Parser)]
#[command(name = "vlscan", version, propagate_version = true, max_term_width = 110)]
pub struct Cli {
    /// Command.
    #[command(subcommand)]
    pub command: Command,
    /// Report what each stage does and how long it takes.
    #[arg(short, long, global = true, action = ArgAction::Count)]
    pub verbose: u8,
    /// Treat every warning about the input as an error.
    #[arg(long, action = ArgAction::SetTrue, global = true)]
    pub strict: Switch,
    /// Report errors only.
    #[arg(short, long, global = true)]
    pub quiet: bool,
    /// Format of the messages on stderr: text for people, or one JSON object per line for programs.
    ///
    /// Lines of JSON are progress, warnings and errors with file, line, column and help, and at the end the
    /// files that were written. docs/messages.md describes them.
    #[arg(
        long,
        value_name = "FORMAT",
        value_enum,
        default_value = "text",
        global = true,
        hide_short_help = true
    )]
    pub message_format: MessageFormat,
    /// No messages.
    #[arg(long, global = true, hide = true)]
    pub silent: bool,
    /// Report stage times and errors.
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
    /// The command line of all commands.
    pub fn definition() -> clap::Command {
        with_negative_numbers(Cli::command())
    }

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

    /// Destination of messages.
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
    /// Plan a survey: flight lines over an area, tripod positions, or a drive.
    ///
    /// The plan is a pipeline file whose comments state duration, pulses, density, spacing and footprint.
    Plan(PlanArgs),
    /// Index where the shards of a run begin, once for all shards.
    ///
    /// The command line is that of vlscan run --shard without --shard. It writes the file flight.vlindex to
    /// the folder -o, for any number of shards. Without it the first shard that is computed writes that file.
    #[command(alias = "plan-parts")]
    IndexShards(Box<IndexShardsArgs>),
    /// Merge the shards of a run into its outputs.
    ///
    /// The outputs are byte for byte those of one vlscan run with the same output options: every format, one
    /// file per leg, HELIOS++'s layout, trajectories, and waveforms and pulses if the shards contain them.
    /// Neither survey nor scene is needed. Shards of another version, survey, scene, seed or options are
    /// rejected, and missing ones are listed in the form that array jobs take.
    Merge(Box<MergeArgs>),
    /// Make a data set: one run for every scene, variant and seed of a matrix.
    ///
    /// Any number of processes can work on the same file, on one machine or on many that share the folder;
    /// each takes cells that no other has taken. Complete cells are kept: run the same command again to
    /// continue. A cell that fails is recorded with its message and does not stop the others. The bytes of
    /// the data set do not depend on where its cells were computed.
    Campaign(CampaignArgs),
    /// Measure how fast a survey runs on this machine, comparing threads, schedules, chunk sizes and trees.
    Bench(Box<BenchArgs>),
    /// Fly a survey or pipeline and write the platform's poses to stdout.
    ///
    /// One line per pose after a header: time[s] of the GPS week, x[m],y[m],z[m] of the platform in world
    /// coordinates, roll[deg],pitch[deg],yaw[deg] as in aeronautics (yaw clockwise from +y, right wing down
    /// and nose up positive, roll innermost), as --trajectory reads them. Legs whose scanner is switched off
    /// have no poses.
    ///
    /// With --format arrow an Arrow IPC stream with columns of the same names, which --trajectory also reads.
    Trajectory(Box<TrajectoryArgs>),
    /// Fly a survey or pipeline and write its pulses to stdout instead of tracing them.
    ///
    /// One line per pulse after a header that names the columns and their units: time, origin and direction
    /// in world coordinates, leg, device, number of the pulse, and what `vlscan trace` needs to get the same
    /// echoes bit for bit: the beam's quaternion, the scan angle, the last bits of the coordinates. With
    /// --format arrow an Arrow IPC stream with the same columns, which is smaller and faster. The scene is
    /// loaded as well, for its coordinate frame and for legs on the ground.
    Pulses(Box<PulsesArgs>),
    /// Read pulses, trace them through a scene and write the echoes.
    ///
    /// The pulses come from `vlscan pulses` or any other program: comma-separated or blank-separated values
    /// with a header of names, of which x, y, z and dx, dy, dz (or azimuth_deg, clockwise from +y, and
    /// elevation_deg) are needed; without a header the columns are time, x, y, z, dx, dy, dz. Units follow
    /// the names, as in time[ns] or scan_angle[deg]; without one they are s, m and rad. An uncompressed Arrow
    /// IPC stream or file with columns of these names, whole or floating-point, is recognised by its first
    /// bytes; units are in the names or in the columns' metadata (key unit).
    ///
    /// With a survey as --scanner the echoes are those of `vlscan run`, bit for bit; seed, legs and strips
    /// come from it. With a scanner alone they are as well if --seed and the options of the physics match the
    /// run: then --physics defaults to refined, whereas runs of XML surveys default to helios. Give --physics
    /// and --correct to `vlscan pulses`, too: they change its kinematics.
    Trace(Box<TraceArgs>),
    /// Make scenes, place trees by an inventory, show what a scene contains, pack it.
    Scene(SceneArgs),
    /// List the built-in scanners and platforms.
    Catalogue(CatalogueArgs),
    /// Expand compressed text (.bin) to plain text.
    Unzip(UnzipArgs),
    /// Draw a point cloud: a picture from above and from the side, or an interactive page.
    Preview(PreviewArgs),
    /// Estimate a flight and its scanner from a recorded point cloud, or a spinning sensor from one
    /// revolution, and write a pipeline file.
    ///
    /// The cloud needs GPS times and scan angles, as LAS and LAZ have them, and all pulses of a flight line.
    /// Cones (Palmer scanners), polygon mirrors and oscillating mirrors are told apart. Beside the pipeline
    /// file are written the trajectory, the wander of a cone's mirror and, if the pulse rate is not constant,
    /// the times of the pulses; stdout gets a table of what was estimated, with standard deviations.
    ///
    /// With --still-at the cloud is that of a sensor that stood still, and its scan pattern is written.
    Fit(FitArgs),
    /// Compare two point clouds of one place: measured and simulated, or two runs.
    ///
    /// Within the box that both cover: density, height percentiles, canopy height and intensity histograms,
    /// returns, distances from cloud to cloud, occupied voxels. Heights are above the lowest point of both
    /// clouds within squares of 5 m.
    Compare(CompareArgs),
    /// Describe a point cloud: count, density, extent, coordinate system, classes, returns, times, flight
    /// lines.
    ///
    /// Densities are over the area of square cells with points, the smallest that have ten points on average.
    /// The time kind, version and point format are those of the headers of LAS.
    Info(CloudInfoArgs),
    /// Rasterise a point cloud: terrain, surface, canopy height, densities as GeoTIFF.
    ///
    /// Cells without a value are NaN, which is also stated as the value for no data. Points of the noise
    /// classes 7 and 18 and pulses without a return are left out.
    Raster(RasterArgs),
    /// Write the frames of an MCAP file in the layout of a data set: KITTI or nuScenes.
    ///
    /// A frame is a revolution of a spinning scanner, or as vlscan run --frame-s says. Its points are moved
    /// to where the scanner was at its first point, by the poses on /tf; its pose takes them to the
    /// coordinates of the scene.
    Frames(FramesArgs),
    /// Offer runs, plans, comparisons and pictures as a service, with pages for a browser.
    ///
    /// The service is a program of its own, vlscan-serve, which this command starts: it is looked for beside
    /// vlscan and then in the folders of PATH. Without options it listens on the loopback address only.
    /// docs/service.md describes pages, interface and limits.
    #[command(disable_help_flag = true)]
    Serve(ServeArgs),
    /// Write shell completions for this command line to stdout.
    Completions(CompletionsArgs),
    /// Write the manual pages.
    #[command(hide = true)]
    Man(ManArgs),
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::command_line;
    use clap::Command;
    use clap::error::ErrorKind;
    use std::any::TypeId;

    /// The name of the opposite of a switch.
    fn opposite(long: &str) -> String {
        long.strip_prefix("no-").map_or_else(|| format!("no-{long}"), str::to_owned)
    }

    /// All subcommands with their names before them.
    fn commands(command: &Command, before: &[String]) -> Vec<(Vec<String>, Command)> {
        let mut all = vec![(before.to_vec(), command.clone())];
        for sub in command.get_subcommands() {
            let names = [before, &[sub.get_name().to_owned()]].concat();
            all.extend(commands(sub, &names));
        }
        all
    }

    #[test]
    fn negative_numbers_are_values_that_options_refuse_by_what_they_expect() {
        for (line, expected) in [
            ("vlscan raster a.las --dsm s.tif --cell -1", "expected a number above 0"),
            ("vlscan run a.xml --tile -5", "expected a number above 0"),
            ("vlscan run a.xml --threads -1", "expected a whole number, 0 or greater"),
            ("vlscan run a.xml --max-memory -1", "expected a number of bytes"),
            ("vlscan scene make forest -n -5 -o f", "expected a number such as"),
            ("vlscan preview a.las -o p.png --width -5", "-5 is not in 320..=16384"),
        ] {
            let refused = Cli::definition().try_get_matches_from(line.split(' ')).unwrap_err();
            assert_eq!(refused.kind(), ErrorKind::ValueValidation, "{line}: {refused}");
            assert!(refused.to_string().contains(expected), "{line}: {refused}");
        }
        assert!(Cli::definition().try_get_matches_from(["vlscan", "run", "a.xml", "--seed", "-5"]).is_ok());
    }

    #[test]
    fn every_switch_of_a_file_is_undone_by_its_opposite() {
        let mut found = 0;
        for (names, command) in commands(&command_line(), &[]).into_iter().skip(1) {
            for arg in command.get_arguments() {
                let id = arg.get_id().as_str();
                // `--strict` of commands that read no file is that of the program.
                if arg.is_global_set() || arg.get_value_parser().type_id() != TypeId::of::<Switch>() {
                    continue;
                }
                let on = format!("--{}", arg.get_long().unwrap());
                let off = format!("--{}", opposite(arg.get_long().unwrap()));
                let parsed = |words: &[&str]| {
                    let command = command.clone().no_binary_name(true).ignore_errors(true);
                    *command.try_get_matches_from(words).unwrap().get_one::<Switch>(id).unwrap()
                };
                let message = format!("{names:?} {on}");
                assert_eq!(parsed(&[]), Switch::Unset, "{message}");
                assert_eq!(parsed(&[&on]), Switch::On, "{message}");
                assert_eq!(parsed(&[&off]), Switch::Off, "{message}");
                assert_eq!(parsed(&[&on, &off]), Switch::Off, "{message}");
                assert_eq!(parsed(&[&off, &on]), Switch::On, "{message}");
                let unknown = command.clone().no_binary_name(true).try_get_matches_from([&off]);
                assert!(unknown.err().is_none_or(|e| e.kind() != ErrorKind::UnknownArgument), "{message}");
                found += 1;
            }
        }
        assert!(found > 60, "{found}");
    }
}
