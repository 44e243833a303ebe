"""Surveys, legs and settings of simulations by the names of version 2, over the objects of :mod:`vlscan_helios.v3`."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from math import dist
from typing import TYPE_CHECKING, Any, ClassVar

from vlscan_helios.v3 import DynamicPlatformSettings, Leg, Survey

from .scene import SceneView
from .templates import Template

if TYPE_CHECKING:
    from .scanner import ScannerView


class View:
    """An object whose values have other names, with functions ``getName()``, ``isName()`` and ``setName(value)``.

    Parameters
    ----------
    model : object
        The object.
    is_started : callable
        Returns whether the simulation has been started: values cannot be set afterwards.
    """

    #: Names of values, and those of the object.
    NAMES: ClassVar[dict[str, str]] = {}

    def __init__(self, model: Any, is_started: Callable[[], bool]) -> None:
        object.__setattr__(self, "_model", model)
        object.__setattr__(self, "_is_started", is_started)

    def _known(self, name: str) -> str:
        names = type(self).NAMES
        if name in names:
            return names[name]
        raise AttributeError(f"no attribute {name!r} of {type(self).__name__}; there are {', '.join(names)}")

    def __getattr__(self, name: str) -> Any:
        found = re.fullmatch("(get|is|set)([A-Z])(.*)", name)
        if found is None or name in type(self).NAMES:
            return getattr(self._model, self._known(name))
        own = found[2].lower() + found[3]
        self._known(own)
        if found[1] == "set":
            return partial(setattr, self, own)
        return partial(getattr, self, own)

    def __setattr__(self, name: str, value: Any) -> None:
        if self._is_started():
            raise RuntimeError("the simulation has been started; change its survey before")
        own = getattr(type(self), name, None)
        if isinstance(own, property):
            own.__set__(self, value)
            return
        setattr(self._model, self._known(name), value)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *type(self).NAMES]

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._model!r}>"


class Settings(View):
    """Settings of a leg, which may name a template in the file of the survey.

    Parameters
    ----------
    model : object
        The settings.
    is_started : callable
        Returns whether the simulation has been started.
    template : callable
        Returns the template.
    """

    def __init__(self, model: Any, is_started: Callable[[], bool], template: Callable[[], Template | None] = lambda: None) -> None:
        super().__init__(model, is_started)
        object.__setattr__(self, "_template", template)

    def hasTemplate(self) -> bool:
        """Return whether the settings name a template; their values are those that hold, the template's included."""
        return self._template() is not None

    def getTemplate(self) -> Template:
        """Return the template."""
        found: Template | None = self._template()
        if found is None:
            raise ValueError("the settings name no template; hasTemplate() tells")
        return found


class ScannerSettings(Settings):
    """Scanner settings of a leg; SI units, angles in rad."""

    NAMES: ClassVar[dict[str, str]] = {
        **{"active": "is_active", "pulseFreq": "pulse_frequency", "scanFreq": "scan_frequency", "scanAngle": "scan_angle"},
        **{"headRotatePerSec": "head_rotation", "headRotateStart": "rotation_start_angle", "headRotateStop": "rotation_stop_angle"},
        **{"verticalAngleMin": "min_vertical_angle", "verticalAngleMax": "max_vertical_angle"},
        **{"beamDivAngle": "beam_divergence_angle", "beamDivergenceAngle": "beam_divergence_angle"},
        **{"trajectoryTimeInterval": "trajectory_time_interval"},
        **{"verticalResolution": "vertical_resolution", "horizontalResolution": "horizontal_resolution"},
    }


class PlatformSettings(Settings):
    """Start of a leg, m, and speed of the platform, m/s."""

    NAMES: ClassVar[dict[str, str]] = {
        **{"x": "x", "y": "y", "z": "z", "onGround": "force_on_ground"},
        **{"movePerSec": "speed_m_s", "speed": "speed_m_s"},
    }

    if TYPE_CHECKING:
        x: float
        y: float
        z: float

    @property
    def position(self) -> tuple[float, float, float]:
        """The place, m."""
        return self.x, self.y, self.z

    @position.setter
    def position(self, position: Any) -> None:
        self.x, self.y, self.z = position

    def __getattr__(self, name: str) -> Any:
        if type(self).NAMES.get(name) == "speed_m_s" and not hasattr(self._model, "speed_m_s"):
            # Of a platform that stands, which has no speed.
            return float(DynamicPlatformSettings().speed_m_s)
        return super().__getattr__(name)

    def getPosition(self) -> tuple[float, float, float]:
        """Return the place, m."""
        return self.position

    def setPosition(self, *position: Any) -> None:
        """Set the place: three numbers, or a sequence of them, m."""
        self.x, self.y, self.z = position[0] if len(position) == 1 else position


class LegView(View):
    """A leg.

    Parameters
    ----------
    model : vlscan_helios.v3.Leg
        The leg.
    is_started : callable
        Returns whether the simulation has been started.
    survey : SurveyView, optional
        The survey whose leg it is.
    """

    NAMES: ClassVar[dict[str, str]] = {}

    def __init__(self, model: Any, is_started: Callable[[], bool], survey: SurveyView | None = None) -> None:
        super().__init__(model, is_started)
        object.__setattr__(self, "_survey", survey)

    @property
    def serialId(self) -> int:
        """Number of the leg, from 0. Setting it has no effect: it follows from the order of the legs."""
        return -1 if self._survey is None else self._survey.index_of(self._model)

    @serialId.setter
    def serialId(self, number: int) -> None:
        pass

    @property
    def length(self) -> float:
        """Length of the way to the next leg, m; 0 of the last one."""
        legs = [] if self._survey is None else self._survey.legs
        following = legs[self.serialId + 1 : self.serialId + 2]
        return dist(self.platformSettings.position, following[0].platformSettings.position) if following else 0.0

    def getLength(self) -> float:
        """Return the length of the way to the next leg, m; 0 of the last one."""
        return self.length

    def _template(self, kind: str) -> Template | None:
        return None if self._survey is None else self._survey.template(self._model, kind)

    @property
    def scannerSettings(self) -> ScannerSettings:
        """Scanner settings."""
        return ScannerSettings(self._model.scanner_settings, self._is_started, partial(self._template, "scanner"))

    @property
    def platformSettings(self) -> PlatformSettings:
        """Platform settings: the start of the leg."""
        return PlatformSettings(self._model.platform_settings, self._is_started, partial(self._template, "platform"))

    def getScannerSettings(self) -> ScannerSettings:
        """Return what the scanner does."""
        return self.scannerSettings

    def getPlatformSettings(self) -> PlatformSettings:
        """Return where it begins."""
        return self.platformSettings


class Instrument(View):
    """A platform or a scanner."""

    NAMES: ClassVar[dict[str, str]] = {"name": "name", "reference": "reference"}

    @property
    def id(self) -> str:
        """Id in its file."""
        return str(self._model.reference).rpartition("#")[2]

    def getId(self) -> str:
        """Return the id in its file."""
        return self.id


class SurveyView(View):
    """A survey.

    Parameters
    ----------
    model : vlscan_helios.v3.Survey
        The survey.
    is_started : callable
        Returns whether the simulation has been started.
    as_read : sequence of Leg
        Its legs as they were read from its file.
    """

    NAMES: ClassVar[dict[str, str]] = {"name": "name"}

    def __init__(self, model: Any, is_started: Callable[[], bool], as_read: Sequence[Leg] = ()) -> None:
        super().__init__(model, is_started)
        object.__setattr__(self, "_as_read", as_read)

    def index_of(self, leg: Leg) -> int:
        """Return the number of a leg, from 0; -1 for one that was removed."""
        return _index_of(leg, self._model.legs)

    def template(self, leg: Leg, kind: str) -> Template | None:
        """Return the template that settings of a leg name in the file of the survey; ``None`` for none, and for a copy of a leg."""
        source = leg.source if _index_of(leg, self._as_read) >= 0 else None
        found = None if source is None else source.templates.get(kind)
        return None if found is None else Template(found, kind)

    @property
    def legs(self) -> Sequence[LegView]:
        """The legs."""
        return [LegView(leg, self._is_started, self) for leg in self._model.legs]

    @property
    def scanner(self) -> ScannerView:
        """The scanner."""
        from .scanner import ScannerView

        return ScannerView(self._model.scanner, self._is_started)

    @property
    def platform(self) -> Instrument:
        """The carrier of a scanner."""
        return Instrument(self._model.platform, self._is_started)

    def getScanner(self) -> ScannerView:
        """Return the scanner."""
        return self.scanner

    def getPlatform(self) -> Instrument:
        """Return what carries the scanner."""
        return self.platform

    @property
    def length(self) -> float:
        """Length of the way from leg to leg, m."""
        places = [LegView(leg, self._is_started).platformSettings.position for leg in self._model.legs]
        return sum(dist(place, next_place) for place, next_place in pairwise(places))

    def getLength(self) -> float:
        """Return the length of the way from leg to leg, m."""
        return self.length

    def calculateLength(self) -> float:
        """Return the length of the way from leg to leg, m; it needs no calculation before :meth:`getLength`."""
        return self.length

    @property
    def numLegs(self) -> int:
        """Number of legs."""
        return len(self._model.legs)

    def getNumLegs(self) -> int:
        """Return the number of legs."""
        return self.numLegs

    def getLegs(self) -> Sequence[LegView]:
        """Return the legs."""
        return self.legs

    def getLeg(self, index: int) -> LegView:
        """Return a leg, from 0."""
        self._check(index)
        return self.legs[index]

    def newLeg(self, index: int) -> LegView:
        """Insert a copy of the leg before, or of the first one, at an index and return it; the first leg of all has defaults."""
        legs: list[Leg] = list(self._model.legs)
        if not 0 <= index <= len(legs):
            raise IndexError(f"index of a new leg is {index}, expected 0 to {len(legs)}")
        if legs:
            self._replace([*legs[:index], legs[max(index - 1, 0)].clone(), *legs[index:]])
        elif self._is_started():
            raise RuntimeError("the simulation has been started; change its survey before")
        else:
            self._model.add_leg()
        return self.legs[index]

    def removeLeg(self, index: int) -> None:
        """Remove a leg."""
        self._check(index)
        self._replace([leg for number, leg in enumerate(self._model.legs) if number != index])

    def _replace(self, legs: Sequence[Leg]) -> None:
        if self._is_started():
            raise RuntimeError("the simulation has been started; change its survey before")
        self._model.legs = tuple(legs)

    def _check(self, index: int) -> None:
        if not 0 <= index < self.numLegs:
            raise IndexError(f"index of a leg is {index}, and there are {self.numLegs} legs")


def _index_of(leg: Leg, legs: Sequence[Leg]) -> int:
    return next((number for number, other in enumerate(legs) if other is leg), -1)


# Functions of a simulation that its playback has, too.
_OF_SIMULATION = ("copy", "start", "pause", "resume", "stop", "join", "isStarted", "isRunning", "isPaused", "isStopped", "isFinished")


class Playback:
    """The survey that a simulation plays.

    Parameters
    ----------
    model : vlscan_helios.v3.Survey
        The survey.
    is_started : callable
        Returns whether the simulation has been started.
    file : str
        Its file.
    as_read : sequence of Leg
        Its legs as they were read from the file.
    """

    #: The simulation that plays it, whose functions it has, too.
    simulation: Any = None

    def __init__(self, model: Survey, is_started: Callable[[], bool], file: str = "", as_read: Sequence[Leg] = ()) -> None:
        self._survey, self._scene, self._file = SurveyView(model, is_started, as_read), SceneView(model.scene), file

    def getSurveyPath(self) -> str:
        """Return the file of the survey."""
        return self._file

    def getScene(self) -> SceneView:
        """Return the scene."""
        return self._scene

    @property
    def scene(self) -> SceneView:
        """The scene."""
        return self._scene

    def newLeg(self, index: int) -> LegView:
        """Insert a leg, as :meth:`SurveyView.newLeg` does."""
        return self._survey.newLeg(index)

    def removeLeg(self, index: int) -> None:
        """Remove a leg."""
        self._survey.removeLeg(index)

    def getSurvey(self) -> SurveyView:
        """Return the survey."""
        return self._survey

    def getScanner(self) -> ScannerView:
        """Return the scanner."""
        return self._survey.scanner

    def getPlatform(self) -> Instrument:
        """Return what carries the scanner."""
        return self._survey.platform

    def getNumLegs(self) -> int:
        """Return the number of legs."""
        return self._survey.numLegs

    def getLeg(self, index: int) -> LegView:
        """Return a leg, from 0."""
        return self._survey.getLeg(index)

    @property
    def survey(self) -> SurveyView:
        """The survey."""
        return self._survey

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name in _OF_SIMULATION and self.simulation is not None:
                return getattr(self.simulation, name)
            known = [*(key for key in dir(type(self)) if not key.startswith("_")), *_OF_SIMULATION]
            raise AttributeError(f"sim has no {name!r}; it has {', '.join(known)}")
