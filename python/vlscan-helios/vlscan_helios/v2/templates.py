"""Templates of settings in the file of a survey, by the names of version 2."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from vlscan.legs import Template as EngineTemplate
from vlscan_helios.v3 import DynamicPlatformSettings

# Values of scanner settings: key of a leg, value without it, divisor.
_SCANNER: Mapping[str, tuple[str, float, float]] = {
    **{"pulseFreq": ("pulse_freq_hz", 0, 1), "scanFreq": ("scan_freq_hz", 0, 1)},
    **{"scanAngle": ("scan_angle_deg", 0, 180 / math.pi), "headRotatePerSec": ("head_rate_deg_per_s", 0, 180 / math.pi)},
    **{"headRotateStart": ("head_start_deg", 0, 180 / math.pi), "headRotateStop": ("head_stop_deg", 0, 180 / math.pi)},
    **{"verticalAngleMin": ("vertical_angle_min_deg", math.nan, 180 / math.pi)},
    **{"verticalAngleMax": ("vertical_angle_max_deg", math.nan, 180 / math.pi)},
    **{"beamDivAngle": ("beam_divergence_rad", 0.003, 1), "trajectoryTimeInterval": ("trajectory_interval_s", 0, 1)},
}


class Template:
    """Settings that legs refer to, which cannot be changed; SI units, angles in rad.

    Parameters
    ----------
    template : vlscan.legs.Template
        The settings.
    kind : str
        ``scanner`` or ``platform``.
    """

    def __init__(self, template: EngineTemplate, kind: str) -> None:
        values = _scanner_values(template) if kind == "scanner" else _platform_values(template)
        object.__setattr__(self, "_values", values)
        object.__setattr__(self, "_id", template.id)

    @property
    def id(self) -> str:
        """Id in the file."""
        return str(self._id)

    def getId(self) -> str:
        """Return the id in the file."""
        return self.id

    def __getattr__(self, name: str) -> Any:
        values: dict[str, Any] = self.__dict__.get("_values", {})
        if name.startswith("get") and (own := name[3:4].lower() + name[4:]) in values:
            return lambda: values[own]
        if name not in values:
            raise AttributeError(f"no attribute {name!r} of a template; there are id, {', '.join(values)}")
        return values[name]

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"templates cannot be changed, found {name}; change the settings of the leg")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._values]


def _scanner_values(template: EngineTemplate) -> dict[str, Any]:
    settings: Mapping[str, Any] = template.leg.settings
    numbers = {name: settings.get(key, default) / divisor for name, (key, default, divisor) in _SCANNER.items()}
    return {"active": template.leg.active, **numbers}


def _platform_values(template: EngineTemplate) -> dict[str, Any]:
    leg = template.leg
    speed = DynamicPlatformSettings().speed_m_s if leg.speed_m_per_s is None else leg.speed_m_per_s
    return {**dict(zip("xyz", leg.position, strict=True)), "onGround": leg.on_ground, "movePerSec": float(speed)}
