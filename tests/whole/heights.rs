//! Terrain as height fields gives the bytes of terrain as stored triangles.

use crate::common::{files, folder, succeed};
use crate::scenes::everything;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use vlscan::base::corrections::Corrections;
use vlscan::{
    OutputRequest, PointFormat, Progress, ReadOptions, RunContext, Session, Settings, Stop, Target,
    read_survey,
};

/// A terrain of 8 by 8 heights in place of the floor of [`everything`], with a hole, and the same raster once more: translated
/// and dropped to the first.
fn with_terrain(folder: &Path) {
    everything(folder);
    let mut tiff = crate::common::raster([-21.0, 21.0], 6.0, Some(25832));
    let start = tiff.len() - 4 * 64;
    for (i, number) in tiff[start..].chunks_exact_mut(4).enumerate() {
        let height = if i == 29 { f32::NAN } else { -1.0 + 0.25 * ((i * 7) % 11) as f32 };
        number.copy_from_slice(&height.to_le_bytes());
    }
    fs::write(folder.join("dem.tif"), tiff).unwrap();
    fs::write(
        folder.join("g.mtl"),
        "newmtl soil\nhelios_isGround true\nhelios_reflectance 30\nhelios_classification 2\n",
    )
    .unwrap();
    let param = |key: &str, value: &str| format!("<param type=\"string\" key=\"{key}\" value=\"{value}\"/>");
    let terrain = format!(
        "<filter type=\"geotiffloader\">{}{}</filter>",
        param("filepath", "dem.tif"),
        param("matfile", "g.mtl")
    );
    let moved = "<filter type=\"translate\"><param type=\"vec3\" key=\"offset\" value=\"12;-3;9\"/>\
        <param type=\"integer\" key=\"onGround\" value=\"-1\"/></filter>";
    let scene = fs::read_to_string(folder.join("scene.xml")).unwrap();
    let floor = format!("<filter type=\"objloader\">{}</filter>", param("filepath", "floor.obj"));
    assert!(scene.contains(&floor), "{scene}");
    let scene = scene
        .replace(&floor, &terrain)
        .replace("</scene>", &format!("<part>{terrain}{moved}</part></scene>"));
    fs::write(folder.join("scene.xml"), scene).unwrap();
}

/// The outputs of a run with terrain stored as triangles or not.
fn outputs(survey: &Path, triangulate: bool, change: impl Fn(&mut Settings)) -> BTreeMap<PathBuf, Vec<u8>> {
    let dir = folder();
    let (survey, _) = read_survey(survey, &ReadOptions::default()).unwrap();
    let mut settings = Settings::new(survey);
    change(&mut settings);
    settings.load.triangulate_rasters = triangulate;
    let mut session = Session::open(settings, |_| {}).unwrap();
    let fields = session.scene().geometry.fields.len();
    assert_eq!(fields, if triangulate { 0 } else { 2 });
    let formats = [("a.xyz", PointFormat::Xyz), ("a.las", PointFormat::Las), ("a.csv", PointFormat::Csv)];
    let sinks = formats.map(|(name, format)| (Target::File(dir.path().join(name)), format)).into();
    let request = OutputRequest {
        sinks,
        waveforms: true,
        pulses: true,
        labels: true,
        heights: true,
        ..Default::default()
    };
    let (progress, stop) = (Progress::default(), Stop::new());
    session.run(request, RunContext::new(&progress, &stop)).unwrap();
    files(dir.path()).into_iter().map(|f| (f.clone(), fs::read(dir.path().join(&f)).unwrap())).collect()
}

#[test]
fn height_fields_leave_no_trace() {
    let dir = folder();
    with_terrain(dir.path());
    let survey = dir.path().join("survey.xml");
    for corrections in [Corrections::NONE, Corrections::REFINED] {
        let run = |triangulate, threads| {
            outputs(&survey, triangulate, |settings| {
                settings.set_corrections(corrections);
                settings.set_threads(threads);
            })
        };
        let reference = run(true, 1);
        assert!(
            reference.len() >= 5 && reference.values().all(|bytes| bytes.len() > 10_000),
            "{:?}",
            reference.keys()
        );
        for threads in [1, 2] {
            for (file, bytes) in run(false, threads) {
                assert!(reference[&file] == bytes, "{} differs on {threads} threads", file.display());
            }
        }
    }
}

#[test]
fn packs_and_instruction_sets_leave_no_trace_in_terrain() {
    let dir = folder();
    with_terrain(dir.path());
    let points = |extra: &[&str], set: Option<&str>| {
        let out = dir.path().join("out.xyz");
        let args = [&["run", "survey.xml", "-q", "--force", "-o", "out.xyz", "--physics", "refined"], extra]
            .concat();
        let mut command = crate::common::vlscan(dir.path());
        if let Some(set) = set {
            command.env("VLSCAN_SIMD", set);
        }
        let done = command.args(args).output().unwrap();
        assert!(done.status.success(), "{}", crate::common::text(&done.stderr));
        fs::read(out).unwrap()
    };
    let reference = points(&["-j", "1"], None);
    assert!(reference.len() > 10_000);
    for set in ["portable", "avx2", "avx512"] {
        assert!(points(&["-j", "2"], Some(set)) == reference, "{set}");
    }
    assert!(points(&["--tree", "fsah", "--chunk-size", "7"], None) == reference);
    succeed(dir.path(), &["scene", "pack", "survey.xml", "--physics", "refined", "-o", "all.vlscene", "-q"]);
    assert!(points(&["--scene", "all.vlscene"], None) == reference);
}
