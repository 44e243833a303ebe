//! The refined beam compared with closed forms: one small scene for each law.

use super::*;
use crate::flight::Pulse;

/// An instrument without haze, losses or threshold: 4 W, 0.15 m, 4 ns, quality `quality`.
fn lab(divergence: f64, quality: u32) -> Survey {
    let mut device = tls_device(4.0);
    (device.beam.divergence, device.beam.visibility, device.beam.efficiency) = (divergence, 1e30, 1.0);
    (device.detector.threshold, device.detector.threshold_given) = (1e-300, true);
    (device.detector.range_min, device.waveform.quality) = (1.0, quality);
    let mut survey = survey(vec![device]);
    survey.legs[0].scanner.pulse_freq = 100_000;
    survey
}

/// The sum of the intensities of each of `count` pulses along +y from points `at`.
fn sums(scene: &Scene, survey: &Survey, at: impl Fn(u64) -> DVec3, count: u64) -> Vec<f64> {
    let aimed: Vec<Pulse> = pulses(count).into_iter().map(|p| Pulse { origin: at(p.number), ..p }).collect();
    let batch = simulate_pulses(scene, survey, PhysicsOptions::refined(), 0, &aimed);
    let mut sums = vec![0.0; count as usize];
    batch.echoes.iter().for_each(|e| sums[e.pulse_number as usize - 1] += e.intensity);
    sums
}

/// [`sums`] of one pulse from the origin.
fn one(scene: &Scene, survey: &Survey) -> f64 {
    sums(scene, survey, |_| DVec3::ZERO, 1)[0]
}

/// A board at distance y: half its width and half its height.
fn board(y: f64, half_x: f64, half_z: f64) -> [DVec3; 3] {
    [DVec3::new(-half_x, y, -half_z), DVec3::new(2.0 * half_x, 0.0, 0.0), DVec3::new(0.0, 0.0, 2.0 * half_z)]
}

/// A plane through (0, y, 0) turned about the z axis by `degrees` from facing the beam.
fn slope(y: f64, degrees: f64) -> Scene {
    let (s, c) = radians(degrees).sin_cos();
    let along = DVec3::new(c, s, 0.0) * (1.8 * y);
    let corner = DVec3::new(0.0, y, -0.9 * y) - along * 0.5;
    rectangles(half_white(), &[[corner, along, DVec3::new(0.0, 0.0, 1.8 * y)]])
}

/// Peak of the digitised pulse of 4 ns in bins of 0.25 ns.
const TOP: f64 = 0.541_341_132_946;

#[test]
fn a_wall_returns_its_power_at_any_range_divergence_and_quality() {
    for range in [2.0, 10.0, 100.0, 3000.0] {
        let scene = rectangles(half_white(), &[board(range, range * 0.02, range * 0.02)]);
        // P·ρ·D²/(4R²), nW.
        let expected = 1e9 * 4.0 * 0.5 * 0.15 * 0.15 / (4.0 * range * range) * TOP;
        for (divergence, quality) in [(3e-4, 1), (3e-4, 3), (2e-3, 3), (5e-4, 6)] {
            let ratio = one(&scene, &lab(divergence, quality)) / expected;
            assert!((ratio - 1.0).abs() < 2e-3, "{range} m, {divergence} rad, quality {quality}: {ratio}");
        }
    }
}

#[test]
fn an_edge_cuts_off_what_it_cuts_off_of_a_gaussian_beam() {
    // ½ erfc(√2·x/w) of the energy lies beyond x; w = 0.05 m at 100 m. Only many subrays resolve that share.
    let scene =
        rectangles(half_white(), &[[DVec3::new(0.0, 100.0, -20.0), DVec3::X * 20.0, DVec3::Z * 40.0]]);
    for (quality, tolerance) in [(3, 0.13), (9, 0.03), (20, 0.01)] {
        let survey = lab(1e-3, quality);
        let n = 61;
        let offset = |i: u64| 0.05 * ((i as f64 - 1.0) / 20.0 - 1.5);
        let full = sums(&scene, &survey, |_| DVec3::X * 5.0, 1)[0];
        let seen = sums(&scene, &survey, |i| DVec3::X * offset(i), n);
        for (i, seen) in (1..).zip(seen) {
            let expected = 0.5 * libm::erfc(-(2f64.sqrt()) * offset(i) / 0.05);
            assert!((seen / full - expected).abs() < tolerance, "quality {quality}, {}: {seen}", offset(i));
        }
    }
}

#[test]
fn wires_and_plates_return_their_share_of_the_beam_on_average() {
    // Half widths of 3 mm to 6 cm in a beam of w = 0.05 m, averaged over many pulses, whose patterns are
    // turned.
    let n = 2000;
    let full = one(&rectangles(half_white(), &[board(100.0, 2.0, 2.0)]), &lab(1e-3, 3));
    for half in [0.003, 0.01, 0.03, 0.06] {
        let wire = rectangles(half_white(), &[board(100.0, half, 5.0)]);
        let at = |i: u64| DVec3::X * (0.02 * (i as f64 / n as f64 - 0.5));
        let seen = sums(&wire, &lab(1e-3, 3), at, n).iter().sum::<f64>() / n as f64 / full;
        let below = |x: f64| 0.5 * libm::erfc(-(2f64.sqrt()) * x / 0.05);
        let expected = (1..=n).map(|i| below(at(i).x + half) - below(at(i).x - half)).sum::<f64>() / n as f64;
        assert!((seen / expected - 1.0).abs() < 0.1, "wire of {half} m: {seen} for {expected}");
        // In the far field of a plate the amplitude falls with R⁻⁴: its share of the beam with R⁻².
        let plate = rectangles(half_white(), &[board(100.0, half, half)]);
        let at = |i: u64| {
            DVec3::new(0.1 * ((i * 7) % n) as f64 / n as f64 - 0.05, 0.0, 0.1 * i as f64 / n as f64 - 0.05)
        };
        let seen = sums(&plate, &lab(1e-3, 3), at, n).iter().sum::<f64>() / n as f64 / full;
        let share = |c: f64| below(c + half) - below(c - half);
        let expected = (1..=n).map(|i| share(at(i).x) * share(at(i).z)).sum::<f64>() / n as f64;
        assert!((seen / expected - 1.0).abs() < 0.06, "plate of {half} m: {seen} for {expected}");
    }
}

#[test]
fn one_slope_is_one_echo_with_the_width_that_its_depth_gives() {
    for (divergence, quality) in [(5e-4, 3), (2e-3, 3), (2e-3, 6)] {
        for degrees in [0.0, 20.0, 40.0, 60.0, 75.0, 80.0, 85.0] {
            let options = PhysicsOptions { record_waveforms: true, ..PhysicsOptions::refined() };
            let survey = lab(divergence, quality);
            let batch = simulate(&slope(1000.0, degrees), &survey, options);
            assert_eq!(batch.echoes.len(), 1, "{degrees}°, {divergence}, quality {quality}");
            let moments = |samples: &[f64]| {
                let sum: f64 = samples.iter().sum();
                let mean = (0..).zip(samples).map(|(k, s)| f64::from(k) * s).sum::<f64>() / sum;
                let square =
                    (0..).zip(samples).map(|(k, s)| (f64::from(k) - mean).powi(2) * s).sum::<f64>() / sum;
                (sum, mean * 0.25, square * 0.0625)
            };
            let (energy, _, variance) = moments(&batch.samples);
            let flat = simulate(&slope(1000.0, 0.0), &survey, options);
            let (energy_of_flat, _, variance_of_flat) = moments(&flat.samples);
            let cosine = radians(degrees).cos();
            assert!((energy / energy_of_flat / cosine - 1.0).abs() < 0.02, "{degrees}°: {energy}");
            // w/2·tan θ there and back.
            let depth = 1000.0 * divergence / 4.0 * radians(degrees).tan() * 2.0 / 0.299792458;
            let expected = variance_of_flat + depth * depth;
            assert!((variance / expected - 1.0).abs() < 0.04, "{degrees}°: {variance} for {expected}");
            // The mean range of the light. With angles α, β from the axis of standard deviation s each,
            // ranges are R(1 + α·t + α²(½ + t²)
            // + β²/2), t = tan θ, and the light falls by 1 − 3α·t: R·s²(1 − 2t²) later than the axis.
            let (s, t) = (divergence / 4.0, radians(degrees).tan());
            let late = batch.echoes[0].range - 1000.0 * (1.0 + s * s * (1.0 - 2.0 * t * t));
            // What is left of subrays that are so near each other that their pulses add up to one echo is the
            // reading of its maximum; of merged ones, terms of the third order.
            let tolerance = if depth < 0.4 { 3e-4 } else { 3e-5 };
            assert!(late.abs() < tolerance, "{degrees}°: {late} m late");
        }
    }
}

#[test]
fn two_slopes_of_a_roof_are_not_taken_for_one() {
    let sides = [-1.0, 1.0].map(|side| {
        let (s, c) = radians(80.0).sin_cos();
        [DVec3::new(0.0, 990.0, -50.0), DVec3::new(side * c, s, 0.0) * 100.0, DVec3::Z * 100.0]
    });
    let survey = lab(2e-3, 3);
    let batch = simulate(&rectangles(half_white(), &sides), &survey, PhysicsOptions::refined());
    assert!((1..=2).contains(&batch.echoes.len()), "{}", batch.echoes.len());
    assert!(batch.echoes[0].range > 990.0);
}

#[test]
fn the_beam_leaves_with_the_width_of_its_exit() {
    // A slit of ± 1 cm at 1 m cuts a beam of 3 cm radius and negligible divergence.
    let below = |x: f64, w: f64| 0.5 * libm::erfc(-(2f64.sqrt()) * x / w);
    for range in [1.5, 20.0] {
        let mut survey = lab(2e-3, 12);
        survey.scanner.devices[0].beam.aperture = 0.06;
        let (slit, wall) = (board(range, 0.01, 5.0), board(range, 2.0, 2.0));
        let seen = one(&rectangles(half_white(), &[slit]), &survey)
            / one(&rectangles(half_white(), &[wall]), &survey);
        let w = (0.03f64.powi(2) + (range * 1e-3f64).powi(2)).sqrt();
        let expected = below(0.01, w) - below(-0.01, w);
        assert!((seen - expected).abs() < 0.02, "{range} m: {seen} for {expected}");
    }
}

#[test]
fn an_elliptical_beam_has_two_widths() {
    let mut survey = lab(1e-3, 12);
    survey.scanner.devices[0].beam.divergence_y = Some(3e-3);
    let full = one(&rectangles(half_white(), &[board(100.0, 5.0, 5.0)]), &survey);
    for (half_x, half_z, w) in [(0.03, 5.0, 0.05), (5.0, 0.03, 0.15)] {
        let seen = one(&rectangles(half_white(), &[board(100.0, half_x, half_z)]), &survey) / full;
        let expected = libm::erf(2f64.sqrt() * 0.03 / w);
        assert!((seen - expected).abs() < 0.02, "{seen} for {expected}");
    }
}

#[test]
fn the_beam_quality_changes_nothing_at_a_given_divergence() {
    let wire = rectangles(half_white(), &[board(1000.0, 0.1, 5.0)]);
    let of = |quality: f64| {
        let mut survey = lab(5e-4, 6);
        survey.scanner.devices[0].beam.quality = quality;
        one(&wire, &survey)
    };
    assert_eq!(of(1.0), of(5.0));
}

#[test]
fn a_threshold_is_in_watts_unless_it_is_the_default() {
    // P_r = 2·0.0225/(4R²) W · 0.541 = 1 nW at 2468 m.
    let seen = |range: f64, threshold: f64| {
        let mut survey = lab(3e-4, 1);
        survey.scanner.devices[0].detector.threshold = threshold;
        one(&rectangles(half_white(), &[board(range, 50.0, 50.0)]), &survey) > 0.0
    };
    assert!(seen(2460.0, 1e-9) && !seen(2475.0, 1e-9));
    assert!(seen(20_000.0, 1e-4), "the reference's default is no threshold in watts");
}

#[test]
fn just_behind_the_minimum_range_ranges_and_amplitudes_are_right() {
    for range in [1.0, 1.02, 1.05, 1.1, 1.5] {
        let scene = rectangles(half_white(), &[board(range, 1.0, 1.0)]);
        let batch = simulate(&scene, &lab(5e-3, 1), PhysicsOptions::refined());
        assert_eq!(batch.echoes.len(), 1, "{range} m");
        assert!((batch.echoes[0].range - range).abs() < 1e-6, "{range} m: {}", batch.echoes[0].range);
        assert!((batch.echoes[0].intensity * range * range / (11.25e6 * TOP) - 1.0).abs() < 1e-3);
    }
}
