//! Time per pulse of making chunks: the producer's part of a run, alone, for every platform and every
//! deflector.
//!
//! ```text
//! cargo bench --bench producer                     all platforms and deflectors
//! cargo bench --bench producer -- survey.xml       any survey
//! ```
//!
//! A chunk is made as in a run: the flight's state is copied, and the flight is stepped over 1024 pulses,
//! which are only counted. Times are processor times, the least of three flights of at most 2²² pulses.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;
use vlscan::geom::Rotation;
use vlscan::lidar::flight::{FlightOptions, FlightPlan, FlightState, Step};
use vlscan::lidar::platform::Pose;
use vlscan::options::{Options, read_survey};
use vlscan::{DVec3, Error, Result};

const CHUNK: u32 = 1024;
const MAX_PULSES: u64 = 1 << 22;

/// Instruments with one deflector each, at 300 kHz.
const OPTICS: [(&str, &str); 8] = [
    ("rotating", "optics = \"rotating\"\nscan_angle_max_deg = 30\nscan_freq_max_hz = 500"),
    (
        "rotating, a third of the turn",
        "optics = \"rotating\"\nscan_angle_max_deg = 180\nscan_angle_effective_max_deg = 60\nscan_freq_max_hz = 500",
    ),
    ("oscillating", "optics = \"oscillating\"\nscan_angle_max_deg = 30\nscan_freq_max_hz = 500"),
    ("conic", "optics = \"conic\"\nscan_angle_max_deg = 20\nscan_freq_max_hz = 500"),
    ("fibres", "optics = \"line\"\nfibres = 127\nscan_angle_max_deg = 20"),
    (
        "prisms",
        "optics = \"risley\"\nprisms = [{ rotor_freq_hz = -121, wedge_deg = 18, index = 1.51 }, { rotor_freq_hz = 77, wedge_deg = -18, index = 1.51 }]",
    ),
    ("pattern", "optics = \"pattern\"\npattern = [[0, 0], [7, 12], [-20, 3], [12, -30], [-4, -9]]"),
    (
        "two channels",
        "optics = \"rotating\"\nscan_angle_max_deg = 30\nscan_freq_max_hz = 500\n[[scanner.channel]]\nid = \"a\"\n[[scanner.channel]]\nid = \"b\"",
    ),
];

/// Legs along the axes, and across them, where the increments of x and y alternate in their last bit.
const ALONG: &[[f64; 3]] =
    &[[-50.0, -220.0, 300.0], [-50.0, 220.0, 300.0], [50.0, 220.0, 300.0], [50.0, -220.0, 300.0]];
const ACROSS: &[[f64; 3]] =
    &[[-310.3, -220.0, 300.0], [190.1, 220.7, 301.5], [290.9, 170.2, 302.0], [-205.5, -270.3, 299.0]];

fn legs(points: &[[f64; 3]]) -> String {
    points.iter().map(|p| format!("[[leg]]\nposition_m = {p:?}\nspeed_m_per_s = 60\n")).collect()
}

fn pipeline(platform: &str, optics: &str, settings: &str, legs: &str) -> String {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/room/scene.xml#room");
    format!(
        "scene = {:?}\n[platform]\n{platform}\n[settings]\npulse_freq_hz = 300000\nscan_freq_hz = 100\nscan_angle_deg = 60\n{settings}\n{legs}\n\
         [scanner]\npulse_freqs_hz = [300000]\nhead_rate_max_deg_per_s = 60\n{optics}\n",
        scene.display().to_string()
    )
}

/// Surveys of every platform with a rotating mirror, and of every deflector on a straight flight.
fn surveys() -> Vec<(String, String)> {
    let (rotating, linear) = (OPTICS[0].1, "kind = \"linear_path\"");
    let catalogue = |id: &str| format!("catalogue = \"data/platforms.xml#{id}\"");
    let mut all = vec![
        ("straight, several legs".to_owned(), pipeline(linear, rotating, "", &legs(ALONG))),
        ("straight, several oblique legs".to_owned(), pipeline(linear, rotating, "", &legs(ACROSS))),
        ("straight, one leg".to_owned(), pipeline(linear, rotating, "", &legs(&ALONG[..2]))),
        ("straight, one oblique leg".to_owned(), pipeline(linear, rotating, "", &legs(&ACROSS[..2]))),
        (
            "tripod with a turning head".to_owned(),
            pipeline("", rotating, "head_rate_deg_per_s = 10\nhead_stop_deg = 180", &legs(&ALONG[..1])),
        ),
        ("multicopter".to_owned(), pipeline(&catalogue("quadcopter"), rotating, "", &legs(ALONG))),
        ("ground vehicle".to_owned(), pipeline(&catalogue("tractor"), rotating, "", &legs(&ALONG[..2]))),
        ("stream of poses".to_owned(), {
            let text = pipeline("", rotating, "", "");
            text.replace("[platform]\n\n", "[trajectory]\npath = \"-\"\n")
        }),
    ];
    for (name, optics) in OPTICS {
        all.push((format!("straight, {name}"), pipeline(linear, optics, "", &legs(ALONG))));
    }
    all
}

/// Poses of a straight flight, 200 per second.
fn poses() -> Vec<Pose> {
    let pose = |i: u32| {
        let time = 1000.0 + f64::from(i) * 0.005;
        Pose { time, position: DVec3::new(0.3 * f64::from(i), 0.0, 300.0), attitude: Rotation::IDENTITY }
    };
    (0..4000).map(pose).collect()
}

/// Seconds of this thread's processor time.
#[cfg(target_os = "linux")]
fn computed() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Seconds since the first call.
#[cfg(not(target_os = "linux"))]
fn computed() -> f64 {
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// Flies once and returns the number of pulses and of chunks, and the seconds that it took.
fn fly(plan: &FlightPlan) -> Result<(u64, u64, f64)> {
    let mut state = FlightState::start(plan);
    if plan.is_stream() {
        state.feed(plan, poses());
    }
    let (mut pulses, mut chunks, from) = (0, 0, computed());
    while pulses < MAX_PULSES {
        let start = black_box(state.clone());
        let skipped = state.skip(plan, CHUNK, 1 << 16)?;
        drop(start);
        (pulses, chunks) = (pulses + u64::from(skipped.pulses), chunks + 1);
        match skipped.last {
            Step::NeedsPoses => state.end_poses(),
            Step::Ended => break,
            Step::Advanced | Step::LegChanged => {}
        }
    }
    Ok((pulses, chunks, computed() - from))
}

fn measure(name: &str, path: &Path) -> Result<()> {
    let (survey, ..) = read_survey(path, Options::default())?;
    let (plan, _) = FlightPlan::new(&survey, DVec3::ZERO, &|_, _| None, &FlightOptions::default())?;
    let mut best = (0, 0, f64::INFINITY);
    for _ in 0..3 {
        let flown = fly(&plan)?;
        if flown.2 < best.2 {
            best = flown;
        }
    }
    let (pulses, chunks, seconds) = best;
    println!("{name:<40}{pulses:>10}{chunks:>10}{:>10.1}", seconds * 1e9 / pulses as f64);
    Ok(())
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    println!("{:<40}{:>10}{:>10}{:>10}", "flight", "pulses", "chunks", "ns/pulse");
    if !arguments.is_empty() {
        return arguments.iter().try_for_each(|path| measure(path, &PathBuf::from(path)));
    }
    let started = Instant::now();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("producer");
    std::fs::create_dir_all(&folder).map_err(|e| Error::input(format!("{}: {e}", folder.display())))?;
    for (name, text) in surveys() {
        let path = folder.join("survey.toml");
        std::fs::write(&path, text).map_err(|e| Error::input(format!("{}: {e}", path.display())))?;
        measure(&name, &path)?;
    }
    eprintln!("{:.1} s", started.elapsed().as_secs_f64());
    Ok(())
}
