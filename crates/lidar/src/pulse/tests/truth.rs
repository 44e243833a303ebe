//! True causes of echoes, and the table of subrays.

use super::*;
use crate::pulse::testkit::*;

/// A board that covers the right half of a beam along +y at 100 m, turned by 30°, before a wall at 130 m.
fn half_covered() -> Scene {
    let (s, c) = radians(30.0).sin_cos();
    let board = [DVec3::new(0.0, 100.0, -20.0), DVec3::new(c, s, 0.0) * 10.0, DVec3::Z * 40.0];
    rectangles(half_white(), &[board, wall(-20.0, 20.0, 130.0)])
}

#[test]
fn truths_hold_surface_normal_and_share_of_the_strongest_subray() {
    let options = PhysicsOptions { record_truth: true, ..PhysicsOptions::refined() };
    let mut survey = tls();
    survey.legs[0].scanner.beam_divergence = 2e-3;
    let scene = half_covered();
    let batch = simulate(&scene, &survey, options);
    assert_eq!(batch.echoes.len(), 2);
    let (near, far) = (&batch.echoes[0], &batch.echoes[1]);
    assert!((near.truth(&batch.truths).fraction + far.truth(&batch.truths).fraction - 1.0).abs() < 1e-12);
    assert!(
        (0.3..0.7).contains(&near.truth(&batch.truths).fraction),
        "{}",
        near.truth(&batch.truths).fraction
    );
    let at = near.truth(&batch.truths).surface + scene.shift;
    // On the board's plane y = 100 + x·tan 30°, and within the beam.
    assert!((at.y - 100.0 - at.x * radians(30.0).tan()).abs() < 1e-9 && at.x > 0.0 && at.x < 0.3, "{at}");
    assert!((near.truth(&batch.truths).normal - DVec3::new(0.5, -radians(30.0).cos(), 0.0)).length() < 1e-12);
    assert!(
        (far.truth(&batch.truths).surface + scene.shift).y == 130.0
            || ((far.truth(&batch.truths).surface + scene.shift).y - 130.0).abs() < 1e-9
    );
    assert_eq!(far.truth(&batch.truths).normal, DVec3::NEG_Y);
}

#[test]
fn the_table_of_subrays_has_every_one_with_its_return() {
    let mut survey = tls();
    survey.legs[0].scanner.beam_divergence = 2e-3;
    let scene = half_covered();
    let options = PhysicsOptions { record_subrays: true, ..PhysicsOptions::refined() };
    let batch = simulate(&scene, &survey, options);
    assert_eq!(batch.echoes.len(), 16);
    for (i, e) in (0..).zip(&batch.echoes) {
        assert_eq!((e.truth(&batch.truths).subray, e.return_number, e.number_of_returns), (i, e.part + 1, 2));
        assert!((e.position - e.origin - e.direction * e.range).length() < 1e-12);
    }
    let echoes = simulate(&scene, &survey, PhysicsOptions::refined()).echoes;
    let sum = |part: u32| batch.echoes.iter().filter(|e| e.part == part).map(|e| e.intensity).sum::<f64>();
    // The peak of the pulse in its bins, stretched a little by the slope of the board.
    let peak = |part: u32| echoes[part as usize].intensity / sum(part);
    assert!(
        (0.95..1.0001).contains(&peak(0)) && (0.99..1.0001).contains(&peak(1)),
        "{} {}",
        peak(0),
        peak(1)
    );
}

#[test]
fn subrays_of_a_wide_exit_meet_the_surface_where_they_hit_it() {
    // 50 mm at the exit, 0.1 mrad: at 2 m the subrays lie 2σ = w = 25 mm around the axis.
    let survey = tls_with(|d| {
        (d.beam.aperture, d.waveform.quality) = (0.05, 6);
        d.detector.range_min = 0.5;
    });
    let mut survey = survey;
    survey.legs[0].scanner.beam_divergence = 1e-4;
    let scene = rectangles(half_white(), &[wall(-20.0, 20.0, 2.0)]);
    let options = PhysicsOptions { record_subrays: true, ..PhysicsOptions::refined() };
    let all = pulses(16);
    let batch = simulate_pulses(&scene, &survey, options, 0, &all);
    let square = |e: &crate::pulse::Echo| (e.position + scene.shift).x.powi(2);
    let width = 2.0 * (batch.echoes.iter().map(square).sum::<f64>() / batch.echoes.len() as f64).sqrt();
    assert!((width / 0.025 - 1.0).abs() < 1e-3, "{width}");
    for e in &batch.echoes {
        assert!(((e.position + scene.shift).y - 2.0).abs() < 1e-9, "{}", e.position + scene.shift);
        assert!((e.position - e.origin - e.direction * e.range).length() < 1e-12);
        assert!((e.truth(&batch.truths).surface - e.position).length() < 1e-12);
    }
    // A strip 16 to 24 mm beside the axis is where it is, by the truth of the echo, too.
    let strip = rectangles(half_white(), &[wall(0.016, 0.024, 2.0)]);
    for record_subrays in [true, false] {
        let options = PhysicsOptions { record_subrays, record_truth: true, ..PhysicsOptions::refined() };
        let batch = simulate_pulses(&strip, &survey, options, 0, &all);
        assert!(!batch.echoes.is_empty());
        for e in &batch.echoes {
            let at = e.truth(&batch.truths).surface + strip.shift;
            assert!((0.016..=0.024).contains(&at.x) && (at.y - 2.0).abs() < 1e-9, "{at}");
        }
    }
}
