//! The tree: its components and its construction.

use super::block::{BLOCK_SIZE, Block};
use super::build::{Prim, build_kd, build_wide, collect, frame_of};
use super::frame::Frame;
use super::geometry::Geometry;
use super::heights::FieldBoxes;
use super::node::{KdNode, WideNode};
use super::options::{BuildOptions, Builder, Statistics};
use super::{Hits, Instances};
use crate::memory::vec_bytes;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use vlscan_geom::Aabb;

/// Spatial index over a [`Geometry`]: finds the first primitives that rays hit.
///
/// Immutable. It contains no part of the geometry; every query takes the geometry, which must be the one that
/// the tree was built over.
#[derive(Clone, Debug)]
pub struct Tree {
    pub(super) frame: Frame,
    /// Lower and upper corner of everything, in the tree's frame.
    pub(super) bounds: [[f32; 3]; 2],
    pub(super) nodes: Nodes,
    pub(super) blocks: Vec<Block>,
    /// The hierarchy over the boxes of height fields.
    pub(super) fields: FieldBoxes,
    statistics: Statistics,
    pub(super) instances: Option<Box<InstanceTree>>,
}

/// The trees over instances and over their models.
#[derive(Clone, Debug)]
pub(super) struct InstanceTree {
    pub instances: Arc<Instances>,
    pub models: Vec<Tree>,
    /// The tree over the boxes of the instances, which its blocks hold as cubes.
    pub top: Tree,
}

/// Minimum number of primitives for a build by several threads: one thread builds fewer before others are
/// awake.
const MIN_SHARED_PRIMITIVES: usize = 1024;
/// Number of blocks that are made before the numbers of their primitives are released.
const RELEASED_BLOCKS: usize = if cfg!(test) { 3 } else { 1 << 16 };

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Nodes {
    Kd(Vec<KdNode>),
    Wide(Vec<WideNode>),
}

impl Tree {
    /// Builds a tree over all primitives of `geometry` that are part of no height field, over the boxes of
    /// height fields and over those of grids of voxels. Primitives with a coordinate that is NaN or
    /// infinite are left out; no ray hits them. The result does not depend on the number of threads.
    ///
    /// Vertices of triangles must exist; [`Tree::try_build`] checks that.
    pub fn build(geometry: &Geometry, options: &BuildOptions) -> Tree {
        Tree::build_where(geometry, options, |_| true)
    }

    /// Builds a tree over the primitives of `geometry` whose number `keep` accepts; rays hit no others.
    pub fn build_where(
        geometry: &Geometry,
        options: &BuildOptions,
        keep: impl Fn(u32) -> bool + Send + Sync,
    ) -> Tree {
        let stored = geometry.triangles.len() + geometry.cubes.len() + geometry.grids.len();
        if options.jobs == 0 || stored <= MIN_SHARED_PRIMITIVES {
            // The global pool has all threads, or the build is too small to wake others.
            return build(geometry, options, keep);
        }
        match rayon::ThreadPoolBuilder::new().num_threads(options.jobs.max(options.geometry_jobs)).build() {
            Ok(pool) => pool.install(|| build(geometry, options, keep)),
            // The system has no more threads.
            Err(_) => build(geometry, options, keep),
        }
    }

    /// Adds instances and builds their trees. The primitive numbers of `instances` must continue those of the
    /// geometry that this tree was built over.
    pub fn with_instances(self, instances: &Arc<Instances>, options: &BuildOptions) -> Tree {
        let instances = match rayon::ThreadPoolBuilder::new().num_threads(options.jobs).build() {
            Ok(pool) if options.jobs > 0 => pool.install(|| InstanceTree::build(instances, options)),
            _ => InstanceTree::build(instances, options),
        };
        Tree { instances: Some(Box::new(instances)), ..self }
    }

    pub(super) fn of(
        frame: Frame,
        bounds: [[f32; 3]; 2],
        nodes: Nodes,
        (blocks, fields): (Vec<Block>, FieldBoxes),
        statistics: Statistics,
    ) -> Tree {
        Tree { frame, bounds, nodes, blocks, fields, statistics, instances: None }
    }

    /// Estimates the peak memory of building a tree over `triangles` triangles, in bytes; the finished tree
    /// occupies less.
    pub fn estimate_build_memory(triangles: u64, builder: Builder) -> u64 {
        let each = match builder {
            Builder::Bvh => 75,
            // Kd-trees store a triangle in several leaves. Measured in forests; terrain takes less.
            Builder::Fsah => 250,
            Builder::AxisSah => 270,
            Builder::Sah => 290,
            Builder::Median => 1500,
        };
        triangles.saturating_mul(each)
    }

    /// Size, depth and expected cost of the tree, without instances.
    pub fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// Memory of the tree in bytes, without the geometry.
    pub fn memory(&self) -> usize {
        let nodes = match &self.nodes {
            Nodes::Kd(n) => vec_bytes(n),
            Nodes::Wide(n) => vec_bytes(n),
        };
        let instances = self.instances.as_ref().map_or(0, |i| i.memory());
        nodes + vec_bytes(&self.blocks) + self.fields.memory() + size_of::<Tree>() + instances
    }
}

impl InstanceTree {
    pub fn build(instances: &Arc<Instances>, options: &BuildOptions) -> InstanceTree {
        let models = instances.models.iter().map(|m| Tree::build(&m.geometry, options)).collect();
        InstanceTree { instances: instances.clone(), models, top: over_boxes(&instances.boxes(), options) }
    }

    /// Memory of all trees in bytes, without the models.
    pub fn memory(&self) -> usize {
        self.models.iter().map(Tree::memory).sum::<usize>() + self.top.memory()
    }
}

fn over_boxes(boxes: &[Aabb], options: &BuildOptions) -> Tree {
    let is_sound = |b: &Aabb| b.min.is_finite() && b.max.is_finite() && !b.is_empty();
    let all = boxes.iter().filter(|b| is_sound(b)).fold(Aabb::EMPTY, |all, b| all.union(*b));
    let frame = Frame::around(&all);
    let mut prims: Vec<Prim> = (0..)
        .zip(boxes)
        .filter(|(_, b)| is_sound(b))
        .map(|(id, b)| {
            let (lo, hi) = frame.local_box(b);
            Prim { lo, id, hi }
        })
        .collect();
    let (tree, statistics) = build_wide(0, &frame, &mut prims, options);
    let block = |ids: &[u32]| Block::of_boxes(ids, |id| frame.local_box(&boxes[id as usize]));
    let blocks = blocks_in_order(prims, &tree.sizes, block);
    let (lo, hi) = frame.local_box(&all);
    Tree::of(frame, [lo, hi], Nodes::Wide(tree.nodes), (blocks, FieldBoxes::default()), statistics)
}

/// Blocks of these sizes, which divide the primitives in their order. Primitives are reduced to their numbers
/// before, and the numbers are released while blocks are made, which are the largest part of a tree.
fn blocks_in_order(
    prims: Vec<Prim>,
    sizes: &[u8],
    block: impl Fn(&[u32]) -> Block + Sync + Send,
) -> Vec<Block> {
    // From the last to the first, since a vector is released from its end.
    let mut ids: Vec<u32> = prims.par_iter().rev().map(|p| p.id).collect();
    drop(prims);
    let mut blocks = Vec::with_capacity(sizes.len());
    for sizes in sizes.chunks(RELEASED_BLOCKS) {
        let mut end = ids.len();
        let of_size = |size: &u8| {
            let own = end - usize::from(*size)..end;
            end = own.start;
            own
        };
        let ranges: Vec<Range<usize>> = sizes.iter().map(of_size).collect();
        let of_range = |range: &Range<usize>| {
            let mut of_block = [Hits::MISS; BLOCK_SIZE];
            of_block.iter_mut().zip(ids[range.clone()].iter().rev()).for_each(|(lane, id)| *lane = *id);
            block(&of_block)
        };
        blocks.par_extend(ranges.par_iter().with_min_len(MIN_SHARED_PRIMITIVES / BLOCK_SIZE).map(of_range));
        ids.truncate(end);
        ids.shrink_to_fit();
    }
    blocks
}

fn build(geometry: &Geometry, options: &BuildOptions, keep: impl Fn(u32) -> bool + Sync) -> Tree {
    let frame = frame_of(geometry);
    let mut prims = collect(geometry, &frame, keep);
    let bounds = prims.iter().fold([[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]], |[lo, hi], p| {
        [[0, 1, 2].map(|a| lo[a].min(p.lo[a])), [0, 1, 2].map(|a| hi[a].max(p.hi[a]))]
    });
    let block = |ids: &[u32]| Block::of(geometry, &frame, ids);
    let (nodes, blocks, statistics) = match options.builder {
        Builder::Bvh => {
            let (tree, statistics) = build_wide(geometry.triangle_count(), &frame, &mut prims, options);
            (Nodes::Wide(tree.nodes), blocks_in_order(prims, &tree.sizes, block), statistics)
        }
        _ => {
            let (arena, statistics) = build_kd(geometry, frame, prims, options);
            let slots = arena.slots.par_chunks(BLOCK_SIZE);
            let blocks = slots.with_min_len(MIN_SHARED_PRIMITIVES / BLOCK_SIZE).map(block).collect();
            (Nodes::Kd(arena.nodes), blocks, statistics)
        }
    };
    let fields = FieldBoxes::over(&geometry.fields, &frame);
    Tree::of(frame, bounds, nodes, (blocks, fields), statistics)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::DVec3;

    #[test]
    fn primitives_that_are_not_kept_are_not_hit() {
        let corners = |y: f64| [[-1.0, y, -1.0], [1.0, y, -1.0], [0.0, y, 2.0]].map(DVec3::from);
        let geometry = Geometry {
            vertices: [corners(5.0), corners(9.0)].concat(),
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            ..Geometry::default()
        };
        for builder in [Builder::Bvh, Builder::Median] {
            let first = |kept: &[u32]| {
                let tree = Tree::build_where(&geometry, &BuildOptions::of(builder), |i| kept.contains(&i));
                tree.nearest_where(&geometry, DVec3::ZERO, DVec3::Y, |_| true).map(|h| h.primitive)
            };
            assert_eq!([first(&[0, 1]), first(&[1]), first(&[])], [Some(0), Some(1), None]);
        }
    }
}
