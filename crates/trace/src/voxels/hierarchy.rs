//! The sparse hierarchy over the cells of a grid: nodes with sixteen children, of which those with voxels are
//! stored.
//!
//! Positions are by the axes of the grid, from that along which numbers advance most slowly to that of rows.
//! A node of the lowest level, a brick, has four by four rows of sixteen cells; one of the next has four by
//! four bricks, a cube of 16³ cells; above, the shorter sides of nodes are doubled four times per level.

use super::VoxelCells;
use crate::memory::vec_bytes;
use rayon::prelude::*;

/// Binary logarithm of the number of children.
const CHILD_BITS: u32 = 4;
/// Children of a node.
const CHILDREN: usize = 1 << CHILD_BITS;

/// Cells of a row within a brick.
pub(super) const ROW_CELLS: usize = 16;

/// Binary logarithms of the sides of a brick, and of those of a node above bricks, in cells.
const BRICK_LOGS: [u32; 3] = [2, 2, ROW_CELLS.ilog2()];
const CUBE_LOG: u32 = 4;
/// Cells along the sides of a node above bricks.
const CUBE: usize = 1 << CUBE_LOG;

/// Maximum number of levels: positions have 30 bits on two axes and 16 on that of rows.
const MAX_LEVELS: usize = 20;

/// Maximum number of pending visits: every level leaves up to fifteen.
pub(crate) const MAX_GRID_STACK: usize = stack_of(MAX_LEVELS);

/// Number of levels that grids have rarely more of, and their pending visits.
pub(super) const COMMON_LEVELS: usize = 7;
pub(super) const COMMON_STACK: usize = stack_of(COMMON_LEVELS);

const fn stack_of(levels: usize) -> usize {
    levels * (CHILDREN - 1) + CHILDREN
}

/// The levels of the hierarchy, from the bricks upwards to that of the root alone.
#[derive(Clone, Debug)]
pub(super) struct Hierarchy {
    levels: Vec<Level>,
    /// The lowest cell of the root.
    base: [u32; 3],
}

#[derive(Clone, Debug)]
struct Level {
    /// Binary logarithms of the number of children along each axis.
    bits: [u32; 3],
    /// Binary logarithms of the sides of children, in cells.
    logs: [u32; 3],
    /// The place of the child in each lane along each axis, in sides of children from the first.
    places: [[f32; CHILDREN]; 3],
    /// The children that have voxels, by node.
    masks: Vec<u16>,
    /// Index of each node's first child in the level below; empty for bricks, whose children are rows.
    firsts: Vec<u32>,
}

/// A node of the hierarchy: its level (0 for a row of cells within a brick, 1 for bricks), its index there,
/// and its lowest cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GridNode {
    pub level: u32,
    pub index: u32,
    pub base: [u32; 3],
}

impl GridNode {
    pub const NONE: GridNode = GridNode { level: 0, index: 0, base: [0; 3] };
}

/// The children of a node.
pub(super) struct Children<'a> {
    level: &'a Level,
    node: GridNode,
    /// The lanes of children that have voxels.
    pub mask: u32,
}

impl Children<'_> {
    /// Binary logarithms of the sides of children, in cells, and of the number of children along an axis.
    #[inline(always)]
    pub fn logs(&self, axis: usize) -> (u32, u32) {
        (self.level.logs[axis], self.level.bits[axis])
    }

    /// The place of the child in each lane along an axis, in sides of children from the first.
    #[inline(always)]
    pub fn places(&self, axis: usize) -> &[f32; CHILDREN] {
        &self.level.places[axis]
    }

    /// The child in a lane of the mask.
    #[inline(always)]
    pub fn child(&self, lane: usize) -> GridNode {
        let (mut rest, mut base) = (lane as u32, self.node.base);
        for axis in [2, 1, 0] {
            let (log, bits) = self.logs(axis);
            base[axis] += (rest & ((1 << bits) - 1)) << log;
            rest >>= bits;
        }
        let before = (self.mask & ((1 << lane) - 1)).count_ones();
        let index = self.level.firsts.get(self.node.index as usize).map_or(0, |first| first + before);
        GridNode { level: self.node.level - 1, index, base }
    }
}

/// A node while its level is built.
#[derive(Clone, Copy)]
struct Built {
    /// Position in units of its sides.
    at: [u32; 3],
    mask: u16,
    first: u32,
}

impl Hierarchy {
    /// Builds the hierarchy, on all threads of the pool.
    pub fn over(cells: &VoxelCells) -> Hierarchy {
        let slow = cells.slow_range();
        let slabs: Vec<(Vec<u16>, Vec<Built>)> = (slow.start / CUBE..slow.end.div_ceil(CUBE))
            .into_par_iter()
            .map(|slab| build_slab(cells, slab))
            .collect();
        let mut masks = Vec::with_capacity(slabs.iter().map(|slab| slab.0.len()).sum());
        let mut nodes = Vec::new();
        for (bricks, above) in slabs {
            let before = masks.len() as u32;
            masks.extend(bricks);
            nodes.extend(above.into_iter().map(|node| Built { first: before + node.first, ..node }));
        }
        let (of_bricks, logs) = ([2, 2, 0], [0, 0, BRICK_LOGS[2]]);
        let places = places_of(of_bricks);
        let bricks = Level { bits: of_bricks, logs, places, masks, firsts: Vec::new() };
        let mut levels = vec![bricks];
        let (mut bits, mut logs) = ([2, 2, 0], BRICK_LOGS);
        loop {
            let of_nodes = [0, 1, 2].map(|axis| logs[axis] + bits[axis]);
            let above = doublings(of_nodes, cells.dimensions());
            nodes.par_sort_unstable_by_key(|node| (parent(node, above), lane(node, above)));
            levels.push(Level {
                bits,
                logs,
                places: places_of(bits),
                masks: nodes.iter().map(|node| node.mask).collect(),
                firsts: nodes.iter().map(|node| node.first).collect(),
            });
            if nodes.len() <= 1 {
                let base = |axis: usize| nodes.first().map_or(0, |root| root.at[axis] << of_nodes[axis]);
                return Hierarchy { base: [0, 1, 2].map(base), levels };
            }
            let chunks = nodes.chunk_by(|a, b| parent(a, above) == parent(b, above));
            let mut first = 0;
            nodes = chunks
                .map(|children| {
                    let mask = children.iter().fold(0, |mask, node| mask | 1 << lane(node, above));
                    let node = Built { at: parent(&children[0], above), mask, first };
                    first += children.len() as u32;
                    node
                })
                .collect();
            (bits, logs) = (above, of_nodes);
        }
    }

    /// The root.
    #[inline(always)]
    pub fn root(&self) -> GridNode {
        GridNode { level: self.levels.len() as u32, index: 0, base: self.base }
    }

    /// The children of a node that is not a row.
    #[inline(always)]
    pub fn children(&self, node: GridNode) -> Children<'_> {
        let level = &self.levels[node.level as usize - 1];
        Children { level, node, mask: u32::from(level.masks[node.index as usize]) }
    }

    pub fn memory(&self) -> usize {
        self.levels.iter().map(|level| vec_bytes(&level.masks) + vec_bytes(&level.firsts)).sum()
    }
}

fn parent(node: &Built, bits: [u32; 3]) -> [u32; 3] {
    [0, 1, 2].map(|axis| node.at[axis] >> bits[axis])
}

fn lane(node: &Built, bits: [u32; 3]) -> u32 {
    let within = |axis: usize| node.at[axis] & ((1 << bits[axis]) - 1);
    (within(0) << bits[1] | within(1)) << bits[2] | within(2)
}

/// The place of the child in each lane along each axis of a node with this many children (binary logarithms).
fn places_of(bits: [u32; 3]) -> [[f32; CHILDREN]; 3] {
    let below = [bits[1] + bits[2], bits[2], 0];
    [0, 1, 2].map(|axis| std::array::from_fn(|lane| (lane >> below[axis] & ((1 << bits[axis]) - 1)) as f32))
}

/// How often each side of the nodes of a level, with these logarithms, is doubled in the level above: the
/// shortest one four times, as long as the grid is longer.
fn doublings(mut logs: [u32; 3], dimensions: [u32; 3]) -> [u32; 3] {
    let mut bits = [0; 3];
    for _ in 0..CHILD_BITS {
        let is_covered = |axis: &usize| 1u64 << logs[*axis] >= u64::from(dimensions[*axis]);
        let Some(axis) = (0..3).min_by_key(|axis| (is_covered(axis), logs[*axis])) else { return bits };
        bits[axis] += 1;
        logs[axis] += 1;
    }
    bits
}

/// The bricks of sixteen positions along the slowest axis, and the nodes above them.
fn build_slab(cells: &VoxelCells, slab: usize) -> (Vec<u16>, Vec<Built>) {
    let [slow, mid, fast] = cells.dimensions().map(|count| count as usize);
    let (mut bricks, mut nodes) = (Vec::new(), Vec::new());
    let mut masks = vec![[0u16; CHILDREN]; fast.div_ceil(ROW_CELLS)];
    for column in 0..mid.div_ceil(CUBE) {
        let mut is_empty = true;
        for s in (slab * CUBE..slow).take(CUBE) {
            for m in (column * CUBE..mid).take(CUBE) {
                let along = cells.along(cells.numbers_of(s * mid + m));
                let brick = s % CUBE / 4 * 4 + m % CUBE / 4;
                let row = s % 4 * 4 + m % 4;
                for at in along {
                    masks[*at as usize / ROW_CELLS][brick] |= 1 << row;
                }
                is_empty &= along.is_empty();
            }
        }
        if is_empty {
            continue;
        }
        for (along, of_node) in masks.iter_mut().enumerate() {
            let first = bricks.len() as u32;
            let mut mask = 0;
            for (lane, rows) in of_node.iter_mut().enumerate().filter(|(_, rows)| **rows != 0) {
                mask |= 1 << lane;
                bricks.push(std::mem::take(rows));
            }
            if mask != 0 {
                nodes.push(Built { at: [slab as u32, column as u32, along as u32], mask, first });
            }
        }
    }
    (bricks, nodes)
}
