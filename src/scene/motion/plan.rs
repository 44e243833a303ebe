//! What moves how and when.

use crate::geom::{Affine, DVec3, Rotation};
use crate::scene::{Mover, Part, Scene, Surface};
use crate::survey::{Motion, MotionKind, MotionSequence, MotionTiming};
use crate::tree::Geometry;
use std::collections::HashMap;
use std::ops::Range;

/// The moving parts of a scene: immutable, shared by the producer and all workers.
#[derive(Clone, Debug)]
pub struct Movers {
    /// Simulation steps from one update of the scene to the next; 0: only the first step updates it.
    pub(super) every: u64,
    pub(super) parts: Vec<MovingPart>,
    /// Triangles of the whole scene.
    pub(super) triangles: usize,
}

/// One of them.
#[derive(Clone, Debug)]
pub(super) struct MovingPart {
    pub sequences: Vec<Sequence>,
    /// Scene updates from one move to the next.
    pub every: u64,
    /// Moves from one refresh of what rays see to the next.
    pub refresh_every: u64,
    /// What it turns about by itself, and what moves with it: the centre of the box around it as it stands at first. The
    /// reference does not look for the centre again when the part has turned.
    pub centre: DVec3,
    /// The part alone, as it stands at first, numbered from 0.
    pub rest: Scene,
    /// Numbers of its triangles in the whole scene.
    pub triangles: Range<usize>,
    /// Numbers of its cubes among the scene's cubes.
    pub cubes: Range<usize>,
}

/// A `<dmotion>`.
#[derive(Clone, Debug)]
pub(super) struct Sequence {
    /// Repetitions; 0: for ever.
    pub loops: u32,
    pub next: Option<usize>,
    pub moves: Vec<Move>,
}

/// A `<motion>`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Move {
    pub map: Affine,
    /// About the part's own centre.
    pub about_self: bool,
}

impl Movers {
    /// The moving parts of `scene`; `None` if nothing moves. `pulse_rate` is the first leg's, in Hz: time steps count in
    /// its periods.
    pub fn new(scene: &Scene, pulse_rate: f64) -> Option<Movers> {
        if scene.movers.is_empty() {
            return None;
        }
        let period = scene.dyn_time_step;
        let parts = scene
            .movers
            .iter()
            .map(|mover| {
                let (every, refresh_every) = intervals(&mover.timing, period);
                let rest = alone(scene, mover);
                MovingPart {
                    sequences: sequences(&mover.motions, scene.shift),
                    every,
                    refresh_every,
                    centre: rest.geometry.bounds().centre(),
                    rest,
                    triangles: mover.triangles.clone(),
                    cubes: mover.cubes.clone(),
                }
            })
            .collect();
        let every = period.map_or(u64::from(scene.dyn_step), |t| whole(pulse_rate * t));
        Some(Movers { every, parts, triangles: scene.geometry.triangles.len() })
    }
}

/// A quotient of times as a number of steps, rounded down. What is no number or below 1 becomes 0.
fn whole(quotient: f64) -> u64 {
    quotient as u64
}

/// Scene updates between moves and moves between refreshes. Times count only where the scene has one (spec input-formats
/// §10, trap 44).
fn intervals(timing: &MotionTiming, scene_period: Option<f64>) -> (u64, u64) {
    let Some(scene) = scene_period else {
        return (timing.dyn_step.into(), timing.tree_step.into());
    };
    let part = timing.dyn_time_step.unwrap_or(scene);
    let tree = timing.tree_time_step.unwrap_or(part);
    (whole(part / scene), whole(tree / part))
}

fn sequences(motions: &[MotionSequence], shift: DVec3) -> Vec<Sequence> {
    let moves = |motion: &Motion| Move { map: map(motion, shift), about_self: motion.about_self };
    motions
        .iter()
        .map(|s| Sequence { loops: s.loops, next: s.next, moves: s.motions.iter().map(moves).collect() })
        .collect()
}

/// What a motion does in the scene's frame, whose origin lies at `shift` in the world.
fn map(motion: &Motion, shift: DVec3) -> Affine {
    let rotation = |axis, angle| Affine::rotation(&Rotation::about(axis, angle));
    match motion.kind {
        MotionKind::Identity => Affine::IDENTITY,
        MotionKind::Translation { by } => Affine::translation(by + shift * motion.auto_crs),
        MotionKind::Rotation { axis, angle, centre: None } => rotation(axis, angle),
        MotionKind::Rotation { axis, angle, centre: Some(centre) } => {
            rotation(axis, angle).about(centre - shift * motion.auto_crs)
        }
        MotionKind::Reflection { normal } => Affine::reflection(normal),
        MotionKind::GlidePlane { normal, shift } => {
            Affine::translation(shift).after(&Affine::reflection(normal))
        }
        MotionKind::Helical { axis, angle, glide } => {
            Affine::translation(axis * glide).after(&rotation(axis, angle))
        }
        MotionKind::RotaryReflection { axis, angle, centre } => {
            let about_origin = Affine::reflection(axis).after(&rotation(axis, angle));
            centre.map_or(about_origin, |centre| about_origin.about(centre))
        }
    }
}

/// A moving part as a scene of its own.
fn alone(scene: &Scene, mover: &Mover) -> Scene {
    let g = &scene.geometry;
    let first = mover.vertices.start as u32;
    let geometry = Geometry {
        vertices: g.vertices[mover.vertices.clone()].to_vec().into(),
        triangles: g.triangles[mover.triangles.clone()].iter().map(|t| t.map(|v| v - first)).collect(),
        cubes: g.cubes[mover.cubes.clone()].to_vec().into(),
    };
    let count = g.triangles.len();
    let cubes = count + mover.cubes.start..count + mover.cubes.end;
    let numbers = scene.surface_of.among(mover.triangles.clone()).chain(scene.surface_of.among(cubes));
    let (mut surfaces, mut materials, mut known) = (Vec::new(), Vec::new(), HashMap::new());
    let surface_of = numbers
        .map(|number| {
            *known.entry(number).or_insert_with(|| {
                materials.push(scene.materials[scene.surfaces[number as usize].material as usize].clone());
                surfaces.push(Surface { part: 0, material: surfaces.len() as u32 });
                surfaces.len() as u32 - 1
            })
        })
        .collect();
    Scene {
        shift: scene.shift,
        bounds: scene.bounds,
        geometry,
        surface_of,
        surfaces,
        parts: vec![Part::clone(&scene.parts[mover.part as usize])],
        materials,
        voxels: scene.voxels[mover.cubes.clone()].to_vec().into(),
        ..Scene::default()
    }
}
