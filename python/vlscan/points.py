"""Points: what a run has measured, and what can be made of it."""

from __future__ import annotations

import io
import json
import os
import shutil
from collections.abc import Iterable
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from . import _vlscan
from ._arguments import reals, suggesting
from ._columns import columns_of
from ._conversions import colours_of, crs_of_library, crs_text, normals_of
from ._libraries import needed
from ._pictures import DrawnTable
from ._typing import PathLike, TableLike, Vector
from ._values import values_of
from .errors import InputError, temporary_folder, warn

if TYPE_CHECKING:
    import geopandas
    import laspy
    import open3d

# Coordinates as shorter floats may be wrong by so much.
_LOSSLESS_M = 1e-3

# Extensions of the formats whose names are none.
_EXTENSIONS = {"copc": "copc.laz", "ply-ascii": "ply", "raycloud": "ply", "geoparquet": "geo.parquet"}

# Columns of whole numbers, and the types that files have at most.
_WHOLE: dict[str, np.dtype[np.integer[Any]]] = {
    **{"Intensity": np.dtype("u2"), "ReturnNumber": np.dtype("u1"), "NumberOfReturns": np.dtype("u1")},
    **{"Classification": np.dtype("u1"), "PointSourceId": np.dtype("u2"), "Device": np.dtype("u2")},
    **{"ObjectId": np.dtype("i4"), "Part": np.dtype("u4"), "Primitive": np.dtype("u4")},
}


class Points(DrawnTable):
    """Points, one per row. :func:`vlscan.columns` lists the columns. Shows itself in a notebook.

    ``points[points["Classification"] == 2]`` are some of them, which can be written, drawn and converted as all of them.

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

    _ROW = "point"

    @staticmethod
    def of(table: TableLike | ArrayLike | object, crs: str | None = None) -> Points:
        """Return the points of a table of another library.

        Parameters
        ----------
        table : mapping, Arrow table, structured array, array of n by 3, or object of laspy, xarray, GeoPandas or Open3D
            The table, with columns named as those of :func:`vlscan.columns`: X, Y, Z and others.
        crs : str, optional
            Coordinate reference system: a code such as ``EPSG:25832``, or WKT; by default that of the table.

        Returns
        -------
        Points
            The points.

        Raises
        ------
        TypeError
            It is no table.
        ValueError
            The table has no X, Y or Z, its columns have different lengths, or the coordinate reference system is unknown.

        Examples
        --------
        >>> vlscan.Points.of({"X": [0.0, 1.0], "Y": [0.0, 0.0], "Z": [2.0, 2.0]}).bounds[1].tolist()
        [1.0, 0.0, 2.0]
        """
        given: Any = table
        if isinstance(given, (str, bytes, os.PathLike)):
            raise TypeError(f"expected a table, found {given!r}; Points.read() reads a file")
        crs = crs_of_library(given) if crs is None else crs_text(crs)
        points = Points(_vlscan.Table.of_columns(columns_of(given, ("X", "Y", "Z"), keep_types=True), crs))
        missing = [name for name in "XYZ" if name not in points]
        if missing:
            raise ValueError(f"the table has no column {', '.join(missing)}; there are {', '.join(points.columns)}")
        return points

    @staticmethod
    def concat(parts: Iterable[Points]) -> Points:
        """Return the points of several tables with the same columns as one: of batches, or of runs.

        Parameters
        ----------
        parts : iterable of Points
            The tables.

        Returns
        -------
        Points
            The points, in the order of the tables.

        Raises
        ------
        ValueError
            There are no tables, or their columns or coordinate reference systems differ.

        Examples
        --------
        >>> survey = vlscan.Survey.open("fixtures/room/survey.xml")
        >>> points = vlscan.Points.concat(survey.run_batches(1000, seed=1))
        >>> len(points) == survey.run(seed=1).point_count
        True
        """
        tables = list(parts)
        if not tables:
            raise ValueError("there are no points to join; concat() needs at least one table")
        wrong = next((table for table in tables if not isinstance(table, Points)), None)
        if wrong is not None:
            raise TypeError(f"expected Points, found {type(wrong).__name__}; Points.of() converts tables")
        if len({table.crs for table in tables}) > 1:
            raise ValueError("the points have different coordinate reference systems")
        names = {name for table in tables for name in table.columns}
        differing = sorted(name for name in names if not all(name in table for table in tables))
        if differing:
            raise ValueError(f"the points have different columns: not all have {', '.join(differing)}")
        return Points(_vlscan.Table.concat([table._table for table in tables])) if len(tables) > 1 else tables[0]

    @staticmethod
    def read(path: PathLike | IO[bytes]) -> Points:
        """Read a point cloud: LAS, LAZ, PLY, PCD, E57, PTS, MCAP, text, Arrow or Parquet.

        Parameters
        ----------
        path : str, path-like or binary file object
            The file.

        Returns
        -------
        Points
            The points, with those columns of :func:`vlscan.columns` that the file has. Intensities with fractions are amplitudes;
            colours of 8 bits become those of 16. Of LAS, PLY and tables the names of objects and the coordinate reference
            system are kept, as far as the file has them.

        Raises
        ------
        InputError
            The file is no point cloud, or damaged.
        FileError
            The file cannot be read.

        Examples
        --------
        >>> result = vlscan.run("fixtures/room/survey.xml", to="room.laz", seed=1)
        >>> len(vlscan.Points.read("room.laz")) == result.point_count
        True
        """
        if isinstance(path, (str, bytes, os.PathLike)):
            return Points(_vlscan.read_points(os.fsdecode(path)))
        source: object = path
        if not hasattr(source, "read"):
            raise TypeError(f"expected a file, or a binary file object, found {type(source).__name__}")
        if isinstance(source, io.TextIOBase):
            raise TypeError('points are read from binary file objects, such as open(name, "rb")')
        with temporary_folder() as folder:
            # Text is known by its extension.
            name = os.path.join(folder, "points" + os.path.splitext(str(getattr(path, "name", "")))[1])
            with open(name, "wb") as copy:
                shutil.copyfileobj(path, copy)
            return Points(_vlscan.read_points(name))

    @suggesting
    def write(
        self,
        path: PathLike | IO[bytes],
        *,
        columns: Iterable[str] | None = None,
        format: str | None = None,
        crs: str | None = None,
        labels: bool | None = None,
        las10: bool | None = None,
        las_scale: float | None = None,
        las_extra: str | None = None,
        las_at_most: int | None = None,
        frame_s: float | None = None,
        force: bool = False,
    ) -> None:
        """Write the points to a file, whose extension tells the format: any that a run writes.

        The bytes are those of a file that the run itself had written, if it has the columns that it has by default, or those
        that the format needs. E57 and ray clouds need BeamOriginX and so on, MCAP ScannerX and so on; a run with
        ``columns=vlscan.columns()`` has all of them.

        Parameters
        ----------
        path : str, path-like or binary file object
            The file, or a file object with ``format``: ``.las``, ``.laz``, ``.copc.laz``, ``.ply``, ``.raycloud.ply``, ``.pcd``,
            ``.e57``, ``.mcap``, ``.xyz``, ``.csv``, ``.arrow``, ``.parquet``, ``.geo.parquet``.
        columns : iterable of str, optional
            Columns of text, Arrow and Parquet; all by default.
        format : str, optional
            Name of the format, if the extension does not tell it.
        crs : str, optional
            Coordinate reference system: a code such as ``EPSG:25832``, or WKT.
        labels : bool, optional
            True if LAS and PLY have part, primitive and true range.
        las10 : bool, optional
            True if LAS has version 1.0.
        las_scale : float, optional
            Scale of LAS, m.
        las_extra : str, optional
            Extra bytes of LAS: ``all``, ``helios`` or ``none``.
        las_at_most : int, optional
            Number of points in the header of LAS that is written as a stream.
        frame_s : float, optional
            Duration of the frames of MCAP, s.
        force : bool
            If set, an existing file is replaced.

        Raises
        ------
        InputError
            The file exists, its extension is that of no format, or the points lack columns that the format needs.
        FileError
            The file cannot be written.

        Examples
        --------
        >>> points = vlscan.run("fixtures/room/survey.xml", seed=1).points
        >>> points.write("room.laz", force=True)
        >>> points[points["ReturnNumber"] == 1].write("first.ply")
        """
        options = dict(
            columns=None if columns is None else [columns] if isinstance(columns, str) else list(columns),
            format=format,
            crs=crs,
            labels=labels,
            las10=las10,
            las_scale=las_scale,
            las_extra=las_extra,
            las_at_most=las_at_most,
            frame_s=frame_s,
            force=force or None,
        )
        if isinstance(path, (str, bytes, os.PathLike)):
            name = os.fsdecode(path)
            if os.path.isdir(name):
                raise InputError(f"{name} is a folder; points are written to one file, such as {os.path.join(name, 'points.laz')}")
            if not os.path.splitext(name)[1]:
                # The engine takes such a name for a folder, whatever the format.
                raise InputError(f"{name} has no extension; add one, such as .laz")
            self._warn_of_limits(name)
            self._table.write({**values_of(options), "out": [os.fsdecode(path)]})
            return
        target: object = path
        if not hasattr(target, "write"):
            raise TypeError(f"expected a file, or a binary file object, found {type(target).__name__}")
        if isinstance(target, io.TextIOBase):
            raise TypeError('points are written to binary file objects, such as open(name, "wb")')
        if format is None:
            raise ValueError('a file object has no extension; give its format, for example format="laz"')
        self._warn_of_limits("points")
        with temporary_folder() as folder:
            name = os.path.join(folder, f"points.{_EXTENSIONS.get(format, format)}")
            self._table.write({**values_of(options), "out": [name]})
            with open(name, "rb") as written:
                shutil.copyfileobj(written, path)

    def _warn_of_limits(self, file: str) -> None:
        """Warn of values that the columns of files have no place for, such as those of a table of another library."""
        for name, kind in _WHOLE.items():
            try:
                values = self[name] if name in self else np.empty(0, kind)
            except TypeError:
                # Of no numbers, which the engine refuses.
                continue
            if values.dtype == kind:
                continue
            limits = np.iinfo(kind)
            with np.errstate(invalid="ignore"):
                rows = np.flatnonzero(~((values >= limits.min) & (values <= limits.max) & (values == np.floor(values))))
            if len(rows):
                first = f"{values[rows[0]]:g} in row {rows[0]}"
                more = f" and {len(rows) - 1:,} more" if len(rows) > 1 else ""
                warn(f"{file}: {name} holds {first}{more}; files have whole numbers from {limits.min} to {limits.max}, so others change")

    @property
    def crs(self) -> str | None:
        """Coordinate reference system as WKT, if it is known."""
        return self.metadata.get("crs")

    @property
    def object_names(self) -> dict[int, str]:
        """Names of objects by the numbers in the column ``ObjectId``, of those whose name is not that number."""
        return {int(number): name for number, name in json.loads(self.metadata.get("object_names", "{}")).items()}

    def coordinates(self, dtype: DTypeLike = np.float64, offset: Vector | None = None) -> NDArray[Any]:
        """Return the coordinates as an array of its own, n rows and three columns, which can be changed.

        Parameters
        ----------
        dtype : data-type
            Type of the values, for example ``"float32"``.
        offset : sequence of float, optional
            x, y, z that are subtracted before, m: large coordinates lose digits as 32-bit floats.

        Returns
        -------
        numpy.ndarray
            The array, m.

        Raises
        ------
        TypeError
            A type without fractions, or an offset that is no numbers.

        Examples
        --------
        >>> points = vlscan.run("fixtures/room/survey.xml", seed=1).points
        >>> points.coordinates("float32", offset=points.bounds[0]).min(axis=0).tolist()
        [0.0, 0.0, 0.0]
        """
        kind = np.dtype(dtype)
        if kind.kind != "f":
            raise TypeError(f"dtype is {kind}, expected a type of floating point, such as float32; others have no fractions of a metre")
        origin = np.zeros(3) if offset is None else reals("offset", offset)
        if origin.shape != (3,):
            raise ValueError(f"offset has the shape {origin.shape}, expected x, y, z")
        values = np.empty((len(self), 3), dtype=kind)
        for axis, name in enumerate("XYZ"):
            values[:, axis] = self[name] - origin[axis] if origin[axis] else self[name]
        if kind.itemsize < 8 and len(self):
            reach, step = max(np.abs(self.bounds - origin).max(), 0.0), float(np.finfo(kind).eps)
            if reach * step > 2 * _LOSSLESS_M:
                warn(
                    f"{8 * kind.itemsize}-bit floats resolve {reach * step:.3g} m at coordinates of {reach:.0f} m; "
                    "give coordinates() an offset, such as offset=points.bounds[0]"
                )
        return values

    def to_laspy(self) -> laspy.LasData:
        """Return the points for laspy, with all dimensions that a LAS file of them has.

        Returns
        -------
        laspy.LasData
            The points.

        Raises
        ------
        ImportError
            Laspy is not installed.

        Examples
        --------
        >>> las = vlscan.run("fixtures/room/survey.xml", seed=1).points.to_laspy()
        >>> int(las.header.point_format.id), "range" in las.point_format.extra_dimension_names
        (6, True)
        """
        library = needed("laspy", "to_laspy()")
        with temporary_folder() as folder:
            path = os.path.join(folder, "points.las")
            self.write(path)
            read: laspy.LasData = library.read(path)
        return read

    def to_open3d(self) -> open3d.geometry.PointCloud:
        """Return the points for Open3D, with normals and colours if there are the columns NormalX and so on, and Red, Green and Blue.

        Returns
        -------
        open3d.geometry.PointCloud
            The points.

        Raises
        ------
        ImportError
            Open3D is not installed.
        """
        library = needed("open3d", "to_open3d()")
        vectors = library.utility.Vector3dVector
        cloud: open3d.geometry.PointCloud = library.geometry.PointCloud()
        cloud.points = vectors(self.xyz)
        if (normals := normals_of(self)) is not None:
            cloud.normals = vectors(normals)
        if (colours := colours_of(self)) is not None:
            cloud.colors = vectors(colours)
        return cloud

    def to_geopandas(self) -> geopandas.GeoDataFrame:
        """Return the points for GeoPandas: a geometry of x, y and z with the coordinate reference system, and the other columns.

        Returns
        -------
        geopandas.GeoDataFrame
            The points.

        Raises
        ------
        ImportError
            GeoPandas is not installed.

        Examples
        --------
        >>> frame = vlscan.run("fixtures/room/survey.xml", seed=1, crs="EPSG:25832").points.to_geopandas()
        >>> frame.crs.to_epsg(), bool(frame.geometry.has_z.all())
        (25832, True)
        """
        library = needed("geopandas", "to_geopandas()")
        geometry = library.points_from_xy(self["X"], self["Y"], self["Z"])
        columns = {name: self[name] for name in self.columns if name not in ("X", "Y", "Z")}
        frame: geopandas.GeoDataFrame = library.GeoDataFrame(columns, geometry=geometry, crs=self.crs)
        return frame

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
