//! `vlscan run --dry-run`: what a run will cost and give.

use super::args::RunArgs;
use super::companions::open;
use super::coverage;
use super::rig::{OutputPlaces, ScannerTimes, SharedScene, different_times, file_of, resolve_outputs};
use super::shared_logs::SharedPaths;
use super::watch::during;
use super::{Console, interrupt};
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Instant;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::write_stdout;
use vlscan_base::quantity::{amount, bytes, duration, metres};
use vlscan_options::ResolvedRun;
use vlscan_session::output::OutputRequest;
use vlscan_session::{CoverageMap, DryRunReport, LegEstimate, Progress, RunContext, Session};

/// Legs that are listed as text; `--json` lists all.
const MAX_LISTED_LEGS: usize = 20;

/// The forecasts of several scanners.
#[derive(Serialize)]
struct Forecasts {
    scanners: Vec<Forecast>,
}

/// The forecast of one of several scanners.
#[derive(Serialize)]
struct Forecast {
    name: String,
    forecast: DryRunReport,
}

pub fn run(args: &RunArgs, console: &Console) -> Result<()> {
    let started = Instant::now();
    let mut jobs = resolve_outputs(&args.file, &args.options, console)?;
    if jobs.len() > 1 {
        return run_each(args, jobs, started, console);
    }
    let Some(job) = jobs.pop() else { return Ok(()) };
    let (mut scene, replace) = (SharedScene::of(&jobs), job.output.force);
    let (forecast, map) = Trial::open(args, job, &mut scene, console)?.forecast(args, started, console)?;
    if let Some(map) = map {
        coverage::write(&args.dry, &[(None, &map)], replace, console)?;
    }
    let text = match args.dry.json {
        true => json_of(&forecast)?,
        false => text(&forecast),
    };
    write_stdout(&text)
}

/// Forecasts the run of one scanner after the other, after all have been checked.
fn run_each(args: &RunArgs, jobs: Vec<ResolvedRun>, started: Instant, console: &Console) -> Result<()> {
    for job in &jobs {
        coverage::check_names(&args.dry, job.scanner.as_deref(), job.output.force)?;
    }
    let shared = SharedPaths::of(jobs.iter().map(|job| &job.output));
    let mut scene = SharedScene::of(&jobs);
    let replace = jobs.iter().any(|job| job.output.force);
    let (mut places, mut times, mut trials) = (OutputPlaces::default(), Vec::new(), Vec::new());
    for mut job in jobs {
        let name = job.scanner.clone().unwrap_or_default();
        shared.prepare(&name, false, &mut job.output)?;
        let trial = Trial::open(args, job, &mut scene, console)?;
        let own = trial.output_places().map_err(|error| error.named(&format!("scanner `{name}`")))?;
        places.add(&name, shared.without_shared(own))?;
        times.push(ScannerTimes::of(&name, &trial.session)?);
        trials.push((name, trial));
    }
    drop(scene);
    console.warnings(&different_times(&args.file, &times))?;
    let (mut scanners, mut maps, mut started_one) = (Vec::new(), Vec::new(), started);
    for (name, trial) in trials {
        let (forecast, map) = trial.forecast(args, started_one, console)?;
        scanners.push(Forecast { name, forecast });
        maps.extend(map);
        // Scenes are loaded before the first forecast.
        started_one = Instant::now();
    }
    if !maps.is_empty() {
        let names: Vec<String> = scanners.iter().map(|of| of.name.clone()).collect();
        coverage::write_each(&args.dry, &names, &maps, replace, console)?;
    }
    let text = match args.dry.json {
        true => json_of(&Forecasts { scanners })?,
        false => {
            let texts = scanners.iter().map(|of| format!("scanner     {}\n{}", of.name, text(&of.forecast)));
            texts.collect::<Vec<_>>().join("\n")
        }
    };
    write_stdout(&text)
}

fn json_of<T: Serialize>(forecast: &T) -> Result<String> {
    let text = serde_json::to_string_pretty(forecast).map_err(|e| Error::Internal(e.to_string()))?;
    Ok(text + "\n")
}

/// A run that is ready to be forecast.
struct Trial {
    session: Session,
    output: OutputRequest,
}

impl Trial {
    /// Loads the scene unless an earlier scanner has, and checks the flight and the files of the options.
    fn open(args: &RunArgs, job: ResolvedRun, scene: &mut SharedScene, console: &Console) -> Result<Trial> {
        let ResolvedRun { scanner, settings, mut output, schedule_log, part_table, .. } = job;
        let name = scanner.as_deref().filter(|_| scene.has_several());
        let objects = args.objects.as_deref();
        let objects = objects.map(|path| name.map_or_else(|| path.to_path_buf(), |name| file_of(path, name)));
        output.inputs.push(args.file.clone());
        output.companions.extend(schedule_log.into_iter().chain(part_table).chain(objects));
        let session = scene.open(settings, console, open)?;
        if args.objects.is_some() {
            session.check_objects()?;
        }
        coverage::check(&args.dry, name, &session, &args.file, output.force)?;
        Ok(Trial { session, output })
    }

    /// Files and folders that the run would fill. Those that exist are no errors: the forecast notes them.
    fn output_places(&self) -> Result<BTreeSet<PathBuf>> {
        let mut checked = self.output.clone();
        checked.force = true;
        self.session.output_places(&checked)
    }

    /// Forecasts the run, and measures its coverage if that is requested.
    fn forecast(
        self,
        args: &RunArgs,
        started: Instant,
        console: &Console,
    ) -> Result<(DryRunReport, Option<CoverageMap>)> {
        let Trial { mut session, output } = self;
        let progress = Progress::default();
        let context = RunContext::new(&progress, &interrupt::STOP);
        during(console, "trying the survey", || match coverage::side(&args.dry) {
            None => session.dry_run(&output, started, context).map(|forecast| (forecast, None)),
            Some(side) => {
                let measured = session.dry_run_with_coverage(&output, side, started, context);
                measured.map(|(forecast, map)| (forecast, Some(map)))
            }
        })
    }
}

fn text(f: &DryRunReport) -> String {
    let mut out = String::new();
    let mut line = |name: &str, value: String| {
        let _ = writeln!(out, "{name:<12}{value}");
    };
    let flown = if f.epochs > 1 { format!(", flown {} times", f.epochs) } else { String::new() };
    let firing = f.legs.iter().filter(|leg| leg.pulses > 0.0).count();
    line("legs", format!("{} of which {firing} fire{flown}, {}", f.legs.len(), duration(f.duration_s)));
    let about = if f.pulses_are_counted { "" } else { "about " };
    line("pulses", format!("{about}{}", amount(f.pulses)));
    let per_pulse = f.points.value / f.pulses.max(1.0);
    let points = format!("{}{}", amount(f.points.value), percent_off(f.points.uncertainty));
    line("points", format!("{points}, {per_pulse:.2} per pulse"));
    if let (Some(points), Some(pulses)) = (f.points_per_m2, f.pulses_per_m2) {
        let area = area(f.covered_m2);
        line(
            "density",
            format!("{points:.1} points and {pulses:.1} pulses per m² of {area} that are covered"),
        );
    }
    line("memory", bytes(f.memory_bytes));
    let time = &f.time;
    line(
        "time",
        format!(
            "{}{} on {} threads of this machine, {} of it for loading",
            duration(time.total_s),
            percent_off(time.uncertainty),
            time.threads,
            duration(time.loading_s)
        ),
    );
    for file in &f.files {
        line("writes", format!("{}  {} of {}", file.name, bytes(file.bytes as u64), file.content));
    }
    missed(f, &mut line);
    legs(&f.legs, &mut out);
    out
}

fn missed(f: &DryRunReport, line: &mut impl FnMut(&str, String)) {
    let missed = &f.missed;
    let mut reasons = Vec::new();
    if missed.beside_scene > 0.005 {
        reasons.push(format!("{} pass beside the scene", percent(missed.beside_scene)));
    }
    if missed.out_of_range > 0.005 {
        reasons.push(format!("of {} the scene is out of the scanner's range", percent(missed.out_of_range)));
    }
    let reasons = if reasons.is_empty() { String::new() } else { format!(": {}", reasons.join(", ")) };
    line("misses", format!("{} of the pulses have no echo{reasons}", percent(missed.pulses)));
    if missed.area > 0.005 {
        line("", format!("{} of the scene's box is outside of all swaths", percent(missed.area)));
    }
    if !missed.legs.is_empty() {
        let all: Vec<String> = missed.legs.iter().take(MAX_LISTED_LEGS).map(u32::to_string).collect();
        line("", format!("legs without points: {}", all.join(", ")));
    }
}

fn legs(legs: &[LegEstimate], out: &mut String) {
    let _ = writeln!(
        out,
        "\n{:>5} {:>9} {:>9} {:>9} {:>8} {:>10} {:>8} {:>8}",
        "leg", "time", "pulses", "points", "range", "footprint", "along", "across"
    );
    let count = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), amount);
    let far = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), metres);
    let near = |value: Option<f64>| match value {
        Some(length) if length < 1.0 => format!("{:.1} cm", length * 100.0),
        Some(length) => format!("{length:.2} m"),
        None => "-".to_owned(),
    };
    for leg in legs.iter().take(MAX_LISTED_LEGS) {
        let _ = writeln!(
            out,
            "{:>5} {:>9} {:>9} {:>9} {:>8} {:>10} {:>8} {:>8}",
            leg.leg,
            duration(leg.seconds),
            amount(leg.pulses),
            count(leg.points),
            far(leg.range_m),
            near(leg.footprint_m),
            near(leg.along_m),
            near(leg.across_m)
        );
    }
    if legs.len() > MAX_LISTED_LEGS {
        let _ = writeln!(out, "      and {} more; --json lists all", legs.len() - MAX_LISTED_LEGS);
    }
}

fn percent(fraction: f64) -> String {
    format!("{:.0} %", fraction * 100.0)
}

/// An uncertainty, unless it is negligible.
fn percent_off(fraction: f64) -> String {
    if fraction < 0.0005 { String::new() } else { format!(" ± {:.1} %", fraction * 100.0) }
}

fn area(m2: f64) -> String {
    match m2 {
        m2 if m2 >= 1e6 => format!("{:.2} km²", m2 / 1e6),
        m2 if m2 >= 1e4 => format!("{:.2} ha", m2 / 1e4),
        m2 => format!("{m2:.0} m²"),
    }
}
