//! A survey file from a program: several runs over one loaded scene, with progress, requests to stop and
//! warnings.
//!
//!     cargo run --example session

use vlscan::output::LasVersion;
use vlscan::render::Render as _;
use vlscan::{
    LoadedScene, Notice, OutputRequest, PointFormat, Progress, ReadOptions, RunContext, Session, Settings,
    Stop, Target, read_survey,
};

fn main() -> vlscan::Result<()> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let survey = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/room/survey.xml");
    let (survey, warnings) = read_survey(survey.as_ref(), &ReadOptions::default())?;
    eprint!("{}", warnings.render(false));

    let mut settings = Settings::new(survey);
    settings.set_threads(2);
    let scene = LoadedScene::of(&settings, &|_| ())?;

    let mut sums = Vec::new();
    for seed in [1, 2, 1] {
        let mut settings = settings.clone();
        settings.set_seed(seed);
        let observer = |notice| {
            if let Notice::Note(text) = notice {
                eprintln!("{text}");
            }
        };
        let path = folder.path().join(format!("room-{}.las", sums.len()));
        let mut outputs = OutputRequest::default();
        outputs.sinks = vec![(Target::File(path.clone()), PointFormat::Las)];
        outputs.cloud.las.version = LasVersion::V10;
        // Another thread may read the progress and request the end meanwhile.
        let (progress, stop) = (Progress::default(), Stop::new());
        let mut session = Session::new(settings, scene.clone(), observer)?;
        let report = session.run(outputs, RunContext::new(&progress, &stop))?;
        assert_eq!(progress.snapshot().pulses, report.pulses);
        let bytes = std::fs::read(&path).expect("the file of the run");
        assert_eq!(bytes[24..26], [1, 0], "LAS 1.0");
        println!("seed {seed}: {} points, {} bytes", report.summary.points, bytes.len());
        sums.push(bytes);
    }
    assert!(sums[0] == sums[2], "equal seeds give equal bytes");
    assert!(sums[0] != sums[1], "other seeds do not");
    Ok(())
}
