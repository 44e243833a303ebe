//! `vlscan bench`: the paper's experiment on this machine. One survey is flown with every tree, every schedule,
//! different chunk sizes and numbers of threads; the times are written as table, JSON and picture.

mod columns;
mod forecast;
mod matrix;
mod measure;
mod nodes;
mod paper;
mod picture;
mod report;
mod table;

use super::args::BenchArgs;
use super::{Cli, Command, Console, RunArgs};
use clap::Parser;
use matrix::{Matrix, thread_counts};
use report::Report;
use std::ffi::OsString;
use std::path::Path;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched, identity, is_special, reads, write_stdout};
use vlscan_warehouse::{Schedule, Workload};

pub fn run(args: &BenchArgs, console: &Console) -> Result<()> {
    let matrix = Matrix::new(args)?;
    for path in [&args.json, &args.svg].into_iter().flatten() {
        if path.exists() && !is_special(path) && !args.force {
            return Err(Error::input(format!("{} exists; --force replaces it", path.display())));
        }
    }
    if let (Some(json), Some(svg)) = (&args.json, &args.svg)
        && identity(json) == identity(svg)
    {
        return Err(Error::input(format!("--json and --svg would both be written to {}", json.display())));
    }
    for path in [&args.json, &args.svg].into_iter().flatten() {
        reads::refuse_input_of(path, [&args.survey])?;
    }
    let run = run_args(args)?;
    let bench = measure::Bench::prepare(&run, &args.format, console)?;
    let mut report = Report::begin(&bench);
    let simulated = thread_counts(&args.simulate_threads)?;
    for (name, options) in &matrix.trees {
        let built = bench.build(options, &matrix)?;
        let cells = bench.cells(name, options, &built, &matrix, console)?;
        if !simulated.is_empty() || !args.simulate_nodes.is_empty() {
            console.detail(format!("task times: {name}"));
            let load = bench.workload(options, &built.tree, &matrix)?;
            report.forecasts.extend(forecast::simulate(name, &load, &matrix, &simulated, &cells));
            if let Some(schedule) = matrix.parallel().filter(|_| !args.simulate_nodes.is_empty()) {
                console.detail(format!("parts: {name}"));
                let costs = bench.part_costs(options, &built, schedule.policy.size())?;
                report.clusters.push(cluster(args, name, &load, costs, schedule));
            }
        }
        report.cells.extend(cells);
    }
    report.compare();
    write_report(args, &report)
}

/// Simulates the nodes that `args` name, each of which flies by `schedule`.
fn cluster(
    args: &BenchArgs,
    tree: &'static str,
    load: &Workload,
    costs: measure::PartCosts,
    schedule: Schedule,
) -> report::ClusterForecast {
    let cluster = nodes::Cluster {
        threads: args.node_threads,
        pulses: args.simulate_pulses.map_or(costs.pulses, |pulses| pulses.0),
        parts_per_node: args.node_parts,
        node_bytes_per_s: args.node_disk.0 as f64,
        all_bytes_per_s: args.file_system.0 as f64,
    };
    let nodes = nodes::simulate(load, &costs, schedule, cluster, &args.simulate_nodes);
    report::ClusterForecast { tree, cluster, costs, nodes }
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
