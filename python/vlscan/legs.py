"""Legs of surveys: waypoints with the settings of scanner and platform from there on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from ._arguments import reals
from ._checked import Checked
from ._keys import check_keys
from ._typing import Vector

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._checked import Converted
    from ._keys import LegSettings


class FlownPart(NamedTuple):
    """The part of a recorded trajectory that a leg of a file flies.

    Attributes
    ----------
    start_s, end_s : float or None
        Start and end, s in the time of the trajectory; ``None`` stands for those of the trajectory.
    teleport : bool
        True if the platform jumps to the start instead of travelling there.
    """

    start_s: float | None
    end_s: float | None
    teleport: bool


class Template(NamedTuple):
    """Settings that legs of an XML file share, see :attr:`Leg.templates`.

    Attributes
    ----------
    id : str
        Id in the file.
    leg : Leg
        A leg with the settings of the template alone.
    """

    id: str
    leg: Leg


class Leg(Checked):
    """A waypoint and the way to the next one: the last leg of a moving platform is where it arrives.

    Parameters
    ----------
    position : sequence of float
        x, y, z, world frame, m.
    on_ground : bool
        True if z is taken from the ground.
    speed_m_per_s : float, optional
        Speed on the way to the next leg.
    active : bool
        True if the scanner fires.
    strip : str, optional
        Name of a strip; legs of the same strip share their files.
    **settings : LegSettings
        Settings of the scanner (docs/pipelines.md): ``pulse_freq_hz``, ``scan_freq_hz``, ``scan_angle_deg``,
        ``head_rate_deg_per_s``, ``head_start_deg``, ``head_stop_deg``, ``vertical_resolution_deg`` and so on.

    Raises
    ------
    TypeError
        A keyword is no setting.
    ValueError
        The position has not three numbers, or one that is not finite.

    Examples
    --------
    >>> leg = vlscan.Leg((0, 0, 1.7), scan_freq_hz=120, head_rate_deg_per_s=60, head_stop_deg=360)
    >>> leg.settings["scan_freq_hz"]
    120
    """

    _ATTRIBUTES: ClassVar[tuple[str, ...]] = ("position", "on_ground", "speed_m_per_s", "active", "strip", "settings")

    if TYPE_CHECKING:
        position: Converted[list[float], Vector] = Converted()
        settings: Converted[dict[str, object], Mapping[str, object] | None] = Converted()

    def __init__(
        self,
        position: Vector = (0.0, 0.0, 0.0),
        *,
        on_ground: bool = False,
        speed_m_per_s: float | None = None,
        active: bool = True,
        strip: str | None = None,
        **settings: Unpack[LegSettings],
    ) -> None:
        self.position = position
        self.on_ground: bool = on_ground
        self.speed_m_per_s: float | None = speed_m_per_s
        self.active: bool = active
        self.strip: str | None = strip
        self.settings = dict(settings)
        self._flown: FlownPart | None = None
        self._templates: dict[str, Template] = {}

    @staticmethod
    def _of_file(keys: Mapping[str, Any]) -> Leg:
        """Return the leg that the engine has read."""
        flown, templates = keys["trajectory"], keys.get("templates", {})
        leg = Leg(**{key: value for key, value in keys.items() if key not in ("trajectory", "templates")})
        leg._flown = None if flown is None else FlownPart(*flown)
        leg._templates = {name: Template(id, Leg._of_file(own)) for name, (id, own) in templates.items()}
        return leg

    @property
    def flown_part(self) -> FlownPart | None:
        """Part of a recorded trajectory that a leg of a file flies; ``None`` for other legs."""
        return self._flown

    @property
    def templates(self) -> dict[str, Template]:
        """Templates that a leg of an XML file names, for its ``scanner`` and ``platform`` settings; their values are the leg's, too."""
        return dict(self._templates)

    def _checked(self, name: str, value: object) -> object:
        if name == "position":
            if isinstance(value, (str, bytes, set, frozenset, Mapping)) or not isinstance(value, Iterable):
                raise TypeError(f"position of a leg is x, y, z, found {type(value).__name__}: vlscan.Leg((x, y, z), ...)")
            numbers = reals("position of a leg", value if hasattr(value, "__array__") else list(value))
            if numbers.shape != (3,):
                raise ValueError(f"position of a leg has the shape {numbers.shape}, expected x, y, z")
            if not np.isfinite(numbers).all():
                raise ValueError(f"position of a leg is {numbers.tolist()}, expected finite numbers")
            return numbers.tolist()
        if name == "settings":
            return keys_of("Leg", value, "[settings]")
        if name in ("active", "on_ground"):
            if not isinstance(value, (bool, np.bool_)) and value not in (0, 1):
                raise TypeError(f"{name} of a leg is True or False, found {value!r}")
            return bool(value)
        if name == "strip" and not (value is None or isinstance(value, str)):
            raise TypeError(f"strip of a leg is a name, found {type(value).__name__}")
        return value

    def _keys(self) -> dict[str, object]:
        return {
            "position_m": self.position,
            "on_ground": True if self.on_ground else None,
            "speed_m_per_s": None if self.speed_m_per_s is None else float(self.speed_m_per_s),
            "active": None if self.active else False,
            "strip": self.strip,
            "settings": self.settings or None,
        }

    def __repr__(self) -> str:
        keys = {name: value for name, value in self._keys().items() if value is not None and name not in ("position_m", "settings")}
        words = [str(tuple(self.position)), *(f"{name}={value!r}" for name, value in {**keys, **self.settings}.items())]
        return f"Leg({', '.join(words)})"


def keys_of(what: str, value: object, table: str) -> dict[str, object]:
    """Return keys of a table as a dictionary of its own."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise TypeError(f"{what} is a mapping of keys, found {type(value).__name__}")
    check_keys(what, value, table)
    return dict(value)


def legs_of(value: object) -> list[Leg]:
    """Return legs as a list."""
    if isinstance(value, Leg) or not isinstance(value, Iterable):
        raise TypeError(f"legs are a list of Leg, found {type(value).__name__}")
    legs = list(value)
    wrong = next((leg for leg in legs if not isinstance(leg, Leg)), None)
    if wrong is not None:
        raise TypeError(f"expected Leg, found {type(wrong).__name__}: vlscan.Leg((x, y, z), ...)")
    return legs
