"""Settings of runs: execution, output, waveforms; and those that hold for all later runs."""

from __future__ import annotations

import enum
import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import Field

from vlscan.errors import VlscanWarning

from .errors import WrongTypeError
from .validation import (
    CreatedDirectory,
    Model,
    PositiveInt,
    PositiveLength,
    PositiveTimeInterval,
    ThreadCount,
    TimeInterval,
    UpdateableMixin,
    distribute,
)

# Threads of runs that set none.
_ALL_THREADS = os.cpu_count() or 1


class StrEnum(str, enum.Enum):
    """An enumeration of texts, as ``enum.StrEnum`` of Python 3.11."""

    __str__ = str.__str__


class ParallelizationStrategy(enum.IntEnum):
    """Distribution of pulses to threads; the points are the same."""

    CHUNK = 0
    WAREHOUSE = 1


class LogVerbosity(enum.IntEnum):
    """Messages of a run. Runs print nothing: their warnings are Python warnings."""

    SILENT = 0
    QUIET = 32
    TIME = 40
    DEFAULT = 56
    VERBOSE = 60
    VERY_VERBOSE = 63

    def apply(self) -> None:
        """Hide the warnings of all later runs (``SILENT``, ``QUIET``), or show them (all others)."""
        warnings.filterwarnings("ignore" if self <= LogVerbosity.QUIET else "default", category=VlscanWarning)


class KDTreeFactoryType(enum.IntEnum):
    """Builders of the tree of a scene; the points are the same."""

    SIMPLE = 1
    SAH = 2
    SAH_BEST_AXIS = 3
    SAH_APPROXIMATION = 4


class OutputFormat(StrEnum):
    """Formats that a run returns (``NPY``, ``LASPY``) or writes."""

    LAS = "las"
    LAZ = "laz"
    XYZ = "xyz"
    NPY = "npy"
    LASPY = "laspy"


class ProgressBarStrategy(StrEnum):
    """Contents of progress bars."""

    NONE = "none"
    LEGS = "legs"
    TIME = "time"
    LEGS_TIME = "legs+time"
    PER_LEG_TIME = "per_leg_time"


class ForceOnGroundStrategy(enum.IntEnum):
    """Ways to lower a part to the ground: a number above 1 is the number of corners that are looked at."""

    NONE = 0
    LEAST_COMPLEX = 1
    MOST_COMPLEX = -1


class ExecutionSettings(Model, UpdateableMixin):
    """Threads, log files, progress; none of them changes the points.

    The engine uses its own defaults for settings that are not given: chunks of 1024 pulses and a tree of boxes.
    """

    parallelization: ParallelizationStrategy = ParallelizationStrategy.CHUNK
    num_threads: ThreadCount = _ALL_THREADS
    chunk_size: PositiveInt = 32
    warehouse_factor: PositiveInt = 4
    log_file: bool = False
    log_file_only: bool = False
    verbosity: LogVerbosity = LogVerbosity.SILENT
    factory_type: KDTreeFactoryType = KDTreeFactoryType.SAH_APPROXIMATION
    kdt_num_threads: ThreadCount = _ALL_THREADS
    kdt_geom_num_threads: ThreadCount = _ALL_THREADS
    sah_nodes: PositiveInt = 32
    discard_shutdown: bool = True
    progressbar: ProgressBarStrategy = ProgressBarStrategy.PER_LEG_TIME


class OutputSettings(Model, UpdateableMixin):
    """Format, folder and contents of the results of a run."""

    format: OutputFormat = OutputFormat.NPY
    split_by_channel: bool = False
    # Checked when it is given: a default would be created by every import.
    output_dir: CreatedDirectory = Field(Path("output"), validate_default=False)
    write_waveform: bool = False
    write_pulse: bool = False
    las_scale: PositiveLength = 0.0001


class FullWaveformSettings(Model):
    """Digitisation of waveforms. ``win_size`` is at least two bins: ``ValueError`` otherwise."""

    bin_size: PositiveTimeInterval = 0.25e-9
    beam_sample_quality: PositiveInt = 3
    win_size: TimeInterval = 1e-9
    max_fullwave_range: TimeInterval = 0.0

    def model_post_init(self, context: Any, /) -> None:
        """Check the window.

        Parameters
        ----------
        context : object
            Without effect.
        """
        self.check()

    def check(self) -> None:
        """Check the window.

        Raises
        ------
        ValueError
            The window is shorter than two bins, so that every bin would count as an echo.
        """
        if self.win_size < 2 * self.bin_size * (1 - 1e-9):
            raise ValueError(f"win_size is {self.win_size:g} s, expected at least two bins of bin_size {self.bin_size:g} s")


_execution = ExecutionSettings()
_output = OutputSettings()

_S = TypeVar("_S", ExecutionSettings, OutputSettings)


def _composed(base: _S, local: _S | None, parameters: Mapping[str, Any]) -> _S:
    settings = base.clone()
    if local is not None:
        if not isinstance(local, type(base)):
            # Settings of another kind without values would be taken in silence.
            raise WrongTypeError(f"expected {type(base).__name__}, found {type(local).__name__}")
        settings.update_from_object(local)
    distribute(parameters, type(base).model_fields)
    settings.update_from_dict(parameters)
    return settings


def compose_execution_settings(
    local_settings: ExecutionSettings | None = None, parameters: Mapping[str, Any] | None = None
) -> ExecutionSettings:
    """Return the settings of a run: those for all runs, replaced by those that are given.

    Parameters
    ----------
    local_settings : ExecutionSettings, optional
        Settings of the run; of these what was given counts.
    parameters : mapping, optional
        Values by keyword, which replace all.

    Returns
    -------
    ExecutionSettings
        The settings.

    Raises
    ------
    ValueError
        Unknown keywords, or invalid values.
    """
    return _composed(_execution, local_settings, parameters or {})


def compose_output_settings(local_settings: OutputSettings | None = None, parameters: Mapping[str, Any] | None = None) -> OutputSettings:
    """Return the settings of a run: those for all runs, replaced by those that are given.

    Parameters
    ----------
    local_settings : OutputSettings, optional
        Settings of the run; of these what was given counts.
    parameters : mapping, optional
        Values by keyword, which replace all.

    Returns
    -------
    OutputSettings
        The settings.

    Raises
    ------
    ValueError
        Unknown keywords, or invalid values.
    """
    return _composed(_output, local_settings, parameters or {})


def set_execution_settings(execution_settings: ExecutionSettings | None = None, **parameters: Any) -> None:
    """Set what all later runs do unless they are told otherwise; without arguments the defaults are restored.

    Parameters
    ----------
    execution_settings : ExecutionSettings, optional
        The settings.
    **parameters : Any
        Values by keyword, which replace these.

    Raises
    ------
    ValueError
        Unknown keywords, or invalid values.
    """
    global _execution
    base = _execution if parameters and execution_settings is None else ExecutionSettings()
    _execution = _composed(base, execution_settings, parameters)


def set_output_settings(output_settings: OutputSettings | None = None, **parameters: Any) -> None:
    """Set what all later runs return or write unless they are told otherwise; without arguments the defaults are restored.

    Parameters
    ----------
    output_settings : OutputSettings, optional
        The settings.
    **parameters : Any
        Values by keyword, which replace these.

    Raises
    ------
    ValueError
        Unknown keywords, or invalid values.
    """
    global _output
    base = _output if parameters and output_settings is None else OutputSettings()
    _output = _composed(base, output_settings, parameters)


def apply_log_writing(execution_settings: ExecutionSettings) -> None:
    """Let all later runs write a log file, or not, as these settings say.

    Parameters
    ----------
    execution_settings : ExecutionSettings
        Settings whose ``log_file`` and ``log_file_only`` count.
    """
    set_execution_settings(log_file=execution_settings.log_file, log_file_only=execution_settings.log_file_only)
