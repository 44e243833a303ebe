//! Chains of commands: what one command writes, the next reads, whatever files of the same names lie in the
//! working folder.

use crate::common::{folder, raster, run, succeed, text};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// Trees of the inventory.
const TREES: usize = 16;

/// A terrain raster, two tree models, an inventory called as the table that `scene stand` writes, and a
/// street.
fn write_inputs(folder: &Path) {
    fs::create_dir_all(folder.join("in/models")).unwrap();
    fs::write(folder.join("in/dem.tif"), raster([0.0, 30.0], 10.0, None)).unwrap();
    let mtl = "newmtl leaves\nKd 0.2 0.5 0.1\nhelios_reflectance 0.5\nhelios_classification 5\n";
    fs::write(folder.join("in/models/tree.mtl"), mtl).unwrap();
    for (name, radius, height) in [("spruce_1", 2.0, 12.0), ("beech_1", 4.0, 12.0)] {
        let mut obj = "mtllib tree.mtl\nusemtl leaves\n".to_owned();
        for (dx, dy, z) in
            [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0), (0.0, 0.0, height)]
        {
            let _ = writeln!(obj, "v {} {} {z}", radius * dx, radius * dy);
        }
        fs::write(folder.join(format!("in/models/{name}.obj")), obj + "f 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n")
            .unwrap();
    }
    let mut inventory = "id,x,y,height,species,DBH_cm\n".to_owned();
    for i in 0..TREES {
        let species = if i % 4 == 0 { "beech" } else { "spruce" };
        let _ = writeln!(
            inventory,
            "t{i},{},{},{},{species},30",
            15 + i % 4 * 12,
            10 - (i / 4 * 12) as i64,
            10 + i % 3
        );
    }
    fs::write(folder.join("trees.csv"), inventory).unwrap();
    fs::write(folder.join("road.wkt"), "LINESTRING (20 -20, 32 -20)").unwrap();
}

/// Files of the names that the commands write, which must not be read: other scenes where the format allows
/// it, so that reading them could go unnoticed.
fn clutter(folder: &Path) {
    let triangle = "v 0 0 5000\nv 1 0 5000\nv 0 1 5000\nusemtl soil\nf 1 2 3\n";
    for name in [
        "ground.obj",
        "terrain_1.obj",
        "spruce_1.obj",
        "beech_1.obj",
        "boulders.obj",
        "houses.obj",
        "shell.obj",
    ] {
        fs::write(folder.join(name), triangle).unwrap();
    }
    let part = "<part><filter type=\"objloader\"><param type=\"string\" key=\"filepath\" value=\"ground.obj\"/></filter></part>";
    let scenes = ["forest", "terrain", "room", "stand"]
        .map(|id| format!("<scene id=\"{id}\">{part}</scene>"))
        .concat();
    for name in ["scene.xml", "stand.xml"] {
        fs::write(folder.join(name), format!("<document>{scenes}</document>")).unwrap();
    }
    for name in [
        "survey.xml",
        "scanners.xml",
        "platforms.xml",
        "labels.csv",
        "forest.mtl",
        "tree.mtl",
        "materials.csv",
    ] {
        fs::write(folder.join(name), "not what is meant").unwrap();
    }
    fs::write(folder.join("terrain.mtl"), "newmtl soil\nhelios_reflectance 0.01\nhelios_classification 9\n")
        .unwrap();
    fs::create_dir(folder.join("trees")).unwrap();
    fs::write(folder.join("trees/spruce_1.obj"), triangle).unwrap();
}

/// Points as text of a run with these arguments.
fn points(folder: &Path, args: &[&str]) -> String {
    text(&succeed(folder, &[&["run"], args, &["-q", "-o", "-", "--format", "xyz"]].concat()).stdout)
}

/// Points per class, column 9 of text.
fn classes(points: &str) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    for line in points.lines() {
        let class = line.split(' ').nth(9).unwrap_or("none").to_owned();
        *counts.entry(class).or_default() += 1;
    }
    counts
}

/// Walks the documented chains in a folder; the results by name.
fn walk(folder: &Path) -> BTreeMap<&'static str, String> {
    let mut found = BTreeMap::new();
    let done = |args: &[&str]| text(&succeed(folder, args).stderr);
    // What is made is scanned as it is.
    for (kind, out, more) in [
        ("forest", "made", &["-n", "4000", "--pulses", "3000", "--models", "2", "--copies", "6"][..]),
        ("terrain", "hills", &["-n", "1000", "--pulses", "2000"]),
        ("room", "flat", &["-n", "1000", "--pulses", "2000"]),
    ] {
        done(&[&["scene", "make", kind, "-o", out, "-q"], more].concat());
        let survey = format!("{out}/survey.xml");
        found.insert(kind, points(folder, &[&survey]));
    }
    // An inventory on a raster: the stand, its facts, its pack.
    let stand =
        ["scene", "stand", "trees.csv", "--trees", "in/models", "--terrain", "in/dem.tif", "-o", "stand"];
    let said = done(&stand);
    assert!(said.contains(&format!("{TREES} trees of 2 models")) && !said.contains("warning"), "{said}");
    let info = text(&succeed(folder, &["scene", "info", "stand/stand.xml", "--json"]).stdout);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert_eq!(info["parts"].as_array().unwrap().len(), TREES + 1, "{info}");
    done(&["scene", "pack", "stand/stand.xml", "-o", "stand.vlscene", "-q"]);
    // Flights, tripods and cars over it, as planned.
    let scene = ["--scene", "stand/stand.xml"];
    let airborne = [
        "plan",
        "airborne",
        "--scanner",
        "riegl_vux-1uav",
        "--height",
        "60",
        "--density",
        "8",
        "--follow-terrain",
        "-o",
        "flight.toml",
    ];
    let terrestrial = [
        "plan",
        "terrestrial",
        "--scanner",
        "riegl_vz400",
        "--around",
        "40,-5",
        "--radius",
        "8",
        "-n",
        "2",
        "--resolution",
        "0.1",
        "--pulse-rate",
        "100000",
        "-o",
        "tripod.toml",
    ];
    let mobile =
        ["plan", "mobile", "--scanner", "vlp16", "--along", "road.wkt", "--speed", "40", "-o", "drive.toml"];
    for plan in [&airborne[..], &terrestrial, &mobile] {
        let said = done(&[plan, &scene].concat());
        assert!(!said.contains("no ground"), "{said}");
    }
    // A sector instead of a turn of the head.
    let tripod = fs::read_to_string(folder.join("tripod.toml")).unwrap();
    assert!(tripod.contains("head_stop_deg = 360") && tripod.contains("on_ground = true"), "{tripod}");
    fs::write(folder.join("tripod.toml"), tripod.replace("head_stop_deg = 360", "head_stop_deg = 8"))
        .unwrap();
    found.insert("flight", points(folder, &["flight.toml"]));
    found.insert("packed", points(folder, &["flight.toml", "--scene", "stand.vlscene"]));
    found.insert("drive", points(folder, &["drive.toml"]));
    found.insert("tripod", points(folder, &["tripod.toml"]));
    succeed(folder, &["run", "flight.toml", "--dry-run", "--json", "-q"]);
    // Files, shards, and what reads them.
    done(&["run", "flight.toml", "-o", "flight.las", "-q"]);
    for shard in ["0/2", "1/2"] {
        done(&["run", "flight.toml", "--shard", shard, "-o", "shards", "-q"]);
    }
    done(&["merge", "shards", "-o", "merged.las", "-q"]);
    let read = |name: &str| fs::read(folder.join(name)).unwrap();
    assert!(read("flight.las") == read("merged.las"), "the merged shards differ from the run");
    done(&["preview", "flight.las", "-o", "flight.png", "-q"]);
    done(&["compare", "flight.las", "merged.las", "-q"]);
    found
}

#[test]
fn chains_of_commands_read_what_they_have_written_whatever_lies_about() {
    let (clean, cluttered) = (folder(), folder());
    write_inputs(clean.path());
    write_inputs(cluttered.path());
    clutter(cluttered.path());
    let (expected, found) = (walk(clean.path()), walk(cluttered.path()));
    for (name, points) in &expected {
        assert!(!points.is_empty(), "{name}: no points");
        assert!(found[name] == *points, "{name}: other points with files of the same names in the folder");
    }
    assert!(expected["flight"] == expected["packed"], "the packed stand differs");
    for name in ["flight", "tripod", "drive"] {
        let counts = classes(&expected[name]);
        assert!(counts.keys().all(|class| class == "2" || class == "5"), "{name}: {counts:?}");
        assert!(counts["2"] > 100 && (name == "tripod" || counts["5"] > 20), "{name}: {counts:?}");
    }
    for (name, ground) in [("forest", "2"), ("terrain", "2"), ("room", "2")] {
        let counts = classes(&expected[name]);
        assert!(counts[ground] > 100 && !counts.contains_key("0"), "{name}: {counts:?}");
    }
}

#[test]
fn a_campaign_of_a_stand_reads_its_own_files() {
    let dir = folder();
    write_inputs(dir.path());
    clutter(dir.path());
    fs::write(
        dir.path().join("campaign.toml"),
        "out = \"set\"\nformat = \"xyz\"\n[[scene]]\nname = \"plot\"\nstand = \"trees.csv --trees in/models --terrain in/dem.tif\"\n\
         [[variant]]\nname = \"drone\"\nplan = \"airborne --scanner riegl_vux-1uav --height 60 --density 8\"\n",
    )
    .unwrap();
    succeed(dir.path(), &["campaign", "campaign.toml", "-q"]);
    let cell = fs::read_dir(dir.path().join("set/cells")).unwrap().next().unwrap().unwrap().path();
    let counts = classes(&fs::read_to_string(cell.join("points.xyz")).unwrap());
    assert!(counts["2"] > 100 && counts["5"] > 20, "{counts:?}");
}

#[test]
fn legs_and_plans_without_ground_are_refused_and_surveys_keep_the_rule_of_the_reference() {
    let dir = folder();
    write_inputs(dir.path());
    let refused = |args: &[&str], expected: &str| {
        let done = run(dir.path(), args);
        let said = text(&done.stderr);
        assert!(done.status.code() == Some(2) && said.contains(expected), "{args:?}: {said}");
    };
    // A raster by itself is ground.
    let plan = [
        "plan",
        "terrestrial",
        "--scanner",
        "riegl_vz400",
        "--around",
        "40,-5",
        "--radius",
        "8",
        "-n",
        "1",
        "-o",
    ];
    let on_terrain = [&plan[..], &["t.toml", "--scene", "in/dem.tif", "--resolution", "0.1"]].concat();
    let said = text(&succeed(dir.path(), &on_terrain).stderr);
    assert!(!said.contains("reflectance"), "{said}");
    assert!(fs::read_to_string(dir.path().join("t.toml")).unwrap().contains("on_ground = true"));
    let drive = ["plan", "mobile", "--scanner", "vlp16", "--scene", "in/dem.tif", "--along"];
    succeed(dir.path(), &[&drive[..], &["LINESTRING (10 -20, 40 10)"]].concat());
    let level =
        [&plan[..], &["level.toml", "--scene", "in/dem.tif", "--ground", "340", "--resolution", "0.1"]]
            .concat();
    succeed(dir.path(), &level);
    assert!(!fs::read_to_string(dir.path().join("level.toml")).unwrap().contains("on_ground"));
    let stand = [
        "scene",
        "stand",
        "trees.csv",
        "--trees",
        "in/models",
        "--terrain",
        "in/dem.tif",
        "-o",
        "stand",
        "-q",
    ];
    succeed(dir.path(), &stand);
    let beside =
        ["plan", "terrestrial", "--scanner", "riegl_vz400", "--around", "400,-5", "--radius", "8", "-n", "1"];
    refused(&[&beside[..], &["--scene", "stand/stand.xml"]].concat(), "no ground below 1 of 1 positions");
    let leg = "[platform]\ncatalogue = \"data/platforms.xml#tripod\"\n[scanner]\ncatalogue = \"data/scanners_tls.xml#riegl_vz400\"\n\
               [settings]\npulse_freq_hz = 100000\nscan_angle_deg = 50\nscan_freq_hz = 60\nhead_rate_deg_per_s = 60\nhead_stop_deg = 20\n\
               [[leg]]\nposition_m = [40, -5, 0]\non_ground = true\n";
    fs::write(dir.path().join("leg.toml"), format!("scene = \"in/dem.tif\"\n{leg}")).unwrap();
    succeed(dir.path(), &["run", "leg.toml", "-o", "ground.csv", "--columns", "Classification"]);
    let classes = fs::read_to_string(dir.path().join("ground.csv")).unwrap();
    assert!(classes.lines().count() > 1000 && classes.lines().skip(1).all(|class| class == "2"));
    // A part without a material is none.
    fs::write(dir.path().join("leg.toml"), format!("{leg}[[part]]\nfile = \"in/dem.tif\"\n")).unwrap();
    refused(&["run", "leg.toml", "-o", "a.xyz"], "leg 0: no ground at x 40 y -5");
    assert!(!dir.path().join("a.xyz").exists());
    // An XML survey follows the reference, with a warning.
    let part = "<part><filter type=\"geotiffloader\"><param type=\"string\" key=\"filepath\" value=\"in/dem.tif\"/></filter></part>";
    let survey = format!(
        "<document><scene id=\"s\">{part}</scene><survey name=\"t\" scene=\"t.xml#s\" platform=\"data/platforms.xml#tripod\" \
         scanner=\"data/scanners_tls.xml#riegl_vz400\"><leg><platformSettings x=\"40\" y=\"-5\" onGround=\"true\"/>\
         <scannerSettings active=\"true\" pulseFreq_hz=\"100000\" scanAngle_deg=\"50\" scanFreq_hz=\"60\" \
         headRotatePerSec_deg=\"60\" headRotateStart_deg=\"0\" headRotateStop_deg=\"20\"/></leg></survey></document>"
    );
    fs::write(dir.path().join("t.xml"), survey).unwrap();
    let said = text(&succeed(dir.path(), &["run", "t.xml", "-o", "t.xyz"]).stderr);
    assert!(said.contains("the leg is put at the height of the scene's centre"), "{said}");
    refused(&["run", "t.xml", "-o", "r.xyz", "--physics", "refined"], "no ground at");
}

#[test]
fn the_terrain_of_a_stand_is_of_the_material_that_is_asked_for() {
    let dir = folder();
    write_inputs(dir.path());
    let mtl = "newmtl mud\nhelios_reflectance 0.1\nhelios_classification 9\nhelios_isGround true\nnewmtl rock\nhelios_reflectance 0.4\n";
    fs::write(dir.path().join("in/site.mtl"), mtl).unwrap();
    let bare = "v -10 -50 1\nv 90 -50 1\nv 90 40 1\nv -10 40 1\nusemtl grass\nf 1 2 3 4\n";
    fs::write(dir.path().join("in/plain.obj"), bare).unwrap();
    let stand = |terrain: &str, more: &[&str]| {
        let args = [
            "scene",
            "stand",
            "trees.csv",
            "--trees",
            "in/models",
            "-o",
            "out",
            "--force",
            "--terrain",
            terrain,
        ];
        run(dir.path(), &[&args[..], more].concat())
    };
    for terrain in ["in/dem.tif", "in/plain.obj"] {
        for (more, name, class) in [(&[][..], "soil", 2), (&["--terrain-mtl", "in/site.mtl#mud"], "mud", 9)] {
            let done = stand(terrain, more);
            assert!(done.status.success(), "{}", text(&done.stderr));
            assert_eq!(
                text(&done.stderr).contains("becomes soil"),
                more.is_empty() && terrain.ends_with("obj")
            );
            let info = text(&succeed(dir.path(), &["scene", "info", "out/stand.xml", "--json"]).stdout);
            let info: serde_json::Value = serde_json::from_str(&info).unwrap();
            let found =
                info["materials"].as_array().unwrap().iter().find(|m| m["name"] == name).unwrap().clone();
            assert!(found["class"] == class && found["ground"] == true, "{terrain}: {found}");
        }
    }
    for (reference, expected) in [
        ("in/site.mtl#rock", "is not ground"),
        ("in/site.mtl#moss", "mud, rock"),
        ("in/site.mtl", "which material?"),
    ] {
        let done = stand("in/dem.tif", &["--terrain-mtl", reference]);
        let said = text(&done.stderr);
        assert!(done.status.code() == Some(2) && said.contains(expected), "{reference}: {said}");
    }
}
