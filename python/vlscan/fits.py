"""Flights, instruments and scenes that are estimated from recorded point clouds."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple

from . import _vlscan
from ._arguments import path_of, suggesting
from ._facts import Facts
from ._typing import PathLike, TableLike
from .errors import temporary_folder
from .points import Points
from .scene import Scene


class Fitted(NamedTuple):
    """A quantity that was estimated.

    Parameters
    ----------
    value : float
        The value.
    deviation : float or None
        Its standard deviation.
    unit : str
        The unit.
    """

    value: float
    deviation: float | None
    unit: str


@suggesting
def fit_flight(
    cloud: TableLike | PathLike,
    output: PathLike,
    *,
    flight_line: int | str | None = None,
    extend: float = 0.0,
    force: bool = False,
    max_memory: int | None = None,
) -> dict[str, Fitted]:
    """Estimate a flight and its scanner from a recorded point cloud, and write them as a pipeline file.

    The trajectory, the wander of a cone's mirror and times of pulses are written beside the pipeline file.

    Parameters
    ----------
    cloud : Points, table, str or path-like
        The recorded cloud, with GPS times and scan angles: points, or a file, LAS or LAZ.
    output : str or path-like
        The pipeline file to write.
    flight_line : int or str, optional
        The point source of the flight line that is fitted, such as 7, or one of several of a source by its number in the order
        of time, such as "7.2"; by default the one with the most points.
    extend : float
        Seconds that the written flight goes on after the recording: straight, with the last attitude, and with the pulses
        that follow from the patterns that were found.
    force : bool
        Replace existing files.
    max_memory : int, optional
        Bytes that the points may take, by default 1 GiB. Of a flight line with more points the scan lines of one second in
        2, 3 … are fitted, with a warning.

    Returns
    -------
    dict of str to Fitted
        Value, standard deviation (or None) and unit of each estimated quantity, by its name.

    Raises
    ------
    InputError
        The cloud has no times or scan angles, or no flight meets its points.
    FileError
        A file cannot be read or exists.
    """
    with _file_of(cloud) as name:
        line = None if flight_line is None else str(flight_line)
        _, figures = _vlscan.fit_flight(name, path_of("output", output), line, extend, force, max_memory)
    return {figure["name"]: Fitted(figure["value"], figure["deviation"], figure["unit"]) for figure in json.loads(figures)}


@suggesting
def fit_sensor(
    revolution: PathLike,
    calibration: PathLike,
    output: PathLike,
    *,
    half: Literal["even", "odd"] = "even",
    planes: PathLike | None = None,
    force: bool = False,
) -> dict[str, Any]:
    """Estimate range noise, detection and dropouts of a spinning sensor, and write it as a pipeline file.

    They are estimated from the planes that one revolution shows.

    Parameters
    ----------
    revolution : str or path-like
        The recorded revolution: Parquet with the columns beam, column, range_mm, reflectivity and, if there is one, signal.
    calibration : str or path-like
        The calibration file that the Ouster sensor writes of itself, JSON.
    output : str or path-like
        The pipeline file to write.
    half : {"even", "odd"}
        The columns of the revolution that are fitted; the others test the fit.
    planes : str or path-like, optional
        The mesh (OBJ) to write the planes to; it becomes the scene of the pipeline file.
    force : bool
        Overwrite files that exist.

    Returns
    -------
    dict
        The estimates, as ``vlscan fit --json`` writes them.

    Raises
    ------
    InputError
        The recording is not one of this sensor, or has too few planes.
    FileError
        A file cannot be read or exists.
    """
    if half not in ("even", "odd"):
        raise ValueError(f'half is {half!r}, expected "even" or "odd"')
    figures: dict[str, Any] = json.loads(
        _vlscan.fit_sensor(
            path_of("revolution", revolution),
            path_of("calibration", calibration),
            path_of("output", output),
            half == "odd",
            None if planes is None else path_of("planes", planes),
            force,
        )
    )
    return figures


class Reconstruction(Facts[Any]):
    """A scene that was estimated from a point cloud: a mapping with the keys of ``report.json``.

    Parameters
    ----------
    report : dict
        The estimates.
    folder : Path
        The folder of the scene.

    Attributes
    ----------
    folder : Path
        The folder.
    """

    def __init__(self, report: dict[str, Any], folder: Path) -> None:
        super().__init__(report)
        self.folder = folder

    @property
    def scene(self) -> Scene:
        """The scene."""
        return Scene(self.folder / "scene.xml")

    @property
    def pipeline(self) -> Path:
        """The pipeline with scene and instrument."""
        return self.folder / "scene.toml"

    @property
    def trajectory(self) -> Path:
        """The estimated trajectory."""
        return self.folder / "trajectory.csv"

    def __repr__(self) -> str:
        return f"<Reconstruction in {self.folder}: {', '.join(self)}>"


@suggesting
def reconstruct(
    cloud: TableLike | PathLike, folder: PathLike, *, voxel: float | None = None, divergence: float = 0.00025, force: bool = False
) -> Reconstruction:
    """Reconstruct a scene from a classified point cloud: terrain, roofs with walls, foliage as voxels of leaf area.

    Parameters
    ----------
    cloud : Points, table, str or path-like
        The cloud, with classes, return numbers and times: points, or a file, LAS or LAZ.
    folder : str or path-like
        The folder that gets ``scene.xml``, ``scene.toml`` with scene and instrument, ``trajectory.csv`` and ``report.json``.
    voxel : float, optional
        Edge of the voxels of foliage, m. By default the mean distance between pulses, 0.3 to 0.75.
    divergence : float
        Divergence of the beam that recorded the cloud, full angle at 1/e² of the intensity, rad.
    force : bool
        If set, existing files are replaced.

    Returns
    -------
    Reconstruction
        The estimates, and the scene.

    Raises
    ------
    InputError
        The cloud cannot be read or has no ground.
    """
    with _file_of(cloud) as name:
        report: dict[str, Any] = json.loads(_vlscan.reconstruct(name, path_of("folder", folder), voxel, divergence, force))
    return Reconstruction(report, Path(folder))


@contextmanager
def _file_of(cloud: TableLike | PathLike) -> Iterator[str]:
    """Yield the name of a file of a cloud."""
    if isinstance(cloud, (str, os.PathLike)):
        yield os.fspath(cloud)
        return
    points = cloud if isinstance(cloud, Points) else Points.of(cloud)
    with temporary_folder() as folder:
        path = os.path.join(folder, "points.laz")
        points.write(path)
        yield path
