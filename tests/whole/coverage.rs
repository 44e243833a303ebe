//! `vlscan run --dry-run --coverage`: closed forms over level ground, and cells of the whole run.

use crate::common::{feed, files, fixture, folder, judge, python, run, succeed, text};
use std::fs;
use std::path::Path;
use vlscan::{CoverageBand, CoverageMap, Options, Progress, ResolvedRun, RunContext, Session, Stop};

const MATERIALS: &str = "newmtl ground\nKd 1 1 1\nhelios_reflectance 0.5\nhelios_classification 2\nhelios_isGround true\n\
                         newmtl roof\nKd 1 1 1\nhelios_reflectance 0.5\nhelios_classification 6\n";

/// Height of the flight, m.
const HEIGHT: f64 = 100.0;
/// Pulses per metre of a flight line.
const PER_METRE: f64 = 400.0;
/// Angle between the ends of a scan line, rad.
const FIELD: f64 = std::f64::consts::PI / 3.0;

/// A level rectangle in OBJ.
fn rectangle(material: &str, [west, south]: [f64; 2], [east, north]: [f64; 2], z: f64) -> String {
    format!(
        "mtllib m.mtl\nusemtl {material}\nv {west} {south} {z}\nv {east} {south} {z}\nv {east} {north} {z}\n\
         v {west} {north} {z}\nf -4 -3 -2 -1\n"
    )
}

/// Lines to the east, 100 m long at 25 m/s, with 10 000 pulses and 20 scan lines of 60° per second.
fn pipeline(lines: &[f64]) -> String {
    let line = |(number, y): (usize, &f64)| {
        format!(
            "[[leg]]\nposition_m = [-50, {y}, {HEIGHT}]\nspeed_m_per_s = 25\nstrip = \"{number}\"\n\
             [[leg]]\nposition_m = [50, {y}, {HEIGHT}]\nspeed_m_per_s = 25\nactive = false\n"
        )
    };
    let legs: String = lines.iter().enumerate().map(line).collect();
    format!(
        "scene = \"g.obj\"\n[platform]\nkind = \"linear_path\"\nmount = {{ rotate_deg = [{{ x = -90 }}, {{ z = 90 }}] }}\n\
         [scanner]\nid = \"exact\"\noptics = \"rotating\"\npulse_freqs_hz = [10000]\nscan_angle_max_deg = 30\n\
         scan_angle_effective_max_deg = 30\nscan_freq_min_hz = 1\nscan_freq_max_hz = 100\nwavelength_nm = 1064\n\
         beam_divergence_rad = 0.0001\npulse_length_ns = 4\nvisibility_km = 100000\naccuracy_m = 0\n\
         range_min_m = 0.5\nrange_max_m = 1000\n[settings]\npulse_freq_hz = 10000\nscan_freq_hz = 20\n\
         [waveform]\nquality = 1\n{legs}"
    )
}

/// The files of a flight over level ground and what else is in `meshes`.
fn write(dir: &Path, meshes: &[String], lines: &[f64]) {
    let ground = rectangle("ground", [-200.0; 2], [200.0; 2], 0.0);
    fs::write(dir.join("g.obj"), ground + &meshes.concat()).unwrap();
    fs::write(dir.join("m.mtl"), MATERIALS).unwrap();
    fs::write(dir.join("p.toml"), pipeline(lines)).unwrap();
}

fn session(dir: &Path) -> Session {
    let (job, _) = ResolvedRun::resolve(&dir.join("p.toml"), &Options::default()).unwrap();
    Session::open(job.settings, |_| ()).unwrap()
}

fn coverage(meshes: &[String], lines: &[f64]) -> CoverageMap {
    let dir = folder();
    write(dir.path(), meshes, lines);
    session(dir.path()).coverage(10.0, RunContext::new(&Progress::default(), &Stop::new())).unwrap()
}

/// Mean of a band over the cells from x = -40 to 40 whose southern side is at y.
fn mean(map: &CoverageMap, band: CoverageBand, y: f64) -> f64 {
    let cells = map.values(band).iter().enumerate().map(|(i, value)| (map.centre(i), *value));
    let row: Vec<f64> = cells
        .filter(|([x, at], _)| x.abs() < 40.0 && (at - y - 5.0).abs() < 0.1)
        .map(|(_, value)| value)
        .collect();
    assert_eq!(row.len(), 8, "y = {y}");
    row.iter().sum::<f64>() / 8.0
}

/// Share of the pulses of a line that meet the ground from y to y + 10 beside it.
fn share(y: f64) -> f64 {
    (((y + 10.0) / HEIGHT).atan() - (y / HEIGHT).atan()) / FIELD
}

#[test]
fn densities_strips_and_angles_over_level_ground_are_those_of_the_formulas() {
    let map = coverage(&[], &[0.0, 60.0]);
    assert!(map.sampled_pulses.abs_diff(80_000) < 5, "{}", map.sampled_pulses);
    for y in [-40.0, -10.0, 10.0, 30.0, 40.0, 60.0, 90.0] {
        let lines: Vec<f64> = [y, y - 60.0].into_iter().filter(|off| (-57.0..47.0).contains(off)).collect();
        // Pulses per metre × share, over the width of a cell.
        let expected: f64 = lines.iter().map(|off| PER_METRE * share(*off) / 10.0).sum();
        for band in [CoverageBand::PulseDensity, CoverageBand::PointDensity] {
            let found = mean(&map, band, y);
            assert!((found / expected - 1.0).abs() < 0.03, "{band:?} at {y}: {found}, expected {expected}");
        }
        assert_eq!(mean(&map, CoverageBand::Strips, y), lines.len() as f64, "{y}");
        assert_eq!((mean(&map, CoverageBand::Gaps, y), mean(&map, CoverageBand::Occlusion, y)), (0.0, 0.0));
    }
    let found = mean(&map, CoverageBand::Incidence, -30.0);
    let expected = (25.0 / HEIGHT).atan().to_degrees();
    assert!((found - expected).abs() < 0.3, "{found}, expected {expected}");
    // Beyond the swaths, which end 57.7 m beside the lines, half of a cell is empty.
    let last = mean(&map, CoverageBand::Gaps, -60.0);
    assert!((0.0..=0.5).contains(&last), "{last}");
    let pulses: f64 = map.values(CoverageBand::PulseDensity).iter().map(|density| density * 100.0).sum();
    assert!((pulses - map.sampled_pulses as f64).abs() < 1.0, "{pulses}");
}

#[test]
fn a_roof_hides_the_ground_behind_it() {
    // From y = 20 to 40 and 20 m high: its shadow lies from 25 to 50.
    let roof = rectangle("roof", [-60.0, 20.0], [60.0, 40.0], 20.0);
    let map = coverage(&[roof], &[0.0]);
    let occlusion = |y: f64| mean(&map, CoverageBand::Occlusion, y);
    assert_eq!([-30.0, 0.0, 10.0, 30.0, 40.0].map(occlusion), [0.0, 0.0, 0.0, 1.0, 1.0]);
    let expected = (0.3f64.atan() - 0.25f64.atan()) / (0.3f64.atan() - 0.2f64.atan());
    assert!((occlusion(20.0) - expected).abs() < 0.05, "{}", occlusion(20.0));
    // Pulses are counted where they return: on the roof, but not in its shadow.
    let pulses = |y: f64| mean(&map, CoverageBand::PulseDensity, y);
    assert!(pulses(30.0) > 3.5 && pulses(40.0) == 0.0, "{} {}", pulses(30.0), pulses(40.0));
    // Without ground nothing is aimed at it.
    let dir = folder();
    write(dir.path(), &[], &[0.0]);
    fs::write(dir.path().join("m.mtl"), MATERIALS.replace("helios_isGround true", "")).unwrap();
    let map =
        session(dir.path()).coverage(10.0, RunContext::new(&Progress::default(), &Stop::new())).unwrap();
    assert!(map.values(CoverageBand::Occlusion).iter().all(|value| value.is_nan()));
}

#[test]
fn sampled_flights_have_the_densities_of_the_formulas() {
    let dir = folder();
    // From y = 20 to 40 and 20 m high: its shadow lies from 25 to 50.
    write(dir.path(), &[rectangle("roof", [-60.0, 20.0], [60.0, 40.0], 20.0)], &[0.0]);
    // 1.6 million pulses in lines of 4000, of which one in a few is measured.
    let rates = [
        ("pulse_freqs_hz = [10000]", "pulse_freqs_hz = [400000]"),
        ("pulse_freq_hz = 10000", "pulse_freq_hz = 400000"),
        ("scan_freq_hz = 20\n", "scan_freq_hz = 100\n"),
    ];
    let text = rates.iter().fold(pipeline(&[0.0]), |text, (from, to)| text.replace(from, to));
    fs::write(dir.path().join("p.toml"), text).unwrap();
    let map =
        session(dir.path()).coverage(10.0, RunContext::new(&Progress::default(), &Stop::new())).unwrap();
    assert!((250_000..600_000).contains(&map.sampled_pulses), "{}", map.sampled_pulses);
    let density = |share: f64| 16_000.0 * share / 10.0;
    let roof = ((40.0f64 / 80.0).atan() - (30.0f64 / 80.0).atan()) / FIELD;
    let cells = [(-50.0, share(-50.0)), (-30.0, share(-30.0)), (0.0, share(0.0)), (30.0, roof)];
    for (y, share) in cells {
        for band in [CoverageBand::PulseDensity, CoverageBand::PointDensity] {
            let (found, expected) = (mean(&map, band, y), density(share));
            assert!((found / expected - 1.0).abs() < 0.005, "{band:?} at {y}: {found}, expected {expected}");
        }
    }
    // The edges of roof and shadow are found between measured pulses.
    let shadow = mean(&map, CoverageBand::PulseDensity, 40.0);
    assert!(shadow < 0.01 * density(share(40.0)), "{shadow}");
    let occlusion = |y: f64| mean(&map, CoverageBand::Occlusion, y);
    assert!(occlusion(40.0) > 0.99 && occlusion(0.0) < 0.01, "{} {}", occlusion(40.0), occlusion(0.0));
    let expected = (0.3f64.atan() - 0.25f64.atan()) / (0.3f64.atan() - 0.2f64.atan());
    assert!((occlusion(20.0) - expected).abs() < 0.02, "{}", occlusion(20.0));
}

#[test]
fn files_are_the_same_for_any_number_of_threads() {
    let dir = folder();
    write(dir.path(), &[], &[0.0, 60.0]);
    for threads in ["1", "3"] {
        let names = ["c", "p"].map(|name| format!("{name}{threads}"));
        let [raster, picture] = [format!("{}.tif", names[0]), format!("{}.png", names[1])];
        let args =
            ["run", "p.toml", "--dry-run", "-j", threads, "--coverage", &raster, "--coverage", &picture];
        let out = succeed(dir.path(), &args);
        assert!(text(&out.stdout).contains("pulses"), "the forecast is printed, too");
        let said = text(&out.stderr);
        assert!(said.contains("cells of 10 m") && said.contains("median"), "{said}");
    }
    for (one, three) in [("c1.tif", "c3.tif"), ("p1.png", "p3.png")] {
        let read = |name: &str| fs::read(dir.path().join(name)).unwrap();
        assert!(read(one) == read(three), "{one}");
    }
    assert!(fs::read(dir.path().join("p1.png")).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn requests_that_cannot_be_met_are_refused_before_anything_is_written() {
    let dir = folder();
    write(dir.path(), &[], &[0.0]);
    fs::write(dir.path().join("mine.tif"), "mine").unwrap();
    let before = files(dir.path()).len();
    for (args, expected) in [
        (&["--coverage", "a.tif"][..], "--dry-run"),
        (&["--dry-run", "--coverage", "a.txt"], "ends in .tif or .png"),
        (&["--dry-run", "--coverage", "-"], "ends in .tif or .png"),
        (&["--dry-run", "--coverage", "a.tif", "--coverage", "a.tif"], "given twice"),
        (&["--dry-run", "--coverage", "mine.tif"], "mine.tif exists"),
        (&["--dry-run", "--coverage", "maps/a.tif"], "maps is not a directory"),
        (&["--dry-run", "--coverage-cell", "5"], "--coverage"),
        (&["--dry-run", "--coverage", "a.tif", "--coverage-cell", "0"], "0"),
        (&["--dry-run", "--coverage", "a.tif", "--coverage-cell", "nan"], "nan"),
        (&["--dry-run", "--coverage", "a.tif", "--coverage-cell", "0.001"], "expected 0.01 to 100000 m"),
        (&["--dry-run", "--coverage", "a.tif", "--coverage-cell", "0.01"], "too many cells"),
        (&["--dry-run", "--coverage", "a.tif", "--coverage-cell", "1e9"], "expected 0.01 to 100000 m"),
    ] {
        let out = run(dir.path(), &[&["run", "p.toml"][..], args].concat());
        let said = text(&out.stderr);
        assert!(out.status.code() == Some(2) && said.contains(expected), "{args:?}: {said}");
        assert_eq!(files(dir.path()).len(), before, "{args:?}");
    }
    let poses = b"time_s,x,y,z,roll,pitch,yaw\n0,0,0,100,0,0,0\n1,10,0,100,0,0,0\n";
    let out =
        feed(dir.path(), &["run", "p.toml", "--trajectory", "-", "--dry-run", "--coverage", "a.tif"], poses);
    assert!(
        out.status.code() == Some(2) && text(&out.stderr).contains("as a stream"),
        "{}",
        text(&out.stderr)
    );
    assert_eq!(files(dir.path()).len(), before);
    assert_eq!(fs::read(dir.path().join("mine.tif")).unwrap(), b"mine");
}

/// Compares `c.tif` with `p.tif` and `d.tif`, the rasters of the points of the whole run. `quantiles` are the
/// largest deviations of half and of 95 % of the cells.
fn compare(python: &Path, dir: &Path, quantiles: [f64; 2]) {
    let script = format!(
        r#"
import numpy as np, rasterio
with rasterio.open("c.tif") as c:
    names = ("pulse_density", "point_density", "strips", "gaps", "incidence_deg", "occlusion")
    assert c.count == 6 and c.descriptions == names and c.dtypes == ("float32",) * 6 and c.res == (10, 10)
    for band, name in ((1, "p.tif"), (2, "d.tif")):
        with rasterio.open(name) as run:
            west, north = ((run.bounds.left - c.bounds.left) / 10, (c.bounds.top - run.bounds.top) / 10)
            # Noise puts some points beyond the scene.
            assert west >= -1 and north >= -1 and west == int(west) and north == int(north)
            west, north = int(west) + 1, int(north) + 1
            full = run.read(1).astype(float)
            rows, columns = full.shape
            found = np.pad(c.read(band), 2)[1:, 1:][north:north + rows, west:west + columns]
            # Cells at the edge of the scene are not whole.
            inner = full > 0.5 * np.median(full)
            inner[[0, -1]] = inner[:, [0, -1]] = False
            off = np.abs(found[inner] / full[inner] - 1)
            assert inner.sum() > 20 and abs(found.sum() / full.sum() - 1) < 0.01
            assert np.median(off) <= {} and np.quantile(off, 0.95) <= {}, (name, np.quantile(off, [0.5, 0.95]))
"#,
        quantiles[0], quantiles[1]
    );
    judge(python, dir, &script);
}

#[test]
fn a_short_flight_is_covered_as_by_its_points() {
    let Some(python) = python("numpy, rasterio") else { return };
    let dir = folder();
    let survey = fixture("terrain/survey.xml");
    let survey = survey.to_str().unwrap();
    succeed(dir.path(), &["run", survey, "-o", "a.laz", "-q"]);
    succeed(dir.path(), &["run", survey, "-q", "--dry-run", "--coverage", "c.tif"]);
    let rasters = ["--pulse-density", "p.tif", "--density", "d.tif"];
    succeed(dir.path(), &[&["raster", "a.laz", "--cell", "10", "-q"][..], &rasters].concat());
    // All pulses are measured; LAZ rounds coordinates.
    compare(&python, dir.path(), [1e-5, 0.02]);
}

#[test]
#[ignore = "minutes; part of `.ci/run --long`"]
fn a_long_flight_is_covered_as_by_its_points() {
    let Some(python) = python("numpy, rasterio") else { return };
    let dir = folder();
    succeed(dir.path(), &["scene", "make", "terrain", "-o", "t", "-n", "200k", "--extent", "600", "-q"]);
    let scanner = ["--scanner", "riegl_lms-q780", "--pulse-rate", "400000", "--scene", "t/scene.xml"];
    let flight = ["--height", "300", "--density", "30", "--overlap", "40", "-o", "p.toml", "-q"];
    succeed(dir.path(), &[&["plan", "airborne"][..], &scanner, &flight].concat());
    succeed(dir.path(), &["run", "p.toml", "-o", "a.laz", "-q"]);
    succeed(dir.path(), &["run", "p.toml", "-q", "--dry-run", "--coverage", "c.tif"]);
    let rasters = ["--pulse-density", "p.tif", "--density", "d.tif"];
    succeed(dir.path(), &[&["raster", "a.laz", "--cell", "10", "-q"][..], &rasters].concat());
    compare(&python, dir.path(), [0.005, 0.02]);
}

#[test]
fn plans_have_their_density_in_the_cells() {
    let dir = folder();
    let ground = rectangle("ground", [-500.0; 2], [500.0; 2], 0.0);
    fs::write(dir.path().join("g.obj"), ground).unwrap();
    fs::write(dir.path().join("m.mtl"), MATERIALS).unwrap();
    let area = "POLYGON ((-100 -60, 100 -60, 100 60, -100 60))";
    let plan = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--scene", "g.obj", "--area", area];
    let flight = ["--height", "60", "--overlap", "10", "-o", "p.toml", "-q"];
    let least = ["--min-density", "8", "--min-share", "98"];
    succeed(dir.path(), &[&plan[..], &flight, &least].concat());
    let text_of_plan = fs::read_to_string(dir.path().join("p.toml")).unwrap();
    assert!(text_of_plan.contains("% of the cells of 10 m have at least 8 pulses/m²"), "{text_of_plan}");
    let points = text(&succeed(dir.path(), &["run", "p.toml", "-o", "-", "--format", "xyz", "-q"]).stdout);
    let mut counts = [[0u32; 20]; 12];
    for line in points.lines() {
        let place: Vec<f64> = line.split(' ').take(2).map(|word| word.parse().unwrap()).collect();
        if place[0].abs() < 100.0 && place[1].abs() < 60.0 {
            counts[((place[1] + 60.0) / 10.0) as usize][((place[0] + 100.0) / 10.0) as usize] += 1;
        }
    }
    // Cells of 10 m have some lines more or fewer than their neighbours.
    let dense = counts.iter().flatten().filter(|count| f64::from(**count) >= 0.96 * 800.0).count();
    assert!(dense as f64 >= 0.97 * 240.0, "{dense} of 240");
    for (more, expected) in [
        (["--density", "5"], "cannot be used with"),
        (["--min-cell", "400"], "no cell of 400 m lies within the area"),
        (["--min-share", "101"], "percent from 0 to 100"),
    ] {
        let out = run(dir.path(), &[&plan[..], &flight, &least[..2], &more, &["--force"]].concat());
        let said = text(&out.stderr);
        assert!(out.status.code() == Some(2) && said.contains(expected), "{more:?}: {said}");
    }
}

#[test]
fn corridors_are_covered_round_their_bends() {
    let dir = folder();
    let ground = rectangle("ground", [-500.0; 2], [1000.0; 2], 0.0);
    fs::write(dir.path().join("g.obj"), ground).unwrap();
    fs::write(dir.path().join("m.mtl"), MATERIALS).unwrap();
    let corridor = ["--area", "LINESTRING (0 0, 300 0, 500 150)", "--buffer", "40", "--follow-line"];
    let plan = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--scene", "g.obj", "--height", "60"];
    let flight = ["--density", "10", "--overlap", "30", "-o", "p.toml", "-q"];
    succeed(dir.path(), &[&plan[..], &corridor, &flight].concat());
    let points = text(&succeed(dir.path(), &["run", "p.toml", "-o", "-", "--format", "xyz", "-q"]).stdout);
    // The distance of a place from the line.
    let off = |[x, y]: [f64; 2]| {
        let piece = |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| {
            let (wx, wy) = (bx - ax, by - ay);
            let t = (((x - ax) * wx + (y - ay) * wy) / (wx * wx + wy * wy)).clamp(0.0, 1.0);
            (x - ax - t * wx).hypot(y - ay - t * wy)
        };
        piece([0.0, 0.0], [300.0, 0.0]).min(piece([300.0, 0.0], [500.0, 150.0]))
    };
    let mut cells = std::collections::HashMap::new();
    let mut inside = 0.0;
    for line in points.lines() {
        let place: Vec<f64> = line.split(' ').take(2).map(|word| word.parse().unwrap()).collect();
        if off([place[0], place[1]]) <= 40.0 {
            inside += 1.0;
            *cells.entry([place[0], place[1]].map(|c| (c / 10.0).floor() as i32)).or_insert(0) += 1;
        }
    }
    // 550 m of line with two half circles; at the corner the sides overlap a little.
    let density = inside / (2.0 * 40.0 * 550.0 + std::f64::consts::PI * 1600.0 - 18.0);
    assert!((density / 10.0 - 1.0).abs() < 0.06, "{density}");
    for (x, y) in (-4..54).flat_map(|x| (-4..19).map(move |y| (x, y))) {
        let corners =
            [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, k)| [x + i, y + k].map(|c| 10.0 * f64::from(c)));
        if corners.into_iter().all(|corner| off(corner) <= 40.0) {
            let count = cells.get(&[x, y]).copied().unwrap_or(0);
            assert!(count > 350, "{count} points at {x}, {y}");
        }
    }
    let straight = ["--follow-line", "--heading", "20"];
    let out = run(dir.path(), &[&plan[..], &corridor[..4], &straight, &flight, &["--force"]].concat());
    assert!(out.status.code() == Some(2) && text(&out.stderr).contains("cannot be used with"));
    let out =
        run(dir.path(), &[&plan[..], &corridor[..2], &["--follow-line"], &flight, &["--force"]].concat());
    assert!(out.status.code() == Some(2) && text(&out.stderr).contains("--buffer"));
}
