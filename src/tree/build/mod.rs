//! Building trees.

mod kd;
mod ledger;
mod prim;
mod split;
mod wide;

pub(crate) use kd::{DEEPEST, build_kd};
pub(crate) use prim::{Prim, collect, frame_of};
pub(crate) use wide::{DEEPEST_WIDE, build_wide};

use super::node::KdNode;
use rayon::prelude::*;

/// Nodes of at least this many primitives are worked on by all threads: the upper levels, where there are fewer nodes
/// than threads (spec §2.3).
const MANY: usize = 1 << 16;

/// Folds the primitives of a node, by all threads if they are many. `join` must not care about grouping.
fn fold<T: Send>(
    prims: &[Prim],
    nothing: impl Fn() -> T + Sync + Send,
    add: impl Fn(&mut T, &Prim) + Sync,
    join: impl Fn(T, T) -> T + Sync + Send,
) -> T {
    fold_by(crew(prims, rayon::current_num_threads()), prims, nothing, add, join)
}

/// How many of `threads` are worth being set upon one node.
fn crew(prims: &[Prim], threads: usize) -> usize {
    if prims.len() < MANY { 1 } else { threads.max(1) }
}

/// Folds the primitives of a node in as many pieces at a time. `join` must not care about grouping.
fn fold_by<T: Send>(
    crew: usize,
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
    if crew < 2 {
        return one(prims);
    }
    prims.par_chunks(prims.len().div_ceil(crew).max(1)).map(one).reduce(&nothing, join)
}

/// A tree under construction: nodes, and the primitives of its leaves in whole blocks.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Arena<N> {
    pub nodes: Vec<N>,
    /// Primitive numbers by block and lane.
    pub slots: Vec<u32>,
}

/// The kd-tree's arena.
pub(crate) type KdArena = Arena<KdNode>;
