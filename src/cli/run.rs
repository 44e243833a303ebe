//! `vlscan run`: flies and measures a survey.

pub mod job;

use super::args::RunArgs;
use super::watch::watched;
use super::{Console, Verbosity, interrupt};
use crate::error::{Error, Result};
use crate::files::{FileWriter, Patched};
use crate::output::FileKind;
use crate::pipeline::{Control, Progress, Report, Session};
use crate::quantity::{amount, duration};
use crate::schedule::Recorder;
pub use job::Job;
use std::time::Instant;

pub fn run(args: &RunArgs, console: &Console) -> Result<()> {
    let started = Instant::now();
    let (job, warnings) = Job::resolve(&args.file, &args.options)?;
    console.warnings(&warnings);
    let Job { settings, mut output, schedule_log, progress_lines } = job;
    let force = output.force;
    output.inputs.push(args.file.clone());
    output.companions.extend(schedule_log.clone());
    let mut session = Session::open(settings, console.observer())?;
    let recorder = schedule_log.is_some().then(Recorder::new);
    let progress = Progress::default();
    let control = Control { recorder: recorder.as_ref(), ..Control::new(&progress, &interrupt::STOP) };
    let legs = session.survey().legs.len();
    let report = watched(console, progress_lines, legs, &progress, || session.run(output, control))?;
    if let (Some(path), Some(recorder), false) = (&schedule_log, recorder, report.interrupted) {
        let text = serde_json::to_string(&recorder.finish()).map_err(|e| Error::Internal(e.to_string()))?;
        let mut log = FileWriter::create(path, force, Patched::Never)?;
        log.append((text + "\n").as_bytes())?;
        log.finish()?;
    }
    show_report(console, &report, started)
}

/// Prints the summary of a run that began at `started`.
///
/// # Errors
/// [`Error::Interrupted`] when the run was interrupted.
pub fn show_report(console: &Console, report: &Report, started: Instant) -> Result<()> {
    let Report { summary, pulses, seconds, interrupted } = report;
    for file in &summary.files {
        let name = file.path.as_ref().map_or_else(|| "stdout".into(), |p| p.display().to_string());
        let unit = if file.kind == FileKind::Points { "points" } else { "records" };
        console.say(format!("{name}  {} {unit}, {} bytes", file.records, file.bytes));
        if file.left_out > 0 {
            console
                .say(format!("  warning: {} points do not fit the format and were left out", file.left_out));
        }
    }
    let pulses = *pulses as f64;
    console.took(
        Verbosity::Normal,
        format!(
            "{} pulses, {} points ({:.2} per pulse) in {} ({} pulses/s; {} with loading)",
            amount(pulses),
            amount(summary.points as f64),
            summary.points as f64 / pulses.max(1.0),
            duration(*seconds),
            amount(pulses / seconds.max(1e-9)),
            duration(started.elapsed().as_secs_f64())
        ),
    );
    if !interrupted {
        return Ok(());
    }
    if !summary.files.is_empty() {
        console
            .say("the run was interrupted: files named NAME.partial.EXT hold what was measured until then");
    }
    Err(Error::Interrupted)
}
