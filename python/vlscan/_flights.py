"""Surveys that are flown without being measured: forecasts, poses and pulses."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from . import _vlscan
from ._arguments import positive, truth
from ._description import SurveyDescription
from ._typing import PathLike
from ._values import recorded, values_of
from .forecast import DryRun
from .tables import Table

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import RunOptions


class FlownSurvey(SurveyDescription):
    """The methods of :class:`vlscan.Survey` that do not measure."""

    def dry_run(self, to: PathLike | Iterable[PathLike] | None = None, **options: Unpack[RunOptions]) -> DryRun:
        """Estimate what a run will cost and give: pulses, points, density, spacing, sizes of files, memory, time, what it misses.

        Legs and pulses are counted or, of long flights, computed; the rest comes from a sample that is measured.

        Parameters
        ----------
        to : str, path-like or iterable of them, optional
            Files whose sizes are estimated; none is written.
        **options : RunOptions
            As for :meth:`vlscan.Survey.run`.

        Returns
        -------
        DryRun
            The estimates.

        Raises
        ------
        InputError
            Input is invalid.

        Examples
        --------
        >>> forecast = vlscan.Survey.open("fixtures/room/survey.xml").dry_run(to="room.laz")
        >>> len(forecast.legs), forecast.files[0].name
        (2, 'room.laz')
        """
        values, _ = recorded(to, None, None, options, FlownSurvey.dry_run)
        return DryRun.of(_vlscan.dry_run(self._flight(values)))

    def fly_trajectory(self, interval: float | None = None, *, true: bool = False, **options: Unpack[RunOptions]) -> Table:
        """Fly the survey without measuring, and return the poses of the platform.

        Parameters
        ----------
        interval : float, optional
            Time from pose to pose, s; by default that of the survey, else 0.05.
        true : bool
            True if the poses are without errors of navigation.
        **options : RunOptions
            As for :meth:`vlscan.Survey.run`.

        Returns
        -------
        Table
            Columns time (s), x, y, z (m), roll, pitch, yaw (degrees), which :class:`vlscan.Survey` takes as trajectory.

        Raises
        ------
        InputError
            Input is invalid.
        TypeError
            The interval is no number.
        ValueError
            The interval is not above 0.

        Examples
        --------
        >>> poses = vlscan.Survey.open("fixtures/terrain/survey.xml").fly_trajectory(interval=0.5)
        >>> poses.columns
        ['time', 'x', 'y', 'z', 'roll', 'pitch', 'yaw']
        """
        interval = None if interval is None else positive("interval", interval, "seconds")
        values = values_of(options, FlownSurvey.fly_trajectory, writes_files=False)
        return Table(_vlscan.fly(self._flight(values), "poses", interval, truth("true", true)))

    def fly_pulses(self, **options: Unpack[RunOptions]) -> Table:
        """Fly the survey without measuring, and return its pulses.

        Parameters
        ----------
        **options : RunOptions
            As for :meth:`vlscan.Survey.run`.

        Returns
        -------
        Table
            The columns of ``vlscan pulses``, which :func:`vlscan.trace` takes: times (s), origins, directions and others.

        Raises
        ------
        InputError
            Input is invalid.

        Examples
        --------
        >>> pulses = vlscan.Survey.open("fixtures/room/survey.xml").fly_pulses(seed=1)
        >>> traced = vlscan.trace("fixtures/room/scene.xml", pulses=pulses, scanner="riegl_vz400", seed=1)
        >>> traced.point_count > 1000
        True
        """
        values = values_of(options, FlownSurvey.fly_pulses, writes_files=False)
        return Table(_vlscan.fly(self._flight(values), "pulses", None, False))
