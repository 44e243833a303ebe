"""Tables and arrays as the engine takes them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arguments import reals
from ._conversions import columns_of_library, unmasked
from ._typing import ArrowStream, PathLike, TableLike

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
        True if columns keep their types; otherwise they become doubles.

    Returns
    -------
    object
        The table.

    Raises
    ------
    TypeError
        No table, or a column without real numbers.
    ValueError
        An array of another shape, columns of different lengths, or masked values.
    """
    table = columns_of_library(table)
    if isinstance(table, ArrowStream):
        return table
    if isinstance(table, Mapping):
        columns = {str(name): _column(str(name), values) for name, values in table.items()}
    else:
        array = unmasked("the array", table)
        if array.dtype.kind in "OSU" or array.ndim == 0:
            advice = "; its collect() makes a table" if hasattr(table, "collect") else ""
            raise TypeError(f"expected a table{_shape_of(names)}, found {type(table).__name__}{advice}")
        if array.dtype.names:
            columns = {name: _column(name, array[name]) for name in array.dtype.names}
        elif names and array.ndim == 2 and array.shape[1] == len(names):
            columns = {name: array[:, index] for index, name in enumerate(names)}
        elif not names:
            raise TypeError(f"expected a table of columns with names, found an array of the shape {array.shape}")
        else:
            raise ValueError(f"an array has the shape {array.shape}, expected n by {len(names)}: {', '.join(names)}")
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"columns of a table have different lengths: {lengths}")
    if keep_types:
        return {name: _typed(name, values) for name, values in columns.items()}
    return {name: reals(f"column {name}", values).astype("<f8", copy=False).tobytes() for name, values in columns.items()}


def named_cloud(cloud: TableLike | PathLike, name: str) -> tuple[str, EngineTable | None]:
    """Return a cloud as the engine takes it.

    Parameters
    ----------
    cloud : table, str or path-like
        Points, or a file.
    name : str
        Name of a table in messages.

    Returns
    -------
    name : str
        The name, or the file.
    table : object or None
        The table; ``None`` for a file.
    """
    if isinstance(cloud, (str, bytes, os.PathLike)):
        return os.fsdecode(cloud), None
    return name, columns_of(cloud, ("X", "Y", "Z"))


def _shape_of(names: tuple[str, ...]) -> str:
    return f" with the columns {', '.join(names)}, or an array of n by {len(names)}" if names else " of columns"


def _column(name: str, values: Any) -> NDArray[Any]:
    """Return the values of a column: one dimension, nothing masked, no complex numbers."""
    column = np.atleast_1d(unmasked(f"column {name}", values))
    if column.ndim != 1:
        raise ValueError(f"column {name} has the shape {column.shape}, expected one value per row")
    if column.dtype.kind == "c":
        raise TypeError(f"column {name} is of {column.dtype}, expected real numbers")
    return column


# Types of numbers that the engine does not have, and the next wider ones.
_WIDER: dict[np.dtype[Any], np.dtype[Any]] = {
    np.dtype(bool): np.dtype("u1"),
    np.dtype(np.float16): np.dtype("f4"),
    np.dtype(np.longdouble): np.dtype("f8"),
}

# How values of other kinds become numbers.
_ADVICE = {
    "O": "; numpy.asarray(values, float) converts numbers of Python",
    "M": "; (times - times[0]) / numpy.timedelta64(1, 's') are seconds",
    "m": "; durations / numpy.timedelta64(1, 's') are seconds",
}


def _typed(name: str, values: NDArray[Any]) -> tuple[str, bytes]:
    kind = _WIDER.get(values.dtype.newbyteorder("="), values.dtype).newbyteorder("<")
    if kind.kind not in "iuf":
        raise TypeError(f"column {name} is of {values.dtype}, expected numbers{_ADVICE.get(kind.kind, '')}")
    return kind.str, values.astype(kind, copy=False).tobytes()
