//! Golden sequences of multicopters (spec kinematics §2.5, §11.3).

use super::*;
use crate::platform::course::reported_angles;
use crate::platform::testing::{MULTICOPTER, course, entry};

fn golden_legs(change: impl Fn(&mut LegCourse)) -> [LegCourse; 4] {
    let legs = [
        ([0.0, 0.0, 50.0], 8.0),
        ([40.0, 10.0, 52.0], 8.0),
        ([20.0, 50.0, 48.0], 5.0),
        ([20.0, 90.0, 48.0], 8.0),
    ];
    legs.map(|(p, speed)| {
        let mut leg = course(p, speed);
        change(&mut leg);
        leg
    })
}

/// Flies the legs until they end or `limit` steps have passed: per leg and step position, pitch and yaw in
/// degrees.
fn fly(legs: &[LegCourse], limit: usize) -> Vec<Vec<(DVec3, f64, f64)>> {
    let plan = MulticopterPlan::new(MULTICOPTER, legs[0].frequency);
    let mut copter = MulticopterState::default();
    let mut flown = Vec::new();
    for leg in 0..legs.len() {
        copter.start_leg(&plan, legs, leg, entry(leg), &Corrections::NONE);
        let mut rows = Vec::new();
        while rows.len() < limit && !copter.check_arrival(&legs[leg]) {
            copter.step(&plan, &legs[leg]);
            let [_, pitch, yaw] = reported_angles(copter.attitude(), None);
            rows.push((copter.course.position, pitch.to_degrees(), yaw.to_degrees()));
        }
        flown.push(rows);
    }
    flown
}

#[test]
fn golden_run() {
    // spec kinematics §11.3: leg, step, position, pitch and yaw of stop-and-turn, of the variant without
    type Row = (usize, usize, [f64; 3], [f64; 2], [f64; 2]);
    let golden: [Row; 10] = [
        (0, 0, [0.0, 0.0, 50.0], [-0.8594, 284.0362], [29.1406, 284.0362]),
        (0, 1, [0.0, 0.0, 50.0010], [-1.7188, 284.0362], [28.2812, 284.0362]),
        (0, 100, [0.0084, 0.0021, 53.3168], [-40.0, 284.0362], [-40.0, 284.0362]),
        (0, 348, [1.6499, 0.4125, 54.4945], [-40.0, 284.0362], [-40.0, 284.0362]),
        (0, 500, [11.2820, 2.8205, 53.0010], [-5.6240, 284.0362], [-5.6240, 284.0362]),
        (0, 870, [39.9721, 9.9930, 52.0043], [-5.6240, 284.0362], [-5.6240, 284.0362]),
        (1, 0, [40.0497, 10.0124, 52.0048], [-0.8594, 26.5651], [-6.4834, 284.8956]),
        (1, 99, [43.0971, 14.4112, 51.3331], [-5.1564, 26.5651], [-5.6240, 9.9762]),
        (1, 299, [36.7156, 28.0841, 49.1173], [-5.1564, 26.5651], [-5.6240, 34.0191]),
        (1, 644, [20.0165, 50.0131, 48.0359], [-4.2970, 26.5651], [-4.7646, 34.0191]),
    ];
    let stopping = fly(&golden_legs(|_| {}), 5000);
    let going = fly(&golden_legs(|l| l.stop_and_turn = false), 5000);
    for (variant, flown) in [&stopping, &going].into_iter().enumerate() {
        let steps: Vec<usize> = flown.iter().map(Vec::len).collect();
        assert_eq!(steps, [871, 645, 806, 0], "variant {variant}");
        for (leg, step, position, stop, go) in golden {
            let (p, pitch, yaw) = flown[leg][step];
            let expected = if variant == 0 { stop } else { go };
            let off = (p - DVec3::from(position)).abs().max_element();
            assert!(off < 1e-4, "variant {variant} leg {leg} step {step}: {p}");
            assert!((pitch - expected[0]).abs() < 1e-4, "variant {variant} leg {leg} step {step}: {pitch}");
            assert!((yaw - expected[1]).abs() < 1e-4, "variant {variant} leg {leg} step {step}: {yaw}");
        }
    }
    let smooth = fly(&golden_legs(|l| (l.stop_and_turn, l.smooth_turn) = (false, true)), 20_000);
    assert_eq!(smooth[0].len(), 871);
    assert!((smooth[0][500].0 - going[0][500].0).length() < 1e-9 && smooth[0][500].1 == going[0][500].1);
    assert_eq!(smooth[1].len(), 20_000, "a smooth turn that misses the waypoint does not end");
}

#[test]
fn braking_distance_depends_on_the_pulse_frequency() {
    // spec kinematics §2.5.5
    for (frequency, expected) in [(100.0, 0.004949), (1000.0, 0.0495), (100_000.0, 4.8426)] {
        let legs = golden_legs(|l| (l.frequency, l.step_length) = (frequency, 8.0 / frequency));
        let plan = MulticopterPlan::new(MULTICOPTER, frequency);
        let mut copter = MulticopterState::default();
        copter.start_leg(&plan, &legs, 0, entry(0), &Corrections::NONE);
        let found = copter.slow_distance;
        assert!((found / expected - 1.0).abs() < 1e-3, "{frequency} Hz: {found}");
    }
}

#[test]
fn the_beam_lags_one_step_behind_the_yaw() {
    // spec kinematics §2.8 example 4
    let legs = golden_legs(|_| {});
    let plan = MulticopterPlan::new(MULTICOPTER, 100.0);
    let mut copter = MulticopterState::default();
    copter.start_leg(&plan, &legs, 0, entry(0), &Corrections::NONE);
    assert!((copter.yaw.to_degrees() + 75.963757).abs() < 1e-6);
    copter.step(&plan, &legs[0]);
    assert_eq!(copter.mount_pointing.forward(), DVec3::Y);
    let expected = DVec3::new(9.89545e-7, 2.47386e-7, 0.001);
    assert!((copter.course.velocity - expected).abs().max_element() < 1e-12);
    assert!((copter.force.length() - 0.000102).abs() < 1e-15);
    copter.step(&plan, &legs[0]);
    assert!((copter.mount_pointing.forward() - DVec3::new(0.970143, 0.242536, 0.0)).length() < 1e-6);
    assert!((copter.force.length() - 0.00010404).abs() < 1e-15);
}

#[test]
fn smooth_turns() {
    // A survey of three legs at 2 kHz, flown by the reference: leg, step, position, roll, pitch, yaw.
    let mut legs = [[-22.0, -11.0], [18.0, -13.0], [21.0, 16.0], [3.0, 21.0]].map(|[x, y]| LegCourse {
        frequency: 2000.0,
        step_length: 6.0 / 2000.0,
        stop_and_turn: false,
        smooth_turn: true,
        ..course([x, y, 45.0], 6.0)
    });
    for leg in &mut legs[2..] {
        (leg.smooth_turn, leg.slowdown) = (false, false);
    }
    let golden = [
        (0, 0, [-22.0, -11.0, 45.0], [0.0, 29.9570, 267.1376]),
        (0, 4000, [-21.7571, -11.0121, 45.0019], [0.0, -40.0, 267.1376]),
        (0, 8000, [-14.4948, -11.3753, 45.0008], [0.0, -4.9794, 267.1376]),
        (0, 18500, [16.9659, -12.9483, 45.0002], [0.0, -4.9794, 267.1376]),
        (1, 0, [18.0026, -13.0001, 45.0001], [0.3152, -4.0341, 268.1689]),
        (1, 4000, [22.0389, -3.6076, 45.0001], [0.0, -4.9794, 3.0094]),
        (1, 12000, [19.4953, 18.9944, 45.0], [21.1437, 30.0, 66.4760]),
        (1, 14000, [18.4555, 19.3265, 45.0], [0.0, 30.0, 74.4685]),
        (2, 0, [18.4017, 19.3415, 45.0], [0.0, 29.9570, 74.5544]),
        (2, 4000, [13.8893, 19.8287, 45.0], [0.0, -34.5428, 83.8599]),
        (2, 7500, [3.4495, 20.9516, 45.0], [0.0, -4.9794, 83.8599]),
    ];
    let plan = MulticopterPlan::new(MULTICOPTER, 2000.0);
    let mut copter = MulticopterState::default();
    let mut steps = [0; 3];
    for leg in 0..3 {
        copter.start_leg(&plan, &legs, leg, entry(leg), &Corrections::NONE);
        while !copter.check_arrival(&legs[leg]) && steps[leg] < 100_000 {
            copter.step(&plan, &legs[leg]);
            for (_, step, position, angles) in golden.iter().filter(|g| (g.0, g.1) == (leg, steps[leg])) {
                let off = (copter.course.position - DVec3::from(*position)).abs().max_element();
                assert!(off < 2e-4, "leg {leg} step {step}: {}", copter.course.position);
                let found = reported_angles(copter.attitude(), None).map(f64::to_degrees);
                for (f, w) in found.iter().zip(angles) {
                    assert!((f - w).abs() < 2e-4, "leg {leg} step {step}: {found:?}");
                }
            }
            steps[leg] += 1;
        }
    }
    assert_eq!(steps[..2], [18_846, 14_394]);
}
