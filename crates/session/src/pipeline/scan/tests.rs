//! Tests of scans.

use super::*;
use vlscan_survey::{Mesh, ReadOptions, find_platform, find_scanner};

fn floor() -> Mesh {
    let corners = [[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]];
    let corners = corners.map(|[x, y]| DVec3::new(x, y, 0.0)).into();
    Mesh::new(corners, vec![[0, 1, 2], [0, 2, 3]], Vec::new(), Vec::new()).unwrap()
}

fn scan() -> Scan {
    let (scanner, _) = find_scanner("vlp16", &ReadOptions::default()).unwrap();
    let turn = std::f64::consts::TAU;
    let scan = Scan::new(floor(), scanner).threads(2);
    scan.configure(|settings| (settings.head_rate, settings.head_stop) = (20.0 * turn, turn))
}

fn rows(batches: Batches) -> Vec<RecordBatch> {
    batches.map(|batch| batch.unwrap()).collect()
}

#[test]
fn stations_share_a_loaded_scene_and_seeds_decide() {
    let at = |scan: Scan| scan.station(DVec3::Z * 2.0).station(DVec3::new(3.0, 0.0, 2.0));
    let (session, outputs) = at(scan()).session().unwrap();
    let loaded = session.loaded().unwrap();
    let first = rows(session.into_batches(outputs, 1000));
    assert!(first.len() > 3 && first[..first.len() - 1].iter().all(|batch| batch.num_rows() == 1000));
    assert_eq!(first, rows(at(scan()).over(loaded.clone()).batches(1000).unwrap()));
    assert_ne!(first, rows(at(scan()).over(loaded).seed(1).batches(1000).unwrap()));
}

#[test]
fn paths_end_at_their_last_position_and_batches_can_be_dropped() {
    let (platform, _) = find_platform("vehicle_linearpath", &ReadOptions::default()).unwrap();
    let path = [DVec3::ZERO, DVec3::new(5.0, 0.0, 0.0)];
    let flight = scan().platform(platform).path(path, 10.0).configure(|settings| settings.head_stop = 0.0);
    let survey = flight.survey().unwrap();
    assert_eq!(survey.legs.iter().map(|leg| leg.scanner.active).collect::<Vec<_>>(), [true, false]);
    let mut batches = flight.batches(10).unwrap();
    assert_eq!(batches.next().unwrap().unwrap().num_rows(), 10);
    assert!(batches.report().is_none());
}

#[test]
fn batches_have_progress_and_a_stop_and_reports_have_the_warnings() {
    let mut batches = scan().station(DVec3::Z).batches(100).unwrap();
    batches.by_ref().take(15).for_each(drop);
    assert!(batches.progress().snapshot().pulses > 0);
    batches.stop();
    let rest = batches.by_ref().filter(|batch| batch.is_ok()).count();
    assert!(batches.report().is_some_and(|report| report.interrupted), "{rest} batches after the stop");
    let folder = tempfile::tempdir().unwrap();
    let turning = scan().configure(|settings| settings.head_stop = 100.0).station(DVec3::Z);
    let report = turning.output(folder.path().join("turns.xyz")).unwrap().run().unwrap();
    let warnings = report.warnings.text();
    assert!(warnings.contains("the head makes 15.9 turns"), "{warnings}");
}

#[test]
fn tables_may_have_other_columns_than_files() {
    use crate::output::Column;
    let folder = tempfile::tempdir().unwrap();
    let run = |name: &str, columns: Option<Vec<Column>>| {
        let scan = scan().station(DVec3::Z).outputs(|o| o.table_columns = columns);
        rows(scan.output(folder.path().join(name)).unwrap().batches(1_000_000).unwrap())
    };
    let (usual, own) = (run("a.xyz", None), run("b.xyz", Some(vec![Column::BeamOriginX, Column::X])));
    let names: Vec<String> = own[0].schema().fields().iter().map(|field| field.name().clone()).collect();
    assert_eq!(names, ["BeamOriginX", "X"]);
    assert!(own[0].num_rows() > 1000);
    assert_eq!(own[0].column_by_name("X"), usual[0].column_by_name("X"));
    let text = |name| std::fs::read_to_string(folder.path().join(name)).unwrap();
    assert_eq!(text("a.xyz"), text("b.xyz"));
}

#[test]
fn poses_of_a_table_are_followed() {
    use ::arrow_array::{ArrayRef, Float64Array, cast::AsArray, types::Float64Type};
    let column = |name, values: [f64; 3]| (name, Arc::new(Float64Array::from(values.to_vec())) as ArrayRef);
    let still = ["y", "roll", "pitch", "yaw"].map(|name| column(name, [0.0; 3]));
    let moving = [column("time", [0.0, 0.5, 1.0]), column("x", [0.0, 5.0, 10.0]), column("z", [2.0; 3])];
    let table = RecordBatch::try_from_iter(moving.into_iter().chain(still)).unwrap();
    let scan = scan().configure(|settings| settings.head_stop = 0.0).poses(&table).unwrap();
    let found = rows(
        scan.outputs(|o| o.cloud.columns = Some(vec![crate::output::Column::X])).batches(1_000_000).unwrap(),
    );
    let x = found[0]["X"].as_primitive::<Float64Type>().values();
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    assert!(x.len() > 10_000 && (mean - 5.0).abs() < 1.0, "{} points around x {mean}", x.len());
}

#[test]
fn numbers_outside_of_their_limits_are_refused() {
    let at = || scan().station(DVec3::Z);
    let path = |speed| scan().path([DVec3::Z, DVec3::new(1.0, 0.0, 1.0)], speed);
    let lasting = |seconds| at().configure(move |settings| settings.max_duration = Some(seconds));
    for (scan, expected) in [
        (at().threads(100_000), "--threads 100000: expected at most 1024"),
        (at().threads(0), "a schedule of 0 threads"),
        (path(0.0), "expected a speed above 0"),
        (path(-1.0), "expected a speed above 0"),
        (path(f64::NAN), "expected a speed above 0"),
        (lasting(0.0), "max_duration is 0 s"),
        (lasting(-1.0), "max_duration is -1 s"),
        (lasting(f64::NAN), "max_duration is NaN s"),
    ] {
        let Err(error) = scan.batches(10) else { panic!("{expected}") };
        assert!(error.to_string().contains(expected), "{error}");
    }
    assert!(at().batches(0).is_err());
    let error = at().run().unwrap_err().to_string();
    assert!(error.contains("no output"), "{error}");
    let (session, outputs) = at().session().unwrap();
    assert!(session.into_batches(outputs, 0).any(|batch| batch.is_err()));
}

#[test]
fn degrees_in_place_of_radians_are_warned_of() {
    let doubts = |change: fn(&mut ScannerSettings)| scan().configure(change).doubts();
    let turn = doubts(|settings| (settings.head_rate, settings.head_stop) = (3600.0, 360.0)).headline();
    assert_eq!(turn, "head_stop is 360 rad: the head makes 57.3 turns");
    let angle = doubts(|settings| settings.scan_angle = 30.0).headline();
    assert_eq!(angle, "scan_angle is 30 rad, more than half a turn to each side");
    let in_degrees = doubts(|settings| {
        settings.set_head_turn_deg(3600.0, 0.0, 3600.0);
        settings.set_scan_angle_deg(15.0);
    });
    assert!(in_degrees.is_empty());
}

#[test]
fn what_is_missing_is_named() {
    let nowhere = scan().run().unwrap_err().to_string();
    assert!(nowhere.contains("needs a station"), "{nowhere}");
    let unknown = scan().output("points.bmp").unwrap_err().to_string();
    assert!(unknown.contains("points.bmp") && unknown.contains("laz"), "{unknown}");
    let never_ends = find_scanner("vlp16", &ReadOptions::default()).unwrap().0;
    let found = Scan::new(floor(), never_ends).station(DVec3::Z).run();
    assert!(found.is_err(), "{found:?}");
}
