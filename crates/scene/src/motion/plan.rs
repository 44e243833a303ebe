//! The schedule and the transforms of moving parts.

use crate::{MovingPart, Part, Scene, Surface};
use std::collections::HashMap;
use std::ops::Range;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_geom::{Affine, DVec3, Rotation};
use vlscan_survey::{Motion, MotionKind, MotionSequence, MotionTiming, rounded_steps};
use vlscan_trace::Geometry;

/// The moving parts of a scene and their motions: immutable, shared by the producer and all workers.
#[derive(Clone, Debug)]
pub struct MotionPlan {
    /// Simulation steps between scene updates; 0: only the first step updates the scene.
    pub(super) update_interval: u64,
    pub(super) parts: Vec<PlannedPart>,
    /// Number of triangles of the complete scene.
    pub(super) triangles: usize,
}

/// A moving part with its motions in the scene's frame.
#[derive(Clone, Debug)]
pub(super) struct PlannedPart {
    pub sequences: Vec<Sequence>,
    /// Scene updates between moves.
    pub move_interval: u64,
    /// Moves between refreshes of the pose that rays hit.
    pub refresh_interval: u64,
    /// Centre of rotations about the part itself: that of its bounding box in the initial pose, moved along
    /// with the part. The reference does not recompute the box after a rotation of the part.
    pub centre: DVec3,
    /// The part alone in its initial pose, numbered from 0.
    pub rest: Scene,
    /// Numbers of its triangles in the complete scene.
    pub triangles: Range<usize>,
    /// Indices of its cubes among all cubes of the scene.
    pub cubes: Range<usize>,
}

/// A `<dmotion>` element.
#[derive(Clone, Debug)]
pub(super) struct Sequence {
    /// Number of repetitions; 0: endless.
    pub loops: u32,
    pub next: Option<usize>,
    pub moves: Vec<Move>,
}

/// A `<motion>` element.
#[derive(Clone, Copy, Debug)]
pub(super) struct Move {
    pub map: Affine,
    /// True if the motion rotates about the part's centre.
    pub about_self: bool,
}

impl MotionPlan {
    /// The moving parts of `scene`; `None` if there are none. `pulse_rate` is that of the first leg, Hz: time
    /// steps are counted in its periods.
    pub fn new(scene: &Scene, pulse_rate: f64) -> Option<MotionPlan> {
        if scene.moving_parts.is_empty() {
            return None;
        }
        let period = scene.dyn_time_step;
        let parts = scene
            .moving_parts
            .iter()
            .map(|part| {
                let (move_interval, refresh_interval) = intervals(&part.timing, period);
                let rest = extract_part(scene, part);
                PlannedPart {
                    sequences: sequences(&part.motions, scene.shift),
                    move_interval,
                    refresh_interval,
                    centre: rest.geometry.bounds().centre(),
                    rest,
                    triangles: numbers_of(scene, &part.triangles),
                    cubes: indices_of(scene, &part.cubes),
                }
            })
            .collect();
        let update_interval = period.map_or(u64::from(scene.dyn_step), |t| whole_steps(pulse_rate * t));
        Some(MotionPlan { update_interval, parts, triangles: scene.geometry.triangle_count() })
    }

    /// Simulation steps between scene updates; 0: only the first step updates the scene.
    pub fn update_interval(&self) -> u64 {
        self.update_interval
    }
}

/// Warns of a time step of a moving scene, which the file `path` describes, that is not a whole number of
/// pulse periods.
pub fn check_time_step(scene: &Scene, path: &Path, pulse_rate: f64) -> Diagnostics {
    let mut found = Diagnostics::default();
    let Some(time) = scene.dyn_time_step.filter(|_| !scene.moving_parts.is_empty()) else { return found };
    if let Some(message) = rounded_steps(pulse_rate * time, time, 1.0 / pulse_rate) {
        found.warn(
            Some(Place::of_file(path)),
            format!("the scene's `dynTimeStep` of {message}, which are the periods of its pulses"),
        );
    }
    found
}

/// A quotient of times as a number of steps, rounded down. NaN and values below 1 become 0.
fn whole_steps(quotient: f64) -> u64 {
    quotient as u64
}

/// Scene updates between moves and moves between refreshes. Times are used only if the scene has one (spec
/// input-formats §10, trap 44).
fn intervals(timing: &MotionTiming, scene_period: Option<f64>) -> (u64, u64) {
    let Some(scene) = scene_period else {
        return (timing.dyn_step.into(), timing.tree_step.into());
    };
    let part = timing.dyn_time_step.unwrap_or(scene);
    let tree = timing.tree_time_step.unwrap_or(part);
    (whole_steps(part / scene), whole_steps(tree / part))
}

fn sequences(motions: &[MotionSequence], shift: DVec3) -> Vec<Sequence> {
    let moves = |motion: &Motion| Move { map: transform_of(motion, shift), about_self: motion.about_self };
    motions
        .iter()
        .map(|s| Sequence { loops: s.loops, next: s.next, moves: s.motions.iter().map(moves).collect() })
        .collect()
}

/// The transform of a motion in the local frame, whose origin is at `shift` in the world.
fn transform_of(motion: &Motion, shift: DVec3) -> Affine {
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

/// The numbers of some stored triangles of one part, which follow each other.
fn numbers_of(scene: &Scene, stored: &Range<usize>) -> Range<usize> {
    let first = scene.geometry.number_of_triangle(stored.start);
    first..first + stored.len()
}

/// The indices among all cubes of some stored cubes of one part, which follow each other.
fn indices_of(scene: &Scene, stored: &Range<usize>) -> Range<usize> {
    let first = scene.geometry.index_of_stored_cube(stored.start);
    first..first + stored.len()
}

/// Copies a moving part into a separate scene.
fn extract_part(scene: &Scene, moving: &MovingPart) -> Scene {
    let g = &scene.geometry;
    let first = moving.vertices.start as u32;
    let geometry = Geometry {
        vertices: g.vertices[moving.vertices.clone()].to_vec(),
        triangles: g.triangles[moving.triangles.clone()].iter().map(|t| t.map(|v| v - first)).collect(),
        cubes: g.cubes[moving.cubes.clone()].to_vec(),
        ..Geometry::default()
    };
    let count = g.triangles.len();
    let cubes = count + moving.cubes.start..count + moving.cubes.end;
    let numbers = scene.surface_ids.range(moving.triangles.clone()).chain(scene.surface_ids.range(cubes));
    let (mut surfaces, mut materials, mut known) = (Vec::new(), Vec::new(), HashMap::new());
    let surface_ids = numbers
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
        surface_ids,
        surfaces,
        parts: vec![Part::clone(&scene.parts[moving.part as usize])],
        materials,
        voxels: scene.voxels[moving.cubes.clone()].to_vec(),
        ..Scene::default()
    }
}
