//! Flights with navigation errors: true poses stay unchanged, reported poses change.

use crate::flight::testing::*;
use crate::flight::{FlightOptions, Pulse};
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, Rotation, radians};
use vlscan_survey::*;

fn flight() -> Survey {
    let scan = |l: &mut Leg| l.scanner.trajectory_interval = 0.1;
    let legs = [[0.0, 0.0, 500.0], [0.0, 90.0, 500.0]].map(|p| leg(p, 30.0, scan)).to_vec();
    let down = Mount { offset: DVec3::new(0.0, 1.0, 0.0), rotation: Rotation::about_x(radians(-90.0)) };
    survey(PlatformKind::LinearPath, down, straight(), legs)
}

fn fly_with(errors: &[(&str, &[f64])]) -> Vec<FlownLeg> {
    let mut navigation = NavigationErrors::NONE;
    errors.iter().for_each(|(key, numbers)| navigation.set(key, numbers).unwrap());
    let kinematics = Corrections::MOTION;
    let options = FlightOptions { kinematics, navigation, seed: 7, ..FlightOptions::default() };
    fly_plan(&plan_with(&flight(), options))
}

#[test]
fn true_poses_do_not_depend_on_errors() {
    let (true_flight, erring) = (
        fly_with(&[]),
        fly_with(&[("position_m", &[0.1]), ("attitude_deg", &[0.1]), ("lever_arm_m", &[1.0])]),
    );
    for (a, b) in true_flight[0].pulses.iter().zip(&erring[0].pulses) {
        assert_eq!((a.origin, a.attitude, a.exact_attitude), (b.origin, b.attitude, b.exact_attitude));
        assert_eq!((a.origin_error, a.reported_attitude), (DVec3::ZERO, a.exact_attitude));
        assert!(b.origin_error.length() > 0.1 && b.reported_attitude != b.exact_attitude);
    }
    for (a, b) in true_flight[0].poses.iter().zip(&erring[0].poses) {
        assert!(a.flown == b.flown && a.position == a.flown.0 && b.position != b.flown.0);
        assert_eq!(b.as_flown().position, a.position);
    }
}

#[test]
fn errors_move_points_as_computed() {
    // 1 mrad of roll to the right, 500 m above ground: points at nadir are reported 0.5 m to the left.
    let roll = libm::atan(1e-3).to_degrees();
    let pulse = fly_with(&[("boresight_deg", &[roll, 0.0, 0.0])])[0].pulses[0];
    let point = |p: &Pulse| p.origin + p.origin_error + p.reported_attitude.forward() * 500.0;
    let below = pulse.origin + pulse.exact_attitude.forward() * 500.0;
    assert!(
        (point(&pulse) - below - DVec3::new(-0.5, 0.0, 0.0)).length() < 1e-3,
        "{}",
        point(&pulse) - below
    );
    // A heading error turns the arm of the mount, 1 m ahead.
    let pulse = fly_with(&[("attitude_bias_deg", &[0.0, 0.0, 90.0])])[0].pulses[0];
    assert!((pulse.origin_error - DVec3::new(1.0, -1.0, 0.0)).length() < 1e-9, "{}", pulse.origin_error);
    // A drift of 3600° an hour: 1° a second.
    let pulses = &fly_with(&[("attitude_drift_deg_per_h", &[0.0, 3600.0, 0.0])])[0].pulses;
    for pulse in [&pulses[0], &pulses[100], &pulses[250]] {
        let seconds = pulse.time_ns * 1e-9;
        let expected = Rotation::about_x(radians(seconds)).after(pulse.exact_attitude).forward();
        assert!((pulse.reported_attitude.forward() - expected).length() < 1e-9);
    }
}
