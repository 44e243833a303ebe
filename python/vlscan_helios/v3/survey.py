"""Surveys: legs, runs, records."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Mapping
from copy import copy
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from vlscan import Survey as EngineSurvey
from vlscan import _vlscan
from vlscan._words import switch, words_of
from vlscan.errors import warn
from vlscan.tables import Points, Table

from .platforms import FIELDS, Platform
from .scanner import Scanner
from .scene import StaticScene
from .settings import (
    ExecutionSettings,
    FullWaveformSettings,
    LogVerbosity,
    OutputFormat,
    OutputSettings,
    ParallelizationStrategy,
    PlatformSettings,
    ScannerSettings,
    Settings,
    TrajectorySettings,
    asset_directories,
    find_asset,
    rng_seed,
    split,
)

if TYPE_CHECKING:
    from vlscan import RunOptions

#: A point, packed.
POINT = np.dtype(
    [
        ("channel_id", "<u8"),
        ("hit_object_id", "<i4"),
        ("position", "<f8", (3,)),
        ("beam_direction", "<f8", (3,)),
        ("beam_origin", "<f8", (3,)),
        ("distance", "<f8"),
        ("intensity", "<f8"),
        ("echo_width", "<f8"),
        ("return_number", "<i4"),
        ("number_of_returns", "<i4"),
        ("fullwave_index", "<i4"),
        ("classification", "<i4"),
        ("gps_time", "<f8"),
        ("point_source_id", "<u2"),
    ]
)

#: A pose: time (s), position (m), angles (rad).
POSE = np.dtype([("gps_time", "<f8"), ("position", "<f8", (3,)), ("roll", "<f8"), ("pitch", "<f8"), ("yaw", "<f8")])

# Fields of a point and the columns of the engine that they hold.
_COLUMNS = {
    "channel_id": "Device",
    "hit_object_id": "ObjectId",
    "position": ("X", "Y", "Z"),
    "beam_direction": ("BeamDirectionX", "BeamDirectionY", "BeamDirectionZ"),
    "beam_origin": ("BeamOriginX", "BeamOriginY", "BeamOriginZ"),
    "distance": "Range",
    "intensity": "Amplitude",
    "echo_width": "EchoWidth",
    "return_number": "ReturnNumber",
    "number_of_returns": "NumberOfReturns",
    "fullwave_index": "PulseNumber",
    "classification": "SurfaceClass",
    "gps_time": "GpsTime",
    "point_source_id": "PointSourceId",
}


class SurveyHook:
    """Not possible: see the message of :meth:`Survey.run`."""


class Leg:
    """A leg: where it begins, and what the scanner does.

    Parameters
    ----------
    platform_settings : PlatformSettings, optional
        Where it begins.
    scanner_settings : ScannerSettings, optional
        What the scanner does.
    trajectory_settings : TrajectorySettings, optional
        The part of a trajectory that is flown.
    **values : Any
        Keywords of these settings.

    Raises
    ------
    ValueError
        Unknown keywords.
    """

    def __init__(
        self,
        platform_settings: PlatformSettings | None = None,
        scanner_settings: ScannerSettings | None = None,
        trajectory_settings: TrajectorySettings | None = None,
        **values: Any,
    ) -> None:
        platform, scanner, trajectory = split(values, PlatformSettings, ScannerSettings, TrajectorySettings)
        self.platform_settings = _with(platform_settings or PlatformSettings(), platform)
        self.scanner_settings = _with(scanner_settings or ScannerSettings(), scanner)
        self.trajectory_settings = _with(trajectory_settings or TrajectorySettings(), trajectory)

    def clone(self) -> Leg:
        """Return a copy.

        Returns
        -------
        Leg
            The copy.
        """
        return Leg(self.platform_settings, self.scanner_settings, self.trajectory_settings)

    def __repr__(self) -> str:
        return f"Leg({self.platform_settings!r}, {self.scanner_settings!r})"


_S = TypeVar("_S", bound=Settings)


def _with(settings: _S, values: dict[str, Any]) -> _S:
    changed = settings.clone()
    for name, value in values.items():
        setattr(changed, name, value)
    return changed


class Survey:
    """A scanner on a platform, a scene, and legs.

    Parameters
    ----------
    scanner : Scanner, optional
        The scanner.
    platform : Platform, optional
        The platform.
    scene : StaticScene, optional
        The scene.
    legs : list of Leg, optional
        The legs.
    full_waveform_settings : FullWaveformSettings, optional
        Digitisation of waveforms.
    name : str
        Name.
    gps_time : datetime, str or float, optional
        Start of the clock: a datetime, a text or POSIX seconds; 2024-01-01 by default.
    **unknown : Any
        Refused.

    Raises
    ------
    ValueError
        Unknown keywords.
    """

    def __init__(
        self,
        scanner: Scanner | None = None,
        platform: Platform | None = None,
        scene: StaticScene | None = None,
        legs: list[Leg] | None = None,
        full_waveform_settings: FullWaveformSettings | None = None,
        name: str = "",
        gps_time: datetime | str | float | None = None,
        **unknown: Any,
    ) -> None:
        if unknown:
            raise ValueError(f"Survey has no {', '.join(map(repr, unknown))}")
        self.scanner, self.platform, self.scene = scanner, platform, scene
        self.legs: list[Leg] = list(legs or [])
        self.full_waveform_settings = full_waveform_settings
        self.name = name
        #: Start of the clock: a datetime, a text or POSIX seconds; 2024-01-01 by default.
        self.gps_time = gps_time
        self._file: str | None = None

    @classmethod
    def from_xml(cls, survey_file: str | os.PathLike[str], **unknown: Any) -> Survey:
        """Return the survey of a file, which is run as it is.

        Parameters
        ----------
        survey_file : str or path-like
            The file.
        **unknown : Any
            ``scene``, ``full_waveform_settings`` and ``gps_time`` can be replaced.

        Returns
        -------
        Survey
            The survey.

        Raises
        ------
        NotImplementedError
            Other arguments of the survey.
        """
        survey = cls(**unknown)
        survey._file = find_asset(survey_file)
        for name in ("scanner", "platform", "legs", "name", "full_waveform_settings"):
            if not getattr(survey, name):
                delattr(survey, name)
        survey._check_file()
        return survey

    def _check_file(self) -> None:
        for name in ("scanner", "platform", "legs", "name"):
            if name in vars(self):
                raise NotImplementedError(
                    f"{name} of the survey of a file cannot be replaced; change the file, or build a Survey of its scene with "
                    "StaticScene.from_xml()"
                )

    def __getattr__(self, name: str) -> Any:
        # Only the survey of a file lacks attributes.
        if name in ("scanner", "platform", "legs", "name", "full_waveform_settings"):
            raise NotImplementedError(f"{name} of the survey of a file is not read from it; display_xml() shows the file")
        raise AttributeError(f"a Survey has no {name!r}")

    def clone(self) -> Survey:
        """Return a copy, which shares scanner, platform and scene.

        Returns
        -------
        Survey
            The copy.
        """
        twin = copy(self)
        if self._file is None:
            twin.legs = [leg.clone() for leg in self.legs]
        return twin

    def add_leg(
        self,
        leg: Leg | None = None,
        platform_settings: PlatformSettings | None = None,
        scanner_settings: ScannerSettings | None = None,
        trajectory_settings: TrajectorySettings | None = None,
        **values: Any,
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
        **values : Any
            Keywords of settings.

        Raises
        ------
        ValueError
            Unknown keywords.
        NotImplementedError
            The survey is that of a file.
        """
        if self._file is not None:
            raise NotImplementedError("legs cannot be added to the survey of a file; change the file, or build a Survey of its scene")
        if leg is not None:
            platform_settings = platform_settings or leg.platform_settings
            scanner_settings = scanner_settings or leg.scanner_settings
            trajectory_settings = trajectory_settings or leg.trajectory_settings
        self.legs.append(Leg(platform_settings, scanner_settings, trajectory_settings, **values))

    def run(
        self,
        execution_settings: ExecutionSettings | None = None,
        output_settings: OutputSettings | None = None,
        callbacks: object | None = None,
        **values: Any,
    ) -> Any:
        """Run the survey.

        Parameters
        ----------
        execution_settings : ExecutionSettings, optional
            Threads.
        output_settings : OutputSettings, optional
            What is returned or written.
        callbacks : object, optional
            Refused.
        **values : Any
            Keywords of these settings.

        Returns
        -------
        tuple or pathlib.Path
            Points and trajectory for the formats NPY and LASPY; the folder that was written for the others.

        Raises
        ------
        ValueError
            Unknown keywords, or the survey has no scanner, platform or scene.
        NotImplementedError
            Callbacks, or what a format has no place for; the message says what to do.
        """
        if callbacks is not None:
            raise NotImplementedError(
                "points are not passed to callbacks: take them while they are measured, leg by leg with "
                "vlscan.Survey.run_batches(per_leg=True), or every n seconds with run_batches(seconds=n)"
            )
        execution_values, output_values = split(values, ExecutionSettings, OutputSettings)
        execution = _with(execution_settings or ExecutionSettings(), execution_values)
        output = _with(output_settings or OutputSettings(), output_values)
        form = OutputFormat(getattr(output.format, "value", output.format))
        is_folder = form in (OutputFormat.LAS, OutputFormat.LAZ, OutputFormat.XYZ)
        for name in ("write_waveform", "write_pulse"):
            if getattr(output, name) and not is_folder:
                raise NotImplementedError(
                    f"{name} needs a format of files: LAS, LAZ or XYZ; vlscan.Survey.run(waveforms=True, pulses=True) has them in memory"
                )
        has_effect = {"las_scale"} if form == OutputFormat.LASPY else set()
        for name in ("output_dir", "split_by_channel", "las_scale"):
            if name in output.changed() and not is_folder and name not in has_effect:
                warn(f"{name} has no effect on the format {form.name}")
        verbosity = LogVerbosity(execution.verbosity)
        options = self._options(execution)
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            if verbosity == LogVerbosity.SILENT:
                warnings.simplefilter("ignore")
            survey = self._engine(Path(folder))
            if is_folder:
                options["las_output"], options["zip_output"] = form != OutputFormat.XYZ, form == OutputFormat.LAZ
                return self._run_to_folder(survey, output, options)
            columns = [name for names in _COLUMNS.values() for name in ([names] if isinstance(names, str) else names)]
            options["columns"] = [*columns, "Intensity", "ScanAngle"]
            result = survey.run(**options)
        points, poses = point_records(result.points), pose_records(result.trajectory)
        if form == OutputFormat.LASPY:
            return _laspy(points, result.points, output.las_scale), poses
        return points, poses

    def _run_to_folder(self, survey: EngineSurvey, output: OutputSettings, options: RunOptions) -> Path:
        options["las_scale"], options["split_by_channel"] = output.las_scale, output.split_by_channel
        words = words_of(options)
        words += [switch("waveforms", output.write_waveform), switch("pulses", output.write_pulse)]
        outcome = _vlscan.run(survey._request([*words, f"--output={os.fspath(output.output_dir)}"]), [], None)
        return Path(outcome.directories[0])

    def _options(self, execution: ExecutionSettings) -> RunOptions:
        is_chunked = ParallelizationStrategy(execution.parallelization) == ParallelizationStrategy.CHUNK
        return {
            "threads": int(execution.num_threads) or None,
            "chunk_size": execution.chunk_size,
            "warehouse_factor": execution.warehouse_factor,
            "schedule": "dynamic" if is_chunked else "warehouse",
            "seed": rng_seed(),
            "gps_start": self.gps_time,
            "assets": asset_directories(),
        }

    def _engine(self, folder: Path) -> EngineSurvey:
        """Return the survey for the engine: its file, or one that is written to ``folder``."""
        scene = None if self.scene is None else self.scene.engine()
        if self._file is not None:
            self._check_file()
            return EngineSurvey.open(self._file, scene, waveform=self._waveform())
        missing = [name for name in ("scanner", "platform", "scene") if getattr(self, name) is None]
        if missing:
            raise ValueError(f"the survey has no {' and no '.join(missing)}")
        file = folder / "survey.xml"
        file.write_text(self.to_xml(folder), encoding="utf-8")
        return EngineSurvey.open(file, scene)

    def _waveform(self) -> dict[str, object] | None:
        fwf = vars(self).get("full_waveform_settings")
        if fwf is None:
            return None
        fwf.check()
        keys = {"bin_ns": fwf.bin_size, "window_ns": fwf.win_size, "quality": int(fwf.beam_sample_quality)}
        return {**keys, "max_range_ns": fwf.max_fullwave_range}

    def to_xml(self, folder: Path | None = None) -> str:
        """Return the survey as XML, that of its file if it has one.

        Parameters
        ----------
        folder : pathlib.Path, optional
            Where a trajectory is written to.

        Returns
        -------
        str
            The text.

        Raises
        ------
        ValueError
            The survey has no scanner or no platform, or a leg has a part of a trajectory and the platform has none.
        """
        if self._file is not None:
            return Path(self._file).read_text(encoding="utf-8")
        platform, scanner = self.platform, self.scanner
        if platform is None or scanner is None:
            raise ValueError("the survey has no scanner or no platform")
        poses = platform.trajectory
        for leg in self.legs if poses is None else []:
            if changed := leg.trajectory_settings.changed():
                raise ValueError(f"a leg has {', '.join(changed)}, but the platform has no trajectory")
        about: dict[str, object] = {"name": self.name or "survey", "scene": "in memory", "scanner": scanner.reference}
        if poses is not None:
            about |= {"platform": "interpolated", "basePlatform": platform.reference or None}
            about["rotationSpec"] = platform.rotation_spec
        else:
            about["platform"] = platform.reference
        lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<document>", f"  {_tag('survey', about)}>"]
        if self.full_waveform_settings is not None:
            fwf = self.full_waveform_settings
            fwf.check()
            values = {
                "binSize_ns": fwf.bin_size,
                "beamSampleQuality": int(fwf.beam_sample_quality),
                "winSize_ns": fwf.win_size,
                "maxFullwaveRange_ns": fwf.max_fullwave_range,
            }
            lines.append(f"    {_tag('FWFSettings', values)}/>")
        for leg in self.legs:
            place = _where(leg.platform_settings) if poses is None else _place(platform, poses, leg.trajectory_settings, folder)
            lines += ["    <leg>", f"      {_tag('platformSettings', place)}/>"]
            lines += [f"      {_tag('scannerSettings', _scanning(leg.scanner_settings))}/>", "    </leg>"]
        return "\n".join([*lines, "  </survey>", "</document>", ""])

    def __repr__(self) -> str:
        return f"<Survey {self._file}>" if self._file is not None else f"<Survey {self.name}: {len(self.legs)} legs>"


def _place(platform: Platform, poses: NDArray[np.void], part: TrajectorySettings, folder: Path | None) -> dict[str, object]:
    path = (folder or Path(".")) / "trajectory.csv"
    if folder is not None and not path.exists():
        columns = [np.degrees(poses[name]) if name in ("roll", "pitch", "yaw") else poses[name] for name in FIELDS]
        np.savetxt(path, np.column_stack(columns), delimiter=",", fmt="%.17g")
    indices = {f"{name}Index": index for index, name in enumerate(FIELDS)}
    return {
        "trajectory": str(path),
        **indices,
        "tStart": part.start_time,
        "tEnd": part.end_time,
        "teleportToStart": bool(part.teleport_to_start) or None,
        "syncGPSTime": platform.sync_gps_time or None,
        "interpolationDomain": "position" if platform.position_only else None,
    }


def _where(settings: PlatformSettings) -> dict[str, object]:
    return {
        "x": settings.x,
        "y": settings.y,
        "z": settings.z,
        "onGround": True if settings.force_on_ground else None,
        "movePerSec_m": getattr(settings, "speed_m_s", None),
    }


def _scanning(settings: ScannerSettings) -> dict[str, object]:
    degrees = {
        "headRotatePerSec_deg": settings.head_rotation,
        "headRotateStart_deg": settings.rotation_start_angle,
        "headRotateStop_deg": settings.rotation_stop_angle,
        "scanAngle_deg": settings.scan_angle,
        "verticalAngleMin_deg": settings.min_vertical_angle,
        "verticalAngleMax_deg": settings.max_vertical_angle,
        "verticalResolution_deg": settings.vertical_resolution,
        "horizontalResolution_deg": settings.horizontal_resolution,
    }
    return {
        "active": None if settings.is_active else False,
        "pulseFreq_hz": None if settings.pulse_frequency is None else round(settings.pulse_frequency),
        "scanFreq_hz": settings.scan_frequency,
        **{name: None if value is None else round(float(np.degrees(value)), 12) for name, value in degrees.items()},
        "beamDivergence_rad": settings.beam_divergence_angle,
        "trajectoryTimeInterval_s": settings.trajectory_time_interval,
        "maxDuration_s": settings.max_duration,
    }


def _tag(name: str, values: Mapping[str, object]) -> str:
    def text(value: object) -> str:
        return str(value).lower() if isinstance(value, bool) else str(value)

    given = [f"{key}={quoteattr(text(value))}" for key, value in values.items() if value is not None]
    return " ".join([f"<{name}", *given])


def point_records(points: Points) -> NDArray[np.void]:
    """Points as records of :data:`POINT`."""
    records = np.empty(len(points), dtype=POINT)
    for field, columns in _COLUMNS.items():
        if isinstance(columns, str):
            records[field] = points[columns]
        else:
            for axis, column in enumerate(columns):
                records[field][:, axis] = points[column]
    return records


def pose_records(poses: Table) -> NDArray[np.void]:
    """Poses as records of :data:`POSE`."""
    records = np.empty(len(poses), dtype=POSE)
    records["gps_time"] = poses["time"]
    for axis, column in enumerate("xyz"):
        records["position"][:, axis] = poses[column]
    for angle in ("roll", "pitch", "yaw"):
        records[angle] = np.radians(poses[f"platform_{angle}"])
    return records


def _laspy(points: NDArray[np.void], columns: Points, scale: float | None) -> Any:
    try:
        import laspy
    except ImportError as failure:
        raise ImportError("OutputFormat.LASPY needs laspy: pip install laspy") from failure
    header = laspy.LasHeader(version="1.4", point_format=6)
    extra = {"echo_width": "f8", "fullwaveIndex": "i4", "hitObjectId": "i4", "heliosAmplitude": "f8"}
    header.add_extra_dims([laspy.ExtraBytesParams(name, kind) for name, kind in extra.items()])
    header.scales = np.full(3, scale or 0.0001)
    header.offsets = points["position"].min(axis=0) if len(points) else np.zeros(3)
    las = laspy.LasData(header)
    las.x, las.y, las.z = points["position"].T
    las.return_number, las.number_of_returns = points["return_number"], points["number_of_returns"]
    las.classification = points["classification"].astype("u1")
    las.gps_time, las.point_source_id = points["gps_time"], points["point_source_id"]
    las.intensity, las.scan_angle = columns["Intensity"], np.rint(np.clip(columns["ScanAngle"] / 0.006, -30_000, 30_000))
    las["echo_width"], las["heliosAmplitude"] = points["echo_width"], points["intensity"]
    las["fullwaveIndex"], las["hitObjectId"] = points["fullwave_index"], points["hit_object_id"]
    return las


def display_xml(survey: Survey) -> str:
    """Return the survey as XML.

    Parameters
    ----------
    survey : Survey
        The survey.

    Returns
    -------
    str
        The text.
    """
    return survey.to_xml()
