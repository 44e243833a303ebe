//! Stands from inventories: trees stand where the table says, as high as it says, and labels lead back to it.

use crate::common::{folder, run, succeed, text};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// A slope, two species of tree models (pyramids; the second one away from the origin), an inventory.
fn write_inputs(folder: &Path) {
    fs::write(
        folder.join("slope.obj"),
        "mtllib slope.mtl\nusemtl soil\nv -60 -60 -6\nv 60 -60 6\nv 60 60 6\nv -60 60 -6\nf 1 2 3\nf 1 3 4\n",
    )
    .unwrap();
    fs::write(folder.join("slope.mtl"), "newmtl soil\nhelios_isGround true\nhelios_classification 2\n")
        .unwrap();
    fs::create_dir(folder.join("models")).unwrap();
    let pyramid = |x: f64, radius: f64, height: f64| {
        let mut obj = String::new();
        for (dx, dy, z) in [(-1, -1, 0.0), (1, -1, 0.0), (1, 1, 0.0), (-1, 1, 0.0), (0, 0, height)] {
            let _ = writeln!(obj, "v {} {} {z}", x + radius * f64::from(dx), radius * f64::from(dy));
        }
        obj + "f 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n"
    };
    fs::write(folder.join("models/spruce_1.obj"), pyramid(0.0, 1.0, 10.0)).unwrap();
    fs::write(folder.join("models/beech_old.obj"), pyramid(500.0, 3.0, 12.0)).unwrap();
    let mut inventory = "id,x,y,height,species,dbh\n".to_owned();
    for i in 0..40 {
        let species = if i % 4 == 0 { "Beech" } else { "Norway spruce" };
        let _ = writeln!(
            inventory,
            "t{i},{},{},{},{species},30",
            (i % 8) * 12 - 42,
            (i / 8) * 12 - 24,
            8 + i % 5
        );
    }
    fs::write(folder.join("plot.csv"), inventory).unwrap();
}

fn rows(path: &Path) -> Vec<BTreeMap<String, String>> {
    let table = fs::read_to_string(path).unwrap();
    let mut lines = table.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let names = lines.next().unwrap();
    lines.map(|fields| names.iter().cloned().zip(fields).collect()).collect()
}

#[test]
fn trees_stand_on_the_ground_as_high_as_measured() {
    let dir = folder();
    write_inputs(dir.path());
    let args = ["scene", "stand", "plot.csv", "--trees", "models", "--terrain", "slope.obj", "-o", "stand"];
    let said = text(&succeed(dir.path(), &args).stderr);
    assert!(said.contains("40 trees of 2 models"), "{said}");
    let labels = rows(&dir.path().join("stand/labels.csv"));
    assert_eq!(labels.len(), 40);
    let number = |row: &BTreeMap<String, String>, key: &str| row[key].parse::<f64>().unwrap();
    for row in &labels {
        assert!((number(row, "z") - 0.1 * number(row, "x")).abs() < 1e-3, "{row:?}");
        let expected = if row["species"] == "Beech" { "beech_old" } else { "spruce_1" };
        assert_eq!(row["model"], expected);
    }
    // Flown over: every tree's highest point is its top.
    succeed(
        dir.path(),
        &[
            "plan",
            "airborne",
            "--scanner",
            "riegl_vux-1uav",
            "--scene",
            "stand/stand.xml",
            "--height",
            "60",
            "--density",
            "60",
            "-o",
            "flight.toml",
        ],
    );
    let args = ["run", "flight.toml", "-o", "-", "--format", "csv", "--columns", "X,Y,Z,Part", "-q"];
    let table = text(&succeed(dir.path(), &args).stdout);
    let mut tops: BTreeMap<u32, [f64; 3]> = BTreeMap::new();
    for line in table.lines().skip(1) {
        let values: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
        let top = tops.entry(values[3] as u32).or_insert([0.0, 0.0, f64::MIN]);
        if values[2] > top[2] {
            *top = [values[0], values[1], values[2]];
        }
    }
    for row in &labels {
        let top = tops[&row["part"].parse().unwrap()];
        let aside = (top[0] - number(row, "x")).hypot(top[1] - number(row, "y"));
        let above = top[2] - number(row, "z");
        assert!(aside < 0.6 && (above / number(row, "height") - 1.0).abs() < 0.15, "{row:?}: {top:?}");
    }
}

/// A tree of 10 m: a stem of 0.3 m and a crown of 4 m, both round.
fn round_tree() -> String {
    let mut mesh = String::from("mtllib tree.mtl\n");
    let mut count = 0;
    for (material, radius, low, high) in [("Rinde", 0.15, 0.0, 10.0), ("Laub", 2.0, 4.0, 9.0)] {
        let _ = writeln!(mesh, "usemtl {material}");
        for side in 0..48 {
            let (sin, cos) = (f64::from(side) * std::f64::consts::TAU / 48.0).sin_cos();
            let (x, y) = (radius * cos, radius * sin);
            let _ = writeln!(mesh, "v {x:.6} {y:.6} {low}\nv {x:.6} {y:.6} {high}");
        }
        for side in 0..48 {
            let (a, b) = (count + 2 * side + 1, count + 2 * ((side + 1) % 48) + 1);
            let _ = writeln!(mesh, "f {a} {b} {} {}", b + 1, a + 1);
        }
        count += 96;
    }
    mesh
}

/// Labels hold the measures of the geometry, which has the crown of the inventory; its other columns are
/// beside them.
#[test]
fn labels_are_measures_of_the_trees_as_placed() {
    let dir = folder();
    let at = |name: &str| dir.path().join(name);
    fs::create_dir(at("models")).unwrap();
    fs::write(at("models/oak.obj"), round_tree()).unwrap();
    fs::write(
        at("models/tree.mtl"),
        "newmtl Rinde\nhelios_reflectance 0.4\nnewmtl Laub\nhelios_reflectance 0.5\n",
    )
    .unwrap();
    let number = |row: &BTreeMap<String, String>, key: &str| row[key].parse::<f64>().unwrap();
    let one = |row: &str, rest: &[&str]| {
        fs::write(at("plot.csv"), format!("x,y,height,crown,dbh,species\n{row}\n")).unwrap();
        succeed(
            dir.path(),
            &[&["scene", "stand", "plot.csv", "-o", "stand", "--force", "-q"], rest].concat(),
        );
        let json = text(&succeed(dir.path(), &["scene", "info", "stand/stand.xml", "--json"]).stdout);
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        (rows(&at("stand/labels.csv")).remove(0), json)
    };
    let (row, info) = one("3,4,20,9,0.60,oak", &["--trees", "models"]);
    let size = |axis: &str| {
        let end = |end: &str| info["bounds_m"][end][if axis == "x" { 0 } else { 2 }].as_f64().unwrap();
        end("max") - end("min")
    };
    assert!((size("x") - 9.0).abs() < 0.03 && (size("z") - 20.0).abs() < 1e-3, "{info}");
    let stem = number(&row, "dbh");
    assert!((stem - 0.675).abs() < 0.002, "the stem of the model, 9/4 as wide: {row:?}");
    for (key, expected) in [("crown", 9.0), ("height", 20.0), ("crown_given", 9.0), ("dbh_given", 0.6)] {
        assert!((number(&row, key) - expected).abs() < 0.01, "{key}: {row:?}");
    }
    // The side of a tube of 2π·4.5 m by 10 m. The bark is no leaf.
    let leaves = info["leaf_area_m2"].as_f64().unwrap();
    assert!((leaves / (std::f64::consts::TAU * 4.5 * 10.0) - 1.0).abs() < 2e-3, "{leaves}");
    let (row, _) = one("0,0,5,,0.3,Yucca", &["--trees", "models"]);
    assert_eq!((row["species"].as_str(), row["species_given"].as_str()), ("oak", "Yucca"));
    assert!((number(&row, "crown") - 2.0).abs() < 0.01 && row["crown_given"].is_empty(), "{row:?}");
    assert!((number(&row, "dbh") - 0.15).abs() < 0.001, "{row:?}");
    let (row, info) = one("0,0,22,12,0.90,beech", &[]);
    assert!((number(&row, "crown") - 12.0).abs() < 0.01 && number(&row, "dbh_given") == 0.9, "{row:?}");
    assert!((0.2..2.5).contains(&number(&row, "dbh")) && number(&row, "dbh") != 0.9, "{row:?}");
    assert!(info["leaf_area_m2"].as_f64().unwrap() > 1.0);
    // A name that may be of anything, and the key that decides.
    fs::write(at("models/oak.obj"), round_tree().replace("Laub", "m_7")).unwrap();
    let materials = |leaf: &str| {
        format!("newmtl Rinde\nhelios_reflectance 0.4\nnewmtl m_7\nhelios_reflectance 0.5\n{leaf}")
    };
    fs::write(at("models/tree.mtl"), materials("")).unwrap();
    let (_, info) = one("0,0,10,,,oak", &["--trees", "models"]);
    assert!(info["leaf_area_m2"].is_null() && info["parts"][0]["leaf_area_m2"].is_null(), "{info}");
    let shown = text(&succeed(dir.path(), &["scene", "info", "stand/stand.xml"]).stdout);
    assert!(shown.contains("unknown"), "{shown}");
    fs::write(at("models/tree.mtl"), materials("vlscan_leaf true\n")).unwrap();
    let (_, info) = one("0,0,10,,,oak", &["--trees", "models"]);
    assert!(info["parts"][0]["leaf_area_m2"].as_f64().unwrap() > 50.0, "{info}");
}

/// A folder with `--copy` is found after it was moved and its sources are gone: the same trees stand on the
/// same ground.
#[test]
fn a_copied_stand_can_be_moved() {
    let dir = folder();
    write_inputs(dir.path());
    let at = |name: &str| dir.path().join(name);
    let common = ["scene", "stand", "plot.csv", "--trees", "models", "--terrain", "slope.obj"];
    succeed(dir.path(), &[&common[..], &["--copy", "-o", "stand"]].concat());
    let facts = |scene: &str| {
        let json = text(&succeed(dir.path(), &["scene", "info", scene, "--json"]).stdout);
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        (json["primitives"].clone(), json["bounds_m"].clone(), json["materials"].clone())
    };
    let before = facts("stand/stand.xml");
    fs::rename(at("stand"), at("moved")).unwrap();
    fs::remove_dir_all(at("models")).unwrap();
    fs::remove_file(at("slope.mtl")).unwrap();
    assert_eq!(facts("moved/stand.xml"), before);
}

/// Without models and terrain: trees of the generator on flat ground, by species in other languages.
#[test]
fn a_stand_needs_no_models_and_no_terrain() {
    let dir = folder();
    let table =
        "x;y;Höhe;Baumart\n0;0;21,5;Fichte\n6;2;18;Fagus sylvatica\n-4;7;12;Wald-Kiefer\n0;9;9;Yucca\n";
    fs::write(dir.path().join("plot.csv"), table).unwrap();
    let args = ["scene", "stand", "plot.csv", "--flat", "-o", "stand"];
    let said = text(&succeed(dir.path(), &args).stderr);
    let kiefer = "note: 1 tree of species `Wald-Kiefer` has a model of spruce";
    let yucca = "warning: 1 tree of species `Yucca` has a model of ";
    assert!(said.contains(kiefer) && said.contains(yucca), "{said}");
    assert!(!said.contains("Fichte") && !said.contains("Fagus"), "{said}");
    let labels = rows(&dir.path().join("stand/labels.csv"));
    let models: Vec<&str> = labels.iter().map(|row| row["model"].split('_').next().unwrap()).collect();
    assert_eq!(models[..3], ["spruce", "beech", "spruce"]);
    let json = text(&succeed(dir.path(), &["scene", "info", "stand/stand.xml", "--json"]).stdout);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let parts = json["parts"].as_array().unwrap();
    assert_eq!((parts.len(), &parts[0]["class"], &parts[0]["areas_m2"][0]), (5, &2.into(), &2450.0.into()));
    for (row, part) in labels.iter().zip(&parts[1..]) {
        let height: f64 = row["height"].parse().unwrap();
        assert!((part["height_m"].as_f64().unwrap() / height - 1.0).abs() < 0.02, "{row:?} {part}");
    }
    fs::write(dir.path().join("sloped.csv"), "x,y,z,height\n0,0,1,20\n5,5,2,20\n").unwrap();
    let refused = run(dir.path(), &["scene", "stand", "sloped.csv", "--flat", "-o", "other"]);
    assert!(!refused.status.success() && text(&refused.stderr).contains("leave out --flat"));
}

#[test]
fn epochs_are_scenes_and_the_same_seed_gives_the_same_files() {
    let dir = folder();
    write_inputs(dir.path());
    let make = |out: &str, seed: &str| {
        let args = [
            "scene",
            "stand",
            "plot.csv",
            "--trees",
            "models",
            "--terrain",
            "slope.obj",
            "--epochs",
            "3",
            "--growth",
            "10",
            "--thinning",
            "20",
            "--storm",
            "10",
            "--seed",
            seed,
            "-o",
            out,
            "-q",
        ];
        succeed(dir.path(), &args);
        let read = |name: &str| fs::read_to_string(dir.path().join(out).join(name)).unwrap();
        ["stand.xml", "trees_0.csv", "trees_1.csv", "trees_2.csv", "labels_2.csv"].map(read)
    };
    let [first, again, other] = [make("a", "1"), make("b", "1"), make("c", "2")];
    assert_eq!(first, again);
    assert_ne!(first[2], other[2]);
    let counts = [1, 2, 3].map(|i| first[i].lines().count() - 1);
    assert!(counts[0] == 40 && counts[1] < 38 && counts[2] < counts[1], "{counts:?}");
    let info = text(&succeed(dir.path(), &["scene", "info", "a/stand.xml#stand_2", "--json"]).stdout);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    // The slope and the trees.
    assert_eq!(info["parts"].as_array().unwrap().len(), counts[2] + 1, "{info}");
}

#[test]
fn mistakes_are_answered() {
    let dir = folder();
    write_inputs(dir.path());
    fs::write(dir.path().join("oak.csv"), "x,y,height,species\n0,0,10,oak\n500,0,10,beech\n").unwrap();
    fs::write(dir.path().join("bad.csv"), "x,y,height\n0,0,tall\n").unwrap();
    fs::create_dir(dir.path().join("flat")).unwrap();
    fs::write(dir.path().join("flat/oak.obj"), "v 0 0 1\nv 1 0 1\nv 0 1 1\nf 1 2 3\n").unwrap();
    let stand = |inventory: &str, rest: &[&str]| {
        let args = [&["scene", "stand", inventory, "-o", "out", "--force"], rest].concat();
        let out = run(dir.path(), &args);
        (out.status.code(), text(&out.stderr))
    };
    let (status, said) = stand("oak.csv", &["--trees", "models", "--terrain", "slope.obj"]);
    assert!(
        status == Some(0)
            && said.contains(
                "1 tree of species `oak` has a model of spruce: no model's name begins with that species"
            )
            && said.contains("are outside the terrain"),
        "{said}"
    );
    for (inventory, rest, expected) in [
        ("bad.csv", ["--trees", "models"], "bad.csv:2"),
        ("oak.csv", ["--trees", "flat"], "without height"),
        ("oak.csv", ["--trees", "out"], "no tree model"),
        ("none.csv", ["--trees", "models"], "none.csv"),
    ] {
        let (status, said) = stand(inventory, &rest);
        assert!(matches!(status, Some(1 | 2)) && said.contains(expected), "{inventory}: {said}");
    }
}
