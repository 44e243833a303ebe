"""Results of runs: tables whose columns are NumPy arrays without copies."""

from __future__ import annotations

import copyreg
import sys
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, TypeAlias, cast, overload

import numpy as np
from numpy.typing import DTypeLike, NDArray

from . import _vlscan
from ._libraries import needed
from ._typing import ColumnArray

if TYPE_CHECKING:
    import pandas
    import polars
    import pyarrow
    import xarray
    from typing_extensions import Self

#: A mask or indices of rows.
Rows: TypeAlias = Sequence[int] | Sequence[bool] | NDArray[np.bool_] | NDArray[np.integer[Any]]


class Table:
    """Columns of numbers in memory.

    ``table["X"]`` is a NumPy array without a copy, which is read-only. Whatever takes Arrow takes the whole table without a
    copy, too: ``polars.DataFrame(table)``, ``pyarrow.table(table)``, ``pandas.DataFrame.from_arrow(table)``,
    ``duckdb.sql("select * from table")`` (over ``table.to_arrow()``); ``numpy.asarray(table)`` and ``pandas.DataFrame(table)``
    are copies, the array a structured one.
    ``table[mask]``, ``table[indices]`` and ``table[10:20]`` are tables of some of the rows. Tables pickle.

    Parameters
    ----------
    table : object
        The table of the engine.

    Examples
    --------
    >>> points = vlscan.run("fixtures/room/survey.xml", seed=1, columns=["X", "Y", "Z"]).points
    >>> points.columns, points["X"].dtype, "Z" in points
    (['X', 'Y', 'Z'], dtype('float64'), True)
    """

    #: Name of the dimension of :meth:`to_xarray`.
    _ROW = "row"

    def __init__(self, table: _vlscan.Table) -> None:
        self._table = table
        self._columns: dict[str, ColumnArray] = {}

    if not TYPE_CHECKING:

        @property
        def __class__(self):
            """Type of the table; ``dict`` for the constructor of pandas.DataFrame, which takes columns of dictionaries only."""
            return dict if sys._getframe(1).f_globals.get("__name__") == "pandas.core.frame" else type(self)

    def __len__(self) -> int:
        return len(self._table)

    @overload
    def __getitem__(self, key: str) -> ColumnArray: ...
    @overload
    def __getitem__(self, key: slice | Rows) -> Self: ...
    def __getitem__(self, key: str | slice | Rows) -> ColumnArray | Self:
        """Return a column by name, or rows by a slice, a mask or indices."""
        if isinstance(key, str):
            return self._column(key)
        return type(self)(self._rows(key))

    def __setitem__(self, key: object, value: object) -> None:
        """Refuse to change a table, with advice."""
        raise TypeError(f"{type(self).__name__} cannot be changed; change table.to_pandas(), of which Points.of(frame) makes points")

    def _column(self, name: str) -> ColumnArray:
        if name not in self._columns:
            try:
                self._columns[name] = cast(ColumnArray, np.asarray(self._table.column(name)))
            except KeyError:
                close = get_close_matches(name.lower(), [column.lower() for column in self.columns], 1)
                near = next((column for column in self.columns if close and column.lower() == close[0]), None)
                hint = f"did you mean {near!r}? There" if near else "there"
                raise KeyError(f"no column is called {name!r}; {hint} are {', '.join(self.columns)}") from None
            except TypeError as problem:
                raise TypeError(f"column {name}: {problem}; to_arrow()[{name!r}] has the values") from None
        return self._columns[name]

    def _rows(self, key: slice | Rows) -> _vlscan.Table:
        count = len(self)
        if isinstance(key, slice):
            start, stop, step = key.indices(count)
            if step == 1:
                return self._table.slice(start, max(start, stop))
            key = np.arange(start, stop, step)
        single: object = key
        if isinstance(single, tuple) and len(single) == 1 and isinstance(single[0], np.ndarray):
            # As numpy.nonzero() returns indices.
            single = key = single[0]
        if isinstance(single, (int, np.integer)):
            row = int(single)
            raise IndexError(f"rows are chosen by a slice, a mask or indices; a single one is table[{row}:{row + 1}] or table[[{row}]]")
        chosen = np.asarray(key)
        if chosen.ndim == 1 and chosen.dtype.kind in "UO" and chosen.size:
            raise IndexError("rows are chosen by a slice, a mask or indices; several columns are table.to_numpy([name, name])")
        if chosen.ndim != 1 or (chosen.size and chosen.dtype.kind not in "biu"):
            raise IndexError(f"rows are chosen by a slice, a mask or indices, found {chosen.dtype} of the shape {chosen.shape}")
        if chosen.dtype == bool:
            if len(chosen) != count:
                raise IndexError(f"a mask has {len(chosen)} values for {count} rows")
            chosen = np.flatnonzero(chosen)
        elif chosen.size and not -count <= chosen.min() <= chosen.max() < count:
            raise IndexError(f"indices of rows are {chosen.min()} to {chosen.max()}, and there are {count} rows")
        indices = np.where(chosen < 0, chosen + count, chosen) if chosen.size else np.zeros(0)
        return self._table.take(indices.astype("<u8").tobytes())

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            # A table without columns is one that is being made or unpickled.
            hint = f"; a column is table[{name!r}]" if "_table" in self.__dict__ and name in self._table.names else ""
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}{hint}")

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def keys(self) -> list[str]:
        """Return the names of the columns, with which ``dict(table)`` works.

        Returns
        -------
        list of str
            The names.
        """
        return self.columns

    def values(self) -> list[ColumnArray]:
        """Return the columns.

        Returns
        -------
        list of numpy.ndarray
            The columns, in the order of their names.
        """
        return [self[name] for name in self.columns]

    def items(self) -> list[tuple[str, ColumnArray]]:
        """Return the columns with their names.

        Returns
        -------
        list of tuple of str and numpy.ndarray
            Names and columns.
        """
        return [(name, self[name]) for name in self.columns]

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return self._table.names

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns that have one."""
        return self._table.units

    @property
    def descriptions(self) -> dict[str, str]:
        """Meanings of the columns, by name."""
        return self._table.descriptions

    @property
    def metadata(self) -> dict[str, str]:
        """Metadata: scanner, coordinate reference system (``crs``, WKT), names of objects (``object_names``, JSON)."""
        return self._table.metadata

    def to_numpy(self, columns: str | Sequence[str] | None = None, dtype: DTypeLike | None = None) -> NDArray[Any]:
        """Return an array of its own, which can be changed.

        Parameters
        ----------
        columns : str or sequence of str, optional
            Names of the columns; all by default.
        dtype : data-type, optional
            Type of all values. With it the array is a plain one of rows and columns, or of one dimension for a single name;
            without it a structured one with a field per column.

        Returns
        -------
        numpy.ndarray
            The array.

        Examples
        --------
        >>> points = vlscan.run("fixtures/room/survey.xml", columns=["X", "ReturnNumber"]).points
        >>> points.to_numpy().dtype.names
        ('X', 'ReturnNumber')
        >>> features = points.to_numpy(["X", "ReturnNumber"], dtype="float32")
        >>> features.shape == (len(points), 2), features.flags.writeable
        (True, True)
        """
        if isinstance(columns, str):
            return np.array(self[columns], dtype=dtype)
        names = [name for name in self.columns if not self._is_list(name)] if columns is None else list(columns)
        if dtype is not None:
            plain = np.empty((len(self), len(names)), dtype=dtype)
            for index, name in enumerate(names):
                plain[:, index] = self[name]
            return plain
        rows = np.empty(len(self), dtype=[(name, self[name].dtype) for name in names])
        for name in names:
            rows[name] = self[name]
        return rows

    def to_arrow(self) -> pyarrow.Table:
        """Return the table for pyarrow, without a copy.

        Returns
        -------
        pyarrow.Table
            The table.
        """
        table: pyarrow.Table = needed("pyarrow", "to_arrow()").table(self)
        return table

    def to_pandas(self) -> pandas.DataFrame:
        """Return the table for pandas.

        Returns
        -------
        pandas.DataFrame
            The table.
        """
        library = needed("pandas", "to_pandas()")
        frame: pandas.DataFrame = library.DataFrame({name: self[name] for name in self.columns if not self._is_list(name)}, copy=False)
        return frame

    def to_polars(self) -> polars.DataFrame:
        """Return the table for polars, without a copy.

        Returns
        -------
        polars.DataFrame
            The table.
        """
        frame: polars.DataFrame = needed("polars", "to_polars()").DataFrame(self)
        return frame

    def to_xarray(self) -> xarray.Dataset:
        """Return the table for xarray: a variable per column along one dimension, with units and descriptions as attributes.

        Coordinates are X, Y and Z, or x, y and z.

        Returns
        -------
        xarray.Dataset
            The table.

        Raises
        ------
        ImportError
            Xarray is not installed.

        Examples
        --------
        >>> data = vlscan.run("fixtures/room/survey.xml", seed=1).points.to_xarray()
        >>> data["Range"].attrs["units"], list(data.coords)
        ('m', ['X', 'Y', 'Z'])
        """
        library = needed("xarray", "to_xarray()")
        dimension = type(self)._ROW
        names = [name for name in self.columns if not self._is_list(name)]
        about = {name: {"units": self.units.get(name), "description": self.descriptions.get(name)} for name in names}
        variables = {name: (dimension, self[name], {key: text for key, text in about[name].items() if text is not None}) for name in names}
        coordinates = {name: variables.pop(name) for name in names if name in ("X", "Y", "Z", "x", "y", "z")}
        data: xarray.Dataset = library.Dataset(variables, coordinates, dict(self.metadata))
        return data

    def _is_list(self, name: str) -> bool:
        return False

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is False:
            raise ValueError("a table becomes an array by a copy; its columns are arrays without one")
        if sys._getframe(1).f_globals.get("__name__", "").startswith("pandas."):
            # A Series would have rows as values.
            raise TypeError("pandas takes a table as pandas.DataFrame(table) or table.to_pandas(), a column as pandas.Series(table[name])")
        return self.to_numpy(dtype=dtype)

    def __arrow_c_array__(self, requested_schema: object | None = None) -> tuple[object, object]:
        return self._table.__arrow_c_array__(requested_schema)

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        return self._table.__arrow_c_stream__(requested_schema)

    def __arrow_c_schema__(self) -> object:
        return self._table.__arrow_c_schema__()

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self._table,)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self)} rows of {', '.join(self.columns)}>"


class Waveforms(Table):
    """Digitised waveforms, one per row.

    Parameters
    ----------
    table : object
        The table of the engine.

    Examples
    --------
    >>> waveforms = vlscan.run("fixtures/room/survey.xml", seed=1, waveforms=True).waveforms
    >>> len(waveforms.samples(0)) == int(waveforms["count"][0])
    True
    """

    def __init__(self, table: _vlscan.Table) -> None:
        super().__init__(table)
        values, offsets = table.lists("samples")
        self._values, self._offsets = np.asarray(values), np.asarray(offsets)

    def samples(self, row: int) -> NDArray[Any]:
        """Return the samples of a row: power over time.

        Parameters
        ----------
        row : int
            The row.

        Returns
        -------
        numpy.ndarray
            Samples in equal steps from ``start`` to ``end`` (one-way travel time, ns).
        """
        row = range(len(self))[row]
        return self._values[self._offsets[row] : self._offsets[row + 1]]

    @property
    def all_samples(self) -> NDArray[Any]:
        """The samples of all rows."""
        return self._values[self._offsets[0] : self._offsets[-1]]

    def _is_list(self, name: str) -> bool:
        return name == "samples"

    def _column(self, name: str) -> ColumnArray:
        """Return a column by name; ``samples`` as an array of arrays."""
        if self._is_list(name):
            rows = np.empty(len(self), dtype=object)
            for row in range(len(self)):
                rows[row] = self.samples(row)
            return cast(ColumnArray, rows)
        return super()._column(name)


def _table_of(parts: tuple[bytes, bytes | None, bytes | None]) -> _vlscan.Table:
    return _vlscan.Table.of_bytes(*parts)


copyreg.pickle(_vlscan.Table, lambda table: (_table_of, (table.to_bytes(),)))
