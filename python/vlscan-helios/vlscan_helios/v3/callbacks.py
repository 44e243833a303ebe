"""Hooks: functions that are called while a survey runs; and progress bars."""

from __future__ import annotations

import inspect
import math
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .settings import ProgressBarStrategy, StrEnum
from .utils import meas_dtype, traj_dtype
from .validation import Model, TimeInterval


class HookPoint(StrEnum):
    """When a hook is called."""

    LEG_START = "leg_start"
    LEG_END = "leg_end"
    SIM_TIME_ONCE = "sim_time_once"
    SIM_TIME_PERIODIC = "sim_time_periodic"


class HookPayload(StrEnum):
    """Points that a hook gets: none, those since its last call, or all so far."""

    METADATA_ONLY = "metadata_only"
    SINCE_LAST = "since_last"
    ALL_POINTS = "all_points"


class HookEndOfLegPolicy(StrEnum):
    """Action of a periodic hook at the end of a leg: none, a call, or a call and a new period."""

    NONE = "none"
    FLUSH = "flush"
    FLUSH_AND_RESET = "flush_and_reset"


@dataclass(frozen=True)
class HookContext:
    """State of a run, as hooks get it. Times are simulated ones, s.

    Parameters
    ----------
    point : HookPoint
        Why it is called.
    step_index : int
        Number of the pulse of the last point.
    play_index : int
        Number of the play; 0.
    leg_index, num_legs : int
        Number of the leg, from 0, and number of legs.
    sim_time_s, gps_time_s : float
        Time since the beginning of the run, and time of points.
    survey_progress, leg_progress : float
        Share of the run and of the leg that is done, 0 to 1, by the durations that follow from the settings; of a leg whose duration
        is not known before, 0 until its end.
    elapsed_time_s, remaining_time_s, leg_elapsed_time_s, leg_remaining_time_s : float
        Times of the run and of the leg; NaN for a remaining time that is not known.
    output_path : str
        Folder of results as the settings have it, in which each run has a folder of its own; empty for runs to memory.
    total_points, payload_points : int
        Number of points so far, and of those that the hook gets.
    total_trajectories, payload_trajectories : int
        Number of poses so far, and of those that the hook gets. Poses are complete only at the end of the run.
    scheduled_time_s, lag_s : float
        Time for which the call was asked, and how much later it was made.
    measurements : numpy.ndarray or None
        The points that the hook gets, as the argument ``points``.
    """

    point: HookPoint
    step_index: int
    play_index: int
    leg_index: int
    num_legs: int
    sim_time_s: float
    gps_time_s: float
    survey_progress: float
    leg_progress: float
    elapsed_time_s: float
    remaining_time_s: float
    leg_elapsed_time_s: float
    leg_remaining_time_s: float
    output_path: str
    total_points: int
    payload_points: int
    total_trajectories: int
    payload_trajectories: int
    scheduled_time_s: float
    lag_s: float
    measurements: NDArray[np.void] | None = None

    @property
    def sim_time(self) -> float:
        """Another name of ``sim_time_s``."""
        return self.sim_time_s

    @property
    def num_points(self) -> int:
        """Another name of ``total_points``."""
        return self.total_points


class SurveyHook(Model):
    """A function that is called while a survey runs.

    Calls are made in the order of simulated time, each with all points up to its time, on the thread that runs the survey; the
    engine continues meanwhile, but not farther than a few batches. An exception of the function ends the run.

    Parameters
    ----------
    point : HookPoint
        When it is called.
    callback : callable
        The function, called as ``callback(context, points, trajectories)`` with a :class:`HookContext` and records of points and of
        poses, which are ``None`` for metadata only; one that takes a single argument gets the context.
    barrier : bool
        Without effect: points up to the call are always complete.
    payload : HookPayload
        Points that it gets.
    end_of_leg_policy : HookEndOfLegPolicy, optional
        Action of a periodic hook at the end of a leg; none by default.
    sim_time : quantity, optional
        Simulated time of ``SIM_TIME_ONCE``; start of ``SIM_TIME_PERIODIC``, which is first called a period later, 0 by default.
    period : quantity, optional
        Period of ``SIM_TIME_PERIODIC``, above 0.
    """

    point: HookPoint
    callback: Callable[..., Any]
    barrier: bool = False
    payload: HookPayload = HookPayload.METADATA_ONLY
    end_of_leg_policy: HookEndOfLegPolicy | None = None
    sim_time: TimeInterval | None = None
    period: TimeInterval | None = None

    def model_post_init(self, context: Any, /) -> None:
        """Check that the hook has the time that its point needs.

        Parameters
        ----------
        context : object
            Without effect.
        """
        is_once, is_periodic = self.point == HookPoint.SIM_TIME_ONCE, self.point == HookPoint.SIM_TIME_PERIODIC
        for name, is_needed, is_used in (("sim_time", is_once, is_once or is_periodic), ("period", is_periodic, is_periodic)):
            is_given = getattr(self, name) is not None
            if is_needed and not is_given or is_given and not is_used:
                raise ValueError(f"a hook of {self.point.name} {'needs' if is_needed else 'has no use for'} {name}")
        if self.period == 0:
            raise ValueError("period is 0 s, expected more")
        if self.end_of_leg_policy is not None and self.point != HookPoint.SIM_TIME_PERIODIC:
            raise ValueError(f"a hook of {self.point.name} has no use for end_of_leg_policy")


class _Timer:
    """A hook, the time of its next call, and what it has got: batches of points and poses."""

    def __init__(self, hook: SurveyHook) -> None:
        self.hook, self.batches, self.poses = hook, 0, 0
        self.takes_points = _takes(hook.callback, 3) or not _takes(hook.callback, 1)
        self.due: float | None = None
        if hook.point == HookPoint.SIM_TIME_ONCE:
            self.due = hook.sim_time
        elif hook.period is not None:
            self.due = (hook.sim_time or 0.0) + hook.period

    def advance(self, now: float) -> None:
        """Set the time of the next call after one at ``now``."""
        self.due = None if self.hook.period is None else now + self.hook.period


def _takes(callback: Callable[..., Any], count: int) -> bool:
    """Return whether a function takes so many arguments; of some built-in ones that is not known."""
    try:
        inspect.signature(callback).bind(*range(count))
    except TypeError:
        return False
    except ValueError:
        return True
    return True


@dataclass(frozen=True)
class RunFacts:
    """Facts about a run, for hooks.

    Parameters
    ----------
    durations : sequence of float
        Durations of the legs, s; NaN for those that are not known.
    gps_start : float
        Time of points at the beginning, s.
    output_path : str
        Folder of results; empty for runs to memory.
    """

    durations: Sequence[float] = ()
    gps_start: float = 0.0
    output_path: str = ""


class HookDispatcher:
    """Calls hooks as points of a run come in.

    Parameters
    ----------
    hooks : sequence of SurveyHook
        The hooks.
    num_legs : int
        Number of legs.
    facts : RunFacts
        Facts about the run.
    """

    def __init__(self, hooks: Sequence[SurveyHook], num_legs: int, facts: RunFacts | None = None) -> None:
        self._timers = [_Timer(hook) for hook in hooks]
        self._num_legs, self._facts = num_legs, facts or RunFacts()
        self._leg, self._now, self._leg_begin = -1, 0.0, 0.0
        self._points: list[NDArray[np.void]] = []
        self._count, self._pulse = 0, 0
        self._poses = np.empty(0, traj_dtype)
        #: True if points are kept, for hooks that ask for them and for :meth:`collected`.
        self.keeps_points = True

    def feed(self, points: NDArray[np.void], times: NDArray[np.float64]) -> None:
        """Take points in the order of their emission.

        Parameters
        ----------
        points : numpy.ndarray
            Records of points.
        times : numpy.ndarray
            Their simulated times, s.
        """
        legs = points["point_source_id"].astype(np.int64) - 1
        cuts = np.flatnonzero(np.diff(legs)) + 1
        for rows, row_times in zip(np.split(points, cuts), np.split(times, cuts), strict=True):
            if len(rows):
                self._enter(int(rows["point_source_id"][0]) - 1)
                self._measure(rows, row_times)

    def finish(self, end: float, poses: NDArray[np.void] | None = None) -> None:
        """End the last leg, and begin and end those without points.

        Parameters
        ----------
        end : float
            Simulated time of the end, s.
        poses : numpy.ndarray, optional
            Records of all poses.
        """
        if poses is not None:
            self._poses = poses
        self._pass_time(max(end, self._now))
        self._enter(self._num_legs - 1)
        self._end_leg()

    def collected(self) -> NDArray[np.void]:
        """Return all points.

        Returns
        -------
        numpy.ndarray
            Records of points.
        """
        return np.concatenate(self._points) if self._points else np.empty(0, meas_dtype)

    def _enter(self, leg: int) -> None:
        while self._leg < leg:
            self._end_leg()
            self._leg += 1
            self._leg_begin = self._now
            self._call(HookPoint.LEG_START)

    def _end_leg(self) -> None:
        if self._leg < 0:
            return
        for timer in self._timers:
            policy = timer.hook.end_of_leg_policy or HookEndOfLegPolicy.NONE
            if policy != HookEndOfLegPolicy.NONE:
                self._deliver(timer, self._now)
            if policy == HookEndOfLegPolicy.FLUSH_AND_RESET:
                timer.advance(self._now)
        self._call(HookPoint.LEG_END)

    def _measure(self, points: NDArray[np.void], times: NDArray[np.float64]) -> None:
        first = 0
        while (due := self._next_due()) is not None and due <= times[-1]:
            index = int(np.searchsorted(times, due))
            self._keep(points[first:index])
            first = index
            self._pass_time(due)
        self._keep(points[first:])
        self._now = max(self._now, float(times[-1]))

    def _keep(self, points: NDArray[np.void]) -> None:
        self._count += len(points)
        if len(points):
            self._pulse = int(points["fullwave_index"][-1])
            if self.keeps_points:
                self._points.append(points)

    def _next_due(self) -> float | None:
        return min((timer.due for timer in self._timers if timer.due is not None), default=None)

    def _pass_time(self, until: float) -> None:
        while (due := self._next_due()) is not None and due <= until:
            self._now = max(self._now, due)
            for timer in self._timers:
                if timer.due is not None and timer.due <= due:
                    self._deliver(timer, timer.due)
                    timer.advance(due)
        self._now = max(self._now, until)

    def _call(self, point: HookPoint) -> None:
        for timer in self._timers:
            if timer.hook.point == point:
                self._deliver(timer, self._now)

    def _deliver(self, timer: _Timer, scheduled: float) -> None:
        hook = timer.hook
        points: NDArray[np.void] | None = None
        poses: NDArray[np.void] | None = None
        if hook.payload != HookPayload.METADATA_ONLY:
            is_rest = hook.payload == HookPayload.SINCE_LAST
            points = np.concatenate([np.empty(0, meas_dtype), *self._points[timer.batches if is_rest else 0 :]])
            poses = self._poses[timer.poses if is_rest else 0 :]
        timer.batches, timer.poses = len(self._points), len(self._poses)
        context = self._context(hook.point, scheduled, points, poses)
        if timer.takes_points:
            hook.callback(context, points, poses)
        else:
            hook.callback(context)

    def _context(self, point: HookPoint, scheduled: float, points: NDArray[np.void] | None, poses: NDArray[np.void] | None) -> HookContext:
        known = self._facts.durations
        duration = known[self._leg] if 0 <= self._leg < len(known) else math.nan
        elapsed = self._now - self._leg_begin
        progress = 1.0 if point == HookPoint.LEG_END else min(elapsed / duration, 1.0) if duration > 0 else 0.0
        left = 0.0 if point == HookPoint.LEG_END else max(duration - elapsed, 0.0) if duration >= 0 else math.nan
        return HookContext(
            point=point,
            step_index=self._pulse,
            play_index=0,
            leg_index=self._leg,
            num_legs=self._num_legs,
            sim_time_s=self._now,
            gps_time_s=self._facts.gps_start + self._now,
            survey_progress=min((max(self._leg, 0) + progress) / self._num_legs, 1.0) if self._num_legs else 1.0,
            leg_progress=progress,
            elapsed_time_s=self._now,
            remaining_time_s=left + sum(known[self._leg + 1 :]),
            leg_elapsed_time_s=elapsed,
            leg_remaining_time_s=left,
            output_path=self._facts.output_path,
            total_points=self._count,
            payload_points=0 if points is None else len(points),
            total_trajectories=len(self._poses),
            payload_trajectories=0 if poses is None else len(poses),
            scheduled_time_s=scheduled,
            lag_s=max(self._now - scheduled, 0.0),
            measurements=points,
        )


class _ProgressBarCallbacks:
    """Progress bars of tqdm.

    Parameters
    ----------
    strategy : ProgressBarStrategy
        Contents of the bars.
    num_legs : int
        Number of legs.
    tqdm : callable
        Makes a bar.
    """

    def __init__(self, strategy: ProgressBarStrategy, num_legs: int, tqdm: Callable[..., Any]) -> None:
        self._strategy = strategy
        has_legs = strategy in (ProgressBarStrategy.LEGS, ProgressBarStrategy.LEGS_TIME)
        self._legs = tqdm(total=num_legs, desc="legs", unit="leg") if has_legs else None
        time_bar = partial(tqdm, unit="s", bar_format="{desc}: {n:.1f} s simulated [{elapsed}]")
        self._make_time_bar: Callable[..., Any] | None = None if strategy == ProgressBarStrategy.LEGS else time_bar
        self._time: Any = None
        self._begin = 0.0

    def leg_start(self, context: HookContext) -> None:
        """Begin a leg.

        Parameters
        ----------
        context : HookContext
            The leg.
        """
        if self._make_time_bar is None:
            return
        if self._strategy == ProgressBarStrategy.PER_LEG_TIME:
            self._close_time()
            self._time = self._make_time_bar(desc=f"leg {context.leg_index + 1} of {context.num_legs}")
            self._begin = context.sim_time
        elif self._time is None:
            self._time = self._make_time_bar(desc="time")

    def time(self, context: HookContext) -> None:
        """Show the simulated time.

        Parameters
        ----------
        context : HookContext
            The time.
        """
        if self._time is not None:
            self._time.update(context.sim_time - self._begin - self._time.n)

    def leg_end(self, context: HookContext) -> None:
        """End a leg.

        Parameters
        ----------
        context : HookContext
            The leg.
        """
        self.time(context)
        if self._legs is not None:
            self._legs.update(1)

    def close(self) -> None:
        """Leave the bars as they are."""
        self._close_time()
        if self._legs is not None:
            self._legs.close()

    def _close_time(self) -> None:
        if self._time is not None:
            self._time.close()
            self._time = None


def build_progressbar_callbacks(
    strategy: ProgressBarStrategy, num_legs: int
) -> tuple[tuple[SurveyHook, ...], _ProgressBarCallbacks | None]:
    """Return hooks that show progress bars: on a terminal or in a notebook, where tqdm is installed.

    Parameters
    ----------
    strategy : ProgressBarStrategy
        Contents of the bars.
    num_legs : int
        Number of legs.

    Returns
    -------
    hooks : tuple of SurveyHook
        The hooks; none without bars.
    bars : object or None
        The bars, to be closed after the run.
    """
    strategy = ProgressBarStrategy(strategy)
    tqdm = None if strategy == ProgressBarStrategy.NONE else _tqdm()
    if tqdm is None:
        return (), None
    bars = _ProgressBarCallbacks(strategy, num_legs, tqdm)
    hooks = (
        SurveyHook(point=HookPoint.LEG_START, callback=bars.leg_start),
        SurveyHook(point=HookPoint.SIM_TIME_PERIODIC, callback=bars.time, period=0.1),
        SurveyHook(point=HookPoint.LEG_END, callback=bars.leg_end),
    )
    return hooks, bars


def _tqdm() -> Callable[..., Any] | None:
    """Return what makes a bar: none without tqdm, and none where nobody looks."""
    try:
        if "ipykernel" in sys.modules:
            with warnings.catch_warnings():
                # Of notebooks without widgets, which get bars of text.
                warnings.simplefilter("ignore")
                from tqdm.auto import tqdm
        elif sys.stderr is not None and sys.stderr.isatty():
            from tqdm import tqdm
        else:
            return None
    except ImportError:
        return None
    made: Callable[..., Any] = tqdm
    return made
