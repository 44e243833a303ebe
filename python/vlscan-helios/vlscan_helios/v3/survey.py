"""Surveys: a scanner, what carries it, what is scanned, legs; and their runs."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, Field, PrivateAttr

from vlscan import Survey as EngineSurvey
from vlscan.errors import warn
from vlscan.places import asset_folders, place_of, working_folder

from . import survey_xml, xml_files
from .callbacks import SurveyHook, build_progressbar_callbacks
from .errors import WrongTypeError, engine_errors, engine_warnings
from .leg import Leg, flown_part, make_leg
from .platforms import Platform, PlatformSettingsBase, TrajectorySettings
from .runs import WEEK, Run, check_output, is_folder
from .scanner import Scanner, ScannerSettingsBase
from .scene import StaticScene
from .settings import (
    ExecutionSettings,
    FullWaveformSettings,
    LogVerbosity,
    OutputFormat,
    OutputSettings,
    ParallelizationStrategy,
    compose_execution_settings,
    compose_output_settings,
)
from .utils import classonlymethod, engine_directories, is_real_iterable, rng_seed
from .validation import SEVERAL, Model, distribute
from .xml_files import Document

if TYPE_CHECKING:
    from vlscan import RunOptions

# Trees by the number of the factory.
_TREES = {1: "median", 2: "sah", 3: "axis-sah", 4: "fsah"}

# Zero of the clock of GPS, s after that of POSIX, as HELIOS++ counts.
_GPS_EPOCH = 315_964_809


def _zoned(time: datetime) -> datetime:
    """Return a time with a zone: UTC where it has none."""
    return time if time.tzinfo is not None else time.replace(tzinfo=timezone.utc)


class _AsRead(NamedTuple):
    """A survey as it was read from its file."""

    name: str
    scanner: Scanner
    platform: Platform
    scene: StaticScene
    legs: tuple[Leg, ...]
    full_waveform_settings: FullWaveformSettings


class Survey(Model):
    """A scanner that legs or a trajectory carry through a scene.

    Parameters
    ----------
    scanner : Scanner
        The scanner.
    platform : Platform
        The carrier of the scanner.
    scene : StaticScene
        The scene.
    legs : tuple of Leg
        The legs.
    name : str
        Name, also of the folder of results.
    gps_time : datetime
        Start of the clock, UTC without a zone; 2024-01-01 by default, so that runs can be repeated.
    full_waveform_settings : FullWaveformSettings
        Digitisation of waveforms.
    """

    scanner: Scanner
    platform: Platform
    scene: StaticScene
    legs: Annotated[tuple[Leg, ...], SEVERAL] = ()
    name: str = ""
    gps_time: Annotated[datetime, AfterValidator(_zoned)] = datetime(2024, 1, 1, tzinfo=timezone.utc)
    full_waveform_settings: FullWaveformSettings = Field(default_factory=FullWaveformSettings)
    _document: Document | None = PrivateAttr(None)
    # Working directory in which the file was named.
    _folder: str = PrivateAttr("")
    _as_read: _AsRead | None = PrivateAttr(None)

    @classonlymethod
    def from_xml(cls, survey_file: str | os.PathLike[str]) -> Survey:
        """Return the survey of a file, which can be changed; unchanged it is run as it stands.

        Parameters
        ----------
        survey_file : str or path-like
            The file.

        Returns
        -------
        Survey
            The survey.

        Raises
        ------
        ValueError
            The file is no survey, or a value of its legs is invalid.
        FileNotFoundError
            There is no such file, or not that of its scene.
        """
        document = xml_files.read(survey_file)
        contents = survey_xml.contents_of(document, _folders(document))
        references = contents.references
        if references is None:
            raise ValueError(f"{document.path} is no survey in XML")
        platform = survey_xml.platform_of(contents, references)
        survey = cls(
            scanner=survey_xml.scanner_of(references),
            platform=platform,
            scene=StaticScene.from_xml(references.scene),
            legs=survey_xml.legs_of(document, contents, platform),
            name=document.path.stem if contents.name in ("", document.path.name) else contents.name,
            full_waveform_settings=survey_xml.waveform_of(contents, references),
        )
        return survey.read_from(document)

    def read_from(self, document: Document) -> Survey:
        """Become the survey of a document, as it is now.

        Parameters
        ----------
        document : Document
            The document.

        Returns
        -------
        Survey
            Itself.
        """
        legs, waveform = tuple(leg.clone() for leg in self.legs), self.full_waveform_settings.clone()
        self._document, self._folder = document, working_folder()
        self._as_read = _AsRead(self.name, self.scanner.clone(), self.platform.clone(), self.scene, legs, waveform)
        # Settings of the file are not the user's.
        self.__pydantic_fields_set__.discard("full_waveform_settings")
        return self

    @property
    def document(self) -> Document | None:
        """File that it was read from."""
        return self._document

    @property
    def as_read(self) -> _AsRead | None:
        """The survey as it was read from its file."""
        return self._as_read

    def add_leg(
        self,
        leg: Leg | None = None,
        platform_settings: PlatformSettingsBase | None = None,
        scanner_settings: ScannerSettingsBase | None = None,
        trajectory_settings: TrajectorySettings | None = None,
        **parameters: Any,
    ) -> None:
        """Add a leg.

        Parameters
        ----------
        leg : Leg, optional
            The leg.
        platform_settings : PlatformSettings, optional
            Instead of those of the leg.
        scanner_settings : ScannerSettings, optional
            Instead of those of the leg.
        trajectory_settings : TrajectorySettings, optional
            Instead of those of the leg.
        **parameters : Any
            Keywords of settings, which replace values of these.

        Raises
        ------
        ValueError
            Unknown keywords, or invalid values.
        """
        made = make_leg(self.platform, leg, platform_settings, scanner_settings, trajectory_settings, parameters)
        self.legs = (*self.legs, made)

    def run(
        self,
        execution_settings: ExecutionSettings | None = None,
        output_settings: OutputSettings | None = None,
        callbacks: Sequence[SurveyHook] | None = None,
        **parameters: Any,
    ) -> Any:
        """Run the survey.

        Parameters
        ----------
        execution_settings : ExecutionSettings, optional
            Threads, over those of :func:`set_execution_settings`.
        output_settings : OutputSettings, optional
            Output of the run, over the settings of :func:`set_output_settings`.
        callbacks : sequence of SurveyHook, optional
            Hooks that are called during the run.
        **parameters : Any
            Keywords of these settings, which replace values of these.

        Returns
        -------
        tuple or pathlib.Path
            Points and trajectory for the formats NPY and LASPY; the folder that was written for the others.

        Raises
        ------
        ValueError
            Unknown keywords, or legs that do not fit the platform.
        HeliosException
            Input of the engine is invalid, or a file cannot be read or written.
        NotImplementedError
            An output that the format cannot hold; the message says what to do.
        """
        for_execution, for_output = distribute(parameters, ExecutionSettings.model_fields, OutputSettings.model_fields)
        execution = compose_execution_settings(execution_settings, for_execution)
        output = compose_output_settings(output_settings, for_output)
        if callbacks is not None and not is_real_iterable(callbacks):
            raise WrongTypeError(f"callbacks is a list of SurveyHook, found {type(callbacks).__name__}")
        hooks = [SurveyHook.model_validate(hook) for hook in callbacks or ()]
        check_output(output, {*for_output, *(output_settings.model_fields_set if output_settings is not None else ())})
        if execution.log_file or execution.log_file_only:
            warn("log_file has no effect; notes go to the logger 'vlscan', which logging.FileHandler writes to a file")
        self.check_legs()
        bar_hooks, bars = build_progressbar_callbacks(execution.progressbar, len(self.legs))
        is_silent = "verbosity" in execution.model_fields_set and execution.verbosity <= LogVerbosity.QUIET
        # Messages about the survey of a file name what the file has.
        fields = None if self._document is not None and self._is_as_read() else survey_xml.FIELDS
        try:
            with engine_warnings(is_silent, fields), engine_errors(fields):
                run = Run(self, self.engine(), self._options(execution, output), output)
                return run.with_hooks([*hooks, *bar_hooks]) if hooks or bar_hooks else run.plain()
        finally:
            if bars is not None:
                bars.close()

    def check_legs(self) -> None:
        """Check that the legs fit the platform.

        Raises
        ------
        ValueError
            There are no legs, or one has a part of a trajectory and the platform has no trajectory.
        """
        if not self.legs:
            raise ValueError("the survey has no legs; add_leg() adds them")
        if self.platform.trajectory is not None or self.platform.follows_file:
            return
        for leg in self.legs:
            part = flown_part(leg)
            changed = [] if part is None else [name for name in part.model_fields_set if getattr(part, name)]
            if changed:
                names = ", ".join(sorted(changed))
                raise ValueError(f"a leg has {names}, but the platform has no trajectory; Platform.load_interpolate_platform() makes one")

    def to_xml(self) -> str:
        """Return the survey as XML, that of its file if it was not changed. Scenes and trajectories of arrays are only named.

        Returns
        -------
        str
            The text.
        """
        if self._document is not None and self._is_as_read():
            path = place_of(os.fspath(self._document.path), self._folder)
            return Path(path).read_text(encoding="utf-8", errors="replace")
        return survey_xml.text_of(survey_xml.write(self))

    @property
    def trajectory(self) -> NDArray[np.void] | None:
        """Recorded poses that the platform follows; an array of them can be set, as for :meth:`Platform.load_interpolate_platform`."""
        return self.platform.trajectory

    @trajectory.setter
    def trajectory(self, poses: ArrayLike) -> None:
        self.platform = self.platform.following(poses)

    @property
    def is_of_file(self) -> bool:
        """True if it was read from a file."""
        return self._document is not None

    @property
    def is_loaded(self) -> bool:
        """True if its scene is loaded."""
        return self.scene.is_loaded

    def _is_as_read(self) -> bool:
        old = self._as_read
        if old is None or self.legs != old.legs or any(leg.source is None for leg in self.legs):
            return False
        same = (self.name, self.scanner, self.platform, self.full_waveform_settings)
        return same == (old.name, old.scanner, old.platform, old.full_waveform_settings) and not self.has_own_waveform

    @property
    def has_own_waveform(self) -> bool:
        """True if waveform settings were given."""
        return "full_waveform_settings" in self.model_fields_set

    def engine(self) -> EngineSurvey:
        """Return the survey for the engine: its file, or one in memory.

        Returns
        -------
        vlscan.Survey
            The survey.
        """
        old = self._as_read
        is_scene_of_file = old is not None and self.scene.source_file == old.scene.source_file and self.scene.is_as_read
        scene = None if is_scene_of_file else self.scene.engine()
        poses = self.platform.trajectory
        trajectories = {} if poses is None else {survey_xml.TRAJECTORY: poses}
        if self._document is None:
            return EngineSurvey.from_document(self.to_xml(), scene, trajectories=trajectories)
        path = place_of(os.fspath(self._document.path), self._folder)
        if self._is_as_read():
            return EngineSurvey.open(path, scene)
        # Lines of messages are those of the XML as it is now.
        return EngineSurvey.from_document(self.to_xml(), scene, f"{path} (as changed)", trajectories=trajectories)

    def _options(self, execution: ExecutionSettings, output: OutputSettings) -> RunOptions:
        given = execution.model_fields_set
        is_chunked = execution.parallelization == ParallelizationStrategy.CHUNK
        options: dict[str, Any] = {
            "threads": execution.num_threads if "num_threads" in given else None,
            "chunk_size": execution.chunk_size if "chunk_size" in given else None,
            "warehouse_factor": execution.warehouse_factor if "warehouse_factor" in given else None,
            "schedule": ("dynamic" if is_chunked else "warehouse") if "parallelization" in given else None,
            "tree": _TREES[execution.factory_type] if "factory_type" in given else None,
            "tree_jobs": execution.kdt_num_threads if "kdt_num_threads" in given else None,
            "seed": rng_seed(),
            "gps_start": self.gps_time if "gps_time" in self.model_fields_set else None,
            "assets": _folders(self._document, self._folder),
        }
        options = {name: value for name, value in options.items() if value is not None}
        if is_folder(output):
            options["las_output"], options["zip_output"] = output.format != OutputFormat.XYZ, output.format == OutputFormat.LAZ
            options["las_scale"] = output.las_scale if "las_scale" in output.model_fields_set else None
            options["split_by_channel"] = output.split_by_channel
        made: RunOptions = options  # type: ignore[assignment]
        return made

    def gps_start(self) -> float:
        """Return the time of points at the beginning of the run, s of the week of GPS.

        Returns
        -------
        float
            The time.
        """
        return (self.gps_time.timestamp() - _GPS_EPOCH) % WEEK

    def durations(self) -> list[float]:
        """Return how long legs take, s: as long as the head turns, or as the way to the next leg takes; NaN where neither is known.

        Returns
        -------
        list of float
            A duration for each leg.
        """
        durations = []
        for leg, following in zip(self.legs, [*self.legs[1:], None], strict=True):
            head, place = leg.scanner_settings, leg.platform_settings
            rate, speed = getattr(head, "head_rotation", 0), getattr(place, "speed_m_s", 0)
            if self.platform.trajectory is not None or self.platform.follows_file:
                durations.append(math.nan)
            elif self.platform.is_static:
                turn = getattr(head, "rotation_stop_angle", 0) - getattr(head, "rotation_start_angle", 0)
                durations.append(abs(turn / rate) if rate else math.nan)
            elif following is None:
                durations.append(0.0)
            else:
                way = [getattr(following.platform_settings, axis, 0) - getattr(place, axis, 0) for axis in "xyz"]
                durations.append(math.hypot(*way) / speed if speed else math.nan)
        return durations

    def _identity(self) -> object:
        return None if self._document is None else self._document.path

    def __copy__(self) -> Survey:
        return self.clone()

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Survey:
        twin = self.twin()
        # Behind the validation, which would note the fields as given.
        twin.__dict__.update({name: value.clone() for name, value in self if isinstance(value, Model)})
        twin.__dict__["legs"] = tuple(leg.clone() for leg in self.legs)
        return twin

    def __repr__(self) -> str:
        return f"<Survey {self.name!r}: {len(self.legs)} legs>"

    __str__ = __repr__


def _folders(document: Document | None, folder: str = "") -> list[str | Path]:
    """Return the folders in which the engine searches the files of a survey that was read in the working directory ``folder``."""
    found: list[str | Path] = [*engine_directories()]
    if document is not None:
        found += [Path("assets"), Path(place_of(os.fspath(document.path), folder)).parent, *asset_folders(folder)]
    return found
