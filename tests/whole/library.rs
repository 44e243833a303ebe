//! The library keeps the contract of the command: kinds of errors, defaults, limits.

use crate::common::{fixture, folder, succeed};
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;
use vlscan::base::diag::ProblemKind;
use vlscan::formats::{AttributeSet, PointRow, PointSink, read_points};
use vlscan::scene::LoadOptions;
use vlscan::survey::{PoseStream, SceneRecipe, find_platform, find_scanner};
use vlscan::trace::BuildOptions;
use vlscan::{
    Batches, DVec3, Error, LoadedScene, Mesh, OutputRequest, PointFormat, Progress, RayHit, ReadOptions,
    Result, RunContext, Scan, SceneGeometry, Session, Settings, Stop, Target, read_scene, read_survey,
};

/// A square floor of 20 m × 20 m.
fn floor() -> Mesh {
    let corners = [[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-10.0, 10.0]];
    let corners = corners.map(|[x, y]| DVec3::new(x, y, 0.0)).into();
    Mesh::new(corners, vec![[0, 1, 2], [0, 2, 3]], Vec::new(), Vec::new()).unwrap()
}

/// A turn of a scanner over a floor.
fn scan() -> Scan {
    let (scanner, _) = find_scanner("vlp16", &ReadOptions::default()).unwrap();
    let turn = std::f64::consts::TAU;
    let scan = Scan::new(floor(), scanner).station(DVec3::Z * 1.5).threads(2);
    scan.configure(|settings| (settings.head_rate, settings.head_stop) = (20.0 * turn, turn))
}

/// A sink without points.
struct Ignore;

impl PointSink for Ignore {
    fn start(&mut self, _: AttributeSet) {}

    fn point(&mut self, _: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
        Ok(ControlFlow::Continue(()))
    }
}

/// A part of a scene whose mesh is missing.
const PART: &str = r#"<part><filter type="objloader">
  <param type="string" key="filepath" value="none.obj"/></filter></part>"#;

/// A survey of one station in a scene of its own document, which has these parts.
fn survey(scene: &str, parts: &str) -> String {
    format!(
        r#"<document><scene id="s">{parts}</scene>
<survey name="s" scene="{scene}" platform="data/platforms.xml#tripod" scanner="data/scanners_tls.xml#vlp16">
  <leg><platformSettings x="0" y="0" z="0"/></leg></survey></document>"#
    )
}

#[test]
fn a_missing_file_is_not_found_at_every_entry_point() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let written = |name: &str, text: String| {
        fs::write(at(name), text).unwrap();
        at(name)
    };
    let named = |name: &str| at(name).display().to_string();
    let without_scene = written("a.xml", survey("none.xml#s", ""));
    let without_mesh = written("b.xml", survey("#s", PART));
    let options = ReadOptions::default();
    let read = |path: &Path| read_survey(path, &options).map(drop);
    let first = |mut batches: Batches| batches.next().unwrap_or_else(|| panic!("no batch")).map(drop);
    let points = |name: &str| read_points(&at(name), &mut Ignore).map(drop);
    let cases: Vec<(&str, Result<()>)> = vec![
        ("survey", read(&at("none.xml"))),
        ("scene of a survey", read(&without_scene)),
        ("mesh of a survey", read(&without_mesh)),
        ("scene", read_scene(&named("none.xml#s"), &options).map(drop)),
        ("mesh", read_scene(&named("none.obj"), &options).map(drop)),
        ("raster", read_scene(&named("none.tif"), &options).map(drop)),
        ("virtual raster", read_scene(&named("none.vrt"), &options).map(drop)),
        ("tiles", read_scene(&named("none*.tif"), &options).map(drop)),
        ("voxels", read_scene(&named("none.vox"), &options).map(drop)),
        ("instances", read_scene(&named("none.csv"), &options).map(drop)),
        ("packed scene", read_scene(&named("none.vlscene"), &options).map(drop)),
        ("scanner", find_scanner(&named("none.xml#a"), &options).map(drop)),
        ("calibration", find_scanner(&named("none.json"), &options).map(drop)),
        ("platform", find_platform(&named("none.xml#a"), &options).map(drop)),
        ("trajectory", scan().trajectory(PoseStream::at(at("none.csv"))).batches(10).and_then(first)),
        ("pulses", vlscan::PulseReader::open(&at("none.csv"), 1).map(drop)),
        ("points", points("none.laz")),
        ("table of points", points("none.csv")),
        ("pipeline", vlscan::ResolvedRun::resolve(&at("none.toml"), &vlscan::Options::default()).map(drop)),
        ("folder of an output", scan().output(at("none/points.laz")).and_then(Scan::run).map(drop)),
    ];
    for (what, outcome) in cases {
        match outcome {
            Err(Error::Input(problems)) => {
                assert!(problems.has(ProblemKind::NotFound), "{what}: {}", problems.text());
            }
            other => panic!("{what}: {other:?}"),
        }
    }
    assert!(read_survey(&fixture("room/survey.xml"), &options).is_ok());
}

#[test]
fn the_library_writes_the_bytes_of_the_command_for_every_fixture() {
    let surveys = [
        "forest/survey.xml",
        "moving/survey.xml",
        "room/survey.xml",
        "street/spinning.xml",
        "street/survey.xml",
        "terrain/survey.xml",
    ];
    for name in surveys {
        let folder = folder();
        let survey = fixture(name);
        for (format, extension) in [(PointFormat::Laz, "laz"), (PointFormat::Csv, "csv")] {
            let by_command = format!("command.{extension}");
            let by_library = folder.path().join(format!("library.{extension}"));
            succeed(folder.path(), &["run", &survey.display().to_string(), "-o", &by_command]);
            let (survey, _) = read_survey(&survey, &ReadOptions::default()).unwrap();
            let mut session = Session::open(Settings::new(survey), |_| ()).unwrap();
            let mut outputs = OutputRequest::default();
            outputs.sinks.push((Target::File(by_library.clone()), format));
            session.run(outputs, RunContext::new(&Progress::default(), &Stop::new())).unwrap();
            let (command, library) = (fs::read(folder.path().join(by_command)), fs::read(by_library));
            assert!(command.unwrap() == library.unwrap(), "{name}: {extension}");
        }
    }
}

#[test]
fn points_of_damaged_and_foreign_files_are_errors_and_sinks_can_fail() {
    struct Full(u32);
    impl PointSink for Full {
        fn start(&mut self, _: AttributeSet) {}

        fn point(&mut self, _: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
            self.0 += 1;
            if self.0 > 3 { Err(Error::input("the sink is full")) } else { Ok(ControlFlow::Continue(())) }
        }
    }
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let survey = fixture("room/survey.xml").display().to_string();
    succeed(folder.path(), &["run", &survey, "-o", "whole.laz", "-o", "whole.csv", "-o", "whole.ply"]);
    let whole = fs::read(at("whole.laz")).unwrap();
    fs::write(at("cut.laz"), &whole[..whole.len() / 2]).unwrap();
    fs::write(at("foreign.laz"), b"\x7fELF\x02\x01\x01\0\0\0\0\0\0\0\0\0").unwrap();
    for name in ["cut.laz", "foreign.laz"] {
        let read = read_points(&at(name), &mut Ignore);
        assert!(matches!(read, Err(Error::Input(_))), "{name}: {read:?}");
    }
    for name in ["whole.laz", "whole.csv", "whole.ply"] {
        assert!(read_points(&at(name), &mut Ignore).is_ok(), "{name}");
        let mut sink = Full(0);
        let failed = read_points(&at(name), &mut sink).unwrap_err().to_string();
        assert_eq!((failed.as_str(), sink.0), ("the sink is full", 4), "{name}");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_run_that_fails_ends_no_other_that_shares_its_stop() {
    let folder = folder();
    let turning = |rate: f64| {
        let scan = scan().configure(move |settings| settings.head_rate = rate);
        scan.outputs(|outputs| outputs.force = true)
    };
    let run = |path: &Path, rate: f64, stop: &Stop| {
        let scan = turning(rate).sink(Target::File(path.to_path_buf()), PointFormat::Xyz);
        let (mut session, outputs) = scan.session()?;
        session.run(outputs, RunContext::new(&Progress::default(), stop))
    };
    let alone = run(&folder.path().join("alone.xyz"), 10.0, &Stop::new()).unwrap();
    let stop = Stop::new();
    for round in 0..3 {
        let shared = folder.path().join(format!("shared{round}.xyz"));
        let (failed, complete) = std::thread::scope(|scope| {
            let failing = scope.spawn(|| run(Path::new("/dev/full"), 60.0, &stop));
            let complete = run(&shared, 10.0, &stop);
            (failing.join().unwrap(), complete.unwrap())
        });
        assert!(matches!(failed, Err(Error::Io { .. })), "{failed:?}");
        assert!(!complete.interrupted && complete.pulses == alone.pulses, "round {round}");
        assert_eq!(fs::read(shared).unwrap(), fs::read(folder.path().join("alone.xyz")).unwrap());
    }
    assert!(!stop.is_requested());
}

#[test]
fn rays_without_an_instrument_have_distance_part_primitive_and_normal() {
    let recipe = SceneRecipe::from(floor());
    let (load, trees) = (LoadOptions::default(), BuildOptions::default());
    let scene = LoadedScene::load(&recipe, &load, &trees, false, &|_| ()).unwrap();
    let above = DVec3::new(1.0, 2.0, 5.0);
    let origins = [above, DVec3::new(2.0, 1.0, -4.0), DVec3::new(99.0, 0.0, 5.0), above, above];
    let directions = [DVec3::Z * -2.0, DVec3::Z, -DVec3::Z, DVec3::ZERO, DVec3::NAN];
    let hits = scene.cast(&origins, &directions, &|_| ()).unwrap();
    let hit = |distance, primitive, normal| Some(RayHit { distance, part: 0, primitive, normal });
    assert_eq!(hits, [hit(5.0, 1, DVec3::Z), hit(4.0, 0, -DVec3::Z), None, None, None]);

    // Many rays, in pieces: each is that of its own.
    let many: Vec<DVec3> = (0..50_000).map(|i| DVec3::new(f64::from(i) * 1e-3 - 24.9995, 3.0, 2.0)).collect();
    let hits = scene.cast(&many, &vec![-DVec3::Z; many.len()], &|_| ()).unwrap();
    assert_eq!(hits.len(), many.len());
    assert!(many.iter().zip(&hits).all(|(origin, hit)| hit.is_some() == (origin.x.abs() <= 10.0)));
    assert!(scene.cast(&many, &[], &|_| ()).unwrap().is_empty());
}

/// The triangles of a scene, each with its number, corners and part.
fn triangles(geometry: &SceneGeometry) -> Vec<(u32, [DVec3; 3], u32)> {
    let corners = geometry.triangles.iter().map(|t| t.map(|vertex| geometry.vertices[vertex as usize]));
    let numbers = geometry.numbers.iter().zip(&geometry.parts);
    numbers.zip(corners).map(|((number, part), corners)| (*number, corners, *part)).collect()
}

#[test]
fn primitives_of_a_scene_are_arrays_in_the_world() {
    let load = |recipe: &SceneRecipe| {
        let (options, trees) = (LoadOptions::default(), BuildOptions::default());
        LoadedScene::load(recipe, &options, &trees, false, &|_| ()).unwrap()
    };
    let load_file = |name: &str| {
        let file = fixture(name).display().to_string();
        load(&read_scene(&file, &ReadOptions::default()).unwrap().0)
    };
    let geometry = load(&SceneRecipe::from(floor())).geometry(None).unwrap();
    assert_eq!(geometry.vertices.len(), 4);
    assert_eq!(geometry.vertices[geometry.triangles[1][2] as usize], DVec3::new(-10.0, 10.0, 0.0));
    assert_eq!((&geometry.numbers[..], &geometry.parts[..]), (&[0, 1][..], &[0, 0][..]));
    assert!(geometry.voxels.is_empty());

    // The hits of rays are on the triangles of their numbers.
    let scene = load_file("forest/scene.xml");
    let all = triangles(&scene.geometry(None).unwrap());
    assert_eq!(all.len() as u64, scene.facts().primitives);
    let middle = scene.facts().bounds.centre();
    let origins: Vec<DVec3> =
        (-20..20).map(|i| middle + DVec3::new(f64::from(i) * 0.5, 0.3, 100.0)).collect();
    let hits = scene.cast(&origins, &vec![-DVec3::Z; origins.len()], &|_| ()).unwrap();
    assert!(hits.iter().flatten().count() > 10);
    for (origin, hit) in origins.iter().zip(&hits).filter_map(|(origin, hit)| Some((origin, (*hit)?))) {
        let (number, [a, b, c], part) = all[hit.primitive as usize];
        assert_eq!((number, part), (hit.primitive, hit.part));
        let place = *origin - DVec3::Z * hit.distance;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        assert!((place - a).dot(normal).abs() < 1e-9, "{place} on {a} {b} {c}");
    }

    // The parts together are the scene.
    let parts = scene.facts().parts.len() as u32;
    let each: Vec<_> = (0..parts).flat_map(|part| triangles(&scene.geometry(Some(part)).unwrap())).collect();
    assert_eq!(each, all);
    assert_eq!(scene.geometry(Some(parts)).unwrap(), SceneGeometry::default());

    let voxels = load_file("voxels/scene.xml").geometry(None).unwrap();
    assert!(!voxels.voxels.is_empty() && voxels.voxels.iter().all(|voxel| voxel.half > 0.0));
    assert_eq!(voxels.triangles.len() + voxels.voxels.len(), voxels.numbers.len());
}
