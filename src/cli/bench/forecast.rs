//! How the schedules would do with other numbers of threads: measured task times in simulated time.

use super::measure::Cell;
use super::{Flight, Matrix};
use crate::schedule::{Schedule, SizeChange, Workload, replay};
use serde::Serialize;

/// A combination in simulated time.
#[derive(Clone, Debug, Serialize)]
pub struct Forecast {
    /// Builder of the tree.
    pub tree: &'static str,
    /// Name of the schedule.
    pub schedule: &'static str,
    /// Pulses per chunk.
    pub chunk_size: u32,
    /// Chunks that may wait per worker.
    pub warehouse_factor: Option<usize>,
    /// Whether legs are kept apart.
    pub leg_barrier: bool,
    /// Threads, on as many cores.
    pub threads: usize,
    /// Simulation, s.
    pub simulation_s: f64,
    /// One thread with the same chunks by this one.
    pub speedup: f64,
    /// Part of all threads' time that goes into computing.
    pub utilisation: f64,
    /// Part of the time in which the producer makes and hands over chunks.
    pub producing: f64,
    /// What was measured here for the same combination, s.
    pub measured_s: Option<f64>,
    /// Processor time of all threads together, s.
    pub cpu_s: f64,
    /// What was measured of that here.
    pub measured_cpu_s: Option<f64>,
    /// Chunk sizes in the course of the simulation, of dynamic chunks.
    pub sizes: Vec<SizeChange>,
}

/// Every schedule of the matrix with each number of threads.
pub fn of(
    tree: &'static str,
    load: &Workload,
    matrix: &Matrix,
    threads: &[usize],
    measured: &[Cell],
) -> Vec<Forecast> {
    let mut schedules: Vec<Flight> = Vec::new();
    for flight in matrix.flights.iter().filter(|f| f.settings.threads > 1) {
        let flight = Flight { settings: Schedule { threads: 2, ..flight.settings }, ..*flight };
        if !schedules.contains(&flight) {
            schedules.push(flight);
        }
    }
    let mut all = Vec::new();
    for &threads in threads {
        for flight in &schedules {
            let alone = replay(load, &Schedule { threads: 1, ..flight.settings }).seconds;
            let settings = Schedule { threads, ..flight.settings };
            let replayed = replay(load, &settings);
            let (schedule, chunk_size, warehouse_factor) = flight.label();
            let is_same = |c: &&Cell| {
                (c.schedule, c.chunk_size, c.warehouse_factor) == (schedule, chunk_size, warehouse_factor)
                    && (c.threads, c.leg_barrier) == (threads, settings.leg_barrier)
            };
            let cell = measured.iter().find(is_same);
            all.push(Forecast {
                tree,
                schedule,
                chunk_size,
                warehouse_factor,
                leg_barrier: settings.leg_barrier,
                threads,
                simulation_s: replayed.seconds,
                speedup: alone / replayed.seconds.max(f64::MIN_POSITIVE),
                utilisation: replayed.utilisation,
                producing: replayed.producing,
                measured_s: cell.map(|c| c.simulation_s),
                cpu_s: replayed.cpu_s,
                measured_cpu_s: cell.map(|c| c.cpu_s),
                sizes: replayed.sizes.entries().to_vec(),
            });
        }
    }
    all
}
