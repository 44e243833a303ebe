//! Tests of complete point clouds.

use crate::Scene;
use crate::fixture::{Fixture, report};
use std::fmt::Write;
use vlscan_geom::{DVec3, Rotation};
use vlscan_survey::{Loader, MaterialChoice, XyzLoader};

fn loader(files: Vec<std::path::PathBuf>, separator: &str, voxel_size: f64) -> XyzLoader {
    XyzLoader {
        files,
        separator: separator.to_owned(),
        voxel_size,
        max_color_value: 255.0,
        default_normal: None,
        rgb_columns: None,
        normal_columns: None,
        snap_neighbor_normal: false,
        estimate_normals: 0,
        material: MaterialChoice::default(),
    }
}

/// Loads `text` with settings changed by `change`; a second part far below makes empty clouds loadable.
fn scene(text: &str, separator: &str, change: impl FnOnce(&mut XyzLoader)) -> Scene {
    let mut f = Fixture::new();
    let mut settings = loader(vec![f.file("a.xyz", text)], separator, 1.0);
    change(&mut settings);
    f.part(Loader::Xyz(Box::new(settings)));
    f.scene()
}

fn centres(scene: &Scene) -> Vec<[f64; 3]> {
    scene.geometry.cubes.iter().map(|c| scene.to_world(c.centre).to_array()).collect()
}

#[test]
fn one_cube_per_occupied_cell_in_the_order_of_z_y_x() {
    let text = "//x y z\n2.5 0 0\n0 0 2.9\n\n0.2  0.1\t0.3\r\n0 1.5 0\n2.9 0 0\n";
    let s = scene(text, " ", |_| {});
    let expected = [[0.5, 0.5, 0.5], [2.5, 0.5, 0.5], [0.5, 1.5, 0.5], [0.5, 0.5, 2.5]];
    assert_eq!(centres(&s), expected);
    assert!(s.geometry.cubes.iter().all(|c| c.half == 0.5));
    assert!(s.voxels.iter().all(|v| v.normal().is_none()));
}

#[test]
fn every_character_of_the_separator_separates() {
    let expected = scene("1 2 3\n4 5 6\n", "", |_| {});
    for (text, separator) in
        [("1,2,3\n4, 5 ,6\n", ","), ("1;2,3\n4;5,6,\n", ";,"), ("1\t2\t3\n4\t 5\t6\n", "\t")]
    {
        assert_eq!(centres(&scene(text, separator, |_| {})), centres(&expected), "{text:?}");
    }
}

#[test]
fn columns_are_found_by_the_names_that_a_file_gives_them() {
    let expected = centres(&scene("1 2 3\n4 5 6\n", " ", |_| {}));
    for (text, separator) in [
        ("id,x,y,z\n7,1,2,3\n8,4,5,6\n", ","),
        ("z class x y\n3 2 1 2\n6 2 4 5\n", " "),
        ("//Intensity X Y Z\n9 1 2 3\n9 4 5 6\n", " "),
        ("E;N;Height [cm]\n1;2;300\n4;5;600\n", ";"),
    ] {
        assert_eq!(centres(&scene(text, separator, |_| {})), expected, "{text:?}");
    }
    let named = scene("x y z nx ny nz\n0 0 0 0 0 2\n", " ", |_| {});
    assert_eq!(named.voxels[0].normal(), Some(DVec3::Z));
    let other = scene("x y z red green blue\n0 0 0 0 0 2\n", " ", |_| {});
    assert_eq!(other.voxels[0].normal(), None, "these are colours by their names");
}

#[test]
fn a_wrong_separator_is_named() {
    let mut f = Fixture::new();
    let file = f.file("a.csv", "1,2,3\n4,5,6\n");
    f.part(Loader::Xyz(Box::new(loader(vec![file], " ", 1.0))));
    let report = f.error();
    assert!(report.contains("the separator of the part is") && report.contains("a.csv:1"), "{report}");
}

#[test]
fn lines_may_end_in_carriage_returns() {
    let lines = ["x y z", "1 2 3", "4 5 6", "# note", "7 8 9"];
    let expected = centres(&scene(&lines.join("\n"), " ", |_| {}));
    assert_eq!(expected.len(), 3);
    for text in [
        lines.join("\r"),
        lines.join("\r\n"),
        lines.join("\r") + "\r",
        lines.join("\n").replacen('\n', "\r", 2),
    ] {
        assert_eq!(centres(&scene(&text, " ", |_| {})), expected, "{text:?}");
    }
    let mut f = Fixture::new();
    let file = f.file("a.xyz", "1 2 3\r4 5 6\r7 two 9\r");
    f.part(Loader::Xyz(Box::new(loader(vec![file], " ", 1.0))));
    let report = f.error();
    assert!(report.contains("a.xyz:3:3") && report.contains("7 two 9"), "{report}");
}

#[test]
fn commas_that_do_not_separate_are_decimal_commas() {
    let expected = centres(&scene("1.5 2.5 3.5\n", " ", |_| {}));
    for (text, separator) in [
        ("1,5 2,5 3,5\n", " "),
        ("1,5\t2,5\t3,5\n", "\t"),
        ("1,5;2,5;3,5\n", ";"),
        ("\"x\";\"y\";\"z\"\n\"1,5\";\"2,5\";\"3,5\"\n", ";"),
    ] {
        assert_eq!(centres(&scene(text, separator, |_| {})), expected, "{text:?}");
    }
    for (text, separator) in
        [("1,5 2,5 3,5\n", ","), ("1,5\t2,5\t3,5\n", ","), ("1,5;2,5;3,5\n", " "), ("1,5;2,5;3,5\n", ",")]
    {
        let message =
            scene_of("a.csv", text.as_bytes(), |l| l.separator = separator.to_owned()).err().unwrap();
        let is_named = message.contains("the columns are separated by");
        assert!(is_named && message.contains("a.csv:"), "{text:?} by {separator:?}: {message}");
    }
}

/// The warnings of a cloud in these bytes.
fn warnings(name: &str, bytes: &[u8], change: impl FnOnce(&mut XyzLoader)) -> String {
    let mut f = Fixture::new();
    let mut settings = loader(vec![f.file(name, bytes)], " ", 0.5);
    change(&mut settings);
    f.part(Loader::Xyz(Box::new(settings)));
    f.load().unwrap().1.text()
}

#[test]
fn what_is_not_used_as_written_is_told() {
    let classes = warnings("a.xyz", b"x y z class\n1 2 3 4\n1 2 3 300\n1 2 3 2.5\n1 2 3 nan\n", |_| {});
    for part in
        ["class \"300\" is not a whole number from 0 to 255, 255 counts", "a.xyz:3:7", "\"2.5\"", "\"nan\""]
    {
        assert!(classes.contains(part), "{part} is missing from {classes}");
    }
    let normals = b"1 2 3 0 0 0\n1 2 3 0 0 1\n1 2 3 a b c\n";
    let left_out = warnings("a.xyz", normals, |_| {});
    assert!(left_out.contains("left out: 2 of them") && left_out.contains("defaultNormal"), "{left_out}");
    assert_eq!(warnings("a.xyz", normals, |l| l.default_normal = Some(DVec3::Z)), "");
    assert_eq!(warnings("a.xyz", normals, |l| l.estimate_normals = 1), "");
    let mut points = cloud();
    points[3].1 = DVec3::ZERO;
    let left_out = warnings("a.ply", &as_ply(&points, true, "normals"), |_| {});
    assert!(left_out.contains("left out: 1 of them") && left_out.contains("a.ply"), "{left_out}");
}

#[test]
fn colours_and_halves_of_numbers_are_unlikely_normals() {
    for (text, separator) in [("1 2 3 128 64 20\n", " "), ("1,5,2,5,3,5\n", ",")] {
        let said = warnings("a.xyz", text.as_bytes(), |l| l.separator = separator.to_owned());
        assert!(said.contains("are read as a normal, whose length is") && said.contains("a.xyz:1"), "{said}");
    }
    assert_eq!(warnings("a.xyz", b"1 2 3 0 0 1\n", |_| {}), "");
    let colours = |l: &mut XyzLoader| l.rgb_columns = Some([3, 4, 5]);
    assert_eq!(warnings("a.xyz", b"1 2 3 128 64 20\n", colours), "");
    assert_eq!(warnings("a.xyz", b"x y z r g b\n1 2 3 128 64 20\n", |_| {}), "");
}

#[test]
fn normals_come_from_their_columns() {
    /// A scene whose points without a usable normal are warned of.
    fn warned(text: &str, change: impl FnOnce(&mut XyzLoader)) -> Scene {
        scene_of("a.xyz", text.as_bytes(), |l| {
            l.voxel_size = 1.0;
            change(l);
        })
        .unwrap()
    }
    let text = "0 0 0 0 0 2\n0.5 0.5 0.5 2 0 0\n0.9 0.9 0.9 nan 0 1\n1 1 1 0 0 0\n";
    let normal = |s: &Scene| s.voxels[0].normal().map(|n| n.to_array());
    let diagonal = f64::from(0.5f32.sqrt());
    assert_eq!(normal(&warned(text, |_| {})), Some([diagonal, 0.0, diagonal]), "mean of the good ones");
    assert_eq!(normal(&warned(text, |l| l.snap_neighbor_normal = true)), Some([1.0, 0.0, 0.0]));
    assert_eq!(normal(&scene(text, " ", |l| l.rgb_columns = Some([3, 4, 5]))), None, "these are colours");
    let moved = scene("0 0 0 9 9 0 3 0\n", " ", |l| l.normal_columns = Some([5, 6, 7]));
    assert_eq!(normal(&moved), Some([0.0, 1.0, 0.0]));
    let bad = "0 0 0 0 0 0\n5 5 5 0 0 1\n";
    assert_eq!(warned(bad, |_| {}).voxels.len(), 1, "a point with a useless normal is left out");
    assert_eq!(
        scene(bad, " ", |l| l.default_normal = Some(DVec3::X * 3.0)).voxels[0].normal(),
        Some(DVec3::X)
    );
}

#[test]
fn estimated_normals_need_three_points() {
    let mut text = String::from("9 9 9\n8.9 8.9 8.9\n");
    for i in 0..30 {
        let (x, y) = (f64::from(i % 6) * 0.1, f64::from(i / 6) * 0.1);
        let _ = writeln!(text, "{x} {y} {}", 0.5 * x);
    }
    let estimated = scene(&text, " ", |l| l.estimate_normals = 1);
    assert_eq!(estimated.voxels.len(), 1, "the cell of two points is left out");
    let expected = vlscan_geom::unit(DVec3::new(-0.5, 0.0, 1.0));
    assert!(estimated.voxels[0].normal().unwrap().dot(expected).abs() > 1.0 - 1e-6);
    let filled = scene(&text, " ", |l| {
        l.estimate_normals = 2;
        l.default_normal = Some(DVec3::Z);
    });
    assert_eq!(filled.voxels[1].normal(), Some(DVec3::Z));
}

#[test]
fn clouds_scale_and_turn_as_a_whole_and_cubes_stay_upright() {
    let mut f = Fixture::new();
    let files = vec![f.file("a.xyz", "0 0 0 1 0 0\n3 0 0 1 0 0\n")];
    let part = f.part(Loader::Xyz(Box::new(loader(files, " ", 1.0))));
    part.transform.rotation = Rotation::about_z(std::f64::consts::FRAC_PI_2);
    part.transform.scale = 2.0;
    part.transform.offset = DVec3::new(0.0, 0.0, 5.0);
    let s = f.scene();
    for (ours, expected) in centres(&s).iter().zip([[0.0, 1.0, 5.0], [0.0, 5.0, 5.0]]) {
        assert!((DVec3::from(*ours) - DVec3::from(expected)).length() < 1e-12, "{ours:?}");
    }
    assert_eq!(s.geometry.cubes[0].half, 1.0);
    assert!((s.voxels[0].normal().unwrap() - DVec3::Y).length() < 1e-7);
}

#[test]
fn lines_that_are_no_points_are_named() {
    let mut f = Fixture::new();
    let file = f.file("a.xyz", "x y z\n# note\n1 2\n1 2 3\n1 2 inf\n1 2 1e300\nabc\n");
    f.part(Loader::Xyz(Box::new(loader(vec![file], " ", 1.0))));
    let report = f.error();
    for place in ["a.xyz:3:4", "a.xyz:5:5", "a.xyz:6:5", "a.xyz:7:1"] {
        assert!(report.contains(place), "{place} is missing from {report}");
    }
    assert!(!report.contains("a.xyz:1:"), "the first line names the columns: {report}");
}

#[test]
fn a_short_last_line_is_cut() {
    let mut f = Fixture::new();
    let file = f.file("a.xyz", "1 2 3 0 0 1\n1 2 3 0 0");
    f.part(Loader::Xyz(Box::new(loader(vec![file], " ", 1.0))));
    assert!(f.error().contains("a.xyz:2:1"));
}

#[test]
fn settings_that_cannot_work_are_errors() {
    for (size, normal) in [(-1.0, None), (f64::NAN, None), (1e-9, None), (1.0, Some(DVec3::ZERO))] {
        let mut f = Fixture::new();
        let mut settings = loader(vec![f.file("a.xyz", "0 0 0\n1e6 1e6 1e6\n")], " ", size);
        settings.default_normal = normal;
        f.part(Loader::Xyz(Box::new(settings)));
        assert!(f.error().contains("scene.xml:10"));
    }
    assert_eq!(scene("0 0 0\n1.5 0 0\n", " ", |l| l.voxel_size = 0.0).geometry.cubes.len(), 2, "0 means 1 m");
}

#[test]
fn many_pieces_and_threads_give_the_same_cubes() {
    let mut text = String::new();
    for i in 0..60_000u32 {
        let r = |m: u32| f64::from(i.wrapping_mul(m) >> 12) / 1e5;
        let _ = writeln!(
            text,
            "{} {} {} {} {} 1",
            r(2_654_435_761),
            r(40_503_001),
            r(97_531_357),
            r(77_777),
            r(313_131)
        );
    }
    assert!(text.len() > 2 << 20);
    let load = |jobs| {
        let mut f = Fixture::new();
        let settings = loader(vec![f.file("a.xyz", &text)], " ", 0.7);
        f.part(Loader::Xyz(Box::new(settings)));
        f.options.jobs = jobs;
        f.scene()
    };
    let (one, three) = (load(1), load(3));
    assert!(one.numbers() > 1000);
    let all =
        |scene: &Scene| (0..scene.numbers() as u32).map(|i| scene.voxel_and_cube(i)).collect::<Vec<_>>();
    assert_eq!(all(&one), all(&three));
}

/// Points on a grid of 1/1024 m, which LAS stores exactly: position, normal, class.
fn cloud() -> Vec<(DVec3, DVec3, u8)> {
    (0..3000u32)
        .map(|i| {
            let r = |m: u32| f64::from(i.wrapping_mul(m) >> 20) / 1024.0;
            let position = DVec3::new(r(2_654_435_761) + 512_000.5, r(40_503_001), r(97_531_357) * 2.0);
            let normal = DVec3::new(r(77_777) - 2.0, 0.25, 1.0);
            (position, normal, if i % 3 == 0 { 2 } else { 5 })
        })
        .collect()
}

fn as_text(points: &[(DVec3, DVec3, u8)], normals: bool) -> Vec<u8> {
    let mut text = String::new();
    for (p, n, _) in points {
        let _ = match normals {
            true => writeln!(text, "{} {} {} {} {} {}", p.x, p.y, p.z, n.x, n.y, n.z),
            false => writeln!(text, "{} {} {}", p.x, p.y, p.z),
        };
    }
    text.into_bytes()
}

fn as_las(points: &[(DVec3, DVec3, u8)], format: u8, compressed: bool, classes: bool) -> Vec<u8> {
    use las::point::{Classification, Format};
    let mut builder = las::Builder::from((1, if format < 6 { 2 } else { 4 }));
    builder.point_format = Format::new(format).unwrap();
    builder.point_format.is_compressed = compressed;
    let transform = |offset| las::Transform { scale: 1.0 / 1024.0, offset };
    builder.transforms = las::Vector { x: transform(512_000.0), y: transform(0.0), z: transform(-8.0) };
    let mut writer =
        las::Writer::new(std::io::Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
    for (p, _, class) in points {
        let class = if classes { *class } else { 0 };
        let point = las::Point {
            x: p.x,
            y: p.y,
            z: p.z,
            gps_time: Some(1.0).filter(|_| format != 0),
            classification: Classification::new(class).unwrap(),
            ..las::Point::default()
        };
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
    writer.into_inner().unwrap().into_inner()
}

fn as_ply(points: &[(DVec3, DVec3, u8)], binary: bool, more: &str) -> Vec<u8> {
    let format = if binary { "binary_little_endian" } else { "ascii" };
    let mut file = format!(
        "ply\nformat {format} 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n",
        points.len()
    )
    .into_bytes();
    let has = |what: &str| more.contains(what);
    if has("normals") {
        file.extend(b"property float nx\nproperty float ny\nproperty float nz\n");
    }
    file.extend(b"property uchar red\n");
    if has("classes") {
        file.extend(b"property uchar classification\n");
    }
    file.extend(b"end_header\n");
    for (p, n, class) in points {
        let mut numbers: Vec<(f64, usize)> = p.to_array().map(|x| (x, 8)).to_vec();
        if has("normals") {
            numbers.extend(n.to_array().map(|x| (x, 4)));
        }
        numbers.push((200.0, 1));
        if has("classes") {
            numbers.push((f64::from(*class), 1));
        }
        for (x, size) in numbers {
            match (binary, size) {
                (false, _) => file.extend(format!("{x} ").into_bytes()),
                (true, 8) => file.extend(x.to_le_bytes()),
                (true, 4) => file.extend((x as f32).to_le_bytes()),
                _ => file.push(x as u8),
            }
        }
        if !binary {
            file.push(b'\n');
        }
    }
    file
}

/// Loads the bytes of a file and returns the scene or the error messages.
fn scene_of(name: &str, bytes: &[u8], change: impl FnOnce(&mut XyzLoader)) -> Result<Scene, String> {
    let mut f = Fixture::new();
    let mut settings = loader(vec![f.file(name, bytes)], " ", 0.5);
    change(&mut settings);
    f.part(Loader::Xyz(Box::new(settings)));
    f.load().map(|(scene, _)| scene).map_err(|e| report(&e))
}

#[test]
fn the_same_cloud_gives_the_same_scene_in_every_format() {
    let points = cloud();
    let load = |name: &str, bytes: Vec<u8>, estimate| {
        let change = |l: &mut XyzLoader| l.estimate_normals = estimate;
        scene_of(name, &bytes, change).unwrap_or_else(|e| panic!("{name}: {e}"))
    };
    for estimate in [0, 1] {
        let text = load("a.xyz", as_text(&points, false), estimate);
        assert!(text.voxels.len() > 100);
        for (name, bytes) in [
            ("a.las", as_las(&points, 1, false, false)),
            ("b.las", as_las(&points, 6, false, false)),
            ("a.laz", as_las(&points, 0, true, false)),
            ("b.laz", as_las(&points, 6, true, false)),
            ("a.ply", as_ply(&points, false, "")),
            ("b.ply", as_ply(&points, true, "")),
        ] {
            let other = load(name, bytes, estimate);
            assert_eq!(other.geometry.cubes, text.geometry.cubes, "{name}");
            assert_eq!(other.voxels, text.voxels, "{name}");
            assert_eq!(other.materials, text.materials, "{name}");
        }
    }
    let text = load("n.xyz", as_text(&points, true), 0);
    assert!(text.voxels.iter().all(|v| v.normal().is_some()));
    for binary in [false, true] {
        let other = load("n.ply", as_ply(&points, binary, "normals"), 0);
        assert_eq!((other.geometry.cubes, other.voxels), (text.geometry.cubes.clone(), text.voxels.clone()));
    }
}

#[test]
fn cubes_have_the_class_of_most_of_their_points_unless_a_material_says_otherwise() {
    let points: Vec<_> =
        cloud().into_iter().map(|(p, n, class)| (p, n, if p.z > 4.0 { class } else { 0 })).collect();
    let classes = |scene: &Scene| -> Vec<i32> {
        let first = scene.geometry.triangles.len();
        let class = |i: usize| {
            let surface = scene.surface((first + i) as u32);
            (scene.geometry.cubes[i].centre.z, scene.materials[surface.material as usize].classification)
        };
        let mut of_cubes: Vec<_> = (0..scene.geometry.cubes.len()).map(class).collect();
        of_cubes.sort_by(|a, b| a.0.total_cmp(&b.0));
        of_cubes.into_iter().map(|c| c.1).collect()
    };
    let files = [
        ("a.las", as_las(&points, 1, false, true)),
        ("a.laz", as_las(&points, 6, true, true)),
        ("a.ply", as_ply(&points, true, "classes")),
    ];
    for (name, bytes) in files {
        let scene = scene_of(name, &bytes, |_| {}).unwrap();
        let found = classes(&scene);
        assert_eq!((found[0], found.iter().max()), (0, Some(&5)), "{name}");
        let mut f = Fixture::new();
        let mut settings = loader(vec![f.file(name, &bytes)], "", 0.5);
        settings.material.file =
            Some(f.file("m.mtl", "newmtl m\nhelios_classification 9\nhelios_reflectance 40\n"));
        f.part(Loader::Xyz(Box::new(settings)));
        assert!(classes(&f.scene()).iter().all(|c| *c == 9));
    }
}

#[test]
fn damaged_clouds_are_refused_and_never_panic() {
    let points = cloud();
    for (name, whole) in [
        ("a.las", as_las(&points, 6, false, true)),
        ("a.laz", as_las(&points, 6, true, true)),
        ("b.laz", as_las(&points, 1, true, true)),
        ("a.ply", as_ply(&points, false, "normals")),
        ("b.ply", as_ply(&points, true, "normals")),
    ] {
        for tenth in 0..10 {
            let cut = scene_of(name, &whole[..whole.len() * tenth / 10], |_| {});
            let message = cut.err().unwrap_or_else(|| panic!("{name} cut at {tenth} tenths is loaded"));
            assert!(message.contains(name), "{message}");
        }
        // Replaces every second byte of the header, and some of the others.
        let rest = (400..whole.len()).step_by(whole.len() / 40);
        for at in (0..400).step_by(2).chain(rest) {
            for value in [0xff, whole[at] ^ 0x11] {
                let mut bytes = whole.clone();
                bytes[at] = value;
                let _ = scene_of(name, &bytes, |_| {});
            }
        }
    }
    for (name, bytes) in [("a.las", &b"1 2 3\n"[..]), ("a.ply", b"plyx"), ("a.laz", b"")] {
        let message = scene_of(name, bytes, |_| {}).err().unwrap();
        assert!(message.contains("LA") || message.contains("PLY"), "{message}");
    }
}

#[test]
fn points_without_a_place_are_refused() {
    let mut points = cloud();
    for bad in [f64::NAN, f64::INFINITY, 1e300] {
        points[7].0.y = bad;
        let message = scene_of("a.ply", &as_ply(&points, true, ""), |_| {}).err().unwrap();
        assert!(message.contains("point 7"), "{message}");
    }
}

#[test]
fn lines_of_other_lengths_than_the_first_are_reported() {
    let said = |text: &str, separator: &str| {
        let mut f = Fixture::new();
        let settings = loader(vec![f.file("a.xyz", text)], separator, 1.0);
        f.part(Loader::Xyz(Box::new(settings)));
        f.load().map_or_else(|e| e.to_string(), |(_, warnings)| warnings.text())
    };
    // Many lines, so that the file is read in pieces.
    let points = "1,2,3\n".repeat(1000);
    let reported = said(&format!("{points}4,5,6,7\n{points}0,30,3,00,0,90\n"), ",");
    assert!(reported.contains("2 lines have more values than line 1, which has 3"), "{reported}");
    assert!(reported.contains("a.xyz:1001:7") && reported.contains("a decimal comma divides"), "{reported}");
    let reported = said("1 2 3 0 0 1\n4 5 6\n7 8 9\n", " ");
    assert!(
        reported.contains("2 lines have fewer values than line 1") && reported.contains("a.xyz:2:6"),
        "{reported}"
    );
    let reported = said("1 2 3 0 0 1 9 9 9 5 5\n4 5 6 0 0 1 9 9 9 5 5\n", " ");
    assert!(reported.contains("columns 10 to 11 have no names and are not read"), "{reported}");
    assert!(said("1 2 3 7\n4 5 6 8\n", " ").contains("column 4 has no name and is not read"));
    assert_eq!(said(&points, ","), "");
    assert_eq!(said("1 2 3 0 0 1 9 9 9\n", " "), "");
}

#[test]
fn voxels_have_the_mean_colour_of_their_points() {
    let colours = |numbers: [[u32; 3]; 3], max: f64| {
        let mut f = Fixture::new();
        f.options.colours = true;
        let mut text = String::new();
        for ([r, g, b], x) in numbers.into_iter().zip(["0.2", "0.4", "1.5"]) {
            writeln!(text, "{x} 0 0 {r} {g} {b}").unwrap();
        }
        let mut settings = loader(vec![f.file("a.xyz", text)], " ", 1.0);
        (settings.rgb_columns, settings.max_color_value) = (Some([3, 4, 5]), max);
        f.part(Loader::Xyz(Box::new(settings)));
        let scene = f.scene();
        [0, 1].map(|cube| scene.colour_at(cube, None, DVec3::ZERO))
    };
    assert_eq!(colours([[10, 20, 30], [20, 30, 31], [1, 2, 255]], 255.0), [[15, 25, 31], [1, 2, 255]]);
    for factor in [256, 257] {
        let numbers = [[200, 100, 7], [202, 100, 7], [255, 1, 0]].map(|row| row.map(|c| c * factor));
        assert_eq!(colours(numbers, 255.0), [[201, 100, 7], [255, 1, 0]], "{factor}");
    }
    assert_eq!(colours([[0, 20, 100]; 3], 100.0), [[0, 51, 255]; 2]);
}
