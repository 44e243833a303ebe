//! The command line of the stages: `vlscan trajectory`, `vlscan pulses`, `vlscan trace`.

use super::args::{FlightArgs, InputArgs, OriginArgs, OutputArgs, PhysicsArgs, ScheduleArgs, TreeArgs};
use clap::Args;
use std::path::PathBuf;

/// What is flown and how.
#[derive(Debug, Args)]
pub struct SurveyArgs {
    /// The survey (.xml) or pipeline (.toml).
    pub file: PathBuf,
    /// Where the platform is.
    #[command(flatten)]
    pub flight: FlightArgs,
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

/// `vlscan trajectory`.
#[derive(Debug, Args)]
#[command(
    long_about = "Fly a survey or pipeline and write the platform's poses to stdout.\n\nOne line per pose after a header: \
time[s] of the GPS week, x[m],y[m],z[m] of the platform in world coordinates, roll[deg],pitch[deg],yaw[deg] after ARINC \
705 (yaw clockwise from +y, right wing down and nose up positive), which is what --trajectory reads. Legs whose scanner \
is switched off have no poses."
)]
pub struct TrajectoryArgs {
    /// What is flown and how.
    #[command(flatten)]
    pub survey: SurveyArgs,
    /// Seconds from pose to pose. [default: the survey's trajectoryTimeInterval_s, else 0.05]
    #[arg(long, value_name = "SECONDS", help_heading = "Output")]
    pub interval: Option<f64>,
}

/// `vlscan pulses`.
#[derive(Debug, Args)]
#[command(
    long_about = "Fly a survey or pipeline and write every pulse to stdout instead of tracing it.\n\nOne line per pulse \
after a header that names the columns and their units: time, origin and direction in world coordinates, leg, device, \
number of the pulse, and what `vlscan trace` needs to get the same echoes bit for bit: the beam's quaternion, the scan \
angle, the last bits of the coordinates. The scene is loaded too, for its frame and for legs on the ground."
)]
pub struct PulsesArgs {
    /// What is flown and how.
    #[command(flatten)]
    pub survey: SurveyArgs,
}

/// `vlscan trace`.
#[derive(Debug, Args)]
#[command(
    long_about = "Read pulses, trace them through a scene and write the echoes.\n\nThe pulses come from `vlscan pulses` or \
from any program that prints them: comma-separated (or blank-separated) values with a header of names, of which x, y, z \
and dx, dy, dz are needed; without a header the columns are time, x, y, z, dx, dy, dz. Units stand behind the names, as in \
time[ns] or scan_angle[deg]; without one they are s, m and rad.

With a survey as --scanner the echoes are those of `vlscan run`, bit for bit; seed, legs and strips come from it. With \
the scanner alone they are, too, when --seed and the options of the physics are those of the run."
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
    /// What is read.
    #[command(flatten)]
    pub input: InputArgs,
    /// What everything depends on.
    #[command(flatten)]
    pub origin: OriginArgs,
    /// How echoes are computed.
    #[command(flatten)]
    pub physics: PhysicsArgs,
    /// How the work is done.
    #[command(flatten)]
    pub schedule: ScheduleArgs,
    /// How the scene is kept.
    #[command(flatten)]
    pub tree: TreeArgs,
}

/// Changes of the instrument, for all of its devices.
#[derive(Clone, Debug, Default, Args)]
pub struct InstrumentArgs {
    /// Divergence of the beam in rad, whatever the stream says. [default: the stream's, else the scanner's]
    #[arg(long, value_name = "RAD", help_heading = "Instrument")]
    pub divergence: Option<f64>,
    /// Length of the outgoing pulse in ns.
    #[arg(long, value_name = "NS", help_heading = "Instrument")]
    pub pulse_length: Option<f64>,
    /// Pulses per second: moving scenes whose steps are given in seconds go by it. [default: the scanner's first]
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Instrument")]
    pub pulse_rate: Option<u32>,
    /// Concentric rings of subrays per pulse (beamSampleQuality).
    #[arg(long, value_name = "RINGS", value_parser = clap::value_parser!(u32).range(1..=512), help_heading = "Instrument")]
    pub beam_quality: Option<u32>,
    /// Width of the waveform's bins in ns (binSize_ns).
    #[arg(long, value_name = "NS", help_heading = "Instrument")]
    pub bin: Option<f64>,
    /// Peak search window in ns (winSize_ns).
    #[arg(long, value_name = "NS", help_heading = "Instrument")]
    pub window: Option<f64>,
    /// Standard deviation of the range noise in metres.
    #[arg(long, value_name = "METRES", help_heading = "Instrument")]
    pub accuracy: Option<f64>,
    /// Nearest range in metres.
    #[arg(long, value_name = "METRES", help_heading = "Instrument")]
    pub range_min: Option<f64>,
    /// Farthest range in metres.
    #[arg(long, value_name = "METRES", help_heading = "Instrument")]
    pub range_max: Option<f64>,
    /// Most returns per pulse; 0 is unlimited.
    #[arg(long, value_name = "N", help_heading = "Instrument")]
    pub max_returns: Option<u32>,
}
