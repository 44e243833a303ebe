"""Points: files without another run, rows, arrays, other libraries."""

import pickle
import sys
import types
import warnings

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES
from vlscan import Leg, Part, Points, Survey

#: Formats of a run with the usual columns, and of one with all.
USUAL = ["las", "laz", "copc.laz", "ply", "xyz", "csv", "bin", "arrow", "parquet", "geo.parquet"]
#: PCD of a scanner that stands has its place, by the origins of beams.
ALL = ["e57", "raycloud.ply", "pcd", "csv", "laz"]


@pytest.fixture(scope="module")
def points():
    return vlscan.run(FIXTURES / "room/survey.xml", seed=1).points


def far_survey(**options):
    """A survey at coordinates of a national grid, where doubles of the world lack digits of the scene."""
    size = 60.0
    corners = [[-size, -size, 0.1], [size, -size, 3.3], [size, size, -2.7], [-size, size, 0]]
    place = (476_123.456, 5_429_876.543, 212.1)
    ground = Part.mesh(corners, [[0, 1, 2], [0, 2, 3]]).translate(*place)
    leg = Leg((place[0], place[1], place[2] + 20.0), scan_freq_hz=40, head_rate_deg_per_s=36, head_stop_deg=90)
    return Survey(ground, "riegl_vz400", [leg], **options)


def same(survey, folder, endings, run_options, write_options=None):
    """Compares the files of a run with those of its points."""
    survey.run(to=[folder / f"run.{ending}" for ending in endings], **run_options)
    memory = {name: value for name, value in run_options.items() if name not in ("las10", "las_scale", "labels", "force")}
    points = survey.run(**memory).points
    for ending in endings:
        points.write(folder / f"own.{ending}", **(write_options or {}))
        assert (folder / f"own.{ending}").read_bytes() == (folder / f"run.{ending}").read_bytes(), ending
    return points


def test_files_have_the_bytes_of_a_run(tmp_path):
    same(Survey.open(FIXTURES / "room/survey.xml"), tmp_path, USUAL, {"seed": 1})


def test_files_of_all_columns_have_the_bytes_of_a_run(tmp_path):
    same(Survey.open(FIXTURES / "room/survey.xml"), tmp_path, ALL, {"seed": 1, "columns": vlscan.columns()})


@pytest.mark.parametrize("physics", ["helios", "refined"])
def test_files_far_from_the_origin_have_the_bytes_of_a_run(physics, tmp_path):
    run_options = {"seed": 3, "physics": physics, "echo_width": True, "crs": "EPSG:25832", "threads": 2}
    points = same(far_survey(), tmp_path, ["laz", "arrow", "copc.laz", "xyz"], run_options)
    assert len(points) > 30_000 and points.bounds[0, 1] > 5e6


def test_files_of_moving_platforms_and_misses_have_the_bytes_of_a_run(tmp_path):
    terrain = Survey.open(FIXTURES / "terrain/survey.xml")
    same(terrain, tmp_path, ["las", "ply", "csv"], {"seed": 1, "misses": True, "height_above_ground": True})
    options = {"las10": True, "las_scale": 0.01, "force": True}
    same(terrain, tmp_path, ["laz"], {"seed": 1, **options}, options)


@pytest.mark.parametrize("name", ["room/survey.xml", "street/spinning.xml"])
def test_messages_of_ros_have_the_bytes_of_a_run(name, tmp_path):
    options = {"seed": 1, "columns": vlscan.columns()}
    points = same(Survey.open(FIXTURES / name), tmp_path, ["mcap", "csv"], options)
    own = pickle.loads(pickle.dumps(points))
    own.write(tmp_path / "half.mcap", frame_s=0.05)
    # Points with the columns of colours, of radial velocities and of the way of light are written with all of them.
    chosen = ["Red", "Green", "Blue", "Doppler", "Path", "PathOrder", "Primitive", "SurfaceX", "SurfaceY", "SurfaceZ"]
    vlscan.run(FIXTURES / name, to=tmp_path / "c.mcap", frame_s=0.05, seed=1, columns=chosen)
    assert (tmp_path / "half.mcap").read_bytes() == (tmp_path / "c.mcap").read_bytes() != (tmp_path / "own.mcap").read_bytes()
    assert b"/odom" in (tmp_path / "own.mcap").read_bytes()
    assert "AttitudeW" not in points.columns


def test_columns_that_formats_need_are_named(points, tmp_path):
    for ending, column in [("e57", "BeamOriginX"), ("mcap", "ScannerX"), ("raycloud.ply", "BeamOriginZ")]:
        with pytest.raises(vlscan.InputError, match=f"(?s){column}.*vlscan.columns"):
            points.write(tmp_path / f"points.{ending}")
        assert not (tmp_path / f"points.{ending}").exists()
    with pytest.raises(vlscan.InputError, match="no format"):
        points.write(tmp_path / "points.doc")
    with pytest.raises(vlscan.InputError, match="TrueX"):
        points.write(tmp_path / "points.csv", columns=["X", "TrueX"])
    points.write(tmp_path / "points.csv", columns=["X", "Y", "Z", "GpsTime"])
    assert (tmp_path / "points.csv").read_text().splitlines()[0] == "X,Y,Z,GpsTime"
    with pytest.raises(vlscan.InputError, match="exists"):
        points.write(tmp_path / "points.csv")
    points.write(tmp_path / "points.csv", columns=["X"], force=True)
    with pytest.raises(vlscan.FileError):
        points.write(tmp_path / "nowhere/points.laz")
    bare = vlscan.run(FIXTURES / "room/survey.xml", seed=1, columns=["X", "Y", "Z"]).points
    with pytest.warns(vlscan.VlscanWarning, match="ReturnNumber"):
        bare.write(tmp_path / "bare.laz")
    assert len(Points.read(tmp_path / "bare.laz")) == len(bare)


def test_rows_are_points(points, tmp_path):
    near = points[points["Range"] < 3]
    assert isinstance(near, Points) and 0 < len(near) < len(points) and near["Range"].max() < 3
    assert near.metadata == points.metadata and near.units == points.units
    near.write(tmp_path / "near.laz")
    assert len(Points.read(tmp_path / "near.laz")) == len(near)
    assert points[10:20]["X"].tolist() == points["X"][10:20].tolist()
    assert points[::-1]["X"][0] == points["X"][-1] and points[[-1, 0]]["Y"].tolist() == points["Y"][[-1, 0]].tolist()
    assert len(points[:0]) == 0 and len(points[[]]) == 0 and len(points[20:10]) == 0
    for wrong in ([True], [len(points)], [-len(points) - 1], [0.5], np.zeros((2, 2), int)):
        with pytest.raises(IndexError):
            points[wrong]
    with pytest.raises(KeyError, match="there are X"):
        points["nothing"]
    # Consecutive parts are the whole, to the byte.
    points.write(tmp_path / "whole.xyz")
    for name, part in [("a.xyz", points[:1000]), ("b.xyz", points[1000:])]:
        part.write(tmp_path / name)
    assert (tmp_path / "a.xyz").read_bytes() + (tmp_path / "b.xyz").read_bytes() == (tmp_path / "whole.xyz").read_bytes()


def test_batches_are_written(tmp_path):
    parts = list(vlscan.run_batches(FIXTURES / "room/survey.xml", 5000, seed=1))
    for number, part in enumerate(parts):
        part.write(tmp_path / f"{number}.xyz")
    vlscan.run(FIXTURES / "room/survey.xml", to=tmp_path / "whole.xyz", seed=1)
    joined = b"".join((tmp_path / f"{number}.xyz").read_bytes() for number in range(len(parts)))
    assert len(parts) > 2 and joined == (tmp_path / "whole.xyz").read_bytes()


def test_tables_of_other_libraries_become_points(points, tmp_path):
    pyarrow, pandas, polars = (pytest.importorskip(name) for name in ("pyarrow", "pandas", "polars"))
    changed = points.to_pandas()
    changed["Classification"] = np.uint8(6)
    sources = [changed, pyarrow.table(points), polars.DataFrame(points), dict(points), points.to_numpy(), points.xyz]
    for number, source in enumerate(sources):
        own = Points.of(source, crs=points.crs)
        assert len(own) == len(points) and (own["X"] == points["X"]).all()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            own.write(tmp_path / f"{number}.las")
        read = Points.read(tmp_path / f"{number}.las")
        assert abs(read.xyz - points.xyz).max() < 1e-4
        if number < 5:
            assert (read["GpsTime"] == points["GpsTime"]).all() and (read["ReturnNumber"] == points["ReturnNumber"]).all()
            assert (read["Intensity"] == points["Intensity"]).all()
    with pytest.warns(vlscan.VlscanWarning, match="not written: Label"):
        Points.of(dict(points) | {"Label": np.ones(len(points))}).write(tmp_path / "label.laz")
    assert (Points.of(changed)["Classification"] == 6).all() and Points.of(dict(points))["ReturnNumber"].dtype == np.uint8
    assert Points.of(points.xyz, crs='LOCAL_CS["a"]').crs == 'LOCAL_CS["a"]'
    with pytest.raises(ValueError, match="no column Y, Z"):
        Points.of({"X": [1.0]})
    with pytest.raises(ValueError, match="shape"):
        Points.of(np.zeros((3, 2)))
    with pytest.raises(vlscan.InputError, match="Classification"):
        Points.of(pandas.DataFrame({"X": [1.0], "Y": [1.0], "Z": [1.0], "Classification": ["tree"]})).write(tmp_path / "a.laz")


def test_files_are_read(points, tmp_path):
    for ending in ["laz", "ply", "csv", "arrow", "parquet", "xyz"]:
        points.write(tmp_path / f"points.{ending}")
        read = Points.read(tmp_path / f"points.{ending}")
        assert len(read) == len(points) and abs(read.xyz - points.xyz).max() < 1e-3, ending
        assert (read["Classification"] == points["Classification"]).all()
    assert read.save_preview(tmp_path / "a.png") is None
    with pytest.raises(vlscan.FileError, match="No such file or directory.*nowhere.laz"):
        Points.read(tmp_path / "nowhere.laz")
    (tmp_path / "text.laz").write_text("no points")
    with pytest.raises(vlscan.InputError, match="text.laz"):
        Points.read(tmp_path / "text.laz")


def stand_of_beeches():
    """A survey of two trees: a name is no number, the other one is."""
    beech = Part.obj(FIXTURES / "forest/beech.obj").translate(500_000, 5_400_000, 0)
    legs = [Leg((500_004.0, 5_399_988.0, 2.0), scan_freq_hz=100, head_rate_deg_per_s=60, head_stop_deg=360)]
    return Survey([beech.named("oak"), beech.translate(9, 0).named("7")], "riegl_vz400", legs)


def test_files_are_read_with_all_their_columns(tmp_path):
    points = stand_of_beeches().run(seed=1, columns=vlscan.columns(), crs="EPSG:25832").points
    assert len(points) > 1000 and points.object_names == {8: "oak"} and points["Red"].any()
    labels = {"ObjectId", "Range", "TrueRange", "Part", "Primitive", "PulseNumber", "PointSourceId", "Path", "SurfaceX", "Red"}
    for ending in ["arrow", "parquet", "csv", "laz", "ply", "pcd"]:
        points.write(tmp_path / f"points.{ending}", labels=True)
        read = Points.read(tmp_path / f"points.{ending}")
        expected = {"pcd": {"Primitive", "Path", "SurfaceX", "Red"}, "laz": labels, "ply": labels}
        assert expected.get(ending, set(points.columns)) <= set(read.columns) <= set(points.columns), ending
        for name in read.columns:
            assert read[name].dtype == points[name].dtype, (ending, name)
            if ending in ("arrow", "parquet"):
                assert np.array_equal(read[name], points[name], equal_nan=True), (ending, name)
            elif (ending, name) != ("pcd", "Device"):
                # Of LAS scan angles are multiples of 0.006 degrees; other formats have intensities as amplitudes of 32 bits.
                limit = 1 if name == "Intensity" else 5e-3
                assert np.allclose(read[name].astype(float), points[name].astype(float), atol=limit, equal_nan=True), (ending, name)
        if ending not in ("csv", "pcd"):
            assert read.object_names == points.object_names, ending
        assert read.crs == (points.crs if ending in ("arrow", "parquet", "laz") else None), ending
    # What is read is written as before.
    Points.read(tmp_path / "points.parquet").write(tmp_path / "again.csv")
    assert (tmp_path / "again.csv").read_bytes() == (tmp_path / "points.csv").read_bytes()
    Points.read(tmp_path / "points.laz").write(tmp_path / "again.ply")
    assert Points.read(tmp_path / "again.ply").object_names == points.object_names


def test_text_without_names_of_columns_has_names_of_objects(tmp_path):
    result = stand_of_beeches().run(seed=1, to=tmp_path / "points.xyz")
    read = Points.read(tmp_path / "points.xyz")
    assert read.object_names == {8: "oak"} and set(read["ObjectId"].tolist()) == {7, 8}
    assert read["PulseNumber"].dtype == np.uint64 and read["ObjectId"].dtype == np.int32
    assert len(read) == result.point_count


def test_columns_of_other_programs_keep_their_meaning(tmp_path):
    (tmp_path / "points.csv").write_text(
        "x,y,z,intensity,Amplitude,Part,red,green,blue\n1,2,3,700,12.5,0.5,255,0,7\n1,2,4,900,13,2,0,1,2\n"
    )
    read = Points.read(tmp_path / "points.csv")
    assert read["Intensity"].tolist() == [700, 900] and read["Intensity"].dtype == np.uint16
    assert read["Amplitude"].tolist() == [12.5, 13] and read["Part"].tolist() == [0.5, 2]
    assert read["Red"].tolist() == [65_280, 0] and read["Blue"].tolist() == [1792, 512]
    assert "ObjectId" not in read


def test_systems_that_do_not_fit_are_warned_of_as_by_a_run(points, tmp_path):
    def told(act):
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            act()
        return [str(warning.message) for warning in found if "fit" in str(warning.message)]

    for system in ("EPSG:4326", "EPSG:25832"):
        of_run = told(lambda system=system: vlscan.run(FIXTURES / "room/survey.xml", seed=1, crs=system))
        of_file = told(lambda system=system: points.write(tmp_path / "a.laz", crs=system, force=True))
        assert len(of_run) == len(of_file) == 1
        assert of_run == of_file if system == "EPSG:4326" else "does not fit" in of_file[0], (of_run, of_file)


def test_arrays_are_their_own(points):
    features = points.to_numpy(["X", "Intensity"], dtype="float32")
    assert features.shape == (len(points), 2) and features.dtype == np.float32 and features.flags.writeable
    features[:] = 0
    assert points["X"].any() and not points["X"].flags.writeable
    single = points.to_numpy("ReturnNumber", dtype="int64")
    assert single.ndim == 1 and single.dtype == np.int64 and single.flags.writeable
    rows = points.to_numpy(["Y", "ReturnNumber"])
    assert rows.dtype.names == ("Y", "ReturnNumber") and rows.dtype["ReturnNumber"] == np.uint8
    local = points.coordinates("float32", offset=points.bounds[0])
    assert local.flags.writeable and local.flags.c_contiguous and local.min() == 0
    assert (points.coordinates() == points.xyz).all()
    with pytest.raises(ValueError, match="offset"):
        points.coordinates(offset=[1, 2])
    far = Points.of(points.xyz + [476_000.0, 5_429_000.0, 0.0])
    with pytest.warns(vlscan.VlscanWarning, match="offset=points.bounds"):
        far.coordinates("float32")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        far.coordinates("float32", offset=far.bounds[0])
    assert points.to_numpy([], dtype=float).shape == (len(points), 0)


def test_points_become_those_of_laspy(points):
    laspy = pytest.importorskip("laspy")
    las = points.to_laspy()
    assert isinstance(las, laspy.LasData) and len(las) == len(points)
    assert abs(las.xyz - points.xyz).max() < 1e-4 and (las.gps_time == points["GpsTime"]).all()
    assert (np.asarray(las.heliosAmplitude) == points["Amplitude"]).all()


def test_tables_become_those_of_xarray(points):
    xarray = pytest.importorskip("xarray")
    data = points.to_xarray()
    assert isinstance(data, xarray.Dataset) and dict(data.sizes) == {"point": len(points)}
    assert data["Z"].attrs["units"] == "m" and "scanner" in data.attrs
    high = data.where(data["Z"] > 1, drop=True)
    assert 0 < high.sizes["point"] < len(points)
    poses = vlscan.trajectory(FIXTURES / "terrain/survey.xml").to_xarray()
    assert set(poses.coords) == {"x", "y", "z"} and poses["roll"].attrs["units"] == "deg"


def test_points_become_those_of_geopandas():
    geopandas = pytest.importorskip("geopandas")
    points = vlscan.run(FIXTURES / "room/survey.xml", seed=1, crs="EPSG:25832").points
    frame = points.to_geopandas()
    assert isinstance(frame, geopandas.GeoDataFrame) and frame.crs.to_epsg() == 25832
    assert (frame.geometry.z == points["Z"]).all() and (frame["Range"] == points["Range"]).all()
    assert vlscan.run(FIXTURES / "room/survey.xml", seed=1).points[:5].to_geopandas().crs is None


class Vectors(np.ndarray):
    """Stand-in for Vector3dVector of Open3D, which takes rows of three doubles."""

    def __new__(cls, rows):
        assert rows.dtype == np.float64 and rows.ndim == 2 and rows.shape[1] == 3
        return np.array(rows).view(cls)


class Cloud:
    """Stand-in for PointCloud of Open3D, all of whose attributes are vectors."""

    def __init__(self):
        self.points = self.normals = self.colors = Vectors(np.empty((0, 3)))

    def __setattr__(self, name, value):
        assert name in ("points", "normals", "colors") and isinstance(value, Vectors)
        super().__setattr__(name, value)

    def has_normals(self):
        return 0 < len(self.points) == len(self.normals)

    def has_colors(self):
        return 0 < len(self.points) == len(self.colors)


def test_points_become_those_of_open3d_and_back(points, monkeypatch):
    """With a stand-in for Open3D, which has no wheels for every version of Python and is large."""
    geometry, utility = types.SimpleNamespace(PointCloud=Cloud), types.SimpleNamespace(Vector3dVector=Vectors)
    monkeypatch.setitem(sys.modules, "open3d", types.SimpleNamespace(geometry=geometry, utility=utility))
    cloud = points.to_open3d()
    assert (cloud.points == points.xyz).all() and not cloud.has_normals() and not cloud.has_colors()
    assert Points.of(cloud).columns == ["X", "Y", "Z"] and len(points[:0].to_open3d().points) == 0
    columns = ["X", "Y", "Z", "NormalX", "NormalY", "NormalZ", "Red", "Green", "Blue"]
    surfaces = vlscan.run(FIXTURES / "room/survey.xml", columns=columns).points
    cloud = surfaces.to_open3d()
    assert abs(np.linalg.norm(cloud.normals, axis=1) - 1).max() < 1e-6
    assert cloud.colors.min() >= 0 and 0.5 < cloud.colors.max() <= 1
    for made in (cloud, types.SimpleNamespace(point={}, to_legacy=lambda: cloud)):
        back = Points.of(made)
        assert back.columns == columns and all((back[name] == surfaces[name]).all() for name in columns)


def test_points_of_laspy_and_xarray_keep_columns_and_system(points):
    pytest.importorskip("laspy")
    pytest.importorskip("xarray")
    with pytest.warns(vlscan.VlscanWarning, match="does not fit"):
        points = vlscan.run(FIXTURES / "room/survey.xml", seed=1, crs="EPSG:25832").points
    assert Points.of(points.to_xarray()).crs == points.crs
    back = Points.of(points.to_laspy())
    assert back.crs == points.crs and set(points.columns) - set(back.columns) == {"TrueRange", "Part", "Primitive"}
    for name in back.columns:
        limit = {"X": 1e-3, "Y": 1e-3, "Z": 1e-3, "ScanAngle": 3.1e-3, "Range": 1e-5}.get(name, 0)
        assert back[name].dtype == points[name].dtype and abs(back[name] - points[name].astype(float)).max() <= limit, name


def test_a_system_is_a_code_or_well_known_text():
    columns = {"X": [4e5], "Y": [5.4e6], "Z": [0.0]}
    made = Points.of(columns, crs="EPSG:25832")
    assert made.crs.startswith("PROJCS[") and Points.of(columns, crs=made.crs).crs == made.crs
    with pytest.raises(vlscan.InputError, match="crs: expected a coordinate reference system"):
        Points.of(columns, crs="UTM 32")


def test_dimensions_of_laspy_have_their_own_names():
    laspy = pytest.importorskip("laspy")
    las = laspy.create(point_format=3, file_version="1.2")
    las.add_extra_dim(laspy.ExtraBytesParams("range", np.uint16))
    las.x, las.y, las.z = [1.0, 2.0], [3.0, 4.0], [5.0, 6.0]
    las.scan_angle_rank, las["range"], las.red = [-7, 8], [9, 10], [256, 512]
    read = Points.of(las)
    assert read["ScanAngle"].tolist() == [-7, 8] and read["range"].tolist() == [9, 10] and read["Red"].tolist() == [256, 512]
    assert "Range" not in read and read.crs is None


@pytest.mark.parametrize(
    ("method", "library"),
    [("to_open3d", "open3d"), ("to_laspy", "laspy"), ("to_xarray", "xarray"), ("to_geopandas", "geopandas"), ("to_arrow", "pyarrow")],
)
def test_libraries_that_are_missing_are_named(method, library, points, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ImportError, match=f"{method}.*pip install {library}") as error:
        getattr(points, method)()
    assert error.value.name == library
