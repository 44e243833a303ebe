"""Plans, campaigns and comparisons: what the commands do."""

import json

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES

SQUARE = [(-20, -20), (20, -20), (20, 20), (-20, 20)]
FLAT = "v -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\nf 1 2 3\nf 1 3 4\n"


def test_plans_are_those_of_the_command(command, tmp_path):
    scene = tmp_path / "flat.obj"
    scene.write_text(FLAT)
    text = f"POLYGON (({', '.join(f'{x} {y}' for x, y in [*SQUARE, SQUARE[0]])}))"
    options = ["--scanner", "riegl_vux-1uav", "--height", 50, "--density", 5, "--area", text, "--scene", scene]
    done = command("plan", "airborne", *options, "-o", tmp_path / "plan.toml")
    assert done.returncode == 0, done.stderr
    for area in (SQUARE, text):
        plan = vlscan.plan_airborne("riegl_vux-1uav", 50, density=5, area=area, scene=scene)
        expected = (tmp_path / "plan.toml").read_text().split("\n", 1)[1]
        assert plan.text.split("\n", 1)[1] == expected and any("density" in line for line in plan.promises)
    plan.save(tmp_path / "own.toml")
    points = vlscan.run(tmp_path / "own.toml", seed=1).points
    assert 5000 < len(points) < 50_000
    tripods = vlscan.plan_terrestrial("riegl_vz400", around=(0, 0), radius=10, at_centre=True, resolution=0.1, scene=scene, ground=0)
    assert tripods.text.count("[[leg]]") == 5
    tripods = vlscan.plan_terrestrial("riegl_vz400", at=[(0, 0), (4, -2.5)], resolution=0.1, scene=scene, ground=0)
    assert tripods.text.count("[[leg]]") == 2 and "position_m = [4, -2.5, 0]" in tripods.text
    with pytest.raises(ValueError, match="spacing has no meaning"):
        vlscan.plan_terrestrial("riegl_vz400", at=[(0, 0)], spacing=5, scene=scene)
    assert "vlp16" in vlscan.plan_mobile("vlp16", "LINESTRING (0 0, 40 0)", scene=scene, ground=0).text
    with pytest.raises(vlscan.InputError, match="height=-5"):
        vlscan.plan_airborne("riegl_vux-1uav", -5, density=5, area=SQUARE)
    with pytest.raises(TypeError, match="height"):
        vlscan.plan_airborne("riegl_vux-1uav", "low", density=5, area=SQUARE)


def test_campaigns_are_computed_and_clouds_compared(tmp_path):
    (tmp_path / "flat.obj").write_text(FLAT)
    text = """out = "set"
seeds = 2
[[scene]]
name = "flat"
file = "flat.obj"
area = "POLYGON ((-20 -20, 20 -20, 20 20, -20 20))"
[[variant]]
name = "u"
plan = "airborne --scanner riegl_vux-1uav --height 50 --density 5"
"""
    (tmp_path / "c.toml").write_text(text)
    events = []
    report = vlscan.run_campaign(tmp_path / "c.toml", cells=["flat-u-1"], notify=lambda *event: events.append(event))
    assert (report.computed, report.left, report.failed, report.manifest) == (1, 1, [], None)
    assert [event[:2] for event in events if event[0] == "completed"] == [("completed", "flat-u-1")]
    report = vlscan.run_campaign(tmp_path / "c.toml")
    assert (report.computed, report.left) == (1, 0) and report.points > 10_000
    with open(report.manifest, encoding="utf-8") as file:
        assert [json.loads(line)["seed"] for line in file] == [1, 2]
    clouds = [tmp_path / f"set/cells/flat-u-{seed}/points.laz" for seed in (1, 2)]
    found = vlscan.compare(*clouds, chance=True)
    sampled = vlscan.compare(*clouds, max_distances=100)["first_to_second"]
    assert vlscan.compare(*clouds, most_distances=100)["first_to_second"] == sampled
    with pytest.raises(TypeError, match="earlier name of max_distances"):
        vlscan.compare(*clouds, most_distances=100, max_distances=100)
    returns = next(quantity for quantity in found["quantities"] if quantity["name"] == "returns per pulse")
    assert returns["figures"][0]["is_within_chance"] is True and found["chance"]["splits"] == 39
    assert found["first_to_second"]["mean_m"] < 1 and found["first"]["points"] > 5000
    plan = vlscan.plan_airborne("riegl_vux-1uav", 50, density=5, area=SQUARE, scene=tmp_path / "flat.obj")
    plan.save(tmp_path / "p.toml")
    points = vlscan.run(tmp_path / "p.toml", seed=1).points
    assert vlscan.compare(points, clouds[0], voxel=1)["second"]["name"].endswith("points.laz")
    with pytest.raises(vlscan.InputError, match="no cell nothing"):
        vlscan.run_campaign(tmp_path / "c.toml", cells=["nothing"])
    (tmp_path / "c.toml").write_text(text + 'run = "--seed 3"\n')
    with pytest.raises(vlscan.InputError, match='--seed …" cannot be used in a campaign'):
        vlscan.run_campaign(tmp_path / "c.toml")


@pytest.mark.filterwarnings("ignore")
def test_a_flight_is_fitted_and_a_scene_reconstructed(tmp_path):
    plan = vlscan.plan_airborne("riegl_vux-1uav", height=60, density=4, scene=FIXTURES / "forest" / "ground.obj")
    plan.save(tmp_path / "plan.toml")
    vlscan.run(tmp_path / "plan.toml", to=tmp_path / "line.laz", seed=1)
    found = vlscan.fit_flight(tmp_path / "line.laz", tmp_path / "fit.toml", extend=2.0)
    value, deviation, unit = found["height above the points"]
    assert abs(value - 60) < 1 and 0 < deviation < 1 and unit == "m"
    assert 'optics = "rotating"' in (tmp_path / "fit.toml").read_text()
    with pytest.raises(vlscan.Error, match="force"):
        vlscan.fit_flight(tmp_path / "none.laz", tmp_path / "fit.toml")
    (tmp_path / "plain.xyz").write_text("1 2 3\n4 5 6\n")
    with pytest.raises(vlscan.InputError, match="GPS times"):
        vlscan.fit_flight(tmp_path / "plain.xyz", tmp_path / "other.toml")
    report = vlscan.reconstruct(tmp_path / "line.laz", tmp_path / "place")
    assert report["pulses"] > 1000 and (tmp_path / "place" / "scene.xml").exists()


def test_a_spinning_sensor_is_fitted(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    import pyarrow

    altitudes, columns = np.linspace(20, -20, 32), 1024
    calibration = {
        "product": "OS-1-32",
        "mode": f"{columns}x10",
        "columns": columns,
        "origin_to_beam_mm": 0,
        "beam_altitude_deg": list(altitudes),
        "beam_azimuth_deg": [0] * 32,
    }
    (tmp_path / "sensor.json").write_text(json.dumps(calibration))
    # A room of 16 by 16 by 6 m, ranges with a noise of 10 mm, every fiftieth pulse lost.
    beam, column = np.divmod(np.arange(32 * columns), columns)
    up, turn = np.radians(altitudes[beam]), 2 * np.pi * column / columns
    direction = np.c_[np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)]
    ranges = 1000 * (np.array([8, 8, 3]) / np.maximum(abs(direction), 1e-9)).min(1)
    random = np.random.default_rng(1)
    ranges = np.where(random.random(len(ranges)) < 0.02, 0, np.round(ranges + random.normal(0, 10, len(ranges))))
    fields = {"beam": beam, "column": column, "range_mm": ranges, "reflectivity": np.full(len(beam), 50.0)}
    parquet.write_table(pyarrow.table(fields), tmp_path / "revolution.parquet")
    files = (tmp_path / "revolution.parquet", tmp_path / "sensor.json", tmp_path / "fit.toml")
    found = vlscan.fit_sensor(*files, planes=tmp_path / "planes.obj")
    assert 50 < found["planes"] and abs(found["dropout_rate"][0] - 0.02) < 0.005, found
    assert abs(found["classes"][0]["scatter_m"][0] - 0.01) < 0.002, found
    assert "catalogue" in (tmp_path / "fit.toml").read_text() and (tmp_path / "planes.obj").exists()
    with pytest.raises(vlscan.Error, match="force"):
        vlscan.fit_sensor(*files, half="odd")
    with pytest.raises(ValueError, match="half"):
        vlscan.fit_sensor(*files, half="both")
    with pytest.raises(vlscan.Error, match="sensor.json"):
        vlscan.fit_sensor(tmp_path / "sensor.json", tmp_path / "sensor.json", tmp_path / "other.toml")
    # Names are checked before the recording is read.
    with pytest.raises(vlscan.Error, match="planes.obj exists already"):
        vlscan.fit_sensor(tmp_path / "none.parquet", files[1], tmp_path / "other.toml", planes=tmp_path / "planes.obj")
