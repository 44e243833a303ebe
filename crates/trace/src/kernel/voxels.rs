//! Grids of voxels in a packet's traversal: nodes of their hierarchy like those of the wide tree, and rows of cubes like blocks.

use super::filter::{box_in_pulses, boxes_in_frustum};
use super::lanes::PACKET_SIZE;
use super::packet::PlaneDepth;
use super::traversal::{GridVisit, PacketTraversal};
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

    /// Traverses the grids whose boxes the pulses hit. `is_single` is whether there is only one pulse.
    #[inline(always)]
    pub(super) fn walk_grids(&mut self, frame: &Frame, is_single: bool) {
        while let Some((grid, pulses)) = self.grids.pop() {
            self.walk_grid(&self.geometry.grids[grid], frame, pulses, is_single);
        }
    }

    /// Traverses a grid of voxels with the pulses in a mask, front to back.
    #[inline(always)]
    fn walk_grid(&mut self, grid: &VoxelGrid, frame: &Frame, pulses: u32, is_single: bool) {
        let view = GridView::new(grid, frame);
        self.stacks.grid[0] = GridVisit { node: view.root(), enter: 0.0, pulses };
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let GridVisit { node, enter, pulses } = self.stacks.grid[height];
            let pulses = pulses & self.within_limit(enter);
            if pulses == 0 {
                continue;
            }
            match node.level > 0 {
                true => height = self.push_grid_children(&view, node, pulses, is_single, height),
                false => self.hit_row(&view, node, pulses),
            }
        }
    }

    /// Pushes the children of a node that the pulses hit on the stack, the nearest on top. Returns the new height of
    /// the stack.
    #[inline(always)]
    fn push_grid_children(
        &mut self,
        view: &GridView,
        node: GridNode,
        pulses: u32,
        is_single: bool,
        floor: usize,
    ) -> usize {
        let children = view.children(node);
        let (lower, upper) = (&children.lower, &children.upper);
        let (mut depths, mut height) = ([0.0; PACKET_SIZE], floor);
        let limit = self.simd.load(&self.limit.0).max_lane();
        let (met, enter) = boxes_in_frustum(self.simd, &self.frustum.hull, lower, upper, limit);
        let mut met = met & children.mask();
        enter.store(&mut depths);
        while met != 0 {
            let lane = met.trailing_zeros() as usize;
            met &= met - 1;
            let corner =
                |corners: &[[f32; PACKET_SIZE]; 3]| [corners[0][lane], corners[1][lane], corners[2][lane]];
            // The hull of a single pulse is that pulse.
            let meeting = match is_single {
                true => pulses,
                false => pulses & box_in_pulses(&self.frustum, corner(lower), corner(upper), &self.limit),
            };
            if meeting == 0 {
                continue;
            }
            let stack = &mut self.stacks.grid;
            let mut at = height;
            while at > floor && stack[at - 1].enter < depths[lane] {
                stack[at] = stack[at - 1];
                at -= 1;
            }
            stack[at] = GridVisit { node: children.child(lane), enter: depths[lane], pulses: meeting };
            height += 1;
        }
        height
    }

    /// Tests the pulses in a mask against the cubes of a row, each up to the cube behind which nothing of it is left.
    #[inline(always)]
    fn hit_row(&mut self, view: &GridView, node: GridNode, mut pulses: u32) {
        let row = view.row(node);
        let first = (self.geometry.triangle_count() + view.grid.first() as usize + row.first) as u32;
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
