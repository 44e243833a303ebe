"""Scenes and their parts."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Sequence
from glob import glob
from typing import Any

import numpy as np

from ..scene import Part, Scene
from .materials import Material, read_materials
from .settings import asset_directories, find_asset, number

PathLike = str | os.PathLike[str]


class BBox:
    """A box: ``bounds`` are the lowest and the highest corner, ``centroid`` is its middle."""

    def __init__(self, bounds: np.ndarray) -> None:
        self.bounds: tuple[np.ndarray, np.ndarray] = (bounds[0], bounds[1])

    @property
    def centroid(self) -> np.ndarray:
        """The middle."""
        return (self.bounds[0] + self.bounds[1]) / 2


class ScenePart:
    """Geometry, its materials, and where it stands. Transforms change the part and return it."""

    def __init__(self, part: Part, materials: Callable[[], dict[str, Material]] | None = None) -> None:
        self._part = part
        self._read = materials or dict
        self._materials: dict[str, Material] | None = None
        self._as_read: dict[str, Material] = {}
        self._updates: list[tuple[Material, Any]] = []
        self.force_on_ground = False

    @classmethod
    def from_obj(cls, obj_file: PathLike, up_axis: str = "z") -> ScenePart:
        """A part of an OBJ file."""
        path = find_asset(obj_file)
        return cls(Part.obj(path, up_axis), lambda: _materials_of_obj(path))

    @classmethod
    def from_objs(cls, obj_files: str | Iterable[PathLike], up_axis: str = "z") -> list[ScenePart]:
        """Parts of OBJ files, which a pattern (``trees/*.obj``) or a list names."""
        return [cls.from_obj(path, up_axis) for path in _files(obj_files)]

    @classmethod
    def from_tiff(cls, tiff_file: PathLike) -> ScenePart:
        """A part of a terrain raster."""
        return cls(Part.raster(find_asset(tiff_file)), _default_material)

    @classmethod
    def from_tiffs(cls, tiff_files: str | Iterable[PathLike]) -> list[ScenePart]:
        """Parts of terrain rasters."""
        return [cls.from_tiff(path) for path in _files(tiff_files)]

    @classmethod
    def from_xyz(
        cls,
        xyz_file: PathLike,
        separator: str = " ",
        voxel_size: Any = 1.0,
        max_color_value: float = 255.0,
        default_normal: Sequence[float] | None = None,
        rgb_file_columns: Sequence[int] | None = None,
        normal_file_columns: Sequence[int] | None = None,
        snap_neighbor_normal: bool = False,
        estimate_normals: bool | int = False,
        **unknown: Any,
    ) -> ScenePart:
        """A part of a point cloud, whose points become voxels."""
        if unknown:
            raise ValueError(f"from_xyz() has no {', '.join(map(repr, unknown))}")
        return cls(
            Part.points(
                find_asset(xyz_file),
                number(voxel_size, "m"),
                separator="" if separator == " " else separator,
                normal_columns=None if normal_file_columns is None else tuple(normal_file_columns),  # type: ignore[arg-type]
                rgb_columns=None if rgb_file_columns is None else tuple(rgb_file_columns),  # type: ignore[arg-type]
                max_color_value=max_color_value,
                default_normal=None if default_normal is None else tuple(default_normal),  # type: ignore[arg-type]
                estimate_normals=int(estimate_normals),
                snap_neighbor_normal=snap_neighbor_normal,
            ),
            _default_material,
        )

    @classmethod
    def from_xyzs(cls, xyz_files: str | Iterable[PathLike], **settings: Any) -> list[ScenePart]:
        """Parts of point clouds."""
        return [cls.from_xyz(path, **settings) for path in _files(xyz_files)]

    @classmethod
    def from_vox(
        cls,
        vox_file: PathLike,
        intersection_mode: str = "transmittive",
        intersection_argument: float | None = None,
        random_shift: bool = False,
        ladlut_path: PathLike | None = None,
        **unknown: Any,
    ) -> ScenePart:
        """A part of vegetation voxels (AMAPVox)."""
        if unknown:
            raise ValueError(f"from_vox() has no {', '.join(map(repr, unknown))}")
        part = Part.voxels(
            find_asset(vox_file),
            mode=intersection_mode,
            exponent=0.5 if intersection_argument is None else intersection_argument,
            random_shift=random_shift,
            leaf_angles=None if ladlut_path is None else find_asset(ladlut_path),
        )
        return cls(part, _default_material)

    @classmethod
    def from_numpy_array(cls, vertices: Any, faces: Any = None, material: Material | None = None) -> ScenePart:
        """A part of arrays: ``vertices`` n by 3 and ``faces`` m by 3; or triangles, m by 3 by 3."""
        corners = np.asarray(vertices, float)
        if faces is None:
            if corners.ndim != 3 or corners.shape[1:] != (3, 3):
                raise ValueError(f"without faces, expected triangles m by 3 by 3, found the shape {corners.shape}")
            faces = np.arange(corners.size // 3).reshape(-1, 3)
            corners = corners.reshape(-1, 3)
        own = material or Material("default")
        return cls(Part.mesh(corners, faces, own.engine()), lambda: {own.name: own.clone()})

    @classmethod
    def from_open3d(cls, o3d_mesh: Any, up_axis: str = "z", material: Material | None = None) -> ScenePart:
        """A part of a mesh of Open3D."""
        corners = np.asarray(o3d_mesh.vertices, float)
        if up_axis == "y":
            corners = np.column_stack([corners[:, 0], -corners[:, 2], corners[:, 1]])
        return cls.from_numpy_array(corners, np.asarray(o3d_mesh.triangles), material)

    @classmethod
    def from_xml(cls, scene_file: PathLike, id: str | int | None = None) -> ScenePart:
        """Not possible: see the message."""
        raise NotImplementedError(
            "parts of a scene file cannot be taken out one by one; StaticScene.from_xml() reads the whole scene, "
            "and ScenePart.from_obj() and its kin read the files of a part"
        )

    def scale(self, factor: float) -> ScenePart:
        """Scales the part about the origin."""
        self._part = self._part.scale(float(factor))
        return self

    def translate(self, vector: Sequence[Any]) -> ScenePart:
        """Moves the part."""
        x, y, z = (number(v, "m") for v in vector)
        self._part = self._part.translate(x, y, z)
        return self

    def rotate(
        self,
        quaternion: Sequence[float] | None = None,
        *,
        axis: Sequence[float] | None = None,
        angle: Any = None,
        from_axis: Sequence[float] | None = None,
        to_axis: Sequence[float] | None = None,
        rotation_center: Sequence[float] | None = None,
    ) -> ScenePart:
        """Turns the part: by a quaternion (w, x, y, z), about an axis by an angle, or from one axis to another."""
        ways = [quaternion is not None, axis is not None or angle is not None, from_axis is not None or to_axis is not None]
        if sum(ways) != 1:
            raise ValueError("rotate() needs a quaternion, an axis and an angle, or from_axis and to_axis")
        if quaternion is None and ways[1]:
            if axis is None or angle is None:
                raise ValueError("rotate() needs an axis and an angle")
            direction = np.asarray(axis, float) / np.linalg.norm(axis)
            half = number(angle, "rad") / 2
            quaternion = (math.cos(half), *(direction * math.sin(half)))
        elif quaternion is None:
            if from_axis is None or to_axis is None:
                raise ValueError("rotate() needs from_axis and to_axis")
            quaternion = _between(np.asarray(from_axis, float), np.asarray(to_axis, float))
        if rotation_center is not None:
            self.translate([-v for v in rotation_center])
        self._part = self._part.turn(quaternion)
        return self if rotation_center is None else self.translate(rotation_center)

    @property
    def materials(self) -> dict[str, Material]:
        """Materials by name; their properties can be changed."""
        if self._materials is None:
            self._materials = self._read()
            self._as_read = {name: material.clone() for name, material in self._materials.items()}
        return self._materials

    def update_material(
        self,
        material: Material,
        indices: Any = None,
        range_start: int | None = None,
        range_stop: int | None = None,
        **unknown: Any,
    ) -> ScenePart:
        """Gives faces another material: all, those with ``indices`` (or a mask, for arrays), or those from ``range_start`` to
        before ``range_stop``. A polygon of a file is one face; voxels follow the faces."""
        if unknown:
            raise ValueError(f"update_material() has no {', '.join(map(repr, unknown))}")
        if indices is None and (range_start is not None or range_stop is not None):
            if range_stop is None:
                raise ValueError("update_material() needs range_stop with range_start")
            indices = np.arange(range_start or 0, range_stop)
        chosen = None if indices is None else self._part._face_numbers(indices)
        self._updates.append((material.clone(), chosen))
        return self

    @property
    def bbox(self) -> BBox:
        """The box around the part where it stands now."""
        return BBox(Scene([self.engine()]).bounds)

    def clone(self) -> ScenePart:
        """A copy, which shares the geometry."""
        twin = ScenePart(self._part, self._read)
        if self._materials is not None:
            twin._materials = {name: material.clone() for name, material in self._materials.items()}
        twin._as_read, twin._updates = dict(self._as_read), list(self._updates)
        twin.force_on_ground = self.force_on_ground
        return twin

    def state(self) -> tuple[Any, ...]:
        """What the part for the engine follows from."""
        materials = [vars(material).copy() for material in (self._materials or {}).values()]
        return self._part, materials, len(self._updates), self.force_on_ground

    def engine(self) -> Part:
        """The part for the engine."""
        part = self._part
        for name, material in (self._materials or {}).items():
            if material != self._as_read.get(name):
                part = part.with_material(material.engine(), of=name)
        for material, indices in self._updates:
            part = part.with_material(material.engine(), of=indices)
        return part.drop_to_ground(self.force_on_ground)


def _files(names: str | Iterable[PathLike]) -> list[str]:
    if not isinstance(names, (str, os.PathLike)):
        return [find_asset(name) for name in names]
    pattern = os.fspath(names)
    for folder in ["", *asset_directories(), "assets"]:
        found = sorted(glob(os.path.join(folder, pattern)))
        if found:
            return found
    raise ValueError(f"no file matches {pattern!r}")


def _default_material() -> dict[str, Material]:
    return {"default": Material("default")}


def _materials_of_obj(path: str) -> dict[str, Material]:
    found: dict[str, Material] = {}
    with open(path, "rb") as file:
        for line in file:
            if line.startswith(b"mtllib"):
                for name in line.decode(errors="replace").split()[1:]:
                    library = os.path.join(os.path.dirname(path), name)
                    if os.path.exists(library):
                        found = {**read_materials(library), **found}
    return found


def _between(a: np.ndarray, b: np.ndarray) -> tuple[float, ...]:
    """The quaternion of the shortest rotation from one direction to another."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    w = 1 + float(a @ b)
    if w < 1e-12:
        aside = np.cross(a, [1.0, 0.0, 0.0] if abs(a[0]) < 0.9 else [0.0, 1.0, 0.0])
        return (0.0, *(aside / np.linalg.norm(aside)))
    return (w, *np.cross(a, b))


class StaticScene:
    """Parts that do not move."""

    def __init__(self, scene_parts: Iterable[ScenePart] = (), **unknown: Any) -> None:
        if unknown:
            raise ValueError(f"StaticScene has no {', '.join(map(repr, unknown))}")
        self._parts = list(scene_parts)
        self._scene: Scene | None = None
        self._state: list[tuple[Any, ...]] = []
        self._file: str | None = None

    @classmethod
    def from_xml(cls, scene_file: PathLike, id: str | None = None) -> StaticScene:
        """The scene of a file: the one with the id, else the first."""
        scene = cls()
        file = find_asset(scene_file)
        scene._file = file if id is None else f"{file}#{id}"
        return scene

    @classmethod
    def from_binary(cls, filename: PathLike) -> StaticScene:
        """The scene of a file of :meth:`to_binary`."""
        scene = cls()
        scene._file = find_asset(filename)
        return scene

    def to_binary(self, filename: PathLike, is_dyn_scene: bool = False) -> None:
        """Writes the scene, ready to be used, as a packed scene of vlscan (``.vlscene``)."""
        name = os.fspath(filename)
        if not name.endswith(".vlscene"):
            raise ValueError(f"{name}: expected a name that ends in .vlscene")
        self.engine().pack(name, physics="helios")

    @property
    def scene_parts(self) -> list[ScenePart]:
        """The parts."""
        if self._file is not None:
            raise NotImplementedError("the parts of a scene file are not listed; build the scene of ScenePart.from_obj() and its kin")
        return self._parts

    def add_scene_part(self, scene_part: ScenePart, force_on_ground: bool = False) -> None:
        """Adds a part."""
        self.scene_parts.append(scene_part)
        if force_on_ground:
            scene_part.force_on_ground = True
        self._scene = None

    @property
    def bbox(self) -> BBox:
        """The box around all parts."""
        return BBox(self.engine().bounds)

    def engine(self) -> Scene:
        """The scene for the engine; it is loaded once unless its parts change."""
        if self._file is not None:
            if self._scene is None:
                self._scene = Scene(self._file, asset_directories())
            return self._scene
        state = [part.state() for part in self._parts]
        if self._scene is None or state != self._state:
            self._state = state
            self._scene = Scene([part.engine() for part in self._parts], asset_directories())
        return self._scene

    def clone(self) -> StaticScene:
        """A copy."""
        twin = StaticScene([part.clone() for part in self._parts])
        twin._file, twin._scene = self._file, self._scene if self._file else None
        return twin

