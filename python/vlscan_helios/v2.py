"""The ``SimulationBuilder`` of HELIOS++ 2: ``import vlscan.pyhelios as pyhelios``.

A simulation runs in a thread of its own; what it writes is what ``vlscan run SURVEY --output OUT`` writes.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from vlscan import _vlscan
from vlscan._words import switch, words_of
from vlscan.points import Points
from vlscan.results import Result
from vlscan.tables import Table


class SimulationBuilder:
    """Collects what a simulation needs."""

    def __init__(
        self,
        surveyPath: str | os.PathLike[str],
        assetsDir: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] = (),
        outputDir: str | os.PathLike[str] = "output",
    ) -> None:
        folders = [assetsDir] if isinstance(assetsDir, (str, os.PathLike)) else list(assetsDir)
        self._survey, self._output = os.fspath(surveyPath), os.fspath(outputDir)
        self._options: dict[str, object] = {"assets": [os.fspath(folder) for folder in folders]}
        self._recorded: dict[str, bool] = {}

    def setNumThreads(self, numThreads: int) -> SimulationBuilder:
        """Set the number of threads; 0 is all."""
        self._options["threads"] = int(numThreads) or None
        return self

    def setLasOutput(self, lasOutput: bool) -> SimulationBuilder:
        """LAS instead of text."""
        self._options["las_output"] = bool(lasOutput)
        return self

    def setLas10(self, las10: bool) -> SimulationBuilder:
        """LAS 1.0 instead of 1.4."""
        self._options["las10"] = bool(las10)
        return self

    def setZipOutput(self, zipOutput: bool) -> SimulationBuilder:
        """Compressed outputs."""
        self._options["zip_output"] = bool(zipOutput)
        return self

    def setSplitByChannel(self, splitByChannel: bool) -> SimulationBuilder:
        """Write a file per channel."""
        self._options["split_by_channel"] = bool(splitByChannel)
        return self

    def setLasScale(self, lasScale: float) -> SimulationBuilder:
        """Resolution of LAS coordinates, m."""
        self._options["las_scale"] = float(lasScale)
        return self

    def setSeed(self, seed: int | str) -> SimulationBuilder:
        """Seed of all random draws."""
        self._options["seed"] = seed
        return self

    def setFixedGpsTimeStart(self, fixedGpsTimeStart: str) -> SimulationBuilder:
        """Start of the clock: ``"YYYY-MM-DD hh:mm:ss"`` or POSIX seconds."""
        self._options["gps_start"] = fixedGpsTimeStart or None
        return self

    def setWriteWaveform(self, writeWaveform: bool) -> SimulationBuilder:
        """Write waveforms."""
        self._recorded["waveforms"] = bool(writeWaveform)
        return self

    def setWritePulse(self, writePulse: bool) -> SimulationBuilder:
        """Write pulses."""
        self._recorded["pulses"] = bool(writePulse)
        return self

    def setCalcEchowidth(self, calcEchowidth: bool) -> SimulationBuilder:
        """Fit the widths of echoes."""
        self._options["echo_width"] = bool(calcEchowidth)
        return self

    def setFullWaveNoise(self, fullWaveNoise: bool) -> SimulationBuilder:
        """Add noise to waveforms."""
        self._options["waveform_noise"] = bool(fullWaveNoise)
        return self

    def setPlatformNoiseDisabled(self, platformNoiseDisabled: bool) -> SimulationBuilder:
        """Ignore the noise of the platform."""
        self._options["no_platform_noise"] = bool(platformNoiseDisabled)
        return self

    def setLegNoiseDisabled(self, legNoiseDisabled: bool) -> SimulationBuilder:
        """Ignore random offsets of legs."""
        self._options["no_leg_noise"] = bool(legNoiseDisabled)
        return self

    def setRebuildScene(self, rebuildScene: bool) -> SimulationBuilder:
        """Without effect: vlscan keeps no scenes beside their files."""
        return self

    def setFinalOutput(self, finalOutput: bool) -> SimulationBuilder:
        """Without effect: outputs are always collected by :meth:`Simulation.join`."""
        return self

    def setCallbackFrequency(self, callbackFrequency: int) -> SimulationBuilder:
        """Not possible unless 0: see the message."""
        if callbackFrequency:
            self.setCallback(None)
        return self

    def setCallback(self, callback: object) -> SimulationBuilder:
        """Not possible: see the message."""
        raise NotImplementedError(
            "points are not passed to callbacks; take them while they are measured with vlscan.Survey.open(...).run_batches()"
        )

    def build(self) -> Simulation:
        """Return the simulation."""
        recorded = [switch(name, is_written) for name, is_written in self._recorded.items()]
        words = [*words_of(self._options), *recorded, f"--output={self._output}"]
        return Simulation(_vlscan.Request(words, file=self._survey))


class Simulation:
    """A simulation that can be started once."""

    def __init__(self, request: _vlscan.Request) -> None:
        self._request = request
        self._thread: threading.Thread | None = None
        self._done, self._is_stopped = threading.Event(), threading.Event()
        self._outcome: _vlscan.Outcome | None = None
        self._failure: BaseException | None = None

    def start(self) -> None:
        """Start the simulation in a thread of its own."""
        if self._thread is not None:
            raise RuntimeError("the simulation has been started already")
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._outcome = _vlscan.run(self._request, ["points", "trajectory"], self._check)
        except BaseException as failure:
            self._failure = failure
        finally:
            self._done.set()

    def _check(self, **_progress: Any) -> None:
        if self._is_stopped.is_set():
            raise KeyboardInterrupt

    def isStarted(self) -> bool:
        """Whether it has been started."""
        return self._thread is not None

    def isRunning(self) -> bool:
        """Whether it runs."""
        return self._thread is not None and not self._done.is_set()

    def isFinished(self) -> bool:
        """Whether it has ended."""
        return self._done.is_set()

    def join(self) -> Output:
        """Wait for the end, raise what went wrong, and return the output. Ctrl-C ends the simulation."""
        if self._thread is None:
            raise RuntimeError("the simulation has not been started")
        try:
            # With a timeout, so that Ctrl-C is handled.
            while not self._done.wait(0.1):
                pass
        except KeyboardInterrupt:
            self._is_stopped.set()
            self._done.wait()
            raise
        if self._failure is not None:
            raise self._failure
        if self._outcome is None:
            raise RuntimeError("the simulation has no output")
        return Output(self._outcome)


class Output:
    """What a simulation has measured and written."""

    def __init__(self, outcome: _vlscan.Outcome) -> None:
        result = Result(outcome)
        #: Points and poses as tables of vlscan.
        self.points, self.trajectory = result.points, result.trajectory
        folder = Path(outcome.directories[0])
        #: Path of the folder that was written; two names of it.
        self.outpath = self.filepath = str(folder)
        #: Paths of the files that were written.
        self.outpaths = [path for path, *_ in outcome.files]

    @property
    def measurements(self) -> Points:
        """The points."""
        return self.points

    @property
    def trajectories(self) -> Table:
        """The poses."""
        return self.trajectory
