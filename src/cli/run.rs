//! `vlscan run`: the whole river.

mod job;

use super::args::RunArgs;
use super::watch::{amount, duration, watched};
use super::{Console, Verbosity, interrupt};
use crate::error::{Error, Result};
use crate::flight::FlightPlan;
use crate::output::{FileKind, OutputContext, OutputPlan, Summary};
use crate::pipeline::{self, Progress};
use crate::platform::PoseReader;
use crate::pulse::Physics;
use crate::scene::{self, Scene};
use crate::survey::PlatformKind;
use crate::tree::Tree;
use job::Job;
pub use job::count;
use std::sync::Arc;
use std::time::Instant;

/// Runs `vlscan run`.
pub fn run(args: &RunArgs, console: &Console) -> Result<()> {
    interrupt::listen();
    let started = Instant::now();
    let (job, warnings) = Job::resolve(args)?;
    console.warnings(&warnings);
    let (scene, tree) = load_and_build(&job, console)?;

    let ground = |x, y| scene.ground_height(x, y);
    let (flight, warnings) = FlightPlan::new(&job.survey, scene.shift, &ground, &job.flight)?;
    console.warnings(&warnings.finish(job.strict)?);
    let physics = Physics::new(&scene, &tree, &job.survey, job.physics)?;
    let output =
        Arc::new(OutputPlan::new(job.output.clone(), &OutputContext { survey: &job.survey, scene: &scene })?);
    let poses = match &job.survey.platform.kind {
        PlatformKind::Stream(stream) => Some(PoseReader::open(stream)?),
        _ => None,
    };

    let progress = Progress::default();
    let flying = Instant::now();
    let summary = watched(console, job.progress_lines, job.survey.legs.len(), &progress, || {
        pipeline::fly(pipeline::Run {
            flight: &flight,
            physics: &physics,
            output,
            poses,
            schedule: job.schedule,
            chunk_size: job.chunk_size,
            stop: &interrupt::STOP,
            progress: &progress,
        })
    })?;
    let pulses = progress.snapshot().pulses;
    report(console, &summary, pulses, flying.elapsed().as_secs_f64(), started.elapsed().as_secs_f64());
    Ok(())
}

fn load_and_build(job: &Job, console: &Console) -> Result<(Scene, Tree)> {
    let started = Instant::now();
    let (scene, warnings) = scene::load(&job.survey.scene, &job.load)?;
    console.warnings(&warnings.finish(job.strict)?);
    console.took(
        Verbosity::Verbose,
        format!(
            "scene: {} parts, {} primitives, {:.1} MB, {:.2} s",
            scene.parts.len(),
            amount(scene.geometry.len() as f64),
            scene.memory() as f64 / 1e6,
            started.elapsed().as_secs_f64()
        ),
    );
    let started = Instant::now();
    let tree = Tree::build(&scene.geometry, &job.tree);
    console.took(
        Verbosity::Verbose,
        format!("tree: {:.1} MB, {:.2} s", tree.memory() as f64 / 1e6, started.elapsed().as_secs_f64()),
    );
    if interrupt::STOP.asked() {
        return Err(Error::Interrupted);
    }
    Ok((scene, tree))
}

fn report(console: &Console, summary: &Summary, pulses: u64, flying: f64, whole: f64) {
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
            "{} pulses, {} points in {} ({} pulses/s; {} with loading)",
            amount(pulses as f64),
            amount(summary.points as f64),
            duration(flying),
            amount(pulses as f64 / flying.max(1e-9)),
            duration(whole)
        ),
    );
}
