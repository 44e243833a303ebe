"""Scanners of simulations by the names of version 2: their figures, as XML has them."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, ClassVar
from xml.etree.ElementTree import Element, ParseError, parse

from vlscan.errors import InputError
from vlscan_helios.v3.utils import find_file
from vlscan_helios.v3.xml_files import float_of

from .views import Instrument


class Detector:
    """The detector of a scanner: its accuracy and the ranges that it measures, m.

    Parameters
    ----------
    entry : xml.etree.ElementTree.Element
        The entry of the scanner in its file.
    """

    def __init__(self, entry: Element) -> None:
        #: Standard deviation of ranges, m.
        self.accuracy = float_of(entry.get("accuracy_m"), 0)
        #: Ranges that are measured, m; infinite without a limit.
        self.rangeMin, self.rangeMax = float_of(entry.get("rangeMin_m"), 0), float_of(entry.get("rangeMax_m"), math.inf)

    def getAccuracy(self) -> float:
        """Return the standard deviation of ranges, m."""
        return self.accuracy

    def getRangeMin(self) -> float:
        """Return the shortest range, m."""
        return self.rangeMin

    def getRangeMax(self) -> float:
        """Return the longest range, m."""
        return self.rangeMax


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
            return float_of(self._entry.get(attribute), default) / divisor
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
        return [int(float_of(word, 0)) for word in self._entry.get("pulseFreqs_Hz", "0").split(",")]

    def getSupportedPulseFrequencies(self) -> list[int]:
        """Return the pulse frequencies, Hz."""
        return self.pulseFreqs

    def getPulseFreqs(self) -> list[int]:
        """Return the pulse frequencies, Hz."""
        return self.pulseFreqs

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
