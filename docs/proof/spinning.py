"""Holds a spinning sensor against its recording: python spinning.py VLSCAN RECORDING.parquet CALIBRATION.json OUT

VLSCAN is the program. The recording is a revolution: beam, column, range_mm, reflectivity, signal (see `vlscan fit --help`). The even
columns give planes, noise and detection; the sensor that was estimated is flown over the planes as a scene; what it records is
fitted in the same way, and scatter and dropouts of the odd columns of both are compared by class. Chance is the same comparison of
the odd and the even columns of the recording. Writes OUT/figures.md, OUT/figures.json and OUT/noise.png.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq


def run(*command):
    return subprocess.run([str(part) for part in command], check=True, capture_output=True, text=True).stdout


def fit(vlscan, recording, calibration, out, *options):
    text = run(vlscan, "fit", recording, "--calibration", calibration, "-o", out, "--json", "--force", *options)
    return json.loads(text)


def first(calibration, *names):
    """The first of these keys of a calibration file, at the top or in a section."""
    sections = [calibration] + [value for value in calibration.values() if isinstance(value, dict)]
    return next(section[name] for name in names for section in sections if name in section)


def beams(path):
    """Altitudes and azimuths of the beams (rad), distance of their origin from the axis (m), columns of a revolution."""
    calibration = json.loads(path.read_text())
    altitude = np.radians(first(calibration, "beam_altitude_angles", "beam_altitude_deg"))
    azimuth = np.radians(first(calibration, "beam_azimuth_angles", "beam_azimuth_deg"))
    origin = first(calibration, "lidar_origin_to_beam_origin_mm", "origin_to_beam_mm") / 1000
    return altitude, azimuth, origin, int(first(calibration, "lidar_mode", "mode").split("x")[0])


def directions(sensor):
    """Origins and directions of all beams by beam and column, by the formula of Ouster's manual, with y towards column 0."""
    altitude, azimuth, origin, columns = sensor
    encoder = -2 * np.pi * np.arange(columns) / columns + 0 * altitude[:, None]
    angle = encoder - azimuth[:, None]
    up = altitude[:, None] + 0 * encoder
    directions = np.stack([-np.sin(angle) * np.cos(up), np.cos(angle) * np.cos(up), np.sin(up)], -1)
    return origin * np.stack([-np.sin(encoder), np.cos(encoder), 0 * up], -1), directions


def simulate(vlscan, pipeline, sensor, work):
    """A recording of the pipeline's sensor, in the form of the real one."""
    points = work / "points.parquet"
    run(vlscan, "run", pipeline, "-o", points, "--format", "parquet", "--columns", "x,y,z,device,pulse", "--force", "-q")
    table = pq.read_table(points)
    origins, beam_directions = directions(sensor)
    beam = table["device"].to_numpy().astype(int)
    column = table["pulse"].to_numpy().astype(int) - 1
    position = np.stack([table[name].to_numpy() for name in "xyz"], 1)
    range_m = np.einsum("ij,ij->i", position - origins[beam, column], beam_directions[beam, column])
    # Off the beam: the pattern of beams and columns is another one.
    off = np.linalg.norm(position - origins[beam, column] - range_m[:, None] * beam_directions[beam, column], axis=1)
    ranges = np.zeros(origins.shape[:2])
    ranges[beam, column] = np.rint((range_m + sensor[2]) * 1000)
    return ranges, float(np.degrees(np.max(off / range_m)))


def record(ranges, real, path):
    """Writes a simulated recording; reflectivity and signal are those of the real one, as the law of noise was estimated by them."""
    rows, columns = ranges.shape
    beam, column = np.divmod(np.arange(rows * columns), columns)
    names = [name for name in ("reflectivity", "signal") if name in real.column_names]
    data = {"beam": beam.astype(np.uint16), "column": column.astype(np.uint16), "range_mm": ranges.ravel().astype(np.uint32)}
    for name in names:
        image = np.zeros(ranges.shape)
        image[real["beam"].to_numpy(), real["column"].to_numpy()] = real[name].to_numpy()
        data[name] = image.ravel()
    pq.write_table(pa.table(data), path)
