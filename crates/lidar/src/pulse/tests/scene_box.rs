//! The scene's box: in the reference the beam's axis must hit it, and moving parts outside of it are
//! invisible.

use super::*;

#[test]
fn the_axis_must_meet_the_scene_s_box_unless_corrected() {
    let scene = rectangles(half_white(), &[wall(5e-3, 20.0, 100.0)]);
    let survey = step_survey(|_| ());
    let options = PhysicsOptions { record_pulses: true, ..legacy() };
    let batch = simulate(&scene, &survey, options);
    assert_eq!((batch.echoes.len(), batch.pulses.len()), (0, 1), "the pulse is recorded all the same");
    assert_eq!(batch.pulses[0].direction, DVec3::Y);
    assert_eq!(simulate(&scene, &survey, with(options, "no_axis_gate")).echoes.len(), 1);
}

#[test]
fn a_box_behind_the_scanner_is_not_met_and_one_around_it_is() {
    let behind = rectangles(half_white(), &[wall(-20.0, 20.0, -10.0)]);
    assert_eq!(simulate(&behind, &tls(), legacy()).echoes.len(), 0);
    let around = rectangles(half_white(), &[wall(-20.0, 20.0, -10.0), wall(-20.0, 20.0, 10.0)]);
    assert_eq!(simulate(&around, &tls(), legacy()).echoes.len(), 1);
}

#[test]
fn what_moved_out_of_the_scene_s_box_vanishes_unless_corrected() {
    // spec pulse-physics §6: a plate that leaves the initial box of y from 100 to 120
    let mut scene = rectangles(half_white(), &[wall(-20.0, 20.0, 99.5), wall(-20.0, 20.0, 120.0)]);
    scene.bounds = Aabb { min: DVec3::new(-20.0, 100.0, -20.0), max: DVec3::new(20.0, 120.0, 20.0) }
        .translated(-scene.shift);
    let range = |options| simulate(&scene, &tls(), options).echoes[0].range;
    assert!((range(legacy()) - 120.0).abs() < 1e-9);
    assert!((range(with(legacy(), "unbounded_scene")) - 99.5).abs() < 1e-9);
    scene.bounds.max.y -= 10.0;
    assert_eq!(simulate(&scene, &tls(), legacy()).echoes.len(), 0, "nothing within the box");
}
