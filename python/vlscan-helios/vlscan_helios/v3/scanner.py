"""Scanners: by name, from files, and a function for each that ships (``riegl_vz_400()``); what they do on a leg."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from pydantic import PrivateAttr

from vlscan import InputError, catalogue

from .errors import WrongTypeError
from .settings import FullWaveformSettings
from .utils import classonlymethod, existing_file
from .validation import Angle, AngleVelocity, Frequency, Model, ScanFrequency, TimeInterval, UpdateableMixin

if TYPE_CHECKING:
    from typing_extensions import Self

_T = TypeVar("_T", bound="Named")

# Names of the scanners, and their ids in the catalogue.
_NAMES = {
    "leica_als50": "leica_als50",
    "leica_als50_ii": "leica_als50-ii",
    "optech_2033": "optech_2033",
    "optech_3100": "optech_3100",
    "optech_galaxy": "optech_galaxy",
    "riegl_lms_q560": "riegl_lms-q560",
    "riegl_lms_q780": "riegl_lms-q780",
    "riegl_vq_780i": "riegl_vq_780i",
    "riegl_vux_1uav": "riegl_vux-1uav",
    "riegl_vux_1uav22": "riegl_vux-1uav22",
    "riegl_vux_1ha22": "riegl_vux-1ha22",
    "riegl_vq_880g": "riegl_vq-880g",
    "riegl_vq_1560i": "riegl_vq-1560i",
    # The catalogues of airborne and of terrestrial scanners have the same id.
    "livox_mid70": "data/scanners_als.xml#livox_mid-70",
    "livox_mid100": "livox-mid-100",
    "livox_mid100a": "livox-mid-100a",
    "livox_mid100b": "livox-mid-100b",
    "livox_mid100c": "livox-mid-100c",
    "dji_zenmuse_l2_repetitive": "dji-zenmuse-l2-repetitive",
    "dji_zenmuse_l2_non_repetitive": "dji-zenmuse-l2-non-repetitive",
    "riegl_vz_400": "riegl_vz400",
    "riegl_vz_1000": "riegl_vz1000",
    "riegl_vz_2000i": "riegl_vz2000i",
    "riegl_vz_600i": "riegl_vz600i",
    "riegl_vq_450": "riegl_vq-450",
    "livox_mid40": "livox_mid-40",
    "livox_mid70_tls": "data/scanners_tls.xml#livox_mid-70",
    "vlp16": "vlp16",
    "velodyne_hdl_64e": "velodyne_hdl-64e",
    "tractor_scanner": "tractorscanner",
    "pano_scanner": "panoscanner",
}


class ScannerSettingsBase(Model, UpdateableMixin):
    """Settings of any scanner on a leg."""


class ScannerSettings(ScannerSettingsBase):
    """Settings of the scanner on a leg.

    A scan angle, a rate of the head or a resolution of 0, a divergence of 3 mrad and vertical angles of NaN are the scanner's own
    values.
    """

    is_active: bool = True
    head_rotation: AngleVelocity = 0
    rotation_start_angle: Angle = 0
    rotation_stop_angle: Angle = 0
    pulse_frequency: Frequency = 300_000
    scan_angle: Angle = 0
    min_vertical_angle: Angle = np.nan
    max_vertical_angle: Angle = np.nan
    scan_frequency: ScanFrequency = 200
    beam_divergence_angle: Angle = 0.003
    trajectory_time_interval: TimeInterval = 0.01
    vertical_resolution: Angle = 0
    horizontal_resolution: Angle = 0
    max_duration: TimeInterval | None = None


class RotatingOpticsScannerSettings(ScannerSettingsBase):
    """Settings of a scanner with a head that turns."""

    is_active: bool = True
    head_rotation: AngleVelocity = 0
    rotation_start_angle: Angle = 0
    rotation_stop_angle: Angle = 0


class OscillatingOpticsScannerSettings(ScannerSettingsBase):
    """Settings that only a scanner with an oscillating mirror has: none."""


class LineOpticsScannerSettings(ScannerSettingsBase):
    """Settings that only a scanner with fibres has: none."""


class ConicOpticsScannerSettings(ScannerSettingsBase):
    """Settings that only a scanner with a conical mirror has: none."""


class RisleyOpticsScannerSettings(ScannerSettingsBase):
    """Settings that only a scanner with prisms has: none."""


class Named(Model):
    """A scanner or a platform, by the reference of its entry in a file."""

    _reference: str = PrivateAttr("")
    _name: str = PrivateAttr("")

    @classmethod
    def of_reference(cls, reference: str, name: str = "") -> Self:
        """Return the one of a reference.

        Parameters
        ----------
        reference : str
            ``file.xml#id``.
        name : str
            Name; the id by default.

        Returns
        -------
        Scanner or Platform
            The scanner or platform.
        """
        made = cls()
        made._reference, made._name = reference, name or reference.split("#")[-1]
        return made

    @property
    def reference(self) -> str:
        """``file.xml#id``."""
        return self._reference

    @property
    def name(self) -> str:
        """Name."""
        return self._name

    @property
    def is_of_file(self) -> bool:
        """True if it is that of an XML file."""
        return bool(self._reference)

    def _identity(self) -> object:
        return self._reference

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._name!r})"

    __str__ = __repr__


def reference_in(file: str | os.PathLike[str], id: str) -> str:
    """Return the reference of an entry in a file that can be found."""
    path = existing_file(file)
    return f"{path.as_posix()}#{id}" if id else path.as_posix()


def check_id(read: Callable[[str], object], reference: str, kind: str) -> None:
    """Refuse the reference of an entry that its file does not have; ``read`` lets the engine read the entry."""
    try:
        read(reference)
    except InputError as error:
        if all(problem.kind != "missing_entry" for problem in error.problems):
            raise
        file, _, id = reference.partition("#")
        hint = "" if os.path.exists(file) else f"; list_{kind}s() lists those that ship"
        raise ValueError(f"{file} has no {kind} with the id {id!r}{hint}") from error


class Scanner(Named):
    """An instrument: see :func:`scanner_from_name`, :func:`list_scanners` and :meth:`from_xml`."""

    @classonlymethod
    def from_xml(cls, scanner_file: str | os.PathLike[str], scanner_id: str = "") -> Scanner:
        """Return a scanner of a file.

        Parameters
        ----------
        scanner_file : str or path-like
            The file.
        scanner_id : str
            Its id; the first by default.

        Returns
        -------
        Scanner
            The scanner.

        Raises
        ------
        ValueError
            No scanner of the file has the id.
        FileNotFoundError
            There is no such file.
        """
        reference = reference_in(scanner_file, scanner_id)
        if scanner_id:
            check_id(catalogue.scanner_figures, reference, "scanner")
        return cls.of_reference(reference, scanner_id or os.path.basename(scanner_file))


def _plain(name: str) -> str:
    return re.sub("[^a-z0-9]", "", name.lower())


def find(name: str, names: Mapping[str, str], ids: Iterable[str], kind: str) -> str:
    """Return the id of a name, whatever its hyphens, underscores and capitals; ids of the catalogue are names, too."""
    if not isinstance(name, str):
        raise WrongTypeError(f"the name of a {kind} is a text, found {name!r}")
    known = {_plain(id): id for id in ids} | {_plain(key): id for key, id in names.items()}
    if _plain(name) in known:
        return known[_plain(name)]
    close = get_close_matches(_plain(name), [_plain(key) for key in names], 1)
    near = next((key for key in names if close and _plain(key) == close[0]), None)
    hint = f"did you mean {near!r}?" if near else f"there are {', '.join(names)}"
    raise ValueError(f"no {kind} is called {name!r}; {hint}")


def scanner_from_name(scanner_name: str) -> Scanner:
    """Return a scanner that ships.

    Parameters
    ----------
    scanner_name : str
        A name of :func:`list_scanners`, or an id of :func:`vlscan.scanners`, whatever its hyphens, underscores and capitals.

    Returns
    -------
    Scanner
        The scanner.

    Raises
    ------
    ValueError
        No scanner has the name.
    """
    known = catalogue.scanners()
    id = find(scanner_name, _NAMES, known, "scanner")
    return Scanner.of_reference(catalogue.scanner_reference(id), known[id])


def list_scanners() -> list[str]:
    """List the scanners of HELIOS++; :func:`vlscan.scanners` lists all that ship.

    Returns
    -------
    list of str
        Their names, each of which is a function of this module, too.
    """
    return list(_NAMES)


def by_attribute(from_name: Callable[[str], _T]) -> Callable[[str], Callable[[], _T]]:
    """``__getattr__`` of a module with a function for each instrument that ships."""

    def get(name: str) -> Callable[[], _T]:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            from_name(name)
        except ValueError as failure:
            raise AttributeError(str(failure)) from None
        return instrument_function(from_name, name)

    return get


def instrument_function(from_name: Callable[[str], _T], name: str) -> Callable[[], _T]:
    """Return a function that returns the instrument of a name."""

    def make() -> _T:
        return from_name(name)

    make.__name__ = make.__qualname__ = name
    make.__doc__ = f"Return {name}."
    return make


#: Functions that return the scanners of :func:`list_scanners`, by name.
SCANNER_REGISTRY = {name: instrument_function(scanner_from_name, name) for name in _NAMES}

if not TYPE_CHECKING:
    globals().update(SCANNER_REGISTRY)


def __getattr__(name: str) -> Any:
    return by_attribute(scanner_from_name)(name)


__all__ = [
    "SCANNER_REGISTRY",
    "ConicOpticsScannerSettings",
    "FullWaveformSettings",
    "LineOpticsScannerSettings",
    "OscillatingOpticsScannerSettings",
    "RisleyOpticsScannerSettings",
    "RotatingOpticsScannerSettings",
    "Scanner",
    "ScannerSettings",
    "ScannerSettingsBase",
    "list_scanners",
    "scanner_from_name",
    *_NAMES,
]
