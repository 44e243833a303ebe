//! Ghosts of mirrors, and surfaces behind panes.

use super::*;
use crate::pulse::testkit::*;
use crate::pulse::{Echo, EchoPath, PathKind};
use vlscan_geom::unit;
use vlscan_scene::{Optics, OpticsKind, Water};

const PANE: OpticsKind = OpticsKind::Pane { index: 1.5, thickness: 0.004, absorption: 0.0, sheets: 1 };

/// A scene of rectangles, the first `optical` of which are mirrors or panes without diffuse reflectance.
fn scene_of(kind: OpticsKind, optical: usize, of: &[[DVec3; 3]]) -> Scene {
    let mut scene = rectangles(half_white(), of);
    let optics = Optics { kind, share: 1.0, roughness: 0.0 };
    scene.materials.push(Material { reflectance: 0.0, optics: Some(optics), ..half_white() });
    scene.surfaces.iter_mut().take(optical).for_each(|surface| surface.material = 1);
    scene
}

/// One subray, the axis, every reflection of which is a row with its truth.
fn one_ray() -> (Survey, PhysicsOptions) {
    let options = PhysicsOptions { record_truth: true, record_subrays: true, ..PhysicsOptions::refined() };
    (tls_with(|d| d.waveform.quality = 1), options)
}

/// The records of a ray along +y that is turned about z by this angle, degrees.
fn ray(scene: &Scene, degrees: f64) -> Batch {
    let (survey, options) = one_ray();
    simulate_pulses(scene, &survey, options, 0, &[pulse(Rotation::about_z(radians(degrees)))])
}

/// A wall that faces +x or −x at this x.
fn side_wall(x: f64) -> [DVec3; 3] {
    [DVec3::new(x, -20.0, -20.0), DVec3::Y * 60.0, DVec3::Z * 40.0]
}

fn mirror() -> OpticsKind {
    OpticsKind::Mirror { reflectance: 1.0 }
}

/// Flat water without scattering.
fn flat_water() -> OpticsKind {
    OpticsKind::Water(Water {
        index: 1.34,
        group_index: 1.365,
        attenuation: 0.1,
        beam_attenuation: 0.1,
        backscatter: 0.0,
        slopes: [0.0; 2],
        wind: [0.0, 1.0],
    })
}

#[test]
fn a_ghost_has_the_range_of_the_mirrored_wall_and_the_position_of_the_true_one() {
    let scene = scene_of(mirror(), 1, &[side_wall(3.0), wall(-20.0, 20.0, 8.0)]);
    // 60° from +x.
    let batch = ray(&scene, -30.0);
    let [ghost] = &batch.echoes[..] else { panic!("{:?}", batch.echoes) };
    let truth = ghost.truth(&batch.truths);
    assert!((ghost.range - 9.237604307).abs() < 1e-9, "{}", ghost.range);
    let at = truth.surface + scene.shift;
    assert!((at - DVec3::new(1.381197846, 8.0, 0.0)).length() < 1e-9, "{at}");
    let reported = ghost.origin + ghost.direction * ghost.range + scene.shift;
    assert!((reported - DVec3::new(4.618802154, 8.0, 0.0)).length() < 1e-9, "{reported}");
    assert_eq!((truth.path, ghost.part), (EchoPath { kind: PathKind::Mirror, order: 1 }, 1));
    assert!((truth.normal - DVec3::NEG_Y).length() < 1e-12, "{}", truth.normal);
}

#[test]
fn a_perfect_mirror_shows_the_mirrored_copy_at_its_amplitude() {
    let mirrored = scene_of(mirror(), 1, &[side_wall(3.0), side_wall(-5.0)]);
    let copy = rectangles(half_white(), &[side_wall(11.0)]);
    for step in 0..12 {
        let degrees = -70.0 + 3.0 * f64::from(step);
        let (ghost, direct) = (ray(&mirrored, degrees), ray(&copy, degrees));
        let ([ghost], [direct]) = (&ghost.echoes[..], &direct.echoes[..]) else { panic!("{degrees}°") };
        assert!((ghost.range - direct.range).abs() < 1e-9, "{degrees}°");
        assert!((ghost.intensity / direct.intensity - 1.0).abs() < 1e-9, "{degrees}°");
        assert!((ghost.incidence_cosine - direct.incidence_cosine).abs() < 1e-12, "{degrees}°");
    }
}

#[test]
fn a_wall_behind_a_pane_is_farther_and_darker() {
    let wall_alone = rectangles(half_white(), &[wall(-30.0, 30.0, 20.0)]);
    let scene = scene_of(PANE, 1, &[wall(-30.0, 30.0, 10.0), wall(-30.0, 30.0, 20.0)]);
    for (degrees, parallel, squared) in [(0.0, 2.0, 0.852071), (45.0, 1.146506, 0.823274)] {
        let (seen, alone) = (ray(&scene, degrees), ray(&wall_alone, degrees));
        let through = |i: &usize| seen.truths[*i].path.kind == PathKind::Pane;
        let (Some(i), [alone]) = ((0..seen.echoes.len()).find(through), &alone.echoes[..]) else {
            panic!("{degrees}°: {:?}", seen.echoes)
        };
        let (truth, seen) = (seen.truths[i], seen.echoes[i]);
        assert!((seen.range - alone.range - parallel * 1e-3).abs() < 1e-9, "{degrees}°");
        let fading = (alone.range / seen.range).powi(2);
        // The air takes a little more on the longer way.
        assert!((seen.intensity / alone.intensity / fading - squared).abs() < 2e-6, "{degrees}°");
        assert_eq!(truth.path, EchoPath { kind: PathKind::Pane, order: 1 });
        assert!(((truth.surface + scene.shift).y - 20.0).abs() < 1e-9);
    }
}

#[test]
fn the_light_that_a_pane_mirrors_comes_from_the_room() {
    let scene =
        scene_of(PANE, 1, &[wall(-20.0, 20.0, 10.0), wall(-30.0, 30.0, 20.0), wall(-20.0, 20.0, -5.0)]);
    let batch = ray(&scene, 0.0);
    let kinds: Vec<_> = batch.truths.iter().map(|truth| truth.path.kind).collect();
    // And that which it mirrors straight back.
    assert_eq!(kinds.len(), 3, "{:?}", batch.echoes);
    let expected = [PathKind::Mirror, PathKind::Pane, PathKind::MirrorSurface];
    assert!(expected.iter().all(|kind| kinds.contains(kind)), "{kinds:?}");
    let ghost = batch.truths.iter().position(|truth| truth.path.kind == PathKind::Mirror).unwrap();
    assert!((batch.echoes[ghost].range - 25.0).abs() < 1e-9 && batch.echoes[ghost].part == 2);
}

#[test]
fn facing_mirrors_end_at_the_maximum_order() {
    let mut scene = scene_of(mirror(), 2, &[wall(-20.0, 20.0, 10.0), wall(-20.0, 20.0, -5.0)]);
    scene.materials[1].reflectance = 0.1;
    let orders = |max_order: u8| {
        let (survey, options) = one_ray();
        let options = PhysicsOptions { max_order, ..options };
        let batch = simulate(&scene, &survey, options);
        let (own, ghosts): (Vec<EchoPath>, Vec<EchoPath>) = batch
            .truths
            .iter()
            .map(|truth| truth.path)
            .partition(|path| path.kind == PathKind::MirrorSurface);
        let orders = |of: Vec<EchoPath>| of.iter().map(|path| path.order).collect::<Vec<_>>();
        (orders(ghosts), orders(own))
    };
    // Light that comes from the mirror behind does not fall into the receiver.
    assert_eq!(orders(4), (vec![0, 1, 2, 3, 4], vec![0, 2]));
    assert_eq!(orders(1), (vec![0, 1], vec![0]));
    assert_eq!(orders(0), (vec![0], vec![]));
}

#[test]
fn the_greatest_order_ends_lossless_mirrors_without_a_maximum_range() {
    let mut scene = scene_of(mirror(), 2, &[wall(-20.0, 20.0, 10.0), wall(-20.0, 20.0, -5.0)]);
    scene.materials[1].reflectance = 0.1;
    let (survey, options) = one_ray();
    assert!(survey.scanner.devices[0].detector.range_max > 1e300);
    // Each second way also comes straight back.
    for (max_order, expected) in [(PhysicsOptions::GREATEST_ORDER, 65 + 32), (u8::MAX, 256 + 128)] {
        let batch = simulate(&scene, &survey, PhysicsOptions { max_order, ..options });
        assert_eq!(batch.echoes.len(), expected);
        assert_eq!(batch.truths.last().map(|truth| truth.path.order), Some(max_order));
    }
}

#[test]
fn many_panes_of_dense_glass_end_where_no_light_is_left() {
    // Light splits in two at each of them: without an end there would be 2⁶⁴ ways.
    let dense = OpticsKind::Pane { index: 5.0, thickness: 0.004, absorption: 0.0, sheets: 2 };
    let mut all: Vec<_> = (0..40).map(|i| wall(-20.0, 20.0, f64::from(5 + i))).collect();
    all.push(wall(-20.0, 20.0, -5.0));
    let scene = scene_of(dense, 40, &all);
    let (survey, options) = one_ray();
    let options = PhysicsOptions { max_order: PhysicsOptions::GREATEST_ORDER, ..options };
    let batch = simulate(&scene, &survey, options);
    assert!(batch.echoes.iter().all(|echo| echo.range.is_finite() && echo.intensity.is_finite()));
}

#[test]
fn nested_panes_end_at_the_maximum_order_or_show_what_is_behind() {
    let panes = |count: i32| {
        let mut all: Vec<_> = (0..count).map(|i| wall(-20.0, 20.0, f64::from(5 + i))).collect();
        all.push(wall(-20.0, 20.0, 30.0));
        ray(&scene_of(PANE, count as usize, &all), 0.0)
    };
    for count in 1..=4 {
        let batch = panes(count);
        let through = |truth: &&crate::pulse::EchoTruth| truth.path.kind == PathKind::Pane;
        let found: Vec<_> = batch.truths.iter().filter(through).collect();
        assert_eq!(found.len(), 1, "{count} panes");
        assert_eq!(i32::from(found[0].path.order), count);
    }
    assert!(panes(5).truths.iter().all(|truth| truth.path.kind != PathKind::Pane));
}

#[test]
fn opaque_pulses_do_not_change_beside_mirrors() {
    let walls = [wall(-20.0, 0.0, 10.0), side_wall(15.0)];
    let (plain, optical) = (rectangles(half_white(), &walls), {
        let mut scene = scene_of(mirror(), 0, &walls);
        scene.surfaces[1].material = 1;
        scene
    });
    let options = PhysicsOptions { record_truth: true, ..PhysicsOptions::refined() };
    let [plain, optical] = [plain, optical].map(|scene| {
        let aimed = pulse(Rotation::about_z(radians(20.0)));
        simulate_pulses(&scene, &tls(), options, 0, &[aimed])
    });
    assert_eq!(plain.echoes.len(), 1);
    assert_eq!((plain.echoes, plain.truths), (optical.echoes, optical.truths));
}

#[test]
fn rough_mirrors_blur_and_give_the_same_ghosts_again() {
    let mut scene = scene_of(mirror(), 1, &[side_wall(3.0), wall(-20.0, 20.0, 8.0)]);
    let polished = ray(&scene, -30.0);
    if let Some(optics) = &mut scene.materials[1].optics {
        optics.roughness = 0.01;
    }
    let (one, other) = (ray(&scene, -30.0), ray(&scene, -30.0));
    assert_eq!((&one.echoes, &one.truths), (&other.echoes, &other.truths));
    assert_eq!(one.echoes.len(), 1);
    assert!(one.echoes[0].intensity < polished.echoes[0].intensity);
    let off = unit(one.truths[0].surface - polished.truths[0].surface);
    assert!(off.is_finite() && one.truths[0].surface != polished.truths[0].surface);
}

#[test]
fn windows_nearer_than_the_minimum_range_let_light_pass() {
    let scene = scene_of(PANE, 1, &[wall(-20.0, 20.0, 0.5), wall(-30.0, 30.0, 20.0)]);
    let batch = ray(&scene, 0.0);
    assert_eq!(batch.echoes.len(), 1, "{:?}", batch.echoes);
    assert!((batch.echoes[0].range - 20.002).abs() < 1e-9);
}

/// Four rectangles that share a corner at (0, y, 0); the diagonals of two of them end there.
fn quarters(y: f64) -> [[DVec3; 3]; 4] {
    [(-20.0, -20.0), (0.0, -20.0), (-20.0, 0.0), (0.0, 0.0)]
        .map(|(x, z)| [DVec3::new(x, y, z), DVec3::X * 20.0, DVec3::Z * 20.0])
}

/// A ray that meets the plane y = `y` at this x and z, turned about z by an angle in degrees.
fn ray_to(scene: &Scene, [x, y, z]: [f64; 3], degrees: f64) -> Batch {
    let (survey, options) = one_ray();
    let aimed = pulse(Rotation::about_z(radians(degrees)));
    let direction = aimed.attitude.forward();
    let origin = DVec3::new(x, y, z) - direction * (y / direction.y);
    simulate_pulses(scene, &survey, options, 0, &[Pulse { origin, ..aimed }])
}

#[test]
fn light_meets_a_surface_once_at_the_edges_and_corners_of_its_triangles() {
    let foil = OpticsKind::Pane { index: 1.5, thickness: 0.0, absorption: 0.0, sheets: 1 };
    let walls = [wall(-200.0, 200.0, 20.0), wall(-200.0, 200.0, -5.0)];
    for kind in [PANE, foil, mirror(), flat_water()] {
        let scene = scene_of(kind, 4, &[&quarters(10.0)[..], &walls[..]].concat());
        for degrees in [0.0, 30.0, 80.0] {
            let found = |x: f64, z: f64| -> Vec<(f64, f64, EchoPath)> {
                let batch = ray_to(&scene, [x, 10.0, z], degrees);
                let of = |echo: &Echo| (echo.range, echo.intensity, echo.truth(&batch.truths).path);
                batch.echoes.iter().map(of).collect()
            };
            let inside = found(-3.0, 1.5);
            assert!(!inside.is_empty(), "{kind:?}, {degrees}°");
            let (corner, edges) = ([(0.0, 0.0)], [(0.0, 5.0), (0.0, -7.0), (-4.0, 0.0), (9.0, 0.0)]);
            let diagonals = [(-5.0, -5.0), (7.5, 7.5), (4.0, -16.0), (-12.0, 8.0)];
            for (x, z) in corner.into_iter().chain(diagonals).chain(edges) {
                let there = found(x, z);
                assert_eq!(there.len(), inside.len(), "{kind:?}, {degrees}°, {x} {z}: {there:?}");
                for (one, other) in there.iter().zip(&inside) {
                    let is_equal = (one.0 - other.0).abs() < 1e-9
                        && (one.1 / other.1 - 1.0).abs() < 1e-9
                        && one.2 == other.2;
                    assert!(is_equal, "{kind:?}, {degrees}°, {x} {z}: {one:?} {other:?}");
                }
            }
        }
    }
}

#[test]
fn light_does_not_depend_on_the_orientation_of_the_scene() {
    let insulating = OpticsKind::Pane { index: 1.6, thickness: 0.01, absorption: 5.0, sheets: 2 };
    // A surface that faces no axis in a room.
    let oblique = [DVec3::new(-9.0, 14.0, -6.0), DVec3::new(17.0, -5.0, 3.0), DVec3::new(2.0, 4.0, 13.0)];
    let across = |x: f64| [DVec3::new(x, -8.0, -20.0), DVec3::Y * 33.0, DVec3::Z * 40.0];
    let level = |z: f64| [DVec3::new(-40.0, -8.0, z), DVec3::X * 80.0, DVec3::Y * 33.0];
    let room = [wall(-40.0, 40.0, 25.0), wall(-40.0, 40.0, -8.0), across(40.0), across(-40.0), level(20.0)];
    let room = [&[oblique][..], &room[..], &[level(-20.0)][..]].concat();
    let turn = Rotation::about(unit(DVec3::new(1.0, -2.0, 0.5)), 1.1);
    let turned: Vec<[DVec3; 3]> = room.iter().map(|corners| corners.map(|v| turn.apply(v))).collect();
    for kind in [PANE, insulating, mirror(), flat_water()] {
        let scenes = [scene_of(kind, 1, &room), scene_of(kind, 1, &turned)];
        for (aside, up) in [(0.0, 0.0), (10.0, 5.0), (-12.0, 8.0), (4.0, -9.0)] {
            let attitude = Rotation::about_z(radians(aside)).after(Rotation::about_x(radians(up)));
            let (survey, options) = one_ray();
            let simulated = |scene: &Scene, attitude: Rotation| {
                simulate_pulses(scene, &survey, options, 0, &[pulse(attitude)])
            };
            let (one, other) = (simulated(&scenes[0], attitude), simulated(&scenes[1], turn.after(attitude)));
            let place = format!("{kind:?}, {aside}°, {up}°");
            assert_eq!(one.echoes.len(), other.echoes.len(), "{place}");
            assert!(one.truths.iter().any(|truth| truth.path.order > 0), "{place}");
            for (a, b) in one.echoes.iter().zip(&other.echoes) {
                let (seen, turned) = (a.truth(&one.truths), b.truth(&other.truths));
                assert!((a.range - b.range).abs() < 1e-9, "{place}: {a:?} {b:?}");
                assert!((a.intensity / b.intensity - 1.0).abs() < 1e-9, "{place}: {a:?} {b:?}");
                assert_eq!((seen.path, a.part), (turned.path, b.part), "{place}");
                let at = turn.apply(seen.surface + scenes[0].shift);
                assert!((at - turned.surface - scenes[1].shift).length() < 1e-9, "{place}: {at}");
            }
        }
    }
}

/// The echo of the light that a pane lets pass: range, true position and part.
fn behind_pane(scene: &Scene, batch: &Batch) -> (f64, DVec3, u32) {
    let through = |i: &usize| batch.truths[*i].path.kind == PathKind::Pane;
    let all: Vec<usize> = (0..batch.echoes.len()).filter(through).collect();
    let [i] = all[..] else { panic!("{:?}", batch.echoes) };
    (batch.echoes[i].range, batch.truths[i].surface + scene.shift, batch.echoes[i].part)
}

#[test]
fn a_wall_nearer_to_a_pane_than_its_thickness_is_seen_through_it() {
    // The second one touches the back of the pane.
    for y in [10.002, 10.004] {
        let scene = scene_of(PANE, 1, &[10.0, y, 20.0].map(|y| wall(-200.0, 200.0, y)));
        for (degrees, parallel) in [(0.0, 2.0), (45.0, 1.146506), (60.0, -0.651531), (80.0, -15.080608)] {
            for step in 0..20 {
                let x = 0.37 * f64::from(step);
                let (range, surface, part) = behind_pane(&scene, &ray_to(&scene, [x, 10.0, 1.0], degrees));
                assert_eq!(part, 1, "{degrees}°, {x}");
                let expected = y / libm::cos(radians(degrees)) + parallel * 1e-3;
                assert!((range - expected).abs() < 1e-9, "{degrees}°: {range} is not {expected}");
                assert!((surface.y - y).abs() < 1e-9, "{degrees}°: {surface}");
            }
        }
    }
}

#[test]
fn light_in_a_pane_meets_the_reveal_that_it_runs_into_and_not_the_one_beside_it() {
    // The light enters the pane at x = 5 mm and leaves it at 8.48 mm.
    let found = |x: f64| {
        let reveal = [DVec3::new(x, 10.0, -20.0), DVec3::Y * 0.2, DVec3::Z * 40.0];
        let scene = scene_of(PANE, 1, &[wall(-200.0, 200.0, 10.0), reveal, wall(-200.0, 200.0, 20.0)]);
        behind_pane(&scene, &ray_to(&scene, [0.005, 10.0, 0.0], -80.0))
    };
    for x in [0.0, 0.0045] {
        let (range, surface, part) = found(x);
        assert_eq!(part, 2, "{x}");
        let expected = 20.0 / libm::cos(radians(80.0)) - 0.015080608;
        assert!((range - expected).abs() < 1e-9 && (surface.y - 20.0).abs() < 1e-9, "{x}: {range}");
    }
    for x in [0.006, 0.0084] {
        let (_, surface, part) = found(x);
        assert_eq!(part, 1, "{x}");
        assert!((surface.x - x).abs() < 1e-9 && (10.0..10.004).contains(&surface.y), "{x}: {surface}");
    }
}

/// The echoes of a mirror or pane itself, with their paths.
fn own_echoes(batch: &Batch) -> Vec<(Echo, EchoPath)> {
    let all = batch.echoes.iter().map(|echo| (*echo, echo.truth(&batch.truths).path));
    all.filter(|(_, path)| path.kind == PathKind::MirrorSurface).collect()
}

#[test]
fn a_mirror_that_faces_the_beam_has_an_echo_of_what_falls_on_the_receiver() {
    let white = rectangles(half_white(), &[wall(-20.0, 20.0, 100.0)]);
    let scene = scene_of(mirror(), 1, &[wall(-20.0, 20.0, 100.0)]);
    for quality in [1, 3] {
        let options =
            PhysicsOptions { record_truth: true, record_subrays: true, ..PhysicsOptions::refined() };
        let survey = tls_with(|device| {
            device.waveform.quality = quality;
            device.beam.receiver_diameter = 0.05;
        });
        let light = |scene: &Scene, degrees: f64| {
            let aimed = pulse(Rotation::about_z(radians(degrees)));
            let batch = simulate_pulses(scene, &survey, options, 0, &[aimed]);
            batch.echoes.iter().map(|echo| echo.intensity).sum::<f64>()
        };
        // 1 − e^(−2·(25 mm)²/(30 mm)²) of the light returns, where a white wall sends 0.5·(50 mm/200 m)².
        let expected = 0.750648 * (200.0f64 / 0.05).powi(2) / 0.5;
        assert!((light(&scene, 0.0) / light(&white, 0.0) / expected - 1.0).abs() < 1e-6, "{quality}");
        assert_eq!(light(&scene, 0.1), 0.0);
    }
    let batch = ray(&scene, 0.0);
    let [(echo, path)] = own_echoes(&batch)[..] else { panic!("{:?}", batch.echoes) };
    assert_eq!((path.order, echo.part), (0, 0));
    assert!((echo.incidence_cosine - 1.0).abs() < 1e-12);
    assert!((echo.range - 100.0).abs() < 1e-9 && (echo.position.y + scene.shift.y - 100.0).abs() < 1e-9);
}

#[test]
fn mirrors_show_the_receiver_itself_through_panes_and_in_corners_but_not_behind_walls() {
    // Glass takes T² of the light and makes the way longer by half a sheet of 4 mm.
    let [bare, glazed] = [scene_of(mirror(), 1, &[wall(-20.0, 20.0, 100.0)]), {
        let mut scene = scene_of(PANE, 1, &[wall(-20.0, 20.0, 60.0), wall(-20.0, 20.0, 100.0)]);
        let optics = Optics { kind: mirror(), share: 1.0, roughness: 0.0 };
        scene.materials.push(Material { reflectance: 0.0, optics: Some(optics), ..half_white() });
        scene.surfaces[1].material = 2;
        scene
    }];
    let [bare, glazed] = [bare, glazed].map(|scene| own_echoes(&ray(&scene, 0.0)));
    let ([(bare, _)], [(pane, _), (glazed, path)]) = (&bare[..], &glazed[..]) else {
        panic!("{bare:?} {glazed:?}")
    };
    assert!((pane.range - 60.0).abs() < 1e-9 && pane.part == 0);
    assert!((glazed.range - 100.002).abs() < 1e-9 && (path.order, glazed.part) == (2, 1));
    assert!((glazed.intensity / bare.intensity / 0.852071 - 1.0).abs() < 1e-4);
    // Two mirrors at right angles turn light back beside its way: here the beam meets their edge.
    let half = 20.0f64;
    let corner = [
        [DVec3::new(0.0, 50.0, -20.0), DVec3::new(-half, -half, 0.0), DVec3::Z * 40.0],
        [DVec3::new(0.0, 50.0, -20.0), DVec3::new(half, -half, 0.0), DVec3::Z * 40.0],
    ];
    let aside = |x: f64, walls: &[[DVec3; 3]]| {
        let scene = scene_of(mirror(), 2, &[&corner[..], walls].concat());
        let (survey, options) = one_ray();
        let aimed = Pulse { origin: DVec3::X * x, ..pulse(Rotation::IDENTITY) };
        own_echoes(&simulate_pulses(&scene, &survey, options, 0, &[aimed]))
    };
    let [(echo, path)] = aside(0.01, &[])[..] else { panic!("{:?}", aside(0.01, &[])) };
    assert!((echo.range - 50.0).abs() < 1e-5 && path.order == 1, "{echo:?} {path:?}");
    assert!(aside(0.5, &[]).is_empty());
    // A wall hides the way back, but not the way there.
    assert!(aside(0.01, &[wall(-1.0, 0.0, 40.0)]).is_empty());
}

#[test]
fn light_that_passed_the_receiver_is_not_received_again_from_the_panes_behind_it() {
    // A mirror at 5 m, panes 2 m and 4 m behind the receiver; the axis meets no edge of a triangle.
    let rectangles = [5.0, -2.0, -4.0].map(|y| wall(-20.0, 10.0, y));
    let mut scene = scene_of(PANE, 3, &rectangles);
    let optics = Optics { kind: mirror(), share: 1.0, roughness: 0.0 };
    scene.materials.push(Material { reflectance: 0.0, optics: Some(optics), ..half_white() });
    scene.surfaces[0].material = 2;
    let found = |max_order: u8| {
        let (survey, options) = one_ray();
        let options = PhysicsOptions { max_order, ..options };
        let mut own = own_echoes(&simulate(&scene, &survey, options));
        own.sort_by(|a, b| a.0.range.total_cmp(&b.0.range));
        own
    };
    // Light comes from the mirror each time: at once, after it was at the pane at −2 m (24 m in all), at that
    // at −4 m (28 m, with 2 mm more for each way through the other), and twice at that at −2 m (38 m).
    let expected = [(5.0, 0), (12.0, 2), (14.002, 4), (19.0, 4)];
    for (max_order, count) in [(2, 1), (4, 2), (6, 4)] {
        let own = found(max_order);
        assert_eq!(own.len(), count, "{max_order}: {own:?}");
        for ((echo, path), (range, order)) in own.iter().zip(expected) {
            assert!((echo.range - range).abs() < 1e-9 && path.order == order, "{echo:?} {path:?}");
            assert_eq!(echo.part, 0);
        }
    }
}
