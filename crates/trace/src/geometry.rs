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

    /// How many triangles of height fields with numbers below `number` are missing.
    pub fn missing_before(&self, number: usize) -> usize {
        let before =
            |field: &HeightField| field.missing_before(number.saturating_sub(field.first() as usize));
        self.fields.iter().map(before).sum()
    }

    /// True if there are no primitives.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The corners of the stored triangle at `index`.
    #[inline]
    pub fn stored_triangle(&self, index: usize) -> [DVec3; 3] {
        let [a, b, c] = self.triangles[index];
        [self.vertices[a as usize], self.vertices[b as usize], self.vertices[c as usize]]
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
