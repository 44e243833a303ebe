"""Surveys: a scanner, what carries it, and what is scanned; and their runs."""

from __future__ import annotations

import operator
import os
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from . import _toml, _vlscan
from ._checked import Checked
from ._columns import EngineTable, columns_of
from ._conversions import unmasked
from ._libraries import shown_progress
from ._typing import PathLike, Progress, TableLike
from ._values import values_of
from .contents import References, SurveyContents
from .errors import InputError
from .forecast import DryRun
from .instruments import Platform, Scanner
from .legs import Leg, keys_of, legs_of
from .parts import Part
from .places import asset_folders, place_of, working_folder
from .results import Batches, Result
from .scene import Scene, rays_of
from .tables import Table

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import RunOptions

#: Columns of a trajectory as an array.
TRAJECTORY_COLUMNS = ("time", "x", "y", "z", "roll", "pitch", "yaw")


class SurveyArguments(TypedDict, total=False):
    """Arguments of :class:`Survey` but its scene."""

    scanner: Scanner | str | Mapping[str, object] | None
    legs: Iterable[Leg]
    platform: Platform | str | None
    trajectory: PathLike | TableLike | ArrayLike | None
    settings: Mapping[str, object] | None
    waveform: Mapping[str, object] | None
    detector: Mapping[str, object] | None
    name: str | None


class Survey(Checked):
    """A scanner that legs or a trajectory carry through a scene.

    Parameters
    ----------
    scene : Scene, str, path-like, Part or iterable of Part, optional
        What is scanned: a scene, a file, or parts.
    scanner : Scanner, str or mapping, optional
        A scanner, its name, or its keys.
    legs : iterable of Leg
        Waypoints.
    platform : Platform or str, optional
        A platform, its name, ``static`` (the default) or ``linear_path``.
    trajectory : array_like, mapping, Arrow table, str or path-like, optional
        Recorded poses instead of legs: an array of n rows of time (s), x, y, z (m), roll, pitch, yaw (degrees; heading,
        clockwise from +y), a dictionary or table with such columns, or a file.
    settings : mapping, optional
        Settings of the scanner for all legs.
    waveform, detector : mapping, optional
        Keys of ``[waveform]`` and ``[detector]`` in a pipeline file.
    name : str, optional
        Name of the survey.

    Raises
    ------
    TypeError
        An argument, or a value that an attribute is set to, is of another type; a setting is no key.

    Examples
    --------
    >>> wall = vlscan.Part.mesh([[-9, 5, 0], [9, 5, 0], [9, 5, 4], [-9, 5, 4]], [[0, 1, 2, 3]])
    >>> leg = vlscan.Leg((0, 0, 1.7), scan_freq_hz=20, head_rate_deg_per_s=90, head_start_deg=-45, head_stop_deg=45)
    >>> survey = vlscan.Survey(wall, "riegl_vz400", [leg])
    >>> points = survey.run(seed=1).points
    >>> len(points) > 1000
    True
    """

    _ATTRIBUTES: ClassVar[tuple[str, ...]] = (
        *("scene", "scanner", "legs", "platform", "trajectory", "settings", "waveform", "detector", "name"),
    )

    def __init__(
        self,
        scene: Scene | PathLike | Part | Iterable[Part] | None = None,
        scanner: Scanner | str | Mapping[str, object] | None = None,
        legs: Iterable[Leg] = (),
        *,
        platform: Platform | str | None = None,
        trajectory: PathLike | TableLike | ArrayLike | None = None,
        settings: Mapping[str, object] | None = None,
        waveform: Mapping[str, object] | None = None,
        detector: Mapping[str, object] | None = None,
        name: str | None = None,
    ) -> None:
        self.scene = scene if scene is None or isinstance(scene, Scene) else Scene(scene)
        self.scanner = None if scanner is None else Scanner.of(scanner)
        self.legs = legs_of(legs)
        self.platform = None if platform is None else Platform.of(platform)
        self.trajectory = trajectory
        self.settings = dict(settings or {})
        self.waveform = dict(waveform or {})
        self.detector = dict(detector or {})
        self.name = name
        # Working directory, relative to which files are named.
        self._folder = working_folder()
        self._file: str | None = None
        self._text: str | None = None
        self._name = "<python>"
        # Recorded poses of the document in memory, by the names that its legs have for their files.
        self._trajectories: dict[str, TableLike | ArrayLike] = {}
        # Keys of the legs of a file as they were read, and whether they hold all that it has about legs.
        self._read_legs: tuple[list[dict[str, object]], bool] | None = None

    def _checked(self, name: str, value: object) -> object:
        if name in ("settings", "waveform", "detector"):
            return keys_of(f"{name} of a survey", value, f"[{name}]")
        if name == "legs":
            return legs_of(value)
        if value is None:
            return None
        if name == "scene":
            return value if isinstance(value, Scene) else Scene(value)  # type: ignore[arg-type]
        if name == "scanner":
            return Scanner.of(value)  # type: ignore[arg-type]
        if name == "platform":
            return Platform.of(value)  # type: ignore[arg-type]
        if name == "name" and not isinstance(value, str):
            raise TypeError(f"name of a survey is a text, found {type(value).__name__}")
        return value

    @staticmethod
    def from_document(
        text: str,
        scene: Scene | PathLike | None = None,
        path: PathLike = "<python>",
        *,
        trajectories: Mapping[str, TableLike | ArrayLike] | None = None,
    ) -> Survey:
        """Return the survey of a document in memory.

        Parameters
        ----------
        text : str
            A pipeline, TOML, as :meth:`document` and plans have it, or a survey of HELIOS++, XML.
        scene : Scene, str or path-like, optional
            Replaces the scene of the document.
        path : str or path-like
            Name of the document in messages. Files that the document names are searched in the folder of this name, too. The file
            itself need not exist.
        trajectories : mapping of str to array_like, mapping or Arrow table, optional
            Recorded poses in memory by the names that legs in XML have for their files (``trajectory="name"``): n rows as for the
            trajectory of :class:`Survey`. Angles are degrees, or radians where legs have ``toRadians="false"``, composed as
            ``rotationSpec`` says.

        Returns
        -------
        Survey
            The survey.

        Raises
        ------
        TypeError
            ``trajectories`` is no mapping.

        Examples
        --------
        >>> plan = vlscan.plan_terrestrial("riegl_vz400", around=(0, 0), radius=5, positions=1, resolution=0.25, scene="ground.obj")
        >>> vlscan.Survey.from_document(plan.text).run(seed=1).point_count > 1000
        True
        """
        survey = Survey(scene)
        survey._text, survey._name = text, os.fspath(path)
        if not (trajectories is None or isinstance(trajectories, Mapping)):
            raise TypeError(f"trajectories are tables by name, found {type(trajectories).__name__}")
        survey._trajectories = dict(trajectories or {})
        return survey

    @staticmethod
    def open(path: PathLike, scene: Scene | PathLike | None = None, **changes: Unpack[SurveyArguments]) -> Survey:
        """Open the survey of a file.

        Parameters
        ----------
        path : str or path-like
            A survey of HELIOS++ (``.xml``) or a pipeline (``.toml``).
        scene : Scene, str or path-like, optional
            Replaces the scene of the file.
        **changes : SurveyArguments
            Other arguments of :class:`Survey`, which replace what an XML file says; of a pipeline only the trajectory can be
            replaced.

        Returns
        -------
        Survey
            The survey.

        Raises
        ------
        ValueError
            A pipeline would be changed.

        Examples
        --------
        >>> survey = vlscan.Survey.open("fixtures/room/survey.xml", settings={"trajectory_interval_s": 0.1})
        >>> "x" in survey.run(columns=["X"]).trajectory
        True
        """
        survey = Survey(scene, **changes)
        survey._file = os.fsdecode(path)
        if "legs" not in changes:
            del survey.legs
        if survey._file.lower().endswith(".toml") and survey._keys():
            raise ValueError("a pipeline file cannot be changed by arguments; give them as options of the run, or change the file")
        return survey

    def contents(self, **options: Unpack[RunOptions]) -> SurveyContents:
        """Return what the survey consists of, that of its file included; the scene is not loaded.

        Parameters
        ----------
        **options : RunOptions
            Options of :meth:`run`, of which those of input files matter (``assets``).

        Returns
        -------
        SurveyContents
            Name, scanner, platform, parts of the scene, waveform settings, legs.

        Raises
        ------
        InputError
            The file is invalid.

        Examples
        --------
        >>> found = vlscan.Survey.open("fixtures/room/survey.xml").contents()
        >>> found.scanner, found.platform, found.platform_kind, len(found.legs)
        ('tls_polygon', 'tripod', 'static', 2)
        """
        request = self._request(values_of(options, Survey.contents, writes_files=False))
        name, scanner, platform, parts, waveform, legs, _, found = _vlscan.contents(request)
        references = None if found is None else References(**found)
        return SurveyContents(name, *scanner, *platform, parts, waveform, [Leg._of_file(leg) for leg in legs], references)

    def __getattr__(self, name: str) -> Any:
        # Legs of a file are read when they are first asked for, and sent if they were changed.
        if name != "legs" or self.__dict__.get("_file") is None:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        *_, legs, is_whole, _ = _vlscan.contents(self._request({}))
        self.legs = [Leg._of_file(leg) for leg in legs]
        self._read_legs = ([leg._keys() for leg in self.legs], is_whole)
        return self.legs

    def _leg_keys(self) -> list[dict[str, object]]:
        """Return the keys of the legs, none for those of a file that are as they were read."""
        if "legs" not in self.__dict__:
            return []
        keys = [leg._keys() for leg in legs_of(self.legs)]
        if self._read_legs is None:
            return keys
        as_read, is_whole = self._read_legs
        if keys == as_read:
            return []
        if not is_whole:
            raise ValueError(f"legs of {self._file} hold more than Leg does (trajectories, pulse times, mounts); change the file")
        return keys

    def _keys(self) -> dict[str, object]:
        keys = {
            "name": self.name,
            "platform": self.platform.keys if self.platform else None,
            "scanner": self.scanner.keys if self.scanner else None,
            "settings": self.settings or None,
            "leg": self._leg_keys() or None,
            "waveform": self.waveform or None,
            "detector": self.detector or None,
        }
        return {key: value for key, value in keys.items() if value is not None}

    def document(self) -> str:
        """Return the survey as a pipeline file, without what is in memory: scene and trajectory.

        Returns
        -------
        str
            TOML.

        Examples
        --------
        >>> print(vlscan.Survey(name="test", settings={"scan_freq_hz": 120}).document())
        name = "test"
        <BLANKLINE>
        [settings]
        scan_freq_hz = 120
        <BLANKLINE>
        """
        if self._text is not None:
            return self._text
        keys: dict[str, object] = {}
        if self._file is not None:
            keys["survey"] = os.path.abspath(place_of(self._file, self._folder))
        return _toml.document({**keys, **self._keys()})

    def _request(self, options: dict[str, object], pulses: EngineTable | None = None) -> _vlscan.Request:
        """Return what the engine runs; ``options`` are values as :func:`values_of` returns them."""
        trajectory: EngineTable | None = None
        folders = asset_folders(self._folder)
        if folders:
            options = {**options, "assets": [*_listed(options.get("assets")), *folders]}
        if isinstance(self.trajectory, (str, os.PathLike)):
            options = {**options, "trajectory": place_of(os.fspath(self.trajectory), self._folder)}
        elif self.trajectory is not None:
            trajectory = columns_of(self.trajectory, TRAJECTORY_COLUMNS)
        scene = self.scene._scene if self.scene is not None else None
        if self._text is not None and self._keys():
            raise ValueError("a pipeline cannot be changed by attributes; give them as options of the run, or change its text")
        if self._file is not None and self._file.lower().endswith(".toml") and self._keys():
            raise ValueError("a pipeline file cannot be changed by attributes; give them as options of the run, or change the file")
        if self._file is not None and not self._keys():
            file = place_of(self._file, self._folder)
            return _vlscan.Request(options, file=file, scene=scene, trajectory=trajectory, pulses=pulses)
        document = self.document()
        if "output" in options and self.name is None and self._text is None and self._file is None:
            # Its folder has the name of the survey. Without a name all keys are in tables, below an empty line, so that lines in
            # messages stay those of document().
            document = f'name = "survey"{document}'
        named = [(name, columns_of(table, TRAJECTORY_COLUMNS)) for name, table in self._trajectories.items()]
        text = (self._document_name(), document, named)
        return _vlscan.Request(options, document=text, scene=scene, trajectory=trajectory, pulses=pulses)

    def _document_name(self) -> str:
        """Return the name of the document in memory, in the folder that it named when the survey was made."""
        folder, file = os.path.split(self._name)
        place = place_of(folder, self._folder) if folder else folder
        return self._name if place == folder else os.path.join(place, file)

    def _flight(self, options: dict[str, object]) -> _vlscan.Request:
        """Return the request of a run. A survey of objects without scene, scanner or flight is an error that names arguments."""
        if self._file is None and self._text is None:
            there = {"scene": self.scene, "scanner": self.scanner, "legs and no trajectory": self.legs or self.trajectory is not None}
            missing = [name for name, value in there.items() if not value]
            if missing:
                raise InputError(f"the survey has no {', no '.join(missing)}: vlscan.Survey(scene, scanner, [vlscan.Leg((x, y, z), ...)])")
        return self._request(options)

    def run(
        self,
        to: PathLike | Iterable[PathLike] | None = None,
        *,
        waveforms: bool | None = None,
        pulses: bool | None = None,
        progress: Progress | bool | None = None,
        **options: Unpack[RunOptions],
    ) -> Result:
        """Fly and measure the survey.

        Parameters
        ----------
        to : str, path-like or iterable of them, optional
            Files that are written, whose extensions tell the format (``.laz``, ``.copc.laz``, ``.las``, ``.parquet``,
            ``.geo.parquet``, ``.arrow``, ``.ply``, ``.csv``, ``.xyz``). Without it the points stay in memory.
        waveforms, pulses : bool, optional
            Whether they are recorded, too.
        progress : callable or bool, optional
            A function that is called about twenty times per second with the keywords ``pulses``, ``points``, ``leg`` and ``done`` (0
            to 1); or whether to show a bar of tqdm. By default there is a bar in notebooks where tqdm is installed.
        **options : RunOptions
            Options of the command line with underscores, for example ``seed``, ``threads``, ``columns`` (a list), ``misses``,
            ``physics`` (``"helios"`` or ``"refined"``, by default the former for XML surveys and the latter for others),
            ``force`` (replace files), ``output`` (a folder in the layout of HELIOS++, instead of ``to``): see
            :func:`vlscan.options`. ``False`` undoes a switch that the survey's pipeline file sets.

        Returns
        -------
        Result
            The points, or the names of the files.

        Raises
        ------
        InputError
            Input is invalid.
        FileError
            A file cannot be read or written.
        TypeError
            No option has such a name.
        ValueError
            An option of files where none are written.
        KeyboardInterrupt
            Ctrl-C has ended the run; what was measured is in ``NAME.partial.EXT``.

        Examples
        --------
        >>> survey = vlscan.Survey.open("fixtures/room/survey.xml")
        >>> survey.run(seed=1, columns=["X", "Y", "Z"]).points.columns
        ['X', 'Y', 'Z']
        >>> survey.run(to="room.laz", seed=1, force=True).files
        ['room.laz']
        """
        values, tables = recorded(to, waveforms, pulses, options, Survey.run)
        with shown_progress(progress) as tell:
            return Result(_vlscan.run(self._flight(values), tables, tell))

    def dry_run(self, to: PathLike | Iterable[PathLike] | None = None, **options: Unpack[RunOptions]) -> DryRun:
        """Estimate what a run will cost and give: pulses, points, density, spacing, sizes of files, memory, time, what it misses.

        Legs and pulses are counted or, of long flights, computed; the rest comes from a sample that is measured.

        Parameters
        ----------
        to : str, path-like or iterable of them, optional
            Files whose sizes are estimated; none is written.
        **options : RunOptions
            As for :meth:`run`.

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
        values, _ = recorded(to, None, None, options, Survey.dry_run)
        return DryRun.of(_vlscan.dry_run(self._flight(values)))

    def fly_trajectory(self, interval: float | None = None, *, true: bool = False, **options: Unpack[RunOptions]) -> Table:
        """Fly the survey without measuring, and return the poses of the platform.

        Parameters
        ----------
        interval : float, optional
            Time from pose to pose, s; by default that of the survey, else 0.05.
        true : bool
            Whether the poses are without errors of navigation.
        **options : RunOptions
            As for :meth:`run`.

        Returns
        -------
        Table
            Columns time (s), x, y, z (m), roll, pitch, yaw (degrees), which :class:`Survey` takes as trajectory.

        Raises
        ------
        InputError
            Input is invalid.
        TypeError
            The interval is a text.
        ValueError
            The interval is not above 0.

        Examples
        --------
        >>> poses = vlscan.Survey.open("fixtures/terrain/survey.xml").fly_trajectory(interval=0.5)
        >>> poses.columns
        ['time', 'x', 'y', 'z', 'roll', 'pitch', 'yaw']
        """
        given: object = interval
        if isinstance(given, str):
            raise TypeError(f"interval is {given!r}, expected a number of seconds")
        if interval is not None and not 0 < interval < float("inf"):
            raise ValueError(f"interval is {interval}, expected seconds above 0")
        values = values_of(options, Survey.fly_trajectory, writes_files=False)
        return Table(_vlscan.fly(self._flight(values), "poses", interval, true))

    def fly_pulses(self, **options: Unpack[RunOptions]) -> Table:
        """Fly the survey without measuring, and return its pulses.

        Parameters
        ----------
        **options : RunOptions
            As for :meth:`run`.

        Returns
        -------
        Table
            The columns of ``vlscan pulses``, which :func:`trace` takes: times (s), origins, directions and others.

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
        values = values_of(options, Survey.fly_pulses, writes_files=False)
        return Table(_vlscan.fly(self._flight(values), "pulses", None, False))

    def run_batches(
        self,
        rows: int = 1_000_000,
        per_leg: bool = False,
        seconds: float | None = None,
        *,
        batch_columns: Iterable[str] | None = None,
        to: PathLike | Iterable[PathLike] | None = None,
        waveforms: bool | None = None,
        pulses: bool | None = None,
        **options: Unpack[RunOptions],
    ) -> Batches:
        """Fly and measure the survey, and yield the points in batches while it does.

        Memory does not grow with the number of points: the run waits until batches are taken. Leaving the loop ends the run, and
        so does leaving a block of ``with survey.run_batches() as batches:``.

        Parameters
        ----------
        rows : int
            Number of points of a batch.
        per_leg : bool
            Whether a batch ends with its leg, too.
        seconds : float, optional
            A batch ends at every multiple of so many seconds of ``GpsTime``, too: 0.1 yields the sweeps of a scanner that turns
            ten times per second.
        batch_columns : iterable of str, optional
            Columns of the batches, of those that :func:`vlscan.columns` lists; by default the option ``columns``, which files
            of text, Arrow and Parquet have, too.
        to, waveforms, pulses : object
            As for :meth:`run`: files that are written, too, and what is recorded beside the points.
        **options : RunOptions
            As for :meth:`run`.

        Returns
        -------
        Batches
            The batches, an iterator of :class:`Points`; its ``result`` is that of the run after the last one.

        Raises
        ------
        InputError
            Input is invalid.
        TypeError
            No option has such a name.
        ValueError
            An option of files, an interval that is not above 0, or less than one row.

        Examples
        --------
        >>> survey = vlscan.Survey.open("fixtures/room/survey.xml")
        >>> sum(len(batch) for batch in survey.run_batches(1000, seed=1)) == survey.run(seed=1).point_count
        True
        """
        values, tables = recorded(to, waveforms, pulses, options, Survey.run_batches)
        if isinstance(rows, bool) or (seconds is not None and isinstance(seconds, (str, bool))):
            raise TypeError(f"rows and seconds are numbers, found {rows!r} and {seconds!r}")
        if seconds is not None and not 0 < seconds < float("inf"):
            raise ValueError(f"seconds is {seconds}, expected more than 0")
        if not hasattr(rows, "__index__"):
            raise TypeError(f"rows is {rows!r}, expected a whole number")
        count = min(operator.index(rows), 2**62)
        if count < 1:
            raise ValueError(f"rows is {count}, expected at least 1")
        beside = [table for table in tables if table != "points"]
        chosen = None if batch_columns is None else [batch_columns] if isinstance(batch_columns, str) else list(batch_columns)
        return Batches(partial(_vlscan.run_batches, self._flight(values), count, per_leg, seconds, 2, beside, chosen))

    def __repr__(self) -> str:
        what = [repr(self._file)] if self._file else ["pipeline"] if self._text else []
        what += [f"{key}={value!r}" for key, value in self._keys().items() if key != "leg"]
        if "legs" in self.__dict__ and (self.legs or not self._text):
            # Those of a file may not have been read yet.
            what.append(f"{len(self.legs)} leg{'' if len(self.legs) == 1 else 's'}")
        return f"Survey({', '.join(what)})"


def run(
    survey: Survey | PathLike,
    to: PathLike | Iterable[PathLike] | None = None,
    *,
    waveforms: bool | None = None,
    pulses: bool | None = None,
    progress: Progress | bool | None = None,
    **options: Unpack[RunOptions],
) -> Result:
    """Run a survey.

    Parameters
    ----------
    survey : Survey, str or path-like
        A survey, or its file.
    to, waveforms, pulses, progress : object
        As for :meth:`Survey.run`.
    **options : RunOptions
        As for :meth:`Survey.run`.

    Returns
    -------
    Result
        The points, or the names of the files.

    Examples
    --------
    >>> result = vlscan.run("fixtures/room/survey.xml", seed=1)
    >>> result.points.units["X"]
    'm'
    """
    return opened(survey).run(to, waveforms=waveforms, pulses=pulses, progress=progress, **options)


def run_batches(
    survey: Survey | PathLike,
    rows: int = 1_000_000,
    per_leg: bool = False,
    seconds: float | None = None,
    *,
    batch_columns: Iterable[str] | None = None,
    to: PathLike | Iterable[PathLike] | None = None,
    waveforms: bool | None = None,
    pulses: bool | None = None,
    **options: Unpack[RunOptions],
) -> Batches:
    """Run a survey batch by batch.

    Parameters
    ----------
    survey : Survey, str or path-like
        A survey, or its file.
    rows, per_leg, seconds, batch_columns, to, waveforms, pulses : object
        As for :meth:`Survey.run_batches`.
    **options : RunOptions
        As for :meth:`Survey.run`.

    Returns
    -------
    Batches
        The batches, an iterator of :class:`Points`.

    Examples
    --------
    >>> [set(leg["PointSourceId"].tolist()) for leg in vlscan.run_batches("fixtures/room/survey.xml", per_leg=True)]
    [{1}, {2}]
    """
    return opened(survey).run_batches(
        rows, per_leg, seconds, batch_columns=batch_columns, to=to, waveforms=waveforms, pulses=pulses, **options
    )


def dry_run(survey: Survey | PathLike, to: PathLike | Iterable[PathLike] | None = None, **options: Unpack[RunOptions]) -> DryRun:
    """Estimate what a run will cost and give.

    Parameters
    ----------
    survey : Survey, str or path-like
        A survey, or its file.
    to : object
        As for :meth:`Survey.dry_run`.
    **options : RunOptions
        As for :meth:`Survey.run`.

    Returns
    -------
    DryRun
        The estimates.

    Examples
    --------
    >>> forecast = vlscan.dry_run("fixtures/room/survey.xml")
    >>> abs(forecast.points.value / vlscan.run("fixtures/room/survey.xml").point_count - 1) < 0.1
    True
    """
    return opened(survey).dry_run(to, **options)


def trajectory(survey: Survey | PathLike, interval: float | None = None, *, true: bool = False, **options: Unpack[RunOptions]) -> Table:
    """Fly a survey without measuring, and return the poses of the platform.

    Parameters
    ----------
    survey : Survey, str or path-like
        A survey, or its file.
    interval, true : object
        As for :meth:`Survey.fly_trajectory`.
    **options : RunOptions
        As for :meth:`Survey.run`.

    Returns
    -------
    Table
        The poses.

    Examples
    --------
    >>> poses = vlscan.trajectory("fixtures/terrain/survey.xml", interval=0.25)
    >>> round(float(poses["time"][1] - poses["time"][0]), 2)
    0.25
    """
    return opened(survey).fly_trajectory(interval, true=true, **options)


def pulses(survey: Survey | PathLike, **options: Unpack[RunOptions]) -> Table:
    """Fly a survey without measuring, and return its pulses.

    Parameters
    ----------
    survey : Survey, str or path-like
        A survey, or its file.
    **options : RunOptions
        As for :meth:`Survey.run`.

    Returns
    -------
    Table
        The pulses, which :func:`trace` takes.

    Examples
    --------
    >>> vlscan.pulses("fixtures/room/survey.xml").columns[:7]
    ['time', 'x', 'y', 'z', 'dx', 'dy', 'dz']
    """
    return opened(survey).fly_pulses(**options)


def trace(
    scene: Scene | PathLike | Part | Iterable[Part],
    origins: ArrayLike | None = None,
    directions: ArrayLike | None = None,
    *,
    scanner: Scanner | str | Mapping[str, object] = "riegl_vz400",
    time: ArrayLike | None = None,
    pulses: TableLike | ArrayLike | None = None,
    waveform: Mapping[str, object] | None = None,
    detector: Mapping[str, object] | None = None,
    to: PathLike | Iterable[PathLike] | None = None,
    waveforms: bool | None = None,
    progress: Progress | bool | None = None,
    **options: Unpack[RunOptions],
) -> Result:
    """Trace pulses of your own pattern through a scene.

    Parameters
    ----------
    scene : Scene, str, path-like, Part or iterable of Part
        What is scanned.
    origins : array_like, optional
        Origins of the pulses, n by 3, world frame, m, or one for all.
    directions : array_like, optional
        Directions of the pulses, n by 3, of any length, or one for all.
    scanner : Scanner, str or mapping
        What receives the echoes: its beam, its detector.
    time : array_like, optional
        Times of emission, s; 0 by default.
    pulses : mapping, Arrow table or structured array, optional
        A table instead of origins and directions, with the columns x, y, z, dx, dy, dz and others that ``vlscan pulses`` writes.
    waveform, detector : mapping, optional
        As for :class:`Survey`.
    to, waveforms, progress : object
        As for :meth:`Survey.run`.
    **options : RunOptions
        As for :meth:`Survey.run`.

    Returns
    -------
    Result
        The points, or the names of the files.

    Raises
    ------
    TypeError
        Neither pulses nor origins and directions are given, or both; or times that are no numbers.
    ValueError
        Origins, directions or times have another shape.

    Examples
    --------
    >>> floor = vlscan.Part.mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2, 3]])
    >>> down = np.broadcast_to([0, 0, -1], (3, 3))
    >>> points = vlscan.trace(floor, [[0, 0, 5], [1, 0, 5], [99, 0, 5]], down).points
    >>> points["X"].round(3).tolist()
    [0.0, 1.0]
    """
    survey = Survey(scene, scanner, waveform=waveform, detector=detector, name="trace")
    if pulses is None:
        if origins is None or directions is None:
            raise TypeError("trace() needs origins and directions, or pulses")
        starts, ends = rays_of(origins, directions)
        columns: dict[str, ArrayLike] = {name: starts[:, axis] for axis, name in enumerate("xyz")}
        columns |= {f"d{name}": ends[:, axis] for axis, name in enumerate("xyz")}
        if time is not None:
            if np.asarray(time).dtype.kind in "mM":
                raise TypeError("time holds calendar times or durations, expected seconds")
            times = np.asarray(unmasked("time", time), float)
            if times.shape not in ((), (1,), (len(ends),)):
                raise ValueError(f"time has the shape {times.shape}, expected one number or {len(ends)}")
            columns["time"] = np.broadcast_to(times, len(ends))
        pulses = columns
    elif not (origins is None and directions is None and time is None):
        raise TypeError("trace() takes either pulses or origins, directions and time, which are columns of pulses")
    values, tables = recorded(to, waveforms, None, options, trace)
    with shown_progress(progress) as tell:
        return Result(_vlscan.run(survey._request(values, columns_of(pulses, ())), tables, tell))


def _listed(value: object) -> list[object]:
    """Return a value as a list; none is empty."""
    return [] if value is None else value if isinstance(value, list) else [value]


def opened(survey: Survey | PathLike) -> Survey:
    """Return a survey, or that of a file."""
    return survey if isinstance(survey, Survey) else Survey.open(survey)


def recorded(
    to: PathLike | Iterable[PathLike] | None,
    waveforms: bool | None,
    pulses: bool | None,
    options: Mapping[str, object],
    call: Callable[..., object],
) -> tuple[dict[str, object], list[str]]:
    """Return the values of a run's options, and the tables that it leaves in memory; ``call`` as for :func:`values_of`."""
    recorded = {"waveforms": waveforms, "pulses": pulses}
    if to is None and options.get("output") is None:
        # The run counts the points of its first table.
        tables = ["points", *(name for name, is_wanted in recorded.items() if is_wanted), "trajectory"]
        return values_of(options, call, writes_files=False), tables
    switches = {name: is_wanted for name, is_wanted in recorded.items() if is_wanted is not None}
    values = {**values_of(options, call), **switches}
    if to is None:
        return values, ["trajectory"]
    if "output" in values:
        raise ValueError("give either to, the names of files, or output, a folder in the layout of HELIOS++")
    if not isinstance(to, (str, bytes, os.PathLike, Iterable)):
        raise TypeError(f"to is the name of a file, or several, found {type(to).__name__}")
    files = [to] if isinstance(to, (str, bytes, os.PathLike)) else list(to)
    if not files:
        raise ValueError("to names no file; without it the points stay in memory")
    return {**values, "out": [os.fsdecode(file) for file in files]}, ["trajectory"]
