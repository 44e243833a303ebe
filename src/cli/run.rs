//! `vlscan run`: flies and measures a survey.

use super::args::RunArgs;
use super::companions::{Companions, open};
use super::rig::{OutputPlaces, ScannerTimes, SharedScene, different_times, file_of, resolve_outputs};
use super::shards::open_without_tree;
use super::shared_logs::{SharedPaths, is_part};
use super::watch::during;
use super::{Console, Verbosity, interrupt, messages};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{identity, reads, refuse_unwritable};
use vlscan_base::quantity::{amount, amount_of, counted, duration};
use vlscan_options::ResolvedRun;
use vlscan_options::outputs::check_companion;
use vlscan_session::output::{FileKind, OutputRequest, Target};
use vlscan_session::{Report, ResumeOptions, Session};
use vlscan_survey::Scanner;
use vlscan_tools::catalogue::unverified_figures;

pub fn run(args: &RunArgs, console: &Console) -> Result<()> {
    args.objects.as_deref().map_or(Ok(()), |path| check_companion("--objects", path, "CSV"))?;
    if args.dry.dry_run {
        return super::dry_run::run(args, console);
    }
    if let Some(shard) = args.shards.shard {
        return super::shards::run_shard(args, shard, console);
    }
    let started = Instant::now();
    let jobs = resolve_outputs(&args.file, &args.options, console)?;
    let mut scene = SharedScene::of(&jobs);
    let ready = jobs.into_iter().map(|job| Ready::open(args, job, &mut scene, console));
    let ready = ready.collect::<Result<Vec<_>>>()?;
    drop(scene);
    match ready.len() {
        1 => ready.into_iter().try_for_each(|run| run.run(started, console).map(drop)),
        _ => run_each(&args.file, ready, started, console),
    }
}

/// Runs one scanner after the other, after the outputs of all have been checked.
fn run_each(file: &Path, mut ready: Vec<Ready>, started: Instant, console: &Console) -> Result<()> {
    let shared = SharedPaths::of(ready.iter().map(|run| &run.output));
    let mut places = OutputPlaces::default();
    for run in &mut ready {
        let Ready { scanner, output, resumption, .. } = &mut *run;
        shared.prepare(scanner.as_deref().unwrap_or_default(), resumption.is_some(), output)?;
        // A repeated run recognises the scanners that are complete.
        resumption.iter_mut().for_each(|how| how.keeps_mark = true);
        let own = run.check().map_err(|error| error.named(&format!("scanner `{}`", run.scanner())))?;
        places.add(run.scanner(), shared.without_shared(own))?;
    }
    let times =
        ready.iter().map(|run| ScannerTimes::of(run.scanner(), &run.session)).collect::<Result<Vec<_>>>()?;
    console.warnings(&different_times(file, &times))?;
    let resumptions: Vec<ResumeOptions> = ready.iter().filter_map(|run| run.resumption.clone()).collect();
    let replace = ready.iter().any(|run| run.output.force);
    let mut logs = shared.begin()?;
    for log in &mut logs {
        for Ready { scanner, output, .. } in &mut ready {
            log.redirect(scanner.as_deref().unwrap_or_default(), output);
        }
    }
    if let Err(error) = measure_each(ready, started, console) {
        for log in &logs {
            if let Err(second) = log.write_partial(replace, console) {
                let text = second.to_string();
                console.caution(format!("warning: {text}"), messages::warning(None, text));
            }
        }
        return Err(error);
    }
    for how in resumptions {
        how.remove_folder()?.into_iter().for_each(console.observer());
    }
    logs.iter().try_for_each(|log| log.write(replace, console))
}

/// Measures with one scanner after the other.
fn measure_each(ready: Vec<Ready>, mut started_one: Instant, console: &Console) -> Result<()> {
    let started = started_one;
    let (mut pulses, mut points, mut seconds) = (0, 0, 0.0);
    for run in ready {
        console.say(format!("scanner {}", run.scanner()));
        let report = run.run(started_one, console)?;
        pulses += report.pulses;
        points += report.summary.points;
        seconds += report.seconds;
        console.record(|result| {
            (result.pulses, result.points) = (Some(pulses), Some(points));
            result.seconds = Some(seconds);
            result.total_seconds = Some(started.elapsed().as_secs_f64());
        });
        started_one = Instant::now();
    }
    Ok(())
}

/// A run that is ready to start.
struct Ready {
    scanner: Option<String>,
    session: Session,
    output: OutputRequest,
    companions: Companions,
    /// File of the poses of moving parts.
    objects: Option<PathBuf>,
    resumption: Option<ResumeOptions>,
    progress_lines: bool,
}

impl Ready {
    /// Opens the session of a run.
    fn open(args: &RunArgs, job: ResolvedRun, scene: &mut SharedScene, console: &Console) -> Result<Ready> {
        let ResolvedRun { scanner, settings, mut output, schedule_log, part_table, progress_lines, .. } = job;
        output.inputs.push(args.file.clone());
        let mut companions = Companions::of(schedule_log, part_table, &mut output);
        let name = scanner.as_deref().filter(|_| scene.has_several());
        let objects = args.objects.as_deref();
        let objects = objects.map(|path| name.map_or_else(|| path.to_path_buf(), |name| file_of(path, name)));
        let resumption =
            args.shards.resume.map(|pulses| ResumeOptions::next_to(&output, pulses.0)).transpose()?;
        // A repeated run recognises the scanners that are complete by their points.
        let is_apart = scene.has_several() && resumption.is_some();
        output.companions.extend(objects.clone().filter(|_| !is_apart));
        let load = if resumption.is_some() { open_without_tree } else { open };
        let session = scene.open(settings, console, load)?;
        companions.describe(session.scene())?;
        if objects.is_some() {
            session.check_objects()?;
        }
        Ok(Ready { scanner, session, output, companions, objects, resumption, progress_lines })
    }

    /// Name of the scanner; empty if the pipeline names none.
    fn scanner(&self) -> &str {
        self.scanner.as_deref().unwrap_or_default()
    }

    /// Checks a run that begins later, and returns the files and folders that its outputs fill.
    fn check(&mut self) -> Result<BTreeSet<PathBuf>> {
        self.session.check(&interrupt::STOP)?;
        let mut places = match &self.resumption {
            Some(how) => self.session.check_resumable(&self.output, how)?,
            None => self.session.output_places(&self.output)?,
        };
        if let Some(path) = &self.objects {
            let is_begun = self.resumption.as_ref().is_some_and(|how| how.folder.is_dir());
            refuse_unwritable(path, self.output.force || is_begun)?;
            reads::refuse_input_of(path, self.session.inputs().chain(self.output.inputs.iter().cloned()))?;
            if !places.insert(identity(path)) {
                return Err(Error::input(format!("two outputs would be written to {}", path.display())));
            }
        }
        Ok(places)
    }

    /// Measures the survey and shows the summary, with the time since `started`.
    fn run(self, started: Instant, console: &Console) -> Result<Report> {
        let Ready { mut session, output, companions, objects, resumption, progress_lines, .. } = self;
        let force = output.force;
        let is_helios_layout = output.sinks.iter().all(|(target, _)| matches!(target, Target::Helios(_)));
        let legs = session.survey().legs.len();
        let mut report = companions.run(console, progress_lines, legs, |control| match &resumption {
            Some(how) => session.run_resumable(output, how, control),
            None => session.run(output, control),
        })?;
        report.summary.files.retain(|file| !is_part(file));
        if is_helios_layout && console.shows(Verbosity::Times) {
            name_directories(&report);
        }
        if resumption.is_some() {
            warn_of_few_points(console, &report)?;
        }
        if let Some(path) = objects.filter(|_| !report.interrupted) {
            // An earlier start of the run may have written the file of a scanner that was complete.
            let replace = force || resumption.as_ref().is_some_and(|how| how.keeps_mark);
            let write = || session.write_objects(&path, replace, &interrupt::STOP);
            let rows = during(console, "writing the poses of objects", write)?;
            let text = format!("{}  {}", path.display(), counted(rows, "pose"));
            console.wrote(messages::written(&path, "objects"), text);
        }
        note_unverified_figures(console, &session.survey().scanner);
        show_report(console, &report, started)?;
        Ok(report)
    }
}

/// Names the figures of an instrument of the catalogue that have not been compared with a data sheet, and
/// says if those of HELIOS++ are kept.
fn note_unverified_figures(console: &Console, scanner: &Scanner) {
    let figures = unverified_figures(scanner);
    if !figures.is_empty() {
        console.say(format!(
            "{}: {} not verified by a data sheet (sources: vlscan catalogue show {})",
            scanner.name,
            figures.join(", "),
            scanner.id
        ));
    }
    if scanner.devices.iter().any(|device| device.stated.are_left()) {
        console.say(format!(
            "{}: the survey keeps figures of HELIOS++'s catalogue that differ from those of pipelines",
            scanner.name
        ));
    }
}

/// Names the run directories on standard output, where programs around HELIOS++ look for this line.
fn name_directories(report: &Report) {
    let mut stdout = std::io::stdout().lock();
    for directory in &report.summary.directories {
        // Stdout may be closed.
        let _ = writeln!(stdout, "Output directory: \"{}\"", directory.display());
    }
}

/// Points per pulse below which merged shards are reported.
const MIN_YIELD: f64 = 0.01;

/// Warns of merged shards that hit almost nothing; shards by themselves are not checked, since each sees a
/// piece of the flight only.
pub fn warn_of_few_points(console: &Console, report: &Report) -> Result<()> {
    let (pulses, points) = (report.pulses as f64, report.summary.points as f64);
    if !report.interrupted && pulses > 0.0 && points < MIN_YIELD * pulses && !report.summary.files.is_empty()
    {
        let mut found = Diagnostics::default();
        found
            .warn(None, format!("{} gave only {}", amount_of(pulses, "pulse"), amount_of(points, "point")))
            .help("run without --shard to see the likely cause");
        console.warnings(&found)?;
    }
    Ok(())
}

/// Prints the summary of a run that began at `started`.
///
/// # Errors
/// [`Error::Interrupted`] when the run was interrupted.
pub fn show_report(console: &Console, report: &Report, started: Instant) -> Result<()> {
    let Report { summary, pulses, seconds, interrupted, .. } = report;
    for file in &summary.files {
        let name = file.path.as_ref().map_or_else(|| "stdout".into(), |p| p.display().to_string());
        let has_points = matches!(file.kind, FileKind::Points | FileKind::Shard);
        let records = counted(file.records, if has_points { "point" } else { "record" });
        console.wrote(messages::written_by_run(file), format!("{name}  {records}, {} bytes", file.bytes));
        if file.left_out > 0 {
            let points = counted(file.left_out, "point");
            let text = format!("{points} left out, which the format cannot hold");
            console.caution(format!("  warning: {text}"), messages::warning(Some(name), text));
        }
    }
    if summary.left_out > 0 {
        let points = counted(summary.left_out, "point");
        let text = format!("{points} left out, far outside all tiles or of no part");
        console.caution(format!("  warning: {text}"), messages::warning(None, text));
    }
    console.record(|result| {
        (result.pulses, result.points) = (Some(*pulses), Some(summary.points));
        result.seconds = Some(*seconds);
        result.total_seconds = Some(started.elapsed().as_secs_f64());
    });
    let pulses = *pulses as f64;
    console.took(
        Verbosity::Normal,
        format!(
            "{}, {} ({:.2} per pulse) in {} ({} pulses/s; {} with loading)",
            amount_of(pulses, "pulse"),
            amount_of(summary.points as f64, "point"),
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
        console.say("the run was interrupted: files named NAME.partial.EXT contain what was measured so far");
    }
    Err(Error::Interrupted)
}
