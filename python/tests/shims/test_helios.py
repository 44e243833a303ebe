"""The names of HELIOS++ 3."""

import sys

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES

pytest.importorskip("pint")

from vlscan import helios


@pytest.fixture(autouse=True)
def _fresh():
    helios.set_rng_seed(1)
    with helios.add_asset_directory(FIXTURES / "room"):
        yield


def plane(size=30.0, z=0.0):
    corners = [[-size, -size, z], [size, -size, z], [size, size, z], [-size, size, z]]
    return helios.ScenePart.from_numpy_array(corners, [[0, 1, 2], [0, 2, 3]])


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
    assert trajectory.dtype.names == ("gps_time", "position", "roll", "pitch", "yaw") and len(trajectory) > 10


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


def test_the_survey_of_a_file_is_run_as_it_is_or_refused(tmp_path):
    fine = helios.Survey.from_xml("survey.xml", full_waveform_settings=helios.FullWaveformSettings(beam_sample_quality=1, bin_size=0.5))
    plain = helios.Survey.from_xml("survey.xml")
    assert fine.full_waveform_settings.beam_sample_quality == 1
    for name in ("name", "legs", "scanner", "platform", "full_waveform_settings"):
        with pytest.raises(NotImplementedError, match=f"^{name} of the survey of a file is not read"):
            getattr(plain.clone(), name)
    with pytest.raises(AttributeError, match="'nothing'"):
        plain.nothing
    assert "survey.xml" in repr(plain) and plain.scene is None
    assert helios.display_xml(plain) == plain.to_xml() == (FIXTURES / "room/survey.xml").read_text()
    a, b = fine.run()[0], plain.run()[0]
    assert len(a) > 10_000 and (len(a) != len(b) or (a["intensity"] != b["intensity"]).any())
    own = '<FWFSettings binSize_ns="0.5" beamSampleQuality="1" winSize_ns="1"/><leg>'
    (tmp_path / "own.xml").write_text(plain.to_xml().replace("<leg>", own, 1))
    assert helios.Survey.from_xml(tmp_path / "own.xml").run()[0].tobytes() == a.tobytes()
    for change in (
        {"name": "other"}, {"legs": [helios.Leg()]}, {"scanner": helios.scanner.riegl_vz_400()}, {"platform": helios.platforms.tripod()},
    ):  # fmt: skip
        with pytest.raises(NotImplementedError, match=f"^{next(iter(change))} of the survey of a file cannot be replaced"):
            helios.Survey.from_xml("survey.xml", **change)
        survey = plain.clone()
        setattr(survey, *next(iter(change.items())))
        with pytest.raises(NotImplementedError, match="cannot be replaced"):
            survey.run()


def test_a_window_below_two_bins_is_an_error():
    with pytest.raises(ValueError, match="win_size is 0.5 ns, expected at least two bins of bin_size 0.5 ns"):
        helios.FullWaveformSettings(bin_size=0.5, win_size=0.5)
    assert helios.FullWaveformSettings(bin_size=0.1, win_size=0.2).win_size == 0.2
    settings = helios.FullWaveformSettings()
    settings.bin_size = 1.0
    survey = helios.Survey.from_xml("survey.xml", full_waveform_settings=settings)
    with pytest.raises(ValueError, match="two bins"):
        survey.run()


def test_keywords_without_effect_are_refused():
    for form in (helios.OutputFormat.NPY, "laspy"):
        for name in ("write_waveform", "write_pulse"):
            with pytest.raises(NotImplementedError, match=f"^{name} needs a format of files"):
                static_survey().run(format=form, **{name: True})
    for form, name, value in (("npy", "las_scale", 0.01), ("laspy", "split_by_channel", True), ("npy", "output_dir", "elsewhere")):
        with pytest.warns(vlscan.VlscanWarning, match=f"^{name} has no effect") as caught:
            static_survey().run(format=form, **{name: value})
        assert caught[0].filename == __file__
    for wrong in ({"parallelization": 7}, {"parallelization": "chunk"}, {"verbosity": 6}):
        with pytest.raises(ValueError, match="is not a valid"):
            static_survey().run(**wrong)
    survey = static_survey()
    survey.legs[0].trajectory_settings.start_time = 3
    with pytest.raises(ValueError, match="start_time, but the platform has no trajectory"):
        survey.run()
    with pytest.raises(ValueError, match="no scanner or no platform"):
        helios.display_xml(helios.Survey())


def test_the_clock_starts_at_a_time_of_any_zone():
    from datetime import datetime, timedelta, timezone

    def first(gps_time):
        survey = static_survey()
        survey.gps_time = gps_time
        return survey.run()[0]["gps_time"][0]

    expected = first("2024-06-05 10:00:00")
    assert first(datetime(2024, 6, 5, 12, tzinfo=timezone(timedelta(hours=2)))) == expected == first(datetime(2024, 6, 5, 10))
    assert first("2024-06-05 12:00:00") == expected + 7200


def test_a_folder_added_for_good_stays_after_a_block(tmp_path):
    from vlscan.helios.settings import asset_directories

    before = asset_directories()
    helios.add_asset_directory(tmp_path)
    with helios.add_asset_directory(tmp_path):
        assert asset_directories() == [*before, str(tmp_path)]
    assert asset_directories() == [*before, str(tmp_path)]
    with helios.add_asset_directory(tmp_path / "other"):
        assert asset_directories() == [*before, str(tmp_path), str(tmp_path / "other")]
    assert asset_directories() == [*before, str(tmp_path)]


def test_units():
    settings = helios.ScannerSettings(head_rotation="180 deg/s", max_duration="2 min", scan_frequency="1 kHz")
    assert settings.head_rotation == pytest.approx(np.pi) and (settings.max_duration, settings.scan_frequency) == (120, 1000)
    settings.scan_angle = 45 * helios.units.deg
    assert settings.scan_angle == pytest.approx(np.pi / 4)
    with pytest.raises(Exception, match="length"):
        helios.ScannerSettings(scan_angle="3 m")
    both = helios.combine_parameters(settings, helios.ScannerSettings(is_active=False), pulse_frequency=5)
    assert (both.is_active, both.pulse_frequency, both.max_duration) == (False, 5, 120)


def test_unknown_keywords_are_value_errors():
    for wrong in (
        lambda: helios.ScannerSettings(scan_freqency=1),
        lambda: static_survey().add_leg(hight=3),
        lambda: static_survey().run(formt="npy"),
        lambda: helios.Survey(scaner=None),
        lambda: helios.StaticScene(parts=[]),
        lambda: helios.Material("a", reflectence=1),
        lambda: helios.scanner_from_name("riegl_vz_4000"),
        lambda: helios.Survey().run(),
        lambda: setattr(helios.ScannerSettings(), "speed", 1),
    ):
        with pytest.raises(ValueError):
            wrong()
    with pytest.raises(NotImplementedError, match="run_batches"):
        static_survey().run(callbacks=helios.SurveyHook())
    with pytest.raises(NotImplementedError, match="StaticScene"):
        helios.ScenePart.from_xml("scene.xml")


def test_parts_are_transformed_in_order():
    part = plane(1.0).scale(2).translate([10, 0, 0]).rotate(axis=[0, 0, 1], angle="90 deg")
    low, high = part.bbox.bounds
    assert np.allclose(low, [-2, 8, 0]) and np.allclose(high, [2, 12, 0]) and np.allclose(part.bbox.centroid, [0, 10, 0])
    turned = plane(1.0).rotate(from_axis=[0, 0, 1], to_axis=[1, 0, 0], rotation_center=[0, 0, 5])
    assert np.allclose(turned.bbox.bounds, [[-5, -1, 4], [-5, 1, 6]])
    half = plane(1.0).rotate([0, 0, 0, 1])
    assert np.allclose(half.bbox.bounds, [[-1, -1, 0], [1, 1, 0]])
    with pytest.raises(ValueError, match="needs"):
        plane().rotate()


def test_materials_can_be_changed():
    part = helios.ScenePart.from_obj(FIXTURES / "forest/beech.obj")
    assert part.materials
    name = next(iter(part.materials))
    part.materials[name].classification = 77
    scene = helios.StaticScene([part])
    assert 77 in {kind for _, kind in scene.engine().materials.values()}
    other = plane().update_material(helios.Material("roof", reflectance=0.9, classification=6), indices=[1])
    points, _ = static_survey(other).run()
    assert set(points["classification"]) <= {0, 6} and 6 in points["classification"]
    vertices, quads = [[-9, -9, 0], [0, -9, 0], [9, -9, 0], [9, 9, 0], [0, 9, 0], [-9, 9, 0]], [[0, 1, 4, 5], [1, 2, 3, 4]]
    for chosen in ({"indices": [1]}, {"indices": np.array([False, True])}, {"range_start": 1, "range_stop": 2}):
        field = helios.ScenePart.from_numpy_array(vertices, quads)
        field.update_material(helios.Material("a", reflectance=0.9, classification=6), **chosen)
        points, _ = static_survey(field).run()
        assert ((points["classification"] == 6) == (points["position"][:, 0] > 0)).mean() > 0.99 and len(points) > 1000
    for wrong in ({"indices": [-1]}, {"indices": [2]}, {"indices": [True]}, {"range_stop": 3}):
        with pytest.raises(ValueError, match="expected"):
            helios.ScenePart.from_numpy_array(vertices, quads).update_material(helios.Material("a"), **wrong)
    # As a fraction, which the default physics of the engine takes; surveys of this package take 50 with that of HELIOS++.
    assert helios.StaticScene([plane()]).engine().materials == {"default": (0.5, 0)}
    with pytest.warns(vlscan.VlscanWarning, match="'bright' is 1.5"):
        helios.Material("bright", reflectance=1.5)
    read = helios.Material.from_file(FIXTURES / "forest/forest.mtl")
    assert helios.Material.from_file(FIXTURES / "forest/forest.mtl", next(iter(read))) in read.values()


def test_scenes(tmp_path):
    scene = helios.StaticScene.from_xml("scene.xml")
    assert scene.bbox.bounds[0][0] < scene.bbox.centroid[0]
    built = helios.StaticScene([plane()])
    built.add_scene_part(plane(1.0, z=4.0), force_on_ground=False)
    assert len(built.scene_parts) == 2 and built.bbox.bounds[1][2] == 4 and built.engine() is built.engine()
    built.to_binary(tmp_path / "a.vlscene")
    assert np.allclose(helios.StaticScene.from_binary(tmp_path / "a.vlscene").bbox.bounds, built.bbox.bounds)
    assert len(helios.ScenePart.from_objs(str(FIXTURES / "forest/*.obj"))) == 4


def test_scanners_and_platforms():
    assert len(helios.list_scanners()) >= 31 and len(helios.list_platforms()) >= 11
    assert helios.scanner.riegl_vz_400().reference == helios.scanner_from_name("riegl_vz400").reference
    assert helios.Scanner.from_xml("scanners.xml").reference.endswith("room/scanners.xml")
    assert helios.platforms.tripod().name == "tripod"


def test_recorded_trajectories(tmp_path):
    t = np.arange(0, 4, 0.05)
    table = np.column_stack([t, 0 * t, 0 * t, 0 * t, 0 * t, 20 * t - 40, 0 * t + 100])
    file = tmp_path / "flight.csv"
    np.savetxt(file, table, delimiter=",")
    poses = helios.platforms.load_traj_csv(csv=file, tIndex=0, rollIndex=1, pitchIndex=2, yawIndex=3, xIndex=4, yIndex=5, zIndex=6)
    platform = helios.Platform.load_interpolate_platform(poses, platform_file="data/platforms.xml", platform_id="sr22")
    survey = helios.Survey(scanner=helios.scanner_from_name("riegl_lms_q780"), platform=platform, scene=helios.StaticScene([plane(200.0)]))
    survey.add_leg(
        scanner_settings=helios.ScannerSettings(pulse_frequency=50_000, scan_frequency=50, scan_angle="20 deg"),
        trajectory_settings=helios.TrajectorySettings(start_time=1.0, end_time=2.0, teleport_to_start=True),
    )
    points, trajectory = survey.run()
    assert (
        len(points) > 10_000
        and np.isclose(trajectory["position"][0, 1], -20, atol=1)
        and np.isclose(trajectory["position"][-1, 1], 0, atol=1)
    )


def test_other_names_of_the_package_are_the_same_modules():
    from vlscan.helios.settings import ScannerSettings

    from vlscan_helios import v3

    assert vlscan.helios is v3 is helios and ScannerSettings is v3.ScannerSettings


def test_install_gives_the_name_of_the_original():

    before = dict(sys.modules)
    try:
        vlscan.helios.install()
        import helios as installed
        from helios.scanner import riegl_vz_400
        from helios.settings import ScannerSettings

        assert installed is helios and ScannerSettings is helios.ScannerSettings and riegl_vz_400().name
    finally:
        for name in set(sys.modules) - set(before):
            del sys.modules[name]


def test_surveys_are_cloned_and_shown():
    survey = static_survey()
    twin = survey.clone()
    twin.legs[0].scanner_settings.pulse_frequency = 300_000
    assert survey.legs[0].scanner_settings.pulse_frequency == 100_000
    assert 'headRotateStop_deg="20.0"' in helios.display_xml(survey)
