//! `vlscan run`: the whole river, once for every play of a survey with swapped parts. HELIOS++ layouts get a run directory
//! for each play; in single files and streams the plays follow one another, told apart by GPS time and pulse number.

pub mod job;
pub mod speed;

use super::args::RunArgs;
use super::watch::{amount, duration, watched};
use super::{Console, Verbosity, interrupt, slips};
use crate::error::{Error, Result};
use crate::flight::FlightPlan;
use crate::output::{FileKind, FileSummary, OutputContext, OutputPlan, OutputRequest, Summary};
use crate::pipeline::{self, Ended, Moment, Progress};
use crate::platform::{PoseReader, Told};
use crate::pulse::Physics;
use crate::scene::{self, MotionPlan, Scene, SceneFrame};
use crate::schedule::Recorder;
use crate::survey::{PlatformKind, PoseStream};
use crate::tree::Tree;
pub use job::{Job, count};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Instant;

/// Runs `vlscan run`.
pub fn run(args: &RunArgs, console: &Console) -> Result<()> {
    interrupt::listen();
    let started = Instant::now();
    let (job, warnings) = Job::resolve(args)?;
    console.warnings(&warnings);
    let plays = scene::count_epochs(&job.survey.scene)?;
    let stream = match &job.survey.platform.kind {
        PlatformKind::Stream(_) if plays > 1 => {
            return Err(Error::input(format!(
                "the scene's swaps ask for {plays} flights, and a stream of poses passes only once"
            )));
        }
        PlatformKind::Stream(stream) => Some(stream),
        _ => None,
    };
    let mut stage = load_and_build(&job, console, 0, None)?;

    let ground = |x, y| stage.scene.ground_height(x, y);
    let (flight, warnings) = FlightPlan::new(&job.survey, stage.scene.shift, &ground, &job.flight)?;
    console.warnings(&warnings.finish(job.strict)?);
    let slipped = slips::before_flight(&job.survey, &stage, &flight).finish(job.strict)?;
    console.warnings(&slipped);
    let told = Arc::new(AtomicBool::new(!slipped.is_empty()));
    let context = OutputContext { survey: &job.survey, scene: &stage.scene };
    let output = Arc::new(OutputPlan::new(OutputRequest { plays, ..job.output.clone() }, &context)?);
    let first = SceneFrame::of(&stage.scene);
    let mut poses = match stream {
        Some(stream) => {
            let mut watch =
                slips::PoseWatch::new(stream, stage.scene.bounds.moved(stage.scene.shift), told.clone());
            Some(open_poses(stream, &job, console)?.observed(move |seen| watch.see(seen)))
        }
        None => None,
    };

    let progress = Progress::default();
    let recorder = job.schedule_log.is_some().then(Recorder::new);
    let (mut flying, mut before) = (0.0, None);
    let mut play = 0;
    let summary = loop {
        let physics = Physics::new(&stage.scene, &stage.tree, &job.survey, job.physics)?;
        let judge = judge(&job, &stage, console, (stream.is_some(), told.clone()));
        let run = pipeline::Run {
            flight: &flight,
            physics: &physics,
            movers: stage.movers.as_ref().map(|movers| (movers, &job.tree)),
            output: output.clone(),
            poses: poses.take(),
            schedule: job.schedule,
            recorder: recorder.as_ref(),
            stop: &interrupt::STOP,
            progress: &progress,
            target: slips::target(&job.survey, &stage.scene),
            judge: Some(&judge),
        };
        let took_off = Instant::now();
        let legs = job.survey.legs.len();
        let ended = watched(console, job.progress_lines, legs, &progress, || {
            pipeline::fly(run, before.take(), play + 1 == plays)
        });
        let ended = ended.inspect_err(|_| tell_rescued(console, &output.rescued()))?;
        flying += took_off.elapsed().as_secs_f64();
        match ended {
            Ended::Whole(summary) => break summary,
            Ended::Cut(summary) => {
                let pulses = progress.snapshot().pulses;
                report(console, &summary, pulses, flying, started.elapsed().as_secs_f64());
                return Err(interrupted(console, &summary));
            }
            Ended::Play(interval) => before = Some(interval),
        }
        // One play's scene at a time.
        drop(judge);
        drop(stage);
        play += 1;
        console.detail(format!("play {} of {plays}", play + 1));
        stage = load_and_build(&job, console, play, Some(first))?;
    };
    if let (Some(path), Some(recorder)) = (&job.schedule_log, recorder) {
        let text = serde_json::to_string(&recorder.finish()).map_err(|e| Error::Internal(e.to_string()))?;
        std::fs::write(path, text + "\n").map_err(|e| Error::io("write", path, e))?;
    }
    let pulses = progress.snapshot().pulses;
    report(console, &summary, pulses, flying, started.elapsed().as_secs_f64());
    Ok(())
}

/// The reader of a live trajectory, which tells the user what it meets.
pub fn open_poses(stream: &PoseStream, job: &Job, console: &Console) -> Result<PoseReader> {
    let console = console.clone();
    let tell = move |told| match told {
        Told::Warnings(found) => console.warnings(&found),
        Told::Note(note) => console.say(note),
        Told::Detail(detail) => console.detail(detail),
    };
    Ok(PoseReader::open(stream)?.patient(job.latency).telling(job.strict, tell))
}

/// Tells of too few points: at the end, or of a `live` flight while it goes on; not where its cause has been `told`. With
/// `--strict` that ends the run.
pub fn judge<'a>(
    job: &'a Job,
    stage: &'a Stage,
    console: &'a Console,
    (live, told): (bool, Arc<AtomicBool>),
) -> impl Fn(&Progress, Moment) -> Result<()> + Sync + 'a {
    move |progress, moment| {
        if told.load(Relaxed) || moment == Moment::Early && !live {
            return Ok(());
        }
        let (done, aim) = (progress.snapshot(), progress.aim());
        let target = slips::target(&job.survey, &stage.scene);
        let run = slips::Yield {
            pulses: done.pulses,
            echoes: done.echoes,
            aim: &aim,
            target,
            mount: job.survey.platform.mount,
        };
        if let Some(slip) = slips::judge_yield(&run, stage, moment) {
            told.store(true, Relaxed);
            console.warnings(&slip.warning(None).finish(job.strict)?);
        }
        Ok(())
    }
}

/// Says what an interrupted run leaves behind.
pub fn interrupted(console: &Console, summary: &Summary) -> Error {
    if !summary.files.is_empty() {
        console.say("the run was interrupted: these outputs are valid but partial, and say so");
    }
    tell_rescued(console, &summary.files);
    Error::Interrupted
}

/// Says which files of earlier runs stay because what would have replaced them is partial.
pub fn tell_rescued(console: &Console, files: &[FileSummary]) {
    for file in files {
        if let (Some(old), Some(new)) = (&file.beside, &file.path) {
            let (old, new) = (old.display(), new.display());
            console.say(format!("{old} is kept as it was; what was measured until then is in {new}"));
        }
    }
}

/// What a play is flown over.
pub struct Stage {
    pub scene: Scene,
    /// Over what stands still.
    pub tree: Tree,
    pub movers: Option<MotionPlan>,
}

/// Loads the scene of a play and builds its tree. `first` is where the first play's scene stands.
pub fn load_and_build(job: &Job, console: &Console, play: u32, first: Option<SceneFrame>) -> Result<Stage> {
    let started = Instant::now();
    let recipe = &job.survey.scene;
    foretell_rasters(job, console)?;
    let (scene, warnings) = scene::load_epoch(recipe, &job.load, play, first)?;
    console.warnings(&warnings.finish(job.strict)?);
    console.took(
        Verbosity::Verbose,
        format!(
            "scene: {} parts, {} primitives, {:.1} MB, {:.2} s",
            scene.parts.len(),
            amount(scene.primitives() as f64),
            scene.memory() as f64 / 1e6,
            started.elapsed().as_secs_f64()
        ),
    );
    let started = Instant::now();
    check_tree(job, &scene)?;
    let tree = scene.tree(&job.tree);
    console.took(
        Verbosity::Verbose,
        format!("tree: {:.1} MB, {:.2} s", tree.memory() as f64 / 1e6, started.elapsed().as_secs_f64()),
    );
    let pulse_rate = job.survey.legs.first().map_or(0.0, |leg| f64::from(leg.scanner.pulse_freq));
    let movers = MotionPlan::new(&scene, pulse_rate);
    if interrupt::STOP.asked() {
        return Err(Error::Interrupted);
    }
    Ok(Stage { scene, tree, movers })
}

/// Rasters that take less are not worth a word.
const TOLD: u64 = 500_000_000;

/// Says what large rasters will take, and refuses what is more than allowed, before any of it is loaded.
fn foretell_rasters(job: &Job, console: &Console) -> Result<()> {
    let mut all = 0u64;
    for need in scene::raster_needs(&job.survey.scene) {
        let tree = Tree::forecast(need.triangles, job.tree.builder);
        all = all.saturating_add(need.bytes).saturating_add(tree);
        if need.bytes.saturating_add(tree) >= TOLD {
            console.say(format!(
                "{}: {} x {} pixels become {} triangles, which need {}B, and about {}B more for the tree over them",
                need.path.display(),
                need.columns,
                need.rows,
                amount(need.triangles as f64),
                amount(need.bytes as f64),
                amount(tree as f64)
            ));
        }
    }
    match job.load.max_memory {
        Some(limit) if all > limit => Err(Error::input(format!(
            "the rasters of the scene and the tree over them need about {}B; the limit is {}B",
            amount(all as f64),
            amount(limit as f64)
        ))),
        _ => Ok(()),
    }
}

/// Refuses a tree that would take more memory than allowed, before it is built.
fn check_tree(job: &Job, scene: &Scene) -> Result<()> {
    let (held, tree) = (scene.memory() as u64, scene.tree_forecast(job.tree.builder));
    match job.load.max_memory {
        Some(limit) if held.saturating_add(tree) > limit => Err(Error::input(format!(
            "the scene needs {}B and the tree over it about {}B more; the limit is {}B",
            amount(held as f64),
            amount(tree as f64),
            amount(limit as f64)
        ))),
        _ => Ok(()),
    }
}

/// Tells what was written.
pub fn report(console: &Console, summary: &Summary, pulses: u64, flying: f64, whole: f64) {
    for file in &summary.files {
        let name = file.path.as_ref().map_or_else(|| "stdout".into(), |p| p.display().to_string());
        let unit = if file.kind == FileKind::Points { "points" } else { "records" };
        console.say(format!("{name}  {} {unit}, {} bytes", file.records, file.bytes));
        if file.left_out > 0 {
            console
                .say(format!("  warning: {} points do not fit the format and were left out", file.left_out));
        }
    }
    console.took(
        Verbosity::Normal,
        format!(
            "{} pulses, {} points ({:.2} per pulse) in {} ({} pulses/s; {} with loading)",
            amount(pulses as f64),
            amount(summary.points as f64),
            summary.points as f64 / (pulses as f64).max(1.0),
            duration(flying),
            amount(pulses as f64 / flying.max(1e-9)),
            duration(whole)
        ),
    );
}
