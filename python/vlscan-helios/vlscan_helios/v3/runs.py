"""Runs of surveys: points in memory or in files, and hooks on the way."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vlscan import Result
from vlscan import Survey as EngineSurvey
from vlscan.errors import warn

from .callbacks import HookDispatcher, HookPayload, RunFacts, SurveyHook
from .records import COLUMNS, laspy_data, point_records, pose_records
from .settings import OutputFormat, OutputSettings

if TYPE_CHECKING:
    from vlscan import RunOptions

    from .survey import Survey

#: Length of a week of GPS, s.
WEEK = 604_800

# Points of a batch that hooks are given.
_BATCH_ROWS = 200_000


def is_folder(output: OutputSettings) -> bool:
    """Return whether an output is a folder of files."""
    return output.format in (OutputFormat.LAS, OutputFormat.LAZ, OutputFormat.XYZ)


def check_output(output: OutputSettings, given: set[str]) -> None:
    """Refuse what the format of a run has no place for, or warn of it, if it was given for this run."""
    if is_folder(output):
        return
    for name in ("write_waveform", "write_pulse"):
        if getattr(output, name):
            raise NotImplementedError(
                f"{name} needs a format of files: LAS, LAZ or XYZ; vlscan.Survey.run(waveforms=True, pulses=True) has them in memory"
            )
    has_effect = {"las_scale"} if output.format == OutputFormat.LASPY else set()
    for name in ("output_dir", "split_by_channel", "las_scale"):
        if name in given - has_effect:
            warn(f"{name} has no effect on the format {output.format.name}")


class Run:
    """A run of a survey to one output."""

    def __init__(self, survey: Survey, engine: EngineSurvey, options: RunOptions, output: OutputSettings) -> None:
        self._survey, self._engine, self._options, self._output = survey, engine, options, output
        self._is_folder = is_folder(output)

    def _chosen(self, has_batches: bool) -> dict[str, Any]:
        """Return the arguments of the engine's run."""
        options, output = dict(self._options), self._output
        if has_batches:
            # Columns of text are those of HELIOS++.
            options["batch_columns"] = COLUMNS
        elif not self._is_folder:
            options["columns"] = COLUMNS
        if self._is_folder:
            options |= {"output": output.output_dir, "waveforms": output.write_waveform, "pulses": output.write_pulse}
        return options

    def plain(self) -> Any:
        """Run, and return the results."""
        result = self._engine.run(progress=False, **self._chosen(False))
        if self._is_folder:
            return Path(result.directories[0])
        points = result.points
        return self._result(point_records(points), result, points["Intensity"], points["ScanAngle"])

    def with_hooks(self, hooks: list[SurveyHook]) -> Any:
        """Run, call hooks, and return the results."""
        path = os.fspath(self._output.output_dir) if self._is_folder else ""
        facts = RunFacts(self._survey.durations(), self._survey.gps_start(), path)
        dispatcher = HookDispatcher(hooks, len(self._survey.legs), facts)
        needs_points = not self._is_folder or any(hook.payload != HookPayload.METADATA_ONLY for hook in hooks)
        dispatcher.keeps_points = needs_points
        columns: list[tuple[NDArray[Any], NDArray[Any]]] = []
        start, last = None, 0.0
        # A hook may fail, which ends the run.
        with self._engine.run_batches(_BATCH_ROWS, True, **self._chosen(True)) as batches:
            for points in batches:
                gps_times = np.asarray(points["GpsTime"])
                if start is None:
                    start = self._start(gps_times)
                times = np.maximum.accumulate(gps_times - start)
                dispatcher.feed(point_records(points), times)
                last = float(times[-1]) if len(times) else last
                if self._output.format == OutputFormat.LASPY:
                    columns.append((np.array(points["Intensity"]), np.array(points["ScanAngle"])))
            result = batches.result
        dispatcher.finish(last, pose_records(result.trajectory) if needs_points else None)
        if self._is_folder:
            return Path(result.directories[0])
        intensity, angle = (np.concatenate(parts) for parts in zip(*columns, strict=True)) if columns else (np.empty(0), np.empty(0))
        return self._result(dispatcher.collected(), result, intensity, angle)

    def _start(self, times: NDArray[np.float64]) -> float:
        """Return the time of points at the beginning of the run."""
        start = self._survey.gps_start()
        is_of_run = len(times) and not self._survey.platform.sync_gps_time and 0 <= times[0] - start < WEEK
        return start if is_of_run else float(times[0]) if len(times) else 0.0

    def _result(self, records: NDArray[np.void], result: Result, intensity: NDArray[Any], angle: NDArray[Any]) -> Any:
        poses = pose_records(result.trajectory)
        if self._output.format == OutputFormat.LASPY:
            return laspy_data(records, intensity, angle, self._output.las_scale), poses
        return records, poses
