//! The default physics: that of HELIOS++ where an XML survey is run, the refined one everywhere else.

use crate::common::{feed, fixture, folder, succeed, text};
use std::fs;
use std::path::Path;

fn points(folder: &Path, words: &str) -> Vec<u8> {
    let words: Vec<&str> = words.split(' ').chain(["-q", "-o", "-", "--format", "xyz"]).collect();
    succeed(folder, &words).stdout
}

#[test]
fn the_default_follows_what_is_run() {
    let dir = folder();
    let of = |name: &str| fixture(name).display().to_string();
    let (survey, scene) = (of("room/survey.xml"), format!("{}#room", of("room/scene.xml")));
    let write = |name: &str, content: String| fs::write(dir.path().join(name), content).unwrap();
    write(
        "own.toml",
        format!(
            "scene = '{scene}'\n[platform]\ncatalogue = 'data/platforms.xml#tripod'\n[scanner]\n\
             catalogue = 'data/scanners_tls.xml#riegl_vz400'\n[settings]\npulse_freq_hz = 100000\nscan_angle_deg = 50\n\
             scan_freq_hz = 60\nhead_rate_deg_per_s = 180\nhead_stop_deg = 6\n[[leg]]\nposition_m = [0.3, -0.2, 0]\n"
        ),
    );
    write("changed.toml", format!("survey = '{survey}'\nseed = 3\n"));
    for (run, default, other) in [
        (survey.as_str(), "helios", "refined"),
        ("own.toml", "refined", "helios"),
        ("changed.toml", "helios", "refined"),
    ] {
        let found = points(dir.path(), &format!("run {run}"));
        assert!(!found.is_empty(), "{run}");
        assert!(found == points(dir.path(), &format!("run {run} --physics {default}")), "{run}");
        assert!(found != points(dir.path(), &format!("run {run} --physics {other}")), "{run}");
    }
    write(
        "helios.toml",
        fs::read_to_string(dir.path().join("own.toml")).unwrap() + "[physics]\nprofile = 'helios'\n",
    );
    assert!(points(dir.path(), "run helios.toml") == points(dir.path(), "run own.toml --physics helios"));
    // A scanner by itself.
    let pulses = b"x,y,z,dx,dy,dz\n0,0,1.5,1,0,0\n0,0,1.5,0,1,0\n0,0,1.5,0.7,0.7,0.1\n";
    let traced = |more: &[&str]| {
        let args = ["trace", "-q", "--scene", &scene, "--scanner", "riegl_vz400"];
        let out = feed(dir.path(), &[&args[..], more].concat(), pulses);
        assert!(out.status.success() && !out.stdout.is_empty(), "{}", text(&out.stderr));
        out.stdout
    };
    assert!(
        traced(&[]) == traced(&["--physics", "refined"]) && traced(&[]) != traced(&["--physics", "helios"])
    );
}

#[test]
fn a_packed_scene_is_for_one_physics_and_says_which() {
    let dir = folder();
    fs::write(
        dir.path().join("wall.obj"),
        "mtllib wall.mtl\nusemtl m\nv 5 -5 -5\nv 5 5 -5\nv 5 0 5\nf 1 2 3\n",
    )
    .unwrap();
    fs::write(dir.path().join("wall.mtl"), "newmtl m\nhelios_reflectance 0.4\n").unwrap();
    succeed(dir.path(), &["scene", "pack", "wall.obj", "-o", "wall.vlscene", "-q"]);
    let traced = |more: &[&str]| {
        let args = ["trace", "-q", "--scene", "wall.vlscene", "--scanner", "riegl_vz400"];
        feed(dir.path(), &[&args[..], more].concat(), b"x,y,z,dx,dy,dz\n0,0,0,1,0,0\n")
    };
    let fits = traced(&[]);
    assert!(fits.status.success() && !fits.stdout.is_empty(), "{}", text(&fits.stderr));
    let refused = traced(&["--physics", "helios"]);
    let said = text(&refused.stderr);
    assert!(refused.status.code() == Some(2), "{said}");
    for part in ["read for --physics refined", "has --physics helios", "pack the scene again"] {
        assert!(said.contains(part), "{said}");
    }
}
