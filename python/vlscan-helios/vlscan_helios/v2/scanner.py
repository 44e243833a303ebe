"""Scanners of simulations by the names of version 2: their figures, as XML has them."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, ClassVar
from xml.etree.ElementTree import Element, ParseError, parse

from vlscan.errors import InputError
from vlscan_helios.v3.utils import find_file

from .templates import number_or
from .views import Instrument


class Figures:
    """Figures of a part of a scanner, which can be read, also by functions ``getName()``; SI units, angles in rad.

    Parameters
    ----------
    entry : xml.etree.ElementTree.Element
        The entry of the scanner in its file.
    """

    #: Figures: attribute of XML, value without it, divisor.
    FIGURES: ClassVar[dict[str, tuple[str, float, float]]] = {}

    def __init__(self, entry: Element) -> None:
        object.__setattr__(self, "_entry", entry)

    def __getattr__(self, name: str) -> Any:
        figures = type(self).FIGURES
        if name.startswith("get") and (own := name[3:4].lower() + name[4:]) in figures:
            return lambda: getattr(self, own)
        if name not in figures:
            raise AttributeError(f"no figure {name!r} of a {type(self).__name__}; there are {', '.join(figures)}")
        attribute, default, divisor = figures[name]
        return number_or(self._entry.get(attribute), default) / divisor

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"figures of a scanner cannot be set, found {name}; change its entry in its file")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *type(self).FIGURES]


class Detector(Figures):
    """Accuracy and ranges of a scanner, m; a range without a limit is infinite."""

    FIGURES = {"accuracy": ("accuracy_m", 0, 1), "rangeMin": ("rangeMin_m", 0, 1), "rangeMax": ("rangeMax_m", math.inf, 1)}


class ScannerHead(Figures):
    """Limit of the turns of a scanner's head."""

    FIGURES = {"rotatePerSecMax": ("headRotatePerSecMax_deg", 0, 180 / math.pi)}


class BeamDeflector(Figures):
    """Limits of a scanner's mirror."""

    FIGURES = {
        "scanFreqMin": ("scanFreqMin_Hz", 0, 1),
        "scanFreqMax": ("scanFreqMax_Hz", 0, 1),
        "scanAngleMax": ("scanAngleMax_deg", 0, 180 / math.pi),
    }


class ScannerView(Instrument):
    """A scanner, whose figures cannot be set. Those of several channels are the scanner's own.

    ``wavelength`` is in m, ``visibility`` in km, ``pulseLength`` in ns, ``beamDivergence`` in rad, ``averagePower`` in W,
    ``pulseFreqs`` in Hz.
    """

    #: Figures: attribute of XML, value without it, divisor.
    FIGURES: ClassVar[dict[str, tuple[str, float, float]]] = {
        "averagePower": ("averagePower_w", 4, 1),
        "beamDivergence": ("beamDivergence_rad", 0.0003, 1),
        "beamQuality": ("beamQualityFactor", 1, 1),
        "efficiency": ("opticalEfficiency", 0.99, 1),
        "receiverDiameter": ("receiverDiameter_m", 0.15, 1),
        "visibility": ("atmosphericVisibility_km", 23, 1),
        "wavelength": ("wavelength_nm", 1064, 1e9),
        "pulseLength": ("pulseLength_ns", 4, 1),
        "accuracy": ("accuracy_m", 0, 1),
    }

    def _known(self, name: str) -> str:
        if name in type(self).FIGURES or name in type(self).NAMES:
            return type(self).NAMES.get(name, name)
        known = ", ".join(["deviceId", "pulseFreqs", *type(self).NAMES, *type(self).FIGURES])
        raise AttributeError(f"no attribute {name!r} of a scanner; there are {known}")

    def __getattr__(self, name: str) -> Any:
        if name in type(self).FIGURES:
            attribute, default, divisor = type(self).FIGURES[name]
            return number_or(self._entry.get(attribute), default) / divisor
        return super().__getattr__(name)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"figures of a scanner cannot be set, found {name}; change its entry in {self.reference}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *type(self).FIGURES]

    @cached_property
    def _entry(self) -> Element:
        """The entry of the scanner in its file."""
        file, _, id = str(self._model.reference).partition("#")
        path = str(find_file(file))
        try:
            entries = [entry for entry in parse(path).getroot().iter("scanner") if not id or entry.get("id") == id]
        except ParseError as error:
            raise InputError(f"{path}: not well-formed XML: {error}") from None
        if not entries:
            raise InputError(f"{path}: there is no scanner {id!r}")
        return entries[0]

    @property
    def deviceId(self) -> str:
        """Id in its file."""
        return self.id

    @property
    def pulseFreqs(self) -> list[int]:
        """Pulse frequencies, Hz."""
        return [int(number_or(word, 0)) for word in self._entry.get("pulseFreqs_Hz", "0").split(",")]

    def getSupportedPulseFrequencies(self) -> list[int]:
        """Return the pulse frequencies, Hz."""
        return self.pulseFreqs

    def getPulseFreqs(self) -> list[int]:
        """Return the pulse frequencies, Hz."""
        return self.pulseFreqs

    def getScannerHead(self) -> ScannerHead:
        """Return the head."""
        return ScannerHead(self._entry)

    def getBeamDeflector(self) -> BeamDeflector:
        """Return the deflector."""
        return BeamDeflector(self._entry)

    def getDetector(self) -> Detector:
        """Return the detector."""
        return self.detector

    @property
    def detector(self) -> Detector:
        """The detector."""
        return Detector(self._entry)

    def toString(self) -> str:
        """Return the figures as lines of text."""
        rows = {"Device": self.id, **{name: getattr(self, name) for name in type(self).FIGURES}, "pulseFreqs": self.pulseFreqs}
        return "\n".join(f"{name}: {value}" for name, value in rows.items())
