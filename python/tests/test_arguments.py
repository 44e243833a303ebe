"""Wrong arguments: errors name the argument, what was given, and what to give instead."""

import inspect
import io
import os
import pickle
import shutil
import warnings
from datetime import timedelta
from decimal import Decimal

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES
from vlscan.survey import TRAJECTORY_COLUMNS

SQUARE, FACES = [[-9, 5, 0], [9, 5, 0], [9, 5, 4], [-9, 5, 4]], [[0, 1, 2, 3]]
TREE = FIXTURES / "forest/beech.obj"
VOXELS = FIXTURES / "voxels/crown.vox"
POSES = {name: np.arange(3.0) for name in TRAJECTORY_COLUMNS}


def wall(vertices=None, faces=None, **others):
    return vlscan.Part.mesh(SQUARE if vertices is None else vertices, FACES if faces is None else faces, **others)


def survey(**changes):
    leg = vlscan.Leg((0, 0, 1.7), scan_freq_hz=20, head_rate_deg_per_s=50, head_start_deg=-5, head_stop_deg=5)
    return vlscan.Survey(**{"scene": wall(), "scanner": "riegl_vz400", "legs": [leg], **changes})


@pytest.fixture(scope="module")
def points():
    return survey().run(seed=1).points


COMPLEX = np.array(SQUARE, complex)
TIMES = np.arange(3).astype("datetime64[s]")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: wall(COMPLEX), "vertices is of complex128, expected real numbers"),
        (lambda: wall([["a", "b", "c"]] * 4), "vertices holds 'a'"),
        (lambda: wall(row for row in SQUARE), r"vertices is of the type generator.*list\(\) makes a list"),
        (lambda: wall(faces=iter(FACES)), "faces is of the type list_iterator"),
        (lambda: wall(np.array(SQUARE).astype("M8[s]")), "vertices is of datetime64"),
        (lambda: wall().translate("a", 0, 0), "a translation holds 'a'"),
        (lambda: wall().translate({1, 2, 3}), "a translation is {1, 2, 3}, expected numbers in order"),
        (lambda: wall().scale("2"), "factor is '2', expected a number"),
        (lambda: wall().rotate((0, 0, 1), None), "angle_deg is None"),
        (lambda: wall().rotate((0, 0, 1j), 90), "an axis is of complex128"),
        (lambda: wall().turn("abcd"), "a quaternion is 'abcd'"),
        (lambda: wall().drop_to_ground(1.5), "on_ground is 1.5, expected a whole number"),
        (lambda: vlscan.Part.points(COMPLEX, 0.1), "points is of complex128"),
        (lambda: vlscan.Part.points(SQUARE, "a"), "voxel_size is 'a'"),
        (lambda: vlscan.Part.obj(None), "path is None, expected the name of a file"),
        (lambda: vlscan.Material("m", diffuse="red"), "diffuse of the material 'm' is 'red'"),
        (lambda: vlscan.Material("m", reflectance=True), "reflectance of the material 'm' is True"),
        (lambda: vlscan.Leg(3), r"position of a leg is x, y, z, found int: vlscan.Leg\(\(x, y, z\)"),
        (lambda: vlscan.Leg((0, 0, 1j)), "position of a leg is of complex128"),
        (lambda: survey(settings=[1]), "settings of a survey is a mapping of keys, found list"),
        (lambda: survey(scene=["a.obj"]), r"has 'a.obj', expected Part; Part.file\(\)"),
        (lambda: survey().run(to=io.BytesIO(b"a\nb")), r"found a file object; run\(\).points.write\(file, format=...\)"),
        (lambda: survey().run(to=[None]), "to is None"),
        (lambda: survey().run(waveforms="yes"), "waveforms is True or False, found 'yes'"),
        (lambda: survey().run(pulses=2), "pulses is True or False, found 2"),
        (lambda: survey().run_batches(seconds=timedelta(seconds=1)), "seconds is datetime.timedelta"),
        (lambda: survey().run_batches(per_leg="yes"), "per_leg is True or False, found 'yes'"),
        (lambda: survey().fly_trajectory([1]), r"interval is \[1\]"),
        (lambda: survey().fly_trajectory(true="no"), "true is True or False, found 'no'"),
        (lambda: survey(trajectory={**POSES, "time": TIMES}).run(), "column time is of datetime64.*are seconds"),
        (lambda: survey(trajectory=np.zeros((3, 7), complex)).run(), "column time is of complex128"),
        (lambda: vlscan.trace(wall(), [[0, 0, 1j]], [[0, 1, 0]]), "origins is of complex128"),
        (lambda: vlscan.trace(wall(), pulses=np.zeros((3, 6))), r"with names, found an array of the shape \(3, 6\)"),
        (lambda: vlscan.Scene(wall()).sample(10.5), "count is 10.5"),
        (lambda: vlscan.Scene(wall()).ground_height([0], 0), r"x is \[0\]"),
        (lambda: vlscan.Points.of("a.laz"), r"found 'a.laz'; Points.read\(\) reads a file"),
        (lambda: vlscan.Points.of({"X": [0.0], "Y": [0.0], "Z": [0.0]}, crs=1.5), "crs is 1.5"),
        (lambda: vlscan.Survey.from_document(None), "text is None, expected a text"),
        (lambda: vlscan.run_shard(survey(), 0, 0, "shards"), "of is 'shards', expected a whole number"),
        (lambda: vlscan.preview(3, "a.png"), "source is 3"),
        (lambda: survey(scanner=vlscan.Scanner("vlp16", pattern=[1j])).document(), "pattern: expected numbers, .*found complex"),
        (lambda: vlscan.run_campaign("set.toml", notify=3), "notify is 3, expected a function"),
        (lambda: vlscan.plan_airborne("riegl_vux-1uav", 60, density=5, area=COMPLEX), "area is of complex128"),
    ],
)
def test_values_of_another_type_are_named(call, message):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(TypeError, match=message):
            call()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: wall([[1, 2, 3], [1, 2]]), "vertices has rows of different lengths"),
        (lambda: wall().drop_to_ground(-2), "on_ground is -2, expected at least -1"),
        (lambda: vlscan.Material("m", specular_exponent=-1), "specular_exponent of the material 'm' is -1"),
        (lambda: vlscan.Part.voxels(VOXELS, "scale"), "mode is 'scale', expected 'transmittive', 'fixed', 'scaled'"),
        (lambda: vlscan.Part.voxels(VOXELS, "scaled", -3), "exponent is -3"),
        (lambda: vlscan.Part.voxels(VOXELS, "scaled", np.nan), "exponent is nan"),
        (lambda: vlscan.Part.raster([]), "path names no raster"),
        (lambda: vlscan.Part.file("a.xyz"), r"Part.points\(\) makes voxels of point clouds"),
        (lambda: survey().run(gps_start=np.datetime64("NaT")), "gps_start is NaT"),
        (lambda: survey().run_batches(batch_columns=[]), "batch_columns names no column"),
        (lambda: vlscan.Scene(wall()).sample(-1), "count is -1, expected at least 0"),
    ],
)
def test_values_beyond_their_range_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: vlscan.Material(reflectence=0.3), r"Material\(\) has no keyword 'reflectence'; did you mean 'reflectance'"),
        (lambda: vlscan.Part.mesh(SQUARE, FACES, material=vlscan.Material()), "did you mean 'materials'"),
        (lambda: vlscan.Part.file(TREE, units="cm"), "did you mean 'unit'"),
        (lambda: vlscan.Survey(wall(), leg=[]), r"Survey\(\) has no keyword 'leg'; did you mean 'legs'"),
        (lambda: vlscan.Survey.open("survey.xml", legz=[]), r"Survey\(\) has no keyword 'legz'; did you mean 'legs'"),
        (lambda: vlscan.raster("a.laz", dsmm=True), r"raster\(\) has no keyword 'dsmm'; did you mean 'dsm'"),
        (lambda: vlscan.compare("a.laz", "b.laz", cel=1), "did you mean 'cell'"),
        (lambda: vlscan.plan_airborne("riegl_vux-1uav", heigt=60), "did you mean 'height'"),
        (lambda: vlscan.make_scene("forest", "out", sed=1), "did you mean 'seed'"),
        (lambda: vlscan.preview("a.laz", "a.png", hight=3), "did you mean 'height'"),
        (lambda: vlscan.raster("a.laz", seconds=1), "there are dtm, dsm"),
    ],
)
def test_unknown_keywords_of_functions_have_a_suggestion(call, message):
    with pytest.raises(TypeError, match=message):
        call()


def test_functions_with_suggestions_keep_their_signatures():
    assert "reflectance" in inspect.signature(vlscan.Material).parameters
    assert next(iter(inspect.signature(vlscan.Survey).parameters)) == "scene"
    assert inspect.signature(vlscan.Part.mesh).parameters["materials"].default is None
    assert pickle.loads(pickle.dumps(vlscan.compare)) is vlscan.compare


def test_numbers_of_other_types_are_numbers():
    assert wall().scale(Decimal("0.5")) == wall().scale(np.float32(0.5)) == wall().scale(np.array(0.5))
    assert wall().rotate((0, 0, 1), np.int64(90)) == wall().rotate(np.array([0, 0, 1], ">f4"), 90.0)
    assert wall().drop_to_ground(np.bool_(True)).on_ground == wall().drop_to_ground(np.int64(1)).on_ground == 1
    assert wall(np.array(SQUARE, ">f4"), np.array(FACES, ">i2")) == wall(np.asfortranarray(SQUARE, float)) == wall()


def test_frames_where_rows_are_expected_name_what_has_them():
    pandas = pytest.importorskip("pandas")
    pattern = vlscan.Scanner("livox_mid-360", optics="pattern", pattern=pandas.DataFrame([[0.0, 1.0]]))
    with pytest.raises(TypeError, match=r"pattern: .*found DataFrame; to_numpy\(\) has its rows"):
        survey(scanner=pattern).document()


def test_points_to_compare_and_join_are_checked(points):
    with pytest.raises(ValueError, match="the points have different columns: not all have Amplitude"):
        vlscan.Points.concat([points, vlscan.Points.of(points.xyz)])
    with pytest.raises(TypeError, match="dtype is int8, expected a type of floating point"):
        points.coordinates("int8")
    with pytest.warns(vlscan.VlscanWarning, match=r"16-bit floats resolve 0.00\d+ m"):
        points.coordinates("float16")
    for wrong, message in (({"width": 800.5}, "width is 800.5"), ({"title": 3}, "title is 3"), ({"colour": None}, "colour is None")):
        with pytest.raises(TypeError, match=message):
            points.png(**wrong)
    with pytest.raises(ValueError, match="max_points is -1"):
        points.html(max_points=-1)
    with pytest.raises(TypeError, match="did you mean 'labels'"):
        points.write("points.laz", label=True)


def test_systems_are_codes_numbers_or_objects(points):
    pyproj = pytest.importorskip("pyproj")
    text = vlscan.Points.of(points, crs="EPSG:25832").crs
    assert vlscan.Points.of(points, crs=25832).crs == text
    with warnings.catch_warnings():
        # The place of the wall is not in the area of the system.
        warnings.simplefilter("ignore")
        assert "25832" in survey().run(seed=1, crs=pyproj.CRS(25832)).points.crs
    assert "25832" in vlscan.Points.of(points, crs=pyproj.CRS(25832)).crs


def test_names_of_files_may_be_bytes(points, tmp_path):
    name = os.fsencode(tmp_path / "Bäume.laz")
    points.write(name)
    assert vlscan.cloud_info(name)["points"] == len(points)
    vlscan.preview(name, os.fsencode(tmp_path / "Bäume.png"), width=320, height=240)
    assert (tmp_path / "Bäume.png").exists()


def test_a_deleted_temporary_file_of_points_is_named():
    part = vlscan.Part.points(SQUARE, 0.5)
    shutil.rmtree(os.path.dirname(os.fspath(part._arguments[0])))
    for call in (lambda: vlscan.Scene(part).bounds, lambda: pickle.dumps(part)):
        with pytest.raises(vlscan.InputError, match="has been deleted; make the part again"):
            call()
