//! The builders of trees.
//!
//! | file | contents |
//! |---|---|
//! | `prim` | primitives of the builders: boxes |
//! | `split`, `cost` | the split searches of a kd-tree node; acceptance of splits by cost |
//! | `kd` | the recursion of the kd builders |
//! | `wide` | the bounding volume hierarchy |

mod cost;
mod kd;
mod prim;
mod split;
mod wide;

pub(crate) use kd::{MAX_DEPTH, build_kd};
pub(crate) use prim::{Prim, collect, frame_of};
pub(crate) use wide::{MAX_WIDE_DEPTH, build_wide};

use super::node::KdNode;
use rayon::prelude::*;

/// Minimum number of primitives of a node that several threads work on together: in the upper levels there
/// are fewer nodes than threads (spec tree-and-schedule §2.3).
const MIN_TEAM_PRIMITIVES: usize = 1 << 16;

/// Folds the primitives of a node, in parallel if they are many. `join` must be associative.
fn fold<T: Send>(
    prims: &[Prim],
    nothing: impl Fn() -> T + Sync + Send,
    add: impl Fn(&mut T, &Prim) + Sync,
    join: impl Fn(T, T) -> T + Sync + Send,
) -> T {
    let threads = if prims.len() < MIN_TEAM_PRIMITIVES { 1 } else { rayon::current_num_threads() };
    fold_by(threads, prims, nothing, add, join)
}

/// Folds the primitives of a node by several threads, one piece each. `join` must be associative.
fn fold_by<T: Send>(
    threads: usize,
    prims: &[Prim],
    nothing: impl Fn() -> T + Sync + Send,
    add: impl Fn(&mut T, &Prim) + Sync,
    join: impl Fn(T, T) -> T + Sync + Send,
) -> T {
    let one = |prims: &[Prim]| {
        let mut sum = nothing();
        for p in prims {
            add(&mut sum, p);
        }
        sum
    };
    if threads < 2 {
        return one(prims);
    }
    pieces(threads, prims).map(one).reduce(&nothing, join)
}

/// Divides the primitives of a node into one piece per thread.
fn pieces(threads: usize, prims: &[Prim]) -> rayon::slice::Chunks<'_, Prim> {
    prims.par_chunks(prims.len().div_ceil(threads.max(1)).max(1))
}

/// A kd-tree under construction: nodes, and the primitives of its leaves in complete blocks.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct KdArena {
    pub nodes: Vec<KdNode>,
    /// Primitive numbers by block and lane.
    pub slots: Vec<u32>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn threads_fold_a_piece_each() {
        let prims: Vec<Prim> = (0..1000).map(|id| Prim { lo: [0.0; 3], id, hi: [1.0; 3] }).collect();
        for threads in [1, 2, 3, 7] {
            let folded = AtomicUsize::new(0);
            let add = |sum: &mut (u64, bool), p: &Prim| {
                // Counts the pieces, each of which starts from the initial value.
                if !std::mem::replace(&mut sum.1, true) {
                    folded.fetch_add(1, Ordering::Relaxed);
                }
                sum.0 += u64::from(p.id);
            };
            let (sum, _) = fold_by(threads, &prims, || (0, false), add, |a, b| (a.0 + b.0, a.1 || b.1));
            assert_eq!((sum, folded.into_inner()), (499_500, threads));
        }
    }
}
