//! Tests of complete scenes: parts, ids, ground, shift, limits.

use super::fixture::{Fixture, report};
use super::{Scene, SceneFrame, load_epoch};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use vlscan_base::error::Error;
use vlscan_geom::{Aabb, DVec3};
use vlscan_survey::{Loader, MeshReading, MotionSequence, Swap};

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

fn offset(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

#[test]
fn the_shift_is_the_centre_of_the_box_and_keeps_utm_coordinates_exact() {
    let mut f = Fixture::new();
    f.obj("a.obj", "v 477000.125 5474500.0625 100\nv 477010.125 5474500.0625 100\nv 477000.125 5474530.0625 140.5\nv 9 9 9\nf 1 2 3\n");
    let scene = f.scene();
    assert_eq!(scene.shift, offset(477005.125, 5474515.0625, 120.25));
    let half = offset(5.0, 15.0, 20.25);
    assert_eq!(scene.bounds, Aabb { min: -half, max: half });
    assert_eq!(scene.geometry.vertices, [-half, offset(5.0, -15.0, -20.25), offset(-5.0, 15.0, 20.25)]);
}

#[test]
fn a_request_to_stop_ends_the_loading() {
    let mut f = Fixture::new();
    f.obj("a.obj", TRIANGLE);
    let stop = Arc::new(AtomicBool::new(false));
    f.options.stop = Some(stop.clone());
    f.load().unwrap();
    stop.store(true, Ordering::Relaxed);
    assert!(matches!(f.load(), Err(Error::Interrupted)));
}

#[test]
fn parts_without_id_are_numbered_and_each_of_their_files_is_a_part() {
    let mut f = Fixture::new();
    f.obj("a.obj", TRIANGLE);
    let files =
        vec![f.file("b.obj", TRIANGLE), f.file("empty.obj", "# nothing\n"), f.file("c.obj", TRIANGLE)];
    f.part(Loader::MeshFiles { files: files.clone(), reading: MeshReading::default() });
    f.obj("none.obj", "o nothing\nv 1 1 1\np 1\n");
    f.part(Loader::MeshFiles { files, reading: MeshReading::default() }).id = Some("hedge".to_owned());
    f.obj("d.obj", TRIANGLE).id = Some(String::new());
    f.obj("e.obj", TRIANGLE).id = Some("7".to_owned());
    f.obj("g.obj", TRIANGLE);
    let (scene, d) = f.load().unwrap();
    let ids: Vec<&str> = scene.parts.iter().map(|p| p.id.as_str()).collect();
    assert_eq!(ids, ["0", "1", "3", "hedge", "6", "7", "8"]);
    let parts: Vec<u32> = (0..scene.geometry.len() as u32).map(|i| scene.part_of(i)).collect();
    assert_eq!(parts, [0, 1, 2, 3, 3, 4, 5, 6]);
    let lines: Vec<usize> = d.items().iter().map(|i| i.place.as_ref().unwrap().line).collect();
    assert_eq!(lines, [11, 12], "an empty file and an empty part");
}

#[test]
fn vertex_numbers_of_later_parts_are_moved_up() {
    let mut f = Fixture::new();
    f.obj("a.obj", TRIANGLE);
    f.obj("b.obj", "v 5 5 5\nv 8 8 8\nv 6 5 5\nv 5 6 5\nf 1 3 4\n");
    let scene = f.scene();
    assert_eq!(scene.geometry.triangles, [[0, 1, 2], [3, 4, 5]]);
    assert_eq!(scene.to_world(scene.geometry.triangle(1)[1]), offset(6.0, 5.0, 5.0));
}

#[test]
fn missing_files_and_an_empty_scene_are_input_errors_with_the_part_s_place() {
    let mut f = Fixture::new();
    let files = vec![f.path().join("gone.obj"), f.path().to_path_buf()];
    f.part(Loader::MeshFiles { files, reading: MeshReading::default() });
    let report = f.error();
    assert!(report.contains("gone.obj") && report.matches("scene.xml:10").count() >= 2, "{report}");
    let mut empty = Fixture::new();
    empty.obj("a.obj", "# nothing\n");
    assert!(empty.error().contains("is empty"));
}

#[test]
fn parts_keep_their_numbers_and_ids_in_all_plays() {
    let mut f = Fixture::new();
    f.obj("a.obj", TRIANGLE);
    let swapped = f.file("wide.obj", "v 0 0 0\nv 30 0 0\nv 0 1 0\nv 0 2 0\nf 1 2 3\nf 1 2 4\n");
    let gate = f.obj("c.obj", TRIANGLE);
    let swap = Swap { epochs: 1, keep_crs: true, vanish: true, loader: None, scale: None, offset: None };
    let wide = Loader::MeshFiles { files: vec![swapped], reading: MeshReading::default() };
    gate.swaps = vec![swap.clone(), Swap { vanish: false, loader: Some(wide), ..swap }];
    f.obj("e.obj", TRIANGLE);
    let first = f.scene();
    let stand = SceneFrame::of(&first);
    for (epoch, triangles) in [(0, [1, 1, 1]), (1, [1, 0, 1]), (2, [1, 2, 1]), (3, [1, 2, 1])] {
        let (scene, warnings) = load_epoch(&f.recipe(), &f.options, epoch, Some(stand)).unwrap();
        assert!(warnings.items().is_empty());
        let ids: Vec<&str> = scene.parts.iter().map(|p| p.id.as_str()).collect();
        assert_eq!((ids, scene.shift), (vec!["0", "1", "2"], first.shift));
        let mut found = [0; 3];
        (0..scene.geometry.len() as u32).for_each(|i| found[scene.part_of(i) as usize] += 1);
        assert_eq!(found, triangles, "epoch {epoch}");
        let reach = if epoch < 2 { 0.5 } else { 29.5 };
        assert_eq!((scene.bounds.min.x, scene.bounds.max.x), (-reach, reach));
    }
    f.parts[1].swaps[1].keep_crs = false;
    let (scene, _) = load_epoch(&f.recipe(), &f.options, 2, Some(stand)).unwrap();
    assert_eq!((scene.bounds.min.x, scene.bounds.max.x), (-0.5, 29.5), "a box of its own");
}

#[test]
fn coordinates_that_cannot_be_computed_are_refused() {
    let mut f = Fixture::new();
    f.obj("a.obj", TRIANGLE).transform.scale = 1e200;
    f.obj("b.obj", TRIANGLE).transform.offset = DVec3::NAN;
    let report = f.error();
    assert!(report.contains("scene.xml:10") && report.contains("scene.xml:11"), "{report}");
}

#[test]
fn a_scene_over_the_limit_is_refused_with_its_need() {
    let mut f = Fixture::new();
    f.obj("a.obj", TRIANGLE);
    f.options.max_memory = Some(3 * 24 + 16);
    assert_eq!(f.scene().geometry.len(), 1);
    f.options.max_memory = Some(80);
    let report = f.error();
    assert!(report.contains("88 B") && report.contains("80 B"), "{report}");
}

const SLOPE: &str = "mtllib g.mtl\nusemtl g\nv 0 0 10\nv 10 0 20\nv 10 10 20\nv 0 10 10\nf 1 2 3 4\n";

fn on_slope(mode: i64, at: DVec3) -> (Fixture, f64) {
    let mut f = Fixture::new();
    f.file("g.mtl", "newmtl g\nhelios_isGround true\n");
    f.obj("slope.obj", SLOPE);
    // The lowest corner is the last one; the one closest above the slope is the first.
    let thing = f.obj("thing.obj", "v 4 0 3\nv 1 0 1\nv 0 0 0\nf 1 2 3\nv 0 1 2\nf 1 2 4\n");
    thing.transform.offset = at;
    thing.transform.on_ground = mode;
    let (scene, _) = f.load().unwrap();
    let z = scene.to_world(scene.geometry.triangle(3)[2]).z;
    (f, z)
}

#[test]
fn on_ground_moves_a_part_onto_the_plane_below_it() {
    // The plane is z = 10 + x. Lowest corner at (2, 5): height 12. Corner (6, 5): 3 above the lowest, ground
    // 4 higher.
    let at = offset(2.0, 5.0, 50.0);
    let close = |mode, expected: f64| {
        let (_, z) = on_slope(mode, at);
        assert!((z - expected).abs() < 1e-9, "mode {mode}: {z} is not {expected}");
    };
    close(0, 52.0);
    close(1, 14.0);
    close(-5, 14.0);
    close(-1, 15.0);
    close(1000, 15.0);
}

#[test]
fn a_part_without_ground_below_stays_and_says_so() {
    let (f, z) = on_slope(1, offset(200.0, 5.0, 50.0));
    assert_eq!(z, 52.0);
    let (_, d) = f.load().unwrap();
    let warning = d.items().last().unwrap();
    assert!(warning.message.contains("\"1\" is not moved") && warning.place.as_ref().unwrap().line == 11);
}

/// The scene loaded once with stored parts and once with all possible meshes shared.
fn both_ways(f: &mut Fixture) -> [Scene; 2] {
    [super::Sharing::Never, super::Sharing::Always].map(|sharing| {
        f.options.sharing = sharing;
        f.load().unwrap_or_else(|e| panic!("{}", report(&e))).0
    })
}

const CROWN: &str = "mtllib c.mtl\nusemtl wood\nv 0 0 0\nv 0.3 0 0\nv 0 0.4 3\nf 1 2 3\nusemtl leaf\n\
    v -1 -1 3\nv 1 -1.1 3.2\nv 0.1 1 2.9\nf 4 5 6\nv 9 9 9\nf 4 6 3\n";

#[test]
fn sharing_a_mesh_changes_nothing() {
    let mut f = Fixture::new();
    f.file("g.mtl", "newmtl g\nhelios_isGround true\n");
    f.file(
        "c.mtl",
        "newmtl wood\nhelios_reflectance 20\nnewmtl leaf\nhelios_reflectance 60\nhelios_classification 5\n",
    );
    f.obj("slope.obj", SLOPE);
    for i in 0..12 {
        let turn = vlscan_geom::Rotation::about(DVec3::new(0.1, 0.0, 1.0), f64::from(i));
        let part = f.obj("crown.obj", CROWN);
        part.transform.rotation = turn;
        part.transform.scale = 0.5 + 0.1 * f64::from(i);
        part.transform.offset = DVec3::new(1.0 + 0.7 * f64::from(i), 2.0 + 0.5 * f64::from(i), 30.0);
        part.transform.on_ground = [0, 1, -1, 3][i as usize % 4];
        if i == 5 {
            f.obj("other.obj", TRIANGLE).transform.offset = DVec3::new(4.0, 4.0, 20.0);
        }
    }
    let [stored, shared] = both_ways(&mut f);
    assert!(stored.instances.is_none() && shared.geometry.is_empty());
    assert_eq!(shared.instances.as_ref().unwrap().instances.models.len(), 3);
    assert_eq!((shared.shift, shared.bounds), (stored.shift, stored.bounds));
    assert_eq!(shared.parts, stored.parts);
    assert_eq!(shared.primitives(), stored.primitives());
    for i in 0..shared.primitives() as u32 {
        let n = shared.number_when_stored(i);
        assert_eq!(shared.triangle(i), stored.triangle(n), "{i}");
        assert_eq!(shared.part_of(i), stored.part_of(n));
        assert_eq!(shared.material_of(i), stored.material_of(n));
    }
    for x in -60..60 {
        let (x, y) = (f64::from(x) * 0.1, f64::from(x) * 0.05);
        assert_eq!(shared.ground_height(x, y), stored.ground_height(x, y));
    }
    let options = vlscan_trace::BuildOptions::default();
    let trees = [stored.tree(&options), shared.tree(&options)];
    let mut hits = 0;
    for i in 0..4000 {
        let (a, b) = (f64::from(i % 63) / 63.0, f64::from(i / 63) / 64.0);
        let size = stored.bounds.size();
        let origin = stored.bounds.min + DVec3::new(a * size.x, b * size.y, size.z + 50.0);
        let direction = vlscan_geom::unit(DVec3::new(0.1 * a - 0.05, 0.03, -1.0));
        let one = trees[0].nearest_where(&stored.geometry, origin, direction, |_| true);
        let other = trees[1].nearest_where(&shared.geometry, origin, direction, |_| true);
        assert_eq!(one.map(|h| h.t), other.map(|h| h.t));
        assert_eq!(one.map(|h| h.primitive), other.map(|h| shared.number_when_stored(h.primitive)));
        hits += u32::from(one.is_some());
    }
    assert!(hits > 1000, "{hits}");
}

#[test]
fn instances_stay_instances_beside_parts_that_move_or_are_swapped() {
    let mut f = Fixture::new();
    for x in 0..4 {
        f.obj("a.obj", TRIANGLE).transform.offset.x = 3.0 * f64::from(x);
    }
    f.parts[1].motions =
        vec![MotionSequence { id: "m".to_owned(), loops: 0, next: None, motions: Vec::new() }];
    let swap = Swap { epochs: 1, keep_crs: true, vanish: true, loader: None, scale: None, offset: None };
    f.parts[2].swaps = vec![swap];
    f.options.sharing = super::Sharing::Always;
    let first = f.scene();
    for (epoch, expected) in [(0, vec![0, 2, 3]), (1, vec![0, 3])] {
        let (scene, _) = load_epoch(&f.recipe(), &f.options, epoch, Some(SceneFrame::of(&first))).unwrap();
        assert_eq!(scene.instances.as_ref().unwrap().parts, expected, "epoch {epoch}");
        let moving = &scene.moving_parts[0];
        assert_eq!((moving.part, &moving.triangles, scene.geometry.triangles.len()), (1, &(0..1), 1));
    }
}
