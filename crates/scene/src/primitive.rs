//! References to the primitives of a scene, and a visit to all of them.

use super::{Scene, Surface, Voxel, VoxelKind};
use vlscan_geom::{Aabb, DVec3};
use vlscan_trace::{Cube, PrimitiveRef};

/// A primitive with its facts.
#[derive(Clone, Copy, Debug)]
pub struct PrimitiveFacts {
    /// Its storage.
    pub primitive: PrimitiveRef,
    /// Index in [`Scene::parts`].
    pub part: u32,
    /// Index in [`Scene::materials`].
    pub material: u32,
    /// Its shape, scene frame.
    pub shape: PrimitiveShape,
}

/// The shape of a primitive, m.
#[derive(Clone, Copy, Debug)]
pub enum PrimitiveShape {
    /// Corners of a triangle.
    Triangle([DVec3; 3]),
    /// Attributes of a cube, and the cube.
    Voxel(Voxel, Cube),
}

impl PrimitiveFacts {
    /// The box around the primitive, m.
    pub fn bounds(&self) -> Aabb {
        match &self.shape {
            PrimitiveShape::Triangle(corners) => Aabb::around(*corners),
            PrimitiveShape::Voxel(_, cube) => cube.bounds(),
        }
    }

    /// Area of one side of a triangle, m²; 0 for a cube.
    pub fn triangle_area(&self) -> f64 {
        match &self.shape {
            PrimitiveShape::Triangle(corners) => area_of_triangle(*corners),
            PrimitiveShape::Voxel(..) => 0.0,
        }
    }

    /// One-sided plant area of a voxel that transmits light, m²: plant area density times volume; 0 for
    /// another primitive.
    pub fn plant_area(&self) -> f64 {
        match &self.shape {
            PrimitiveShape::Voxel(voxel, cube)
                if voxel.kind() == VoxelKind::Transmittive && voxel.density.is_finite() =>
            {
                voxel.density * (2.0 * cube.half).powi(3)
            }
            _ => 0.0,
        }
    }
}

/// Area of one side of a triangle, m².
pub(crate) fn area_of_triangle([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

impl Scene {
    /// Storage of primitive `i`; `None` for a primitive of a tile and for a number that is out of range.
    #[inline]
    pub fn primitive(&self, i: u32) -> Option<PrimitiveRef> {
        let own = self.geometry.primitive(i as usize);
        own.or_else(|| self.instances.as_ref()?.instances.primitive(i))
    }

    /// Number of a primitive; `None` for a triangle of an instance in a scene without instances.
    pub fn number_of(&self, primitive: PrimitiveRef) -> Option<u32> {
        let own = self.geometry.number_of(primitive);
        let number = own.or_else(|| self.instances.as_ref()?.instances.number_of(primitive))?;
        u32::try_from(number).ok()
    }

    /// Part and material of a primitive; `None` for a reference to none.
    #[inline]
    pub fn surface_of(&self, primitive: PrimitiveRef) -> Option<Surface> {
        let surface = match primitive {
            PrimitiveRef::Triangle(index) => self.surface_ids.get(index)?,
            PrimitiveRef::Field { field, .. } => *self.field_surfaces.get(field)?,
            PrimitiveRef::Cube(index) => self.surface_ids.get(self.geometry.triangles.len() + index)?,
            PrimitiveRef::Grid { grid, voxel } => self.grid_voxels.get(grid)?.surfaces.get(voxel)?,
            PrimitiveRef::Instance { instance, triangle } => {
                return Some(self.instances.as_ref()?.surface(instance, triangle));
            }
        };
        Some(self.surfaces[surface as usize])
    }

    /// The corners of a triangle in the scene's frame, m; `None` for a missing triangle of a height field and
    /// for a cube.
    #[inline]
    pub fn corners_of(&self, primitive: PrimitiveRef) -> Option<[DVec3; 3]> {
        match primitive {
            PrimitiveRef::Triangle(index) => Some(self.geometry.stored_triangle(index)),
            PrimitiveRef::Field { field, triangle } => self.geometry.fields[field].triangle(triangle),
            PrimitiveRef::Instance { instance, triangle } => {
                let set = &self.instances.as_ref()?.instances;
                Some(set.corners(&set.all[instance], triangle))
            }
            PrimitiveRef::Cube(_) | PrimitiveRef::Grid { .. } => None,
        }
    }

    /// The attributes of a cube, and the cube; `None` for a triangle.
    #[inline]
    pub fn voxel_of(&self, primitive: PrimitiveRef) -> Option<(Voxel, Cube)> {
        match primitive {
            PrimitiveRef::Cube(index) => Some((*self.voxels.get(index)?, *self.geometry.cubes.get(index)?)),
            PrimitiveRef::Grid { grid, voxel } => {
                Some((self.grid_voxels[grid].get(voxel), self.geometry.grids[grid].cube(voxel)))
            }
            _ => None,
        }
    }

    /// Facts about a primitive; `None` for a missing triangle of a height field.
    pub fn facts_of(&self, primitive: PrimitiveRef) -> Option<PrimitiveFacts> {
        let shape = match self.corners_of(primitive) {
            Some(corners) => PrimitiveShape::Triangle(corners),
            None => {
                let (voxel, cube) = self.voxel_of(primitive)?;
                PrimitiveShape::Voxel(voxel, cube)
            }
        };
        let Surface { part, material } = self.surface_of(primitive)?;
        Some(PrimitiveFacts { primitive, part, material, shape })
    }

    /// Calls `visit` with each primitive once, those of instances last. Primitives of tiles are those of the
    /// scenes of the tiles, and are not visited.
    pub fn for_each_primitive(&self, mut visit: impl FnMut(&PrimitiveFacts)) {
        self.for_each_own_primitive(&mut visit);
        let Some(set) = &self.instances else { return };
        for (instance, of) in set.instances.all.iter().enumerate() {
            let triangles = 0..set.materials[of.model as usize].len();
            let all = triangles.map(|triangle| PrimitiveRef::Instance { instance, triangle });
            all.filter_map(|primitive| self.facts_of(primitive)).for_each(|facts| visit(&facts));
        }
    }

    /// Calls `visit` with each primitive that is part of neither an instance nor a tile, once: stored
    /// triangles, stored cubes, height fields, grids of voxels.
    pub fn for_each_own_primitive(&self, mut visit: impl FnMut(&PrimitiveFacts)) {
        let g = &self.geometry;
        let triangles = (0..g.triangles.len()).map(PrimitiveRef::Triangle);
        let cubes = (0..g.cubes.len()).map(PrimitiveRef::Cube);
        let fields = g.fields.iter().enumerate().flat_map(|(field, of)| {
            (0..of.len()).map(move |triangle| PrimitiveRef::Field { field, triangle })
        });
        let grids = g
            .grids
            .iter()
            .enumerate()
            .flat_map(|(grid, of)| (0..of.len()).map(move |voxel| PrimitiveRef::Grid { grid, voxel }));
        let all = triangles.chain(cubes).chain(fields).chain(grids);
        all.filter_map(|primitive| self.facts_of(primitive)).for_each(|facts| visit(&facts));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GridSurfaces, GridVoxels, InstanceSet};
    use std::sync::Arc;
    use vlscan_trace::{
        Geometry, GridPlace, HeightField, HeightGrid, Heights, Instances, Model, Placement, VoxelCells,
        VoxelGrid,
    };

    /// A scene with primitives of all kinds: two stored triangles with a height field of 4 between them, of
    /// which one is missing; two stored cubes after a grid of 3 voxels; two instances of 2 triangles.
    fn scene() -> Scene {
        let mut heights = Heights::single(6).unwrap();
        heights.set(0, &[1.0, 2.0, 3.0, 4.0, 5.0, f64::NAN]).unwrap();
        let field = HeightField::new(HeightGrid::new(3, 2), heights, 1).unwrap();
        let mut cells = VoxelCells::new([3, 1, 1]);
        assert!((0..3).all(|x| cells.push([x, 0, 0])));
        let grid = VoxelGrid::new(GridPlace::new(DVec3::ZERO, 1.0), cells, 0).unwrap();
        let mut grid_voxels = GridVoxels::default();
        assert!((0..3).all(|_| grid_voxels.push(&Voxel::of_plants(2.0, VoxelKind::Transmittive))));
        grid_voxels.complete(GridSurfaces::InTurn(vec![2]));
        let mesh = Geometry {
            vertices: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z],
            triangles: vec![[0, 1, 2], [0, 1, 3]],
            ..Geometry::default()
        };
        let geometry = Geometry {
            cubes: vec![Cube { centre: DVec3::ONE, half: 0.5 }; 2],
            fields: vec![field],
            grids: vec![grid],
            ..mesh.clone()
        };
        let places = [(0, 0, Placement::IDENTITY), (0, 1, Placement::IDENTITY)];
        let instances = Instances::new(vec![Arc::new(Model::new(mesh))], places, geometry.len()).unwrap();
        Scene {
            geometry,
            surface_ids: vec![0, 0, 1, 1].into(),
            field_surfaces: vec![1],
            surfaces: (0..3).map(|n| Surface { part: n, material: 2 - n }).collect(),
            voxels: vec![Voxel::of_points(None); 2],
            grid_voxels: vec![grid_voxels],
            instances: Some(InstanceSet {
                instances: Arc::new(instances),
                materials: vec![vec![0, 1]],
                parts: vec![1, 2],
            }),
            ..Scene::default()
        }
    }

    #[test]
    fn every_number_is_that_of_one_primitive() {
        let scene = scene();
        let numbers = scene.numbers() as u32;
        assert_eq!(numbers, 2 + 4 + 2 + 3 + 4);
        for i in 0..numbers {
            let primitive = scene.primitive(i).unwrap();
            assert_eq!(scene.number_of(primitive), Some(i));
            assert_eq!(scene.surface_of(primitive), Some(scene.surface(i)));
            assert_eq!(
                scene.find_triangle(i).map(|found| found.surface()),
                match primitive {
                    PrimitiveRef::Cube(_) | PrimitiveRef::Grid { .. } => None,
                    _ => Some(scene.surface(i)),
                }
            );
        }
        assert_eq!(scene.primitive(numbers), None);
    }

    #[test]
    fn every_primitive_is_visited_once() {
        let scene = scene();
        let mut seen = vec![0; scene.numbers()];
        scene.for_each_primitive(|facts| {
            let i = scene.number_of(facts.primitive).unwrap();
            seen[i as usize] += 1;
            assert_eq!((facts.part, facts.material), (scene.part_of(i), scene.surface(i).material));
            match facts.shape {
                PrimitiveShape::Triangle(corners) => assert_eq!(scene.triangle(i), Some(corners)),
                PrimitiveShape::Voxel(voxel, cube) => {
                    assert_eq!(scene.voxel_and_cube(i), Some((voxel, cube)));
                }
            }
        });
        let is_missing = |i: &usize| scene.triangle(*i as u32).is_none() && scene.voxel(*i as u32).is_none();
        let missing: Vec<usize> = (0..scene.numbers()).filter(is_missing).collect();
        assert_eq!(missing, [4], "the last cell lacks the triangle with its last corner");
        assert!((0..seen.len()).all(|i| seen[i] == usize::from(!missing.contains(&i))), "{seen:?}");
        let mut own = 0;
        scene.for_each_own_primitive(|_| own += 1);
        assert_eq!(own + 4, scene.primitives());
    }

    #[test]
    fn areas_are_those_of_triangles_and_of_plants() {
        let scene = scene();
        let facts = |i| scene.facts_of(scene.primitive(i).unwrap()).unwrap();
        assert_eq!((facts(0).triangle_area(), facts(0).plant_area()), (0.5, 0.0));
        // Opaque cubes have no plant area.
        let cubes: Vec<f64> = (6..11).map(|i| facts(i).plant_area()).collect();
        assert_eq!(cubes, [2.0, 2.0, 2.0, 0.0, 0.0]);
        assert_eq!(facts(9).bounds(), Aabb { min: DVec3::splat(0.5), max: DVec3::splat(1.5) });
    }
}
