//! The corrected kinematics compared with closed formulas: clock, legs, headings, offsets, noise.

use crate::flight::FlightOptions;
use crate::flight::testing::*;
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, Rotation, degrees, radians};
use vlscan_survey::*;

/// Flies `survey` from GPS second 1000 of the week on.
fn fly_as(survey: &Survey, kinematics: Corrections) -> Vec<FlownLeg> {
    let options = FlightOptions { gps_start_ns: 1000e9, kinematics, ..FlightOptions::default() };
    fly_plan(&plan_with(survey, options))
}

fn corrected(survey: &Survey) -> Vec<FlownLeg> {
    fly_as(survey, Corrections::MOTION)
}

/// Straight legs through `points` at 30 m/s, the last one inactive.
fn path(points: &[[f64; 3]], frequency: u32) -> Survey {
    let last = points.len() - 1;
    let legs = points
        .iter()
        .enumerate()
        .map(|(i, p)| leg(*p, 30.0, |l| (l.scanner.pulse_freq, l.scanner.active) = (frequency, i < last)));
    survey(PlatformKind::LinearPath, Mount::IDENTITY, straight(), legs.collect())
}

fn azimuth(beam: Rotation) -> f64 {
    let d = beam.forward();
    degrees(libm::atan2(d.x, d.y)).rem_euclid(360.0)
}

#[test]
fn every_time_is_a_multiple_of_the_period() {
    let still = |frequency| {
        leg([0.0; 3], 0.0, |l| {
            l.scanner.pulse_freq = frequency;
            l.scanner.max_duration = Some(0.25);
        })
    };
    let s = survey(PlatformKind::Static, Mount::IDENTITY, straight(), vec![still(300_000), still(7000)]);
    let flown = corrected(&s);
    // Every leg of 0.25 s has 0.25 f pulses; the second begins where the first ended.
    assert_eq!((flown[0].pulses.len(), flown[1].pulses.len()), (75_000, 1750));
    for (leg, start, frequency) in [(0, 1000e9, 300_000), (1, 1000.25e9, 7000)] {
        for (k, pulse) in flown[leg].pulses.iter().enumerate() {
            let expected = start + k as f64 * 1e9 / f64::from(frequency);
            assert!((pulse.time_ns - expected).abs() < 3e-4, "pulse {k}: {}", pulse.time_ns);
        }
    }
    // The reference has one more pulse in the later leg, and counts time at the first leg's rate.
    let helios = fly_as(&s, Corrections::NONE);
    assert_eq!(helios[1].pulses.len(), 75_001);
}

#[test]
fn the_exact_clock_wraps_at_the_end_of_the_week() {
    let l = leg([0.0; 3], 0.0, |l| l.scanner.max_duration = Some(2.0));
    let s = survey(PlatformKind::Static, Mount::IDENTITY, straight(), vec![l]);
    let options = FlightOptions {
        gps_start_ns: 604_799e9,
        kinematics: Corrections::MOTION,
        ..FlightOptions::default()
    };
    let flown = fly_plan(&plan_with(&s, options));
    assert_eq!(flown[0].pulses.len(), 200);
    assert!((flown[0].pulses[199].time_ns - 0.99e9).abs() < 1e-3);
}

#[test]
fn beams_point_along_the_leg() {
    for bearing in [0.3, 0.6, 1.0, 30.0, 180.0, 270.0, 359.0f64] {
        let (s, c) = (libm::sin(radians(bearing)), libm::cos(radians(bearing)));
        let points = [[0.0; 3], [200.0 * s, 200.0 * c, 0.0], [400.0 * s, 400.0 * c, 3.0]];
        let flown = corrected(&path(&points, 100));
        for pulse in flown[..2].iter().flat_map(|l| &l.pulses) {
            let off = (azimuth(pulse.attitude) - bearing + 180.0).rem_euclid(360.0) - 180.0;
            assert!(off.abs() < 1e-9, "{bearing}: {off}");
        }
    }
}

#[test]
fn corners_are_sharp_and_take_no_time() {
    // 30 m/s at 100 Hz: 0.3 m a step. The corner at 10.1 m is reached after 33 steps (9.9 m) and 2/3 of
    // another.
    let flown = corrected(&path(&[[0.0; 3], [10.1, 0.0, 0.0], [10.1, -5.0, 0.0]], 100));
    let origins: Vec<DVec3> = flown.iter().flat_map(|l| &l.pulses).map(|p| p.origin).collect();
    for (k, place) in origins.iter().enumerate() {
        let way = 0.3 * k as f64;
        let expected = if way < 10.1 { DVec3::new(way, 0.0, 0.0) } else { DVec3::new(10.1, 10.1 - way, 0.0) };
        assert!((*place - expected).length() < 1e-9, "{k}: {place} is not {expected}");
    }
    assert!(origins.len() == 51 && flown[0].pulses.len() == 34, "{}", origins.len());
    let south = flown[1].pulses[0].attitude;
    assert!((azimuth(south) - 180.0).abs() < 1e-9, "the heading changes with the leg");
}

#[test]
fn a_leg_has_its_own_speed_in_metres_per_second() {
    let mut s = path(&[[0.0; 3], [0.0, 30.0, 0.0], [0.0, 60.0, 0.0]], 100);
    s.legs[1].scanner.pulse_freq = 40;
    let flown = corrected(&s);
    for pulse in flown.iter().flat_map(|l| &l.pulses) {
        let seconds = (pulse.time_ns - 1000e9) * 1e-9;
        assert!((pulse.origin.y - 30.0 * seconds).abs() < 1e-6, "{} at {seconds}", pulse.origin);
    }
    let second = &flown[1].pulses;
    assert!((second[1].time_ns - second[0].time_ns - 25e6).abs() < 1e-3);
}

#[test]
fn recorded_legs_start_on_time_and_turn_the_shorter_way() {
    let legs = [(100.5, 101.5, false), (103.0, 104.0, false), (100.0, 101.0, true)];
    let (s, _dir) =
        recorded(350.0, true, legs.map(|(start, end, teleport)| recorded_leg(start, end, teleport)).to_vec());
    let flown = corrected(&s);
    let active: Vec<&FlownLeg> = flown.iter().filter(|l| !l.pulses.is_empty()).collect();
    assert_eq!(active.len(), 3);
    for (leg, start) in active.iter().zip([100.5, 103.0, 100.0]) {
        assert_eq!(leg.pulses.len(), 10);
        for (k, pulse) in leg.pulses.iter().enumerate() {
            let time = start + 0.1 * k as f64;
            assert!((pulse.time_ns * 1e-9 - time).abs() < 1e-9, "{} is not {time}", pulse.time_ns);
            assert!((pulse.origin.x - 10.0 * (time - 100.0)).abs() < 1e-9, "{} at {time}", pulse.origin);
            let heading = match time {
                t if t < 102.0 => 350.0 + 20.0 * (t - 100.0),
                t => 30.0 - 20.0 * (t - 102.0),
            };
            let off = (azimuth(pulse.attitude) - heading + 180.0).rem_euclid(360.0) - 180.0;
            assert!(off.abs() < 1e-9, "heading at {time}: off by {off}");
        }
    }
}

fn copter(legs: Vec<Leg>, kinematics: Corrections) -> Vec<FlownLeg> {
    fly_as(
        &survey(PlatformKind::Multicopter(MULTICOPTER.clone()), mount([0.0, 0.0, -0.5]), straight(), legs),
        kinematics,
    )
}

#[test]
fn a_tilted_multicopter_tilts_its_scanner() {
    let legs = || {
        [[0.0, 0.0, 50.0], [40.0, 10.0, 52.0], [20.0, 50.0, 48.0]]
            .map(|p| leg(p, 8.0, |l| l.scanner.trajectory_interval = 0.01))
            .to_vec()
    };
    let tilted = copter(legs(), Corrections::MOTION);
    let first = &tilted[0].pulses;
    // Towards (40, 10): 75.96° from the first pulse on; after a second the pitch is at its limit, −40°.
    assert!((azimuth(first[0].attitude) - 75.963_757).abs() < 1e-3, "{}", azimuth(first[0].attitude));
    let nose = first[100].attitude.forward();
    assert!((degrees(libm::asin(nose.z)) + 40.0).abs() < 1e-6, "{nose}");
    // The mount hangs below the craft, along its own axes.
    let pose =
        tilted[0].poses.iter().find(|p| p.time_ns == first[100].time_ns).expect("a pose with each pulse");
    let arm = first[100].origin - pose.position;
    assert!((arm - pose.attitude.apply(DVec3::new(0.0, 0.0, -0.5))).length() < 1e-12, "{arm}");
    let level = copter(legs(), Corrections { multicopter_tilt: false, ..Corrections::MOTION });
    assert!(level[0].pulses.iter().all(|p| p.attitude.forward().z.abs() < 1e-12));
}

#[test]
fn attitude_noise_turns_platform_and_mount() {
    // A constant 0.1 rad about the platform's y: the platform rolls to the right. The beam of a
    // downward-looking scanner swings to the left; in the reference the beam turns about its own axis.
    let mut s = path(&[[0.0; 3], [0.0, 30.0, 0.0]], 100);
    s.platform.mount =
        Mount { offset: DVec3::new(0.0, 0.0, -2.0), rotation: Rotation::about_x(radians(-90.0)) };
    s.platform.noise.attitude[1] =
        Some(Noise { kind: NoiseKind::Uniform { min: 0.1, max: 0.1 }, clip: None, lifespan: 1 });
    let pulse = corrected(&s)[0].pulses[0];
    let (sin, cos) = libm::sincos(0.1);
    assert!((pulse.attitude.forward() - DVec3::new(-sin, 0.0, -cos)).length() < 1e-12);
    assert!((pulse.origin - DVec3::new(-2.0 * sin, 0.0, -2.0 * cos)).length() < 1e-12);
    let helios = fly_as(&s, Corrections::NONE)[0].pulses[0];
    assert!((helios.attitude.forward() - DVec3::new(0.0, 0.0, -1.0)).length() < 1e-12);
}

#[test]
fn warm_up_moves_the_optics_only() {
    let scan = |l: &mut Leg| {
        turn_head(l, 36.0, 9.0);
        l.scanner.warmup = 0.1;
    };
    let s = survey(PlatformKind::Static, Mount::IDENTITY, straight(), vec![leg([0.0; 3], 0.0, scan)]);
    // The reference turns by a step of 0.36° before the first pulse, with ten steps of warm-up by eleven.
    assert!(azimuth(corrected(&s)[0].pulses[0].attitude) < 1e-9);
    assert!((azimuth(fly_as(&s, Corrections::NONE)[0].pulses[0].attitude) - 356.04).abs() < 1e-9);
}

#[test]
fn all_channels_restart_after_an_inactive_leg() {
    let scan = |active: bool| {
        move |l: &mut Leg| {
            l.scanner.active = active;
            (l.scanner.scan_freq, l.scanner.scan_angle) = (0.7, radians(20.0));
            l.scanner.max_duration = Some(0.33);
        }
    };
    let legs = [true, false, true].map(|active| leg([0.0; 3], 0.0, scan(active))).to_vec();
    let mut s = survey(PlatformKind::Static, Mount::IDENTITY, Deflector::Conic, legs);
    s.scanner.devices.push(s.scanner.devices[0].clone());
    let flown = corrected(&s);
    let of = |device: u32| flown[2].pulses.iter().find(|p| p.device == device).unwrap().attitude;
    assert_eq!(of(0), of(1));
    let helios = Corrections { channels_restart: false, ..Corrections::MOTION };
    let flown = fly_as(&s, helios);
    let of = |device: u32| flown[2].pulses.iter().find(|p| p.device == device).unwrap().attitude;
    assert_ne!(of(0), of(1));
}

#[test]
fn a_leg_can_have_a_mount_of_its_own() {
    // Straight ahead is +y; the second leg's mount turns it to the east and hangs 2 m lower.
    let own = Mount { offset: DVec3::new(0.0, 0.0, -2.0), rotation: Rotation::about_z(radians(-90.0)) };
    let stand = |change: fn(&mut Leg, Mount)| {
        leg([0.0, 0.0, 10.0], 0.0, |l| {
            l.scanner.max_duration = Some(0.05);
            change(l, own);
        })
    };
    let legs = vec![stand(|_, _| {}), stand(|l, own| l.platform.mount = Some(own)), stand(|_, _| {})];
    let flown = fly(&survey(PlatformKind::Static, Mount::IDENTITY, straight(), legs));
    let first = |leg: usize| (flown[leg].pulses[0].origin, flown[leg].pulses[0].attitude.forward());
    for (leg, origin, direction) in
        [(0, [0.0, 0.0, 10.0], DVec3::Y), (1, [0.0, 0.0, 8.0], DVec3::X), (2, [0.0, 0.0, 10.0], DVec3::Y)]
    {
        let found = first(leg);
        assert!(
            (found.0 - DVec3::from(origin)).length() < 1e-12 && (found.1 - direction).length() < 1e-12,
            "{found:?}"
        );
        assert!((flown[leg].pulses[0].scanner_attitude.forward() - direction).length() < 1e-12, "leg {leg}");
    }
}
