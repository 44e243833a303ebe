"""Platforms: by name, from files, and those that follow recorded trajectories; where legs begin."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, PrivateAttr, validate_call
from typing_extensions import Self

from vlscan import Error, catalogue
from vlscan.errors import warn

from .errors import WrongTypeError, engine_errors, wrong_input
from .scanner import Named, by_attribute, check_id, find, instrument_function, reference_in
from .utils import classonlymethod, existing_file
from .validation import Coordinate, Model, Speed, TimePoint, UpdateableMixin

if TYPE_CHECKING:
    from .scene import StaticScene

#: A row of a trajectory: time (s), angles, position (m).
traj_csv_dtype: np.dtype[np.void] = np.dtype(
    [("t", "f8"), ("roll", "f8"), ("pitch", "f8"), ("yaw", "f8"), ("x", "f8"), ("y", "f8"), ("z", "f8")]
)

_ANGLES = ("roll", "pitch", "yaw")

# Names of the platforms, and their ids in the catalogue.
_NAMES = {
    "sr22": "sr22",
    "quadcopter": "quadcopter",
    "copter_linearpath": "copter_linearpath",
    "tractor": "tractor",
    "tractor_leftside": "tractor_leftside",
    "vehicle_linearpath": "vehicle_linearpath",
    "vmx_450_car_left": "vmx-450-car-left",
    "vmx_450_car_right": "vmx-450-car-right",
    "vmq_1ha_car": "vmq-1ha-car-0",
    "simple_linearpath": "simple_linearpath",
    "tripod": "tripod",
}

_Column = Annotated[int, Field(strict=True, ge=0, le=6)]


class Printable:
    """Settings that print as a list of their values."""

    def __str__(self) -> str:
        values = {name: getattr(self, name) for name in getattr(type(self), "model_fields", {})}
        # Settings within settings are indented below their name.
        lines = (f"{name}: {value}".replace("\n", "\n  ") for name, value in values.items())
        return "\n".join([type(self).__name__, *(f"  {line}" for line in lines)])


class PlatformSettingsBase(Printable, Model, UpdateableMixin):
    """Start of a leg, and motion of the platform."""


class TrajectorySettings(PlatformSettingsBase):
    """The part of a trajectory that a leg flies, on the trajectory's own time; 0 to 0 is all of it."""

    start_time: TimePoint = 0
    end_time: TimePoint = 0
    teleport_to_start: bool = False


class PlatformSettings(PlatformSettingsBase):
    """Start of a leg, world frame, m."""

    x: Coordinate = 0
    y: Coordinate = 0
    z: Coordinate = 0

    def do_force_on_ground(self, scene: StaticScene) -> None:
        """Set ``z`` to the height of the ground.

        Parameters
        ----------
        scene : StaticScene
            The scene, which is loaded.

        Raises
        ------
        ValueError
            The scene has no ground at ``x``, ``y``.
        """
        with engine_errors():
            height = scene.engine().ground_height(self.x, self.y)
        if height is None:
            raise ValueError(f"the scene has no ground at x = {self.x:g}, y = {self.y:g}; a part is ground if a material has is_ground")
        self.z = height


class StaticPlatformSettings(PlatformSettingsBase):
    """Position of a platform that stands, world frame, m."""

    x: Coordinate = 0
    y: Coordinate = 0
    z: Coordinate = 0
    force_on_ground: bool = False


class DynamicPlatformSettings(PlatformSettings):
    """Start of a leg, world frame, m, and speed of the platform on the way to the next one, m/s."""

    trajectory_settings: TrajectorySettings = Field(default_factory=TrajectorySettings)
    speed_m_s: Speed = 70
    force_on_ground: bool = False


class Platform(Named):
    """The carrier of a scanner: see :func:`platform_from_name`, :func:`list_platforms` and :meth:`from_xml`."""

    platform_settings: PlatformSettingsBase | None = None
    _trajectory: NDArray[np.void] | None = PrivateAttr(None)
    _rotation_spec: str = PrivateAttr("ARINC 705")
    _sync_gps_time: bool = PrivateAttr(False)
    # Whether it follows poses that the legs of a survey file name.
    _follows_file: bool = PrivateAttr(False)
    # Whether it stands, where that is known from its file.
    _is_static: bool | None = PrivateAttr(None)

    @property
    def trajectory(self) -> NDArray[np.void] | None:
        """Recorded poses (:data:`traj_csv_dtype`, rad) that the platform follows; ``None`` for one that has none in memory."""
        return self._trajectory

    @property
    def rotation_spec(self) -> str:
        """Meaning of the recorded angles."""
        return self._rotation_spec

    @property
    def sync_gps_time(self) -> bool:
        """True if points have the times of the recorded poses."""
        return self._sync_gps_time

    @property
    def is_static(self) -> bool:
        """True if it does not move between legs."""
        if self._trajectory is not None or self._follows_file:
            return False
        if self._is_static is None:
            self._is_static = _stands(self._reference)
        return self._is_static

    @property
    def follows_file(self) -> bool:
        """True if it follows poses that the legs of a survey file name."""
        return self._follows_file

    def flown(
        self,
        trajectory: NDArray[np.void] | None = None,
        follows_file: bool = False,
        rotation_spec: str = "ARINC 705",
        sync_gps_time: bool = False,
        is_static: bool | None = None,
    ) -> Self:
        """Set how it moves.

        Parameters
        ----------
        trajectory : numpy.ndarray, optional
            Poses of :data:`traj_csv_dtype` that it follows.
        follows_file : bool
            True if it follows poses that the legs of a survey file name.
        rotation_spec : str
            Meaning of the angles of poses.
        sync_gps_time : bool
            True if points have the times of the poses.
        is_static : bool, optional
            True if it stands, where that is known from its file.

        Returns
        -------
        Platform
            Itself.
        """
        self._trajectory, self._follows_file, self._is_static = trajectory, follows_file, is_static
        self._rotation_spec, self._sync_gps_time = rotation_spec, sync_gps_time
        return self

    def _identity(self) -> object:
        poses = None if self._trajectory is None else self._trajectory.tobytes()
        return self._reference, poses, self._rotation_spec, self._sync_gps_time, self._follows_file

    @classonlymethod
    def from_xml(cls, platform_file: str | os.PathLike[str], platform_id: str = "") -> Platform:
        """Return a platform of a file.

        Parameters
        ----------
        platform_file : str or path-like
            The file.
        platform_id : str
            Its id; the first by default.

        Returns
        -------
        Platform
            The platform.

        Raises
        ------
        ValueError
            No platform of the file has the id.
        FileNotFoundError
            There is no such file.
        """
        reference = reference_in(platform_file, platform_id)
        if platform_id:
            check_id(catalogue.platform_kind, reference, "platform")
        return cls.of_reference(reference, platform_id or os.path.basename(platform_file))

    @classonlymethod
    def load_interpolate_platform(
        cls,
        trajectory: ArrayLike,
        platform_file: str | os.PathLike[str],
        platform_id: str = "",
        interpolation_method: Literal["CANONICAL", "ARINC 705"] = "ARINC 705",
        sync_gps_time: bool = False,
        is_roll_pitch_yaw_in_radians: bool = True,
    ) -> Platform:
        """Return a platform that follows recorded poses.

        Parameters
        ----------
        trajectory : array_like
            An array of :func:`load_traj_csv`, a trajectory that a run returned, or rows of t, roll, pitch, yaw, x, y, z.
        platform_file : str or path-like
            File of the platform whose mount and noise it has.
        platform_id : str
            Id of the platform in its file; the first by default.
        interpolation_method : str
            Meaning of the angles: ``ARINC 705`` or ``CANONICAL``.
        sync_gps_time : bool
            True if points have the times of the trajectory.
        is_roll_pitch_yaw_in_radians : bool
            True if the angles are radians; else they are degrees.

        Returns
        -------
        Platform
            The platform.

        Raises
        ------
        ValueError
            Another method, an array of another type, or no platform of the file has the id.
        FileNotFoundError
            There is no such file.
        """
        if interpolation_method not in ("ARINC 705", "CANONICAL"):
            raise wrong_input(f"interpolation_method is {interpolation_method!r}, expected 'ARINC 705' or 'CANONICAL'")
        poses = _poses(trajectory)
        if not is_roll_pitch_yaw_in_radians:
            for angle in _ANGLES:
                poses[angle] = np.radians(poses[angle])
        platform: Platform = cls.from_xml(platform_file, platform_id)
        return platform.flown(poses, rotation_spec=interpolation_method, sync_gps_time=bool(sync_gps_time))

    def following(self, trajectory: ArrayLike) -> Platform:
        """Return the platform, with its mount and noise, following recorded poses.

        Parameters
        ----------
        trajectory : array_like
            As for :meth:`load_interpolate_platform`, angles in rad.

        Returns
        -------
        Platform
            The platform.

        Raises
        ------
        ValueError
            An array of another type.
        """
        spec, is_synchronous = self._rotation_spec, self._sync_gps_time
        return self.clone().flown(_poses(trajectory), False, spec, is_synchronous, self._is_static)


def _stands(reference: str) -> bool:
    """Return whether a platform stands; the engine tells when it is run what is wrong with one that it cannot read."""
    try:
        return bool(reference) and catalogue.platform_kind(reference) == "static"
    except Error:
        return False


def _poses(trajectory: ArrayLike) -> NDArray[np.void]:
    """Return a copy of a trajectory as :data:`traj_csv_dtype`."""
    given = np.asarray(trajectory)
    if given.ndim == 0:
        raise WrongTypeError(f"a trajectory is an array of poses, found {type(trajectory).__name__}")
    names = set(given.dtype.names or ())
    poses = np.empty(len(given), dtype=traj_csv_dtype)
    columns: dict[str, Any]
    if set(traj_csv_dtype.names or ()) <= names:
        columns = {name: given[name] for name in traj_csv_dtype.names or ()}
    elif {"gps_time", "position", *_ANGLES} <= names:
        columns = {"t": given["gps_time"], **{name: given[name] for name in _ANGLES}}
        columns |= {axis: given["position"][:, index] for index, axis in enumerate("xyz")}
    elif not names and given.ndim == 2 and given.shape[1] == 7:
        columns = {name: given[:, index] for index, name in enumerate(traj_csv_dtype.names or ())}
    else:
        expected = ", ".join(traj_csv_dtype.names or ())
        raise ValueError(f"a trajectory needs the fields {expected}, as of load_traj_csv(), or rows of these seven numbers")
    for name, values in columns.items():
        poses[name] = values
    _check_poses(poses)
    return poses


def _check_poses(poses: NDArray[np.void]) -> None:
    """Refuse poses that cannot be flown, and warn of times that go back."""
    if len(poses) < 2:
        raise ValueError(f"expected a trajectory of at least 2 poses, found {len(poses)}")
    for name in traj_csv_dtype.names or ():
        wrong = np.flatnonzero(~np.isfinite(poses[name]))
        if len(wrong):
            raise ValueError(f"{name} of pose {wrong[0]} of the trajectory is {poses[name][wrong[0]]:g}, expected a finite number")
    back = np.flatnonzero(np.diff(poses["t"]) < 0)
    if len(back):
        later, earlier = poses["t"][back[0]], poses["t"][back[0] + 1]
        warn(f"times of the trajectory go back after pose {back[0]}, from {later:g} s to {earlier:g} s; poses are sorted by time")


@validate_call
def load_traj_csv(
    csv: str | os.PathLike[str],
    tIndex: _Column = 0,
    rollIndex: _Column = 1,
    pitchIndex: _Column = 2,
    yawIndex: _Column = 3,
    xIndex: _Column = 4,
    yIndex: _Column = 5,
    zIndex: _Column = 6,
    trajectory_separator: Annotated[str, Field(strict=True, min_length=1, max_length=1)] = ",",
    rpy_in_radians: bool = False,
) -> Any:
    """Read a trajectory of text. Lines that begin with ``#``, and a first line of names, are passed over.

    Names that contradict the columns are warned of: ``time,x,y,z,roll,pitch,yaw`` needs ``rollIndex=4`` and so on.

    Parameters
    ----------
    csv : str or path-like
        The file.
    tIndex, rollIndex, pitchIndex, yawIndex, xIndex, yIndex, zIndex : int
        Columns, from 0.
    trajectory_separator : str
        Character between columns.
    rpy_in_radians : bool
        True if the angles of the file are radians; else they are degrees, and become radians.

    Returns
    -------
    numpy.ndarray
        Poses of :data:`traj_csv_dtype`, angles in rad.

    Raises
    ------
    ValueError
        No poses, words that are no numbers, too few columns, or a column that is used twice.
    FileNotFoundError
        There is no such file.
    """
    separator = None if trajectory_separator == " " else trajectory_separator
    with open(existing_file(csv), encoding="utf-8-sig") as file:
        lines = [line for line in file if line.strip() and not line.lstrip().startswith("#")]
    names = lines.pop(0).split(separator) if lines and not any(map(_is_number, lines[0].split(separator))) else []
    if not lines:
        raise ValueError(f"{os.fspath(csv)} has no poses")
    try:
        numbers = np.loadtxt(lines, delimiter=separator, ndmin=2)
    except ValueError as problem:
        raise ValueError(f"{os.fspath(csv)}: {problem} The columns are separated by {trajectory_separator!r}.") from None
    indices = dict(zip(traj_csv_dtype.names or (), (tIndex, rollIndex, pitchIndex, yawIndex, xIndex, yIndex, zIndex), strict=True))
    if len(set(indices.values())) < len(indices):
        raise ValueError(f"columns of a trajectory are {indices}, expected another one for each")
    if max(indices.values()) >= numbers.shape[1]:
        raise ValueError(f"{os.fspath(csv)} has {numbers.shape[1]} columns, expected at least {max(indices.values()) + 1}")
    _compare_names(os.fspath(csv), names, indices)
    poses = np.empty(len(numbers), dtype=traj_csv_dtype)
    for name, index in indices.items():
        values = numbers[:, index]
        poses[name] = np.radians(values) if name in _ANGLES and not rpy_in_radians else values
    return poses


def _compare_names(file: str, names: Sequence[str], indices: Mapping[str, int]) -> None:
    """Warn of columns whose names in the first line of a file are those of other ones."""
    # Without units: "x[m]", "roll (deg)".
    plain = [re.sub(r"[\[(].*", "", name).strip().strip('"').lower() for name in names]
    known = {"time": "t", "heading": "yaw"}
    there = {known.get(name, name): index for index, name in enumerate(plain)}
    wrong = {name: there[name] for name, index in indices.items() if there.get(name, index) != index}
    if wrong:
        advice = ", ".join(f"{name}Index={index}" for name, index in wrong.items())
        warn(f"{file}: the names in its first line are those of other columns than the ones that are read; give {advice}")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def platform_from_name(platform_name: str) -> Platform:
    """Return a platform that ships.

    Parameters
    ----------
    platform_name : str
        A name of :func:`list_platforms`, or an id of :func:`vlscan.platforms`, whatever its hyphens, underscores and capitals.

    Returns
    -------
    Platform
        The platform.

    Raises
    ------
    ValueError
        No platform has the name.
    """
    id = find(platform_name, _NAMES, catalogue.platforms(), "platform")
    return Platform.of_reference(catalogue.platform_reference(id), platform_name)


def list_platforms() -> list[str]:
    """List the platforms of HELIOS++; :func:`vlscan.platforms` lists all that ship.

    Returns
    -------
    list of str
        Their names, each of which is a function of this module, too.
    """
    return list(_NAMES)


#: Functions that return the platforms of :func:`list_platforms`, by name.
PLATFORM_REGISTRY = {name: instrument_function(platform_from_name, name) for name in _NAMES}

if not TYPE_CHECKING:
    globals().update(PLATFORM_REGISTRY)


def __getattr__(name: str) -> Any:
    return by_attribute(platform_from_name)(name)


__all__ = [
    "PLATFORM_REGISTRY",
    "DynamicPlatformSettings",
    "Platform",
    "PlatformSettings",
    "PlatformSettingsBase",
    "Printable",
    "StaticPlatformSettings",
    "TrajectorySettings",
    "list_platforms",
    "load_traj_csv",
    "platform_from_name",
    "traj_csv_dtype",
    *_NAMES,
]
