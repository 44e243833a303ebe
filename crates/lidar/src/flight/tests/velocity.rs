//! Velocities of the origins of pulses.

use crate::flight::testing::*;
use crate::flight::{FlightOptions, FlightSink, FlightState, PoseSample, Pulse, Step};
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, Rotation, radians};
use vlscan_survey::*;

#[derive(Default)]
struct Velocities(Vec<Pulse>);

impl FlightSink for Velocities {
    fn pulse(&mut self, pulse: impl FnOnce() -> Pulse) {
        self.0.push(pulse());
    }
    fn records_velocities(&self) -> bool {
        true
    }
    fn pose(&mut self, _: impl FnOnce() -> PoseSample) {}
}

/// Origins and velocities of the pulses of a survey.
fn flown(survey: &Survey) -> Vec<(DVec3, DVec3)> {
    let plan = plan_with(survey, FlightOptions { kinematics: Corrections::MOTION, ..options() });
    let (mut state, mut all) = (FlightState::start(&plan), Velocities::default());
    while !matches!(state.step(&plan, &mut all).unwrap(), Step::Ended) {}
    all.0.iter().map(|pulse| (pulse.origin, pulse.velocity.unwrap())).collect()
}

/// Velocities are those by which the origins move on, within `tolerance` m/s, at `rate` pulses per second.
fn assert_moves(pulses: &[(DVec3, DVec3)], rate: f64, tolerance: f64) {
    assert!(pulses.len() > 20, "{}", pulses.len());
    for three in pulses.windows(3) {
        let moved = (three[2].0 - three[0].0) * (0.5 * rate);
        assert!((moved - three[1].1).length() < tolerance, "{moved} is not {}", three[1].1);
    }
}

#[test]
fn a_turning_head_moves_the_emitter_on_it() {
    let scan = |l: &mut Leg| {
        l.scanner.pulse_freq = 20_000;
        turn_head(l, 7200.0, 360.0);
    };
    let mut s = survey(PlatformKind::Static, Mount::IDENTITY, straight(), vec![leg([0.0; 3], 0.0, scan)]);
    s.scanner.devices[0].head.max_rate = 200.0;
    s.scanner.devices[0].beam_origin.offset = DVec3::X * 0.0158;
    let pulses = flown(&s);
    for (_, velocity) in &pulses {
        assert!((velocity.length() - 1.985486557).abs() < 1e-9, "{}", velocity.length());
    }
    assert_moves(&pulses, 20_000.0, 1e-4);
    // Along the beam nothing moves: the origin turns about the head's axis, radially to the beam.
    s.scanner.devices[0].beam_origin.offset = DVec3::Y * 0.0158;
    let radial = flown(&s).iter().map(|(origin, velocity)| velocity.dot(*origin)).fold(0.0, f64::max);
    assert!(radial.abs() < 1e-12, "{radial}");
}

#[test]
fn moving_platforms_carry_their_scanners() {
    let scan = |l: &mut Leg| {
        l.scanner.pulse_freq = 400;
        turn_head(l, 90.0, 45.0);
    };
    let legs = [[0.0; 3], [30.0, 0.0, 0.0]].map(|p| leg(p, 30.0, scan)).to_vec();
    let mut s = survey(PlatformKind::LinearPath, mount([0.0, 0.5, -1.0]), straight(), legs);
    s.scanner.devices[0].head.max_rate = 10.0;
    s.scanner.devices[0].beam_origin =
        Mount { offset: DVec3::new(0.3, 0.1, 0.0), rotation: Rotation::IDENTITY };
    s.legs[1].scanner.active = false;
    let pulses = flown(&s);
    assert_moves(&pulses[2..pulses.len() - 2], 400.0, 1e-4);
    // 30 m/s and half a turn in two seconds at 0.316 m.
    let fastest = pulses.iter().map(|pulse| pulse.1.length()).fold(0.0, f64::max);
    assert!(fastest <= 30.0 + radians(90.0) * 0.3163, "{fastest}");
}

#[test]
fn recorded_flights_have_the_velocity_between_their_poses() {
    let (mut s, _folder) = recorded(0.0, false, vec![recorded_leg(100.2, 100.8, false)]);
    s.legs[0].scanner.pulse_freq = 100;
    s.platform.mount = mount([0.0, 2.0, 0.0]);
    let pulses = flown(&s);
    assert_moves(&pulses[1..pulses.len() - 1], 100.0, 1e-3);
    for (_, velocity) in &pulses {
        // A lever of 2 m at 10 degrees per second beside 10 m/s.
        assert!((velocity.x - 10.0).abs() < 0.36 && velocity.y.abs() < 0.36, "{velocity}");
    }
}
