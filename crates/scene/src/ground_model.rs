//! The ground of a loaded scene, found with its tree: the reference of point heights, which planned legs
//! follow and trees stand on.

use crate::{LoadOptions, Scene, load};
use std::fmt;
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_geom::DVec3;
use vlscan_survey::SceneRecipe;
use vlscan_trace::{BuildOptions, Tree};

/// The surface that is taken as ground in scenes without a ground material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fallback {
    /// The lowest surface at a place.
    Lowest,
    /// The highest surface at a place.
    Highest,
}

/// The highest ground at each place of a scene.
pub struct GroundModel {
    scene: Arc<Scene>,
    tree: Arc<Tree>,
    has_ground: bool,
    fallback: Fallback,
}

impl GroundModel {
    /// The ground of a scene with its tree; `fallback` applies where no material is ground.
    pub fn new(scene: Arc<Scene>, tree: Arc<Tree>, fallback: Fallback) -> GroundModel {
        let has_ground = scene.materials.iter().any(|material| material.is_ground);
        GroundModel { scene, tree, has_ground, fallback }
    }

    /// Loads a scene for its ground, or its highest surfaces if no material is ground. Also returns what
    /// [`load`](fn@load) warns of.
    ///
    /// # Errors
    /// The errors of [`load`](fn@load).
    pub fn load(recipe: &SceneRecipe, options: &LoadOptions) -> Result<(GroundModel, Diagnostics)> {
        let (scene, warnings) = load(recipe, options)?;
        let tree = scene.tree(&BuildOptions::default());
        Ok((GroundModel::new(Arc::new(scene), tree, Fallback::Highest), warnings))
    }

    /// The corners of the box of the scene's ground, which crowns and roofs may reach beyond, world
    /// coordinates, m; in scenes without a ground material the corners of the scene's box.
    pub fn extent(&self) -> [[f64; 2]; 2] {
        let bounds = self.scene.ground_bounds().unwrap_or(self.scene.bounds);
        [bounds.min, bounds.max].map(|corner| {
            let corner = self.scene.to_world(corner);
            [corner.x, corner.y]
        })
    }

    /// The system of the scene's coordinates as WKT, if its files name one.
    pub fn crs(&self) -> Option<&str> {
        self.scene.crs.as_deref()
    }

    /// True if a material of the scene is ground.
    pub fn has_ground(&self) -> bool {
        self.has_ground
    }

    /// True if a leg at x, y (world coordinates) has ground below it, by the rules of a run.
    pub fn is_under(&self, x: f64, y: f64) -> bool {
        let place = self.scene.to_local(DVec3::new(x, y, 0.0));
        self.scene.ground_height(place.x, place.y).is_some()
    }

    /// World height of the ground at x, y, world coordinates, m; `None` where there is none.
    pub fn height(&self, x: f64, y: f64) -> Option<f64> {
        let place = self.scene.to_local(DVec3::new(x, y, 0.0));
        let z = self.local_height(place.x, place.y)?;
        Some(self.scene.to_world(place.with_z(z)).z)
    }

    /// Height of the ground at x, y, scene frame, m; `None` where there is none.
    pub fn local_height(&self, x: f64, y: f64) -> Option<f64> {
        let GroundModel { scene, tree, has_ground, fallback } = self;
        let bounds = &scene.bounds;
        let (from, towards) = match *has_ground || *fallback == Fallback::Highest {
            true => (DVec3::new(x, y, bounds.max.z + 1.0), -DVec3::Z),
            false => (DVec3::new(x, y, bounds.min.z - 1.0), DVec3::Z),
        };
        let is_ground = |scene: &Scene, i: u32| !has_ground || scene.material_of(i).is_ground;
        let hit = scene.nearest_where(tree, from, towards, is_ground)?;
        Some((from + towards * hit.t).z)
    }
}

impl fmt::Debug for GroundModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GroundModel").field("has_ground", &self.has_ground).finish_non_exhaustive()
    }
}
