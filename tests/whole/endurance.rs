//! Many runs in one process: memory, file descriptors, threads and temporary files at the end as at the
//! beginning.

use crate::common::{files, fixture, folder, text};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use vlscan::{
    OutputRequest, PointFormat, Progress, ReadOptions, RunContext, Session, Settings, Stop, Target,
    read_survey,
};

/// Number of runs, from the environment.
const VARIABLE: &str = "VLSCAN_ENDURANCE_RUNS";

/// Other tests of this program would change what is counted, so that the runs have a process of their own.
#[test]
#[ignore = "minutes; part of `.ci/run --long`"]
#[cfg(target_os = "linux")]
fn many_runs_leave_nothing_behind() {
    let mut child = Command::new(std::env::current_exe().unwrap());
    // The C library keeps a heap for each of the first threads, which grow for a thousand runs, to 60 MB.
    child.env("MALLOC_ARENA_MAX", "1");
    child.args(["--exact", "endurance::runs", "--ignored", "--nocapture"]).env(VARIABLE, "75");
    let output = child.output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
}

/// Resources that a process holds.
#[derive(Clone, Copy, Debug)]
struct Held {
    /// Bytes that have been allocated and not freed.
    allocated: usize,
    /// Resident memory, kB: with what the C library keeps of the freed.
    memory_kb: u64,
    threads: usize,
    descriptors: usize,
}

/// Runs whose least counts.
const WINDOW: u32 = 25;

fn least(window: &[Held]) -> Held {
    Held {
        allocated: window.iter().map(|held| held.allocated).min().unwrap(),
        memory_kb: window.iter().map(|held| held.memory_kb).min().unwrap(),
        threads: window.iter().map(|held| held.threads).max().unwrap(),
        descriptors: window.iter().map(|held| held.descriptors).min().unwrap(),
    }
}

fn held() -> Held {
    let entries = |folder: &str| std::fs::read_dir(folder).unwrap().count();
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let memory = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    let memory_kb = memory.trim().trim_end_matches(" kB").parse().unwrap();
    Held {
        allocated: crate::ALLOCATOR.allocated(),
        memory_kb,
        threads: entries("/proc/self/task"),
        descriptors: entries("/proc/self/fd"),
    }
}

#[test]
#[ignore = "called by many_runs_leave_nothing_behind; VLSCAN_ENDURANCE_RUNS=10000 MALLOC_ARENA_MAX=1 for a night"]
fn runs() {
    let runs: u32 = std::env::var(VARIABLE).map_or(100, |n| n.parse().unwrap());
    let dir = folder();
    assert!(runs >= 3 * WINDOW, "at least {} runs", 3 * WINDOW);
    (0..WINDOW).for_each(|run| fly(dir.path(), run));
    // Freed memory goes back to the system at some later time: the least of several runs counts.
    let mut window = Vec::new();
    let mut start = None;
    for run in WINDOW..runs {
        fly(dir.path(), run);
        window.push(held());
        if window.len() == WINDOW as usize && run < runs - WINDOW {
            start.get_or_insert(least(&window));
            window.clear();
        }
    }
    let (start, last): (Held, Held) = (start.expect("a first window"), least(&window));
    // Threads that have been joined are listed until the system has removed them.
    let deadline = Instant::now() + Duration::from_secs(10);
    while held().threads > start.threads && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(10));
    }
    let end = Held { allocated: last.allocated, memory_kb: last.memory_kb, ..held() };
    eprintln!("{runs} runs: {start:?} at the beginning, {end:?} at the end");
    assert!(end.threads <= start.threads, "threads: {start:?}, {end:?}");
    assert_eq!(end.descriptors, start.descriptors);
    // The least of some runs differs by up to 4 kB, as they are of different kinds.
    assert!(end.allocated < start.allocated + 16 * 1024, "allocated: {start:?}, {end:?}");
    // The C library keeps some of what was freed, how much depends on the order in which threads free it.
    assert!(end.memory_kb < 2 * start.memory_kb, "memory: {start:?}, {end:?}");
    assert!(files(dir.path()).is_empty(), "{:?}", files(dir.path()));
}

/// A run of one of the small surveys to one of the formats; every fifth fails because the file exists, every
/// seventh is stopped.
fn fly(dir: &Path, run: u32) {
    let surveys = ["moving/survey.xml", "street/spinning.xml", "room/survey.xml"];
    let formats =
        [PointFormat::Las, PointFormat::Laz, PointFormat::Parquet, PointFormat::Copc, PointFormat::Xyz];
    let (mut survey, _) =
        read_survey(&fixture(surveys[run as usize % surveys.len()]), &ReadOptions::default()).unwrap();
    survey.legs.truncate(1);
    let mut session = Session::open(Settings::new(survey), |_| {}).unwrap();
    let points = dir.join("points");
    if run % 5 == 4 {
        std::fs::write(&points, "another run's").unwrap();
    }
    let mut outputs = OutputRequest::default();
    outputs.sinks = vec![(Target::File(points.clone()), formats[run as usize % formats.len()])];
    let (progress, stop) = (Progress::default(), Stop::new());
    if run % 7 == 6 {
        stop.request();
    }
    let outcome = session.run(outputs, RunContext::new(&progress, &stop));
    assert_eq!(outcome.is_err(), run % 5 == 4 || run % 7 == 6, "run {run}: {outcome:?}");
    for file in files(dir) {
        std::fs::remove_file(dir.join(file)).unwrap();
    }
}
