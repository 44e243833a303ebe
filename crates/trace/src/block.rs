//! Leaves: blocks of sixteen primitives side by side in single precision, as a filter in front of the exact
//! test.

use super::frame::Frame;
use super::{Geometry, Hits};
use bytemuck::{Pod, Zeroable};

pub(crate) const BLOCK_SIZE: usize = 16;

/// Sixteen triangles, or sixteen cubes, among which boxes of grids of voxels count. Coordinates are in the
/// tree's frame, rounded to nearest for triangles, outward for cubes. Unused lanes hold NaN, which no
/// comparison accepts, or an inside-out cube, and [`Hits::MISS`].
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Block {
    /// `corner[c][axis][lane]`: a triangle's corners, or a cube's lower and upper corner.
    pub corner: [[[f32; BLOCK_SIZE]; 3]; 3],
    /// Primitive numbers by lane; [`Hits::MISS`] in unused lanes.
    pub id: [u32; BLOCK_SIZE],
    /// Vertex numbers of the corners of triangles.
    pub vertex: [[u32; BLOCK_SIZE]; 3],
}

impl Block {
    /// Creates the block of the primitives `ids`, all of one kind; [`Hits::MISS`] leaves a lane empty.
    pub fn of(geometry: &Geometry, frame: &Frame, ids: &[u32]) -> Block {
        let triangles = geometry.triangle_count();
        if ids.first().is_some_and(|&id| id as usize >= triangles) {
            return Block::of_boxes(ids, |id| frame.local_box(&geometry.outer_bounds_of(id as usize)));
        }
        let mut block = Block::EMPTY;
        for (lane, &id) in ids.iter().enumerate().filter(|(_, id)| **id != Hits::MISS) {
            block.id[lane] = id;
            for (corner, vertex) in geometry.triangles[geometry.index_of(id as usize)].into_iter().enumerate()
            {
                let p = frame.local(geometry.vertices[vertex as usize]);
                block.put(corner, lane, p.to_array().map(|x| x as f32));
                block.vertex[corner][lane] = vertex;
            }
        }
        block
    }

    /// Creates a block of boxes, stored like cubes; `bounds` returns the lower and upper corner of each.
    pub fn of_boxes(ids: &[u32], bounds: impl Fn(u32) -> ([f32; 3], [f32; 3])) -> Block {
        let mut block = Block::EMPTY;
        block.corner[0] = [[f32::INFINITY; BLOCK_SIZE]; 3];
        block.corner[1] = [[f32::NEG_INFINITY; BLOCK_SIZE]; 3];
        for (lane, &id) in ids.iter().enumerate().filter(|(_, id)| **id != Hits::MISS) {
            let (lo, hi) = bounds(id);
            block.id[lane] = id;
            block.put(0, lane, lo);
            block.put(1, lane, hi);
        }
        block
    }

    pub(crate) const EMPTY: Block = Block {
        corner: [[[f32::NAN; BLOCK_SIZE]; 3]; 3],
        id: [Hits::MISS; BLOCK_SIZE],
        vertex: [[0; BLOCK_SIZE]; 3],
    };

    fn put(&mut self, corner: usize, lane: usize, p: [f32; 3]) {
        for (axis, x) in p.into_iter().enumerate() {
            self.corner[corner][axis][lane] = x;
        }
    }

    /// True if the block's primitives are cubes, which have no third corner.
    #[inline(always)]
    pub fn holds_cubes(&self) -> bool {
        self.corner[2][0][0].is_nan()
    }
}

/// Appends the primitives of one leaf to `slots` in blocks: triangles first, then cubes, each kind padded to
/// complete blocks. Returns the number of blocks.
pub(crate) fn append_leaf(
    slots: &mut Vec<u32>,
    triangles: usize,
    ids: impl Iterator<Item = u32> + Clone,
) -> usize {
    let start = slots.len();
    for cubes in [false, true] {
        slots.extend(ids.clone().filter(|&id| (id as usize >= triangles) == cubes));
        let fill = (slots.len() - start).next_multiple_of(BLOCK_SIZE);
        slots.resize(start + fill, Hits::MISS);
    }
    (slots.len() - start) / BLOCK_SIZE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_leaf_keeps_triangles_and_cubes_apart() {
        let mut slots = vec![7; BLOCK_SIZE];
        let ids = (0..20u32).chain(30..33);
        assert_eq!(append_leaf(&mut slots, 25, ids), 3);
        assert_eq!(slots.len(), 4 * BLOCK_SIZE);
        assert_eq!(slots[BLOCK_SIZE + 19], 19);
        assert_eq!(slots[BLOCK_SIZE + 20], Hits::MISS);
        assert_eq!(&slots[3 * BLOCK_SIZE..3 * BLOCK_SIZE + 4], &[30, 31, 32, Hits::MISS]);
        assert_eq!(append_leaf(&mut slots, 25, 40..57), 2);
    }
}
