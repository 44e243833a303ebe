//! How chunks are handed out.

use super::feed::HELD;

/// The four schedules of spec kdtree-and-scheduling §3. With one thread they are all the same: chunk after chunk.
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
    /// As [`Policy::Static`], with a size that follows the workers' idle times (§3.4, [`super::Dropper`]).
    Dynamic {
        /// Tasks of the first chunk.
        size: u32,
        /// Idle times below this, and changes up to this, mean nothing: τ and ε, ns.
        significant_ns: u64,
    },
    /// Chunks wait in a bounded warehouse; while it is full the producer works off a whole chunk (§3.5).
    Warehouse {
        /// Tasks per chunk.
        size: u32,
        /// Chunks that may wait, per worker.
        factor: usize,
    },
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

/// How the work is spread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Threads that compute, the producer's included; at least one.
    pub threads: usize,
    /// How chunks are handed out.
    pub policy: Policy,
    /// Whether a leg begins only when everything of the one before is done, as in the paper. Costs time and changes
    /// nothing else.
    pub leg_barrier: bool,
}

impl Schedule {
    /// Threads beside the producer's.
    pub fn workers(&self) -> usize {
        self.threads.max(1) - 1
    }

    /// Chunks that may wait for a worker.
    pub(super) fn capacity(&self) -> usize {
        match self.policy {
            Policy::Warehouse { factor, .. } => (factor.max(1) * self.workers()).max(1),
            // Only as many as there are free workers are ever sent.
            _ => self.workers().max(1),
        }
    }

    /// Results that may have been announced and not been collected, beyond the one that the collector waits for: those of
    /// every chunk that waits or is being worked on, and as many finished ones. Where a producer computes single tasks while
    /// a worker has a whole chunk, there is a place for those, too; and where chunks are small, for so many of them that
    /// nobody waits for a collector that is off its core for a moment.
    pub(super) fn receipts(&self) -> usize {
        let size = self.policy.size();
        let singles = match self.policy {
            Policy::Static { .. } => size.min(AHEAD),
            Policy::Dynamic { .. } => AHEAD,
            Policy::Single | Policy::Warehouse { .. } => 0,
        };
        let chunks = 2 * (self.capacity() + self.threads.max(1));
        (chunks + (singles as usize).div_ceil(HELD)).max((AHEAD / size) as usize)
    }
}

/// Tasks of small chunks by which a producer may be ahead of the collector, and single ones by which it may be ahead of a
/// worker with a chunk.
const AHEAD: u32 = 4096;
