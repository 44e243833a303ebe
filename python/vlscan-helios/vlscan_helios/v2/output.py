"""Results of simulations: points and poses as objects, as arrays, and the files."""

from __future__ import annotations

import operator
import os
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from itertools import accumulate
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from vlscan import Points, Table

# Columns of the arrays of outputToNumpy(), by the names of vlscan's columns.
_POINT_COLUMNS = (
    *("X", "Y", "Z", "BeamOriginX", "BeamOriginY", "BeamOriginZ", "BeamDirectionX", "BeamDirectionY", "BeamDirectionZ"),
    *("Amplitude", "EchoWidth", "ReturnNumber", "NumberOfReturns", "PulseNumber", "ObjectId", "SurfaceClass", "GpsTime"),
)
_POSE_COLUMNS = ("x", "y", "z", "time", "platform_roll", "platform_pitch", "platform_yaw")

#: Columns of points in memory.
COLUMNS = (*_POINT_COLUMNS, "Range", "PointSourceId", "Device", "Intensity", "Classification")


class Vector(tuple[float, float, float]):
    """Three numbers, also by the names ``x``, ``y`` and ``z``."""

    __slots__ = ()

    @property
    def x(self) -> float:
        """First number."""
        return self[0]

    @property
    def y(self) -> float:
        """Second number."""
        return self[1]

    @property
    def z(self) -> float:
        """Third number."""
        return self[2]


class _Record:
    """A row of a table, whose values are attributes and have functions ``getName()``."""

    _VECTORS: dict[str, tuple[str, str, str]] = {}
    _NUMBERS: dict[str, str] = {}

    __slots__ = ("_row", "_table")

    def __init__(self, table: Table, row: int) -> None:
        object.__setattr__(self, "_table", table)
        object.__setattr__(self, "_row", row)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a {type(self).__name__.lower()} cannot be changed; outputToNumpy() returns arrays, which can")

    def _value(self, column: str) -> Any:
        return self._table[column][self._row].item()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("get") and len(name) > 3:
            value = self._named(name[3].lower() + name[4:])
            return lambda: value
        return self._named(name)

    def _named(self, name: str) -> Any:
        if name in self._VECTORS:
            return Vector(self._value(column) for column in self._VECTORS[name])
        if name in self._NUMBERS:
            return self._value(self._NUMBERS[name])
        known = ", ".join([*self._VECTORS, *self._NUMBERS])
        raise AttributeError(f"a {type(self).__name__.lower()} has no {name!r}; there are {known}")

    def __dir__(self) -> list[str]:
        names = [*self._VECTORS, *self._NUMBERS]
        return [*names, *(f"get{name[0].upper()}{name[1:]}" for name in names)]

    def __repr__(self) -> str:
        x, y, z = self._named("position")
        return f"<{type(self).__name__} at {x:.3f}, {y:.3f}, {z:.3f}>"


class Measurement(_Record):
    """A point; ``measurement.position`` and ``measurement.getPosition()`` are the same."""

    _VECTORS = {
        "position": ("X", "Y", "Z"),
        "beamOrigin": ("BeamOriginX", "BeamOriginY", "BeamOriginZ"),
        "beamDirection": ("BeamDirectionX", "BeamDirectionY", "BeamDirectionZ"),
    }
    _NUMBERS = {
        **{"x": "X", "y": "Y", "z": "Z", "distance": "Range", "intensity": "Amplitude", "echoWidth": "EchoWidth"},
        **{"returnNumber": "ReturnNumber", "pulseReturnNumber": "NumberOfReturns", "fullwaveIndex": "PulseNumber"},
        **{"hitObjectId": "ObjectId", "classification": "SurfaceClass", "gpsTime": "GpsTime", "devId": "Device"},
    }


class Trajectory(_Record):
    """A pose of the platform, angles in degrees."""

    _VECTORS = {"position": ("x", "y", "z")}
    _NUMBERS = {"gpsTime": "time", "roll": "platform_roll", "pitch": "platform_pitch", "yaw": "platform_yaw"}


_R = TypeVar("_R", bound=_Record)


class Records(Sequence[_R]):
    """The rows of tables as objects."""

    def __init__(self, tables: Sequence[Table], kind: Callable[[Table, int], _R]) -> None:
        self._tables, self._kind = list(tables), kind
        self._ends = list(accumulate(len(table) for table in self._tables))

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    @overload
    def __getitem__(self, key: int) -> _R: ...
    @overload
    def __getitem__(self, key: slice) -> list[_R]: ...
    def __getitem__(self, key: int | slice) -> _R | list[_R]:
        if isinstance(key, slice):
            return [self[row] for row in range(len(self))[key]]
        row = self._row(key)
        part = bisect_right(self._ends, row)
        return self._kind(self._tables[part], row - (self._ends[part - 1] if part else 0))

    def _row(self, key: int) -> int:
        if not hasattr(key, "__index__"):
            raise TypeError(f"an index of records is {key!r}, expected a whole number or a slice")
        row, count = operator.index(key), len(self)
        if not -count <= row < count:
            raise IndexError(f"index of a record is {row}, and there are {count} records")
        return row % count

    def __iter__(self) -> Iterator[_R]:
        for table in self._tables:
            for row in range(len(table)):
                yield self._kind(table, row)

    def __repr__(self) -> str:
        return f"<{len(self)} records>"


class Output:
    """Results and files of a simulation.

    Also a sequence of ``measurements``, ``trajectories``, ``filepath``, ``filepaths``, and whether these are complete.

    Parameters
    ----------
    parts : sequence of Points
        The points, in tables.
    trajectory : Table, optional
        The poses, which exist once the simulation has ended.
    files : sequence of str
        The files that were written.
    folder : str
        The folder of the files.
    seconds : float
        Duration of the simulation, s.
    """

    def __init__(
        self, parts: Sequence[Points], trajectory: Table | None = None, files: Sequence[str] = (), folder: str = "", seconds: float = 0.0
    ) -> None:
        self._parts, self._poses = list(parts), trajectory
        #: Paths of all files, and the folder that they are in; none without files.
        self.files: list[str] = list(files)
        self.folder: str = folder
        #: Duration of the simulation, s.
        self.seconds: float = seconds
        points = [file for file in self.files if "_points" in os.path.basename(file)]
        #: Paths of the files of points; two names of them.
        self.outpaths: list[str] = points or self.files
        self.filepaths: list[str] = self.outpaths
        #: Path of the first file of points; two names of it.
        self.outpath: str = self.filepaths[0] if self.filepaths else ""
        self.filepath: str = self.outpath

    @cached_property
    def points(self) -> Points:
        """The points as a table of vlscan."""
        return Points.concat(self._parts) if self._parts else Points.of({name: [] for name in COLUMNS})

    @property
    def poses(self) -> Table | None:
        """The poses as a table of vlscan; ``None`` before the simulation has ended."""
        return self._poses

    @property
    def trajectory(self) -> Table:
        """The poses as a table of vlscan."""
        if self._poses is None:
            raise AttributeError("poses are complete when the simulation has ended; it has not, or was stopped")
        return self._poses

    @property
    def measurements(self) -> Records[Measurement]:
        """The points as objects."""
        return Records(self._parts, Measurement)

    @property
    def trajectories(self) -> Records[Trajectory]:
        """The poses as objects; none before the simulation has ended."""
        return Records([] if self._poses is None else [self._poses], Trajectory)

    def _as_tuple(self) -> tuple[Records[Measurement], Records[Trajectory], str, list[str], bool]:
        return self.measurements, self.trajectories, self.filepath, self.filepaths, self._poses is not None

    def __getitem__(self, key: int) -> Any:
        """Return points (0), poses (1), the first file (2), all files (3), or whether these are complete (4)."""
        return self._as_tuple()[key]

    def __iter__(self) -> Iterator[Any]:
        return iter(self._as_tuple())

    def __len__(self) -> int:
        return len(self._as_tuple())

    def __repr__(self) -> str:
        where = f" in {self.folder!r}" if self.folder else ""
        return f"<Output: {len(self.measurements):,} points, {len(self.trajectories):,} poses{where}>"


def outputToNumpy(output: Output) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the points and the poses of an output as arrays.

    Parameters
    ----------
    output : Output
        The output.

    Returns
    -------
    points : numpy.ndarray
        Rows of position, origin and direction of the beam, intensity, echo width, number of the return, number of returns, number of
        the pulse, object, class, GPS time.
    poses : numpy.ndarray
        Rows of position, GPS time, roll, pitch, yaw (rad).
    """
    if not isinstance(output, Output):
        raise TypeError(f"expected the output of a simulation, found {type(output).__name__}")
    points = output.points.to_numpy(_POINT_COLUMNS, dtype=np.float64)
    poses = np.empty((0, 7)) if output.poses is None else output.poses.to_numpy(_POSE_COLUMNS, dtype=np.float64)
    poses[:, 4:] = np.radians(poses[:, 4:])
    return points, poses
