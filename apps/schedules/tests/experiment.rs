//! The experiment from end to end: its JSON has every combination that was requested, and its figures agree.

use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

fn survey() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/forest/survey.xml");
    path.to_str().unwrap().to_owned()
}

/// Runs the experiment in `folder` and returns its table and its JSON.
fn measured(folder: &Path, options: &[&str]) -> (String, Value) {
    let output = Command::new(env!("CARGO_BIN_EXE_vlscan-schedules"))
        .current_dir(folder)
        .args([&survey()[..], "--json", "all.json"])
        .args(options)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let json = std::fs::read_to_string(folder.join("all.json")).unwrap();
    (String::from_utf8(output.stdout).unwrap(), serde_json::from_str(&json).unwrap())
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("no number {key} in {value}"))
}

#[test]
#[ignore = "minutes; part of `.ci/run --long`"]
fn every_cell_is_measured_and_told() {
    let dir = tempfile::tempdir().unwrap();
    let (table, json) = measured(
        dir.path(),
        &[
            "--tree",
            "median,sah,axis-sah,fsah,bvh",
            "--chunk-size",
            "32,256",
            "--warehouse-factor",
            "4,8",
            "-j",
            "1,2",
            "--leg-barrier",
            "both",
            "--repetitions",
            "1",
            "--warm-up",
            "0",
            "--simulate-threads",
            "2,8,64,512",
            "--paper",
            "--svg",
            "all.svg",
        ],
    );
    assert!(table.contains("warehouse + barrier") && table.contains("The paper, Table 6"), "{table}");

    let mut expected = BTreeSet::new();
    for tree in ["median", "sah", "axis-sah", "fsah", "bvh"] {
        for chunk in [32, 256] {
            expected.insert(format!("{tree} sequential {chunk} null false 1"));
            for barrier in [false, true] {
                expected.insert(format!("{tree} single 1 null {barrier} 2"));
                expected.insert(format!("{tree} static {chunk} null {barrier} 2"));
                expected.insert(format!("{tree} dynamic {chunk} null {barrier} 2"));
                for factor in [4, 8] {
                    expected.insert(format!("{tree} warehouse {chunk} {factor} {barrier} 2"));
                }
            }
        }
    }
    let name = |c: &Value| {
        format!(
            "{} {} {} {} {} {}",
            c["tree"].as_str().unwrap(),
            c["schedule"].as_str().unwrap(),
            c["chunk_size"],
            c["warehouse_factor"],
            c["leg_barrier"],
            c["threads"]
        )
    };
    let cells = json["cells"].as_array().unwrap();
    assert_eq!(cells.iter().map(name).collect::<BTreeSet<_>>(), expected);
    assert_eq!(cells.len(), expected.len(), "a combination was measured twice");

    let first = &cells[0];
    for cell in cells {
        let of = |key: &str| number(cell, key);
        assert!((of("build_s") + of("simulation_s") - of("total_s")).abs() < 1e-9);
        assert!(of("cpu_s") > 0.0);
        assert!(of("tree_leaves") > 0.0 && of("tree_references") >= number(&json, "primitives"));
        assert!(of("build_s") > 0.0 && of("simulation_s") > 0.0 && of("rays_per_s") >= of("pulses_per_s"));
        assert_eq!((&cell["pulses"], &cell["echoes"]), (&first["pulses"], &first["echoes"]), "{cell}");
        assert!((of("efficiency") * of("threads") - of("speedup")).abs() < 1e-9);
        assert!((of("time_reduction") - (1.0 - 1.0 / of("global_speedup"))).abs() < 1e-9);
        let alone = cells.iter().find(|c| {
            c["threads"] == 1
                && c["tree"] == cell["tree"]
                && (c["chunk_size"] == cell["chunk_size"] || cell["schedule"] == "single")
        });
        let speedup = number(alone.unwrap(), "simulation_s") / of("simulation_s");
        assert!((speedup - of("speedup")).abs() < 1e-9, "{cell}");
    }
    assert_eq!(
        number(first, "global_speedup"),
        1.0,
        "the simple tree on one thread is what all are compared to"
    );

    let simulated = json["simulated"].as_array().unwrap();
    let of_two_threads = expected.iter().filter(|name| name.ends_with(" 2")).count();
    assert_eq!(simulated.len(), 4 * of_two_threads);
    for forecast in simulated {
        assert!(number(forecast, "simulation_s") > 0.0 && number(forecast, "utilisation") <= 1.0 + 1e-9);
        // Not at most the number of threads: what a chunk costs on one thread and on several is measured
        // separately.
        assert!(number(forecast, "speedup") > 0.0, "{forecast}");
        assert_eq!(forecast["measured_s"].is_number(), forecast["threads"] == 2, "{forecast}");
        assert!(number(forecast, "cpu_s") > 0.0);
    }
    assert_eq!(json["paper"]["table_3"].as_array().unwrap().len(), 7);

    let svg = std::fs::read_to_string(dir.path().join("all.svg")).unwrap();
    let picture = roxmltree::Document::parse(&svg).unwrap();
    let lines = picture.descendants().filter(|n| n.has_tag_name("polyline")).count();
    assert!(lines >= 10, "{lines} lines");
}

#[test]
fn nodes_are_simulated_from_measured_parts() {
    let dir = tempfile::tempdir().unwrap();
    let options = [
        "--tree",
        "bvh",
        "-j",
        "1,2",
        "--schedule",
        "warehouse",
        "--chunk-size",
        "1024",
        "--repetitions",
        "1",
    ];
    let nodes = ["--simulate-nodes", "1,10,1000", "--simulate-pulses", "100G"];
    let (table, json) = measured(dir.path(), &[&["--warm-up", "0"], &options[..], &nodes].concat());
    assert!(table.contains("Simulated nodes of 32 threads, 100.00 G pulses"), "{table}");
    let cluster = &json["clusters"][0];
    let costs = &cluster["costs"];
    assert_eq!(number(costs, "pulses"), number(&json["cells"][0], "pulses"));
    for cost in ["index_s", "start_s", "run_cpu_s", "shard_cpu_s", "merge_cpu_s", "shard_bytes", "out_bytes"]
    {
        assert!(number(costs, cost) > 0.0, "{cost}: {costs}");
    }
    let rows = cluster["nodes"].as_array().unwrap();
    assert_eq!(rows.len(), 3);
    for row in rows {
        let sum: f64 = ["index_s", "shards_s", "merge_s", "join_s"].iter().map(|key| number(row, key)).sum();
        assert!((sum / number(row, "total_s") - 1.0).abs() < 1e-9, "{row}");
        assert_eq!(number(row, "shards"), 4.0 * number(row, "nodes"));
    }
    assert!(number(&rows[1], "shards_s") < number(&rows[0], "shards_s"), "{cluster}");
}
