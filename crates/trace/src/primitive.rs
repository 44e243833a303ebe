//! References to primitives: where a primitive is stored, and its number.

use crate::{Cube, Geometry, HeightField, Instances, VoxelGrid};
use std::ops::Range;
use vlscan_geom::{Aabb, DVec3};

/// Storage of a primitive. [`Geometry::primitive`] and [`Instances::primitive`] return that of a number;
/// [`Geometry::number_of`] and [`Instances::number_of`] return the number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PrimitiveRef {
    /// A stored triangle, by its index in [`Geometry::triangles`].
    Triangle(usize),
    /// A triangle of a height field; it may be missing.
    Field {
        /// Index in [`Geometry::fields`].
        field: usize,
        /// Index of the triangle, counted from the first of the field.
        triangle: usize,
    },
    /// A stored cube, by its index in [`Geometry::cubes`].
    Cube(usize),
    /// A voxel of a grid.
    Grid {
        /// Index in [`Geometry::grids`].
        grid: usize,
        /// Index of the voxel, counted from the first of the grid.
        voxel: usize,
    },
    /// A triangle of an instance.
    Instance {
        /// Index in [`Instances::all`].
        instance: usize,
        /// Index of the triangle in the model of the instance.
        triangle: usize,
    },
}

impl Geometry {
    /// Storage of the primitive with this number; `None` for a number that is not below [`Geometry::len`].
    #[inline(always)]
    pub fn primitive(&self, number: usize) -> Option<PrimitiveRef> {
        let index = match self.locate_triangle(number) {
            (Some(field), triangle) => return Some(PrimitiveRef::Field { field, triangle }),
            (None, index) => index,
        };
        let Some(cube) = index.checked_sub(self.triangles.len()) else {
            return Some(PrimitiveRef::Triangle(index));
        };
        match self.locate_cube(cube) {
            (Some(grid), voxel) => Some(PrimitiveRef::Grid { grid, voxel }),
            (None, index) => (index < self.cubes.len()).then_some(PrimitiveRef::Cube(index)),
        }
    }

    /// Number of a primitive; `None` for a triangle of an instance.
    pub fn number_of(&self, primitive: PrimitiveRef) -> Option<usize> {
        match primitive {
            PrimitiveRef::Triangle(index) => Some(self.number_of_triangle(index)),
            PrimitiveRef::Field { field, triangle } => Some(self.fields[field].first() as usize + triangle),
            PrimitiveRef::Cube(index) => Some(self.triangle_count() + self.index_of_stored_cube(index)),
            PrimitiveRef::Grid { grid, voxel } => {
                Some(self.triangle_count() + self.grids[grid].first() as usize + voxel)
            }
            PrimitiveRef::Instance { .. } => None,
        }
    }

    /// Number of the stored triangle at `index`.
    #[inline(always)]
    pub fn number_of_triangle(&self, index: usize) -> usize {
        count_inserted(&self.fields, HeightField::numbers, index)
    }

    /// Index among all cubes of the stored cube at `index`.
    #[inline(always)]
    pub fn index_of_stored_cube(&self, index: usize) -> usize {
        count_inserted(&self.grids, VoxelGrid::indices, index)
    }

    /// The height field of triangle `number` and the triangle's index there; without a field the index among
    /// the stored triangles, which is beyond them for the number of a cube.
    #[inline(always)]
    fn locate_triangle(&self, number: usize) -> (Option<usize>, usize) {
        locate(&self.fields, HeightField::numbers, number)
    }

    /// The grid of the cube with this index among all cubes, and the voxel's index there; without a grid the
    /// index among the stored cubes.
    #[inline(always)]
    pub(crate) fn locate_cube(&self, index: usize) -> (Option<usize>, usize) {
        locate(&self.grids, VoxelGrid::indices, index)
    }

    /// Index of stored triangle `number`.
    pub(crate) fn index_of(&self, number: usize) -> usize {
        let (field, index) = self.locate_triangle(number);
        assert!(field.is_none(), "triangle {number} is part of a height field");
        index
    }

    /// The corners of triangle `i`; NaN for a missing one of a height field.
    #[inline]
    pub fn triangle(&self, i: usize) -> [DVec3; 3] {
        match self.locate_triangle(i) {
            (Some(field), triangle) => self.fields[field].triangle(triangle).unwrap_or([DVec3::NAN; 3]),
            (None, index) => self.stored_triangle(index),
        }
    }

    /// The cube with this index among all cubes, if there is one.
    #[inline(always)]
    pub fn cube(&self, index: usize) -> Option<Cube> {
        match self.locate_cube(index) {
            (Some(grid), voxel) => Some(self.grids[grid].cube(voxel)),
            (None, index) => self.cubes.get(index).copied(),
        }
    }

    /// Primitive `number` if it is a cube.
    #[inline(always)]
    pub fn cube_of(&self, number: u32) -> Option<Cube> {
        self.cube((number as usize).checked_sub(self.triangle_count())?)
    }

    /// The box around primitive `i`.
    pub fn bounds_of(&self, i: usize) -> Aabb {
        match i.checked_sub(self.triangle_count()) {
            None => Aabb::around(self.triangle(i)),
            Some(cube) => self.cube(cube).map_or(Aabb::EMPTY, |cube| cube.bounds()),
        }
    }

    /// The box around primitive `i`, or for a voxel of a grid that around all of its grid.
    pub(crate) fn outer_bounds_of(&self, i: usize) -> Aabb {
        match i.checked_sub(self.triangle_count()).map(|cube| self.locate_cube(cube)) {
            Some((Some(grid), _)) => self.grids[grid].bounds(),
            _ => self.bounds_of(i),
        }
    }
}

impl Instances {
    /// Storage of the triangle of an instance with this number; `None` for another primitive.
    #[inline]
    pub fn primitive(&self, number: u32) -> Option<PrimitiveRef> {
        let (instance, triangle) = self.locate(number)?;
        Some(PrimitiveRef::Instance { instance, triangle })
    }

    /// Number of a triangle of an instance; `None` for another primitive.
    pub fn number_of(&self, primitive: PrimitiveRef) -> Option<usize> {
        match primitive {
            PrimitiveRef::Instance { instance, triangle } => {
                Some(self.all[instance].first as usize + triangle)
            }
            _ => None,
        }
    }
}

/// Finds a number among items that are stored and the ranges of `inserted`, which are numbered as if they
/// were stored among the items: the range that contains the number and the position there, or none and the
/// index of the item. The ranges are ascending and do not overlap.
#[inline(always)]
fn locate<T>(inserted: &[T], range_of: impl Fn(&T) -> Range<usize>, number: usize) -> (Option<usize>, usize) {
    let before = inserted.partition_point(|item| range_of(item).start <= number);
    if let Some(last) = before.checked_sub(1) {
        let range = range_of(&inserted[last]);
        if range.contains(&number) {
            return (Some(last), number - range.start);
        }
    }
    (None, inserted[..before].iter().fold(number, |index, item| index - range_of(item).len()))
}

/// Number of the stored item at `index`, counting the ranges of `inserted` before it.
#[inline(always)]
fn count_inserted<T>(inserted: &[T], range_of: impl Fn(&T) -> Range<usize>, index: usize) -> usize {
    inserted.iter().map(range_of).fold(index, |number, range| match number >= range.start {
        true => number + range.len(),
        false => number,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GridPlace, HeightGrid, Heights, Model, Placement, VoxelCells};
    use proptest::prelude::*;
    use std::sync::Arc;

    /// A field of one row of cells, all triangles of which are there, or none.
    fn field(cells: usize, first: usize) -> HeightField {
        let mut heights = Heights::single(2 * (cells + 1)).unwrap();
        heights.set(0, &vec![1.0; 2 * (cells + 1)]).unwrap();
        HeightField::new(HeightGrid::new(cells + 1, 2), heights, first).unwrap()
    }

    fn grid(voxels: usize, first: usize) -> VoxelGrid {
        let mut cells = VoxelCells::new([voxels as u32, 1, 1]);
        assert!((0..voxels as u32).all(|x| cells.push([x, 0, 0])));
        VoxelGrid::new(GridPlace::new(DVec3::ZERO, 1.0), cells, first).unwrap()
    }

    /// Primitives in the order of their numbers: runs of stored ones, each with the length of what is
    /// inserted after it, and the last stored ones.
    fn numbered(
        (runs, last): (&[(usize, usize)], usize),
        stored: impl Fn(usize) -> PrimitiveRef,
        inserted: impl Fn(usize, usize) -> PrimitiveRef,
    ) -> Vec<PrimitiveRef> {
        let (mut all, mut count) = (Vec::new(), 0);
        for (i, &(before, length)) in runs.iter().enumerate() {
            all.extend((count..count + before).map(&stored));
            all.extend((0..length).map(|n| inserted(i, n)));
            count += before;
        }
        all.extend((count..count + last).map(&stored));
        all
    }

    /// Numbers of the first inserted primitives.
    fn firsts(runs: &[(usize, usize)]) -> Vec<usize> {
        let starts = runs.iter().scan(0, |end, &(before, length)| {
            let first = *end + before;
            *end = first + length;
            Some(first)
        });
        starts.collect()
    }

    fn two_triangles() -> Geometry {
        Geometry {
            vertices: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            triangles: vec![[0, 1, 2]; 2],
            ..Geometry::default()
        }
    }

    proptest! {
        #[test]
        fn every_number_is_that_of_one_primitive(
            fields in prop::collection::vec((0..4usize, 0..5usize), 0..6),
            grids in prop::collection::vec((0..4usize, 1..5usize), 0..6),
            last in 0..4usize,
            instances in 0..4u32,
        ) {
            let fields: Vec<_> = fields.into_iter().map(|(before, cells)| (before, 2 * cells)).collect();
            let stored = |runs: &[(usize, usize)]| runs.iter().map(|run| run.0).sum::<usize>() + last;
            let field_at = |(run, first): (&(usize, usize), usize)| field(run.1 / 2, first);
            let grid_at = |(run, first): (&(usize, usize), usize)| grid(run.1, first);
            let geometry = Geometry {
                vertices: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
                triangles: vec![[0, 1, 2]; stored(&fields)],
                cubes: vec![Cube { centre: DVec3::ZERO, half: 0.5 }; stored(&grids)],
                fields: fields.iter().zip(firsts(&fields)).map(field_at).collect(),
                grids: grids.iter().zip(firsts(&grids)).map(grid_at).collect(),
            };
            let in_field = |field: usize, triangle: usize| PrimitiveRef::Field { field, triangle };
            let in_grid = |grid: usize, voxel: usize| PrimitiveRef::Grid { grid, voxel };
            let triangles = numbered((&fields[..], last), PrimitiveRef::Triangle, in_field);
            let cubes = numbered((&grids[..], last), PrimitiveRef::Cube, in_grid);
            let all = [triangles, cubes].concat();
            prop_assert_eq!(all.len(), geometry.len());
            for (number, primitive) in all.iter().enumerate() {
                prop_assert_eq!(geometry.primitive(number), Some(*primitive));
                prop_assert_eq!(geometry.number_of(*primitive), Some(number));
            }
            prop_assert_eq!(geometry.primitive(all.len()), None);

            let places = (0..instances).map(|_| (0, 0, Placement::IDENTITY));
            let model = Arc::new(Model::new(two_triangles()));
            let set = Instances::new(vec![model], places, all.len()).unwrap();
            for n in 0..2 * instances as usize {
                let (number, instance) = (all.len() + n, n / 2);
                let primitive = PrimitiveRef::Instance { instance, triangle: n % 2 };
                prop_assert_eq!(set.primitive(number as u32), Some(primitive));
                prop_assert_eq!(set.number_of(primitive), Some(number));
                prop_assert_eq!(geometry.number_of(primitive), None);
            }
            prop_assert!((0..all.len() as u32).all(|number| set.primitive(number).is_none()));
        }
    }
}
