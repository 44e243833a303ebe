//! `vlscan trajectory` and `vlscan pulses`: a survey is flown, and its poses or pulses go to stdout.

use crate::cli::args::{
    EmitArgs, EmitFormat, OutputArgs, PhysicsArgs, ProfileArgs, PulsesArgs, RunArgs, SurveyArgs,
    TrajectoryArgs, TreeArgs,
};
use crate::cli::run::{Job, open_poses};
use crate::cli::watch::{amount, duration, watched};
use crate::cli::{Console, Verbosity, interrupt};
use crate::diag::Diagnostics;
use crate::error::{Error, Result};
use crate::flight::{FlightPlan, PoseSample};
use crate::geom::DVec3;
use crate::pipeline::{Emission, Emitted, Progress, emit};
use crate::scene;
use crate::streams::{
    Column, POSE_HEADER, Present, PulseRow, TableColumn, TableWriter, header, pose_columns, pulse_columns,
    push_pose, push_pose_row, push_pulse, push_pulse_row, usual_columns, with_errors, with_reported,
};
use crate::survey::{PlatformKind, Survey};
use std::io::{IsTerminal, Write};
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
    fly(&as_run(&args.survey, &args.profile), &args.emit, args.flown, console, change, &Poses)
}

/// Runs `vlscan pulses`.
pub fn pulses(args: &PulsesArgs, console: &Console) -> Result<()> {
    // Poses would only make work.
    let change = |survey: &mut Survey| {
        survey.legs.iter_mut().for_each(|leg| leg.scanner.trajectory_interval = 0.0);
    };
    fly(&as_run(&args.survey, &args.profile), &args.emit, false, console, change, &Pulses)
}

/// What is written of a flight, as lines of text or as rows of a table.
trait Rows: Sync {
    /// First line of text.
    fn header(&self, flight: &Flight) -> String;
    /// Columns of a table.
    fn columns(&self, flight: &Flight) -> Vec<TableColumn>;
    /// Appends what was emitted as lines.
    fn push_lines(&self, flight: &Flight, emitted: &Emitted, out: &mut Vec<u8>);
    /// Appends it as values, row by row, as [`TableWriter`] takes them.
    fn push_values(&self, flight: &Flight, emitted: &Emitted, out: &mut Vec<u8>);
}

struct Poses;

impl Poses {
    fn rows(flight: &Flight, emitted: &Emitted) -> impl Iterator<Item = PoseSample> {
        emitted.poses.iter().map(|pose| if flight.as_flown { pose.as_flown() } else { *pose })
    }
}

impl Rows for Poses {
    fn header(&self, _: &Flight) -> String {
        POSE_HEADER.to_owned()
    }

    fn columns(&self, _: &Flight) -> Vec<TableColumn> {
        pose_columns()
    }

    fn push_lines(&self, flight: &Flight, emitted: &Emitted, out: &mut Vec<u8>) {
        Poses::rows(flight, emitted).for_each(|pose| push_pose(out, &pose, flight.shift));
    }

    fn push_values(&self, flight: &Flight, emitted: &Emitted, out: &mut Vec<u8>) {
        Poses::rows(flight, emitted).for_each(|pose| push_pose_row(out, &pose, flight.shift));
    }
}

struct Pulses;

impl Pulses {
    fn rows(flight: &Flight, emitted: &Emitted) -> impl Iterator<Item = PulseRow> {
        let divergence = flight.divergences.get(emitted.leg as usize).copied();
        let (leg, play) = (emitted.leg, emitted.play);
        emitted.pulses.iter().map(move |(pulse, step)| PulseRow {
            pulse: *pulse,
            leg,
            step: *step,
            play,
            divergence,
        })
    }
}

impl Rows for Pulses {
    fn header(&self, flight: &Flight) -> String {
        header(flight.columns)
    }

    fn columns(&self, flight: &Flight) -> Vec<TableColumn> {
        pulse_columns(flight.columns)
    }

    fn push_lines(&self, flight: &Flight, emitted: &Emitted, out: &mut Vec<u8>) {
        Pulses::rows(flight, emitted).for_each(|row| push_pulse(out, &row, flight.columns, flight.shift));
    }

    fn push_values(&self, flight: &Flight, emitted: &Emitted, out: &mut Vec<u8>) {
        Pulses::rows(flight, emitted).for_each(|row| push_pulse_row(out, &row, flight.columns, flight.shift));
    }
}

/// What the rows need to know of the flight.
struct Flight {
    shift: DVec3,
    /// Columns of a stream of pulses.
    columns: Present,
    /// Poses are those flown, not those reported.
    as_flown: bool,
    /// By leg: divergence when the survey begins and in the leg.
    divergences: Vec<[f64; 2]>,
}

impl Flight {
    fn of(survey: &Survey, shift: DVec3, plays: u32, navigation: bool, as_flown: bool) -> Flight {
        let own = survey.scanner.devices[0].beam.divergence;
        let of_legs: Vec<f64> = survey.legs.iter().map(|l| l.scanner.beam_divergence).collect();
        let start = of_legs.first().copied().unwrap_or(own);
        let mut columns = usual_columns();
        if survey.scanner.devices.iter().any(|d| d.errors.any()) {
            columns = with_errors(columns);
        }
        if navigation {
            columns = with_reported(columns);
        }
        if of_legs.iter().any(|d| *d != own) {
            columns = columns.with(Column::Divergence).with(Column::StartDivergence);
        }
        if plays > 1 {
            columns = columns.with(Column::Play);
        }
        Flight {
            shift,
            columns,
            as_flown,
            divergences: of_legs.into_iter().map(|leg| [start, leg]).collect(),
        }
    }
}

fn fly(
    args: &RunArgs,
    emit_args: &EmitArgs,
    as_flown: bool,
    console: &Console,
    change: impl FnOnce(&mut Survey),
    rows: &impl Rows,
) -> Result<()> {
    interrupt::listen();
    if emit_args.format == EmitFormat::Arrow && !emit_args.force && std::io::stdout().is_terminal() {
        return Err(Error::input(
            "an Arrow stream would go to the terminal; redirect standard output, or insist with --force",
        ));
    }
    let (mut job, warnings) = Job::resolve(args)?;
    console.warnings(&warnings);
    change(&mut job.survey);
    let plays = scene::count_epochs(&job.survey.scene)?;
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
    let flight = Flight::of(&job.survey, scene.shift, plays, job.flight.navigation.any(), as_flown);
    // Pulses go on in the frame of the scene, which itself is needed no more.
    drop(scene);

    let progress = Progress::default();
    let started = Instant::now();
    let live = poses.is_some();
    let emission = Emission {
        flight: &plan,
        plays,
        poses,
        schedule: job.schedule,
        stop: &interrupt::STOP,
        progress: &progress,
    };
    let legs = job.survey.legs.len();
    let failed = |e| Error::io("write", "standard output", e);
    let mut out = std::io::stdout();
    match emit_args.format {
        EmitFormat::Csv => {
            out.write_all(rows.header(&flight).as_bytes()).and_then(|()| out.flush()).map_err(failed)?;
            let encode = |emitted: &Emitted, out: &mut Vec<u8>| rows.push_lines(&flight, emitted, out);
            watched(console, job.progress_lines, legs, &progress, || emit(emission, encode, out))?;
        }
        EmitFormat::Arrow => {
            let mut out = TableWriter::begin(rows.columns(&flight), live, out).map_err(failed)?;
            out.flush().map_err(failed)?;
            let encode = |emitted: &Emitted, out: &mut Vec<u8>| rows.push_values(&flight, emitted, out);
            let out = watched(console, job.progress_lines, legs, &progress, || emit(emission, encode, out))?;
            out.finish().map_err(failed)?;
        }
    }
    if interrupt::STOP.asked() {
        return Err(Error::Interrupted);
    }
    let seconds = started.elapsed().as_secs_f64();
    let pulses = amount(progress.snapshot().pulses as f64);
    console.took(Verbosity::Verbose, format!("{pulses} pulses flown in {}", duration(seconds)));
    Ok(())
}

/// The same choices as those of a run without points.
fn as_run(args: &SurveyArgs, profile: &ProfileArgs) -> RunArgs {
    RunArgs {
        output: OutputArgs::default(),
        survey: args.clone(),
        physics: PhysicsArgs { profile: profile.clone(), ..PhysicsArgs::default() },
        tree: TreeArgs::default(),
        trajectory_out: None,
    }
}
