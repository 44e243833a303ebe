"""Surveys: a scanner, what carries it, and what is scanned; and their runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from . import _vlscan
from ._arguments import positive, reals, truth, whole
from ._columns import columns_of
from ._description import TRAJECTORY_COLUMNS, SurveyArguments
from ._flights import FlownSurvey
from ._libraries import shown_progress
from ._typing import PathLike, Progress, TableLike
from ._values import recorded
from .forecast import DryRun
from .instruments import Scanner
from .parts import Part
from .results import Batches, Result
from .scene import Scene, rays_of
from .tables import Table

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import RunOptions

__all__ = [
    "TRAJECTORY_COLUMNS",
    "Survey",
    "SurveyArguments",
    "dry_run",
    "opened",
    "pulses",
    "run",
    "run_batches",
    "trace",
    "trajectory",
]


class Survey(FlownSurvey):
    """A scanner that legs or a trajectory carry through a scene.

    Parameters
    ----------
    scene : Scene, str, path-like, Part or iterable of Part, optional
        The scene: a scene, a file, or parts.
    scanner : Scanner, str or mapping, optional
        A scanner, its name, or its keys.
    legs : iterable of Leg
        Waypoints.
    platform : Platform or str, optional
        A platform, its name, ``static`` (the default) or ``linear_path``.
    trajectory : array_like, mapping, Arrow table, str or path-like, optional
        Recorded poses instead of legs: an array of n rows of time (s), x, y, z (m), roll, pitch, yaw (degrees; heading,
        clockwise from +y), a dictionary or table with such columns, or a file.
    settings : mapping, optional
        Settings of the scanner for all legs.
    waveform, detector : mapping, optional
        Keys of ``[waveform]`` and ``[detector]`` in a pipeline file.
    name : str, optional
        Name of the survey.

    Raises
    ------
    TypeError
        An argument, or a value that an attribute is set to, is of another type; a setting is no key.

    Examples
    --------
    >>> wall = vlscan.Part.mesh([[-9, 5, 0], [9, 5, 0], [9, 5, 4], [-9, 5, 4]], [[0, 1, 2, 3]])
    >>> leg = vlscan.Leg((0, 0, 1.7), scan_freq_hz=20, head_rate_deg_per_s=90, head_start_deg=-45, head_stop_deg=45)
    >>> survey = vlscan.Survey(wall, "riegl_vz400", [leg])
    >>> points = survey.run(seed=1).points
    >>> len(points) > 1000
    True
    """

    def run(
        self,
        to: PathLike | Iterable[PathLike] | None = None,
        *,
        waveforms: bool | None = None,
        pulses: bool | None = None,
        progress: Progress | bool | None = None,
        **options: Unpack[RunOptions],
    ) -> Result:
        """Fly and measure the survey.

        Parameters
        ----------
        to : str, path-like or iterable of them, optional
            Files that are written, whose extensions tell the format (``.laz``, ``.copc.laz``, ``.las``, ``.parquet``,
            ``.geo.parquet``, ``.arrow``, ``.ply``, ``.csv``, ``.xyz``). Without it the points stay in memory.
        waveforms, pulses : bool, optional
            True if they are recorded, too.
        progress : callable or bool, optional
            A function that is called about twenty times per second with the keywords ``pulses``, ``points``, ``leg`` and ``done`` (0
            to 1); or whether to show a bar of tqdm. By default there is a bar in notebooks where tqdm is installed.
        **options : RunOptions
            Options of the command line with underscores, for example ``seed``, ``threads``, ``columns`` (a list), ``misses``,
            ``physics`` (``"helios"`` or ``"refined"``, by default the former for XML surveys and the latter for others),
            ``force`` (replace files), ``output`` (a folder in the layout of HELIOS++, instead of ``to``): see
            :func:`vlscan.options`. ``False`` undoes a switch that the survey's pipeline file sets.

        Returns
        -------
        Result
            The points, or the names of the files.

        Raises
        ------
        InputError
            Input is invalid.
        FileError
            A file cannot be read or written.
        TypeError
            No option has such a name.
        ValueError
            An option of files where none are written.
        KeyboardInterrupt
            Ctrl-C has ended the run; what was measured is in ``NAME.partial.EXT``.

        Examples
        --------
        >>> survey = vlscan.Survey.open("fixtures/room/survey.xml")
        >>> survey.run(seed=1, columns=["X", "Y", "Z"]).points.columns
        ['X', 'Y', 'Z']
        >>> survey.run(to="room.laz", seed=1, force=True).files
        ['room.laz']
        """
        values, tables = recorded(to, waveforms, pulses, options, Survey.run)
        with shown_progress(progress) as tell:
            return Result(_vlscan.run(self._flight(values), tables, tell))

    def run_batches(
        self,
        rows: int = 1_000_000,
        per_leg: bool = False,
        seconds: float | None = None,
        *,
        batch_columns: Iterable[str] | None = None,
        to: PathLike | Iterable[PathLike] | None = None,
        waveforms: bool | None = None,
        pulses: bool | None = None,
        **options: Unpack[RunOptions],
    ) -> Batches:
        """Fly and measure the survey, and yield the points in batches while it does.

        Memory does not grow with the number of points: the run waits until batches are taken. Leaving the loop ends the run, and
        so does leaving a block of ``with survey.run_batches() as batches:``.

        Parameters
        ----------
        rows : int
            Number of points of a batch.
        per_leg : bool
            True if a batch ends with its leg, too.
        seconds : float, optional
            A batch ends at every multiple of so many seconds of ``GpsTime``, too: 0.1 yields the sweeps of a scanner that turns
            ten times per second.
        batch_columns : iterable of str, optional
            Columns of the batches, of those that :func:`vlscan.columns` lists; by default the option ``columns``, which files
            of text, Arrow and Parquet have, too.
        to, waveforms, pulses : object
            As for :meth:`run`: files that are written, too, and what is recorded beside the points.
        **options : RunOptions
            As for :meth:`run`.

        Returns
        -------
        Batches
            The batches, an iterator of :class:`Points`; its ``result`` is that of the run after the last one.

        Raises
        ------
        InputError
            Input is invalid.
        TypeError
            No option has such a name.
        ValueError
            An option of files, an interval that is not above 0, or less than one row.

        Examples
        --------
        >>> survey = vlscan.Survey.open("fixtures/room/survey.xml")
        >>> sum(len(batch) for batch in survey.run_batches(1000, seed=1)) == survey.run(seed=1).point_count
        True
        """
        values, tables = recorded(to, waveforms, pulses, options, Survey.run_batches)
        count = min(whole("rows", rows, 1), 2**62)
        seconds = None if seconds is None else positive("seconds", seconds, "seconds")
        per_leg = truth("per_leg", per_leg)
        beside = [table for table in tables if table != "points"]
        chosen = None if batch_columns is None else [batch_columns] if isinstance(batch_columns, str) else list(batch_columns)
        if chosen == []:
            raise ValueError("batch_columns names no column; leave it out for those of the option columns")
        return Batches(partial(_vlscan.run_batches, self._flight(values), count, per_leg, seconds, 2, beside, chosen))


def run(
    survey: Survey | PathLike,
    to: PathLike | Iterable[PathLike] | None = None,
    *,
    waveforms: bool | None = None,
    pulses: bool | None = None,
    progress: Progress | bool | None = None,
    **options: Unpack[RunOptions],
) -> Result:
    """Run a survey.

    Parameters
    ----------
    survey : Survey, str or path-like
        A survey, or its file.
    to, waveforms, pulses, progress : object
        As for :meth:`Survey.run`.
    **options : RunOptions
        As for :meth:`Survey.run`.

    Returns
    -------
    Result
        The points, or the names of the files.

    Examples
    --------
    >>> result = vlscan.run("fixtures/room/survey.xml", seed=1)
    >>> result.points.units["X"]
    'm'
    """
    return opened(survey).run(to, waveforms=waveforms, pulses=pulses, progress=progress, **options)


def run_batches(
    survey: Survey | PathLike,
    rows: int = 1_000_000,
    per_leg: bool = False,
    seconds: float | None = None,
    *,
    batch_columns: Iterable[str] | None = None,
    to: PathLike | Iterable[PathLike] | None = None,
    waveforms: bool | None = None,
    pulses: bool | None = None,
    **options: Unpack[RunOptions],
) -> Batches:
    """Run a survey batch by batch.

    Parameters
    ----------
    survey : Survey, str or path-like
        A survey, or its file.
    rows, per_leg, seconds, batch_columns, to, waveforms, pulses : object
        As for :meth:`Survey.run_batches`.
    **options : RunOptions
        As for :meth:`Survey.run`.

    Returns
    -------
    Batches
        The batches, an iterator of :class:`Points`.

    Examples
    --------
    >>> [set(leg["PointSourceId"].tolist()) for leg in vlscan.run_batches("fixtures/room/survey.xml", per_leg=True)]
    [{1}, {2}]
    """
    return opened(survey).run_batches(
        rows, per_leg, seconds, batch_columns=batch_columns, to=to, waveforms=waveforms, pulses=pulses, **options
    )


def dry_run(survey: Survey | PathLike, to: PathLike | Iterable[PathLike] | None = None, **options: Unpack[RunOptions]) -> DryRun:
    """Estimate what a run will cost and give.

    Parameters
    ----------
    survey : Survey, str or path-like
        A survey, or its file.
    to : object
        As for :meth:`Survey.dry_run`.
    **options : RunOptions
        As for :meth:`Survey.run`.

    Returns
    -------
    DryRun
        The estimates.

    Examples
    --------
    >>> forecast = vlscan.dry_run("fixtures/room/survey.xml")
    >>> abs(forecast.points.value / vlscan.run("fixtures/room/survey.xml").point_count - 1) < 0.1
    True
    """
    return opened(survey).dry_run(to, **options)


def trajectory(survey: Survey | PathLike, interval: float | None = None, *, true: bool = False, **options: Unpack[RunOptions]) -> Table:
    """Fly a survey without measuring, and return the poses of the platform.

    Parameters
    ----------
    survey : Survey, str or path-like
        A survey, or its file.
    interval, true : object
        As for :meth:`Survey.fly_trajectory`.
    **options : RunOptions
        As for :meth:`Survey.run`.

    Returns
    -------
    Table
        The poses.

    Examples
    --------
    >>> poses = vlscan.trajectory("fixtures/terrain/survey.xml", interval=0.25)
    >>> round(float(poses["time"][1] - poses["time"][0]), 2)
    0.25
    """
    return opened(survey).fly_trajectory(interval, true=true, **options)


def pulses(survey: Survey | PathLike, **options: Unpack[RunOptions]) -> Table:
    """Fly a survey without measuring, and return its pulses.

    Parameters
    ----------
    survey : Survey, str or path-like
        A survey, or its file.
    **options : RunOptions
        As for :meth:`Survey.run`.

    Returns
    -------
    Table
        The pulses, which :func:`trace` takes.

    Examples
    --------
    >>> vlscan.pulses("fixtures/room/survey.xml").columns[:7]
    ['time', 'x', 'y', 'z', 'dx', 'dy', 'dz']
    """
    return opened(survey).fly_pulses(**options)


def trace(
    scene: Scene | PathLike | Part | Iterable[Part],
    origins: ArrayLike | None = None,
    directions: ArrayLike | None = None,
    *,
    scanner: Scanner | str | Mapping[str, object] = "riegl_vz400",
    time: ArrayLike | None = None,
    pulses: TableLike | ArrayLike | None = None,
    waveform: Mapping[str, object] | None = None,
    detector: Mapping[str, object] | None = None,
    to: PathLike | Iterable[PathLike] | None = None,
    waveforms: bool | None = None,
    progress: Progress | bool | None = None,
    **options: Unpack[RunOptions],
) -> Result:
    """Trace pulses of your own pattern through a scene.

    Parameters
    ----------
    scene : Scene, str, path-like, Part or iterable of Part
        The scene.
    origins : array_like, optional
        Origins of the pulses, n by 3, world frame, m, or one for all.
    directions : array_like, optional
        Directions of the pulses, n by 3, of any length, or one for all.
    scanner : Scanner, str or mapping
        The scanner whose beam and detector are used.
    time : array_like, optional
        Times of emission, s; 0 by default.
    pulses : mapping, Arrow table or structured array, optional
        A table instead of origins and directions, with the columns x, y, z, dx, dy, dz and others that ``vlscan pulses`` writes.
    waveform, detector : mapping, optional
        As for :class:`Survey`.
    to, waveforms, progress : object
        As for :meth:`Survey.run`.
    **options : RunOptions
        As for :meth:`Survey.run`.

    Returns
    -------
    Result
        The points, or the names of the files.

    Raises
    ------
    TypeError
        Neither pulses nor origins and directions are given, or both; or times that are no numbers.
    ValueError
        Origins, directions or times have another shape.

    Examples
    --------
    >>> floor = vlscan.Part.mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2, 3]])
    >>> down = np.broadcast_to([0, 0, -1], (3, 3))
    >>> points = vlscan.trace(floor, [[0, 0, 5], [1, 0, 5], [99, 0, 5]], down).points
    >>> points["X"].round(3).tolist()
    [0.0, 1.0]
    """
    survey = Survey(scene, scanner, waveform=waveform, detector=detector, name="trace")
    if pulses is None:
        if origins is None or directions is None:
            raise TypeError("trace() needs origins and directions, or pulses")
        starts, ends = rays_of(origins, directions)
        columns: dict[str, ArrayLike] = {name: starts[:, axis] for axis, name in enumerate("xyz")}
        columns |= {f"d{name}": ends[:, axis] for axis, name in enumerate("xyz")}
        if time is not None:
            times = reals("time", time)
            if times.shape not in ((), (1,), (len(ends),)):
                raise ValueError(f"time has the shape {times.shape}, expected one number or {len(ends)}")
            columns["time"] = np.broadcast_to(times, len(ends))
        pulses = columns
    elif not (origins is None and directions is None and time is None):
        raise TypeError("trace() takes either pulses or origins, directions and time, which are columns of pulses")
    values, tables = recorded(to, waveforms, None, options, trace)
    with shown_progress(progress) as tell:
        return Result(_vlscan.run(survey._request(values, columns_of(pulses, ())), tables, tell))


def opened(survey: Survey | PathLike) -> Survey:
    """Return a survey, or that of a file."""
    return survey if isinstance(survey, Survey) else Survey.open(survey)
