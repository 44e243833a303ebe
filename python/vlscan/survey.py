"""Surveys: a scanner, what carries it, and what is scanned; and their runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import datetime, timezone
from difflib import get_close_matches
from typing import Any

import numpy as np

from . import _toml, _vlscan, catalogue
from .errors import Problem
from .scene import Part, PathLike, Scene
from .tables import Points, Table, Waveforms

#: A function that is told the progress of a run: numbers of pulses and points, the leg, and the fraction done (NaN if unknown).
Progress = Callable[..., object]


class Scanner:
    """An instrument: one that ships, changed by keys, or one of your own.

    ``Scanner("riegl_vz400")``; ``Scanner("riegl_vz400", accuracy_m=0.002)``; ``Scanner("my.xml#id")``;
    ``Scanner(optics="rotating", pulse_freqs_hz=[100_000], scan_angle_max_deg=50, ...)``. The keys are those of ``[scanner]`` in a
    pipeline file (docs/instruments.md); ``channel`` is a list of dictionaries of them.
    """

    def __init__(self, name: str | None = None, **keys: Any) -> None:
        self.keys: dict[str, Any] = dict(keys)
        if name is not None:
            self.keys = {"catalogue": catalogue.scanner_reference(name), **keys}

    @staticmethod
    def of(scanner: Scanner | str | Mapping[str, Any]) -> Scanner:
        """The scanner of a name, of keys, or itself."""
        if isinstance(scanner, Scanner):
            return scanner
        return Scanner(scanner) if isinstance(scanner, str) else Scanner(**scanner)

    def __repr__(self) -> str:
        return f"Scanner({', '.join(f'{key}={value!r}' for key, value in self.keys.items())})"


class Platform:
    """What carries the scanner: ``Platform("sr22")`` of those that ship, ``Platform(kind="linear_path")``, or ``static``.

    ``mount``: pose of the scanner on the platform, ``{"offset_m": [x, y, z], "rotate_deg": [{"x": -90}]}``.
    """

    def __init__(self, name: str | None = None, kind: str | None = None, mount: Mapping[str, Any] | None = None) -> None:
        self.keys: dict[str, Any] = {}
        if name is not None:
            self.keys["catalogue"] = catalogue.platform_reference(name)
        if kind is not None:
            self.keys["kind"] = kind
        if mount is not None:
            self.keys["mount"] = dict(mount)

    @staticmethod
    def of(platform: Platform | str) -> Platform:
        """The platform of a name or a kind, or itself."""
        if isinstance(platform, Platform):
            return platform
        return Platform(kind=platform) if platform in ("static", "linear_path") else Platform(platform)

    def __repr__(self) -> str:
        return f"Platform({', '.join(f'{key}={value!r}' for key, value in self.keys.items())})"


class Leg:
    """A waypoint and the way to the next one: the last leg of a moving platform is where it arrives.

    ``position``: x, y, z, world frame, m. ``on_ground``: take z from the ground. ``speed_m_per_s``: of the way to the next leg.
    ``active``: whether the scanner fires. ``strip``: legs of the same strip share their files. Other keys are settings of the
    scanner: ``pulse_freq_hz``, ``scan_freq_hz``, ``scan_angle_deg``, ``head_rate_deg_per_s``, ``head_start_deg``,
    ``head_stop_deg``, ``vertical_resolution_deg`` ... (docs/pipelines.md).
    """

    def __init__(
        self,
        position: Sequence[float] = (0.0, 0.0, 0.0),
        *,
        on_ground: bool = False,
        speed_m_per_s: float | None = None,
        active: bool = True,
        strip: str | None = None,
        **settings: Any,
    ) -> None:
        self.position = [float(v) for v in position]
        self.on_ground, self.speed_m_per_s, self.active, self.strip = on_ground, speed_m_per_s, active, strip
        self.settings = settings

    def _keys(self) -> dict[str, Any]:
        return {
            "position_m": self.position,
            "on_ground": True if self.on_ground else None,
            "speed_m_per_s": None if self.speed_m_per_s is None else float(self.speed_m_per_s),
            "active": None if self.active else False,
            "strip": self.strip,
            "settings": self.settings or None,
        }

    def __repr__(self) -> str:
        return f"Leg({self._keys()})"


class Result:
    """What a run has measured."""

    def __init__(self, outcome: _vlscan.Outcome) -> None:
        self._outcome = outcome
        self._tables: dict[str, Table] = {}

    def _table(self, name: str) -> Table:
        if name not in self._tables:
            table = self._outcome.table(name)
            if table is None:
                how = "run without to=" if name == "points" else f"run with {name}=True and without to="
                raise AttributeError(f"this run has no {name} in memory; {how}")
            self._tables[name] = {"points": Points, "waveforms": Waveforms}.get(name, Table)(table)
        return self._tables[name]

    @property
    def points(self) -> Points:
        """The points."""
        table = self._table("points")
        assert isinstance(table, Points)
        return table

    @property
    def trajectory(self) -> Table:
        """Poses of the platform, as often as ``trajectory_interval_s`` of the settings asks for: time (s), x, y, z (m), roll,
        pitch, yaw (degrees, of a heading); ``platform_roll`` ... in the convention of HELIOS++."""
        return self._table("trajectory")

    @property
    def pulses(self) -> Table:
        """Emitted pulses: time (s), x, y, z (m), dx, dy, dz, pulse, device, scan_angle (degrees). With ``pulses=True``."""
        return self._table("pulses")

    @property
    def waveforms(self) -> Waveforms:
        """Digitised waveforms. With ``waveforms=True``."""
        table = self._table("waveforms")
        assert isinstance(table, Waveforms)
        return table

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

    def __repr__(self) -> str:
        where = f", {', '.join(self.files)}" if self.files else ""
        return f"<Result: {self.pulse_count:,} pulses, {self.point_count:,} points in {self.seconds:.2f} s{where}>"

    def _repr_html_(self) -> str:
        if self._outcome.table("points") is None:
            import html

            return f"<div>{html.escape(repr(self))}</div>"
        return self.points._repr_html_()


class Survey:
    """A scanner that legs or a trajectory carry through a scene.

    ``scene``: a :class:`Scene`, a file, or parts. ``scanner``: a :class:`Scanner` or a name. ``platform``: a :class:`Platform`, a
    name, or ``static`` (the default) or ``linear_path``. ``legs``: waypoints. ``trajectory`` instead of legs: recorded poses as an
    array of n rows of time (s), x, y, z (m), roll, pitch, yaw (degrees; heading, clockwise from +y), a dictionary or table with
    such columns, or a file. ``settings``: of the scanner, for all legs. ``waveform``, ``detector``: as in pipeline files.
    """

    def __init__(
        self,
        scene: Scene | PathLike | Part | Iterable[Part] | None = None,
        scanner: Scanner | str | Mapping[str, Any] | None = None,
        legs: Iterable[Leg] = (),
        *,
        platform: Platform | str | None = None,
        trajectory: Any = None,
        settings: Mapping[str, Any] | None = None,
        waveform: Mapping[str, Any] | None = None,
        detector: Mapping[str, Any] | None = None,
        name: str | None = None,
    ) -> None:
        self.scene = scene if scene is None or isinstance(scene, Scene) else Scene(scene)
        self.scanner = None if scanner is None else Scanner.of(scanner)
        self.legs = list(legs)
        self.platform = None if platform is None else Platform.of(platform)
        self.trajectory = trajectory
        self.settings = dict(settings or {})
        self.waveform = dict(waveform or {})
        self.detector = dict(detector or {})
        self.name = name
        self._file: str | None = None

    @staticmethod
    def open(path: PathLike, scene: Scene | PathLike | None = None, **changes: Any) -> Survey:
        """The survey of a file: of HELIOS++ (``.xml``) or a pipeline (``.toml``). ``changes`` are arguments of :class:`Survey`,
        which replace what an XML file says."""
        survey = Survey(scene, **changes)
        survey._file = os.fspath(path)
        if survey._file.lower().endswith(".toml") and survey._keys():
            raise ValueError("a pipeline file cannot be changed by arguments; give them as options of the run, or change the file")
        return survey

    def _keys(self) -> dict[str, Any]:
        keys = {
            "name": self.name,
            "platform": self.platform.keys if self.platform else None,
            "scanner": self.scanner.keys if self.scanner else None,
            "settings": self.settings or None,
            "leg": [leg._keys() for leg in self.legs] or None,
            "waveform": self.waveform or None,
            "detector": self.detector or None,
        }
        return {key: value for key, value in keys.items() if value is not None}

    def document(self) -> str:
        """The survey as a pipeline (TOML), without what is in memory: scene and trajectory."""
        keys: dict[str, Any] = {}
        if self._file is not None:
            keys["survey"] = os.path.abspath(self._file)
        return _toml.document({**keys, **self._keys()})

    def _request(
        self, options: dict[str, Any], pulses: Any = None, words: Sequence[str] = ()
    ) -> _vlscan.Request:
        words = [*words_of(options), *words]
        trajectory = self.trajectory
        if isinstance(trajectory, (str, os.PathLike)):
            words.append(f"--trajectory={os.fspath(trajectory)}")
            trajectory = None
        elif trajectory is not None:
            trajectory = columns_of(trajectory, TRAJECTORY_COLUMNS)
        scene = self.scene._scene if self.scene is not None else None
        arguments: dict[str, Any] = {"scene": scene, "trajectory": trajectory, "pulses": pulses}
        if self._file is not None and not self._keys():
            return _vlscan.Request(words, file=self._file, **arguments)
        return _vlscan.Request(words, document=self.document(), **arguments)

    def run(
        self,
        to: PathLike | Iterable[PathLike] | None = None,
        *,
        waveforms: bool | None = None,
        pulses: bool | None = None,
        progress: Progress | None = None,
        **options: Any,
    ) -> Result:
        """Flies and measures the survey.

        Without ``to`` the points stay in memory; with it they are written to files, whose extensions tell the format (``.laz``,
        ``.copc.laz``, ``.las``, ``.parquet``, ``.arrow``, ``.ply``, ``.csv``, ``.xyz``). ``waveforms`` and ``pulses`` are recorded,
        too. ``progress`` is called about twenty times per second with ``pulses``, ``points``, ``leg`` and ``done`` (0 to 1).

        Options are those of the command line with underscores, for example ``seed``, ``threads``, ``columns`` (a list), ``misses``,
        ``physics`` (``"helios"`` or ``"refined"``, by default the former for XML surveys and the latter for others), ``force``
        (replace files): see :func:`vlscan.options`. ``False`` undoes a switch that the survey's pipeline file sets.

        Raises :class:`vlscan.InputError` for invalid input and :class:`vlscan.FileError` for files; ``KeyboardInterrupt`` ends the
        run and leaves what was measured in ``NAME.partial.EXT``.
        """
        return Result(self._execute(self._request, to, waveforms, pulses, progress, options))

    @staticmethod
    def _execute(
        request: Callable[[dict[str, Any]], _vlscan.Request],
        to: PathLike | Iterable[PathLike] | None,
        waveforms: bool | None,
        pulses: bool | None,
        progress: Progress | None,
        options: dict[str, Any],
    ) -> _vlscan.Outcome:
        if to is None:
            # The run counts the points of its first table.
            tables = ["points", *["waveforms"] * bool(waveforms), *["pulses"] * bool(pulses), "trajectory"]
            _refuse_options_of_files(options)
        else:
            tables = ["trajectory"]
            files = [to] if isinstance(to, (str, os.PathLike)) else list(to)
            if not files:
                raise ValueError("to names no file; without it the points stay in memory")
            options = {**options, "out": [os.fspath(file) for file in files], "waveforms": waveforms, "pulses": pulses}
        return _vlscan.run(request(options), tables, progress)

    def run_batches(
        self, rows: int = 1_000_000, per_leg: bool = False, seconds: float | None = None, **options: Any
    ) -> Iterator[Points]:
        """Flies and measures the survey, and yields the points in batches of ``rows`` while it does. Memory does not grow with the
        number of points: the run waits until batches are taken. Leaving the loop ends the run.

        With ``per_leg`` a batch ends with its leg, too, and with ``seconds`` at every multiple of so many seconds of ``GpsTime``:
        ``seconds=0.1`` yields the sweeps of a scanner that turns ten times per second."""
        _refuse_options_of_files(options)
        if seconds is not None and not 0 < seconds < float("inf"):
            raise ValueError(f"seconds is {seconds}, expected more than 0")
        return self._batches(self._request(options), rows, per_leg, seconds)

    @staticmethod
    def _batches(request: _vlscan.Request, rows: int, per_leg: bool, seconds: float | None) -> Iterator[Points]:
        batches = _vlscan.run_batches(request, rows, per_leg, seconds, 2)
        try:
            for table in batches:
                yield Points(table)
        finally:
            batches.close()

    def __repr__(self) -> str:
        what = [repr(self._file)] if self._file else []
        what += [f"{key}={value!r}" for key, value in self._keys().items() if key != "leg"]
        return f"Survey({', '.join([*what, f'{len(self.legs)} legs'])})"


def run(survey: Survey | PathLike, to: PathLike | Iterable[PathLike] | None = None, **options: Any) -> Result:
    """Runs a survey, or the survey of a file; see :meth:`Survey.run`."""
    return (survey if isinstance(survey, Survey) else Survey.open(survey)).run(to, **options)


def run_batches(
    survey: Survey | PathLike, rows: int = 1_000_000, per_leg: bool = False, seconds: float | None = None, **options: Any
) -> Iterator[Points]:
    """Runs a survey, or the survey of a file, batch by batch; see :meth:`Survey.run_batches`."""
    opened = survey if isinstance(survey, Survey) else Survey.open(survey)
    return opened.run_batches(rows, per_leg, seconds, **options)


def trace(
    scene: Scene | PathLike | Part | Iterable[Part],
    origins: Any = None,
    directions: Any = None,
    *,
    scanner: Scanner | str | Mapping[str, Any] = "riegl_vz400",
    time: Any = None,
    pulses: Any = None,
    waveform: Mapping[str, Any] | None = None,
    detector: Mapping[str, Any] | None = None,
    to: PathLike | Iterable[PathLike] | None = None,
    waveforms: bool | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Result:
    """Traces pulses of your own pattern through a scene.

    ``origins``: n by 3, world frame, m, or one origin for all. ``directions``: n by 3, of any length. ``time``: of emission, s; 0 by
    default. ``pulses`` instead of them: a table or dictionary with the columns x, y, z, dx, dy, dz and others that ``vlscan pulses``
    writes. ``scanner`` receives the echoes: its beam, its detector. The other arguments are those of :meth:`Survey.run`.
    """
    survey = Survey(scene, scanner, waveform=waveform, detector=detector, name="trace")
    if pulses is None:
        if origins is None or directions is None:
            raise TypeError("trace() needs origins and directions, or pulses")
        ends = np.asarray(directions, float)
        if ends.ndim != 2 or ends.shape[1] != 3:
            raise ValueError(f"directions has the shape {ends.shape}, expected n by 3")
        starts = np.broadcast_to(np.asarray(origins, float), ends.shape)
        pulses = {name: starts[:, axis] for axis, name in enumerate("xyz")}
        pulses |= {f"d{name}": ends[:, axis] for axis, name in enumerate("xyz")}
        if time is not None:
            pulses["time"] = np.broadcast_to(np.asarray(time, float), len(ends))
    table = columns_of(pulses, ())

    def request(chosen: dict[str, Any]) -> _vlscan.Request:
        return survey._request(chosen, table)

    return Result(Survey._execute(request, to, waveforms, None, progress, options))


#: Columns of a trajectory as an array.
TRAJECTORY_COLUMNS = ("time", "x", "y", "z", "roll", "pitch", "yaw")


def columns_of(table: Any, names: tuple[str, ...]) -> Any:
    """A table that the engine takes: something of Arrow as it is, arrays as a dictionary of columns as bytes."""
    if hasattr(table, "__arrow_c_stream__"):
        return table
    if isinstance(table, Mapping):
        columns = {str(name): np.asarray(values) for name, values in table.items()}
    else:
        array = np.asarray(table)
        if array.dtype.names:
            columns = {name: array[name] for name in array.dtype.names}
        elif names and array.ndim == 2 and array.shape[1] == len(names):
            columns = {name: array[:, index] for index, name in enumerate(names)}
        else:
            raise ValueError(f"an array has the shape {array.shape}, expected n by {len(names)}: {', '.join(names)}")
    return {name: np.asarray(values, dtype="<f8").tobytes() for name, values in columns.items()}


# Options that only say how files are written.
_OPTIONS_OF_FILES = {
    "force", "format", "frame_s", "labels", "las10", "las_at_most", "las_extra", "las_output", "las_scale", "per_object", "split_by_channel",
    "tile", "wave_packets", "zip_output",
}  # fmt: skip


def _refuse_options_of_files(options: Mapping[str, Any]) -> None:
    for name, value in options.items():
        if name in _OPTIONS_OF_FILES and value is not None and value is not False:
            raise ValueError(f"{name} is an option of files, but this run writes none; name them with run(to=...)")


def words_of(options: Mapping[str, Any]) -> list[str]:
    """Options as words of a command line."""
    known = catalogue.options()
    words = []
    for name, value in options.items():
        if name not in known and name != "out":
            close = get_close_matches(name, known, 1)
            hint = f"did you mean {close[0]!r}?" if close else "vlscan.options() lists them"
            raise TypeError(f"no option of a run is called {name!r}; {hint}")
        word = "--" + name.replace("_", "-")
        if value is None or (value is False and known[name].has_value):
            continue
        if value is False:
            words.append("--" + word.removeprefix("--no-") if word.startswith("--no-") else "--no-" + word.removeprefix("--"))
        elif value is True:
            words.append(word)
        elif isinstance(value, Mapping):
            words += [f"{word}={key}={_text(item)}" for key, item in value.items()]
        elif isinstance(value, (list, tuple)) and (name == "out" or known[name].is_list) and name != "correct":
            words += [f"{word}={_text(item)}" for item in value]
        else:
            words.append(f"{word}={_text(value)}")
    return words


def _text(value: Any) -> str:
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, datetime) and value.tzinfo is not None:
        return str(value.astimezone(timezone.utc).replace(tzinfo=None))
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return ",".join(_text(item) for item in value)
    return str(value)
