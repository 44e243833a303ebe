"""Results of runs."""

from __future__ import annotations

import copyreg
import html
import os
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any

from . import _vlscan
from .errors import Problem
from .points import Points
from .tables import Table, Waveforms

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self


class Result:
    """The points and other results of a run. Results pickle.

    Parameters
    ----------
    outcome : object
        The result of the engine.

    Examples
    --------
    >>> result = vlscan.run("fixtures/room/survey.xml", seed=1)
    >>> result.point_count == len(result.points)
    True
    """

    def __init__(self, outcome: _vlscan.Outcome) -> None:
        self._outcome = outcome

    def _table(self, name: str) -> _vlscan.Table:
        table = self._outcome.table(name)
        if table is None:
            how = "run without to=" if name == "points" else f"run with {name}=True and without to="
            raise AttributeError(f"this run has no {name} in memory; {how}")
        return table

    @cached_property
    def points(self) -> Points:
        """The points."""
        return Points(self._table("points"))

    @cached_property
    def trajectory(self) -> Table:
        """Poses of the platform, as often as ``trajectory_interval_s`` of the settings asks for.

        Columns are time (s), x, y, z (m), roll, pitch, yaw (degrees, of a heading); ``platform_roll`` and so on in the
        convention of HELIOS++.
        """
        return Table(self._table("trajectory"))

    @cached_property
    def pulses(self) -> Table:
        """Emitted pulses of a run with ``pulses=True``.

        Columns are time (s), x, y, z (m), dx, dy, dz, pulse, device, scan_angle (degrees).
        """
        return Table(self._table("pulses"))

    @cached_property
    def waveforms(self) -> Waveforms:
        """Digitised waveforms of a run with ``waveforms=True``."""
        return Waveforms(self._table("waveforms"))

    @property
    def pulse_count(self) -> int:
        """Number of pulses emitted."""
        return self._outcome.pulses

    @property
    def point_count(self) -> int:
        """Number of points, in memory or in the first file."""
        return self._outcome.points

    @property
    def seconds(self) -> float:
        """Time from the first pulse to the last point, s."""
        return self._outcome.seconds

    @property
    def files(self) -> list[str]:
        """Files that were written."""
        return [path for path, *_ in self._outcome.files]

    @property
    def directories(self) -> list[str]:
        """Run directories, in the layout of HELIOS++."""
        return [os.fspath(path) for path in self._outcome.directories]

    @property
    def problems(self) -> list[Problem]:
        """Warnings and notes of the run, with their places."""
        return [Problem(**fields) for fields in self._outcome.notices]

    def __reduce__(self) -> tuple[Any, ...]:
        return Result, (self._outcome,)

    def __repr__(self) -> str:
        where = f", {', '.join(self.files)}" if self.files else ""
        return f"<Result: {self.pulse_count:,} pulses, {self.point_count:,} points in {self.seconds:.2f} s{where}>"

    def _repr_html_(self) -> str:
        if self._outcome.table("points") is None:
            return f"<div>{html.escape(repr(self))}</div>"
        return self.points._repr_html_()


class Batches(Iterator[Points]):
    """The points of a run, batch by batch; the run begins with the first one. As a context manager it ends the run.

    Parameters
    ----------
    start : callable
        Starts the run.

    Examples
    --------
    >>> survey = vlscan.Survey.open("fixtures/room/survey.xml")
    >>> with survey.run_batches(10_000, seed=1) as batches:
    ...     count = sum(len(points) for points in batches)
    >>> batches.result.point_count == count
    True
    """

    def __init__(self, start: Callable[[], _vlscan.BatchIterator]) -> None:
        self._start: Callable[[], _vlscan.BatchIterator] | None = start
        self._batches: _vlscan.BatchIterator | None = None
        self._is_closed = False

    def __next__(self) -> Points:
        if self._start is not None:
            self._batches, self._start = self._start(), None
        if self._batches is None:
            raise StopIteration
        return Points(next(self._batches))

    def close(self) -> None:
        """End the run."""
        self._start, self._is_closed = None, True
        if self._batches is not None:
            self._batches.close()

    @property
    def is_complete(self) -> bool:
        """True if the last batch has been taken, so that there is a result."""
        return self._batches is not None and self._batches.outcome() is not None

    @property
    def result(self) -> Result:
        """Counts, files, warnings and trajectory of the run; a ``RuntimeError`` before the last batch has been taken."""
        outcome = None if self._batches is None else self._batches.outcome()
        if outcome is None:
            raise RuntimeError("a run has a result when its last batch has been taken")
        return Result(outcome)

    def __repr__(self) -> str:
        if self._start is not None:
            return "<Batches: not begun>"
        if self.is_complete:
            return f"<Batches of {self.result!r}>"
        return "<Batches: closed>" if self._is_closed or self._batches is None else "<Batches: begun>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def _outcome_of(*parts: Any) -> _vlscan.Outcome:
    return _vlscan.Outcome(*parts)


copyreg.pickle(_vlscan.Outcome, lambda outcome: (_outcome_of, outcome.parts()))
