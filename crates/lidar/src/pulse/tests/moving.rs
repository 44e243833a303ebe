//! Pulses over a scene in which something moves (spec pulse-physics §6).

use super::*;
use crate::pulse::{Physics, PulseSimulator};
use vlscan_scene::{DynamicScene, MotionPlan, MotionState, MovingPart, ObjectUpdate, Twist};
use vlscan_survey::*;
use vlscan_trace::{BuildOptions, Tree};

/// A plate 100 m away that moves by `by` along y after every pulse, before a wall at 120 m; five pulses along
/// +y.
fn echoes(by: f64, options: PhysicsOptions) -> Vec<(f64, u32)> {
    let mut scene = rectangles(half_white(), &[wall(-20.0, 20.0, 100.0), wall(-20.0, 20.0, 120.0)]);
    let survey = tls();
    let motion =
        Motion { kind: MotionKind::Translation { by: DVec3::Y * by }, about_self: false, auto_crs: 0.0 };
    scene.dyn_step = 1;
    scene.moving_parts = vec![MovingPart {
        part: 0,
        vertices: 0..4,
        triangles: 0..2,
        cubes: 0..0,
        motions: vec![MotionSequence { id: "m".to_owned(), loops: 0, next: None, motions: vec![motion] }],
        timing: MotionTiming { dyn_step: 1, tree_step: 1, dyn_time_step: None, tree_time_step: None },
    }];
    let plan = MotionPlan::new(&scene, 1000.0).unwrap();
    let tree = Tree::build_where(&scene.geometry, &BuildOptions::default(), |i| scene.is_still(i));
    let physics = Physics::new(&scene, &tree, &survey, options).unwrap();
    let pulses: Vec<_> = pulses(5).iter().map(|p| in_frame(&scene, p)).collect();
    let (mut state, mut changes) = (MotionState::start(&plan), Vec::new());
    for before in 1..=pulses.len() {
        state.step(&plan, |object, transform| {
            changes.push(ObjectUpdate {
                first_pulse: before,
                object,
                transform: *transform,
                twist: Twist::ZERO,
            })
        });
    }
    let mut dynamic = DynamicScene::new(&plan, BuildOptions::default());
    let mut batch = Batch::default();
    PulseSimulator::new(&physics).simulate_dynamic(0, &pulses, &mut dynamic, &changes, &mut batch).unwrap();
    assert_eq!(batch.echoes.len(), 5);
    batch.echoes.iter().map(|e| (e.range, e.primitive)).collect()
}

fn ranges(by: f64, options: PhysicsOptions) -> Vec<f64> {
    echoes(by, options).iter().map(|e| e.0).collect()
}

fn assert_ranges(found: &[f64], expected: [f64; 5]) {
    let close = found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-9);
    assert!(close, "{found:?} is not {expected:?}");
}

#[test]
fn pulse_m_sees_m_minus_1_motions() {
    assert_ranges(&ranges(0.5, legacy()), [100.0, 100.5, 101.0, 101.5, 102.0]);
}

#[test]
fn what_leaves_the_first_box_is_invisible_unless_corrected() {
    assert_ranges(&ranges(-0.5, legacy()), [100.0, 120.0, 120.0, 120.0, 120.0]);
    let unbounded = with(legacy(), "unbounded_scene");
    assert_ranges(&ranges(-0.5, unbounded), [100.0, 99.5, 99.0, 98.5, 98.0]);
}

#[test]
fn of_equally_near_primitives_the_smaller_number_is_hit_whether_it_moves_or_not() {
    // The plate reaches the wall, whose triangles have greater numbers, and goes through it.
    let found = echoes(10.0, with(legacy(), "unbounded_scene"));
    let is_plate: Vec<bool> = found.iter().map(|(_, primitive)| *primitive < 2).collect();
    assert_eq!(is_plate, [true, true, true, false, false], "{found:?}");
}
