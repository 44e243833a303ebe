//! The same survey gives the same bytes for any number of threads and any chunk size, in every format.

use crate::common::{files, fixture, folder, succeed};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vlscan::trace::{BuildOptions, Builder};
use vlscan::{
    OutputRequest, PointFormat, Progress, ReadOptions, RunContext, Session, Settings, Stop, Target,
    read_survey,
};

const OUTPUTS: [&str; 14] = [
    "all.xyz",
    "all.las",
    "all.laz",
    "all.bin",
    "all.ply",
    "all.raycloud.ply",
    "all.pcd",
    "all.e57",
    "all.mcap",
    "all.csv",
    "all.arrow",
    "all.parquet",
    "all.geo.parquet",
    "legs",
];

/// Compares what two runs have written: the same files with the same bytes.
fn check_same(reference: &BTreeMap<PathBuf, Vec<u8>>, other: &BTreeMap<PathBuf, Vec<u8>>, extra: &[&str]) {
    assert!(reference.keys().eq(other.keys()), "{extra:?}: {:?}, not {:?}", other.keys(), reference.keys());
    for (file, bytes) in other {
        assert!(&reference[file] == bytes, "{} differs with {extra:?}", file.display());
    }
}

/// A survey with noise on every source that may draw random numbers.
fn outputs(survey: &Path, extra: &[&str]) -> BTreeMap<PathBuf, Vec<u8>> {
    let dir = folder();
    let survey = survey.to_str().unwrap();
    let mut args = vec!["run", survey, "-q", "--seed", "11", "--waveforms", "--pulses", "--waveform-noise"];
    for path in OUTPUTS {
        args.extend(["-o", path]);
    }
    args.extend(extra);
    succeed(dir.path(), &args);
    files(dir.path()).into_iter().map(|f| (f.clone(), std::fs::read(dir.path().join(&f)).unwrap())).collect()
}

#[test]
fn threads_and_chunk_sizes_leave_no_trace() {
    for survey in ["forest/survey.xml", "room/survey.xml", "moving/survey.xml"] {
        let survey = fixture(survey);
        let reference = outputs(&survey, &["-j", "1"]);
        assert!(reference.len() >= OUTPUTS.len(), "outputs are missing: {:?}", reference.keys());
        assert!(reference.values().all(|bytes| !bytes.is_empty()));
        let settings: &[&[&str]] = &[
            &["-j", "2"],
            &["-j", "8"],
            &["-j", "2", "--chunk-size", "1"],
            &["-j", "8", "--chunk-size", "64", "--warehouse-factor", "1"],
            &["-j", "2", "--chunk-size", "4096"],
            &["-j", "1", "--chunk-size", "7", "--tree-jobs", "1"],
            &["-j", "4", "--tree", "fsah", "--tree-jobs", "2"],
            &["-j", "2", "--tree", "sah"],
        ];
        for extra in settings {
            check_same(&reference, &outputs(&survey, extra), extra);
        }
    }
}

#[test]
fn channels_that_fire_in_turn_leave_no_trace() {
    let dir = folder();
    let survey = dir.path().join("turn.toml");
    let text = format!(
        "scene = '{}#street'\n[platform]\ncatalogue = 'data/platforms.xml#vmq-1ha-car-0'\n\
         [scanner]\ncatalogue = 'data/scanners_tls.xml#vlp16'\n\
         [settings]\nhead_rate_deg_per_s = 7200\nhead_stop_deg = 720\n\
         [[leg]]\nposition_m = [0, -3, 0]\nspeed_m_per_s = 20\n[[leg]]\nposition_m = [0, 2, 0]\nactive = false\n",
        fixture("street/scene.xml").display()
    );
    std::fs::write(&survey, text).unwrap();
    let reference = outputs(&survey, &["-j", "1"]);
    for extra in [&["-j", "2", "--chunk-size", "5"][..], &["-j", "3", "--chunk-size", "4096"]] {
        check_same(&reference, &outputs(&survey, extra), extra);
    }
    let text = std::fs::read_to_string(&survey).unwrap();
    std::fs::write(&survey, text.replace("[settings]", "firing_offset_us = 0\n[settings]")).unwrap();
    let at_once = outputs(&survey, &[]);
    assert!(at_once[Path::new("all.xyz")] != reference[Path::new("all.xyz")]);
}

#[test]
fn schedules_leave_no_trace() {
    assert_schedules_leave_no_trace(&["moving/survey.xml"]);
}

#[test]
#[ignore = "minutes; part of `.ci/run --long`"]
fn schedules_leave_no_trace_in_larger_surveys() {
    assert_schedules_leave_no_trace(&["forest/survey.xml", "room/survey.xml"]);
}

fn assert_schedules_leave_no_trace(surveys: &[&str]) {
    for survey in surveys {
        let dir = folder();
        let survey = fixture(survey);
        let points = |extra: &[&str]| {
            let mut args = vec!["run", survey.to_str().unwrap(), "-q", "--seed", "11", "--force"];
            args.extend(["-o", "all.xyz", "--trajectory-out", "way.csv"]);
            args.extend(extra);
            succeed(dir.path(), &args);
            ["all.xyz", "way.csv"].map(|name| std::fs::read(dir.path().join(name)).unwrap())
        };
        let reference = points(&["-j", "1", "--chunk-size", "300"]);
        assert!(reference[0].len() > 1000 && !reference[1].is_empty());
        for schedule in ["single", "static", "dynamic", "warehouse"] {
            for threads in ["1", "2", "8"] {
                for size in ["1", "13", "1024"] {
                    if schedule == "single" && size != "1" {
                        continue;
                    }
                    let extra = ["--schedule", schedule, "-j", threads, "--chunk-size", size];
                    assert!(points(&extra) == reference, "{extra:?}");
                }
                let extra = ["--schedule", schedule, "-j", threads, "--chunk-size", "9", "--leg-barrier"];
                assert!(points(&extra) == reference, "{extra:?}");
            }
        }
        // Every idle time before a chunk changes the size of the next.
        let extra =
            ["--schedule", "dynamic", "--idle-threshold", "0", "--schedule-log", "log.json", "-j", "3"];
        assert!(points(&extra) == reference, "{extra:?}");
        let log = std::fs::read_to_string(dir.path().join("log.json")).unwrap();
        let log: serde_json::Value = serde_json::from_str(&log).unwrap();
        assert_eq!((log["schedule"].as_str(), log["threads"].as_u64()), (Some("dynamic"), Some(3)));
        let tasks = |thread: &serde_json::Value| thread["tasks"].as_u64().unwrap();
        let by_workers: u64 = log["workers"].as_array().unwrap().iter().map(tasks).sum();
        assert_eq!(by_workers + tasks(&log["producer"]), log["tasks"].as_u64().unwrap());
        assert!(log["tasks"].as_u64().unwrap() > 1000);
    }
}

#[test]
fn trees_leave_no_trace() {
    let trees = [
        BuildOptions::default(),
        BuildOptions { bins: 4, ..BuildOptions::of(Builder::Fsah) },
        BuildOptions { candidates: 3, ..BuildOptions::strict(Builder::Sah) },
        BuildOptions { max_depth: Some(3), jobs: 3, delegate: 64, ..BuildOptions::of(Builder::AxisSah) },
        BuildOptions { min_primitives: 200, geometry_jobs: 4, ..BuildOptions::of(Builder::Median) },
    ];
    for survey in ["forest/survey.xml", "room/survey.xml", "moving/survey.xml"] {
        let points = trees.clone().map(|tree| {
            let dir = folder();
            let points = dir.path().join("all.xyz");
            let (survey, _) = read_survey(&fixture(survey), &ReadOptions::default()).unwrap();
            let mut settings = Settings::new(survey);
            settings.tree = tree;
            let mut session = Session::open(settings, |_| {}).unwrap();
            let mut outputs = OutputRequest::default();
            outputs.sinks = vec![(Target::File(points.clone()), PointFormat::Xyz)];
            let (progress, stop) = (Progress::default(), Stop::new());
            session.run(outputs, RunContext::new(&progress, &stop)).unwrap();
            std::fs::read(points).unwrap()
        });
        assert!(points[0].len() > 1000);
        for (bytes, tree) in points.iter().zip(&trees) {
            assert!(*bytes == points[0], "{survey} differs with {tree:?}");
        }
    }
}

#[test]
fn another_seed_gives_other_noise() {
    let survey = fixture("forest/survey.xml");
    let one = outputs(&survey, &[]);
    let dir = folder();
    let args = ["run", survey.to_str().unwrap(), "-q", "--seed", "12", "-o", "all.xyz"];
    succeed(dir.path(), &args);
    let other = std::fs::read(dir.path().join("all.xyz")).unwrap();
    assert!(
        !other.is_empty() && one[Path::new("all.xyz")] != other,
        "range noise does not depend on the seed"
    );
}

#[test]
fn moving_parts_move_and_every_epoch_has_its_own_run_directory() {
    let (dir, survey) = (folder(), fixture("moving/survey.xml"));
    succeed(dir.path(), &["run", survey.to_str().unwrap(), "-q", "--output", "out", "-j", "2"]);
    let points: Vec<PathBuf> =
        files(dir.path()).into_iter().filter(|f| f.ends_with("leg001_points.xyz")).collect();
    assert_eq!(points.len(), 3, "a run directory per epoch: {points:?}");
    let of = |file: &Path, id: &str| -> Vec<Vec<f64>> {
        let text = std::fs::read_to_string(dir.path().join(file)).unwrap();
        let rows = text.lines().map(|l| l.split(' ').collect::<Vec<_>>());
        rows.filter(|w| w[8] == id).map(|w| w[..2].iter().map(|x| x.parse().unwrap()).collect()).collect()
    };
    // Returns of the box lie in several places, farther apart than it is wide.
    let circling = of(&points[0], "2");
    let apart = |a: &[f64], b: &[f64]| (a[0] - b[0]).hypot(a[1] - b[1]);
    assert!(circling.iter().any(|p| apart(p, &circling[0]) > 3.0), "{circling:?}");
    let reach = |file: &PathBuf| of(file, "3").iter().map(|p| p[0]).fold(f64::MIN, f64::max);
    assert!((reach(&points[0]) + 3.5).abs() < 0.1, "a box of 1 m at -4: {}", reach(&points[0]));
    assert!((reach(&points[1]) + 3.0).abs() < 0.1, "one of 2 m: {}", reach(&points[1]));
    assert!(of(&points[2], "3").is_empty(), "and none");
}

#[test]
fn shared_meshes_give_the_bytes_of_stored_ones() {
    let dir = folder();
    let make = [
        "scene", "make", "forest", "-o", "f", "-n", "60k", "--models", "3", "--copies", "20", "--pulses",
        "20k", "-q",
    ];
    succeed(dir.path(), &make);
    let points = |when: &str, threads: &str| {
        let out = format!("{when}{threads}.xyz");
        let args = [
            "run",
            "f/survey.xml",
            "-q",
            "-o",
            &out,
            "--instances",
            when,
            "-j",
            threads,
            "--physics",
            "refined",
        ];
        succeed(dir.path(), &args);
        std::fs::read(dir.path().join(out)).unwrap()
    };
    let stored = points("never", "2");
    assert!(stored.len() > 100_000, "{} bytes", stored.len());
    assert!(points("always", "2") == stored, "shared");
    assert!(points("always", "1") == stored, "shared, one thread");
}

#[test]
fn pulse_times_and_wander_leave_no_trace_of_threads_chunks_and_shards() {
    let dir = folder();
    std::fs::write(
        dir.path().join("plane.obj"),
        "v -90 -90 0\nv 90 -90 0\nv 90 90 0\nv -90 90 0\nf 1 2 3\nf 1 3 4\n",
    )
    .unwrap();
    let times: String =
        (0..6000).map(|k| format!("{}\n", f64::from(k * k % 7) * 1e-5 + f64::from(k) * 1e-4)).collect();
    std::fs::write(dir.path().join("times.txt"), times).unwrap();
    for when in ["pulse_times = \"times.txt\"", "pulse_intervals_us = [54, 66, 84, 231]"] {
        let pipeline = format!(
            "seed = 3\n[[part]]\nfile = \"plane.obj\"\nmaterial = [{{ reflectance = 0.5 }}]\n[platform]\nkind = \"linear_path\"\n\
             mount = {{ rotate_deg = [{{ x = -90 }}] }}\n[scanner]\noptics = \"conic\"\npulse_freqs_hz = [10000]\n\
             scan_angle_max_deg = 20\naccuracy_m = 0.02\nscan_reverse = true\nscan_phase_deg = 70\n\
             scan_axis_tilt_deg = [0.3, -0.2]\nscan_wander = {{ amplitude_deg = 2, freq_hz = 11 }}\n[settings]\n{when}\n\
             scan_freq_hz = 30\n[[leg]]\nposition_m = [-20, 0, 100]\nspeed_m_per_s = 80\n[[leg]]\nposition_m = [20, 0, 100]\n\
             active = false\n"
        );
        std::fs::write(dir.path().join("p.toml"), pipeline).unwrap();
        let points = |name: &str, extra: &[&str]| {
            succeed(dir.path(), &[&["run", "p.toml", "-q", "--force", "-o", name], extra].concat());
            std::fs::read(dir.path().join(name)).unwrap()
        };
        let reference = points("one.csv", &["-j", "1"]);
        assert!(reference.iter().filter(|byte| **byte == b'\n').count() > 4000, "{when}");
        for extra in [&["-j", "3", "--chunk-size", "7"], &["-j", "2", "--chunk-size", "4096"]] {
            assert!(points("other.csv", extra) == reference, "{when} {extra:?}");
        }
        for shard in ["0/3", "1/3", "2/3"] {
            succeed(dir.path(), &["run", "p.toml", "-q", "-o", "shards", "--shard", shard]);
        }
        succeed(dir.path(), &["merge", "shards", "-q", "-o", "merged.csv"]);
        assert!(std::fs::read(dir.path().join("merged.csv")).unwrap() == reference, "{when}: merged shards");
        std::fs::remove_dir_all(dir.path().join("shards")).unwrap();
        std::fs::remove_file(dir.path().join("merged.csv")).unwrap();
    }
}
