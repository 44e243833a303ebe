//! The tree: its components and its construction.

use super::Instances;
use super::block::{BLOCK_SIZE, Block};
use super::build::{Prim, build_kd, build_wide, collect, frame_of};
use super::frame::Frame;
use super::geometry::Geometry;
use super::heights::FieldBoxes;
use super::node::{KdNode, WideNode};
use super::options::{BuildOptions, Builder, Statistics};
use crate::memory::vec_bytes;
use rayon::prelude::*;
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
            Builder::Bvh => 85,
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
    let prims: Vec<Prim> = (0..)
        .zip(boxes)
        .filter(|(_, b)| is_sound(b))
        .map(|(id, b)| {
            let (lo, hi) = frame.local_box(b);
            Prim { lo, id, hi }
        })
        .collect();
    let (arena, statistics) = build_wide(0, &frame, prims, options);
    let block = |ids| Block::of_boxes(ids, |id| frame.local_box(&boxes[id as usize]));
    let blocks: Vec<Block> = arena.slots.chunks(BLOCK_SIZE).map(block).collect();
    let (lo, hi) = frame.local_box(&all);
    Tree::of(frame, [lo, hi], Nodes::Wide(arena.nodes), (blocks, FieldBoxes::default()), statistics)
}

fn build(geometry: &Geometry, options: &BuildOptions, keep: impl Fn(u32) -> bool + Sync) -> Tree {
    let frame = frame_of(geometry);
    let prims = collect(geometry, &frame, keep);
    let bounds = prims.iter().fold([[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]], |[lo, hi], p| {
        [[0, 1, 2].map(|a| lo[a].min(p.lo[a])), [0, 1, 2].map(|a| hi[a].max(p.hi[a]))]
    });
    let (nodes, slots, statistics) = match options.builder {
        Builder::Bvh => {
            let (arena, statistics) = build_wide(geometry.triangle_count(), &frame, prims, options);
            (Nodes::Wide(arena.nodes), arena.slots, statistics)
        }
        _ => {
            let (arena, statistics) = build_kd(geometry, frame, prims, options);
            (Nodes::Kd(arena.nodes), arena.slots, statistics)
        }
    };
    let blocks: Vec<Block> = slots
        .par_chunks(BLOCK_SIZE)
        .with_min_len(MIN_SHARED_PRIMITIVES / BLOCK_SIZE)
        .map(|ids| Block::of(geometry, &frame, ids))
        .collect();
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
