//! Complete runs: files, names, order, failures.

use super::testing::{batch, scene, survey, write};
use super::*;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::error::Error;
use vlscan_lidar::pulse::Batch;

fn plan(request: OutputRequest, survey: &vlscan_survey::Survey) -> Arc<OutputPlan> {
    Arc::new(OutputPlan::new(request, &OutputContext::new(survey, &scene())).unwrap())
}

fn points(target: Target) -> OutputRequest {
    let run_stamp = Some("2026-01-02_03-04-05".to_owned());
    OutputRequest { sinks: vec![(target, PointFormat::Xyz)], run_stamp, ..OutputRequest::default() }
}

/// Names of all files below `dir`, with `/`, sorted.
fn files(dir: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut folders = vec![dir.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.push(path.strip_prefix(dir).unwrap().to_str().unwrap().to_owned());
            }
        }
    }
    found.sort();
    found
}

fn lines(path: PathBuf) -> usize {
    fs::read_to_string(path).unwrap().lines().count()
}

#[test]
fn tiles_take_points_beside_the_scene_and_others_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let survey = survey(1, &[None, None, None]);
    let mut request = points(Target::Directory(dir.path().join("tiles")));
    request.division = Some(Division::Tiles(500.0));
    request.sinks.push((Target::File(dir.path().join("all.xyz")), PointFormat::Xyz));
    let mut batch = batch(1, 0, 300);
    // The scene ends at 1000 m.
    batch.echoes[7].position.x = 1020.0;
    batch.echoes[8].position.x = 5000.0;
    let plan = plan(request.clone(), &survey);
    let slots: Vec<&[u32]> = plan.layout.routes.iter().map(|routes| routes[0].slots.as_slice()).collect();
    assert!(slots[0].len() > 16 && std::ptr::eq(slots[0], slots[2]), "all legs have one list");
    let summary = write(request.clone(), &survey, &[batch]).unwrap();
    assert_eq!((summary.points, summary.left_out), (299, 1));
    let tiles: usize =
        files(&dir.path().join("tiles")).iter().map(|f| lines(dir.path().join("tiles").join(f))).sum();
    assert_eq!((tiles, lines(dir.path().join("all.xyz"))), (299, 300));

    // Without points there are no tiles, and the other files are there.
    fs::remove_dir_all(dir.path().join("tiles")).unwrap();
    fs::remove_file(dir.path().join("all.xyz")).unwrap();
    write(request, &survey, &[]).unwrap();
    assert_eq!(files(dir.path()), ["all.xyz"]);
}

#[test]
fn the_layout_of_the_reference() {
    let dir = tempfile::tempdir().unwrap();
    let survey = survey(2, &[None, Some("!"), Some("7"), None, Some("7"), Some("A")]);
    let batches = [batch(0, 0, 300), batch(2, 0, 200), batch(3, 0, 0), batch(4, 200, 100)];
    let request =
        OutputRequest { waveforms: true, pulses: true, ..points(Target::Helios(dir.path().into())) };
    let summary = write(request.clone(), &survey, &batches).unwrap();
    let mut expected = Vec::new();
    for leg in ["leg000", "leg003", "strip007", "strip00A"] {
        for product in ["fullwave.txt", "points.xyz", "pulse.txt", "trajectory.txt"] {
            expected.push(format!("demo/2026-01-02_03-04-05/{leg}_{product}"));
        }
    }
    assert_eq!(files(dir.path()), expected);
    let run = dir.path().join("demo/2026-01-02_03-04-05");
    assert_eq!(summary.directories, std::slice::from_ref(&run));
    assert_eq!(summary.points, 600);
    // Legs of a strip share every product (trap 10), and no remainder of pulses is lost (trap 1).
    for (name, count) in [
        ("leg000_points.xyz", 300),
        ("leg003_points.xyz", 0),
        ("strip007_points.xyz", 300),
        ("strip007_fullwave.txt", 3),
        ("strip007_pulse.txt", 3),
        ("strip007_trajectory.txt", 3),
        ("strip00A_points.xyz", 0),
    ] {
        assert_eq!(lines(run.join(name)), count, "{name}");
    }
    // A second run within the same second gets its own directory.
    let again = write(request, &survey, &batches).unwrap();
    assert_eq!(again.directories, [dir.path().join("demo/2026-01-02_03-04-05_2")]);
}

#[test]
fn joined_batches_are_written_like_separate_ones() {
    let survey = survey(2, &[None, Some("!")]);
    let batches = [batch(0, 0, 30), batch(0, 30, 1), batch(0, 31, 9), batch(1, 0, 5)];
    let formats =
        [PointFormat::Xyz, PointFormat::Las, PointFormat::Laz, PointFormat::PlyBinary, PointFormat::Csv];
    for format in formats.into_iter().chain([PointFormat::Arrow, PointFormat::Parquet]) {
        let file = |dir: &tempfile::TempDir| dir.path().join(format!("all.{}", format.extension()));
        let dirs = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let [apart, joined] = dirs.each_ref().map(|dir| OutputRequest {
            sinks: vec![(Target::File(file(dir)), format)],
            ..points(Target::File(file(dir)))
        });
        write(apart, &survey, &batches).unwrap();
        let plan = plan(joined, &survey);
        let mut all: Vec<Encoded> = Vec::new();
        for batch in &batches {
            let next = plan.encode(batch, None);
            let rest = match all.last_mut() {
                Some(last) => last.join(next),
                None => Some(next),
            };
            all.extend(rest);
        }
        // Batches of different legs cannot be joined.
        assert_eq!(all.len(), 2, "{format:?}");
        let mut writer = plan.open(Arc::new(NoOffload)).unwrap();
        all.into_iter().try_for_each(|encoded| writer.append(encoded)).unwrap();
        writer.finish().unwrap();
        let [apart, joined] = dirs.each_ref().map(|dir| fs::read(file(dir)).unwrap());
        assert!(apart == joined && apart.len() > 1000, "{format:?}");
    }
}

#[test]
fn formats_share_a_run_directory() {
    let dir = tempfile::tempdir().unwrap();
    let mut request = points(Target::Helios(dir.path().into()));
    request.sinks.push((Target::Helios(dir.path().into()), PointFormat::Las));
    let summary = write(request, &survey(1, &[None]), &[batch(0, 0, 300)]).unwrap();
    let run = dir.path().join("demo/2026-01-02_03-04-05");
    assert_eq!(files(&run), ["leg000_points.las", "leg000_points.xyz", "leg000_trajectory.txt"]);
    assert_eq!(lines(run.join("leg000_trajectory.txt")), 3);
    assert_eq!((summary.points, summary.directories), (300, vec![run]));
}

#[test]
fn workers_and_writer_are_on_different_threads() {
    fn check<T: Send>() {}
    check::<Arc<OutputPlan>>();
    check::<Encoded>();
    check::<Writer>();
}

#[test]
fn run_directories_are_named_by_the_time_and_run_out_at_99() {
    let dir = tempfile::tempdir().unwrap();
    let stamp = super::plan::stamp();
    let shape: String = stamp.chars().map(|c| if c.is_ascii_digit() { '0' } else { c }).collect();
    assert_eq!(shape, "0000-00-00_00-00-00");
    for number in 1..=99 {
        let (made, folders) = super::plan::create_run_directory(dir.path(), "s").unwrap();
        folders.into_iter().for_each(vlscan_base::files::NewFolder::keep);
        let name = if number == 1 { "s".to_owned() } else { format!("s_{number}") };
        assert_eq!(made, dir.path().join(name));
    }
    assert!(matches!(super::plan::create_run_directory(dir.path(), "s"), Err(Error::Input(_))));
}

#[test]
fn text_is_what_the_reference_writes() {
    let dir = tempfile::tempdir().unwrap();
    let batch = batch(0, 20, 3);
    write(points(Target::File(dir.path().join("p.xyz"))), &survey(1, &[None]), std::slice::from_ref(&batch))
        .unwrap();
    let written = fs::read_to_string(dir.path().join("p.xyz")).unwrap();
    let shift = scene().shift;
    for (line, echo) in written.lines().zip(&batch.echoes) {
        let p = echo.position + shift;
        let part = ["0", "north", "-"][echo.part as usize];
        let expected = format!(
            "{:.4} {:.4} {:.4} {:.4} {:.4} {} {} {} {part} {} {:.9}",
            p.x,
            p.y,
            p.z,
            echo.intensity,
            echo.echo_width,
            echo.return_number,
            echo.number_of_returns,
            echo.pulse_number,
            echo.classification,
            echo.time_ns / 1e9
        );
        assert_eq!(line, expected);
    }
    assert_eq!(written.lines().count(), 3);
}

#[test]
fn channels_are_split_by_id() {
    let dir = tempfile::tempdir().unwrap();
    let request =
        OutputRequest { split_by_channel: true, ..points(Target::Directory(dir.path().join("new"))) };
    write(request, &survey(2, &[None, Some("s")]), &[batch(0, 0, 100), batch(1, 100, 20)]).unwrap();
    let names =
        ["leg000_points_devq0", "leg000_points_devq1", "strip00s_points_devq0", "strip00s_points_devq1"];
    assert_eq!(files(dir.path()), names.map(|n| format!("new/{n}.xyz")));
    let counts = names.map(|n| lines(dir.path().join(format!("new/{n}.xyz"))));
    assert_eq!(counts, [60, 40, 0, 20]);
    // With one device the option has no effect.
    let request =
        OutputRequest { split_by_channel: true, ..points(Target::File(dir.path().join("one.xyz"))) };
    write(request, &survey(1, &[None]), &[]).unwrap();
    assert!(dir.path().join("one.xyz").exists());
}

#[test]
fn a_single_file_takes_all_legs_and_products_stand_beside_it() {
    let dir = tempfile::tempdir().unwrap();
    let mut request = points(Target::File(dir.path().join("all.xyz")));
    request.waveforms = true;
    request.trajectory = Some((Target::File(dir.path().join("t.csv")), TrajectoryFormat::Csv));
    let summary = write(request, &survey(1, &[None, None]), &[batch(0, 0, 150), batch(1, 150, 150)]).unwrap();
    assert_eq!(files(dir.path()), ["all.xyz", "all_fullwave.txt", "t.csv"]);
    assert_eq!([lines(dir.path().join("all.xyz")), lines(dir.path().join("t.csv"))], [300, 4]);
    let all = &summary.files[0];
    assert_eq!((all.records, all.bytes), (300, fs::metadata(dir.path().join("all.xyz")).unwrap().len()));
    assert_eq!(all.by_return.iter().sum::<u64>(), 300);
    assert!(all.bounds.min.x > 499_000.0 && all.bounds.max.x < 501_200.0);
}

#[test]
fn a_file_has_its_name_only_when_it_is_complete() {
    let dir = tempfile::tempdir().unwrap();
    let survey = survey(1, &[None, None]);
    let plan = plan(points(Target::Directory(dir.path().into())), &survey);
    assert!(files(dir.path()).is_empty(), "a plan writes nothing");
    let mut writer = plan.open(Arc::new(NoOffload)).unwrap();
    let temporary = files(dir.path());
    assert!(temporary.len() == 2 && temporary.iter().all(|name| name.ends_with(".part")), "{temporary:?}");
    writer.append(plan.encode(&batch(0, 0, 10), None)).unwrap();
    writer.flush().unwrap();
    assert_eq!(lines(dir.path().join(&temporary[0])), 10);
    writer.append(plan.encode(&batch(1, 10, 10), None)).unwrap();
    assert_eq!(files(dir.path()), ["leg000_points.xyz", temporary[1].as_str()]);
    assert!(matches!(writer.append(plan.encode(&batch(0, 20, 10), None)), Err(Error::Internal(_))));
    writer.abort();
    assert_eq!(
        files(dir.path()),
        ["leg000_points.xyz"],
        "after a failure of the writer nothing partial is left"
    );
}

#[test]
fn what_was_measured_before_a_failure_is_kept_as_partial() {
    let dir = tempfile::tempdir().unwrap();
    let survey = survey(1, &[None, None, None]);
    let plan = plan(points(Target::Directory(dir.path().join("legs"))), &survey);
    let mut writer = plan.open(Arc::new(NoOffload)).unwrap();
    for leg in 0..2 {
        writer.append(plan.encode(&batch(leg, 0, 10), None)).unwrap();
    }
    writer.abort();
    assert_eq!(files(dir.path()), ["legs/leg000_points.xyz", "legs/leg001_points.partial.xyz"]);
    let partial_files = plan.partial_files();
    assert!(
        partial_files.len() == 1 && partial_files[0].partial && partial_files[0].records == 10,
        "{partial_files:?}"
    );
    // A run that measured nothing leaves nothing.
    let plan = self::plan(points(Target::Directory(dir.path().join("none"))), &survey);
    drop(plan.open(Arc::new(NoOffload)).unwrap());
    assert!(!dir.path().join("none").exists());
}

#[test]
fn an_output_that_cannot_be_completed_leaves_no_packets_and_others_are_kept() {
    let dir = tempfile::tempdir().unwrap();
    let mut request = points(Target::File(dir.path().join("b.xyz")));
    request.sinks.push((Target::File(dir.path().join("a.las")), PointFormat::Las));
    request.cloud.las.packets = Some(PacketPlace::Beside);
    let plan = plan(request, &survey(2, &[None, None]));
    let mut writer = plan.open(Arc::new(NoOffload)).unwrap();
    writer.append(plan.encode(&batch(0, 0, 10), None)).unwrap();
    // The next leg closes the handles of the last one.
    writer.append(plan.encode(&batch(1, 10, 0), None)).unwrap();
    let temporary = files(dir.path()).into_iter().find(|name| name.starts_with("a.las")).unwrap();
    fs::remove_file(dir.path().join(temporary)).unwrap();
    writer.abort();
    assert_eq!(files(dir.path()), ["b.partial.xyz"]);
    assert_eq!(plan.partial_files().len(), 1);
}

#[test]
fn an_abandoned_run_leaves_no_directory() {
    let dir = tempfile::tempdir().unwrap();
    let survey = survey(1, &[None]);
    let plan = plan(points(Target::Helios(dir.path().into())), &survey);
    let writer = plan.open(Arc::new(NoOffload)).unwrap();
    assert_eq!(writer.directories().count(), 1);
    drop(writer);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn files_are_not_overwritten_without_force() {
    let dir = tempfile::tempdir().unwrap();
    let survey = survey(1, &[None]);
    for name in ["a.xyz", "b.xyz", "b.xyz.part"] {
        fs::write(dir.path().join(name), "precious").unwrap();
    }
    let mut request = points(Target::File(dir.path().join("a.xyz")));
    request.sinks.push((Target::File(dir.path().join("b.xyz")), PointFormat::Xyz));
    request.sinks.push((Target::File(dir.path().join("missing/c.xyz")), PointFormat::Xyz));
    let context = OutputContext::new(&survey, &scene());
    let Err(Error::Input(problems)) = OutputPlan::new(request.clone(), &context) else { panic!("accepted") };
    assert_eq!(problems.items().len(), 3, "{}", problems.text());
    request.sinks.pop();
    request.force = true;
    write(request, &survey, &[batch(0, 0, 5)]).unwrap();
    assert_eq!(files(dir.path()), ["a.xyz", "b.xyz", "b.xyz.part"]);
    assert_eq!(lines(dir.path().join("a.xyz")), 5);
    assert_eq!(fs::read(dir.path().join("b.xyz.part")).unwrap(), b"precious");
}

#[test]
fn what_appears_during_the_run_is_not_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let survey = survey(1, &[None]);
    let plan = plan(points(Target::File(dir.path().join("a.xyz"))), &survey);
    let mut writer = plan.open(Arc::new(NoOffload)).unwrap();
    writer.append(plan.encode(&batch(0, 0, 5), None)).unwrap();
    fs::write(dir.path().join("a.xyz"), "precious").unwrap();
    assert!(matches!(writer.finish(), Err(Error::Io { .. })));
    assert_eq!(fs::read_to_string(dir.path().join("a.xyz")).unwrap(), "precious");
    assert_eq!(lines(dir.path().join("a.new.xyz")), 5, "the result stays under another name");
}

#[test]
fn requests_that_cannot_be_met() {
    let survey = survey(2, &[None]);
    let context = OutputContext::new(&survey, &scene());
    let refused = |request: OutputRequest, part: &str| {
        let Err(Error::Input(problems)) = OutputPlan::new(request, &context) else {
            panic!("accepted: {part}")
        };
        assert!(problems.headline().contains(part), "{}", problems.headline());
    };
    let stdout = points(Target::Stdout);
    refused(OutputRequest { waveforms: true, ..stdout.clone() }, "beside a file of points");
    refused(OutputRequest { split_by_channel: true, ..stdout.clone() }, "--split-by-channel needs files");
    let trajectory = Some((Target::File("/dev/stdout".into()), TrajectoryFormat::Csv));
    refused(OutputRequest { trajectory, ..stdout.clone() }, "only one output");
    let run = Some((Target::Helios("out".into()), TrajectoryFormat::Csv));
    refused(OutputRequest { trajectory: run, ..stdout }, "writes the trajectories itself");
    let dir = tempfile::tempdir().unwrap();
    let file = points(Target::File(dir.path().join("a.xyz")));
    refused(
        OutputRequest { sinks: [file.sinks.clone(), file.sinks.clone()].concat(), ..file },
        "two outputs",
    );
    let mut twice = points(Target::File(dir.path().join("a.xyz")));
    twice.sinks.push((Target::File(dir.path().join("./a.xyz")), PointFormat::Xyz));
    refused(twice.clone(), "two outputs");
    twice.sinks.pop();
    twice.companions.push(dir.path().join("a.xyz"));
    refused(twice, "two outputs");
    fs::write(dir.path().join("read.xyz"), "").unwrap();
    let mut source = points(Target::File(dir.path().join("read.xyz")));
    (source.force, source.inputs) = (true, vec![dir.path().join("./read.xyz")]);
    refused(source, "is read by this command");
    refused(points(Target::File(dir.path().into())), "is a directory");
    fs::write(dir.path().join("file"), "").unwrap();
    refused(points(Target::Directory(dir.path().join("file"))), "expected a directory");
    let run = points(Target::Helios(dir.path().into()));
    refused(
        OutputRequest { sinks: [run.sinks.clone(), run.sinks.clone()].concat(), ..run },
        "leg000_points.xyz",
    );
}

#[test]
fn chosen_columns_that_no_output_has_are_warned_of() {
    let (dir, survey) = (tempfile::tempdir().unwrap(), survey(1, &[None]));
    let warnings = |formats: &[PointFormat], columns: &[Column]| {
        let mut request = OutputRequest::default();
        let sink = |format: &PointFormat| (Target::File(dir.path().join(format.name())), *format);
        request.sinks = formats.iter().map(sink).collect();
        request.cloud.columns = Some(columns.to_vec());
        plan(request, &survey).warnings().text()
    };
    let (las, csv) = (PointFormat::Las, PointFormat::Csv);
    let said = warnings(&[las], &[Column::Path, Column::Subray, Column::HeightAboveGround]);
    assert!(said.contains("--columns: the outputs have no Subray, HeightAboveGround"), "{said}");
    assert!(said.contains("--height-above-ground"), "{said}");
    assert_eq!(warnings(&[las], &[Column::Path, Column::Range]), "");
    assert_eq!(warnings(&[las, csv], &[Column::Path, Column::Subray]), "");
}

#[test]
fn names_from_the_input_stay_in_their_folder() {
    let dir = tempfile::tempdir().unwrap();
    let mut survey = survey(1, &[Some("../x"), Some("")]);
    survey.name = "..".to_owned();
    write(points(Target::Helios(dir.path().into())), &survey, &[]).unwrap();
    let run = "_../2026-01-02_03-04-05";
    let names = [
        "strip..%2Fx_points.xyz",
        "strip..%2Fx_trajectory.txt",
        "strip00__points.xyz",
        "strip00__trajectory.txt",
    ];
    assert_eq!(files(dir.path()), names.map(|n| format!("{run}/{n}")));
}

#[test]
fn every_epoch_has_a_run_directory_and_files_are_continued() {
    let dir = tempfile::tempdir().unwrap();
    let survey = survey(1, &[None, None]);
    let mut request = points(Target::Helios(dir.path().join("runs")));
    request.sinks.push((Target::File(dir.path().join("all.xyz")), PointFormat::Xyz));
    let plan = plan(OutputRequest { epochs: 2, ..request }, &survey);
    let mut writer = plan.open(Arc::new(NoOffload)).unwrap();
    for epoch in 0..2 {
        for leg in 0..2 {
            writer.append(plan.encode(&batch(leg, 0, 10), None)).unwrap();
        }
        assert_eq!(writer.next_epoch().is_ok(), epoch == 0);
    }
    let summary = writer.finish().unwrap();
    assert_eq!((summary.directories.len(), summary.points), (2, 40));
    assert_eq!(lines(dir.path().join("all.xyz")), 40);
    let first = summary.directories[0].join("leg001_points.xyz");
    let second = summary.directories[1].join("leg001_points.xyz");
    assert_eq!([lines(first), lines(second)], [10, 10]);
}

#[cfg(target_os = "linux")]
#[test]
fn devices_and_pipes_are_written_as_they_are() {
    let survey = survey(1, &[None]);
    let full = write(points(Target::File("/dev/full".into())), &survey, &[batch(0, 0, 10)]);
    assert!(matches!(full, Err(Error::Io { path, .. }) if path == Path::new("/dev/full")));
    let summary = write(points(Target::File("/dev/null".into())), &survey, &[batch(0, 0, 10)]).unwrap();
    assert_eq!((summary.files[0].path.as_deref(), summary.points), (Some(Path::new("/dev/null")), 10));

    let (mut reader, pipe) = io::pipe().unwrap();
    let name = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&pipe));
    let plan = plan(points(Target::File(name.into())), &survey);
    let mut writer = plan.open(Arc::new(NoOffload)).unwrap();
    drop(pipe);
    writer.append(plan.encode(&batch(0, 0, 1), None)).unwrap();
    let mut line = [0; 40];
    reader.read_exact(&mut line).unwrap();
    assert!(line.starts_with(b"500000.2500 5400900.5000 300.1250 "), "a stream does not wait for its end");
    drop(reader);
    assert!(matches!(writer.append(plan.encode(&batch(0, 1, 1), None)), Err(Error::ClosedPipe)));
}

#[test]
fn batches_of_any_size_give_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let survey = survey(1, &[None]);
    let run = |name: &str, size: usize| {
        let batches: Vec<Batch> = (0..1000).step_by(size).map(|i| batch(0, i, size.min(1000 - i))).collect();
        let path = dir.path().join(name);
        write(points(Target::File(path.clone())), &survey, &batches).unwrap();
        fs::read(path).unwrap()
    };
    assert_eq!(run("a.xyz", 1000), run("b.xyz", 7));
}
