//! How chunks are distributed.

/// The four schedules of spec kdtree-and-scheduling §3. With one thread there is no difference between them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// One task at a time for every free worker; the producer waits and never computes (§3.2).
    Single,
    /// Chunks of `size` tasks for free workers; while all are busy the producer computes single tasks of the next chunk
    /// (§3.3).
    Static {
        /// Tasks per chunk.
        size: u32,
    },
    /// As [`Policy::Static`], with a size that follows the workers' idle times (§3.4, `sizing`).
    Dynamic {
        /// Tasks of the first chunk.
        size: u32,
        /// Idle times below this, and changes up to this, are ignored: τ and ε, ns.
        significant_ns: u64,
    },
    /// Chunks wait in a bounded queue, the warehouse; while it is full the producer computes a whole chunk (§3.5).
    Warehouse {
        /// Tasks per chunk.
        size: u32,
        /// Chunks that may wait, per worker.
        factor: usize,
    },
}

/// The kinds of [`Policy`], without their parameters. The points are the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PolicyKind {
    /// Chunks wait in a bounded queue; while it is full the producer computes a chunk itself.
    #[default]
    Warehouse,
    /// Chunks go to free workers, and grow or shrink with the workers' idle times.
    Dynamic,
    /// Chunks of one size go to free workers; while all are busy the producer computes single pulses.
    Static,
    /// Pulses go to free workers one by one; the producer computes none.
    Single,
}

impl Policy {
    /// The name on the command line.
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

/// How the work is distributed to threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Threads that compute, the producer's included; at least one.
    pub threads: usize,
    /// How chunks are distributed.
    pub policy: Policy,
    /// Whether a leg begins only when everything of the one before is done, as in the paper. This costs time and changes
    /// no result.
    pub leg_barrier: bool,
}

impl Schedule {
    /// Threads beside the producer's.
    pub fn workers(&self) -> usize {
        self.threads.max(1) - 1
    }

    /// Chunks that may wait for a worker.
    pub(super) fn queue_capacity(&self) -> usize {
        match self.policy {
            Policy::Warehouse { factor, .. } => (factor.max(1) * self.workers()).max(1),
            // A chunk is only sent to an idle worker.
            _ => self.workers().max(1),
        }
    }

    /// Results that may be pending beyond the one that the collector waits for: one of every chunk that waits or is being
    /// computed, and as many finished ones. There is room for the single tasks that a producer computes while a worker has
    /// a whole chunk, and, where chunks are small, for so many results that nothing waits for a collector that is off its
    /// core for a moment.
    pub(super) fn results_capacity(&self) -> usize {
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

/// Tasks of small chunks by which the producer may be ahead of the collector, and single tasks by which it may be ahead of a
/// worker with a chunk.
const MAX_TASKS_AHEAD: u32 = 4096;

/// Single tasks that the producer computes before it passes their results to the collector, which may have to wake up.
pub(super) const MAX_BUFFERED_TASKS: usize = 64;
