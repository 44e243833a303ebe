"""Holds fitted lines of an instrument with two channels against the lines that were not used to fit them.

    python channels.py TILE.laz [--flight-line N] [--vlscan PROGRAM] [--folder FOLDER]

Half of the lines of one flight line, one of every two neighbours at random, goes to `vlscan fit` and `vlscan scene reconstruct`; the fitted
flight is flown over the reconstructed scene, and its points are compared with the other lines. Each line is of the channel that looks ahead
or of the one that looks back: a small place sees them one after the other. Chance is the same comparison of the two halves of the lines
that were not used. Needs what flight_line.py needs.
"""

import argparse
import json
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from flight_line import Cloud, by_time, distance, pulse_pairs, terrain_of
from recordings import fitted_scanner, read_cloud, run_script, with_receiver

FIELDS = ("time", "xyz", "returns", "number", "ground", "angle", "first", "arc")
STEP = 0.006  # of scan angles in LAS 1.4, degrees


def line_directions(cloud):
    """Of each line the direction in which it lies, radians from east (without its sense), and the time of its middle."""
    found = {}
    for arc in np.unique(cloud.arc):
        of_line = (cloud.arc == arc) & cloud.first
        if of_line.sum() < 20:
            continue
        xy, time = cloud.xyz[of_line, :2], cloud.time[of_line]
        vx, vy = np.polyfit(time - time.mean(), xy - xy.mean(0), 1)[0]
        found[arc] = np.arctan2(vy, vx) % np.pi, time.mean()
    return found


def channels(cloud):
    """The lines of either channel, by the two directions of lines."""
    directions = line_directions(cloud)
    arcs = np.array(list(directions))
    turn = np.array([directions[arc][0] for arc in arcs])
    # The middle of the widest gap between directions, on the circle of half turns.
    order = np.sort(turn)
    gaps = np.diff(np.r_[order, order[0] + np.pi])
    first = order[(np.argmax(gaps) + 1) % len(order)]
    turn = (turn - first) % np.pi
    is_second = turn > (turn.min() + turn.max()) / 2
    return arcs[~is_second], arcs[is_second]


def places(cloud, arcs, along):
    """Times and distances across the lines at which lines pass the middle of the tile, for lines in the direction `along`."""
    middle = np.median(cloud.xyz[:, :2], axis=0)
    times, across = [], []
    for arc in arcs:
        of_line = (cloud.arc == arc) & cloud.first
        way = (cloud.xyz[of_line, :2] - middle) @ along
        if of_line.sum() < 20 or not way.min() < 0 < way.max():
            continue
        side = (cloud.xyz[of_line, :2] - middle) @ np.array([-along[1], along[0]])
        time = cloud.time[of_line]
        times.append(np.polyfit(way, time - time[0], 1)[1] + time[0])
        across.append(np.polyfit(way, side, 1)[1])
    return np.array(times), np.array(across)


def figures(cloud, terrain, of_channels, alongs):
    a, b = pulse_pairs(cloud)
    steps = np.linalg.norm(cloud.xyz[b, :2] - cloud.xyz[a, :2], axis=1)
    on_ground = steps[cloud.ground[a] & cloud.ground[b]]
    above = cloud.xyz[:, 2] - terrain(cloud.xyz[:, 0], cloud.xyz[:, 1])
    ground = above[cloud.ground & np.isfinite(above)] * 1000
    first = cloud.returns[cloud.first]
    rows = {}
    for number, (arcs, along) in enumerate(zip(of_channels, alongs), 1):
        times, across = places(cloud, np.intersect1d(arcs, np.unique(cloud.arc)), along)
        # Lines are left out: periods are counted.
        period = np.min(np.diff(times)[np.diff(times) > 1e-3])
        turns = np.round((times - times[0]) / period)
        for _ in range(3):
            period = np.polyfit(turns, times - times[0], 1)[0]
            turns = np.round((times - times[0]) / period)
        rows[f"lines of channel {number}, 1/s"] = 1 / period
        rows[f"spacing of lines of channel {number}, m"] = abs(np.polyfit(turns, across - across[0], 1)[0])
    return rows | {
        "pulse rate, 1/s": 1 / np.mean(cloud.time[b] - cloud.time[a]),
        "spacing along on ground, 10 %, m": np.quantile(on_ground, 0.1),
        "spacing along on ground, mean, m": on_ground.mean(),
        "spacing along on ground, 90 %, m": np.quantile(on_ground, 0.9),
        "spacing along, 10 %, m": np.quantile(steps, 0.1),
        "spacing along, mean, m": steps.mean(),
        "spacing along, 90 %, m": np.quantile(steps, 0.9),
        "pulses with an echo per line": cloud.first.sum() / len(np.unique(cloud.arc)),
        "single returns, % of pulses": 100 * np.mean(first == 1),
        "double returns, % of pulses": 100 * np.mean(first == 2),
        "triple returns, % of pulses": 100 * np.mean(first == 3),
        "ground over terrain, mean, mm": np.clip(ground, -500, 500).mean(),
        "ground over terrain, robust spread, mm": 1.4826 * np.median(abs(ground - np.median(ground))),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tile", type=Path)
    parser.add_argument("--flight-line", type=int)
    parser.add_argument("--vlscan", default="vlscan")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--seed", type=int, default=1, help="of the choice of lines")
    args = parser.parse_args()
    program = shutil.which(args.vlscan) or parser.error(f"--vlscan {args.vlscan}: no such program")
    folder = args.folder or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    run = lambda *words: subprocess.run([Path(program).absolute(), *map(str, words)], check=True, cwd=folder, stdout=subprocess.PIPE).stdout

    las = read_cloud(args.tile)
    source = np.asarray(las.point_source_id)
    line = args.flight_line or np.bincount(source).argmax()
    las.points = las.points[source == line].copy()
    las.write(folder / "line.laz")
    real = Cloud(folder / "line.laz")
    arcs = np.arange(len(real.arcs))
    coin = np.random.default_rng(args.seed).integers(0, 2, len(arcs) // 2 + 1)
    is_fitted = arcs % 2 == coin[arcs // 2]
    held = arcs[~is_fitted]
    real.write(folder / "fitted.laz", arcs[is_fitted])
    print(run("fit", "fitted.laz", "-o", "flight.toml", "--force").decode())
    fitted_scanner(folder / "flight.toml", "rotating", 2)
    run("scene", "reconstruct", "fitted.laz", "-o", "scene", "--force", "-q")
    with_receiver(folder / "flight.toml", folder / "scene")
    run("run", "flight.toml", "--scene", "scene/scene.xml", "-o", "simulated.laz", "--force", "-q")
    simulated = Cloud(folder / "simulated.laz", real.arcs)
    steps = real.las.header.scales
    simulated.xyz = np.round(simulated.xyz / steps) * steps
    low, high = real.xyz[:, :2].min(0), real.xyz[:, :2].max(0)
    # Beside the tile, and between the lines of the recording: what passes the tile while the other channel's line is recorded.
    inside = ((simulated.xyz[:, :2] >= low) & (simulated.xyz[:, :2] <= high)).all(1)
    inside &= abs(simulated.time - real.arcs[simulated.arc]) < 1e-3
    for name in FIELDS:
        setattr(simulated, name, getattr(simulated, name)[inside])
    of_channels = channels(real)
    directions = line_directions(real)
    alongs = []
    for lines in of_channels:
        turns = np.array([directions[arc][0] for arc in lines])
        mean = np.angle(np.mean(np.exp(2j * turns))) / 2
        alongs.append(np.array([np.cos(mean), np.sin(mean)]))
    terrain = terrain_of(real.select(arcs[is_fitted]))
    halves = [figures(real.select(held[k::2]), terrain, of_channels, alongs) for k in (0, 1)]
    recorded, predicted = (figures(cloud.select(held), terrain, of_channels, alongs) for cloud in (real, simulated))
    print(f"flight line {line}: {is_fitted.sum()} lines fitted, {len(held)} compared, of channels {[len(c) for c in of_channels]}")
    print(f"{'quantity':42} {'recorded':>14} {'simulated':>14} {'chance':>12}")
    for name, value in recorded.items():
        print(f"{name:42} {value:14.4f} {predicted[name]:14.4f} {abs(halves[0][name] - halves[1][name]):12.4f}")
    place, angles, share = by_time(real.select(held), simulated.select(held))
    rms = lambda values: np.sqrt(np.mean(values**2))
    print(f"place at the same time, rms: {rms(place[:, 0]):.3f} m east, {rms(place[:, 1]):.3f} m north; of {100 * share:.1f} % of the pulses")
    # Angles in the recording are whole degrees: the difference is that of an even distribution if they agree.
    print(f"scan angle at the same time: mean {angles.mean():.4f}, rms {rms(angles):.4f} deg; rounding alone {1 / 12**0.5:.4f}")
    over = lambda cloud: (lambda d: d[np.isfinite(d)])(
        cloud.xyz[cloud.ground, 2] - terrain(cloud.xyz[cloud.ground, 0], cloud.xyz[cloud.ground, 1])
    )
    heights = distance(over(real.select(held)), over(simulated.select(held)))
    chance = distance(over(real.select(held[::2])), over(real.select(held[1::2])))
    print(f"largest distance of the distributions of ground over terrain: {heights:.3f}, by chance {chance:.3f}")
    (folder / "figures.json").write_text(json.dumps({"recorded": recorded, "simulated": predicted, "halves": halves}, indent=1))


if __name__ == "__main__":
    run_script(main)
