//! Scenes whose primitives are stored in another way give the same bytes.

use crate::common::{files, folder, text, vlscan};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use vlscan::base::corrections::Corrections;
use vlscan::scene::{LoadOptions, Pack};
use vlscan::trace::Geometry;
use vlscan::{
    OutputRequest, PointFormat, Progress, ReadOptions, RunContext, Session, Settings, Stop, Target,
    read_survey,
};

/// Checks that all outputs of a survey are the same bytes with primitives stored one by one and compactly,
/// whatever the physics and the number of threads. `store` changes the settings to compact storage or to the
/// other one, of which `count` finds `compact` or no objects in the scene.
pub fn leaves_no_trace(
    survey: &Path,
    store: impl Fn(&mut Settings, bool),
    count: impl Fn(&Geometry) -> usize,
    compact: usize,
) {
    for corrections in [Corrections::NONE, Corrections::REFINED] {
        let run = |is_compact, threads| {
            let mut settings = settings(survey, corrections);
            settings.set_threads(threads);
            store(&mut settings, is_compact);
            let session = Session::open(settings, |_| {}).unwrap();
            assert_eq!(count(&session.scene().geometry), if is_compact { compact } else { 0 });
            outputs(session)
        };
        let reference = run(false, 1);
        assert!(
            reference.len() >= 5 && reference.values().all(|bytes| bytes.len() > 10_000),
            "{:?}",
            reference.keys()
        );
        for threads in [1, 2] {
            for (file, bytes) in run(true, threads) {
                assert!(reference[&file] == bytes, "{} differs on {threads} threads", file.display());
            }
        }
    }
}

/// Checks that the points are the same bytes from a packed scene, with compact storage that `store` chooses,
/// for every instruction set, tree and chunk size, as from primitives that are stored one by one. `count`
/// counts the compact objects in a scene.
pub fn packs_and_instruction_sets_leave_no_trace(
    folder: &Path,
    store: impl Fn(&mut Settings, bool),
    count: impl Fn(&Geometry) -> usize,
    compact: usize,
) {
    for (pack, is_compact) in [("single.vlscene", false), ("compact.vlscene", true)] {
        let mut settings = settings(&folder.join("survey.xml"), Corrections::REFINED);
        store(&mut settings, is_compact);
        let Settings { survey, load, tree, .. } = &settings;
        let path = folder.join(pack);
        vlscan::scene::pack(&survey.scene, load, tree, &path, &|_| Ok(())).unwrap();
        let scene = Pack::open(&path).unwrap();
        let scene = scene.scene(&scene.load_options(LoadOptions::default()), 0).unwrap();
        assert_eq!(count(&scene.geometry), if is_compact { compact } else { 0 });
    }
    let points = |scene: &[&str], extra: &[&str], set: Option<&str>| {
        let run = ["run", "survey.xml", "-q", "--force", "-o", "out.xyz", "--physics", "refined"];
        let mut command = vlscan(folder);
        if let Some(set) = set {
            command.env("VLSCAN_SIMD", set);
        }
        let done = command.args(run).args(scene).args(extra).output().unwrap();
        assert!(done.status.success(), "{}", text(&done.stderr));
        fs::read(folder.join("out.xyz")).unwrap()
    };
    let compact = ["--scene", "compact.vlscene"];
    let reference = points(&[], &["-j", "1"], None);
    assert!(reference.len() > 10_000);
    for set in ["portable", "avx2", "avx512"] {
        assert!(
            points(&["--scene", "single.vlscene"], &["-j", "2"], Some(set)) == reference,
            "single, {set}"
        );
        assert!(points(&compact, &["-j", "2"], Some(set)) == reference, "compact, {set}");
    }
    assert!(points(&[], &["--tree", "fsah", "--chunk-size", "7"], None) == reference);
    assert!(points(&compact, &["--chunk-size", "7"], None) == reference);
}

fn settings(survey: &Path, corrections: Corrections) -> Settings {
    let (survey, _) = read_survey(survey, &ReadOptions::default()).unwrap();
    let mut settings = Settings::new(survey);
    settings.set_corrections(corrections);
    settings
}

fn outputs(mut session: Session) -> BTreeMap<PathBuf, Vec<u8>> {
    let dir = folder();
    let formats = [("a.xyz", PointFormat::Xyz), ("a.las", PointFormat::Las), ("a.csv", PointFormat::Csv)];
    let sinks = formats.map(|(name, format)| (Target::File(dir.path().join(name)), format)).into();
    let mut request = OutputRequest::default();
    (request.sinks, request.waveforms, request.pulses) = (sinks, true, true);
    (request.cloud.labels, request.cloud.heights) = (true, true);
    let (progress, stop) = (Progress::default(), Stop::new());
    session.run(request, RunContext::new(&progress, &stop)).unwrap();
    files(dir.path()).into_iter().map(|f| (f.clone(), fs::read(dir.path().join(&f)).unwrap())).collect()
}
