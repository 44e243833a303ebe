//! Every fuzz target on its seeds and on random changes to them.
//!
//! The coverage-guided search, which needs a nightly compiler, is `fuzz/run.sh`.

#[path = "../../fuzz/targets.rs"]
mod targets;

use crate::common::text;
use std::path::PathBuf;
use std::process::Command;
use targets::{Bench, TARGETS};

/// Changed inputs per target.
const CHANGED: u64 = 40;

/// Names the target to the process that runs it.
const VARIABLE: &str = "VLSCAN_FUZZ";

/// Each target runs in a process of its own, whose many error messages are dropped.
#[test]
fn readers_survive_random_damage() {
    let failed: Vec<&str> = std::thread::scope(|scope| {
        let halves: Vec<_> = (0..2).map(|half| scope.spawn(move || failed_targets(half))).collect();
        halves.into_iter().flat_map(|half| half.join().unwrap()).collect()
    });
    assert!(failed.is_empty(), "{failed:?}");
}

/// Runs every second target and returns those that failed.
fn failed_targets(first: usize) -> Vec<&'static str> {
    let mut failed = Vec::new();
    for target in TARGETS.iter().skip(first).step_by(2) {
        let mut child = Command::new(std::env::current_exe().unwrap());
        child.args(["--exact", "fuzz::one_target", "--ignored", "--nocapture"]).env(VARIABLE, target.name);
        let output = child.output().unwrap();
        if !output.status.success() {
            let messages = text(&output.stderr);
            let lines: Vec<&str> = messages.lines().collect();
            eprintln!("{}:\n{}", target.name, lines[lines.len().saturating_sub(30)..].join("\n"));
            failed.push(target.name);
        }
    }
    failed
}

#[test]
#[ignore = "called by readers_survive_random_damage for each target"]
fn one_target() {
    let Ok(name) = std::env::var(VARIABLE) else { return };
    let target = TARGETS.iter().find(|target| target.name == name).expect("a target");
    let bench = Bench::new();
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds").join(target.name);
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    paths.sort();
    assert!(!paths.is_empty(), "no seeds");
    let seeds: Vec<Vec<u8>> = paths.iter().map(|path| std::fs::read(path).unwrap()).collect();
    for (path, seed) in paths.iter().zip(&seeds) {
        eprintln!("{}", path.display());
        target.run(&bench, seed, true);
    }
    for number in 0..CHANGED {
        let changed = change(&seeds[number as usize % seeds.len()], number);
        eprintln!("changed input {number}");
        target.run(&bench, &changed, true);
    }
}

/// Replaces, removes or repeats up to four random stretches of a seed.
fn change(seed: &[u8], number: u64) -> Vec<u8> {
    let mut state = number;
    let mut below = |n: usize| {
        // SplitMix64.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) as usize % n
    };
    let mut bytes = seed.to_vec();
    for _ in 0..1 + below(4) {
        let at = below(bytes.len() + 1);
        let end = (at + 1 + below(8)).min(bytes.len());
        match below(5) {
            0 => bytes.truncate(at),
            1 => drop(bytes.drain(at.min(end)..end)),
            2 => {
                let repeated: Vec<u8> =
                    seed.iter().copied().skip(below(seed.len() + 1)).take(below(64)).collect();
                bytes.splice(at..at, repeated).for_each(drop);
            }
            3 => bytes[at.min(end)..end]
                .iter_mut()
                .for_each(|byte| *byte = [0, 0xff, b'9', b'-', b'\n'][below(5)]),
            _ => bytes[at.min(end)..end].iter_mut().for_each(|byte| *byte ^= 1 << below(8)),
        }
    }
    bytes
}
