"""Tables and arrays as the engine takes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._typing import ArrowStream, TableLike

#: A table as the engine takes it: of Arrow, or columns as bytes of doubles, or with their types.
EngineTable: TypeAlias = ArrowStream | dict[str, bytes] | dict[str, tuple[str, bytes]]


def columns_of(table: TableLike | ArrayLike, names: tuple[str, ...], keep_types: bool = False) -> EngineTable:
    """Return a table as the engine takes it.

    Parameters
    ----------
    table : mapping, Arrow table or array
        The table.
    names : tuple of str
        Names of the columns of an array without names.
    keep_types : bool
        Whether columns keep their types; otherwise they become doubles.

    Returns
    -------
    object
        The table.

    Raises
    ------
    ValueError
        An array of another shape.
    """
    table = _of_library(table)
    if isinstance(table, ArrowStream):
        return table
    if isinstance(table, Mapping):
        columns = {str(name): np.asarray(values) for name, values in table.items()}
    else:
        array = np.asarray(table)
        if array.dtype.names:
            columns = {name: array[name] for name in array.dtype.names}
        elif names and array.ndim == 2 and array.shape[1] == len(names):
            columns = {name: array[:, index] for index, name in enumerate(names)}
        else:
            raise ValueError(f"an array has the shape {array.shape}, expected n by {len(names)}: {', '.join(names)}")
    if keep_types:
        return {name: _typed(np.asarray(values)) for name, values in columns.items()}
    return {name: np.asarray(values, dtype="<f8").tobytes() for name, values in columns.items()}


# Dimensions of laspy and the columns that they are.
_LAS = {
    "intensity": "Intensity",
    "return_number": "ReturnNumber",
    "number_of_returns": "NumberOfReturns",
    "classification": "Classification",
    "scan_angle": "ScanAngle",
    "point_source_id": "PointSourceId",
    "gps_time": "GpsTime",
}


def _of_library(table: Any) -> Any:
    """Return an object of laspy, xarray, GeoPandas or Open3D as columns; all else as it is."""
    if hasattr(table, "point_format") and hasattr(table, "header"):
        known = set(table.point_format.dimension_names)
        columns = {axis.upper(): np.asarray(getattr(table, axis)) for axis in "xyz"}
        columns |= {name: np.asarray(table[key]) for key, name in _LAS.items() if key in known}
        if "ScanAngle" in columns:
            # In steps of 0.006 degrees.
            columns["ScanAngle"] = columns["ScanAngle"] * 0.006
        return columns
    if hasattr(table, "data_vars") and hasattr(table, "coords"):
        return {
            str(name): values.to_numpy() for part in (table.coords, table.data_vars) for name, values in part.items() if values.ndim == 1
        }
    if hasattr(table, "geometry") and hasattr(table, "to_crs"):
        places = table.geometry.get_coordinates(include_z=True)
        columns = {axis.upper(): places[axis].to_numpy() for axis in "xyz"}
        others = {str(name): table[name].to_numpy() for name in getattr(table, "columns", ()) if name != table.geometry.name}
        return columns | {name: values for name, values in others.items() if values.dtype.kind in "biuf"}
    if hasattr(table, "points") and hasattr(table, "has_normals"):
        columns = dict(zip("XYZ", np.asarray(table.points, float).reshape(-1, 3).T, strict=True))
        normals = np.asarray(table.normals, float) if table.has_normals() else np.empty((0, 3))
        return columns | (dict(zip(("NormalX", "NormalY", "NormalZ"), normals.T, strict=True)) if len(normals) else {})
    return table


def _typed(values: NDArray[Any]) -> tuple[str, bytes]:
    kind = np.dtype(np.uint8) if values.dtype == bool else values.dtype.newbyteorder("<")
    return kind.str, values.astype(kind, copy=False).tobytes()
