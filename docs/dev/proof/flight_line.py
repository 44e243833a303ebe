"""Holds a fitted flight line against the arcs that were not used to fit it.

    python flight_line.py RECORDING.laz [--vlscan PROGRAM] [--folder FOLDER] [--picture FILE.png]

A third of the scanner's arcs, one of every three at random, goes to `vlscan fit` and
`vlscan scene reconstruct`; the fitted flight is flown over the reconstructed scene, and its points are compared with the other arcs.
Beside each figure stands what chance gives: the same comparison between the even and the odd arcs that were not used.
Needs numpy, scipy, laspy with lazrs, matplotlib.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import laspy
import numpy as np
from recordings import fitted_scanner, read_cloud, run_script, with_receiver
from scipy.interpolate import LinearNDInterpolator

WEEK = 604_800
GROUND = 2


class Cloud:
    """Points in the order of time, with the arc of each."""

    def __init__(self, path, arcs=None):
        las = read_cloud(path)
        order = np.lexsort((las.return_number, las.gps_time))
        self.las, self.order = las, order
        take = lambda name: np.asarray(las[name])[order]
        self.time = take("gps_time") % WEEK
        self.xyz = np.c_[np.asarray(las.x), np.asarray(las.y), np.asarray(las.z)][order]
        self.returns, self.number = take("number_of_returns"), take("return_number")
        self.ground = take("classification") == GROUND
        extended = las.header.point_format.id >= 6
        self.angle = take("scan_angle") * 0.006 if extended else take("scan_angle_rank").astype(float)
        self.first = self.number == 1
        if arcs is None:
            steps = np.diff(self.time)
            usual = np.median(steps[steps > 0])
            starts = np.r_[0, np.nonzero(steps > 100 * usual)[0] + 1]
            arcs = np.array([self.time[a:b].mean() for a, b in zip(starts, np.r_[starts[1:], len(steps) + 1])])
        self.arcs = arcs
        middle = (arcs[1:] + arcs[:-1]) / 2
        self.arc = np.searchsorted(middle, self.time)

    def select(self, arcs):
        """The points of these arcs."""
        chosen = np.isin(self.arc, arcs)
        other = object.__new__(Cloud)
        other.arcs = self.arcs
        for name in ("time", "xyz", "returns", "number", "ground", "angle", "first", "arc"):
            setattr(other, name, getattr(self, name)[chosen])
        return other

    def write(self, path, arcs):
        chosen = self.order[np.isin(self.arc, arcs)]
        part = laspy.LasData(self.las.header)
        part.points = self.las.points[np.sort(chosen)]
        part.write(path)


def pulse_pairs(cloud):
    """Indices of neighbouring pulses of one arc between which none is missing."""
    first = np.nonzero(cloud.first)[0]
    a, b = first[:-1], first[1:]
    step = cloud.time[b] - cloud.time[a]
    same = cloud.arc[a] == cloud.arc[b]
    short = np.full(len(cloud.arcs), np.inf)
    for arc in np.unique(cloud.arc[a[same]]):
        short[arc] = np.quantile(step[same & (cloud.arc[a] == arc)], 0.1)
    neighbours = same & (step < 1.6 * short[cloud.arc[a]])
    return a[neighbours], b[neighbours]


def circle(cloud):
    """Centre at the mean time, velocity and radius of the moving circle on which the points lie."""
    time = cloud.time - cloud.time.mean()
    origin = cloud.xyz[:, :2].mean(0)
    x, y = (cloud.xyz[:, :2] - origin).T
    columns = np.c_[2 * x, 2 * y, 2 * x * time, 2 * y * time, np.ones_like(x), time, time**2]
    cx, cy, vx, vy, rest = np.linalg.lstsq(columns, x * x + y * y, rcond=None)[0][:5]
    return np.array([cx, cy]) + origin, np.array([vx, vy]), np.sqrt(rest + cx * cx + cy * cy)


def revolutions(cloud, angle):
    """Revolutions per second, and the distance between successive arcs: by the times and places at which they pass a scan angle."""
    times, numbers, places = [], [], []
    for arc in np.unique(cloud.arc):
        of_arc = (cloud.arc == arc) & cloud.first
        a, t, xy = cloud.angle[of_arc], cloud.time[of_arc], cloud.xyz[of_arc, :2]
        if len(a) > 30 and a.min() < angle < a.max():
            line = np.polyfit(a - angle, np.c_[t - t[0], xy - xy[0]], 2)[2]
            times.append(t[0] + line[0])
            places.append(xy[0] + line[1:])
            numbers.append(arc)
    times, numbers, places = np.array(times), np.array(numbers), np.array(places)
    period = np.median(np.diff(times) / np.diff(numbers))
    turns = np.round((times - times[0]) / period)
    return 1 / np.polyfit(turns, times - times[0], 1)[0], np.linalg.norm(np.polyfit(turns, places - places[0], 1)[0])


def figures(cloud, terrain, angle):
    a, b = pulse_pairs(cloud)
    steps = np.linalg.norm(cloud.xyz[b, :2] - cloud.xyz[a, :2], axis=1)
    _, velocity, radius = circle(cloud)
    rate, spacing = revolutions(cloud, angle)
    above = cloud.xyz[:, 2] - terrain(cloud.xyz[:, 0], cloud.xyz[:, 1])
    ground = above[cloud.ground & np.isfinite(above)] * 1000
    first = cloud.returns[cloud.first]
    arcs = np.unique(cloud.arc)
    return {
        "revolutions, 1/s": rate,
        "pulse rate, 1/s": 1 / np.mean(cloud.time[b] - cloud.time[a]),
        "radius of the circle, m": radius,
        "spacing of arcs, m": spacing,
        "spacing of arcs by the moving circle, m": np.linalg.norm(velocity) / rate,
        "spacing along, 10 %, m": np.quantile(steps, 0.1),
        "spacing along, median, m": np.quantile(steps, 0.5),
        "spacing along, 90 %, m": np.quantile(steps, 0.9),
        "pulses with an echo per arc": cloud.first.sum() / len(arcs),
        "single returns, % of pulses": 100 * np.mean(first == 1),
        "double returns, % of pulses": 100 * np.mean(first == 2),
        "triple returns, % of pulses": 100 * np.mean(first == 3),
        "ground over terrain, mean, mm": ground.mean(),
        "ground over terrain, robust spread, mm": 1.4826 * np.median(abs(ground - np.median(ground))),
    }


def terrain_of(cloud, cell=1.5):
    """Heights of the ground: triangles over means of cells."""
    xyz = cloud.xyz[cloud.ground]
    key = np.floor(xyz[:, :2] / cell).astype(np.int64)
    _, inverse = np.unique(key, axis=0, return_inverse=True)
    count = np.bincount(inverse)
    means = np.c_[tuple(np.bincount(inverse, xyz[:, k]) / count for k in range(3))][count >= 2]
    return LinearNDInterpolator(means[:, :2], means[:, 2])


def by_time(real, simulated):
    """Differences of the simulated pulses from the recorded ones at the same times: m across and along, degrees."""
    t = simulated.time[simulated.first]
    order = np.argsort(t)
    t = t[order]
    wanted = real.time[real.first]
    if len(t) < 2 or not len(wanted):
        sys.exit(f"{len(t)} simulated and {len(wanted)} recorded pulses have a first return within the recording")
    after = np.clip(np.searchsorted(t, wanted), 1, len(t) - 1)
    near = np.minimum(abs(t[after] - wanted), abs(t[after - 1] - wanted)) < 2e-6
    if not near.any():
        sys.exit("no simulated pulse within the recording has the time of a recorded one")
    take = lambda values: np.interp(wanted[near], t, values[simulated.first][order])
    here = lambda values: values[real.first][near]
    place = np.c_[
        take(simulated.xyz[:, 0]) - here(real.xyz[:, 0]), take(simulated.xyz[:, 1]) - here(real.xyz[:, 1])
    ]
    angle = take(simulated.angle) - here(real.angle)
    return place, angle, near.mean()


def distance(a, b):
    """Largest distance of two cumulative distributions."""
    values = np.sort(np.r_[a, b])
    return abs(np.searchsorted(np.sort(a), values, "right") / len(a) - np.searchsorted(np.sort(b), values, "right") / len(b)).max()


def draw(path, real, simulated):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    arcs = np.unique(real.arc)
    few = arcs[len(arcs) // 2 : len(arcs) // 2 + 8]
    place, angle, _ = by_time(real, simulated)
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.6))
    for cloud, colour, name in ((real, "black", "recorded"), (simulated, "tab:red", "simulated")):
        some = np.isin(cloud.arc, few)
        axes[0].plot(*cloud.xyz[some, :2].T, ".", ms=2, color=colour, label=name, alpha=0.6)
    centre = real.xyz[np.isin(real.arc, few), :2].mean(0)
    axes[0].set_xlim(centre[0] - 4, centre[0] + 4)
    axes[0].set_ylim(centre[1] - 4, centre[1] + 4)
    axes[0].set_aspect("equal")
    axes[0].ticklabel_format(useOffset=False)
    axes[0].tick_params(labelsize=6)
    axes[0].legend(fontsize=7)
    axes[0].set_title("arcs that were not fitted, m", fontsize=9)
    for column, name in ((0, "east"), (1, "north")):
        axes[1].hist(place[:, column], np.linspace(-0.3, 0.3, 121), histtype="step", label=name)
    axes[1].legend(fontsize=7)
    axes[1].set_title("simulated minus recorded place at the same time, m", fontsize=9)
    axes[2].hist(angle, np.linspace(-0.04, 0.04, 81), histtype="step")
    axes[2].set_title("simulated minus recorded scan angle, deg", fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=90)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--vlscan", default="vlscan")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--seed", type=int, default=1, help="of the choice of arcs")
    args = parser.parse_args()
    program = shutil.which(args.vlscan) or parser.error(f"--vlscan {args.vlscan}: no such program")
    folder = args.folder or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    run = lambda *words: subprocess.run([Path(program).absolute(), *map(str, words)], check=True, cwd=folder, stdout=subprocess.PIPE).stdout

    real = Cloud(args.recording)
    arcs = np.arange(len(real.arcs))
    # At random, since what repeats with a multiple of three arcs would not be seen otherwise.
    starts = arcs[::3]
    fitted = np.minimum(starts + np.random.default_rng(args.seed).integers(0, 3, len(starts)), arcs[-1])
    held = np.setdiff1d(arcs, fitted)
    real.write(folder / "fitted.laz", fitted)
    print(run("fit", "fitted.laz", "-o", "flight.toml", "--force").decode())
    fitted_scanner(folder / "flight.toml", "conic")
    run("scene", "reconstruct", "fitted.laz", "-o", "scene", "--force", "-q")
    with_receiver(folder / "flight.toml", folder / "scene")
    run("run", "flight.toml", "--scene", "scene/scene.xml", "-o", "simulated.laz", "--force", "-q")
    simulated = Cloud(folder / "simulated.laz", real.arcs)
    # To the resolution of the recording. What lies beside it is not compared.
    steps = real.las.header.scales
    simulated.xyz = np.round(simulated.xyz / steps) * steps
    low, high = real.xyz[:, :2].min(0), real.xyz[:, :2].max(0)
    inside = ((simulated.xyz[:, :2] >= low) & (simulated.xyz[:, :2] <= high)).all(1)
    for name in ("time", "xyz", "returns", "number", "ground", "angle", "first", "arc"):
        setattr(simulated, name, getattr(simulated, name)[inside])
    terrain = terrain_of(real.select(fitted))
    angle = np.quantile(real.angle, 0.9)
    halves = [figures(real.select(held[k::2]), terrain, angle) for k in (0, 1)]
    recorded, predicted = (figures(cloud.select(held), terrain, angle) for cloud in (real, simulated))
    print(f"{'quantity':42} {'recorded':>14} {'simulated':>14} {'chance':>12}")
    for name, value in recorded.items():
        print(f"{name:42} {value:14.4f} {predicted[name]:14.4f} {abs(halves[0][name] - halves[1][name]):12.4f}")
    place, angles, share = by_time(real.select(held), simulated.select(held))
    rms = lambda values: np.sqrt(np.mean(values**2))
    print(f"place at the same time, rms: {rms(place[:, 0]):.3f} m east, {rms(place[:, 1]):.3f} m north; of {100 * share:.1f} % of the pulses")
    print(f"scan angle at the same time: mean {angles.mean():.4f}, rms {rms(angles):.4f} deg")
    over = lambda cloud: (lambda d: d[np.isfinite(d)])(
        cloud.xyz[cloud.ground, 2] - terrain(cloud.xyz[cloud.ground, 0], cloud.xyz[cloud.ground, 1])
    )
    heights = distance(over(real.select(held)), over(simulated.select(held)))
    chance = distance(over(real.select(held[::2])), over(real.select(held[1::2])))
    print(f"largest distance of the distributions of ground over terrain: {heights:.3f}, by chance {chance:.3f}")
    (folder / "figures.json").write_text(json.dumps({"recorded": recorded, "simulated": predicted, "halves": halves}, indent=1))
    if args.picture:
        draw(args.picture, real.select(held), simulated.select(held))


if __name__ == "__main__":
    run_script(main)
