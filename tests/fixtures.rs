//! The files in `fixtures/` are what the generator writes: same options, same bytes, on every machine.
//!
//! After an intended change of the generator, `UPDATE_FIXTURES=1 cargo test --test fixtures` writes them anew.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vlscan::internals::UtmZone;
use vlscan::internals::{
    GeneratedFlight, GridPlace, Kind, SceneOptions, write_flight, write_sbet, write_scene,
};

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures")
}

fn options(kind: Kind) -> SceneOptions {
    let of = |triangles, pulses, extent_m| SceneOptions {
        pulses: Some(pulses),
        extent_m,
        overwrite: true,
        ..SceneOptions::new(kind, triangles)
    };
    match kind {
        Kind::Forest => of(4000, 60_000, None),
        Kind::Terrain => of(4000, 40_000, Some(240.0)),
        Kind::Room => of(1000, 40_000, None),
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
    for kind in Kind::ALL {
        let kept = fixtures().join(kind.name());
        if updating() {
            write_scene(&options(kind), &kept, |_| ()).unwrap();
        }
        let folder = tempfile::tempdir().unwrap();
        write_scene(&options(kind), folder.path(), |_| ()).unwrap();
        let (kept, made) = (files_of(&kept), files_of(folder.path()));
        let names = |files: &BTreeMap<String, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&kept), names(&made), "{kind:?}");
        for (name, bytes) in &made {
            assert!(*bytes == kept[name], "fixtures/{}/{name} differs from what is made now", kind.name());
        }
    }
}

#[test]
fn the_flight_is_what_the_generator_writes() {
    let kept = fixtures().join("flight.csv");
    if updating() {
        write_flight(&GeneratedFlight::default(), &kept).unwrap();
    }
    let folder = tempfile::tempdir().unwrap();
    let made = write_flight(&GeneratedFlight::default(), &folder.path().join("flight.csv")).unwrap();
    assert!(std::fs::read(kept).unwrap() == std::fs::read(made).unwrap(), "fixtures/flight.csv differs");
}

#[test]
fn the_geographic_flight_is_what_the_generator_writes() {
    let options = GeneratedFlight { rate_hz: 50.0, duration_s: 10.0, ..GeneratedFlight::default() };
    let zone = UtmZone::parse("32N").unwrap();
    let place = GridPlace { zone, origin_m: [476_000.0, 5_429_000.0], height_m: 48.0 };
    let kept = fixtures().join("airborne/flight.out");
    if updating() {
        write_sbet(&options, &place, &kept).unwrap();
    }
    let folder = tempfile::tempdir().unwrap();
    let made = write_sbet(&options, &place, &folder.path().join("flight.out")).unwrap();
    assert!(
        std::fs::read(kept).unwrap() == std::fs::read(made).unwrap(),
        "fixtures/airborne/flight.out differs"
    );
}
