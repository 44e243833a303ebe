//! Scan angles: across the track with roll, negative to the left, whatever the mount.

use crate::flight::FlightOptions;
use crate::flight::testing::*;
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, Rotation, degrees, radians};
use vlscan_survey::*;

const RECORDED: Corrections = Corrections { las_scan_angles: true, ..Corrections::MOTION };

fn fly_as(survey: &Survey, kinematics: Corrections) -> Vec<FlownLeg> {
    fly_plan(&plan_with(survey, FlightOptions { kinematics, ..FlightOptions::default() }))
}

/// Looking down: the mirror's axis along the flight, or against it.
fn looking_down(turn: f64) -> Mount {
    Mount {
        offset: DVec3::ZERO,
        rotation: Rotation::about_z(radians(turn)).after(Rotation::about_x(radians(-90.0))),
    }
}

/// Flights of a cone and of a mirror from `[0, 0, 0]` towards `end`.
fn flights(deflector: &Deflector, mount: Mount, end: [f64; 3]) -> Survey {
    let scan = |l: &mut Leg| {
        (l.scanner.scan_freq, l.scanner.scan_angle) = (3.0, radians(20.0));
        l.scanner.max_duration = Some(1.0);
    };
    let legs = vec![leg([0.0; 3], 30.0, scan), leg(end, 30.0, |l| l.scanner.active = false)];
    let mut s = survey(PlatformKind::LinearPath, mount, deflector.clone(), legs);
    s.scanner.devices[0].scan_freq = (0.0, 10.0);
    s
}

#[test]
fn angles_are_negative_to_the_left_of_the_flight_for_any_mount() {
    for deflector in [polygon(), Deflector::Conic] {
        for turn in [90.0, -90.0] {
            for end in [[100.0, 0.0, 0.0], [-30.0, 90.0, 5.0], [10.0, -80.0, 0.0]] {
                let s = flights(&deflector, looking_down(turn), end);
                let pulses = &fly_as(&s, RECORDED)[0].pulses;
                let way = DVec3::new(end[0], end[1], 0.0).normalize();
                let (mut left, mut right) = (0, 0);
                for pulse in pulses {
                    let beam = pulse.attitude.forward();
                    // Where it meets level ground 1000 m below, to the right of the track.
                    let aside = beam.dot(way.cross(DVec3::Z)) * 1000.0 / -beam.z;
                    assert!((1000.0 * libm::tan(pulse.scan_angle) - aside).abs() < 1e-6, "{end:?} {turn}");
                    left += i32::from(pulse.scan_angle < -0.1);
                    right += i32::from(pulse.scan_angle > 0.1);
                }
                assert!(left > 5 && right > 5, "{left} {right}");
                // On the scanner, the sign is that of the mount.
                let on_scanner = &fly_as(&s, Corrections::MOTION)[0].pulses;
                let sign = if turn > 0.0 { -1.0 } else { 1.0 };
                for (pulse, plain) in pulses.iter().zip(on_scanner) {
                    assert!(pulse.attitude == plain.attitude);
                    assert!((pulse.scan_angle - sign * plain.scan_angle).abs() < 1e-9, "{turn}");
                }
            }
        }
    }
}

/// Straight down from a recorded flight to the east with this roll and heading, deg, at this speed.
fn recorded_nadir(roll: f64, heading: f64, speed: f64) -> f64 {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("flight.txt");
    let row = |t: f64| format!("{t}, {roll}, 0, {heading}, {}, 0, 100\n", speed * t);
    std::fs::write(&path, format!("#TIME_COLUMN: 0\n{}{}", row(0.0), row(10.0))).unwrap();
    let s =
        survey(following(path, false), looking_down(0.0), straight(), vec![recorded_leg(0.0, 1.0, false)]);
    degrees(fly_as(&s, RECORDED)[0].pulses[3].scan_angle)
}

#[test]
fn roll_counts_and_the_direction_is_that_of_the_flight_not_of_the_nose() {
    // Right side down, the beam swings to the left.
    assert!((recorded_nadir(5.0, 90.0, 60.0) + 5.0).abs() < 1e-9);
    // Flown sideways with a drift of 10°: the part of the roll about the direction of flight.
    let across = degrees(libm::atan(libm::tan(radians(5.0)) * libm::cos(radians(10.0))));
    assert!((recorded_nadir(5.0, 80.0, 60.0) + across).abs() < 1e-9);
    // Backwards, as multicopters may fly.
    assert!((recorded_nadir(5.0, 270.0, 60.0) - 5.0).abs() < 1e-9);
    // Standing, left is where the nose says.
    assert!((recorded_nadir(5.0, 270.0, 0.0) + 5.0).abs() < 1e-9);
    assert!((recorded_nadir(5.0, 270.0, 0.4) + 5.0).abs() < 1e-9);
}

#[test]
fn without_a_flight_angles_count_from_straight_down() {
    let scan = |l: &mut Leg| {
        (l.scanner.scan_freq, l.scanner.scan_angle) = (5.0, radians(50.0));
        turn_head(l, 36.0, 9.0);
    };
    let s = survey(PlatformKind::Static, Mount::IDENTITY, polygon(), vec![leg([0.0; 3], 0.0, scan)]);
    let (flown, plain) = (fly_as(&s, RECORDED), fly_as(&s, Corrections::MOTION));
    let mut range = (f64::INFINITY, f64::NEG_INFINITY);
    for (pulse, plain) in flown[0].pulses.iter().zip(&plain[0].pulses) {
        // The mirror turns about a level axis from straight ahead.
        assert!((pulse.scan_angle - (radians(90.0) + plain.scan_angle)).abs() < 1e-12);
        range = (range.0.min(pulse.scan_angle), range.1.max(pulse.scan_angle));
    }
    assert!(range.0 < radians(50.0) && range.1 > radians(130.0), "{range:?}");
}

#[test]
fn level_beams_along_the_flight_have_the_angle_0() {
    // Neither left nor right, neither up nor down: no half turn by a negative zero.
    let s = flights(&straight(), Mount::IDENTITY, [0.0, 100.0, 0.0]);
    for pulse in &fly_as(&s, RECORDED)[0].pulses {
        assert_eq!(pulse.scan_angle.to_bits(), 0);
    }
}
