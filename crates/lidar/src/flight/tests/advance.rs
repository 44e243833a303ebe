//! Many steps at once are those of single steps.

use crate::flight::clock::WEEK_NS;
use crate::flight::testing::*;
use crate::flight::{FlightOptions, FlightPlan, FlightState, Step};
use crate::platform::Pose;
use proptest::prelude::*;
use std::sync::Arc;
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, Rotation, radians};
use vlscan_survey::*;

/// Flies `plan` in steps of up to `limits` at once and, beside it, in single steps. Returns the fraction of
/// the steps that were taken at once.
fn compare(plan: &FlightPlan, limits: &[u32], feed: impl Fn(&mut FlightState)) -> f64 {
    let (mut quick, mut single) = (FlightState::start(plan), FlightState::start(plan));
    feed(&mut quick);
    feed(&mut single);
    let (mut at_once, mut all) = (0u64, 0u64);
    for &limit in limits.iter().cycle() {
        let (steps, pulses) = quick.advance(plan, limit);
        let mut count = Count::default();
        for _ in 0..steps {
            assert_eq!(single.step(plan, &mut count).unwrap(), Step::Advanced);
        }
        assert_eq!((count.pulses, count.poses), (u64::from(pulses), 0));
        assert_eq!(format!("{quick:?}"), format!("{single:?}"), "after {steps} steps at once");
        let step = quick.step(plan, &mut Count::default());
        let expected = single.step(plan, &mut Count::default());
        assert_eq!(format!("{step:?}"), format!("{expected:?}"));
        (at_once, all) = (at_once + u64::from(steps), all + u64::from(steps) + 1);
        // A leg between equal waypoints is an error of its first step.
        let Ok(step) = step else { return at_once as f64 / all as f64 };
        match step {
            Step::Ended => return at_once as f64 / all as f64,
            Step::NeedsPoses => {
                quick.end_poses();
                single.end_poses();
            }
            Step::Advanced | Step::LegChanged => {}
        }
    }
    unreachable!("the limits repeat")
}

#[test]
fn streamed_flights_advance_as_in_single_steps() {
    for max_gap in [0.4, f64::INFINITY] {
        let mut s = along(PlatformKind::LinearPath, &[[0.0; 3]], 3000, 1, |l| l.platform.speed = 0.0);
        s.platform.kind = PlatformKind::Stream(PoseStream { max_gap, ..PoseStream::at("-") });
        for kinematics in [Corrections::NONE, Corrections::MOTION] {
            let poses: Vec<Pose> = [0.0, 0.1, 0.3, 0.65, 1.2, 1.3, 1.5]
                .map(|t| Pose { time: 604_799.0 + t, position: DVec3::X * t, attitude: Rotation::about_z(t) })
                .to_vec();
            let plan = planned(&s, kinematics, START_NS);
            let at_once = compare(&plan, &[200, 31], |state| state.feed(&plan, poses.clone()));
            assert!(at_once > 0.8, "{at_once}");
        }
    }
}

/// A table of five beams in seven steps.
fn table() -> Deflector {
    let beam = |step: u32| PatternBeam {
        step,
        azimuth: 0.1 * f64::from(step),
        elevation: -0.05 * f64::from(step),
        origin: DVec3::ZERO,
    };
    let beams: Vec<PatternBeam> = [0, 1, 3, 4, 6].map(beam).to_vec();
    Deflector::Pattern(Arc::new(PatternTable::new(&beams, 7, true)))
}

fn deflectors() -> [Deflector; 7] {
    let prism = |rotor_freq: f64, degrees: f64| Prism { rotor_freq, angle: radians(degrees), index: 1.5 };
    let risley = |steep: f64| Deflector::Risley {
        prisms: vec![prism(-10.0, steep), prism(7.0, -18.0)],
        air: 1.0,
        incident: DVec3::Y,
    };
    [
        polygon(),
        Deflector::Oscillating { scan_product: 1e6 },
        Deflector::Conic,
        Deflector::Fibres { count: 7 },
        risley(18.0),
        risley(-44.0),
        table(),
    ]
}

/// A survey of `kind` at `frequency` Hz along `points`, with two devices.
fn along(
    kind: PlatformKind,
    points: &[[f64; 3]],
    frequency: u32,
    deflector: usize,
    change: impl Fn(&mut Leg),
) -> Survey {
    let legs = points.iter().map(|p| {
        leg(*p, 10.0, |l| {
            l.scanner.pulse_freq = frequency;
            (l.scanner.scan_freq, l.scanner.scan_angle) = (f64::from(frequency) / 160.0, radians(60.0));
            change(l);
        })
    });
    let mut s = survey(kind, Mount::IDENTITY, deflectors()[deflector % 7].clone(), legs.collect());
    s.scanner.pulse_freqs = vec![frequency];
    let mut second = s.scanner.devices[0].clone();
    second.deflector = deflectors()[(deflector + 1) % 7].clone();
    s.scanner.devices.push(second);
    s
}

fn planned(survey: &Survey, kinematics: Corrections, start_ns: f64) -> FlightPlan {
    plan_with(survey, FlightOptions { kinematics, gps_start_ns: start_ns, ..options() })
}

#[test]
fn oblique_legs_of_many_steps_are_those_of_single_steps() {
    // Where increments alternate in their last bit, steps are taken one by one.
    let points = [[0.0, 0.0, 300.0], [30.0, 17.0, 300.0], [-28.3, 17.07, 301.3], [-28.3, -20.0, 301.3]];
    for kinematics in [Corrections::NONE, Corrections::MOTION] {
        let s = along(PlatformKind::LinearPath, &points, 20_000, 0, |_| {});
        let at_once = compare(&planned(&s, kinematics, START_NS), &[1024, 3000, 17, 1], |_| ());
        assert!(at_once > 0.95, "{at_once}");
    }
}

#[test]
fn every_deflector_advances_as_in_single_steps() {
    for deflector in 0..7 {
        for kinematics in [Corrections::NONE, Corrections::MOTION] {
            let s = along(PlatformKind::LinearPath, &[[0.0; 3], [3.0, 4.0, 0.0]], 3000, deflector, |l| {
                l.scanner.warmup = 0.01;
            });
            let at_once = compare(&planned(&s, kinematics, START_NS), &[64, 500], |_| ());
            assert!(at_once > 0.9, "{deflector}: {at_once}");
        }
    }
}

#[test]
fn heads_samples_durations_and_the_end_of_the_week_are_single_steps() {
    let s = along(PlatformKind::Static, &[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 2000, 0, |l| {
        turn_head(l, 36.0, 50.0);
        l.scanner.trajectory_interval = 0.11;
    });
    assert!(compare(&planned(&s, Corrections::NONE, WEEK_NS - 0.7e9), &[400, 90], |_| ()) > 0.9);
    let s = along(PlatformKind::Static, &[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 2000, 3, |l| {
        l.scanner.max_duration = Some(1.3);
    });
    for kinematics in [Corrections::NONE, Corrections::MOTION] {
        assert!(compare(&planned(&s, kinematics, START_NS), &[400, 90], |_| ()) > 0.9);
    }
}

#[test]
fn recorded_flights_advance_as_in_single_steps() {
    let legs = [(100.2, 103.5), (101.0, 104.0)].map(|(start, end)| recorded_leg(start, end, false));
    let (mut s, _folder) = recorded(10.0, true, legs.to_vec());
    s.legs.iter_mut().for_each(|leg| {
        (leg.scanner.pulse_freq, leg.scanner.trajectory_interval) = (1000, 0.3);
    });
    // In the reference the steps keep the rate of the first leg.
    s.legs[1].scanner.pulse_freq = 3000;
    for kinematics in [Corrections::NONE, Corrections::MOTION] {
        assert!(compare(&planned(&s, kinematics, START_NS), &[300, 70], |_| ()) > 0.9);
    }
}

/// Gives a survey a wander, pulse times that repeat, or recorded ones, of `rate` on average and with a gap.
fn make_timed(s: &mut Survey, kind: usize, rate: f64) {
    let intervals = [0.54, 0.66, 0.84, 1.2, 0.3, 2.46].map(|share| share / rate);
    for device in s.scanner.devices.iter_mut().filter(|_| kind != 1) {
        device.scan_motion.wander = Some(Wander::Sine { amplitude: 0.3, freq: 5.0, phase: 1.0 });
    }
    let recorded = || {
        let cycle = PulseTimes::of_intervals(&intervals);
        let late = |k: u64| if k > 700 { 0.2 } else { 0.003 };
        PulseTimes::Recorded((0..1500).map(|k| cycle.at(k) + late(k)).collect())
    };
    for leg in s.legs.iter_mut().filter(|_| kind > 0) {
        let times = if kind == 1 { PulseTimes::of_intervals(&intervals) } else { recorded() };
        leg.scanner.pulse_freq = times.mean_rate().round() as u32;
        leg.scanner.pulse_times = Some(times);
    }
}

#[test]
fn functions_of_time_advance_as_in_single_steps() {
    for kind in 0..3 {
        for deflector in 0..7 {
            for kinematics in [Corrections::NONE, Corrections::MOTION] {
                let mut flown = along(
                    PlatformKind::LinearPath,
                    &[[0.0; 3], [3.0, 4.0, 0.0], [9.0, 4.0, 0.0]],
                    2000,
                    deflector,
                    |l| {
                        (l.scanner.warmup, l.scanner.trajectory_interval) = (0.01, 0.07);
                    },
                );
                make_timed(&mut flown, kind, 2000.0);
                let mut still =
                    along(PlatformKind::Static, &[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 2000, deflector, |l| {
                        turn_head(l, 36.0, 30.0);
                    });
                make_timed(&mut still, kind, 2000.0);
                let legs =
                    [(100.2, 101.5), (101.0, 102.0)].map(|(start, end)| recorded_leg(start, end, false));
                let (mut followed, _folder) = recorded(10.0, true, legs.to_vec());
                for leg in &mut followed.legs {
                    (leg.scanner.pulse_freq, leg.scanner.trajectory_interval) = (1000, 0.3);
                }
                make_timed(&mut followed, kind, 1000.0);
                for survey in [flown, still, followed] {
                    let at_once = compare(&planned(&survey, kinematics, START_NS), &[300, 41], |_| ());
                    assert!(at_once > 0.7, "{kind} {deflector}: {at_once}");
                }
                let mut s =
                    along(PlatformKind::LinearPath, &[[0.0; 3]], 2000, deflector, |l| l.platform.speed = 0.0);
                s.platform.kind = PlatformKind::Stream(PoseStream { max_gap: 0.4, ..PoseStream::at("-") });
                make_timed(&mut s, kind, 2000.0);
                let poses: Vec<Pose> = [0.0, 0.1, 0.3, 0.65, 1.2, 1.3, 1.5]
                    .map(|t| Pose {
                        time: 604_799.0 + t,
                        position: DVec3::X * t,
                        attitude: Rotation::about_z(t),
                    })
                    .to_vec();
                let plan = planned(&s, kinematics, START_NS);
                let at_once = compare(&plan, &[200, 31], |state| state.feed(&plan, poses.clone()));
                assert!(at_once > 0.7, "{kind} {deflector}: {at_once}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn random_flights_advance_as_in_single_steps(
        points in prop::collection::vec(prop::array::uniform3(-400.0..400.0f64), 2..4),
        round in any::<bool>(),
        speed in 5.0..300.0f64,
        frequency in 200..6000u32,
        deflector in 0..7usize,
        corrected in any::<bool>(),
        limits in prop::collection::vec(1..4000u32, 1..6),
    ) {
        let points: Vec<[f64; 3]> = points
            .into_iter()
            .map(|p| if round { p.map(|c| (c / 100.0).round() * 100.0) } else { p })
            .collect();
        let s = along(PlatformKind::LinearPath, &points, frequency, deflector, |l| l.platform.speed = speed);
        let kinematics = if corrected { Corrections::MOTION } else { Corrections::NONE };
        if let Ok((plan, _)) = FlightPlan::new(
            &s,
            DVec3::ZERO,
            &|_, _| None,
            &FlightOptions { kinematics, ..options() },
        ) {
            compare(&plan, &limits, |_| ());
        }
    }
}
