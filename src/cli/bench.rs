//! `vlscan bench`: how fast a survey runs on this machine, with which threads, schedule, chunks and tree, and
//! where the time goes.

use super::args::BenchArgs;
use super::companions::open;
use super::{Console, interrupt, messages};
use serde::Serialize;
use serde_json::json;
use std::time::Instant;
use vlscan_base::aligned::{Side, aligned};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{reads, refuse_unwritable, write_file, write_stderr, write_stdout};
use vlscan_base::quantity::amount;
use vlscan_choice::Choice as _;
use vlscan_options::outputs::check_content;
use vlscan_options::{ChunkSize, Options, ResolvedRun, Switch, policy};
use vlscan_session::output::{OutputRequest, PointFormat, Target};
use vlscan_session::{LoadedScene, Progress, RunContext, Session, Settings};
use vlscan_survey::PlatformKind;
use vlscan_trace::BuildOptions;
use vlscan_warehouse::{Log, MAX_THREADS, Policy, Recorder, Schedule};

/// Measurements under one schedule.
#[derive(Serialize)]
struct Cell {
    tree: &'static str,
    schedule: &'static str,
    /// Pulses per chunk, of the first one when the size is dynamic.
    chunk_size: u32,
    /// Chunks per worker that may be queued.
    warehouse_factor: Option<usize>,
    threads: usize,
    /// Least time from the first pulse to the last point written, s, and that of every repetition.
    simulation_s: f64,
    simulations_s: Vec<f64>,
    /// Of the least time, that of completing the file after its last point, with waiting for the disk, s.
    completing_s: f64,
    pulses: u64,
    points: u64,
    pulses_per_s: f64,
    points_per_s: f64,
    /// Time of the same tree on the fewest threads, divided by this one.
    speedup: f64,
    shares: Shares,
}

/// Shares of all threads' time.
#[derive(Serialize)]
struct Shares {
    /// Computing pulses.
    computing: f64,
    /// Making chunks and handing them over.
    making: f64,
    /// Compressing and writing.
    writing: f64,
    /// Waiting for work, or for the writer.
    waiting: f64,
}

pub fn run(args: &BenchArgs, console: &Console) -> Result<()> {
    if let Some(path) = &args.json {
        check_content("--json", path, "JSON")?;
        refuse_unwritable(path, args.force)?;
        reads::refuse_input_of(path, [&args.survey])?;
    }
    let mut options = Options::parse(args.run.iter().cloned())
        .map_err(|e| Error::input(format!("options of vlscan run after --: {e}")))?;
    options.input.assets.extend(args.assets.iter().cloned());
    if console.is_strict() {
        options.input.strict = Switch::On;
    }
    let (job, warnings) = ResolvedRun::resolve(&args.survey, &options)?;
    console.warnings(&warnings)?;
    if matches!(job.settings.survey.platform.kind, PlatformKind::Stream(_)) {
        return Err(Error::input(
            "vlscan bench flies the survey many times, but a stream of poses can be read only once",
        ));
    }
    let schedules = schedules(args, &job.settings)?;
    let folder = tempfile::tempdir().map_err(|e| Error::io("create", std::env::temp_dir(), e))?;
    let target = Target::File(folder.path().join(format!("points.{}", args.format)));
    let mut request = job.output;
    // Of no format is `none`.
    request.sinks = PointFormat::named(&args.format).map(|points| (target, points)).into_iter().collect();
    (request.waveforms, request.pulses, request.trajectory, request.force) = (false, false, None, true);
    let (mut cells, mut scene) = (Vec::new(), String::new());
    for &builder in &args.tree {
        let BuildOptions { jobs, geometry_jobs, .. } = job.settings.tree;
        let tree = BuildOptions { jobs, geometry_jobs, ..BuildOptions::of(builder) };
        let mut settings = job.settings.clone();
        settings.tree = tree;
        let started = Instant::now();
        let session = open(settings.clone(), console)?;
        let loaded = session.loaded().ok_or_else(|| Error::Internal("the scene is not loaded".to_owned()))?;
        scene = format!(
            "{}: {} primitives, {} legs; loaded with its tree in {:.2} s; points as {}\n\n",
            session.survey().name,
            amount(session.scene().primitives() as f64),
            session.survey().legs.len(),
            started.elapsed().as_secs_f64(),
            args.format
        );
        drop(session);
        cells.extend(compare(args, &settings, &loaded, &schedules, &request, console)?);
    }
    if let Some(path) = &args.json {
        write_file(path, args.force, json_of(&args.format, &cells)?.as_bytes())?;
        console.record(|result| result.files.push(messages::written(path, "times")));
        if path.as_os_str() == "-" {
            let text = scene + &table(&cells);
            match console.is_json() {
                true => console.say(text.trim_end()),
                false => write_stderr(&text),
            }
            return Ok(());
        }
    }
    write_stdout(&(scene + &table(&cells)))
}

/// The cells as JSON, with program and machine.
fn json_of(format: &str, cells: &[Cell]) -> Result<String> {
    let machine = json!({
        "threads": all_threads(), "arch": std::env::consts::ARCH, "os": std::env::consts::OS,
    });
    let program = concat!("vlscan ", env!("CARGO_PKG_VERSION"));
    let all = json!({ "program": program, "machine": machine, "format": format, "cells": cells });
    Ok(serde_json::to_string_pretty(&all).map_err(|e| Error::Internal(e.to_string()))? + "\n")
}

/// The schedules to compare, each once.
fn schedules(args: &BenchArgs, settings: &Settings) -> Result<Vec<Schedule>> {
    let all = all_threads();
    let threads = match &args.threads[..] {
        [] => (0..).map(|i| 1 << i).take_while(|&n| n < all).chain([all]).collect(),
        given => given.to_vec(),
    };
    if let Some(n) = threads.iter().find(|n| !(1..=MAX_THREADS).contains(*n)) {
        return Err(Error::input(format!("--threads: expected 1 to {MAX_THREADS} threads, found {n}")));
    }
    let default_size = [ChunkSize(settings.schedule.policy.size())];
    let sizes = if args.chunk_size.is_empty() { &default_size[..] } else { &args.chunk_size };
    let mut found: Vec<Schedule> = Vec::new();
    for &threads in &threads {
        for &kind in &args.schedule {
            for &ChunkSize(size) in sizes {
                // On one thread they are all the same.
                let policy = match threads {
                    1 => Policy::Static { size },
                    _ => policy(kind, size, args.warehouse_factor.0, None),
                };
                let schedule = Schedule { threads, policy, ..settings.schedule };
                if !found.contains(&schedule) {
                    found.push(schedule);
                }
            }
        }
    }
    Ok(found)
}

/// Flies every schedule as often as asked for; they take turns, so that other load affects all of them alike.
fn compare(
    args: &BenchArgs,
    settings: &Settings,
    loaded: &LoadedScene,
    schedules: &[Schedule],
    request: &OutputRequest,
    console: &Console,
) -> Result<Vec<Cell>> {
    let mut cells: Vec<Option<Cell>> = schedules.iter().map(|_| None).collect();
    for turn in 0..=args.repetitions {
        console.detail(match turn {
            0 => "warm-up".to_owned(),
            n => format!("repetition {n}"),
        });
        for (schedule, best) in schedules.iter().zip(&mut cells) {
            let mut settings = settings.clone();
            settings.schedule = *schedule;
            let tree = settings.tree.builder.name();
            let mut session = Session::new(settings, loaded.clone(), |_| ())?;
            let (progress, recorder) = (Progress::default(), Recorder::new());
            let context =
                RunContext { recorder: Some(&recorder), ..RunContext::new(&progress, &interrupt::STOP) };
            let report = session.run(request.clone(), context)?;
            // A flight that was stopped has no valid time.
            if report.interrupted {
                return Err(Error::Interrupted);
            }
            if turn > 0 {
                let points = progress.snapshot().echoes;
                let cell =
                    cell((tree, *schedule), (report.pulses, points), report.seconds, &recorder.finish());
                let times = best.as_mut().map(|best| std::mem::take(&mut best.simulations_s));
                let mut kept = match best.take() {
                    Some(best) if best.simulation_s <= cell.simulation_s => best,
                    _ => cell,
                };
                kept.simulations_s = times.into_iter().flatten().chain([report.seconds]).collect();
                *best = Some(kept);
            }
        }
    }
    let mut cells: Vec<Cell> = cells.into_iter().flatten().collect();
    let least = cells.iter().min_by_key(|cell| cell.threads).map_or(f64::NAN, |cell| cell.simulation_s);
    cells.iter_mut().for_each(|cell| cell.speedup = least / cell.simulation_s);
    Ok(cells)
}

fn cell(
    (tree, Schedule { threads, policy, .. }): (&'static str, Schedule),
    (pulses, points): (u64, u64),
    seconds: f64,
    log: &Log,
) -> Cell {
    let all = log.workers.iter().fold(log.producer, |sum, worker| sum.plus(*worker));
    let share = |part: f64| part / all.wall_s.max(f64::MIN_POSITIVE);
    let making =
        (log.producer.wall_s - log.producer.busy_s - log.producer.idle_s - log.producer.jobs_s).max(0.0);
    Cell {
        tree,
        schedule: if threads == 1 { "sequential" } else { policy.name() },
        chunk_size: policy.size(),
        warehouse_factor: match policy {
            Policy::Warehouse { factor, .. } => Some(factor),
            _ => None,
        },
        threads,
        simulation_s: seconds,
        simulations_s: Vec::new(),
        completing_s: log.completing_s,
        pulses,
        points,
        pulses_per_s: pulses as f64 / seconds.max(1e-9),
        points_per_s: points as f64 / seconds.max(1e-9),
        speedup: f64::NAN,
        shares: Shares {
            computing: share(all.busy_s),
            making: share(making),
            writing: share(all.jobs_s),
            waiting: share(all.idle_s),
        },
    }
}

/// The cells in lines, and the fastest one as options of a run.
fn table(cells: &[Cell]) -> String {
    let head = [
        "tree",
        "schedule",
        "chunk",
        "threads",
        "simulation s",
        "completing s",
        "speedup",
        "pulses/s",
        "points/s",
        "computing",
        "making",
        "writing",
        "waiting",
    ];
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let mut lines = vec![head.map(str::to_owned).to_vec()];
    lines.extend(cells.iter().map(|c| {
        vec![
            c.tree.to_owned(),
            c.schedule.to_owned(),
            c.chunk_size.to_string(),
            c.threads.to_string(),
            format!("{:.3}", c.simulation_s),
            format!("{:.3}", c.completing_s),
            format!("{:.2}", c.speedup),
            amount(c.pulses_per_s),
            amount(c.points_per_s),
            percent(c.shares.computing),
            percent(c.shares.making),
            percent(c.shares.writing),
            percent(c.shares.waiting),
        ]
    }));
    let mut text = aligned(&lines, Side::Right);
    if let Some(best) = cells.iter().min_by(|a, b| a.simulation_s.total_cmp(&b.simulation_s)) {
        let schedule = match best.threads {
            1 => String::new(),
            _ => format!(" --schedule {}", best.schedule),
        };
        let Cell { tree, threads, chunk_size, .. } = best;
        text +=
            &format!("\nfastest: --threads {threads}{schedule} --chunk-size {chunk_size} --tree {tree}\n");
    }
    text
}

fn all_threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
