//! Surveys of the conformance suite give the points of the reference program; needs the suite
//! (`VLSCAN_CONFORMANCE`).

use crate::common;
use std::path::{Path, PathBuf};
use std::process::Command;

/// All cases; the suite's `compare.py` compares each within the tolerance of the case.
const CASES: &[&str] = &[
    "als_conic_palmer",
    "als_flat_plane",
    "als_geotiff",
    "als_line_fibres",
    "als_oscillating_relief",
    "als_rotating_polygon",
    "duration_and_warmup",
    "dyn_geometry_swap",
    "dyn_motion_types",
    "dyn_rigid_motion",
    "filters_order",
    "fwf_quality1to4_channels",
    "fwf_quality5_echowidth",
    "incidence_and_pulses",
    "legacy_energy_model",
    "materials_reflectance",
    "mechanical_errors",
    "mls_groundvehicle",
    "mls_linearpath",
    "mls_multichannel_8",
    "onground_modes",
    "pulse_frequency_change",
    "range_limits_maxnor",
    "resolution_settings",
    "single_file",
    "strips_and_legs",
    "tls_polygon_room",
    "tls_risley_two_prisms",
    "traj_interpolated_arinc",
    "traj_interpolated_canonical",
    "uls_smoothturn",
    "uls_stopandturn",
    "utm_precision",
    "vox_fixed_and_scaled",
    "vox_fixed_ladlut",
    "vox_transmittive",
    "vox_transmittive_ladlut",
    "warmup_oscillating",
    "xyz_estimated_normals",
    "xyz_given_normals",
];

fn suite() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/conformance");
    let folder = std::env::var_os("VLSCAN_CONFORMANCE").map_or(beside, PathBuf::from);
    if folder.join("run_suite.py").is_file() {
        return Some(folder);
    }
    common::missing("conformance", &format!("no suite at {}", folder.display()));
    None
}

#[test]
#[ignore = "needs the reference's surveys (VLSCAN_CONFORMANCE); closed_form has cases that need nothing"]
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
        common::missing("python3", "apt install python3");
        return;
    };
    assert!(judged.status.success(), "{}\n{}", common::text(&judged.stdout), common::text(&judged.stderr));
}
