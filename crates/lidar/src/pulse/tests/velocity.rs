//! Radial velocities of echoes.

use super::*;
use crate::pulse::EchoVelocity;
use vlscan_scene::{DynamicScene, MotionPlan, MovingPart, ObjectUpdate, Twist};
use vlscan_survey::{Fmcw, MotionTiming};
use vlscan_trace::{BuildOptions, Tree};

fn recorded() -> PhysicsOptions {
    PhysicsOptions { record_truth: true, record_velocities: true, ..PhysicsOptions::refined() }
}

fn one_ray() -> Survey {
    tls_with(|device| device.waveform.quality = 1)
}

fn from(attitude: Rotation, velocity: DVec3) -> [Pulse; 1] {
    [Pulse { velocity: Some(velocity), ..pulse(attitude) }]
}

fn only(batch: &Batch) -> EchoVelocity {
    let [echo] = batch.echoes[..] else { panic!("{:?}", batch.echoes) };
    echo.velocity(&batch.velocities)
}

/// The velocity of a wall at 100 m that turns at `rate` rad/s about an axis through `centre`, as a resting
/// instrument sees it along +y at 1 kHz.
fn turning(survey: &Survey, rate: DVec3, centre: DVec3) -> EchoVelocity {
    let mut scene = rectangles(half_white(), &[wall(-20.0, 20.0, 100.0), wall(-20.0, 20.0, 120.0)]);
    scene.dyn_step = 1;
    scene.moving_parts = vec![MovingPart {
        part: 0,
        vertices: 0..4,
        triangles: 0..2,
        cubes: 0..0,
        motions: Vec::new(),
        timing: MotionTiming { dyn_step: 1, tree_step: 1, dyn_time_step: None, tree_time_step: None },
    }];
    let plan = MotionPlan::new(&scene, 1000.0).unwrap();
    let tree = Tree::build_where(&scene.geometry, &BuildOptions::default(), |i| scene.is_still(i));
    let physics = Physics::new(&scene, &tree, survey, recorded()).unwrap();
    let rotation = rate * 1e-3;
    let twist = Twist { rotation, translation: -rotation.cross(centre - scene.shift) };
    let transform = vlscan_geom::Affine::IDENTITY;
    let updates = [ObjectUpdate { first_pulse: 0, object: 0, transform, twist }];
    let pulses = from(Rotation::IDENTITY, DVec3::ZERO).map(|p| in_frame(&scene, &p));
    let mut dynamic = DynamicScene::new(&plan, BuildOptions::default());
    let mut batch = Batch::default();
    PulseSimulator::new(&physics).simulate_dynamic(0, &pulses, &mut dynamic, &updates, &mut batch).unwrap();
    only(&batch)
}

#[test]
fn resting_walls_approach_a_moving_instrument() {
    // 20 m/s forward, the beam 30° aside and 10° up.
    let attitude = Rotation::about_z(radians(-30.0)).after(Rotation::about_x(radians(10.0)));
    let scene = rectangles(half_white(), &[wall(-60.0, 60.0, 50.0)]);
    let batch = simulate_pulses(&scene, &one_ray(), recorded(), 0, &from(attitude, DVec3::Y * 20.0));
    let EchoVelocity { radial, spread } = only(&batch);
    assert!((radial + 17.057370639).abs() < 1e-9 && spread == 0.0, "{radial} {spread}");
    let unknown = simulate_pulses(&scene, &one_ray(), recorded(), 0, &[pulse(attitude)]);
    assert!(unknown.velocities.is_empty() && only(&unknown).radial.is_nan());
    let plain = PhysicsOptions { record_velocities: false, ..recorded() };
    let same = simulate_pulses(&scene, &one_ray(), plain, 0, &from(attitude, DVec3::ZERO));
    assert_eq!(same.echoes, batch.echoes);
}

#[test]
fn surfaces_of_a_cylinder_have_the_velocity_of_its_axis_distance() {
    // 10 rad/s about an upright axis that the ray passes at 0.2 m, whatever its distance.
    for distance in [90.0, 100.0, 130.0] {
        let found = turning(&one_ray(), DVec3::Z * 10.0, DVec3::new(-0.2, distance, 0.0));
        assert!((found.radial - 2.0).abs() < 1e-9 && found.spread == 0.0, "{found:?}");
    }
}

#[test]
fn a_wheel_widens_the_line_by_the_footprint_on_it() {
    // A beam of 10 mm on a wheel of 50 rad/s: ω·w/2 of standard deviation.
    let survey = tls_with(|device| {
        (device.beam.divergence, device.beam.aperture, device.waveform.quality) = (1e-9, 0.02, 3);
    });
    let found = turning(&survey, DVec3::X * 50.0, DVec3::Y * 100.0);
    assert!(found.radial.abs() < 1e-9 && (found.spread - 0.25).abs() < 1e-6, "{found:?}");
}

#[test]
fn fog_is_at_rest() {
    let mut survey = one_ray();
    survey.legs[0].scanner.weather.air.fog = 0.1;
    let scene = rectangles(half_white(), &[wall(-60.0, 60.0, 500.0)]);
    let batch = simulate_pulses(&scene, &survey, recorded(), 0, &from(Rotation::IDENTITY, DVec3::Y * 5.0));
    assert!((batch.echoes[0].velocity(&batch.velocities).radial + 5.0).abs() < 1e-9);
}

#[test]
fn chirps_confuse_range_and_velocity_of_fast_targets_near_by() {
    let survey = tls_with(|device| {
        (device.waveform.quality, device.beam.wavelength) = (1, 1550.0);
        let wave =
            Fmcw { bandwidth: 1e9, chirp: 1e-5, sample_rate: None, has_quadrature: false, false_alarm: None };
        device.receiver.fmcw = Some(wave);
    });
    let seen = |range: f64| {
        let scene = rectangles(half_white(), &[wall(-60.0, 60.0, range)]);
        // The instrument moves away at 50 m/s.
        let pulses = from(Rotation::IDENTITY, DVec3::Y * -50.0);
        let batch = simulate_pulses(&scene, &survey, recorded(), 0, &pulses);
        (batch.echoes[0].range, only(&batch))
    };
    let (range, velocity) = seen(100.0);
    assert!((range - 100.0).abs() < 1e-3 && (velocity.radial - 50.0).abs() < 1e-9, "{range} {velocity:?}");
    // The line of a resting target: λ/(2T) at half maximum.
    assert!((velocity.spread - 0.0775 / 2.354820045).abs() < 1e-9, "{velocity:?}");
    let (range, velocity) = seen(90.0);
    assert!((range - 96.707245).abs() < 1e-3, "{range}");
    assert!((velocity.radial - 50.0 * 90.0 / 96.707245).abs() < 1e-3, "{velocity:?}");
}
