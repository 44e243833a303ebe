//! `vlscan info` and `vlscan raster`: counts by laspy, and cells computed with numpy from the points, read by
//! rasterio.

use crate::common::{self, feed, fixture, folder, judge, run, succeed, text};
use std::fs;
use std::path::Path;

/// The forest as LAZ, in a system and at its coordinates, and other formats.
fn scan(dir: &Path) {
    let survey = common::forest();
    let outputs = ["-o", "a.laz", "-o", "a.csv", "-o", "a.ply", "-o", "a.parquet", "-o", "a.copc.laz"];
    succeed(dir, &[&["run", &survey, "-q", "--crs", "EPSG:25832"][..], &outputs].concat());
}

#[test]
fn a_cloud_is_described_as_laspy_counts_it() {
    let Some(python) = common::python("laspy, lazrs, numpy") else { return };
    let dir = folder();
    scan(dir.path());
    for name in ["a.laz", "a.copc.laz", "a.csv", "a.ply", "a.parquet"] {
        let out = succeed(dir.path(), &["info", name, "--json"]);
        fs::write(dir.path().join(format!("{name}.json")), out.stdout).unwrap();
    }
    let script = r#"
import json, laspy, numpy as np
las = laspy.read("a.laz")
found = json.load(open("a.laz.json"))
assert found["points"] == len(las.points) and found["epsg"] == 25832
x, y, z = (np.asarray(v) for v in (las.x, las.y, las.z))
assert np.allclose(found["bounds_m"]["min"], [x.min(), y.min(), z.min()], atol=1e-6)
assert np.allclose(found["bounds_m"]["max"], [x.max(), y.max(), z.max()], atol=1e-6)
classes = {c["class"]: c["points"] for c in found["classes"]}
assert classes == {int(c): int(n) for c, n in zip(*np.unique(las.classification, return_counts=True))}
assert next(c["name"] for c in found["classes"] if c["class"] == 2) == "ground"
returns = {r["return"]: r["points"] for r in found["returns"]}
assert returns == {int(c): int(n) for c, n in zip(*np.unique(las.return_number, return_counts=True))}
firsts = las.return_number == 1
assert found["pulses"] == firsts.sum()
of = {r["returns"]: r["pulses"] for r in found["pulses_by_returns"]}
assert of == {int(c): int(n) for c, n in zip(*np.unique(las.number_of_returns[firsts], return_counts=True))}
lines = {l["point_source_id"]: l for l in found["flight_lines"]}
for source in np.unique(las.point_source_id):
    chosen = las.point_source_id == source
    assert lines[source]["points"] == chosen.sum()
    times = las.gps_time[chosen]
    assert lines[source]["time_s"] == {"min": times.min(), "max": times.max()}
assert len(lines) == len(np.unique(las.point_source_id))
assert found["time_kind"] == "GPS week" and found["time_s"]["max"] == las.gps_time.max()
angle = found["scan_angle_deg"]
assert np.allclose([angle["min"], angle["max"]], [las.scan_angle.min() * 0.006, las.scan_angle.max() * 0.006])
file = found["files"][0]
assert file["format"] == "LAZ" and file["las_version"] == "1.4" and file["point_format"] == las.header.point_format.id
# The smallest square cells that have ten points on average.
side = 0.25
while len(x) < 10 * len(np.unique(np.floor(np.column_stack([x, y]) / side), axis=0)):
    side *= 2
area = len(np.unique(np.floor(np.column_stack([x, y]) / side), axis=0)) * side * side
assert found["area_cell_m"] == side and found["area_m2"] == area
assert np.isclose(found["density_per_m2"], len(x) / area)
assert np.isclose(found["pulse_density_per_m2"], firsts.sum() / area)
formats = {"a.copc.laz": "COPC", "a.csv": "text", "a.ply": "PLY", "a.parquet": "Parquet"}
for name, format in formats.items():
    other = json.load(open(name + ".json"))
    assert other["files"][0]["format"] == format
    for key in ["points", "classes", "returns"]:
        assert other[key] == found[key], (name, key)
print(len(x))
"#;
    let count = judge(&python, dir.path(), script);
    let shown = text(&succeed(dir.path(), &["info", "a.laz"]).stdout);
    for part in [
        count.trim(),
        "EPSG:25832",
        "2 ",
        "ground",
        "LAZ 1.4",
        "pulses/m²",
        "flight lines",
        "of the GPS week",
    ] {
        assert!(shown.contains(part), "{part}: {shown}");
    }
    // Through a pipe, and two files as one.
    let csv = fs::read(dir.path().join("a.csv")).unwrap();
    let piped = text(&feed(dir.path(), &["info", "-"], &csv).stdout);
    assert!(piped.contains(count.trim()), "{piped}");
    let both = text(&succeed(dir.path(), &["info", "a.laz", "a.copc.laz", "--json"]).stdout);
    let both: serde_json::Value = serde_json::from_str(&both).unwrap();
    assert_eq!(both["points"].as_u64(), count.trim().parse::<u64>().ok().map(|count| 2 * count));
    let scene = run(dir.path(), &["info", fixture("forest/scene.xml").to_str().unwrap()]);
    assert!(
        !scene.status.success() && text(&scene.stderr).contains("vlscan scene info"),
        "{}",
        text(&scene.stderr)
    );
}

#[test]
fn rasters_are_those_of_numpy() {
    let Some(python) = common::python("laspy, lazrs, numpy, rasterio") else { return };
    let dir = folder();
    scan(dir.path());
    let rasters = [
        "--dtm",
        "dtm.tif",
        "--dsm",
        "dsm.tif",
        "--chm",
        "chm.tif",
        "--density",
        "d.tif",
        "--pulse-density",
        "p.tif",
    ];
    succeed(dir.path(), &[&["raster", "a.laz", "--cell", "0.5", "--fill", "3", "-q"][..], &rasters].concat());
    let script = r#"
import laspy, numpy as np, rasterio
las = laspy.read("a.laz")
x, y, z = (np.asarray(v) for v in (las.x, las.y, las.z))
side = 0.5
column, row = (np.floor(v / side).astype(int) for v in (x, y))
west, south, east, north = column.min(), row.min(), column.max() + 1, row.max() + 1
cell = (row - south) * (east - west) + column - west
shape = (north - south, east - west)
def read(name):
    with rasterio.open(name) as raster:
        assert raster.crs.to_epsg() == 25832 and raster.count == 1 and np.isnan(raster.nodata)
        assert raster.dtypes == ("float32",) and raster.res == (side, side)
        assert tuple(raster.bounds) == (west * side, south * side, east * side, north * side)
        return raster.read(1)[::-1].astype(float)
def counts(chosen):
    return np.bincount(cell[chosen], minlength=shape[0] * shape[1]).reshape(shape) / side**2
everything = np.ones(len(x), bool)
assert (read("d.tif") == counts(everything)).all()
assert (read("p.tif") == counts(las.return_number == 1)).all()
highest = np.full(shape[0] * shape[1], -np.inf)
np.maximum.at(highest, cell, z)
highest = np.where(np.isinf(highest), np.nan, highest).reshape(shape)
dsm = read("dsm.tif")
assert np.allclose(dsm, highest, atol=1e-4, equal_nan=True)
# The mean ground point of each cell, and the plane through the twelve that are nearest to the centre of a cell.
ground = las.classification == 2
number = np.bincount(cell[ground])
cells = np.flatnonzero(number)
mean = np.column_stack([np.bincount(cell[ground], v[ground])[cells] / number[cells] for v in (x, y, z)])
dtm = read("dtm.tif")
filled = np.isfinite(dtm)
rows, columns = np.nonzero(filled)
checked = np.random.default_rng(1).choice(len(rows), 400, replace=False)
planes = 0
for r, c in zip(rows[checked], columns[checked]):
    centre = np.array([(west + c + 0.5) * side, (south + r + 0.5) * side])
    square = ((mean[:, :2] - centre) ** 2).sum(1)
    near = np.argsort(square, kind="stable")[:12]
    assert square[near[0]] <= 9
    weight = (1 - square[near] / (1.2 * square[near[-1]])) ** 2
    offset = mean[near, :2] - centre
    middle = weight @ offset / weight.sum()
    spread = (weight @ (offset - middle) ** 2 / weight.sum()).sum()
    if middle @ middle > 1.5 * spread:
        expected = weight @ mean[near, 2] / weight.sum()
    else:
        a = np.column_stack([np.ones(len(near)), offset]) * np.sqrt(weight)[:, None]
        expected = np.linalg.lstsq(a, mean[near, 2] * np.sqrt(weight), rcond=None)[0][0]
        planes += 1
    assert abs(dtm[r, c] - expected) < 1e-3, (r, c, dtm[r, c], expected)
assert planes > 300
# Where ground points are there is terrain.
assert filled[counts(ground) > 0].all()
assert np.allclose(read("chm.tif"), dsm - dtm, atol=1e-4, equal_nan=True)
print(f"{np.nanmax(dsm - dtm):.1f}")
"#;
    let height: f64 = judge(&python, dir.path(), script).trim().parse().unwrap();
    assert!(height > 3.0, "{height}");
    // The same from a pipe to a pipe, and from other formats.
    let csv = fs::read(dir.path().join("a.csv")).unwrap();
    let args = ["raster", "-", "--density", "-", "--cell", "0.5", "--crs", "EPSG:25832", "-q"];
    let piped = feed(dir.path(), &args, &csv);
    assert_eq!(piped.stdout, fs::read(dir.path().join("d.tif")).unwrap());
}

#[test]
fn rasters_that_cannot_be_made_are_refused() {
    let dir = folder();
    scan(dir.path());
    fs::write(dir.path().join("b.xyz"), "1 2 3\n4 5 6\n").unwrap();
    let lasts = "x,y,z,return_number,number_of_returns\n1,2,3,2,2\n4,5,6,3,1\n";
    fs::write(dir.path().join("c.csv"), lasts).unwrap();
    let described = text(&succeed(dir.path(), &["info", "c.csv"]).stderr);
    assert!(described.contains("1 point with a return number beyond"), "{described}");
    for (args, expected) in [
        (&["raster", "a.laz"][..], "at least one of --dtm"),
        (&["raster", "a.laz", "--dtm", "a.png"], "ends in .tif"),
        (&["raster", "a.laz", "--dtm", "a.tif", "--chm", "a.tif"], "--dtm and --chm are both"),
        (&["raster", "a.laz", "--dsm", "a.tif", "--cell", "0.0001"], "--cell"),
        (&["raster", "b.xyz", "--dtm", "a.tif"], "no points of class 2"),
        (&["raster", "b.xyz", "--pulse-density", "a.tif"], "no return numbers; use --density"),
        (&["raster", "c.csv", "--pulse-density", "a.tif"], "no point is one; use --density"),
        (&["raster", "a.laz", "--dsm", "a.tif", "--crs", "EPSG:25833"], "one system"),
    ] {
        let out = run(dir.path(), args);
        assert_eq!(out.status.code(), Some(2), "{args:?}");
        assert!(text(&out.stderr).contains(expected), "{args:?}: {}", text(&out.stderr));
        assert!(!dir.path().join("a.tif").exists(), "{args:?}");
    }
    succeed(dir.path(), &["raster", "a.laz", "--dsm", "a.tif", "-q"]);
    let again = run(dir.path(), &["raster", "a.laz", "--dsm", "a.tif"]);
    assert!(!again.status.success() && text(&again.stderr).contains("--force"));
}

#[test]
fn clouds_that_are_named_twice_and_unused_options_are_told() {
    let dir = folder();
    let points = b"1 2 3\n4 5 6\n";
    for command in [&["info", "-", "-"][..], &["raster", "-", "-", "--dsm", "a.tif"], &["compare", "-", "-"]]
    {
        let out = feed(dir.path(), command, points);
        assert_eq!(out.status.code(), Some(2), "{command:?}");
        assert!(text(&out.stderr).contains("can be read only once"), "{command:?}: {}", text(&out.stderr));
    }
    fs::write(dir.path().join("b.xyz"), points).unwrap();
    let said = text(&succeed(dir.path(), &["raster", "b.xyz", "--dsm", "b.tif", "--fill", "5"]).stderr);
    assert!(said.contains("--fill has no effect"), "{said}");
    for command in [&["info", "b.xyz", "./b.xyz"][..], &["raster", "b.xyz", "./b.xyz", "--dsm", "a.tif"]] {
        let said = text(&succeed(dir.path(), command).stderr);
        assert!(said.contains("named twice"), "{command:?}: {said}");
    }
}
