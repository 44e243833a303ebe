"""Platforms: by name, from files, and those that follow recorded trajectories."""

from __future__ import annotations

import os
from copy import copy
from typing import Any

import numpy as np

from .. import catalogue
from .scanner import by_attribute, find
from .settings import find_asset

#: Fields of a trajectory.
FIELDS = ("t", "roll", "pitch", "yaw", "x", "y", "z")


class Platform:
    """What carries the scanner."""

    def __init__(self, reference: str, name: str) -> None:
        self.reference, self.name = reference, name
        #: Recorded poses of the fields t (s), roll, pitch, yaw (rad), x, y, z (m).
        self.trajectory: np.ndarray | None = None
        self.rotation_spec, self.sync_gps_time, self.position_only = "ARINC 705", False, False

    @classmethod
    def from_xml(cls, platform_file: str | os.PathLike[str], platform_id: str | None = None) -> Platform:
        """A platform of a file: the one with the id, else the first."""
        file = find_asset(platform_file)
        return cls(file if platform_id is None else f"{file}#{platform_id}", platform_id or os.path.basename(file))

    @classmethod
    def load_interpolate_platform(
        cls,
        trajectory: Any,
        platform_file: str | os.PathLike[str] | None = None,
        interpolation_method: str = "ARINC 705",
        sync_gps_time: bool = False,
        interpolation_domain: str = "position_and_attitude",
        platform_id: str | None = None,
        **unknown: Any,
    ) -> Platform:
        """A platform that follows recorded poses: an array of :func:`load_traj_csv`. ``platform_file`` and ``platform_id`` name the
        platform whose mount and noise it has."""
        if unknown:
            raise ValueError(f"load_interpolate_platform() has no {', '.join(map(repr, unknown))}")
        if interpolation_method.upper().replace("_", " ") not in ("ARINC 705", "CANONICAL"):
            raise ValueError(f"interpolation_method is {interpolation_method!r}, expected 'ARINC 705' or 'CANONICAL'")
        base = "" if platform_file is None else cls.from_xml(platform_file, platform_id).reference
        platform = cls(base, "interpolated")
        poses = np.asarray(trajectory)
        if poses.dtype.names is None or not set(FIELDS) <= set(poses.dtype.names):
            raise ValueError(f"a trajectory needs the fields {', '.join(FIELDS)}; load_traj_csv() makes them")
        platform.trajectory = poses
        platform.rotation_spec = interpolation_method.upper().replace("_", " ")
        platform.sync_gps_time, platform.position_only = sync_gps_time, interpolation_domain == "position"
        return platform

    def clone(self) -> Platform:
        """A copy."""
        return copy(self)

    def __repr__(self) -> str:
        return f"Platform({self.name!r})"


def load_traj_csv(
    csv: str | os.PathLike[str],
    tIndex: int = 0,  # noqa: N803
    rollIndex: int = 1,  # noqa: N803
    pitchIndex: int = 2,  # noqa: N803
    yawIndex: int = 3,  # noqa: N803
    xIndex: int = 4,  # noqa: N803
    yIndex: int = 5,  # noqa: N803
    zIndex: int = 6,  # noqa: N803
    trajectory_separator: str = ",",
    to_radians: bool = True,
    **unknown: Any,
) -> np.ndarray:
    """Reads a trajectory of text: columns by their indices from 0, angles in degrees unless ``to_radians`` is false. Lines that
    begin with ``#`` are passed over."""
    if unknown:
        raise ValueError(f"load_traj_csv() has no {', '.join(map(repr, unknown))}")
    numbers = np.loadtxt(find_asset(csv), delimiter=trajectory_separator, ndmin=2)
    indices = dict(zip(FIELDS, (tIndex, rollIndex, pitchIndex, yawIndex, xIndex, yIndex, zIndex), strict=True))
    if max(indices.values()) >= numbers.shape[1]:
        raise ValueError(f"{os.fspath(csv)} has {numbers.shape[1]} columns, expected at least {max(indices.values()) + 1}")
    poses = np.empty(len(numbers), dtype=[(name, "f8") for name in FIELDS])
    for name, index in indices.items():
        values = numbers[:, index]
        poses[name] = np.radians(values) if to_radians and name in ("roll", "pitch", "yaw") else values
    return poses


def platform_from_name(platform_name: str) -> Platform:
    """A platform that ships."""
    known = {name: name for name in catalogue.platforms()}
    key = find(platform_name, known, "platform")
    return Platform(catalogue.platform_reference(key), key)


def list_platforms() -> list[str]:
    """Names of the platforms that ship."""
    return catalogue.platforms()


__getattr__ = by_attribute(platform_from_name)
