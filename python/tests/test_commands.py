"""What the command line has: forecasts, flights without tracing, shares of runs, scenes that are made, pictures, the catalogue."""

import json
import sys
import types

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES
from vlscan import Part, Scene, Survey

SQUARE = [(-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0)]
FLAT = "v -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\nf 1 2 3\nf 1 3 4\n"


def flat():
    """A plane in memory."""
    return Part.mesh([[-50, -50, 0], [50, -50, 0], [50, 50, 0], [-50, 50, 0]], [[0, 1, 2, 3]])


def test_forecasts_are_those_of_the_command(room, command, tmp_path):
    done = command("run", room, "--dry-run", "--json", "--seed", 1, "-o", tmp_path / "room.laz")
    expected = json.loads(done.stdout)
    found = vlscan.dry_run(room, to=tmp_path / "room.laz", seed=1)
    assert [leg.pulses for leg in found.legs] == [leg["pulses"] for leg in expected["legs"]]
    assert found.points.value == expected["points"]["value"] and float(found.points) == found.points.value
    assert found.files[0].bytes == expected["files"][0]["bytes"]
    assert found.files[0].content == "points" and found.files[0].bytes > 1000 and not (tmp_path / "room.laz").exists()
    assert vlscan.dry_run(room).files == [] and "2 legs" in repr(found) and len(found.to_pandas()) == 2
    survey = Survey(flat(), "vlp16", [vlscan.Leg((0, 0, 5), head_rate_deg_per_s=3600, head_stop_deg=3600)])
    assert survey.dry_run(seed=1).missed.pulses > 0.3
    with pytest.raises(vlscan.InputError):
        vlscan.dry_run("nothing.xml")


def test_flights_are_those_of_the_command(command, tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    terrain = FIXTURES / "terrain/survey.xml"
    for name, words, own in [
        ("trajectory", ["--interval", "0.5"], vlscan.trajectory(terrain, 0.5, seed=3)),
        ("pulses", [], vlscan.pulses(terrain, seed=3)),
    ]:
        done = command(name, terrain, "--seed", 3, "--format", "arrow", *words)
        assert done.returncode == 0, done.stderr
        expected = pyarrow.ipc.open_stream(done.stdout).read_all()
        assert own.columns == expected.column_names and own.to_arrow().equals(expected)
    # What was flown is flown and traced again.
    traced = vlscan.trace(FIXTURES / "terrain/scene.xml", pulses=vlscan.pulses(terrain, seed=3), scanner=own_scanner(terrain), seed=3)
    assert abs(traced.point_count / vlscan.run(terrain, seed=3).point_count - 1) < 0.01
    poses = vlscan.trajectory(terrain, 0.1)
    again = Survey(
        FIXTURES / "terrain/scene.xml",
        own_scanner(terrain),
        trajectory=poses,
        settings={"scan_freq_hz": 50, "scan_angle_deg": 20},
        platform=own_platform(terrain),
    )
    assert again.run(seed=1).point_count > 1000


def own_scanner(path):
    """The scanner of a survey of the fixtures."""
    return f"{path.parent / 'scanners.xml'}#als_oscillating"


def own_platform(path):
    """The platform of a survey of the fixtures, with the mount of its scanner."""
    return f"{path.parent / 'platforms.xml'}#plane"


def test_shards_are_those_of_one_run(room, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert vlscan.index_shards(room, tmp_path / "shards", seed=5) == vlscan.run(room, seed=5).pulse_count
    survey = Survey.open(room)
    files = [vlscan.run_shard(survey, tmp_path / "shards", number, 3, seed=5) for number in range(3)]
    assert all(file.exists() for file in files)
    vlscan.check_shards(tmp_path / "shards")
    merged, whole = vlscan.merge_shards(tmp_path / "shards"), vlscan.run(room, seed=5)
    assert merged.files == [] and not (tmp_path / "output").exists()
    assert merged.points.to_numpy().tobytes() == whole.points.to_numpy().tobytes() and merged.pulse_count == whole.pulse_count
    done = vlscan.merge_shards(tmp_path / "shards", to=[tmp_path / "a.laz", tmp_path / "a.e57"], threads=1)
    vlscan.run(room, to=[tmp_path / "b.laz", tmp_path / "b.e57"], seed=5)
    assert len(done.files) == 2
    for ending in ("laz", "e57"):
        assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()
    merged.points.write(tmp_path / "c.laz")
    assert (tmp_path / "c.laz").read_bytes() == (tmp_path / "b.laz").read_bytes()
    before = files[0].stat().st_mtime_ns
    assert vlscan.run_shard(survey, tmp_path / "shards", 0, 3, resume=True, seed=5) == files[0]
    assert files[0].stat().st_mtime_ns == before
    for wrong in (dict(seed=5), dict(seed=6, resume=True)):
        with pytest.raises(vlscan.InputError):
            vlscan.run_shard(survey, tmp_path / "shards", 0, 3, **wrong)
    with pytest.raises(vlscan.InputError, match="heights above ground need the scene"):
        vlscan.run_shard(survey, tmp_path / "high", 0, 3, height_above_ground=True)
    with pytest.raises(ValueError, match="0 to 2"):
        vlscan.run_shard(survey, tmp_path / "shards", 3, 3)
    files[1].write_bytes(files[1].read_bytes()[:-100])
    with pytest.raises(vlscan.InputError):
        vlscan.check_shards(tmp_path / "shards")


def test_merged_points_in_memory_have_the_times_of_files(tmp_path):
    street = FIXTURES / "street/spinning.xml"
    for number in range(2):
        vlscan.run_shard(street, tmp_path / "shards", number, 2, seed=5)
    run = vlscan.run(street, seed=5).points
    columns = [*run.columns, *(f"{name}{axis}" for name in ("BeamOrigin", "BeamDirection", "Scanner") for axis in "XYZ")]
    merged = vlscan.merge_shards(tmp_path / "shards", columns=columns).points
    merged.write(tmp_path / "merged.mcap")
    vlscan.Points.concat([merged[:1000], merged[1000:]]).write(tmp_path / "joined.mcap")
    vlscan.run(street, seed=5, columns=columns).points.write(tmp_path / "run.mcap")
    vlscan.merge_shards(tmp_path / "shards", to=tmp_path / "file.mcap")
    expected = (tmp_path / "file.mcap").read_bytes()
    assert all((tmp_path / f"{name}.mcap").read_bytes() == expected for name in ("merged", "joined", "run"))
    # A run without widths of echoes has other values beside its columns than its shards.
    assert len(vlscan.Points.concat([vlscan.merge_shards(tmp_path / "shards").points, run])) == 2 * len(run)


def test_scenes_are_made(command, tmp_path):
    made = vlscan.make_scene("forest", tmp_path / "own", triangles=3000, seed=2, pulses=20_000, separate_trees=True)
    assert (
        command(
            "scene", "make", "forest", "-n", "3000", "--seed", 2, "--pulses", "20k", "--separate-trees", "-o", tmp_path / "c"
        ).returncode
        == 0
    )
    for file in (tmp_path / "c").rglob("*.*"):
        assert (made.folder / file.relative_to(tmp_path / "c")).read_bytes() == file.read_bytes()
    assert abs(made.triangles / 3000 - 1) < 0.05 and made.scene.primitives == made.triangles
    assert 5000 < made.survey.run(seed=1).point_count < 60_000
    with pytest.raises(vlscan.InputError, match="exist"):
        vlscan.make_scene("forest", tmp_path / "own", triangles=3000)
    with pytest.raises(ValueError, match="forest, terrain, room"):
        vlscan.make_scene("jungle", tmp_path / "other")


def test_stands_are_made_of_tables(command, tmp_path):
    pandas, polars, pyarrow = (pytest.importorskip(name) for name in ("pandas", "polars", "pyarrow"))
    (tmp_path / "flat.obj").write_text(FLAT)
    columns = {"x": [5.0, -9.0, 20.0], "y": [8.0, 3.0, -7.0], "height": [20.0, 14.0, 17.5], "species": ["beech", "spruce", "beech"]}
    pandas.DataFrame(columns).to_csv(tmp_path / "inventory.csv", index=False)
    done = command(
        "scene",
        "stand",
        tmp_path / "inventory.csv",
        "--trees",
        FIXTURES / "forest",
        "--terrain",
        tmp_path / "flat.obj",
        "-o",
        tmp_path / "c",
    )
    assert done.returncode == 0, done.stderr
    frame = pandas.DataFrame(columns)
    inventories = [columns, frame, polars.DataFrame(columns), pyarrow.table(columns), tmp_path / "inventory.csv", frame.to_records()]
    geopandas = pytest.importorskip("geopandas")
    points = geopandas.points_from_xy(frame["x"], frame["y"])
    inventories.append(geopandas.GeoDataFrame(frame[["height", "species"]], geometry=points))
    for number, inventory in enumerate(inventories):
        stand = vlscan.make_stand(inventory, FIXTURES / "forest", tmp_path / str(number), terrain=tmp_path / "flat.obj")
        assert (stand.folder / "labels.csv").read_bytes() == (tmp_path / "c/labels.csv").read_bytes()
        assert stand.trees == [3] and [tree["species"] for tree in stand.labels()] == columns["species"]
    assert list(stand.to_pandas()["height"]) == columns["height"] and stand.scene.primitives > 100
    grown = vlscan.make_stand(columns, FIXTURES / "forest", tmp_path / "g", terrain=[tmp_path / "flat.obj"], epochs=2, growth=10)
    assert grown.epoch(1).bounds[1, 2] > 1.05 * grown.scene.bounds[1, 2] and len(grown.trees) == 2
    assert float(grown.labels(1)[0]["height"]) == pytest.approx(22)
    with pytest.raises(IndexError):
        grown.epoch(2)
    with pytest.raises(ValueError, match="lengths"):
        vlscan.make_stand({"x": [1.0], "y": [1.0, 2.0], "height": [1.0]}, FIXTURES / "forest", tmp_path / "x")
    with pytest.raises(vlscan.InputError, match="height"):
        vlscan.make_stand({"x": [1.0], "y": [1.0]}, FIXTURES / "forest", tmp_path / "x")
    with pytest.raises(TypeError, match="table or a file"):
        vlscan.make_stand(3, FIXTURES / "forest", tmp_path / "x")


def test_areas_are_geometries(tmp_path):
    geopandas, shapely = (pytest.importorskip(name) for name in ("geopandas", "shapely"))
    polygon = shapely.Polygon(SQUARE)
    frame = geopandas.GeoDataFrame(geometry=[polygon], crs="EPSG:25832")
    scene = Scene(flat())
    texts = set()
    for area in (SQUARE, np.array(SQUARE), polygon, frame, frame.geometry, polygon.wkt, shapely.Polygon([(*c, 3.0) for c in SQUARE])):
        plan = vlscan.plan_airborne("riegl_vux-1uav", 50, density=5, area=area, scene=scene)
        texts.add(plan.text.split("\n", 1)[1])
    assert len(texts) == 1, texts
    points = plan.run(seed=1).points
    assert 5000 < len(points) < 50_000 and abs(points["Z"]).max() < 1
    assert abs(plan.dry_run().points.value / len(points) - 1) < 0.1
    plan.save(tmp_path / "plan.toml")
    assert "scene.vlscene" in (tmp_path / "plan.toml").read_text()
    with pytest.raises(ValueError, match="estimate_utm_crs"):
        vlscan.plan_airborne("riegl_vux-1uav", 50, density=5, area=frame.to_crs("EPSG:4326"), scene=scene)
    with pytest.raises(ValueError, match="corners"):
        vlscan.plan_airborne("riegl_vux-1uav", 50, density=5, area=[1.0, 2.0], scene=scene)
    line = [(0.0, 0.0), (40.0, 0.0)]
    drives = {
        vlscan.plan_mobile("vlp16", along, scene=scene, ground=0).text.split("\n", 1)[1]
        for along in (line, shapely.LineString(line), np.array(line))
    }
    assert len(drives) == 1
    assert "[[leg]]" in vlscan.plan_terrestrial("riegl_vz400", area=polygon, spacing=20, scene=flat(), ground=0).text


def test_clouds_are_compared_as_objects(room, tmp_path):
    pytest.importorskip("pandas")
    first, second = (vlscan.run(room, seed=seed).points[::5] for seed in (1, 2))
    found = vlscan.compare(first, second, voxel=1, page=tmp_path / "a.html", change=tmp_path / "a.tif", changed=tmp_path / "a.laz")
    assert found["first"]["points"] == len(first) and "first_to_second" in found and len(found) == len(list(found))
    assert (tmp_path / "a.html").stat().st_size > 10_000 and (tmp_path / "a.tif").exists() and (tmp_path / "a.laz").exists()
    table = found.to_pandas()
    assert {"quantity", "name"} <= set(table.columns) and len(table) > 10 and "Comparison of first" in repr(found)
    cells = found.change_map
    assert cells.differences.shape == cells.detection.shape == cells.is_changed.shape and cells.side_m == 1
    assert np.nanmax(np.abs(cells.differences)) < 0.2 and cells.is_changed.dtype == bool
    rasterio = pytest.importorskip("rasterio")
    with rasterio.open(tmp_path / "a.tif") as raster:
        # Rasters begin in the north.
        assert np.array_equal(raster.read(1), cells.differences[::-1].astype("float32"), equal_nan=True)
    data = pytest.importorskip("xarray") and cells.to_xarray()
    assert data["difference"].dims == ("y", "x") and float(data.y[1] - data.y[0]) == 1
    with pytest.raises(vlscan.Error, match="a.html"):
        vlscan.compare(first, second, page=tmp_path / "a.html")


def test_pictures_are_those_of_the_command(room, command, tmp_path):
    assert command("preview", room, "-o", tmp_path / "c.png", "--width", 400, "--height", 300).returncode == 0
    vlscan.preview(room, tmp_path / "own.png", width=400, height=300)
    assert (tmp_path / "own.png").read_bytes() == (tmp_path / "c.png").read_bytes()
    vlscan.run(room, to=tmp_path / "room.laz", seed=1)
    vlscan.preview(tmp_path / "room.laz", tmp_path / "cloud.html", colour="intensity", light=True)
    assert b"<html" in (tmp_path / "cloud.html").read_bytes().lower()
    result = vlscan.run(room, to=tmp_path / "w.xyz", seed=1, waveforms=True)
    waves = next(file for file in result.files if "fullwave" in file)
    number = int(open(waves, encoding="utf-8").readline().split()[0])
    vlscan.preview(waves, tmp_path / "wave.png", pulse=number, width=400, height=300)
    assert (tmp_path / "wave.png").read_bytes()[1:4] == b"PNG"
    survey = Survey(flat(), "vlp16", [vlscan.Leg((0, 0, 5), head_rate_deg_per_s=3600, head_stop_deg=360)])
    vlscan.preview(survey, tmp_path / "memory.png", width=400, height=300)
    with pytest.raises(FileExistsError, match="force"):
        vlscan.preview(survey, tmp_path / "memory.png")
    with pytest.raises(ValueError, match=".png or .html"):
        vlscan.preview(survey, tmp_path / "memory.jpg")
    with pytest.raises(ValueError, match="file of waveforms"):
        vlscan.preview(vlscan.run(room, seed=1).points, tmp_path / "b.png", pulse=3)


def test_figures_are_those_of_the_command(command):
    rows = json.loads(command("catalogue", "--json").stdout)["scanners"]
    assert [figures.reference for figures in vlscan.all_scanner_figures()] == [row["reference"] for row in rows]
    shown = json.loads(command("catalogue", "show", "riegl_vz400", "--json").stdout)
    figures = vlscan.scanner_figures("riegl_vz400")
    assert figures.pulse_rates_hz == shown["pulse_rates_hz"] and figures.sources == shown["sources"]
    assert "<svg" in figures._repr_html_() and vlscan.all_scanner_figures("vux")
    with pytest.raises(vlscan.InputError, match="did you mean"):
        vlscan.scanner_figures("riegl_vz40")


def test_facts_of_scenes_are_those_of_the_command(command):
    expected = json.loads(command("scene", "info", FIXTURES / "forest/scene.xml", "--json").stdout)
    facts = Scene(FIXTURES / "forest/scene.xml").info()
    for key in ("primitives", "bounds_m", "parts", "materials", "instances"):
        assert facts[key] == expected[key], key
    assert Scene(flat()).info()["triangles"] == 2


def test_compressed_text_is_expanded(room, tmp_path):
    vlscan.run(room, to=[tmp_path / "a.bin", tmp_path / "a.xyz"], seed=1)
    assert vlscan.unzip(tmp_path / "a.bin", tmp_path / "b.xyz") > 10_000
    assert (tmp_path / "b.xyz").read_bytes() == (tmp_path / "a.xyz").read_bytes()
    with pytest.raises(vlscan.Error):
        vlscan.unzip(tmp_path / "a.bin", tmp_path / "b.xyz")


def test_cells_of_campaigns_are_listed_and_counted(tmp_path, capsys):
    tqdm = pytest.importorskip("tqdm")
    (tmp_path / "flat.obj").write_text(FLAT)
    (tmp_path / "c.toml").write_text(
        'out = "set"\nseeds = 2\n[[scene]]\nname = "flat"\nfile = "flat.obj"\narea = "POLYGON ((-9 -9, 9 -9, 9 9, -9 9, -9 -9))"\n'
        '[[variant]]\nname = "u"\nplan = "airborne --scanner riegl_vux-1uav --height 50 --density 5"\n'
    )
    assert vlscan.campaign_cells(tmp_path / "c.toml") == ["flat-u-1", "flat-u-2"]
    report = vlscan.run_campaign(tmp_path / "c.toml", progress=True)
    assert report.left == 0 and "2/2" in capsys.readouterr().err and tqdm
    assert vlscan.campaign_cells(tmp_path / "c.toml") == []
    assert [record["seed"] for record in report.records()] == [1, 2] and len(report.to_pandas()) == 2


class Kernel:
    """An interpreter of a notebook."""

    kernel = object()


def test_bars_are_shown_where_they_are_looked_at(room, monkeypatch):
    pytest.importorskip("tqdm")
    bars = []

    class Bar:
        n = 0.0

        def __init__(self, **options):
            bars.append(self)
            self.options, self.is_closed = options, False

        def update(self, more):
            self.n += more

        def set_postfix_str(self, text, refresh):
            self.text = text

        def close(self):
            self.is_closed = True

    monkeypatch.setitem(sys.modules, "tqdm.auto", types.SimpleNamespace(tqdm=Bar))
    vlscan.run(room, seed=1)
    assert not bars
    vlscan.run(room, seed=1, progress=True)
    assert len(bars) == 1 and bars[0].is_closed and abs(bars[0].n - 100) < 1e-6 and "points" in bars[0].text
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: Kernel))
    vlscan.run(room, seed=1)
    vlscan.run(room, seed=1, progress=False)
    assert len(bars) == 2 and bars[1].options["delay"] > 0
    with pytest.raises(vlscan.FileError):
        vlscan.run("nothing.toml")
    assert bars[-1].is_closed
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    vlscan.run(room, seed=1)
    with pytest.raises(ImportError, match="pip install tqdm"):
        vlscan.run(room, seed=1, progress=True)
