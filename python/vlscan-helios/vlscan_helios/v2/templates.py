"""Templates of settings in the file of a survey, by the names of version 2."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError, parse

from vlscan_helios.v3.utils import find_file

# Values of settings: attribute of XML, value without it, divisor.
_SCANNER: Mapping[str, tuple[str, float | bool, float]] = {
    **{"active": ("active", True, 1), "pulseFreq": ("pulseFreq_hz", 0, 1), "scanFreq": ("scanFreq_hz", 0, 1)},
    **{"scanAngle": ("scanAngle_deg", 0, 180 / math.pi), "headRotatePerSec": ("headRotatePerSec_deg", 0, 180 / math.pi)},
    **{"headRotateStart": ("headRotateStart_deg", 0, 180 / math.pi), "headRotateStop": ("headRotateStop_deg", 0, 180 / math.pi)},
    **{"verticalAngleMin": ("verticalAngleMin_deg", math.nan, 180 / math.pi)},
    **{"verticalAngleMax": ("verticalAngleMax_deg", math.nan, 180 / math.pi)},
    **{"beamDivAngle": ("beamDivergence_rad", 0.003, 1), "trajectoryTimeInterval": ("trajectoryTimeInterval_s", 0.01, 1)},
}
_PLATFORM: Mapping[str, tuple[str, float | bool, float]] = {
    **{"x": ("x", 0, 1), "y": ("y", 0, 1), "z": ("z", 0, 1), "onGround": ("onGround", False, 1)},
    **{"movePerSec": ("movePerSec_m", 70, 1)},
}
_KINDS = {"scannerSettings": _SCANNER, "platformSettings": _PLATFORM}


class Template:
    """Settings that legs refer to, which cannot be changed; SI units, angles in rad.

    Parameters
    ----------
    element : xml.etree.ElementTree.Element
        The element of the settings.
    """

    def __init__(self, element: Element) -> None:
        object.__setattr__(self, "_element", element)

    @property
    def id(self) -> str:
        """Id in the file."""
        return str(self._element.get("id", ""))

    def getId(self) -> str:
        """Return the id in the file."""
        return self.id

    def __getattr__(self, name: str) -> Any:
        known = _KINDS[self._element.tag]
        if name.startswith("get") and name not in known:
            own = name[3:4].lower() + name[4:]
            return lambda: getattr(self, own)
        if name not in known:
            raise AttributeError(f"no attribute {name!r} of a template; there are id, {', '.join(known)}")
        attribute, default, divisor = known[name]
        text = self._element.get(attribute)
        if isinstance(default, bool):
            return {"true": True, "1": True, "false": False, "0": False}.get((text or "").strip().lower(), default)
        return number_or(text, default) / divisor

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"templates cannot be changed, found {name}; change the settings of the leg")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *_KINDS[self._element.tag]]


def number_or(text: str | None, default: float) -> float:
    """Return a number, or the default for a text that is none: the engine tells about it when the file is run."""
    try:
        return default if text is None else float(text)
    except ValueError:
        return default


def template_of(survey: str, leg: int, tag: str) -> Template | None:
    """Return the template that the settings of a leg name.

    Parameters
    ----------
    survey : str
        File of the survey.
    leg : int
        Number of the leg in that file, from 0; below 0 for one that is not in it.
    tag : str
        ``scannerSettings`` or ``platformSettings``.

    Returns
    -------
    Template or None
        The template; ``None`` if there is none.
    """
    found = find_file(survey, fatal=False)
    if leg < 0 or found is None:
        return None
    try:
        root = parse(found).getroot()
        settings = list(root.iter("leg"))[leg].find(tag)
        file, _, id = ("" if settings is None else settings.get("template", "")).rpartition("#")
        home = find_file(file, fatal=False) or found.parent / Path(file).name if file else None
        known = root if home is None else parse(home).getroot()
    except (ParseError, IndexError, OSError):
        # The engine tells what is wrong with the file.
        return None
    chosen = [element for element in known.iter(tag) if id and element.get("id") == id]
    return Template(chosen[0]) if chosen else None
