//! Moving instruments and user-defined instruments: the street fixtures and every example of
//! `docs/instruments.md`.

use crate::common::{fixture, folder, succeed, text};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

#[test]
fn every_example_of_the_documentation_runs() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = fs::read_to_string(root.join("docs/instruments.md")).unwrap();
    let examples: Vec<&str> =
        page.split("```toml\n").skip(1).map(|rest| rest.split_once("```").unwrap().0).collect();
    assert_eq!(examples.len(), 4);
    let dir = folder();
    for (number, example) in examples.iter().enumerate() {
        // paths are relative to the pipeline file
        let name = format!("example{number}.toml");
        let example = example.replace("\"fixtures/", &format!("\"{}/fixtures/", root.display()));
        fs::write(dir.path().join(&name), example).unwrap();
        let out = succeed(dir.path(), &["run", &name, "--strict", "-o", "-", "--format", "xyz"]);
        let points = text(&out.stdout).lines().count();
        assert!(points > 500, "example {number}: {points} points\n{}", text(&out.stderr));
    }
}

/// Columns x, y, class and time of the points of a fixture's survey.
fn points(survey: &str) -> Vec<[f64; 4]> {
    let dir = folder();
    let out = succeed(dir.path(), &[fixture(survey).to_str().unwrap(), "-o", "-", "-q"]);
    let number = |line: &str, at: usize| line.split(' ').nth(at).unwrap().parse::<f64>().unwrap();
    text(&out.stdout).lines().map(|l| [0, 1, 9, 10].map(|at| number(l, at))).collect()
}

#[test]
fn a_car_sees_the_street_on_both_sides() {
    let points = points("street/survey.xml");
    assert!(points.len() > 10_000, "{} points", points.len());
    for class in [11.0, 6.0, 15.0] {
        assert!(points.iter().any(|p| p[2] == class), "class {class}");
    }
    for side in [-1.0, 1.0] {
        let walls = points.iter().filter(|p| p[2] == 6.0 && p[0] * side > 8.0).count();
        assert!(walls > 500, "{walls} points on walls");
    }
    // A profile across the road lies at the car's position and advances with time.
    let along = |at: usize| points[at][1];
    let (first, last) = (along(0), along(points.len() - 1));
    assert!((first + 20.4).abs() < 1.0 && last > 8.0, "from {first} to {last}");
}

#[test]
fn every_channel_of_a_spinning_scanner_fires() {
    let dir = folder();
    let survey = fixture("street/spinning.xml");
    succeed(dir.path(), &[survey.to_str().unwrap(), "-q", "-o", "legs", "--split-by-channel", "--pulses"]);
    let pulses = fs::read_to_string(dir.path().join("legs/leg000_pulse.txt")).unwrap();
    let devices: BTreeSet<&str> = pulses.lines().map(|l| l.rsplit(' ').next().unwrap()).collect();
    assert_eq!(devices.len(), 128);
    // The lowest channels hit the road; all channels together cover all directions.
    let lowest = fs::read_to_string(dir.path().join("legs/leg000_points_dev000.xyz")).unwrap();
    let quadrants: BTreeSet<(bool, bool)> = lowest
        .lines()
        .map(|l| {
            let mut fields = l.split(' ').map(|f| f.parse::<f64>().unwrap_or(0.0));
            (fields.next().unwrap() > 1.5, fields.next().unwrap() > -10.0)
        })
        .collect();
    assert_eq!(quadrants.len(), 4);
    let highest = fs::read_to_string(dir.path().join("legs/leg000_points_dev127.xyz")).unwrap();
    assert!(lowest.lines().count() > highest.lines().count());
}
