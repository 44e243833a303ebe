//! Rays without an instrument through a loaded scene: [`LoadedScene::cast`] and [`RayCaster`].

use super::scene::LoadedScene;
use rayon::prelude::*;
use std::sync::Arc;
use vlscan_base::diag::Notice;
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;
use vlscan_scene::Scene;
use vlscan_trace::{Hit, TraceScratch, Tree};

/// First surface that a ray hits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// Distance from the origin of the ray, m.
    pub distance: f64,
    /// Index of the part among [`SceneFacts::parts`](super::SceneFacts::parts).
    pub part: u32,
    /// Number of the primitive, in the order of the parts; cubes follow the triangles.
    pub primitive: u32,
    /// Unit normal of the surface, towards the origin of the ray.
    pub normal: DVec3,
}

impl LoadedScene {
    /// First hits of rays without an instrument, on all threads: origins in the world frame, m, directions of
    /// any length. Rays that are not finite and those without a direction hit nothing. If there are more
    /// origins than directions, or fewer, the rest is left out.
    ///
    /// # Errors
    /// As for [`LoadedScene::caster`].
    pub fn cast(
        &self,
        origins: &[DVec3],
        directions: &[DVec3],
        notify: &dyn Fn(Notice),
    ) -> Result<Vec<Option<RayHit>>> {
        let caster = self.caster(notify)?;
        let mut found = vec![None; origins.len().min(directions.len())];
        let origins = origins.par_chunks(RayCaster::PIECE);
        let rays = origins.zip(directions.par_chunks(RayCaster::PIECE));
        let pieces = found.par_chunks_mut(RayCaster::PIECE).zip(rays);
        pieces.for_each_init(
            || caster.clone(),
            |caster, (found, (origins, directions))| {
                let hits = caster.hits(origins.iter().copied().zip(directions.iter().copied()));
                found.iter_mut().zip(hits).for_each(|(to, hit)| *to = hit);
            },
        );
        Ok(found)
    }

    /// Returns what sends rays through the scene on one thread; each thread has a clone.
    ///
    /// # Errors
    /// [`Error::Input`] for scenes with moving parts or with parts that are not in memory; as for
    /// [`LoadedScene::tree`].
    pub fn caster(&self, notify: &dyn Fn(Notice)) -> Result<RayCaster> {
        let scene = self.scene();
        if scene.tiles.is_some() {
            return Err(Error::input(
                "rays need the scene in memory: leave out --scene-memory, also where it was packed",
            ));
        }
        if let Some(moving) = scene.moving_parts.first() {
            let id = scene.parts.get(moving.part as usize).map_or("", |part| part.id.as_str());
            return Err(Error::input(format!("rays need a scene at rest, but part {id} moves")));
        }
        Ok(RayCaster::new(scene.clone(), self.tree(notify)?.clone()))
    }
}

/// Sends rays through a scene, on one thread. Clones share the scene.
pub struct RayCaster {
    scene: Arc<Scene>,
    tree: Arc<Tree>,
    /// Rays of the call in the scene frame, with unit directions.
    origins: Vec<DVec3>,
    directions: Vec<DVec3>,
    scratch: TraceScratch,
}

impl RayCaster {
    /// Number of rays that are best traced by one call.
    pub const PIECE: usize = 16_384;

    fn new(scene: Arc<Scene>, tree: Arc<Tree>) -> RayCaster {
        RayCaster {
            scene,
            tree,
            origins: Vec::new(),
            directions: Vec::new(),
            scratch: TraceScratch::default(),
        }
    }

    /// First hits of rays as origins in the world frame, m, and directions of any length; `None` for those
    /// that hit nothing.
    pub fn hits(
        &mut self,
        rays: impl Iterator<Item = (DVec3, DVec3)>,
    ) -> impl Iterator<Item = Option<RayHit>> {
        let RayCaster { scene, tree, origins, directions, scratch } = self;
        let scene: &Scene = scene;
        origins.clear();
        directions.clear();
        for (origin, direction) in rays {
            origins.push(scene.to_local(origin));
            directions.push(direction.normalize_or_zero());
        }
        let hits = tree.trace_rays(&scene.geometry, origins, directions, scratch);
        let rays = origins.iter().zip(&*directions).zip(hits);
        rays.map(move |((origin, way), hit)| hit.map(|hit| ray_hit(scene, (*origin, *way), hit)))
    }
}

impl Clone for RayCaster {
    fn clone(&self) -> RayCaster {
        RayCaster::new(self.scene.clone(), self.tree.clone())
    }
}

/// Converts the hit of a ray in the scene frame.
fn ray_hit(scene: &Scene, (origin, direction): (DVec3, DVec3), hit: Hit) -> RayHit {
    let normal = match scene.triangle(hit.primitive) {
        Some([a, b, c]) => (b - a).cross(c - a).normalize_or_zero(),
        None => {
            let centre = scene.geometry.cube_of(hit.primitive).map_or(DVec3::ZERO, |cube| cube.centre);
            let offset = origin + direction * hit.t - centre;
            let size = offset.abs();
            if size.x >= size.y && size.x >= size.z {
                DVec3::X
            } else if size.y >= size.z {
                DVec3::Y
            } else {
                DVec3::Z
            }
        }
    };
    RayHit {
        distance: hit.t,
        part: scene.part_of(hit.primitive),
        primitive: scene.number_when_stored(hit.primitive),
        normal: if normal.dot(direction) > 0.0 { -normal } else { normal },
    }
}
