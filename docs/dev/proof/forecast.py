"""Foresees the last third of a flight line of a conic scanner: python forecast.py RECORDING.laz [--vlscan PROGRAM] [--folder FOLDER]

The first two thirds of the time are given to `vlscan fit`, which writes the flight on beyond them (--extend). The beams of the written files
(place and attitude of the platform, phase and wander of the mirror) are intersected with the heights of the recorded points at their
times; the differences of place and scan angle are printed by the time since the last pulse that was fitted. Needs numpy, laspy with lazrs.
"""

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

import laspy
import numpy as np
from recordings import fitted_scanner, read_cloud, run_script


def turned(x, y, z, roll, pitch):
    """Right side down by the roll, then nose up by the pitch, in the axes right, forward, up."""
    x, z = np.cos(roll) * x + np.sin(roll) * z, np.cos(roll) * z - np.sin(roll) * x
    return x, np.cos(pitch) * y - np.sin(pitch) * z, np.sin(pitch) * y + np.cos(pitch) * z


def foreseen(folder, start, time, height):
    """Places east and north at which the written flight's beams meet these heights, m, and their scan angles, degrees."""
    scanner = fitted_scanner(folder / "flight.toml", "conic")
    poses = np.loadtxt(folder / "flight.trajectory.csv", delimiter=",", skiprows=1)
    wander = np.loadtxt(folder / "flight.wander.txt")
    at = lambda column: np.interp(time, poses[:, 0], poses[:, column])
    sense = -1 if scanner.get("scan_reverse") else 1
    half_angle = np.radians(scanner["scan_angle_max_deg"])
    # The phase counts from the right, here from ahead.
    phase = np.radians(scanner["scan_phase_deg"] + 90)
    turn = 2 * np.pi * sense * scanner["scan_freq_max_hz"] * (time - start) + phase
    turn = turn + np.radians(np.interp(time - start, wander[:, 0], wander[:, 1]))
    x, y, z = np.sin(half_angle) * np.sin(turn), np.sin(half_angle) * np.cos(turn), np.full(len(turn), -np.cos(half_angle))
    tilt = np.radians(scanner["scan_axis_tilt_deg"])
    x, y, z = turned(x, y, z, np.radians(at(4)) - tilt[0], np.radians(at(5)) + tilt[1])
    heading, scale = np.radians(poses[0, 6]), (at(3) - height) / -z
    east = at(1) + scale * (x * np.cos(heading) + y * np.sin(heading))
    north = at(2) + scale * (y * np.cos(heading) - x * np.sin(heading))
    return east, north, np.degrees(np.arctan2(x, -z))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--vlscan", default="vlscan")
    parser.add_argument("--folder", type=Path)
    args = parser.parse_args()
    program = shutil.which(args.vlscan) or parser.error(f"--vlscan {args.vlscan}: no such program")
    folder = args.folder or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    las = read_cloud(args.recording)
    time = np.asarray(las.gps_time)
    until = time.min() + (time.max() - time.min()) * 2 / 3
    part = laspy.LasData(las.header)
    part.points = las.points[time <= until].copy()
    part.write(folder / "fitted.laz")
    last = time[time <= until].max()
    command = [Path(program).absolute(), "fit", "fitted.laz", "-o", "flight.toml", "--extend", f"{time.max() - last:.6f}", "--force"]
    subprocess.run(command, check=True, cwd=folder)
    first = np.asarray(las.return_number) == 1
    east, north, angle = foreseen(folder, time.min(), time, np.asarray(las.z))
    recorded = np.asarray(las.scan_angle) * 0.006 if las.header.point_format.id >= 6 else np.asarray(las.scan_angle_rank)
    differences = east - np.asarray(las.x), north - np.asarray(las.y), angle - recorded
    rms = lambda chosen: [np.sqrt(np.mean(difference[chosen] ** 2)) for difference in differences]
    print("| s after the last pulse that was fitted | east, rms, m | north, rms, m | scan angle, rms |\n|---|---|---|---|")
    print("| fitted | {:.3f} | {:.3f} | {:.4f}° |".format(*rms(first & (time <= until))))
    # In small steps where the forecast begins.
    limits = [last + step for step in (0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8) if last + step < time.max()] + [time.max()]
    for low, high in zip(limits[:-1], limits[1:]):
        print(f"| {low - last:.2f} to {high - last:.2f} | " + "{:.2f} | {:.2f} | {:.4f}° |".format(*rms(first & (time > low) & (time <= high))))


if __name__ == "__main__":
    run_script(main)
