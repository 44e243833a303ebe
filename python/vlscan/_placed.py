"""Parts of scenes where they stand: moved, turned and scaled, with other materials."""

from __future__ import annotations

import copyreg
import math
import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _vlscan
from ._arguments import array_of, real, reals, whole
from ._point_file import PointFile
from ._typing import Vector
from .materials import FileMaterial, Material, fields_of
from .places import place_of, working_folder

if TYPE_CHECKING:
    from typing_extensions import Self

_Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class Place:
    """Placement of a part: ``p' = scale * rotation(p) + offset``; ``on_ground`` is 1 for a part that is dropped to the ground."""

    quaternion: _Quaternion = (1.0, 0.0, 0.0, 0.0)
    scale: float = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    on_ground: int = 0
    id: str | None = None
    changes: _vlscan.Changes = _vlscan.Changes()

    def is_same(self, other: Place) -> bool:
        """Return whether another place has the same values; changes of materials are compared by what they are."""
        if replace(self, changes=other.changes) != other:
            return False
        return self.changes is other.changes or self.changes.parts() == other.changes.parts()

    def fields(self) -> dict[str, object]:
        """Return the fields that the engine reads."""
        w, *vector = self.quaternion
        length = math.hypot(*vector)
        axis = [v / length for v in vector] if length > 0 else [0.0, 0.0, 1.0]
        angle = 2 * math.atan2(length, w)
        scale, offset = float(self.scale), [float(v) for v in self.offset]
        return dict(axis=axis, angle=angle, scale=scale, offset=offset, on_ground=int(self.on_ground), id=self.id, changes=self.changes)


def _product(a: _Quaternion, b: _Quaternion) -> _Quaternion:
    """Return the quaternion of the rotation ``b``, then ``a``."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def _turned(q: _Quaternion, v: tuple[float, float, float]) -> tuple[float, float, float]:
    w, axis, vector = q[0], np.asarray(q[1:], float), np.asarray(v, float)
    x, y, z = (vector + 2 * np.cross(axis, np.cross(axis, vector) + w * vector)).tolist()
    return x, y, z


class PlacedPart:
    """Place, materials and id of a :class:`vlscan.Part`, whose geometry its functions make."""

    def __init__(self, kind: str, arguments: tuple[object, ...], place: Place, faces: tuple[int, int] | None = None) -> None:
        self._kind, self._arguments, self._place, self._faces = kind, arguments, place, faces
        self._folder = working_folder()

    @overload
    def translate(self, x: float, y: float, z: float = 0.0) -> Self: ...
    @overload
    def translate(self, x: Vector) -> Self: ...
    def translate(self, x: float | Vector, y: float | None = None, z: float = 0.0) -> Self:
        """Return the part moved.

        Parameters
        ----------
        x, y, z : float
            The way, m; or three numbers as one sequence.

        Returns
        -------
        Part
            The moved part, which shares the geometry.

        Raises
        ------
        ValueError
            A number is not finite.
        """
        numbers = reals("a translation", x if y is None and not z else (x, 0.0 if y is None else y, z))
        if numbers.shape != (3,) or not np.isfinite(numbers).all():
            raise ValueError(f"a translation is {numbers.tolist()}, expected three finite numbers: x, y and z")
        way = numbers.tolist()
        old_x, old_y, old_z = self._place.offset
        return self._placed(offset=(old_x + way[0], old_y + way[1], old_z + way[2]))

    def scale(self, factor: float) -> Self:
        """Return the part scaled about the origin.

        Parameters
        ----------
        factor : float
            The factor, above 0.

        Returns
        -------
        Part
            The scaled part, which shares the geometry.

        Raises
        ------
        ValueError
            The factor is not above 0.
        """
        factor = real("factor", factor)
        if not 0 < factor < math.inf:
            raise ValueError(f"a scale is {factor:g}, expected a number above 0")
        x, y, z = self._place.offset
        return self._placed(scale=self._place.scale * factor, offset=(x * factor, y * factor, z * factor))

    def rotate(self, axis: Vector, angle_deg: float) -> Self:
        """Return the part turned about an axis through the origin, right-handed.

        Parameters
        ----------
        axis : sequence of float
            The axis, of any length.
        angle_deg : float
            The angle, degrees.

        Returns
        -------
        Part
            The turned part, which shares the geometry.

        Raises
        ------
        TypeError
            The axis is a text.
        ValueError
            The axis is 0, or a number is not finite.
        """
        given: object = axis
        if isinstance(given, str):
            raise TypeError(f"an axis is {given!r}, expected three numbers, such as (0, 0, 1) for z")
        direction = reals("an axis", axis)
        length = np.linalg.norm(direction)
        if direction.shape != (3,) or not 0 < length < math.inf:
            raise ValueError(f"an axis is {axis}, expected three finite numbers that are not all 0")
        angle_deg = real("angle_deg", angle_deg)
        if not math.isfinite(angle_deg):
            raise ValueError(f"an angle is {angle_deg}, expected a finite number of degrees")
        half = math.radians(angle_deg) / 2
        return self.turn((math.cos(half), *(direction / length * math.sin(half))))

    def turn(self, quaternion: Vector) -> Self:
        """Return the part turned about the origin by a quaternion.

        Parameters
        ----------
        quaternion : sequence of float
            w, x, y, z, of any length.

        Returns
        -------
        Part
            The turned part, which shares the geometry.

        Raises
        ------
        ValueError
            The quaternion is 0, or a number is not finite.
        """
        q = reals("a quaternion", quaternion)
        if q.shape != (4,) or not 0 < np.linalg.norm(q) < math.inf:
            raise ValueError(f"a quaternion is {quaternion}, expected finite numbers w, x, y, z that are not all 0")
        w, x, y, z = (q / np.linalg.norm(q)).tolist()
        unit = (w, x, y, z)
        return self._placed(quaternion=_product(unit, self._place.quaternion), offset=_turned(unit, self._place.offset))

    def drop_to_ground(self, on_ground: bool | int = True) -> Self:
        """Return the part lowered, or lifted, to the ground below it: to surfaces whose material is ground.

        Parameters
        ----------
        on_ground : bool or int
            True if it is lowered; or the mode ``onGround`` of scene files, where -1 looks for the best position.

        Returns
        -------
        Part
            The part, which shares the geometry.

        Raises
        ------
        TypeError
            Neither a truth value nor a whole number.
        ValueError
            A number below -1.
        """
        mode = int(on_ground) if isinstance(on_ground, (bool, np.bool_)) else whole("on_ground", on_ground, -1)
        return self._placed(on_ground=mode)

    def with_material(self, material: Material, of: str | ArrayLike | None = None) -> Self:
        """Return the part with another material.

        Parameters
        ----------
        material : Material
            The material.
        of : str or array_like, optional
            The faces that get it, all by default: those whose material has this name, or those with these indices. Indices
            count the faces as they were given or as the file has them, from 0; a polygon is one, and voxels follow them. For
            a part of :meth:`mesh` it may be a mask, too.

        Returns
        -------
        Part
            The part, which shares the geometry.

        Raises
        ------
        ValueError
            An index beyond the faces of a mesh; of a file it is an error when the scene is loaded.

        Examples
        --------
        >>> tree = vlscan.Part.obj("fixtures/forest/beech.obj")
        >>> wet = tree.with_material(vlscan.Material("wet", reflectance=0.1), of="leaves")
        """
        which: str | bytes | None
        if of is None or isinstance(of, str):
            which = of
        else:
            indices, per_face = self.face_numbers(of), self._faces[1] if self._faces else 1
            # A quadrilateral is two triangles.
            triangles = (indices[:, None] * per_face + np.arange(per_face)).ravel()
            which = triangles.astype("<u4").tobytes()
        return self._placed(changes=self._place.changes.then(which, fields_of(material)))

    def face_numbers(self, of: ArrayLike) -> NDArray[np.int64]:
        """Return the indices of faces that a mask or indices choose.

        Parameters
        ----------
        of : array_like
            A mask with a value for each face, or indices from 0.

        Returns
        -------
        numpy.ndarray
            The indices.

        Raises
        ------
        ValueError
            An index beyond the faces, or an array of another shape.
        """
        chosen = np.atleast_1d(array_of("of", of))
        count = self._faces[0] if self._faces else None
        if chosen.dtype == bool:
            if count is None:
                raise ValueError("the number of faces of a file is not known yet, so a mask cannot be checked; give indices")
            if chosen.shape != (count,):
                raise ValueError(f"a mask of faces has the shape {chosen.shape}, expected one per face, ({count},)")
            return np.flatnonzero(chosen)
        if chosen.size == 0:
            return np.zeros(0, np.int64)
        if chosen.ndim != 1 or chosen.dtype.kind not in "iu":
            raise ValueError(f"expected a list of indices of faces, found the shape {chosen.shape} of {chosen.dtype}")
        highest = (2**32 if count is None else count) - 1
        if chosen.min() < 0 or chosen.max() > highest:
            raise ValueError(f"indices of faces are {chosen.min()} to {chosen.max()}, expected 0 to {highest}")
        return chosen.astype(np.int64)

    def named(self, id: str) -> Self:
        """Return the part with an id.

        Parameters
        ----------
        id : str
            Value of the column ``ObjectId``.

        Returns
        -------
        Part
            The part, which shares the geometry.
        """
        return self._placed(id=None if id is None else str(id))

    @property
    def id(self) -> str | None:
        """Value of the column ``ObjectId``, if the part was named."""
        return self._place.id

    @property
    def on_ground(self) -> int:
        """Mode of :meth:`drop_to_ground`; 0 for a part that stands where it is."""
        return self._place.on_ground

    @property
    def only_in_scene(self) -> str | None:
        """Reason why a part of :meth:`Scene.read_parts` exists only in its scene; ``None`` for one that other scenes can have."""
        return str(self._arguments[0]) if self._kind == "of_scene" else None

    @property
    def materials(self) -> dict[str, Material]:
        """Materials by name, with those of :meth:`with_material`; empty if nothing defines any.

        Materials of arrays are as given. Material files are read: OBJ files name their own, and rasters, points and voxels have one
        material. Other meshes, and those with a table of materials, are loaded; their materials have reflectance and class only.
        """
        found = self._defined_materials()
        for which, fields in self._place.changes.parts():
            changed = FileMaterial.of_fields(fields)
            if which is None:
                found = {changed.name: changed}
            elif isinstance(which, bytes) or which in found:
                # A material that is replaced leaves its place to the other one.
                found = {changed.name if name == which else name: changed if name == which else old for name, old in found.items()}
                found.setdefault(changed.name, changed)
        return found

    def _defined_materials(self) -> dict[str, Material]:
        """Return the materials without those of :meth:`with_material`."""
        first, last = self._arguments[0], self._arguments[-1]
        if isinstance(first, _vlscan.Mesh):
            given = map(FileMaterial.of_fields, first.materials())
            return {material.name: material for material in given}
        if self._kind == "of_mesh_file":
            is_obj = last is None and str(first).lower().endswith(".obj")
            return Material.read(str(first)) if is_obj else self._loaded_materials()
        if not isinstance(last, dict) or last["file"] is None:
            return {}
        known = Material.read(last["file"])
        name = last["name"] or min(known, default="")
        return {name: known[name]} if name in known else {}

    def _loaded_materials(self) -> dict[str, Material]:
        from .parts import Part
        from .scene import Scene

        loaded = Scene([Part(self._kind, self._arguments, Place())]).materials
        return {name: FileMaterial(name, reflectance=share, classification=kind) for name, (share, kind) in loaded.items()}

    @property
    def face_count(self) -> int | None:
        """Number of faces of a part of arrays; ``None`` for one of a file, which is not read yet."""
        return self._faces[0] if self._faces else None

    def _placed(self, **changes: Any) -> Self:
        part = type(self)(self._kind, self._arguments, replace(self._place, **changes), self._faces)
        part._folder = self._folder
        return part

    def _made(self) -> _vlscan.Part:
        if self.only_in_scene is not None:
            raise NotImplementedError(f"the part {self.id} exists only in its scene: {self.only_in_scene}")
        arguments = (self._found(value, number == 0) for number, value in enumerate(self._arguments))
        made: _vlscan.Part = getattr(_vlscan.Part, self._kind)(*arguments, self._place.fields())
        return made

    def _found(self, value: object, is_path: bool = False) -> object:
        """Return an argument for the engine, with files as they are found from the working directory."""
        if isinstance(value, PointFile):
            return os.fspath(value)
        if isinstance(value, str):
            # Other texts are names of axes, units and materials as well: only files have a dot.
            return place_of(value, self._folder) if is_path or "." in value else value
        if isinstance(value, list):
            return [self._found(item, is_path) for item in value]
        return {key: self._found(item) for key, item in value.items()} if isinstance(value, dict) else value

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, PlacedPart):
            return NotImplemented
        if self._kind != other._kind or not self._place.is_same(other._place):
            return False
        pairs = zip(self._arguments, other._arguments, strict=True)
        return all(one is another or _content(one) == _content(another) for one, another in pairs)

    def __hash__(self) -> int:
        # Without changes of materials, which are no values.
        return hash((self._kind, self._place.quaternion, self._place.scale, self._place.offset, self._place.id))

    def __repr__(self) -> str:
        place = self._place
        facts = [self._kind.removeprefix("of_").replace("_", " ")]
        facts += [repr(value) for value in self._arguments[:1] if isinstance(value, (str, PointFile))]
        facts += [] if place.id is None else [f"id {place.id!r}"]
        facts += [] if self._faces is None else [f"{self._faces[0]} faces"]
        facts += [] if place.quaternion == (1.0, 0.0, 0.0, 0.0) else ["turned"]
        facts += [] if place.scale == 1 else [f"scale {place.scale:g}"]
        facts += [] if place.offset == (0.0, 0.0, 0.0) else ["at {:g}, {:g}, {:g}".format(*place.offset)]
        facts += ["on the ground"] if place.on_ground else []
        return f"<Part: {', '.join(facts)}>"


def _content(argument: object) -> object:
    """Return what an argument consists of, which is the same for an object and one that was pickled."""
    return argument.parts() if isinstance(argument, _vlscan.Mesh) else argument


def _mesh_of(*parts: Any) -> _vlscan.Mesh:
    return _vlscan.Mesh(*parts)


def _changes_of(parts: list[tuple[str | bytes | None, dict[str, Any]]]) -> _vlscan.Changes:
    changes = _vlscan.Changes()
    for which, fields in parts:
        changes = changes.then(which, fields)
    return changes


copyreg.pickle(_vlscan.Mesh, lambda mesh: (_mesh_of, mesh.parts()))
copyreg.pickle(_vlscan.Changes, lambda changes: (_changes_of, (changes.parts(),)))
