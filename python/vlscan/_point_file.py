"""Points of an array as the file that the engine reads."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arguments import reals
from .errors import InputError, kept_folder

# Columns beyond which an array with fewer rows is taken for a transposed one: position, normal, colour and some more.
_MAX_COLUMNS = 20


class PointFile:
    """Points as text in a folder of its own, which lives as long as the parts that read it and is pickled with them."""

    def __init__(self, content: bytes) -> None:
        self._path = os.path.join(kept_folder(self), "points.xyz")
        with open(self._path, "wb") as file:
            file.write(content)

    @staticmethod
    def of(points: ArrayLike) -> PointFile:
        """Return the file of rows of x, y, z and more columns, or of an object with ``xyz``, as Points and laspy have it."""
        given: Any = getattr(points, "xyz", points)
        names = getattr(getattr(given, "dtype", None), "names", None)
        if names:
            raise ValueError(f"points is a table of {', '.join(names)}, expected rows of x, y, z: Points.of(table) has them")
        rows: NDArray[np.float64] = reals("points", given)
        if rows.ndim != 2 or rows.shape[1] < 3 or not len(rows):
            raise ValueError(f"points has the shape {rows.shape}, expected n by 3 or more")
        if rows.shape[1] > max(len(rows), _MAX_COLUMNS):
            raise ValueError(f"points has the shape {rows.shape}, expected a point per row, not per column: points.T")
        wrong = np.flatnonzero(~np.isfinite(rows[:, :3]).all(axis=1))
        if len(wrong):
            raise ValueError(f"points[{wrong[0]}] is at {rows[wrong[0], :3].tolist()}, expected finite numbers")
        lines = (" ".join(map(repr, row)) for row in rows.tolist())
        return PointFile(("\n".join(lines) + "\n").encode())

    def __fspath__(self) -> str:
        if not os.path.exists(self._path):
            raise InputError("the temporary file of a part of points has been deleted; make the part again, of its array")
        return self._path

    def __reduce__(self) -> tuple[Callable[[bytes], PointFile], tuple[Any, ...]]:
        with open(os.fspath(self), "rb") as file:
            return PointFile, (file.read(),)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PointFile) and self.__reduce__() == other.__reduce__()

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return "array"
