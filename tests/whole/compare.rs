//! `vlscan compare` on runs of the fixtures, in several formats.

use crate::common::{fixture, folder, run, succeed, text};
use std::fs;

#[test]
fn runs_are_compared_in_every_format() {
    let dir = folder();
    let survey = fixture("forest/survey.xml");
    let survey = survey.to_str().unwrap();
    succeed(
        dir.path(),
        &["run", survey, "-o", "a.laz", "-o", "a.parquet", "-o", "a.ply", "-o", "a.xyz", "--seed", "1", "-q"],
    );
    succeed(dir.path(), &["run", survey, "-o", "b.las", "--seed", "2", "-q"]);
    let json = |first: &str, second: &str| -> serde_json::Value {
        let out = succeed(dir.path(), &["compare", first, second, "--json"]);
        serde_json::from_slice(&out.stdout).unwrap()
    };
    for other in ["a.parquet", "a.ply", "a.xyz"] {
        let same = json("a.laz", other);
        assert!(same["voxels"]["agreement"].as_f64().unwrap() > 0.99, "{other}: {same}");
        assert!(same["first_to_second"]["percentile_95_m"].as_f64().unwrap() < 0.002, "{other}: {same}");
        assert_eq!(same["first"]["points"], same["second"]["points"], "{other}");
    }
    // Other noise, the same forest.
    let other = json("a.laz", "b.las");
    let number = |path: &str| other.pointer(path).and_then(serde_json::Value::as_f64).unwrap_or(f64::NAN);
    let distance = number("/first_to_second/median_m");
    assert!(distance > 0.001 && distance < 0.2, "{other}");
    assert!(number("/canopy/correlation") > 0.9 && number("/heights/overlap") > 0.97, "{other}");
    assert!(
        (number("/second/density_per_m2") / number("/first/density_per_m2") - 1.0).abs() < 0.02,
        "{other}"
    );
    let args = ["compare", "a.laz", "b.las", "--page", "c.html"];
    let table = text(&succeed(dir.path(), &args).stdout);
    for name in ["density", "height, 95 %", "canopy height", "intensity", "returns 1", "distance", "voxels"] {
        assert!(table.contains(name), "{name}: {table}");
    }
    assert!(table.lines().all(|line| line.chars().count() <= 120), "{table}");
    let page = fs::read_to_string(dir.path().join("c.html")).unwrap();
    assert!(page.contains("data:image/png;base64,") && page.contains("<svg") && !page.contains("http://"));
    let again = run(dir.path(), &args);
    assert!(!again.status.success() && text(&again.stderr).contains("--force"));
}

#[test]
fn clouds_of_different_places_are_refused() {
    let dir = folder();
    fs::write(dir.path().join("a.xyz"), "0 0 0\n10 10 1\n").unwrap();
    fs::write(dir.path().join("b.xyz"), "500000 5400000 0\n500010 5400010 1\n").unwrap();
    let out = run(dir.path(), &["compare", "a.xyz", "b.xyz"]);
    assert!(
        out.status.code() == Some(2) && text(&out.stderr).contains("do not overlap"),
        "{}",
        text(&out.stderr)
    );
    let out = run(dir.path(), &["compare", "a.xyz", "none.xyz"]);
    assert!(!out.status.success() && text(&out.stderr).contains("none.xyz"));
}
