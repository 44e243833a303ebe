//! The command line of what stands beside the river: comparing, listing, looking, helping.

use super::{ScheduleKind, TreeKind};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Whether legs wait for one another in a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Barriers {
    /// They do not.
    Off,
    /// They do.
    On,
    /// Once and once.
    Both,
}

impl Barriers {
    /// The settings to compare.
    pub fn values(self) -> &'static [bool] {
        match self {
            Barriers::Off => &[false],
            Barriers::On => &[true],
            Barriers::Both => &[false, true],
        }
    }
}

/// `vlscan bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// The survey (.xml) or pipeline (.toml).
    pub survey: PathBuf,
    /// Trees to compare.
    #[arg(long, value_name = "TREE,…", value_delimiter = ',', default_value = "median,sah,fsah,bvh")]
    pub tree: Vec<TreeKind>,
    /// Build the kd-trees by the paper's rules: unit costs, 5 primitives, axes in turn.
    #[arg(long)]
    pub tree_strict: bool,
    /// Schedules to compare.
    #[arg(
        long,
        value_name = "SCHEDULE,…",
        value_delimiter = ',',
        default_value = "single,static,dynamic,warehouse"
    )]
    pub schedule: Vec<ScheduleKind>,
    /// Pulses per chunk; single pulses and sequential runs aside.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "32")]
    pub chunk_size: Vec<u32>,
    /// Chunks per worker that may wait in the warehouse.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "4")]
    pub warehouse_factor: Vec<usize>,
    /// Threads that build and compute; one thread is always among them. [default: 1, 2, 4, … to all]
    #[arg(short = 'j', long, value_name = "N,…", value_delimiter = ',')]
    pub threads: Vec<usize>,
    /// Whether a leg begins only when everything of the one before is done, as in the paper.
    #[arg(long, value_name = "WHEN", default_value = "off")]
    pub leg_barrier: Barriers,
    /// Dynamic chunks: idle times shorter than this mean nothing, in milliseconds. [default: 0.1]
    #[arg(long, value_name = "MS")]
    pub idle_threshold: Option<f64>,
    /// How often everything is measured; the least time counts.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub repetitions: usize,
    /// How often everything is run before that.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub warm_up: usize,
    /// What the points are written as, to a temporary file.
    #[arg(long, value_name = "FORMAT", default_value = "las", value_parser = ["none", "xyz", "las", "laz"])]
    pub format: String,
    /// Replay measured task times on machines with so many threads, too.
    #[arg(long, value_name = "N,…", value_delimiter = ',')]
    pub simulate_threads: Vec<usize>,
    /// Print the paper's own tables, too.
    #[arg(long)]
    pub paper: bool,
    /// Write everything as JSON; - for stdout, where the table goes to stderr.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Draw times, speedups and chunk sizes as SVG.
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    /// Overwrite files that exist.
    #[arg(long)]
    pub force: bool,
    /// Folder to look for scenes, scanners, platforms, geometry and spectra in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// Options of vlscan run that change what is simulated, such as --physics refined.
    #[arg(last = true, value_name = "RUN OPTIONS")]
    pub run: Vec<std::ffi::OsString>,
}

/// `vlscan catalogue`.
#[derive(Debug, Args)]
pub struct CatalogueArgs {
    /// Only what has this in its reference or name.
    pub filter: Option<String>,
    /// JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// `vlscan unzip`.
#[derive(Debug, Args)]
pub struct UnzipArgs {
    /// The compressed text; - for stdin.
    pub file: PathBuf,
    /// The text; - for stdout.
    #[arg(default_value = "-")]
    pub out: PathBuf,
    /// Overwrite a file that exists.
    #[arg(long)]
    pub force: bool,
}

/// What colours a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Colour {
    /// Height.
    Height,
    /// Class of the surface.
    Class,
    /// Echo strength.
    Intensity,
    /// Part that was hit.
    Object,
    /// Number of the return.
    Return,
}

/// `vlscan preview`.
#[derive(Debug, Args)]
pub struct PreviewArgs {
    /// The points: .xyz, .csv, .las, .laz, .ply, .arrow, .parquet, or - for text or an Arrow stream on stdin; with --pulse
    /// waveforms (*_fullwave.txt, also .gz or .bin) or LAS and LAZ with waveform packets.
    pub points: PathBuf,
    /// A picture (.png), or a page to turn the points around in a browser (.html); - for stdout, which gets the picture.
    #[arg(short = 'o', long, value_name = "PATH")]
    pub out: PathBuf,
    /// Plot the waveform of this pulse, its echoes marked with their fitted widths; the number is the eighth column of
    /// point files.
    #[arg(long, value_name = "N")]
    pub pulse: Option<u64>,
    /// What colours the points.
    #[arg(long, value_enum, default_value = "height")]
    pub colour: Colour,
    /// Width of the picture in pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 1600)]
    pub width: u32,
    /// Height of the picture in pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 1000)]
    pub height: u32,
    /// Points that a page shows at most; of more, an even sample is taken. 500k is understood.
    #[arg(long, value_name = "N", default_value = "5M")]
    pub most_points: String,
    /// Overwrite a file that exists, and write a picture to a terminal.
    #[arg(long)]
    pub force: bool,
}

/// `vlscan completions`.
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell.
    pub shell: clap_complete::Shell,
}

/// `vlscan man`.
#[derive(Debug, Args)]
pub struct ManArgs {
    /// The folder that gets the pages; pages of the same names are replaced.
    pub dir: PathBuf,
}
