"""Scenes and their parts."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Sequence
from glob import glob
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vlscan._typing import MeshWithTriangles, PathLike
from vlscan.parts import Part
from vlscan.scene import Scene

from .materials import Material, read_materials
from .settings import Quantity, asset_directories, find_asset, number, three


class BBox:
    """A box.

    Parameters
    ----------
    bounds : numpy.ndarray
        Lowest and highest corner.
    """

    def __init__(self, bounds: NDArray[np.float64]) -> None:
        self.bounds: tuple[NDArray[np.float64], NDArray[np.float64]] = (bounds[0], bounds[1])

    @property
    def centroid(self) -> NDArray[np.float64]:
        """The middle."""
        low, high = self.bounds
        return np.asarray((low + high) / 2)


class ScenePart:
    """Geometry, its materials, and where it stands. Transforms change the part and return it.

    Parameters
    ----------
    part : vlscan.Part
        The part for the engine.
    materials : callable, optional
        Reads the materials by name.
    """

    def __init__(self, part: Part, materials: Callable[[], dict[str, Material]] | None = None) -> None:
        self._part = part
        self._read = materials or dict
        self._materials: dict[str, Material] | None = None
        self._as_read: dict[str, Material] = {}
        self._updates: list[tuple[Material, NDArray[np.int64] | None]] = []
        self.force_on_ground = False

    @classmethod
    def from_obj(cls, obj_file: PathLike, up_axis: str = "z") -> ScenePart:
        """Make a part of an OBJ file.

        Parameters
        ----------
        obj_file : str or path-like
            The file.
        up_axis : str
            The axis that points up, ``z`` or ``y``.

        Returns
        -------
        ScenePart
            The part.
        """
        path = find_asset(obj_file)
        return cls(Part.obj(path, up_axis), lambda: _materials_of_obj(path))

    @classmethod
    def from_objs(cls, obj_files: str | Iterable[PathLike], up_axis: str = "z") -> list[ScenePart]:
        """Make parts of OBJ files.

        Parameters
        ----------
        obj_files : str or iterable
            A pattern (``trees/*.obj``), or the files.
        up_axis : str
            The axis that points up.

        Returns
        -------
        list of ScenePart
            The parts.

        Raises
        ------
        ValueError
            No file matches.
        """
        return [cls.from_obj(path, up_axis) for path in _files(obj_files)]

    @classmethod
    def from_tiff(cls, tiff_file: PathLike) -> ScenePart:
        """Make a part of a terrain raster.

        Parameters
        ----------
        tiff_file : str or path-like
            The file.

        Returns
        -------
        ScenePart
            The part.
        """
        return cls(Part.raster(find_asset(tiff_file)), _default_material)

    @classmethod
    def from_tiffs(cls, tiff_files: str | Iterable[PathLike]) -> list[ScenePart]:
        """Make parts of terrain rasters.

        Parameters
        ----------
        tiff_files : str or iterable
            A pattern, or the files.

        Returns
        -------
        list of ScenePart
            The parts.

        Raises
        ------
        ValueError
            No file matches.
        """
        return [cls.from_tiff(path) for path in _files(tiff_files)]

    @classmethod
    def from_xyz(
        cls,
        xyz_file: PathLike,
        separator: str = " ",
        voxel_size: Quantity = 1.0,
        max_color_value: float = 255.0,
        default_normal: Sequence[float] | None = None,
        rgb_file_columns: Sequence[int] | None = None,
        normal_file_columns: Sequence[int] | None = None,
        snap_neighbor_normal: bool = False,
        estimate_normals: bool | int = False,
        **unknown: Any,
    ) -> ScenePart:
        """Make a part of a point cloud, whose points become voxels.

        Parameters
        ----------
        xyz_file : str or path-like
            The file.
        separator : str
            Characters that separate columns.
        voxel_size : quantity
            Edge of the voxels.
        max_color_value : float
            Value that colours are divided by.
        default_normal : sequence of float, optional
            Normal of points that have none.
        rgb_file_columns, normal_file_columns : sequence of int, optional
            Columns of the colour and of the normal, from 0.
        snap_neighbor_normal : bool
            Whether a voxel has the normal of the point nearest to its centre.
        estimate_normals : bool or int
            Whether normals are those of a plane through the points of each voxel.
        **unknown : Any
            Refused.

        Returns
        -------
        ScenePart
            The part.

        Raises
        ------
        ValueError
            Unknown keywords.
        """
        if unknown:
            raise ValueError(f"from_xyz() has no {', '.join(map(repr, unknown))}")
        return cls(
            Part.points(
                find_asset(xyz_file),
                number(voxel_size, "m"),
                separator="" if separator == " " else separator,
                normal_columns=None if normal_file_columns is None else three(normal_file_columns),
                rgb_columns=None if rgb_file_columns is None else three(rgb_file_columns),
                max_color_value=max_color_value,
                default_normal=None if default_normal is None else three(default_normal),
                estimate_normals=int(estimate_normals),
                snap_neighbor_normal=snap_neighbor_normal,
            ),
            _default_material,
        )

    @classmethod
    def from_xyzs(cls, xyz_files: str | Iterable[PathLike], **settings: Any) -> list[ScenePart]:
        """Make parts of point clouds.

        Parameters
        ----------
        xyz_files : str or iterable
            A pattern, or the files.
        **settings : Any
            Keywords of :meth:`from_xyz`.

        Returns
        -------
        list of ScenePart
            The parts.

        Raises
        ------
        ValueError
            No file matches.
        """
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
        """Make a part of vegetation voxels (AMAPVox).

        Parameters
        ----------
        vox_file : str or path-like
            The file.
        intersection_mode : str
            ``transmittive``, ``fixed`` or ``scaled``.
        intersection_argument : float, optional
            Exponent of the density by which cubes are scaled, 0.5 by default.
        random_shift : bool
            Whether scaled cubes are moved within their cells.
        ladlut_path : str or path-like, optional
            A table of leaf angles.
        **unknown : Any
            Refused.

        Returns
        -------
        ScenePart
            The part.

        Raises
        ------
        ValueError
            Unknown keywords.
        """
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
    def from_numpy_array(cls, vertices: ArrayLike, faces: ArrayLike | None = None, material: Material | None = None) -> ScenePart:
        """Make a part of arrays.

        Parameters
        ----------
        vertices : array_like
            Coordinates, n by 3; without ``faces`` triangles, m by 3 by 3.
        faces : array_like, optional
            Indices of vertices, m by 3.
        material : Material, optional
            The material.

        Returns
        -------
        ScenePart
            The part.

        Raises
        ------
        ValueError
            Arrays of another shape.

        Examples
        --------
        >>> part = vlscan.helios.ScenePart.from_numpy_array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]])
        >>> part.scale(2).bbox.bounds[1].tolist()
        [2.0, 2.0, 0.0]
        """
        corners = np.asarray(vertices, float)
        if faces is None:
            if corners.ndim != 3 or corners.shape[1:] != (3, 3):
                raise ValueError(f"without faces, expected triangles m by 3 by 3, found the shape {corners.shape}")
            faces = np.arange(corners.size // 3).reshape(-1, 3)
            corners = corners.reshape(-1, 3)
        own = material or Material("default")
        return cls(Part.mesh(corners, faces, own.engine()), lambda: {own.name: own.clone()})

    @classmethod
    def from_open3d(cls, o3d_mesh: MeshWithTriangles, up_axis: str = "z", material: Material | None = None) -> ScenePart:
        """Make a part of a mesh of Open3D.

        Parameters
        ----------
        o3d_mesh : open3d.geometry.TriangleMesh
            The mesh.
        up_axis : str
            The axis that points up, ``z`` or ``y``.
        material : Material, optional
            The material.

        Returns
        -------
        ScenePart
            The part.
        """
        corners = np.asarray(o3d_mesh.vertices, float)
        if up_axis == "y":
            corners = np.column_stack([corners[:, 0], -corners[:, 2], corners[:, 1]])
        return cls.from_numpy_array(corners, np.asarray(o3d_mesh.triangles), material)

    @classmethod
    def from_xml(cls, scene_file: PathLike, id: str | int | None = None) -> ScenePart:
        """Refuse to take a part out of a scene file.

        Parameters
        ----------
        scene_file : str or path-like
            The file.
        id : str or int, optional
            Id of the part.

        Returns
        -------
        ScenePart
            The part.

        Raises
        ------
        NotImplementedError
            Always; the message says what to do.
        """
        raise NotImplementedError(
            "parts of a scene file cannot be taken out one by one; StaticScene.from_xml() reads the whole scene, "
            "and ScenePart.from_obj() and its kin read the files of a part"
        )

    def scale(self, factor: float) -> ScenePart:
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
        self._part = self._part.scale(float(factor))
        return self

    def translate(self, vector: Sequence[Quantity]) -> ScenePart:
        """Move the part.

        Parameters
        ----------
        vector : sequence of quantity
            The way.

        Returns
        -------
        ScenePart
            Itself.
        """
        x, y, z = (number(v, "m") for v in vector)
        self._part = self._part.translate(x, y, z)
        return self

    def rotate(
        self,
        quaternion: Sequence[float] | None = None,
        *,
        axis: Sequence[float] | None = None,
        angle: Quantity | None = None,
        from_axis: Sequence[float] | None = None,
        to_axis: Sequence[float] | None = None,
        rotation_center: Sequence[float] | None = None,
    ) -> ScenePart:
        """Turn the part: by a quaternion, about an axis by an angle, or from one axis to another.

        Parameters
        ----------
        quaternion : sequence of float, optional
            w, x, y, z.
        axis : sequence of float, optional
            The axis.
        angle : quantity, optional
            The angle.
        from_axis, to_axis : sequence of float, optional
            The axes.
        rotation_center : sequence of float, optional
            The centre, m; the origin by default.

        Returns
        -------
        ScenePart
            Itself.

        Raises
        ------
        ValueError
            None of these ways, or several.
        """
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
        indices: ArrayLike | None = None,
        range_start: int | None = None,
        range_stop: int | None = None,
        **unknown: Any,
    ) -> ScenePart:
        """Give faces another material. A polygon of a file is one face; voxels follow the faces.

        Parameters
        ----------
        material : Material
            The material.
        indices : array_like, optional
            Indices of the faces, or a mask for parts of arrays; all faces by default.
        range_start, range_stop : int, optional
            Instead of them the first face and the one behind the last.
        **unknown : Any
            Refused.

        Returns
        -------
        ScenePart
            Itself.

        Raises
        ------
        ValueError
            An index beyond, or unknown keywords.
        """
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
        """Return a copy, which shares the geometry.

        Returns
        -------
        ScenePart
            The copy.
        """
        twin = ScenePart(self._part, self._read)
        if self._materials is not None:
            twin._materials = {name: material.clone() for name, material in self._materials.items()}
        twin._as_read, twin._updates = dict(self._as_read), list(self._updates)
        twin.force_on_ground = self.force_on_ground
        return twin

    def state(self) -> tuple[object, ...]:
        """Return what the part for the engine follows from.

        Returns
        -------
        tuple
            Values that are equal as long as it is the same.
        """
        materials = [vars(material).copy() for material in (self._materials or {}).values()]
        return self._part, materials, len(self._updates), self.force_on_ground

    def engine(self) -> Part:
        """Return the part for the engine.

        Returns
        -------
        vlscan.Part
            The part.
        """
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


def _between(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[float, ...]:
    """Return the quaternion of the shortest rotation from one direction to another."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    w = 1 + float(a @ b)
    if w < 1e-12:
        aside = np.cross(a, [1.0, 0.0, 0.0] if abs(a[0]) < 0.9 else [0.0, 1.0, 0.0])
        return (0.0, *(aside / np.linalg.norm(aside)))
    return (w, *np.cross(a, b))


class StaticScene:
    """Parts that do not move.

    Parameters
    ----------
    scene_parts : iterable of ScenePart
        The parts.
    **unknown : Any
        Refused.

    Raises
    ------
    ValueError
        Unknown keywords.
    """

    def __init__(self, scene_parts: Iterable[ScenePart] = (), **unknown: Any) -> None:
        if unknown:
            raise ValueError(f"StaticScene has no {', '.join(map(repr, unknown))}")
        self._parts = list(scene_parts)
        self._scene: Scene | None = None
        self._state: list[tuple[object, ...]] = []
        self._file: str | None = None

    @classmethod
    def from_xml(cls, scene_file: PathLike, id: str | None = None) -> StaticScene:
        """Return the scene of a file.

        Parameters
        ----------
        scene_file : str or path-like
            The file.
        id : str, optional
            Its id; the first by default.

        Returns
        -------
        StaticScene
            The scene.
        """
        scene = cls()
        file = find_asset(scene_file)
        scene._file = file if id is None else f"{file}#{id}"
        return scene

    @classmethod
    def from_binary(cls, filename: PathLike) -> StaticScene:
        """Return the scene of a file of :meth:`to_binary`.

        Parameters
        ----------
        filename : str or path-like
            The file.

        Returns
        -------
        StaticScene
            The scene.
        """
        scene = cls()
        scene._file = find_asset(filename)
        return scene

    def to_binary(self, filename: PathLike, is_dyn_scene: bool = False) -> None:
        """Write the scene, ready to be used, as a packed scene of vlscan.

        Parameters
        ----------
        filename : str or path-like
            The file, ``.vlscene``.
        is_dyn_scene : bool
            Without effect.

        Raises
        ------
        ValueError
            Another extension.
        """
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
        """Add a part.

        Parameters
        ----------
        scene_part : ScenePart
            The part.
        force_on_ground : bool
            Whether it is lowered to the ground.

        Raises
        ------
        NotImplementedError
            The scene is that of a file.
        """
        self.scene_parts.append(scene_part)
        if force_on_ground:
            scene_part.force_on_ground = True
        self._scene = None

    @property
    def bbox(self) -> BBox:
        """The box around all parts."""
        return BBox(self.engine().bounds)

    def engine(self) -> Scene:
        """Return the scene for the engine; it is loaded once unless its parts change.

        Returns
        -------
        vlscan.Scene
            The scene.
        """
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
        """Return a copy.

        Returns
        -------
        StaticScene
            The copy.
        """
        twin = StaticScene([part.clone() for part in self._parts])
        twin._file, twin._scene = self._file, self._scene if self._file else None
        return twin
