"""Types of arguments."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: A file name.
PathLike: TypeAlias = str | os.PathLike[str]

#: Three numbers.
Vector: TypeAlias = Sequence[float] | NDArray[np.floating[Any]] | NDArray[np.integer[Any]]


@runtime_checkable
class ArrowArray(Protocol):
    """An object that exports an array by the Arrow C data interface."""

    def __arrow_c_array__(self, requested_schema: object | None = None) -> tuple[object, object]: ...


@runtime_checkable
class ArrowStream(Protocol):
    """An object that exports a table by the Arrow C stream interface, as tables of pyarrow, polars, pandas and DuckDB do."""

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...


#: A table: of any library that speaks Arrow, or arrays by the names of their columns.
TableLike: TypeAlias = ArrowStream | Mapping[str, Any]


if TYPE_CHECKING:

    class ColumnArray(np.ndarray[tuple[int], np.dtype[Any]]):
        """A column of a table. NumPy declares no type of ``==``, which makes a mask of rows here."""

        def __eq__(self, other: object, /) -> NDArray[np.bool_]: ...  # type: ignore[override]
        def __ne__(self, other: object, /) -> NDArray[np.bool_]: ...  # type: ignore[override]

else:
    ColumnArray = np.ndarray


class Displayed(Protocol):
    """An object that notebooks display, such as ``IPython.display.HTML``."""

    def _repr_html_(self) -> object: ...


class MeshWithFaces(Protocol):
    """A mesh with ``vertices`` and ``faces``, as in trimesh."""

    @property
    def vertices(self) -> ArrayLike: ...
    @property
    def faces(self) -> ArrayLike: ...


class MeshWithTriangles(Protocol):
    """A mesh with ``vertices`` and ``triangles``, as in Open3D."""

    @property
    def vertices(self) -> ArrayLike: ...
    @property
    def triangles(self) -> ArrayLike: ...


class Geometry(Protocol):
    """A geometry of shapely or GeoPandas: one, a column of them, or a table with one."""

    @property
    def geom_type(self) -> Any: ...


class Progress(Protocol):
    """A function that is told the progress of a run: numbers of pulses and points, the leg, and the fraction done (NaN if unknown)."""

    def __call__(self, *, pulses: int, points: int, leg: int, done: float) -> object: ...


#: Box, number of primitives, ids of parts, materials (name, reflectance, class) and memory (bytes) of a loaded scene.
SceneFacts: TypeAlias = tuple[list[list[float]], int, list[str], list[tuple[str, float, int]], int]
