//! The command line of `vlscan run` and of its stages: `vlscan trajectory`, `vlscan pulses`, `vlscan trace`.

use super::{
    FlightArgs, InputArgs, InstrumentArgs, OriginArgs, OutputArgs, PhysicsArgs, ProfileArgs, ScheduleArgs,
    TreeArgs,
};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// What every command of the river lets one choose.
#[derive(Clone, Debug, Default, Args)]
pub struct CommonArgs {
    /// What is read.
    #[command(flatten)]
    pub input: InputArgs,
    /// What everything depends on.
    #[command(flatten)]
    pub origin: OriginArgs,
    /// How the work is done.
    #[command(flatten)]
    pub schedule: ScheduleArgs,
}

/// What is flown and how.
#[derive(Clone, Debug, Args)]
pub struct SurveyArgs {
    /// The survey (.xml) or pipeline (.toml).
    pub file: PathBuf,
    /// Where the platform is.
    #[command(flatten)]
    pub flight: FlightArgs,
    /// What every command of the river lets one choose.
    #[command(flatten)]
    pub common: CommonArgs,
}

/// `vlscan run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Points and what is written beside them.
    #[command(flatten)]
    pub output: OutputArgs,
    /// What is flown and how.
    #[command(flatten)]
    pub survey: SurveyArgs,
    /// How echoes are computed.
    #[command(flatten)]
    pub physics: PhysicsArgs,
    /// How the scene is kept.
    #[command(flatten)]
    pub tree: TreeArgs,
    /// Write the platform's poses as often as the survey's trajectoryTimeInterval_s asks for (CSV, as --trajectory reads
    /// it).
    #[arg(long, value_name = "PATH", help_heading = "Output")]
    pub trajectory_out: Option<PathBuf>,
}

/// How poses and pulses are written.
#[derive(Clone, Debug, Default, Args)]
pub struct EmitArgs {
    /// Lines of comma-separated values, or an Arrow IPC stream with the same columns.
    #[arg(long, value_name = "FORMAT", value_enum, default_value = "csv", help_heading = "Output")]
    pub format: EmitFormat,
    /// Write Arrow to a terminal.
    #[arg(long, help_heading = "Output")]
    pub force: bool,
}

/// Format of what stages hand to one another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum EmitFormat {
    /// Comma-separated values after a line of names and units.
    #[default]
    Csv,
    /// Arrow IPC stream; each column's unit is in its metadata.
    Arrow,
}

/// `vlscan trajectory`.
#[derive(Debug, Args)]
#[command(
    long_about = "Fly a survey or pipeline and write the platform's poses to stdout.\n\nOne line per pose after a header: \
time[s] of the GPS week, x[m],y[m],z[m] of the platform in world coordinates, roll[deg],pitch[deg],yaw[deg] as in \
aeronautics (yaw clockwise from +y, right wing down and nose up positive, roll innermost), which is what --trajectory reads. Legs whose scanner \
is switched off have no poses.\n\nWith --format arrow an Arrow IPC stream with columns of these names, which \
--trajectory reads, too."
)]
pub struct TrajectoryArgs {
    /// What is flown and how.
    #[command(flatten)]
    pub survey: SurveyArgs,
    /// Seconds from pose to pose. [default: the survey's trajectoryTimeInterval_s, else 0.05]
    #[arg(long, value_name = "SECONDS", help_heading = "Output")]
    pub interval: Option<f64>,
    /// Write the poses that were flown, not those that are reported with --navigation-error or [navigation_errors].
    #[arg(long = "true", help_heading = "Output")]
    pub flown: bool,
    /// Where the kinematics depart from the reference's.
    #[command(flatten)]
    pub profile: ProfileArgs,
    /// How poses are written.
    #[command(flatten)]
    pub emit: EmitArgs,
}

/// `vlscan pulses`.
#[derive(Debug, Args)]
#[command(
    long_about = "Fly a survey or pipeline and write every pulse to stdout instead of tracing it.\n\nOne line per pulse \
after a header that names the columns and their units: time, origin and direction in world coordinates, leg, device, \
number of the pulse, and what `vlscan trace` needs to get the same echoes bit for bit: the beam's quaternion, the scan \
angle, the last bits of the coordinates. With --format arrow an Arrow IPC stream with the same columns, which is \
smaller and quicker. The scene is loaded too, for its frame and for legs on the ground."
)]
pub struct PulsesArgs {
    /// What is flown and how.
    #[command(flatten)]
    pub survey: SurveyArgs,
    /// Where the kinematics depart from the reference's.
    #[command(flatten)]
    pub profile: ProfileArgs,
    /// How pulses are written.
    #[command(flatten)]
    pub emit: EmitArgs,
}

/// `vlscan trace`.
#[derive(Debug, Args)]
#[command(
    long_about = "Read pulses, trace them through a scene and write the echoes.\n\nThe pulses come from `vlscan pulses` or \
from any program that writes them: comma-separated (or blank-separated) values with a header of names, of which x, y, z \
and dx, dy, dz are needed; without a header the columns are time, x, y, z, dx, dy, dz. Units stand behind the names, as in \
time[ns] or scan_angle[deg]; without one they are s, m and rad. An uncompressed Arrow IPC stream or file with columns of \
these names, whole or floating-point, is recognised by its first bytes; units are in the names or in the columns' metadata \
(key unit).

With a survey as --scanner the echoes are those of `vlscan run`, bit for bit; seed, legs and strips come from it. With \
the scanner alone they are, too, when --seed and the options of the physics are those of the run; --physics and --correct are for `vlscan pulses` as well, whose \
kinematics they change."
)]
pub struct TraceArgs {
    /// The pulses; - for stdin.
    #[arg(value_name = "PULSES", default_value = "-")]
    pub stream: PathBuf,
    /// What receives the echoes: the id of a scanner that ships (see vlscan catalogue), file.xml#id, or a survey (.xml) or
    /// pipeline (.toml) with everything that it says.
    #[arg(long, value_name = "SCANNER")]
    pub scanner: String,
    /// Changes of the instrument.
    #[command(flatten)]
    pub instrument: InstrumentArgs,
    /// Points and what is written beside them.
    #[command(flatten)]
    pub output: OutputArgs,
    /// What every command of the river lets one choose.
    #[command(flatten)]
    pub common: CommonArgs,
    /// How echoes are computed.
    #[command(flatten)]
    pub physics: PhysicsArgs,
    /// How the scene is kept.
    #[command(flatten)]
    pub tree: TreeArgs,
}
