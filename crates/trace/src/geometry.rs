//! Primitives, and the hit of a ray.

use crate::{Cube, HeightField, VoxelGrid};
use std::ops::Range;
use vlscan_geom::{Aabb, DVec3};

/// The primitives of a scene, numbered: triangles first, then cubes. The triangles of a height field are
/// numbered among the stored ones, as if they were stored, and so are the voxels of a grid among the stored
/// cubes.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// Vertices in the frame of the rays, m.
    pub vertices: Vec<DVec3>,
    /// Vertex numbers of each stored triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Stored cubes. Cube `i` of all is primitive number [`Geometry::triangle_count`] `+ i`.
    pub cubes: Vec<Cube>,
    /// Height fields, in the order of their triangles' numbers.
    pub fields: Vec<HeightField>,
    /// Grids of voxels, in the order of their cubes' numbers.
    pub grids: Vec<VoxelGrid>,
}

/// Location of a triangle.
#[derive(Clone, Copy, Debug)]
pub enum TriangleAt<'a> {
    /// Index among the stored triangles.
    Stored(usize),
    /// Index of its height field, the field, and the triangle's number there.
    Field(usize, &'a HeightField, usize),
}

/// Location of a cube.
#[derive(Clone, Copy, Debug)]
pub enum CubeAt<'a> {
    /// Index among the stored cubes.
    Stored(usize),
    /// Index of its grid, the grid, and the voxel's number there.
    Grid(usize, &'a VoxelGrid, usize),
}

impl Geometry {
    /// Number of primitives, with the missing triangles of height fields.
    pub fn len(&self) -> usize {
        self.triangle_count() + self.cube_count()
    }

    /// Number of triangles, with the missing ones of height fields; the number of the first cube.
    #[inline(always)]
    pub fn triangle_count(&self) -> usize {
        self.fields.iter().fold(self.triangles.len(), |sum, field| sum + field.len())
    }

    /// Number of cubes, with the voxels of grids.
    #[inline(always)]
    pub fn cube_count(&self) -> usize {
        self.grids.iter().fold(self.cubes.len(), |sum, grid| sum + grid.len())
    }

    /// Location of the cube with this index among all cubes.
    #[inline(always)]
    pub fn cube_at(&self, index: usize) -> CubeAt<'_> {
        let mut stored = index;
        for (i, grid) in self.grids.iter().enumerate() {
            let indices = grid.indices();
            if index < indices.start {
                break;
            }
            if index < indices.end {
                return CubeAt::Grid(i, grid, index - indices.start);
            }
            stored -= grid.len();
        }
        CubeAt::Stored(stored)
    }

    /// The cube with this index among all cubes, if there is one.
    #[inline(always)]
    pub fn cube(&self, index: usize) -> Option<Cube> {
        match self.cube_at(index) {
            CubeAt::Stored(index) => self.cubes.get(index).copied(),
            CubeAt::Grid(_, grid, i) => Some(grid.cube(i)),
        }
    }

    /// Primitive `number` if it is a cube.
    #[inline(always)]
    pub fn cube_of(&self, number: u32) -> Option<Cube> {
        self.cube((number as usize).checked_sub(self.triangle_count())?)
    }

    /// The stored cubes and the voxels of the grids in these ranges, in the order of their numbers.
    pub fn cubes_in(&self, stored: Range<usize>, grids: Range<usize>) -> impl Iterator<Item = Cube> {
        let mut in_grids = self.grids[..grids.start].iter().map(VoxelGrid::len).sum::<usize>();
        let (mut at, mut pieces) = (stored.start, Vec::with_capacity(grids.len() + 1));
        for grid in &self.grids[grids] {
            let before = (grid.first() as usize - in_grids).clamp(at, stored.end);
            pieces.push((at..before, Some(grid)));
            in_grids += grid.len();
            at = before;
        }
        pieces.push((at..stored.end, None));
        pieces.into_iter().flat_map(|(stored, grid)| {
            self.cubes[stored].iter().copied().chain(grid.into_iter().flat_map(VoxelGrid::cubes))
        })
    }

    /// The index among all cubes of the stored cube at `index`.
    #[inline(always)]
    pub fn index_of_stored_cube(&self, index: usize) -> usize {
        let after = |index: usize, grid: &VoxelGrid| match index >= grid.first() as usize {
            true => index + grid.len(),
            false => index,
        };
        self.grids.iter().fold(index, after)
    }

    /// How many triangles of height fields with numbers below `number` are missing.
    pub fn missing_before(&self, number: usize) -> usize {
        let before =
            |field: &HeightField| field.missing_before(number.saturating_sub(field.first() as usize));
        self.fields.iter().map(before).sum()
    }

    /// The number of the stored triangle at `index`.
    #[inline(always)]
    pub fn number_of(&self, index: usize) -> usize {
        let after = |number: usize, field: &HeightField| match number >= field.first() as usize {
            true => number + field.len(),
            false => number,
        };
        self.fields.iter().fold(index, after)
    }

    /// Location of triangle `number`.
    #[inline(always)]
    pub fn triangle_at(&self, number: usize) -> TriangleAt<'_> {
        let mut index = number;
        for (i, field) in self.fields.iter().enumerate() {
            let numbers = field.numbers();
            if number < numbers.start {
                break;
            }
            if number < numbers.end {
                return TriangleAt::Field(i, field, number - numbers.start);
            }
            index -= field.len();
        }
        TriangleAt::Stored(index)
    }

    /// The index of stored triangle `number`.
    pub(crate) fn index_of(&self, number: usize) -> usize {
        match self.triangle_at(number) {
            TriangleAt::Stored(index) => index,
            TriangleAt::Field(..) => panic!("triangle {number} is part of a height field"),
        }
    }

    /// True if there are no primitives.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The corners of triangle `i`; NaN for a missing one of a height field.
    #[inline]
    pub fn triangle(&self, i: usize) -> [DVec3; 3] {
        match self.triangle_at(i) {
            TriangleAt::Stored(index) => self.stored_triangle(index),
            TriangleAt::Field(_, field, i) => field.triangle(i).unwrap_or([DVec3::NAN; 3]),
        }
    }

    /// The corners of the stored triangle at `index`.
    #[inline]
    pub fn stored_triangle(&self, index: usize) -> [DVec3; 3] {
        let [a, b, c] = self.triangles[index];
        [self.vertices[a as usize], self.vertices[b as usize], self.vertices[c as usize]]
    }

    /// The box around primitive `i`.
    pub fn bounds_of(&self, i: usize) -> Aabb {
        match i.checked_sub(self.triangle_count()) {
            None => Aabb::around(self.triangle(i)),
            Some(cube) => self.bounds_of_cube(cube),
        }
    }

    /// The box around primitive `i`, or for a voxel of a grid that around all of its grid.
    pub(crate) fn outer_bounds_of(&self, i: usize) -> Aabb {
        match i.checked_sub(self.triangle_count()).map(|cube| self.cube_at(cube)) {
            Some(CubeAt::Grid(_, grid, _)) => grid.bounds(),
            _ => self.bounds_of(i),
        }
    }

    fn bounds_of_cube(&self, index: usize) -> Aabb {
        self.cube(index).map_or(Aabb::EMPTY, |cube| cube.bounds())
    }

    /// The box around all primitives.
    pub fn bounds(&self) -> Aabb {
        let fields = self.fields.iter().map(HeightField::bounds);
        let triangles = (0..self.triangles.len()).map(|i| Aabb::around(self.stored_triangle(i)));
        let cubes = self.cubes.iter().map(Cube::bounds);
        let grids = self.grids.iter().map(VoxelGrid::bounds);
        fields.chain(triangles).chain(cubes).chain(grids).fold(Aabb::EMPTY, Aabb::union)
    }
}

/// A ray's first hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the direction, which has unit length, m, > 0.
    pub t: f64,
    /// Number of the primitive; at equal distances the smaller number wins.
    pub primitive: u32,
}
