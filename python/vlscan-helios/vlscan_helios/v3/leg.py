"""Legs: their start, and the settings of the scanner."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element

from pydantic import PrivateAttr

from vlscan.legs import Template

from .errors import WrongTypeError
from .platforms import DynamicPlatformSettings, Platform, PlatformSettingsBase, StaticPlatformSettings, TrajectorySettings
from .scanner import ScannerSettings, ScannerSettingsBase
from .validation import Model, distribute


class LegSource:
    """The element of a file that a leg was read from; copies of the leg share it.

    Parameters
    ----------
    element : xml.etree.ElementTree.Element
        The element.
    as_read : Leg
        The leg as it was read.
    templates : mapping of str to vlscan.legs.Template
        Templates of its scanner and its platform settings.
    """

    def __init__(self, element: Element, as_read: Leg, templates: Mapping[str, Template]) -> None:
        self.element: Element = element
        self.as_read: Leg = as_read
        self.templates: Mapping[str, Template] = templates

    def __deepcopy__(self, memo: object) -> LegSource:
        return self


class Leg(Model):
    """A leg: its start, and the settings of the scanner.

    Parameters
    ----------
    scanner_settings : ScannerSettingsBase
        Settings of the scanner.
    platform_settings : PlatformSettingsBase
        Start of the leg.
    trajectory_settings : TrajectorySettings, optional
        The part of a trajectory that is flown.
    """

    scanner_settings: ScannerSettingsBase
    platform_settings: PlatformSettingsBase
    trajectory_settings: TrajectorySettings | None = None
    _source: LegSource | None = PrivateAttr(None)

    @property
    def source(self) -> LegSource | None:
        """Element of a file that it was read from."""
        return self._source

    def read_from(self, element: Element, templates: Mapping[str, Template]) -> Leg:
        """Keep the element that it was read from.

        Parameters
        ----------
        element : xml.etree.ElementTree.Element
            The element.
        templates : mapping of str to vlscan.legs.Template
            Templates of its settings.

        Returns
        -------
        Leg
            Itself.
        """
        self._source = LegSource(element, self.clone(), templates)
        return self


def flown_part(leg: Leg) -> TrajectorySettings | None:
    """Return the part of a trajectory that a leg flies: its own, else that of its platform settings; ``None`` for none.

    Parameters
    ----------
    leg : Leg
        The leg.

    Returns
    -------
    TrajectorySettings or None
        The part.
    """
    of_platform = getattr(leg.platform_settings, "trajectory_settings", None)
    return leg.trajectory_settings or (None if of_platform == TrajectorySettings() else of_platform)


def make_leg(
    platform: Platform,
    leg: Leg | None,
    platform_settings: PlatformSettingsBase | None,
    scanner_settings: ScannerSettingsBase | None,
    trajectory_settings: TrajectorySettings | None,
    parameters: dict[str, Any],
) -> Leg:
    """Return the leg of settings and of keywords, which replace values of the settings.

    Parameters
    ----------
    platform : Platform
        The platform that flies it.
    leg : Leg, optional
        The leg that is extended.
    platform_settings, scanner_settings, trajectory_settings : Model, optional
        Settings instead of those of the leg.
    parameters : dict
        Keywords of settings.

    Returns
    -------
    Leg
        The leg that was given, changed, or a new one; settings that keywords change are copies.

    Raises
    ------
    ValueError
        Unknown keywords, or invalid values.
    """
    if leg is not None and not isinstance(leg, Leg):
        raise WrongTypeError(f"leg is {leg!r}, expected a Leg; keywords make one: add_leg(x=0, y=0, z=2)")
    _check_kind("platform_settings", platform_settings, PlatformSettingsBase)
    _check_kind("scanner_settings", scanner_settings, ScannerSettingsBase)
    if leg is not None and not parameters and (platform_settings, scanner_settings, trajectory_settings) == (None, None, None):
        return leg
    platform_keys = [*DynamicPlatformSettings.model_fields]
    for_scanner, for_platform, for_trajectory = distribute(
        parameters, ScannerSettings.model_fields, platform_keys, TrajectorySettings.model_fields
    )
    if leg is not None:
        platform_settings = platform_settings or leg.platform_settings
        scanner_settings = scanner_settings or leg.scanner_settings
        trajectory_settings = trajectory_settings or leg.trajectory_settings
    if platform_settings is None:
        platform_settings = platform.platform_settings or _default_place(platform)
    if for_platform.keys() - type(platform_settings).model_fields:
        # Of another kind than the keywords need: the kind that knows all of them.
        wider = DynamicPlatformSettings()
        wider.update_from_object(platform_settings)
        platform_settings = wider
    scanner_settings = scanner_settings or ScannerSettings()
    if for_trajectory or trajectory_settings:
        trajectory_settings = _changed(trajectory_settings or TrajectorySettings(), for_trajectory)
    scanner_settings, platform_settings = _changed(scanner_settings, for_scanner), _changed(platform_settings, for_platform)
    if leg is None:
        return Leg(scanner_settings, platform_settings, trajectory_settings)
    leg.scanner_settings, leg.platform_settings, leg.trajectory_settings = scanner_settings, platform_settings, trajectory_settings
    return leg


def _check_kind(name: str, settings: object, kind: type[Model]) -> None:
    if settings is not None and not isinstance(settings, kind):
        expected = kind.__name__.removesuffix("Base")
        raise WrongTypeError(f"{name} is {settings!r}, expected {expected}; values can be keywords of add_leg()")


def _default_place(platform: Platform) -> PlatformSettingsBase:
    return StaticPlatformSettings() if platform.is_static else DynamicPlatformSettings()


def _changed(settings: Any, values: dict[str, Any]) -> Any:
    if not values:
        return settings
    settings = settings.clone()
    settings.update_from_dict(values)
    return settings
