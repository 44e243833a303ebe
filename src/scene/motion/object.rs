//! The moving parts as rays see them.

use super::plan::{MotionPlan, PlannedPart};
use super::state::MotionState;
use crate::geom::Affine;
use crate::scene::Scene;
use crate::tree::{BuildOptions, Tree};
use std::ops::Range;

/// A worker's copy of the moving parts. The static part of the scene is shared by all workers and has a tree of its own.
#[derive(Clone, Debug)]
pub struct DynamicScene<'a> {
    plan: &'a MotionPlan,
    options: BuildOptions,
    objects: Vec<DynamicObject>,
    /// For each object the transform that [`DynamicScene::rebuild_moved`] has yet to apply.
    pending: Vec<Option<Affine>>,
}

/// A moving part in its current pose: a scene of its own with the tree over it.
#[derive(Clone, Debug)]
pub struct DynamicObject {
    /// The part alone; its primitives are numbered from 0.
    pub scene: Scene,
    /// The tree over it.
    pub tree: Tree,
    transform: Affine,
    /// Numbers of its triangles in the whole scene.
    triangles: Range<usize>,
    /// Numbers of its cubes in the whole scene.
    cubes: Range<usize>,
}

/// Rays see an object in another pose from some pulse on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectUpdate {
    /// Number of the first pulse of the batch that sees the new pose.
    pub first_pulse: usize,
    /// Number of the object among the moving parts.
    pub object: usize,
    /// From the initial pose to the new one.
    pub transform: Affine,
}

impl<'a> DynamicScene<'a> {
    /// All parts in their initial pose. `options` are those of their trees.
    pub fn new(plan: &'a MotionPlan, options: BuildOptions) -> DynamicScene<'a> {
        let options = BuildOptions { jobs: 0, ..options };
        let object = |part: &PlannedPart| DynamicObject {
            tree: Tree::build(&part.rest.geometry, &options),
            scene: part.rest.clone(),
            transform: Affine::IDENTITY,
            triangles: part.triangles.clone(),
            cubes: plan.triangles + part.cubes.start..plan.triangles + part.cubes.end,
        };
        let objects = plan.parts.iter().map(object).collect();
        DynamicScene { plan, options, objects, pending: vec![None; plan.parts.len()] }
    }

    /// Takes over the poses that rays see in `state`.
    pub fn set_state(&mut self, state: &MotionState) {
        for (pending, seen) in self.pending.iter_mut().zip(state.seen()) {
            *pending = Some(*seen);
        }
    }

    /// Takes over the pose of one object.
    pub fn apply(&mut self, update: &ObjectUpdate) {
        self.pending[update.object] = Some(update.transform);
    }

    /// Rebuilds the objects whose pose has changed since the last call; returns all of them.
    pub fn rebuild_moved(&mut self) -> &[DynamicObject] {
        for ((object, part), pending) in self.objects.iter_mut().zip(&self.plan.parts).zip(&mut self.pending)
        {
            if let Some(transform) = pending.take()
                && transform != object.transform
            {
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
        // Cubes stay upright; only their normals turn.
        to.cubes.iter_mut().zip(&from.cubes).for_each(|(c, rest)| c.centre = transform.apply(rest.centre));
        for (voxel, rest) in self.scene.voxels.iter_mut().zip(&rest.voxels) {
            *voxel = *rest;
            voxel.turn(&transform);
        }
    }

    /// The number in the whole scene of the object's primitive `i`.
    #[inline]
    pub fn to_scene_index(&self, i: u32) -> u32 {
        let i = i as usize;
        let number = match i.checked_sub(self.triangles.len()) {
            None => self.triangles.start + i,
            Some(cube) => self.cubes.start + cube,
        };
        number as u32
    }

    /// The object's number of the whole scene's primitive `i`; `None` if the primitive is of another part.
    #[inline]
    pub fn to_object_index(&self, i: u32) -> Option<u32> {
        let i = i as usize;
        if self.triangles.contains(&i) {
            return Some((i - self.triangles.start) as u32);
        }
        self.cubes.contains(&i).then(|| (i - self.cubes.start + self.triangles.len()) as u32)
    }
}
