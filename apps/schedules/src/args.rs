//! The command line.

use clap::{Parser, ValueEnum};
use std::path::PathBuf;
use vlscan::options::choice;
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::NumberError;
use vlscan_trace::{BuildOptions, Builder};
use vlscan_warehouse::{Policy, PolicyKind};

/// Compares trees, schedules, chunk sizes and numbers of threads on a survey as in the paper on HPC HELIOS++
/// (IEEE Access 2022), and replays what was measured on machines with more cores.
#[derive(Debug, Parser)]
#[command(name = "vlscan-schedules", version, max_term_width = 110)]
pub struct Args {
    /// The survey (.xml) or pipeline (.toml).
    pub survey: PathBuf,
    /// Trees to compare.
    #[arg(
        long,
        value_name = "TREE,…",
        value_delimiter = ',',
        default_value = "median,sah,fsah,bvh",
        value_parser = choice::<Builder>(),
    )]
    pub tree: Vec<Builder>,
    /// Rules of the tree builders.
    #[command(flatten)]
    pub rules: TreeRules,
    /// Schedules to compare.
    #[arg(
        long,
        value_name = "SCHEDULE,…",
        value_delimiter = ',',
        default_value = "single,static,dynamic,warehouse",
        value_parser = choice::<PolicyKind>(),
    )]
    pub schedule: Vec<PolicyKind>,
    /// Pulses per chunk; single pulses and sequential runs aside.
    #[arg(
        long,
        value_name = "N,…",
        value_delimiter = ',',
        default_value = "32",
        value_parser = clap::value_parser!(u32).range(1..=1 << 24),
    )]
    pub chunk_size: Vec<u32>,
    /// Chunks per worker that may wait in the warehouse.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "4", value_parser = count)]
    pub warehouse_factor: Vec<u64>,
    /// Threads that build and compute; one thread is always among them. [default: 1, 2, 4, … to all]
    #[arg(short = 'j', long, value_name = "N,…", value_delimiter = ',')]
    pub threads: Vec<usize>,
    /// Barrier: a leg begins only when the one before is complete, as in the paper.
    #[arg(long, value_name = "WHEN", default_value = "off")]
    pub leg_barrier: Barriers,
    /// Dynamic chunks: idle times shorter than this are ignored, in milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 0.1)]
    pub idle_threshold: f64,
    /// How often everything is measured; the least time counts.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// How often everything is run before that.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub warm_up: u32,
    /// Format in which points are written, to a temporary file.
    #[arg(long, value_name = "FORMAT", default_value = "las", value_parser = ["none", "xyz", "las", "laz"])]
    pub format: String,
    /// Replay measured task times on machines with so many threads, too.
    #[arg(long, value_name = "N,…", value_delimiter = ',')]
    pub simulate_threads: Vec<usize>,
    /// Replay a run in shards on clusters of so many nodes, too, from the measured costs of shards and of
    /// their merge.
    #[arg(
        long,
        value_name = "N,…",
        value_delimiter = ',',
        value_parser = clap::value_parser!(u32).range(1..),
    )]
    pub simulate_nodes: Vec<u32>,
    /// With --simulate-nodes: pulses of the whole survey, of which the one that is flown is a sample.
    /// [default: those that are flown]
    #[arg(long, value_name = "N", value_parser = count)]
    pub simulate_pulses: Option<u64>,
    /// With --simulate-nodes: threads of a node, each on a core of its own.
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..))]
    pub node_threads: u32,
    /// With --simulate-nodes: shards per node.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    pub node_shards: u32,
    /// With --simulate-nodes: bytes per second that a node reads or writes.
    #[arg(long, value_name = "BYTES", default_value = "1G", value_parser = count)]
    pub node_disk: u64,
    /// With --simulate-nodes: bytes per second that all nodes read and write together.
    #[arg(long, value_name = "BYTES", default_value = "20G", value_parser = count)]
    pub file_system: u64,
    /// Print the paper's own tables, too.
    #[arg(long)]
    pub paper: bool,
    /// Write everything as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Draw times, speedups and chunk sizes as SVG.
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    /// Replace existing files.
    #[arg(long)]
    pub force: bool,
    /// Say on stderr what is measured.
    #[arg(short, long)]
    pub verbose: bool,
    /// Options of vlscan run that change the simulation, such as --physics refined.
    #[arg(last = true, value_name = "RUN OPTIONS")]
    pub run: Vec<String>,
}

impl Args {
    /// A schedule of several threads with those settings that apply to it.
    pub fn policy(&self, kind: PolicyKind, size: u32, factor: u64) -> Policy {
        match kind {
            PolicyKind::Single => Policy::Single,
            PolicyKind::Static => Policy::Static { size },
            PolicyKind::Dynamic => {
                let significant_ns = (self.idle_threshold.max(0.0) * 1e6).round() as u64;
                Policy::Dynamic { size, significant_ns }
            }
            PolicyKind::Warehouse => Policy::Warehouse { size, factor: factor.min(1 << 16) as usize },
        }
    }
}

/// A whole number of at least one with an optional unit prefix: 250k, 4G.
fn count(text: &str) -> Result<u64, NumberError> {
    let digits = text.trim_end_matches(['k', 'K', 'm', 'M', 'g', 'G', 't', 'T']);
    let factor = match text[digits.len()..].to_lowercase().as_str() {
        "" => 1,
        "k" => 1000,
        "m" => 1_000_000,
        "g" => 1_000_000_000,
        "t" => 1_000_000_000_000,
        _ => 0,
    };
    let number = digits.parse::<u64>().ok().and_then(|n| n.checked_mul(factor)).filter(|n| *n > 0);
    let problem = || NumberError { expected: "a number such as 250000 or 250k", found: format!("{text:?}") };
    number.ok_or_else(problem)
}

/// Barriers between legs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Barriers {
    /// No barriers.
    Off,
    /// A barrier after each leg.
    On,
    /// Each schedule without and with barriers.
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
#[derive(Clone, Debug, Default, clap::Args)]
pub struct TreeRules {
    /// Build the kd-trees by the paper's rules: unit costs, 5 primitives, axes in turn, every split booked in
    /// the cost of the whole tree; the other --tree options change single rules.
    #[arg(long)]
    pub tree_strict: bool,
    /// Histogram bins (fsah) or candidates (sah, axis-sah) of the tree builder. [default: 32, 21]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1024))]
    pub tree_bins: Option<u32>,
    /// Threads that work together on a kd-tree's large upper nodes; 1 = none help. [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub tree_geom_jobs: Option<u32>,
    /// kd-trees: cost of visiting an interior node, visiting a leaf and testing a primitive. [default: 8,1,1]
    #[arg(long, value_name = "CI,CL,CO", value_delimiter = ',', allow_hyphen_values = true)]
    pub tree_costs: Vec<f64>,
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
        match self.tree_costs[..] {
            [] => {}
            [interior, leaf, primitive] if interior >= 0.0 && leaf >= 0.0 && primitive > 0.0 => {
                (options.cost_interior, options.cost_leaf, options.cost_primitive) =
                    (interior, leaf, primitive);
            }
            _ => {
                return Err(Error::input(
                    "--tree-costs: expected three numbers of at least 0, the last above 0",
                ));
            }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn rules(line: &str) -> Result<BuildOptions> {
        let words = ["vlscan-schedules", "a.toml"].into_iter().chain(line.split_whitespace());
        Args::parse_from(words).rules.build_options(Builder::Fsah)
    }

    #[test]
    fn every_rule_of_a_tree_can_be_changed() {
        let line = "--tree-strict --tree-costs 1,2,3 --tree-min-primitives 9 --tree-depth 12 --tree-bins 40 \
                    --tree-geom-jobs 2";
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
        for wrong in ["1,1,0", "-1,1,1", "1,1"] {
            assert!(rules(&format!("--tree-costs={wrong}")).is_err(), "{wrong}");
        }
    }

    #[test]
    fn numbers_have_prefixes() {
        assert_eq!([count("100G"), count("7")], [Ok(100_000_000_000), Ok(7)]);
        assert!(["0", "k", "1x", "99999999999T"].iter().all(|text| count(text).is_err()));
    }
}
