"""Tables of other libraries as points: missing and masked values, indices, types, values beyond those of files."""

import datetime
import decimal
import io
import warnings

import numpy as np
import pytest

import vlscan
from vlscan import Points, VlscanWarning

COLUMNS = {"X": [0.0, 1.0, 2.0], "Y": [0.0, 1.0, 2.0], "Z": [0.0, 0.0, 0.0]}


def test_missing_floating_point_numbers_are_nan():
    pyarrow = pytest.importorskip("pyarrow")
    points = Points.of(pyarrow.table({**COLUMNS, "Range": [1.0, None, 3.0]}))
    assert np.isnan(points["Range"][1]) and points["Range"][[0, 2]].tolist() == [1, 3]
    narrow = Points.of(pyarrow.table({**COLUMNS, "Range": pyarrow.array([1.0, None, 3.0], pyarrow.float32())}))
    assert narrow["Range"].dtype == np.float32 and np.isnan(narrow["Range"][1])


def test_missing_whole_numbers_are_an_error():
    polars = pytest.importorskip("polars")
    with pytest.raises(ValueError, match="column Classification has 1 missing values"):
        Points.of(polars.DataFrame({**COLUMNS, "Classification": [2, None, 3]}))


def test_masked_values_are_an_error():
    masked = np.ma.masked_array([0.0, 1.0, 2.0], [False, True, False])
    with pytest.raises(ValueError, match="column X has 1 masked values"):
        Points.of({**COLUMNS, "X": masked})
    assert Points.of({**COLUMNS, "X": masked.filled(7)})["X"].tolist() == [0, 7, 2]


def test_masked_geometry_is_an_error():
    corners = np.ma.masked_array(np.eye(3), np.eye(3) > 0)
    floor = vlscan.Part.mesh([[-9, -9, 0], [9, -9, 0], [0, 9, 0]], [[0, 1, 2]])
    calls = [
        lambda: vlscan.Part.mesh(corners, [[0, 1, 2]]),
        lambda: vlscan.Part.mesh(np.eye(3), np.ma.masked_array([[0, 1, 2]], [[0, 1, 0]])),
        lambda: vlscan.Part.points(corners, voxel_size=1),
        lambda: vlscan.Scene(floor).cast((0, 0, 5), corners),
        lambda: vlscan.trace(floor, corners, (0, 0, -1)),
        lambda: vlscan.trace(floor, (0, 0, 5), np.eye(3), time=corners[0]),
        lambda: vlscan.compare(corners, np.eye(3)),
    ]
    for call in calls:
        with pytest.raises(ValueError, match="masked values"):
            call()
    # A mask that hides nothing is none.
    assert vlscan.Part.mesh(np.ma.masked_array(np.eye(3)), [[0, 1, 2]]).face_count == 1


def test_an_index_of_pandas_without_a_name_is_no_column():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({**COLUMNS, "is_roof": [True, False, True], "half": np.arange(3, dtype="f2")}, index=[7, 2, 9])
    points = Points.of(frame)
    assert points.columns == ["X", "Y", "Z", "is_roof", "half"]
    assert points["is_roof"].tolist() == [1, 0, 1] and points["half"].dtype == np.float32
    assert Points.of(frame.rename_axis("number")).columns[0] == "number"


def _pandas(columns):
    return pytest.importorskip("pandas").DataFrame(columns)


def _polars(columns):
    return pytest.importorskip("polars").DataFrame(columns)


def _pyarrow(columns):
    return pytest.importorskip("pyarrow").table(columns)


@pytest.mark.parametrize("table", [_pandas, _polars, _pyarrow])
def test_truth_values_and_decimal_numbers_are_numbers(table):
    prices = [decimal.Decimal(text) for text in ("1.25", "-0.10", "3.00")]
    points = Points.of(table({**COLUMNS, "is_roof": [True, False, True], "price": prices}))
    assert points["is_roof"].dtype == np.uint8 and points["is_roof"].tolist() == [1, 0, 1]
    assert points["price"].dtype == np.float64 and points["price"].tolist() == [1.25, -0.1, 3]
    assert vlscan.cloud_info(table({**COLUMNS, "Classification": [True, False, True]}))["points"] == 3


def test_half_precision_numbers_have_single_precision():
    pyarrow = pytest.importorskip("pyarrow")
    points = Points.of(pyarrow.table({**COLUMNS, "half": pyarrow.array(np.array([0.5, 1, 65504], "f2"))}))
    assert points["half"].dtype == np.float32 and points["half"].tolist() == [0.5, 1, 65504]


def test_nullable_columns_and_categories_of_numbers_are_numbers():
    pandas = pytest.importorskip("pandas")
    columns = {"count": pandas.array([1, 2, 3], "Int64"), "is_roof": pandas.array([True, False, True], "boolean")}
    frame = pandas.DataFrame({**COLUMNS, **columns, "kind": pandas.Categorical([5, 2, 5])})
    points = Points.of(frame)
    assert [points[name].tolist() for name in ("count", "is_roof", "kind")] == [[1, 2, 3], [1, 0, 1], [5, 2, 5]]
    frame["is_roof"] = pandas.array([True, None, True], "boolean")
    with pytest.raises(ValueError, match="column is_roof has 1 missing values"):
        Points.of(frame)


@pytest.mark.parametrize("values", [["a", "b", "a"], [datetime.datetime(2024, 1, day) for day in (1, 2, 3)]])
@pytest.mark.parametrize("table", [_pandas, _polars, _pyarrow])
def test_columns_without_numbers_are_named_when_they_are_read(table, values):
    pytest.importorskip("pyarrow")
    points = Points.of(table({**COLUMNS, "k": values}))
    with pytest.raises(TypeError, match=r"column k: NumPy has no array of .*; to_arrow\(\)\['k'\]"):
        points["k"]
    assert points.to_arrow()["k"].to_pylist() == values


@pytest.mark.parametrize(
    ("values", "error"),
    [
        (np.array(["a", "b", "c"]), "column k is of <U1"),
        (np.array([1, None, 2], object), "column k is of object, expected numbers; numpy.asarray"),
        (np.zeros((3, 2)), r"column k has the shape \(3, 2\)"),
        (np.array([1, 1j, 2]), "column k is of complex128"),
        (np.arange(3).astype("M8[s]"), r"column k is of datetime64\[s\], .* are seconds"),
    ],
)
def test_errors_name_the_column(values, error):
    with pytest.raises((TypeError, ValueError), match=error):
        Points.of({**COLUMNS, "k": values})


@pytest.mark.parametrize("kind", [">f8", "<f4", "f2", "g", ">i2", "?"])
def test_arrays_of_any_order_and_stride_are_taken(kind):
    values = np.repeat(np.array([0, 1, 1]), 2).astype(kind)[::2]
    values.setflags(write=False)
    assert Points.of({**COLUMNS, "X": values})["X"].tolist() == [0, 1, 1]


@pytest.mark.parametrize(
    ("column", "values", "first"),
    [
        ("Classification", [300, 2, 5], "holds 300 in row 0"),
        ("Classification", [2, -1, -2], "holds -1 in row 1 and 1 more"),
        ("Intensity", [0.5, 0.25, 1], "holds 0.5 in row 0 and 1 more"),
        ("PointSourceId", [1, 70_000, 2], "holds 70000 in row 1"),
        ("Intensity", [1, np.nan, 3], "holds nan in row 1"),
    ],
)
def test_values_beyond_those_of_files_are_warned_of(tmp_path, column, values, first):
    points = Points.of({**COLUMNS, column: values})
    with pytest.warns(VlscanWarning, match=f"{column} {first}"):
        points.write(tmp_path / "points.parquet")


def test_whole_numbers_of_any_type_are_written_in_silence(tmp_path):
    points = Points.of({**COLUMNS, "Classification": [2, 5, 255], "Intensity": [1.0, 2.0, 65_535.0]})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        points.write(tmp_path / "points.parquet")


def test_files_of_other_types_are_refused():
    points = Points.of(COLUMNS)
    for wrong in (None, 3):
        with pytest.raises(TypeError, match="expected a file"):
            Points.read(wrong)
        with pytest.raises(TypeError, match="expected a file"):
            points.write(wrong)
    file = io.BytesIO()
    points.write(file, format="ply")
    file.seek(0)
    assert len(Points.read(file)) == 3


def test_an_attribute_that_is_a_column_has_a_hint():
    points = Points.of(COLUMNS)
    with pytest.raises(AttributeError, match=r"a column is table\['X'\]"):
        points.X
    with pytest.raises(AttributeError) as error:
        points.colour
    assert "table[" not in str(error.value)
    with pytest.raises(IndexError, match="to_numpy"):
        points[["X", "Y"]]
    assert points[np.nonzero(points["X"] > 0)]["X"].tolist() == [1, 2]


def test_a_single_column_is_written_by_its_name(tmp_path):
    Points.of({**COLUMNS, "GpsTime": [1.0, 2.0, 3.0]}).write(tmp_path / "times.csv", columns="GpsTime")
    assert (tmp_path / "times.csv").read_text().split()[0] == "GpsTime"
