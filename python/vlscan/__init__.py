"""Virtual laser scanning.

A survey (a scanner that legs or a trajectory carry through a scene) becomes the point cloud that the instrument would have
measured::

    import vlscan

    survey = vlscan.Survey(
        scene="forest.obj",
        scanner="riegl_vz400",
        legs=[vlscan.Leg((0, 0, 1.7), head_rate_deg_per_s=10, head_stop_deg=360, scan_freq_hz=120)],
    )
    result = survey.run(seed=1)
    result.points["X"]                    # NumPy, without a copy
    survey.run(to="forest.laz", seed=1)   # the same points as a file

Lengths are metres, times seconds, angles degrees; keys of settings carry their unit in the name. The same input and seed give
the same points, bit for bit, for any number of threads.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._options import RunOptions
    from .catalogue import columns, options, platforms, scanners
    from .errors import Error, FileError, InputError, Problem, VlscanWarning
    from .instruments import Platform, Scanner
    from .parts import Material, Part
    from .results import Result
    from .scene import Scene
    from .survey import Leg, Survey, run, run_batches, trace
    from .tables import Points, Table, Waveforms
    from .tools import (
        CampaignReport,
        Plan,
        compare,
        fit_flight,
        fit_sensor,
        plan_airborne,
        plan_mobile,
        plan_terrestrial,
        reconstruct,
        run_campaign,
    )

    __version__: str

# Modules are imported when one of their names is needed first, so that the command starts quickly.
_MODULES = {
    "_options": ["RunOptions"],
    "catalogue": ["columns", "options", "platforms", "scanners"],
    "errors": ["Error", "FileError", "InputError", "Problem", "VlscanWarning"],
    "instruments": ["Platform", "Scanner"],
    "parts": ["Material", "Part"],
    "results": ["Result"],
    "scene": ["Scene"],
    "survey": ["Leg", "Survey", "run", "run_batches", "trace"],
    "tables": ["Points", "Table", "Waveforms"],
    "tools": [
        "CampaignReport",
        "Plan",
        "compare",
        "fit_flight",
        "fit_sensor",
        "plan_airborne",
        "plan_mobile",
        "plan_terrestrial",
        "reconstruct",
        "run_campaign",
    ],
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "CampaignReport",
    "Error",
    "FileError",
    "InputError",
    "Leg",
    "Material",
    "Part",
    "Plan",
    "Platform",
    "Points",
    "Problem",
    "Result",
    "RunOptions",
    "Scanner",
    "Scene",
    "Survey",
    "Table",
    "VlscanWarning",
    "Waveforms",
    "columns",
    "compare",
    "fit_flight",
    "fit_sensor",
    "options",
    "plan_airborne",
    "plan_mobile",
    "plan_terrestrial",
    "platforms",
    "reconstruct",
    "run",
    "run_batches",
    "run_campaign",
    "scanners",
    "trace",
]


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name == "__version__":
        from ._vlscan import version

        return version()
    if name in _HOME:
        return getattr(import_module(f".{_HOME[name]}", __name__), name)
    if name in ("helios", "pyhelios"):
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module 'vlscan' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__", "helios", "pyhelios"]
