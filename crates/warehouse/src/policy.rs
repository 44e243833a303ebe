//! Schedules: how chunks are distributed.

use super::error::{MAX_CHUNK_SIZE, MAX_FACTOR, MAX_THREADS, ScheduleError};

/// The four schedules of spec kdtree-and-scheduling §3. With one thread they are identical.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// One task at a time for every idle worker; the producer waits and never computes (§3.2).
    Single,
    /// Chunks of `size` tasks for idle workers; while all are busy the producer computes single tasks of the
    /// next chunk (§3.3).
    Static {
        /// Tasks per chunk.
        size: u32,
    },
    /// Like [`Policy::Static`], with a size that follows the workers' idle times (§3.4, `sizing`).
    Dynamic {
        /// Tasks of the first chunk.
        size: u32,
        /// Idle times below this, and changes up to this, are ignored: τ and ε, ns.
        significant_ns: u64,
    },
    /// Chunks are stored in a bounded queue, the warehouse; while it is full the producer computes a complete
    /// chunk (§3.5).
    Warehouse {
        /// Tasks per chunk.
        size: u32,
        /// Maximum queued chunks per worker.
        factor: usize,
    },
}

vlscan_choice::choices! {
    /// The kinds of [`Policy`], without their parameters. They do not affect the points.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum PolicyKind: default PolicyKind::Warehouse {
        /// Chunks wait in a bounded queue; while it is full the producer computes a chunk itself.
        Warehouse = "warehouse",
        /// Chunks go to free workers, and grow or shrink with the workers' idle times.
        Dynamic = "dynamic",
        /// Chunks of one size go to free workers; while all are busy the producer computes single pulses.
        Static = "static",
        /// Pulses go to free workers one by one; the producer computes none.
        Single = "single",
    }
}

impl Policy {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Policy::Single => "single",
            Policy::Static { .. } => "static",
            Policy::Dynamic { .. } => "dynamic",
            Policy::Warehouse { .. } => "warehouse",
        }
    }

    /// Tasks of the first chunk, at least one.
    pub fn size(self) -> u32 {
        match self {
            Policy::Single => 1,
            Policy::Static { size } | Policy::Dynamic { size, .. } | Policy::Warehouse { size, .. } => {
                size.max(1)
            }
        }
    }
}

/// Distribution of the work to threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Computing threads including the producer's, at least one.
    pub threads: usize,
    /// How chunks are distributed.
    pub policy: Policy,
    /// True if a leg begins only when the one before it is done, as in the paper. This costs time and does
    /// not change the results.
    pub leg_barrier: bool,
}

impl Schedule {
    /// Checks the number of threads and the parameters of the policy; [`run`](crate::run()) does the same.
    ///
    /// # Errors
    /// Numbers that are 0 or exceed their limits.
    pub fn check(&self) -> Result<(), ScheduleError> {
        if !(1..=MAX_THREADS).contains(&self.threads) {
            return Err(ScheduleError::Threads(self.threads));
        }
        let (size, factor) = match self.policy {
            Policy::Single => (1, 1),
            Policy::Static { size } | Policy::Dynamic { size, .. } => (size, 1),
            Policy::Warehouse { size, factor } => (size, factor),
        };
        if !(1..=MAX_CHUNK_SIZE).contains(&size) {
            return Err(ScheduleError::Size(size));
        }
        if !(1..=MAX_FACTOR).contains(&factor) {
            return Err(ScheduleError::Factor(factor));
        }
        Ok(())
    }

    /// Threads besides the producer's.
    pub fn workers(&self) -> usize {
        self.threads.max(1) - 1
    }

    /// Maximum number of queued chunks.
    pub fn queue_capacity(&self) -> usize {
        match self.policy {
            Policy::Warehouse { factor, .. } => (factor.max(1) * self.workers()).max(1),
            // A chunk is sent only to an idle worker.
            _ => self.workers().max(1),
        }
    }

    /// Maximum number of pending results besides the one that the collector waits for: one for every chunk
    /// that is queued or being computed, and as many finished ones. There is room for the single tasks that a
    /// producer computes while a worker has a complete chunk, and, where chunks are small, for enough results
    /// that no thread waits while the collector is briefly descheduled.
    pub fn results_capacity(&self) -> usize {
        let size = self.policy.size();
        let singles = match self.policy {
            Policy::Static { .. } => size.min(MAX_TASKS_AHEAD),
            Policy::Dynamic { .. } => MAX_TASKS_AHEAD,
            Policy::Single | Policy::Warehouse { .. } => 0,
        };
        let chunks = 2 * (self.queue_capacity() + self.threads.max(1));
        let results = chunks + (singles as usize).div_ceil(MAX_BUFFERED_TASKS);
        results.max((MAX_TASKS_AHEAD / size) as usize)
    }
}

/// Maximum number of tasks in small chunks by which the producer is ahead of the collector, and of single
/// tasks by which it is ahead of a worker with a chunk.
const MAX_TASKS_AHEAD: u32 = 4096;

/// Single tasks that the producer computes before it passes their results to the collector, which may have to
/// be woken.
pub const MAX_BUFFERED_TASKS: usize = 64;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedules_are_within_their_limits() {
        let check = |threads, policy| Schedule { threads, policy, leg_barrier: false }.check();
        let warehouse = |size, factor| Policy::Warehouse { size, factor };
        for (threads, policy, expected) in [
            (1, Policy::Single, Ok(())),
            (MAX_THREADS, warehouse(MAX_CHUNK_SIZE, MAX_FACTOR), Ok(())),
            (0, Policy::Single, Err(ScheduleError::Threads(0))),
            (MAX_THREADS + 1, Policy::Single, Err(ScheduleError::Threads(MAX_THREADS + 1))),
            (1, Policy::Static { size: 0 }, Err(ScheduleError::Size(0))),
            (1, Policy::Dynamic { size: 0, significant_ns: 1 }, Err(ScheduleError::Size(0))),
            (1, warehouse(MAX_CHUNK_SIZE + 1, 1), Err(ScheduleError::Size(MAX_CHUNK_SIZE + 1))),
            (1, warehouse(1, 0), Err(ScheduleError::Factor(0))),
            (1, warehouse(1, usize::MAX), Err(ScheduleError::Factor(usize::MAX))),
        ] {
            assert_eq!(check(threads, policy), expected, "{threads} {policy:?}");
        }
    }
}
