"""Triangles and voxels of scenes by the names of version 2."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vlscan import SceneGeometry

from .output import Vector


class Box:
    """A box, m.

    Parameters
    ----------
    lowest, highest : array_like
        Two corners.
    """

    def __init__(self, lowest: ArrayLike, highest: ArrayLike) -> None:
        #: The corners.
        self.min: Vector = Vector(np.asarray(lowest, float).tolist())
        self.max: Vector = Vector(np.asarray(highest, float).tolist())

    @property
    def bounds(self) -> tuple[Vector, Vector]:
        """Lowest and highest corner."""
        return self.min, self.max

    @property
    def centroid(self) -> Vector:
        """The middle."""
        return Vector((a + b) / 2 for a, b in zip(self.min, self.max, strict=True))

    def getMin(self) -> Vector:
        """Return the lowest corner."""
        return self.min

    def getMax(self) -> Vector:
        """Return the highest corner."""
        return self.max

    def getCentroid(self) -> Vector:
        """Return the middle."""
        return self.centroid

    def __repr__(self) -> str:
        return f"<Box {tuple(self.min)} to {tuple(self.max)}>"


class Vertex:
    """A corner of a triangle, world frame.

    Parameters
    ----------
    position : Vector
        The place, m.
    """

    def __init__(self, position: Vector) -> None:
        #: The place, m.
        self.position = position

    def getPosition(self) -> Vector:
        """Return the place, m."""
        return self.position

    def __repr__(self) -> str:
        return f"<Vertex at {tuple(self.position)}>"


class Primitive:
    """A triangle or a voxel, world frame.

    Parameters
    ----------
    geometry : vlscan.SceneGeometry
        The scene.
    index : int
        Number of the primitive, from 0.
    """

    def __init__(self, geometry: SceneGeometry, index: int) -> None:
        self._geometry, self._index = geometry, index

    def isTriangle(self) -> bool:
        """Return whether it is a triangle."""
        return self._index < len(self._geometry.triangles)

    def isVoxel(self) -> bool:
        """Return whether it is a voxel."""
        return not self.isTriangle()

    @property
    def _corners(self) -> NDArray[np.float64]:
        """Corners of a triangle, two opposite ones of a voxel."""
        geometry = self._geometry
        if self.isTriangle():
            corners: NDArray[np.float64] = geometry.vertices[geometry.triangles[self._index]]
            return corners
        voxel = self._index - len(geometry.triangles)
        half = geometry.voxel_edges[voxel] / 2
        return np.stack([geometry.voxel_centres[voxel] - half, geometry.voxel_centres[voxel] + half])

    def getNumVertices(self) -> int:
        """Return the number of vertices: three of a triangle, the lowest and the highest of a voxel."""
        return len(self._corners)

    def getVertex(self, index: int) -> Vertex:
        """Return a vertex, from 0."""
        corners = self._corners
        if not 0 <= index < len(corners):
            raise IndexError(f"index of a vertex is {index}, and there are {len(corners)} vertices")
        return Vertex(Vector(corners[index].tolist()))

    @property
    def centroid(self) -> Vector:
        """The mean of the vertices, m."""
        return Vector(self._corners.mean(axis=0).tolist())

    def getCentroid(self) -> Vector:
        """Return the mean of the vertices, m."""
        return self.centroid

    def getAABB(self) -> Box:
        """Return the box around it."""
        corners = self._corners
        return Box(corners.min(axis=0), corners.max(axis=0))

    def __getattr__(self, name: str) -> NoReturn:
        known = [key for key in dir(type(self)) if not key.startswith("_")]
        raise AttributeError(f"a primitive has no {name!r}; it has {', '.join(known)}")

    def __repr__(self) -> str:
        kind = "triangle" if self.isTriangle() else "voxel"
        return f"<Primitive {self._index}: {kind}>"
