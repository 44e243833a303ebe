//! `vlscan bench`: the paper's experiment on this machine. One survey is flown with every tree, by every schedule, with
//! chunks of different sizes and different numbers of threads, and what that took is told as table, JSON and picture.

mod forecast;
mod measure;
mod paper;
mod picture;
mod report;
mod table;

use super::args::{BenchArgs, ScheduleKind, TreeKind};
use super::run::speed;
use super::{Cli, Command, Console, RunArgs, interrupt};
use crate::error::{Error, Result};
use crate::schedule::{Policy, Schedule};
use crate::tree::{BuildOptions, Builder};
use clap::Parser;
use report::Report;
use std::ffi::OsString;
use std::io::Write as _;
use std::path::Path;

/// What is compared.
struct Matrix {
    trees: Vec<(TreeKind, BuildOptions)>,
    /// What every tree is flown with; on one thread all schedules are the same, and `sequential` stands for them.
    flights: Vec<Flight>,
    repetitions: usize,
    warm_up: usize,
}

/// A schedule with its parameters.
#[derive(Clone, Copy, PartialEq)]
struct Flight {
    settings: Schedule,
    /// What its sequential counterpart is computed in, which for single pulses is another number than its chunks'.
    chunk: u32,
}

impl Flight {
    /// Name of the schedule, chunk size and warehouse factor.
    fn label(&self) -> (&'static str, u32, Option<usize>) {
        match self.settings.policy {
            _ if self.settings.threads == 1 => ("sequential", self.chunk, None),
            Policy::Warehouse { size, factor } => ("warehouse", size, Some(factor)),
            policy => (policy.name(), policy.size(), None),
        }
    }
}

/// Runs `vlscan bench`.
pub fn run(args: &BenchArgs, console: &Console) -> Result<()> {
    interrupt::listen();
    let matrix = matrix(args)?;
    for path in [&args.json, &args.svg].into_iter().flatten() {
        if path.exists() && !args.force {
            return Err(Error::input(format!("{} exists; --force replaces it", path.display())));
        }
    }
    let run = run_args(args)?;
    let bench = measure::Bench::prepare(&run, &args.format, console)?;
    let mut report = Report::begin(&bench);
    let simulated = threads(&args.simulate_threads)?;
    for (kind, options) in &matrix.trees {
        let built = bench.build(options, &matrix)?;
        let cells = bench.cells(*kind, options, &built, &matrix, console)?;
        if !simulated.is_empty() {
            console.detail(format!("task times: {}", name(*kind)));
            let load = bench.workload(options, &built.tree, &matrix)?;
            report.forecasts.extend(forecast::of(name(*kind), &load, &matrix, &simulated, &cells));
        }
        report.cells.extend(cells);
    }
    report.compare();
    finish(args, &report)
}

fn finish(args: &BenchArgs, report: &Report) -> Result<()> {
    let mut text = table::of(report);
    if args.paper {
        text.push('\n');
        text.push_str(&paper::tables());
    }
    let to_stdout = args.json.as_deref().is_some_and(|path| path.as_os_str() == "-");
    if let Some(path) = &args.json {
        let json = serde_json::to_string_pretty(&report.json(args.paper))
            .map_err(|e| Error::Internal(e.to_string()))?;
        write(path, &(json + "\n"))?;
    }
    if let Some(path) = &args.svg {
        write(path, &picture::of(report))?;
    }
    if to_stdout {
        eprint!("{text}");
        return Ok(());
    }
    write(Path::new("-"), &text)
}

fn write(path: &Path, text: &str) -> Result<()> {
    if path.as_os_str() != "-" {
        return std::fs::write(path, text).map_err(|e| Error::io("write", path, e));
    }
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).map_err(|e| match e.kind() {
        std::io::ErrorKind::BrokenPipe => Error::ClosedPipe,
        _ => Error::io("write to", Path::new("stdout"), e),
    })
}

/// The survey with the options of `vlscan run` that follow `--`.
fn run_args(args: &BenchArgs) -> Result<Box<RunArgs>> {
    let words = ["vlscan", "run", "-q"].into_iter().map(OsString::from);
    let assets = args.assets.iter().flat_map(|dir| [OsString::from("--assets"), dir.clone().into()]);
    let words = words.chain([args.survey.clone().into()]).chain(assets).chain(args.run.iter().cloned());
    match Cli::try_parse_from(words) {
        Ok(Cli { command: Command::Run(run), .. }) => Ok(run),
        Ok(_) => Err(Error::input("after --: expected options of vlscan run")),
        Err(e) => Err(Error::input(format!("after --: {e}"))),
    }
}

fn matrix(args: &BenchArgs) -> Result<Matrix> {
    let trees = args
        .tree
        .iter()
        .map(|&kind| {
            let builder = speed::builder(kind);
            let strict = args.tree_strict && builder != Builder::Bvh;
            (kind, if strict { BuildOptions::strict(builder) } else { BuildOptions::of(builder) })
        })
        .collect();
    let sizes =
        args.chunk_size.iter().map(|&n| speed::chunk_size(Some(i64::from(n)))).collect::<Result<Vec<_>>>()?;
    let mut wanted = threads(&args.threads)?;
    if wanted.is_empty() {
        wanted = (0..).map(|i| 1 << i).take_while(|&n| n < cores()).chain([cores()]).collect();
    }
    // Speedups need it.
    if !wanted.contains(&1) {
        wanted.insert(0, 1);
    }
    let mut flights: Vec<Flight> = Vec::new();
    for &threads in &wanted {
        for &leg_barrier in args.leg_barrier.values() {
            for &kind in &args.schedule {
                for &chunk in &sizes {
                    for &factor in &args.warehouse_factor {
                        let policy = match threads {
                            1 => Policy::Static { size: chunk },
                            _ => speed::policy(kind, chunk, factor, args.idle_threshold)?,
                        };
                        let chunk = if kind == ScheduleKind::Single && threads > 1 { 1 } else { chunk };
                        let leg_barrier = leg_barrier && threads > 1;
                        let flight = Flight { settings: Schedule { threads, policy, leg_barrier }, chunk };
                        if !flights.contains(&flight) {
                            flights.push(flight);
                        }
                    }
                }
            }
        }
    }
    Ok(Matrix { trees, flights, repetitions: args.repetitions.max(1), warm_up: args.warm_up })
}

fn threads(wanted: &[usize]) -> Result<Vec<usize>> {
    let mut all: Vec<usize> = Vec::new();
    for &n in wanted {
        if !(1..=65_536).contains(&n) {
            return Err(Error::input(format!("expected 1 to 65536 threads, found {n}")));
        }
        if !all.contains(&n) {
            all.push(n);
        }
    }
    Ok(all)
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The name of a tree on the command line.
fn name(kind: TreeKind) -> &'static str {
    match kind {
        TreeKind::Bvh => "bvh",
        TreeKind::Fsah => "fsah",
        TreeKind::AxisSah => "axis-sah",
        TreeKind::Sah => "sah",
        TreeKind::Median => "median",
    }
}
