//! Tests of complete OBJ files: against an independent reader, in many pieces, and malformed.

use crate::fixture::Fixture;
use crate::{Reflection, Scene};
use proptest::prelude::*;
use std::fmt::Write;
use vlscan_geom::{DVec3, Rotation};
use vlscan_survey::{Loader, MaterialChange, MaterialDefinition, MeshReading, Replaced, UpAxis};

fn world_triangles(scene: &Scene) -> Vec<[DVec3; 3]> {
    (0..scene.geometry.triangles.len())
        .map(|i| scene.geometry.triangle(i).map(|p| scene.to_world(p)))
        .collect()
}

/// The triangles of a file as read by tobj.
fn oracle(path: &std::path::Path) -> Vec<[DVec3; 3]> {
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    let (models, _) = tobj::load_obj(path, &options).unwrap();
    let mut triangles = Vec::new();
    for mesh in models.iter().map(|m| &m.mesh) {
        let corner = |i: u32| DVec3::from_slice(&mesh.positions[3 * i as usize..]);
        triangles.extend(mesh.indices.chunks_exact(3).map(|t| [corner(t[0]), corner(t[1]), corner(t[2])]));
    }
    triangles
}

fn assert_equal_up_to_the_shift(ours: &[[DVec3; 3]], theirs: &[[DVec3; 3]]) {
    assert_eq!(ours.len(), theirs.len());
    for (a, b) in ours.iter().flatten().zip(theirs.iter().flatten()) {
        assert!((*a - *b).abs().max_element() < 1e-9, "{a} is not {b}");
    }
}

#[test]
fn a_file_of_many_pieces_equals_the_oracle() {
    // More than 1 MiB, with quads, pentagons, negative numbers and all entry forms.
    let mut text = String::from("# relief\r\n");
    let side = 120;
    for i in 0..side * side {
        let (x, y) = (f64::from(i % side) * 0.5, f64::from(i / side) * 0.25);
        let _ = writeln!(text, "v {x:.4} {y:.4} {:.7e}", x.sin() * y.cos());
        let _ = writeln!(text, "vt {x} {y}\nvn 0 0 1");
    }
    let count = side * side;
    for i in 0..(side * (side - 1) - 1) {
        let (a, b, c, d) = (i + 1, i + 2, i + side + 2, i + side + 1);
        // At the end of a row a polygon would go on in the next one.
        let is_last = i % side == side - 1;
        let _ = match i % 4 {
            3 if is_last => writeln!(text, "f {a} {b} {c}"),
            0 => writeln!(text, "f {a} {b} {c} {d}"),
            1 => writeln!(text, "f {a}/{a} {b}/{b} {c}/{c}"),
            2 => writeln!(text, "f {} {} {}", a - count - 1, b - count - 1, d - count - 1),
            _ => writeln!(text, "f {a}//{a} {b}//{b} {c}/{c}/{c} {d}//{d} {}//{d}", d.max(2) - 1),
        };
    }
    let filler = "# a comment that makes the file long enough for several pieces\n".repeat(10_000);
    let (head, tail) = text.split_at(text.len() / 2);
    let cut = head.rfind('\n').unwrap() + 1;
    let text = format!("{}{filler}{}{tail}", &head[..cut], &head[cut..]);
    assert!(text.len() > 3 << 20 >> 1);
    let mut f = Fixture::new();
    f.obj("relief.obj", &text);
    let ours = f.scene();
    let theirs = oracle(&f.path().join("relief.obj"));
    assert_equal_up_to_the_shift(&world_triangles(&ours), &theirs);
    f.options.jobs = 1;
    assert_eq!(f.scene().geometry.vertices, ours.geometry.vertices);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_decimal_coordinates_are_read_exactly(points in prop::collection::vec(prop::array::uniform3(-1e7..1e7f64), 3..30), digits in 0usize..15) {
        let mut text = String::new();
        for p in &points {
            let _ = writeln!(text, "v {:.digits$} {:.digits$} {:e}", p[0], p[1], p[2]);
        }
        for i in 3..=points.len() {
            let _ = writeln!(text, "f {} {} {}", i - 2, i - 1, i);
        }
        let mut f = Fixture::new();
        f.obj("p.obj", &text);
        if let Ok((scene, _)) = f.load() {
            let file = f.path().join("p.obj");
            let expected: Vec<_> = oracle(&file).into_iter().filter(|[a, b, c]| (*b - *a).cross(*c - *a) != DVec3::ZERO).collect();
            let local: Vec<_> = expected.iter().map(|t| t.map(|p| p - scene.shift)).collect();
            let ours: Vec<_> = (0..scene.geometry.triangles.len()).map(|i| scene.geometry.triangle(i)).collect();
            prop_assert_eq!(ours, local);
        }
    }

    #[test]
    fn no_bytes_make_the_reader_panic(bytes in prop::collection::vec(any::<u8>(), 0..400), words in prop::collection::vec("(v|f|usemtl|mtllib|-?[0-9]{1,12}|1e300|nan|/|#|\\\\|\n|\r\n| ){1,6}", 0..60)) {
        let mut f = Fixture::new();
        f.obj("a.obj", bytes);
        f.obj("b.obj", words.join(" "));
        f.obj("c.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
        match f.load() {
            Ok((scene, _)) => prop_assert!(!scene.geometry.is_empty()),
            Err(e) => prop_assert_eq!(e.exit_status(), 2),
        }
    }
}

#[test]
fn lines_may_end_in_carriage_returns() {
    let mut f = Fixture::new();
    f.obj("mac.obj", "mtllib m.mtl\rv 0 0 0\rv 1 0 0\rv 0 1 0\rusemtl a\rf 1 2 3\r");
    f.file("m.mtl", "newmtl a\rhelios_reflectance 0.25\r");
    let scene = f.scene();
    assert_eq!(scene.geometry.triangles.len(), 1);
    assert!(scene.materials.iter().any(|m| m.name == "a" && m.reflectance == 0.25));
}

#[test]
fn wrong_numbers_are_named() {
    let mut f = Fixture::new();
    f.obj(
        "x.obj",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 1 1\nf 1 2 9\nf -9 1 2\nf 1 2 4\nf 1 2 2\nf 1 2 3\nf 1 2 \\\n 77\n",
    );
    let Err(vlscan_base::Error::Input(d)) = f.load() else { panic!("a broken file loads") };
    let mut lines: Vec<usize> = d.items().iter().flat_map(|i| i.lines()).collect();
    lines.sort_unstable();
    assert_eq!(lines, [4, 5, 6, 8, 10], "{}", d.text());
    assert!(d.items().iter().all(|i| i.place.as_ref().is_some_and(|p| p.path.ends_with("x.obj"))));
}

#[test]
fn thousands_of_problems_are_counted_and_twenty_shown() {
    let mut f = Fixture::new();
    f.obj("x.obj", format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n{}", "f 1 2 99\n".repeat(5000)));
    let Err(vlscan_base::Error::Input(d)) = f.load() else { panic!("a broken file loads") };
    // The twenty reported problems are equal and merged into one item; the second item counts the others.
    assert_eq!(d.items().len(), 2);
    assert_eq!(d.items()[0].repeats, 19);
    assert!(d.items()[1].message.starts_with("4980 more problems"), "{}", d.items()[1].message);
}

#[test]
fn a_file_cut_anywhere_gives_a_report_and_no_panic() {
    let text =
        "mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1/1 2/2 3/3\nf 1//1 3//3 \\\n4//4\n";
    for end in 0..text.len() {
        let mut f = Fixture::new();
        f.obj("cut.obj", &text[..end]);
        match f.load() {
            Ok((scene, _)) => assert!(scene.geometry.triangles.len() <= 2),
            Err(e) => assert_eq!(e.exit_status(), 2),
        }
    }
}

#[test]
fn latin_1_and_noise_between_good_lines() {
    let mut f = Fixture::new();
    f.file("b\u{fc}sche.mtl", "newmtl x\nKd 1 1 1\nhelios_reflectance 40\n");
    f.obj(
        "x.obj",
        b"# Geb\xe4ude\r\nmtllib b\xfcsche.mtl\r\nusemtl x\r\nv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3\r\n",
    );
    assert_eq!(f.scene().material_of(0).reflection, Reflection::Lambert);
}

#[test]
fn materials_are_looked_up_at_the_faces() {
    let mut f = Fixture::new();
    f.file("sub/two words.mtl", "newmtl a\nhelios_classification 1\nnewmtl b\nhelios_classification 2\n");
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let face = "f 1 2 3\n";
    let text = format!(
        "{vertices}{face}usemtl a # rest\n{face}mtllib two words.mtl\n{face}usemtl b\nusemtl a\n{face}{face}usemtl b\n{face}usemtl nowhere\n{face}usemtl default\n{face}"
    );
    f.obj("sub/x.obj", text);
    let (scene, d) = f.load().unwrap();
    let names: Vec<(&str, i32)> =
        (0..8).map(|i| scene.material_of(i)).map(|m| (m.name.as_str(), m.classification)).collect();
    let expected =
        [("default", 0), ("a", 0), ("a", 1), ("a", 1), ("a", 1), ("b", 2), ("nowhere", 0), ("default", 0)];
    assert_eq!(names, expected);
    let lines: Vec<usize> = d.items().iter().map(|i| i.place.as_ref().unwrap().line).collect();
    assert_eq!(
        lines,
        [5, 15, 1],
        "two names that nothing defines, materials without reflectance: {}",
        d.text()
    );
    assert_eq!(scene.surfaces.len(), 5);
}

#[test]
fn names_with_blanks_are_whole() {
    let mut f = Fixture::new();
    f.file(
        "my  trees.mtl",
        "newmtl Oak bark\nhelios_classification 4\nnewmtl Oak leaf\nhelios_classification 5\n",
    );
    let face = "f 1 2 3\n";
    let text = format!(
        "mtllib my  trees.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl Oak leaf\n{face}usemtl  Oak bark \r\n{face}usemtl Oak\n{face}"
    );
    f.obj("x.obj", text);
    let (scene, d) = f.load().unwrap();
    let found: Vec<(&str, i32)> =
        (0..3).map(|i| scene.material_of(i)).map(|m| (m.name.as_str(), m.classification)).collect();
    assert_eq!(found, [("Oak leaf", 5), ("Oak bark", 4), ("Oak bark", 4)]);
    let first_word = "no material file defines \"Oak\"; \"Oak bark\" is used";
    assert!(d.items()[0].message.contains(first_word), "{}", d.text());
    assert_eq!(d.items()[0].place.as_ref().unwrap().line, 9);
}

#[test]
fn materials_that_are_replaced_need_no_definition() {
    let warnings = |replaced: &[Replaced]| {
        let mut f = Fixture::new();
        f.options.rules.reflectance_fraction = true;
        let material = MaterialDefinition { reflectance: Some(0.3), ..MaterialDefinition::new("x") };
        let change =
            |replaced: &Replaced| MaterialChange { replaced: replaced.clone(), material: material.clone() };
        let faces = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nv 0 0 5\nv 1 0 5\nv 0 1 5\nusemtl glass\nf 4 5 6\n";
        let part = f.obj("x.obj", faces);
        part.changes = replaced.iter().map(change).collect();
        f.load().unwrap().1.text()
    };
    let named = |name: &str| Replaced::Named(name.to_owned());
    let all = warnings(&[]);
    assert!(
        all.contains("material \"default\" has no reflectance") && all.contains("defines \"glass\""),
        "{all}"
    );
    let glass = warnings(&[named("glass")]);
    assert!(glass.contains("\"default\" has no reflectance") && !glass.contains("glass"), "{glass}");
    assert_eq!(warnings(&[named("glass"), named("default")]), "");
    assert_eq!(warnings(&[Replaced::All]), "");
}

#[test]
fn libraries_in_other_spellings() {
    let text = |name: &str| format!("mtllib {name}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n");
    let load = |name: &str| {
        let mut f = Fixture::new();
        f.file("materials/Site.mtl", "newmtl a\nhelios_reflectance 0.5\n");
        f.file("Plot.MTL", "newmtl a\nhelios_reflectance 0.5\n");
        f.obj("x.obj", text(name));
        f.load().unwrap().1.text()
    };
    assert_eq!(load("materials/Site.mtl"), "");
    let respelled = load("materials\\Site.mtl");
    assert!(respelled.contains("`materials/Site.mtl` is read"), "{respelled}");
    let other_case = load("plot.mtl");
    assert!(other_case.contains("did you mean `Plot.MTL`?"), "{other_case}");
}

#[test]
fn a_missing_library_is_a_warning() {
    let mut f = Fixture::new();
    f.obj("x.obj", "mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let (_, d) = f.load().unwrap();
    assert!(d.items()[0].message.contains("gone.mtl"));
    assert_eq!(d.items()[0].place.as_ref().unwrap().line, 1);
}

#[test]
fn y_up_is_turned_before_the_transforms() {
    let mut f = Fixture::new();
    let files = vec![f.file("x.obj", "v 1 2 3\nv 4 5 6\nv 7 8 10\nf 1 2 3\n")];
    let part = f.part(Loader::MeshFiles {
        files,
        reading: MeshReading { up: Some(UpAxis::Y), ..MeshReading::default() },
    });
    part.transform.rotation = Rotation::about_z(std::f64::consts::FRAC_PI_2);
    part.transform.scale = 2.0;
    part.transform.offset = DVec3::new(100.0, 0.0, 0.0);
    let corners = world_triangles(&f.scene())[0];
    for (ours, expected) in corners.iter().zip([[106.0, 2.0, 4.0], [112.0, 8.0, 10.0], [120.0, 14.0, 16.0]]) {
        assert!((*ours - DVec3::from(expected)).length() < 1e-12, "{ours}");
    }
}

#[test]
fn polygons_can_be_left_out_as_the_reference_does() {
    let mut f = Fixture::new();
    f.obj("x.obj", "v 0 0 0\nv 1 0 0\nv 2 1 0\nv 1 2 0\nv 0 1 0\nf 1 2 3 4 5\nf 1 2 3 4\n");
    assert_eq!(f.scene().geometry.triangles.len(), 5);
    f.options.drop_polygons = true;
    let (scene, d) = f.load().unwrap();
    assert_eq!((scene.geometry.triangles.len(), d.items().len()), (2, 1));
}
