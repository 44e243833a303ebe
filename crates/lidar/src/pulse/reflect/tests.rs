//! Tests of reflections.

use super::*;
use crate::pulse::ray_batch::RayBatch;
use crate::pulse::subray::Subrays;
use crate::pulse::testkit::{foliage, half_white, rectangles, tls_instrument, tree, wall};
use crate::pulse::traced::GainBuffer;
use vlscan_base::rng::{Purpose, Stream};
use vlscan_geom::Rotation;
use vlscan_scene::{Reflection, VoxelKind};
use vlscan_trace::{RayGroup, TraceScratch};

#[test]
fn the_nearest_face_of_a_cube_gives_its_normal() {
    for n in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
        assert_eq!(face_of_cube(n * 0.5 + DVec3::splat(0.1), 0.5), n);
    }
    assert_eq!(face_of_cube(DVec3::new(0.5, 0.5, 0.5), 0.5), DVec3::X, "the first of equals");
}

/// Calls `check` with a traced pulse from the world's origin whose axis is turned off +y.
fn trace_pulse<R>(
    scene: &Scene,
    instrument: &Instrument,
    turn: &Rotation,
    check: impl FnOnce(&SceneView, (TracedPulse, SubrayGains), &mut FreePaths) -> R,
) -> R {
    let tree = tree(scene);
    let view = SceneView {
        scene,
        tree: &tree,
        moving: &[],
        tiles: None,
        visible_bounds: None,
        fixed_incidence: false,
        max_cube_size: 1.0,
        wavelength: 0,
        has_optics: false,
        has_colours: false,
    };
    let mut batch = RayBatch::default();
    batch.rays = RayGroup::new(instrument.subrays.len());
    instrument.subrays.expand(0, turn, batch.rays.push_registers(-scene.shift));
    batch.trace(&tree, &scene.geometry, &mut TraceScratch::default());
    let (traced, mut gain_buffer) = (TracedPulse::of(&batch, 0), GainBuffer::default());
    gain_buffer.push(instrument, &traced);
    let mut paths = FreePaths { stream: Stream::new(0, Purpose::FreePath), device: 0, pulse: 1, drawn: 0 };
    check(&view, (traced, gain_buffer.of(0, &traced)), &mut paths)
}

fn empty(instrument: &Instrument) -> Reflections {
    let mut out = Reflections::default();
    out.clear(instrument.subrays.len());
    out
}

fn assert_same(one: &Reflections, other: &Reflections) {
    assert_eq!(one.primitives(), other.primitives());
    assert_eq!(one.ranges(), other.ranges());
    assert_eq!(one.entries(), other.entries());
    assert_eq!(one.cosines(), other.cosines());
    assert_eq!(one.intensities(), other.intensities());
}

#[test]
fn triangles_reflect_alike_in_blocks_and_one_by_one() {
    // Boards with gaps between them, the farthest of them out of range.
    let boards: Vec<_> =
        (0..12).map(|i| wall(f64::from(i) - 6.3, f64::from(i) - 5.7, f64::from(9 + i))).collect();
    let shiny = |i: u32| match i % 5 {
        0 => Reflection::Uniform,
        1 => Reflection::Lambert,
        2 => Reflection::Phong { specularity: 0.3, exponent: 7.0 },
        3 => Reflection::Lobes { specularity: 0.0, exponent: 7.0, roughness: 0.0 },
        _ => Reflection::Lobes { specularity: 0.4, exponent: 7.0, roughness: 0.3 },
    };
    let (mut some, mut none) = (0, 0);
    for round in 0..60u32 {
        let scene = rectangles(Material { reflection: shiny(round), ..half_white() }, &boards);
        let mut instrument = tls_instrument(5.0);
        (instrument.detector.range_min, instrument.detector.range_max) = (9.5, 18.5);
        instrument.subrays = Subrays::new(0.02 * f64::from(round % 9), 3);
        let turn = Rotation::about_z(f64::from(round) * 0.02 - 0.6);
        trace_pulse(&scene, &instrument, &turn, |view, pulse, paths| {
            let view = SceneView { fixed_incidence: round % 7 == 0, ..*view };
            let (mut shaded, mut each) = (empty(&instrument), empty(&instrument));
            let mut scratch = ReflectScratch::default();
            assert!(view.shade_triangles(&instrument, pulse, &mut scratch.triangles, &mut shaded));
            view.reflect_each(&instrument, pulse, &[], paths, &mut scratch, &mut each);
            assert_same(&shaded, &each);
            some += shaded.primitives().len();
            none += instrument.subrays.len() - shaded.primitives().len();
        });
    }
    assert!(some > 200 && none > 200, "{some} {none}");
}

/// The first eight subrays miss the cubes and hit the wall, some of the others do not.
#[test]
fn triangles_shaded_before_a_voxel_is_hit_count_once() {
    let cubes: Vec<_> = (0..5).map(|i| (f64::from(100 + i), 0.0, VoxelKind::Opaque)).collect();
    let scene = foliage(&cubes, None);
    let mut instrument = tls_instrument(5.0);
    instrument.subrays = Subrays::new(0.01, 3);
    trace_pulse(&scene, &instrument, &Rotation::about_z(-0.01), |view, pulse, paths| {
        let (mut shaded, mut each, mut out) = (empty(&instrument), empty(&instrument), empty(&instrument));
        let mut scratch = ReflectScratch::default();
        assert!(!view.shade_triangles(&instrument, pulse, &mut scratch.triangles, &mut shaded));
        assert_eq!(shaded.count(), 8);
        view.reflect_each(&instrument, pulse, &[], paths, &mut scratch, &mut each);
        view.reflect(&instrument, pulse, paths, &mut scratch, &mut out);
        assert_eq!(out.count(), instrument.subrays.len());
        assert_same(&out, &each);
    });
}

#[test]
fn opaque_cubes_reflect_like_their_nearest_face() {
    let scene = foliage(&[(10.0, 0.0, VoxelKind::Opaque)], None);
    let mut instrument = tls_instrument(5.0);
    instrument.subrays = Subrays::new(0.0, 1);
    let turn = Rotation::about_x(0.01);
    let mut out = Reflections::default();
    trace_pulse(&scene, &instrument, &turn, |view, pulse, paths| {
        view.reflect(&instrument, pulse, paths, &mut ReflectScratch::default(), &mut out);
    });
    let d = turn.forward();
    assert_eq!(out.primitives(), [0]);
    assert!((out.ranges()[0] - 10.0 / d.y).abs() < 1e-12);
    assert!((out.cosines()[0] - d.y).abs() < 1e-15);
}
