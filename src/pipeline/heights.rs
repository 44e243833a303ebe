//! The ground that heights of points count from and that planned legs follow.

use crate::output::Ground;
use std::fmt;
use std::sync::Arc;
use vlscan_geom::DVec3;
use vlscan_scene::Scene;
use vlscan_trace::Tree;

/// The surface that is taken as ground in scenes without a ground material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fallback {
    /// The lowest surface: heights of points in a scene of terrain and what is on it.
    Lowest,
    /// The highest surface: what a flight must stay above.
    Highest,
}

/// The highest ground at a place, found with the scene's tree.
pub struct SceneGround {
    /// The scene.
    pub scene: Arc<Scene>,
    tree: Arc<Tree>,
    /// Whether a material of the scene is ground.
    has_ground: bool,
    fallback: Fallback,
}

impl SceneGround {
    /// The ground of a scene, found with the tree over it.
    pub fn new(scene: Arc<Scene>, tree: Arc<Tree>, fallback: Fallback) -> SceneGround {
        let has_ground = scene.materials.iter().any(|material| material.is_ground);
        SceneGround { scene, tree, has_ground, fallback }
    }
}

impl fmt::Debug for SceneGround {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SceneGround").field("has_ground", &self.has_ground).finish_non_exhaustive()
    }
}

impl Ground for SceneGround {
    fn height(&self, x: f64, y: f64) -> Option<f64> {
        let SceneGround { scene, tree, has_ground, fallback } = self;
        let bounds = &scene.bounds;
        let (from, towards) = match *has_ground || *fallback == Fallback::Highest {
            true => (DVec3::new(x, y, bounds.max.z + 1.0), -DVec3::Z),
            false => (DVec3::new(x, y, bounds.min.z - 1.0), DVec3::Z),
        };
        let is_ground = |i: u32| !has_ground || scene.material_of(i).is_ground;
        let hit = tree.nearest_where(&scene.geometry, from, towards, is_ground)?;
        Some((from + towards * hit.t).z)
    }
}
