//! The crates that the program is built of: their licences, sources and versions, by the rules of
//! `deny.toml`.
//!
//! `cargo-deny` checks the same rules and the advisories; this test needs nothing but cargo.

use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// Packages of the program on this platform, without those that only tests use.
fn packages() -> Vec<Value> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let mut command = Command::new(cargo);
    command.args(["metadata", "--format-version", "1", "--locked"]);
    command.args(["--filter-platform", "x86_64-unknown-linux-gnu"]).current_dir(env!("CARGO_MANIFEST_DIR"));
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let nodes = metadata["resolve"]["nodes"].as_array().unwrap();
    let node = |id: &Value| nodes.iter().find(|node| node["id"] == *id).unwrap();
    let mut wanted = vec![metadata["resolve"]["root"].clone()];
    let mut next = 0;
    while next < wanted.len() {
        for dependency in node(&wanted[next].clone())["deps"].as_array().unwrap() {
            let mut kinds = dependency["dep_kinds"].as_array().unwrap().iter();
            if kinds.any(|kind| kind["kind"] != "dev") && !wanted.contains(&dependency["pkg"]) {
                wanted.push(dependency["pkg"].clone());
            }
        }
        next += 1;
    }
    let packages = metadata["packages"].as_array().unwrap();
    packages.iter().filter(|package| wanted.contains(&package["id"])).cloned().collect()
}

/// True if an SPDX expression of ORs and ANDs can be met with the licences allowed.
fn is_allowed(expression: &str, allowed: &[&str]) -> bool {
    let plain = expression.replace(['(', ')'], " ").replace('/', " OR ");
    // AND binds closer than OR; the parentheses in use surround ORs beside an AND, where each side must be
    // met.
    let is_met = |part: &str| part.split(" OR ").any(|name| allowed.contains(&name.trim()));
    if expression.contains('(') {
        plain.split(" AND ").all(is_met)
    } else {
        plain.split(" OR ").any(|part| part.split(" AND ").all(is_met))
    }
}

#[test]
fn licences_sources_and_versions_are_those_of_the_rules() {
    let rules = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("deny.toml")).unwrap();
    let rules: toml::Table = rules.parse().unwrap();
    let allowed: Vec<&str> =
        rules["licenses"]["allow"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    let skipped = rules["bans"]["skip"].as_array().unwrap();
    let packages = packages();
    assert!(packages.len() > 50, "{}", packages.len());
    let mut versions: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for package in &packages {
        let name = package["name"].as_str().unwrap();
        let licence = package["license"].as_str().unwrap_or("none");
        assert!(is_allowed(licence, &allowed), "{name}: the licence {licence} is not in deny.toml");
        let source = package["source"].as_str().unwrap_or("here");
        assert!(
            source == "here" || source.starts_with("registry+https://github.com/rust-lang/crates.io-index"),
            "{name}: {source}"
        );
        versions.entry(name).or_default().push(package["version"].as_str().unwrap());
    }
    for (name, versions) in versions.iter().filter(|(_, versions)| versions.len() > 1) {
        let is_named = |rule: &toml::Value| rule["name"].as_str() == Some(name);
        assert!(
            skipped.iter().any(is_named),
            "{name} has the versions {versions:?}; deny.toml names no reason"
        );
    }
    for rule in skipped {
        let name = rule["name"].as_str().unwrap();
        assert!(
            versions.get(name).is_some_and(|v| v.len() > 1),
            "{name} has one version; deny.toml still names it"
        );
    }
}

#[test]
fn expressions_of_licences_are_read() {
    let allowed = ["MIT", "Apache-2.0", "Unicode-3.0"];
    for good in [
        "MIT",
        "MIT OR GPL-3.0",
        "GPL-3.0/MIT",
        "(MIT OR Zlib) AND Unicode-3.0",
        "Zlib OR MIT AND Apache-2.0",
    ] {
        assert!(is_allowed(good, &allowed), "{good}");
    }
    for bad in ["GPL-3.0", "none", "MIT AND GPL-3.0", "(MIT OR Zlib) AND GPL-3.0"] {
        assert!(!is_allowed(bad, &allowed), "{bad}");
    }
}
