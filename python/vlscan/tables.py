"""Results of runs: tables whose columns are NumPy arrays without copies."""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _vlscan
from ._typing import PathLike

if TYPE_CHECKING:
    import pandas
    import polars
    import pyarrow
    from IPython.display import HTML


class Table:
    """Columns of numbers in memory.

    ``table["X"]`` is a NumPy array without a copy, which is read-only. Whatever takes Arrow takes the whole table without a
    copy, too: ``polars.DataFrame(table)``, ``pyarrow.table(table)``, ``pandas.DataFrame.from_arrow(table)``,
    ``duckdb.sql("select * from table")`` (over ``table.to_arrow()``).

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

    def __init__(self, table: _vlscan.Table) -> None:
        self._table = table
        self._columns: dict[str, NDArray[Any]] = {}

    def __len__(self) -> int:
        return len(self._table)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column by name."""
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
        """Return the names of the columns, with which ``dict(table)`` and ``pandas.DataFrame(dict(table))`` work.

        Returns
        -------
        list of str
            The names.
        """
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

    def to_numpy(self) -> NDArray[np.void]:
        """Return a structured array with a field per column (a copy).

        Returns
        -------
        numpy.ndarray
            The array.

        Examples
        --------
        >>> points = vlscan.run("fixtures/room/survey.xml", columns=["X", "ReturnNumber"]).points
        >>> points.to_numpy().dtype.names
        ('X', 'ReturnNumber')
        """
        names = [name for name in self.columns if not self._is_list(name)]
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
        import pyarrow

        return pyarrow.table(self)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the table for pandas.

        Returns
        -------
        pandas.DataFrame
            The table.
        """
        import pandas

        return pandas.DataFrame({name: self[name] for name in self.columns if not self._is_list(name)}, copy=False)

    def to_polars(self) -> polars.DataFrame:
        """Return the table for polars, without a copy.

        Returns
        -------
        polars.DataFrame
            The table.
        """
        import polars

        return polars.DataFrame(self)

    def _is_list(self, name: str) -> bool:
        return False

    def __arrow_c_array__(self, requested_schema: object | None = None) -> tuple[object, object]:
        return self._table.__arrow_c_array__(requested_schema)

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        return self._table.__arrow_c_stream__(requested_schema)

    def __arrow_c_schema__(self) -> object:
        return self._table.__arrow_c_schema__()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self)} rows of {', '.join(self.columns)}>"


class Points(Table):
    """Points, one per row. :func:`vlscan.columns` lists the columns. Shows itself in a notebook.

    Parameters
    ----------
    table : object
        The table of the engine.

    Examples
    --------
    >>> points = vlscan.run("fixtures/room/survey.xml", seed=1).points
    >>> points.xyz.shape == (len(points), 3)
    True
    """

    @property
    def xyz(self) -> NDArray[np.float64]:
        """Coordinates as an array of n rows and three columns, world frame, m (a copy)."""
        return np.column_stack([self["X"], self["Y"], self["Z"]])

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lowest and highest coordinates, m, as an array of two rows."""
        if not len(self):
            return np.full((2, 3), np.nan)
        columns = [self[name] for name in "XYZ"]
        return np.array([[c.min() for c in columns], [c.max() for c in columns]])

    def png(self, colour: str = "height", title: str = "", width: int = 1600, height: int = 1200) -> bytes:
        """Draw the points from above and from the side.

        Parameters
        ----------
        colour : str
            ``height``, ``class``, ``intensity``, ``object`` or ``return``.
        title : str
            A title.
        width, height : int
            Size of the picture, pixels.

        Returns
        -------
        bytes
            A PNG file.

        Raises
        ------
        ValueError
            Another colour, or another size than 320 to 16384 by 240 to 16384.
        """
        return _vlscan.picture(self._table, colour, title, width, height)

    def html(self, colour: str = "height", title: str = "", max_points: int = 1_000_000) -> str:
        """Make a page to turn the points around in a browser, offline.

        Parameters
        ----------
        colour : str
            ``height``, ``class``, ``intensity``, ``object`` or ``return``.
        title : str
            A title.
        max_points : int
            Of more points evenly chosen ones are shown.

        Returns
        -------
        str
            The page.
        """
        return _vlscan.page(self._table, colour, title, max_points)

    def show(self, colour: str = "height", title: str = "", max_points: int = 200_000) -> HTML | None:
        """Show the points: in a notebook as a view to turn around, otherwise as a page in the browser.

        Parameters
        ----------
        colour : str
            ``height``, ``class``, ``intensity``, ``object`` or ``return``.
        title : str
            A title.
        max_points : int
            Of more points evenly chosen ones are shown.

        Returns
        -------
        IPython.display.HTML or None
            The view, in a notebook.
        """
        return show_page(self.html(colour, title, max_points))

    def save_preview(self, path: PathLike, colour: str = "height", title: str = "") -> None:
        """Write a picture or a page.

        Parameters
        ----------
        path : str or path-like
            The file, ``.png`` or ``.html``.
        colour : str
            ``height``, ``class``, ``intensity``, ``object`` or ``return``.
        title : str
            A title.

        Raises
        ------
        ValueError
            Another extension or colour.

        Examples
        --------
        >>> vlscan.run("fixtures/room/survey.xml", seed=1).points.save_preview("room.png", "intensity")
        """
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

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column by name; ``samples`` as an array of arrays."""
        if self._is_list(name):
            rows = np.empty(len(self), dtype=object)
            for row in range(len(self)):
                rows[row] = self.samples(row)
            return rows
        return super().__getitem__(name)


def picture_html(png: bytes, about: str) -> str:
    """Return a picture with a line of text below it, for notebooks."""
    data = base64.b64encode(png).decode()
    return f'<img src="data:image/png;base64,{data}" style="max-width:100%"><div>{about}</div>'


def show_page(page: str) -> HTML | None:
    """Show a page in the notebook that runs the program, otherwise in a browser."""
    try:
        from IPython import get_ipython
        from IPython.display import HTML
    except ImportError:
        pass
    else:
        if hasattr(get_ipython(), "kernel"):
            frame = html.escape(page, quote=True)
            return HTML(f'<iframe srcdoc="{frame}" style="width:100%;height:600px;border:0"></iframe>')
    import tempfile
    import webbrowser

    with tempfile.NamedTemporaryFile("w", suffix=".html", delete=False, encoding="utf-8") as file:
        file.write(page)
    webbrowser.open(f"file://{file.name}")
    return None
