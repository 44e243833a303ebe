//! Random surveys give the same bytes however they are computed: with any number of threads, schedule, chunk
//! size, tree, instruction set and way to store instances, in every format.
//!
//! A survey and its settings are functions of a seed.
//! `VLSCAN_CAMPAIGN=1000 cargo test --test whole campaign -- --ignored` flies a thousand of them;
//! `VLSCAN_CAMPAIGN_FIRST` is the first seed. A seed that fails goes into [`KEPT`].

mod draw;
mod instrument;
mod scenery;
mod survey;

use crate::common::{files, folder, text, vlscan};
use draw::Draw;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Stdio;

/// Seeds that failed once and are not among the first.
const KEPT: &[u64] = &[267];
/// Number of seeds of an ordinary test.
const SEEDS: u64 = 30;
/// Further runs of each survey.
const VARIANTS: usize = 2;

const FORMATS: [&str; 9] =
    ["a.xyz", "a.las", "a.laz", "a.copc.laz", "a.bin", "a.ply", "a.csv", "a.arrow", "a.parquet"];

#[test]
fn surveys_give_the_same_bytes_however_they_are_computed() {
    let seeds: Vec<u64> = KEPT.iter().copied().chain(0..SEEDS).collect();
    let flown = fly_all(&seeds);
    // Most random surveys hit something, or the campaign would compare empty files.
    assert!(flown.points * 2 > seeds.len(), "{} of {} surveys gave points", flown.points, seeds.len());
}

#[test]
#[ignore = "hours; the number of seeds is in VLSCAN_CAMPAIGN"]
fn a_campaign_of_surveys() {
    let number = |name: &str| std::env::var(name).ok().map(|n| n.parse().expect("a number"));
    let first: u64 = number("VLSCAN_CAMPAIGN_FIRST").unwrap_or(SEEDS);
    let count: u64 = number("VLSCAN_CAMPAIGN").unwrap_or(1000);
    let flown = fly_all(&(first..first + count).collect::<Vec<_>>());
    println!("{count} surveys from seed {first}: {flown:?}, the same bytes");
}

/// Result of a campaign.
#[derive(Debug, Default)]
struct Flown {
    runs: usize,
    /// Surveys with points.
    points: usize,
    /// Surveys that the program refused; their messages are the same however they are computed, too.
    refused: usize,
    bytes: usize,
}

fn fly_all(seeds: &[u64]) -> Flown {
    let mut total = Flown::default();
    let mut failures = Vec::new();
    for &seed in seeds {
        if let Err(failure) = fly(seed, &mut total) {
            println!("seed {seed}: {failure}");
            failures.push(seed);
        }
    }
    assert!(failures.is_empty(), "seeds {failures:?} of {total:?}");
    total
}

/// Flies the survey of `seed` with one thread, and again with other settings of the computation.
fn fly(seed: u64, total: &mut Flown) -> Result<(), String> {
    let mut draw = Draw::new(seed);
    let dir = folder();
    survey::write(&mut draw, dir.path());
    let options = options(&mut draw, seed);
    let reference = outcome(dir.path(), &options, &Variant::plain());
    total.runs += 1;
    match &reference {
        Ok(written) => {
            let size: usize = written.values().map(Vec::len).sum();
            total.bytes += size;
            total.points += usize::from(has_points(written));
        }
        Err(_) => total.refused += 1,
    }
    for _ in 0..VARIANTS {
        let variant = Variant::draw(&mut draw);
        let found = outcome(dir.path(), &options, &variant);
        total.runs += 1;
        if let Err(what) = compare(&reference, &found) {
            let survey = dir.keep().join("survey.xml");
            let options = options.join(" ");
            return Err(format!("{what} with {variant:?}\nvlscan run {} {options}", survey.display()));
        }
    }
    Ok(())
}

type Written = BTreeMap<PathBuf, Vec<u8>>;

fn has_points(written: &Written) -> bool {
    written.get(Path::new("points.xyz")).is_some_and(|text| !text.is_empty())
}

fn compare(reference: &Result<Written, String>, found: &Result<Written, String>) -> Result<(), String> {
    match (reference, found) {
        (Ok(reference), Ok(found)) => {
            if !reference.keys().eq(found.keys()) {
                return Err(format!("{:?} instead of {:?}", found.keys(), reference.keys()));
            }
            match reference.iter().find(|(file, bytes)| found.get(*file) != Some(bytes)) {
                Some((file, _)) => Err(format!("{} differs", file.display())),
                None => Ok(()),
            }
        }
        (Err(reference), Err(found)) if reference == found => Ok(()),
        (reference, found) => {
            let shown =
                |outcome: &Result<Written, String>| outcome.as_ref().map(Written::len).map_err(String::clone);
            Err(format!("{:?} instead of {:?}", shown(found), shown(reference)))
        }
    }
}

/// Options of the run that may change its output.
fn options(draw: &mut Draw, seed: u64) -> Vec<String> {
    let mut options = vec!["--seed".to_owned(), seed.to_string(), "-o".to_owned(), "points.xyz".to_owned()];
    let mut add = |words: &[&str]| options.extend(words.iter().map(|word| (*word).to_owned()));
    for _ in 0..draw.between(1, 2) {
        // A format that is drawn twice would be one file.
        let format = draw.pick(&FORMATS);
        let name = format!("{}{format}", draw.below(1 << 30));
        add(&["-o", &name]);
    }
    if draw.chance(0.2) {
        add(&["-o", "legs"]);
    }
    add(&["--physics", draw.pick(&["helios", "refined"])]);
    for (option, chance) in [
        ("--waveforms", 0.3),
        ("--pulses", 0.3),
        ("--waveform-noise", 0.3),
        ("--echo-width", 0.2),
        ("--fixed-incidence", 0.1),
        ("--legacy-energy", 0.1),
        ("--labels", 0.2),
        ("--misses", 0.2),
        ("--no-platform-noise", 0.1),
        ("--no-leg-noise", 0.1),
        ("--split-by-channel", 0.1),
        ("--true-positions", 0.1),
    ] {
        if draw.chance(chance) {
            add(&[option]);
        }
    }
    if draw.chance(0.3) {
        add(&["--trajectory-out", "way.csv"]);
    }
    if draw.chance(0.25) {
        add(&["--navigation-error", "position_m=0.02,0.03,0.05", "--navigation-error", "attitude_deg=0.01"]);
    }
    options
}

/// Settings of the computation, which must leave no trace in its output.
#[derive(Debug)]
struct Variant {
    options: Vec<String>,
    simd: Option<&'static str>,
}

impl Variant {
    /// One thread, and everything else as it is by default.
    fn plain() -> Variant {
        Variant { options: vec!["-j".to_owned(), "1".to_owned()], simd: None }
    }

    fn draw(draw: &mut Draw) -> Variant {
        let mut options = vec!["-j".to_owned(), draw.between(1, 8).to_string()];
        let mut add = |name: &str, value: String| options.extend([name.to_owned(), value]);
        add("--chunk-size", draw.pick(&[1, 2, 7, 13, 64, 300, 1024, 5000]).to_string());
        add("--schedule", draw.pick(&["single", "static", "dynamic", "warehouse"]).to_owned());
        add("--warehouse-factor", draw.between(1, 6).to_string());
        add("--tree", draw.pick(&["bvh", "median", "sah", "axis-sah", "fsah"]).to_owned());
        add("--tree-jobs", draw.between(1, 4).to_string());
        add("--instances", draw.pick(&["auto", "always", "never"]).to_owned());
        if draw.chance(0.3) {
            add("--idle-threshold", "0".to_owned());
        }
        if draw.chance(0.2) {
            options.push("--leg-barrier".to_owned());
        }
        let simd = draw.pick(&[None, Some("portable"), Some("avx2"), Some("avx512")]);
        Variant { options, simd }
    }
}

/// The files that a run writes, or its exit status and message.
fn outcome(folder: &Path, options: &[String], variant: &Variant) -> Result<Written, String> {
    let out = crate::common::folder();
    let mut command = vlscan(out.path());
    command.arg("run").arg(folder.join("survey.xml")).arg("-q").args(options).args(&variant.options);
    match variant.simd {
        Some(set) => command.env("VLSCAN_SIMD", set),
        None => command.env_remove("VLSCAN_SIMD"),
    };
    let output = command.stdin(Stdio::null()).output().expect("the program starts");
    if !output.status.success() {
        // Messages may name the temporary folder, which is the same for all runs of a survey.
        return Err(format!("{:?}: {}", output.status.code(), text(&output.stderr)));
    }
    let read = |file: PathBuf| (file.clone(), std::fs::read(out.path().join(file)).expect("a readable file"));
    Ok(files(out.path()).into_iter().map(read).collect())
}
