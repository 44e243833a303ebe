//! The paper's results: Tables 3 to 6.

use crate::rows::table;
use serde_json::{Value, json};

/// Table 3: SCALED_COG, 6 cores; build, simulation, total in seconds.
const TABLE_3: [(&str, [f64; 3]); 7] = [
    ("BL simple", [128.27, 713.40, 841.67]),
    ("BLI simple", [43.04, 597.20, 640.24]),
    ("BL FSAH", [70.77, 326.40, 397.17]),
    ("BLI FSAH", [24.86, 194.40, 219.26]),
    ("FSAH static 32", [24.70, 89.80, 114.50]),
    ("FSAH dynamic 32", [24.77, 80.20, 104.97]),
    ("FSAH warehouse 32×4", [24.64, 72.80, 97.44]),
];

/// Scene, tree, schedule, cores; build, simulation, total in seconds; time reduction where the paper states
/// it.
type Best = (&'static str, &'static str, &'static str, u32, [f64; 3], Option<f64>);

/// Table 4: the best configurations on a PC with 32 cores.
const TABLE_4: [Best; 5] = [
    ("FIXED_250", "simple", "dynamic 32", 16, [2.94, 87.0, 89.94], Some(92.60)),
    ("HAMMERLE", "FSAH", "warehouse 32×8", 32, [25.22, 46.0, 71.22], Some(99.15)),
    ("SCALED_COG", "simple", "dynamic 16", 32, [25.60, 106.0, 131.60], Some(93.05)),
    ("DIWANG", "SAH", "static 64", 32, [196.71, 612.0, 808.71], Some(98.99)),
    ("ARBORETUM", "simple", "warehouse 64×8", 21, [29.31, 183.0, 212.31], Some(89.51)),
];

/// Table 5: the best configurations on a node with 24 cores of a supercomputer.
const TABLE_5: [Best; 5] = [
    ("FIXED_250", "simple", "warehouse 64×8", 24, [3.62, 67.0, 70.62], None),
    ("HAMMERLE", "FSAH", "dynamic 32", 24, [19.56, 107.0, 126.56], None),
    ("SCALED_COG", "FSAH", "warehouse 64×4", 9, [28.96, 64.0, 92.96], None),
    ("DIWANG", "FSAH", "warehouse 64×8", 24, [77.33, 521.0, 598.33], None),
    ("ARBORETUM", "FSAH", "warehouse 64×8", 14, [36.24, 113.0, 149.24], None),
];

/// Table 6: sequential build, simulation, total; their speedups; time reduction in per cent.
const TABLE_6: [(&str, [f64; 3], [f64; 3], f64); 5] = [
    ("FIXED_250", [12.16, 816.0, 828.16], [3.36, 12.18, 11.73], 91.47),
    ("HAMMERLE", [94.32, 13990.0, 14084.32], [4.82, 130.75, 111.28], 99.10),
    ("SCALED_COG", [163.26, 2889.0, 3052.26], [5.64, 45.14, 32.83], 96.95),
    ("DIWANG", [271.13, 99234.0, 99505.13], [3.51, 190.47, 166.31], 99.40),
    ("ARBORETUM", [89.43, 3051.0, 3140.43], [2.47, 27.00, 21.04], 95.25),
];

fn seconds(x: f64) -> String {
    format!("{x:.2}")
}

fn percent(x: f64) -> String {
    format!("{x:.2} %")
}

pub fn tables() -> String {
    let third = table(
        &TABLE_3,
        &[
            ("implementation", |r| r.0.to_owned()),
            ("build s", |r| seconds(r.1[0])),
            ("simulation s", |r| seconds(r.1[1])),
            ("total s", |r| seconds(r.1[2])),
        ],
    );
    let best = |rows: &[Best]| {
        table(
            rows,
            &[
                ("scene", |r| r.0.to_owned()),
                ("tree", |r| r.1.to_owned()),
                ("schedule", |r| r.2.to_owned()),
                ("cores", |r| r.3.to_string()),
                ("build s", |r| seconds(r.4[0])),
                ("simulation s", |r| seconds(r.4[1])),
                ("total s", |r| seconds(r.4[2])),
                ("reduction", |r| r.5.map_or_else(String::new, percent)),
            ],
        )
    };
    let sixth = table(
        &TABLE_6,
        &[
            ("scene", |r| r.0.to_owned()),
            ("seq. build s", |r| seconds(r.1[0])),
            ("seq. simulation s", |r| seconds(r.1[1])),
            ("seq. total s", |r| seconds(r.1[2])),
            ("build", |r| seconds(r.2[0])),
            ("simulation", |r| seconds(r.2[1])),
            ("total", |r| seconds(r.2[2])),
            ("reduction", |r| percent(r.3)),
        ],
    );
    format!(
        "The paper, Table 3: SCALED_COG (10.29 M primitives), 6 cores\n{third}\n\
         The paper, Table 4: best configurations, 32 cores\n{}\n\
         The paper, Table 5: best configurations, 24 cores\n{}\n\
         The paper, Table 6: best of Table 5 against the sequential simple tree\n{sixth}",
        best(&TABLE_4),
        best(&TABLE_5)
    )
}

pub fn json() -> Value {
    let times = |[build, simulation, total]: [f64; 3]| {
        json!({
            "build_s": build, "simulation_s": simulation, "total_s": total
        })
    };
    let best = |rows: [Best; 5]| -> Vec<Value> {
        rows.into_iter()
            .map(|(scene, tree, schedule, cores, seconds, reduction)| {
                json!({
                    "scene": scene, "tree": tree, "schedule": schedule, "cores": cores,
                    "times": times(seconds), "time_reduction_percent": reduction,
                })
            })
            .collect()
    };
    let third = TABLE_3.map(|(name, seconds)| json!({ "implementation": name, "times": times(seconds) }));
    let sixth = TABLE_6.map(|(scene, seconds, [build, simulation, total], reduction)| {
        json!({
            "scene": scene, "sequential": times(seconds),
            "speedup": { "build": build, "simulation": simulation, "total": total },
            "time_reduction_percent": reduction,
        })
    });
    json!({ "table_3": third, "table_4": best(TABLE_4), "table_5": best(TABLE_5), "table_6": sixth })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn totals_and_ratios_of_the_paper_agree() {
        for (name, [build, simulation, total]) in TABLE_3 {
            assert!((build + simulation - total).abs() < 0.02, "{name}");
        }
        for (scene, _, _, _, [build, simulation, total], _) in TABLE_4.into_iter().chain(TABLE_5) {
            assert!((build + simulation - total).abs() < 0.02, "{scene}");
        }
        for ((scene, sequential, speedup, reduction), best) in TABLE_6.into_iter().zip(TABLE_5) {
            for (i, ratio) in speedup.into_iter().enumerate() {
                assert!((sequential[i] / best.4[i] / ratio - 1.0).abs() < 0.01, "{scene} {i}");
            }
            assert!((100.0 * (1.0 - 1.0 / speedup[2]) - reduction).abs() < 0.02, "{scene}");
        }
    }
}
