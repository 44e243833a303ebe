"""Values that HELIOS++ 3's models and functions take and refuse; copies; the working directory."""

import os
import pickle
import warnings

import numpy as np
import pytest
from vlscan.helios.scene import Material

import vlscan
from conftest import FIXTURES, ROOT
from vlscan import VlscanWarning, helios

SQUARE = [[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]]


def ground():
    """Return a square."""
    return helios.ScenePart.from_mesh(SQUARE, [[0, 1, 2, 3]], Material("ground", is_ground=True, reflectance=0.5))


def tripod_survey(scene=None):
    """Return a survey of one leg."""
    survey = helios.Survey(helios.scanner.riegl_vz_400(), helios.platforms.tripod(), scene or helios.StaticScene([ground()]))
    survey.add_leg(x=0, y=0, z=3, head_rotation="50 deg/s", rotation_stop_angle="20 deg", scan_frequency="120 Hz", pulse_frequency=100_000)
    return survey


def flight(poses):
    return helios.Platform.load_interpolate_platform(poses, "data/platforms.xml", "sr22")


def test_times_that_go_back_are_warned_of():
    poses = np.zeros((4, 7))
    poses[:, 0] = [0, 2, 1, 3]
    with pytest.warns(VlscanWarning, match="go back after pose 1, from 2 s to 1 s"):
        flight(poses)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        flight(poses[[0, 2, 1, 3]])


def test_settings_within_settings_are_printed_below_their_name():
    lines = str(helios.DynamicPlatformSettings(speed_m_s=3)).splitlines()
    assert lines[4:7] == ["  trajectory_settings: TrajectorySettings", "    start_time: 0.0", "    end_time: 0.0"]


def test_objects_of_laspy_have_the_counts_and_the_classes_of_files():
    pytest.importorskip("laspy")
    survey = tripod_survey()
    survey.scene.scene_parts[0].update_material(helios.scene.Material("odd", classification=-1, reflectance=0.5))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        las, _ = survey.run(format="laspy")
    assert las.header.point_count == len(las) > 100 and set(las.classification) == {0}
    assert np.allclose(las.header.maxs, las.xyz.max(axis=0)) and np.allclose(las.header.mins, las.xyz.min(axis=0))


def test_an_unknown_keyword_that_resembles_a_field_has_a_suggestion():
    with pytest.raises(ValueError, match="did you mean 'scan_angle'"):
        helios.ScannerSettings(scan_angel=1)
    settings = helios.ScannerSettings()
    for name in ("scan_angel", "pulse_freq", "scan_freq"):
        with pytest.warns(VlscanWarning, match=name):
            setattr(settings, name, 1)
    settings.scan_angle = "30 deg"
    assert settings.scan_angle == pytest.approx(np.pi / 6)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: helios.OutputSettings(las_scale=0), "more than 0 m"),
        (lambda: helios.OutputSettings(output_dir=3), "expected a folder"),
        (lambda: helios.FullWaveformSettings(bin_size=0), "more than 0 s"),
        (lambda: helios.set_execution_settings({"num_threads": 1}), "expected ExecutionSettings, found dict"),
        (lambda: helios.set_output_settings("las"), "expected OutputSettings, found str"),
        (lambda: tripod_survey().run("las"), "expected ExecutionSettings, found str"),
        (lambda: tripod_survey().run(helios.OutputSettings()), "expected ExecutionSettings, found OutputSettings"),
        (lambda: helios.set_output_settings(helios.ExecutionSettings()), "expected OutputSettings, found ExecutionSettings"),
        (lambda: tripod_survey().run(callbacks=print), "callbacks is a list of SurveyHook, found builtin_function_or_method"),
        (lambda: tripod_survey().run(callbacks=helios.SurveyHook("leg_end", print)), "callbacks is a list of SurveyHook, found SurveyHook"),
        (lambda: tripod_survey().add_leg(1), "leg is 1, expected a Leg"),
        (lambda: tripod_survey().add_leg(platform_settings=(0, 0, 1)), r"platform_settings is \(0, 0, 1\), expected PlatformSettings"),
        (lambda: tripod_survey().add_leg(scanner_settings={"scan_angle": 1}), "scanner_settings is .* expected ScannerSettings"),
        (lambda: tripod_survey().add_leg(None, helios.ScannerSettings()), "platform_settings is .* expected PlatformSettings"),
        (lambda: helios.StaticScene(ground()), r"found one ScenePart: \[ScenePart"),
        (lambda: setattr(tripod_survey(), "legs", tripod_survey().legs[0]), r"found one Leg: \[Leg"),
        (lambda: flight(np.zeros((1, 7))), "at least 2 poses, found 1"),
        (lambda: flight([[0] * 7, [1, 0, 0, 0, np.nan, 0, 0]]), "x of pose 1 of the trajectory is nan"),
        (lambda: helios.ScannerSettings().update_from_object(None), "expected ScannerSettings, found NoneType"),
        (lambda: helios.set_rng_seed([1]), "a seed is"),
        (lambda: helios.set_rng_seed(True), "a seed is"),
        (lambda: helios.scanner_from_name(None), "name of a scanner"),
        (lambda: helios.platform_from_name(3), "name of a platform"),
        (lambda: helios.ScenePart.from_obj(None), "the name of a file"),
        (lambda: helios.ScenePart.from_objs(3), "a pattern"),
        (lambda: helios.utils.find_file(3), "the name of a file"),
        (lambda: ground().rotate(axis=[0, 0, 0], angle=1), "axis is .* expected a direction"),
        (lambda: ground().rotate(from_axis=[1, 0, 0], to_axis=[0, 0, 0]), "to_axis is .* expected a direction"),
        (lambda: ground().translate({1, 2, 3}), "in order"),
        (lambda: helios.Platform.load_interpolate_platform("poses", "data/platforms.xml"), "an array of poses"),
    ],
)
def test_wrong_values_are_refused_at_once_as_value_errors(make, match):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ValueError, match=match):
            make()


@pytest.mark.parametrize("text", ["ten", "((", "1/0 rad", "a b c", "10 deg/", "10 m", "len('a')", "", "None", "10 deg;20"])
def test_texts_that_are_no_quantities_are_value_errors(text):
    with pytest.raises(ValueError, match="expected a number or a quantity in rad/s"):
        helios.ScannerSettings(head_rotation=text)


def test_times_of_trajectories_have_units():
    settings = helios.TrajectorySettings("500 ms", 2 * helios.units.s)
    assert (settings.start_time, settings.end_time) == (0.5, 2.0)


def test_a_folder_for_all_runs_is_no_fault_of_a_run_to_memory(tmp_path):
    helios.set_output_settings(format="las", output_dir=tmp_path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert len(tripod_survey().run(format="npy")[0]) > 100
        with pytest.warns(VlscanWarning, match="output_dir has no effect"):
            tripod_survey().run(format="npy", output_dir=tmp_path)
    finally:
        helios.set_output_settings()


def test_faults_of_trajectory_files_name_the_file(tmp_path):
    (tmp_path / "empty.csv").write_text("# nothing\n")
    with pytest.raises(ValueError, match=r"empty\.csv has no poses"):
        helios.load_traj_csv(tmp_path / "empty.csv")
    (tmp_path / "wrong.csv").write_text("1,2,3,4,5,6,x\n")
    with pytest.raises(ValueError, match=r"wrong\.csv.*'x'"):
        helios.load_traj_csv(tmp_path / "wrong.csv")


def test_dumps_have_the_values_of_settings():
    leg = helios.Leg(helios.ScannerSettings(scan_angle=0.5), helios.DynamicPlatformSettings(1, 2, 3, speed_m_s=4))
    values = leg.model_dump()
    assert values["scanner_settings"]["scan_angle"] == 0.5 and values["platform_settings"]["speed_m_s"] == 4
    assert tripod_survey().model_dump()["legs"][0]["platform_settings"]["z"] == 3


def test_defaults_of_models_of_the_user_are_checked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    class Own(helios.validation.Model):
        angle: helios.validation.Angle = "90 deg"
        time: helios.validation.TimeInterval = 3 * helios.units.ns
        place: helios.validation.R3Vector = (1, 2, 3)

    own = Own()
    assert own.angle == pytest.approx(np.pi / 2) and own.time == pytest.approx(3e-9) and own.place.tolist() == [1, 2, 3]
    assert own.model_fields_set == set() and own.clone() == own
    assert str(helios.OutputSettings().output_dir) == "output" and os.listdir() == []
    assert '"diffuse_components":[0.0,' in Material("a").model_dump_json()


def test_colours_of_materials_are_copies():
    colour = np.array([0.1, 0.2, 0.3, 0.4])
    material = Material("a", diffuse_components=colour)
    colour[0] = 9
    assert material.diffuse_components[0] == 0.1


def test_parts_and_scenes_equal_their_pickles():
    part = ground().translate([1, 2, 3]).update_material(Material("wet", reflectance=0.1))
    cloud = helios.ScenePart.from_numpy_array(np.random.default_rng(1).uniform(0, 5, (20, 3)), 0.5)
    for model in (part, cloud, helios.StaticScene([part, cloud])):
        assert pickle.loads(pickle.dumps(model)) == model
    assert ground() == ground() and ground() != part


def test_scenes_of_binary_files_are_loaded_pickle_and_leave_no_warnings(tmp_path):
    helios.StaticScene([ground()]).to_binary(tmp_path / "scene.bin")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = helios.StaticScene.from_binary(tmp_path / "scene.bin")
        assert helios.utils.is_finalized(scene) and scene.source_file == str(tmp_path / "scene.bin")
        copy = pickle.loads(pickle.dumps(scene))
        assert copy.bbox.bounds[1].tolist() == [20, 20, 0] and len(tripod_survey(copy).run()[0]) > 100
        del scene, copy
    (tmp_path / "text.bin").write_text("hello")
    with pytest.raises(helios.HeliosException, match=r"text\.bin") as error:
        helios.StaticScene.from_binary(tmp_path / "text.bin")
    assert "vlscan-" not in str(error.value)
    with pytest.raises(FileNotFoundError, match=r"nowhere/scene\.bin"):
        helios.StaticScene([ground()]).to_binary(tmp_path / "nowhere/scene.bin")


def test_errors_of_scenes_are_those_of_helios_and_name_no_temporary_files():
    with pytest.raises(helios.HeliosException, match="is empty"):
        helios.StaticScene().bbox
    with pytest.raises(helios.HeliosException, match="<points>:1:1"):
        helios.ScenePart.from_numpy_array([[1e300, 0, 0]], 1.0).bbox


def test_boxes_print_their_corners():
    assert repr(ground().bbox) == "<BoundingBox [-20.0, -20.0, 0.0] to [20.0, 20.0, 0.0]>"


def test_stars_bring_what_annotations_of_version_3_need():
    names: dict = {}
    exec("import vlscan.helios; vlscan.helios.install(); from helios.validation import *", names)
    expected = "validate_call Field BaseModel PositiveInt PositiveFloat NonNegativeInt NonNegativeFloat Union Tuple Sequence NDArray"
    assert [name for name in expected.split() if name not in names] == []


def test_files_are_found_after_the_working_directory_changed(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    survey = helios.Survey.from_xml("fixtures/room/survey.xml")
    changed = survey.clone()
    changed.legs[0].scanner_settings.pulse_frequency = 9200
    changed.name = "renamed"
    of_part = tripod_survey(helios.StaticScene([helios.ScenePart.from_obj("fixtures/forest/ground.obj")]))
    before = [len(each.run()[0]) for each in (survey, changed, of_part)]
    fresh = helios.Survey.from_xml("fixtures/room/survey.xml")
    os.chdir(tmp_path)
    assert [len(each.run()[0]) for each in (survey, changed, of_part)] == before
    assert len(fresh.run()[0]) == before[0] and fresh.to_xml() == (ROOT / "fixtures/room/survey.xml").read_text()


def test_names_of_the_engine_and_of_serialization_can_be_imported():
    names: dict = {}
    text = "import vlscan.helios; vlscan.helios.install(); from _helios import HeliosException, HookContext; "
    exec(f"{text}from helios.serialization import to_yaml; import helios.serialization", names)
    assert names["HeliosException"] is helios.HeliosException and names["HookContext"] is helios.HookContext
    with pytest.raises(NotImplementedError, match=r"Survey\.to_xml"):
        names["to_yaml"](3)
    with pytest.raises(ImportError):
        exec("from _helios import Scanner")


def test_groups_of_parameters_are_lists_of_lists():
    for groups in (["x", "y"], ["xx"], "xy"):
        with pytest.raises(TypeError, match=r"expected lists of names, such as groups=\[\['x', 'y'\]\]"):
            helios.combine_parameters(groups=groups, x=[1, 2], y=[3, 4])


def test_names_of_columns_of_flights_that_contradict_are_warned_of(tmp_path):
    file = tmp_path / "flight.csv"
    file.write_text("time[s],x[m],y[m],z[m],roll[deg],pitch[deg],Heading[deg]\n0,1,2,3,0,0,90\n1,2,2,3,0,0,90\n")
    with pytest.warns(vlscan.VlscanWarning, match="rollIndex=4, pitchIndex=5, yawIndex=6, xIndex=1, yIndex=2, zIndex=3"):
        helios.load_traj_csv(file)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        poses = helios.load_traj_csv(file, rollIndex=4, pitchIndex=5, yawIndex=6, xIndex=1, yIndex=2, zIndex=3)
        assert poses["x"].tolist() == [1, 2]
        file.write_text("Time,Roll,Pitch,Yaw,Easting,Northing,Height\n0,0,0,90,1,2,3\n1,0,0,90,2,2,3\n")
        assert helios.load_traj_csv(file)["x"].tolist() == [1, 2]


def test_arrays_that_are_no_numbers_are_refused():
    for wrong in (np.zeros((3, 3), complex), [["a", "b", "c"]], np.zeros((3, 3), "M8[s]")):
        with pytest.raises(TypeError, match="points"):
            helios.ScenePart.from_numpy_array(wrong, 1)
    with pytest.raises(ValueError, match="exponent is -1"):
        helios.ScenePart.from_vox(FIXTURES / "voxels/crown.vox", "scaled", -1)


def test_warnings_are_of_the_line_of_the_program():
    with pytest.warns(vlscan.VlscanWarning, match="reflectance") as found:
        helios.Material(reflectance=3)
    assert found[0].filename == __file__


def test_names_that_are_unknown_have_a_suggestion():
    with pytest.raises(ValueError, match="has no field 'pulse_freq'; did you mean pulse_frequency"):
        helios.ScannerSettings().update_from_dict({"pulse_freq": 3})
    with pytest.raises(ValueError, match="the id or tag 'tls_polygn'; did you mean 'tls_polygon'"):
        helios.display_xml(FIXTURES / "room/scanners.xml", "tls_polygn")
    with pytest.raises(TypeError, match="expected a file or a survey, found 3"):
        helios.display_xml(3)
    with pytest.raises(ValueError, match="0 parts with the id 99, expected one; there are 0, 1, 2, 3, 4"):
        helios.ScenePart.from_xml(FIXTURES / "room/scene.xml", 99)
