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
    from .campaigns import CampaignReport, campaign_cells, run_campaign
    from .catalogue import (
        DeviceFigures,
        ScannerFigures,
        Spectrum,
        all_scanner_figures,
        columns,
        options,
        platform_kind,
        platforms,
        scanner_figures,
        scanners,
        spectra,
    )
    from .clouds import CloudInfo, FrameCounts, Rasters, cloud_info, raster, write_frames
    from .comparisons import ChangeMap, Comparison, compare
    from .errors import Error, FileError, InputError, Problem, VlscanWarning
    from .fits import Fitted, Reconstruction, fit_flight, fit_sensor, reconstruct
    from .forecast import DryRun
    from .instruments import Platform, Scanner
    from .legs import Leg
    from .making import MadeScene, Stand, make_scene, make_stand, unzip
    from .materials import Material
    from .parts import Part
    from .plans import Plan, PlanLine, plan_airborne, plan_mobile, plan_terrestrial
    from .points import Points
    from .previews import preview
    from .results import Batches, Result
    from .scene import RayHits, Scene, SceneGeometry
    from .shards import check_shards, index_shards, merge_shards, run_shard
    from .survey import Survey, dry_run, pulses, run, run_batches, trace, trajectory
    from .tables import Table, Waveforms

    __version__: str

# Modules are imported when one of their names is needed first, so that the command starts quickly.
_MODULES = {
    "_options": ["RunOptions"],
    "campaigns": ["CampaignReport", "campaign_cells", "run_campaign"],
    "catalogue": [
        *(
            "DeviceFigures",
            "ScannerFigures",
            "Spectrum",
            "all_scanner_figures",
            "columns",
            "options",
            "platform_kind",
            "platforms",
            "scanner_figures",
        ),
        *("scanners", "spectra"),
    ],
    "clouds": ["CloudInfo", "FrameCounts", "Rasters", "cloud_info", "raster", "write_frames"],
    "comparisons": ["ChangeMap", "Comparison", "compare"],
    "errors": ["Error", "FileError", "InputError", "Problem", "VlscanWarning"],
    "fits": ["Fitted", "Reconstruction", "fit_flight", "fit_sensor", "reconstruct"],
    "forecast": ["DryRun"],
    "instruments": ["Platform", "Scanner"],
    "legs": ["Leg"],
    "making": ["MadeScene", "Stand", "make_scene", "make_stand", "unzip"],
    "materials": ["Material"],
    "parts": ["Part"],
    "plans": ["Plan", "PlanLine", "plan_airborne", "plan_mobile", "plan_terrestrial"],
    "points": ["Points"],
    "previews": ["preview"],
    "results": ["Batches", "Result"],
    "scene": ["RayHits", "Scene", "SceneGeometry"],
    "shards": ["check_shards", "index_shards", "merge_shards", "run_shard"],
    "survey": ["Survey", "dry_run", "pulses", "run", "run_batches", "trace", "trajectory"],
    "tables": ["Table", "Waveforms"],
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "Batches",
    "CampaignReport",
    "ChangeMap",
    "CloudInfo",
    "Comparison",
    "DeviceFigures",
    "DryRun",
    "Error",
    "FileError",
    "Fitted",
    "FrameCounts",
    "InputError",
    "Leg",
    "MadeScene",
    "Material",
    "Part",
    "Plan",
    "PlanLine",
    "Platform",
    "Points",
    "Problem",
    "Rasters",
    "RayHits",
    "Reconstruction",
    "Result",
    "RunOptions",
    "Scanner",
    "ScannerFigures",
    "Scene",
    "SceneGeometry",
    "Spectrum",
    "Stand",
    "Survey",
    "Table",
    "VlscanWarning",
    "Waveforms",
    "all_scanner_figures",
    "campaign_cells",
    "check_shards",
    "cloud_info",
    "columns",
    "compare",
    "dry_run",
    "fit_flight",
    "fit_sensor",
    "index_shards",
    "make_scene",
    "make_stand",
    "merge_shards",
    "options",
    "plan_airborne",
    "plan_mobile",
    "plan_terrestrial",
    "platform_kind",
    "platforms",
    "preview",
    "pulses",
    "raster",
    "reconstruct",
    "run",
    "run_batches",
    "run_campaign",
    "run_shard",
    "scanner_figures",
    "scanners",
    "spectra",
    "trace",
    "trajectory",
    "unzip",
    "write_frames",
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
