//! The worked examples and golden sequences of spec kinematics.

use crate::flight::testing::*;
use crate::flight::{FlightOptions, FlightState, Step};
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, Rotation, degrees, radians};
use vlscan_survey::Formula;
use vlscan_survey::*;

fn close(found: DVec3, expected: [f64; 3], tolerance: f64) {
    assert!((found - DVec3::from(expected)).abs().max_element() <= tolerance, "{found} is not {expected:?}");
}

fn tripod(legs: Vec<Leg>) -> Survey {
    let mut s = survey(PlatformKind::Static, mount([0.0, 0.0, 1.5]), polygon(), legs);
    s.scanner.devices[0].beam_origin = mount([0.0, 0.3, 0.2]);
    s
}

fn lines(leg: &mut Leg) {
    leg.scanner.scan_freq = 10.0;
    leg.scanner.scan_angle = radians(120.0);
}

#[test]
fn static_polygon() {
    // §11.1
    let golden = [
        (0.00, [-0.0057, 0.9135, 0.4067]),
        (0.01, [-0.0084, 0.6691, 0.7431]),
        (0.08, [-0.0378, 0.6681, -0.7431]),
        (0.09, [-0.0574, 0.9117, -0.4067]),
        (0.10, [-0.0691, 0.9976, -0.0000]),
        (0.11, [-0.0688, 0.9109, 0.4067]),
        (0.12, [-0.0546, 0.6669, 0.7431]),
        (0.19, [-0.0839, 0.6639, -0.7431]),
        (0.23, [-0.1005, 0.6615, 0.7431]),
    ];
    let scan = |l: &mut Leg| {
        lines(l);
        turn_head(l, 36.0, 9.0);
    };
    let flown = fly(&tripod(vec![leg([1.0, 2.0, 3.0], 0.0, scan), leg([1.0, 2.0, 3.0], 0.0, scan)]));
    assert_eq!((flown[0].steps, flown[0].pulses.len()), (26, 12));
    for (time, direction) in golden {
        let pulse = flown[0].pulses.iter().find(|p| (seconds(p) - time).abs() < 1e-6);
        let pulse = pulse.unwrap_or_else(|| panic!("no pulse at {time}"));
        close(pulse.origin, [1.0, 2.3, 4.7], 1e-12);
        close(pulse.attitude.forward(), direction, 6e-5);
    }
    assert!((seconds(&flown[1].pulses[0]) - 0.26).abs() < 1e-6);
    let numbers: Vec<u64> = flown.iter().flat_map(|l| &l.pulses).map(|p| p.number).collect();
    assert_eq!(numbers, (1..=24).collect::<Vec<_>>());
}

#[test]
fn linear_path_with_fibres() {
    // §11.2
    let line = |l: &mut Leg| l.scanner.scan_angle = radians(30.0);
    let legs = vec![
        leg([0.0, 0.0, 100.0], 30.0, line),
        leg([10.1, 0.0, 100.0], 30.0, line),
        leg([15.1, 5.0, 101.0], 20.0, |l| l.scanner.active = false),
        leg([15.1, -10.0, 101.0], 30.0, |l| {
            line(l);
            l.scanner.pulse_freq = 50;
        }),
        leg([300.0, -10.0, 101.0], 30.0, line),
    ];
    let flown =
        fly(&survey(PlatformKind::LinearPath, mount([0.0, 1.0, 0.5]), Deflector::Fibres { count: 8 }, legs));
    let pulses: Vec<_> = flown.iter().flat_map(|l| &l.pulses).collect();
    let golden: [(usize, [f64; 3], [f64; 3], f64); 8] = [
        (0, [0.0, 1.0, 100.5], [0.8660, 0.0, -0.5], 0.00),
        (1, [0.3, 1.0, 100.5], [0.9239, 0.0, -0.3827], 0.01),
        (33, [9.9, 1.0, 100.5], [0.9239, 0.0, -0.3827], 0.33),
        (34, [10.2, 1.0, 100.5], [0.6963, 0.6695, -0.2588], 0.34),
        (35, [10.4079, 1.2121, 100.5424], [0.7147, 0.6872, -0.1305], 0.35),
        (57, [14.9810, 5.8785, 101.4757], [0.6660, 0.6403, -0.3827], 0.57),
        (58, [15.0994, -9.1091, 101.4999], [0.9659, -0.0003, -0.2588], 1.34),
        (59, [15.6994, -9.1088, 101.4999], [0.9914, -0.0003, -0.1305], 1.35),
    ];
    for (i, origin, direction, time) in golden {
        close(pulses[i].origin, origin, 6e-5);
        close(pulses[i].attitude.forward(), direction, 6e-5);
        assert!((seconds(pulses[i]) - time).abs() < 1e-6, "{i}: {}", seconds(pulses[i]));
    }
}

#[test]
fn linear_path_overshoots_and_turns_at_once() {
    // §2.8 example 1
    let sampled = |l: &mut Leg| l.scanner.trajectory_interval = 0.001;
    let legs = vec![
        leg([0.0, 0.0, 100.0], 30.0, sampled),
        leg([10.1, 0.0, 100.0], 30.0, sampled),
        leg([15.1, 5.0, 101.0], 30.0, sampled),
    ];
    let flown = fly(&survey(PlatformKind::LinearPath, Mount::IDENTITY, Deflector::Fibres { count: 1 }, legs));
    assert_eq!(flown[0].steps, 34);
    for (i, pulse) in flown[0].pulses.iter().enumerate() {
        close(pulse.origin, [0.3 * i as f64, 0.0, 100.0], 1e-9);
    }
    close(flown[1].pulses[0].origin, [10.2, 0.0, 100.0], 1e-9);
    close(flown[1].pulses[1].origin, [10.4079, 0.2121, 100.0424], 6e-5);
    assert!((degrees(flown[1].poses[0].yaw) - 313.8767).abs() < 6e-5);
    assert_eq!(flown[2].steps, 0, "the last leg's target is where it starts");
}

#[test]
fn small_clockwise_errors_of_the_first_leg_quadruple() {
    // §2.8 example 2
    let sampled = |l: &mut Leg| l.scanner.trajectory_interval = 0.001;
    // 0.3° aside, clockwise
    for (target, expected) in [([2.618, 500.0, 0.0], 0.9), ([100.0, 0.0, 0.0], 270.0)] {
        let legs = vec![leg([0.0; 3], 30.0, sampled), leg(target, 30.0, sampled)];
        let flown =
            fly(&survey(PlatformKind::LinearPath, Mount::IDENTITY, Deflector::Fibres { count: 1 }, legs));
        let yaw = degrees(flown[0].poses[0].yaw);
        assert!((yaw - expected).abs() < 6e-5, "{yaw}");
    }
}

#[test]
fn last_leg_ping_pong() {
    // §11.5
    let legs = vec![
        leg([0.0, 0.0, 100.0], 10.0, |l| turn_head(l, 36.0, 1.0)),
        leg([0.0, 1.05, 100.0], 10.0, |l| turn_head(l, 36.0, 5.0)),
    ];
    let flown = fly(&survey(PlatformKind::LinearPath, Mount::IDENTITY, Deflector::Fibres { count: 1 }, legs));
    assert_eq!((flown[0].steps, flown[1].steps), (11, 14));
    for (i, pulse) in flown[1].pulses.iter().enumerate() {
        close(pulse.origin, [0.0, if i % 2 == 0 { 1.1 } else { 1.0 }, 100.0], 1e-9);
    }
}

#[test]
fn maximum_duration() {
    // §1.8 example 1
    let timed = |active: bool, duration: f64| {
        move |l: &mut Leg| {
            l.scanner.max_duration = Some(duration);
            l.scanner.active = active;
        }
    };
    let legs = vec![
        leg([0.0; 3], 0.0, timed(true, 1.0)),
        leg([0.0; 3], 0.0, timed(true, 1.0)),
        leg([0.0; 3], 0.0, timed(false, 0.5)),
    ];
    let flown = fly(&survey(PlatformKind::Static, Mount::IDENTITY, Deflector::Fibres { count: 1 }, legs));
    let steps: Vec<usize> = flown.iter().map(|l| l.steps).collect();
    assert_eq!(steps, [100, 101, 50]);
    assert_eq!(flown[1].pulses.len(), 101);
    assert!((seconds(&flown[1].pulses[0]) - 1.0).abs() < 1e-9);
    assert!((seconds(&flown[1].pulses[100]) - 2.0).abs() < 1e-9);
    assert!(flown[2].pulses.is_empty());
}

#[test]
fn the_gps_clock_is_a_running_sum() {
    // §1.8 example 2
    for (start, steps, advanced) in
        [(271_991e9, 300_000, 1_000_003_125.0), (86_391e9, 300_000, 999_998_437.5)]
    {
        let mut s = tripod(vec![leg([0.0; 3], 0.0, |l| {
            l.scanner.max_duration = Some(2.0);
            l.scanner.pulse_freq = 300_000;
        })]);
        s.scanner.devices[0].deflector = Deflector::Fibres { count: 1 };
        let plan = plan_with(&s, FlightOptions { gps_start_ns: start, ..Default::default() });
        let mut state = FlightState::start(&plan);
        let mut count = Count::default();
        for _ in 0..steps {
            assert_eq!(state.step(&plan, &mut count).unwrap(), Step::Advanced);
        }
        assert_eq!(state.time_ns() - start, advanced);
        assert_eq!(count.pulses, steps);
    }
}

#[test]
fn the_clock_keeps_the_first_legs_frequency() {
    // §1.8 example 4
    let legs = vec![
        leg([0.0; 3], 0.0, |l| turn_head(l, 36.0, 3.6)),
        leg([0.0; 3], 0.0, |l| {
            turn_head(l, 36.0, 3.6);
            l.scanner.pulse_freq = 50;
        }),
    ];
    let flown = fly(&survey(PlatformKind::Static, Mount::IDENTITY, straight(), legs));
    let azimuths: Vec<f64> = flown[1]
        .pulses
        .iter()
        .map(|p| p.attitude.forward())
        .map(|d| degrees(libm::atan2(-d.x, d.y)))
        .collect();
    assert!((azimuths[0] - 0.72).abs() < 1e-9 && (azimuths[1] - 1.44).abs() < 1e-9);
    let second = seconds(&flown[1].pulses[1]) - seconds(&flown[1].pulses[0]);
    assert!((second - 0.01).abs() < 1e-9);
}

#[test]
fn warm_up_turns_mirror_and_head_in_every_active_leg() {
    let scan = |l: &mut Leg| {
        turn_head(l, 36.0, 9.0);
        l.scanner.warmup = 0.045;
    };
    let legs = vec![leg([0.0; 3], 0.0, scan), leg([0.0; 3], 0.0, scan)];
    let flown = fly(&survey(PlatformKind::Static, Mount::IDENTITY, straight(), legs));
    for leg in &flown {
        // round half away from zero: 4.5 → 5 steps; then 26 − 5 remain
        assert_eq!(leg.steps, 21);
        let d = leg.pulses[0].attitude.forward();
        assert!((degrees(libm::atan2(-d.x, d.y)) - 6.0 * 0.36).abs() < 1e-9);
    }
    assert!((seconds(&flown[0].pulses[0])).abs() < 1e-12);
}

#[test]
fn inactive_legs_freeze_the_deflector_and_restart_device_0() {
    let timed = |active: bool| {
        move |l: &mut Leg| {
            l.scanner.max_duration = Some(0.1);
            l.scanner.active = active;
            (l.scanner.scan_freq, l.scanner.scan_angle) = (0.5, radians(20.0));
        }
    };
    let legs = [true, false, true].map(|active| leg([0.0; 3], 0.0, timed(active))).to_vec();
    let mut s =
        survey(PlatformKind::Static, Mount::IDENTITY, Deflector::Oscillating { scan_product: 1e6 }, legs);
    let second = s.scanner.devices[0].clone();
    s.scanner.devices.push(second);
    let flown = fly(&s);
    let angles = |device: u32| -> Vec<f64> {
        flown[2].pulses.iter().filter(|p| p.device == device).map(|p| degrees(p.scan_angle)).collect()
    };
    assert!((angles(0)[0] + 20.0).abs() < 1e-9, "device 0 starts a new period");
    let last_before = degrees(flown[0].pulses.last().unwrap().scan_angle);
    let first_after = angles(1)[0];
    assert!(
        first_after > last_before && first_after < -19.0,
        "device 1 continues: {last_before} {first_after}"
    );
}

#[test]
fn mounting_chain() {
    // §3.1
    let m = Rotation::about_z(radians(90.0)).after(Rotation::about_x(radians(-90.0)));
    let legs = vec![leg([0.0; 3], 30.0, |_| {}), leg([100.0, 0.0, 0.0], 30.0, |_| {})];
    let aerial = Mount { offset: DVec3::ZERO, rotation: m };
    let mut s = survey(PlatformKind::LinearPath, aerial, Deflector::Fibres { count: 1 }, legs);
    // The only fibre points to −scan angle.
    s.scanner.devices[0].scan_angle_max = radians(20.0);
    let first = |s: &Survey| fly(s)[0].pulses[0];
    close(first(&s).attitude.forward(), [0.0, -0.342020, -0.939693], 1e-6);
    s.legs[0].scanner.head_rate = radians(3000.0);
    s.scanner.devices[0].beam_origin.rotation = Rotation::about_y(radians(10.0));
    let turned = Rotation::about_z(radians(-90.0))
        .after(m)
        .after(Rotation::about_z(radians(30.0)).after(Rotation::about_y(radians(10.0))))
        .after(Rotation::about_x(radians(-20.0)));
    assert!((first(&s).attitude.forward() - turned.forward()).length() < 1e-9);
}

#[test]
fn offsets_are_in_world_axes_unless_they_turn_with_the_mount() {
    let legs = vec![leg([0.0; 3], 30.0, |_| {}), leg([100.0, 0.0, 0.0], 30.0, |_| {})];
    let mut s =
        survey(PlatformKind::LinearPath, mount([0.0, 1.0, 0.5]), Deflector::Fibres { count: 1 }, legs);
    s.scanner.devices[0].beam_origin.offset = DVec3::new(0.0, 0.25, 0.0);
    for (rotate, expected) in [(false, [0.0, 1.25, 0.5]), (true, [1.25, 0.0, 0.5])] {
        let kinematics = Corrections { mount_offsets_turn: rotate, ..Corrections::NONE };
        let flown = fly_plan(&plan_with(&s, FlightOptions { kinematics, ..Default::default() }));
        close(flown[0].pulses[0].origin, expected, 1e-7);
    }
}

#[test]
fn mechanical_errors_separate_the_traced_from_the_exact_beam() {
    let scan = |l: &mut Leg| {
        lines(l);
        turn_head(l, 36.0, 9.0);
    };
    let mut s = tripod(vec![leg([0.0; 3], 0.0, scan)]);
    let plain = fly(&s);
    let errors = &mut s.scanner.devices[0].errors;
    errors.range = Some(Formula::parse("0.5*THETA").unwrap());
    errors.head = Some((Formula::parse("0.1*THETA").unwrap(), radians(1.0)));
    let noise = Noise { kind: NoiseKind::Normal { mean: 0.0, stdev: 0.01 }, clip: None, lifespan: 1 };
    s.platform.noise.attitude[0] = Some(noise);
    let disturbed = fly(&s);
    for (a, b) in plain[0].pulses.iter().zip(&disturbed[0].pulses) {
        assert_eq!(a.exact_attitude, b.exact_attitude);
        assert_eq!(a.attitude, a.exact_attitude);
        assert_ne!(b.attitude, b.exact_attitude);
        assert_eq!(b.range_error, 0.5 * b.scan_angle);
    }
}

#[test]
fn channels_fire_together() {
    // §8: base beamOrigin (0,0.3,0.2) + rot y 10°; channel b (1,2,3) + rot z 90°
    let scan = |l: &mut Leg| {
        lines(l);
        turn_head(l, 36.0, 9.0);
    };
    let mut s = tripod(vec![leg([0.0; 3], 0.0, scan)]);
    let base = &mut s.scanner.devices[0];
    base.beam_origin.rotation = Rotation::about_y(radians(10.0));
    let mut b = base.clone();
    b.beam_origin = Mount { offset: DVec3::new(1.0, 2.0, 3.0), rotation: Rotation::about_z(radians(90.0)) };
    s.scanner.devices.push(b);
    s.scanner.multi_channel = true;
    let pulses = &fly(&s)[0].pulses;
    assert_eq!((pulses[0].number, pulses[0].device, pulses[1].number, pulses[1].device), (1, 0, 1, 1));
    assert_eq!(pulses[0].time_ns, pulses[1].time_ns);
    close(pulses[0].origin, [0.0, 0.3, 1.7], 1e-12);
    close(pulses[0].attitude.forward(), [0.0649, 0.9140, 0.4006], 6e-5);
    close(pulses[1].origin, [1.0, 2.0, 4.5], 1e-12);
    close(pulses[1].attitude.forward(), [-0.9135, -0.0057, 0.4067], 6e-5);
}

#[test]
fn trajectory_samples() {
    // §9: interval 0.05 s, 26 steps: six samples; the next leg begins with a new one
    let scan = |l: &mut Leg| {
        turn_head(l, 36.0, 9.0);
        l.scanner.trajectory_interval = 0.05;
    };
    let flown = fly(&tripod(vec![leg([1.0, 2.0, 3.0], 0.0, scan), leg([1.0, 2.0, 3.0], 0.0, scan)]));
    let times: Vec<f64> =
        flown[0].poses.iter().map(|p| ((p.time_ns - START_NS) * 1e-9 * 100.0).round()).collect();
    assert_eq!(times, [0.0, 5.0, 10.0, 15.0, 20.0, 25.0]);
    assert_eq!(flown[1].poses[0].time_ns, START_NS + 0.26e9);
    let p = flown[0].poses[0];
    assert_eq!((p.position, p.pitch), (DVec3::new(1.0, 2.0, 3.0), 0.0));
    assert!(p.roll == 0.0 && p.roll.is_sign_negative() && p.yaw == 0.0 && p.yaw.is_sign_negative());
}

#[test]
fn interpolated_trajectory() {
    // §2.8 example 5
    let legs = vec![
        recorded_leg(100.5, 101.5, false),
        recorded_leg(103.0, 104.0, false),
        recorded_leg(100.0, 101.0, true),
    ];
    let (s, _dir) = recorded(0.0, true, legs);
    let (plan, _) = plan_of(&s).unwrap();
    assert_eq!(plan.leg_count(), 7);
    let numbers: Vec<u32> = plan.legs.iter().map(|l| l.number).collect();
    assert_eq!(numbers, [0, 0, 1, 1, 2, 2, 2]);
    let flown = fly(&s);
    let xs = |leg: usize| -> Vec<f64> { flown[leg].pulses.iter().map(|p| p.origin.x).collect() };
    let check = |found: Vec<f64>, from: i32, count: i32| {
        assert_eq!(found.len(), count as usize);
        for (f, w) in found.iter().zip(from..) {
            assert!((f - f64::from(w)).abs() < 1e-9, "{f} is not {w}");
        }
    };
    check(xs(0), 5, 10);
    check(xs(2), 33, 9);
    check(xs(5), 4, 9);
    for (pose, expected) in flown[2].poses.iter().zip([238.0, 254.0, 270.0]) {
        assert!((degrees(pose.yaw) - expected).abs() < 1e-9, "{}", degrees(pose.yaw));
    }
    assert_eq!(flown[0].pulses[0].time_ns, 100.5e9);
}

#[test]
fn a_first_leg_with_teleport_starts_one_step_late() {
    let (s, _dir) = recorded(0.0, false, vec![recorded_leg(100.5, 101.5, true)]);
    let flown = fly(&s);
    assert!((flown[1].pulses[0].origin.x - 6.0).abs() < 1e-9);
    assert_eq!(flown[1].pulses[0].time_ns, START_NS);
}

#[test]
fn a_leg_beyond_the_table_is_extrapolated_with_a_warning() {
    let (s, _dir) = recorded(0.0, false, vec![recorded_leg(103.0, 106.0, false)]);
    let (_, warnings) = plan_of(&s).unwrap();
    assert!(warnings.text().contains("the first and last poses are extrapolated"));
    let last = fly(&s)[0].pulses.last().unwrap().origin.x;
    assert!((last - 59.0).abs() < 1e-9, "{last}");
}

#[test]
fn an_aerial_polygon_over_a_climbing_path() {
    // A survey flown by the reference: pulse number, time after the start in ns, origin, direction.
    let golden = [
        (1, 0.0, [-9.3000, -2.1000, 42.2000], [-0.0044, 0.0151, -0.9999]),
        (2, 200_000.0, [-9.2973, -2.0992, 42.2002], [-0.0088, 0.0302, -0.9995]),
        (500, 113_000_000.0, [-7.7849, -1.6590, 42.3131], [0.1423, -0.4888, -0.8607]),
        (1000, 224_000_000.0, [-6.2966, -1.2259, 42.4241], [-0.0905, 0.3110, -0.9461]),
    ];
    let down = Mount {
        offset: DVec3::new(0.0, 0.0, 0.2),
        rotation: Rotation::about_z(radians(90.0)).after(Rotation::about_x(radians(-90.0))),
    };
    let scan = |l: &mut Leg| (l.scanner.pulse_freq, l.scanner.scan_freq) = (5000, 50.0);
    let legs =
        vec![leg([-9.3, -2.1, 42.0], 14.0, scan), leg([4.1, 1.8, 43.0], 14.0, |l| l.scanner.active = false)];
    let optics = Deflector::Polygon { effective_max: radians(40.0), facet_tilts: Vec::new() };
    let mut s = survey(PlatformKind::LinearPath, down, optics, legs);
    s.scanner.devices[0].scan_angle_max = radians(45.0);
    let pulses = &fly(&s)[0].pulses;
    for (number, time, origin, direction) in golden {
        let pulse = &pulses[number - 1];
        assert_eq!((pulse.number, pulse.time_ns - START_NS), (number as u64, time));
        close(pulse.origin, origin, 1e-4);
        close(pulse.attitude.forward(), direction, 1e-4);
    }
}
