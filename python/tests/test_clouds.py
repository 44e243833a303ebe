"""What clouds are, their rasters, frames of driving, and the lines of plans."""

import json

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES

SQUARE = [(-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0)]


def test_facts_are_those_of_the_command(room, command, tmp_path):
    points = vlscan.run(room, seed=1).points
    points.write(tmp_path / "a.laz")
    done = command("info", tmp_path / "a.laz", "--json")
    found = vlscan.cloud_info(tmp_path / "a.laz")
    assert dict(found) == json.loads(done.stdout)
    assert str(found) == command("info", tmp_path / "a.laz").stdout.decode()
    # Positions in memory are not rounded.
    own = vlscan.cloud_info(points)
    assert own["points"] == found["points"] == len(points) and "CloudInfo of" in repr(own)
    assert np.allclose(own["bounds_m"]["min"], found["bounds_m"]["min"], atol=0.001)
    assert own["returns"] == found["returns"] and own["classes"] == found["classes"]
    both = vlscan.cloud_info(points, tmp_path / "a.laz")
    assert both["points"] == 2 * len(points) and len(both["files"]) == 2
    with pytest.raises(ValueError, match="no cloud"):
        vlscan.cloud_info()
    (tmp_path / "no.laz").write_bytes(b"LASF")
    with pytest.raises(vlscan.InputError):
        vlscan.cloud_info(tmp_path / "no.laz")


def test_rasters_are_those_of_the_command(forest, command, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    points = vlscan.run(forest, seed=1).points
    points.write(tmp_path / "a.laz")
    words = [word for name in ("dtm", "dsm", "pulse-density") for word in (f"--{name}", tmp_path / f"{name}.tif")]
    done = command("raster", tmp_path / "a.laz", "--cell", 2, *words)
    assert done.returncode == 0, done.stderr
    own = vlscan.raster(tmp_path / "a.laz", dtm=True, dsm=tmp_path / "own.tif", pulse_density=True, cell=2)
    assert list(own) == ["dtm", "dsm", "pulse_density"] and own.side_m == 2 and "dtm, dsm" in repr(own)
    assert (tmp_path / "own.tif").read_bytes() == (tmp_path / "dsm.tif").read_bytes()
    for name, values in own.items():
        with rasterio.open(tmp_path / f"{name.replace('_', '-')}.tif") as raster:
            # Rasters begin in the north.
            assert np.array_equal(raster.read(1), values[::-1].astype("float32"), equal_nan=True)
            assert (raster.bounds.left, raster.bounds.bottom) == own.corner
    assert abs(float(np.nansum(own["pulse_density"])) * 4 - (points["ReturnNumber"] == 1).sum()) < 0.5
    memory = vlscan.raster(points, dsm=True, cell=2, crs="EPSG:25832")
    assert memory["dsm"].shape == own["dsm"].shape and "25832" in (memory.crs or "")
    assert np.allclose(memory["dsm"], own["dsm"], atol=0.01, equal_nan=True)
    data = pytest.importorskip("xarray") and memory.to_xarray()
    assert data["dsm"].dims == ("y", "x") and float(data.x[1] - data.x[0]) == 2 and data.attrs["crs"] == memory.crs
    with pytest.raises(vlscan.Error, match=r"own\.tif"):
        vlscan.raster(points, dsm=tmp_path / "own.tif")
    for words, message in [({}, "at least one of dtm"), ({"dsm": "a.png"}, ".tif"), ({"dsm": "a.tif", "chm": "a.tif"}, "two rasters")]:
        with pytest.raises(ValueError, match=message):
            vlscan.raster(points, **words)


def test_frames_are_those_of_the_command(command, tmp_path):
    survey = FIXTURES / "street/spinning.xml"
    vlscan.run(survey, to=tmp_path / "a.mcap", seed=1)
    for layout in ("kitti", "nuscenes"):
        assert command("frames", tmp_path / "a.mcap", "-o", tmp_path / f"c_{layout}", "--layout", layout).returncode == 0
        counts = vlscan.write_frames(tmp_path / "a.mcap", tmp_path / f"own_{layout}", layout)
        assert counts.frames > 3 and counts.points > 1000
        expected = sorted(path.relative_to(tmp_path / f"c_{layout}") for path in (tmp_path / f"c_{layout}").rglob("*"))
        assert expected == sorted(path.relative_to(tmp_path / f"own_{layout}") for path in (tmp_path / f"own_{layout}").rglob("*"))
        for path in expected:
            own, other = tmp_path / f"own_{layout}" / path, tmp_path / f"c_{layout}" / path
            assert own.is_dir() or own.read_bytes() == other.read_bytes(), path
    points = vlscan.run(survey, seed=1, columns=vlscan.columns()).points
    assert vlscan.write_frames(points, tmp_path / "memory", "kitti") == vlscan.write_frames(tmp_path / "a.mcap", tmp_path / "file", "kitti")
    assert (tmp_path / "memory/sequences/00/poses.txt").read_bytes() == (tmp_path / "file/sequences/00/poses.txt").read_bytes()
    with pytest.raises(vlscan.InputError, match="exists"):
        vlscan.write_frames(tmp_path / "a.mcap", tmp_path / "own_kitti", "kitti")
    for words, message in [
        ({"layout": "waymo"}, "layout"),
        ({"forward": "z"}, "forward"),
        ({"sequence": 100}, "0 to 99"),
        ({"skewed_objects": True}, "needs objects"),
        ({"categories": {300: "Car"}}, "0 to 255"),
    ]:
        with pytest.raises(ValueError, match=message):
            vlscan.write_frames(tmp_path / "a.mcap", tmp_path / "b", **{"layout": "kitti", **words})


def test_lines_of_plans_are_those_of_the_command(command, tmp_path):
    moved = [(500_000 + x, 5_400_000 + y) for x, y in SQUARE]
    polygon = f"POLYGON (({', '.join(f'{x} {y}' for x, y in moved)}))"
    files = [tmp_path / f"c.{ending}" for ending in ("geojson", "kml", "csv")]
    words = [word for file in files for word in ("--lines", file)]
    flight = ["--scanner", "riegl_vux-1uav", "--height", 50, "--density", 5, "--area", polygon, "--crs", "EPSG:25832"]
    done = command("plan", "airborne", *flight, "-o", tmp_path / "plan.toml", *words)
    assert done.returncode == 0, done.stderr
    plan = vlscan.plan_airborne("riegl_vux-1uav", 50, density=5, area=moved, crs="EPSG:25832")
    for file in files:
        own = tmp_path / f"own{file.suffix}"
        plan.write_lines(own)
        assert own.read_bytes() == file.read_bytes(), file.suffix
    with pytest.raises(vlscan.Error, match="own.csv"):
        plan.write_lines(tmp_path / "own.csv")
    with pytest.raises(vlscan.InputError, match="geojson, .kml or .csv"):
        plan.write_lines(tmp_path / "own.shp")
    without = vlscan.plan_terrestrial("riegl_vz400", area=SQUARE, spacing=20)
    without.write_lines(tmp_path / "places.csv")
    with pytest.raises(vlscan.InputError, match="crs="):
        without.write_lines(tmp_path / "places.kml")
    assert all(len(line.vertices) == 1 and line.speed_m_per_s is None for line in without.lines)
    geopandas = pytest.importorskip("geopandas")
    frame, read = plan.to_geopandas(), geopandas.read_file(tmp_path / "own.geojson")
    assert len(frame) == len(read) == len(plan.lines) and frame.crs.to_epsg() == 25832
    assert frame.to_crs(4326).geometry.iloc[0].distance(read.geometry.iloc[0]) < 1e-8
    assert np.allclose(frame["length_m"], read["length_m"], atol=0.001) and list(frame["name"]) == list(read["name"])
    assert set(without.to_geopandas().geom_type) == {"Point"} and (without.to_geopandas()["length_m"] == 0).all()
