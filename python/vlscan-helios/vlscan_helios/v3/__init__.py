"""The names of HELIOS++ 3 over vlscan: ``import vlscan.helios as helios``, ``from vlscan.helios.scanner import riegl_vz_400``.

Scripts that say ``from helios.scanner import ...`` keep their lines after ``vlscan.helios.install()``, which makes this package
importable as ``helios``.

Quantities are texts with units (``"10 deg/s"``), quantities of :mod:`pint` (:data:`units`), or plain numbers in SI units: m, s,
rad, rad/s, Hz. Settings are models of :mod:`pydantic`: unknown keywords and invalid values are ``ValueError``, when they are
given and when they are changed. What vlscan does otherwise is a ``NotImplementedError`` that says how. Written from the public
interface; no code of HELIOS++ is contained.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, MutableMapping, Sequence
from datetime import datetime, timezone
from enum import IntEnum
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, Literal, Optional, Tuple, Union  # noqa: UP035

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, validate_call

from vlscan import __version__ as __version__

from . import callbacks, leg, platforms, scanner, scene, serialization, settings, survey, utils, validation
from .callbacks import HookContext, HookEndOfLegPolicy, HookPayload, HookPoint, SurveyHook
from .errors import HeliosException
from .leg import Leg
from .platforms import (
    DynamicPlatformSettings,
    Platform,
    PlatformSettings,
    StaticPlatformSettings,
    TrajectorySettings,
    list_platforms,
    load_traj_csv,
    platform_from_name,
)
from .scanner import Scanner, ScannerSettings, list_scanners, scanner_from_name
from .scene import BoundingBox, Material, ScenePart, StaticScene
from .settings import (
    ExecutionSettings,
    ForceOnGroundStrategy,
    FullWaveformSettings,
    KDTreeFactoryType,
    LogVerbosity,
    OutputFormat,
    OutputSettings,
    ParallelizationStrategy,
    ProgressBarStrategy,
    set_execution_settings,
    set_output_settings,
)
from .survey import Survey
from .utils import add_asset_directory, combine_parameters, display_xml, set_rng_seed
from .validation import units

# Names that ``from helios.survey import *`` brings in version 3, whatever the module: those of all modules, and of libraries.
_SHARED: dict[str, object] = {
    **{"np": np, "datetime": datetime, "timezone": timezone, "Path": Path},
    **{"Annotated": Annotated, "Any": Any, "Callable": Callable, "Literal": Literal, "Optional": Optional},
    **{"Sequence": Sequence, "Tuple": Tuple, "Union": Union, "MutableMapping": MutableMapping},  # noqa: UP006
    **{"BaseModel": BaseModel, "Field": Field, "validate_call": validate_call, "NDArray": NDArray},
    **{"PositiveInt": PositiveInt, "PositiveFloat": PositiveFloat, "IntEnum": IntEnum},
    **{"NonNegativeInt": NonNegativeInt, "NonNegativeFloat": NonNegativeFloat},
}
_QUANTITIES = (
    *("Angle", "AngleVelocity", "AssetPath", "CompressionLevel", "CreatedDirectory", "Frequency", "Length", "MultiAssetPath"),
    *("Quaternion", "R3Vector", "ScanFrequency", "ThreadCount", "TimeInterval", "units"),
)


def _share_names() -> None:
    """Let every module have the public names of all."""
    modules = (callbacks, leg, platforms, scanner, scene, settings, survey, utils, validation)
    instruments = {*platforms.PLATFORM_REGISTRY, *scanner.SCANNER_REGISTRY}
    shared: dict[str, object] = {**_SHARED, **{name: vars(validation)[name] for name in _QUANTITIES}}
    shared |= {name: vars(utils)[name] for name in ("meas_dtype", "traj_dtype")}
    shared |= {name: vars(platforms)[name] for name in ("PLATFORM_REGISTRY", "traj_csv_dtype")}
    shared |= {"SCANNER_REGISTRY": scanner.SCANNER_REGISTRY, "Survey": Survey}
    for module in modules:
        for name, value in vars(module).items():
            is_own = getattr(value, "__module__", "") == module.__name__ and not name.startswith("_")
            if is_own and name not in instruments:
                shared.setdefault(name, value)
    for module in modules:
        own = getattr(module, "__all__", [])
        for name, value in shared.items():
            vars(module).setdefault(name, value)
        vars(module)["__all__"] = sorted({*own, *shared})


_share_names()

__all__ = [
    "BoundingBox",
    "DynamicPlatformSettings",
    "ExecutionSettings",
    "ForceOnGroundStrategy",
    "FullWaveformSettings",
    "HeliosException",
    "HookContext",
    "HookEndOfLegPolicy",
    "HookPayload",
    "HookPoint",
    "KDTreeFactoryType",
    "Leg",
    "LogVerbosity",
    "Material",
    "OutputFormat",
    "OutputSettings",
    "ParallelizationStrategy",
    "Platform",
    "PlatformSettings",
    "ProgressBarStrategy",
    "Scanner",
    "ScannerSettings",
    "ScenePart",
    "StaticPlatformSettings",
    "StaticScene",
    "Survey",
    "SurveyHook",
    "TrajectorySettings",
    "add_asset_directory",
    "callbacks",
    "combine_parameters",
    "display_xml",
    "install",
    "leg",
    "list_platforms",
    "list_scanners",
    "load_traj_csv",
    "metadata",
    "platform_from_name",
    "platforms",
    "scanner",
    "scanner_from_name",
    "scene",
    "serialization",
    "set_execution_settings",
    "set_output_settings",
    "set_rng_seed",
    "settings",
    "survey",
    "units",
    "utils",
    "validation",
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
    own = {key: module for key, module in sys.modules.items() if f"{key}.".startswith(f"{__name__}.")}
    sys.modules.update({name + key.removeprefix(__name__): module for key, module in own.items()})
    if name == "helios":
        sys.modules.setdefault("_helios", _engine_module())
    return package


def _engine_module() -> ModuleType:
    """Return what scripts import from the engine of HELIOS++ 3: the exception, and what hooks are told."""
    module = ModuleType("_helios", "The names of HELIOS++'s engine that vlscan has.")
    module.__dict__.update(HeliosException=HeliosException, HookContext=HookContext)
    return module
