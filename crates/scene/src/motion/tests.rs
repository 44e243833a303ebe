//! Motions, sequences and timing.

use super::*;
use crate::Scene;
use crate::fixture::Fixture;
use vlscan_geom::{Affine, DVec3, radians};
use vlscan_survey::{Motion, MotionKind, MotionSequence, MotionTiming, SceneRecipe};
use vlscan_trace::BuildOptions;

/// A part whose box is centred at (2, 2, 2), unlike its corners.
const PART: &str = "v 1 1 1\nv 3 1 1\nv 3 3 1\nv 1 1 3\nf 1 2 3\nf 1 2 4\n";
/// A part around the origin, so that the scene's shift is 0.
const ROOM: &str = "v -9 -9 -9\nv 9 9 9\nv 9 -9 -9\nf 1 2 3\n";

fn motion(kind: MotionKind) -> Motion {
    Motion { kind, about_self: false, auto_crs: 0.0 }
}

fn sequence(loops: u32, next: Option<usize>, motions: &[Motion]) -> MotionSequence {
    MotionSequence { id: "m".to_owned(), loops, next, motions: motions.to_vec() }
}

fn shift(by: DVec3) -> Motion {
    motion(MotionKind::Translation { by })
}

fn moving(sequences: Vec<MotionSequence>) -> (SceneRecipe, Scene) {
    let mut f = Fixture::new();
    f.obj("room.obj", ROOM);
    f.obj("part.obj", PART).motions = sequences;
    (f.recipe(), f.scene())
}

/// World position of the corner (3, 3, 1) of the part, as hit by rays, before the first step and after each
/// of `steps`.
fn corners(recipe: &SceneRecipe, scene: &Scene, steps: usize) -> Vec<DVec3> {
    let part = recipe.parts[1].timing;
    let mut scene = scene.clone();
    (scene.dyn_step, scene.dyn_time_step, scene.moving_parts[0].timing) =
        (recipe.dyn_step, recipe.dyn_time_step, part);
    let plan = MotionPlan::new(&scene, 1000.0).unwrap();
    let mut state = MotionState::start(&plan);
    let mut dynamic = DynamicScene::new(&plan, BuildOptions::default());
    let corner = |dynamic: &mut DynamicScene| dynamic.rebuild_moved()[0].scene.geometry.vertices[2];
    let mut seen = vec![corner(&mut dynamic)];
    for _ in 0..steps {
        state.step(&plan, |object, transform| {
            dynamic.apply(&ObjectUpdate { first_pulse: 0, object, transform: *transform, twist: Twist::ZERO })
        });
        seen.push(corner(&mut dynamic));
    }
    dynamic.set_state(&state);
    assert_eq!(Some(&corner(&mut dynamic)), seen.last(), "a state shows what its steps showed");
    seen
}

fn after_one(motion: Motion) -> DVec3 {
    let (recipe, scene) = moving(vec![sequence(0, None, &[motion])]);
    corners(&recipe, &scene, 1)[1]
}

#[test]
fn every_motion_does_what_its_name_says() {
    use MotionKind::*;
    let quarter = radians(90.0);
    let close = |kind, expected: [f64; 3]| {
        let found = after_one(motion(kind));
        assert!((found - DVec3::from(expected)).length() < 1e-12, "{kind:?}: {found}");
    };
    let z = DVec3::Z;
    close(Identity, [3.0, 3.0, 1.0]);
    close(Translation { by: DVec3::new(1.0, 2.0, 3.0) }, [4.0, 5.0, 4.0]);
    close(Rotation { axis: z, angle: quarter, centre: None }, [-3.0, 3.0, 1.0]);
    close(Rotation { axis: z, angle: quarter, centre: Some(DVec3::X) }, [-2.0, 2.0, 1.0]);
    close(Reflection { normal: z }, [3.0, 3.0, -1.0]);
    close(GlidePlane { normal: z, shift: DVec3::X }, [4.0, 3.0, -1.0]);
    close(Helical { axis: z, angle: quarter, glide: 5.0 }, [-3.0, 3.0, 6.0]);
    close(RotaryReflection { axis: z, angle: quarter, centre: None }, [-3.0, 3.0, -1.0]);
    close(RotaryReflection { axis: z, angle: quarter, centre: Some(z) }, [-3.0, 3.0, 1.0]);
}

#[test]
fn a_part_turns_about_the_centre_of_its_first_box_wherever_it_has_gone() {
    let half = MotionKind::Rotation { axis: DVec3::Z, angle: radians(180.0), centre: None };
    let turn = Motion { about_self: true, ..motion(half) };
    assert!((after_one(turn) - DVec3::ONE).length() < 1e-12);
    let (recipe, scene) = moving(vec![sequence(0, None, &[turn, shift(DVec3::X * 10.0)])]);
    let found = corners(&recipe, &scene, 2);
    assert!((found[1] - DVec3::new(11.0, 1.0, 1.0)).length() < 1e-12, "{}", found[1]);
    assert!((found[2] - DVec3::new(23.0, 3.0, 1.0)).length() < 1e-12, "{}", found[2]);
}

#[test]
fn auto_crs_speaks_of_world_coordinates() {
    let mut f = Fixture::new();
    f.obj("room.obj", ROOM).transform.offset = DVec3::X * 1000.0;
    let about =
        MotionKind::Rotation { axis: DVec3::Z, angle: radians(180.0), centre: Some(DVec3::X * 1000.0) };
    let part = f.obj("part.obj", PART);
    part.transform.offset = DVec3::X * 1000.0;
    part.motions = vec![sequence(1, None, &[Motion { auto_crs: 1.0, ..motion(about) }])];
    let (recipe, scene) = (f.recipe(), f.scene());
    let corner = scene.to_world(corners(&recipe, &scene, 1)[1]);
    assert!((corner - DVec3::new(997.0, -3.0, 1.0)).length() < 1e-9, "{corner}");
}

#[test]
fn sequences_loop_and_follow_one_another() {
    let (x, y) = (shift(DVec3::X), shift(DVec3::Y));
    let seen = |sequences| -> Vec<(f64, f64)> {
        let (recipe, scene) = moving(sequences);
        corners(&recipe, &scene, 6).iter().map(|c| (c.x - 3.0, c.y - 3.0)).collect()
    };
    let stops = seen(vec![sequence(2, Some(1), &[x]), sequence(1, None, &[y, y])]);
    assert_eq!(stops, [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 2.0), (2.0, 2.0), (2.0, 2.0), (2.0, 2.0)]);
    let rounds = seen(vec![sequence(1, Some(1), &[x]), sequence(1, Some(0), &[y])]);
    assert_eq!(rounds[6], (3.0, 3.0));
    assert_eq!(seen(vec![sequence(0, Some(1), &[x]), sequence(1, None, &[y])])[6], (6.0, 0.0));
}

/// The steps among the first 30 after which the pose that rays hit has changed.
fn refreshes(change: impl Fn(&mut SceneRecipe)) -> Vec<usize> {
    let (mut recipe, scene) = moving(vec![sequence(0, None, &[shift(DVec3::X)])]);
    change(&mut recipe);
    let seen = corners(&recipe, &scene, 30);
    (1..=30).filter(|&i| seen[i] != seen[i - 1]).collect()
}

fn timing(recipe: &mut SceneRecipe) -> &mut MotionTiming {
    &mut recipe.parts[1].timing
}

#[test]
fn steps_are_counted_from_the_first_one() {
    let every = |scene: u32, part: u32, tree: u32| {
        refreshes(|r| {
            r.dyn_step = scene;
            (timing(r).dyn_step, timing(r).tree_step) = (part, tree);
        })
    };
    assert_eq!(every(1, 1, 1), (1..=30).collect::<Vec<_>>());
    assert_eq!(every(4, 1, 1), [1, 5, 9, 13, 17, 21, 25, 29]);
    assert_eq!(every(4, 2, 1), [1, 9, 17, 25]);
    assert_eq!(every(2, 3, 2), [1, 13, 25], "every second move is seen");
    assert_eq!(every(0, 1, 1), [1], "an interval of nothing fires once");
    assert_eq!(every(1, 5, 0), [1]);
}

#[test]
fn times_are_cut_down_to_steps() {
    // Arguments: time steps of the scene, the part and the tree, s; the pulse rate is 1000 Hz.
    let every = |scene: Option<f64>, part: Option<f64>, tree: Option<f64>| {
        refreshes(|r| {
            r.dyn_time_step = scene;
            (timing(r).dyn_time_step, timing(r).tree_time_step) = (part, tree);
        })
    };
    assert_eq!(every(Some(0.0109), None, None), [1, 11, 21]);
    assert_eq!(every(Some(0.002), Some(0.0099), None), [1, 9, 17, 25], "4 updates of 2 steps");
    assert_eq!(every(Some(0.002), Some(0.004), Some(0.013)), [1, 13, 25], "3 moves");
    assert_eq!(every(Some(0.0005), None, None), [1], "shorter than a period");
    assert_eq!(every(None, Some(0.01), None).len(), 30, "the scene has no time step");
}

#[test]
fn what_is_seen_late_has_moved_as_far() {
    let (mut recipe, scene) = moving(vec![sequence(0, None, &[shift(DVec3::X)])]);
    timing(&mut recipe).tree_step = 3;
    let seen: Vec<f64> = corners(&recipe, &scene, 7).iter().map(|c| c.x).collect();
    assert_eq!(seen, [3.0, 4.0, 4.0, 4.0, 7.0, 7.0, 7.0, 10.0]);
}

#[test]
fn primitives_keep_the_numbers_that_they_have_in_the_whole_scene() {
    let (_, scene) = moving(vec![sequence(0, None, &[shift(DVec3::X)])]);
    let plan = MotionPlan::new(&scene, 1.0).unwrap();
    let mut dynamic = DynamicScene::new(&plan, BuildOptions::default());
    let object = &dynamic.rebuild_moved()[0];
    assert_eq!((object.to_scene_index(0), object.to_scene_index(1)), (1, 2));
    assert_eq!([0, 1, 2, 3].map(|i| object.to_object_index(i)), [None, Some(0), Some(1), None]);
    assert_eq!([0, 1, 2].map(|i| scene.is_still(i)), [true, false, false]);
    assert_eq!(object.scene.geometry.triangle(0), scene.geometry.triangle(1));
    assert!(MotionPlan::new(&moving(Vec::new()).1, 1.0).is_none());
}

#[test]
fn parts_have_the_velocity_of_their_next_moves() {
    let turn = MotionKind::Rotation { axis: DVec3::Z, angle: 0.1, centre: None };
    let wheel = [Motion { about_self: true, ..motion(turn) }, shift(DVec3::X * 3.0)];
    let (recipe, scene) = moving(vec![sequence(2, None, &wheel)]);
    let mut scene = scene.clone();
    (scene.dyn_step, scene.moving_parts[0].timing) = (5, recipe.parts[1].timing);
    scene.moving_parts[0].timing.dyn_step = 2;
    let plan = MotionPlan::new(&scene, 1000.0).unwrap();
    let mut state = MotionState::start(&plan);
    // Ten steps for each move; the centre of the box moves along.
    for centre in [2.0, 5.0] {
        let twist = state.twist(&plan, 0);
        let at = |y: f64| twist.at(DVec3::new(centre, 2.0 + y, 0.0));
        assert!((at(0.0) - DVec3::X * 0.3).length() < 1e-14, "{}", at(0.0));
        assert!((at(1.0) - DVec3::X * 0.29).length() < 1e-14, "{}", at(1.0));
        (0..10).for_each(|_| state.step(&plan, |_, _| ()));
    }
    assert_eq!(state.twist(&plan, 0), Twist::ZERO, "the part has stopped");
}

#[test]
fn states_are_alike_wherever_they_are_replayed() {
    let turn = MotionKind::Helical { axis: DVec3::Z, angle: 0.1, glide: 0.01 };
    let (_, scene) = moving(vec![sequence(0, None, &[motion(turn)])]);
    let plan = MotionPlan::new(&scene, 1.0).unwrap();
    let mut whole = MotionState::start(&plan);
    (0..1000).for_each(|_| whole.step(&plan, |_, _| ()));
    let mut parts = MotionState::start(&plan);
    for _ in 0..10 {
        let mut copy = parts.clone();
        (0..100).for_each(|_| copy.step(&plan, |_, _| ()));
        parts = copy;
    }
    assert_eq!(whole, parts);
    let place: Vec<&Affine> = whole.seen().collect();
    assert!((place[0].shift.z - 10.0).abs() < 1e-9);
}

/// The poses of the box of the moving part before the first step and after each of some steps, at one step
/// per move.
fn boxes(sequences: Vec<MotionSequence>, steps: usize) -> (BodyBox, Vec<BodyPose>) {
    let (recipe, mut scene) = moving(sequences);
    (scene.dyn_step, scene.moving_parts[0].timing) = (1, recipe.parts[1].timing);
    let plan = MotionPlan::new(&scene, 1000.0).unwrap();
    let rest = plan.body_box(&[0]).unwrap();
    let mut state = MotionState::start(&plan);
    let mut poses = vec![state.body_pose(&plan, 0, &rest)];
    for _ in 0..steps {
        state.step(&plan, |_, _| ());
        poses.push(state.body_pose(&plan, 0, &rest));
    }
    (rest, poses)
}

#[test]
fn boxes_go_along_with_their_parts() {
    // The part has its corners at (1, 1, 1), (3, 1, 1), (3, 3, 1) and (1, 1, 3).
    let (rest, poses) = boxes(vec![sequence(0, None, &[shift(DVec3::X * 0.5)])], 2);
    assert_eq!((rest.centre, rest.forward, rest.size), (DVec3::splat(2.0), DVec3::X, DVec3::splat(2.0)));
    for (i, pose) in poses.iter().enumerate() {
        assert!((pose.centre - DVec3::new(2.0 + 0.5 * i as f64, 2.0, 2.0)).length() < 1e-12);
        assert!((pose.rotation.apply(DVec3::X) - DVec3::X).length() < 1e-12);
        assert!((pose.velocity - DVec3::X * 0.5).length() < 1e-12);
    }
    // Backwards the front is at -x, and the left side at -y.
    let (rest, poses) = boxes(vec![sequence(0, None, &[shift(DVec3::X * -0.5)])], 1);
    assert_eq!((rest.centre, rest.forward), (DVec3::splat(2.0), -DVec3::X));
    assert!((poses[1].rotation.apply(DVec3::Y) + DVec3::Y).length() < 1e-12);
}

#[test]
fn boxes_turn_with_their_parts_and_lie_along_their_way() {
    // A circle around the origin, on which the part begins to go in the direction (-1, 1).
    let step = 0.02;
    let kind = MotionKind::Rotation { axis: DVec3::Z, angle: step, centre: None };
    let (rest, poses) = boxes(vec![sequence(0, None, &[motion(kind)])], 50);
    let half = 0.5f64.sqrt();
    assert!((rest.forward - DVec3::new(-half, half, 0.0)).length() < 1e-12, "{}", rest.forward);
    // Along (-1, 1) the corners lie from -sqrt 2 to 0, along (-1, -1) from -3 sqrt 2 to -sqrt 2.
    let size = DVec3::new(2.0 * half, 4.0 * half, 2.0);
    assert!((rest.size - size).length() < 1e-12, "{}", rest.size);
    assert!((rest.centre - DVec3::new(2.5, 1.5, 2.0)).length() < 1e-12, "{}", rest.centre);
    let radius = 2.5f64.hypot(1.5);
    for (i, pose) in poses.iter().enumerate() {
        let turn = vlscan_geom::Rotation::about_z(step * i as f64);
        assert!((pose.centre - turn.apply(rest.centre)).length() < 1e-11);
        assert!((pose.rotation.apply(DVec3::X) - turn.apply(rest.forward)).length() < 1e-11);
        assert!((pose.velocity.length() - step * radius).abs() < 1e-10);
    }
    // Parts that go nowhere, and parts that wait before they go.
    let spin = Motion { about_self: true, ..motion(kind) };
    assert_eq!(boxes(vec![sequence(0, None, &[spin])], 1).0.forward, DVec3::X);
    let wait = sequence(9, Some(1), &[motion(MotionKind::Identity)]);
    let (rest, _) = boxes(vec![wait, sequence(1, None, &[shift(DVec3::Y)])], 1);
    assert_eq!(rest.forward, DVec3::Y);
}

#[test]
fn states_count_the_steps_to_their_next_update() {
    let (recipe, mut scene) = moving(vec![sequence(0, None, &[shift(DVec3::X)])]);
    (scene.dyn_step, scene.moving_parts[0].timing) = (4, recipe.parts[1].timing);
    let plan = MotionPlan::new(&scene, 1000.0).unwrap();
    let mut state = MotionState::start(&plan);
    let mut updates = Vec::new();
    for step in 1..=10u64 {
        updates.push(step - 1 + state.steps_to_update());
        state.step(&plan, |_, _| ());
    }
    assert_eq!(updates, [1, 5, 5, 5, 5, 9, 9, 9, 9, 13]);
}
