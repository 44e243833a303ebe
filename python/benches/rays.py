"""First hits of a million rays: `Scene.cast` and trimesh with embreex, by turns on the same mesh.

python python/benches/rays.py [TURNS]

Needs trimesh and embreex. Prints rays per second of each turn, the ratio of the medians, and how many distances agree.
"""

import statistics
import sys
import time

import numpy as np
import trimesh

import vlscan

RAYS, SIDE = 1_000_000, 500


def terrain() -> trimesh.Trimesh:
    """Half a million triangles over a square of 100 m."""
    x, y = np.meshgrid(np.linspace(-50, 50, SIDE + 1), np.linspace(-50, 50, SIDE + 1))
    z = 3 * np.sin(x / 5) * np.cos(y / 7) + np.sin(3 * x) * np.cos(2.5 * y) / 4
    corner = (np.arange(SIDE)[:, None] * (SIDE + 1) + np.arange(SIDE)).ravel()
    faces = np.vstack([corner + np.array([[0], [1], [SIDE + 2]]), corner + np.array([[0], [SIDE + 2], [SIDE + 1]])])
    faces = np.concatenate([faces[:3].T, faces[3:].T])
    return trimesh.Trimesh(np.column_stack([x.ravel(), y.ravel(), z.ravel()]), faces, process=False)


def rays() -> tuple[np.ndarray, np.ndarray]:
    """Rays of a scanner 20 m above the middle, in the order in which it sends them."""
    angle = np.linspace(0, 2 * np.pi * 1000, RAYS)
    tilt = np.radians(np.linspace(5, 70, RAYS))
    directions = np.column_stack([np.cos(angle) * np.sin(tilt), np.sin(angle) * np.sin(tilt), -np.cos(tilt)])
    return np.broadcast_to([0.0, 0.0, 20.0], (RAYS, 3)).copy(), directions


def timed(function, *arguments):
    """Return the result of a function and how long it took, s."""
    begin = time.perf_counter()
    return function(*arguments), time.perf_counter() - begin


def main() -> None:
    """Compare both, by turns."""
    mesh, (origins, directions) = terrain(), rays()
    scene = vlscan.Scene(vlscan.Part.of(mesh)).load()
    other = trimesh.ray.ray_pyembree.RayMeshIntersector(mesh, scale_to_box=False)
    scene.cast(origins[:1000], directions[:1000])
    other.intersects_first(origins[:1000], directions[:1000])
    own, theirs, places = [], [], []
    for _ in range(int(sys.argv[1]) if len(sys.argv) > 1 else 7):
        hits, seconds = timed(scene.cast, origins, directions)
        own.append(RAYS / seconds)
        first, seconds = timed(other.intersects_first, origins, directions)
        theirs.append(RAYS / seconds)
        (found, index, _), seconds = timed(lambda: other.intersects_location(origins, directions, multiple_hits=False))
        places.append(RAYS / seconds)
        print(f"vlscan {own[-1] / 1e6:.2f} M/s, embreex: faces {theirs[-1] / 1e6:.2f} M/s, places {places[-1] / 1e6:.2f} M/s")
    ratios = [statistics.median(own) / statistics.median(rates) for rates in (theirs, places)]
    print(f"vlscan is {ratios[0]:.2f} times as fast as faces alone, {ratios[1]:.2f} times as fast as places")
    distance = np.full(RAYS, np.nan)
    distance[index] = np.linalg.norm(found - origins[index], axis=1)
    same, near = (first == hits.primitive).mean(), np.isclose(distance, hits.distance, atol=1e-3, equal_nan=True).mean()
    print(f"{same:.2%} of the faces and {near:.2%} of the distances are the same")


if __name__ == "__main__":
    main()
