"""Facts about point clouds, their rasters, and their frames as data sets of driving."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _vlscan
from ._arguments import path_of, suggesting
from ._columns import EngineTable, named_cloud
from ._facts import Facts
from ._libraries import needed
from ._typing import PathLike, TableLike
from .errors import temporary_folder
from .points import Points

if TYPE_CHECKING:
    import xarray


class CloudInfo(Facts[Any]):
    """Facts about a point cloud: a mapping with the keys of ``vlscan info --json``.

    Parameters
    ----------
    facts : dict
        The facts by name.
    text : str
        The facts as text.
    """

    def __init__(self, facts: dict[str, Any], text: str) -> None:
        super().__init__(facts)
        self._text = text

    def __str__(self) -> str:
        return self._text

    def __repr__(self) -> str:
        return f"<CloudInfo of {self['points']:,} points: {', '.join(self)}>"


def cloud_info(*clouds: TableLike | PathLike) -> CloudInfo:
    """Describe point clouds as one: counts, density, extent, system, classes, returns, times, flight lines.

    Parameters
    ----------
    *clouds : Points, table, str or path-like
        The clouds: points, or files in any format that is read.

    Returns
    -------
    CloudInfo
        The facts; ``print()`` shows them as ``vlscan info`` does.

    Raises
    ------
    InputError
        A file is no point cloud or damaged.
    ValueError
        There is no cloud.

    Examples
    --------
    >>> points = vlscan.run("fixtures/room/survey.xml", seed=1).points
    >>> info = vlscan.cloud_info(points)
    >>> info["points"] == len(points), info["density_per_m2"] > 10
    (True, True)
    """
    facts, text = _vlscan.cloud_info(_named(clouds))
    return CloudInfo(json.loads(facts), text)


class Rasters(Facts[NDArray[np.float64]]):
    """Rasters of a point cloud by name: arrays with rows from south to north and columns from west to east, NaN where there is no value.

    Parameters
    ----------
    values : dict
        The rasters.
    side_m : float
        Side of a cell, m.
    corner : tuple of float
        South-western corner, x and y, world frame, m.
    crs : str, optional
        Coordinate reference system as WKT.

    Attributes
    ----------
    side_m : float
        Side of a cell, m.
    corner : tuple of float
        South-western corner, x and y, world frame, m.
    crs : str or None
        Coordinate reference system as WKT.
    """

    def __init__(self, values: dict[str, NDArray[np.float64]], side_m: float, corner: tuple[float, float], crs: str | None) -> None:
        super().__init__(values)
        self.side_m = side_m
        self.corner = corner
        self.crs = crs

    def to_xarray(self) -> xarray.Dataset:
        """Return the rasters for xarray, with the centres of the cells as coordinates.

        Returns
        -------
        xarray.Dataset
            The rasters, with the dimensions y and x; the system is the attribute ``crs``.
        """
        rows, columns = next(iter(self.values())).shape
        centres = {
            "y": self.corner[1] + self.side_m * (np.arange(rows) + 0.5),
            "x": self.corner[0] + self.side_m * (np.arange(columns) + 0.5),
        }
        about = {} if self.crs is None else {"crs": self.crs}
        cells = {name: (("y", "x"), values) for name, values in self.items()}
        data: xarray.Dataset = needed("xarray", "to_xarray()").Dataset(cells, centres, about)
        return data

    def __repr__(self) -> str:
        rows, columns = next(iter(self.values())).shape
        return f"<Rasters of {columns} by {rows} cells of {self.side_m:g} m: {', '.join(self)}>"


@suggesting
def raster(
    *clouds: TableLike | PathLike,
    dtm: PathLike | bool = False,
    dsm: PathLike | bool = False,
    chm: PathLike | bool = False,
    density: PathLike | bool = False,
    pulse_density: PathLike | bool = False,
    cell: float = 1.0,
    fill: float = 30.0,
    crs: str | None = None,
    force: bool = False,
) -> Rasters:
    """Make rasters of point clouds, which are taken as one.

    Parameters
    ----------
    *clouds : Points, table, str or path-like
        The clouds: points, or files in any format that is read.
    dtm : str, path-like or bool
        Height of the ground, m: ``True``, or also the file to write, ``.tif``; likewise the following.
    dsm : str, path-like or bool
        Height of the highest point of each cell, m.
    chm : str, path-like or bool
        Canopy height: surface minus terrain, m.
    density : str, path-like or bool
        Points per m².
    pulse_density : str, path-like or bool
        First returns per m².
    cell : float
        Side of a cell, m. Corners of cells are at multiples of it.
    fill : float
        Largest distance from a ground point at which there is terrain, m.
    crs : str, optional
        Coordinate reference system of clouds that name none: ``EPSG:25832``, WKT, or a file with either.
    force : bool
        If set, existing files are replaced.

    Returns
    -------
    Rasters
        The rasters that are asked for, by the names of their arguments.

    Raises
    ------
    InputError
        A cloud cannot be read, has no ground, or a file exists.
    ValueError
        No cloud or no raster is asked for, or a file has another extension.

    Examples
    --------
    >>> points = vlscan.run("fixtures/terrain/survey.xml", seed=1).points
    >>> rasters = vlscan.raster(points, dsm=True, density="density.tif", cell=2)
    >>> rasters["dsm"].shape == rasters["density"].shape, rasters.side_m
    (True, 2.0)
    """
    asked = {"dtm": dtm, "dsm": dsm, "chm": chm, "density": density, "pulse_density": pulse_density}
    wanted = {name: None if file is True else path_of(name, file) for name, file in asked.items() if file is not False}
    if not wanted:
        raise ValueError(f"no raster is asked for: expected at least one of {', '.join(asked)}")
    files = [file for file in wanted.values() if file is not None]
    for file in files:
        if not file.lower().endswith((".tif", ".tiff")):
            raise ValueError(f"{file}: expected a name that ends in .tif")
        if files.count(file) > 1:
            raise ValueError(f"two rasters have the file {file}")
    fields: dict[str, Any] = {"cell": cell, "fill": fill, "crs": crs, "force": force}
    named = [(name.replace("_", "-"), file) for name, file in wanted.items()]
    (columns, rows, side, corner), system, cells = _vlscan.raster(_named(clouds), named, fields)
    values = {name: np.frombuffer(content, "<f8").reshape(rows, columns) for name, content in zip(wanted, cells, strict=True)}
    return Rasters(values, side, (corner[0], corner[1]), system)


class FrameCounts(NamedTuple):
    """Counts of :func:`write_frames`.

    Parameters
    ----------
    frames : int
        Number of frames.
    points : int
        Number of points.
    """

    frames: int
    points: int


@suggesting
def write_frames(
    points: Points | PathLike,
    folder: PathLike,
    layout: Literal["kitti", "nuscenes"],
    *,
    forward: Literal["x", "y"] = "x",
    sequence: int = 0,
    intensity_factor: float = 1.0,
    frame_s: float | None = None,
    objects: PathLike | None = None,
    skewed_objects: bool = False,
    categories: Mapping[int, str] | None = None,
) -> FrameCounts:
    """Write the frames of a scanner in the layout of KITTI odometry with SemanticKITTI's labels, or of nuScenes with lidarseg.

    Parameters
    ----------
    points : Points, str or path-like
        Points of a run with ``columns=vlscan.columns()``, or an MCAP file of a run.
    folder : str or path-like
        The folder to write to.
    layout : {"kitti", "nuscenes"}
        The layout.
    forward : {"x", "y"}
        The axis of the scanner that points forward.
    sequence : int
        Number of the sequence of KITTI, 0 to 99.
    intensity_factor : float
        Factor from the intensities of the instrument to those of the files, which are 0 to 1 in KITTI and 0 to 255 in nuScenes.
    frame_s : float, optional
        Duration of a frame of points in memory, s; by default that of a revolution.
    objects : str or path-like, optional
        A table of ``vlscan run --objects`` for the same points: boxes of the moving objects are written, too. The points of these
        objects are moved to where they are at the time of the box.
    skewed_objects : bool
        Leave the points of moving objects where they were measured, smeared along their way.
    categories : mapping of int to str, optional
        Names of classes in the labels of KITTI and the categories of nuScenes, such as ``{64: "Car"}``.

    Returns
    -------
    FrameCounts
        Numbers of frames and points.

    Raises
    ------
    InputError
        The file is no MCAP with points and poses, or the folder of the layout exists.
    ValueError
        Another layout, axis, sequence, factor or class, or ``skewed_objects`` without ``objects``.

    Examples
    --------
    >>> vlscan.run("fixtures/street/survey.xml", to="street.mcap", seed=1, force=True).point_count > 0
    True
    >>> vlscan.write_frames("street.mcap", "kitti", "kitti").frames > 0
    True
    """
    if layout not in ("kitti", "nuscenes"):
        raise ValueError(f'layout is {layout!r}, expected "kitti" or "nuscenes"')
    if forward not in ("x", "y"):
        raise ValueError(f'forward is {forward!r}, expected "x" or "y"')
    if not 0 <= sequence <= 99:
        raise ValueError(f"sequence is {sequence}, expected 0 to 99")
    if not (math.isfinite(intensity_factor) and intensity_factor > 0):
        raise ValueError(f"intensity_factor is {intensity_factor}, expected a number above 0")
    if skewed_objects and objects is None:
        raise ValueError("skewed_objects needs objects")
    names = dict(categories or {})
    for number, name in names.items():
        if not 0 <= number <= 255 or not name.strip() or not name.isprintable():
            raise ValueError(f"categories have {number}: {name!r}, expected a class from 0 to 255 and its name")
    fields: dict[str, Any] = {
        "layout": layout,
        "forward": forward,
        "sequence": sequence,
        "intensity_factor": intensity_factor,
        "objects": None if objects is None else path_of("objects", objects),
        "skewed_objects": skewed_objects,
        "categories": list(names.items()),
    }
    if not isinstance(points, Points):
        if frame_s is not None:
            raise ValueError("frame_s is for points in memory; a file has its frames")
        return FrameCounts(*_vlscan.write_frames(path_of("points", points), path_of("folder", folder), fields))
    with temporary_folder() as place:
        path = os.path.join(place, "points.mcap")
        points.write(path, frame_s=frame_s)
        return FrameCounts(*_vlscan.write_frames(path, path_of("folder", folder), fields))


def _named(clouds: tuple[TableLike | PathLike, ...]) -> list[tuple[str, EngineTable | None]]:
    """Return clouds as the engine takes them."""
    if not clouds:
        raise ValueError("no cloud is given: expected points or files")
    return [named_cloud(cloud, "points") for cloud in clouds]
