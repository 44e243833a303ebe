//! `vlscan bench`: its JSON has every combination that was requested, and its parts agree.

use crate::common::{fixture, folder, run, succeed, text};
use serde_json::Value;

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("no number {key} in {value}"))
}

#[test]
fn threads_and_schedules_are_compared() {
    let dir = folder();
    let survey = fixture("forest/survey.xml");
    let survey = survey.to_str().unwrap();
    let options = ["--schedule", "static,warehouse", "-j", "1,2", "--repetitions", "2", "--json", "all.json"];
    let output = succeed(dir.path(), &[&["bench", survey], &options[..], &["--", "--seed", "3"]].concat());
    let table = text(&output.stdout);
    assert!(table.contains("pulses/s") && table.contains("\nfastest: --threads "), "{table}");
    let json: Value =
        serde_json::from_str(&std::fs::read_to_string(dir.path().join("all.json")).unwrap()).unwrap();
    let cells = json["cells"].as_array().unwrap();
    let of = |cell: &Value| format!("{} {}", cell["schedule"].as_str().unwrap(), cell["threads"]);
    assert_eq!(cells.iter().map(of).collect::<Vec<_>>(), ["sequential 1", "static 2", "warehouse 2"]);
    for cell in cells {
        assert_eq!((&cell["pulses"], &cell["points"]), (&cells[0]["pulses"], &cells[0]["points"]));
        assert!(number(cell, "points") > 0.0 && cell["simulations_s"].as_array().unwrap().len() == 2);
        let least = number(&cells[0], "simulation_s") / number(cell, "simulation_s");
        assert!((number(cell, "speedup") / least - 1.0).abs() < 1e-9, "{cell}");
        let shares = &cell["shares"];
        let sum: f64 = ["computing", "making", "writing", "waiting"].iter().map(|s| number(shares, s)).sum();
        assert!((sum - 1.0).abs() < 0.05, "{cell}");
    }
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let dir = folder();
    let survey = fixture("forest/survey.xml");
    let survey = survey.to_str().unwrap();
    std::fs::write(dir.path().join("kept.json"), "").unwrap();
    for (arguments, advice) in [
        (vec![survey, "--json", "kept.json"], "--force"),
        (vec![survey, "-j", "0"], "threads"),
        (vec![survey, "--chunk-size", "0"], "--chunk-size"),
        (vec![survey, "--", "--physics", "wrong"], "refined"),
        (vec!["missing.xml"], "missing.xml"),
    ] {
        let output = run(dir.path(), &[vec!["bench"], arguments.clone()].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", text(&output.stderr));
        assert!(text(&output.stderr).contains(advice), "{arguments:?}: {}", text(&output.stderr));
    }
    assert!(std::fs::read(dir.path().join("kept.json")).unwrap().is_empty());
}

/// Legs, rates and the mix of primitives are those of the paper's Tables 1 and 2; the files in the repository
/// are what the script makes.
#[test]
fn stand_ins_of_the_papers_surveys_are_made() {
    let dir = folder();
    let paper = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/paper");
    let made = std::process::Command::new(paper.join("make.sh"))
        .args(["0.01", dir.path().to_str().unwrap()])
        .env("VLSCAN", env!("CARGO_BIN_EXE_vlscan"))
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", text(&made.stderr));
    for (name, primitives, voxels, legs, pulses, scans) in [
        ("FIXED_250", 1_977_319.0, true, 41, 1_000_000, 225),
        ("HAMMERLE", 4_630_456.0, false, 7, 1_200_000, 200),
        ("SCALED_COG", 10_290_011.0, false, 41, 1_000_000, 225),
        ("DIWANG", 11_738_288.0, false, 9, 100_000, 50),
        ("ARBORETUM", 13_711_899.0, true, 21, 100_000, 50),
    ] {
        let file = format!("{name}.toml");
        let written = std::fs::read_to_string(dir.path().join(&file)).unwrap();
        assert_eq!(
            written,
            std::fs::read_to_string(paper.join(&file)).unwrap(),
            "run make.sh and commit {file}"
        );
        assert_eq!(written.matches("[[leg]]").count(), legs, "{name}");
        assert!(written.contains(&format!("pulse_freq_hz = {pulses}\nscan_freq_hz = {scans}\n")), "{name}");
        let info = succeed(dir.path(), &["scene", "info", &file, "--json"]);
        let info: Value = serde_json::from_slice(&info.stdout).unwrap();
        let (triangles, cubes) = (number(&info, "triangles"), number(&info, "voxels"));
        let share = (triangles + cubes) / (0.01 * primitives);
        assert!((share - 1.0).abs() < 0.1, "{name}: {triangles} triangles, {cubes} voxels");
        assert_eq!(cubes > 0.0, voxels, "{name}");
    }
}
