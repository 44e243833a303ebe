//! The combinations of trees, schedules and threads that are compared.

use crate::args::Args;
use serde::Serialize;
use vlscan_base::error::{Error, Result};
use vlscan_trace::{BuildOptions, Builder};
use vlscan_warehouse::{Policy, PolicyKind, Schedule};

pub struct Matrix {
    pub trees: Vec<(&'static str, BuildOptions)>,
    /// Schedules that every tree is flown with. On one thread they are equivalent and reported as
    /// `sequential`.
    pub variants: Vec<Variant>,
    pub repetitions: u32,
    pub warm_up: u32,
}

#[derive(Clone, Copy, PartialEq)]
pub struct Variant {
    pub schedule: Schedule,
    /// Pulses per chunk of the sequential counterpart; under the single schedule they differ from the
    /// schedule's chunk size.
    pub chunk: u32,
}

/// A tree and a schedule, with the names used in tables and JSON.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Combination {
    pub tree: &'static str,
    /// Name of the schedule; `sequential` on one thread.
    pub schedule: &'static str,
    /// Pulses per chunk (of the first one, when the size is dynamic).
    pub chunk_size: u32,
    /// Maximum queued chunks per worker.
    pub warehouse_factor: Option<usize>,
    /// True if there is a barrier between legs.
    pub leg_barrier: bool,
    pub threads: usize,
}

impl Matrix {
    /// The last schedule of several threads, and of the largest chunks.
    pub fn parallel(&self) -> Option<Schedule> {
        let parallel = self.variants.iter().filter(|variant| variant.schedule.threads > 1);
        parallel.max_by_key(|variant| variant.schedule.policy.size()).map(|variant| variant.schedule)
    }
}

impl Variant {
    pub fn with_tree(&self, tree: &'static str) -> Combination {
        let Schedule { threads, policy, leg_barrier } = self.schedule;
        let (schedule, chunk_size, warehouse_factor) = match policy {
            _ if threads == 1 => ("sequential", self.chunk, None),
            Policy::Warehouse { size, factor } => ("warehouse", size, Some(factor)),
            policy => (policy.name(), policy.size(), None),
        };
        Combination { tree, schedule, chunk_size, warehouse_factor, leg_barrier, threads }
    }
}

impl Combination {
    /// Describes the schedule in words.
    pub fn schedule_text(&self) -> String {
        format!("{}{}", self.schedule, if self.leg_barrier { " + barrier" } else { "" })
    }
}

impl Matrix {
    /// Returns the combinations requested on the command line.
    pub fn new(args: &Args) -> Result<Matrix> {
        let tree = |&builder: &Builder| Ok((builder.name(), args.rules.build_options(builder)?));
        let trees = args.tree.iter().map(tree).collect::<Result<Vec<_>>>()?;
        let mut wanted = thread_counts(&args.threads)?;
        if wanted.is_empty() {
            wanted = (0..).map(|i| 1 << i).take_while(|&n| n < cores()).chain([cores()]).collect();
        }
        // Speedups are relative to one thread.
        if !wanted.contains(&1) {
            wanted.insert(0, 1);
        }
        let mut variants: Vec<Variant> = Vec::new();
        for &threads in &wanted {
            for &leg_barrier in args.leg_barrier.values() {
                for &kind in &args.schedule {
                    for &chunk in &args.chunk_size {
                        for &factor in &args.warehouse_factor {
                            let policy = match threads {
                                1 => Policy::Static { size: chunk },
                                _ => args.policy(kind, chunk, factor),
                            };
                            let chunk = if kind == PolicyKind::Single && threads > 1 { 1 } else { chunk };
                            let leg_barrier = leg_barrier && threads > 1;
                            let variant =
                                Variant { schedule: Schedule { threads, policy, leg_barrier }, chunk };
                            if !variants.contains(&variant) {
                                variants.push(variant);
                            }
                        }
                    }
                }
            }
        }
        Ok(Matrix { trees, variants, repetitions: args.repetitions, warm_up: args.warm_up })
    }
}

pub fn thread_counts(wanted: &[usize]) -> Result<Vec<usize>> {
    let mut all: Vec<usize> = Vec::new();
    for &n in wanted {
        if !(1..=65_536).contains(&n) {
            return Err(Error::input(format!("expected 1 to 65536 threads, found {n}")));
        }
        if !all.contains(&n) {
            all.push(n);
        }
    }
    Ok(all)
}

pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
