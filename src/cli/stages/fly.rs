//! `vlscan trajectory` and `vlscan pulses`: a survey is flown, and its poses or pulses go to stdout.

use crate::cli::args::{OutputArgs, PhysicsArgs, PulsesArgs, RunArgs, SurveyArgs, TrajectoryArgs, TreeArgs};
use crate::cli::run::{Job, open_poses};
use crate::cli::watch::{amount, duration, watched};
use crate::cli::{Console, Verbosity, interrupt};
use crate::diag::Diagnostics;
use crate::error::{Error, Result};
use crate::flight::FlightPlan;
use crate::geom::DVec3;
use crate::pipeline::{Emission, Emitted, Progress, emit};
use crate::scene;
use crate::streams::{
    Column, POSE_HEADER, Present, PulseRow, header, push_pose, push_pulse, usual_columns, with_errors,
};
use crate::survey::{PlatformKind, Survey};
use std::io::Write;
use std::time::Instant;

/// Seconds between poses of surveys that do not say.
const INTERVAL: f64 = 0.05;

/// Runs `vlscan trajectory`.
pub fn trajectory(args: &TrajectoryArgs, console: &Console) -> Result<()> {
    let interval = match args.interval {
        Some(s) if !(s.is_finite() && s > 0.0) => {
            return Err(Error::input(format!("--interval: expected seconds above 0, found {s}")));
        }
        other => other,
    };
    let change = |survey: &mut Survey| {
        for leg in &mut survey.legs {
            let own = leg.scanner.trajectory_interval;
            leg.scanner.trajectory_interval = interval.unwrap_or(if own > 0.0 { own } else { INTERVAL });
        }
    };
    let begin = |_: &Flight| POSE_HEADER.to_owned();
    let encode = |flight: &Flight, emitted: &Emitted, out: &mut Vec<u8>| {
        emitted.poses.iter().for_each(|pose| push_pose(out, pose, flight.shift));
    };
    fly(&args.survey, console, change, begin, encode)
}

/// Runs `vlscan pulses`.
pub fn pulses(args: &PulsesArgs, console: &Console) -> Result<()> {
    let begin = |flight: &Flight| header(flight.columns);
    let encode = |flight: &Flight, emitted: &Emitted, out: &mut Vec<u8>| {
        for (pulse, step) in &emitted.pulses {
            let divergence = flight.divergences.get(emitted.leg as usize).copied();
            let row =
                PulseRow { pulse: *pulse, leg: emitted.leg, step: *step, play: emitted.play, divergence };
            push_pulse(out, &row, flight.columns, flight.shift);
        }
    };
    // Poses would only make work.
    let change = |survey: &mut Survey| {
        survey.legs.iter_mut().for_each(|leg| leg.scanner.trajectory_interval = 0.0);
    };
    fly(&args.survey, console, change, begin, encode)
}

/// What the rows need to know of the flight.
struct Flight {
    shift: DVec3,
    /// Columns of a stream of pulses.
    columns: Present,
    /// By leg: divergence when the survey begins and in the leg.
    divergences: Vec<[f64; 2]>,
}

impl Flight {
    fn of(survey: &Survey, shift: DVec3, plays: u32) -> Flight {
        let own = survey.scanner.devices[0].beam.divergence;
        let of_legs: Vec<f64> = survey.legs.iter().map(|l| l.scanner.beam_divergence).collect();
        let start = of_legs.first().copied().unwrap_or(own);
        let mut columns = usual_columns();
        if survey.scanner.devices.iter().any(|d| d.errors.any()) {
            columns = with_errors(columns);
        }
        if of_legs.iter().any(|d| *d != own) {
            columns = columns.with(Column::Divergence).with(Column::StartDivergence);
        }
        if plays > 1 {
            columns = columns.with(Column::Play);
        }
        Flight { shift, columns, divergences: of_legs.into_iter().map(|leg| [start, leg]).collect() }
    }
}

fn fly(
    args: &SurveyArgs,
    console: &Console,
    change: impl FnOnce(&mut Survey),
    begin: impl FnOnce(&Flight) -> String,
    encode: impl Fn(&Flight, &Emitted, &mut Vec<u8>) + Sync,
) -> Result<()> {
    interrupt::listen();
    let (mut job, warnings) = Job::resolve(&as_run(args))?;
    console.warnings(&warnings);
    change(&mut job.survey);
    let plays = scene::plays(&job.survey.scene)?;
    let poses = match &job.survey.platform.kind {
        PlatformKind::Stream(_) if plays > 1 => {
            return Err(Error::input(format!(
                "the scene's swaps ask for {plays} flights, and a stream of poses passes only once"
            )));
        }
        PlatformKind::Stream(stream) => Some(open_poses(stream, &job, console)?),
        _ => None,
    };
    let (scene, found) = scene::load(&job.survey.scene, &job.load)?;
    console.warnings(&found.finish(job.strict)?);
    let ground = |x, y| scene.ground_height(x, y);
    let (plan, found): (FlightPlan, Diagnostics) =
        FlightPlan::new(&job.survey, scene.shift, &ground, &job.flight)?;
    console.warnings(&found.finish(job.strict)?);
    let flight = Flight::of(&job.survey, scene.shift, plays);
    // Pulses go on in the frame of the scene, which itself is needed no more.
    drop(scene);

    let mut out = std::io::stdout();
    let failed = |e| Error::io("write", "standard output", e);
    out.write_all(begin(&flight).as_bytes()).and_then(|()| out.flush()).map_err(failed)?;
    let progress = Progress::default();
    let started = Instant::now();
    let emission = Emission {
        flight: &plan,
        plays,
        poses,
        schedule: job.schedule,
        stop: &interrupt::STOP,
        progress: &progress,
    };
    let encode = |emitted: &Emitted, out: &mut Vec<u8>| encode(&flight, emitted, out);
    watched(console, job.progress_lines, job.survey.legs.len(), &progress, || emit(emission, encode, out))?;
    let seconds = started.elapsed().as_secs_f64();
    let pulses = amount(progress.snapshot().pulses as f64);
    console.took(Verbosity::Verbose, format!("{pulses} pulses flown in {}", duration(seconds)));
    Ok(())
}

/// The same choices as those of a run without points.
fn as_run(args: &SurveyArgs) -> RunArgs {
    RunArgs {
        file: args.file.clone(),
        output: OutputArgs::default(),
        flight: args.flight.clone(),
        input: args.input.clone(),
        origin: args.origin.clone(),
        physics: PhysicsArgs::default(),
        schedule: args.schedule.clone(),
        tree: TreeArgs::default(),
        trajectory_out: None,
    }
}
