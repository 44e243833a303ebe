"""What processes pass to one another: points, parts, scenes, surveys, results, errors."""

import copy
import multiprocessing
import pickle

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES
from vlscan import Leg, Material, Part, Points, Scene, Survey

LEG = Leg((0, 0, 5), scan_freq_hz=20, head_rate_deg_per_s=36, head_stop_deg=90)


def tree():
    """A part of arrays with two materials, one of which was changed."""
    corners = [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]
    leaf, bark = Material("leaf", reflectance=0.4, classification=5), Material("bark", roughness_deg=20)
    part = Part.mesh(corners, [[0, 1, 2], [0, 2, 3]], [leaf, bark], material_of=[0, 1])
    return part.with_material(Material("wet", reflectance=0.1), of="bark").with_material(Material("dry"), of=[1])


def scan(part):
    """Work for another process: a part becomes points."""
    return Survey(part, "riegl_vz400", [LEG]).run(seed=1).points


def fly(survey, seed):
    """Work for another process: a survey becomes a result."""
    return survey.run(seed=seed, waveforms=True)


def mean_height(points):
    """Work for another process: points become a number."""
    return float(points["Z"].mean())


def fail(path):
    """Work for another process that fails."""
    return vlscan.run(path)


@pytest.fixture(scope="module")
def pool():
    with multiprocessing.get_context("spawn").Pool(2) as processes:
        yield processes


def test_processes_pass_parts_and_points(pool):
    parts = [tree().translate(0, 0, height) for height in range(3)]
    found = pool.map(scan, parts)
    for part, points in zip(parts, found, strict=True):
        assert isinstance(points, Points) and (points.xyz == scan(part).xyz).all() and points.metadata == scan(part).metadata
    heights = pool.map(mean_height, found)
    assert np.allclose(np.diff(heights), 1, atol=0.01), heights


def test_processes_pass_surveys_and_results(pool, room, tmp_path):
    near = Leg((0, 0, 1.5), **LEG.settings)
    surveys = [Survey.open(room), Survey([tree()], "riegl_vz400", [LEG]), Survey(Scene(FIXTURES / "room/scene.xml"), "riegl_vz400", [near])]
    for survey, result in zip(surveys, pool.starmap(fly, [(survey, 2) for survey in surveys]), strict=True):
        expected = fly(survey, 2)
        assert result.points.to_numpy().tobytes() == expected.points.to_numpy().tobytes()
        assert (result.pulse_count, result.point_count, result.problems) == (expected.pulse_count, expected.point_count, expected.problems)
        assert (
            len(result.waveforms) == len(expected.waveforms)
            and result.waveforms.samples(0).tolist() == expected.waveforms.samples(0).tolist()
        )
        result.points.write(tmp_path / "a.laz", force=True)
        expected.points.write(tmp_path / "b.laz", force=True)
        assert (tmp_path / "a.laz").read_bytes() == (tmp_path / "b.laz").read_bytes()


def test_processes_pass_errors(pool):
    with pytest.raises(vlscan.FileError, match="nothing.toml") as missing:
        pool.apply(fail, ["nothing.toml"])
    assert missing.value.errno == 2
    with pytest.raises(vlscan.InputError) as error:
        pool.apply(fail, [FIXTURES / "room/scene.xml"])
    assert error.value.problems and error.value.problems[0].file
    raised = vlscan.InputError("a", [{"severity": "error", "message": "a", "line": 3}])
    assert pickle.loads(pickle.dumps(raised)).problems == raised.problems


def test_copies_share_their_mesh_after_pickling():
    vertices = np.random.default_rng(1).random((3000, 3))
    part = Part.mesh(vertices, np.arange(3000).reshape(-1, 3))
    copies = [part.translate(i, 0, 0).named(str(i)) for i in range(100)]
    assert len(pickle.dumps(copies)) < 2 * len(pickle.dumps([part]))
    loaded = pickle.loads(pickle.dumps(copies))
    assert Scene(loaded).primitives == 100 * 1000 and Scene(loaded).memory == Scene(copies).memory
    assert Scene(loaded).parts[3] == "3"


def test_scenes_and_tables_are_copied(room):
    scene = Scene([tree()])
    points = vlscan.run(room, seed=1).points
    for other in (copy.copy(scene), copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        assert other.bounds.tolist() == scene.bounds.tolist() and other.materials == scene.materials
    for other in (copy.deepcopy(points), pickle.loads(pickle.dumps(points))):
        assert other.to_numpy().tobytes() == points.to_numpy().tobytes() and other.units == points.units
    part = pickle.loads(pickle.dumps(points[100:200]))
    assert len(part) == 100 and len(pickle.dumps(part)) < len(pickle.dumps(points)) / 10
    assert repr(pickle.loads(pickle.dumps(Survey.open(room, legs=[LEG])))) == repr(Survey.open(room, legs=[LEG]))
