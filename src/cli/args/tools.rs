//! The command line of `bench`, `catalogue`, `unzip`, `preview`, `completions` and `man`.

use crate::options::{ChunkSize, Count, NotNegative, Vector};
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;
use vlscan_base::error::{Error, Result};
use vlscan_tools::preview::ColourBy;
use vlscan_trace::{BuildOptions, Builder};
use vlscan_warehouse::PolicyKind;

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

/// Rules of the tree builders; the points are the same.
#[derive(Clone, Debug, Default, Args)]
pub struct TreeRules {
    /// Build the kd-trees by the paper's rules: unit costs, 5 primitives, axes in turn, every split booked in the cost of the
    /// whole tree; the other --tree options change single rules.
    #[arg(long)]
    pub tree_strict: bool,
    /// Histogram bins (fsah) or candidates (sah, axis-sah) of the tree builder. [default: 32, 21]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1024))]
    pub tree_bins: Option<u32>,
    /// Threads that work together on a kd-tree's large upper nodes; 1 = none help. [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub tree_geom_jobs: Option<u32>,
    /// kd-trees: cost of visiting an interior node, visiting a leaf and testing a primitive. [default: 8,1,1]
    #[arg(long, value_name = "CI,CL,CO")]
    pub tree_costs: Option<Vector>,
    /// kd-trees: smallest number of primitives that may be split. [default: 17]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..))]
    pub tree_min_primitives: Option<u32>,
    /// kd-trees: deepest level. [default: 8 + 1.3 log2 of the primitives]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(..=64))]
    pub tree_depth: Option<u32>,
}

impl TreeRules {
    /// The options of a builder under these rules.
    ///
    /// # Errors
    /// Costs below 0, or tests of primitives that cost nothing.
    pub fn build_options(&self, builder: Builder) -> Result<BuildOptions> {
        let strict = self.tree_strict && builder != Builder::Bvh;
        let mut options = if strict { BuildOptions::strict(builder) } else { BuildOptions::of(builder) };
        if let Some(Vector([interior, leaf, primitive])) = self.tree_costs {
            if interior < 0.0 || leaf < 0.0 || primitive <= 0.0 {
                return Err(Error::input("--tree-costs: expected numbers of at least 0, the last above 0"));
            }
            (options.cost_interior, options.cost_leaf, options.cost_primitive) = (interior, leaf, primitive);
        }
        if let Some(bins) = self.tree_bins {
            (options.bins, options.candidates) = (bins as usize, bins as usize);
        }
        options.geometry_jobs = self.tree_geom_jobs.map_or(0, |jobs| jobs as usize);
        options.min_primitives = self.tree_min_primitives.map_or(options.min_primitives, |n| n as usize);
        options.max_depth = self.tree_depth.or(options.max_depth);
        Ok(options)
    }
}

/// `vlscan bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// The survey (.xml) or pipeline (.toml).
    pub survey: PathBuf,
    /// Trees to compare.
    #[arg(long, value_name = "TREE,…", value_delimiter = ',', default_value = "median,sah,fsah,bvh")]
    pub tree: Vec<Builder>,
    /// Rules of the tree builders.
    #[command(flatten)]
    pub rules: TreeRules,
    /// Schedules to compare.
    #[arg(
        long,
        value_name = "SCHEDULE,…",
        value_delimiter = ',',
        default_value = "single,static,dynamic,warehouse"
    )]
    pub schedule: Vec<PolicyKind>,
    /// Pulses per chunk; single pulses and sequential runs aside.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "32")]
    pub chunk_size: Vec<ChunkSize>,
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
    pub idle_threshold: Option<NotNegative>,
    /// How often everything is measured; the least time counts.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..))]
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
    /// Replay a run in parts on clusters of so many nodes, too, from the measured costs of parts and of their merge.
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..))]
    pub simulate_nodes: Vec<u32>,
    /// With --simulate-nodes: pulses of the whole survey, of which the one that is flown is a sample. [default: those that
    /// are flown]
    #[arg(long, value_name = "N")]
    pub simulate_pulses: Option<Count<1>>,
    /// With --simulate-nodes: threads of a node, each on a core of its own.
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..))]
    pub node_threads: usize,
    /// With --simulate-nodes: parts per node.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    pub node_parts: u32,
    /// With --simulate-nodes: bytes per second that a node reads or writes.
    #[arg(long, value_name = "BYTES", default_value = "1G")]
    pub node_disk: Count<1>,
    /// With --simulate-nodes: bytes per second that all nodes read and write together.
    #[arg(long, value_name = "BYTES", default_value = "20G")]
    pub file_system: Count<1>,
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
#[command(args_conflicts_with_subcommands = true)]
pub struct CatalogueArgs {
    /// What to do instead of listing.
    #[command(subcommand)]
    pub command: Option<CatalogueCommand>,
    /// Only what has this in its reference or name.
    pub filter: Option<String>,
    /// JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Subcommands of `vlscan catalogue`.
#[derive(Debug, Subcommand)]
pub enum CatalogueCommand {
    /// Show the figures of a scanner, and draw its scan pattern.
    Show(ShowArgs),
}

/// `vlscan catalogue show`.
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// A scanner: an id of the catalogue, or file.xml#id.
    pub name: String,
    /// Draw where its beams point, as SVG: a revolution of its head, or 0.1 s of one that does not turn.
    #[arg(long, value_name = "FILE.svg")]
    pub picture: Option<PathBuf>,
    /// Replace a picture that exists.
    #[arg(long)]
    pub force: bool,
    /// JSON instead of lines.
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

/// `vlscan preview`.
#[derive(Debug, Args)]
pub struct PreviewArgs {
    /// A survey (.xml) or pipeline (.toml), whose scene, flight lines and swaths are drawn; or points: text, LAS, LAZ, PLY, PCD, E57, PTS, Arrow, Parquet, - for stdin; with --pulse
    /// waveforms (*_fullwave.txt, also .gz or .bin) or LAS and LAZ with waveform packets.
    pub points: PathBuf,
    /// A picture (.png), or a page to turn the points around in a browser (.html); - for stdout, which gets the picture.
    #[arg(short = 'o', long, value_name = "PATH")]
    pub out: PathBuf,
    /// Plot the waveform of this pulse, its echoes marked with their fitted widths; the number is the eighth column of
    /// point files.
    #[arg(long, value_name = "N")]
    pub pulse: Option<u64>,
    /// What colours the points. [default: height; of a survey the leg that covers them, grey where none does]
    #[arg(long, value_enum)]
    pub colour: Option<ColourBy>,
    /// Dark on white, for paper, instead of light on black.
    #[arg(long)]
    pub light: bool,
    /// Width of the picture in pixels, 320 to 16384.
    #[arg(long, value_name = "PIXELS", default_value_t = 1600, value_parser = clap::value_parser!(u32).range(320..=16_384))]
    pub width: u32,
    /// Height of the picture in pixels, 240 to 16384.
    #[arg(long, value_name = "PIXELS", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(240..=16_384))]
    pub height: u32,
    /// Points that a page shows at most; of more, an even sample is taken. 500k is understood.
    #[arg(long, value_name = "N", default_value = "5M")]
    pub most_points: Count<1>,
    /// Of a survey: folder to look for files in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
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
    /// Write the options of a run as a module of the Python package instead, _options.py.
    #[arg(long)]
    pub python: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::{Cli, Command};
    use clap::Parser;

    #[test]
    fn every_rule_of_a_tree_can_be_changed() {
        let rules = |line: &str| {
            let words = ["vlscan", "bench", "a.toml"].into_iter().chain(line.split_whitespace());
            let Command::Bench(args) = Cli::parse_from(words).command else { panic!("no bench") };
            args.rules.build_options(Builder::Fsah)
        };
        let line = "--tree-strict --tree-costs 1,2,3 --tree-min-primitives 9 --tree-depth 12 --tree-bins 40 --tree-geom-jobs 2";
        let expected = BuildOptions {
            cost_interior: 1.0,
            cost_leaf: 2.0,
            cost_primitive: 3.0,
            min_primitives: 9,
            max_depth: Some(12),
            bins: 40,
            candidates: 40,
            geometry_jobs: 2,
            ..BuildOptions::strict(Builder::Fsah)
        };
        assert_eq!(rules(line).unwrap(), expected);
        assert_eq!(rules("").unwrap(), BuildOptions::of(Builder::Fsah));
        for wrong in ["1,1,0", "-1,1,1"] {
            assert!(rules(&format!("--tree-costs={wrong}")).is_err(), "{wrong}");
        }
    }
}
