//! Instruments, scenes and pulses for the tests of this module.

use super::detector_settings::DetectorSettings;
use super::instrument::{Instrument, InstrumentTable};
use super::return_profile::ReturnProfile;
use super::waveform::Waveform;
use super::{Echo, Physics, PhysicsOptions, PulseSimulator};
use crate::flight::Pulse;
use crate::pulse::Batch;
use std::sync::Arc;
use vlscan_geom::{Aabb, DVec3, Rotation};
use vlscan_scene::{LadTable, Material, Part, Reflection, Scene, Surface, Voxel, VoxelKind};
use vlscan_survey::Survey;
pub use vlscan_survey::testkit::*;
use vlscan_trace::{BuildOptions, Builder, Cube, Geometry, Tree};

/// The instrument of [`tls_device`] in the reference's physics.
pub fn tls_instrument(pulse_length: f64) -> Instrument {
    let table =
        InstrumentTable::new(&survey(vec![tls_device(pulse_length)]), &PhysicsOptions::helios()).unwrap();
    table.instrument(0, 0).unwrap().clone()
}

pub fn tls_detector(pulse_length: f64) -> DetectorSettings {
    tls_instrument(pulse_length).detector
}

/// The waveform that an instrument receives from (range, intensity) pairs.
pub fn received(returns: &[(f64, f64)], detector: &DetectorSettings) -> Waveform {
    let mut waveform = Waveform::default();
    assert!(waveform.receive(&ReturnProfile::of(returns), detector), "the dead zone swallowed the pulse");
    waveform
}

pub fn half_white() -> Material {
    Material {
        reflectance: 0.5,
        further_reflectances: Vec::new(),
        reflection: Reflection::Lambert,
        ..Material::unnamed("half white", Default::default())
    }
}

/// A scene of rectangles, one part each, all of one material: corner and two edges. Shifted like every scene.
pub fn rectangles(material: Material, of: &[[DVec3; 3]]) -> Scene {
    let mut geometry = Geometry::default();
    let mut scene = Scene::default();
    for (part, [corner, e1, e2]) in (0..).zip(of) {
        let first = geometry.vertices.len() as u32;
        geometry.vertices.extend([*corner, *corner + *e1, *corner + *e1 + *e2, *corner + *e2]);
        geometry.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        scene.surfaces.push(Surface { part, material: 0 });
        scene.surface_ids.extend([part, part]);
        scene.parts.push(Part { id: (part + 1).to_string(), ..Part::default() });
    }
    scene.materials.push(material);
    scene.bounds = Aabb::EMPTY;
    if !of.is_empty() {
        scene.shift = geometry.bounds().centre();
        geometry.vertices.iter_mut().for_each(|v| *v -= scene.shift);
        scene.bounds = geometry.bounds();
    }
    scene.geometry = geometry;
    scene
}

/// A scene of a column of cubes of 1 m along +y, as (start, density, kind), and of a wall at 120 m if there
/// are more than four. All cubes are one part, with that leaf angle table.
pub fn foliage(cubes: &[(f64, f64, VoxelKind)], lad: Option<LadTable>) -> Scene {
    let walls = [wall(-20.0, 20.0, 120.0)];
    let mut scene = rectangles(half_white(), if cubes.len() > 4 { &walls } else { &[] });
    let first = -scene.shift;
    scene.surfaces.push(Surface { part: scene.parts.len() as u32, material: 0 });
    scene.parts.push(Part { id: "foliage".to_owned(), lad: lad.map(Arc::new), ..Part::default() });
    for (y, density, kind) in cubes {
        scene.geometry.cubes.push(Cube { centre: first + DVec3::new(0.0, y + 0.5, 0.0), half: 0.5 });
        scene.voxels.push(Voxel::of_plants(*density, *kind));
        scene.surface_ids.push(scene.surfaces.len() as u32 - 1);
    }
    scene.bounds = scene.geometry.bounds();
    scene
}

/// A wall that faces −y: from x0 to x1 at distance y, 40 m high.
pub fn wall(x0: f64, x1: f64, y: f64) -> [DVec3; 3] {
    [DVec3::new(x0, y, -20.0), DVec3::new(x1 - x0, 0.0, 0.0), DVec3::new(0.0, 0.0, 40.0)]
}

/// A pulse from the world's origin with that attitude.
pub fn pulse(attitude: Rotation) -> Pulse {
    Pulse {
        origin: DVec3::ZERO,
        attitude,
        exact_attitude: attitude,
        reported_attitude: attitude,
        scanner_attitude: Rotation::IDENTITY,
        origin_error: DVec3::ZERO,
        time_ns: 0.0,
        number: 1,
        device: 0,
        scan_angle: 0.0,
        range_error: 0.0,
        velocity: None,
    }
}

pub fn tree(scene: &Scene) -> Tree {
    Tree::build(&scene.geometry, &BuildOptions::of(Builder::Median))
}

/// The records of one pulse along +y.
pub fn simulate(scene: &Scene, survey: &Survey, options: PhysicsOptions) -> Batch {
    simulate_pulses(scene, survey, options, 0, &pulses(1))
}

/// The records of pulses from the world's frame in `leg`.
pub fn simulate_pulses(
    scene: &Scene,
    survey: &Survey,
    options: PhysicsOptions,
    leg: u32,
    pulses: &[Pulse],
) -> Batch {
    let tree = tree(scene);
    let physics = Physics::new(scene, &tree, survey, options).unwrap();
    let pulses: Vec<Pulse> = pulses.iter().map(|p| in_frame(scene, p)).collect();
    let mut batch = Batch::default();
    PulseSimulator::new(&physics).simulate(leg, &pulses, &mut batch).unwrap();
    batch
}

pub fn pulses(count: u64) -> Vec<Pulse> {
    (1..=count).map(|number| Pulse { number, ..pulse(Rotation::IDENTITY) }).collect()
}

pub fn measured(echoes: &[Echo]) -> Vec<(f64, f64)> {
    echoes.iter().map(|e| (e.range, e.intensity)).collect()
}

/// A pulse of the world in the scene's frame.
pub fn in_frame(scene: &Scene, pulse: &Pulse) -> Pulse {
    Pulse { origin: pulse.origin - scene.shift, ..*pulse }
}
