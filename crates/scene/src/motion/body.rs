//! Moving objects as boxes.

use super::plan::MotionPlan;
use super::state::front;
use crate::{PartFacts, Scene};
use vlscan_geom::{Aabb, DVec3, Rotation};

/// The box around an object in its initial pose: upright, aligned with the direction in which the object
/// begins to move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyBox {
    /// Its centre, scene frame, m.
    pub centre: DVec3,
    /// Horizontal direction of its front, a unit vector.
    pub forward: DVec3,
    /// Length along `forward`, width and height, m.
    pub size: DVec3,
}

/// Pose and velocity of the box of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyPose {
    /// Centre of the box, scene frame, m.
    pub centre: DVec3,
    /// From the axes of the box, with x forward, y left and z up, to the scene frame.
    pub rotation: Rotation,
    /// Velocity of the centre, m per simulation step.
    pub velocity: DVec3,
}

impl MotionPlan {
    /// The box around some moving parts, by their indices, which are one object; its front is that of the
    /// first part. `None` without primitives.
    pub fn body_box(&self, objects: &[usize]) -> Option<BodyBox> {
        let forward = front(self.parts.get(*objects.first()?)?);
        let axes = [forward, DVec3::Z.cross(forward), DVec3::Z];
        let parts = objects.iter().filter_map(|&object| self.parts.get(object));
        let bounds = parts.map(|part| bounds_along(&part.rest, axes)).fold(Aabb::EMPTY, Aabb::union);
        if bounds.is_empty() {
            return None;
        }
        let at = bounds.centre();
        let centre = axes[0] * at.x + axes[1] * at.y + axes[2] * at.z;
        Some(BodyBox { centre, forward, size: bounds.size() })
    }

    /// Point class of most primitives of a moving part, by its index.
    pub fn class_of(&self, object: usize) -> i32 {
        let Some(part) = self.parts.get(object) else { return 0 };
        PartFacts::of_scene(&part.rest).first().map_or(0, |facts| facts.class(&part.rest))
    }
}

/// The box around the primitives of a scene in other axes.
fn bounds_along(scene: &Scene, axes: [DVec3; 3]) -> Aabb {
    let g = &scene.geometry;
    let along = |p: DVec3| DVec3::from(axes.map(|axis| axis.dot(p)));
    let corners = g.triangles.iter().flatten().map(|&vertex| along(g.vertices[vertex as usize]));
    // Cubes keep the axes of the scene while the box turns.
    let cubes = g.cubes.iter().flat_map(|cube| {
        let reach = DVec3::splat(cube.half * 3f64.sqrt());
        [along(cube.centre) - reach, along(cube.centre) + reach]
    });
    Aabb::around(corners.chain(cubes))
}
