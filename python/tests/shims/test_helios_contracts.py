"""HELIOS++ 3: contracts beyond names: order of values, attributes of users, hooks, templates, errors."""

import copy
import inspect
import subprocess
import sys
import tempfile
import warnings

import numpy as np
import pytest

from conftest import FIXTURES

pytest.importorskip("pint")
pytest.importorskip("pydantic")

from test_helios import plane, static_survey

import vlscan
from vlscan import helios


@pytest.fixture(autouse=True)
def _seed():
    helios.set_rng_seed(1)


def test_models_take_their_fields_in_order():
    part = plane()
    survey = helios.Survey(helios.scanner.riegl_vz_400(), helios.platforms.tripod(), helios.StaticScene([part]))
    assert survey.scene.scene_parts == (part,) and survey.scanner == helios.scanner.riegl_vz_400()
    place = helios.PlatformSettings(1, 2, z=3)
    assert (place.x, place.y, place.z) == (1, 2, 3)
    assert helios.Material("bark", True).is_ground and list(inspect.signature(helios.PlatformSettings).parameters) == ["x", "y", "z"]
    assert helios.Leg(helios.ScannerSettings(), place).platform_settings is place
    with pytest.raises(TypeError, match="takes 3 values, found 4: x, y, z"):
        helios.PlatformSettings(1, 2, 3, 4)
    with pytest.raises(TypeError, match="two values of x"):
        helios.PlatformSettings(1, x=2)
    with pytest.raises(ValueError):
        helios.PlatformSettings(1, "two")


def test_users_set_attributes_of_their_own():
    part, settings = plane(), helios.ScannerSettings()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        part.note = settings.note = "beech"
        settings.pulse_frequency = "10 kHz"
    assert part.note == settings.note == "beech" and settings.pulse_frequency == 10_000
    for twin in (part.clone(), copy.deepcopy(part), settings.clone(), copy.deepcopy(settings)):
        assert not hasattr(twin, "note")
    assert settings == settings.clone()
    with pytest.warns(vlscan.VlscanWarning, match="did you mean 'pulse_frequency'"):
        settings.pulse_frequncy = 1


def test_star_imports_bring_what_the_modules_of_version_3_bring():
    text = "from vlscan.helios.survey import *\nprint(ScannerSettings(), StaticScene, units, np, Optional, SurveyHook, LogVerbosity.QUIET)"
    assert subprocess.run([sys.executable, "-c", text], check=False).returncode == 0


def test_hooks_get_context_points_and_trajectories():
    survey, seen = static_survey(), []

    def take(context, points, trajectories):
        seen.append((context, points, trajectories))

    hooks = [helios.SurveyHook(point=point, callback=take, payload="all_points") for point in ("leg_start", "leg_end")]
    points, poses = survey.run(callbacks=[*hooks, helios.SurveyHook(point="leg_end", callback=take)])
    (start, none, _), (end, every, flown), (_, *missing) = seen
    assert len(none) == 0 and every.tobytes() == points.tobytes() and flown.tobytes() == poses.tobytes() and missing == [None, None]
    assert (start.leg_progress, start.total_points, start.payload_points) == (0, 0, 0)
    assert start.leg_remaining_time_s == pytest.approx(2) and end.leg_remaining_time_s == end.remaining_time_s == 0
    assert (end.leg_progress, end.survey_progress, end.total_points, end.payload_points) == (1, 1, len(points), len(points))
    assert end.total_trajectories == end.payload_trajectories == len(poses) and end.sim_time_s == end.elapsed_time_s > 0
    assert end.gps_time_s >= points["gps_time"].max() - 1e-6 and end.output_path == "" and end.lag_s == 0 and end.play_index == 0


def test_periodic_hooks_begin_at_their_time():
    def times(**values):
        seen = []
        hook = helios.SurveyHook(point="sim_time_periodic", period=0.5, callback=seen.append, **values)
        static_survey().run(callbacks=[hook])
        return [context.sim_time_s for context in seen]

    assert times()[:3] == times(sim_time=0)[:3] == [0.5, 1.0, 1.5] and times(sim_time=0.25)[:2] == [0.75, 1.25]


def test_hooks_of_many_calls_take_time_in_proportion():
    survey, seen = static_survey(), []
    often = {"point": "sim_time_periodic", "period": 0.001, "payload": "since_last"}
    hook = helios.SurveyHook(**often, callback=lambda context, points, _: seen.append(points))
    rest = helios.SurveyHook(point="leg_end", payload="since_last", callback=lambda context, points, _: None)
    points, _ = survey.run(callbacks=[hook, rest])
    assert len(seen) > 1000 and np.concatenate(seen).tobytes() == points[: sum(map(len, seen))].tobytes()


def test_texts_of_combinations_are_templates():
    assert helios.combine_parameters(x=[0, 1], name="x={x}") == [{"x": 0, "name": "x=0"}, {"x": 1, "name": "x=1"}]
    assert helios.combine_parameters(groups=[["a"]], a=[1, 2], b=[3, 4]) == [{"a": 1, "b": [3, 4]}, {"a": 2, "b": [3, 4]}]
    (filled,) = helios.combine_parameters(x=0.5, name="{x:.2f}", other="{y}", open="{")
    assert filled == {"x": 0.5, "name": "0.50", "other": "{y}", "open": "{"}


def test_levels_of_compression_have_names(tmp_path):
    scene = helios.StaticScene([plane()])
    for level in ("none", "fast", "default", "best", 0, 9):
        scene.to_binary(tmp_path / f"{level}.vlscene", level)
    for wrong in ("most", 10, -1, True):
        with pytest.raises(ValueError, match="compression level"):
            scene.to_binary(tmp_path / "wrong.vlscene", wrong)


def test_registries_are_dictionaries_of_functions():
    assert helios.scanner.SCANNER_REGISTRY["riegl_vz_400"]() == helios.scanner.riegl_vz_400()
    assert list(helios.platforms.PLATFORM_REGISTRY) == helios.list_platforms()


def test_a_material_that_replaces_another_has_its_own_name():
    part = plane()
    part.materials["default"] = helios.Material("roof", classification=6)
    assert list(part.materials) == ["roof"] and list(part.clone().materials) == ["roof"]
    assert set(static_survey(part).run()[0]["classification"]) == {6}
    part.materials["roof"].classification = 7
    assert set(static_survey(part.clone()).run()[0]["classification"]) == {7}


def test_messages_name_the_fields_of_settings():
    survey = static_survey()
    survey.legs[0].scanner_settings.head_rotation = 0
    with pytest.raises(helios.HeliosException) as caught:
        survey.run()
    told = [line for line in str(caught.value).splitlines() if "<scannerSettings" not in line]
    assert any("max_duration" in line for line in told) and not any("maxDuration_s" in line for line in told), told


def test_wrong_ids_indices_and_meshes_are_errors_at_once():
    with pytest.raises(IndexError, match="expected 0 to 1"):
        plane().update_material(helios.Material("a"), indices=[2])
    with pytest.raises(ValueError, match="at least one face"):
        plane().update_material(helios.Material("a"), range_start=2, range_stop=1)
    shelf = helios.ScenePart.from_obj(FIXTURES / "room/shelf.obj")
    names = list(shelf.materials)
    with pytest.raises(IndexError, match="for face 1000000, but the part has"):
        shelf.update_material(helios.Material("a"), indices=[0, 1_000_000])
    assert list(shelf.materials) == names and len(shelf.bbox.bounds) == 2
    assert "a" in shelf.update_material(helios.Material("a"), indices=[0]).materials
    for file in ("data/platforms.xml", FIXTURES / "room/platforms.xml"):
        with pytest.raises(ValueError, match="no platform with the id 'tripodd'"):
            helios.Platform.from_xml(file, "tripodd")
        assert helios.Platform.from_xml(file, "tripod").name == "tripod"
    with pytest.raises(ValueError, match="no scanner with the id"):
        helios.Scanner.from_xml("data/scanners_tls.xml", "riegl_vz4000")

    class Empty:
        vertices, triangles = np.zeros((3, 3)), np.zeros((0, 3), int)

    with pytest.raises(ValueError, match="no triangles"):
        helios.ScenePart.from_open3d(Empty())
    with pytest.raises(helios.HeliosException, match="CANONICAL"):
        helios.Platform.load_interpolate_platform(np.zeros((2, 7)), "data/platforms.xml", "sr22", "other")
    with pytest.raises(TypeError, match="belongs to the class"):
        plane().from_obj("a.obj")


def test_a_survey_takes_a_trajectory_as_an_array():
    survey = helios.Survey(helios.scanner.leica_als50(), helios.platforms.sr22(), helios.StaticScene([plane()]))
    survey.trajectory = np.column_stack([np.arange(3), np.zeros((3, 3)), np.arange(3) * 10.0, np.zeros(3), np.full(3, 60.0)])
    assert survey.trajectory["x"].tolist() == [0, 10, 20] and survey.platform.trajectory is survey.trajectory
    with pytest.raises(ValueError, match="seven numbers"):
        survey.trajectory = np.zeros((2, 3))


def test_yaml_and_bundles_are_not_offered():
    for call in (static_survey().to_yaml, helios.Survey.from_yaml, helios.StaticScene().to_bundle, helios.ScenePart.from_bundle):
        with pytest.raises(NotImplementedError, match="to_xml"):
            call("file")


def test_the_files_of_the_catalogue_are_files(tmp_path):
    with helios.add_asset_directory(tmp_path):
        first, *_, last = helios.utils.get_asset_directories()
        assert first == tmp_path and (last / "scanners_tls.xml").is_file() and len(helios.utils.get_asset_directories()) == 4
    assert "tripod" in helios.display_xml("data/platforms.xml", "tripod")
    assert helios.Platform.from_xml("data/platforms.xml", "tripod").reference == "data/platforms.xml#tripod"
    assert helios.Scanner.from_xml(last / "scanners_tls.xml", "riegl_vz400").name == "riegl_vz400"


def test_another_separator_than_that_of_the_cloud_is_an_error(tmp_path):
    cloud = tmp_path / "a.xyz"
    cloud.write_text("0;0;0\n1;1;1\n")
    with pytest.raises(ValueError, match="no three columns between ','; its separator is ';'"):
        helios.ScenePart.from_xyz(cloud, 0.5, separator=",")
    assert helios.ScenePart.from_xyz(cloud, 0.5, separator=";").bbox.bounds[1][0] == 1


def test_files_of_the_package_are_found_by_their_names():
    assert helios.utils.find_file("scanners_tls.xml").is_file()
    assert helios.Platform.from_xml("platforms.xml", "tripod").reference == "data/platforms.xml#tripod"
    assert (helios.utils.find_file("spectra") / "needle.txt").is_file()
    rows = helios.utils.find_file("spectra/broadleaf.txt").read_text().splitlines()[26:]
    leaf = vlscan.spectra()["broadleaf"]
    assert [float(row.split()[0]) * 1000 for row in rows] == pytest.approx(leaf.wavelengths_nm)
    assert [float(row.split()[1]) / 100 for row in rows] == pytest.approx(leaf.reflectances)
    assert helios.utils.find_file("spectra/none.txt", fatal=False) is None


SQUARE = [[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]]
WOOD = "header\n" * 26 + "0.4\t10\n2.5\t10\n"


def test_spectra_of_an_installation_are_found(tmp_path, monkeypatch):
    """In ``assets`` of a folder that was added, and around the file of a material."""
    monkeypatch.chdir(tmp_path)
    spectra, part = tmp_path / "helios/assets/spectra", tmp_path / "helios/data/sceneparts/wall"
    spectra.mkdir(parents=True)
    part.mkdir(parents=True)
    (spectra / "wood.txt").write_text(WOOD)
    (part / "wall.mtl").write_text("newmtl wood\nhelios_spectra wood\n")
    (part / "wall.obj").write_text("mtllib wall.mtl\nv -20 -20 0\nv 20 -20 0\nv 20 20 0\nv -20 20 0\nusemtl wood\nf 1 2 3 4\n")

    def intensities(part):
        survey = helios.Survey(helios.scanner.riegl_vz_400(), helios.platforms.tripod(), helios.StaticScene([part]))
        survey.add_leg(z=2, head_rotation="60 deg/s", rotation_stop_angle="20 deg", scan_frequency="120 Hz", pulse_frequency="100 kHz")
        return survey.run()[0]["intensity"].tolist()

    def wall(**material):
        return helios.ScenePart.from_mesh(SQUARE, [[0, 1, 2, 3]], helios.Material(name="wood", **material))

    expected = intensities(wall(reflectance=10))
    assert expected and intensities(helios.ScenePart.from_obj(part / "wall.obj")) == expected
    with helios.add_asset_directory(tmp_path / "helios"):
        assert intensities(wall(spectra="wood")) == expected


def test_handles_of_folders_show_nothing(tmp_path):
    with helios.add_asset_directory(tmp_path) as handle:
        assert repr(handle) == ""


@pytest.mark.parametrize("library", ["pint", "pydantic", "vlscan_helios"])
@pytest.mark.parametrize("package", ["vlscan.helios", "vlscan.pyhelios"])
def test_without_its_distribution_the_package_says_what_to_install(library, package):
    if (library, package) in (("pint", "vlscan.pyhelios"), ("pydantic", "vlscan.pyhelios")):
        return
    text = f"import sys; sys.modules[{library!r}] = None; import {package}"
    failed = subprocess.run([sys.executable, "-c", text], check=False, capture_output=True, text=True)
    assert failed.returncode == 1 and "pip install vlscan-helios" in failed.stderr


def test_messages_about_a_changed_survey_name_its_file():
    survey = helios.Survey.from_xml(FIXTURES / "room/survey.xml")
    survey.legs[0].scanner_settings.scan_frequency = 1e6
    with pytest.raises(helios.HeliosException, match=r"survey\.xml \(as changed\):\d+"):
        survey.run()


def test_a_changed_survey_finds_the_files_beside_its_file(tmp_path, monkeypatch):
    for file in (FIXTURES / "room").iterdir():
        text = file.read_text().replace(' paths="beside"', "")
        (tmp_path / file.name).write_text(text)
    monkeypatch.chdir(tmp_path.parent)
    survey = helios.Survey.from_xml(tmp_path / "survey.xml")
    plain, _ = survey.run()
    survey.name = "written anew"
    assert survey.run()[0].tobytes() == plain.tobytes()
    assert f'scanner="{survey.scanner.reference}"' in survey.to_xml()


def test_messages_do_not_name_files_of_the_run():
    flight = np.column_stack(
        [np.linspace(0, 1, 11), np.zeros((11, 2)), np.full(11, 0.0025), np.linspace(-10, 10, 11), np.zeros(11), np.full(11, 60)]
    )
    platform = helios.Platform.load_interpolate_platform(flight, "data/platforms.xml", "sr22", "CANONICAL")
    ground = helios.ScenePart.from_mesh([[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]], [[0, 1, 2, 3]])
    survey = helios.Survey(helios.scanner.leica_als50(), platform, helios.StaticScene([ground]))
    survey.add_leg(scan_angle="20 deg", pulse_frequency="10 kHz", scan_frequency="50 Hz")
    with pytest.warns(vlscan.VlscanWarning, match="<survey>") as caught:
        survey.run()
    assert {warning.filename for warning in caught} == {__file__}
    text = "\n".join(str(warning.message) for warning in caught)
    assert tempfile.gettempdir() not in text and "radians" not in text
    assert 'trajectory="&lt;trajectory&gt;"' in survey.to_xml()
    survey.add_leg(scan_angle="89 deg")
    with pytest.raises(helios.HeliosException, match="<survey>"):
        survey.run()
