"""Every name of HELIOS++ 3: where it is, its arguments in their order, its defaults; and a call of each with its arguments."""

import enum
import importlib
import inspect
import math
import os
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pytest

from conftest import FIXTURES

pytest.importorskip("pint")
pytest.importorskip("pydantic")

from vlscan import helios
from vlscan.helios import callbacks, platforms, scanner, settings, validation

NAN, NEEDED = math.nan, inspect.Parameter.empty
LARGEST = [np.finfo(np.float64).max] * 3
THREADS = os.cpu_count() or 1

#: Names of each module.
NAMES = {
    "": """metadata Leg Platform PlatformSettings DynamicPlatformSettings load_traj_csv TrajectorySettings StaticPlatformSettings
        list_platforms platform_from_name Scanner ScannerSettings list_scanners scanner_from_name StaticScene ScenePart BoundingBox
        ExecutionSettings ForceOnGroundStrategy FullWaveformSettings KDTreeFactoryType LogVerbosity OutputFormat OutputSettings
        ParallelizationStrategy ProgressBarStrategy set_execution_settings set_output_settings HookEndOfLegPolicy HookPayload HookPoint
        SurveyHook Survey add_asset_directory combine_parameters units HeliosException HookContext""",
    "callbacks": "HookPoint HookPayload HookEndOfLegPolicy SurveyHook build_progressbar_callbacks",
    "leg": "Leg",
    "platforms": """Printable traj_csv_dtype load_traj_csv PlatformSettingsBase TrajectorySettings PlatformSettings
        StaticPlatformSettings DynamicPlatformSettings Platform list_platforms platform_from_name""",
    "scanner": """ScannerSettingsBase ScannerSettings RotatingOpticsScannerSettings OscillatingOpticsScannerSettings
        LineOpticsScannerSettings ConicOpticsScannerSettings RisleyOpticsScannerSettings Scanner list_scanners scanner_from_name""",
    "scene": "Material MaterialDict BoundingBox ScenePart StaticScene",
    "settings": """ParallelizationStrategy LogVerbosity KDTreeFactoryType OutputFormat ProgressBarStrategy ForceOnGroundStrategy
        ExecutionSettings OutputSettings FullWaveformSettings set_execution_settings set_output_settings compose_execution_settings
        compose_output_settings apply_log_writing""",
    "survey": "Survey",
    "utils": """classonlymethod add_asset_directory get_asset_directories find_file find_files set_rng_seed is_real_iterable
        combine_parameters display_xml detect_separator is_finalized is_xml_loaded check_integrate_survey_and_legs apply_scene_shift
        traj_dtype""",
    "validation": "units Model UpdateableMixin",
}

SCANNERS = """leica_als50 leica_als50_ii optech_2033 optech_3100 optech_galaxy riegl_lms_q560 riegl_lms_q780 riegl_vq_780i riegl_vux_1uav
    riegl_vux_1uav22 riegl_vux_1ha22 riegl_vq_880g riegl_vq_1560i livox_mid70 livox_mid100 livox_mid100a livox_mid100b livox_mid100c
    dji_zenmuse_l2_repetitive dji_zenmuse_l2_non_repetitive riegl_vz_400 riegl_vz_1000 riegl_vz_2000i riegl_vz_600i riegl_vq_450
    livox_mid40 livox_mid70_tls vlp16 velodyne_hdl_64e tractor_scanner pano_scanner""".split()
PLATFORMS = """sr22 quadcopter copter_linearpath tractor tractor_leftside vehicle_linearpath vmx_450_car_left vmx_450_car_right
    vmq_1ha_car simple_linearpath tripod""".split()

#: Values of the enumerations.
VALUES = {
    callbacks.HookPoint: {name: name.lower() for name in ("LEG_START", "LEG_END", "SIM_TIME_ONCE", "SIM_TIME_PERIODIC")},
    callbacks.HookPayload: {name: name.lower() for name in ("METADATA_ONLY", "SINCE_LAST", "ALL_POINTS")},
    callbacks.HookEndOfLegPolicy: {name: name.lower() for name in ("NONE", "FLUSH", "FLUSH_AND_RESET")},
    settings.ParallelizationStrategy: {"CHUNK": 0, "WAREHOUSE": 1},
    settings.LogVerbosity: {"SILENT": 0, "QUIET": 32, "TIME": 40, "DEFAULT": 56, "VERBOSE": 60, "VERY_VERBOSE": 63},
    settings.KDTreeFactoryType: {"SIMPLE": 1, "SAH": 2, "SAH_BEST_AXIS": 3, "SAH_APPROXIMATION": 4},
    settings.OutputFormat: {name: name.lower() for name in ("LAS", "LAZ", "XYZ", "NPY", "LASPY")},
    settings.ProgressBarStrategy: {
        "NONE": "none", "LEGS": "legs", "TIME": "time", "LEGS_TIME": "legs+time", "PER_LEG_TIME": "per_leg_time",
    },
    settings.ForceOnGroundStrategy: {"NONE": 0, "LEAST_COMPLEX": 1, "MOST_COMPLEX": -1},
}  # fmt: skip

HEAD = {"is_active": True, "head_rotation": 0, "rotation_start_angle": 0, "rotation_stop_angle": 0}
#: Fields and defaults of the models; those of their own come behind.
FIELDS = {
    callbacks.SurveyHook: {
        "point": NEEDED, "callback": NEEDED, "barrier": False, "payload": callbacks.HookPayload.METADATA_ONLY, "end_of_leg_policy": None,
        "sim_time": None, "period": None,
    },
    helios.Leg: {"scanner_settings": NEEDED, "platform_settings": NEEDED, "trajectory_settings": None},
    helios.TrajectorySettings: {"start_time": 0, "end_time": 0, "teleport_to_start": False},
    helios.PlatformSettings: {"x": 0, "y": 0, "z": 0},
    helios.StaticPlatformSettings: {"x": 0, "y": 0, "z": 0, "force_on_ground": False},
    helios.DynamicPlatformSettings: {"x": 0, "y": 0, "z": 0, "trajectory_settings": helios.TrajectorySettings(), "speed_m_s": 70},
    helios.Platform: {"platform_settings": None},
    helios.ScannerSettings: HEAD | {
        "pulse_frequency": 300_000, "scan_angle": 0, "min_vertical_angle": NAN, "max_vertical_angle": NAN, "scan_frequency": 200,
        "beam_divergence_angle": 0.003, "trajectory_time_interval": 0.01, "vertical_resolution": 0, "horizontal_resolution": 0,
    },
    scanner.RotatingOpticsScannerSettings: HEAD,
    scanner.OscillatingOpticsScannerSettings: {},
    scanner.LineOpticsScannerSettings: {},
    scanner.ConicOpticsScannerSettings: {},
    scanner.RisleyOpticsScannerSettings: {},
    helios.Scanner: {},
    helios.Material: {
        "name": "", "is_ground": False, "spectra": "", "reflectance": NAN, "specularity": 0, "specular_exponent": 10, "classification": 0,
        "ambient_components": np.zeros(4), "diffuse_components": np.zeros(4), "specular_components": np.zeros(4),
    },
    helios.BoundingBox: {},
    helios.ScenePart: {"force_on_ground": settings.ForceOnGroundStrategy.NONE},
    helios.StaticScene: {"scene_parts": ()},
    helios.ExecutionSettings: {
        "parallelization": settings.ParallelizationStrategy.CHUNK, "num_threads": THREADS, "chunk_size": 32, "warehouse_factor": 4,
        "log_file": False, "log_file_only": False, "verbosity": settings.LogVerbosity.SILENT,
        "factory_type": settings.KDTreeFactoryType.SAH_APPROXIMATION, "kdt_num_threads": THREADS, "kdt_geom_num_threads": THREADS,
        "sah_nodes": 32, "discard_shutdown": True, "progressbar": settings.ProgressBarStrategy.PER_LEG_TIME,
    },
    helios.OutputSettings: {
        "format": settings.OutputFormat.NPY, "split_by_channel": False, "output_dir": Path("output"), "write_waveform": False,
        "write_pulse": False, "las_scale": 0.0001,
    },
    helios.FullWaveformSettings: {"bin_size": 2.5e-10, "beam_sample_quality": 3, "win_size": 1e-9, "max_fullwave_range": 0},
    helios.Survey: {
        "scanner": NEEDED, "platform": NEEDED, "scene": NEEDED, "legs": (), "name": "",
        "gps_time": datetime(2024, 1, 1, tzinfo=timezone.utc), "full_waveform_settings": helios.FullWaveformSettings(),
    },
}  # fmt: skip

CLOUD = {
    "separator": None, "max_color_value": 0, "default_normal": LARGEST, "sparse": True, "estimate_normals": False,
    "normals_file_columns": (3, 4, 5), "rgb_file_columns": (6, 7, 8), "snap_neighbor_normal": False,
}  # fmt: skip
#: Parameters of functions and methods in their order, with their defaults.
PARAMETERS = {
    "callbacks.build_progressbar_callbacks": {"strategy": NEEDED, "num_legs": NEEDED},
    "platforms.load_traj_csv": {
        "csv": NEEDED, "tIndex": 0, "rollIndex": 1, "pitchIndex": 2, "yawIndex": 3, "xIndex": 4, "yIndex": 5, "zIndex": 6,
        "trajectory_separator": ",", "rpy_in_radians": False,
    },
    "platforms.PlatformSettings.do_force_on_ground": {"scene": NEEDED},
    "platforms.Platform.from_xml": {"platform_file": NEEDED, "platform_id": ""},
    "platforms.Platform.load_interpolate_platform": {
        "trajectory": NEEDED, "platform_file": NEEDED, "platform_id": "", "interpolation_method": "ARINC 705", "sync_gps_time": False,
        "is_roll_pitch_yaw_in_radians": True,
    },
    "platforms.list_platforms": {},
    "platforms.platform_from_name": {"platform_name": NEEDED},
    "scanner.Scanner.from_xml": {"scanner_file": NEEDED, "scanner_id": ""},
    "scanner.list_scanners": {},
    "scanner.scanner_from_name": {"scanner_name": NEEDED},
    "scene.Material.from_file": {"material_file": NEEDED, "material_id": ""},
    "scene.MaterialDict.items": {},
    "scene.MaterialDict.keys": {},
    "scene.MaterialDict.values": {},
    "scene.ScenePart.rotate": dict.fromkeys(("quaternion", "axis", "angle", "from_axis", "to_axis", "rotation_center")),
    "scene.ScenePart.scale": {"factor": NEEDED},
    "scene.ScenePart.translate": {"offset": NEEDED},
    "scene.ScenePart.from_xml": {"scene_part_file": NEEDED, "id": NEEDED},
    "scene.ScenePart.from_obj": {"obj_file": NEEDED, "up_axis": "z"},
    "scene.ScenePart.from_tiff": {"tiff_file": NEEDED},
    "scene.ScenePart.from_objs": {"obj_files": NEEDED, "up_axis": "z"},
    "scene.ScenePart.from_tiffs": {"tiff_files": NEEDED},
    "scene.ScenePart.from_xyz": {"xyz_file": NEEDED, "voxel_size": NEEDED} | CLOUD,
    "scene.ScenePart.from_xyzs": {"xyz_files": NEEDED, "voxel_size": NEEDED} | CLOUD | {"sparse": False},
    "scene.ScenePart.from_vox": {
        "vox_file": NEEDED, "intersection_mode": "transmittive", "intersection_argument": None, "random_shift": False, "ladlut_path": None,
    },
    "scene.ScenePart.from_numpy_array": {
        "points": NEEDED, "voxel_size": NEEDED, "normals_file_columns": None, "rgb_file_columns": None, "max_color_value": 0,
        "default_normal": LARGEST, "sparse": True, "estimate_normals": False, "snap_neighbor_normal": False,
    },
    "scene.ScenePart.from_open3d": {"geometry": NEEDED, "kwargs": NEEDED},
    "scene.ScenePart.update_material": {"material": NEEDED, "indices": None, "range_start": None, "range_stop": None},
    "scene.StaticScene.add_scene_part": {"scene_part": NEEDED},
    "scene.StaticScene.from_xml": {"scene_file": NEEDED},
    "scene.StaticScene.from_binary": {"binary_file": NEEDED},
    "scene.StaticScene.to_binary": {"binary_file": NEEDED, "compression_level": 6},
    "settings.LogVerbosity.apply": {},
    "settings.set_execution_settings": {"execution_settings": None, "parameters": NEEDED},
    "settings.set_output_settings": {"output_settings": None, "parameters": NEEDED},
    "settings.compose_execution_settings": {"local_settings": None, "parameters": None},
    "settings.compose_output_settings": {"local_settings": None, "parameters": None},
    "settings.apply_log_writing": {"execution_settings": NEEDED},
    "survey.Survey.run": {"execution_settings": None, "output_settings": None, "callbacks": None, "parameters": NEEDED},
    "survey.Survey.add_leg": {
        "leg": None, "platform_settings": None, "scanner_settings": None, "trajectory_settings": None, "parameters": NEEDED,
    },
    "survey.Survey.from_xml": {"survey_file": NEEDED},
    "utils.add_asset_directory": {"directory": NEEDED},
    "utils.get_asset_directories": {},
    "utils.find_file": {"filename": NEEDED, "fatal": True},
    "utils.find_files": {"filename": NEEDED, "fatal": True},
    "utils.set_rng_seed": {"seed": None},
    "utils.is_real_iterable": {"value": NEEDED},
    "utils.combine_parameters": {"groups": None, "parameters": NEEDED},
    "utils.display_xml": {"path": NEEDED, "item": None},
    "utils.detect_separator": {"file_path": NEEDED},
    "utils.is_finalized": {"obj": NEEDED},
    "utils.is_xml_loaded": {"obj": NEEDED},
    "utils.check_integrate_survey_and_legs": {"survey": NEEDED},
    "utils.apply_scene_shift": {"survey": NEEDED, "execution_settings": NEEDED},
}  # fmt: skip


def module(name):
    return importlib.import_module(f"vlscan.helios.{name}" if name else "vlscan.helios")


def found(path):
    first, *rest = path.split(".")
    thing = module(first)
    for part in rest:
        thing = getattr(thing, part)
    return thing


def same(a, b):
    if a is NEEDED or b is NEEDED:
        return a is b
    return validation.same(a, b) if not isinstance(b, list) else np.array_equal(np.asarray(a), b)


@pytest.mark.parametrize("name", NAMES)
def test_names_are_in_their_modules(name):
    missing = [each for each in NAMES[name].split() if not hasattr(module(name), each)]
    assert not missing


@pytest.mark.parametrize("kind", VALUES, ids=lambda kind: kind.__name__)
def test_values_of_enumerations(kind):
    assert {each.name: each.value for each in kind} == VALUES[kind]
    assert issubclass(kind, str if isinstance(next(iter(kind)).value, str) else enum.IntEnum)


@pytest.mark.parametrize("kind", FIELDS, ids=lambda kind: kind.__name__)
def test_fields_and_defaults(kind):
    fields = kind.model_fields
    for name, expected in FIELDS[kind].items():
        default = NEEDED if fields[name].is_required() else fields[name].get_default(call_default_factory=True)
        assert same(default, expected), (name, default)
    own = list(fields)[len(FIELDS[kind]) :]
    assert not set(own) - {"max_duration", "force_on_ground"}
    assert not any(fields[name].is_required() for name in own)


@pytest.mark.parametrize("path", PARAMETERS)
def test_parameters_and_defaults(path):
    parameters = dict(inspect.signature(found(path)).parameters)
    parameters.pop("self", None)
    assert list(parameters) == list(PARAMETERS[path])
    for name, expected in PARAMETERS[path].items():
        assert same(parameters[name].default, expected), name


@pytest.mark.parametrize("name", SCANNERS)
def test_scanners(name):
    made = getattr(scanner, name)()
    assert isinstance(made, helios.Scanner) and made == helios.scanner_from_name(name) and made.name and made == made.clone()
    # Each is known to the engine.
    survey = helios.Survey(scanner=made, platform=platforms.tripod(), scene=SCENE)
    assert scanner.list_scanners() == SCANNERS and made.reference in survey.to_xml()


def test_names_of_scanners_with_the_same_id():
    assert scanner.livox_mid70().reference == "data/scanners_als.xml#livox_mid-70"
    assert scanner.livox_mid70_tls().reference == "data/scanners_tls.xml#livox_mid-70"
    assert helios.scanner_from_name("data/scanners_tls.xml#livox_mid-70") == scanner.livox_mid70_tls()
    assert helios.Scanner.from_xml("data/scanners_als.xml", "livox_mid-70") == scanner.livox_mid70()


@pytest.mark.parametrize("name", PLATFORMS)
def test_platforms(name):
    made = getattr(platforms, name)()
    assert isinstance(made, helios.Platform) and made == helios.platform_from_name(name) and made.name == name
    assert platforms.list_platforms() == PLATFORMS and made.is_static == (name == "tripod")


SQUARE = [[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]]
SCENE = helios.StaticScene(scene_parts=[helios.ScenePart.from_mesh(SQUARE, [[0, 1, 2, 3]], helios.Material(name="soil", is_ground=True))])


class Mesh:
    vertices, triangles = np.array(SQUARE, float), np.array([[0, 1, 2]])


def part():
    return helios.ScenePart.from_mesh(SQUARE, [[0, 1, 2, 3]])


def room():
    return helios.Survey.from_xml(FIXTURES / "room/survey.xml")


def small():
    survey = helios.Survey(scanner=scanner.pano_scanner(), platform=platforms.tripod(), scene=SCENE)
    survey.add_leg(None, helios.StaticPlatformSettings(z=2), helios.ScannerSettings(max_duration=0.01), None, scan_frequency="100 Hz")
    return survey


def poses(folder):
    rows = np.column_stack([np.arange(3), np.zeros((3, 3)), np.arange(3), np.zeros(3), np.full(3, 9.0)])
    np.savetxt(folder / "flight.csv", rows, delimiter=",")
    return folder / "flight.csv"


def cloud(folder):
    np.savetxt(folder / "cloud.xyz", np.random.default_rng(1).uniform(0, 3, (50, 3)))
    return folder / "cloud.xyz"


def raster(folder):
    rasterio = pytest.importorskip("rasterio")
    profile = {"driver": "GTiff", "width": 4, "height": 4, "count": 1, "dtype": "float32", "crs": "EPSG:25832"}
    with rasterio.open(folder / "hill.tif", "w", **profile, transform=rasterio.transform.from_origin(0, 4, 1, 1)) as file:
        file.write(np.ones((1, 4, 4), "float32"))
    return folder / "hill.tif"


LARGE = np.array(LARGEST)
#: A call of each function and method with all its arguments, and what holds for its result.
CALLS = {
    "callbacks.build_progressbar_callbacks": lambda f, at: f("none", 3) == ((), None),
    "platforms.load_traj_csv": lambda f, at: f(poses(at), 0, 1, 2, 3, 4, 5, 6, ",", False).dtype == platforms.traj_csv_dtype,
    "platforms.PlatformSettings.do_force_on_ground": lambda f, at: f(helios.PlatformSettings(z=5), SCENE) is None,
    "platforms.Platform.from_xml": lambda f, at: f("data/platforms.xml", "tripod").is_static,
    "platforms.Platform.load_interpolate_platform": lambda f, at: (
        len(f(helios.load_traj_csv(poses(at)), "data/platforms.xml", "sr22", "CANONICAL", True, True).trajectory) == 3
    ),
    "platforms.list_platforms": lambda f, at: "tripod" in f(),
    "platforms.platform_from_name": lambda f, at: f("sr22").name == "sr22",
    "scanner.Scanner.from_xml": lambda f, at: f("data/scanners_als.xml", "leica_als50").name == "leica_als50",
    "scanner.list_scanners": lambda f, at: len(f()) == 31,
    "scanner.scanner_from_name": lambda f, at: f("vlp16").name == "Velodyne VLP-16",
    "scene.Material.from_file": lambda f, at: f(FIXTURES / "forest/forest.mtl", "beech_leaves").name == "beech_leaves",
    "scene.MaterialDict.items": lambda f, at: [name for name, _ in f(part().materials)] == ["default"],
    "scene.MaterialDict.keys": lambda f, at: list(f(part().materials)) == ["default"],
    "scene.MaterialDict.values": lambda f, at: [each.name for each in f(part().materials)] == ["default"],
    "scene.ScenePart.rotate": lambda f, at: (
        f(part(), None, [0, 0, 1], "90 deg", None, None, [1, 0, 0]).bbox.bounds[0][0] == pytest.approx(-19)
    ),
    "scene.ScenePart.scale": lambda f, at: f(part(), 2.0).bbox.bounds[1][0] == 40,
    "scene.ScenePart.translate": lambda f, at: f(part(), np.array([1.0, 2.0, 3.0])).bbox.centroid.tolist() == [1, 2, 3],
    "scene.ScenePart.from_xml": lambda f, at: f(FIXTURES / "room/scene.xml", 1).materials,
    "scene.ScenePart.from_obj": lambda f, at: f(FIXTURES / "forest/beech.obj", "y").materials,
    "scene.ScenePart.from_tiff": lambda f, at: f(raster(at)).bbox.bounds[1][2] == 1,
    "scene.ScenePart.from_objs": lambda f, at: len(f([FIXTURES / "forest/beech.obj", str(FIXTURES / "forest/spr*.obj")], "z")) == 2,
    "scene.ScenePart.from_tiffs": lambda f, at: len(f(str(raster(at)))) == 1,
    "scene.ScenePart.from_xyz": lambda f, at: f(cloud(at), 0.5, " ", 0.0, LARGE, True, False, snap_neighbor_normal=False).bbox,
    "scene.ScenePart.from_xyzs": lambda f, at: f([cloud(at)], 0.5, " ", 0.0, LARGE, False, False, snap_neighbor_normal=True)[0].bbox,
    "scene.ScenePart.from_vox": lambda f, at: f(FIXTURES / "voxels/crown.vox", "scaled", 0.3, True, None).bbox,
    "scene.ScenePart.from_numpy_array": lambda f, at: (
        f(
            np.ones((9, 9)) * np.arange(9)[:, None],
            0.5,
            normals_file_columns=[3, 4, 5],
            rgb_file_columns=[6, 7, 8],
            max_color_value=9.0,
            default_normal=[0, 0, 1],
            sparse=False,
            estimate_normals=False,
            snap_neighbor_normal=True,
        ).bbox
    ),
    "scene.ScenePart.from_open3d": lambda f, at: f(Mesh(), up_axis="z").bbox.bounds[0][0] == -20,
    "scene.ScenePart.update_material": lambda f, at: f(part(), helios.Material(name="a"), None, 0, 1).engine(),
    "scene.StaticScene.add_scene_part": lambda f, at: f(helios.StaticScene(), part()) is None,
    "scene.StaticScene.from_xml": lambda f, at: len(f(FIXTURES / "room/scene.xml").scene_parts) == 5,
    "scene.StaticScene.from_binary": lambda f, at: SCENE.to_binary(at / "a.bin") is None and f(at / "a.bin").bbox,
    "scene.StaticScene.to_binary": lambda f, at: f(SCENE, at / "b.bin", 9) is None and (at / "b.bin").exists(),
    "settings.LogVerbosity.apply": lambda f, at: f(settings.LogVerbosity.DEFAULT) is None,
    "settings.set_execution_settings": lambda f, at: f(helios.ExecutionSettings(), num_threads=2) is None,
    "settings.set_output_settings": lambda f, at: f(helios.OutputSettings(), format="npy") is None,
    "settings.compose_execution_settings": lambda f, at: f(helios.ExecutionSettings(chunk_size=3), {"num_threads": 1}).chunk_size == 3,
    "settings.compose_output_settings": lambda f, at: f(helios.OutputSettings(las_scale="1 mm"), {"format": "las"}).las_scale == 0.001,
    "settings.apply_log_writing": lambda f, at: f(helios.ExecutionSettings()) is None,
    "survey.Survey.run": lambda f, at: len(f(small(), helios.ExecutionSettings(), helios.OutputSettings(), [], num_threads=1)[0]) > 10,
    "survey.Survey.add_leg": lambda f, at: f(small(), None, None, None, None, x=1, is_active=False) is None,
    "survey.Survey.from_xml": lambda f, at: f(FIXTURES / "room/survey.xml").name == "room",
    "utils.add_asset_directory": lambda f, at: f(at).__exit__(None, None, None) is None,
    "utils.get_asset_directories": lambda f, at: (f()[-1] / "scanners_tls.xml").is_file() and (f()[-1] / "platforms.xml").is_file(),
    "utils.find_file": lambda f, at: f(at / "none", False) is None and f("data/platforms.xml", True).is_file(),
    "utils.find_files": lambda f, at: f(str(at / "*.none"), False) == [] and f(at, True) == [at],
    "utils.set_rng_seed": lambda f, at: f(datetime(2024, 1, 1)) is None and f() is None and f(1) is None,
    "utils.is_real_iterable": lambda f, at: (
        (f([1]), f(np.ones(2)), f(range(3)), f("text"), f(3), f({}), f(part())) == (1, 1, 1, 0, 0, 0, 0)
    ),
    "utils.combine_parameters": lambda f, at: [values["z"] for values in f([["x", "y"]], x=[1, 2], y=[3, 4], z=[5, 6])] == [[5, 6]] * 2,
    "utils.display_xml": lambda f, at: "panorama" in f(FIXTURES / "room/survey.xml", "panorama"),
    "utils.detect_separator": lambda f, at: f(poses(at)) == ",",
    "utils.is_finalized": lambda f, at: not f(part()),
    "utils.is_xml_loaded": lambda f, at: f(room()) and not f(SCENE),
    "utils.check_integrate_survey_and_legs": lambda f, at: f(room()) is None,
    "utils.apply_scene_shift": lambda f, at: f(small(), helios.ExecutionSettings()) is None and SCENE.is_loaded,
}


def test_every_function_is_called():
    assert CALLS.keys() == PARAMETERS.keys()


@pytest.mark.parametrize("path", CALLS)
def test_calls(path, tmp_path):
    assert CALLS[path](found(path), tmp_path)


@pytest.fixture(autouse=True)
def _defaults():
    yield
    helios.set_execution_settings()
    helios.set_output_settings()
    helios.set_rng_seed(0)


def test_class_methods_belong_to_the_class():
    with pytest.raises(AttributeError, match="belongs to the class"):
        part().from_obj("a.obj")


def test_models_print():
    assert "speed_m_s: 70" in str(helios.DynamicPlatformSettings()) and "VLP-16" in str(scanner.vlp16()) and "parts" in repr(SCENE)
    assert isinstance(helios.DynamicPlatformSettings(), platforms.Printable)
