//! Sense, phase, tilt and wander of deflectors.

use super::*;
use crate::scanner::testing::{device, settings};
use std::f64::consts::TAU;
use std::sync::Arc;
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, degrees, radians};
use vlscan_survey::{AngleTable, Device, Prism, ScanMotion, Wander};

/// Pulses per second.
const RATE: u32 = 1000;
/// Revolutions, facets, periods per second of the settings, and turns of the first prism.
const FREQ: f64 = 7.0;

/// A device of each kind of optics.
fn devices() -> Vec<Device> {
    let prism = |rotor_freq: f64, angle: f64| Prism { rotor_freq, angle: radians(angle), index: 1.5 };
    let deflectors = [
        Deflector::Conic,
        Deflector::EllipticConic { along_max: radians(14.0) },
        Deflector::Polygon {
            effective_max: radians(30.0),
            facet_tilts: [0.0, 4.0, -4.0].map(radians).to_vec(),
        },
        Deflector::Oscillating { scan_product: 1e6 },
        Deflector::Risley {
            prisms: vec![prism(-FREQ, 18.0), prism(3.0, -18.0)],
            air: 1.0,
            incident: DVec3::Y,
        },
    ];
    deflectors.map(|deflector| Device { scan_angle_max: radians(30.0), ..device(deflector) }).to_vec()
}

fn started(device: &Device, kinematics: Corrections) -> (DevicePlan, DeviceState) {
    let plan = DevicePlan::new(device, kinematics);
    let mut leg = settings(RATE);
    (leg.scan_freq, leg.scan_angle) = (FREQ, radians(20.0));
    let mut state = DeviceState::at_rest(&plan);
    state.start_leg(&plan, &leg);
    (plan, state)
}

/// The first beams of a leg.
fn beams(device: &Device, count: usize) -> Vec<DVec3> {
    let (plan, mut state) = started(device, Corrections::MOTION);
    let mut beam = || {
        state.step_deflector(&plan);
        state.deflector.rotation(&plan).forward()
    };
    (0..count).map(|_| beam()).collect()
}

fn moving(device: &Device, motion: ScanMotion) -> Device {
    Device { scan_motion: motion, ..device.clone() }
}

fn assert_near(found: &[DVec3], expected: &[DVec3], what: &str) {
    assert_eq!(found.len(), expected.len());
    for (i, (f, w)) in found.iter().zip(expected).enumerate() {
        assert!((*f - *w).length() < 1e-9, "{what}, pulse {i}: {f} is not {w}");
    }
}

#[test]
fn the_first_pulse_leaves_at_the_phase() {
    let half = radians(20.0);
    let cone = |phase: f64| Rotation::about_y(phase).after(Rotation::about_x(half)).forward();
    let conic =
        |degrees: f64| moving(&devices()[0], ScanMotion { phase: radians(degrees), ..Default::default() });
    for degrees in [0.0, 30.0, 200.0, 359.0] {
        let found = beams(&conic(degrees), 3);
        let expected = [0.0, 1.0, 2.0].map(|k| cone(radians(degrees) + TAU * FREQ * k / f64::from(RATE)));
        assert_near(&found, &expected, &format!("{degrees}"));
    }
    let polygon = moving(&devices()[2], ScanMotion { phase: radians(270.0), ..Default::default() });
    let (plan, mut state) = started(&polygon, Corrections::MOTION);
    state.step_deflector(&plan);
    assert!(
        (degrees(state.deflector.exact_angle()) + 15.0).abs() < 1e-9,
        "a quarter of a line before its middle"
    );
    // The reference has turned by a step before.
    let (plan, mut state) = started(&polygon, Corrections::NONE);
    state.step_deflector(&plan);
    assert!((degrees(state.deflector.exact_angle()) + 15.0 - 60.0 * 0.007).abs() < 1e-9);
    let fibres = Device { scan_angle_max: radians(20.0), ..device(Deflector::Fibres { count: 8 }) };
    let angles = |motion: ScanMotion| {
        let (plan, mut state) = started(&moving(&fibres, motion), Corrections::MOTION);
        let mut angle = || {
            state.step_deflector(&plan);
            degrees(state.deflector.exact_angle())
        };
        [angle(), angle(), angle()]
    };
    let phase = radians(90.0);
    for (motion, expected) in [
        (ScanMotion { phase, ..Default::default() }, [-7.5, -2.5, 2.5]),
        (ScanMotion { phase, is_reversed: true, ..Default::default() }, [-7.5, -12.5, -17.5]),
        (ScanMotion { is_reversed: true, ..Default::default() }, [-17.5, 17.5, 12.5]),
    ] {
        let found = angles(motion);
        assert!(
            found.iter().zip(expected).all(|(f, w)| (f - w).abs() < 1e-9),
            "{found:?} is not {expected:?}"
        );
    }
}

#[test]
fn reversed_deflectors_do_what_they_did_backwards() {
    for forward in devices() {
        let reversed = moving(&forward, ScanMotion { is_reversed: true, ..Default::default() });
        let (found, ahead) = (beams(&reversed, 400), beams(&forward, 1));
        if let Deflector::Oscillating { .. } = forward.deflector {
            let mirrored: Vec<DVec3> =
                beams(&forward, 400).iter().map(|b| DVec3::new(b.x, b.y, -b.z)).collect();
            assert_near(&found, &mirrored, "oscillating");
            continue;
        }
        // Prisms are at their phase a step before the first pulse.
        if !matches!(forward.deflector, Deflector::Risley { .. }) {
            assert_near(&found[..1], &ahead, "the first pulse");
        }
        // From the phase of the reversed deflector after 399 steps the forward one comes to the first beam.
        let turns = -399.0 * FREQ / f64::from(RATE);
        if let Deflector::Conic | Deflector::EllipticConic { .. } = forward.deflector {
            let phase = TAU * (turns - turns.floor());
            let mut back = beams(&moving(&forward, ScanMotion { phase, ..Default::default() }), 400);
            back.reverse();
            assert_near(&found, &back, "conic");
        }
        if let Deflector::Polygon { .. } = forward.deflector {
            // Facets 0, 2, 1, 0 in turn, with falling angles.
            let (plan, mut state) = started(&reversed, Corrections::MOTION);
            let (mut tilts, mut before) = (Vec::new(), f64::NEG_INFINITY);
            for _ in 0..400 {
                state.step_deflector(&plan);
                let angle = state.deflector.exact_angle();
                if tilts.is_empty() || angle > before {
                    tilts.push(degrees(libm::asin(state.deflector.rotation(&plan).forward().x)).round());
                }
                before = angle;
            }
            assert_eq!(tilts, [0.0, -4.0, 4.0, 0.0]);
        }
        if let Deflector::Risley { prisms, .. } = &mut forward.clone().deflector {
            prisms.iter_mut().for_each(|prism| prism.rotor_freq *= -1.0);
            let deflector = Deflector::Risley { prisms: prisms.clone(), air: 1.0, incident: DVec3::Y };
            assert_near(&found, &beams(&Device { deflector, ..forward.clone() }, 400), "risley");
        }
    }
}

#[test]
fn a_tilted_axis_turns_the_whole_pattern() {
    let (x, z) = (radians(2.0), radians(-3.0));
    for straight in devices() {
        let tilted = moving(&straight, ScanMotion { axis_tilt: [x, z], ..Default::default() });
        let turn = |b: &DVec3| Rotation::about_z(z).apply(Rotation::about_x(x).apply(*b));
        let expected: Vec<DVec3> = beams(&straight, 300).iter().map(turn).collect();
        assert_near(&beams(&tilted, 300), &expected, straight.deflector.optics());
    }
}

#[test]
fn deflectors_without_deviation_move_alike_as_functions_of_time() {
    let still = Wander::Table(Arc::new(AngleTable { times: vec![0.0], degrees: vec![0.0] }));
    for even in devices() {
        for is_reversed in [false, true] {
            let motion = ScanMotion { is_reversed, phase: radians(100.0), ..Default::default() };
            let even = moving(&even, motion.clone());
            let wandering = moving(&even, ScanMotion { wander: Some(still.clone()), ..motion });
            assert_near(&beams(&wandering, 700), &beams(&even, 700), even.deflector.optics());
        }
    }
}

#[test]
fn wander_is_added_to_the_phase_at_the_time_of_each_pulse() {
    let wander = Wander::Sine { amplitude: radians(5.0), freq: 3.0, phase: radians(40.0) };
    let conic = moving(&devices()[0], ScanMotion { wander: Some(wander), phase: 1.0, ..Default::default() });
    for (k, beam) in beams(&conic, 500).into_iter().enumerate() {
        let time = k as f64 / f64::from(RATE);
        let turn = 1.0 + TAU * FREQ * time + radians(5.0) * (TAU * 3.0 * time + radians(40.0)).sin();
        let expected = Rotation::about_y(turn).after(Rotation::about_x(radians(20.0))).forward();
        assert!((beam - expected).length() < 1e-9, "{k}");
    }
}

#[test]
fn many_steps_at_once_lead_to_the_state_of_single_steps() {
    let wander = Wander::Sine { amplitude: radians(5.0), freq: 3.0, phase: 0.0 };
    for even in devices() {
        for (is_reversed, wander) in
            [(true, None), (false, Some(wander.clone())), (true, Some(wander.clone()))]
        {
            let motion = ScanMotion { is_reversed, phase: 2.0, wander, ..Default::default() };
            for kinematics in [Corrections::NONE, Corrections::MOTION] {
                let (plan, mut at_once) = started(&moving(&even, motion.clone()), kinematics);
                let (_, mut single) = started(&moving(&even, motion.clone()), kinematics);
                for steps in [1, 7, 150, 1000] {
                    let fired = at_once.advance_deflector(&plan, steps);
                    let mut count = 0;
                    for _ in 0..steps {
                        single.step_deflector(&plan);
                        count += u32::from(single.deflector.is_firing());
                    }
                    assert_eq!((fired, format!("{at_once:?}")), (count, format!("{single:?}")));
                }
            }
        }
    }
}

#[test]
fn a_leg_goes_on_where_the_one_before_ended_and_a_rest_restarts_it() {
    let wander = Wander::Sine { amplitude: radians(5.0), freq: 3.0, phase: 1.0 };
    for wander in [None, Some(wander)] {
        let amplitude = if wander.is_some() { radians(5.0) } else { 0.0 };
        let deviation = |time: f64| amplitude * (TAU * 3.0 * time + 1.0).sin();
        let motion = ScanMotion { phase: 0.5, wander, ..Default::default() };
        let (plan, mut state) = started(&moving(&devices()[0], motion), Corrections::MOTION);
        (0..100).for_each(|_| state.step_deflector(&plan));
        let mut leg = settings(2 * RATE);
        (leg.scan_freq, leg.scan_angle) = (2.0 * FREQ, radians(20.0));
        state.start_leg(&plan, &leg);
        state.step_deflector(&plan);
        // 100 steps of the leg before have passed since its first pulse.
        let expected = 0.5 + TAU * FREQ * 0.1 + deviation(0.0);
        assert!((state.deflector.exact_angle() - expected % TAU).abs() < 1e-9);
        state.restart(&plan);
        state.start_leg(&plan, &leg);
        state.restart(&plan);
        state.step_deflector(&plan);
        assert!((state.deflector.exact_angle() - (0.5 + deviation(0.0))).abs() < 1e-9);
    }
}
