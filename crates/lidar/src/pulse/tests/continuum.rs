//! Beams of several subrays in foliage as a medium, in the refined physics.

use super::*;
use crate::pulse::Echo;
use vlscan_scene::{LadTable, VoxelKind};

/// A column of foliage of that many voxels from 99 m on, before a wall at 120 m.
fn column(voxels: u32, density: f64, lad: Option<LadTable>) -> Scene {
    let cubes: Vec<_> = (0..voxels.max(5))
        .map(|i| (f64::from(99 + i), if i < voxels { density } else { 0.0 }, VoxelKind::Transmittive))
        .collect();
    foliage(&cubes, lad)
}

fn echoes(scene: &Scene, quality: u32, options: PhysicsOptions, count: u64) -> Vec<Vec<Echo>> {
    let survey = tls_with(|d| (d.waveform.quality, d.detector.threshold) = (quality, 1e-30));
    let mut by_pulse = vec![Vec::new(); count as usize];
    for echo in simulate_pulses(scene, &survey, options, 0, &pulses(count)).echoes {
        by_pulse[echo.pulse_number as usize - 1].push(echo);
    }
    by_pulse
}

#[test]
fn a_homogeneous_slab_is_one_echo_and_the_wall_behind_another() {
    let without = Corrections { foliage_continuum: false, ..Corrections::REFINED };
    let without = PhysicsOptions { corrections: without, ..PhysicsOptions::refined() };
    let mut most_without = 0;
    for (voxels, density) in [(1, 0.2), (5, 0.1), (5, 2.0), (16, 0.1), (16, 0.4), (16, 5.0)] {
        let scene = column(voxels, density, None);
        for quality in [2, 3, 6] {
            for of_pulse in echoes(&scene, quality, PhysicsOptions::refined(), 40) {
                let leaves = of_pulse.iter().filter(|e| e.range < 118.0).count();
                assert!(
                    leaves <= 1 && of_pulse.len() - leaves <= 1,
                    "{voxels} of {density}, quality {quality}"
                );
            }
        }
        let each = echoes(&scene, 6, without, 40);
        most_without = most_without.max(each.iter().map(Vec::len).max().unwrap_or(0));
    }
    assert!(most_without > 4, "subrays are echoes without it: {most_without}");
}

/// The mean amplitude of the wall is exp(−T) of its amplitude without foliage, T = 0.5 · 0.4/m · 5 m, within
/// four standard errors.
#[test]
fn the_wall_keeps_what_foliage_lets_through_on_average() {
    let amplitude = |density| {
        let all = echoes(&column(5, density, None), 2, PhysicsOptions::refined(), 3000);
        let of_wall = |e: &Vec<Echo>| e.iter().filter(|e| e.range > 118.0).map(|e| e.intensity).sum::<f64>();
        all.iter().map(of_wall).collect::<Vec<f64>>()
    };
    let (clear, dim) = (amplitude(0.0)[0], amplitude(0.4));
    let n = dim.len() as f64;
    let mean = dim.iter().sum::<f64>() / n / clear;
    let variance = dim.iter().map(|a| (a / clear - mean).powi(2)).sum::<f64>() / n;
    let off = (mean - libm::exp(-1.0)) / (variance / n).sqrt();
    assert!(off.abs() < 4.0, "{mean}");
    assert!(variance > 0.01, "interception is random");
}

/// Foliage of 1 m² per m³, 4 m deep, of elements of that size before the wall; its optical depth is 2.
fn of_elements(size: f64) -> Vec<Vec<Echo>> {
    let mut scene = column(4, 1.0, None);
    scene.materials.iter_mut().for_each(|m| m.element_size = size);
    echoes(&scene, 6, PhysicsOptions::refined(), 1500)
}

/// The mean light of the wall is that of the law of Beer and Lambert whatever the size of the elements; its
/// variance, and the share of pulses with a single return, grow with the size.
#[test]
fn larger_elements_keep_the_mean_and_leave_fewer_returns() {
    let clear = echoes(&column(0, 0.0, None), 6, PhysicsOptions::refined(), 1)[0][0].intensity;
    let mut last = (0.0, -1.0);
    for size in [0.002, 0.02, 10.0] {
        let all = of_elements(size);
        let n = all.len() as f64;
        let wall: Vec<f64> = all
            .iter()
            .map(|e| e.iter().filter(|e| e.range > 118.0).map(|e| e.intensity).sum::<f64>() / clear)
            .collect();
        let mean = wall.iter().sum::<f64>() / n;
        let variance = wall.iter().map(|w| (w - mean).powi(2)).sum::<f64>() / n;
        let off = (mean - libm::exp(-2.0)) / (variance / n).sqrt();
        assert!(off.abs() < 4.0, "{size} m: {mean}");
        let single = all.iter().filter(|e| e.len() == 1).count() as f64 / n;
        assert!(variance > last.0 && single > last.1, "{size} m: {variance} {single} after {last:?}");
        last = (variance, single);
    }
    // All or nothing: p(1 − p), but for the borders of the columns.
    let p = libm::exp(-2.0);
    assert!((last.0 / (p * (1.0 - p)) - 1.0).abs() < 0.1 && last.1 > 0.98, "{last:?}");
}

/// Depths of single returns of large elements are exponential: half of those of the foliage lie above the
/// median of the exponential distribution cut at the depth 2.
#[test]
fn large_elements_are_met_by_the_law_of_beer_and_lambert() {
    let ranges = of_elements(10.0).into_iter().filter(|e| e.len() == 1 && e[0].range < 118.0);
    let ranges: Vec<f64> = ranges.map(|e| e[0].range).collect();
    let median = 99.0 - 2.0 * libm::log(0.5 * (1.0 + libm::exp(-2.0)));
    let below = ranges.iter().filter(|r| **r < median).count() as f64 / ranges.len() as f64;
    assert!((below - 0.5).abs() < 4.0 * 0.5 / (ranges.len() as f64).sqrt(), "{below} of {}", ranges.len());
}

/// The share of the subrays that reach the wall is that of the light that the wall returns, pulse by pulse:
/// subrays and truths are of the draw that the points are of.
#[test]
fn subrays_and_truths_show_the_foliage_of_the_points() {
    let clear = echoes(&column(0, 0.0, None), 6, PhysicsOptions::refined(), 1)[0][0].intensity;
    for size in [0.0, 0.02, 0.3, 10.0] {
        let mut scene = column(4, 1.0, None);
        scene.materials.iter_mut().for_each(|m| m.element_size = size);
        let with_subrays = PhysicsOptions { record_subrays: true, ..PhysicsOptions::refined() };
        let points = echoes(&scene, 6, PhysicsOptions::refined(), 60);
        let subrays = echoes(&scene, 6, with_subrays, 60);
        let mut through = 0;
        for (points, subrays) in points.iter().zip(&subrays) {
            let is_wall = |e: &&Echo| e.range > 118.0;
            let light: f64 = points.iter().filter(is_wall).map(|e| e.intensity).sum::<f64>() / clear;
            // Every subray hits either foliage or the wall.
            assert_eq!(subrays.len(), 96, "{size}");
            let share = subrays.iter().filter(is_wall).count() as f64 / 96.0;
            assert!((light - share).abs() < 1e-3, "{size} m: {light} of the light, {share} of the subrays");
            through += usize::from(share > 0.0);
            assert!(subrays.iter().all(|e| e.number_of_returns as usize == points.len()), "{size}");
            assert!(subrays.iter().filter(|e| !is_wall(e)).all(|e| (99.0..=103.1).contains(&e.range)));
        }
        assert!(through > 0, "{size}");
        let survey = tls_with(|d| (d.waveform.quality, d.detector.threshold) = (6, 1e-30));
        let options = PhysicsOptions { record_truth: true, ..PhysicsOptions::refined() };
        let batch = simulate_pulses(&scene, &survey, options, 0, &pulses(60));
        for of_pulse in batch.echoes.chunk_by(|a, b| a.pulse_number == b.pulse_number) {
            let sum: f64 = of_pulse.iter().map(|e| e.truth(&batch.truths).fraction).sum();
            assert!(sum < 1.0 + 1e-9, "{size} m: {sum} of the footprint");
        }
        // What is recorded changes no return.
        let recorded: Vec<_> = batch.echoes.iter().map(|e| (e.position, e.intensity)).collect();
        let plain: Vec<_> = points.iter().flatten().map(|e| (e.position, e.intensity)).collect();
        assert_eq!(recorded, plain, "{size}");
    }
}

#[test]
fn a_beam_of_one_ray_stops_at_points() {
    let all = echoes(&column(16, 0.3, None), 1, PhysicsOptions::refined(), 400);
    assert!(all.iter().all(|e| e.len() == 1));
    let mut ranges: Vec<f64> = all.iter().map(|e| e[0].range).collect();
    ranges.sort_by(f64::total_cmp);
    ranges.dedup();
    assert!(ranges.len() > 300, "{} different ranges", ranges.len());
}

#[test]
fn a_leaf_angle_table_of_the_same_leaves_changes_nothing() {
    let spherical = || LadTable::new([(DVec3::Z, std::f64::consts::PI)]);
    for quality in [1, 3] {
        let (with, without) = (column(5, 1.0, spherical()), column(5, 1.0, None));
        let options = PhysicsOptions::refined();
        let all = echoes(&with, quality, options, 30).into_iter().zip(echoes(&without, quality, options, 30));
        for (with, without) in all {
            assert_eq!(with.len(), without.len());
            for (a, b) in with.iter().zip(&without) {
                assert!((a.range - b.range).abs() < 1e-9 && (a.intensity / b.intensity - 1.0).abs() < 1e-6);
                assert!((a.incidence_cosine - b.incidence_cosine).abs() < 1e-6);
            }
        }
    }
}

/// Horizontal leaves have no projection along a ray at 90° from the zenith; a ray 60° off the zenith hits
/// them at cos θ = 1/2.
#[test]
fn leaves_of_a_table_are_met_at_their_own_angle() {
    let level = || {
        LadTable::new((0..=180).map(|i| {
            let z = f64::from(i).to_radians();
            (DVec3::new(z.sin(), 0.0, z.cos()), std::f64::consts::TAU * z.cos().abs())
        }))
    };
    let scene = column(5, 1.0, level());
    assert!(
        echoes(&scene, 3, PhysicsOptions::refined(), 20).iter().all(|e| e.len() == 1 && e[0].range > 118.0)
    );
    let table = level().unwrap();
    let down = DVec3::new(0.0, 0.75f64.sqrt(), -0.5);
    assert!((table.mean_cosine(down) - 0.5).abs() < 1e-3, "{}", table.mean_cosine(down));
}
