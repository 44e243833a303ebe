//! The report as tables.

use crate::matrix::Combination;
use crate::report::{ClusterForecast, Report};
use crate::rows::table;
use vlscan_base::quantity::amount;

/// The heading of a column and its text in every row.
pub fn of(report: &Report) -> String {
    let mut text = format!(
        "{}: {} primitives, {} legs, {} pulses, {} echoes; loaded in {:.2} s; points as {}\n\n",
        report.survey,
        amount(report.primitives as f64),
        report.legs,
        amount(report.cells.first().map_or(0.0, |c| c.pulses as f64)),
        amount(report.cells.first().map_or(0.0, |c| c.echoes as f64)),
        report.load_s,
        report.format,
    );
    text.push_str(&measured(report));
    if !report.forecasts.is_empty() {
        text.push_str("\nSimulated from measured task times:\n");
        text.push_str(&simulated(report));
        let completing = report.cells.iter().map(|cell| cell.completing_s).fold(f64::INFINITY, f64::min);
        if completing > 5e-4 && completing.is_finite() {
            text.push_str(&format!(
                "Not simulated: completing the file, which waits for the disk, {completing:.3} s on this \
                 machine.\n"
            ));
        }
    }
    for cluster in &report.clusters {
        text.push_str(&simulated_nodes(cluster));
    }
    text
}

fn simulated_nodes(cluster: &ClusterForecast) -> String {
    let ClusterForecast { tree, cluster: assumed, costs, nodes } = cluster;
    let per_pulse = |seconds: f64| seconds * 1e9 / costs.pulses.max(1) as f64;
    let megabytes = |bytes: u64| bytes as f64 / 1e6;
    let head = format!(
        "\nSimulated nodes of {} threads, {} pulses, tree {tree}; {}B/s per node, {}B/s altogether.\n\
         Measured per pulse on one thread: run {:.0} ns, as a shard {:.0} ns, index {:.1} ns, merge {:.0} + \
         {:.0} ns; start {:.2} s, shards {:.0} MB, output {:.0} MB for {} pulses.\n",
        assumed.threads,
        amount(assumed.pulses as f64),
        amount(assumed.node_bytes_per_s),
        amount(assumed.all_bytes_per_s),
        per_pulse(costs.run_cpu_s),
        per_pulse(costs.shard_cpu_s),
        per_pulse(costs.index_s),
        per_pulse(costs.merge_cpu_s),
        per_pulse(costs.collect_s),
        costs.start_s,
        megabytes(costs.shard_bytes),
        megabytes(costs.out_bytes),
        amount(costs.pulses as f64),
    );
    let rows = table(
        nodes,
        &[
            ("nodes", |n| n.nodes.to_string()),
            ("shards", |n| n.shards.to_string()),
            ("index s", |n| format!("{:.1}", n.index_s)),
            ("shards s", |n| format!("{:.1}", n.shards_s)),
            ("merge s", |n| format!("{:.1}", n.merge_s)),
            ("by nodes", |n| n.merging_nodes.to_string()),
            ("join s", |n| format!("{:.1}", n.join_s)),
            ("total s", |n| format!("{:.1}", n.total_s)),
            ("speedup", |n| format!("{:.2}", n.speedup)),
            ("efficiency", |n| format!("{:.2}", n.efficiency)),
            ("disk", |n| format!("{:.0} %", 100.0 * n.disk)),
        ],
    );
    head + &rows
}

fn factor(of: &Combination) -> String {
    of.warehouse_factor.map_or_else(String::new, |factor| factor.to_string())
}

fn measured(report: &Report) -> String {
    let table = table(
        &report.cells,
        &[
            ("tree", |c| c.of.tree.to_owned()),
            ("schedule", |c| c.of.schedule_text()),
            ("chunk", |c| c.of.chunk_size.to_string()),
            ("factor", |c| factor(&c.of)),
            ("threads", |c| c.of.threads.to_string()),
            ("build s", |c| format!("{:.3}", c.build_s)),
            ("simulation s", |c| format!("{:.3}", c.simulation_s)),
            ("total s", |c| format!("{:.3}", c.total_s)),
            ("speedup", |c| format!("{:.2}", c.speedup)),
            ("efficiency", |c| format!("{:.2}", c.efficiency)),
            ("global", |c| format!("{:.2}", c.global_speedup)),
            ("reduction", |c| format!("{:.1} %", 100.0 * c.time_reduction)),
            ("idle", |c| format!("{:.0} %", 100.0 * c.idle)),
            ("depth", |c| format!("{:.1}", c.queue_depth)),
            ("pulses/s", |c| amount(c.pulses_per_s)),
            ("rays/s", |c| amount(c.rays_per_s)),
            ("echoes/s", |c| amount(c.echoes_per_s)),
            ("tree MB", |c| format!("{:.1}", c.tree_bytes as f64 / 1e6)),
        ],
    );
    let peak = report.cells.iter().map(|c| c.peak_bytes).max().unwrap_or(0);
    let [scene, peak] = [report.scene_bytes as f64, peak as f64].map(|bytes| bytes / 1e6);
    format!("{table}scene {scene:.1} MB, most memory held {peak:.1} MB\n")
}

fn simulated(report: &Report) -> String {
    table(
        &report.forecasts,
        &[
            ("tree", |f| f.of.tree.to_owned()),
            ("schedule", |f| f.of.schedule_text()),
            ("chunk", |f| f.of.chunk_size.to_string()),
            ("factor", |f| factor(&f.of)),
            ("threads", |f| f.of.threads.to_string()),
            ("simulation s", |f| format!("{:.4}", f.simulation_s)),
            ("speedup", |f| format!("{:.2}", f.speedup)),
            ("efficiency", |f| format!("{:.2}", f.speedup / f.of.threads as f64)),
            ("computing", |f| format!("{:.0} %", 100.0 * f.utilisation)),
            ("producing", |f| format!("{:.0} %", 100.0 * f.producing)),
            ("measured s", |f| f.measured_s.map_or_else(String::new, |m| format!("{m:.4}"))),
            ("off", |f| {
                let off = |m: f64| format!("{:+.1} %", 100.0 * (f.simulation_s / m - 1.0));
                f.measured_s.map(off).unwrap_or_default()
            }),
        ],
    )
}
