//! What makes a run faster or slower and changes no point: the tree and the schedule.

use crate::cli::args::{ScheduleArgs, ScheduleKind, TreeArgs, TreeKind};
use crate::error::{Error, Result};
use crate::pipeline::{DEFAULT_CHUNK_SIZE, DEFAULT_WAREHOUSE_FACTOR};
use crate::schedule::{Policy, Schedule};
use crate::survey::RunSettings;
use crate::tree::{BuildOptions, Builder};
use clap::ValueEnum;

/// Idle times that mean nothing to dynamic chunks, in milliseconds.
const IDLE_THRESHOLD_MS: f64 = 0.1;

/// Most threads that are ever started.
const MOST_THREADS: usize = 1024;

/// The builder of a kind.
pub fn builder(kind: TreeKind) -> Builder {
    match kind {
        TreeKind::Bvh => Builder::Bvh,
        TreeKind::Fsah => Builder::Fsah,
        TreeKind::AxisSah => Builder::AxisSah,
        TreeKind::Sah => Builder::Sah,
        TreeKind::Median => Builder::Median,
    }
}

/// The builder and its settings.
pub fn tree(args: &TreeArgs, set: &RunSettings, threads: usize) -> Result<BuildOptions> {
    // The file's reader takes the same names only.
    let written = set.tree.as_deref().and_then(|name| TreeKind::from_str(name, true).ok());
    let builder = args.tree.or(written).map_or(BuildOptions::default().builder, builder);
    let usual = if args.tree_strict { BuildOptions::strict(builder) } else { BuildOptions::of(builder) };
    let [cost_interior, cost_leaf, cost_primitive] = costs(args, &usual)?;
    let wanted = |n: Option<usize>, otherwise: usize| match n {
        Some(n) if n > 0 => n.min(MOST_THREADS),
        _ => otherwise,
    };
    let jobs = wanted(args.tree_jobs, threads.min(MOST_THREADS));
    Ok(BuildOptions {
        bins: args.tree_bins.unwrap_or(usual.bins).clamp(2, 1024),
        candidates: args.tree_bins.unwrap_or(usual.candidates).clamp(2, 1024),
        min_primitives: args.tree_min_primitives.unwrap_or(usual.min_primitives).max(2),
        max_depth: args.tree_depth.or(usual.max_depth),
        cost_interior,
        cost_leaf,
        cost_primitive,
        jobs,
        geometry_jobs: wanted(args.tree_geom_jobs, jobs),
        ..usual
    })
}

fn costs(args: &TreeArgs, usual: &BuildOptions) -> Result<[f64; 3]> {
    match args.tree_costs[..] {
        [] => Ok([usual.cost_interior, usual.cost_leaf, usual.cost_primitive]),
        [i, l, o] if [i, l].iter().all(|c| c.is_finite() && *c >= 0.0) && o.is_finite() && o > 0.0 => {
            Ok([i, l, o])
        }
        _ => Err(Error::input(format!(
            "--tree-costs: expected three numbers, none below 0 and the last above it, found {:?}",
            args.tree_costs
        ))),
    }
}

/// How pulses are handed out.
pub fn schedule(args: &ScheduleArgs, set: &RunSettings, threads: usize) -> Result<Schedule> {
    let written = set.policy.as_deref().and_then(|name| ScheduleKind::from_str(name, true).ok());
    let wanted = args.chunk_size.or(set.chunk_size.and_then(|n| i64::try_from(n).ok()));
    let size = chunk_size(wanted)?;
    let kind = match args.parallelization.as_deref() {
        // The reference marks dynamic chunks by the sign of their first size; its warehouse uses the absolute value.
        Some("0") if wanted.is_some_and(|n| n < 0) => ScheduleKind::Dynamic,
        Some("0") => ScheduleKind::Static,
        Some(_) => ScheduleKind::Warehouse,
        None => args.schedule.or(written).unwrap_or(ScheduleKind::Warehouse),
    };
    let factor = args.warehouse_factor.or(set.warehouse_factor).unwrap_or(DEFAULT_WAREHOUSE_FACTOR);
    Ok(Schedule {
        threads,
        policy: policy(kind, size, factor, args.idle_threshold)?,
        leg_barrier: args.leg_barrier || set.leg_barrier.unwrap_or(false),
    })
}

/// A schedule with its parameters, each where it has a meaning.
pub fn policy(
    kind: ScheduleKind,
    size: u32,
    factor: usize,
    idle_threshold_ms: Option<f64>,
) -> Result<Policy> {
    let ms = idle_threshold_ms.unwrap_or(IDLE_THRESHOLD_MS);
    if !(0.0..1e9).contains(&ms) {
        return Err(Error::input(format!("--idle-threshold: expected milliseconds, 0 or more, found {ms}")));
    }
    Ok(match kind {
        ScheduleKind::Warehouse => Policy::Warehouse { size, factor: factor.clamp(1, 1 << 16) },
        ScheduleKind::Dynamic => Policy::Dynamic { size, significant_ns: (ms * 1e6).round() as u64 },
        ScheduleKind::Static => Policy::Static { size },
        ScheduleKind::Single => Policy::Single,
    })
}

/// A chunk size as typed.
pub fn chunk_size(wanted: Option<i64>) -> Result<u32> {
    match wanted {
        None => Ok(DEFAULT_CHUNK_SIZE),
        Some(n) => match u32::try_from(n.unsigned_abs()) {
            Ok(n @ 1..=16_777_216) => Ok(n),
            _ => Err(Error::input(format!("--chunk-size: expected 1 to 16777216 pulses, found {n}"))),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::{Cli, Command, RunArgs};
    use clap::Parser;

    fn args(line: &str) -> RunArgs {
        let words = ["vlscan", "run", "a.toml"].into_iter().chain(line.split_whitespace());
        let Command::Run(args) = Cli::parse_from(words).command else { panic!("no run") };
        *args
    }

    #[test]
    fn a_pipeline_file_may_name_the_tree() {
        let builder = |line: &str, set: &RunSettings| tree(&args(line).tree, set, 1).unwrap().builder;
        let set = RunSettings { tree: Some("axis-sah".to_owned()), ..RunSettings::default() };
        assert_eq!(builder("", &RunSettings::default()), BuildOptions::default().builder);
        assert_eq!(builder("", &set), Builder::AxisSah);
        assert_eq!(builder("--tree median", &set), Builder::Median);
    }

    #[test]
    fn every_rule_of_a_tree_can_be_changed() {
        let none = RunSettings::default();
        let line = "--tree fsah --tree-strict --tree-costs 1,2,3 --tree-min-primitives 9 --tree-depth 12 --tree-bins 40 \
                    --tree-jobs 3 --tree-geom-jobs 2";
        let found = tree(&args(line).tree, &none, 8).unwrap();
        let expected = BuildOptions {
            cost_interior: 1.0,
            cost_leaf: 2.0,
            cost_primitive: 3.0,
            min_primitives: 9,
            max_depth: Some(12),
            bins: 40,
            candidates: 40,
            jobs: 3,
            geometry_jobs: 2,
            ..BuildOptions::strict(Builder::Fsah)
        };
        assert_eq!(found, expected);
        let usual = tree(&args("").tree, &none, 8).unwrap();
        assert_eq!((usual.jobs, usual.geometry_jobs), (8, 8));
        for wrong in ["1,1", "1,1,0", "-1,1,1", "nan,1,1", "1,1,1,1"] {
            assert!(tree(&args(&format!("--tree-costs={wrong}")).tree, &none, 1).is_err(), "{wrong}");
        }
    }

    #[test]
    fn schedules_go_by_our_names_and_by_the_numbers_of_the_reference() {
        let none = RunSettings::default();
        let policy = |line: &str| schedule(&args(line).survey.common.schedule, &none, 2).unwrap().policy;
        let warehouse = |size, factor| Policy::Warehouse { size, factor };
        let dynamic = |size| Policy::Dynamic { size, significant_ns: 100_000 };
        for (line, expected) in [
            ("", warehouse(1024, 4)),
            ("--parallelization 1 --chunk-size 32 --warehouse-factor 8", warehouse(32, 8)),
            ("--parallelization 1 --chunk-size=-32", warehouse(32, 4)),
            ("--parallelization 0 --chunk-size 64", Policy::Static { size: 64 }),
            ("--parallelization 0 --chunk-size=-64", dynamic(64)),
            ("--schedule dynamic --chunk-size 64", dynamic(64)),
            (
                "--schedule dynamic --idle-threshold 0.01",
                Policy::Dynamic { size: 1024, significant_ns: 10_000 },
            ),
            ("--schedule static", Policy::Static { size: 1024 }),
            ("--schedule single --chunk-size 64", Policy::Single),
        ] {
            assert_eq!(policy(line), expected, "{line}");
        }
        assert!(schedule(&args("--chunk-size 0").survey.common.schedule, &none, 2).is_err());
        assert!(schedule(&args("--idle-threshold=-1").survey.common.schedule, &none, 2).is_err());
        let set = RunSettings {
            policy: Some("dynamic".to_owned()),
            leg_barrier: Some(true),
            ..RunSettings::default()
        };
        let found = schedule(&args("").survey.common.schedule, &set, 2).unwrap();
        assert_eq!((found.policy, found.leg_barrier), (dynamic(1024), true));
    }
}
