"""The names of HELIOS++ 3: surveys, legs, settings, runs."""

import math
import sys
from datetime import datetime, timedelta, timezone

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES

pytest.importorskip("pint")
pytest.importorskip("pydantic")

from vlscan import helios


@pytest.fixture(autouse=True)
def _fresh():
    helios.set_rng_seed(1)
    with helios.add_asset_directory(FIXTURES / "room"):
        yield
    helios.set_execution_settings()
    helios.set_output_settings()


def plane(size=30.0, z=0.0):
    corners = [[-size, -size, z], [size, -size, z], [size, size, z], [-size, size, z]]
    return helios.ScenePart.from_mesh(corners, [[0, 1, 2], [0, 2, 3]])


def static_survey(*parts):
    scene = helios.StaticScene(scene_parts=list(parts) or [plane()])
    survey = helios.Survey(scanner=helios.scanner_from_name("riegl_vz_400"), platform=helios.platform_from_name("tripod"), scene=scene)
    survey.add_leg(
        x=0,
        y=0,
        z="150 cm",
        head_rotation="10 deg/s",
        rotation_start_angle="0 deg",
        rotation_stop_angle=20 * helios.units.degree,
        pulse_frequency=100_000,
        scan_frequency=120,
        min_vertical_angle="-40 deg",
        max_vertical_angle=np.radians(60),
    )
    return survey


def test_a_survey_gives_points_and_trajectory():
    points, trajectory = static_survey().run()
    assert points.dtype.itemsize == 134 and len(points) > 10_000 and points.flags.c_contiguous
    assert np.abs(points["position"][:, 2]).max() < 0.1
    ends = points["beam_origin"] + points["beam_direction"] * points["distance"][:, None]
    assert np.allclose(ends, points["position"], atol=1e-9)
    assert (points["return_number"] <= points["number_of_returns"]).all()
    assert trajectory.dtype == helios.utils.traj_dtype and len(trajectory) > 10


def test_the_same_survey_as_file_gives_the_same(tmp_path):
    survey = helios.Survey.from_xml("survey.xml")
    points, _ = survey.run(num_threads=2)
    other = vlscan.run(FIXTURES / "room/survey.xml", seed=1).points
    assert points["position"][:, 0].tobytes() == other["X"].tobytes() and (points["intensity"] == other["Amplitude"]).all()
    folder = survey.run(format=helios.OutputFormat.XYZ, output_dir=tmp_path)
    assert sum(1 for file in folder.glob("*_points.xyz") for _ in file.open()) == len(points)
    folder = survey.run(format="laz", output_dir=tmp_path, write_waveform=True)
    assert list(folder.glob("*.laz")) and list(folder.glob("*fullwave*"))
    laspy = pytest.importorskip("laspy")
    las, _ = survey.run(format=helios.OutputFormat.LASPY)
    assert isinstance(las, laspy.LasData) and np.allclose(las.xyz, points["position"], atol=1e-4)
    written = [laspy.read(file) for file in sorted(survey.run(format="las", output_dir=tmp_path).glob("*.las"))]
    for name in ("intensity", "scan_angle", "return_number", "number_of_returns", "classification", "gps_time"):
        expected = np.concatenate([np.asarray(each[name]) for each in written])
        assert np.array_equal(np.asarray(las[name]), expected), name
    assert las.intensity.max() > 0 and len(set(las.scan_angle)) > 10


def test_the_survey_of_a_file_can_be_read():
    survey = helios.Survey.from_xml("survey.xml")
    assert (survey.name, len(survey.legs), len(survey.scene.scene_parts)) == ("room", 2, 5)
    assert survey.scanner.reference.endswith("room/scanners.xml#tls_polygon") and survey.platform.reference.endswith("#tripod")
    first, second = survey.legs
    assert isinstance(first.platform_settings, helios.StaticPlatformSettings) and second.platform_settings.x == 1.802
    settings = first.scanner_settings
    assert (settings.pulse_frequency, settings.scan_frequency, settings.trajectory_time_interval) == (9200, 120, 1)
    assert math.isclose(settings.scan_angle, math.radians(52.5)) and math.isnan(settings.min_vertical_angle)
    assert survey.full_waveform_settings == helios.FullWaveformSettings() and helios.utils.is_xml_loaded(survey)
    assert helios.display_xml(survey) == (FIXTURES / "room/survey.xml").read_text()
    assert helios.Survey.from_xml("survey.xml") == survey == survey.clone()


def test_the_survey_of_a_file_is_run_as_changed(tmp_path):
    def points_of(change):
        survey = helios.Survey.from_xml("survey.xml")
        change(survey)
        return survey.run()[0]

    plain = points_of(lambda survey: None)
    # A change and its undoing, and a value that the file says elsewhere.
    text = (FIXTURES / "room/survey.xml").read_text().replace('pulseFreq_hz="9200"', 'pulseFreq_hz="4600"')
    (tmp_path / "slow.xml").write_text(text)

    def slower(survey):
        for leg in survey.legs:
            leg.scanner_settings.pulse_frequency = "4.6 kHz"

    with helios.add_asset_directory(FIXTURES / "room"):
        slow = vlscan.Survey.open(tmp_path / "slow.xml").run(seed=1, assets=[FIXTURES / "room"]).points
    assert points_of(slower)["position"][:, 0].tobytes() == slow["X"].tobytes()
    renamed = points_of(lambda survey: setattr(survey, "name", "other"))
    assert renamed.tobytes() == plain.tobytes()

    def second_only(survey):
        survey.legs = survey.legs[1:]

    one = points_of(second_only)
    assert set(one["point_source_id"]) == {1}
    expected = np.sort(plain["position"][plain["point_source_id"] == 2], axis=0)
    assert abs(len(one) - len(expected)) < 30 and np.allclose(np.sort(one["position"], axis=0)[::97][:50], expected[::97][:50], atol=0.5)

    def third(survey):
        survey.add_leg(survey.legs[0], x=0.5, y=0.5)
        survey.legs[0].platform_settings.x += 0.25

    assert set(points_of(third)["point_source_id"]) == {1, 2, 3}
    moved = points_of(lambda survey: setattr(survey, "scene", helios.StaticScene(scene_parts=[plane(z=-1.0)])))
    assert np.abs(moved["position"][:, 2] + 1).max() < 0.2
    other = points_of(lambda survey: setattr(survey, "scanner", helios.scanner.riegl_vz_1000()))
    assert len(other) > 10_000 and other.tobytes() != plain.tobytes()
    raised = points_of(lambda survey: setattr(survey, "platform", helios.platforms.simple_linearpath()))
    assert raised.tobytes() != plain.tobytes()

    def part_moved(survey):
        survey.scene.scene_parts[1].translate([0, 0, 5])

    # Behind the ceiling.
    assert 1 in plain["hit_object_id"] and 1 not in points_of(part_moved)["hit_object_id"]

    def finer(survey):
        survey.full_waveform_settings = helios.FullWaveformSettings(beam_sample_quality=1, bin_size="0.5 ns")

    fine = points_of(finer)
    own = '<FWFSettings binSize_ns="0.5" beamSampleQuality="1" winSize_ns="1"/><leg>'
    (tmp_path / "own.xml").write_text((FIXTURES / "room/survey.xml").read_text().replace("<leg>", own, 1))
    from_file = helios.Survey.from_xml(tmp_path / "own.xml")
    assert from_file.full_waveform_settings.bin_size == pytest.approx(0.5e-9)
    assert from_file.run()[0].tobytes() == fine.tobytes() != plain.tobytes()


@pytest.mark.parametrize("folder", ["forest", "moving", "street", "terrain"])
def test_what_is_not_changed_stays_as_it_is(folder, monkeypatch):
    monkeypatch.setattr(helios.utils, "_asset_directories", [])
    survey = helios.Survey.from_xml(FIXTURES / folder / "survey.xml")
    plain, _ = survey.run()
    survey.name = "written anew"
    assert len(plain) > 100 and survey.run()[0].tobytes() == plain.tobytes()


def test_the_flight_of_a_file_can_be_read_and_changed():
    survey = helios.Survey.from_xml(FIXTURES / "forest/survey.xml")
    assert [leg.scanner_settings.is_active for leg in survey.legs] == [True, False, True, False]
    place = survey.legs[0].platform_settings
    assert isinstance(place, helios.DynamicPlatformSettings) and (place.x, place.z, place.speed_m_s) == (10, 301.5, 60)
    before = survey.run()[0]
    for leg in survey.legs:
        leg.platform_settings.speed_m_s = 120
    after = survey.run()[0]
    assert len(after) < 0.6 * len(before)


def test_a_window_below_two_bins_is_an_error():
    with pytest.raises(ValueError, match="win_size is 5e-10 s, expected at least two bins"):
        helios.FullWaveformSettings(bin_size="0.5 ns", win_size="0.5 ns")
    assert helios.FullWaveformSettings(bin_size=1e-10, win_size=2e-10).win_size == 2e-10
    survey = helios.Survey.from_xml("survey.xml")
    survey.full_waveform_settings.bin_size = 1e-9
    with pytest.raises(ValueError, match="two bins"):
        survey.run()


def test_a_window_of_a_file_is_as_it_is(tmp_path):
    own = '<FWFSettings binSize_ns="1" winSize_ns="1"/><leg>'
    (tmp_path / "own.xml").write_text((FIXTURES / "room/survey.xml").read_text().replace("<leg>", own, 1))
    survey = helios.Survey.from_xml(tmp_path / "own.xml")
    assert survey.full_waveform_settings.win_size == survey.full_waveform_settings.bin_size == pytest.approx(1e-9)
    plain, _ = survey.run()
    survey.name = "written anew"
    assert survey.run()[0].tobytes() == plain.tobytes()


def test_keywords_without_effect_are_refused():
    for form in (helios.OutputFormat.NPY, "laspy"):
        for name in ("write_waveform", "write_pulse"):
            with pytest.raises(NotImplementedError, match=f"^{name} needs a format of files"):
                static_survey().run(format=form, **{name: True})
    for form, name, value in (("npy", "las_scale", 0.01), ("laspy", "split_by_channel", True)):
        with pytest.warns(vlscan.VlscanWarning, match=f"^{name} has no effect") as caught:
            static_survey().run(format=form, **{name: value})
        assert caught[0].filename == __file__
    with pytest.warns(vlscan.VlscanWarning, match="^log_file has no effect"):
        static_survey().run(log_file=True)
    for wrong in ({"parallelization": 7}, {"parallelization": "chunk"}, {"verbosity": 6}, {"num_threads": 0}, {"chunk_size": -1}):
        with pytest.raises(ValueError, match="Input should be"):
            static_survey().run(**wrong)
    survey = static_survey()
    survey.add_leg(start_time=3)
    with pytest.raises(ValueError, match="start_time, but the platform has no trajectory"):
        survey.run()
    with pytest.raises(ValueError, match="no legs"):
        helios.Survey(scanner=survey.scanner, platform=survey.platform, scene=survey.scene).run()
    with pytest.raises(ValueError, match="Field required"):
        helios.Survey()


def test_errors_of_the_engine_are_helios_exceptions():
    survey = static_survey()
    survey.legs[0].scanner_settings.scan_frequency = 1e6
    with pytest.raises(helios.HeliosException, match="scan frequency") as caught:
        survey.run()
    assert isinstance(caught.value, vlscan.InputError) and any(problem.severity == "error" for problem in caught.value.problems)
    with pytest.raises(FileNotFoundError, match="add_asset_directory"):
        helios.Survey.from_xml("missing.xml")


@pytest.mark.parametrize(
    "text", ["", "<document>", "<document/>", "<document><survey/></document>", "\xff<a/>", "<document><survey scene='s.xml'/>"]
)
def test_files_that_are_no_surveys_are_errors(text, tmp_path):
    (tmp_path / "survey.xml").write_text(text, encoding="latin-1")
    with pytest.raises((ValueError, FileNotFoundError)):
        helios.Survey.from_xml(tmp_path / "survey.xml")


def test_files_of_other_encodings_are_read(tmp_path):
    text = (FIXTURES / "room/survey.xml").read_text().replace('name="room"', 'name="R\u00e4ume"')
    (tmp_path / "survey.xml").write_bytes(b"\n" + text.encode("latin-1"))
    assert helios.Survey.from_xml(tmp_path / "survey.xml").name == "R\u00e4ume"


def test_the_clock_starts_at_a_time_of_any_zone():
    def first(gps_time):
        survey = static_survey()
        survey.gps_time = gps_time
        return survey.run()[0]["gps_time"][0]

    expected = first("2024-06-05 10:00:00")
    assert first(datetime(2024, 6, 5, 12, tzinfo=timezone(timedelta(hours=2)))) == expected == first(datetime(2024, 6, 5, 10))
    assert first("2024-06-05 12:00:00") == expected + 7200


def test_a_folder_added_for_good_stays_after_a_block(tmp_path):
    def directories():
        # Those of the package come last.
        return helios.utils.get_asset_directories()[:-3]

    before = directories()
    registration = helios.add_asset_directory(tmp_path)
    with helios.add_asset_directory(tmp_path):
        assert directories() == [*before, tmp_path]
    assert directories() == [*before, tmp_path]
    with helios.add_asset_directory(tmp_path / "other"):
        assert directories() == [*before, tmp_path, tmp_path / "other"]
    with registration:
        pass
    assert directories() == before


def test_units():
    settings = helios.ScannerSettings(head_rotation="180 deg/s", trajectory_time_interval="2 min", scan_frequency="1 kHz")
    assert settings.head_rotation == pytest.approx(np.pi) and (settings.trajectory_time_interval, settings.scan_frequency) == (120, 1000)
    settings.scan_angle = 45 * helios.units.deg
    assert settings.scan_angle == pytest.approx(np.pi / 4)
    settings.min_vertical_angle = "10"
    assert settings.min_vertical_angle == 10
    for wrong in (
        {"scan_angle": "3 m"},
        {"scan_angle": "3 turnips"},
        {"pulse_frequency": -1},
        {"pulse_frequency": True},
        {"scan_angle": None},
    ):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            helios.ScannerSettings(**wrong)
    with pytest.raises(ValueError, match="rad"):
        settings.scan_angle = "3 m"


def test_unknown_keywords_are_value_errors():
    for wrong in (
        lambda: helios.ScannerSettings(scan_freqency=1),
        lambda: static_survey().add_leg(hight=3),
        lambda: static_survey().run(formt="npy"),
        lambda: helios.Survey(scaner=None),
        lambda: helios.StaticScene(parts=[]),
        lambda: helios.Material(name="a", reflectence=1),
        lambda: helios.scanner_from_name("riegl_vz_4000"),
        lambda: helios.set_output_settings(formt="npy"),
        lambda: helios.ScenePart.from_obj("shelf.obj", up="y"),
    ):
        with pytest.raises(ValueError):
            wrong()


def test_settings_hold_for_all_later_runs(tmp_path):
    pytest.importorskip("laspy")
    helios.set_output_settings(format="laspy")
    assert hasattr(static_survey().run()[0], "header")
    assert static_survey().run(format="npy")[0].dtype.names
    assert static_survey().run(output_settings=helios.OutputSettings(format="npy"))[0].dtype.names
    helios.set_output_settings(helios.OutputSettings(format="las"), output_dir=tmp_path / "new")
    assert (tmp_path / "new").is_dir() and list(static_survey().run().glob("*.las"))
    helios.set_execution_settings(num_threads=1, verbosity=helios.LogVerbosity.SILENT)
    composed = helios.settings.compose_execution_settings(helios.ExecutionSettings(chunk_size=5), {"warehouse_factor": 2})
    assert (composed.num_threads, composed.chunk_size, composed.warehouse_factor) == (1, 5, 2)
    helios.set_execution_settings()
    assert helios.settings.compose_execution_settings() == helios.ExecutionSettings()


def test_legs_take_settings_and_keywords():
    survey = static_survey()
    shared = helios.ScannerSettings(pulse_frequency=1000)
    survey.add_leg(scanner_settings=shared, platform_settings=helios.StaticPlatformSettings(x=3), is_active=False)
    survey.add_leg(scanner_settings=shared, x=4, force_on_ground=True)
    assert (survey.legs[1].scanner_settings.is_active, shared.is_active) == (False, True)
    assert survey.legs[2].scanner_settings is shared and survey.legs[2].platform_settings.force_on_ground
    survey.add_leg(survey.legs[1], z="2 m")
    # That same leg, changed.
    assert survey.legs[3] is survey.legs[1] and (survey.legs[3].platform_settings.x, survey.legs[3].platform_settings.z) == (3, 2)
    leg = helios.Leg(scanner_settings=shared, platform_settings=helios.StaticPlatformSettings())
    survey.add_leg(leg)
    assert survey.legs[-1] is leg
    survey.platform = helios.platforms.sr22()
    survey.add_leg(speed_m_s=30)
    assert isinstance(survey.legs[-1].platform_settings, helios.DynamicPlatformSettings)


def test_settings_take_values_of_others():
    settings = helios.ScannerSettings(scan_angle=0.1)
    settings.update_from_dict({"pulse_frequency": "1 kHz", "is_active": False})
    settings.update_from_object(helios.ScannerSettings(scan_frequency=7))
    assert (settings.pulse_frequency, settings.is_active, settings.scan_frequency, settings.scan_angle) == (1000, False, 7, 0.1)
    with pytest.raises(ValueError):
        settings.update_from_dict({"turnips": 1})
    settings.update_from_dict({"turnips": 1, "scan_frequency": 8}, skip_exceptions=True)
    assert settings.scan_frequency == 8
    assert settings != helios.ScannerSettings() == helios.ScannerSettings().clone()


def test_recorded_trajectories(tmp_path):
    t = np.arange(0, 4, 0.05)
    table = np.column_stack([t, 0 * t, 0 * t, 0 * t, 0 * t, 20 * t - 40, 0 * t + 100])
    file = tmp_path / "flight.csv"
    np.savetxt(file, table, delimiter=",")
    poses = helios.load_traj_csv(csv=file, tIndex=0, rollIndex=1, pitchIndex=2, yawIndex=3, xIndex=4, yIndex=5, zIndex=6)
    scene = helios.StaticScene(scene_parts=[plane(200.0)])
    positions = []
    for given in (poses, table):
        platform = helios.Platform.load_interpolate_platform(given, "data/platforms.xml", "sr22", "ARINC 705", True)
        survey = helios.Survey(scanner=helios.scanner_from_name("riegl_lms_q780"), platform=platform, scene=scene)
        survey.add_leg(
            scanner_settings=helios.ScannerSettings(pulse_frequency=50_000, scan_frequency=50, scan_angle="20 deg"),
            trajectory_settings=helios.TrajectorySettings(start_time=1.0, end_time=2.0, teleport_to_start=True),
        )
        points, trajectory = survey.run()
        assert len(points) > 10_000 and points["gps_time"][0] == pytest.approx(1, abs=0.1)
        assert np.isclose(trajectory["position"][0, 1], -20, atol=1) and np.isclose(trajectory["position"][-1, 1], 0, atol=1)
        positions.append(points["position"])
    assert np.array_equal(*positions)
    part = helios.TrajectorySettings(start_time=1.0, end_time=2.0, teleport_to_start=True)
    survey.legs = [
        helios.Leg(
            scanner_settings=survey.legs[0].scanner_settings, platform_settings=helios.DynamicPlatformSettings(trajectory_settings=part)
        )
    ]
    assert survey.run()[0]["position"].tobytes() == positions[0].tobytes()
    again = helios.Platform.load_interpolate_platform(trajectory, "data/platforms.xml", "sr22")
    assert again.trajectory.dtype == helios.platforms.traj_csv_dtype and not again.is_static
    degrees = helios.Platform.load_interpolate_platform(table + 1, "data/platforms.xml", "sr22", is_roll_pitch_yaw_in_radians=False)
    assert degrees.trajectory["roll"][0] == pytest.approx(np.radians(1))
    assert helios.load_traj_csv(file, rpy_in_radians=True)["yaw"][0] == 0
    for wrong in ({"tIndex": 7}, {"tIndex": 1}, {"tIndex": 0.5}, {"trajectory_separator": ", "}):
        with pytest.raises(ValueError):
            helios.load_traj_csv(file, **wrong)
    with pytest.raises(ValueError, match="CANONICAL"):
        helios.Platform.load_interpolate_platform(table, "data/platforms.xml", "sr22", "SPLINE")
    with pytest.raises(ValueError, match="seven numbers"):
        helios.Platform.load_interpolate_platform(table[:, :5], "data/platforms.xml")


def test_parameters_are_combined():
    combined = helios.combine_parameters(groups=[["x", "y"], ["speed_m_s"]], x=[0, 1], y=(2, 3), speed_m_s=np.array([5, 6]), z="3 m")
    assert [(each["x"], each["y"], each["speed_m_s"], each["z"]) for each in combined] == [
        (0, 2, 5, "3 m"), (0, 2, 6, "3 m"), (1, 3, 5, "3 m"), (1, 3, 6, "3 m"),
    ]  # fmt: skip
    for wrong in ({"groups": [["x", "y"]], "x": [1]}, {"groups": [["x", "y"]], "x": [1], "y": [1, 2]}, {"groups": [["x"], ["x"]], "x": 1}):
        with pytest.raises(ValueError, match="group"):
            helios.combine_parameters(**wrong)


def test_surveys_are_cloned_and_shown():
    survey = static_survey()
    twin = survey.clone()
    assert twin == survey
    twin.legs[0].scanner_settings.pulse_frequency = 300_000
    assert survey.legs[0].scanner_settings.pulse_frequency == 100_000 and twin != survey
    assert 'headRotateStop_deg="20.0"' in helios.display_xml(survey)
    assert "panorama" in helios.display_xml(FIXTURES / "room/survey.xml", "panorama")
    with pytest.raises(ValueError, match="no element"):
        helios.display_xml(FIXTURES / "room/survey.xml", "turnip")


def test_other_names_of_the_package_are_the_same_modules():
    from vlscan.helios.scanner import riegl_vz_400
    from vlscan.helios.settings import ExecutionSettings

    from vlscan_helios import v3

    assert vlscan.helios is v3 is helios and ExecutionSettings is v3.ExecutionSettings and riegl_vz_400() == helios.scanner.riegl_vz_400()


def test_install_gives_the_name_of_the_original():
    before = dict(sys.modules)
    try:
        vlscan.helios.install()
        import helios as installed
        from helios.leg import Leg
        from helios.scanner import riegl_vz_400

        assert installed is helios and Leg is helios.Leg and riegl_vz_400().name
    finally:
        for name in set(sys.modules) - set(before):
            del sys.modules[name]


def test_the_command_line(tmp_path, capfd):
    from vlscan_helios.v3.__main__ import cli

    assert cli(survey=FIXTURES / "room/survey.xml", output=tmp_path, seed=1, las_output=True) == 0
    assert "Output directory" in capfd.readouterr().out and list(tmp_path.rglob("*.las"))
    with pytest.raises(TypeError, match="survey"):
        cli(seed=1)
