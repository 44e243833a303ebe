"""Divide a recording in two: python halves.py RECORDING OUT_A OUT_B [--lines] [--raise METRES] [--seed N]

Whole pulses (points of one source and GPS time) go to one file or the other by a coin; with --lines whole scan lines, which end where
the times of a source have a gap of more than a millisecond, of two neighbouring lines one to each file. --raise lifts the points of the second file.
Needs laspy and numpy.
"""

import argparse
import sys

import laspy
import numpy as np
from recordings import check_pulses, read_cloud, run_script

GAP_S = 1e-3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording")
    parser.add_argument("out", nargs=2)
    parser.add_argument("--lines", action="store_true")
    parser.add_argument("--raise", dest="lift", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()

    cloud = read_cloud(args.recording)
    steps = args.lift / cloud.header.scales[2]
    if abs(steps - round(steps)) > 1e-6:
        parser.error(f"--raise {args.lift}: expected a multiple of {cloud.header.scales[2]} m, the step of the recording's heights")
    pulses, pulse_of = np.unique(np.array([cloud.point_source_id, cloud.gps_time]).T, axis=0, return_inverse=True)
    check_pulses(args.recording, cloud, pulse_of.ravel())
    random = np.random.default_rng(args.seed)
    if args.lines:
        is_new = (np.diff(pulses[:, 0]) != 0) | (np.diff(pulses[:, 1]) > GAP_S)
        line = np.concatenate([[0], np.cumsum(is_new)])
        coin = random.integers(0, 2, line[-1] // 2 + 1)
        part = line % 2 ^ coin[line // 2]
    else:
        part = random.integers(0, 2, len(pulses))
    part = part[pulse_of.ravel()]
    if len(np.unique(part)) < 2:
        sys.exit(f"{args.recording}: {len(pulses)} pulses{' of one line' * args.lines}: one of the halves has none")
    for number, path in enumerate(args.out):
        half = laspy.LasData(cloud.header)
        half.points = cloud.points[part == number].copy()
        if number == 1 and args.lift:
            half.points["Z"] = half.points["Z"] + round(steps)
        half.write(path)


if __name__ == "__main__":
    run_script(main)
