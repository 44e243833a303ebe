"""The ``SimulationBuilder`` of HELIOS++ 2."""

import math
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES
from vlscan import pyhelios
from vlscan.pyhelios.__main__ import helios_exec


def test_it_needs_no_pint():
    text = "import sys; sys.modules['pint'] = None; from vlscan.pyhelios import SimulationBuilder"
    assert subprocess.run([sys.executable, "-c", text], check=False).returncode == 0


def test_the_simulation_builder_of_version_2(tmp_path):
    builder = pyhelios.SimulationBuilder(str(FIXTURES / "room/survey.xml"), [str(FIXTURES / "room")], str(tmp_path))
    builder.setNumThreads(2)
    builder.setLasOutput(True)
    builder.setZipOutput(True)
    builder.setSeed("7")
    simulation = builder.build()
    assert not simulation.isStarted()
    simulation.start()
    while simulation.isRunning():
        time.sleep(0.05)
    output = simulation.join()
    assert simulation.isFinished() and len(output.measurements) > 10_000
    assert output.outpaths and all(path.endswith(".laz") for path in output.outpaths)
    assert os.path.isfile(output.filepath) and output.filepath.startswith(str(tmp_path)) and os.path.isdir(output.folder)


def builder_of(tmp_path):
    """Return a builder of the room."""
    return pyhelios.SimulationBuilder(str(FIXTURES / "room/survey.xml"), [str(FIXTURES / "room")], str(tmp_path))


def simulation(tmp_path, change=lambda builder: None):
    """Return a simulation of the room in memory."""
    builder = builder_of(tmp_path)
    builder.setExportToFile(False).setSeed(7)
    change(builder)
    return builder.build()


def test_names_of_scripts_of_version_2_exist():
    functions = "loggingVerbose loggingVerbose2 loggingQuiet loggingSilent loggingDefault loggingTime outputToNumpy __version__ util"
    functions += " setDefaultRandomnessGeneratorSeed default_rand_generator_seed cartesianToSpherical sphericalToCartesian"
    functions += " PYHELIOS_SIMULATION_BUILD_CONDITION_VARIABLE"
    assert [name for name in functions.split() if not hasattr(pyhelios, name)] == []
    setters = "setFullwaveNoise setExportToFile setKDTJobs setKDTFactory setKDTType setKDTSAHLossNodes setParallelizationStrategy"
    setters += " setChunkSize setWarehouseFactor setLegacyEnergyModel addRotateFilter addScaleFilter addTranslateFilter setSurveyPath"
    setters += " setAssetsDir setOutputDir setCallback setCallbackFrequency"
    assert [name for name in setters.split() if not hasattr(pyhelios.SimulationBuilder, name)] == []
    methods = "pause resume stop isStarted isRunning isPaused isStopped isFinished sim copy join"
    assert [name for name in methods.split() if not hasattr(pyhelios.Simulation, name)] == []
    with pytest.raises(AttributeError, match="setKDTJobs"):
        pyhelios.SimulationBuilder("survey.xml").setKDTJob(1)


def test_a_simulation_in_memory_has_points_poses_and_arrays(tmp_path):
    started = simulation(tmp_path)
    started.start()
    output = started.join()
    assert output.filepath == "" and output.outpaths == [] and list(tmp_path.iterdir()) == []
    points, poses = pyhelios.outputToNumpy(output)
    assert points.shape == (len(output.measurements), 17) and np.isfinite(points[:, :9]).all()
    assert poses.shape == (len(output.trajectories), 7) and len(poses) > 0
    last = output.measurements[-1]
    assert last.position == last.getPosition() == tuple(points[-1, :3]) and last.getPosition().x == points[-1, 0]
    assert len(output.measurements[:3]) == 3 and output.trajectories[0].gpsTime == poses[0, 3]
    with pytest.raises(AttributeError, match="hitObjectId"):
        last.colour


def test_callbacks_get_the_points_so_far_and_the_end(tmp_path):
    seen = []
    started = simulation(tmp_path, lambda builder: builder.setCallbackFrequency(5000).setCallback(lambda output: seen.append(output)))
    started.start()
    output = started.join()
    counts = [len(each.measurements) for each in seen]
    assert counts == sorted(counts) and counts[0] == 5000 and counts[-1] == len(output.measurements)
    assert len(seen[0].trajectories) == 0 and len(seen[-1].trajectories) > 0


def test_an_output_is_a_sequence_too(tmp_path):
    seen = []
    started = simulation(tmp_path, lambda builder: builder.setCallbackFrequency(5000).setCallback(lambda output: seen.append(output)))
    started.start()
    measurements, trajectories, path, paths, is_complete = output = started.join()
    assert len(output) == 5 and len(output[0]) == len(measurements) == len(output.measurements) > 5000
    assert len(output[1]) == len(trajectories) > 0 and (path, paths, is_complete) == ("", [], True)
    assert len(seen[0][0]) == 5000 and len(seen[0][1]) == 0 and seen[0][4] is False and output[-1] is True


def test_copies_of_the_playback_are_changed_and_run(tmp_path):
    pytest.importorskip("pydantic")
    first = simulation(tmp_path)
    twin = first.sim.copy()
    assert first.sim is first.sim is not twin.sim and first.sim.getScene() is first.sim.getScene()
    assert twin.getNumLegs() == 2 and twin.getSurveyPath() == first.sim.getSurveyPath()
    for leg in range(twin.getNumLegs()):
        twin.getLeg(leg).getScannerSettings().pulseFreq /= 2
    assert first.sim.getLeg(0).getScannerSettings().pulseFreq == 9200
    counts = []
    for run in (first.sim, twin):
        assert not run.isStarted()
        run.start()
        counts.append(len(run.join()[0]))
    assert first.isFinished() and counts[1] == pytest.approx(counts[0] / 2, rel=0.02)
    for odd in (first, first.sim):
        with pytest.raises(AttributeError, match="no .*'getLegs'"):
            odd.getLegs()


def test_attributes_of_builders_are_set_by_their_setters(tmp_path):
    builder = pyhelios.SimulationBuilder(str(FIXTURES / "room/survey.xml"), [str(FIXTURES / "room")], "elsewhere")
    builder.lasOutput = True
    builder.outputDir = str(tmp_path)
    built = builder.build()
    built.start()
    assert built.join().filepath.startswith(str(tmp_path)) and built.join().filepath.endswith(".las")
    with pytest.raises(TypeError, match="zipOutput is True or False"):
        builder.zipOutput = "yes"
    with pytest.raises(AttributeError, match="no 'setLasOuput'; did you mean 'setLasOutput'"):
        builder.lasOuput = True


def test_wrong_values_of_builders_are_named():
    builder = pyhelios.SimulationBuilder("survey.xml")
    for call, name in (
        (lambda: builder.setNumThreads("x"), "numThreads"),
        (lambda: builder.setChunkSize(1.5), "chunkSize"),
        (lambda: builder.setLasScale("fine"), "lasScale"),
        (lambda: builder.addScaleFilter(None), "scaleFactor"),
        (lambda: builder.setAssetsDir(5), "expected a folder, or several, found 5"),
    ):
        with pytest.raises(TypeError, match=name):
            call()
    with pytest.raises(AttributeError, match="no 'loggingVerbos'; did you mean 'loggingVerbose'"):
        pyhelios.loggingVerbos()


def test_the_last_results_are_those_of_the_highest_number(tmp_path):
    for name in ("2026-01-01_00-00-00", "2026-01-01_00-00-00_2", "2026-01-01_00-00-00_10", "2025-12-31_23-59-59_11"):
        (tmp_path / "room" / name).mkdir(parents=True)
    found = pyhelios.util.xmldisplayer.find_playback_dir(FIXTURES / "room/survey.xml", tmp_path)
    assert os.path.basename(found) == "2026-01-01_00-00-00_10"


def test_a_simulation_is_paused_resumed_and_stopped(tmp_path):
    def small(builder):
        builder.setCallbackFrequency(100).setCallback(lambda output: None)

    paused = simulation(tmp_path, small)
    paused.pause()
    paused.start()
    time.sleep(0.5)
    assert paused.isStarted() and paused.isPaused() and not paused.isRunning() and not paused.isFinished()
    paused.resume()
    whole = len(paused.join().measurements)
    stopped = paused.copy()
    stopped.pause()
    stopped.start()
    stopped.stop()
    assert len(stopped.join().measurements) < whole and stopped.isStopped() and stopped.isFinished()


def test_the_seed_of_the_module_is_that_of_builders_without_one(tmp_path):
    def measured(change):
        builder = pyhelios.SimulationBuilder(str(FIXTURES / "room/survey.xml"), [str(FIXTURES / "room")], str(tmp_path))
        change(builder.setExportToFile(False))
        run = builder.build()
        run.start()
        return pyhelios.outputToNumpy(run.join())[0]

    own = measured(lambda builder: builder.setSeed(5))
    pyhelios.setDefaultRandomnessGeneratorSeed(5)
    try:
        of_module = measured(lambda builder: None)
    finally:
        pyhelios.setDefaultRandomnessGeneratorSeed(0)
    assert np.array_equal(own, of_module)


def test_runs_that_write_text_have_beams_in_memory(tmp_path):
    def measured(name, change):
        builder = pyhelios.SimulationBuilder(str(FIXTURES / "room/survey.xml"), [str(FIXTURES / "room")], str(tmp_path / name))
        run = change(builder.setSeed(5)).build()
        run.start()
        output = run.join()
        return output, pyhelios.outputToNumpy(output)[0]

    (text, beside), (_, alone) = measured("a", lambda builder: builder), measured("b", lambda builder: builder.setExportToFile(False))
    assert np.array_equal(beside, alone) and np.isfinite(beside).all()
    assert np.allclose(np.linalg.norm(beside[:, 6:9], axis=1), 1)
    with open(text.filepath) as lines:
        assert len(lines.readline().split()) == 11


def test_spherical_coordinates_come_back():
    points = np.array([[1.0, 2.0, 3.0], [-1.0, 0.5, -2.0], [0.0, 0.0, 4.0]])
    spherical = pyhelios.cartesianToSpherical(points)
    assert spherical[2].tolist() == [4.0, 0.0, 0.0]
    assert np.allclose(pyhelios.sphericalToCartesian(spherical), points)
    assert pyhelios.cartesianToSpherical(0, 0, 4).tolist() == pyhelios.cartesianToSpherical((0, 0, 4)).tolist()
    with pytest.raises(ValueError, match="expected x, y and z"):
        pyhelios.cartesianToSpherical(1, 2)


def test_legs_are_changed_by_sim(tmp_path):
    pytest.importorskip("pydantic")
    changed = simulation(tmp_path)
    survey = changed.sim.getSurvey()
    assert survey.getNumLegs() == 2 and survey.getLeg(0).getScannerSettings().isActive()
    survey.getLeg(0).scannerSettings.active = False
    survey.getLeg(1).getPlatformSettings().setX(0.5)
    assert survey.getLeg(1).platformSettings.x == 0.5
    with pytest.raises(IndexError, match="there are 2 legs"):
        survey.getLeg(2)
    with pytest.raises(AttributeError, match="pulseFreq"):
        survey.getLeg(0).scannerSettings.pulseFrequency
    changed.start()
    assert set(changed.join().points["PointSourceId"].tolist()) == {2}
    with pytest.raises(RuntimeError, match="has been started"):
        survey.removeLeg(0)


def test_lengths_and_figures_are_read_by_sim(tmp_path):
    pytest.importorskip("pydantic")
    survey = simulation(tmp_path).sim.getSurvey()
    first, second = (survey.getLeg(index).platformSettings.getPosition() for index in range(2))
    survey.calculateLength()
    assert survey.getLength() == survey.length == pytest.approx(np.linalg.norm(np.subtract(first, second)))
    scanner = survey.getScanner()
    assert scanner.deviceId == scanner.getId() == "tls_polygon" and scanner.getPulseFreqs() == [9200]
    assert (scanner.beamDivergence, scanner.getWavelength(), scanner.visibility) == (0.00035, 1.55e-6, 23)
    assert "wavelength: 1.55e-06" in scanner.toString()
    with pytest.raises(AttributeError, match="figures of a scanner cannot be set"):
        scanner.averagePower = 3
    with pytest.raises(AttributeError, match="there are deviceId, pulseFreqs, name"):
        scanner.averagePowr


def test_figures_of_a_scanner_without_an_entry_are_errors(tmp_path, monkeypatch):
    pytest.importorskip("pydantic")
    from vlscan_helios.v2.scanner import ScannerView

    monkeypatch.chdir(tmp_path)

    def view(reference):
        return ScannerView(SimpleNamespace(reference=reference), lambda: False)

    with pytest.raises(vlscan.InputError, match=r"cannot find the file `nowhere\.xml`"):
        _ = view("nowhere.xml#a").wavelength
    shutil.copy(FIXTURES / "room/scanners.xml", tmp_path / "other.xml")
    with pytest.raises(vlscan.InputError, match="there is no <scanner> with the id `a`"):
        _ = view("other.xml#a").pulseFreqs
    assert view("other.xml#tls_polygon").pulseFreqs == [9200]
    (tmp_path / "other.xml").write_text("<document>")
    with pytest.raises(vlscan.InputError, match="not well-formed XML"):
        view("other.xml#b").toString()


def test_filters_move_parts(tmp_path):
    pytest.importorskip("pydantic")
    moved = simulation(tmp_path, lambda builder: builder.addTranslateFilter(0, 0, -0.5))
    plain = simulation(tmp_path)
    lowest = []
    for run in (plain, moved):
        run.start()
        lowest.append(run.join().points["Z"].min())
    assert lowest[1] < lowest[0] - 0.3
    with pytest.raises(ValueError, match="no part of the scene has the id 'nowhere'"):
        simulation(tmp_path, lambda builder: builder.addScaleFilter(2, "nowhere"))


def test_the_package_of_version_2_has_its_modules(tmp_path, monkeypatch):
    pytest.importorskip("pydantic")
    text = (
        "import vlscan.pyhelios\n"
        "vlscan.pyhelios.install()\n"
        "import pyhelios\n"
        "from pyhelios.__main__ import helios_exec\n"
        "from pyhelios.util.xmldisplayer import display_xml, find_playback_dir\n"
        "import sys\n"
        "assert helios_exec([sys.argv[1], '--output', 'out', '-q']) == 0\n"
        "print('platform' in display_xml(sys.argv[1]), find_playback_dir(sys.argv[1], 'out'))\n"
    )
    survey = FIXTURES / "room/survey.xml"
    done = subprocess.run([sys.executable, "-c", text, survey], cwd=tmp_path, capture_output=True, text=True, check=True)
    is_shown, folder = done.stdout.splitlines()[-1].split(maxsplit=1)
    assert is_shown == "True" and list((tmp_path / folder).iterdir())


def test_modules_that_are_missing_name_an_alternative():
    imports = {
        "import pyhelios.live": "setCallback",
        "from pyhelios import live": "setCallback",
        "from pyhelios.util import scene_writer": "vlscan.Scene",
        "from pyhelios.util.flight_planner import spiral": "plan_airborne",
    }
    lines = ["import vlscan.pyhelios", "vlscan.pyhelios.install()"]
    for statement in imports:
        lines += ["try:", f"    {statement}", "except ImportError as error:", "    print(error)"]
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=True)
    for text, advice in zip(done.stdout.splitlines(), imports.values(), strict=True):
        assert "is not part of vlscan" in text and advice in text


def test_ctrl_c_ends_a_simulation_of_version_2(tmp_path):
    survey = (FIXTURES / "room/survey.xml").read_text()
    stop = re.search(r'headRotatePerSec_deg="[^"]*"', survey)
    (tmp_path / "survey.xml").write_text(survey.replace(stop[0], 'headRotatePerSec_deg="0.001"'))
    for file in (FIXTURES / "room").iterdir():
        if file.name != "survey.xml":
            shutil.copy(file, tmp_path)
    text = (
        "import sys, threading, time\n"
        "from vlscan import pyhelios\n"
        "simulation = pyhelios.SimulationBuilder(sys.argv[1] + '/survey.xml', [sys.argv[1]], sys.argv[1] + '/out').build()\n"
        "simulation.start()\n"
        "print('started', flush=True)\n"
        "try:\n"
        "    simulation.join()\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', simulation.isRunning(), simulation.isFinished(), threading.active_count(), flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", text, tmp_path], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout.readline() == "started\n"
    time.sleep(1)
    process.send_signal(signal.SIGINT)
    rest, _ = process.communicate(timeout=60)
    assert process.returncode == 0 and rest.startswith("interrupted False True")


def test_filters_are_checked_at_once(tmp_path):
    builder = builder_of(tmp_path)
    for wrong, message in (
        (lambda: builder.addRotateFilter(0, 0, 0, 0), "q0, q1, q2, q3 are .*not all 0"),
        (lambda: builder.addRotateFilter(math.nan, 0, 0, 0), "q0 is nan"),
        (lambda: builder.addTranslateFilter(0, math.inf, 0), "y is inf"),
    ):
        with pytest.raises(ValueError, match=message):
            wrong()
    with pytest.raises(TypeError, match="x is 'a', expected a number"):
        builder.addTranslateFilter("a", 0, 0)


def test_records_are_read_only_and_their_indices_are_checked(tmp_path):
    run = simulation(tmp_path)
    run.start()
    measurements = run.join().measurements
    with pytest.raises(IndexError, match="index of a record is 1000000, and there are"):
        measurements[1_000_000]
    with pytest.raises(TypeError, match=r"an index of records is 1.5"):
        measurements[1.5]
    with pytest.raises(AttributeError, match=r"cannot be changed; outputToNumpy\(\)"):
        measurements[0].intensity = 3
    assert repr(measurements[-1]) == repr(measurements[len(measurements) - 1])


def test_calls_of_other_kinds_name_what_to_call(tmp_path):
    with pytest.raises(TypeError, match=r"SimulationBuilder\(surveyPath, assetsDir, outputDir\).build\(\)"):
        pyhelios.Simulation("survey.xml", "assets/", "output/", 0, True)
    for wrong, message in (((3,), "surveyPath is 3"), (("a.xml", [3]), r"assetsDir has 3"), (("a.xml", "b", None), "outputDir is None")):
        with pytest.raises(TypeError, match=message):
            pyhelios.SimulationBuilder(*wrong)
    with pytest.raises(TypeError, match="numThreads is True"):
        builder_of(tmp_path).setNumThreads(True)
    with pytest.raises(TypeError, match=r"shlex.split\(\)"):
        helios_exec("survey.xml --lasOutput")
