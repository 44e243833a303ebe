"""Runs: to memory, to files, batch by batch, with progress, errors and interruption."""

import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES, ROOT
from vlscan import Leg, Material, Part, Scene, Survey

pyarrow = pytest.importorskip("pyarrow")


LEG = Leg((0, 0, 5), scan_freq_hz=50, head_rate_deg_per_s=36, head_stop_deg=90)


def wall(size=10.0, z=0.0):
    """A square in the xy plane."""
    corners = [[-size, -size, z], [size, -size, z], [size, size, z], [-size, size, z]]
    return corners, [[0, 1, 2], [0, 2, 3]]


def long_survey(seconds=600):
    """A survey of 100 000 pulses per second over a plane."""
    leg = Leg((0, 0, 20), scan_freq_hz=100, head_rate_deg_per_s=360 / seconds, head_stop_deg=360)
    return Survey([Part.mesh(*wall(1000))], "riegl_vz400", [leg])


def test_memory_has_the_bytes_of_the_command(room, command, tmp_path):
    file = tmp_path / "room.arrow"
    done = command("run", room, "-o", file, "--seed", 7)
    assert done.returncode == 0, done.stderr
    expected = pyarrow.ipc.open_stream(file).read_all()
    for threads in (1, 2):
        points = vlscan.run(room, seed=7, threads=threads).points
        assert points.columns == expected.column_names and len(points) == len(expected) > 10_000
        for name in points:
            assert np.asarray(expected[name]).tobytes() == points[name].tobytes(), name
    assert points.metadata["scanner"] == expected.schema.metadata[b"scanner"].decode()


def test_columns_are_not_copied(room):
    points = vlscan.run(room).points
    assert points["X"] is points["X"] and not points["X"].flags.owndata and not points["X"].flags.writeable
    x = points["X"]
    first = x[0]
    del points
    assert x[0] == first
    table = pyarrow.table(vlscan.run(room).points)
    assert table.num_rows == len(x) and table["X"].num_chunks == 1


def test_other_libraries_take_points(room):
    points = vlscan.run(room, columns=["X", "Y", "Z", "ReturnNumber"]).points
    assert points.columns == ["X", "Y", "Z", "ReturnNumber"] and points.units == {"X": "m", "Y": "m", "Z": "m"}
    rows = points.to_numpy()
    assert rows.dtype.names == ("X", "Y", "Z", "ReturnNumber") and (rows["Z"] == points["Z"]).all()
    assert points.xyz.shape == (len(points), 3) and (points.bounds[0] <= points.xyz.min(axis=0)).all()
    polars = pytest.importorskip("polars")
    assert polars.DataFrame(points).shape == (len(points), 4) and points.to_polars()["X"][5] == points["X"][5]
    pandas = pytest.importorskip("pandas")
    assert pandas.DataFrame(dict(points)).shape == (len(points), 4) and points.to_pandas()["X"][5] == points["X"][5]
    duckdb = pytest.importorskip("duckdb")
    arrow = points.to_arrow()  # noqa: F841
    first = duckdb.sql("select count(*) from arrow where ReturnNumber = 1").fetchall()[0][0]
    assert first == (points["ReturnNumber"] == 1).sum() > 10_000


def test_points_in_memory_are_counted(room):
    for recorded in ({}, {"waveforms": True, "pulses": True}):
        result = vlscan.run(room, **recorded)
        assert result.point_count == len(result.points) > 10_000 and f"{len(result.points):,} points" in repr(result)


def test_batches_join_to_the_points(room):
    whole = vlscan.run(room, seed=3).points
    batches = list(vlscan.run_batches(room, rows=1000, seed=3))
    assert [len(batch) for batch in batches[:-1]] == [1000] * (len(batches) - 1)
    assert np.concatenate([batch["GpsTime"] for batch in batches]).tobytes() == whole["GpsTime"].tobytes()


def test_batches_end_with_legs(room):
    whole = vlscan.run(room, seed=3).points
    legs = list(vlscan.run_batches(room, per_leg=True, seed=3, columns=["X", "PointSourceId"]))
    assert [np.unique(batch["PointSourceId"]).tolist() for batch in legs] == [[1], [2]]
    assert np.concatenate([batch["X"] for batch in legs]).tobytes() == whole["X"].tobytes()
    # Long legs have several batches.
    sizes = [len(batch) for batch in vlscan.run_batches(room, rows=10_000, per_leg=True, seed=3)]
    ends = np.cumsum(sizes)
    assert len(legs[0]) in ends and ends[-1] == len(whole) and max(sizes) == 10_000


def test_batches_may_have_other_columns_than_files(room, tmp_path):
    vlscan.run(room, to=tmp_path / "usual.xyz", seed=3)
    whole = vlscan.run(room, seed=3, columns=["BeamOriginX", "X"]).points
    with vlscan.run_batches(room, to=tmp_path / "points.xyz", batch_columns=["BeamOriginX", "X"], seed=3) as batches:
        beside = vlscan.Points.concat(batches)
    assert beside.columns == ["BeamOriginX", "X"] and beside.to_numpy().tobytes() == whole.to_numpy().tobytes()
    assert (tmp_path / "points.xyz").read_bytes() == (tmp_path / "usual.xyz").read_bytes()
    # Without files they are the columns of the points.
    assert next(vlscan.run_batches(room, batch_columns="X", seed=3)).columns == ["X"]
    with pytest.raises(ValueError, match="no column is called .Q."):
        next(vlscan.run_batches(room, to=tmp_path / "a.laz", batch_columns=["Q"]))


def test_batches_end_at_intervals_of_time(room):
    whole = vlscan.run(room, seed=3).points
    batches = list(vlscan.run_batches(room, seconds=0.25, seed=3))
    assert np.concatenate([batch["GpsTime"] for batch in batches]).tobytes() == whole["GpsTime"].tobytes()
    intervals = [np.unique(batch["GpsTime"] // 0.25).tolist() for batch in batches]
    assert all(len(interval) == 1 for interval in intervals) and len(intervals) > 3
    assert np.all(np.diff(np.concatenate(intervals)) >= 1)
    with pytest.raises(vlscan.InputError, match="GpsTime"):
        list(vlscan.run_batches(room, seconds=1, columns=["X"]))
    with pytest.raises(ValueError, match="rows is 0, expected at least 1"):
        vlscan.run_batches(room, rows=0)
    with pytest.raises(ValueError, match="seconds"):
        vlscan.run_batches(room, seconds=0)


#: Threads and memory of a process are read from /proc, which Linux has.
HAS_PROC = pytest.mark.skipif(not os.path.isdir("/proc/self/task"), reason="there is no /proc")
#: Ctrl-C cannot be sent to a single process on Windows.
SENDS_CTRL_C = pytest.mark.skipif(sys.platform == "win32", reason="Windows sends Ctrl-C to all processes of a console")


def threads_of_the_process():
    return len(os.listdir("/proc/self/task"))


def test_leaving_a_loop_over_batches_ends_the_run():
    started = time.monotonic()
    for batch in long_survey().run_batches(rows=100):
        assert len(batch) == 100
        break
    assert time.monotonic() - started < 60


@HAS_PROC
def test_leaving_a_loop_over_batches_ends_its_threads():
    # Threads that stay, of the allocator or of pools, are there after the first run.
    next(long_survey().run_batches(rows=100))
    before = threads_of_the_process()
    for _ in long_survey().run_batches(rows=100):
        assert threads_of_the_process() > before
        break
    assert threads_of_the_process() == before


def test_a_wrong_option_of_batches_is_refused_at_the_call(room):
    with pytest.raises(TypeError, match="'seed'"):
        vlscan.run_batches(room, sed=1)
    with pytest.raises(ValueError, match="^labels is an option of files"):
        vlscan.run_batches(room, labels=True)


@pytest.mark.parametrize(
    "option",
    [
        {"format": "laz"}, {"force": True}, {"las10": True}, {"las_scale": 0.001}, {"las_at_most": 5}, {"las_extra": "none"},
        {"labels": True}, {"split_by_channel": True}, {"zip_output": True},
    ],
    ids=str,
)  # fmt: skip
def test_options_of_files_need_files(room, option):
    with pytest.raises(ValueError, match=f"^{next(iter(option))} is an option of files"):
        vlscan.run(room, **option)
    vlscan.run(room, columns=["X"], **dict.fromkeys(option))


def test_files_are_written(room, tmp_path):
    file = tmp_path / "room.csv"
    result = vlscan.run(room, to=file, columns=["X", "Y", "Z"])
    assert result.files == [str(file)] and len(file.read_text().splitlines()) == result.point_count + 1
    with pytest.raises(AttributeError, match="without to="):
        result.points
    with pytest.raises(vlscan.InputError, match="(?s)exists already.*force=True") as refused:
        vlscan.run(room, to=file)
    assert "--" not in str(refused.value) + refused.value.problems[0].message
    with pytest.raises(ValueError, match="names no file"):
        vlscan.run(room, to=[])
    assert vlscan.run(room, to=[file, tmp_path / "room.laz"], force=True).point_count == result.point_count


def test_waveforms_pulses_and_trajectory(room, tmp_path):
    survey = Survey.open(room, settings={"trajectory_interval_s": 0.01})
    result = survey.run(waveforms=True, pulses=True)
    pulses, waves = result.pulses, result.waveforms
    assert len(pulses) == result.pulse_count and np.allclose(np.hypot(np.hypot(pulses["dx"], pulses["dy"]), pulses["dz"]), 1)
    assert 0 < len(waves) <= len(pulses) and set(waves["pulse"]) <= set(pulses["pulse"])
    samples = waves.samples(0)
    assert len(samples) == waves["count"][0] and samples.max() > 0 and len(waves.all_samples) == waves["count"].sum()
    assert pyarrow.table(waves)["samples"][0].as_py() == samples.tolist()
    poses = result.trajectory
    assert poses.columns[:7] == ["time", "x", "y", "z", "roll", "pitch", "yaw"] and len(poses) > 1
    plain = vlscan.run(room, to=tmp_path / "room.laz", waveforms=True)
    assert any("fullwave" in file for file in plain.files)


def test_a_trajectory_of_arrays_is_that_of_a_file(tmp_path):
    time_s = np.arange(0, 5, 0.1)
    poses = np.column_stack([time_s, 10 * time_s - 25, 0 * time_s, 0 * time_s + 100, 0 * time_s, 0 * time_s, 0 * time_s + 90])
    file = tmp_path / "flight.csv"
    text = "\n".join(",".join(repr(float(v)) for v in row) for row in poses)
    file.write_text("time,x,y,z,roll,pitch,yaw\n" + text + "\n")
    scene = Scene([Part.mesh(*wall(200))])

    def points(trajectory):
        settings = {"scan_freq_hz": 50, "scan_angle_deg": 20, "pulse_freq_hz": 20_000}
        survey = Survey(scene, "riegl_lms-q780", platform="sr22", trajectory=trajectory, settings=settings)
        return survey.run(seed=1).points

    expected = points(file)
    assert len(expected) > 1000
    table = pyarrow.table({name: poses[:, i] for i, name in enumerate(["time", "x", "y", "z", "roll", "pitch", "yaw"])})
    for trajectory in (poses, {name: table[name].to_numpy() for name in table.column_names}, table):
        found = points(trajectory)
        assert all(found[name].tobytes() == expected[name].tobytes() for name in expected)
    with pytest.raises(ValueError, match="n by 7"):
        points(poses[:, :6])


def test_progress_is_told():
    seen = []
    long_survey(seconds=6).run(progress=lambda **now: seen.append(now), columns=["X"])
    assert seen[-1]["pulses"] > 200_000 and seen[-1]["done"] == 1
    assert [now["pulses"] for now in seen] == sorted(now["pulses"] for now in seen)


def test_an_error_of_the_progress_function_ends_the_run():
    def fail(**now):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        long_survey().run(progress=fail)


@SENDS_CTRL_C
def test_ctrl_c_ends_a_run(tmp_path):
    text = (
        "import sys; sys.path.insert(0, 'python/tests')\n"
        "from test_runs import long_survey\n"
        "try:\n"
        "    long_survey().run(to=sys.argv[1], progress=lambda **now: print(now['pulses'], flush=True))\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', flush=True)\n"
    )
    file = tmp_path / "x.xyz"
    process = subprocess.Popen([sys.executable, "-c", text, file], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    while (line := process.stdout.readline()) and int(line) < 1000:
        pass
    process.send_signal(signal.SIGINT)
    rest = process.stdout.read()
    assert process.wait() == 0 and rest.endswith("interrupted\n")
    assert (tmp_path / "x.partial.xyz").stat().st_size > 0 and not file.exists()


@SENDS_CTRL_C
@pytest.mark.parametrize("call", ["scene.load()", "scene.pack(folder + '/a.vlscene')", "survey.run()", "next(survey.run_batches())"])
def test_ctrl_c_ends_the_loading_of_a_scene(tmp_path, call):
    # Each part is a file of its own, whose loading takes some milliseconds.
    rows = [f"v {x} {y} 0" for y in range(100) for x in range(100)]
    rows += [f"f {c} {c + 1} {c + 101} {c + 100}" for y in range(99) for c in range(100 * y + 1, 100 * y + 100)]
    (tmp_path / "a.obj").write_text("\n".join(rows) + "\n")
    text = (
        "import os, sys, vlscan\n"
        "folder = sys.argv[1]\n"
        "for i in range(2000): os.link(folder + '/a.obj', f'{folder}/{i}.obj')\n"
        "scene = vlscan.Scene([vlscan.Part.obj(f'{folder}/{i}.obj') for i in range(2000)])\n"
        "survey = vlscan.Survey(scene, 'riegl_vz400', [vlscan.Leg(scan_freq_hz=50, head_rate_deg_per_s=36, head_stop_deg=90)])\n"
        "print('loading', flush=True)\n"
        "try:\n"
        f"    {call}\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', scene.is_loaded, sorted(os.listdir(folder))[-1], flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", text, tmp_path], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "loading\n"
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    sent = time.monotonic()
    assert process.stdout.read() == "interrupted False a.obj\n"
    assert process.wait() == 0 and time.monotonic() - sent < 2


@SENDS_CTRL_C
@pytest.mark.parametrize(
    "call",
    [
        "cloud_info('in')",
        "Points.read('in')",
        "raster('in', dtm=True)",
        "compare('in', 'b.csv')",
        "preview('in', 'a.png')",
        "reconstruct('in', 'found')",
        "fit_flight('in', 'a.toml')",
    ],
)
def test_ctrl_c_ends_functions_that_wait_for_their_file(tmp_path, call):
    os.mkfifo(tmp_path / "in")
    (tmp_path / "b.csv").write_text("x,y,z\n1,2,3\n")
    text = (
        "import vlscan\nprint('reading', flush=True)\n"
        f"try:\n    vlscan.{call}\nexcept KeyboardInterrupt:\n    print('interrupted', flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", text], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "reading\n"
    # Opens when somebody reads.
    writer = os.open(tmp_path / "in", os.O_WRONLY)
    process.send_signal(signal.SIGINT)
    assert process.stdout.read() == "interrupted\n" and process.wait() == 0
    os.close(writer)
    assert sorted(os.listdir(tmp_path)) == ["b.csv", "in"]


def test_threads_run_at_the_same_time(room):
    found = []
    scene = Scene([Part.mesh(*wall(50))])

    def points(seed):
        return Survey(scene, "riegl_vz400", [LEG]).run(seed=seed, threads=1).points["X"].tobytes()

    threads = [threading.Thread(target=lambda seed=seed: found.append((seed, points(seed)))) for seed in (1, 2, 1)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    expected = {seed: points(seed) for seed in (1, 2)}
    assert expected[1] != expected[2] and len(found) == 3 and all(bytes == expected[seed] for seed, bytes in found)


@HAS_PROC
def test_memory_does_not_grow_from_run_to_run():
    script = ROOT / "python/benches/memory.py"
    # With one heap: the C library's heaps per thread grow until each has been used.
    one_heap = {**os.environ, "MALLOC_ARENA_MAX": "1"}
    done = subprocess.run([sys.executable, script, "30"], env=one_heap, capture_output=True, text=True, check=True)
    second, last, _ = map(float, done.stdout.split())
    # The heap varies by a few megabytes. The points of a run, which nobody may keep, have more than one.
    assert second > 10 and last < second + 10


def test_false_undoes_a_switch_of_a_pipeline(room, tmp_path):
    file = tmp_path / "a.toml"
    file.write_text(f'survey = "{room}"\nmisses = true\n')
    with_misses, without = vlscan.run(file, seed=1), vlscan.run(file, seed=1, misses=False)
    # Missed pulses have a direction; in this room every pulse meets a wall.
    assert "BeamDirectionX" in with_misses.points and "BeamDirectionX" not in without.points


def test_errors_name_file_line_and_column(room, tmp_path):
    file = tmp_path / "a.toml"
    file.write_text('scene = "nothing.obj"\nscaner = 1\n')
    with pytest.raises(vlscan.InputError) as caught:
        vlscan.run(file)
    problem = next(problem for problem in caught.value.problems if "scaner" in problem.message)
    assert (problem.file, problem.line, problem.column) == (str(file), 2, 1) and "scanner" in problem.help
    assert problem.kind == "invalid" and any(problem.kind == "not_found" for problem in caught.value.problems)
    assert isinstance(caught.value, ValueError) and "a.toml:2:1: unknown key `scaner`" in str(caught.value)
    with pytest.raises(TypeError, match="'head_rate'; did you mean 'head_rate_deg_per_s'"):
        Leg(head_rate=1)
    with pytest.raises(vlscan.InputError) as caught:
        Survey([Part.mesh(*wall())], "riegl_vz400", [Leg(scan_angle_deg="wide")]).run()
    assert caught.value.problems[0].file == "<python>" and "scan_angle_deg" in str(caught.value)
    for options in ({}, {"output": tmp_path / "folder"}):
        survey = Survey([Part.mesh(*wall())], "riegl_vz400", [Leg(scan_angle_deg="wide")])
        with pytest.raises(vlscan.InputError) as caught:
            survey.run(**options)
        line = survey.document().splitlines()[caught.value.problems[0].line - 1]
        assert "scan_angle_deg" in line
    with pytest.raises(vlscan.InputError, match="riegl_vz400"):
        vlscan.Scanner("riegl_vz40")
    with pytest.raises(TypeError, match="'seed'"):
        vlscan.run(file, sed=1)
    with pytest.raises(vlscan.InputError, match="columns"):
        vlscan.run(file, columns=["Q"])
    with pytest.raises(vlscan.FileError) as caught:
        vlscan.run(room, to="/dev/full", format="xyz")
    assert isinstance(caught.value, OSError) and caught.value.filename == "/dev/full"


def test_warnings_are_warnings():
    survey = Survey([Part.mesh(*wall())], "riegl_vz400", [Leg((0, 0, 5000), scan_freq_hz=50, head_rate_deg_per_s=90, head_stop_deg=90)])
    line = sys._getframe().f_lineno
    with pytest.warns(vlscan.VlscanWarning) as caught:
        result = survey.run()
        vlscan.run(survey)
        list(survey.run_batches())
    assert any(problem.severity == "warning" for problem in result.problems)
    assert {(warning.filename, warning.lineno - line) for warning in caught} >= {(__file__, 2 + call) for call in range(3)}
    assert {warning.filename for warning in caught} == {__file__}


def test_pictures_warn_of_what_is_not_used_as_it_stands():
    columns = {"X": [1.0, 2.0, float("nan")], "Y": [0.0] * 3, "Z": [0.0] * 3, "class": [300.0, 2.0, 2.0], "omnivariance": [0.0] * 3}
    table = pyarrow.table(columns)
    for draw in (
        lambda: vlscan._vlscan.picture(table, "height", "", 640, 480),
        lambda: vlscan._vlscan.page(table, "height", "", 10),
    ):
        with pytest.warns(vlscan.VlscanWarning) as caught:
            draw()
        text = "\n".join(str(warning.message) for warning in caught)
        assert "not read: omnivariance" in text and "1 point has a class" in text and "1 point without coordinates" in text
        assert caught[0].filename == __file__


def test_nothing_is_printed(room, capfd):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        vlscan.run(room)
    assert capfd.readouterr() == ("", "")


def test_missing_and_odd_arguments():
    with pytest.raises(ValueError, match="vertices"):
        Part.mesh([[0, 0]], [[0, 0, 0]])
    with pytest.raises(ValueError, match="beyond"):
        Part.mesh([[0, 0, 0]], [[0, 0, 1]])
    with pytest.raises(vlscan.InputError, match="vertex 0"):
        Part.mesh([[np.nan, 0, 0]], [[0, 0, 0]])
    with pytest.raises(ValueError, match="an index per face"):
        Part.mesh(*wall(), materials=[Material()], material_of=[0])
    with pytest.raises(ValueError, match="material_of"):
        Part.mesh(*wall(), materials=[Material("a"), Material("b")])
    for odd in (1, -1, 2**31, 2**63, 2**64, 0.5, np.nan, np.inf, 2.0**63, True, "0"):
        with pytest.raises(ValueError, match="material_of"):
            Part.mesh(*wall(), materials=[Material()], material_of=[0, odd] if odd is not True else [False, True])
        corners, faces = wall()
        with pytest.raises(ValueError, match="faces"):
            Part.mesh(corners, [faces[0], [0, 2, 9 if odd in (0.5, 1, True) else odd]])
    Part.mesh(*wall(), materials=[Material(), Material()], material_of=[0.0, 1.0])
    for axis in ([0, 0, 1e200], [0, 0, np.inf], [0, 0, np.nan], [0, 0, 0]):
        with pytest.raises(ValueError, match="axis"):
            Part.mesh(*wall()).rotate(axis, 90)
    with pytest.raises(ValueError, match="angle"):
        Part.mesh(*wall()).rotate([0, 0, 1], np.nan)
    with pytest.raises(vlscan.InputError, match="empty"):
        Survey([Part.mesh(np.zeros((0, 3)), np.zeros((0, 3), int))], "riegl_vz400", [LEG]).run()
    with pytest.raises(TypeError, match="origins"):
        vlscan.trace([Part.mesh(*wall())])


def test_messages_name_keywords_instead_of_options():
    for text, expected in [
        ("overwrite it with --force", "overwrite it with force=True"),
        ("--las-scale 0.001 holds it", "las_scale=0.001 holds it"),
        ("state it with --crs CODE", "state it with crs="),
        ("name it with --crs EPSG:25832, or", 'name it with crs="EPSG:25832", or'),
        ("larger cells have more points (--cell 2)", "larger cells have more points (cell=2)"),
        ("--height -5: expected more than 0", "height=-5: expected more than 0"),
        ("--planes FILE.obj, --extend or --density", "planes=, extend= or density="),
        ("--physics helios, --chance --task 1/2", 'physics="helios", chance=True task= 1/2'),
        ('run = "--seed 3": --seed 1.5.2', 'run = "--seed 3": seed= 1.5.2'),
        ("`--scanner data/a b.xml#ID` or --scanner my/file.xml#ID", '`scanner= data/a b.xml#ID` or scanner="my/file.xml#ID"'),
        ("--scanner file.xml#ID takes one, --dtm and/or --dsm", 'scanner="file.xml#ID" takes one, dtm= and/or dsm='),
        ("`vlscan run --force` of `--force`", "`vlscan run --force` of `force=True`"),
        ("--no-such-option, a -- b and x--force", "--no-such-option, a -- b and x--force"),
    ]:
        assert vlscan.errors.in_python(text) == expected


def test_values_of_another_kind_are_named():
    with pytest.raises(TypeError, match="classification of the material 'a' is 'ground', expected a number.*2 is ground"):
        vlscan.Material("a", reflectance=0.3, classification="ground")


def test_origins_and_directions_are_broadcast():
    floor = vlscan.Part.mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2, 3]])
    two = [[0, 0, 5], [1, 0, 5]]
    for origins, directions, count in [(two, [[0, 0, -1]], 2), (two, [0, 0, -1], 2), ([0, 0, 5], [0, 0, -1], 1)]:
        assert vlscan.trace(floor, origins, directions).point_count == count
    for origins, directions in [(two, [[0, 0, -1]] * 3), ([0, 0], [0, 0, -1])]:
        with pytest.raises(ValueError):
            vlscan.trace(floor, origins, directions)
    with pytest.raises(TypeError, match="directions is 'up'"):
        vlscan.trace(floor, two, "up")
    with pytest.raises(ValueError, match="found origins of shape .2, 3. and directions of shape .3, 3."):
        vlscan.trace(floor, two, [[0, 0, -1]] * 3)


def test_no_pulses_are_traced_without_a_warning():
    floor = vlscan.Part.mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2, 3]])
    none = np.zeros((0, 3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert vlscan.trace(floor, none, none).point_count == 0


def test_options_are_values():
    survey = vlscan.Survey.open(FIXTURES / "room/survey.xml")
    expected = survey.run(seed=2, columns=["X"], assets=[FIXTURES], no_leg_noise=True).points["X"]
    given = {"seed": np.int64(2), "columns": ("X",), "assets": FIXTURES, "no_leg_noise": np.True_}
    assert np.array_equal(survey.run(**given).points["X"], expected)
    wide = 2**64 - 1
    assert survey.run(seed=wide, columns="X").point_count == survey.run(seed=str(wide), columns="X").point_count
    for wrong, message in [
        ({"threads": -1}, "threads: invalid value: integer `-1`"),
        ({"threads": "3"}, "threads: invalid type: string"),
        ({"chunk_size": 0}, "chunk_size: expected 1 to 16777216 pulses"),
        ({"physics": "real"}, "physics: unknown variant `real`"),
        ({"navigation_error": {"height": 3}}, "navigation_error: "),
    ]:
        with pytest.raises(vlscan.InputError, match=message):
            survey.run(**wrong)
    with pytest.raises(vlscan.InputError, match="tile cannot be used with per_object"):
        survey.run(to="folder", tile=5, per_object=True)


def test_batches_and_files_come_from_one_run(room, tmp_path):
    vlscan.run(room, to=tmp_path / "whole.laz", seed=3)
    with vlscan.run_batches(room, rows=1000, to=tmp_path / "beside.laz", pulses=False, seed=3) as batches:
        count = sum(map(len, batches))
    assert (tmp_path / "beside.laz").read_bytes() == (tmp_path / "whole.laz").read_bytes()
    assert batches.result.point_count == count and batches.result.files == [str(tmp_path / "beside.laz")]
    with vlscan.run_batches(room, pulses=True, seed=3) as batches:
        list(batches)
    assert len(batches.result.pulses) == batches.result.pulse_count


def test_the_folders_of_helios_are_an_output(room, tmp_path):
    result = vlscan.run(room, output=tmp_path, las_output=True, seed=3)
    assert sorted(path.name for path in Path(result.directories[0]).glob("*.las")) == ["leg000_points.las", "leg001_points.las"]
    with pytest.raises(ValueError, match="give either to, the names of files, or output"):
        vlscan.run(room, to="a.laz", output=tmp_path)
    with pytest.raises(ValueError, match="output is an option of files"):
        vlscan.pulses(room, output=tmp_path)


def test_a_scanner_takes_a_pattern_from_an_array(tmp_path):
    turn = np.linspace(0, 2 * np.pi, 500, endpoint=False)
    rows = np.column_stack([20 * np.cos(turn), 20 * np.sin(turn) - 60])
    np.save(tmp_path / "rows.npy", rows)
    leg = Leg((0, 0, 5), max_duration_s=0.5)

    def points(pattern):
        scanner = vlscan.Scanner(optics="pattern", pattern=pattern, pulse_freqs_hz=[1000])
        return Survey([Part.mesh(*wall(100))], scanner, [leg]).run(seed=1).points

    ring = points(rows)
    assert abs(len(ring) - 500) < 3
    elevation = np.degrees(np.arctan2(ring["Z"] - 5, np.hypot(ring["X"], ring["Y"])))
    np.testing.assert_allclose(elevation, np.resize(rows[:, 1], len(ring)), atol=1e-2)
    assert (points(tmp_path / "rows.npy")["X"] == ring["X"]).all()
