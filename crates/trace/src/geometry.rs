//! Primitives, and the hit of a ray.

use crate::HeightField;
use bytemuck::{Pod, Zeroable};
use vlscan_geom::{Aabb, DVec3};

/// An axis-aligned cube.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Cube {
    /// Centre, m.
    pub centre: DVec3,
    /// Half edge length, m.
    pub half: f64,
}

/// The primitives of a scene, numbered: triangles first, then cubes. The triangles of a height field are numbered among the
/// stored ones, as if they were stored.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// Vertices in the frame of the rays, m.
    pub vertices: Vec<DVec3>,
    /// Vertex numbers of each stored triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Cubes; cube `i` is primitive number [`Geometry::triangle_count`] `+ i`.
    pub cubes: Vec<Cube>,
    /// Height fields, in the order of their triangles' numbers.
    pub fields: Vec<HeightField>,
}

/// Where a triangle is.
#[derive(Clone, Copy, Debug)]
pub enum TriangleAt<'a> {
    /// Index among the stored triangles.
    Stored(usize),
    /// Index of its height field, the field, and the triangle's number there.
    Field(usize, &'a HeightField, usize),
}

impl Geometry {
    /// Number of primitives, with the missing triangles of height fields.
    pub fn len(&self) -> usize {
        self.triangle_count() + self.cubes.len()
    }

    /// Number of triangles, with the missing ones of height fields; the number of the first cube.
    #[inline(always)]
    pub fn triangle_count(&self) -> usize {
        self.fields.iter().fold(self.triangles.len(), |sum, field| sum + field.len())
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

    /// Where triangle `number` is.
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

    /// Whether there are no primitives.
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

    fn bounds_of_cube(&self, index: usize) -> Aabb {
        let c = self.cubes[index];
        Aabb { min: c.centre - DVec3::splat(c.half), max: c.centre + DVec3::splat(c.half) }
    }

    /// The box around all primitives.
    pub fn bounds(&self) -> Aabb {
        let fields = self.fields.iter().map(HeightField::bounds);
        let triangles = (0..self.triangles.len()).map(|i| Aabb::around(self.stored_triangle(i)));
        let cubes = (0..self.cubes.len()).map(|i| self.bounds_of_cube(i));
        fields.chain(triangles).chain(cubes).fold(Aabb::EMPTY, Aabb::union)
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
