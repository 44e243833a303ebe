"""Lists of what ships: scanners, platforms, options of runs, columns of points."""

from __future__ import annotations

import html
import json
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from functools import cache
from typing import Any, NamedTuple

from . import _vlscan
from .errors import InputError


class Option(NamedTuple):
    """An option of a run: a keyword of :meth:`vlscan.Survey.run`.

    Attributes
    ----------
    help : str
        Effect of the option.
    has_value : bool
        True if it takes a value; otherwise it is ``True`` or ``False``.
    is_list : bool
        True if a list gives it more than once.
    is_of_files : bool
        True if it says how files of points are written; a run to memory refuses it.
    """

    help: str
    has_value: bool
    is_list: bool
    is_of_files: bool


class Column(NamedTuple):
    """A column of points.

    Attributes
    ----------
    unit : str
        Unit; empty for plain numbers.
    description : str
        Meaning of the values.
    """

    unit: str
    description: str


class Spectrum(NamedTuple):
    """Reflectance and transmittance of a surface by wavelength.

    Parameters
    ----------
    wavelengths_nm : list of float
        Wavelengths, nm, ascending.
    reflectances, transmittances : list of float
        Shares of the light at these wavelengths, 0 to 1. Echoes do not depend on the transmittance of single leaves.
    """

    wavelengths_nm: list[float]
    reflectances: list[float]
    transmittances: list[float]


def spectra() -> dict[str, Spectrum]:
    """List the built-in spectra of common surfaces (docs/dev/light.md names their sources).

    Returns
    -------
    dict of str to Spectrum
        Spectra by the name that materials use: ``vlscan.Material("leaf", spectrum="broadleaf")``.

    Examples
    --------
    >>> leaf = vlscan.spectra()["broadleaf"]
    >>> dict(zip(leaf.wavelengths_nm, leaf.reflectances))[1550.0]
    0.247
    """
    return {name: Spectrum(*map(list, zip(*values, strict=True))) for name, values in _vlscan.spectra()}


def files() -> dict[str, str]:
    """Return the files of the catalogue that ships.

    Returns
    -------
    dict
        Their texts by the path by which surveys refer to them.

    Examples
    --------
    >>> "data/platforms.xml" in vlscan.catalogue.files()
    True
    """
    return dict(_vlscan.catalogue_files())


@cache
def _instruments() -> tuple[dict[str, str], dict[str, str], dict[str, str]]:
    """Names and references of the scanners, and references of the platforms, by what :func:`scanners` and :func:`platforms` list."""
    scanner_rows, platform_rows = _vlscan.catalogue()
    names = dict(scanner_rows)
    scanners = _by_id(names)
    return {key: names[reference] for key, reference in scanners.items()}, scanners, _by_id(platform_rows)


def _by_id(references: Iterable[str]) -> dict[str, str]:
    """Return references by id; those that share their id by themselves, because the id alone does not select one."""
    counts = Counter(map(_id, references))
    return {_id(reference) if counts[_id(reference)] == 1 else reference: reference for reference in references}


def _id(reference: str) -> str:
    return reference.split("#")[1]


def scanners() -> dict[str, str]:
    """List the scanners of the catalogue.

    Returns
    -------
    dict of str to str
        Names by id; scanners with the same id by reference, ``file.xml#id``.

    Examples
    --------
    >>> vlscan.scanners()["riegl_vz400"]
    'RIEGL VZ-400'
    """
    return dict(_instruments()[0])


def platforms() -> list[str]:
    """List the platforms that ship.

    Returns
    -------
    list of str
        Ids.

    Examples
    --------
    >>> "sr22" in vlscan.platforms()
    True
    """
    return list(_instruments()[2])


@cache
def _options() -> dict[str, Option]:
    rows = _vlscan.options()
    return {name.replace("-", "_"): Option(text, has_value, is_list, files) for name, text, has_value, is_list, files in rows}


def options() -> dict[str, Option]:
    """List the options of a run.

    Returns
    -------
    dict of str to Option
        Options by keyword.

    Examples
    --------
    >>> vlscan.options()["seed"].has_value
    True
    """
    return dict(_options())


def columns() -> dict[str, Column]:
    """List the columns of points.

    Returns
    -------
    dict of str to Column
        Columns by name.

    Examples
    --------
    >>> vlscan.columns()["X"].unit
    'm'
    """
    return {name: Column(unit, text) for name, unit, text in _vlscan.columns()}


class DeviceFigures(NamedTuple):
    """Figures of the first device of a scanner, see :attr:`ScannerFigures.device`.

    Surveys in XML use these figures. Pipelines, and surveys made in Python, replace some of the built-in catalogue's
    (docs/instruments.md).

    Parameters
    ----------
    average_power_w : float
        Average power, W.
    divergence_rad : float
        Divergence of the beam, full angle at 1/e², rad.
    beam_quality : float
        Beam quality M².
    optical_efficiency : float
        Optical efficiency, 0 to 1.
    receiver_diameter_m : float
        Diameter of the receiver, m.
    visibility_km : float
        Visibility of the air, km.
    wavelength_nm : float
        Wavelength, nm.
    pulse_length_ns : float
        Length of the pulse in the measure of HELIOS++, ns.
    accuracy_m : float
        Standard deviation of ranges, m.
    range_min_m : float
        Least range, m.
    range_max_m : float or None
        Farthest range, m; ``None`` is unlimited.
    head_rate_max_deg_per_s : float
        Highest rate of the head; 0 without one.
    scan_freq_min_hz, scan_freq_max_hz : float
        Limits of the scan frequency; a maximum of 0 is none.
    scan_angle_max_deg : float
        Limit of the scan angle, half of the field.
    """

    average_power_w: float
    divergence_rad: float
    beam_quality: float
    optical_efficiency: float
    receiver_diameter_m: float
    visibility_km: float
    wavelength_nm: float
    pulse_length_ns: float
    accuracy_m: float
    range_min_m: float
    range_max_m: float | None
    head_rate_max_deg_per_s: float
    scan_freq_min_hz: float
    scan_freq_max_hz: float
    scan_angle_max_deg: float


@dataclass(frozen=True)
class ScannerFigures:
    """Figures of a scanner's data sheet; of several channels those of the first.

    Parameters
    ----------
    reference : str
        Reference in surveys and pipelines.
    name : str
        Name of the instrument.
    optics : str
        Kind of the mechanism that deflects the beam.
    channels : int
        Number of channels.
    divergence_mrad : float
        Divergence of the beam, full angle at 1/e², mrad.
    divergence_y_mrad : float or None
        Of elliptic beams the other one.
    pulse_rates_hz : list of int
        Pulse rates, Hz.
    range_min_m : float
        Least range, m.
    range_max_m : float or None
        Farthest range, m; ``None`` is unlimited.
    field_of_view_deg : list of float
        Full angle of the field, or its two extents: all around, and up and down.
    head_deg_per_s : float
        Highest rate of the head; 0 without one.
    wavelength_nm : float
        Wavelength, nm.
    pulse_length_ns : float
        Length of the pulse in the measure of HELIOS++, ns.
    pulse_fwhm_ns : float
        Full width of the pulse at half maximum, ns.
    accuracy_m : float
        Standard deviation of ranges, m.
    max_returns : int
        Most returns of a pulse; 0 is unlimited.
    """

    reference: str
    name: str
    optics: str
    channels: int
    divergence_mrad: float
    divergence_y_mrad: float | None
    pulse_rates_hz: list[int]
    range_min_m: float
    range_max_m: float | None
    field_of_view_deg: list[float]
    head_deg_per_s: float
    wavelength_nm: float
    pulse_length_ns: float
    pulse_fwhm_ns: float
    accuracy_m: float
    max_returns: int

    @property
    def sources(self) -> dict[str, str]:
        """Sources of the figures, by the names of attributes in XML."""
        sources: dict[str, str] = self._details()["sources"]
        return sources

    @property
    def device(self) -> DeviceFigures:
        """Power, optics, ranges and limits of the first device, as surveys in XML use them."""
        return DeviceFigures(**self._details()["device"])

    @property
    def pattern_svg(self) -> str:
        """The directions of the beams as a drawing (SVG): one revolution of the head, or 0.1 s if it does not turn."""
        return _vlscan.scanner_figures(self.reference)[1]

    def _details(self) -> dict[str, Any]:
        details: dict[str, Any] = json.loads(_vlscan.scanner_figures(self.reference)[0])
        return details

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><td>{name}</td><td>{html.escape(str(value))}</td></tr>" for name, value in asdict(self).items())
        return f"<table>{rows}</table>{self.pattern_svg}"


def scanner_figures(name: str) -> ScannerFigures:
    """Return the figures of a scanner, as ``vlscan catalogue show`` does.

    Parameters
    ----------
    name : str
        The id of one that ships, or ``file.xml#id``.

    Returns
    -------
    ScannerFigures
        The figures.

    Raises
    ------
    InputError
        No scanner has the name.

    Examples
    --------
    >>> figures = vlscan.scanner_figures("riegl_vz400")
    >>> figures.wavelength_nm, figures.pattern_svg[:4]
    (1064.0, '<svg')
    """
    text, _ = _vlscan.scanner_figures(scanner_reference(name))
    return ScannerFigures(**json.loads(text)["figures"])


def all_scanner_figures(text: str = "") -> list[ScannerFigures]:
    """Return the figures of all scanners that ship, as ``vlscan catalogue`` does; ``pandas.DataFrame`` makes a table of them.

    Parameters
    ----------
    text : str
        Text that the reference or the name contains.

    Returns
    -------
    list of ScannerFigures
        The figures.

    Examples
    --------
    >>> sorted({figures.name for figures in vlscan.all_scanner_figures("vz-4")})
    ['RIEGL VZ-400', 'RIEGL VZ-400i']
    """
    figures = [ScannerFigures(**row) for row in json.loads(_vlscan.figures())["scanners"]]
    return [row for row in figures if text.lower() in row.reference.lower() or text.lower() in row.name.lower()]


def platform_kind(name: str) -> str:
    """Return how a platform moves.

    Parameters
    ----------
    name : str
        The id of one that ships, or ``file.xml#id``.

    Returns
    -------
    str
        ``static``, ``linearpath``, ``groundvehicle`` or ``multicopter``.

    Raises
    ------
    InputError
        No platform has the name.

    Examples
    --------
    >>> vlscan.platform_kind("tripod"), vlscan.platform_kind("sr22")
    ('static', 'linearpath')
    """
    return _vlscan.platform_kind(platform_reference(name))


def scanner_reference(name: str) -> str:
    """Return the reference of a scanner.

    Parameters
    ----------
    name : str
        The id of one that ships, or ``file.xml#id``.

    Returns
    -------
    str
        ``file.xml#id``.

    Raises
    ------
    InputError
        No scanner that ships has the id, or several have it.
    """
    return _reference(name, _instruments()[1], "scanner", "vlscan.scanners()")


def platform_reference(name: str) -> str:
    """Return the reference of a platform.

    Parameters
    ----------
    name : str
        The id of one that ships, or ``file.xml#id``.

    Returns
    -------
    str
        ``file.xml#id``.

    Raises
    ------
    InputError
        No platform that ships has the id.
    """
    return _reference(name, _instruments()[2], "platform", "vlscan.platforms()")


def _reference(name: str, known: Mapping[str, str], kind: str, listing: str) -> str:
    if "#" in name or "/" in name or name.endswith(".xml"):
        return name
    if name in known:
        return known[name]
    ids = [_id(reference) for reference in known.values()]
    several = [reference for reference in known.values() if _id(reference) == name]
    close = get_close_matches(name, ids, 1)
    if several:
        message = f"{len(several)} {kind}s of the catalogue have the id {name!r}"
        hint = f"write one of them in full: {' or '.join(several)}"
    else:
        message = f"no {kind} that ships has the id {name!r}"
        hint = f"did you mean {close[0]!r}?" if close else f"{listing} lists those that ship; one of your own is file.xml#id"
    problem = {"severity": "error", "message": message, "help": hint}
    raise InputError(f"{message}; {hint}", [problem])
