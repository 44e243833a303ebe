"""The working directory changes between the making of an object and its use."""

import os
import pickle

import pytest

from conftest import ROOT
from vlscan import InputError, Leg, Part, Scene, Survey, plan_airborne

LEG = Leg((0, 0, 4), scan_freq_hz=120, head_rate_deg_per_s=60, head_stop_deg=10)


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """Return a function that leaves the repository, in which the test begins."""
    monkeypatch.chdir(ROOT)
    return lambda: os.chdir(tmp_path)


def test_a_survey_of_a_file_is_found(elsewhere):
    survey = Survey.open("fixtures/room/survey.xml")
    before = survey.run(seed=1).point_count
    elsewhere()
    assert survey.run(seed=1).point_count == before
    assert len(survey.legs) == 2 and str(ROOT / "fixtures/room/survey.xml") in survey.document()


def test_files_beside_a_document_are_found(elsewhere):
    text = (ROOT / "fixtures/room/survey.xml").read_text()
    survey = Survey.from_document(text, path="fixtures/room/other.xml")
    before = survey.run(seed=1).point_count
    elsewhere()
    assert survey.run(seed=1).point_count == before > 0


def test_a_scene_of_a_file_is_found_and_a_loaded_one_stays(elsewhere):
    scene, loaded = Scene("fixtures/room/scene.xml"), Scene("fixtures/room/scene.xml").load()
    elsewhere()
    assert loaded.is_loaded and not scene.is_loaded
    assert scene.bounds.tolist() == loaded.bounds.tolist()


def test_parts_of_files_and_their_copies_are_found(elsewhere):
    ground = Part.obj("fixtures/forest/ground.obj")
    scene = Scene([ground])
    elsewhere()
    moved = Scene([ground.translate(1, 0)])
    assert moved.bounds[0, 0] == scene.bounds[0, 0] + 1
    assert Survey(pickle.loads(pickle.dumps(ground)), "riegl_vz400", [LEG]).run(seed=1).point_count > 0


def test_rasters_are_found_by_patterns_and_folders(elsewhere, tmp_path):
    tiles = tmp_path / "work/dem"
    tiles.mkdir(parents=True)
    for number in range(2):
        grid = f"ncols 2\nnrows 2\nxllcorner {2 * number}\nyllcorner 0\ncellsize 1\nNODATA_value -9\n{number} 1\n2 3\n"
        (tiles / f"{number}.asc").write_text(grid)
    os.chdir(tmp_path / "work")
    parts = [Part.raster("dem/*.asc"), Part.raster("dem"), Part.raster(["dem/0.asc", "dem/1.asc"])]
    elsewhere()
    assert len({str(Scene(part).bounds) for part in parts}) == 1


def test_the_scene_of_a_plan_is_found(elsewhere):
    plan = plan_airborne("riegl_vux-1uav", height=60, density=5, scene="fixtures/forest/ground.obj")
    before = plan.run(seed=1).point_count
    elsewhere()
    assert plan.run(seed=1).point_count == pickle.loads(pickle.dumps(plan)).run(seed=1).point_count == before


def test_messages_name_files_as_the_program_did(elsewhere):
    part = Part.obj("fixtures/forest/no_such.obj")
    with pytest.raises(InputError, match="cannot read fixtures/forest/no_such.obj"):
        Scene(part).bounds
    elsewhere()
    with pytest.raises(InputError, match="cannot read fixtures/forest/no_such.obj"):
        Scene(part).bounds
