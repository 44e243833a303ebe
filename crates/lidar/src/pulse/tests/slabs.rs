//! Slabs of foliage in the refined physics: the transmission is exp(−σL), however the voxels lie.
//!
//! Of n pulses with transmission probabilities pᵢ, Σpᵢ get through with a variance of Σpᵢ(1−pᵢ); counts may
//! differ by four standard deviations. The draws are fixed by the seed, so the tests always give the same
//! result.

use super::*;
use crate::flight::Pulse;
use crate::pulse::foliage::FreePaths;
use crate::pulse::view::{Interaction, SceneView};
use crate::pulse::{Physics, PulseSimulator};
use proptest::prelude::*;
use rayon::prelude::*;
use std::sync::Arc;
use vlscan_base::rng::{Purpose, Stream};
use vlscan_geom::unit;
use vlscan_scene::{LadTable, Part, Surface, Voxel, VoxelKind};
use vlscan_trace::Cube;

/// Pulses of a comparison.
fn number() -> u64 {
    u64::from(vlscan_base::machine::cases(1_000_000))
}

/// Front of a slab, m along +y, and its voxels' edge.
const FRONT: f64 = 20.0;
const EDGE: f64 = 0.5;

/// A slab of voxels of that density across +y: `layers` voxels deep, 12 m by 12 m wide, in random order in
/// the file, before a wall.
fn slab(layers: usize, density: f64, lad: Option<LadTable>) -> Scene {
    const ACROSS: usize = 24;
    // A material that reflects at any angle.
    let mut scene = rectangles(Material::unnamed("leaves", Default::default()), &[wall(-20.0, 20.0, 60.0)]);
    scene.surfaces.push(Surface { part: 1, material: 0 });
    scene.parts.push(Part { id: "foliage".to_owned(), lad: lad.map(Arc::new), ..Part::default() });
    let count = ACROSS * ACROSS * layers;
    for i in 0..count {
        let i = (i * 7919) % count;
        let (x, z, y) = (i % ACROSS, i / ACROSS % ACROSS, i / (ACROSS * ACROSS));
        let aside = |i: usize| (i as f64 - 0.5 * ACROSS as f64 + 0.5) * EDGE;
        let centre = DVec3::new(aside(x), FRONT + (y as f64 + 0.5) * EDGE, aside(z));
        scene.geometry.cubes.push(Cube { centre: centre - scene.shift, half: 0.5 * EDGE });
        scene.voxels.push(Voxel::of_plants(density, VoxelKind::Transmittive));
        scene.surface_ids.push(scene.surfaces.len() as u32 - 1);
    }
    scene.bounds = scene.geometry.bounds();
    scene
}

/// Pulse number `n` from somewhere within `spread` m of `from`, up to `tilt` rad off +y.
fn aimed(n: u64, from: DVec3, spread: f64, tilt: f64) -> Pulse {
    let stream = Stream::new(99, Purpose::Range);
    let u = |k: u32| 2.0 * stream.uniform(7, n, k) - 1.0;
    let attitude = Rotation::about_z(tilt * u(0)).after(Rotation::about_x(tilt * u(1)));
    let origin = from + DVec3::new(u(2), u(3), u(4)) * spread;
    Pulse { number: n, origin, ..pulse(attitude) }
}

/// Compares how many of [`number`] pulses reach the wall with the sum of their transmission probabilities.
fn assert_beer_lambert(
    scene: &Scene,
    options: PhysicsOptions,
    aim: impl Fn(u64) -> Pulse + Sync,
    depth: impl Fn(&Pulse) -> f64 + Sync,
    sigma: impl Fn(DVec3) -> f64 + Sync,
) {
    let tree = tree(scene);
    let survey = tls_with(|d| {
        d.waveform.quality = 1;
        // The reference receives nothing with a minimum range of 0.
        d.detector.range_min = if options.corrections.waist_at_exit { 0.0 } else { 1.5 };
    });
    let physics = Physics::new(scene, &tree, &survey, options).unwrap();
    const CHUNK: u64 = 5000;
    let number = number();
    let (through, lost, expected, variance) = (0..number / CHUNK)
        .into_par_iter()
        .map(|chunk| {
            let world: Vec<Pulse> = (0..CHUNK).map(|i| aim(chunk * CHUNK + i)).collect();
            let local: Vec<Pulse> = world.iter().map(|p| in_frame(scene, p)).collect();
            let mut batch = Batch::default();
            PulseSimulator::new(&physics).simulate(0, &local, &mut batch).unwrap();
            let through = batch.echoes.iter().filter(|e| e.primitive < 2).count() as f64;
            let chances = world.iter().map(|p| {
                let d = p.attitude.forward();
                libm::exp(-sigma(d) * depth(p) / d.y)
            });
            let (sum, squares) = chances.fold((0.0, 0.0), |(s, q), p| (s + p, q + p * (1.0 - p)));
            (through, CHUNK as f64 - batch.echoes.len() as f64, sum, squares)
        })
        .reduce(|| (0.0, 0.0, 0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1, a.2 + b.2, a.3 + b.3));
    assert_eq!(lost, 0.0, "every pulse ends in the foliage or at the wall");
    let off = (through - expected) / variance.sqrt();
    assert!(off.abs() < 4.0, "{through} of {expected:.1} ± {:.1} get through", variance.sqrt());
    // The test can fail: there is something to count on either side.
    assert!(expected > 0.01 * number as f64 && expected < 0.99 * number as f64, "{expected}");
}

/// The refined physics with G = 1, so that σ is the density.
fn refined() -> PhysicsOptions {
    let mut o = PhysicsOptions::refined();
    o.corrections.spherical_leaves = false;
    o
}

fn whole_depth(layers: usize) -> impl Fn(&Pulse) -> f64 {
    move |_| layers as f64 * EDGE
}

#[test]
fn one_voxel() {
    let (scene, ahead) = (slab(1, 1.4, None), |n| aimed(n, DVec3::ZERO, 0.0, 0.0));
    for options in [refined(), PhysicsOptions::helios()] {
        assert_beer_lambert(&scene, options, ahead, whole_depth(1), |_| 1.4);
    }
}

#[test]
fn many_voxels_in_a_row() {
    let scene = slab(16, 0.2, None);
    // Through the middles of voxels, and along the edge that four rows share.
    for aside in [0.2, 0.0] {
        let ahead = |n| aimed(n, DVec3::new(aside, 0.0, aside), 0.0, 0.0);
        assert_beer_lambert(&scene, refined(), ahead, whole_depth(16), |_| 0.2);
    }
}

#[test]
fn oblique_rays_through_edges_and_corners_of_many_voxels() {
    let scene = slab(8, 0.4, None);
    // From 15 m before the slab, up to 15° off on two axes: within the slab's faces.
    let from = DVec3::new(0.0, FRONT - 15.0, 0.0);
    assert_beer_lambert(&scene, refined(), |n| aimed(n, from, 0.5, 0.26), whole_depth(8), |_| 0.4);
}

#[test]
fn rays_that_begin_inside() {
    let scene = slab(8, 0.6, None);
    let middle = DVec3::new(0.0, FRONT + 2.0, 0.0);
    let left = |p: &Pulse| FRONT + 4.0 - p.origin.y;
    assert_beer_lambert(&scene, refined(), |n| aimed(n, middle, 1.3, 0.35), left, |_| 0.6);
}

#[test]
fn leaf_angle_tables_by_direction() {
    let table = LadTable::new([(DVec3::Z, 2.0), (DVec3::X, 4.0), (-DVec3::Z, 2.0)]).unwrap();
    let scene = slab(8, 0.7, Some(table.clone()));
    let sigma = move |d: DVec3| 0.7 * table.g(d) / std::f64::consts::TAU;
    assert_beer_lambert(&scene, refined(), |n| aimed(n, DVec3::ZERO, 0.5, 0.2), whole_depth(8), sigma);
}

#[test]
fn overlapping_voxels_add_up() {
    let mut scene = slab(4, 0.3, None);
    // Repeats the comparison, shifted by half a voxel within the slab.
    for i in 0..scene.geometry.cubes.len() {
        let cube = scene.geometry.cubes[i];
        let y = (scene.to_world(cube.centre).y - FRONT) / EDGE;
        if y < 3.0 {
            scene.geometry.cubes.push(Cube { centre: cube.centre + DVec3::Y * (0.5 * EDGE), ..cube });
            scene.voxels.push(scene.voxels[i]);
            scene.surface_ids.push(1);
        }
    }
    let both = |_: &Pulse| 4.0 * EDGE + 3.0 * EDGE;
    assert_beer_lambert(&scene, refined(), |n| aimed(n, DVec3::ZERO, 0.5, 0.2), both, |_| 0.3);
}

fn view<'a>(scene: &'a Scene, tree: &'a vlscan_trace::Tree) -> SceneView<'a> {
    SceneView {
        scene,
        tree,
        moving: &[],
        tiles: None,
        visible_bounds: None,
        fixed_incidence: false,
        max_cube_size: EDGE,
        wavelength: 0,
        has_optics: false,
        has_colours: false,
    }
}

/// Follows a ray through foliage too thin to scatter it; returns the number of voxels for which it drew a
/// free path.
fn voxels_drawn(view: &SceneView, origin: DVec3, direction: DVec3) -> u32 {
    let mut instrument = tls_instrument(5.0);
    instrument.detector.corrections = Corrections::REFINED;
    let mut paths = FreePaths { stream: Stream::new(3, Purpose::FreePath), device: 0, pulse: 1, drawn: 0 };
    let first = view.nearest(origin, direction, origin, |_| true);
    let around = crate::pulse::foliage::voxels_around(view.scene, view.tree, origin, EDGE);
    let end: Option<Interaction> =
        view.walk_medium(&instrument.detector, (origin, direction), first, &around, &mut paths);
    assert!(end.is_none_or(|e| e.primitive < 2), "{end:?}");
    paths.drawn
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// A ray draws for exactly those voxels through which it runs for more than rounding.
    #[test]
    fn no_voxel_is_skipped_or_met_twice(
        from in [-3.0..3.0f64, 16.0..23.9f64, -3.0..3.0f64],
        to in prop_oneof![
            [-5.0..5.0f64, 24.1..30.0f64, -5.0..5.0f64].prop_map(DVec3::from),
            // Aimed at corners and edges.
            [-8..=8i32, 40..=48i32, -8..=8i32].prop_map(|c| DVec3::from(c.map(|x| f64::from(x) * EDGE))),
        ],
        snap in any::<bool>(),
    ) {
        thread_local! {
            static SLAB: (Scene, vlscan_trace::Tree) = {
                let scene = slab(8, 1e-12, None);
                let tree = tree(&scene);
                (scene, tree)
            };
        }
        let origin = DVec3::from(from.map(|x| if snap { (x / EDGE).round() * EDGE } else { x }));
        let direction = unit(to - origin);
        prop_assume!(direction.is_finite() && direction.y > 0.05);
        SLAB.with(|(scene, tree)| {
            let origin = scene.to_local(origin);
            let drawn = voxels_drawn(&view(scene, tree), origin, direction);
            // Chord and middle of it in each cube, grown by `by`.
            let crossed = |c: &Cube, by: f64| {
                let half = DVec3::splat(c.half + by);
                let b = Aabb { min: c.centre - half, max: c.centre + half };
                let (enter, exit) = b.slabs(origin, direction)?;
                let enter = enter.max(0.0);
                Some((exit - enter, (origin + direction * (0.5 * (enter + exit)) - c.centre) / c.half))
            };
            let is_owned = |m: DVec3| m.cmpge(DVec3::NEG_ONE).all() && m.cmplt(DVec3::ONE).all();
            let surely = scene.geometry.cubes.iter().filter_map(|c| crossed(c, 0.0));
            let surely = surely.filter(|(l, m)| *l > 1e-9 && is_owned(*m)).count() as u32;
            let perhaps = scene.geometry.cubes.iter().filter_map(|c| crossed(c, 1e-9));
            let perhaps = perhaps.filter(|(l, m)| *l > 0.0 && is_owned(*m * (1.0 - 1e-8))).count() as u32;
            prop_assert!((surely..=perhaps).contains(&drawn), "{drawn} of {surely} to {perhaps}");
            Ok(())
        })?;
    }
}

#[test]
fn a_trunk_within_a_voxel_is_seen_through_its_leaves() {
    let mut scene = rectangles(half_white(), &[wall(-20.0, 20.0, 20.3), wall(-20.0, 20.0, 60.0)]);
    scene.surfaces.push(Surface { part: 1, material: 0 });
    scene.geometry.cubes.push(Cube { centre: DVec3::Y * 20.25 - scene.shift, half: 0.25 });
    scene.voxels.push(Voxel::of_plants(2.0, VoxelKind::Transmittive));
    scene.surface_ids.push(1);
    let survey = tls_with(|d| d.waveform.quality = 1);
    let batch = simulate_pulses(&scene, &survey, refined(), 0, &pulses(20_000));
    let trunk = batch.echoes.iter().filter(|e| e.primitive < 2).count() as f64 / 20_000.0;
    assert!((trunk - libm::exp(-0.6)).abs() < 0.014, "{trunk}");
    assert!(batch.echoes.iter().all(|e| e.range < 20.31), "nothing is seen behind the trunk");
}
