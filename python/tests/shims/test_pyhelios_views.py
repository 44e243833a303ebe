"""What scripts of HELIOS++ 2 read and change before a simulation starts: templates, legs, scene, detector; and wrong values."""

import math
import os

import numpy as np
import pytest

from conftest import FIXTURES, ROOT
from vlscan import pyhelios


def builder(tmp_path, survey="forest/survey.xml"):
    """Return a builder for runs in memory."""
    return pyhelios.SimulationBuilder(str(FIXTURES / survey), [str(ROOT)], str(tmp_path)).setExportToFile(False)


def test_settings_have_their_templates(tmp_path):
    simulation = builder(tmp_path).build()
    leg = simulation.sim.getLeg(1)
    settings, place = leg.getScannerSettings(), leg.getPlatformSettings()
    assert settings.hasTemplate() and place.hasTemplate()
    assert simulation.copy().getLeg(1).getScannerSettings().getTemplate().id == "strip"
    assert settings.getTemplate().id == "strip" and settings.getTemplate().pulseFreq == 137_700
    assert settings.getTemplate().active is True and settings.active is False
    assert math.degrees(settings.getTemplate().scanAngle) == pytest.approx(5.94)
    assert place.getTemplate().getId() == "cruise" and place.getTemplate().getMovePerSec() == 60
    with pytest.raises(AttributeError, match="cannot be changed"):
        place.getTemplate().z = 1
    with pytest.raises(AttributeError, match="movePerSec"):
        place.getTemplate().speed


def test_intervals_that_templates_lack_are_0(tmp_path):
    text = (FIXTURES / "forest/survey.xml").read_text()
    (tmp_path / "survey.xml").write_text(text.replace(' trajectoryTimeInterval_s="0.01"', "").replace(' paths="beside"', ""))
    made = pyhelios.SimulationBuilder(str(tmp_path / "survey.xml"), [str(FIXTURES / "forest")], str(tmp_path))
    settings = made.setExportToFile(False).build().sim.getLeg(0).getScannerSettings()
    assert settings.getTemplate().trajectoryTimeInterval == settings.trajectoryTimeInterval == 0


def test_settings_without_a_template_say_so(tmp_path):
    settings = builder(tmp_path, "room/survey.xml").build().sim.getLeg(0).getPlatformSettings()
    assert not settings.hasTemplate()
    with pytest.raises(ValueError, match="no template"):
        settings.getTemplate()


def test_legs_are_numbered_and_have_lengths(tmp_path):
    sim = builder(tmp_path).build().sim
    assert [leg.serialId for leg in sim.getSurvey().legs] == [0, 1, 2, 3]
    assert [leg.getLength() for leg in sim.getSurvey().legs] == [44, 20, 44, 0]
    added = sim.newLeg(4)
    added.serialId = 4
    added.platformSettings.position = (1, 2, 300)
    assert added.serialId == 4 and sim.getNumLegs() == 5 and not added.scannerSettings.hasTemplate()
    assert added.platformSettings.getPosition() == (1, 2, 300)
    sim.removeLeg(4)
    assert sim.getNumLegs() == 4


def test_a_survey_without_legs_gets_its_first(tmp_path):
    scene = FIXTURES / "room/scene.xml#room"
    text = f'<document><survey name="empty" scene="{scene}" platform="data/platforms.xml#tripod"'
    (tmp_path / "empty.xml").write_text(f'{text} scanner="data/scanners_tls.xml#riegl_vz400"/></document>')
    simulation = pyhelios.SimulationBuilder(str(tmp_path / "empty.xml"), "assets/", str(tmp_path)).setExportToFile(False).build()
    leg = simulation.sim.newLeg(0)
    leg.getPlatformSettings().setPosition(0, 0, 0)
    settings = leg.getScannerSettings()
    settings.pulseFreq, settings.scanFreq, settings.headRotatePerSec, settings.headRotateStop = 100_000, 120.0, 1.0, 0.2
    simulation.start()
    assert len(simulation.join().measurements) > 1000
    with pytest.raises(RuntimeError, match="has been started"):
        simulation.sim.newLeg(0)


def test_a_leg_of_a_tripod_has_the_speed_by_default(tmp_path):
    assert builder(tmp_path, "room/survey.xml").build().sim.getLeg(0).getPlatformSettings().movePerSec == 70


def test_the_scene_has_parts_a_box_and_ground(tmp_path):
    scene = builder(tmp_path).build().sim.getScene()
    assert scene.getNumSceneParts() == len(scene.sceneParts) == 4 and scene.sceneParts[0].materials[0].name == "forest_floor"
    assert scene.getNumPrimitives() == scene.numPrimitives > 1000
    ground = scene.sceneParts[0].bbox
    assert ground.getMin() == (-20, -20, ground.bounds[0].z) and ground.getMax().x == 20 and ground.getCentroid().y == 0
    assert ground.min.z <= scene.getGroundPointAt(1, 2, 99).z <= ground.max.z
    assert scene.getAABB().max.z == scene.bbox.max.z > ground.max.z
    with pytest.raises(ValueError, match="no ground"):
        scene.getGroundPointAt([1e5, 0, 0])
    with pytest.raises(AttributeError, match="sceneParts"):
        scene.getTriangle(0)


def test_primitives_of_the_scene_have_vertices(tmp_path):
    scene = builder(tmp_path).build().sim.getScene()
    first = scene.getPrimitive(0)
    assert first.isTriangle() and not first.isVoxel() and first.getNumVertices() == 3
    corners = [first.getVertex(index).getPosition() for index in range(3)]
    assert first.getAABB().getMin().z == min(corner.z for corner in corners)
    assert first.getCentroid().x == pytest.approx(sum(corner.x for corner in corners) / 3)
    box = scene.sceneParts[0].bbox
    assert all(box.min.x - 1e-9 <= corner.x <= box.max.x + 1e-9 for corner in corners)
    assert scene.getPrimitive(scene.numPrimitives - 1).isTriangle()
    with pytest.raises(IndexError, match="primitives"):
        scene.getPrimitive(scene.numPrimitives)
    with pytest.raises(IndexError, match="3 vertices"):
        first.getVertex(3)
    with pytest.raises(AttributeError, match="getCentroid"):
        first.getNormal()


def test_the_detector_has_accuracy_and_ranges(tmp_path):
    detector = builder(tmp_path, "room/survey.xml").build().sim.getScanner().getDetector()
    assert (detector.accuracy, detector.rangeMin, detector.rangeMax) == (0.003, 0.3, math.inf)
    assert detector.getAccuracy() == detector.accuracy and detector.getRangeMin() == 0.3 and detector.getRangeMax() == math.inf
    with pytest.raises(AttributeError, match="rangeMax"):
        detector.range
    with pytest.raises(AttributeError, match="cannot be set"):
        detector.accuracy = 0.1


def test_the_head_and_the_deflector_have_limits(tmp_path):
    scanner = builder(tmp_path, "room/survey.xml").build().sim.getScanner()
    assert math.degrees(scanner.getScannerHead().rotatePerSecMax) == pytest.approx(3600)
    deflector = scanner.getBeamDeflector()
    assert (deflector.scanFreqMin, deflector.getScanFreqMax()) == (4, 420)
    assert math.degrees(deflector.scanAngleMax) == pytest.approx(52.5)


@pytest.mark.parametrize(
    ("setter", "value", "error"),
    [
        ("setLasOutput", "false", TypeError),
        ("setZipOutput", None, TypeError),
        ("setWriteWaveform", 2, TypeError),
        ("setNumThreads", -1, ValueError),
        ("setKDTJobs", -1, ValueError),
        ("setWarehouseFactor", 0, ValueError),
        ("setCallbackFrequency", -1, ValueError),
        ("setLasScale", 0, ValueError),
        ("setSeed", [1], TypeError),
        ("setSeed", True, TypeError),
    ],
)
def test_wrong_values_are_refused_at_once(tmp_path, setter, value, error):
    with pytest.raises(error):
        getattr(builder(tmp_path), setter)(value)


def test_values_of_numpy_are_taken(tmp_path):
    made = builder(tmp_path, "room/survey.xml").setNumThreads(np.int64(1)).setLasOutput(np.True_).setSeed(np.int64(3)).setChunkSize(-32)
    simulation = made.build()
    assert repr(made) == repr(simulation).replace("Simulation", "SimulationBuilder").replace(": not started", "")
    simulation.start()
    output = simulation.join()
    assert len(output.measurements) > 1000 and repr(simulation).endswith(": finished>")
    assert repr(output).startswith(f"<Output: {len(output.measurements):,} points, ")


def test_wrong_calls_of_simulations_are_refused(tmp_path):
    simulation = builder(tmp_path).build()
    with pytest.raises(RuntimeError, match="has not been started"):
        simulation.join()
    with pytest.raises(TypeError, match="output of a simulation"):
        pyhelios.outputToNumpy(3)
    with pytest.raises(TypeError, match="a seed"):
        pyhelios.setDefaultRandomnessGeneratorSeed([1])


def test_helpers_for_notebooks_are_attributes_of_the_package():
    text = pyhelios.util.xmldisplayer.display_xml(FIXTURES / "forest/survey.xml", "strip")
    assert text.startswith('<scannerSettings id="strip"')


def test_a_missing_survey_is_an_error_of_the_builder(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such survey"):
        pyhelios.SimulationBuilder("no_such.xml", [str(tmp_path)], str(tmp_path)).build()


def test_the_survey_is_found_after_the_working_directory_changed(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    simulations = [
        pyhelios.SimulationBuilder("fixtures/room/survey.xml", "assets/", str(tmp_path)).setExportToFile(False).build() for _ in range(2)
    ]
    assert simulations[1].sim.getNumLegs() == 2
    os.chdir(tmp_path)
    for simulation in simulations:
        simulation.start()
        assert len(simulation.join().measurements) > 10_000
