#!/usr/bin/env python3
"""Predict one half of the pulses of a recording from a scene that is reconstructed from the other half.

    python town.py TILE.laz [FOLDER] [--vlscan PROGRAM] [--picture FILE.png]

The pulses (points of one time and source) are divided at random. `vlscan scene reconstruct` makes a scene of one half; the beams of the
other half go through it by `vlscan trace`, in the refined physics and in that of HELIOS++, both with the fitted threshold. Compared are the pulses whose beams stay
within the tile from the highest to the lowest point. Chance is the same comparison of the two recorded halves, and of two quarters of the
half that was not used. Writes FOLDER/figures.json and prints a table. Needs laspy (with lazrs), numpy, scipy, and matplotlib for pictures.
"""
import argparse
import csv
import json
import subprocess
import tomllib
from pathlib import Path

import laspy
import numpy as np
from recordings import check_pulses, read_cloud, run_script
from scipy.spatial import cKDTree

GROUND, NOISE = (2, 8, 9, 10, 11), (7, 18)
ROOFS = (6, 17)
CELL = 10.0


class Cloud:
    """Points with the pulse that each belongs to."""

    def __init__(self, xyz, cls, number, of, pulse):
        self.xyz, self.cls, self.number, self.of, self.pulse = xyz, cls, number, of, pulse

    def take(self, keep):
        return Cloud(self.xyz[keep], self.cls[keep], self.number[keep], self.of[keep], self.pulse[keep])


def read(path):
    las = read_cloud(path)
    las.points = las.points[~np.isin(np.asarray(las.classification), NOISE)]
    key = np.stack([np.asarray(las.point_source_id, float), np.asarray(las.gps_time)], 1)
    _, pulse = np.unique(key, axis=0, return_inverse=True)
    check_pulses(path, las, pulse.ravel())
    cloud = Cloud(np.asarray(las.xyz), np.asarray(las.classification), np.asarray(las.return_number),
                  np.asarray(las.number_of_returns), pulse.ravel())
    return las, cloud


def beams(las, cloud, pulses, folder):
    """Origin and direction of pulses: from the path of the instrument through the last known return."""
    with open(folder / "trajectory.csv") as file:
        rows = [(int(r["line"]), float(r["time[s]"]), float(r["x"]), float(r["y"]), float(r["z"])) for r in csv.DictReader(file)]
    paths = {}
    for line, *row in sorted(rows):
        paths.setdefault(line, []).append(row)
    order = np.lexsort((cloud.number, cloud.pulse))
    last = np.r_[np.flatnonzero(np.diff(cloud.pulse[order])), len(order) - 1]
    at = order[last][pulses]
    time, source = np.asarray(las.gps_time)[at], np.asarray(las.point_source_id)[at].astype(int)
    origin = np.empty((len(at), 3))
    for line, path in paths.items():
        path = np.array(path)
        # two rows for each pass over the place
        passes = path.reshape(-1, 2, 4)
        which = source == line
        middle = passes[:, :, 0].mean(1)
        nearest = np.abs(time[which][:, None] - middle).argmin(1)
        a, b = passes[nearest, 0], passes[nearest, 1]
        share = (time[which] - a[:, 0]) / np.maximum(b[:, 0] - a[:, 0], 1e-9)
        origin[which] = a[:, 1:] + (b - a)[:, 1:] * share[:, None]
    target = cloud.xyz[at]
    direction = target - origin
    return time, origin, direction / np.linalg.norm(direction, axis=1, keepdims=True), target


def with_threshold(text, watts):
    """The scanner with a threshold in W in place of the target that just reaches it, which HELIOS++'s physics does not have."""
    return "\n".join(f"received_energy_min_w = {watts:.6e}" if line.startswith("max_range") else line for line in text.split("\n"))


def threshold_w(program, folder, text, physics):
    """The threshold that the same target just reaches in HELIOS++'s physics, W: by bisection, with a wall in place of the scene."""
    target = tomllib.loads(next(line for line in text.split("\n") if line.startswith("max_range")))["max_range"]
    # beside the scene, whose files of pulse and path the scanner names
    wall = folder / "scene"
    way, edge = target["range_m"], target["range_m"] / 10
    (wall / "wall.mtl").write_text(f"newmtl wall\nhelios_reflectance {target['reflectance']}\n")
    (wall / "wall.obj").write_text("mtllib wall.mtl\nusemtl wall\n" + "".join(f"v {x} {way} {z}\n" for x, z in
                                   ((-edge, -edge), (edge, -edge), (edge, edge), (-edge, edge))) + "f 1 2 3 4\n")
    (wall / "wall_pulses.csv").write_text("time,x,y,z,dx,dy,dz\n0,0,0,0,0,1,0\n")
    keys = [line for line in text.split("\n") if not line.startswith(("scene", "assets"))]

    def is_seen(watts):
        (wall / "wall.toml").write_text('scene = "wall.obj"\n' + with_threshold("\n".join(keys), watts))
        command = [program, "trace", "--scanner", str(wall / "wall.toml"), str(wall / "wall_pulses.csv"), "-q", "--force", "-o", str(wall / "wall.csv"), *physics]
        subprocess.run(command, check=True, capture_output=True)
        return len((wall / "wall.csv").read_text().splitlines()) > 1

    low, high = -15.0, 3.0
    while high - low > 0.005:
        middle = (low + high) / 2
        low, high = (middle, high) if is_seen(10**middle) else (low, middle)
    return 10**low


def trace(program, folder, name, pulses, beams_of, physics):
    time, origin, direction, _ = beams_of
    with open(folder / "pulses.csv", "w") as file:
        file.write("time,x,y,z,dx,dy,dz\n")
        np.savetxt(file, np.c_[np.arange(len(time)) * 1e-4, origin, direction], "%.9f", ",")
    out, scanner = folder / f"{name}.csv", folder / "scene" / f"{name}.toml"
    text = (folder / "scene/scene.toml").read_text()
    if "helios" in physics:
        text = with_threshold(text, threshold_w(program, folder, text, physics))
    scanner.write_text(text)
    command = [program, "trace", "--scanner", str(scanner), str(folder / "pulses.csv"), "-q", "--force", "-o", str(out),
               "--columns", "X,Y,Z,Classification,ReturnNumber,NumberOfReturns,GpsTime", *physics]
    subprocess.run(command, check=True)
    rows = np.loadtxt(out, delimiter=",", skiprows=1, ndmin=2)
    pulse = np.round(rows[:, 6] * 1e4).astype(int)
    return Cloud(rows[:, :3], rows[:, 3].astype(int), rows[:, 4].astype(int), rows[:, 5].astype(int), pulses[pulse])


def interior(beams_of, low, high, mins, maxs):
    """Pulses whose beams stay within the tile between the lowest and the highest point."""
    _, _, direction, target = beams_of
    inside = np.ones(len(target), bool)
    for z in (low, high):
        at = target + direction * ((z - target[:, 2]) / direction[:, 2])[:, None]
        inside &= ((at[:, :2] > mins + 1) & (at[:, :2] < maxs - 1)).all(1)
    return inside


def distance(a, b):
    """Largest distance of two cumulative distributions (Kolmogorov and Smirnov)."""
    if not len(a) or not len(b):
        return float("nan")
    a, b = np.sort(a), np.sort(b)
    x = np.r_[a, b]
    return float(np.abs(np.searchsorted(a, x, "right") / len(a) - np.searchsorted(b, x, "right") / len(b)).max())


def spread(x):
    return float(1.4826 * np.median(np.abs(x - np.median(x)))) if len(x) else float("nan")


def figures(cloud, terrain, pulses_per_area):
    first = cloud.number == 1
    order = np.lexsort((cloud.number, cloud.pulse))
    last = np.zeros(len(order), bool)
    last[order[np.r_[np.flatnonzero(np.diff(cloud.pulse[order])), len(order) - 1]]] = True
    known = first & (cloud.of >= 1)
    of = cloud.of[known]
    out = {f"share {name}": float((of == n).mean()) for n, name in ((1, "single"), (2, "double"), (3, "triple"))}
    out["share four and more"] = float((of > 3).mean())
    out["returns per pulse"] = float(of.mean())
    out["ground points"] = float(np.isin(cloud.cls, GROUND).mean())
    out["building points"] = float(np.isin(cloud.cls, ROOFS).mean())
    out["points per m2"] = len(cloud.cls) / pulses_per_area
    ground = np.isin(cloud.cls, (2,))
    residual = cloud.xyz[:, 2] - terrain(cloud.xyz[:, 0], cloud.xyz[:, 1])
    out["ground bias, m"] = float(np.median(residual[ground]))
    out["ground mean, m"] = float(np.mean(np.clip(residual[ground], -0.5, 0.5)))
    out["ground spread, m"] = spread(residual[ground])
    out["_first"], out["_last"], out["_height"] = cloud.xyz[first, 2], cloud.xyz[last, 2], residual
    cell = {}
    index = np.floor(cloud.xyz[first, :2] / CELL).astype(int)
    for key, h in zip(map(tuple, index), residual[first]):
        cell.setdefault(key, []).append(h)
    out["_tops"] = {k: float(np.quantile(v, 0.95)) for k, v in cell.items() if len(v) >= 20}
    return out


def compare(real, other):
    tops = [(other["_tops"][k] - v) for k, v in real["_tops"].items() if k in other["_tops"] and v > 2.0]
    return {
        "tree tops bias, m": float(np.mean(tops)) if tops else float("nan"),
        "tree tops spread, m": float(np.std(tops)) if tops else float("nan"),
        "first heights, distance": distance(real["_first"], other["_first"]),
        "last heights, distance": distance(real["_last"], other["_last"]),
        "heights over terrain, distance": distance(real["_height"], other["_height"]),
        "first heights, quantiles 25 50 75 95, m": [float(v) for v in np.quantile(other["_first"], [.25, .5, .75, .95]) - np.quantile(real["_first"], [.25, .5, .75, .95])],
        "last heights, quantiles 25 50 75 95, m": [float(v) for v in np.quantile(other["_last"], [.25, .5, .75, .95]) - np.quantile(real["_last"], [.25, .5, .75, .95])],
    }


def terrain_of(points):
    """Heights of the plane through the twelve nearest points of the ground: the same terrain for all clouds that are compared."""
    tree = cKDTree(points[:, :2])

    def height(x, y):
        _, near = tree.query(np.c_[x, y], k=min(12, len(points)))
        p = points[near]
        d = p[:, :, :2] - np.c_[x, y][:, None]
        a = np.concatenate([np.ones((*d.shape[:2], 1)), d], 2)
        square = (d ** 2).sum(2)
        w = (1 - square / (1.2 * square.max(1, keepdims=True) + 1e-12)) ** 2
        n = np.einsum("nik,ni,nil->nkl", a, w, a) + 1e-6 * np.eye(3)
        z0 = p[:, :1, 2]
        r = np.einsum("nik,ni,ni->nk", a, w, p[:, :, 2] - z0)
        return z0[:, 0] + np.linalg.solve(n, r[..., None])[:, 0, 0]

    return height


def picture(path, real, sim, title):
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    middle = np.median(real.xyz[:, 1])
    # the strip with most points above the ground
    candidates = np.arange(real.xyz[:, 1].min() + 2, real.xyz[:, 1].max() - 2, 2.0)
    count = [((np.abs(real.xyz[:, 1] - y) < 1.5) & ~np.isin(real.cls, GROUND)).sum() for y in candidates]
    middle = candidates[int(np.argmax(count))]
    fig, axes = plt.subplots(2, 1, figsize=(8, 5), sharex=True, sharey=True)
    colours = {2: "#a6761d", 6: "#d95f02", 9: "#1f78b4", 1: "#777777", 3: "#b2df8a", 4: "#66a61e", 5: "#1b7837"}
    for axis, cloud, name in zip(axes, (real, sim), ("recorded", "simulated")):
        c = cloud.take(np.abs(cloud.xyz[:, 1] - middle) < 1.5)
        axis.scatter(c.xyz[:, 0] - real.xyz[:, 0].min(), c.xyz[:, 2], s=1.2, c=[colours.get(k, "#000000") for k in c.cls], linewidths=0)
        axis.set_title(f"{title}, {name}", fontsize=9)
        axis.set_ylabel("height, m")
        axis.set_aspect("equal")
    axes[1].set_xlabel("x, m")
    fig.tight_layout()
    fig.savefig(path, dpi=90)


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("tile", type=Path)
    arguments.add_argument("folder", type=Path, nargs="?", default=Path("town"))
    arguments.add_argument("--vlscan", default="vlscan")
    arguments.add_argument("--picture", type=Path)
    arguments.add_argument("--voxel", help="edge of the voxels of foliage, m")
    arguments.add_argument("--refined-only", action="store_true", help="leave the physics of HELIOS++ out")
    arguments.add_argument("--seed", type=int, default=1)
    given = arguments.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    las, cloud = read(given.tile)
    count = cloud.pulse.max() + 1
    fitted = np.random.default_rng(given.seed).random(count) < 0.5
    half = laspy.LasData(las.header)
    half.points = las.points[fitted[cloud.pulse]].copy()
    half.write(given.folder / "fitted.laz")
    subprocess.run([given.vlscan, "scene", "reconstruct", str(given.folder / "fitted.laz"), "-o", str(given.folder / "scene"), "--force", *(["--voxel", given.voxel] if given.voxel else [])], check=True)
    held = np.flatnonzero(~fitted)
    of_held = beams(las, cloud, held, given.folder / "scene")
    mins, maxs = cloud.xyz[:, :2].min(0), cloud.xyz[:, :2].max(0)
    inside = interior(of_held, cloud.xyz[:, 2].min(), cloud.xyz[:, 2].max(), mins, maxs)
    held, of_held = held[inside], tuple(v[inside] for v in of_held)
    all_fitted = np.flatnonzero(fitted)
    of_fitted = beams(las, cloud, all_fitted, given.folder / "scene")
    all_fitted = all_fitted[interior(of_fitted, cloud.xyz[:, 2].min(), cloud.xyz[:, 2].max(), mins, maxs)]
    area = float(np.prod(maxs - mins - 2))
    ground = cloud.take(fitted[cloud.pulse] & (cloud.cls == 2))
    terrain = terrain_of(ground.xyz)
    real = cloud.take(np.isin(cloud.pulse, held))
    other = cloud.take(np.isin(cloud.pulse, all_fitted))
    only_first = real.number.max() == 1
    simulated = {}
    for name, physics in (("refined", []), ("helios", ["--physics", "helios"]))[:1 if given.refined_only else 2]:
        found = trace(given.vlscan, given.folder, name, held, of_held, physics)
        simulated[name] = found.take(found.number == 1) if only_first else found
    of_real = figures(real, terrain, area)
    # the points through which the terrain goes are no test of it: chance in heights is by two quarters of the half that was not used
    quarter = np.random.default_rng(given.seed + 1).random(count) < 0.5
    quarters = [figures(real.take(q[real.pulse]), terrain, area / 2) for q in (quarter, ~quarter)]
    columns = {"recorded": of_real, "other half": figures(other, terrain, area * len(all_fitted) / len(held)),
               **{k: figures(v, terrain, area) for k, v in simulated.items()}}
    versus = {"chance": compare(*quarters), **{k: compare(of_real, columns[k]) for k in simulated}}
    result = {"figures": {k: {n: v for n, v in f.items() if n[0] != "_"} for k, f in columns.items()},
              "chance in figures": {n: abs(quarters[0][n] - quarters[1][n]) / 2 for n in quarters[0] if n[0] != "_"},
              "comparison": versus, "pulses": len(held),
              "lost pulses": {k: 1 - len(np.unique(v.pulse)) / len(held) for k, v in simulated.items()}}
    (given.folder / "figures.json").write_text(json.dumps(result, indent=1))
    names = [n for n in of_real if n[0] != "_"]
    heading = "".join(f"{k:>10}" for k in ("recorded", *simulated, "chance"))
    print(f"{given.tile.name}: {len(held)} pulses\n{'':34}{heading}")
    for n in names:
        row = [of_real[n], *(columns[k][n] for k in simulated), result["chance in figures"][n]]
        print(f"{n:34}" + "".join(f"{v:10.4f}" for v in row))
    # of a number that is small of all pulses, the error of its own
    for n in (name for name in ("share double", "share triple") if of_real[name] > 0):
        off = "".join(f"{columns[k][n] / of_real[n] - 1:+10.0%}" for k in simulated)
        print(f"{n + ', off by':34}{'':10}{off}{result['chance in figures'][n] / of_real[n]:10.0%}")
    for n, v in versus["chance"].items():
        show = lambda v: "  ".join(f"{x:+.2f}" for x in v) if isinstance(v, list) else f"{v:.4f}"
        print(f"{n:42}  " + "   ".join(f"{k} {show(versus[k][n])}" for k in (*simulated, "chance")))
    print("lost pulses", result["lost pulses"])
    if given.picture:
        picture(given.picture, real, simulated["refined"], given.tile.stem)


if __name__ == "__main__":
    run_script(main)
