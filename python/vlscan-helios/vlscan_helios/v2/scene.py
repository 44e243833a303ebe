"""Scenes of simulations by the names of version 2."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from vlscan_helios.v3 import ScenePart, StaticScene

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
        self.min, self.max = Vector(np.asarray(lowest, float).tolist()), Vector(np.asarray(highest, float).tolist())

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


class PartView:
    """A part of a scene.

    Parameters
    ----------
    part : vlscan_helios.v3.ScenePart
        The part.
    """

    def __init__(self, part: ScenePart) -> None:
        self._part = part

    @property
    def id(self) -> str:
        """Id in its file."""
        return self._part.id

    def getId(self) -> str:
        """Return the id in its file."""
        return self.id

    @property
    def materials(self) -> list[Any]:
        """Materials, as :class:`vlscan_helios.v3.scene.Material`."""
        return list(self._part.materials.values())

    @property
    def bbox(self) -> Box:
        """The box around the part."""
        return Box(*self._part.bbox.bounds)

    def __repr__(self) -> str:
        return f"<PartView {self.id!r}>"


class SceneView:
    """A scene, which is loaded by the first call that needs it.

    Parameters
    ----------
    scene : vlscan_helios.v3.StaticScene
        The scene.
    """

    def __init__(self, scene: StaticScene) -> None:
        self._scene = scene

    @property
    def bbox(self) -> Box:
        """The box around all parts."""
        return Box(*self._scene.bbox.bounds)

    def getBBox(self) -> Box:
        """Return the box around all parts."""
        return self.bbox

    def getAABB(self) -> Box:
        """Return the box around all parts."""
        return self.bbox

    @property
    def numPrimitives(self) -> int:
        """Number of triangles and voxels."""
        return self._scene.engine().primitives

    def getNumPrimitives(self) -> int:
        """Return the number of triangles and voxels."""
        return self.numPrimitives

    @property
    def sceneParts(self) -> Sequence[PartView]:
        """The parts."""
        return [PartView(part) for part in self._scene.scene_parts]

    def getSceneParts(self) -> Sequence[PartView]:
        """Return the parts."""
        return self.sceneParts

    def getNumSceneParts(self) -> int:
        """Return the number of parts."""
        return len(self._scene.scene_parts)

    def getGroundPointAt(self, *point: Any) -> Vector:
        """Return the point of the ground below or above a point: three numbers, or a sequence of them, m."""
        x, y, _ = point[0] if len(point) == 1 else point
        height = self._scene.engine().ground_height(x, y)
        if height is None:
            raise ValueError(f"the scene has no ground at x = {x:g}, y = {y:g}; a part is ground if a material has helios_isGround")
        return Vector((float(x), float(y), height))

    def __getattr__(self, name: str) -> NoReturn:
        known = [key for key in dir(type(self)) if not key.startswith("_")]
        raise AttributeError(f"a scene has no {name!r}; it has {', '.join(known)}")
