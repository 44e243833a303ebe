//! Campaigns: the data set has the same bytes however its cells were computed, and failures stop nothing.

use crate::common::{files, fixture, folder, run, succeed, text, vlscan};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};
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

/// Two variants of scanning the moving boxes, with this many seeds.
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
#[ignore = "minutes; part of `.ci/run --long`"]
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
    assert!(lines[1]["error"].as_str().unwrap().contains("--columns applies to"), "{}", lines[1]);
    // Kept, and not computed again until asked for.
    let list = |folder: &Path| text(&succeed(folder, &["campaign", &name, "--list"]).stdout);
    assert_eq!(list(dir.path()), "");
    fs::write(dir.path().join(&name), good).unwrap();
    assert_eq!(list(dir.path()), "boxes-tiles-1\n");
    succeed(dir.path(), &["campaign", &name, "--cell", "boxes-tiles-1", "-q"]);
    assert!(manifest(&dir.path().join("set")).iter().all(|line| line["error"].is_null()));
    assert!(!run(dir.path(), &["campaign", &name, "--cell", "nothing"]).status.success());
    // The status of a command with --cell is that of this cell.
    fs::write(dir.path().join(&name), &bad).unwrap();
    let of = |cell: &str| run(dir.path(), &["campaign", &name, "--cell", cell]);
    let failed = of("boxes-tiles-1");
    assert_eq!(failed.status.code(), Some(2));
    assert!(text(&failed.stderr).contains("boxes-tiles-1 has failed: "), "{}", text(&failed.stderr));
    let retry = format!("vlscan campaign {name} --cell boxes-tiles-1 --retry computes it again");
    assert!(text(&failed.stderr).contains(&retry), "{}", text(&failed.stderr));
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

/// A campaign of one cell over a flat square, and its file.
fn square(folder: &Path) -> String {
    fs::write(folder.join("flat.obj"), flat(0.0)).unwrap();
    let file = "out = \"set\"\n[[scene]]\nname = \"flat\"\nfile = \"flat.obj\"\n\
        area = \"POLYGON ((-20 -20, 20 -20, 20 20, -20 20))\"\n\
        [[variant]]\nname = \"u\"\nplan = \"airborne --scanner riegl_vux-1uav --height 50 --density 5\"\n";
    fs::write(folder.join("c.toml"), file).unwrap();
    "c.toml".to_owned()
}

#[test]
fn a_cell_whose_input_is_touched_meanwhile_is_computed_by_the_next_start() {
    let dir = folder();
    let name = square(dir.path());
    let is_ended = AtomicBool::new(false);
    let touch = || {
        while !is_ended.load(Ordering::SeqCst) {
            let mesh = fs::File::options().append(true).open(dir.path().join("flat.obj")).unwrap();
            mesh.set_modified(std::time::SystemTime::now()).unwrap();
            std::thread::sleep(Duration::from_millis(1));
        }
    };
    let out = std::thread::scope(|scope| {
        scope.spawn(touch);
        let out = run(dir.path(), &["campaign", &name]);
        is_ended.store(true, Ordering::SeqCst);
        out
    });
    let said = text(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{said}");
    assert!(said.contains("flat.obj changed while the cell was being computed"), "{said}");
    assert!(said.contains("the next start computes the cell again") && !said.contains("--retry"), "{said}");
    let is_failed = |path: &PathBuf| path.extension().is_some_and(|e| e == "failed");
    assert!(!files(&dir.path().join("set")).iter().any(is_failed), "{said}");
    assert!(manifest(&dir.path().join("set"))[0]["error"].is_string());
    succeed(dir.path(), &["campaign", &name]);
    let line = &manifest(&dir.path().join("set"))[0];
    assert!(line["error"].is_null() && line["points"].as_u64().unwrap() > 1000, "{line}");
}

#[test]
fn messages_in_the_manifest_do_not_depend_on_the_folder() {
    let manifests = ["one", "another/one"].map(|place| {
        let dir = folder();
        let place = dir.path().join(place);
        fs::create_dir_all(&place).unwrap();
        let name = square(&place);
        fs::write(place.join("bad.stl"), "no mesh").unwrap();
        let file = fs::read_to_string(place.join(&name)).unwrap().replace("flat.obj", "bad.stl");
        fs::write(place.join(&name), file).unwrap();
        // From another folder.
        let path = place.join(&name);
        let out = run(dir.path(), &["campaign", path.to_str().unwrap()]);
        assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
        let error = manifest(&place.join("set"))[0]["error"].as_str().unwrap().to_owned();
        assert!(error.contains("bad.stl") && !error.contains(dir.path().to_str().unwrap()), "{error}");
        // Neither do those about files of others.
        let theirs = place.join("set/cells/flat-u-1/notes.txt");
        fs::create_dir_all(theirs.parent().unwrap()).unwrap();
        fs::write(&theirs, "precious").unwrap();
        fs::remove_file(place.join("set/.campaign/flat-u-1.failed")).unwrap();
        let out = run(dir.path(), &["campaign", path.to_str().unwrap()]);
        let whole = fs::canonicalize(&theirs).unwrap();
        let said = text(&out.stderr);
        assert!(said.contains(&format!("mv '{}' FOLDER", whole.display())), "{said}");
        let error = manifest(&place.join("set"))[0]["error"].as_str().unwrap().to_owned();
        assert!(error.contains("mv 'set/cells/flat-u-1/notes.txt' FOLDER"), "{error}");
        fs::read(place.join("set/manifest.jsonl")).unwrap()
    });
    assert!(manifests[0] == manifests[1]);
}

#[test]
fn what_to_do_about_a_file_of_the_user_is_what_helps() {
    let dir = folder();
    let name = square(dir.path());
    let theirs = dir.path().join("set/cells/flat-u-1/notes.txt");
    fs::create_dir_all(theirs.parent().unwrap()).unwrap();
    fs::write(&theirs, "precious").unwrap();
    for options in [&[][..], &["--retry"]] {
        let out = run(dir.path(), &[&["campaign", &name], options].concat());
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{said}");
        assert!(
            said.contains("notes.txt was not written by a campaign: move it to another folder"),
            "{said}"
        );
        assert!(said.contains("then start the campaign again") && !said.contains("--retry"), "{said}");
    }
    fs::rename(&theirs, dir.path().join("notes.txt")).unwrap();
    succeed(dir.path(), &["campaign", &name]);
    assert!(manifest(&dir.path().join("set"))[0]["points"].as_u64().unwrap() > 1000);
    // A manifest of the user's is none of the data set.
    fs::write(dir.path().join("set/manifest.jsonl"), "precious").unwrap();
    let out = run(dir.path(), &["campaign", &name]);
    assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
    assert_eq!(fs::read(dir.path().join("set/manifest.jsonl")).unwrap(), b"precious");
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
    assert!(text(&refused.stderr).contains("need a directory"), "{}", text(&refused.stderr));
}

#[test]
fn cells_that_fail_alike_are_told_once_and_impossible_plans_before_the_first_cell() {
    let dir = folder();
    let name = boxes(dir.path(), "set", 5);
    let good = fs::read_to_string(dir.path().join(&name)).unwrap();
    fs::write(dir.path().join(&name), good.replace("--tile 10", "--tile 10 --columns X")).unwrap();
    let said = text(&run(dir.path(), &["campaign", &name]).stderr);
    assert_eq!(said.matches("--columns applies to").count(), 2, "{said}");
    assert!(said.contains("4 more cells have failed (boxes-tiles-2, boxes-tiles-3"), "{said}");
    let plan = |words: &str| {
        format!(
            "out = \"plans\"\nseeds = 3\n[[scene]]\nname = \"s\"\nfile = \"flat.obj\"\n\
             [[variant]]\nname = \"v\"\nplan = \"{words}\"\n"
        )
    };
    fs::write(dir.path().join("flat.obj"), flat(0.0)).unwrap();
    for (words, reason) in [
        ("terrestrial --scanner riegl_vz400 --spacing 20 --resolution 30", "--resolution 30"),
        ("airborne --scanner riegl_vz999 --density 5", "riegl_vz999"),
    ] {
        fs::write(dir.path().join("p.toml"), plan(words)).unwrap();
        let out = run(dir.path(), &["campaign", "p.toml"]);
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{said}");
        assert!(said.contains("p.toml:8") && said.contains(reason), "{said}");
        assert!(!dir.path().join("plans").exists(), "{said}");
    }
}

#[test]
fn areas_that_cannot_be_read_are_shown_with_their_line() {
    let dir = folder();
    fs::write(dir.path().join("flat.obj"), flat(0.0)).unwrap();
    for area in ["none.geojson", "POLYGON ((0 0, 1 1))", "POLYGON ((0 0, 9 9, 9 0, 0 9))"] {
        let file = format!(
            "out = \"o\"\n[[scene]]\nname = \"s\"\nfile = \"flat.obj\"\narea = \"{area}\"\n\
             [[variant]]\nname = \"v\"\nplan = \"airborne --scanner riegl_vux-1uav --density 5 --height 80\"\n"
        );
        fs::write(dir.path().join("c.toml"), file).unwrap();
        let out = run(dir.path(), &["campaign", "c.toml"]);
        assert_eq!(out.status.code(), Some(2));
        assert!(text(&out.stderr).contains("c.toml:5"), "{area}: {}", text(&out.stderr));
    }
}

#[test]
fn hostile_files_are_refused_with_a_reason() {
    let dir = folder();
    let scene =
        "[[scene]]\nname = \"s\"\nfile = \"none.obj\"\n[[variant]]\nname = \"v\"\nsurvey = \"none.xml\"\n";
    let stand = scene.replace(
        "file = \"none.obj\"",
        "stand = \"i.csv --trees m\"\nplots = 3\narea = \"POLYGON ((0 0, 90 0, 90 9))\"",
    );
    for (text_of_file, reason) in [
        ("out = \"".to_owned(), "TOML"),
        (format!("out = \"o\"\nseeds = 4294967295\n{scene}"), "seeds"),
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
        assert!(line["inputs"]["flat.obj"].is_string(), "{line}");
    }
}

#[test]
fn a_file_for_all_cells_is_refused() {
    let dir = folder();
    let name = boxes(dir.path(), "set", 1);
    let good = fs::read_to_string(dir.path().join(&name)).unwrap();
    for option in ["--parts parts.csv", "--schedule-log log.json", "--objects objects.csv"] {
        fs::write(dir.path().join(&name), good.replace("--tile 10", option)).unwrap();
        let out = run(dir.path(), &["campaign", &name, "--cell", "boxes-tiles-1"]);
        assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
        assert!(text(&out.stderr).contains("which all cells would overwrite"), "{}", text(&out.stderr));
    }
    assert!(!dir.path().join("set").exists());
}

#[test]
fn options_that_a_campaign_decides_are_refused_with_their_line() {
    let dir = folder();
    let name = boxes(dir.path(), "set", 1);
    let good = fs::read_to_string(dir.path().join(&name)).unwrap();
    for (option, advice) in [
        ("--seed 7", "`seeds`"),
        ("--format xyz", "`format"),
        ("--scene x.xml", "[[scene]]"),
        ("-o a.laz", "`out`"),
        ("--resume", "the same campaign"),
        ("-j 3", "vlscan campaign"),
        ("--nonsense", "--nonsense"),
    ] {
        fs::write(dir.path().join(&name), good.replace("--tile 10", option)).unwrap();
        let out = run(dir.path(), &["campaign", &name]);
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{option}: {said}");
        assert!(said.contains("set.toml:13") && said.contains(advice), "{option}: {said}");
    }
    assert!(!dir.path().join("set").exists());
}

#[test]
fn damaged_cells_are_noticed_at_every_start_and_computed_again() {
    let dir = folder();
    let name = boxes(dir.path(), "set", 1);
    let set = dir.path().join("set");
    succeed(dir.path(), &["campaign", &name, "-q"]);
    let whole = contents(&set);
    let bytes = |path: &Path| fs::read(path).unwrap();
    let flip = |path: &Path| {
        let mut bytes = bytes(path);
        let at = bytes.len() / 2;
        bytes[at] ^= 4;
        fs::write(path, bytes).unwrap();
    };
    let points = set.join("cells/boxes-plain-1/points.laz");
    let tile = set.join("cells/boxes-tiles-1/points").read_dir().unwrap().next().unwrap().unwrap().path();
    let damages: [(&str, &dyn Fn()); 8] = [
        ("emptied", &|| fs::write(&points, "").unwrap()),
        ("a bit", &|| flip(&points)),
        ("a tile", &|| flip(&tile)),
        ("a table", &|| fs::remove_file(set.join("cells/boxes-plain-1/objects.csv")).unwrap()),
        ("a record", &|| flip(&set.join("cells/boxes-plain-1/record.json"))),
        ("an empty record", &|| fs::write(set.join("cells/boxes-tiles-1/record.json"), "").unwrap()),
        ("a cell", &|| fs::remove_dir_all(set.join("cells/boxes-plain-1")).unwrap()),
        ("the manifest", &|| flip(&set.join("manifest.jsonl"))),
    ];
    for (what, damage) in damages {
        damage();
        let out = succeed(dir.path(), &["campaign", &name]);
        let said = text(&out.stderr);
        let is_told = said.contains("is computed again: ")
            || what == "a cell"
            || said.contains("did not match the cells");
        assert!(is_told, "{what}: {said}");
        assert!(contents(&set) == whole, "{what}");
    }
    // What is hidden can go, or be damaged.
    fs::remove_dir_all(set.join(".campaign")).unwrap();
    let out = succeed(dir.path(), &["campaign", &name, "--verify"]);
    assert!(!text(&out.stderr).contains("cells in"), "{}", text(&out.stderr));
    assert!(contents(&set) == whole);
}

#[test]
fn a_file_that_appears_is_noticed() {
    let dir = folder();
    fs::write(dir.path().join("flat.obj"), format!("mtllib m.mtl\nusemtl moss\n{}", flat(0.0))).unwrap();
    fs::write(
        dir.path().join("c.toml"),
        "out = \"set\"\n[[scene]]\nname = \"flat\"\nfile = \"flat.obj\"\n\
         area = \"POLYGON ((-20 -20, 20 -20, 20 20, -20 20))\"\n\
         [[variant]]\nname = \"u\"\nplan = \"airborne --scanner riegl_vux-1uav --height 50 --density 1\"\n",
    )
    .unwrap();
    succeed(dir.path(), &["campaign", "c.toml", "-q"]);
    let due = || text(&succeed(dir.path(), &["campaign", "c.toml", "--list"]).stdout);
    assert_eq!(due(), "");
    for name in ["m.mtl", "flat.prj"] {
        fs::write(dir.path().join(name), "newmtl moss\nKd 0.2 0.2 0.2\n").unwrap();
        assert_eq!(due(), "flat-u-1\n", "{name}");
        fs::remove_file(dir.path().join(name)).unwrap();
        assert_eq!(due(), "", "{name}");
    }
}

/// A campaign of one trajectory that fails in flight, and one that does not.
fn flights(folder: &Path) {
    fs::write(folder.join("flat.obj"), flat(0.0)).unwrap();
    let rows: String = (0..40).map(|i| format!("{},{i},0,60,0,0,90\n", f64::from(i) / 200.0)).collect();
    for (name, end) in [("bad", "nan,nan,nan,nan,nan,nan,nan\n"), ("ok", "")] {
        fs::write(folder.join(format!("{name}.csv")), format!("{rows}{end}")).unwrap();
        let survey = format!(
            "scene = \"flat.obj\"\ntrajectory = {{ path = \"{name}.csv\" }}\n\
             platform = {{ catalogue = \"data/platforms.xml#sr22\" }}\n\
             scanner = {{ catalogue = \"data/scanners_als.xml#riegl_lms-q780\" }}\n\
             settings = {{ pulse_freq_hz = 100000, scan_freq_hz = 80, scan_angle_deg = 25 }}\n"
        );
        fs::write(folder.join(format!("{name}.toml")), survey).unwrap();
    }
    let campaign = "out = \"set\"\n[[scene]]\nname = \"g\"\nfile = \"flat.obj\"\n\
         [[variant]]\nname = \"bad\"\nsurvey = \"bad.toml\"\n[[variant]]\nname = \"ok\"\nsurvey = \"ok.toml\"\n";
    fs::write(folder.join("c.toml"), campaign).unwrap();
}

#[test]
fn a_cell_that_fails_in_flight_stops_no_other() {
    let dir = folder();
    flights(dir.path());
    for start in 0..2 {
        let out = run(dir.path(), &["campaign", "c.toml"]);
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{said}");
        assert_eq!(said.contains("g-bad-1  failed: "), start == 0, "{said}");
        let lines = manifest(&dir.path().join("set"));
        assert!(lines[0]["error"].is_string() && lines[1]["points"].as_u64().unwrap() > 0, "{said}");
    }
}

#[cfg(unix)]
#[test]
fn files_of_others_are_kept_and_pipes_hang_nothing() {
    let dir = folder();
    let name = boxes(dir.path(), "set", 1);
    let set = dir.path().join("set");
    let theirs = set.join("cells/boxes-plain-1/thesis/chapter.txt");
    fs::create_dir_all(theirs.parent().unwrap()).unwrap();
    fs::write(&theirs, "precious").unwrap();
    let failing = |reason: &str| {
        let out = run(dir.path(), &["campaign", &name]);
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{reason}: {said}");
        let lines = manifest(&set);
        assert!(
            lines[0]["error"].as_str().unwrap_or_default().contains(reason),
            "{reason}: {said} {}",
            lines[0]
        );
        assert!(lines[1]["points"].as_u64().unwrap() > 0, "{reason}: {said}");
    };
    failing("chapter.txt");
    assert_eq!(fs::read(&theirs).unwrap(), b"precious");
    fs::remove_dir_all(set.join("cells/boxes-plain-1")).unwrap();
    succeed(dir.path(), &["campaign", &name, "-q"]);
    let pipe = |path: &str| {
        let path = set.join(path);
        let _ = fs::remove_file(&path);
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        path
    };
    for path in ["cells/boxes-plain-1/points.laz", "cells/boxes-plain-1/record.json"] {
        let pipe = pipe(path);
        failing("not a regular file");
        fs::remove_file(pipe).unwrap();
        succeed(dir.path(), &["campaign", &name, "-q"]);
    }
    for path in
        [".campaign/boxes-plain-1.lock", ".campaign/boxes-plain-1.failed", ".campaign/boxes-plain-1.made"]
    {
        fs::remove_dir_all(set.join("cells/boxes-plain-1")).unwrap();
        let pipe = pipe(path);
        failing("not a regular file");
        fs::remove_file(pipe).unwrap();
        succeed(dir.path(), &["campaign", &name, "-q"]);
    }
    for path in ["manifest.jsonl", "times.jsonl"] {
        let pipe = pipe(path);
        assert_eq!(run(dir.path(), &["campaign", &name]).status.code(), Some(2), "{path}");
        fs::remove_file(pipe).unwrap();
        succeed(dir.path(), &["campaign", &name, "-q"]);
    }
}

#[cfg(debug_assertions)]
#[test]
fn a_full_disk_is_no_failure_of_a_cell() {
    let dir = folder();
    let name = boxes(dir.path(), "set", 1);
    for first in [1, 4, 9, 14, 19, 26, 34] {
        let mut command = vlscan(dir.path());
        command.args(["campaign", &name, "-j", "1"]).env("VLSCAN_FAULT", format!("{first}+"));
        let out = command.stdin(Stdio::null()).output().unwrap();
        if out.status.success() {
            // It was complete before.
            break;
        }
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(1), "{first}: {said}");
        assert!(said.contains("injected failure"), "{first}: {said}");
        let is_failed = |path: &PathBuf| path.extension().is_some_and(|e| e == "failed");
        assert!(!files(&dir.path().join("set")).iter().any(is_failed), "{first}: {said}");
    }
    let out = succeed(dir.path(), &["campaign", &name]);
    assert!(
        manifest(&dir.path().join("set")).iter().all(|line| line["error"].is_null()),
        "{}",
        text(&out.stderr)
    );
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

#[test]
fn warnings_of_cells_are_shown_once_and_are_errors_if_strict() {
    let dir = folder();
    let (scene, scanner) = (fixture("forest/ground.obj"), fixture("forest/scanners.xml"));
    let poses = "0,0,0,30,0,0,0\n1,9,0,30,0,0,0\n";
    fs::write(dir.path().join("poses.csv"), poses).unwrap();
    let survey = format!(
        "seed = 5\nscene = {scene:?}\ntrajectory = {{ path = \"poses.csv\" }}\nplatform = {{ catalogue = \"data/platforms.xml#sr22\" }}\n\
         scanner = {{ catalogue = \"{}#uls\" }}\nsettings = {{ pulse_freq_hz = 1000, scan_freq_hz = 20, scan_angle_deg = 20 }}\n\
         [[output]]\npath = \"mine.las\"\n",
        scanner.display()
    );
    let id = fs::read_to_string(&scanner).unwrap();
    let id = id.split("<scanner id=\"").nth(1).unwrap().split('"').next().unwrap().to_owned();
    fs::write(dir.path().join("s.toml"), survey.replace("#uls", &format!("#{id}"))).unwrap();
    let campaign = format!(
        "out = \"set\"\nseeds = 2\n[[scene]]\nname = \"g\"\nfile = {scene:?}\n[[variant]]\nname = \"own\"\nsurvey = \"s.toml\"\n"
    );
    fs::write(dir.path().join("c.toml"), campaign).unwrap();
    let strict = run(dir.path(), &["campaign", "c.toml", "--strict"]);
    assert_eq!(strict.status.code(), Some(2), "{}", text(&strict.stderr));
    assert!(text(&strict.stderr).contains("its seed 5 is not used"), "{}", text(&strict.stderr));
    let said = text(&succeed(dir.path(), &["campaign", "c.toml", "--retry"]).stderr);
    for warning in ["g-own-1  warning: s.toml: its seed 5 is not used", "its [[output]] is not used"] {
        assert_eq!(said.matches(warning).count(), 1, "{warning}: {said}");
    }
    assert!(!said.contains("g-own-2  warning"), "{said}");
    assert!(!dir.path().join("mine.las").exists());
}
