"""Surveys from and to XML.

A leg that was read keeps its element: what the settings here have no place for (noise, templates, trajectories) stays as it is, and
only values that were changed are written over it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent, tostring

import numpy as np

from .leg import Leg, flown_part
from .platforms import DynamicPlatformSettings, Platform, StaticPlatformSettings, TrajectorySettings, traj_csv_dtype
from .scanner import Scanner, ScannerSettings
from .settings import FullWaveformSettings
from .validation import Model, same
from .xml_files import Document, float_of, read, truth_of

if TYPE_CHECKING:
    from .survey import Survey

_DEGREES = math.degrees(1)

# Attribute of each setting, its unit in units of the setting, and the value that means "not given".
_SCANNER: dict[str, tuple[str, float, float | bool]] = {
    "is_active": ("active", 1, True),
    "head_rotation": ("headRotatePerSec_deg", _DEGREES, 0),
    "rotation_start_angle": ("headRotateStart_deg", _DEGREES, 0),
    "rotation_stop_angle": ("headRotateStop_deg", _DEGREES, 0),
    "pulse_frequency": ("pulseFreq_hz", 1, 0),
    "scan_angle": ("scanAngle_deg", _DEGREES, 0),
    "min_vertical_angle": ("verticalAngleMin_deg", _DEGREES, math.nan),
    "max_vertical_angle": ("verticalAngleMax_deg", _DEGREES, math.nan),
    "scan_frequency": ("scanFreq_hz", 1, 0),
    "beam_divergence_angle": ("beamDivergence_rad", 1, 0.003),
    "trajectory_time_interval": ("trajectoryTimeInterval_s", 1, 0),
    "vertical_resolution": ("verticalResolution_deg", _DEGREES, 0),
    "horizontal_resolution": ("horizontalResolution_deg", _DEGREES, 0),
    "max_duration": ("maxDuration_s", 1, -1),
}
_PLACE: dict[str, tuple[str, float, float | bool]] = {
    "x": ("x", 1, 0),
    "y": ("y", 1, 0),
    "z": ("z", 1, 0),
    "force_on_ground": ("onGround", 1, False),
    "speed_m_s": ("movePerSec_m", 1, 70),
}
_TRAJECTORY: dict[str, tuple[str, float, float | bool]] = {
    "start_time": ("tStart", 1, 0),
    "end_time": ("tEnd", 1, 0),
    "teleport_to_start": ("teleportToStart", 1, False),
}
_WAVEFORM: dict[str, tuple[str, float]] = {
    "bin_size": ("binSize_ns", 1e9),
    "beam_sample_quality": ("beamSampleQuality", 1),
    "win_size": ("winSize_ns", 1e9),
    "max_fullwave_range": ("maxFullwaveRange_ns", 1e9),
}
_FOLLOWED = ("trajectory", "syncGPSTime", "interpolationDomain", "toRadians", "slopeFilterThreshold", "trajectory_seperator")
_INDICES = [f"{name}Index" for name in traj_csv_dtype.names or ()]


# --- reading ---


def read_platform(document: Document) -> Platform:
    """Return the platform of a survey."""
    survey = document.asset("survey")
    reference = survey.get("platform", "")
    if reference != "interpolated":
        platform: Platform = Platform.of_reference(document.reference(reference))
        return platform.flown(is_static=is_static(document, platform.reference))
    base = survey.get("basePlatform")
    platform = Platform.of_reference(document.reference(base) if base else "", "interpolated")
    return platform.flown(follows_file=True, rotation_spec=survey.get("rotationSpec", "ARINC 705"))


def is_static(document: Document, reference: str) -> bool | None:
    """Return whether a platform of a file on disk stands; ``None`` for one that ships."""
    file, _, id = reference.partition("#")
    if not Path(file).exists():
        return None
    try:
        return read(file).asset("platform", id).get("type", "static").lower() == "static"
    except (ValueError, OSError):
        # The engine tells what is wrong with it.
        return None


def _has_prisms(reference: str) -> bool:
    """Return whether a scanner deflects by prisms."""
    file, _, id = reference.partition("#")
    if not Path(file).exists():
        # One that ships.
        return "livox" in id or "zenmuse" in id
    try:
        return read(file).asset("scanner", id).get("optics", "").lower() == "risley"
    except (ValueError, OSError):
        # The engine tells what is wrong with it.
        return False


def read_scanner(document: Document) -> Scanner:
    """Return the scanner of a survey."""
    return Scanner.of_reference(document.reference(document.asset("survey").get("scanner", "")))


def read_waveform(document: Document) -> FullWaveformSettings:
    """Return the waveform settings of a survey, those for all where it has none."""
    element = document.asset("survey").find("FWFSettings")
    given = {} if element is None else element.attrib
    values = {name: float_of(given.get(key), math.nan) / unit for name, (key, unit) in _WAVEFORM.items() if key in given}
    if "beam_sample_quality" in values:
        values["beam_sample_quality"] = int(values["beam_sample_quality"])
    if "win_size" not in values and "bin_size" in values:
        # The window follows from the pulse; at least two bins.
        values["win_size"] = max(1e-9, 2 * values["bin_size"])
    settings = FullWaveformSettings()
    for name, value in values.items():
        # The window is not checked: the file is run as it stands.
        setattr(settings, name, value)
    return settings


def read_legs(document: Document, platform: Platform) -> tuple[Leg, ...]:
    """Return the legs of a survey."""
    legs = []
    for element in document.asset("survey").findall("leg"):
        place = _layers(document, element.find("platformSettings"))
        scanning = _layers(document, element.find("scannerSettings"))
        if "maxDuration_s" in element.attrib:
            scanning["maxDuration_s"] = element.attrib["maxDuration_s"]
        kind = StaticPlatformSettings if platform.is_static else DynamicPlatformSettings
        is_followed = platform.follows_file
        leg = Leg(
            scanner_settings=_settings(ScannerSettings, _SCANNER, scanning),
            platform_settings=_settings(kind, _PLACE, place),
            trajectory_settings=_settings(TrajectorySettings, _TRAJECTORY, place) if is_followed else None,
        )
        legs.append(leg.read_from(element))
    return tuple(legs)


def _layers(document: Document, element: Element | None, depth: int = 0) -> dict[str, str]:
    """Return the attributes of settings, over those of their template."""
    if element is None:
        return {}
    own = dict(element.attrib)
    template = own.pop("template", "")
    file, _, id = template.rpartition("#")
    if not template or depth > 8:
        return own
    try:
        home = read(document.locate(file)) if file else document
        return {**_layers(home, home.asset(element.tag, id), depth + 1), **own}
    except (ValueError, OSError):
        # The engine tells that there is no such template.
        return own


def _settings(kind: type[Any], table: Mapping[str, tuple[str, float, float | bool]], given: Mapping[str, str]) -> Any:
    values: dict[str, Any] = {}
    for name, (key, unit, absent) in table.items():
        if name not in kind.model_fields:
            continue
        if isinstance(absent, bool):
            values[name] = truth_of(given.get(key), absent)
        else:
            values[name] = float_of(given.get(key), absent) / unit
    if values.get("max_duration", 0) < 0:
        values["max_duration"] = None
    made = kind(**values)
    object.__setattr__(made, "__pydantic_fields_set__", {name for name in values if table[name][0] in given})
    return made


# --- writing ---


def write(survey: Survey, folder: Path | None) -> Element:
    """Return the document of a survey that is not that of a file, or was changed; a trajectory is written to ``folder``."""
    document = survey.document
    if document is None:
        root = Element("document")
        element = SubElement(root, "survey")
        element.set("scene", "in memory")
    else:
        root = _independent(document)
        element = next(root.iter("survey"))
    element.set("name", survey.name or (document.path.stem if document else "survey"))
    if survey.scanner.reference:
        element.set("scanner", survey.scanner.reference)
    _write_platform(element, survey.platform)
    _write_waveform(element, survey)
    trajectory = _write_trajectory(survey.platform, folder)
    has_prisms = _has_prisms(survey.scanner.reference)
    known = {id(original): copied for original, copied in zip(_legs_of(document), element.findall("leg"), strict=True)}
    for old in element.findall("leg"):
        element.remove(old)
    for leg in survey.legs:
        source = leg.source if leg.source is not None and id(leg.source.element) in known else None
        copied = Element("leg") if source is None else deepcopy(known[id(source.element)])
        element.append(copied)
        _write_leg(copied, leg, None if source is None else source.as_read, has_prisms)
        _write_followed(copied, leg, survey.platform, trajectory, known.values())
    return root


def text_of(root: Element) -> str:
    """Return a document as text."""
    indent(ElementTree(root))
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def _legs_of(document: Document | None) -> list[Element]:
    return [] if document is None else document.asset("survey").findall("leg")


def _independent(document: Document) -> Element:
    """Return a copy of a document that can stand in another folder."""
    root = deepcopy(document.root)
    root.attrib.pop("paths", None)
    for element in root.iter():
        for name in ("scene", "scanner", "platform", "basePlatform", "template"):
            value = element.get(name, "")
            if ".xml" in value.lower():
                element.set(name, document.reference(value))
        if "trajectory" in element.attrib:
            element.set("trajectory", document.locate(element.attrib["trajectory"]))
    return root


def _write_platform(element: Element, platform: Platform) -> None:
    if platform.trajectory is None and not platform.follows_file:
        element.set("platform", platform.reference)
        for name in ("basePlatform", "rotationSpec"):
            element.attrib.pop(name, None)
        return
    element.set("platform", "interpolated")
    element.set("rotationSpec", platform.rotation_spec)
    if platform.reference:
        element.set("basePlatform", platform.reference)


def _write_waveform(element: Element, survey: Survey) -> None:
    settings = survey.full_waveform_settings
    as_read = survey.as_read
    if settings == (as_read.full_waveform_settings if as_read else FullWaveformSettings()) and not survey.has_own_waveform:
        return
    settings.check()
    for old in element.findall("FWFSettings"):
        element.remove(old)
    values = {key: _text(getattr(settings, name) * unit) for name, (key, unit) in _WAVEFORM.items()}
    values["beamSampleQuality"] = str(settings.beam_sample_quality)
    element.insert(0, Element("FWFSettings", values))


def _write_trajectory(platform: Platform, folder: Path | None) -> str | None:
    """Write the poses that a platform has in memory; the name of the file."""
    poses = platform.trajectory
    if poses is None:
        return None
    path = (folder or Path()) / "trajectory.csv"
    if folder is not None:
        names = poses.dtype.names or ()
        np.savetxt(path, np.column_stack([poses[name] for name in names]), delimiter=",", fmt="%.17g")
    return str(path)


def _write_leg(element: Element, leg: Leg, as_read: Leg | None, has_prisms: bool) -> None:
    place, scanning = _child(element, "platformSettings"), _child(element, "scannerSettings")
    written = dict(_SCANNER)
    if as_read is None and has_prisms and "scan_frequency" not in leg.scanner_settings.model_fields_set:
        # The default is none of prisms, which turn by themselves.
        del written["scan_frequency"]
    for target, table, settings, old in (
        (place, _PLACE, leg.platform_settings, as_read and as_read.platform_settings),
        (scanning, written, leg.scanner_settings, as_read and as_read.scanner_settings),
        (place, _TRAJECTORY, flown_part(leg), as_read and flown_part(as_read)),
    ):
        if settings is not None:
            _write_settings(target, table, settings, old)
    if "template" not in place.attrib and any(name in place.attrib for name in "xyz"):
        # A place is written whole.
        for name in "xyz":
            place.attrib.setdefault(name, "0.0")
    if "maxDuration_s" in element.attrib and "maxDuration_s" in scanning.attrib:
        # That of the leg goes before that of the settings.
        element.set("maxDuration_s", scanning.attrib.pop("maxDuration_s"))


def _write_settings(element: Element, table: Mapping[str, tuple[str, float, float | bool]], settings: Model, old: Any) -> None:
    for name, (key, unit, absent) in table.items():
        if name not in type(settings).model_fields:
            continue
        value = getattr(settings, name)
        before = getattr(old, name, None) if old is not None else None
        if old is not None and same(value, before):
            continue
        if value is None:
            value = absent
        if old is None and same(float(value), float(absent)):
            continue
        if isinstance(absent, bool):
            element.set(key, str(bool(value)).lower())
        elif key == "pulseFreq_hz":
            element.set(key, str(round(value)))
        else:
            element.set(key, _text(value * unit))


def _write_followed(leg: Element, settings: Leg, platform: Platform, trajectory: str | None, legs: Iterable[Element]) -> None:
    """Let a leg follow recorded poses, or none."""
    place = _child(leg, "platformSettings")
    if platform.follows_file:
        if "trajectory" not in place.attrib and "template" not in place.attrib:
            first = next((_child(other, "platformSettings") for other in legs), place)
            place.attrib.update({name: first.attrib[name] for name in (*_FOLLOWED, *_INDICES) if name in first.attrib})
        return
    for name in (*_FOLLOWED, *_INDICES):
        place.attrib.pop(name, None)
    if trajectory is None:
        for key, _, _ in _TRAJECTORY.values():
            place.attrib.pop(key, None)
        return
    for name in ("x", "y", "z", "movePerSec_m", "onGround"):
        # Poses are those of the trajectory.
        place.attrib.pop(name, None)
    place.set("trajectory", trajectory)
    # Angles are radians already.
    place.set("toRadians", "false")
    place.attrib.update({name: str(index) for index, name in enumerate(_INDICES)})
    if platform.sync_gps_time:
        place.set("syncGPSTime", "true")


def _child(element: Element, tag: str) -> Element:
    found = element.find(tag)
    return SubElement(element, tag) if found is None else found


def _text(value: float) -> str:
    """Return a number without the last digit, which a conversion of units may have changed."""
    return str(float(f"{value:.15g}"))
