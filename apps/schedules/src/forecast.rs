//! Schedules with other numbers of threads: measured task times in simulated time.

use crate::matrix::{Combination, Matrix, Variant};
use crate::measure::Cell;
use crate::replay::replay;
use crate::workload::Workload;
use serde::Serialize;
use vlscan_warehouse::{Schedule, SizeChange};

#[derive(Clone, Debug, Serialize)]
pub struct Forecast {
    /// Tree, schedule and threads, with as many cores.
    #[serde(flatten)]
    pub of: Combination,
    /// Time of the simulation without completing the outputs, s.
    pub simulation_s: f64,
    /// Time on one thread with the same chunks, divided by this time.
    pub speedup: f64,
    /// Fraction of all threads' time spent computing.
    pub utilisation: f64,
    /// Fraction of the time in which the producer makes and hands over chunks.
    pub producing: f64,
    /// Measured time of the combination on this machine, without completing the outputs, s.
    pub measured_s: Option<f64>,
    /// Processor time of all threads together, s.
    pub cpu_s: f64,
    /// Measured processor time on this machine, s.
    pub measured_cpu_s: Option<f64>,
    /// History of the size of dynamic chunks.
    pub sizes: Vec<SizeChange>,
}

pub fn simulate(
    tree: &'static str,
    load: &Workload,
    matrix: &Matrix,
    threads: &[usize],
    measured: &[Cell],
) -> Vec<Forecast> {
    let mut variants: Vec<Variant> = Vec::new();
    for variant in matrix.variants.iter().filter(|v| v.schedule.threads > 1) {
        let variant = Variant { schedule: Schedule { threads: 2, ..variant.schedule }, ..*variant };
        if !variants.contains(&variant) {
            variants.push(variant);
        }
    }
    let simulate = |threads: usize, variant: &Variant| {
        let with = |threads| Schedule { threads, ..variant.schedule };
        let (alone, replayed) = (replay(load, &with(1)).seconds, replay(load, &with(threads)));
        let of = Combination { threads, ..variant.with_tree(tree) };
        let cell = measured.iter().find(|cell| cell.of == of);
        Forecast {
            of,
            simulation_s: replayed.seconds,
            speedup: alone / replayed.seconds.max(f64::MIN_POSITIVE),
            utilisation: replayed.utilisation,
            producing: replayed.producing,
            measured_s: cell.map(|c| c.simulation_s - c.completing_s),
            cpu_s: replayed.cpu_s,
            measured_cpu_s: cell.map(|c| c.cpu_s),
            sizes: replayed.sizes.entries().to_vec(),
        }
    };
    threads
        .iter()
        .flat_map(|&n| variants.iter().map(move |variant| (n, variant)))
        .map(|(n, v)| simulate(n, v))
        .collect()
}
