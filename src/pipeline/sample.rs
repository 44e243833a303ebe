//! Facts about a loaded scene, and points on its surfaces for a picture of it.

use super::session::LoadedScene;
use ::arrow_array::{Float64Array, Int32Array, RecordBatch};
use std::sync::Arc;
use vlscan_base::error::{Error, Result};
use vlscan_base::rng::{Purpose, Stream};
use vlscan_geom::{Aabb, DVec3};

/// Facts about a loaded scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFacts {
    /// Box around all primitives, world frame, m.
    pub bounds: Aabb,
    /// Number of triangles and voxels, those of instances included.
    pub primitives: u64,
    /// Ids of the parts.
    pub parts: Vec<String>,
    /// Names, reflectances and classes of the materials.
    pub materials: Vec<(String, f64, i32)>,
    /// Memory of scene and tree, bytes.
    pub memory: u64,
}

impl LoadedScene {
    /// Facts about the scene.
    pub fn facts(&self) -> SceneFacts {
        let scene = self.scene();
        SceneFacts {
            bounds: scene.bounds.translated(scene.shift),
            primitives: scene.primitives() as u64,
            parts: scene.parts.iter().map(|part| part.id.clone()).collect(),
            materials: scene
                .materials
                .iter()
                .map(|material| (material.name.clone(), material.reflectance, material.classification))
                .collect(),
            memory: (scene.memory() + self.tree().memory()) as u64,
        }
    }

    /// World height of the ground at (x, y), m: the lowest surface whose material is ground; `None` where there is none.
    pub fn ground_height(&self, x: f64, y: f64) -> Option<f64> {
        let scene = self.scene();
        let shift = scene.shift;
        scene.ground_height(x - shift.x, y - shift.y).map(|z| z + shift.z)
    }

    /// About `count` points on the surfaces of the scene, in proportion to their areas and the same in every call, with the
    /// columns X, Y, Z (m, world frame), Classification and ObjectId (index of the part).
    ///
    /// # Errors
    /// [`Error::Internal`] if no table can be made of them.
    pub fn sample(&self, count: usize) -> Result<RecordBatch> {
        let scene = self.scene();
        let area = |i: u32| match scene.triangle(i) {
            Some([a, b, c]) => (b - a).cross(c - a).length() / 2.0,
            None => {
                let cube = (i as usize).checked_sub(scene.geometry.triangles.len());
                let half = cube.and_then(|i| scene.geometry.cubes.get(i)).map_or(0.0, |cube| cube.half);
                24.0 * half * half
            }
        };
        let primitives = scene.primitives() as u32;
        let total: f64 = (0..primitives).map(area).sum();
        let per_area = if total > 0.0 { count as f64 / total } else { 0.0 };
        let stream = Stream::new(0, Purpose::Material);
        let (mut points, mut classes, mut parts) = (Vec::new(), Vec::new(), Vec::new());
        let mut due = 0.0;
        for i in 0..primitives {
            due += area(i) * per_area;
            let mut number = 0;
            while due >= 1.0 {
                due -= 1.0;
                let random = |component| stream.uniform(i, number, component);
                points.push(point_on(self, i, [random(0), random(1), random(2)]) + scene.shift);
                classes.push(scene.material_of(i).classification);
                parts.push(scene.part_of(i) as i32);
                number += 1;
            }
        }
        let axis = |axis: usize| Arc::new(points.iter().map(|p| p[axis]).collect::<Float64Array>());
        let columns: [(&str, Arc<dyn ::arrow_array::Array>); 5] = [
            ("X", axis(0)),
            ("Y", axis(1)),
            ("Z", axis(2)),
            ("Classification", Arc::new(Int32Array::from(classes))),
            ("ObjectId", Arc::new(Int32Array::from(parts))),
        ];
        RecordBatch::try_from_iter(columns).map_err(|e| Error::Internal(format!("Arrow: {e}")))
    }
}

/// A point on primitive `i`, scene frame; the random numbers are uniform from 0 to 1.
fn point_on(loaded: &LoadedScene, i: u32, [u, v, w]: [f64; 3]) -> DVec3 {
    let scene = loaded.scene();
    if let Some([a, b, c]) = scene.triangle(i) {
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        return a + (b - a) * u + (c - a) * v;
    }
    let index = (i as usize).saturating_sub(scene.geometry.triangles.len());
    let Some(cube) = scene.geometry.cubes.get(index) else { return DVec3::ZERO };
    let side = (w * 6.0) as usize % 6;
    let mut offset = DVec3::new(2.0 * u - 1.0, 2.0 * v - 1.0, 0.0);
    offset[2] = if side.is_multiple_of(2) { 1.0 } else { -1.0 };
    let turned = [offset, DVec3::new(offset.z, offset.x, offset.y), DVec3::new(offset.y, offset.z, offset.x)];
    cube.centre + turned[side / 2] * cube.half
}
