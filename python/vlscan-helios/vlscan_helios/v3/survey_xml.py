"""Surveys of files as objects, from what the engine has read, and changed surveys as XML.

Pipelines express all that can be set here but not all that a file may have: noise of legs and platforms, vehicles and multicopters,
recorded poses of legs, mounts and times of pulses. So a changed survey is run as the XML of its file, in memory: a leg keeps its
element, and only values that were changed are written over it. Surveys made here, without a file, are written alike.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent, tostring

from vlscan import Error, scanner_figures
from vlscan import Leg as EngineLeg
from vlscan import Survey as EngineSurvey
from vlscan.contents import References, SurveyContents
from vlscan.legs import FlownPart

from .leg import Leg, flown_part
from .platforms import DynamicPlatformSettings, Platform, StaticPlatformSettings, TrajectorySettings, traj_csv_dtype
from .scanner import Scanner, ScannerSettings
from .settings import FullWaveformSettings
from .validation import Model, same
from .xml_files import Document

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
_ATTRIBUTES = {name: values[0] for name, values in (_SCANNER | _PLACE | _TRAJECTORY).items()}
_ATTRIBUTES |= {name: values[0] for name, values in _WAVEFORM.items()}
#: Settings by the attributes that stand for them, those whose names are not words.
FIELDS = {attribute: name for name, attribute in _ATTRIBUTES.items() if attribute != attribute.lower()}
#: Name of the poses in memory in XML.
TRAJECTORY = "<trajectory>"
_FOLLOWED = ("trajectory", "syncGPSTime", "interpolationDomain", "toRadians", "slopeFilterThreshold", "trajectory_seperator")
_INDICES = [f"{name}Index" for name in traj_csv_dtype.names or ()]


# Keys of the settings of the scanner in legs of the engine.
_KEYS = {
    "head_rotation": "head_rate_deg_per_s",
    "rotation_start_angle": "head_start_deg",
    "rotation_stop_angle": "head_stop_deg",
    "pulse_frequency": "pulse_freq_hz",
    "scan_angle": "scan_angle_deg",
    "min_vertical_angle": "vertical_angle_min_deg",
    "max_vertical_angle": "vertical_angle_max_deg",
    "scan_frequency": "scan_freq_hz",
    "beam_divergence_angle": "beam_divergence_rad",
    "trajectory_time_interval": "trajectory_interval_s",
    "max_duration": "max_duration_s",
}
_WAVEFORM_KEYS = {"bin_size": "bin_ns", "beam_sample_quality": "quality", "win_size": "window_ns", "max_fullwave_range": "max_range_ns"}


# --- what the engine has read ---


def platform_of(contents: SurveyContents, references: References) -> Platform:
    """Return the platform of a survey."""
    reference = references.platform or ""
    if contents.platform_kind != "interpolated":
        platform: Platform = Platform.of_reference(reference)
        return platform.flown(is_static=contents.platform_kind == "static")
    platform = Platform.of_reference(reference, "interpolated")
    return platform.flown(follows_file=True, rotation_spec=references.rotation_spec or "ARINC 705")


def scanner_of(references: References) -> Scanner:
    """Return the scanner of a survey."""
    return Scanner.of_reference(references.scanner or "")


def waveform_of(contents: SurveyContents, references: References) -> FullWaveformSettings:
    """Return the waveform settings of a survey, those for all where it has none: the scanner may have its own."""
    settings = FullWaveformSettings()
    if not references.has_waveform:
        return settings
    for name, key in _WAVEFORM_KEYS.items():
        # The window is not checked: the file is run as it stands.
        setattr(settings, name, contents.waveform[key] if key == "quality" else contents.waveform[key] / _WAVEFORM[name][1])
    return settings


def contents_of(document: Document, folders: list[str | Path]) -> SurveyContents:
    """Return what the engine reads in a survey; one without legs, which the engine refuses, may get them later."""
    if document.asset("survey").find("leg") is not None:
        return EngineSurvey.open(document.path).contents(assets=folders)
    root = deepcopy(document.root)
    leg = SubElement(Document(document.path, root).asset("survey"), "leg")
    SubElement(leg, "platformSettings", x="0", y="0", z="0")
    SubElement(leg, "scannerSettings", active="false", maxDuration_s="1")
    survey = EngineSurvey.from_document(tostring(root, encoding="unicode"), path=document.path)
    return survey.contents(assets=folders)._replace(legs=[])


def legs_of(document: Document, contents: SurveyContents, platform: Platform) -> tuple[Leg, ...]:
    """Return the legs of a survey."""
    elements = document.asset("survey").findall("leg")
    kind = StaticPlatformSettings if platform.is_static else DynamicPlatformSettings
    pairs = zip(elements, contents.legs, strict=True)
    return tuple(_leg_of(leg, kind).read_from(element, leg.templates) for element, leg in pairs)


def _leg_of(leg: EngineLeg, kind: type[Any]) -> Leg:
    x, y, z = leg.position
    place = {"x": x, "y": y, "z": z, "force_on_ground": leg.on_ground}
    if leg.speed_m_per_s is not None and "speed_m_s" in kind.model_fields:
        place["speed_m_s"] = leg.speed_m_per_s
    return Leg(
        scanner_settings=_scanner_settings(leg),
        platform_settings=kind(**place),
        trajectory_settings=None if leg.flown_part is None else _trajectory_settings(leg.flown_part),
    )


def _scanner_settings(leg: EngineLeg) -> ScannerSettings:
    given: dict[str, Any] = {"is_active": leg.active}
    absent: dict[str, Any] = {}
    for name, (_, unit, default) in _SCANNER.items():
        value = leg.settings.get(_KEYS.get(name, ""))
        if isinstance(value, (int, float)):
            given[name] = value / unit
        elif name not in given:
            absent[name] = default
    if absent.get("max_duration", 0) < 0:
        absent["max_duration"] = None
    made = ScannerSettings(**given, **absent)
    made.__pydantic_fields_set__ = set(given)
    return made


def _trajectory_settings(part: FlownPart) -> TrajectorySettings:
    given = {name: value for name, value in (("start_time", part.start_s), ("end_time", part.end_s)) if value is not None}
    return TrajectorySettings(**given, teleport_to_start=part.teleport)


def _has_prisms(reference: str) -> bool:
    """Return whether a scanner deflects by prisms."""
    try:
        return bool(reference) and scanner_figures(reference).optics == "risley"
    except Error:
        # The engine tells what is wrong with it when it is run.
        return False


# --- writing ---


def write(survey: Survey) -> Element:
    """Return the document of a survey that is not that of a file, or was changed; poses in memory are named :data:`TRAJECTORY`."""
    document = survey.document
    if document is None:
        root = Element("document")
        element = SubElement(root, "survey")
        element.set("scene", "in memory")
    else:
        root = deepcopy(document.root)
        element = next(root.iter("survey"))
    element.set("name", survey.name or (document.path.stem if document else "survey"))
    if survey.scanner.reference:
        element.set("scanner", survey.scanner.reference)
    _write_platform(element, survey.platform)
    _write_waveform(element, survey)
    has_default = any("scan_frequency" not in leg.scanner_settings.model_fields_set for leg in survey.legs)
    has_prisms = has_default and _has_prisms(survey.scanner.reference)
    known = {id(original): copied for original, copied in zip(_legs_of(document), element.findall("leg"), strict=True)}
    for old in element.findall("leg"):
        element.remove(old)
    for leg in survey.legs:
        source = leg.source if leg.source is not None and id(leg.source.element) in known else None
        copied = Element("leg") if source is None else deepcopy(known[id(source.element)])
        element.append(copied)
        _write_leg(copied, leg, None if source is None else source.as_read, has_prisms)
        _write_followed(copied, survey.platform, known.values())
    return root


def text_of(root: Element) -> str:
    """Return a document as text."""
    indent(ElementTree(root))
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def _legs_of(document: Document | None) -> list[Element]:
    return [] if document is None else document.asset("survey").findall("leg")


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


def _write_leg(element: Element, leg: Leg, as_read: Leg | None, has_prisms: bool) -> None:
    place, scanning = _child(element, "platformSettings"), _child(element, "scannerSettings")
    written = dict(_SCANNER)
    if as_read is None and has_prisms and "scan_frequency" not in leg.scanner_settings.model_fields_set:
        # The default is none of prisms, which turn by themselves.
        del written["scan_frequency"]
    if as_read is not None and _has_own_steps(leg.scanner_settings, as_read.scanner_settings):
        for key in ("verticalResolution_deg", "horizontalResolution_deg"):
            # Scan frequency and rate of the head would follow from them.
            scanning.attrib.pop(key, None)
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


def _has_own_steps(settings: Model, as_read: Model) -> bool:
    """Return whether scan frequency or rate of the head were changed."""
    return any(not same(getattr(settings, name, None), getattr(as_read, name, None)) for name in ("scan_frequency", "head_rotation"))


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


def _write_followed(leg: Element, platform: Platform, legs: Iterable[Element]) -> None:
    """Let a leg follow recorded poses, or none."""
    place = _child(leg, "platformSettings")
    if platform.follows_file:
        if "trajectory" not in place.attrib and "template" not in place.attrib:
            first = next((_child(other, "platformSettings") for other in legs), place)
            place.attrib.update({name: first.attrib[name] for name in (*_FOLLOWED, *_INDICES) if name in first.attrib})
        return
    for name in (*_FOLLOWED, *_INDICES):
        place.attrib.pop(name, None)
    if platform.trajectory is None:
        for key, _, _ in _TRAJECTORY.values():
            place.attrib.pop(key, None)
        return
    for name in ("x", "y", "z", "movePerSec_m", "onGround"):
        # Poses are those of the trajectory.
        place.attrib.pop(name, None)
    place.set("trajectory", TRAJECTORY)
    # Angles are radians already.
    place.set("toRadians", "false")
    # Instead of those of a template.
    place.attrib.update({name: str(index) for index, name in enumerate(_INDICES)})
    if platform.sync_gps_time:
        place.set("syncGPSTime", "true")


def _child(element: Element, tag: str) -> Element:
    found = element.find(tag)
    return SubElement(element, tag) if found is None else found


def _text(value: float) -> str:
    """Return a number without the last digit, which a conversion of units may have changed."""
    return str(float(f"{value:.15g}"))
