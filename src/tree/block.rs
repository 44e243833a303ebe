//! Leaves: sixteen primitives side by side in single precision, as a filter in front of the verdict.

use super::frame::Frame;
use super::{Geometry, Hits};
use bytemuck::{Pod, Zeroable};

/// Primitives per block.
pub(crate) const LANES: usize = 16;

/// Sixteen triangles, or sixteen cubes. Coordinates are in the tree's frame: those of triangles rounded to nearest, those
/// of cubes outward. Unused lanes hold NaN, which no comparison accepts, or an inside-out cube, and [`Hits::MISS`].
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
pub(crate) struct Block {
    /// `corner[c][axis][lane]`: a triangle's corners, or a cube's lower and upper corner.
    pub corner: [[[f32; LANES]; 3]; 3],
    /// Primitive numbers. All lanes in use are of one kind.
    pub id: [u32; LANES],
    /// Numbers of the corners of triangles.
    pub vertex: [[u32; LANES]; 3],
}

impl Block {
    /// The block of these primitives, [`Hits::MISS`] marking lanes to leave empty.
    pub fn of(geometry: &Geometry, frame: &Frame, ids: &[u32]) -> Block {
        let mut block =
            Block { corner: [[[f32::NAN; LANES]; 3]; 3], id: [Hits::MISS; LANES], vertex: [[0; LANES]; 3] };
        if ids.first().is_some_and(|&id| id as usize >= geometry.triangles.len()) {
            block.corner[0] = [[f32::INFINITY; LANES]; 3];
            block.corner[1] = [[f32::NEG_INFINITY; LANES]; 3];
        }
        for (lane, &id) in ids.iter().enumerate().filter(|(_, id)| **id != Hits::MISS) {
            block.id[lane] = id;
            let i = id as usize;
            if i < geometry.triangles.len() {
                for (corner, vertex) in geometry.triangles[i].into_iter().enumerate() {
                    let p = frame.local(geometry.vertices[vertex as usize]);
                    block.put(corner, lane, p.to_array().map(|x| x as f32));
                    block.vertex[corner][lane] = vertex;
                }
            } else {
                let (lo, hi) = frame.local_box(&geometry.bounds_of(i));
                block.put(0, lane, lo);
                block.put(1, lane, hi);
            }
        }
        block
    }

    fn put(&mut self, corner: usize, lane: usize, p: [f32; 3]) {
        for (axis, x) in p.into_iter().enumerate() {
            self.corner[corner][axis][lane] = x;
        }
    }

    /// Whether the block's primitives are cubes, which have no third corner.
    #[inline(always)]
    pub fn holds_cubes(&self) -> bool {
        self.corner[2][0][0].is_nan()
    }
}

/// Appends the primitives of one leaf to `slots`, blockwise: triangles first, then cubes, each kind filled up to whole
/// blocks. Returns how many blocks that made.
pub(crate) fn append_leaf(
    slots: &mut Vec<u32>,
    triangles: usize,
    ids: impl Iterator<Item = u32> + Clone,
) -> usize {
    let start = slots.len();
    for cubes in [false, true] {
        slots.extend(ids.clone().filter(|&id| (id as usize >= triangles) == cubes));
        let fill = (slots.len() - start).next_multiple_of(LANES);
        slots.resize(start + fill, Hits::MISS);
    }
    (slots.len() - start) / LANES
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_leaf_keeps_triangles_and_cubes_apart() {
        let mut slots = vec![7; LANES];
        let ids = (0..20u32).chain(30..33);
        assert_eq!(append_leaf(&mut slots, 25, ids), 3);
        assert_eq!(slots.len(), 4 * LANES);
        assert_eq!(slots[LANES + 19], 19);
        assert_eq!(slots[LANES + 20], Hits::MISS);
        assert_eq!(&slots[3 * LANES..3 * LANES + 4], &[30, 31, 32, Hits::MISS]);
        assert_eq!(append_leaf(&mut slots, 25, 40..57), 2);
    }
}
