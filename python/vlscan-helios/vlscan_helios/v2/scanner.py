"""Scanners of simulations by the names of version 2, with the figures that the engine uses."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, ClassVar

from vlscan import DeviceFigures, ScannerFigures, scanner_figures

from .views import Instrument


def _figure(device: DeviceFigures, name: str, divisor: float) -> float:
    """Return a figure; one without a limit is infinite."""
    value = getattr(device, name)
    return math.inf if value is None else float(value) / divisor


class Figures:
    """Figures of a part of a scanner, which can be read, also by functions ``getName()``; SI units, angles in rad.

    Parameters
    ----------
    device : vlscan.DeviceFigures
        Figures of the scanner.
    """

    #: Figures: name in vlscan, divisor.
    FIGURES: ClassVar[dict[str, tuple[str, float]]] = {}

    def __init__(self, device: DeviceFigures) -> None:
        object.__setattr__(self, "_device", device)

    def __getattr__(self, name: str) -> Any:
        figures = type(self).FIGURES
        if name.startswith("get") and (own := name[3:4].lower() + name[4:]) in figures:
            return lambda: getattr(self, own)
        if name not in figures:
            raise AttributeError(f"no figure {name!r} of a {type(self).__name__}; there are {', '.join(figures)}")
        return _figure(self._device, *figures[name])

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"figures of a scanner cannot be set, found {name}; change its entry in its file")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *type(self).FIGURES]


class Detector(Figures):
    """Accuracy and ranges of a scanner, m; a range without a limit is infinite."""

    FIGURES = {"accuracy": ("accuracy_m", 1), "rangeMin": ("range_min_m", 1), "rangeMax": ("range_max_m", 1)}


class ScannerHead(Figures):
    """Limit of the turns of a scanner's head."""

    FIGURES = {"rotatePerSecMax": ("head_rate_max_deg_per_s", 180 / math.pi)}


class BeamDeflector(Figures):
    """Limits of a scanner's mirror."""

    FIGURES = {
        "scanFreqMin": ("scan_freq_min_hz", 1),
        "scanFreqMax": ("scan_freq_max_hz", 1),
        "scanAngleMax": ("scan_angle_max_deg", 180 / math.pi),
    }


class ScannerView(Instrument):
    """A scanner, whose figures cannot be set. Those of several channels are those of the first.

    ``wavelength`` is in m, ``visibility`` in km, ``pulseLength`` in ns, ``beamDivergence`` in rad, ``averagePower`` in W,
    ``pulseFreqs`` in Hz.
    """

    #: Figures: name in vlscan, divisor.
    FIGURES: ClassVar[dict[str, tuple[str, float]]] = {
        "averagePower": ("average_power_w", 1),
        "beamDivergence": ("divergence_rad", 1),
        "beamQuality": ("beam_quality", 1),
        "efficiency": ("optical_efficiency", 1),
        "receiverDiameter": ("receiver_diameter_m", 1),
        "visibility": ("visibility_km", 1),
        "wavelength": ("wavelength_nm", 1e9),
        "pulseLength": ("pulse_length_ns", 1),
        "accuracy": ("accuracy_m", 1),
    }

    def _known(self, name: str) -> str:
        if name in type(self).FIGURES or name in type(self).NAMES:
            return type(self).NAMES.get(name, name)
        known = ", ".join(["deviceId", "pulseFreqs", *type(self).NAMES, *type(self).FIGURES])
        raise AttributeError(f"no attribute {name!r} of a scanner; there are {known}")

    def __getattr__(self, name: str) -> Any:
        if name in type(self).FIGURES:
            return _figure(self._device, *type(self).FIGURES[name])
        return super().__getattr__(name)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"figures of a scanner cannot be set, found {name}; change its entry in {self.reference}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *type(self).FIGURES]

    @cached_property
    def _figures(self) -> ScannerFigures:
        """Figures of the data sheet."""
        return scanner_figures(self.reference)

    @cached_property
    def _device(self) -> DeviceFigures:
        """Figures that surveys use."""
        return self._figures.device

    @property
    def deviceId(self) -> str:
        """Id in its file."""
        return self.id

    @property
    def pulseFreqs(self) -> list[int]:
        """Pulse frequencies, Hz."""
        return self._figures.pulse_rates_hz

    def getSupportedPulseFrequencies(self) -> list[int]:
        """Return the pulse frequencies, Hz."""
        return self.pulseFreqs

    def getPulseFreqs(self) -> list[int]:
        """Return the pulse frequencies, Hz."""
        return self.pulseFreqs

    def getScannerHead(self) -> ScannerHead:
        """Return the head."""
        return ScannerHead(self._device)

    def getBeamDeflector(self) -> BeamDeflector:
        """Return the deflector."""
        return BeamDeflector(self._device)

    def getDetector(self) -> Detector:
        """Return the detector."""
        return self.detector

    @property
    def detector(self) -> Detector:
        """The detector."""
        return Detector(self._device)

    def toString(self) -> str:
        """Return the figures as lines of text."""
        rows = {"Device": self.id, **{name: getattr(self, name) for name in type(self).FIGURES}, "pulseFreqs": self.pulseFreqs}
        return "\n".join(f"{name}: {value}" for name, value in rows.items())
