//! The ground of a scene, for commands that put something on it or above it.

use crate::diag::Diagnostics;
use crate::error::Result;
use crate::geom::DVec3;
use crate::scene::{self, LoadOptions, Scene};
use crate::survey::SceneRecipe;
use crate::tree::{BuildOptions, Tree};

/// A loaded scene with its tree.
pub struct GroundModel {
    scene: Scene,
    tree: Tree,
    /// Whether a material of the scene is ground.
    has_ground: bool,
}

impl GroundModel {
    /// # Errors
    /// Those of [`scene::load`].
    pub fn load(recipe: &SceneRecipe, options: &LoadOptions) -> Result<(GroundModel, Diagnostics)> {
        let (scene, warnings) = scene::load(recipe, options)?;
        let tree = scene.tree(&BuildOptions::default());
        let has_ground = scene.materials.iter().any(|material| material.is_ground);
        Ok((GroundModel { scene, tree, has_ground }, warnings))
    }

    /// The corners of the scene's box, world coordinates, m.
    pub fn extent(&self) -> [[f64; 2]; 2] {
        let bounds = &self.scene.bounds;
        [bounds.min, bounds.max].map(|corner| {
            let corner = self.scene.to_world(corner);
            [corner.x, corner.y]
        })
    }

    /// World height of the highest ground at x, y, m; in scenes without a ground material that of the highest surface.
    /// `None` where there is none.
    pub fn height(&self, x: f64, y: f64) -> Option<f64> {
        let above = self.scene.to_local(DVec3::new(x, y, 0.0)).with_z(self.scene.bounds.max.z + 1.0);
        let is_ground = |i: u32| !self.has_ground || self.scene.material_of(i).is_ground;
        let hit = self.tree.nearest_where(&self.scene.geometry, above, -DVec3::Z, is_ground)?;
        Some(self.scene.to_world(above - DVec3::Z * hit.t).z)
    }
}
