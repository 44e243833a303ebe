//! Errors of navigation from end to end: points move, their true positions and the true trajectory do not,
//! and neither chunks nor threads nor `vlscan pulses | vlscan trace` instead of `vlscan run` change a bit.

use crate::common::{feed, folder, python_with_laspy, succeed, text, vlscan};
use std::fs;
use std::path::Path;

const PIPELINE: &str = "scene = 'ground.obj'\nseed = 5\n[platform]\nkind = 'linear_path'\n\
    mount = { offset_m = [0, 0, -0.5], rotate_deg = [{ x = -90 }, { z = 90 }] }\n\
    [scanner]\nid = 's'\noptics = 'rotating'\npulse_freqs_hz = [2000]\nscan_angle_max_deg = 30\n\
    scan_angle_effective_max_deg = 20\nscan_freq_max_hz = 100\naccuracy_m = 0\nrange_min_m = 1\n[settings]\nscan_freq_hz = 20\n\
    scan_angle_deg = 20\n[[leg]]\nposition_m = [0, -20, 100]\nspeed_m_per_s = 40\n[[leg]]\nposition_m = [0, 20, 100]\nactive = false\n";

fn write(dir: &Path, errors: &str) {
    let ground = "v -200 -200 0\nv 200 -200 0\nv 200 200 0\nv -200 200 0\nf 1 2 3\nf 1 3 4\n";
    fs::write(dir.join("ground.obj"), ground).unwrap();
    fs::write(dir.join("p.toml"), format!("{PIPELINE}[navigation_errors]\n{errors}")).unwrap();
}

/// X, Y, Z and the true ones of every point.
fn points(dir: &Path, options: &[&str]) -> Vec<[f64; 6]> {
    let columns =
        ["run", "p.toml", "-q", "-o", "-", "--format", "csv", "--columns", "X,Y,Z,TrueX,TrueY,TrueZ"];
    let out = succeed(dir, &[&columns, options].concat()).stdout;
    let row = |line: &str| -> [f64; 6] {
        let numbers: Vec<f64> = line.split(',').map(|n| n.parse().unwrap()).collect();
        numbers.try_into().unwrap()
    };
    text(&out).lines().skip(1).map(row).collect()
}

#[test]
fn points_move_and_their_true_positions_do_not() {
    let dir = folder();
    write(dir.path(), "");
    let plain = points(dir.path(), &[]);
    assert!(plain.len() > 1000);
    assert!(plain.iter().all(|p| p[..3] == p[3..]), "without errors the two are one");

    // 0.1 m to the east, and 1 mrad of heading, which moves a point beside the track along it.
    write(dir.path(), "position_bias_m = [0.1, 0, 0]\nattitude_bias_deg = [0, 0, 0.05729577951308232]\n");
    let moved = points(dir.path(), &[]);
    assert_eq!(moved.len(), plain.len());
    for (p, m) in plain.iter().zip(&moved) {
        assert!((0..3).all(|i| (p[i] - m[3 + i]).abs() < 1e-4), "{p:?} {m:?}");
        let (east, north) = (m[0] - m[3] - 0.1, m[1] - m[4]);
        assert!(
            east.abs() < 2e-4 && (north + 1e-3 * m[3]).abs() < 2e-4 && (m[2] - m[5]).abs() < 1e-4,
            "{m:?}"
        );
    }
    // The command line wins key by key.
    let typed = points(
        dir.path(),
        &["--navigation-error", "position_bias_m=0", "--navigation-error", "attitude_bias_deg=0"],
    );
    assert_eq!(typed, plain);
}

#[test]
fn random_errors_are_the_same_for_any_chunk_thread_and_way() {
    let dir = folder();
    write(
        dir.path(),
        "position_m = [0.02, 0.02, 0.05]\nposition_correlation_s = 0.3\nattitude_deg = 0.01\nboresight_sigma_deg = 0.01\nlever_arm_sigma_m = 0.01\n",
    );
    let args = ["run", "p.toml", "-q", "-o", "-", "--format", "xyz"];
    let whole = succeed(dir.path(), &args).stdout;
    for other in [["-j", "1", "--chunk-size", "7"], ["-j", "3", "--chunk-size", "100"]] {
        assert!(succeed(dir.path(), &[&args[..], &other].concat()).stdout == whole, "{other:?}");
    }
    assert!(succeed(dir.path(), &[&args[..], &["--seed", "6"]].concat()).stdout != whole);
    let pulses = succeed(dir.path(), &["pulses", "p.toml", "-q"]).stdout;
    let traced =
        feed(dir.path(), &["trace", "--scanner", "p.toml", "-q", "-o", "-", "--format", "xyz"], &pulses);
    assert!(traced.stdout == whole, "{}", text(&traced.stderr));
}

#[test]
fn the_true_trajectory_is_told_on_request() {
    let dir = folder();
    let poses = |options: &[&str]| -> Vec<Vec<f64>> {
        let out = succeed(dir.path(), &[&["trajectory", "p.toml", "-q"], options].concat()).stdout;
        text(&out).lines().skip(1).map(|l| l.split(',').map(|n| n.parse().unwrap()).collect()).collect()
    };
    write(dir.path(), "");
    let plain = poses(&[]);
    write(dir.path(), "position_bias_m = [0, 0, 0.25]\nattitude_bias_deg = [1, 2, 3]\n");
    let (reported, flown) = (poses(&[]), poses(&["--true"]));
    assert!(plain.len() > 10 && flown == plain);
    for (f, r) in flown.iter().zip(&reported) {
        let off: Vec<f64> = (0..7).map(|i| r[i] - f[i]).collect();
        for (found, wanted) in off.iter().zip([0.0, 0.0, 0.0, 0.25, 1.0, 2.0, 3.0]) {
            assert!((found - wanted).abs() < 1e-9, "{off:?}");
        }
    }
    write(dir.path(), "position_m = -1\nattitude_deg = [1, 2]\nnonsense = 1\n");
    let refused = vlscan(dir.path()).args(["run", "p.toml", "-o", "a.xyz"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused.stderr));
}

#[test]
fn las_has_true_positions_on_request() {
    let Some(python) = python_with_laspy() else { return };
    let dir = folder();
    write(dir.path(), "position_bias_m = [0.25, -0.5, 1]\n");
    for name in ["a.las", "a.laz"] {
        succeed(dir.path(), &["run", "p.toml", "-q", "-o", name, "--true-positions", "--force"]);
        let script = "import laspy, numpy as np, sys\nlas = laspy.read(sys.argv[1])\n\
            off = [np.asarray(las[a.lower()]) - np.asarray(las['True' + a]) for a in 'XYZ']\n\
            assert len(las.points) > 1000\n\
            assert all(np.abs(o - w).max() < 1e-4 for o, w in zip(off, (0.25, -0.5, 1))), off\n";
        let out = std::process::Command::new(&python)
            .args(["-c", script, name])
            .current_dir(dir.path())
            .output()
            .unwrap();
        assert!(out.status.success(), "{name}: {}", text(&out.stderr));
    }
}

#[test]
fn points_in_the_scanners_axes_do_not_depend_on_the_heading() {
    let dir = folder();
    write(dir.path(), "");
    let columns = "PulseNumber,ScannerX,ScannerY,ScannerZ,Range,ScanAngle";
    let seen = || -> Vec<[f64; 6]> {
        let words = [
            "run",
            "p.toml",
            "-q",
            "-o",
            "-",
            "--format",
            "csv",
            "--physics",
            "refined",
            "--columns",
            columns,
        ];
        let row = |line: &str| -> [f64; 6] {
            let numbers: Vec<f64> = line.split(',').map(|n| n.parse().unwrap()).collect();
            numbers.try_into().unwrap()
        };
        text(&succeed(dir.path(), &words).stdout).lines().skip(1).map(row).collect()
    };
    let north = seen();
    assert!(north.len() > 1000);
    for [number, x, y, z, range, angle] in &north {
        assert!(((x * x + y * y + z * z).sqrt() - range).abs() < 3e-4, "{number}");
        // The mirror turns the beam off the y axis of the mount, about one other axis.
        assert!((y - range * angle.to_radians().cos()).abs() < 3e-4, "{number}: {y}, {range} m at {angle}°");
        assert!(x.abs().min(z.abs()) < 2e-4, "{number}: {x} {z}");
    }
    let pipeline = fs::read_to_string(dir.path().join("p.toml")).unwrap();
    let pipeline = pipeline.replace("[0, -20, 100]", "[-20, 0, 100]").replace("[0, 20, 100]", "[20, 0, 100]");
    fs::write(dir.path().join("p.toml"), pipeline).unwrap();
    let east = seen();
    assert_eq!(east.len(), north.len());
    for (n, e) in north.iter().zip(&east) {
        assert!((0..6).all(|i| (n[i] - e[i]).abs() < 2e-3), "{n:?} {e:?}");
    }
}
