"""Around runs: surveys that are planned, campaigns of many runs, clouds that are compared."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from . import _vlscan
from ._typing import PathLike, TableLike
from .survey import columns_of

#: The corners of a polygon, x and y in m; a file of GeoJSON, KML or well-known text; or well-known text itself.
Area: TypeAlias = PathLike | Sequence[Sequence[float]]


@dataclass(frozen=True)
class Plan:
    """A planned survey.

    Parameters
    ----------
    text : str
        The pipeline file, which ``vlscan run`` flies.
    promises : list of str
        What the plan promises: duration, pulses, density, spacing, footprint.
    warnings : list of str
        What there is to know of it.
    """

    text: str
    promises: list[str]
    warnings: list[str]

    def save(self, path: PathLike) -> None:
        """Write the pipeline file.

        Parameters
        ----------
        path : str or path-like
            The file, ``.toml``.
        """
        with open(path, "w", encoding="utf-8") as file:
            file.write(self.text)


def plan_airborne(
    scanner: str,
    height: float,
    *,
    area: Area | None = None,
    buffer: float | None = None,
    speed: float | None = None,
    density: float | None = None,
    overlap: float | None = None,
    scan_angle: float | None = None,
    scan_freq: float | None = None,
    heading: float | None = None,
    cross_lines: int = 0,
    run_in: float | None = None,
    turn_radius: float | None = None,
    follow_terrain: bool = False,
    climb: float | None = None,
    platform: str | None = None,
    scene: PathLike | None = None,
    ground: float | None = None,
    pulse_rate: int | None = None,
    assets: Iterable[PathLike] = (),
) -> Plan:
    """Plan parallel flight lines over an area, with the options of ``vlscan plan airborne``.

    Parameters
    ----------
    scanner : str
        Id of the scanner.
    height : float
        Height above the ground, m.
    area : sequence, str or path-like, optional
        Corners of a polygon, a file, or well-known text; the scene by default.
    buffer : float, optional
        Make the area a corridor: everything within this distance of the line, m.
    speed, density : float, optional
        Speed, m/s, and mean pulses per m²; one of them is needed.
    overlap : float, optional
        Overlap of neighbouring strips, percent of the swath.
    scan_angle, scan_freq : float, optional
        Half opening angle, degrees, and scan frequency, Hz.
    heading : float, optional
        Direction of the lines, degrees clockwise from +y; by default the one with the fewest lines.
    cross_lines : int
        Number of cross lines, perpendicular to the others and evenly spread.
    run_in : float, optional
        Length by which lines begin before the area and end behind it, m.
    turn_radius : float, optional
        Radius of turns between lines, m; by default the flight is straight to the next line.
    follow_terrain : bool
        Whether the height is above the scene's ground instead of above its mean.
    climb : float, optional
        Steepest climb with ``follow_terrain``, degrees.
    platform : str, optional
        Id of the platform; the usual one of the scanner by default.
    scene : str or path-like, optional
        The scene, for the heights of its ground.
    ground : float, optional
        Height of the ground where no scene tells it, m; tripods and vehicles stand on it even if a scene does.
    pulse_rate : int, optional
        Pulses per second; the scanner's first by default.
    assets : iterable of str or path-like
        Folders in which files are searched.

    Returns
    -------
    Plan
        The plan.

    Raises
    ------
    InputError
        The options are missing, invalid, or beyond what the instrument can do.
    """
    return _plan("airborne", dict(locals()))


def plan_terrestrial(
    scanner: str,
    *,
    area: Area | None = None,
    spacing: float | None = None,
    around: tuple[float, float] | None = None,
    radius: float | None = None,
    positions: int | None = None,
    at_centre: bool = False,
    resolution: float = 0.04,
    platform: str | None = None,
    scene: PathLike | None = None,
    ground: float | None = None,
    pulse_rate: int | None = None,
    assets: Iterable[PathLike] = (),
) -> Plan:
    """Plan positions of a tripod over an area or around a plot, with the options of ``vlscan plan terrestrial``.

    Parameters
    ----------
    scanner : str
        Id of the scanner.
    area : sequence, str or path-like, optional
        Corners of a polygon, a file, or well-known text; the scene by default.
    spacing : float, optional
        Distance of the positions on a grid, m.
    around : tuple of float, optional
        Centre of a plot, m.
    radius : float, optional
        Its radius, m.
    positions : int, optional
        Number of positions around it.
    at_centre : bool
        Whether there is one at its centre, too.
    resolution : float
        Angle between points, degrees.
    platform : str, optional
        Id of the platform; the usual one of the scanner by default.
    scene : str or path-like, optional
        The scene, for the heights of its ground.
    ground : float, optional
        Height of the ground where no scene tells it, m; tripods and vehicles stand on it even if a scene does.
    pulse_rate : int, optional
        Pulses per second; the scanner's first by default.
    assets : iterable of str or path-like
        Folders in which files are searched.

    Returns
    -------
    Plan
        The plan.

    Raises
    ------
    InputError
        The options are missing, invalid, or beyond what the instrument can do.
    """
    return _plan("terrestrial", dict(locals()))


def plan_mobile(
    scanner: str,
    along: PathLike,
    *,
    speed: float = 10.0,
    scan_angle: float | None = None,
    scan_freq: float | None = None,
    step: float = 20.0,
    platform: str | None = None,
    scene: PathLike | None = None,
    ground: float | None = None,
    pulse_rate: int | None = None,
    assets: Iterable[PathLike] = (),
) -> Plan:
    """Plan a drive along a line, with the options of ``vlscan plan mobile``.

    Parameters
    ----------
    scanner : str
        Id of the scanner.
    along : str or path-like
        The line: a file, or well-known text.
    speed : float
        Speed, m/s.
    scan_angle, scan_freq : float, optional
        Half opening angle, degrees, and scan frequency, Hz.
    step : float
        Maximum distance between waypoints, where the vehicle is placed on the scene's ground, m.
    platform : str, optional
        Id of the platform; the usual one of the scanner by default.
    scene : str or path-like, optional
        The scene, for the heights of its ground.
    ground : float, optional
        Height of the ground where no scene tells it, m; tripods and vehicles stand on it even if a scene does.
    pulse_rate : int, optional
        Pulses per second; the scanner's first by default.
    assets : iterable of str or path-like
        Folders in which files are searched.

    Returns
    -------
    Plan
        The plan.

    Raises
    ------
    InputError
        The options are missing, invalid, or beyond what the instrument can do.
    """
    return _plan("mobile", dict(locals()))


def _plan(kind: str, fields: dict[str, Any]) -> Plan:
    for name in ("area", "along", "scene"):
        if isinstance(fields.get(name), os.PathLike):
            fields[name] = os.fspath(fields[name])
    if fields.get("area") is not None and not isinstance(fields["area"], str):
        fields["area"] = [[float(x), float(y)] for x, y in fields["area"]]
    fields["assets"] = [os.fspath(folder) for folder in fields["assets"]]
    return Plan(*_vlscan.plan(kind, fields))


@dataclass(frozen=True)
class CampaignReport:
    """The state of a campaign's data set.

    Parameters
    ----------
    computed : int
        Cells that the call has computed.
    seconds : float
        How long it took, s.
    cells : int
        Cells of the campaign.
    left : int
        Those of them that are neither complete nor failed.
    points : int
        Points of all cells.
    manifest : path-like or None
        The manifest, which is written when no cell is left.
    failed : list of tuple
        Names of the cells that have failed, each with the reason.
    """

    computed: int
    seconds: float
    cells: int
    left: int
    points: int
    manifest: os.PathLike[str] | None
    failed: list[tuple[str, str]]


def run_campaign(
    path: PathLike,
    *,
    task: tuple[int, int] | None = None,
    cells: Iterable[str] = (),
    retry: bool = False,
    verify: bool = False,
    threads: int | None = None,
    strict: bool = False,
    notify: Callable[[str, str, str], object] | None = None,
) -> CampaignReport:
    """Compute the cells of a campaign that are left, as ``vlscan campaign`` does. A cell that fails stops no other.

    The campaign's folder is the working directory of the process meanwhile, so that a process computes one campaign at a time.

    Parameters
    ----------
    path : str or path-like
        The campaign's file.
    task : tuple of int, optional
        K and N: every N-th cell only, from cell K on, with K from 0 to N-1.
    cells : iterable of str
        Names of the cells; all by default.
    retry : bool
        Whether cells that have failed are computed again.
    verify : bool
        Whether the checksums of all files of complete cells are compared.
    threads : int, optional
        Threads of this process; all by default.
    strict : bool
        Whether warnings about the input are errors.
    notify : callable, optional
        Called with the kind of an event (``warning``, ``damaged``, ``completed``, ``failed``), the name of the cell, and a text.

    Returns
    -------
    CampaignReport
        The state of the data set.

    Raises
    ------
    InputError
        The campaign is invalid, or has no such cell.
    """
    fields = {"task": task, "cells": list(cells), "retry": retry, "verify": verify, "threads": threads, "strict": strict}
    return CampaignReport(**_vlscan.run_campaign(os.fspath(path), fields, notify))


def compare(
    first: TableLike | PathLike,
    second: TableLike | PathLike,
    *,
    cell: float = 1.0,
    voxel: float = 0.5,
    most_distances: int = 200_000,
    chance: bool = False,
    terrain: PathLike | None = None,
) -> dict[str, Any]:
    """Compare two point clouds of one place: heights, returns, pulses, scan lines, residuals to a terrain, change of the ground and more.

    Parameters
    ----------
    first, second : Points, table, str or path-like
        The clouds: the points of a run, or a file.
    cell : float
        Side of the cells of density, canopy height and change, m.
    voxel : float
        Side of the voxels whose occupancy is compared, m.
    most_distances : int
        Most points of each cloud whose distance to the other and height above the terrain are measured.
    chance : bool
        Whether each figure comes with what chance alone gives: the largest difference between random halves of the first cloud.
    terrain : str or path-like, optional
        A raster or mesh that heights and residuals refer to; by default the ground points of the first cloud.

    Returns
    -------
    dict
        What ``vlscan compare --json`` writes.

    Raises
    ------
    InputError
        A cloud cannot be compared.
    """

    def named(cloud: TableLike | PathLike, name: str) -> tuple[str, object]:
        if isinstance(cloud, (str, os.PathLike)):
            return os.fspath(cloud), None
        return name, columns_of(cloud, ("X", "Y", "Z"))

    fields: dict[str, object] = {
        "cell": cell,
        "voxel": voxel,
        "most_distances": most_distances,
        "chance": chance,
        "terrain": None if terrain is None else os.fspath(terrain),
    }
    compared: dict[str, Any] = json.loads(_vlscan.compare(named(first, "first"), named(second, "second"), fields))
    return compared


def fit_flight(
    cloud: PathLike,
    output: PathLike,
    *,
    flight_line: int | None = None,
    extend: float = 0.0,
    force: bool = False,
) -> dict[str, tuple[float, float | None, str]]:
    """Estimate a flight and its scanner from a recorded point cloud, and write them as a pipeline file.

    The trajectory, the wander of a cone's mirror and times of pulses are written beside the pipeline file.

    Parameters
    ----------
    cloud : str or path-like
        The recorded cloud, with GPS times and scan angles: LAS or LAZ.
    output : str or path-like
        The pipeline file to write.
    flight_line : int, optional
        The point source of the flight line that is fitted; by default the one with the most points.
    extend : float
        Seconds that the written flight goes on after the recording: straight, with the last attitude, and with the pulses
        that follow from the patterns that were found.
    force : bool
        Replace existing files.

    Returns
    -------
    dict
        Value, standard deviation (or None) and unit of each estimated quantity, by its name.

    Raises
    ------
    InputError
        The cloud has no times or scan angles, or no flight meets its points.
    FileError
        A file cannot be read or exists.
    """
    _, figures = _vlscan.fit_flight(os.fspath(cloud), os.fspath(output), flight_line, extend, force)
    return {figure["name"]: (figure["value"], figure["deviation"], figure["unit"]) for figure in json.loads(figures)}


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
        What was estimated, as ``vlscan fit --json`` writes it.

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
            os.fspath(revolution),
            os.fspath(calibration),
            os.fspath(output),
            half == "odd",
            None if planes is None else os.fspath(planes),
            force,
        )
    )
    return figures


def reconstruct(
    cloud: PathLike, folder: PathLike, *, voxel: float | None = None, divergence: float = 0.00025, force: bool = False
) -> dict[str, Any]:
    """Reconstruct a scene from a classified point cloud: terrain, roofs with walls, foliage as voxels of leaf area.

    Parameters
    ----------
    cloud : str or path-like
        The cloud, LAS or LAZ with classes, return numbers and times.
    folder : str or path-like
        The folder that gets ``scene.xml``, ``scene.toml`` with scene and instrument, ``trajectory.csv`` and ``report.json``.
    voxel : float, optional
        Edge of the voxels of foliage, m. By default the mean distance between pulses, 0.3 to 0.75.
    divergence : float
        Divergence of the beam that recorded the cloud, full angle at 1/e² of the intensity, rad.
    force : bool
        Whether files that exist are replaced.

    Returns
    -------
    dict
        What was estimated, as ``report.json`` has it.

    Raises
    ------
    InputError
        The cloud cannot be read or has no ground.
    """
    found: dict[str, Any] = json.loads(_vlscan.reconstruct(os.fspath(cloud), os.fspath(folder), voxel, divergence, force))
    return found
