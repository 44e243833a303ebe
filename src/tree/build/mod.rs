//! Building trees.

mod kd;
mod ledger;
mod prim;
mod split;
mod wide;

pub(crate) use kd::{DEEPEST, build_kd};
pub(crate) use prim::{collect, frame_of};
pub(crate) use wide::{DEEPEST_WIDE, build_wide};

use super::node::KdNode;

/// A tree under construction: nodes, and the primitives of its leaves in whole blocks.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Arena<N> {
    pub nodes: Vec<N>,
    /// Primitive numbers by block and lane.
    pub slots: Vec<u32>,
}

/// The kd-tree's arena.
pub(crate) type KdArena = Arena<KdNode>;
