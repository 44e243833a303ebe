"""Surveys as objects, files and documents in memory, and the requests to the engine that they become."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, TypedDict

from numpy.typing import ArrayLike

from . import _toml, _vlscan
from ._arguments import suggesting
from ._arguments import text as checked_text
from ._checked import Checked
from ._columns import EngineTable, columns_of
from ._typing import PathLike, TableLike
from ._values import values_of
from .contents import References, SurveyContents
from .errors import InputError
from .instruments import Platform, Scanner
from .legs import Leg, keys_of, legs_of
from .parts import Part
from .places import asset_folders, place_of, working_folder
from .scene import Scene

if TYPE_CHECKING:
    from typing_extensions import Self, Unpack

    from ._checked import Converted
    from ._options import RunOptions

#: Columns of a trajectory as an array.
TRAJECTORY_COLUMNS = ("time", "x", "y", "z", "roll", "pitch", "yaw")


class SurveyArguments(TypedDict, total=False):
    """Arguments of :class:`vlscan.Survey` but its scene."""

    scanner: Scanner | str | Mapping[str, object] | None
    legs: Iterable[Leg]
    platform: Platform | str | None
    trajectory: PathLike | TableLike | ArrayLike | None
    settings: Mapping[str, object] | None
    waveform: Mapping[str, object] | None
    detector: Mapping[str, object] | None
    name: str | None


class SurveyDescription(Checked):
    """The attributes of :class:`vlscan.Survey`, and what the engine gets of them."""

    _ATTRIBUTES: ClassVar[tuple[str, ...]] = (
        *("scene", "scanner", "legs", "platform", "trajectory", "settings", "waveform", "detector", "name"),
    )

    if TYPE_CHECKING:
        # None is Any where a file may have the value: pyright does not narrow attributes that convert.
        scene: Converted[Scene | Any, Scene | PathLike | Part | Iterable[Part] | None] = Converted()
        scanner: Converted[Scanner | Any, Scanner | str | Mapping[str, object] | None] = Converted()
        legs: Converted[list[Leg], Iterable[Leg]] = Converted()
        platform: Converted[Platform | Any, Platform | str | None] = Converted()
        settings: Converted[dict[str, object], Mapping[str, object] | None] = Converted()
        waveform: Converted[dict[str, object], Mapping[str, object] | None] = Converted()
        detector: Converted[dict[str, object], Mapping[str, object] | None] = Converted()

    @suggesting
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
        self.settings = settings
        self.waveform = waveform
        self.detector = detector
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

    @classmethod
    def from_document(
        cls,
        text: str,
        scene: Scene | PathLike | None = None,
        path: PathLike = "<python>",
        *,
        trajectories: Mapping[str, TableLike | ArrayLike] | None = None,
    ) -> Self:
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
            trajectory of :class:`vlscan.Survey`. Angles are degrees, or radians where legs have ``toRadians="false"``, composed as
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
        survey = cls(scene)
        text = checked_text("text", text)
        survey._text, survey._name = text, os.fspath(path)
        if not (trajectories is None or isinstance(trajectories, Mapping)):
            raise TypeError(f"trajectories are tables by name, found {type(trajectories).__name__}")
        survey._trajectories = dict(trajectories or {})
        return survey

    @classmethod
    def open(cls, path: PathLike, scene: Scene | PathLike | None = None, **changes: Unpack[SurveyArguments]) -> Self:
        """Open the survey of a file.

        Parameters
        ----------
        path : str or path-like
            A survey of HELIOS++ (``.xml``) or a pipeline (``.toml``).
        scene : Scene, str or path-like, optional
            Replaces the scene of the file.
        **changes : SurveyArguments
            Other arguments of :class:`vlscan.Survey`, which replace what an XML file says; of a pipeline only the trajectory can be
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
        survey = cls(scene, **changes)
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
            Options of :meth:`vlscan.Survey.run`, of which those of input files matter (``assets``).

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
        request = self._request(values_of(options, SurveyDescription.contents, writes_files=False))
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

    def __repr__(self) -> str:
        what = [repr(self._file)] if self._file else ["pipeline"] if self._text else []
        what += [f"{key}={value!r}" for key, value in self._keys().items() if key != "leg"]
        if "legs" in self.__dict__ and (self.legs or not self._text):
            # Those of a file may not have been read yet.
            what.append(f"{len(self.legs)} leg{'' if len(self.legs) == 1 else 's'}")
        return f"Survey({', '.join(what)})"


def _listed(value: object) -> list[object]:
    """Return a value as a list; ``None`` is an empty one."""
    return [] if value is None else value if isinstance(value, list) else [value]
