//! Grids of voxels in a packet's traversal: nodes of their hierarchy like those of the wide tree, and rows of
//! cubes like blocks.

use super::filter::boxes_in_frustum;
use super::lanes::PACKET_SIZE;
use super::packet::PlaneDepth;
use super::traversal::{PacketTraversal, Visit};
use crate::frame::Frame;
use crate::frustum::DEPTH_MARGIN;
use crate::simd::{F32Ops, Simd};
use crate::voxels::{GridNode, GridView, VoxelGrid};

impl<S: Simd> PacketTraversal<'_, S> {
    /// Remembers that a pulse hits the box of a grid.
    #[cold]
    pub(super) fn record_grid(&mut self, grid: usize, pulse: usize) {
        match self.grids.iter_mut().find(|known| known.0 == grid) {
            Some((_, pulses)) => *pulses |= 1 << pulse,
            None => self.grids.push((grid, 1 << pulse)),
        }
    }

    /// Traverses the grids whose boxes the pulses hit.
    #[inline(always)]
    pub(super) fn walk_grids(&mut self, frame: &Frame) {
        let simd = self.simd;
        while let Some((grid, pulses)) = self.grids.pop() {
            simd.outlined(
                #[inline(always)]
                || self.walk_grid(&self.geometry.grids[grid], frame, pulses),
            );
        }
    }

    /// Traverses a grid of voxels with the pulses in a mask, front to back.
    #[inline(always)]
    fn walk_grid(&mut self, grid: &VoxelGrid, frame: &Frame, pulses: u32) {
        let view = GridView::new(grid, frame);
        self.stacks.grid[0] = Visit::root(view.root(), pulses);
        let mut height = 1;
        while let Some(visit) = self.pop_visit(|stacks| &stacks.grid, &mut height) {
            let Visit { node, pulses, .. } = visit;
            if node.level == 0 {
                self.hit_row(&view, node, pulses);
                continue;
            }
            let children = view.children(node);
            height = self.push_children(
                |stacks| &mut stacks.grid,
                (height, pulses),
                (&children.lower, &children.upper, children.mask()),
                |lane| children.child(lane),
            );
        }
    }

    /// Tests the pulses in a mask against the cubes of a row, each up to the cube behind which nothing of it
    /// is left.
    #[inline(always)]
    fn hit_row(&mut self, view: &GridView, node: GridNode, mut pulses: u32) {
        let row = view.row(node);
        let first = (self.first_cube + view.grid.first() as usize + row.first) as u32;
        // The lanes of a row follow each other along an axis.
        let [above, below] = &self.frustum.hull[row.axis()];
        let is_ascending = above.inverse > 0.0 && below.inverse > 0.0;
        while pulses != 0 {
            let p = pulses.trailing_zeros() as usize % PACKET_SIZE;
            pulses &= pulses - 1;
            let planes = self.frustum.planes.each_ref().map(|planes| {
                planes.each_ref().map(|s| PlaneDepth { from: s.from.0[p], inverse: s.inverse.0[p] })
            });
            let limit = self.limit.0[p];
            let (met, enter) = boxes_in_frustum(self.simd, &planes, &row.lower, &row.upper, limit);
            let (mut met, mut depths) = (met & row.mask(), [0.0; PACKET_SIZE]);
            enter.store(&mut depths);
            while met != 0 {
                let lane =
                    if is_ascending { met.trailing_zeros() } else { met.ilog2() } as usize % PACKET_SIZE;
                met &= !(1 << lane);
                if depths[lane] > self.limit.0[p] * DEPTH_MARGIN {
                    continue;
                }
                self.hit_cube(self.first + p, first + lane as u32, row.cube(view.grid, lane));
                self.lower_limit(p);
            }
        }
    }
}
