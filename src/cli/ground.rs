//! The ground of a scene, for commands that put something on it or above it.

use crate::output::Ground;
use crate::pipeline::{Fallback, LoadedScene, SceneGround};
use std::sync::Arc;
use vlscan_base::diag::{Diagnostics, Notice};
use vlscan_base::error::Result;
use vlscan_geom::DVec3;
use vlscan_scene::LoadOptions;
use vlscan_survey::SceneRecipe;
use vlscan_trace::BuildOptions;

/// The ground of a loaded scene in world coordinates.
pub struct GroundModel(SceneGround);

impl GroundModel {
    /// # Errors
    /// Those of [`vlscan_scene::load`].
    pub fn load(recipe: &SceneRecipe, options: &LoadOptions) -> Result<(GroundModel, Diagnostics)> {
        let (scene, warnings) = vlscan_scene::load(recipe, options)?;
        let tree = scene.tree(&BuildOptions::default());
        let ground = SceneGround::new(Arc::new(scene), tree, Fallback::Highest);
        Ok((GroundModel(ground), warnings))
    }

    /// The ground of a scene that is loaded.
    ///
    /// # Errors
    /// Those of [`LoadedScene::tree`].
    pub fn over(loaded: &LoadedScene, notify: &dyn Fn(Notice)) -> Result<GroundModel> {
        Ok(GroundModel(loaded.ground(Fallback::Highest, notify)?))
    }

    /// The corners of the box of the scene's ground, which crowns and roofs may reach beyond, world coordinates, m; in
    /// scenes without a ground material those of the scene's box.
    pub fn extent(&self) -> [[f64; 2]; 2] {
        let scene = &self.0.scene;
        let bounds = scene.ground_bounds().unwrap_or(scene.bounds);
        [bounds.min, bounds.max].map(|corner| {
            let corner = scene.to_world(corner);
            [corner.x, corner.y]
        })
    }

    /// The system of the scene's coordinates as WKT, if its files name one.
    pub fn crs(&self) -> Option<&str> {
        self.0.scene.crs.as_deref()
    }

    /// Whether a material of the scene is ground.
    pub fn has_ground(&self) -> bool {
        self.0.scene.materials.iter().any(|material| material.is_ground)
    }

    /// Whether a leg at x, y finds ground, as a run looks for it.
    pub fn is_under(&self, x: f64, y: f64) -> bool {
        let place = self.0.scene.to_local(DVec3::new(x, y, 0.0));
        self.0.scene.ground_height(place.x, place.y).is_some()
    }

    /// World height of the highest ground at x, y, m; in scenes without a ground material that of the highest surface.
    /// `None` where there is none.
    pub fn height(&self, x: f64, y: f64) -> Option<f64> {
        let place = self.0.scene.to_local(DVec3::new(x, y, 0.0));
        let z = self.0.height(place.x, place.y)?;
        Some(self.0.scene.to_world(place.with_z(z)).z)
    }
}
