//! Pulses through voxels: the worked examples of spec pulse-physics §2.8 and §3.6.

use super::*;
use crate::flight::Pulse;
use vlscan_scene::{LadTable, VoxelKind};

const N: usize = 20_000;

fn one_ray() -> Survey {
    tls_with(|d| d.waveform.quality = 1)
}

/// Share of N pulses along +y that each primitive reflects, and the batch.
fn shares(scene: &Scene, options: PhysicsOptions) -> (Vec<f64>, Batch) {
    let batch = simulate_pulses(scene, &one_ray(), options, 0, &pulses(N as u64));
    let mut counts = vec![0.0; scene.geometry.len() - 1];
    for e in &batch.echoes {
        // Both triangles of the wall count as primitive 0.
        counts[(e.primitive as usize).saturating_sub(1)] += 1.0 / N as f64;
    }
    (counts, batch)
}

fn assert_shares(found: &[f64], expected: &[f64]) {
    for (f, e) in found.iter().zip(expected) {
        assert!((f - e).abs() < 0.012 && ((*e == 0.0) == (*f == 0.0)), "{found:?} is not {expected:?}");
    }
}

fn column(densities: [f64; 6]) -> Scene {
    let cubes: Vec<_> =
        (99..).zip(densities).map(|(y, d)| (f64::from(y), d, VoxelKind::Transmittive)).collect();
    foliage(&cubes, None)
}

#[test]
fn every_second_voxel_of_a_row_is_invisible_unless_corrected() {
    // spec pulse-physics §2.8 (d); the wall comes first
    let through = |k: i32| (-f64::from(k)).exp();
    let stop = 1.0 - through(1);
    let (found, batch) = shares(&column([1.0; 6]), legacy());
    assert_shares(&found, &[through(3), stop, 0.0, stop * through(1), 0.0, stop * through(2), 0.0]);
    assert!(batch.echoes.iter().all(|e| e.range >= 99.0 && e.range <= 120.0));
    let (found, _) = shares(&column([1.0; 6]), with(legacy(), "adjacent_voxels"));
    let beer_lambert: Vec<f64> = (0..6).map(|k| stop * through(k)).collect();
    assert_shares(&found, &[&[through(6)], &beer_lambert[..]].concat());
    let (found, _) = shares(&column([1.0; 6]), with(with(legacy(), "adjacent_voxels"), "spherical_leaves"));
    assert_shares(&found[..1], &[through(3)]);
}

#[test]
fn voxels_without_leaves_shift_the_row() {
    // spec pulse-physics §2.8 (e), with the empty voxel kept
    let (found, _) = shares(&column([f64::NAN, 1.0, 0.0, 1.0, 2.0, 2.0]), legacy());
    assert_shares(&found, &[0.137, 0.0, 0.0, 0.0, 0.0, 0.863, 0.0]);
    // with the empty voxel dropped
    let v = VoxelKind::Transmittive;
    let dropped = [(99.0, f64::NAN, v), (100.0, 1.0, v), (102.0, 1.0, v), (103.0, 2.0, v), (104.0, 2.0, v)];
    let (found, _) = shares(&foliage(&dropped, None), legacy());
    assert_shares(&found, &[0.05, 0.0, 0.0, 0.635, 0.0, 0.315]);
}

#[test]
fn a_voxel_around_the_scanner_is_seen_when_corrected() {
    let cubes: Vec<_> = (-1..5).map(|y| (f64::from(y) + 0.5, 1.0, VoxelKind::Transmittive)).collect();
    let scene = foliage(&cubes, None);
    let (found, _) = shares(&scene, legacy());
    assert_eq!(
        found,
        vec![0.0; 7],
        "the second voxel begins within the minimum range of 1.5 m and ends all rays"
    );
    let mut options = with(with(legacy(), "adjacent_voxels"), "voxel_stop_point");
    options.corrections.clip_dead_zone = true;
    let through = |m: f64| (-m).exp();
    let (found, batch) = shares(&scene, options);
    assert_eq!(found[1..3], [0.0, 0.0], "what stops within the minimum range is lost");
    assert_shares(&found[..1], &[through(5.5)]);
    assert!((batch.echoes.len() as f64 / N as f64 - through(1.5)).abs() < 0.012);
}

#[test]
fn opaque_and_transparent_voxels() {
    let kinds = [VoxelKind::Transparent, VoxelKind::Opaque, VoxelKind::Opaque];
    let cubes: Vec<_> = [97.0, 99.0, 101.0].into_iter().zip(kinds).map(|(y, k)| (y, 3.0, k)).collect();
    let batch = simulate(&foliage(&cubes, None), &one_ray(), legacy());
    assert_echoes(&batch, &[(99.0, 1924.4513)], 1e-7);
    assert_eq!((batch.echoes[0].primitive, batch.echoes[0].incidence_cosine), (1, 1.0));
}

#[test]
fn a_leaf_angle_table_changes_the_law() {
    // spec pulse-physics §3.6: σ = 0.5 at 99 m and at 101 m, in either model
    let spherical = || LadTable::new([(DVec3::Z, std::f64::consts::PI)]);
    for options in [legacy(), PhysicsOptions::helios()] {
        for (y, amplitude) in [(99.0, 221051.9156), (101.0, 204048.6845)] {
            let scene = foliage(&[(y, 1.0, VoxelKind::Opaque)], spherical());
            assert_echoes(&simulate(&scene, &one_ray(), options), &[(y, amplitude)], 3e-9);
        }
    }
    let scene = foliage(&[(99.0, 1.0, VoxelKind::Transmittive); 5], spherical());
    let (found, _) = shares(&scene, legacy());
    assert!((found[1] - (1.0 - (-0.5f64).exp())).abs() < 0.012, "{found:?}");
}

#[test]
fn the_stop_decides_range_and_the_entry_intensity_unless_corrected() {
    // spec pulse-physics §9, trap 22
    let (_, batch) = shares(&column([1.0; 6]), legacy());
    let first: Vec<_> = batch.echoes.iter().filter(|e| e.primitive == 2).collect();
    assert!(first.iter().all(|e| (e.intensity / 1924.4513 - 1.0).abs() < 1e-7));
    let (near, far) =
        (first.iter().filter(|e| e.range < 99.5).count(), first.iter().filter(|e| e.range > 99.5).count());
    assert!(near > far && far > 0);
    let (_, batch) = shares(&column([1.0; 6]), with(legacy(), "voxel_stop_point"));
    assert!(batch.echoes.iter().all(|e| e.primitive < 2 || e.range < 99.01 || e.intensity < 1924.07));
}

#[test]
fn free_paths_depend_on_seed_and_pulse_alone() {
    let scene = column([1.0; 6]);
    let run = |seed| shares(&scene, PhysicsOptions { seed, ..legacy() }).1.echoes;
    assert_eq!(run(3), run(3));
    assert_ne!(run(3), run(4));
    let alone = Pulse { number: 500, ..pulse(Rotation::IDENTITY) };
    let alone = simulate_pulses(&scene, &one_ray(), PhysicsOptions { seed: 3, ..legacy() }, 0, &[alone]);
    assert_eq!(alone.echoes[0], *run(3).iter().find(|e| e.pulse_number == 500).unwrap());
}

#[test]
fn leaves_are_met_at_their_mean_angle_when_corrected() {
    let (_, batch) = shares(&column([1.0; 6]), with(legacy(), "foliage_incidence"));
    for e in &batch.echoes {
        let expected = if e.primitive < 2 { 1.0 } else { 2.0 / 3.0 };
        assert_eq!(e.incidence_cosine, expected, "primitive {}", e.primitive);
    }
    let ratio = |i: usize| {
        let found =
            shares(&column([1.0; 6]), if i == 0 { legacy() } else { with(legacy(), "foliage_incidence") }).1;
        found.echoes.iter().find(|e| e.primitive == 2).map(|e| e.intensity).unwrap()
    };
    assert!((ratio(1) / ratio(0) - 2.0 / 3.0).abs() < 1e-9, "a Lambertian material");
    let opaque = foliage(&[(99.0, 1.0, VoxelKind::Opaque)], None);
    let batch = simulate(&opaque, &one_ray(), with(legacy(), "foliage_incidence"));
    assert_eq!(batch.echoes[0].incidence_cosine, 1.0, "what is solid keeps its faces");
}
