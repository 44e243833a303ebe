"""Scenes of simulations by the names of version 2."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn

from vlscan import Scene, SceneGeometry
from vlscan_helios.v3 import ScenePart, StaticScene

from .output import Vector
from .primitives import Box, Primitive


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
        # The primitives, and the scene that has them.
        self._read: tuple[Scene, SceneGeometry] | None = None

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

    def getPrimitive(self, index: int) -> Primitive:
        """Return a triangle or voxel, from 0: triangles in the order of the parts, then voxels."""
        engine = self._scene.engine()
        if self._read is None or self._read[0] is not engine:
            self._read = engine, engine.geometry()
        geometry = self._read[1]
        if not 0 <= index < len(geometry.part):
            raise IndexError(f"index of a primitive is {index}, and there are {len(geometry.part)} primitives")
        return Primitive(geometry, index)

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
