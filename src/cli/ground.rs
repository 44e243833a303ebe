//! The ground of a scene, for commands that put something on it or above it.

use crate::diag::Diagnostics;
use crate::error::Result;
use crate::geom::DVec3;
use crate::output::Ground;
use crate::pipeline::{Fallback, SceneGround};
use crate::scene::{self, LoadOptions};
use crate::survey::SceneRecipe;
use crate::tree::BuildOptions;
use std::sync::Arc;

/// The ground of a loaded scene in world coordinates.
pub struct GroundModel(SceneGround);

impl GroundModel {
    /// # Errors
    /// Those of [`scene::load`].
    pub fn load(recipe: &SceneRecipe, options: &LoadOptions) -> Result<(GroundModel, Diagnostics)> {
        let (scene, warnings) = scene::load(recipe, options)?;
        let tree = scene.tree(&BuildOptions::default());
        let ground = SceneGround::new(Arc::new(scene), Arc::new(tree), Fallback::Highest);
        Ok((GroundModel(ground), warnings))
    }

    /// The corners of the scene's box, world coordinates, m.
    pub fn extent(&self) -> [[f64; 2]; 2] {
        let scene = &self.0.scene;
        [scene.bounds.min, scene.bounds.max].map(|corner| {
            let corner = scene.to_world(corner);
            [corner.x, corner.y]
        })
    }

    /// World height of the highest ground at x, y, m; in scenes without a ground material that of the highest surface.
    /// `None` where there is none.
    pub fn height(&self, x: f64, y: f64) -> Option<f64> {
        let place = self.0.scene.to_local(DVec3::new(x, y, 0.0));
        let z = self.0.height(place.x, place.y)?;
        Some(self.0.scene.to_world(place.with_z(z)).z)
    }
}
