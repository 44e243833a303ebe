//! The command line of `bench`, `catalogue`, `unzip`, `preview`, `serve`, `completions` and `man`.

use super::PointMemory;
use clap::{Args, Subcommand};
use std::ffi::OsString;
use std::path::PathBuf;
use vlscan_options::values::whole;
use vlscan_options::{ChunkSize, Count, WarehouseFactor, choice};
use vlscan_tools::preview::ColourBy;
use vlscan_trace::Builder;
use vlscan_warehouse::PolicyKind;

/// `vlscan bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// The survey (.xml) or pipeline (.toml).
    pub survey: PathBuf,
    /// Trees to compare.
    #[arg(
        long,
        value_name = "TREE,…",
        value_delimiter = ',',
        default_value = "bvh",
        value_parser = choice::<Builder>(),
    )]
    pub tree: Vec<Builder>,
    /// Schedules to compare.
    #[arg(
        long,
        value_name = "SCHEDULE,…",
        value_delimiter = ',',
        default_value = "warehouse",
        value_parser = choice::<PolicyKind>(),
    )]
    pub schedule: Vec<PolicyKind>,
    /// Pulses per chunk. [default: those of the run]
    #[arg(long, value_name = "N,…", value_delimiter = ',')]
    pub chunk_size: Vec<ChunkSize>,
    /// Chunks per worker that may wait in the warehouse.
    #[arg(long, value_name = "N", default_value = "4")]
    pub warehouse_factor: WarehouseFactor,
    /// Numbers of threads to compare. [default: 1, 2, 4, … to all]
    #[arg(short = 'j', long, value_name = "N,…", value_delimiter = ',', value_parser = whole::<usize>)]
    pub threads: Vec<usize>,
    /// Number of measurements of each setting, after a warm-up run; the shortest time is reported.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Format in which points are written, to a temporary file.
    #[arg(long, value_name = "FORMAT", default_value = "las", value_parser = ["none", "xyz", "las", "laz"])]
    pub format: String,
    /// Write all results as JSON; - for stdout (the table then goes to stderr).
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
    /// Folder to look for scenes, scanners, platforms, geometry and spectra in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// Options of vlscan run that change the simulation, such as --physics refined.
    #[arg(last = true, value_name = "RUN OPTIONS")]
    pub run: Vec<String>,
}

/// `vlscan catalogue`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct CatalogueArgs {
    /// Command in place of the list.
    #[command(subcommand)]
    pub command: Option<CatalogueCommand>,
    /// The list.
    #[command(flatten)]
    pub list: ListArgs,
}

/// `vlscan catalogue list`, or without `list`.
#[derive(Debug, Args)]
pub struct ListArgs {
    /// Show only entries with all these words in their reference or name.
    pub filter: Vec<String>,
    /// JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Subcommands of `vlscan catalogue`.
#[derive(Debug, Subcommand)]
pub enum CatalogueCommand {
    /// Show the specifications of a scanner, and draw its scan pattern.
    Show(ShowArgs),
    /// List the entries, as without a command.
    #[command(hide = true)]
    List(ListArgs),
}

/// `vlscan catalogue show`.
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// A scanner: an id of the catalogue, or file.xml#id.
    pub name: String,
    /// Draw the directions of its beams as SVG: one revolution of the head, or 0.1 s if it does not turn.
    #[arg(long, value_name = "FILE.svg", value_parser = super::besides_report())]
    pub picture: Option<PathBuf>,
    /// Replace an existing picture.
    #[arg(long)]
    pub force: bool,
    /// JSON instead of lines.
    #[arg(long)]
    pub json: bool,
}

/// `vlscan unzip`.
#[derive(Debug, Args)]
pub struct UnzipArgs {
    /// Compressed file; - for stdin.
    pub file: PathBuf,
    /// Output file; - for stdout.
    #[arg(default_value = "-")]
    pub out: PathBuf,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
}

/// `vlscan preview`.
#[derive(Debug, Args)]
pub struct PreviewArgs {
    /// A survey (.xml) or pipeline (.toml), whose scene, flight lines and swaths are drawn; or points: text,
    /// LAS, LAZ, PLY, PCD, E57, PTS, MCAP, Arrow, Parquet, - for stdin; with --pulse waveforms
    /// (*_fullwave.txt, also .gz or .bin) or LAS and LAZ with waveform packets.
    pub points: PathBuf,
    /// A picture (.png), an interactive page for a browser (.html), or all points as COPC for viewers that
    /// read ranges (.copc.laz); - writes the picture to stdout.
    #[arg(short = 'o', long, value_name = "PATH")]
    pub out: PathBuf,
    /// Plot the waveform of this pulse, its echoes marked with their fitted widths; the number is the eighth
    /// column of point files.
    #[arg(long, value_name = "N", value_parser = whole::<u64>)]
    pub pulse: Option<u64>,
    /// Attribute that sets the colour. [default: height; for a survey the density of pulses in a picture,
    /// and in a page the flight line that covers the point, grey where none does]
    #[arg(long, value_enum)]
    pub colour: Option<ColourBy>,
    /// Dark on white, for print, instead of light on black.
    #[arg(long)]
    pub light: bool,
    /// Width of the picture in pixels, 320 to 16384.
    #[arg(
        long,
        value_name = "PIXELS",
        default_value_t = PreviewArgs::WIDTH,
        value_parser = clap::value_parser!(u32).range(320..=16_384),
    )]
    pub width: u32,
    /// Height of the picture in pixels, 240 to 16384.
    #[arg(
        long,
        value_name = "PIXELS",
        default_value_t = PreviewArgs::HEIGHT,
        value_parser = clap::value_parser!(u32).range(240..=16_384),
    )]
    pub height: u32,
    /// Maximum number of points in a page, evenly sampled; 500k is understood.
    #[arg(long, alias = "most-points", value_name = "N", default_value = "5M")]
    pub max_points: Count<1>,
    /// Memory of the cloud.
    #[command(flatten)]
    pub memory: PointMemory,
    /// Of a survey: folder to look for files in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// Replace an existing file, and write a picture to a terminal.
    #[arg(long)]
    pub force: bool,
}

impl PreviewArgs {
    /// Default width of pictures, pixels.
    pub const WIDTH: u32 = 1600;
    /// Default height of pictures, pixels.
    pub const HEIGHT: u32 = 1000;
    /// Default number of points in a page.
    pub const PAGE_POINTS: u64 = 5_000_000;
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
    #[arg(required_unless_present = "json_schema")]
    pub dir: Option<PathBuf>,
    /// Write the options of a run as a module of the Python package instead, _options.py.
    #[arg(long)]
    pub python: bool,
    /// Write what commands and pipeline files take to stdout instead, as JSON Schema.
    #[arg(long, conflicts_with_all = ["dir", "python"])]
    pub json_schema: bool,
}

/// `vlscan serve`.
#[derive(Debug, Args)]
pub struct ServeArgs {
    /// Options of the service; vlscan serve --help lists them.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "OPTIONS")]
    pub options: Vec<OsString>,
}
