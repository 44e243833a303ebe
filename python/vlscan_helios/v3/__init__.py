"""The names of HELIOS++ 3 over vlscan: ``import vlscan.helios as helios``.

Scripts that also say ``from helios.scanner import ...`` keep their lines after ``vlscan.helios.install()``, which makes this
package importable as ``helios``.

Quantities are texts with units (``"10 deg/s"``), quantities of :mod:`pint` (:data:`units`), or plain numbers in SI units: m, s,
rad, rad/s, Hz; of waveforms in ns. Unknown keywords are ``ValueError``; what vlscan does otherwise is a ``NotImplementedError``
that says how. Written from the public interface; no code of HELIOS++ is contained.
"""

from __future__ import annotations

import sys
from types import ModuleType

from . import platforms, scanner, scene, settings, survey
from .materials import Material
from .platforms import Platform, list_platforms, platform_from_name
from .scanner import Scanner, list_scanners, scanner_from_name
from .scene import ScenePart, StaticScene
from .settings import (
    DynamicPlatformSettings,
    ExecutionSettings,
    FullWaveformSettings,
    LogVerbosity,
    OutputFormat,
    OutputSettings,
    ParallelizationStrategy,
    PlatformSettings,
    ScannerSettings,
    StaticPlatformSettings,
    TrajectorySettings,
    add_asset_directory,
    combine_parameters,
    set_rng_seed,
    units,
)
from .survey import Leg, Survey, SurveyHook, display_xml

__all__ = [
    "DynamicPlatformSettings",
    "ExecutionSettings",
    "FullWaveformSettings",
    "Leg",
    "LogVerbosity",
    "Material",
    "OutputFormat",
    "OutputSettings",
    "ParallelizationStrategy",
    "Platform",
    "PlatformSettings",
    "Scanner",
    "ScannerSettings",
    "ScenePart",
    "StaticPlatformSettings",
    "StaticScene",
    "Survey",
    "SurveyHook",
    "TrajectorySettings",
    "add_asset_directory",
    "combine_parameters",
    "display_xml",
    "install",
    "list_platforms",
    "list_scanners",
    "platform_from_name",
    "platforms",
    "scanner",
    "scanner_from_name",
    "scene",
    "set_rng_seed",
    "settings",
    "survey",
    "units",
]


def install(name: str = "helios") -> ModuleType:
    """Make this package importable by another name in this process, submodules included.

    Parameters
    ----------
    name : str
        The name.

    Returns
    -------
    module
        The package.
    """
    package = sys.modules[__name__]
    sys.modules[name] = package
    for module in (platforms, scanner, scene, settings, survey):
        sys.modules[f"{name}.{module.__name__.rsplit('.', 1)[1]}"] = module
    return package
