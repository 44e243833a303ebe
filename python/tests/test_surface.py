"""The edges of the module: typos, types, arrays, files without names, warnings, what objects print."""

import datetime
import io
import logging
import pickle
import typing
from pathlib import Path

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES
from vlscan import Leg, Part, Points, Scanner, Scene, Survey
from vlscan._keys import LegSettings, ScannerKeys, known_keys

SQUARE = [[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]]


def ground():
    return Part.mesh(SQUARE, [[0, 1, 2, 3]])


def survey():
    return Survey(ground(), "riegl_vz400", [Leg((0, 0, 2), scan_freq_hz=120, head_rate_deg_per_s=60, head_stop_deg=20)])


@pytest.fixture(scope="module")
def points():
    return survey().run(seed=1).points


def test_a_typo_of_an_attribute_is_an_error_with_a_suggestion():
    made = survey()
    with pytest.raises(AttributeError, match="no attribute 'scaner'; did you mean 'scanner'"):
        made.scaner = "vlp16"
    with pytest.raises(AttributeError, match="did you mean 'position'"):
        made.legs[0].postion = (1, 2, 3)
    with pytest.raises(AttributeError, match="there are keys"):
        made.scanner.colour = "red"


def test_attributes_are_converted_and_checked():
    made = survey()
    made.scanner, made.scene, made.platform = "vlp16", ground(), "static"
    assert isinstance(made.scanner, Scanner) and isinstance(made.scene, Scene) and made.platform.keys == {"kind": "static"}
    for name, wrong in [("scanner", 3), ("scene", 3), ("scene", [3]), ("platform", 3), ("legs", [(0, 0, 1)]), ("legs", Leg()), ("name", 3)]:
        with pytest.raises(TypeError, match="found"):
            setattr(made, name, wrong)
    made.legs.append((0, 0, 1))
    with pytest.raises(TypeError, match="expected Leg, found tuple"):
        made.run()
    with pytest.raises(ValueError, match="expected x, y, z"):
        Leg((0, 0))


def test_scenes_and_materials_say_what_they_expect():
    class Mesh:
        vertices, faces = np.eye(3), np.array([[0, 1, 2]])

    for call in (lambda: Scene([Mesh()]), lambda: Survey(Mesh()), lambda: vlscan.trace(Mesh(), (0, 0, 1), np.eye(3))):
        with pytest.raises(TypeError, match="found Mesh; Part.of"):
            call()
    for call in (lambda: ground().with_material("soil"), lambda: Part.mesh(SQUARE, [[0, 1, 2, 3]], materials="soil")):
        with pytest.raises(TypeError, match="soil"):
            call()


def test_keywords_of_legs_and_scanners_are_checked_and_typed():
    with pytest.raises(TypeError, match="Leg has no keyword 'scan_frq_hz'; did you mean 'scan_freq_hz'"):
        Leg(scan_frq_hz=120)
    with pytest.raises(TypeError, match="Scanner has no keyword 'acuracy_m'; did you mean 'accuracy_m'"):
        Scanner("riegl_vz400", acuracy_m=0.01)
    with pytest.raises(TypeError, match="settings of a survey has no keyword"):
        Survey(settings={"scan_frq_hz": 1})
    assert set(typing.get_type_hints(LegSettings)) == set(known_keys("[settings]"))
    assert set(typing.get_type_hints(ScannerKeys)) == set(known_keys("[scanner]")) - {"name"}


def test_an_array_of_points_is_structured(points):
    rows = np.asarray(points)
    assert rows.dtype.names == tuple(points.columns) and (rows["X"] == points["X"]).all()
    assert np.asarray(points[:5], dtype="float32").shape == (5, len(points.columns))
    with pytest.raises(KeyError, match="did you mean 'Intensity'"):
        points["intensity"]
    with pytest.raises(IndexError, match=r"table\[3:4\]"):
        points[3]


def test_a_frame_of_pandas_has_the_columns(points):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(points)
    assert frame.equals(points.to_pandas()) and list(frame.columns) == points.columns
    frame["X"] = 0.0
    assert (points["X"] != 0).any(), "a frame is a copy"
    some = pandas.DataFrame(points, columns=["Z", "X"], index=range(1, len(points) + 1))
    assert list(some.columns) == ["Z", "X"] and some["X"][1] == points["X"][0]
    assert pandas.DataFrame(points[:0]).shape == (0, len(points.columns))
    assert not isinstance(points, dict) and isinstance(points, Points) and points.__class__ is Points
    with pytest.raises(TypeError, match="pandas.DataFrame"):
        pandas.Series(points)


def test_columns_are_listed_as_those_of_mappings(points):
    assert [name for name, _ in points.items()] == points.keys() == points.columns
    assert all(column is points[name] for name, column in points.items())
    assert all(column is points[name] for name, column in zip(points, points.values(), strict=True))


@pytest.mark.parametrize("library", ["pandas", "polars", "arrow", "laspy", "xarray", "geopandas"])
def test_points_are_made_of_what_they_become(points, library):
    pytest.importorskip("pyarrow" if library == "arrow" else library)
    back = Points.of(getattr(points, f"to_{library}")())
    assert len(back) == len(points) and abs(back.xyz - points.xyz).max() < 1e-3
    assert (back["ReturnNumber"] == points["ReturnNumber"]).all()


def test_batches_are_joined(points):
    made = survey()
    joined = Points.concat(made.run_batches(1000, seed=1))
    assert joined.columns == points.columns and all((joined[name] == points[name]).all() for name in points.columns)
    assert len(Points.concat([points, points])) == 2 * len(points)
    with pytest.raises(ValueError, match="at least one table"):
        Points.concat([])
    with pytest.raises(ValueError, match="different columns"):
        Points.concat([points, Points.of(points.xyz)])
    with pytest.raises(TypeError, match="expected Points, found dict"):
        Points.concat([points, dict(points)])


def test_joined_batches_are_written_as_the_run_writes_them(tmp_path):
    made = survey()
    made.run(to=tmp_path / "run.laz", seed=1)
    Points.concat(made.run_batches(1000, seed=1)).write(tmp_path / "joined.laz")
    assert (tmp_path / "joined.laz").read_bytes() == (tmp_path / "run.laz").read_bytes()


def test_batches_are_a_context_and_have_the_result(points):
    with survey().run_batches(1000, seed=1) as batches:
        first = next(batches)
        assert not batches.is_complete and len(first) == 1000
    assert list(batches) == [] and not batches.is_complete
    with pytest.raises(RuntimeError, match="its last batch"):
        batches.result
    with survey().run_batches(1000, seed=1) as batches:
        assert sum(map(len, batches)) == len(points) == batches.result.point_count
    for wrong in (0, -1):
        with pytest.raises(ValueError, match="expected at least 1"):
            survey().run_batches(wrong)
    with pytest.raises(TypeError):
        survey().run_batches(1.5)


def test_points_go_through_file_objects(points):
    file = io.BytesIO()
    points.write(file, format="laz")
    file.seek(0)
    assert len(Points.read(file)) == len(points)
    with pytest.raises(ValueError, match="give its format"):
        points.write(io.BytesIO())


def test_nothing_is_replaced_without_force(points, tmp_path):
    (tmp_path / "own.png").write_text("mine")
    with pytest.raises(vlscan.InputError, match="force=True"):
        points.save_preview(tmp_path / "own.png")
    assert (tmp_path / "own.png").read_text() == "mine"
    points.save_preview(tmp_path / "own.png", force=True)
    ground = FIXTURES / "forest/ground.obj"
    plan = vlscan.plan_terrestrial("riegl_vz400", around=(0, 0), radius=5, positions=3, resolution=0.2, scene=ground)
    plan.save(tmp_path / "own.toml")
    with pytest.raises(vlscan.InputError, match="force=True"):
        plan.save(tmp_path / "own.toml")
    plan.save(tmp_path / "own.toml", force=True)
    assert len(repr(plan)) < 200 and repr(plan).startswith("<Plan: riegl_vz400")


def test_switches_are_truth_values(points):
    made = survey()
    assert len(made.run(seed=1, misses=np.True_).points) == len(made.run(seed=1, misses=1).points) > 0
    assert len(made.run(seed=np.int64(1), misses=np.False_).points) == len(points)
    for wrong in ({"misses": 2}, {"misses": "yes"}, {"seed": True}):
        with pytest.raises(TypeError, match=next(iter(wrong))):
            made.run(**wrong)


def test_each_warning_is_one_with_its_place(tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl a\nhelios_x 1\nnewmtl b\nhelios_y 1\n")
    faces = "usemtl a\nf 1 2 3\nusemtl b\nf 1 2 4\n"
    (tmp_path / "g.obj").write_text("mtllib m.mtl\nv -9 -9 0\nv 9 -9 0\nv 9 9 0\nv -9 9 0\n" + faces)
    made = Survey(tmp_path / "g.obj", "riegl_vz400", survey().legs)
    with pytest.warns(vlscan.VlscanWarning) as caught:
        result = made.run(seed=1)
    problems = [problem for problem in result.problems if problem.severity == "warning"]
    assert [warning.message.problem for warning in caught] == problems and len(problems) > 1
    assert not any(str(warning.message).startswith("warning") for warning in caught)
    placed = next(problem for problem in problems if problem.line is not None)
    assert any(str(warning.message).startswith(f"{placed.file}:{placed.line}:{placed.column}: ") for warning in caught)


def test_the_logger_is_silent_until_it_is_asked(caplog):
    from vlscan.errors import report

    with caplog.at_level(logging.INFO, "vlscan"):
        report([{"severity": "note", "message": "the scene has no ground"}])
    assert caplog.messages == ["the scene has no ground"]
    assert any(isinstance(handler, logging.NullHandler) for handler in logging.getLogger("vlscan").handlers)


def test_objects_print_what_they_are():
    part = Part.obj("tree.obj").scale(2).translate(1, 2, 3).named("7")
    assert repr(part) == "<Part: mesh file, 'tree.obj', id '7', scale 2, at 1, 2, 3>"
    assert repr(ground()) == "<Part: mesh, 1 faces>"
    assert "legs" not in repr(Survey.open(FIXTURES / "room/survey.xml")) and repr(survey()).endswith("1 leg)")


def test_points_of_an_array_become_voxels():
    cloud = Part.points(np.array([[0.1, 0, 0], [1, 0, 0], [0, 1, 2]]), voxel_size=0.5)
    assert "array" in repr(cloud) and Scene(cloud).primitives == 3
    twin = pickle.loads(pickle.dumps(cloud))
    del cloud
    assert Scene(twin.translate(1, 0)).primitives == 3
    with pytest.raises(ValueError, match=r"shape \(3,\), expected n by 3 or more"):
        Part.points([1, 2, 3], voxel_size=0.5)
    with pytest.raises(ValueError, match=r"points\[1\] is at \[0.0, nan, 1.0\]"):
        Part.points([[0, 0, 0], [0, np.nan, 1]], voxel_size=0.5)


def test_points_of_objects_and_turned_arrays_are_recognised(points):
    cloud = Part.points(points, voxel_size=0.5)
    assert cloud == Part.points(points.xyz, voxel_size=0.5)
    with pytest.raises(ValueError, match="a point per row, not per column"):
        Part.points(np.zeros((3, 21)), voxel_size=0.5)
    assert isinstance(Part.points(np.zeros((3, 20)), voxel_size=0.5), Part)
    with pytest.raises(ValueError, match=r"table of X, Y, .* Points\.of\(table\)"):
        Part.points(points.to_numpy(["X", "Y"]), voxel_size=0.5)


def test_a_way_is_three_numbers_or_one_sequence():
    part = ground()
    for way in ([1, 2, 3], (1, 2, 3), np.array([1, 2, 3], "f4")):
        assert part.translate(way) == part.translate(1, 2, 3)
    for wrong in (1, [1, 2], [1, 2, np.nan]):
        with pytest.raises(ValueError, match="three finite numbers"):
            part.translate(wrong)
    with pytest.raises(TypeError, match="a translation is '123'"):
        part.translate("123")
    with pytest.raises(ValueError, match="rows of different lengths|three finite numbers"):
        part.translate([1, 2, 3], z=4)
    with pytest.raises(TypeError, match="an axis is 'z', expected three numbers"):
        part.rotate("z", 90)


def test_tables_are_not_changed_by_assignment(points):
    with pytest.raises(TypeError, match=r"Points cannot be changed; .* Points\.of\(frame\)"):
        points["Classification"] = 6


def test_a_typo_of_an_argument_has_a_suggestion_among_the_arguments():
    with pytest.raises(TypeError, match="did you mean 'time'"):
        vlscan.trace(ground(), (0, 0, 2), (0, 0, -1), times=0.5)
    with pytest.raises(TypeError, match="did you mean 'waveforms'"):
        survey().run(wavforms=True)
    with pytest.raises(TypeError, match="did you mean 'seconds'"):
        survey().run_batches(second=1)
    with pytest.raises(TypeError, match="did you mean 'batch_columns'"):
        survey().run_batches(batch_column="X")
    with pytest.raises(TypeError, match="did you mean 'progress'"):
        survey().run(progres=True)
    with pytest.raises(TypeError, match="did you mean 'interval'"):
        survey().fly_trajectory(intervall=1)
    with pytest.raises(TypeError, match="did you mean 'resume'"):
        vlscan.run_shard(survey(), "shards", 0, 1, resum=True)
    with pytest.raises(TypeError, match="did you mean 'scanner'"):
        Scene(ground()).load(scaner="vlp16")
    # Not those of other functions.
    for call, wrong in [(survey().dry_run, {"progres": True}), (survey().fly_pulses, {"las_scal": 1}), (survey().contents, {"rows_": 1})]:
        with pytest.raises(TypeError, match=r"vlscan\.options\(\) lists them"):
            call(**wrong)
    with pytest.raises(TypeError, match="rows is 10000.0, expected a whole number"):
        survey().run_batches(1e4)


def test_pulses_are_given_once():
    down = {"x": [0.0], "y": [0.0], "z": [2.0], "dx": [0.0], "dy": [0.0], "dz": [-1.0]}
    assert vlscan.trace(ground(), pulses=down).point_count == 1
    for more in ({"origins": (0, 0, 2), "directions": (0, 0, -1)}, {"time": 1.0}):
        with pytest.raises(TypeError, match="either pulses"):
            vlscan.trace(ground(), pulses=down, **more)


def test_times_of_pulses_are_seconds():
    for wrong in (np.array(["2024-01-01"], "datetime64[ns]"), np.array([1], "timedelta64[s]")):
        with pytest.raises(TypeError, match="time is of (datetime64|timedelta64).* are seconds"):
            vlscan.trace(ground(), (0, 0, 2), (0, 0, -1), time=wrong)


def test_files_without_an_extension_are_errors(points, tmp_path):
    for format in (None, "laz"):
        with pytest.raises(vlscan.InputError, match="points has no extension; add one, such as .laz"):
            points.write(tmp_path / "points", format=format)
    with pytest.raises(vlscan.InputError, match=r"is a folder; .*points\.laz"):
        points.write(tmp_path, format="laz")
    points.write(tmp_path / "points.dat", format="laz")
    assert len(Points.read(tmp_path / "points.dat")) == len(points)


def test_scenes_and_parts_are_drawn(tmp_path):
    for number, source in enumerate((ground(), Scene(ground()))):
        vlscan.preview(source, tmp_path / f"{number}.png", width=320, height=240)
        vlscan.preview(source, tmp_path / f"{number}.html", max_points=100)
        assert (tmp_path / f"{number}.png").read_bytes().startswith(b"\x89PNG")
        assert b"<html" in (tmp_path / f"{number}.html").read_bytes()


def test_a_survey_of_objects_says_what_it_lacks():
    for made, missing in (
        (Survey(ground(), "riegl_vz400"), "no legs and no trajectory:"),
        (Survey(ground(), legs=[Leg()]), "no scanner:"),
        (Survey(), "no scene, no scanner, no legs and no trajectory:"),
    ):
        for fly in (made.run, made.run_batches, made.dry_run, made.fly_trajectory, made.fly_pulses):
            with pytest.raises(vlscan.InputError, match=f"the survey has {missing}"):
                fly()


def test_parts_are_equal_if_they_are_made_alike():
    tree = Part.obj("beech.obj")
    assert tree == Part.obj("beech.obj") and len({tree, Part.obj("beech.obj")}) == 1
    assert tree != tree.translate(1, 0) and tree != Part.obj("spruce.obj") and tree != "beech.obj"
    assert tree.translate(1, 0) == tree.translate(1, 0)
    assert ground() == ground() == pickle.loads(pickle.dumps(ground())) and ground() != ground().with_material(vlscan.Material("soil"))
    assert ground() != Part.mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]) and len({ground(), ground()}) == 1


def test_values_of_legs_are_checked():
    assert Leg(np.array([0, 1, 2], ">f4"), active=np.False_).position == [0, 1, 2]
    for wrong in ("002", {0, 1, 2}, None):
        with pytest.raises(TypeError):
            Leg(wrong)
    with pytest.raises(ValueError, match=r"position of a leg is \[0.0, 0.0, nan\], expected finite numbers"):
        Leg((0, 0, np.nan))
    for name in ("active", "on_ground"):
        with pytest.raises(TypeError, match=f"{name} of a leg is True or False"):
            Leg(**{name: "no"})


def test_values_of_materials_places_and_intervals_are_checked():
    for wrong in (
        {"name": 3},
        {"is_ground": "no"},
        {"spectrum": 3},
        {"classification": 1.5},
        {"diffuse": (1, 2)},
        {"diffuse": (np.nan, 0, 0)},
    ):
        with pytest.raises((TypeError, ValueError), match="of the material"):
            vlscan.Material(**wrong)
    assert vlscan.Material("a", classification=np.uint8(5), is_ground=np.True_).classification == 5
    with pytest.raises(ValueError, match="finite"):
        ground().translate(np.nan, 0)
    for size in (0, -1, np.nan):
        with pytest.raises(ValueError, match="voxel_size"):
            Part.points([[0, 0, 0]], voxel_size=size)
    with pytest.raises(ValueError, match="above 0"):
        vlscan.trajectory(FIXTURES / "room/survey.xml", interval=0)
    with pytest.raises(TypeError, match="interval is '1 s', expected a number of seconds"):
        vlscan.trajectory(FIXTURES / "room/survey.xml", interval="1 s")
    with pytest.raises(TypeError, match="name of a file"):
        vlscan.run(FIXTURES / "room/survey.xml", to=3)
    with pytest.raises(ValueError, match="names no column"):
        vlscan.run(FIXTURES / "room/survey.xml", columns=[])


def test_times_of_other_kinds_start_the_clock():
    room = FIXTURES / "room/survey.xml"
    times = ["2024-05-06 00:00:00", datetime.date(2024, 5, 6), np.datetime64("2024-05-06"), np.datetime64("2024-05-06T00:00:00", "ns")]
    first = {vlscan.run(room, seed=1, gps_start=time).points["GpsTime"][0] for time in times}
    assert len(first) == 1


def test_unknown_facts_of_clouds_have_a_suggestion():
    with pytest.raises(KeyError, match="did you mean 'bounds_m'"):
        vlscan.cloud_info([[0, 0, 0], [1, 1, 1]])["bounds"]


def test_faces_are_chosen_by_a_mask_or_by_numbers():
    part = ground()
    assert part.face_numbers([True]).tolist() == part.face_numbers(0).tolist() == [0]
    with pytest.raises(ValueError, match="expected 0 to 0"):
        part.face_numbers([1])


def test_pictures_of_cells_are_small():
    points = vlscan.run(FIXTURES / "forest/survey.xml", seed=1).points
    assert 5_000 < len(points._repr_html_()) < 60_000 and 2_000 < len(Scene(ground())._repr_html_()) < 60_000


def test_messages_do_not_name_temporary_files(points, tmp_path):
    with pytest.raises(vlscan.InputError, match="^error: <points> is a RIEGL RDB database"):
        Points.read(io.BytesIO(b"RIEGL LMS RDB 2 POINTCLOUD FILE\0\0"))
    places = Points.of(points.xyz)
    with pytest.warns(vlscan.VlscanWarning, match="^<points>: the points have no") as caught:
        places.write(io.BytesIO(), format="laz")
    assert [(warning.filename, warning.message.problem.file) for warning in caught] == [(__file__, "<points>")]
    with (
        pytest.warns(vlscan.VlscanWarning, match="^<points>: ") as caught,
        pytest.raises(vlscan.InputError, match="^error: <points> has 0 points of class 2") as error,
    ):
        vlscan.reconstruct(places, tmp_path / "scene")
    assert caught[0].filename == __file__ and error.value.problems[0].message.startswith("<points> has")
    trees = {"x": [1.0], "y": [2.0], "height": [-3.0], "species": ["beech"]}
    with pytest.raises(vlscan.InputError, match="--> <inventory>:2:1") as error:
        vlscan.make_stand(trees, FIXTURES / "forest", tmp_path / "stand")
    assert error.value.problems[0].file == "<inventory>"
    with pytest.raises(vlscan.InputError, match="scene= <scene>: none of its materials is ground"):
        vlscan.plan_terrestrial("riegl_vz400", spacing=20, scene=ground())


def test_tables_and_times_are_checked():
    with pytest.raises(TypeError, match="expected a table with the columns X, Y, Z, or an array of n by 3, found Survey"):
        Points.of(survey())
    with pytest.raises(TypeError, match="expected a table of columns, found str"):
        vlscan.trace(ground(), pulses="pulses.csv")
    with pytest.raises(ValueError, match=r"time has the shape \(2,\), expected one number or 3"):
        vlscan.trace(ground(), [[0, 0, 1]] * 3, (0, 0, -1), time=[0, 1])
    with pytest.raises(TypeError, match="legs are a list of Leg, found Leg"):
        Survey(ground(), "riegl_vz400", Leg())


def test_values_that_were_ignored_or_failed_late_are_errors(points, tmp_path, monkeypatch):
    with pytest.raises(TypeError, match="progress is a function, True or False, found 'x'"):
        survey().run(progress="x")
    with pytest.raises(ValueError, match="different lengths: {'X': 1, 'Y': 1, 'Z': 2}"):
        Points.of({"X": [1.0], "Y": [2.0], "Z": [1.0, 2.0]})
    with pytest.raises(TypeError, match="binary file objects"):
        Points.read(io.StringIO("1 2 3"))
    with pytest.raises(TypeError, match="binary file objects"):
        points.write(io.StringIO(), format="csv")
    monkeypatch.chdir(tmp_path)
    assert survey().run(to=b"a.laz", seed=1).files == ["a.laz"]
    assert {Path(folder).parent.name for folder in survey().run(output="out", seed=1).directories} == {"survey"}
    assert repr(Leg((1, 2, 3), active=False, scan_freq_hz=50)) == "Leg((1.0, 2.0, 3.0), active=False, scan_freq_hz=50)"


def test_batches_print_what_they_are():
    batches = survey().run_batches(1000, seed=1)
    assert repr(batches) == "<Batches: not begun>"
    next(batches)
    assert repr(batches) == "<Batches: begun>"
    assert len(list(batches)) > 1 and repr(batches).startswith("<Batches of <Result: ")


def test_rows_of_arrays_are_named_by_their_index():
    down = [[0, 0, -1], [0, 0, -1], [0, 0, 0]]
    with pytest.raises(vlscan.InputError, match="error: index 2: 0 0 0 is not a direction\n--> <pulses>"):
        vlscan.trace(ground(), [[0, 0, 1]] * 3, down)
    poses = np.array([[0, 0, 0, 9, 0, 0, 0], [1, 0, 0, np.nan, 0, 0, 0]])
    settings = {"scan_angle_deg": 20, "scan_freq_hz": 50, "pulse_freq_hz": 83_000}
    with pytest.raises(vlscan.InputError, match="error: index 1: expected a number for z"):
        Survey(ground(), "leica_als50", platform="sr22", trajectory=poses, settings=settings).run()


def test_a_packed_scene_is_replaced_with_force_alone(tmp_path):
    scene = Scene(ground())
    scene.pack(tmp_path / "a.vlscene")
    with pytest.raises(vlscan.InputError, match="exists already; replace it with force=True"):
        scene.pack(tmp_path / "a.vlscene")
    scene.pack(tmp_path / "a.vlscene", force=True)
    assert Scene(tmp_path / "a.vlscene").primitives == 2


def test_messages_about_lines_name_the_method(tmp_path):
    plan = vlscan.plan_airborne("riegl_vux-1uav", 50, density=2, scene=ground())
    with pytest.raises(vlscan.InputError, match=r"^error: write_lines\(\): GeoJSON and KML"):
        plan.write_lines(tmp_path / "a.kml")
