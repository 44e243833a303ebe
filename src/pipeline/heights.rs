//! The ground that heights of points count from.

use crate::geom::DVec3;
use crate::output::{Column, Ground, OutputRequest};
use crate::scene::Scene;
use crate::tree::Tree;
use std::fmt;
use std::sync::Arc;

/// The highest ground above a place; in scenes without a ground material the lowest surface.
struct SceneGround {
    scene: Arc<Scene>,
    tree: Arc<Tree>,
    has_ground: bool,
}

impl fmt::Debug for SceneGround {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SceneGround").field("has_ground", &self.has_ground).finish_non_exhaustive()
    }
}

impl Ground for SceneGround {
    fn height(&self, x: f64, y: f64) -> Option<f64> {
        let SceneGround { scene, tree, has_ground } = self;
        let bounds = &scene.bounds;
        let (from, towards) = match has_ground {
            true => (DVec3::new(x, y, bounds.max.z + 1.0), -DVec3::Z),
            false => (DVec3::new(x, y, bounds.min.z - 1.0), DVec3::Z),
        };
        let is_ground = |i: u32| !has_ground || scene.material_of(i).is_ground;
        let hit = tree.nearest_where(&scene.geometry, from, towards, is_ground)?;
        Some((from + towards * hit.t).z)
    }
}

/// The outputs with the ground of the scene if they need it.
pub fn with_ground(outputs: OutputRequest, scene: &Arc<Scene>, tree: &Arc<Tree>) -> OutputRequest {
    let is_height = |column: &Column| *column == Column::HeightAboveGround;
    if !(outputs.heights || outputs.columns.iter().flatten().any(is_height)) {
        return outputs;
    }
    let has_ground = scene.materials.iter().any(|material| material.is_ground);
    let ground = SceneGround { scene: scene.clone(), tree: tree.clone(), has_ground };
    OutputRequest { ground: Some(Arc::new(ground)), ..outputs }
}
