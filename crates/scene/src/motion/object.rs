//! The moving parts in the poses that rays hit.

use super::plan::{MotionPlan, PlannedPart};
use super::state::MotionState;
use super::twist::Twist;
use crate::Scene;
use std::ops::Range;
use vlscan_geom::Affine;
use vlscan_trace::{BuildOptions, Tree};

/// A worker's copy of the moving parts. The static part of the scene is shared by all workers and has a
/// separate tree.
#[derive(Clone, Debug)]
pub struct DynamicScene<'a> {
    plan: &'a MotionPlan,
    options: BuildOptions,
    objects: Vec<DynamicObject>,
    /// For each object the transform and the velocity to be applied by the next
    /// [`DynamicScene::rebuild_moved`].
    pending: Vec<Option<(Affine, Twist)>>,
}

/// A moving part in its current pose: a separate scene with its tree.
#[derive(Clone, Debug)]
pub struct DynamicObject {
    /// The part alone; its primitives are numbered from 0.
    pub scene: Scene,
    /// The tree over the primitives of `scene` for ray tracing.
    pub tree: Tree,
    /// Velocity, per simulation step.
    pub twist: Twist,
    transform: Affine,
    /// Indices of its triangles in the complete scene.
    triangles: Range<usize>,
    /// Indices of its cubes in the complete scene.
    cubes: Range<usize>,
}

/// A change of the pose in which rays hit an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectUpdate {
    /// Index of the first pulse of the batch with the new pose.
    pub first_pulse: usize,
    /// Index of the object among the moving parts.
    pub object: usize,
    /// From the initial pose to the new one.
    pub transform: Affine,
    /// Velocity in the new pose, per simulation step.
    pub twist: Twist,
}

impl<'a> DynamicScene<'a> {
    /// All parts in their initial pose. `options` apply to their trees.
    pub fn new(plan: &'a MotionPlan, options: BuildOptions) -> DynamicScene<'a> {
        let options = BuildOptions { jobs: 0, ..options };
        let object = |part: &PlannedPart| DynamicObject {
            tree: Tree::build(&part.rest.geometry, &options),
            scene: part.rest.clone(),
            twist: Twist::ZERO,
            transform: Affine::IDENTITY,
            triangles: part.triangles.clone(),
            cubes: plan.triangles + part.cubes.start..plan.triangles + part.cubes.end,
        };
        let objects = plan.parts.iter().map(object).collect();
        DynamicScene { plan, options, objects, pending: vec![None; plan.parts.len()] }
    }

    /// Adopts the refreshed poses of `state`.
    pub fn set_state(&mut self, state: &MotionState) {
        for (i, (pending, seen)) in self.pending.iter_mut().zip(state.seen()).enumerate() {
            *pending = Some((*seen, state.twist(self.plan, i)));
        }
    }

    /// Adopts the pose of one object.
    pub fn apply(&mut self, update: &ObjectUpdate) {
        self.pending[update.object] = Some((update.transform, update.twist));
    }

    /// Rebuilds the objects whose pose has changed since the last call; returns all objects.
    pub fn rebuild_moved(&mut self) -> &[DynamicObject] {
        for ((object, part), pending) in self.objects.iter_mut().zip(&self.plan.parts).zip(&mut self.pending)
        {
            let Some((transform, twist)) = pending.take() else { continue };
            object.twist = twist;
            if transform != object.transform {
                object.transform_from(&part.rest, transform);
                object.tree = Tree::build(&object.scene.geometry, &self.options);
            }
        }
        &self.objects
    }
}

impl DynamicObject {
    fn transform_from(&mut self, rest: &Scene, transform: Affine) {
        self.transform = transform;
        let (from, to) = (&rest.geometry, &mut self.scene.geometry);
        to.vertices.iter_mut().zip(&from.vertices).for_each(|(v, rest)| *v = transform.apply(*rest));
        // Cubes remain axis-aligned; only their normals rotate.
        to.cubes.iter_mut().zip(&from.cubes).for_each(|(c, rest)| c.centre = transform.apply(rest.centre));
        for (voxel, rest) in self.scene.voxels.iter_mut().zip(&rest.voxels) {
            *voxel = *rest;
            voxel.turn(&transform);
        }
    }

    /// Converts the index of a primitive of the object to that in the complete scene.
    #[inline]
    pub fn to_scene_index(&self, i: u32) -> u32 {
        let i = i as usize;
        let number = match i.checked_sub(self.triangles.len()) {
            None => self.triangles.start + i,
            Some(cube) => self.cubes.start + cube,
        };
        number as u32
    }

    /// Converts the index of a primitive of the complete scene to that in the object; `None` if it belongs to
    /// another part.
    #[inline]
    pub fn to_object_index(&self, i: u32) -> Option<u32> {
        let i = i as usize;
        if self.triangles.contains(&i) {
            return Some((i - self.triangles.start) as u32);
        }
        self.cubes.contains(&i).then(|| (i - self.cubes.start + self.triangles.len()) as u32)
    }
}
