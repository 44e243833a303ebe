//! The moving parts where rays see them.

use super::plan::{Movers, MovingPart};
use super::state::MoverState;
use crate::geom::Affine;
use crate::scene::Scene;
use crate::tree::{BuildOptions, Tree};
use std::ops::Range;

/// A worker's copy of the moving parts. The still rest of the scene is shared and has a tree of its own.
#[derive(Clone, Debug)]
pub struct Stage<'a> {
    plan: &'a Movers,
    options: BuildOptions,
    actors: Vec<Actor>,
    /// Where each part should be seen, where that is not where its actor stands.
    due: Vec<Option<Affine>>,
}

/// A moving part at one place: a scene of its own with the tree over it.
#[derive(Clone, Debug)]
pub struct Actor {
    /// The part alone; its primitives are numbered from 0.
    pub scene: Scene,
    /// The tree over it.
    pub tree: Tree,
    place: Affine,
    triangles: Range<usize>,
    /// Numbers of its cubes in the whole scene.
    cubes: Range<usize>,
}

/// A part is seen elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// Number of the first pulse, of those that are fired together, that sees it.
    pub before: usize,
    /// Number of the part among those that move.
    pub part: usize,
    /// From where the part stood at first to where it is seen.
    pub place: Affine,
}

impl<'a> Stage<'a> {
    /// All parts where they stand at first. `options` are those of their trees.
    pub fn new(plan: &'a Movers, options: BuildOptions) -> Stage<'a> {
        let options = BuildOptions { jobs: 0, ..options };
        let actor = |part: &MovingPart| Actor {
            tree: Tree::build(&part.rest.geometry, &options),
            scene: part.rest.clone(),
            place: Affine::IDENTITY,
            triangles: part.triangles.clone(),
            cubes: plan.triangles + part.cubes.start..plan.triangles + part.cubes.end,
        };
        let actors = plan.parts.iter().map(actor).collect();
        Stage { plan, options, actors, due: vec![None; plan.parts.len()] }
    }

    /// Shows everything as it is seen at a state.
    pub fn set(&mut self, state: &MoverState) {
        for (due, seen) in self.due.iter_mut().zip(state.seen()) {
            *due = Some(*seen);
        }
    }

    /// Shows one part elsewhere.
    pub fn change(&mut self, change: &Change) {
        self.due[change.part] = Some(change.place);
    }

    /// The parts at their places. Trees of those that moved since the last call are built now.
    pub fn show(&mut self) -> &[Actor] {
        for ((actor, part), due) in self.actors.iter_mut().zip(&self.plan.parts).zip(&mut self.due) {
            if let Some(place) = due.take()
                && place != actor.place
            {
                actor.stand_at(&part.rest, place);
                actor.tree = Tree::build(&actor.scene.geometry, &self.options);
            }
        }
        &self.actors
    }
}

impl Actor {
    fn stand_at(&mut self, rest: &Scene, place: Affine) {
        self.place = place;
        let (from, to) = (&rest.geometry, &mut self.scene.geometry);
        to.vertices.iter_mut().zip(&from.vertices).for_each(|(v, rest)| *v = place.apply(*rest));
        // Cubes stay upright; only their normals turn.
        to.cubes.iter_mut().zip(&from.cubes).for_each(|(c, rest)| c.centre = place.apply(rest.centre));
        for (voxel, rest) in self.scene.voxels.iter_mut().zip(&rest.voxels) {
            *voxel = *rest;
            voxel.turn(&place);
        }
    }

    /// The number in the whole scene of the part's primitive `i`.
    #[inline]
    pub fn global(&self, i: u32) -> u32 {
        let i = i as usize;
        let number = match i.checked_sub(self.triangles.len()) {
            None => self.triangles.start + i,
            Some(cube) => self.cubes.start + cube,
        };
        number as u32
    }

    /// The part's number of the whole scene's primitive `i`, if it belongs to it.
    #[inline]
    pub fn local(&self, i: u32) -> Option<u32> {
        let i = i as usize;
        if self.triangles.contains(&i) {
            return Some((i - self.triangles.start) as u32);
        }
        self.cubes.contains(&i).then(|| (i - self.cubes.start + self.triangles.len()) as u32)
    }
}
