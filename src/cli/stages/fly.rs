//! `vlscan trajectory` and `vlscan pulses`: fly a survey and write its poses or pulses to stdout.

use crate::cli::args::{EmitArgs, EmitFormat, PulsesArgs, SurveyArgs, TrajectoryArgs};
use crate::cli::companions::resolve;
use crate::cli::watch::watched;
use crate::cli::{Console, Verbosity, interrupt};
use crate::pipeline::{Emission, Emitted, Progress, ResolvedRun, RunContext, Session, emit};
use crate::streams::{
    ColumnSet, POSE_HEADER, PulseColumn, PulseRow, TableColumn, TableWriter, default_columns, header,
    pose_columns, pulse_columns, push_pose, push_pose_row, push_pulse, push_pulse_row, with_errors,
    with_reported,
};
use std::io::{IsTerminal, Write};
use std::time::Instant;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched};
use vlscan_base::quantity::{amount, duration};
use vlscan_geom::DVec3;
use vlscan_survey::Survey;

/// Default interval between poses, s.
const INTERVAL: f64 = 0.05;

pub fn trajectory(args: &TrajectoryArgs, console: &Console) -> Result<()> {
    let interval = args.interval.map(|seconds| seconds.0);
    let change = |survey: &mut Survey| {
        for leg in &mut survey.legs {
            let own = leg.scanner.trajectory_interval;
            leg.scanner.trajectory_interval = interval.unwrap_or(if own > 0.0 { own } else { INTERVAL });
        }
    };
    fly(&args.survey, &args.emit, args.flown, console, change, Rows::Poses)
}

pub fn pulses(args: &PulsesArgs, console: &Console) -> Result<()> {
    // No poses are written.
    let change = |survey: &mut Survey| {
        survey.legs.iter_mut().for_each(|leg| leg.scanner.trajectory_interval = 0.0);
    };
    fly(&args.survey, &args.emit, false, console, change, Rows::Pulses)
}

#[derive(Clone, Copy)]
enum Rows {
    Poses,
    Pulses,
}

impl Rows {
    fn header(self, flight: &Flight) -> String {
        match self {
            Rows::Poses => POSE_HEADER.to_owned(),
            Rows::Pulses => header(flight.columns),
        }
    }

    fn columns(self, flight: &Flight) -> Vec<TableColumn> {
        match self {
            Rows::Poses => pose_columns(),
            Rows::Pulses => pulse_columns(flight.columns),
        }
    }

    /// Appends the emitted rows as lines of text, or as values for [`TableWriter`].
    fn push(self, flight: &Flight, emitted: &Emitted, as_text: bool, out: &mut Vec<u8>) {
        match self {
            Rows::Poses => {
                let push = if as_text { push_pose } else { push_pose_row };
                for pose in &emitted.poses {
                    push(
                        out,
                        &if flight.as_flown { pose.as_flown() } else { *pose },
                        (flight.shift, emitted.time_origin),
                    );
                }
            }
            Rows::Pulses => {
                let push = if as_text { push_pulse } else { push_pulse_row };
                let divergence = flight.divergences.get(emitted.leg as usize).copied();
                let (leg, epoch) = (emitted.leg, emitted.epoch);
                for &(mut pulse, step) in &emitted.pulses {
                    pulse.time_ns += emitted.time_origin * 1e9;
                    let row = PulseRow { pulse, leg, step, epoch, divergence };
                    push(out, &row, flight.columns, flight.shift);
                }
            }
        }
    }
}

/// Properties of the flight that the rows depend on.
struct Flight {
    shift: DVec3,
    columns: ColumnSet,
    /// Whether poses are true poses, not reported ones.
    as_flown: bool,
    /// Divergence at the start of the survey and in the leg, by leg, rad.
    divergences: Vec<[f64; 2]>,
}

impl Flight {
    fn new(emission: &Emission, has_errors: bool, as_flown: bool) -> Flight {
        let (survey, shift) = (&emission.survey, emission.shift);
        let own = survey.scanner.devices[0].beam.divergence;
        let of_legs: Vec<f64> = survey.legs.iter().map(|l| l.scanner.beam_divergence).collect();
        let start = of_legs.first().copied().unwrap_or(own);
        let mut columns = default_columns();
        if survey.scanner.devices.iter().any(|d| d.errors.any()) {
            columns = with_errors(columns);
        }
        if has_errors {
            columns = with_reported(columns);
        }
        if of_legs.iter().any(|d| *d != own) {
            columns = columns.with(PulseColumn::Divergence).with(PulseColumn::StartDivergence);
        }
        if emission.epochs > 1 {
            columns = columns.with(PulseColumn::Epoch);
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
    args: &SurveyArgs,
    emit_args: &EmitArgs,
    as_flown: bool,
    console: &Console,
    change: impl FnOnce(&mut Survey),
    rows: Rows,
) -> Result<()> {
    if emit_args.format == EmitFormat::Arrow && !emit_args.force && std::io::stdout().is_terminal() {
        return Err(Error::input(
            "an Arrow stream would go to the terminal; redirect standard output, or insist with --force",
        ));
    }
    let ResolvedRun { mut settings, progress_lines, .. } = resolve(&args.file, &args.options(), console)?;
    change(&mut settings.survey);
    let has_errors = settings.flight.navigation.any();
    let emission = Session::open_for_flight(settings, console.observer())?.into_emission()?;
    let flight = Flight::new(&emission, has_errors, as_flown);
    let legs = emission.survey.legs.len();
    let is_live = emission.poses.is_some();

    let progress = Progress::default();
    let control = RunContext::new(&progress, &interrupt::STOP);
    let started = Instant::now();
    let failed = |e| Error::io("write", "standard output", e);
    let mut out = FileWriter::stdout(Patched::Never)?;
    match emit_args.format {
        EmitFormat::Csv => {
            out.append(rows.header(&flight).as_bytes())?;
            let encode = |emitted: &Emitted, out: &mut Vec<u8>| rows.push(&flight, emitted, true, out);
            watched(console, progress_lines, legs, &progress, || emit(emission, control, encode, out))?;
        }
        EmitFormat::Arrow => {
            let mut out = TableWriter::begin(rows.columns(&flight), is_live, out).map_err(failed)?;
            out.flush().map_err(failed)?;
            let encode = |emitted: &Emitted, out: &mut Vec<u8>| rows.push(&flight, emitted, false, out);
            let out =
                watched(console, progress_lines, legs, &progress, || emit(emission, control, encode, out))?;
            out.finish().map_err(failed)?;
        }
    }
    if interrupt::STOP.is_requested() {
        return Err(Error::Interrupted);
    }
    let seconds = started.elapsed().as_secs_f64();
    let pulses = amount(progress.snapshot().pulses as f64);
    console.took(Verbosity::Verbose, format!("{pulses} pulses flown in {}", duration(seconds)));
    Ok(())
}
