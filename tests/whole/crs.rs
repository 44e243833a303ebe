//! The coordinate reference system of a run: where it comes from, and that every format carries it.

use crate::common::{feed, fixture, folder, raster, run, succeed, text};
use std::fs;
use std::path::Path;

/// True if a file holds a text.
fn holds(folder: &Path, name: &str, wanted: &str) -> bool {
    let bytes = fs::read(folder.join(name)).unwrap();
    bytes.windows(wanted.len()).any(|window| window == wanted.as_bytes())
}

const CODE: &str = r#"AUTHORITY["EPSG","25832"]]"#;

/// A scene of one part in `folder`, loaded by `loader` from `file` and moved by `offset`.
fn write_scene(folder: &Path, loader: &str, file: &str, offset: &str) {
    let scene = format!(
        "<document><scene id=\"s\"><part><filter type=\"{loader}\"><param type=\"string\" key=\"filepath\" value=\"{file}\"/>\
         </filter><filter type=\"translate\"><param type=\"vec3\" key=\"offset\" value=\"{offset}\"/></filter></part></scene>\
         </document>"
    );
    fs::write(folder.join("scene.xml"), scene).unwrap();
}

/// A pipeline over `scene.xml` with a flight to the east from x, y; without a place, with poses from stdin.
fn write_pipeline(folder: &Path, from: Option<[f64; 2]>) {
    let flight = match from {
        Some([x, y]) => format!(
            "[[leg]]\nposition_m = [{x}, {y}, 700]\nspeed_m_per_s = 60\n\
             [[leg]]\nposition_m = [{}, {y}, 700]\nactive = false\n",
            x + 60.0
        ),
        None => "[trajectory]\npath = \"-\"\n".to_owned(),
    };
    let text = format!(
        "scene = \"scene.xml\"\n{flight}[platform]\ncatalogue = \"data/platforms.xml#sr22\"\n[scanner]\n\
         catalogue = \"data/scanners_als.xml#riegl_lms-q780\"\n[settings]\npulse_freq_hz = 100000\nscan_freq_hz = 80\n\
         scan_angle_deg = 20\n"
    );
    fs::write(folder.join("p.toml"), text).unwrap();
}

#[test]
fn every_format_carries_the_system_of_the_raster() {
    let dir = folder();
    fs::write(dir.path().join("dem.tif"), raster([476_000.0, 5_429_000.0], 10.0, Some(25832))).unwrap();
    write_scene(dir.path(), "geotiffloader", "dem.tif", "0;0;5");
    write_pipeline(dir.path(), Some([476_010.0, 5_428_960.0]));
    let formats = ["a.las", "a.laz", "a.copc.laz", "a.arrow", "a.parquet", "a.ply"];
    let outputs: Vec<&str> = formats.iter().flat_map(|name| ["-o", *name]).collect();
    let done = succeed(dir.path(), &[&["run", "p.toml", "-q"], &outputs[..]].concat());
    assert!(!text(&done.stderr).contains("--crs"), "{}", text(&done.stderr));
    for name in &formats[..3] {
        assert!(holds(dir.path(), name, CODE), "{name}");
    }
    for name in &formats[3..5] {
        assert!(holds(dir.path(), name, "ETRS89 / UTM zone 32N"), "{name}");
    }
    assert!(holds(dir.path(), "a.ply", "comment crs EPSG:25832\n"));
    // A packed scene carries it, and shards of a run that are merged do.
    succeed(dir.path(), &["scene", "pack", "scene.xml", "-o", "s.vlscene", "-q"]);
    succeed(dir.path(), &["run", "p.toml", "--scene", "s.vlscene", "-o", "packed.las", "-q"]);
    assert!(holds(dir.path(), "packed.las", CODE));
    for shard in ["0/2", "1/2"] {
        succeed(dir.path(), &["run", "p.toml", "--shard", shard, "-o", "shards", "-q"]);
    }
    succeed(dir.path(), &["merge", "shards", "-o", "merged.las", "-q"]);
    assert!(holds(dir.path(), "merged.las", CODE));
    // A part that is moved sideways has coordinates of its own.
    write_scene(dir.path(), "geotiffloader", "dem.tif", "-476000;-5429000;0");
    write_pipeline(dir.path(), Some([10.0, -40.0]));
    succeed(dir.path(), &["run", "p.toml", "-o", "local.las", "-q"]);
    assert!(!holds(dir.path(), "local.las", "PROJCS"));
}

#[test]
fn a_system_is_named_by_its_code_or_by_a_file() {
    let dir = folder();
    let survey = fixture("terrain/survey.xml");
    let survey = survey.to_str().unwrap();
    fs::write(dir.path().join("site.prj"), "EPSG:2193\n").unwrap();
    for (crs, name) in [("EPSG:25832", "a.las"), ("25832", "b.las"), ("site.prj", "c.las")] {
        succeed(dir.path(), &["run", survey, "-q", "--crs", crs, "-o", name]);
        let code = if name == "c.las" { "\"2193\"]]" } else { CODE };
        assert!(holds(dir.path(), name, code), "{crs}");
        assert!(!holds(dir.path(), name, "TOWGS84"), "{crs}");
    }
    // A .prj file beside a mesh.
    fs::write(dir.path().join("m.obj"), "v 0 0 0\nv 100 0 0\nv 100 100 0\nv 0 100 0\nf 1 2 3 4\n").unwrap();
    fs::write(dir.path().join("m.prj"), "PROJCS[\"mine\",UNIT[\"metre\",1]]\n").unwrap();
    write_scene(dir.path(), "objloader", "m.obj", "0;0;0");
    write_pipeline(dir.path(), Some([10.0, 50.0]));
    succeed(dir.path(), &["run", "p.toml", "-o", "m.las", "-o", "m.ply", "-q"]);
    assert!(
        holds(dir.path(), "m.las", "PROJCS[\"mine\"") && holds(dir.path(), "m.ply", "comment crs mine\n")
    );
    // Beyond the size that is read, the file is left out with a warning.
    fs::write(dir.path().join("m.prj"), format!("PROJCS[\"{}\"]", "a".repeat(70_000))).unwrap();
    let done = run(dir.path(), &["run", "p.toml", "-o", "n.las"]);
    assert!(done.status.success() && text(&done.stderr).contains("m.prj"), "{}", text(&done.stderr));
}

#[test]
fn the_zone_of_a_projected_flight_is_the_system_where_none_is_known() {
    let dir = folder();
    fs::write(dir.path().join("dem.tif"), raster([475_960.0, 5_428_900.0], 10.0, None)).unwrap();
    write_scene(dir.path(), "geotiffloader", "dem.tif", "0;0;0");
    write_pipeline(dir.path(), None);
    let mut poses = "time,lon,lat,height,roll,pitch,yaw\n".to_owned();
    for i in 0..100 {
        let step = f64::from(i) * 0.01;
        poses += &format!("{},{},49.0115,800,0,0,90\n", 1000.0 + step, 8.6714 + step * 8e-4);
    }
    let args = ["run", "p.toml", "-q", "-o", "a.las", "-o", "a.ply"];
    let done = feed(dir.path(), &args, poses.as_bytes());
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(holds(dir.path(), "a.las", "WGS 84 / UTM zone 32N"));
    assert!(holds(dir.path(), "a.ply", "comment crs EPSG:32632\n"));
    // The same from a file, in shards.
    fs::write(dir.path().join("flight.csv"), &poses).unwrap();
    for shard in ["0/2", "1/2"] {
        let run = ["run", "p.toml", "--trajectory", "flight.csv", "--shard", shard, "-o", "shards", "-q"];
        succeed(dir.path(), &run);
    }
    succeed(dir.path(), &["merge", "shards", "-o", "b.las", "-q"]);
    let bytes = |name: &str| fs::read(dir.path().join(name)).unwrap();
    assert!(bytes("a.las") == bytes("b.las"));
}
