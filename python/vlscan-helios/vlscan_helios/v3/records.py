"""Points and poses of the engine as records, and as laspy objects."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlscan.points import Points
from vlscan.tables import Table

from .utils import meas_dtype, traj_dtype

# Fields of a point and the columns of the engine that they hold.
_COLUMNS: dict[str, str | tuple[str, ...]] = {
    "channel_id": "Device",
    "hit_object_id": "ObjectId",
    "position": ("X", "Y", "Z"),
    "beam_direction": ("BeamDirectionX", "BeamDirectionY", "BeamDirectionZ"),
    "beam_origin": ("BeamOriginX", "BeamOriginY", "BeamOriginZ"),
    "distance": "Range",
    "intensity": "Amplitude",
    "echo_width": "EchoWidth",
    "return_number": "ReturnNumber",
    "number_of_returns": "NumberOfReturns",
    "fullwave_index": "PulseNumber",
    "classification": "SurfaceClass",
    "gps_time": "GpsTime",
    "point_source_id": "PointSourceId",
}

#: The columns that records and laspy objects are made of.
COLUMNS: list[str] = [name for names in _COLUMNS.values() for name in ([names] if isinstance(names, str) else names)] + [
    "Intensity",
    "ScanAngle",
]


def point_records(points: Points) -> NDArray[np.void]:
    """Return points as records of :data:`meas_dtype`."""
    records = np.empty(len(points), dtype=meas_dtype)
    for field, columns in _COLUMNS.items():
        if isinstance(columns, str):
            records[field] = points[columns]
        else:
            for axis, column in enumerate(columns):
                records[field][:, axis] = points[column]
    return records


def pose_records(poses: Table) -> NDArray[np.void]:
    """Return poses as records of :data:`traj_dtype`."""
    records = np.empty(len(poses), dtype=traj_dtype)
    records["gps_time"] = poses["time"]
    for axis, column in enumerate("xyz"):
        records["position"][:, axis] = poses[column]
    for angle in ("roll", "pitch", "yaw"):
        records[angle] = np.radians(poses[f"platform_{angle}"])
    return records


def laspy_data(points: NDArray[np.void], intensity: NDArray[Any], scan_angle: NDArray[Any], scale: float) -> Any:
    """Return points as an object of laspy."""
    try:
        import laspy
    except ImportError as failure:
        raise ImportError("OutputFormat.LASPY needs laspy: pip install laspy") from failure
    header = laspy.LasHeader(version="1.4", point_format=6)
    extra = {"echo_width": "f8", "fullwaveIndex": "i4", "hitObjectId": "i4", "heliosAmplitude": "f8"}
    header.add_extra_dims([laspy.ExtraBytesParams(name, kind) for name, kind in extra.items()])
    header.scales = np.full(3, scale)
    header.offsets = points["position"].min(axis=0) if len(points) else np.zeros(3)
    las = laspy.LasData(header)
    las.x, las.y, las.z = points["position"].T
    las.return_number, las.number_of_returns = points["return_number"], points["number_of_returns"]
    classes = points["classification"]
    # As LAS files have them.
    las.classification = np.where((classes >= 0) & (classes <= 255), classes, 0).astype("u1")
    las.gps_time, las.point_source_id = points["gps_time"], points["point_source_id"]
    las.intensity, las.scan_angle = intensity, np.rint(np.clip(scan_angle / 0.006, -30_000, 30_000))
    las["echo_width"], las["heliosAmplitude"] = points["echo_width"], points["intensity"]
    las["fullwaveIndex"], las["hitObjectId"] = points["fullwave_index"], points["hit_object_id"]
    # Otherwise the header has counts and bounds of 0 until the object is written.
    las.update_header()
    return las
