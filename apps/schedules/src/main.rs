//! The experiment of *Virtual LiDAR Simulation as a High Performance Computing Challenge: Toward HPC
//! HELIOS++* (IEEE Access 2022) on any survey: every tree, schedule, chunk size and number of threads is
//! measured, and the measured task times are replayed on machines with more cores.
//!
//! ```text
//! cargo run --release -p vlscan-schedules -- survey.xml --simulate-threads 16,64 --json a.json --svg a.svg
//! ```
//!
//! | file | what it does |
//! |---|---|
//! | `args`, `matrix` | the command line, and the combinations that it asks for |
//! | `measure` | flights and tree builds, timed |
//! | `workload`, `replay` | costs of tasks from records of flights; a schedule in simulated time |
//! | `forecast`, `nodes` | replays with more threads, and on the nodes of a cluster |
//! | `report`, `table`, `picture` | the results compared, as text and as charts |
//! | `rows` | rows of a table as text |
//! | `paper` | the paper's own results |

mod args;
mod forecast;
mod matrix;
mod measure;
mod nodes;
mod paper;
mod picture;
mod replay;
mod report;
mod rows;
mod table;
mod workload;

use args::Args;
use clap::Parser;
use matrix::{Matrix, thread_counts};
use report::Report;
use std::process::ExitCode;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{is_special, write_file, write_stdout};
use vlscan_render::Render as _;
use vlscan_warehouse::Schedule;
use workload::Workload;

fn main() -> ExitCode {
    let args = Args::parse();
    match run(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            match &error {
                Error::Input(found) | Error::Limits(found) => eprint!("{}", found.render(false)),
                other => eprintln!("error: {other}"),
            }
            ExitCode::from(error.exit_status())
        }
    }
}

fn run(args: &Args) -> Result<()> {
    let matrix = Matrix::new(args)?;
    for path in [&args.json, &args.svg].into_iter().flatten() {
        if path.exists() && !is_special(path) && !args.force {
            return Err(Error::input(format!("{} exists; --force replaces it", path.display())));
        }
    }
    let say = |text: String| {
        if args.verbose {
            eprintln!("{text}");
        }
    };
    let bench = measure::Bench::prepare(args)?;
    let mut report = Report::default();
    let simulated = thread_counts(&args.simulate_threads)?;
    for (name, options) in &matrix.trees {
        say(format!("{name}: scene and tree"));
        let built = bench.build(options, &matrix)?;
        report.describe(&built, &args.format);
        let cells = bench.cells(name, &built, &matrix, &say)?;
        if !simulated.is_empty() || !args.simulate_nodes.is_empty() {
            say(format!("{name}: task times"));
            let load = bench.workload(&built, &matrix)?;
            report.forecasts.extend(forecast::simulate(name, &load, &matrix, &simulated, &cells));
            if let Some(schedule) = matrix.parallel().filter(|_| !args.simulate_nodes.is_empty()) {
                say(format!("{name}: shards"));
                let costs = bench.shard_costs(&built, schedule.policy.size())?;
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
    args: &Args,
    tree: &'static str,
    load: &Workload,
    costs: measure::ShardCosts,
    schedule: Schedule,
) -> report::ClusterForecast {
    let cluster = nodes::Cluster {
        threads: args.node_threads as usize,
        pulses: args.simulate_pulses.unwrap_or(costs.pulses),
        shards_per_node: args.node_shards,
        node_bytes_per_s: args.node_disk as f64,
        all_bytes_per_s: args.file_system as f64,
    };
    let nodes = nodes::simulate(load, &costs, schedule, cluster, &args.simulate_nodes);
    report::ClusterForecast { tree, cluster, costs, nodes }
}

fn write_report(args: &Args, report: &Report) -> Result<()> {
    let mut text = table::of(report);
    if args.paper {
        text.push('\n');
        text.push_str(&paper::tables());
    }
    if let Some(path) = &args.json {
        let json = serde_json::to_string_pretty(&report.json(args.paper))
            .map_err(|e| Error::Internal(e.to_string()))?;
        write_file(path, args.force, (json + "\n").as_bytes())?;
    }
    if let Some(path) = &args.svg {
        write_file(path, args.force, picture::of(report).as_bytes())?;
    }
    write_stdout(&text)
}
