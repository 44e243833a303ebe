//! The files in `fixtures/` are what the generator writes: same options, same bytes, on every machine.
//!
//! After an intended change of the generator, `UPDATE_FIXTURES=1 cargo test fixtures::` writes them anew.

mod flight;

use flight::{FlightOptions, GridPlace, NAMES, flight_sbet, flight_text};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vlscan::geom::UtmZone;
use vlscan::tools::generate::{SceneKind, SceneOptions, write_scene};

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures")
}

fn options(kind: SceneKind) -> SceneOptions {
    let of = |triangles, pulses, extent| SceneOptions {
        pulses: Some(pulses),
        extent,
        overwrite: true,
        ..SceneOptions::new(kind, triangles)
    };
    match kind {
        SceneKind::Forest => of(4000, 60_000, None),
        SceneKind::Terrain => of(4000, 40_000, Some(240.0)),
        SceneKind::Room => of(1000, 40_000, None),
    }
}

fn files_of(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let file = |path: PathBuf| {
        (path.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(path).unwrap())
    };
    entries.map(|e| file(e.unwrap().path())).collect()
}

fn updating() -> bool {
    std::env::var_os("UPDATE_FIXTURES").is_some()
}

#[test]
fn scenes_are_what_the_generator_writes() {
    for kind in SceneKind::ALL {
        let kept = fixtures().join(kind.name());
        if updating() {
            write_scene(&options(kind), &kept).unwrap();
        }
        let folder = tempfile::tempdir().unwrap();
        write_scene(&options(kind), folder.path()).unwrap();
        let (kept, made) = (files_of(&kept), files_of(folder.path()));
        let names = |files: &BTreeMap<String, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&kept), names(&made), "{kind:?}");
        for (name, bytes) in &made {
            assert!(*bytes == kept[name], "fixtures/{}/{name} differs from what is made now", kind.name());
        }
    }
}

/// Compares a fixture with what is generated, or writes it anew.
fn check(name: &str, generated: Vec<u8>) {
    let kept = fixtures().join(name);
    if updating() {
        std::fs::write(&kept, &generated).unwrap();
    }
    assert!(std::fs::read(kept).unwrap() == generated, "fixtures/{name} differs");
}

#[test]
fn the_flights_are_what_the_generator_writes() {
    check("flight.csv", flight_text(&FlightOptions::default()));
    let options = FlightOptions { rate_hz: 50.0, duration_s: 10.0, ..FlightOptions::default() };
    let zone = UtmZone::parse("32N").unwrap();
    let place = GridPlace { zone, origin_m: [476_000.0, 5_429_000.0], height_m: 48.0 };
    check("airborne/flight.out", flight_sbet(&options, &place));
}

#[test]
fn a_flight_has_its_poses_in_order_and_no_jumps() {
    let text = String::from_utf8(flight_text(&FlightOptions::default())).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next().unwrap(), NAMES);
    let rows: Vec<Vec<f64>> = lines.map(|l| l.split(',').map(|f| f.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 4001);
    for pair in rows.windows(2) {
        let step = |i: usize| pair[1][i] - pair[0][i];
        assert!((step(0) - 0.005).abs() < 1e-9);
        assert!((1..4).all(|i| step(i).abs() < 0.2), "{pair:?}");
        assert!((4..7).all(|i| step(i).abs() < 1.0), "{pair:?}");
    }
}
