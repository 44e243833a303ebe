//! Cost of a chunk besides its work, by schedule and number of threads.
//!
//! ```text
//! cargo bench -p vlscan-warehouse
//! ```
//!
//! Chunks of one task with no work: only handing over, taking and collecting remain.

use std::sync::Arc;
use std::time::Instant;
use vlscan_base::{Error, Result};
use vlscan_warehouse::{Collect, JobQueue, Outcome, Policy, Schedule, Stop, Tasks, run};

const CHUNKS: u32 = 100_000;
const ROUNDS: usize = 5;

struct Chunk;

impl Tasks for Chunk {
    fn tasks(&self) -> u32 {
        1
    }
}

struct Done;

impl Outcome for Done {}

struct Discard;

impl Collect<Done> for Discard {
    type Summary = ();
    type Error = Error;

    fn take(&mut self, _: Done, _more_waiting: bool) -> Result<()> {
        Ok(())
    }

    fn finish(self) -> Result<()> {
        Ok(())
    }

    fn abort(self) {}
}

fn seconds(threads: usize, policy: Policy) -> Result<f64> {
    let started = Instant::now();
    run(
        Schedule { threads, policy, leg_barrier: false },
        &Arc::new(JobQueue::new(threads)),
        &Stop::new(),
        None,
        || |_: Chunk| Ok(Done),
        |feed| (0..CHUNKS).try_for_each(|_| feed.put(Chunk)),
        Discard,
    )?;
    Ok(started.elapsed().as_secs_f64())
}

fn main() -> Result<()> {
    println!("{:<12}{:>9}{:>14}", "schedule", "threads", "ns per chunk");
    let policies = [
        Policy::Warehouse { size: 1, factor: 4 },
        Policy::Dynamic { size: 1, significant_ns: 100_000 },
        Policy::Static { size: 1 },
        Policy::Single,
    ];
    for threads in [1, 2, std::thread::available_parallelism().map_or(2, usize::from)] {
        for policy in policies {
            let mut least = f64::INFINITY;
            for _ in 0..ROUNDS {
                least = least.min(seconds(threads, policy)?);
            }
            println!("{:<12}{threads:>9}{:>14.0}", policy.name(), 1e9 * least / f64::from(CHUNKS));
        }
    }
    Ok(())
}
