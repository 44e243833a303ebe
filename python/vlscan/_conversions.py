"""Clouds of other libraries as columns: laspy, xarray, GeoPandas, Open3D."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import warn

# Dimensions of laspy, their columns and the types of these.
_LAS = {
    "intensity": ("Intensity", "u2"),
    "return_number": ("ReturnNumber", "u1"),
    "number_of_returns": ("NumberOfReturns", "u1"),
    "classification": ("Classification", "u1"),
    "scan_angle_rank": ("ScanAngle", "f4"),
    "scan_angle": ("ScanAngle", "f4"),
    "point_source_id": ("PointSourceId", "u2"),
    "gps_time": ("GpsTime", "f8"),
    "red": ("Red", "u2"),
    "green": ("Green", "u2"),
    "blue": ("Blue", "u2"),
}

# The extra dimensions of files of vlscan and HELIOS++; this one is in all of these files.
_EXTRA_MARK = "heliosAmplitude"
_EXTRA = {
    _EXTRA_MARK: ("Amplitude", "f8"),
    "echo_width": ("EchoWidth", "f4"),
    "fullwaveIndex": ("PulseNumber", "u8"),
    "hitObjectId": ("ObjectId", "i4"),
    "device": ("Device", "u2"),
    "range": ("Range", "f8"),
    "incidence_angle": ("IncidenceAngle", "f4"),
    "part": ("Part", "u4"),
    "primitive": ("Primitive", "u4"),
    "true_range": ("TrueRange", "f8"),
}

# Scan angles of LAS 1.4 are multiples of this many degrees.
_SCAN_ANGLE_STEP = 0.006

_COLOURS = ("Red", "Green", "Blue")
_NORMALS = ("NormalX", "NormalY", "NormalZ")

# Columns of colours have 8 bits in the upper half of 16.
_COLOUR_STEP = 256


def unmasked(what: str, values: Any) -> NDArray[Any]:
    """Return values as an array; masked ones are a ``ValueError``, since an array without a mask would have any number there."""
    if isinstance(values, np.ma.MaskedArray):
        count = int(np.ma.getmaskarray(values).sum())
        if count:
            raise ValueError(f"{what} has {count} masked values; fill them (values.filled(0)), or leave these rows out")
    return np.asarray(values)


def columns_of_library(table: Any) -> Any:
    """Return a cloud of laspy, xarray, GeoPandas or Open3D as columns, and a table of pandas without its index; all else as it is."""
    if _is_laspy(table):
        return _of_laspy(table)
    if _is_xarray(table):
        return {
            str(name): values.to_numpy() for part in (table.coords, table.data_vars) for name, values in part.items() if values.ndim == 1
        }
    if hasattr(table, "geometry") and hasattr(table, "to_crs"):
        places = table.geometry.get_coordinates(include_z=True)
        columns = {axis.upper(): places[axis].to_numpy() for axis in "xyz"}
        others = {str(name): table[name].to_numpy() for name in getattr(table, "columns", ()) if name != table.geometry.name}
        return columns | {name: values for name, values in others.items() if values.dtype.kind in "biuf"}
    if hasattr(table, "reset_index") and hasattr(table, "dtypes"):
        # Arrow has an index without a name as a column.
        return table.reset_index(drop=all(name is None for name in table.index.names))
    if hasattr(table, "point") and hasattr(table, "to_legacy"):
        # A cloud of tensors of Open3D.
        table = table.to_legacy()
    if hasattr(table, "points") and hasattr(table, "has_normals"):
        return _of_open3d(table)
    return table


def crs_of_library(table: Any) -> str | None:
    """Return the coordinate reference system of a cloud of laspy, xarray or GeoPandas, if it is known."""
    known: Any = getattr(table, "crs", None)
    if _is_laspy(table):
        try:
            known = table.header.parse_crs()
        except ImportError:
            warn("the coordinate reference system of the points of laspy is left out, because pyproj is missing: pip install pyproj")
    elif _is_xarray(table):
        known = table.attrs.get("crs")
    if hasattr(known, "to_wkt"):
        return str(known.to_wkt("WKT1_GDAL"))
    return known or None if isinstance(known, str) else None


def crs_text(crs: object) -> str:
    """Return a coordinate reference system as text: that of a text, the number of a code, or an object of pyproj."""
    if hasattr(crs, "to_wkt"):
        return str(crs.to_wkt("WKT1_GDAL"))
    if isinstance(crs, (int, np.integer)) and not isinstance(crs, bool):
        return f"EPSG:{crs}"
    if not isinstance(crs, str):
        raise TypeError(f"crs is {crs!r}, expected a code such as 'EPSG:25832', or WKT")
    return crs


def normals_of(points: Any) -> NDArray[np.float64] | None:
    """Return the columns of normals as an array, if the points have them."""
    return points.to_numpy(_NORMALS, dtype=np.float64) if all(name in points for name in _NORMALS) else None


def colours_of(points: Any) -> NDArray[np.float64] | None:
    """Return the columns of colours as an array of values from 0 to 1, if the points have them."""
    if not all(name in points for name in _COLOURS):
        return None
    bytes_of_colours: NDArray[np.float64] = points.to_numpy(_COLOURS, dtype=np.float64) // _COLOUR_STEP
    return bytes_of_colours / 255


def _is_laspy(table: Any) -> bool:
    return hasattr(table, "point_format") and hasattr(table, "header")


def _is_xarray(table: Any) -> bool:
    return hasattr(table, "data_vars") and hasattr(table, "coords")


def _of_laspy(cloud: Any) -> dict[str, NDArray[Any]]:
    known = set(cloud.point_format.dimension_names)
    names = _LAS | (_EXTRA if _EXTRA_MARK in known else {})
    columns = {axis.upper(): np.asarray(getattr(cloud, axis)) for axis in "xyz"}
    for key, (name, kind) in names.items():
        if key in known:
            values = np.asarray(cloud[key])
            if key == "scan_angle":
                values = values * _SCAN_ANGLE_STEP
            elif key == "fullwaveIndex":
                # The lower 32 bits of the number.
                values = values.astype("u4")
            columns[name] = values.astype(kind)
    others = [key for key in cloud.point_format.extra_dimension_names if key not in names]
    return columns | {key: values for key in others if (values := np.asarray(cloud[key])).ndim == 1}


def _of_open3d(cloud: Any) -> dict[str, NDArray[Any]]:
    columns = dict(zip("XYZ", np.asarray(cloud.points, float).reshape(-1, 3).T, strict=True))
    if cloud.has_normals():
        columns |= dict(zip(_NORMALS, np.asarray(cloud.normals, float).reshape(-1, 3).T, strict=True))
    if cloud.has_colors():
        colours = np.rint(np.asarray(cloud.colors, float).reshape(-1, 3).T * 255).clip(0, 255) * _COLOUR_STEP
        columns |= dict(zip(_COLOURS, colours.astype("u2"), strict=True))
    return columns
