//! Campaigns: the data set has the same bytes however its cells were computed, and failures stop nothing.

use crate::common::{files, fixture, folder, run, succeed, text, vlscan};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

/// Everything in a data set but times and what is hidden.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let is_part = |path: &PathBuf| !path.starts_with(".campaign") && !path.ends_with("times.jsonl");
    files(folder)
        .into_iter()
        .filter(is_part)
        .map(|path| (path.clone(), fs::read(folder.join(path)).unwrap()))
        .collect()
}

fn manifest(folder: &Path) -> Vec<serde_json::Value> {
    let text = fs::read_to_string(folder.join("manifest.jsonl")).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Two variants of scanning the moving boxes, with so many seeds.
fn boxes(folder: &Path, out: &str, seeds: u32) -> String {
    let moving = fixture("moving");
    let moving = moving.to_str().unwrap();
    let text = format!(
        "out = \"{out}\"\nseeds = {seeds}\nrun = \"--assets {moving}\"\n[[scene]]\nname = \"boxes\"\nfile = \"{moving}/scene.xml#yard\"\n\
         [[variant]]\nname = \"plain\"\nsurvey = \"{moving}/survey.xml\"\n\
         [[variant]]\nname = \"tiles\"\nsurvey = \"{moving}/survey.xml\"\nrun = \"--tile 10 --labels\"\n"
    );
    let name = format!("{out}.toml");
    fs::write(folder.join(&name), text).unwrap();
    name
}

#[test]
#[ignore = "minutes; part of the continuous integration"]
fn a_campaign_that_is_killed_gives_the_bytes_of_one_left_alone() {
    let dir = folder();
    let (alone, killed) = (boxes(dir.path(), "alone", 100), boxes(dir.path(), "killed", 100));
    succeed(dir.path(), &["campaign", &alone, "-q"]);
    for attempt in 0..10 {
        let start = |task: &str| {
            let mut command = vlscan(dir.path());
            command.args(["campaign", &killed, "-q", "-j", "1"]).args(task.split_whitespace());
            command.stdin(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
        };
        let mut both = [start(""), start(if attempt % 2 == 0 { "" } else { "--task 1/3" })];
        std::thread::sleep(Duration::from_millis(100 + 37 * attempt));
        both.iter_mut().for_each(|child| child.kill().unwrap());
        for child in &mut both {
            // It may have been quicker.
            let _ = child.wait().unwrap();
        }
    }
    succeed(dir.path(), &["campaign", &killed, "-q", "-j", "3"]);
    let [expected, found] = ["alone", "killed"].map(|out| contents(&dir.path().join(out)));
    assert_eq!(expected.keys().collect::<Vec<_>>(), found.keys().collect::<Vec<_>>());
    let different: Vec<_> = expected.iter().filter(|(path, bytes)| found[*path] != **bytes).collect();
    assert!(different.is_empty(), "{:?}", different.iter().map(|(path, _)| path).collect::<Vec<_>>());
    let lines = manifest(&dir.path().join("killed"));
    assert_eq!(lines.len(), 200);
    for line in &lines {
        let points = line["points"].as_u64().unwrap();
        let of_files = |file: &serde_json::Value| {
            file["path"].as_str().unwrap().ends_with("laz").then(|| file["records"].as_u64().unwrap())
        };
        let sum: u64 = line["files"].as_array().unwrap().iter().filter_map(of_files).sum();
        assert!(points > 500 && points == sum, "{line}");
    }
    // Everything is there: nothing is computed again.
    let again = succeed(dir.path(), &["campaign", &killed]);
    assert!(!text(&again.stderr).contains("cells in"), "{}", text(&again.stderr));
}

#[test]
fn failures_are_kept_and_stop_nothing() {
    let dir = folder();
    let name = boxes(dir.path(), "set", 1);
    let good = fs::read_to_string(dir.path().join(&name)).unwrap();
    let bad = good.replace("--tile 10", "--tile 10 --columns X");
    fs::write(dir.path().join(&name), &bad).unwrap();
    let out = run(dir.path(), &["campaign", &name]);
    assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains("1 of 2 cells have failed"), "{}", text(&out.stderr));
    let lines = manifest(&dir.path().join("set"));
    assert!(lines[0]["error"].is_null() && lines[0]["points"].as_u64().unwrap() > 500, "{}", lines[0]);
    assert!(lines[1]["error"].as_str().unwrap().contains("columns can be chosen"), "{}", lines[1]);
    // Kept, and not computed again until asked for.
    let list = |folder: &Path| text(&succeed(folder, &["campaign", &name, "--list"]).stdout);
    assert_eq!(list(dir.path()), "");
    fs::write(dir.path().join(&name), good).unwrap();
    assert_eq!(list(dir.path()), "boxes-tiles-1\n");
    succeed(dir.path(), &["campaign", &name, "--cell", "boxes-tiles-1", "-q"]);
    assert!(manifest(&dir.path().join("set")).iter().all(|line| line["error"].is_null()));
    assert!(!run(dir.path(), &["campaign", &name, "--cell", "nothing"]).status.success());
    // A cell answers for itself alone.
    fs::write(dir.path().join(&name), &bad).unwrap();
    let of = |cell: &str| run(dir.path(), &["campaign", &name, "--cell", cell]);
    let failed = of("boxes-tiles-1");
    assert_eq!(failed.status.code(), Some(2));
    assert!(text(&failed.stderr).contains("boxes-tiles-1 has failed: "), "{}", text(&failed.stderr));
    let complete = of("boxes-plain-1");
    assert_eq!(complete.status.code(), Some(0), "{}", text(&complete.stderr));
}

#[test]
fn a_changed_input_is_noticed() {
    let dir = folder();
    let corners = |z: f64| {
        let all = ["-50 -50", "50 -50", "50 50", "-50 50"].map(|c| format!("v {c} {z}\n"));
        all.concat() + "f 1 2 3\nf 1 3 4\n"
    };
    fs::write(dir.path().join("flat.obj"), corners(0.0)).unwrap();
    fs::write(
        dir.path().join("c.toml"),
        "out = \"set\"\nformat = \"csv\"\nrun = \"--columns X,Y,Z,HeightAboveGround,ObjectId\"\n\
         [[scene]]\nname = \"flat\"\nfile = \"flat.obj\"\narea = \"POLYGON ((-20 -20, 20 -20, 20 20, -20 20))\"\n\
         [[variant]]\nname = \"uav\"\nplan = \"airborne --scanner riegl_vux-1uav --height 50 --density 5\"\n",
    )
    .unwrap();
    let rows = || {
        succeed(dir.path(), &["campaign", "c.toml", "-q"]);
        let text = fs::read_to_string(dir.path().join("set/cells/flat-uav-1/points.csv")).unwrap();
        let row = |line: &str| line.split(',').map(|n| n.parse::<f64>().unwrap()).collect::<Vec<_>>();
        text.lines().skip(1).map(row).collect::<Vec<_>>()
    };
    let first = rows();
    // Points are kept within the polygon, and their density is that of the plan.
    assert!(
        first.iter().all(|p| p[0].abs() < 20.1 && p[1].abs() < 20.1 && p[2].abs() < 0.2 && p[3].abs() < 0.2)
    );
    assert!((first.len() as f64 / 1600.0 / 5.0 - 1.0).abs() < 0.15, "{} points", first.len());
    fs::write(dir.path().join("flat.obj"), corners(7.0)).unwrap();
    let second = rows();
    assert!(second.iter().all(|p| (p[2] - 7.0).abs() < 0.2 && p[3].abs() < 0.2), "{:?}", second[0]);
    let line = &manifest(&dir.path().join("set"))[0];
    assert_eq!(line["area_m2"], 1600.0);
    assert!(line["inputs"]["flat.obj"].as_str().is_some_and(|sum| sum.len() == 16), "{line}");
}

#[test]
fn objects_have_files_of_their_own_and_heights_count_from_the_ground() {
    let dir = folder();
    let survey = fixture("forest/survey.xml");
    let survey = survey.to_str().unwrap();
    let all = [
        "run",
        survey,
        "-o",
        "all.csv",
        "--columns",
        "X,Y,Z,ObjectId,Classification,HeightAboveGround",
        "-q",
    ];
    succeed(dir.path(), &all);
    succeed(dir.path(), &["run", survey, "-o", "objects", "--format", "csv", "--per-object", "-q"]);
    succeed(
        dir.path(),
        &["run", survey, "-o", "tiles", "--format", "laz", "--tile", "10", "--height-above-ground", "-q"],
    );
    let rows: Vec<Vec<f64>> = fs::read_to_string(dir.path().join("all.csv"))
        .unwrap()
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|n| n.parse().unwrap()).collect())
        .collect();
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for row in &rows {
        *counts.entry(format!("object_{}.csv", row[3])).or_default() += 1;
        let is_ground = row[4] == 2.0;
        assert!(!is_ground || row[5].abs() < 0.5, "{row:?}");
        assert!(row[5].is_nan() || (-1.0..30.0).contains(&row[5]), "{row:?}");
    }
    let lines = |path: &PathBuf| {
        fs::read_to_string(dir.path().join("objects").join(path)).unwrap().lines().count() - 1
    };
    let found = files(&dir.path().join("objects"));
    let found: BTreeMap<String, usize> = found.iter().map(|p| (p.display().to_string(), lines(p))).collect();
    assert_eq!(found, counts);
    let mut points = 0;
    for tile in files(&dir.path().join("tiles")) {
        let bytes = fs::read(dir.path().join("tiles").join(&tile)).unwrap();
        let number = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
        points += u64::from_le_bytes(bytes[247..255].try_into().unwrap());
        let name = tile.file_stem().unwrap().to_str().unwrap().to_owned();
        let corner: Vec<f64> = name.split('_').skip(1).map(|n| n.parse().unwrap()).collect();
        for (axis, at) in [(0, 187), (1, 203)] {
            assert!(number(at) >= corner[axis] - 1e-3 && number(at) <= corner[axis] + 10.0, "{name}");
        }
    }
    assert_eq!(points as usize, rows.len());
    let refused = run(dir.path(), &["run", survey, "-o", "x.laz", "--tile", "5"]);
    assert!(text(&refused.stderr).contains("a folder"), "{}", text(&refused.stderr));
}

#[test]
fn hostile_files_are_refused_with_a_reason() {
    let dir = folder();
    let scene =
        "[[scene]]\nname = \"s\"\nfile = \"none.obj\"\n[[variant]]\nname = \"v\"\nsurvey = \"none.xml\"\n";
    let stand = scene.replace(
        "file = \"none.obj\"",
        "stand = \"i.csv\"\nplots = 3\narea = \"POLYGON ((0 0, 90 0, 90 9))\"",
    );
    for (text_of_file, reason) in [
        ("out = \"".to_owned(), "TOML"),
        (format!("out = \"o\"\nseeds = 4294967295\n{scene}"), "cells"),
        (format!("out = \"o\"\nseeds = nan\n{scene}"), "seeds"),
        (format!("out = \"o\"\nsplit = {{ train = nan }}\n{scene}"), "split"),
        (format!("out = \"o\"\nrun = \"'x\"\n{scene}"), "quote"),
        (format!("out = \"o\"\nformat = \"shp\"\n{scene}"), "format"),
        (format!("out = \"o\"\n{stand}"), "fit into the area"),
        (format!("out = \"o\"\n{scene}"), "failed"),
    ] {
        fs::write(dir.path().join("c.toml"), &text_of_file).unwrap();
        let out = run(dir.path(), &["campaign", "c.toml"]);
        assert_eq!(out.status.code(), Some(2), "{text_of_file}\n{}", text(&out.stderr));
        assert!(text(&out.stderr).contains(reason), "{reason}: {text_of_file}\n{}", text(&out.stderr));
    }
}

/// A flat square of 100 m at that height.
fn flat(z: f64) -> String {
    let corners = ["-50 -50", "50 -50", "50 50", "-50 50"].map(|c| format!("v {c} {z}\n"));
    corners.concat() + "f 1 2 3\nf 1 3 4\n"
}

#[test]
fn the_data_set_is_no_input_of_its_own_cells() {
    let dir = folder();
    fs::write(dir.path().join("flat.obj"), flat(0.0)).unwrap();
    for out in ["set", "."] {
        let file = format!(
            "out = \"{out}\"\nseeds = 2\nrun = \"--assets .\"\n[[scene]]\nname = \"flat\"\nfile = \"flat.obj\"\n\
             area = \"POLYGON ((-20 -20, 20 -20, 20 20, -20 20))\"\n\
             [[variant]]\nname = \"u\"\nplan = \"airborne --scanner riegl_vux-1uav --height 50 --density 1\"\n"
        );
        fs::write(dir.path().join("c.toml"), file).unwrap();
        let first = succeed(dir.path(), &["campaign", "c.toml"]);
        assert!(text(&first.stderr).contains("2 cells in"), "{}", text(&first.stderr));
        let again = succeed(dir.path(), &["campaign", "c.toml"]);
        assert!(!text(&again.stderr).contains("cells in"), "{out}: {}", text(&again.stderr));
        let line = &manifest(&dir.path().join(out))[0];
        assert!(line["inputs"]["./flat.obj"].is_string(), "{line}");
    }
}

#[test]
fn a_file_for_all_cells_is_refused() {
    let dir = folder();
    let name = boxes(dir.path(), "set", 1);
    let good = fs::read_to_string(dir.path().join(&name)).unwrap();
    for option in ["--parts parts.csv", "--schedule-log log.json"] {
        fs::write(dir.path().join(&name), good.replace("--tile 10", option)).unwrap();
        let out = run(dir.path(), &["campaign", &name, "--cell", "boxes-tiles-1"]);
        assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
        assert!(text(&out.stderr).contains("which every cell would write"), "{}", text(&out.stderr));
    }
}

#[test]
fn heights_count_from_the_ground_of_their_epoch() {
    let dir = folder();
    fs::write(dir.path().join("low.obj"), flat(0.0)).unwrap();
    fs::write(dir.path().join("high.obj"), flat(7.0)).unwrap();
    let mesh = |name: &str| {
        format!(
            "<filter type=\"objloader\"><param type=\"string\" key=\"filepath\" value=\"{name}\"/></filter>"
        )
    };
    let scene = format!(
        "<document><scene id=\"s\" name=\"s\"><part>{}<swap swapStep=\"1\">{}</swap></part></scene></document>",
        mesh("low.obj"),
        mesh("high.obj")
    );
    fs::write(dir.path().join("swap.xml"), scene).unwrap();
    let area = "POLYGON ((-20 -20, 20 -20, 20 20, -20 20))";
    let plan = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--height", "50", "--density", "2"];
    succeed(dir.path(), &[&plan[..], &["--area", area, "--scene", "low.obj", "-o", "f.toml", "-q"]].concat());
    let columns = ["--columns", "Z,HeightAboveGround", "--scene", "swap.xml#s"];
    succeed(dir.path(), &[&["run", "f.toml", "-o", "p.csv", "-q"], &columns[..]].concat());
    let table = fs::read_to_string(dir.path().join("p.csv")).unwrap();
    let rows: Vec<Vec<f64>> =
        table.lines().skip(1).map(|line| line.split(',').map(|n| n.parse().unwrap()).collect()).collect();
    let high = rows.iter().filter(|row| row[0] > 3.5).count();
    assert!(high > 1000 && rows.len() - high > 1000, "{high} of {}", rows.len());
    for row in rows {
        assert!(row[1].abs() < 0.2, "{row:?}");
    }
}

#[test]
fn a_tree_is_the_same_model_in_every_plot() {
    let dir = folder();
    fs::write(dir.path().join("flat.obj"), flat(0.0)).unwrap();
    fs::create_dir(dir.path().join("models")).unwrap();
    for name in ["a", "b", "c"] {
        let pyramid =
            "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv 0 0 10\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n";
        fs::write(dir.path().join(format!("models/{name}.obj")), pyramid).unwrap();
    }
    let mut inventory = "id,x,y,height\n".to_owned();
    for i in 0..60 {
        inventory += &format!("t{i},{},{},10\n", i % 20 * 4 - 38, (i / 20) * 4 - 4);
    }
    fs::write(dir.path().join("i.csv"), inventory).unwrap();
    // Plots share the row of trees between them; the easternmost ones have none.
    fs::write(
        dir.path().join("c.toml"),
        "out = \"set\"\n[[scene]]\nname = \"p\"\nstand = \"i.csv --trees models --terrain flat.obj\"\n\
         area = \"POLYGON ((-40 -8, 48 -8, 48 8, -40 8))\"\nplots = 22\nplot_m = 8\nmargin_m = 1\n\
         [[variant]]\nname = \"u\"\nplan = \"airborne --scanner riegl_vux-1uav --height 50 --density 2\"\n",
    )
    .unwrap();
    succeed(dir.path(), &["campaign", "c.toml", "-q"]);
    let mut models: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut without_trees = 0;
    for line in manifest(&dir.path().join("set")) {
        assert!(line["error"].is_null(), "{line}");
        let objects = format!("set/cells/{}/objects.csv", line["cell"].as_str().unwrap());
        let table = fs::read_to_string(dir.path().join(objects)).unwrap();
        let mut rows = table.lines().map(|row| row.split(',').map(str::to_owned).collect::<Vec<_>>());
        let names = rows.next().unwrap();
        let column = |name: &str| names.iter().position(|n| n == name);
        let (Some(tree), Some(model)) = (column("tree"), column("model")) else { panic!("{names:?}") };
        let trees: Vec<Vec<String>> = rows.filter(|row| !row[tree].is_empty()).collect();
        without_trees += usize::from(trees.is_empty());
        for row in trees {
            models.entry(row[tree].clone()).or_default().push(row[model].clone());
        }
    }
    assert!(without_trees >= 1 && models.len() == 60 && models.values().any(|all| all.len() > 1));
    for (tree, all) in models {
        assert!(all.iter().all(|model| *model == all[0]), "{tree}: {all:?}");
    }
}
