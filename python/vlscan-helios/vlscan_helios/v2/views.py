"""Surveys, legs and settings of simulations by the names of version 2, over the objects of :mod:`vlscan_helios.v3`."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from math import dist
from typing import TYPE_CHECKING, Any, ClassVar

from vlscan_helios.v3 import Leg, Survey

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
        setattr(self._model, self._known(name), value)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *type(self).NAMES]

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._model!r}>"


class ScannerSettings(View):
    """What the scanner does on a leg; SI units, angles in rad."""

    NAMES: ClassVar[dict[str, str]] = {
        **{"active": "is_active", "pulseFreq": "pulse_frequency", "scanFreq": "scan_frequency", "scanAngle": "scan_angle"},
        **{"headRotatePerSec": "head_rotation", "headRotateStart": "rotation_start_angle", "headRotateStop": "rotation_stop_angle"},
        **{"verticalAngleMin": "min_vertical_angle", "verticalAngleMax": "max_vertical_angle"},
        **{"beamDivAngle": "beam_divergence_angle", "beamDivergenceAngle": "beam_divergence_angle"},
        **{"trajectoryTimeInterval": "trajectory_time_interval"},
        **{"verticalResolution": "vertical_resolution", "horizontalResolution": "horizontal_resolution"},
    }


class PlatformSettings(View):
    """Where a leg begins, m, and how fast the platform moves, m/s."""

    NAMES: ClassVar[dict[str, str]] = {
        **{"x": "x", "y": "y", "z": "z", "onGround": "force_on_ground"},
        **{"movePerSec": "speed_m_s", "speed": "speed_m_s"},
    }

    @property
    def position(self) -> tuple[float, float, float]:
        """The place, m."""
        return self.x, self.y, self.z

    def getPosition(self) -> tuple[float, float, float]:
        """Return the place, m."""
        return self.position

    def setPosition(self, *position: Any) -> None:
        """Set the place: three numbers, or a sequence of them, m."""
        self.x, self.y, self.z = position[0] if len(position) == 1 else position


class LegView(View):
    """A leg."""

    NAMES: ClassVar[dict[str, str]] = {}

    @property
    def scannerSettings(self) -> ScannerSettings:
        """What the scanner does."""
        return ScannerSettings(self._model.scanner_settings, self._is_started)

    @property
    def platformSettings(self) -> PlatformSettings:
        """Where it begins."""
        return PlatformSettings(self._model.platform_settings, self._is_started)

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
    """A survey."""

    NAMES: ClassVar[dict[str, str]] = {"name": "name"}

    @property
    def legs(self) -> Sequence[LegView]:
        """The legs."""
        return [LegView(leg, self._is_started) for leg in self._model.legs]

    @property
    def scanner(self) -> ScannerView:
        """The scanner."""
        from .scanner import ScannerView

        return ScannerView(self._model.scanner, self._is_started)

    @property
    def platform(self) -> Instrument:
        """What carries the scanner."""
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
        """Insert a copy of the leg before, or of the first one, at an index and return it."""
        legs: list[Leg] = list(self._model.legs)
        if not 0 <= index <= len(legs) or not legs:
            raise IndexError(f"index of a new leg is {index}, expected 0 to {len(legs)}")
        self._replace([*legs[:index], legs[max(index - 1, 0)].clone(), *legs[index:]])
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


class Playback:
    """What a simulation plays: its survey.

    Parameters
    ----------
    model : vlscan_helios.v3.Survey
        The survey.
    is_started : callable
        Returns whether the simulation has been started.
    """

    def __init__(self, model: Survey, is_started: Callable[[], bool]) -> None:
        self._survey = SurveyView(model, is_started)

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
            raise AttributeError(f"sim has no {name!r}; it has getSurvey(), getScanner(), getPlatform(), getNumLegs() and getLeg(index)")
