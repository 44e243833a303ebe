"""Results of runs: tables whose columns are NumPy arrays without copies."""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _vlscan

if TYPE_CHECKING:
    import pandas
    import polars
    import pyarrow


class Table:
    """Columns of numbers in memory.

    ``table["X"]`` is a NumPy array without a copy, which is read-only. Whatever takes Arrow takes the whole table without a
    copy, too: ``polars.DataFrame(table)``, ``pyarrow.table(table)``, ``pandas.DataFrame.from_arrow(table)``,
    ``duckdb.sql("select * from table")`` (over ``table.to_arrow()``).
    """

    def __init__(self, table: _vlscan.Table) -> None:
        self._table = table
        self._columns: dict[str, np.ndarray] = {}

    def __len__(self) -> int:
        return len(self._table)

    def __getitem__(self, name: str) -> np.ndarray:
        """A column by name."""
        if name not in self._columns:
            try:
                self._columns[name] = np.asarray(self._table.column(name))
            except KeyError:
                raise KeyError(f"no column is called {name!r}; there are {', '.join(self.columns)}") from None
        return self._columns[name]

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def keys(self) -> list[str]:
        """Names of the columns; with this ``dict(table)`` and ``pandas.DataFrame(dict(table))`` work."""
        return self.columns

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
        """What the columns mean."""
        return self._table.descriptions

    @property
    def metadata(self) -> dict[str, str]:
        """Metadata: scanner, coordinate reference system (``crs``, WKT), names of objects (``object_names``, JSON)."""
        return self._table.metadata

    def to_numpy(self) -> np.ndarray:
        """A structured array with a field per column (a copy)."""
        names = [name for name in self.columns if not self._is_list(name)]
        rows = np.empty(len(self), dtype=[(name, self[name].dtype) for name in names])
        for name in names:
            rows[name] = self[name]
        return rows

    def to_arrow(self) -> pyarrow.Table:
        """The table for pyarrow, without a copy."""
        import pyarrow

        return pyarrow.table(self)

    def to_pandas(self) -> pandas.DataFrame:
        """The table for pandas."""
        import pandas

        return pandas.DataFrame({name: self[name] for name in self.columns if not self._is_list(name)}, copy=False)

    def to_polars(self) -> polars.DataFrame:
        """The table for polars, without a copy."""
        import polars

        return polars.DataFrame(self)

    def _is_list(self, name: str) -> bool:
        return False

    def __arrow_c_array__(self, requested_schema: Any = None) -> tuple[Any, Any]:
        return self._table.__arrow_c_array__(requested_schema)

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        return self._table.__arrow_c_stream__(requested_schema)

    def __arrow_c_schema__(self) -> Any:
        return self._table.__arrow_c_schema__()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self)} rows of {', '.join(self.columns)}>"


class Points(Table):
    """Points, one per row: see :func:`vlscan.columns` for the columns. Shows itself in a notebook."""

    @property
    def xyz(self) -> np.ndarray:
        """Coordinates as an array of n rows and three columns, world frame, m (a copy)."""
        return np.column_stack([self["X"], self["Y"], self["Z"]])

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest coordinates, m, as an array of two rows."""
        if not len(self):
            return np.full((2, 3), np.nan)
        columns = [self[name] for name in "XYZ"]
        return np.array([[c.min() for c in columns], [c.max() for c in columns]])

    def png(self, colour: str = "height", title: str = "", width: int = 1600, height: int = 1200) -> bytes:
        """A picture from above and from the side. ``colour``: height, class, intensity, object or return."""
        return _vlscan.picture(self._table, colour, title, width, height)

    def html(self, colour: str = "height", title: str = "", max_points: int = 1_000_000) -> str:
        """A page to turn the points around in a browser, offline. Of more points than ``max_points`` evenly chosen ones."""
        return _vlscan.page(self._table, colour, title, max_points)

    def show(self, colour: str = "height", title: str = "", max_points: int = 200_000) -> Any:
        """Shows the points: in a notebook as a view to turn around, otherwise as a page in the browser."""
        return show_page(self.html(colour, title, max_points))

    def save_preview(self, path: str | os.PathLike[str], colour: str = "height", title: str = "") -> None:
        """Writes a picture (``.png``) or a page (``.html``)."""
        name = os.fspath(path)
        if name.lower().endswith((".html", ".htm")):
            content = self.html(colour, title).encode()
        elif name.lower().endswith(".png"):
            content = self.png(colour, title)
        else:
            raise ValueError(f"{name}: expected a name that ends in .png or .html")
        with open(name, "wb") as file:
            file.write(content)

    def _repr_html_(self) -> str:
        about = html.escape(f"{len(self):,} points: {', '.join(self.columns)}")
        if not len(self) or not {"X", "Y", "Z"} <= set(self.columns):
            return f"<div>{about}</div>"
        return picture_html(self.png(width=1000, height=750), about)


class Waveforms(Table):
    """Digitised waveforms, one per row. ``waveforms.samples(i)`` are the samples of row i."""

    def __init__(self, table: _vlscan.Table) -> None:
        super().__init__(table)
        values, offsets = table.lists("samples")
        self._values, self._offsets = np.asarray(values), np.asarray(offsets)

    def samples(self, row: int) -> np.ndarray:
        """The samples of a row: power over time, in equal steps from ``start`` to ``end`` (one-way travel time, ns)."""
        row = range(len(self))[row]
        return self._values[self._offsets[row] : self._offsets[row + 1]]

    @property
    def all_samples(self) -> np.ndarray:
        """The samples of all rows."""
        return self._values[self._offsets[0] : self._offsets[-1]]

    def _is_list(self, name: str) -> bool:
        return name == "samples"

    def __getitem__(self, name: str) -> np.ndarray:
        if self._is_list(name):
            rows = np.empty(len(self), dtype=object)
            for row in range(len(self)):
                rows[row] = self.samples(row)
            return rows
        return super().__getitem__(name)


def picture_html(png: bytes, about: str) -> str:
    """A picture with a line of text below it."""
    data = base64.b64encode(png).decode()
    return f'<img src="data:image/png;base64,{data}" style="max-width:100%"><div>{about}</div>'


def show_page(page: str) -> Any:
    """Shows a page in the notebook that runs the program, otherwise in a browser."""
    try:
        from IPython import get_ipython
        from IPython.display import HTML
    except ImportError:
        notebook = False
    else:
        shell = get_ipython()
        notebook = shell is not None and hasattr(shell, "kernel")
    if notebook:
        frame = html.escape(page, quote=True)
        return HTML(f'<iframe srcdoc="{frame}" style="width:100%;height:600px;border:0"></iframe>')
    import tempfile
    import webbrowser

    with tempfile.NamedTemporaryFile("w", suffix=".html", delete=False, encoding="utf-8") as file:
        file.write(page)
    webbrowser.open(f"file://{file.name}")
    return None
