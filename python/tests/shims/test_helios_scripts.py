"""The names of HELIOS++ 3 as scripts use them: values with units, wrong values, copies, files, whole workflows."""

import copy
import math
import pickle
import re
import sys
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES, ROOT

pytest.importorskip("pint")
pytest.importorskip("pydantic")

import pydantic
from test_helios import plane, static_survey
from vlscan.helios.validation import units

from vlscan import helios
from vlscan.helios import validation


@pytest.fixture(autouse=True)
def _fresh():
    helios.set_rng_seed(1)
    yield
    helios.set_execution_settings()
    helios.set_output_settings()


def value_of(kind, value):
    """A value as a field of a type of the validation holds it."""
    fields = {"__annotations__": {"value": getattr(validation, kind)}, "__module__": __name__}
    return type("Values", (validation.Model,), fields)(value=value).value


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        ("Angle", 45 * units.deg, math.pi / 4),
        ("Angle", "45 deg", math.pi / 4),
        ("Angle", "180deg", math.pi),
        ("Angle", "90°", math.pi / 2),
        ("Angle", "-0.5", -0.5),
        ("Angle", np.float32(1), 1),
        ("Angle", units.Quantity(90, "degree"), math.pi / 2),
        ("AngleVelocity", 10 * units.deg / units.s, math.radians(10)),
        ("AngleVelocity", "1 rpm", 2 * math.pi / 60),
        ("Frequency", 300 * units.kHz, 300_000),
        ("Frequency", "1/s", 1),
        ("ScanFrequency", "120 1/s", 120),
        ("TimeInterval", 0.25 * units.ns, 2.5e-10),
        ("TimeInterval", "1 min", 60),
        ("Length", "1 mm", 0.001),
    ],
)
def test_quantities(kind, value, expected):
    assert math.isclose(value_of(kind, value), expected)


@pytest.mark.parametrize(
    ("kind", "value"),
    [("Angle", wrong) for wrong in ("45 m", "abc", None, [1, 2], {"a": 1}, True, object(), 45 * units.m)]
    + [("Frequency", -1), ("Frequency", "1 m"), ("TimeInterval", "-1 s"), ("Length", -1), ("TimeInterval", "3 Hz")]
    + [("R3Vector", wrong) for wrong in ([1, 2], [[1, 2, 3]], "abc", None, [1, 2, "x"], 1.0, [1, 2, math.nan], np.ones(3) * units.s)],
)
def test_wrong_quantities(kind, value):
    with pytest.raises(pydantic.ValidationError):
        value_of(kind, value)


@pytest.mark.parametrize(
    "value",
    [[1, 2, 3], (1, 2, 3), np.array([1, 2, 3]), ["1 m", "2 m", "300 cm"], np.array([0.001, 0.002, 0.003]) * units.km, [1 * units.m, 2, 3]],
)
def test_vectors(value):
    assert np.allclose(value_of("R3Vector", value), [1, 2, 3])


EQUAL = [
    lambda: helios.ScannerSettings(scan_frequency=5),
    helios.OutputSettings,
    helios.TrajectorySettings,
    helios.FullWaveformSettings,
    lambda: helios.ExecutionSettings(num_threads=1),
    lambda: helios.StaticPlatformSettings(x=3),
    lambda: helios.DynamicPlatformSettings(speed_m_s=3),
    lambda: helios.Material(name="a", diffuse_components=[0.1, 0.2, 0.3, 1.0]),
    lambda: helios.scanner.riegl_vz_400(),
    lambda: helios.platforms.tripod(),
    lambda: helios.Leg(scanner_settings=helios.ScannerSettings(), platform_settings=helios.StaticPlatformSettings(x=1)),
]


@pytest.mark.parametrize("make", EQUAL)
def test_copies_are_equal(make):
    thing = make()
    for other in (make(), thing.clone(), copy.copy(thing), copy.deepcopy(thing), pickle.loads(pickle.dumps(thing))):
        assert other == thing and other is not thing and not other != thing
    assert thing != 3 and repr(thing) and str(thing)
    with pytest.raises(TypeError):
        hash(thing)


def test_values_of_settings_are_checked():
    settings = helios.ScannerSettings()
    settings.update_from_dict({"pulse_frequency": "10 kHz", "scan_angle": 10 * units.deg})
    assert settings.pulse_frequency == 10_000 and settings.scan_angle == pytest.approx(math.radians(10))
    for wrong in ({"nope": 1}, {"scan_angle": "1 m"}):
        with pytest.raises(ValueError):
            settings.update_from_dict(wrong)
    settings.update_from_dict({"nope": 1, "scan_frequency": 5}, skip_exceptions=True)
    settings.update_from_object(helios.ScannerSettings(head_rotation=1))
    assert (settings.scan_frequency, settings.pulse_frequency, settings.head_rotation) == (5, 10_000, 1)
    assert helios.ScannerSettings.model_validate(settings.model_dump()) == settings
    for kind, name, wrong in [
        (helios.ExecutionSettings, "num_threads", 0),
        (helios.ExecutionSettings, "num_threads", 1.5),
        (helios.ExecutionSettings, "parallelization", 7),
        (helios.ExecutionSettings, "chunk_size", 0),
        (helios.OutputSettings, "format", "docx"),
        (helios.OutputSettings, "las_scale", -1),
        (helios.FullWaveformSettings, "beam_sample_quality", 0),
        (helios.DynamicPlatformSettings, "speed_m_s", -1),
        (helios.Material, "diffuse_components", [1, 2]),
        (helios.ScannerSettings, "is_active", "perhaps"),
    ]:
        with pytest.raises(pydantic.ValidationError):
            kind(**{name: wrong})
        with pytest.raises(pydantic.ValidationError):
            setattr(kind(), name, wrong)
        with pytest.raises(pydantic.ValidationError):
            kind(nope=1)
    first, second = helios.DynamicPlatformSettings(), helios.DynamicPlatformSettings()
    first.trajectory_settings.start_time = 5
    assert second.trajectory_settings.start_time == 0


def test_surveys_are_put_together():
    survey = static_survey()
    leg = helios.Leg(scanner_settings=helios.ScannerSettings(pulse_frequency=1e5), platform_settings=helios.PlatformSettings(x=1))
    survey.add_leg(leg)
    survey.add_leg(leg, x=9)
    survey.add_leg(platform_settings=helios.PlatformSettings(x=3), scanner_settings=helios.ScannerSettings())
    assert [each.platform_settings.x for each in survey.legs] == [0, 9, 9, 3]
    assert survey.legs[1] is leg and survey.legs[2] is leg, "a leg that is given is changed and appended itself"
    twin = copy.deepcopy(survey)
    assert twin == survey
    twin.legs[0].platform_settings.x = 77
    assert survey.legs[0].platform_settings.x == 0 and twin != survey
    survey.legs += (leg.clone(),)
    survey.legs = survey.legs[:2]
    assert isinstance(survey.legs, tuple) and len(survey.legs) == 2
    dated = helios.Survey(scanner=survey.scanner, platform=survey.platform, scene=survey.scene, gps_time="2024-05-05T00:00:00+00:00")
    assert dated.gps_time == datetime(2024, 5, 5, tzinfo=timezone.utc)
    for wrong in ({"scanner": 1}, {"nope": 1}, {"legs": [1]}, {"scene": None}):
        values = {"scanner": survey.scanner, "platform": survey.platform, "scene": survey.scene} | wrong
        with pytest.raises(pydantic.ValidationError):
            helios.Survey(**values)
    for wrong in ("add_leg", "run"):
        with pytest.raises(ValueError, match="unknown keyword 'speeds'"):
            getattr(survey, wrong)(speeds=1)


def test_surveys_pickle():
    survey = static_survey(plane(), helios.ScenePart.from_obj(FIXTURES / "forest/beech.obj"))
    points, poses = survey.run()
    other = pickle.loads(pickle.dumps(survey))
    assert other.legs == survey.legs and (other.run()[0] == points).all() and (other.run()[1] == poses).all()
    assert pickle.loads(pickle.dumps(helios.Survey.from_xml(FIXTURES / "room/survey.xml"))).run()[0].tobytes() == (
        helios.Survey.from_xml(FIXTURES / "room/survey.xml").run()[0].tobytes()
    )


def test_flights_of_text_may_have_a_line_of_names(tmp_path):
    rows = "0,0,0,90,0,0,300\n1,0,0,90,10,0,300\n2,0,0,90,20,0,300\n"
    for number, head in enumerate(("", "t,roll,pitch,yaw,x,y,z\n", "# a comment\n", "\n# t, roll\nt,roll,pitch,yaw,x,y,z\n", "\ufeff")):
        (tmp_path / f"{number}.csv").write_text(head + rows, encoding="utf-8")
        poses = helios.load_traj_csv(tmp_path / f"{number}.csv")
        assert len(poses) == 3 and poses["yaw"][0] == pytest.approx(math.pi / 2) and poses["x"].tolist() == [0, 10, 20]
    (tmp_path / "wrong.csv").write_text("0,0,0,90,0,0,10\n1,0,0,ninety,10,0,10\n")
    with pytest.raises(ValueError):
        helios.load_traj_csv(tmp_path / "wrong.csv")
    platform = helios.Platform.load_interpolate_platform(poses, "data/platforms.xml", "sr22", sync_gps_time=True)
    survey = helios.Survey(scanner=helios.scanner.riegl_lms_q780(), platform=platform, scene=helios.StaticScene(scene_parts=[plane(300.0)]))
    scanning = helios.ScannerSettings(pulse_frequency="100 kHz", scan_frequency=50, scan_angle="20 deg")
    survey.add_leg(
        scanner_settings=scanning, trajectory_settings=helios.TrajectorySettings(start_time=0.5, end_time=1.0, teleport_to_start=True)
    )
    points, poses = survey.run()
    assert len(points) > 1000 and 0.5 <= points["gps_time"].min() and points["gps_time"].max() <= 1.01


def test_an_example_before_and_after(monkeypatch):
    """The notebook of the migration guide gives the same points before and after its import is changed."""
    text = (ROOT / "docs/migration.md").read_text(encoding="utf-8")
    after = re.search(r"```python\n(import .*?)```", text, re.DOTALL)[1]
    before = after.replace("import vlscan.helios as helios", "import helios").replace("from vlscan.helios", "from helios")
    assert "vlscan" not in before
    monkeypatch.chdir(ROOT)
    found = []
    for source in (before, after):
        modules = dict(sys.modules)
        helios.install()
        try:
            exec(compile(source, "notebook", "exec"), names := {})
        finally:
            for name in set(sys.modules) - set(modules):
                del sys.modules[name]
        found.append(names["points"])
    assert len(found[0]) > 1000 and found[0].tobytes() == found[1].tobytes()


def test_points_go_to_other_libraries(tmp_path):
    """What notebooks do with points: pictures, rasters, tables, files."""
    rasterio, pandas = pytest.importorskip("rasterio"), pytest.importorskip("pandas")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    points, poses = static_survey().run()
    x, y, z = points["position"].T
    figure, axes = pyplot.subplots()
    axes.scatter(x[::50], y[::50], c=points["intensity"][::50])
    axes.plot(poses["position"][:, 0], poses["gps_time"])
    figure.savefig(tmp_path / "a.png")
    pyplot.close(figure)
    heights, edges, _ = np.histogram2d(x, y, bins=10, weights=z)
    profile = {"driver": "GTiff", "width": 10, "height": 10, "count": 1, "dtype": "float32"}
    with rasterio.open(tmp_path / "a.tif", "w", transform=rasterio.transform.from_origin(0, 10, 1, 1), **profile) as file:
        file.write(heights.astype("float32"), 1)
    frame = pandas.DataFrame({name: points[name] for name in points.dtype.names if points[name].ndim == 1})
    assert frame.groupby("point_source_id")["distance"].mean().iloc[0] > 0
    np.save(tmp_path / "a.npy", points)
    assert np.load(tmp_path / "a.npy").tobytes() == points.tobytes() and edges.size == 11
    folder = static_survey().run(format=helios.OutputFormat.XYZ, output_dir=tmp_path / "out")
    assert isinstance(folder, Path) and np.loadtxt(next(folder.glob("*.xyz"))).shape == (len(points), 11)
    assert vlscan.Points.read(next(folder.glob("*.xyz"))).bounds.shape == (2, 3)
