"""Around runs: surveys that are planned, campaigns of many runs, clouds that are compared."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from . import _vlscan
from .scene import PathLike
from .survey import columns_of
from .tables import Points

#: The corners of a polygon, x and y in m; a file of GeoJSON, KML or well-known text; or well-known text itself.
Area = PathLike | Sequence[Sequence[float]]


@dataclass(frozen=True)
class Plan:
    """A planned survey."""

    #: The pipeline file, which ``vlscan run`` flies.
    text: str
    #: What the plan promises: duration, pulses, density, spacing, footprint.
    promises: list[str]
    #: What there is to know of it.
    warnings: list[str]

    def save(self, path: PathLike) -> None:
        """Writes the pipeline file."""
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
    """Plans parallel flight lines over an area, ``height`` m above the ground; the options are those of ``vlscan plan airborne``.

    ``speed`` (m/s) or ``density`` (pulses/m²) is needed; ``overlap`` is percent of the swath, angles are degrees."""
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
    """Plans positions of a tripod, on a grid (``spacing`` m) over an area or ``around`` a plot; the options are those of
    ``vlscan plan terrestrial``."""
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
    """Plans a drive along a line: a file, or well-known text; the options are those of ``vlscan plan mobile``."""
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
    """The state of a campaign's data set."""

    #: Cells that the call has computed, and how long it took, s.
    computed: int
    seconds: float
    #: Cells of the campaign, and those of them that are neither complete nor failed.
    cells: int
    left: int
    #: Points of all cells.
    points: int
    #: The manifest, which is written when no cell is left.
    manifest: os.PathLike[str] | None
    #: Names of the cells that have failed, each with the reason.
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
    """Computes the cells of a campaign that are left, as ``vlscan campaign`` does. A cell that fails stops no other.

    ``notify`` is called with the kind of an event (``warning``, ``damaged``, ``completed``, ``failed``), the name of the cell, and a
    text. The campaign's folder is the working directory of the process meanwhile."""
    fields = {"task": task, "cells": list(cells), "retry": retry, "verify": verify, "threads": threads, "strict": strict}
    return CampaignReport(**_vlscan.run_campaign(os.fspath(path), fields, notify))


def compare(
    first: Points | PathLike,
    second: Points | PathLike,
    *,
    cell: float = 1.0,
    voxel: float = 0.5,
    most_distances: int = 200_000,
) -> dict[str, Any]:
    """Compares two point clouds of one place, each a file or the points of a run: density, heights, canopy, change, intensity,
    returns, distances from cloud to cloud, occupied voxels. Returns what ``vlscan compare --json`` writes."""

    def named(cloud: Any, name: str) -> tuple[str, Any]:
        if isinstance(cloud, (str, os.PathLike)):
            return os.fspath(cloud), None
        return name, columns_of(cloud, ("X", "Y", "Z"))

    clouds = named(first, "first"), named(second, "second")
    return json.loads(_vlscan.compare(*clouds, cell, voxel, most_distances))
