//! `vlscan bench`: the paper's experiment on this machine. One survey is flown with every tree, every schedule,
//! different chunk sizes and numbers of threads; the times are written as table, JSON and picture.

mod columns;
mod forecast;
mod matrix;
mod measure;
mod paper;
mod picture;
mod report;
mod table;

use super::args::BenchArgs;
use super::{Cli, Command, Console, RunArgs};
use crate::error::{Error, Result};
use crate::files::{FileWriter, Patched, is_special, write_stdout};
use clap::Parser;
use matrix::{Matrix, thread_counts};
use report::Report;
use std::ffi::OsString;
use std::path::Path;

pub fn run(args: &BenchArgs, console: &Console) -> Result<()> {
    let matrix = Matrix::new(args)?;
    for path in [&args.json, &args.svg].into_iter().flatten() {
        if path.exists() && !is_special(path) && !args.force {
            return Err(Error::input(format!("{} exists; --force replaces it", path.display())));
        }
    }
    let run = run_args(args)?;
    let bench = measure::Bench::prepare(&run, &args.format, console)?;
    let mut report = Report::begin(&bench);
    let simulated = thread_counts(&args.simulate_threads)?;
    for (name, options) in &matrix.trees {
        let built = bench.build(options, &matrix)?;
        let cells = bench.cells(name, options, &built, &matrix, console)?;
        if !simulated.is_empty() {
            console.detail(format!("task times: {name}"));
            let load = bench.workload(options, &built.tree, &matrix)?;
            report.forecasts.extend(forecast::simulate(name, &load, &matrix, &simulated, &cells));
        }
        report.cells.extend(cells);
    }
    report.compare();
    write_report(args, &report)
}

fn write_report(args: &BenchArgs, report: &Report) -> Result<()> {
    let mut text = table::of(report);
    if args.paper {
        text.push('\n');
        text.push_str(&paper::tables());
    }
    let to_stdout = args.json.as_deref().is_some_and(|path| path.as_os_str() == "-");
    if let Some(path) = &args.json {
        let json = serde_json::to_string_pretty(&report.json(args.paper))
            .map_err(|e| Error::Internal(e.to_string()))?;
        write(path, &(json + "\n"), args.force)?;
    }
    if let Some(path) = &args.svg {
        write(path, &picture::of(report), args.force)?;
    }
    if to_stdout {
        eprint!("{text}");
        return Ok(());
    }
    write_stdout(&text)
}

fn write(path: &Path, text: &str, force: bool) -> Result<()> {
    if path.as_os_str() == "-" {
        return write_stdout(text);
    }
    let mut file = FileWriter::create(path, force, Patched::Never)?;
    file.append(text.as_bytes())?;
    file.finish().map(drop)
}

/// Parses the survey and the options of `vlscan run` that follow `--`.
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
