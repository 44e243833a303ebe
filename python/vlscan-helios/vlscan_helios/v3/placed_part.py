"""Parts of scenes where they stand: moved, turned and scaled, with their materials."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, NonNegativeInt, PositiveFloat, PositiveInt, PrivateAttr, validate_call
from typing_extensions import Self

from vlscan import InputError
from vlscan.parts import Part
from vlscan.scene import Scene, SceneGeometry

from .errors import HeliosException, engine_errors
from .materials import Material, MaterialDict
from .settings import ForceOnGroundStrategy
from .utils import engine_directories
from .validation import AnyAngle, Model, Quaternion, R3Vector

ARBITRARY = ConfigDict(arbitrary_types_allowed=True)


class BoundingBox(Model):
    """A box, as scenes and their parts return it."""

    _bounds: NDArray[np.float64] = PrivateAttr(default_factory=lambda: np.zeros((2, 3)))

    @classmethod
    def of_bounds(cls, bounds: NDArray[np.float64]) -> BoundingBox:
        """Return the box of two corners.

        Parameters
        ----------
        bounds : numpy.ndarray
            Lowest and highest corner, 2 by 3.

        Returns
        -------
        BoundingBox
            The box.
        """
        box = cls()
        box._bounds = np.asarray(bounds, float)
        return box

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest corner, m."""
        return self._bounds[0], self._bounds[1]

    @property
    def centroid(self) -> NDArray[np.float64]:
        """The middle, m."""
        return np.asarray(self._bounds.mean(axis=0))

    def _identity(self) -> object:
        return self._bounds.tobytes()

    def __repr__(self) -> str:
        lowest, highest = self._bounds.tolist()
        return f"<BoundingBox {lowest} to {highest}>"

    __str__ = __repr__


class PlacedPart(Model):
    """Place, materials and id of a :class:`ScenePart`, whose geometry its functions make."""

    force_on_ground: ForceOnGroundStrategy | PositiveInt = ForceOnGroundStrategy.NONE
    _part: Part | None = PrivateAttr(None)
    # Materials as they were given, for a part that has others than the geometry.
    _given: dict[str, Material] | None = PrivateAttr(None)
    _materials: MaterialDict | None = PrivateAttr(None)
    _as_read: dict[str, Material] = PrivateAttr(default_factory=dict)
    _updates: list[tuple[Material, NDArray[np.int64] | None]] = PrivateAttr(default_factory=list)
    # Why a part of a file cannot be taken out of its scene.
    _obstacle: str = PrivateAttr("")
    _is_of_file: bool = PrivateAttr(False)
    # Bounds of the part, and the state of which they are.
    _measured: tuple[object, NDArray[np.float64]] | None = PrivateAttr(None)
    # The highest face that the file of the part is known to have.
    _last_face: int = PrivateAttr(-1)

    @classmethod
    def of_part(cls, part: Part, materials: Mapping[str, Material] | None = None) -> Self:
        """Return a part of what the engine takes.

        Parameters
        ----------
        part : vlscan.Part
            The part.
        materials : mapping, optional
            Its materials by name; those of its geometry by default.

        Returns
        -------
        ScenePart
            The part.
        """
        made = cls()
        made._part, made._given = part, None if materials is None else dict(materials)
        return made

    @classmethod
    def of_scene(cls, part: Part, file: str) -> Self:
        """Return a part of a scene file; one that cannot be used alone says so when it is.

        Parameters
        ----------
        part : vlscan.Part
            The part.
        file : str
            The file.

        Returns
        -------
        ScenePart
            The part.
        """
        made = cls()
        made._is_of_file, obstacle = True, part.only_in_scene
        try:
            made.force_on_ground = part.on_ground
        except ValueError as problem:
            obstacle = str(problem)
        if obstacle is None:
            made._part = part.drop_to_ground(False)
        else:
            made._obstacle = f"part {part.id} of {file}: {obstacle}"
        return made

    @validate_call
    def scale(self, factor: PositiveFloat) -> Self:
        """Scale the part about the origin.

        Parameters
        ----------
        factor : float
            The factor.

        Returns
        -------
        ScenePart
            Itself.
        """
        self._part = self.known_part().scale(factor)
        return self

    @validate_call(config=ARBITRARY)
    def translate(self, offset: R3Vector) -> Self:
        """Move the part.

        Parameters
        ----------
        offset : array_like
            The way, three numbers (m) or quantities.

        Returns
        -------
        ScenePart
            Itself.
        """
        self._part = self.known_part().translate(*offset.tolist())
        return self

    @validate_call(config=ARBITRARY)
    def rotate(
        self,
        quaternion: Quaternion | None = None,
        axis: R3Vector | None = None,
        angle: AnyAngle | None = None,
        from_axis: R3Vector | None = None,
        to_axis: R3Vector | None = None,
        rotation_center: R3Vector | None = None,
    ) -> Self:
        """Turn the part: by a quaternion, about an axis by an angle, or from one axis to another.

        Parameters
        ----------
        quaternion : array_like, optional
            w, x, y, z.
        axis : array_like, optional
            The axis.
        angle : quantity, optional
            The angle.
        from_axis, to_axis : array_like, optional
            The axes.
        rotation_center : array_like, optional
            The centre, m; the origin by default.

        Returns
        -------
        ScenePart
            Itself.

        Raises
        ------
        ValueError
            None of these ways, several, a direction of length 0, or an angle that is not finite.
        """
        ways: tuple[Any, ...] = (quaternion, axis, angle, from_axis, to_axis)
        given = [way is not None for way in ways]
        turn, about, angle_rad, start, end = ways
        if given == [False, True, True, False, False]:
            direction, half = _direction("axis", about), angle_rad / 2
            turn = (math.cos(half), *(direction * math.sin(half)))
        elif given == [False, False, False, True, True]:
            turn = _between(_direction("from_axis", start), _direction("to_axis", end))
        elif given != [True, False, False, False, False]:
            raise ValueError("rotate() needs a quaternion, an axis and an angle, or from_axis and to_axis")
        part, centre = self.known_part(), (0.0, 0.0, 0.0) if rotation_center is None else rotation_center.tolist()
        x, y, z = centre
        self._part = part.translate(-x, -y, -z).turn(turn).translate(x, y, z)
        return self

    @property
    def materials(self) -> MaterialDict:
        """Materials by name; they can be changed and replaced."""
        if self._materials is None:
            self._materials = MaterialDict(self._defined_materials())
            self._as_read = {name: material.clone() for name, material in self._materials.items()}
        return self._materials

    def _defined_materials(self) -> dict[str, Material]:
        """Return the materials that the part was given, or that its geometry has."""
        if self._given is not None:
            return {name: material.clone() for name, material in self._given.items()}
        of_geometry = {} if self._part is None else self._part.materials
        found = {name: Material.of_engine(material) for name, material in of_geometry.items()}
        return found or {"default": Material(name="default")}

    @validate_call(config=ARBITRARY)
    def update_material(
        self,
        material: Material,
        indices: Any = None,
        range_start: NonNegativeInt | None = None,
        range_stop: NonNegativeInt | None = None,
    ) -> Self:
        """Give faces another material. A polygon of a file is one face; voxels follow the faces.

        Parameters
        ----------
        material : Material
            The material.
        indices : array_like, optional
            Indices of the faces, or a mask for parts of arrays; all faces by default.
        range_start, range_stop : int, optional
            Instead of them the first face and the one behind the last.

        Returns
        -------
        ScenePart
            Itself.

        Raises
        ------
        IndexError
            An index beyond the faces of a mesh or of a file.
        ValueError
            Both indices and a range, or an empty range.
        """
        part = self.known_part()
        if range_start is not None or range_stop is not None:
            if range_stop is None or indices is not None:
                raise ValueError("update_material() needs indices, or range_stop with or without range_start")
            if range_stop <= (range_start or 0):
                raise ValueError(f"range_start is {range_start or 0} and range_stop {range_stop}, expected at least one face between them")
            indices = np.arange(range_start or 0, range_stop)
        _check_faces(part, indices)
        faces = None if indices is None else part.face_numbers(indices)
        known, name, own = self.materials, material.name or "default", material.clone()
        if faces is None:
            known.clear()
            self._updates.clear()
        self._updates.append((own, faces))
        if faces is not None and part.face_count is None:
            self._check_last_face(int(faces.max(initial=-1)))
        if name not in known:
            known[name] = own
        return self

    def _check_last_face(self, face: int) -> None:
        """Undo the last update if the file of the part does not have its highest face; other faults are told by the run."""
        if face <= self._last_face:
            return
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                _ = self.bbox
        except HeliosException as error:
            problems = error.problems if isinstance(error, InputError) else []
            if all(problem.kind != "missing_entry" for problem in problems):
                return
            self._updates.pop()
            raise _FaceIndexError(str(error).removeprefix("error: ")) from None
        self._last_face = face

    def _current(self, material: Material) -> Material:
        """Return what an updated material has become: it may have been changed or replaced by its name since."""
        name = material.name or "default"
        if self._materials is None or name in self._as_read:
            return material
        return self._materials.get(self._materials.current(name), material)

    @property
    def bbox(self) -> BoundingBox:
        """The box around the part where it stands now."""
        state = (self.state(), engine_directories())
        if self._measured is None or self._measured[0] != state:
            with engine_errors():
                self._measured = (state, Scene([self.engine()], engine_directories()).bounds)
        return BoundingBox.of_bounds(self._measured[1])

    def geometry(self) -> SceneGeometry:
        """Return the triangles and voxels of the part where it stands now; an addition of vlscan.

        Returns
        -------
        vlscan.SceneGeometry
            Arrays, world frame, m.
        """
        with engine_errors():
            return Scene([self.engine()], engine_directories()).geometry()

    @property
    def id(self) -> str:
        """Id of a part of a scene file; empty for others."""
        return "" if self._part is None else self._part.id or ""

    @property
    def is_of_file(self) -> bool:
        """True if it is a part of a scene file."""
        return self._is_of_file

    def known_part(self) -> Part:
        """Return the part without changes of materials.

        Returns
        -------
        vlscan.Part
            The part.

        Raises
        ------
        NotImplementedError
            It cannot be used alone, or has no geometry.
        """
        if self._part is None:
            reason = self._obstacle or "it has no geometry; ScenePart.from_obj() and its kin make parts"
            raise NotImplementedError(f"the part cannot be used alone: {reason}")
        return self._part

    def _identity(self) -> object:
        return self.state()[:-1]

    def state(self) -> tuple[object, ...]:
        """Return what the part for the engine follows from.

        Returns
        -------
        tuple
            Values that are equal as long as it is the same.
        """
        changed = {name: material.clone() for name, material in self._changed_materials().items()}
        updates = [(self._current(own).clone(), None if faces is None else faces.tolist()) for own, faces in self._updates]
        return self._part, changed, updates, self.force_on_ground

    def _changed_materials(self) -> dict[str, Material]:
        """Return the materials of the geometry that are not as they were read."""
        known = MaterialDict() if self._materials is None else self._materials
        now = {name: known.get(known.current(name)) for name in self._as_read}
        return {name: material for name, material in now.items() if material is not None and material != self._as_read[name]}

    def engine(self) -> Part:
        """Return the part for the engine.

        Returns
        -------
        vlscan.Part
            The part.

        Raises
        ------
        NotImplementedError
            A part of a scene file that moves, is swapped, or has random materials.
        """
        part = self.known_part()
        for name, material in self._changed_materials().items():
            part = part.with_material(material.engine(), of=name)
        for material, indices in self._updates:
            part = part.with_material(self._current(material).engine(), of=indices)
        return part.drop_to_ground(int(self.force_on_ground))

    def __copy__(self) -> Self:
        return self.__deepcopy__()

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Self:
        # The geometry never changes and is shared.
        return self.twin().with_own_materials()

    def with_own_materials(self) -> Self:
        """Stop sharing materials with the part of which this is a copy.

        Returns
        -------
        ScenePart
            Itself.
        """
        if self._materials is not None:
            self._materials = self._materials.clone()
        self._as_read, self._updates = dict(self._as_read), list(self._updates)
        return self

    def __repr__(self) -> str:
        return f"<ScenePart {self._part if self._part is not None else self._obstacle}>"


class _FaceIndexError(IndexError, ValueError):
    """An index beyond the faces of a mesh."""


def _check_faces(part: Part, indices: Any) -> None:
    """Refuse indices beyond the faces of a mesh; other faults are told by the part."""
    chosen = np.asarray([] if indices is None else indices)
    if part.face_count is None or not chosen.size or chosen.dtype.kind not in "iu":
        return
    if chosen.min() < 0 or chosen.max() >= part.face_count:
        raise _FaceIndexError(f"indices of faces are {chosen.min()} to {chosen.max()}, expected 0 to {part.face_count - 1}")


def _direction(name: str, vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a vector of length 1."""
    length = np.linalg.norm(vector)
    if length == 0:
        raise ValueError(f"{name} is {vector.tolist()}, expected a direction: numbers that are not all 0")
    return vector / length


def _between(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[float, ...]:
    """Return the quaternion of the shortest rotation from one direction, of length 1, to another."""
    w = 1 + float(a @ b)
    if w < 1e-12:
        aside = np.cross(a, [1.0, 0.0, 0.0] if abs(a[0]) < 0.9 else [0.0, 1.0, 0.0])
        return (0.0, *(aside / np.linalg.norm(aside)))
    return (w, *np.cross(a, b))
