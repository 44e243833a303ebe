//! A scene of which parts are loaded and dropped during the flight gives the bytes of the scene in memory.

use crate::common::{feed, files, folder, run, succeed, text};
use crate::scenes::everything;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use vlscan::scene::TileOptions;
use vlscan::trace::BuildOptions;
use vlscan::{Error, Options, PointFormat, Progress, ResolvedRun, RunContext, Session, Stop, Target};

/// Metres, and cells, along a side of a tile.
const SIDE: usize = 20;
const TILES: usize = 12;

/// A tile of terrain that joins its neighbours without a gap.
fn tile(number: usize) -> String {
    let mut mesh = "mtllib ground.mtl\nusemtl soil\n".to_owned();
    for j in 0..=SIDE {
        for i in 0..=SIDE {
            let (x, y) = ((number * SIDE + i) as f64, j as f64 - 10.0);
            writeln!(mesh, "v {x} {y} {:.3}", 2.0 * (x / 7.0).sin() * (y / 5.0).cos()).unwrap();
        }
    }
    for j in 0..SIDE {
        for i in 0..SIDE {
            let a = j * (SIDE + 1) + i + 1;
            writeln!(mesh, "f {a} {} {} {}", a + 1, a + SIDE + 2, a + SIDE + 1).unwrap();
        }
    }
    mesh
}

/// Points of trees over a tile.
fn trees(number: usize) -> String {
    let point = |i: usize| {
        let (x, y) = ((number * SIDE + i % 17) as f64 + 0.3, (i * 7 % 19) as f64 - 9.0);
        format!("{x} {y} {}\n", 2.5 + (i % 5) as f64)
    };
    (0..60).map(point).collect()
}

/// A row of terrain tiles with trees, and a flight along it.
fn row(folder: &Path) {
    fs::create_dir(folder.join("tiles")).unwrap();
    let write = |name: &str, content: String| fs::write(folder.join(name), content).unwrap();
    write(
        "tiles/ground.mtl",
        "newmtl soil\nhelios_reflectance 0.3\nhelios_classification 2\nhelios_isGround true\n".to_owned(),
    );
    for i in 0..TILES {
        write(&format!("tiles/t{i:02}.obj"), tile(i));
        write(&format!("tiles/t{i:02}.xyz"), trees(i));
    }
    let param =
        |kind: &str, key: &str, value: &str| format!(r#"<param type="{kind}" key="{key}" value="{value}"/>"#);
    let terrain = param("string", "efilepath", r"tiles/t.*\.obj");
    let trees = param("string", "efilepath", r"tiles/t.*\.xyz")
        + &param("double", "voxelSize", "0.4")
        + &param("string", "separator", " ");
    write(
        "scene.xml",
        format!(
            r#"<document><scene id="row"><part><filter type="objloader">{terrain}</filter></part>
            <part><filter type="xyzloader">{trees}</filter></part></scene></document>"#
        ),
    );
    write(
        "flight.toml",
        r#"scene = "scene.xml"
        platform = { catalogue = "data/platforms.xml#copter_linearpath" }
        scanner = { catalogue = "data/scanners_als.xml#riegl_vux-1uav" }
        settings = { pulse_freq_hz = 50000, scan_freq_hz = 40, scan_angle_deg = 20 }
        leg = [
            { position_m = [5, 0, 30], on_ground = true, speed_m_per_s = 60 },
            { position_m = [235, 0, 30], on_ground = true, active = false },
        ]
        "#
        .to_owned(),
    );
}

fn points(folder: &Path, extra: &[&str]) -> Vec<u8> {
    let command = [
        "run",
        "flight.toml",
        "-o",
        "out.xyz",
        "--force",
        "-q",
        "--columns",
        "X,Y,Z,Intensity,ObjectId,Classification,Primitive",
    ];
    succeed(folder, &[&command[..], extra].concat());
    fs::read(folder.join("out.xyz")).unwrap()
}

#[test]
fn the_points_do_not_depend_on_the_memory() {
    let dir = folder();
    row(dir.path());
    let all = points(dir.path(), &["-j", "1"]);
    assert!(all.len() > 50_000, "{}", all.len());
    for extra in [
        &["-j", "1", "--scene-memory", "1G"][..],
        &["-j", "2", "--scene-memory", "1G"],
        &["-j", "1", "--scene-memory", "250k"],
        &["-j", "2", "--scene-memory", "250k", "--chunk-size", "97"],
        &["-j", "2", "--scene-memory", "2M", "--tree", "fsah"],
    ] {
        assert!(points(dir.path(), extra) == all, "{extra:?}");
    }
    // What was done is told.
    let said = succeed(dir.path(), &["run", "flight.toml", "-o", "out.las", "-v", "--scene-memory", "250k"]);
    let said = text(&said.stderr);
    assert!(said.contains("tiles: 24 of the parts") && said.contains("found in memory"), "{said}");
    let dropped: u64 = said.split(" dropped").next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    assert!(dropped > 5, "{said}");
}

#[test]
fn packed_tiles_give_the_same_points() {
    let dir = folder();
    row(dir.path());
    let all = points(dir.path(), &["-j", "1", "--parts", "parts.csv"]);
    let table = |name: &str| fs::read_to_string(dir.path().join(name)).unwrap();
    let pack = ["scene", "pack", "scene.xml", "-o", "row.vlscene", "--scene-memory", "250k", "-q"];
    succeed(dir.path(), &pack);
    succeed(dir.path(), &["scene", "pack", "scene.xml", "-o", "whole.vlscene", "-q"]);
    // The tiles do not need the files that they were made from.
    for i in 0..TILES {
        for kind in ["obj", "xyz"] {
            fs::remove_file(dir.path().join(format!("tiles/t{i:02}.{kind}"))).unwrap();
        }
    }
    let scene = ["--scene", "row.vlscene", "-j", "2"];
    let tiled: [&[&str]; 3] =
        [&[], &["--scene-memory", "250k", "--parts", "packed.csv"], &["--scene-memory", "1G"]];
    for extra in tiled {
        assert!(points(dir.path(), &[&scene[..], extra].concat()) == all, "{extra:?}");
    }
    assert_eq!(table("packed.csv"), table("parts.csv"));
    let command =
        ["run", "flight.toml", "--scene", "row.vlscene", "-o", "out.las", "-v", "--scene-memory", "250k"];
    let said = succeed(dir.path(), &command);
    let said = text(&said.stderr);
    assert!(said.contains("tiles: 24 of the parts") && said.contains("found in memory"), "{said}");
    let whole = ["run", "flight.toml", "--scene", "whole.vlscene", "-o", "whole.las", "--scene-memory", "1G"];
    let said = text(&succeed(dir.path(), &whole).stderr);
    assert!(said.contains("packed without --scene-memory"), "{said}");
    let info = succeed(dir.path(), &["scene", "info", "row.vlscene", "--json", "--verify"]);
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(
        (info["tiles"].as_u64(), info["triangles"].as_u64()),
        (Some(24), Some((2 * TILES * SIDE * SIDE) as u64))
    );
}

#[test]
fn every_kind_of_part_gives_the_same_points() {
    let dir = folder();
    everything(dir.path());
    for physics in ["helios", "refined"] {
        let of = |extra: &[&str]| {
            let command = ["run", "survey.xml", "-o", "out.xyz", "--force", "-q", "--physics", physics];
            succeed(dir.path(), &[&command[..], extra].concat());
            fs::read(dir.path().join("out.xyz")).unwrap()
        };
        let all = of(&["--instances", "never"]);
        for instances in ["never", "always"] {
            let tiles = ["--scene-memory", "120k", "--instances", instances, "--physics", physics];
            let pack = ["scene", "pack", "survey.xml", "-o", "all.vlscene", "--force", "-q"];
            succeed(dir.path(), &[&pack[..], &tiles].concat());
            let packed = of(&["--scene", "all.vlscene", "--scene-memory", "120k", "-j", "2"]);
            assert!(packed == all, "packed {physics} {instances}");
        }
        for instances in ["never", "always"] {
            for memory in ["1G", "120k"] {
                let tiled = of(&["--instances", instances, "--scene-memory", memory, "-j", "2"]);
                assert!(tiled == all, "{physics} {instances} {memory}");
            }
        }
    }
}

#[test]
fn shards_and_streams_of_poses_and_pulses_work() {
    let dir = folder();
    row(dir.path());
    let memory = ["--scene-memory", "250k"];
    let command = |args: &[&'static str]| -> Vec<&'static str> { [args, &memory].concat() };
    succeed(dir.path(), &["run", "flight.toml", "-o", "all.las", "-q"]);
    for shard in ["0/2", "1/2"] {
        succeed(dir.path(), &command(&["run", "flight.toml", "-o", "shards", "-q", "--shard", shard]));
    }
    succeed(dir.path(), &["merge", "shards", "-o", "merged.las", "-q"]);
    let [all, merged] = ["all.las", "merged.las"].map(|name| fs::read(dir.path().join(name)).unwrap());
    assert!(all == merged);
    let poses: String = (0..100)
        .map(|i| format!("{},{},0,30,0,0,90\n", 0.01 * f64::from(i), 5.0 + 2.0 * f64::from(i)))
        .collect();
    let poses = format!("time,x,y,z,roll,pitch,yaw\n{poses}");
    let live = |extra: &[&str]| {
        let follow = ["run", "flight.toml", "--trajectory", "-", "-o", "-", "--format", "xyz", "-q"];
        let output = feed(dir.path(), &[&follow[..], extra].concat(), poses.as_bytes());
        assert!(output.status.success(), "{}", text(&output.stderr));
        output.stdout
    };
    let whole = live(&[]);
    assert!(whole.len() > 10_000 && live(&memory) == whole);
}

#[test]
fn a_footprint_that_does_not_fit_is_told_with_what_it_needs() {
    let dir = folder();
    row(dir.path());
    let output = run(dir.path(), &["run", "flight.toml", "-o", "out.las", "--scene-memory", "20k"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("one footprint meets tiles of the scene that need"), "{said}");
    assert!(said.contains("give --scene-memory more than"), "{said}");
    assert!(!dir.path().join("out.las").exists());
}

#[test]
fn a_tile_that_is_damaged_during_the_flight_ends_it_with_its_name() {
    let dir = folder();
    row(dir.path());
    for (damage, expected) in
        [("v 0 0 what\n", "what"), ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "has changed since")]
    {
        fs::write(dir.path().join("tiles/t08.obj"), tile(8)).unwrap();
        let (resolved, _) =
            ResolvedRun::resolve(&dir.path().join("flight.toml"), &Options::default()).unwrap();
        let ResolvedRun { mut settings, output: mut outputs, .. } = resolved;
        settings.load.tiles = Some(TileOptions { memory: 250 << 10, trees: BuildOptions::default() });
        outputs.sinks = vec![(Target::File(dir.path().join("out.las")), PointFormat::Las)];
        let mut session = Session::open(settings, |_| ()).unwrap();
        fs::write(dir.path().join("tiles/t08.obj"), damage).unwrap();
        let (progress, stop) = (Progress::default(), Stop::new());
        let error = session.run(outputs, RunContext::new(&progress, &stop)).unwrap_err();
        let Error::Input(found) = error else { panic!("{error}") };
        let found = found.text();
        assert!(found.contains("t08.obj") && found.contains(expected), "{found}");
        let left = files(dir.path());
        assert!(!left.contains(&"out.las".into()), "{left:?}");
        fs::remove_file(dir.path().join("out.partial.las")).unwrap();
    }
}
