//! Sequences of angles and directions (spec kinematics §4).

use super::*;
use crate::scanner::testing::{device, settings};
use vlscan_base::corrections::Corrections;
use vlscan_geom::{degrees, radians};
use vlscan_survey::{Device, Formula, Prism, Swing};

fn started(device: &Device, settings: &ScannerSettings) -> (DevicePlan, DeflectorState) {
    start(DevicePlan::new(device, Corrections::NONE), device, settings)
}

fn start(plan: DevicePlan, _: &Device, settings: &ScannerSettings) -> (DevicePlan, DeflectorState) {
    let mut state = DeflectorState::at_rest(&plan);
    state.start_leg(&plan, settings, f64::from(settings.pulse_freq));
    (plan, state)
}

/// Exact angles of the first steps, degrees.
fn angles(device: &Device, settings: &ScannerSettings, steps: usize, kinematics: Corrections) -> Vec<f64> {
    let (plan, mut state) = start(DevicePlan::new(device, kinematics), device, settings);
    let mut step = || {
        state.step(&plan);
        degrees(state.exact_angle())
    };
    (0..steps).map(|_| step()).collect()
}

fn assert_close(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (i, (f, w)) in found.iter().zip(expected).enumerate() {
        assert!((f - w).abs() < tolerance, "{i}: {f} is not {w}");
    }
}

#[test]
fn polygon_lines() {
    // spec kinematics §4.2, examples A and B
    let mut d = device(Deflector::Polygon { effective_max: radians(50.0), facet_tilts: Vec::new() });
    let mut s = settings(100);
    (s.scan_freq, s.scan_angle) = (10.0, radians(120.0));
    let lines = [24.0, 48.0, 72.0, 96.0, -120.0, -96.0, -72.0, -48.0, -24.0, 0.0, 24.0];
    let found = angles(&d, &s, 15, Corrections::NONE);
    assert_close(&found[..4], &lines[..4], 1e-9);
    assert!((found[4] - 120.0).abs() < 1e-9, "the fifth addition falls short of 120°: {}", found[4]);
    assert_close(&found[5..12], &lines[4..], 1e-9);
    d.scan_angle_max = radians(30.0);
    let mut s = settings(160);
    s.scan_freq = 20.0;
    let b = [7.5, 15.0, 22.5, -30.0, -22.5, -15.0, -7.5, 0.0, 7.5, 15.0, 22.5, 30.0, -30.0, -22.5];
    assert_close(&angles(&d, &s, 14, Corrections::NONE), &b, 1e-9);
}

#[test]
fn facets_draw_cones_in_turn() {
    let facet_tilts = vec![0.0, radians(10.0), radians(-10.0)];
    let mut d = device(Deflector::Polygon { effective_max: radians(50.0), facet_tilts });
    d.scan_angle_max = radians(60.0);
    let mut s = settings(1200);
    s.scan_freq = 100.0;
    for kinematics in [Corrections::NONE, Corrections::MOTION] {
        let (plan, mut state) = start(DevicePlan::new(&d, kinematics), &d, &s);
        let mut tilts = Vec::new();
        let mut before = 0.0;
        for _ in 0..60 {
            state.step(&plan);
            let beam = state.rotation(&plan).forward();
            // The angle to the axis of the mirror is that of its facet, at any scan angle.
            let tilt = degrees(libm::asin(beam.x));
            assert!((libm::atan2(beam.z, beam.y) - state.exact_angle()).abs() < 1e-12);
            if tilts.is_empty() || state.exact_angle() < before {
                tilts.push(tilt);
            }
            assert!((tilt - tilts[tilts.len() - 1]).abs() < 1e-9, "a facet changed within its line");
            before = state.exact_angle();
        }
        assert_close(&tilts[..6], &[0.0, 10.0, -10.0, 0.0, 10.0, -10.0], 1e-9);
        // Many steps at once lead to the same state.
        let (_, mut at_once) = start(DevicePlan::new(&d, kinematics), &d, &s);
        at_once.advance(&plan, 60);
        assert_eq!(format!("{at_once:?}"), format!("{state:?}"));
    }
}

#[test]
fn elliptic_cones_have_two_half_angles() {
    let mut d = device(Deflector::EllipticConic { along_max: radians(14.0) });
    d.scan_angle_max = radians(20.0);
    let mut s = settings(400);
    (s.scan_freq, s.scan_angle) = (100.0, radians(20.0));
    let beams = |s: &ScannerSettings| -> Vec<DVec3> {
        let (plan, mut state) = started(&d, s);
        let mut step = || {
            state.step(&plan);
            state.exact_rotation(&plan).forward()
        };
        (0..4).map(|_| step()).collect()
    };
    // A quarter of a turn per pulse: along, across, along, across.
    let tilt = |b: &DVec3| [degrees(libm::atan2(b.x, b.y)), degrees(libm::atan2(b.z, b.y))];
    let found: Vec<f64> = beams(&s).iter().flat_map(tilt).collect();
    assert_close(&found, &[14.0, 0.0, 0.0, -20.0, -14.0, 0.0, 0.0, 20.0], 1e-9);
    s.scan_angle = radians(10.0);
    let along = degrees(libm::atan(radians(10.0).tan() * radians(14.0).tan() / radians(20.0).tan()));
    let found: Vec<f64> = beams(&s).iter().flat_map(tilt).collect();
    assert_close(&found, &[along, 0.0, 0.0, -10.0, -along, 0.0, 0.0, 10.0], 1e-9);
}

#[test]
fn a_corrected_polygon_has_the_requested_frequency() {
    // 133 lines a second at 1000 Hz: 7.5188 pulses a line, so that the excess counts; the sum of steps is the
    // angle.
    let mut d = device(Deflector::Polygon { effective_max: radians(50.0), facet_tilts: Vec::new() });
    d.scan_angle_max = radians(30.0);
    let mut s = settings(1000);
    s.scan_freq = 133.0;
    let found = angles(&d, &s, 10_000, Corrections::MOTION);
    for (k, angle) in found.iter().enumerate() {
        let turned = k as f64 * 60.0 * 0.133 + 30.0;
        let off = (turned - 60.0 * (turned / 60.0).floor() - 30.0 - angle).abs();
        assert!(off.min(60.0 - off) < 1e-6, "{k}: {angle}");
    }
    let lines = found.windows(2).filter(|w| w[1] < w[0]).count();
    assert_eq!(lines, 1330);
    let helios = angles(&d, &s, 10_000, Corrections::NONE).windows(2).filter(|w| w[1] < w[0]).count();
    assert_eq!(helios, 1250, "the reference needs 8 pulses a line");
}

#[test]
fn a_corrected_mirror_has_the_requested_frequency_within_its_limits() {
    let d = device(Deflector::Oscillating { scan_product: 1e6 });
    for (freq, turning) in [(70.0, 0.07), (7.3, 0.0073), (430.0, 0.43), (2000.0, 0.5)] {
        let mut s = settings(100_000);
        (s.scan_freq, s.scan_angle) = (freq, radians(20.0));
        let found = angles(&d, &s, 100_000, Corrections::MOTION);
        assert!((found[0] + 20.0).abs() < 1e-9);
        assert!(found.iter().all(|a| a.abs() <= 20.0 + 1e-9));
        let up = found.windows(2).filter(|w| w[0] < 0.0 && w[1] >= 0.0).count();
        assert!((up as f64 - freq).abs() <= 1.0, "{up} periods in a second, not {freq}");
        // Between the turns the speed is 2s over the share of a half period that is left: 2s · 2f / (1 − r).
        let speed = 4.0 * 20.0 * freq / 1e5 / (1.0 - turning);
        let fastest = found.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        assert!((fastest / speed - 1.0).abs() < 0.06, "{freq} Hz: {fastest} {speed}");
    }
    let mut s = settings(1000);
    (s.scan_freq, s.scan_angle) = (2.0, radians(200.0));
    let widest = angles(&d, &s, 500, Corrections::MOTION).into_iter().fold(0.0, f64::max);
    assert!((widest - 120.0).abs() < 0.1, "{widest} is beyond the device");
}

#[test]
fn mirrors_swing_as_a_sine_or_with_reversals_of_a_share_in_any_physics() {
    let mut d = device(Deflector::Oscillating { scan_product: 1e6 });
    let mut s = settings(100_000);
    (s.scan_freq, s.scan_angle) = (50.0, radians(15.0));
    for kinematics in [Corrections::MOTION, Corrections::NONE] {
        d.scan_motion.swing = Swing::Sine;
        for (k, angle) in angles(&d, &s, 5000, kinematics).into_iter().enumerate() {
            let expected = -15.0 * libm::cos(TAU * k as f64 / 2000.0);
            assert!((angle - expected).abs() < 1e-9, "{k}: {angle}");
        }
        // A fifth of each sweep of 1000 pulses is a parabola at either end; 15 · 2 · 1.25 / 1000 a pulse
        // between.
        d.scan_motion.swing = Swing::TurningPart(0.4);
        let found = angles(&d, &s, 2001, kinematics);
        for (k, expected) in [
            (0, -15.0),
            (100, -14.0625),
            (200, -11.25),
            (500, 0.0),
            (501, 0.0375),
            (1000, 15.0),
            (2000, -15.0),
        ] {
            assert!((found[k] - expected).abs() < 1e-9, "{k}: {}", found[k]);
        }
    }
}

#[test]
fn many_steps_of_a_mirror_are_as_many_single_ones() {
    let mut d = device(Deflector::Oscillating { scan_product: 1e6 });
    let mut s = settings(100_000);
    (s.scan_freq, s.scan_angle) = (37.0, radians(15.0));
    for swing in [Swing::TurningPulses, Swing::TurningPart(0.0), Swing::TurningPart(1.0), Swing::Sine] {
        d.scan_motion.swing = swing;
        let (plan, mut stepped) = started(&d, &s);
        let mut advanced = stepped.clone();
        for steps in [1, 2, 777, 100_003] {
            (0..steps).for_each(|_| stepped.step(&plan));
            assert_eq!(advanced.advance(&plan, steps), steps);
            let [one, other] = [&stepped, &advanced].map(|state| state.exact_angle().to_bits());
            assert_eq!(one, other, "{swing:?} {steps}");
        }
    }
}

#[test]
fn the_polygon_window_is_open_below() {
    let d = device(Deflector::Polygon { effective_max: radians(50.0), facet_tilts: Vec::new() });
    let mut s = settings(100);
    s.scan_freq = 10.0;
    let fired = |s: &ScannerSettings| {
        let (plan, mut state) = started(&d, s);
        let mut fired = Vec::new();
        for _ in 0..12 {
            state.step(&plan);
            if state.is_firing() {
                fired.push(degrees(state.exact_angle()).round());
            }
        }
        fired
    };
    assert_eq!(fired(&s), [24.0, 48.0, -48.0, -24.0, 0.0, 24.0]);
    (s.vertical_min, s.vertical_max) = (Some(0.0), Some(0.0));
    assert!(fired(&s).is_empty());
    s.vertical_min = Some(radians(-30.0));
    assert_eq!(fired(&s), [-24.0, 0.0]);
}

#[test]
fn deflection_errors_change_the_angle_but_not_the_motion() {
    // spec kinematics §4.2: M_max 50°, Δ 10°, E = −0.05 cos θ
    let mut d = device(Deflector::Polygon { effective_max: radians(50.0), facet_tilts: Vec::new() });
    d.scan_angle_max = radians(50.0);
    d.errors.deflection = Some(Formula::parse("-0.05*cos(THETA)").unwrap());
    let mut s = settings(100);
    s.scan_freq = 10.0;
    let (plan, mut state) = started(&d, &s);
    let mut rows = Vec::new();
    for _ in 0..6 {
        state.step(&plan);
        let DeflectorState::Polygon(m) = &state else { unreachable!() };
        rows.extend([degrees(m.exact), degrees(m.angle)]);
    }
    assert_close(&rows[..2], &[10.0, 7.1787], 1e-4);
    assert_close(&rows[6..], &[40.0, 37.8054, -50.0, 48.1585, -40.0, -42.1946], 1e-4);
}

#[test]
fn oscillating_period() {
    // spec kinematics §4.3
    let d = device(Deflector::Oscillating { scan_product: 1e6 });
    let mut s = settings(1000);
    (s.scan_freq, s.scan_angle) = (2.0, radians(20.0));
    let found = angles(&d, &s, 501, Corrections::NONE);
    for (j, expected) in [
        (0, -20.0),
        (1, -20.0),
        (2, -19.995908),
        (3, -19.987724),
        (49, -15.18797),
        (50, -14.987469),
        (100, -4.962406),
        (125, 0.050125),
        (200, 15.087719),
        (249, 20.0),
        (250, 20.0),
        (251, 20.0),
        (252, 19.99599),
        (499, -20.0),
        (500, -20.0),
    ] {
        assert!((found[j] - expected).abs() < 1e-6, "{j}: {}", found[j]);
    }
}

#[test]
fn the_scan_product_limits_the_frequency() {
    let d = device(Deflector::Oscillating { scan_product: 1000.0 });
    let mut s = settings(100_000);
    (s.scan_freq, s.scan_angle) = (100.0, radians(20.0));
    let (_, DeflectorState::Oscillating(m)) = started(&d, &s) else { unreachable!() };
    assert_eq!(m.period, 2000);
}

#[test]
fn a_shorter_period_keeps_the_mirror_in_its_range() {
    let d = device(Deflector::Oscillating { scan_product: 1e6 });
    let mut s = settings(1000);
    (s.scan_freq, s.scan_angle) = (1.0, radians(20.0));
    let (plan, mut state) = started(&d, &s);
    (0..900).for_each(|_| state.step(&plan));
    s.scan_freq = 2.0;
    state.start_leg(&plan, &s, 1000.0);
    for _ in 0..2000 {
        state.step(&plan);
        assert!(state.exact_angle().abs() < radians(20.3));
    }
}

#[test]
fn conic_circle() {
    // spec kinematics §4.4
    let mut d = device(Deflector::Conic);
    d.scan_freq = (0.0, 5.0);
    let mut s = settings(100);
    s.scan_angle = radians(20.0);
    let (plan, mut state) = started(&d, &s);
    let mut beams = Vec::new();
    for _ in 0..5 {
        state.step(&plan);
        beams.push(state.rotation(&plan).forward());
    }
    for (i, expected) in [
        (0, [0.105690, 0.939693, 0.325280]),
        (1, [0.201034, 0.939693, 0.276700]),
        (4, [0.342020, 0.939693, 0.0]),
    ] {
        assert!((beams[i] - DVec3::from(expected)).length() < 1e-6, "{}", beams[i]);
    }
}

#[test]
fn fibre_order() {
    // spec kinematics §4.5
    let d = device(Deflector::Fibres { count: 8 });
    let mut s = settings(100);
    s.scan_angle = radians(20.0);
    assert_close(
        &angles(&d, &s, 9, Corrections::NONE),
        &[-20.0, -15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0, -20.0],
        1e-9,
    );
}

#[test]
fn corrected_fibres_are_symmetric() {
    let d = device(Deflector::Fibres { count: 8 });
    let mut s = settings(100);
    s.scan_angle = radians(20.0);
    let found = angles(&d, &s, 9, Corrections::MOTION);
    assert_close(&found, &[-17.5, -12.5, -7.5, -2.5, 2.5, 7.5, 12.5, 17.5, -17.5], 1e-9);
    let one = device(Deflector::Fibres { count: 1 });
    assert_close(&angles(&one, &s, 2, Corrections::MOTION), &[0.0, 0.0], 1e-12);
}

#[test]
fn a_totally_reflected_beam_keeps_its_last_direction() {
    let prism = |rotor_freq, angle: f64| Prism { rotor_freq, angle: radians(angle), index: 1.5 };
    let deflector = Deflector::Risley {
        prisms: vec![prism(1.0, -30.0), prism(-3.0, -30.0)],
        air: 1.0,
        incident: DVec3::Y,
    };
    let d = device(deflector);
    let (plan, mut state) = started(&d, &settings(100));
    let train = plan.prisms.clone().unwrap();
    assert!(train.may_reflect_totally);
    let (mut last, mut failures) = (None, 0);
    for _ in 0..100 {
        state.step(&plan);
        let DeflectorState::Risley { time, .. } = state else { unreachable!() };
        match train.refract(time) {
            Some(beam) => last = Some(beam),
            None => failures += 1,
        }
        let found = state.rotation(&plan).forward();
        assert!((found - last.unwrap_or(DVec3::Y)).length() < 1e-12);
    }
    assert!(failures > 0 && failures < 100, "{failures}");
}
