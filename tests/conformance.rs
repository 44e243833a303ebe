//! The reference program's surveys give the reference program's points, where the conformance suite is at hand.

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

/// Cases whose scenes and instruments are read; each is judged within its own tolerance by the suite's `compare.py`.
const CASES: &[&str] = &[
    "als_flat_plane",
    "als_oscillating_relief",
    "als_rotating_polygon",
    "duration_and_warmup",
    "filters_order",
    "fwf_quality5_echowidth",
    "incidence_and_pulses",
    "legacy_energy_model",
    "materials_reflectance",
    "mls_linearpath",
    "onground_modes",
    "pulse_frequency_change",
    "range_limits_maxnor",
    "resolution_settings",
    "single_file",
    "strips_and_legs",
    "tls_polygon_room",
    "traj_interpolated_arinc",
    "traj_interpolated_canonical",
    "utm_precision",
    "warmup_oscillating",
];

fn suite() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/conformance");
    let folder = std::env::var_os("VLSCAN_CONFORMANCE").map_or(beside, PathBuf::from);
    if folder.join("run_suite.py").is_file() {
        return Some(folder);
    }
    println!("skipped: no conformance suite at {}", folder.display());
    None
}

#[test]
fn the_reference_points_are_met() {
    let Some(suite) = suite() else { return };
    let out = common::folder();
    let command =
        format!("{} run {{survey}} --output {{out}} --assets {{case}} -q", env!("CARGO_BIN_EXE_vlscan"));
    let judged = Command::new("python3")
        .arg(suite.join("run_suite.py"))
        .args(["--command", &command, "--out"])
        .arg(out.path())
        .args(CASES)
        .output();
    let Ok(judged) = judged else {
        println!("skipped: no python3 to run the suite with");
        return;
    };
    assert!(judged.status.success(), "{}\n{}", common::text(&judged.stdout), common::text(&judged.stderr));
}
