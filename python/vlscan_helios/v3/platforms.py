"""Platforms: by name, from files, and those that follow recorded trajectories."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vlscan import catalogue

from .scanner import Named, by_attribute, find
from .settings import find_asset

#: Fields of a trajectory.
FIELDS = ("t", "roll", "pitch", "yaw", "x", "y", "z")


class Platform(Named):
    """What carries the scanner.

    Parameters
    ----------
    reference : str
        ``file.xml#id``.
    name : str
        Name.
    """

    def __init__(self, reference: str, name: str) -> None:
        super().__init__(reference, name)
        #: Recorded poses of the fields t (s), roll, pitch, yaw (rad), x, y, z (m).
        self.trajectory: NDArray[np.void] | None = None
        self.rotation_spec, self.sync_gps_time, self.position_only = "ARINC 705", False, False

    @classmethod
    def from_xml(cls, platform_file: str | os.PathLike[str], platform_id: str | None = None) -> Platform:
        """Return a platform of a file.

        Parameters
        ----------
        platform_file : str or path-like
            The file.
        platform_id : str, optional
            Its id; the first by default.

        Returns
        -------
        Platform
            The platform.
        """
        return cls._of_file(platform_file, platform_id)

    @classmethod
    def load_interpolate_platform(
        cls,
        trajectory: ArrayLike,
        platform_file: str | os.PathLike[str] | None = None,
        interpolation_method: str = "ARINC 705",
        sync_gps_time: bool = False,
        interpolation_domain: str = "position_and_attitude",
        platform_id: str | None = None,
        **unknown: Any,
    ) -> Platform:
        """Return a platform that follows recorded poses.

        Parameters
        ----------
        trajectory : array_like
            An array of :func:`load_traj_csv`.
        platform_file : str or path-like, optional
            File of the platform whose mount and noise it has.
        interpolation_method : str
            Meaning of the angles: ``ARINC 705`` or ``CANONICAL``.
        sync_gps_time : bool
            Whether points have the times of the trajectory.
        interpolation_domain : str
            ``position_and_attitude`` or ``position``.
        platform_id : str, optional
            Id of the platform in its file.
        **unknown : Any
            Refused.

        Returns
        -------
        Platform
            The platform.

        Raises
        ------
        ValueError
            Another method, missing fields, or unknown keywords.
        """
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


def load_traj_csv(
    csv: str | os.PathLike[str],
    tIndex: int = 0,
    rollIndex: int = 1,
    pitchIndex: int = 2,
    yawIndex: int = 3,
    xIndex: int = 4,
    yIndex: int = 5,
    zIndex: int = 6,
    trajectory_separator: str = ",",
    to_radians: bool = True,
    **unknown: Any,
) -> NDArray[np.void]:
    """Read a trajectory of text. Lines that begin with ``#`` are passed over.

    Parameters
    ----------
    csv : str or path-like
        The file.
    tIndex, rollIndex, pitchIndex, yawIndex, xIndex, yIndex, zIndex : int
        Columns, from 0.
    trajectory_separator : str
        Character between columns.
    to_radians : bool
        Whether angles are degrees, and become radians.
    **unknown : Any
        Refused.

    Returns
    -------
    numpy.ndarray
        A structured array with the fields t (s), roll, pitch, yaw (rad), x, y, z (m).

    Raises
    ------
    ValueError
        Too few columns, or unknown keywords.
    """
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
    """Return a platform that ships.

    Parameters
    ----------
    platform_name : str
        Its name, whatever its hyphens, underscores and capitals.

    Returns
    -------
    Platform
        The platform.

    Raises
    ------
    ValueError
        No platform has the name.
    """
    known = {name: name for name in catalogue.platforms()}
    key = find(platform_name, known, "platform")
    return Platform(catalogue.platform_reference(key), key)


def list_platforms() -> list[str]:
    """List the platforms that ship.

    Returns
    -------
    list of str
        Their names.
    """
    return catalogue.platforms()


__getattr__ = by_attribute(platform_from_name)
