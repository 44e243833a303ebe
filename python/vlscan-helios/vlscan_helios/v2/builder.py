"""The builder of simulations."""

from __future__ import annotations

import errno
import math
import operator
import os
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from typing import TYPE_CHECKING

import numpy as np

from .functions import checked_seed, default_seed
from .output import Output
from .simulation import Recipe, Simulation, folders

if TYPE_CHECKING:
    from vlscan_helios.v3 import ScenePart

_Path = str | os.PathLike[str]

# Trees and schedules by their numbers.
_TREES = {1: "median", 2: "sah", 3: "axis-sah", 4: "fsah"}
_SCHEDULES = {0: "dynamic", 1: "warehouse"}

# Options of files, which have no meaning without them.
_OF_FILES = ("las_output", "las10", "zip_output", "split_by_channel", "las_scale")


def _truth(name: str, value: object) -> bool:
    """Return a switch: a truth value, 0 or 1. A text such as ``"false"`` is none."""
    if isinstance(value, (bool, np.bool_)) or (isinstance(value, (int, np.integer)) and value in (0, 1)):
        return bool(value)
    raise TypeError(f"{name} is True or False, found {value!r}")


def _count(name: str, value: int, lowest: int) -> int:
    if isinstance(value, (bool, np.bool_)) or not hasattr(value, "__index__"):
        raise TypeError(f"{name} is {value!r}, expected a whole number")
    number = operator.index(value)
    if number < lowest:
        raise ValueError(f"{name} is {number}, expected at least {lowest}")
    return number


def _real(name: str, value: float) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} is {value!r}, expected a number") from None


def _finite(name: str, value: float) -> float:
    number = _real(name, value)
    if not math.isfinite(number):
        raise ValueError(f"{name} is {number}, expected a finite number")
    return number


def _path(name: str, value: _Path) -> str:
    if not isinstance(value, (str, os.PathLike)):
        raise TypeError(f"{name} is {value!r}, expected a path")
    return os.fspath(value)


class SimulationBuilder:
    """Collects what a simulation needs; every setter returns the builder."""

    def __init__(self, surveyPath: _Path, assetsDir: _Path | Iterable[_Path] = (), outputDir: _Path = "output") -> None:
        self._survey, self._output = _path("surveyPath", surveyPath), _path("outputDir", outputDir)
        self._assets = folders(assetsDir)
        self._options: dict[str, object] = {}
        self._recorded: dict[str, bool] = {}
        self._filters: list[tuple[str, Callable[[ScenePart], object]]] = []
        self._has_files = True
        self._callback: Callable[[Output], object] | None = None
        self._callback_rows = 0

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> object:
            known = [key for key in dir(type(self)) if key.startswith(("set", "add"))]
            close = get_close_matches(name, known, 1)
            hint = f"did you mean {close[0]!r}? It" if close else "it"
            raise AttributeError(f"SimulationBuilder has no {name!r}; {hint} has {', '.join(known)} and build")

        def __setattr__(self, name: str, value: object) -> None:
            # An attribute of a builder is what its setter sets: builder.lasOutput = True.
            setter = f"set{name[:1].upper()}{name[1:]}"
            if name.startswith("_"):
                object.__setattr__(self, name, value)
            elif setter in dir(type(self)):
                getattr(self, setter)(value)
            else:
                getattr(self, setter)

    def _set(self, name: str, value: object) -> SimulationBuilder:
        self._options[name] = value
        return self

    def setSurveyPath(self, surveyPath: _Path) -> SimulationBuilder:
        """Set the survey."""
        self._survey = _path("surveyPath", surveyPath)
        return self

    def setAssetsDir(self, assetsDir: _Path | Iterable[_Path]) -> SimulationBuilder:
        """Set the folder, or the folders, in which files are searched."""
        self._assets = folders(assetsDir)
        return self

    def setOutputDir(self, outputDir: _Path) -> SimulationBuilder:
        """Set the folder of results."""
        self._output = _path("outputDir", outputDir)
        return self

    def setExportToFile(self, exportToFile: bool) -> SimulationBuilder:
        """Write files, as by default; else results are in memory only."""
        self._has_files = _truth("exportToFile", exportToFile)
        return self

    def setNumThreads(self, numThreads: int) -> SimulationBuilder:
        """Set the number of threads; 0 is all."""
        return self._set("threads", _count("numThreads", numThreads, 0) or None)

    def setKDTFactory(self, kdtFactory: int) -> SimulationBuilder:
        """Set the tree: 1 median, 2 SAH, 3 SAH with the best axis, 4 fast SAH. The points are the same."""
        if kdtFactory not in _TREES:
            raise ValueError(f"kdtFactory is {kdtFactory!r}, expected 1 to 4")
        return self._set("tree", _TREES[kdtFactory])

    def setKDTType(self, kdtType: int) -> SimulationBuilder:
        """Set the tree, as :meth:`setKDTFactory`."""
        return self.setKDTFactory(kdtType)

    def setKDTJobs(self, kdtJobs: int) -> SimulationBuilder:
        """Set the number of threads that build the tree; 0 is all."""
        return self._set("tree_jobs", _count("kdtJobs", kdtJobs, 0))

    def setKDTGeometricJobs(self, kdtGeometricJobs: int) -> SimulationBuilder:
        """Without effect: the threads of :meth:`setKDTJobs` do this work, too."""
        return self

    def setKDTSAHLossNodes(self, kdtSAHLossNodes: int) -> SimulationBuilder:
        """Without effect: the tree does not change the points."""
        return self

    def setParallelizationStrategy(self, parallelizationStrategy: int) -> SimulationBuilder:
        """Set how pulses are handed out to threads: 0 chunks, 1 warehouse. The points are the same."""
        if parallelizationStrategy not in _SCHEDULES:
            raise ValueError(f"parallelizationStrategy is {parallelizationStrategy!r}, expected 0 or 1")
        return self._set("schedule", _SCHEDULES[parallelizationStrategy])

    def setChunkSize(self, chunkSize: int) -> SimulationBuilder:
        """Set the number of pulses of a chunk; a negative one is that number, too, since chunks are always handed out as threads ask."""
        return self._set("chunk_size", abs(_count("chunkSize", chunkSize, -(2**31))))

    def setWarehouseFactor(self, warehouseFactor: int) -> SimulationBuilder:
        """Set how many chunks may wait for each thread."""
        return self._set("warehouse_factor", _count("warehouseFactor", warehouseFactor, 1))

    def setLasOutput(self, lasOutput: bool) -> SimulationBuilder:
        """Write LAS instead of text."""
        return self._set("las_output", _truth("lasOutput", lasOutput))

    def setLas10(self, las10: bool) -> SimulationBuilder:
        """Write LAS 1.0 instead of 1.4."""
        return self._set("las10", _truth("las10", las10))

    def setZipOutput(self, zipOutput: bool) -> SimulationBuilder:
        """Compress outputs."""
        return self._set("zip_output", _truth("zipOutput", zipOutput))

    def setSplitByChannel(self, splitByChannel: bool) -> SimulationBuilder:
        """Write a file per channel."""
        return self._set("split_by_channel", _truth("splitByChannel", splitByChannel))

    def setLasScale(self, lasScale: float) -> SimulationBuilder:
        """Set the resolution of LAS coordinates, m."""
        scale = _real("lasScale", lasScale)
        if not 0 < scale < math.inf:
            raise ValueError(f"lasScale is {scale}, expected metres above 0")
        return self._set("las_scale", scale)

    def setSeed(self, seed: int | str) -> SimulationBuilder:
        """Set the seed of all random draws; an empty text is none."""
        return self._set("seed", checked_seed(seed) if seed != "" else None)

    def setFixedGpsTimeStart(self, fixedGpsTimeStart: str) -> SimulationBuilder:
        """Set the start of the clock: ``"YYYY-MM-DD hh:mm:ss"`` or POSIX seconds."""
        return self._set("gps_start", fixedGpsTimeStart or None)

    def setWriteWaveform(self, writeWaveform: bool) -> SimulationBuilder:
        """Write waveforms."""
        self._recorded["waveforms"] = _truth("writeWaveform", writeWaveform)
        return self

    def setWritePulse(self, writePulse: bool) -> SimulationBuilder:
        """Write pulses."""
        self._recorded["pulses"] = _truth("writePulse", writePulse)
        return self

    def setCalcEchowidth(self, calcEchowidth: bool) -> SimulationBuilder:
        """Fit the widths of echoes."""
        return self._set("echo_width", _truth("calcEchowidth", calcEchowidth))

    def setFullwaveNoise(self, fullwaveNoise: bool) -> SimulationBuilder:
        """Add noise to waveforms."""
        return self._set("waveform_noise", _truth("fullwaveNoise", fullwaveNoise))

    def setFullWaveNoise(self, fullWaveNoise: bool) -> SimulationBuilder:
        """Add noise to waveforms, as :meth:`setFullwaveNoise`."""
        return self.setFullwaveNoise(fullWaveNoise)

    def setPlatformNoiseDisabled(self, platformNoiseDisabled: bool) -> SimulationBuilder:
        """Ignore the noise of the platform."""
        return self._set("no_platform_noise", _truth("platformNoiseDisabled", platformNoiseDisabled))

    def setLegNoiseDisabled(self, legNoiseDisabled: bool) -> SimulationBuilder:
        """Ignore random offsets of legs."""
        return self._set("no_leg_noise", _truth("legNoiseDisabled", legNoiseDisabled))

    def setLegacyEnergyModel(self, legacyEnergyModel: bool) -> SimulationBuilder:
        """Compute echo strengths with the older energy model."""
        return self._set("legacy_energy", _truth("legacyEnergyModel", legacyEnergyModel))

    def setRebuildScene(self, rebuildScene: bool) -> SimulationBuilder:
        """Without effect: vlscan keeps no scenes beside their files."""
        return self

    def setFinalOutput(self, finalOutput: bool) -> SimulationBuilder:
        """Without effect: outputs are always collected by :meth:`Simulation.join`."""
        return self

    def setCallbackFrequency(self, callbackFrequency: int) -> SimulationBuilder:
        """Set after how many points the callback is called; 0 leaves that to vlscan."""
        self._callback_rows = _count("callbackFrequency", callbackFrequency, 0)
        return self

    def setCallback(self, callback: Callable[[Output], object] | None) -> SimulationBuilder:
        """Set what is called with the :class:`Output` so far while the simulation runs, in its thread, and once at the end."""
        if callback is not None and not callable(callback):
            raise TypeError(f"expected a function, found {type(callback).__name__}")
        self._callback = callback
        return self

    def addRotateFilter(self, q0: float, q1: float, q2: float, q3: float, partId: str = "") -> SimulationBuilder:
        """Turn a part by a quaternion (w, x, y, z), or all parts without an id."""
        quaternion = tuple(_finite(f"q{index}", value) for index, value in enumerate((q0, q1, q2, q3)))
        if not any(quaternion):
            raise ValueError(f"q0, q1, q2, q3 are {quaternion}, expected w, x, y, z that are not all 0")
        self._filters.append((str(partId), lambda part: part.rotate(quaternion=quaternion)))
        return self

    def addScaleFilter(self, scaleFactor: float, partId: str = "") -> SimulationBuilder:
        """Scale a part, or all parts without an id."""
        factor = _real("scaleFactor", scaleFactor)
        if not 0 < factor < math.inf:
            raise ValueError(f"scaleFactor is {factor}, expected a number above 0")
        self._filters.append((str(partId), lambda part: part.scale(factor)))
        return self

    def addTranslateFilter(self, x: float, y: float, z: float, partId: str = "") -> SimulationBuilder:
        """Move a part (m), or all parts without an id."""
        offset = (_finite("x", x), _finite("y", y), _finite("z", z))
        self._filters.append((str(partId), lambda part: part.translate(offset)))
        return self

    def __repr__(self) -> str:
        return f"<SimulationBuilder of {self._survey!r}>"

    def build(self) -> Simulation:
        """Return the simulation; a missing survey is a ``FileNotFoundError``."""
        places = ["", "assets", *self._assets]
        if not any(os.path.isfile(os.path.join(folder, self._survey)) for folder in places):
            searched = ", ".join(folder or "." for folder in places)
            raise FileNotFoundError(errno.ENOENT, f"there is no such survey in {searched}", self._survey)
        options = {"seed": default_seed(), **self._options, "assets": self._assets}
        if self._has_files:
            options |= {**self._recorded, "output": self._output}
        else:
            options = {name: value for name, value in options.items() if name not in _OF_FILES}
        recipe = Recipe(
            self._survey, list(self._assets), options, self._has_files, self._callback, self._callback_rows, list(self._filters)
        )
        return Simulation(recipe)
