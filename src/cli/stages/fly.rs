//! `vlscan trajectory` and `vlscan pulses`: fly a survey and write its poses or pulses to stdout.

use crate::cli::args::{EmitArgs, EmitFormat, PulsesArgs, SurveyArgs, TrajectoryArgs};
use crate::cli::watch::{during, watched};
use crate::cli::{Console, Verbosity, interrupt, messages};
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::time::Instant;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched};
use vlscan_base::quantity::{amount_of, duration};
use vlscan_messages::{ResultMessage, WrittenFile};
use vlscan_options::ResolvedRun;
use vlscan_session::streams::TableWriter;
use vlscan_session::{Emitted, Flight, FlightRows, Progress, RunContext, Session, emit};

pub fn trajectory(args: &TrajectoryArgs, console: &Console) -> Result<()> {
    let interval = args.interval.map(|seconds| seconds.0);
    fly(&args.survey, &args.emit, args.flown, console, interval, FlightRows::Poses)
}

pub fn pulses(args: &PulsesArgs, console: &Console) -> Result<()> {
    fly(&args.survey, &args.emit, false, console, None, FlightRows::Pulses)
}

/// The result of a flight with these numbers of legs and pulses.
fn result_of(rows: FlightRows, legs: usize, pulses: u64, seconds: f64) -> ResultMessage {
    let (content, records) = match rows {
        FlightRows::Poses => ("trajectory", None),
        FlightRows::Pulses => ("pulses", Some(pulses)),
    };
    ResultMessage {
        files: vec![WrittenFile { records, ..messages::written(Path::new("-"), content) }],
        legs: Some(legs as u64),
        pulses: Some(pulses),
        seconds: Some(seconds),
        ..ResultMessage::default()
    }
}

/// True if all of a flight was written.
fn is_complete<T>(emitted: &Result<T>) -> bool {
    emitted.is_ok() && !interrupt::STOP.is_requested()
}

/// Reads the survey or pipeline, of several scanners that which the command line names, and shows the
/// warnings about it.
fn resolve(args: &SurveyArgs, console: &Console) -> Result<ResolvedRun> {
    let options = args.options();
    let (run, warnings) = match &args.scanner {
        None => ResolvedRun::resolve(&args.file, &options)?,
        Some(name) => ResolvedRun::resolve_scanner(&args.file, name, &options)?,
    };
    console.warnings(&warnings)?;
    Ok(run)
}

fn fly(
    args: &SurveyArgs,
    emit_args: &EmitArgs,
    as_flown: bool,
    console: &Console,
    interval: Option<f64>,
    rows: FlightRows,
) -> Result<()> {
    if emit_args.format == EmitFormat::Arrow && !emit_args.force && std::io::stdout().is_terminal() {
        return Err(Error::input(
            "an Arrow stream would go to the terminal; redirect standard output, or use --force",
        ));
    }
    let ResolvedRun { mut settings, progress_lines, .. } = resolve(args, console)?;
    rows.prepare(&mut settings.survey, interval);
    let has_errors = settings.flight.navigation.any();
    let opened =
        during(console, "reading the survey", || Session::open_for_flight(settings, console.observer()))?;
    let emission = opened.into_emission()?;
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
            let work = || emit(emission, control, encode, out);
            watched(console, progress_lines, legs, &progress, work, is_complete)?;
        }
        EmitFormat::Arrow => {
            let mut out = TableWriter::begin(rows.columns(&flight), is_live, out).map_err(failed)?;
            out.flush().map_err(failed)?;
            let encode = |emitted: &Emitted, out: &mut Vec<u8>| rows.push(&flight, emitted, false, out);
            let work = || emit(emission, control, encode, out);
            let out = watched(console, progress_lines, legs, &progress, work, is_complete)?;
            out.finish().map_err(failed)?;
        }
    }
    if interrupt::STOP.is_requested() {
        return Err(Error::Interrupted);
    }
    let seconds = started.elapsed().as_secs_f64();
    let count = progress.snapshot().pulses;
    console.record(|result| *result = result_of(rows, legs, count, seconds));
    let pulses = amount_of(count as f64, "pulse");
    console.took(Verbosity::Verbose, format!("{pulses} flown in {}", duration(seconds)));
    Ok(())
}
