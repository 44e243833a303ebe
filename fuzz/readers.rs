//! libFuzzer entry for the targets of `targets.rs`; the environment variable `VLSCAN_FUZZ` names the target.
//!
//! One program for all targets: linking one per target would take most of the building time.

#![no_main]

mod targets;

use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;
use targets::{Bench, Target};

static TARGET: LazyLock<&Target> = LazyLock::new(|| {
    let name = std::env::var("VLSCAN_FUZZ").unwrap_or_default();
    let found = targets::TARGETS.iter().find(|target| target.name == name);
    found.unwrap_or_else(|| {
        let names: Vec<&str> = targets::TARGETS.iter().map(|target| target.name).collect();
        eprintln!("VLSCAN_FUZZ names no target; there are {}", names.join(" "));
        std::process::exit(2)
    })
});

thread_local! {
    static BENCH: Bench = Bench::new();
}

fuzz_target!(|data: &[u8]| BENCH.with(|bench| TARGET.run(bench, data, false)));
