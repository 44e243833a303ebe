"""Parts of scenes: geometry and where they stand."""

from __future__ import annotations

import copyreg
import math
import operator
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _vlscan
from ._conversions import unmasked
from ._point_file import PointFile
from ._typing import MeshWithFaces, MeshWithTriangles, PathLike, Vector
from ._values import renamed
from .materials import FileMaterial, Material, fields_of
from .places import place_of, working_folder

_Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class _Place:
    """Where a part stands: ``p' = scale * rotation(p) + offset``; ``on_ground`` is 1 for one that is dropped to the ground."""

    quaternion: _Quaternion = (1.0, 0.0, 0.0, 0.0)
    scale: float = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    on_ground: int = 0
    id: str | None = None
    changes: _vlscan.Changes = _vlscan.Changes()

    def is_same(self, other: _Place) -> bool:
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


class Part:
    """A part of a scene: geometry and where it stands.

    Parts are made by :meth:`mesh`, :meth:`file` and the other static methods. They do not change: :meth:`translate` and the
    like return new ones, which share the geometry, so a thousand copies of a tree take the memory of one. They pickle, and copies
    that are pickled together share their geometry afterwards, too.

    Parameters
    ----------
    kind : str
        Name of the function of the engine that makes the part.
    arguments : tuple
        Its arguments.
    place : object
        Where the part stands.
    faces : tuple of int, optional
        Number of faces and of triangles in each, if known.

    Examples
    --------
    >>> floor = vlscan.Part.mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2, 3]])
    >>> vlscan.Scene([floor, floor.translate(0, 0, 3).named("ceiling")]).bounds[1].tolist()
    [9.0, 9.0, 3.0]
    """

    def __init__(self, kind: str, arguments: tuple[object, ...], place: _Place, faces: tuple[int, int] | None = None) -> None:
        self._kind, self._arguments, self._place, self._faces = kind, arguments, place, faces
        self._folder = working_folder()

    @staticmethod
    def mesh(
        vertices: ArrayLike,
        faces: ArrayLike,
        materials: Material | Iterable[Material] | None = None,
        material_of: ArrayLike | None = None,
        id: str | None = None,
    ) -> Part:
        """Make a part of triangles or quadrilaterals in memory.

        Parameters
        ----------
        vertices : array_like
            Coordinates, n by 3, m.
        faces : array_like
            Indices of vertices, m by 3 or m by 4.
        materials : Material or iterable of Material, optional
            One for all faces, or several.
        material_of : array_like, optional
            Of several materials the index of the one of each face.
        id : str, optional
            What the column ``ObjectId`` reports; a number by default.

        Returns
        -------
        Part
            The part.

        Raises
        ------
        ValueError
            Arrays of another shape or type, or indices beyond.

        Examples
        --------
        >>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
        >>> leaf, bark = vlscan.Material("leaf"), vlscan.Material("bark")
        >>> part = vlscan.Part.mesh(vertices, [[0, 1, 2], [0, 2, 3]], [leaf, bark], material_of=[0, 1])
        """
        points = np.asarray(unmasked("vertices", vertices), dtype="<f8")
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"vertices has the shape {points.shape}, expected n by 3")
        corners = unmasked("faces", faces)
        if corners.ndim != 2 or corners.shape[1] not in (3, 4):
            raise ValueError(f"faces has the shape {corners.shape}, expected n by 3 or n by 4")
        if corners.size and corners.dtype.kind not in "iu":
            raise ValueError(f"faces has the type {corners.dtype}, expected whole numbers")
        if corners.size and (corners.min() < 0 or corners.max() >= len(points)):
            raise ValueError(f"faces has indices beyond the {len(points)} vertices")
        known = _materials(materials)
        if len(known) > 1 and material_of is None:
            raise ValueError(f"there are {len(known)} materials, expected material_of with the index of the one of each face")
        index = np.asarray([] if material_of is None else material_of)
        if index.size and index.shape != (len(corners),):
            raise ValueError(f"material_of has the shape {index.shape}, expected an index per face, ({len(corners)},)")
        index = _indices("material_of", index, len(known), "materials")
        count, per_face = len(corners), corners.shape[1] - 2
        if per_face == 2:
            corners = corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
            index = np.repeat(index, 2)
        made = _vlscan.Mesh(
            points.tobytes(),
            corners.astype("<u4").tobytes(),
            [fields_of(material) for material in known],
            index.tobytes(),
        )
        return Part("of_mesh", (made,), _Place(id=id), (count, per_face))

    @staticmethod
    def of(
        mesh: MeshWithFaces | MeshWithTriangles,
        materials: Material | Iterable[Material] | None = None,
        material_of: ArrayLike | None = None,
        id: str | None = None,
    ) -> Part:
        """Make a part of a mesh of another library.

        Parameters
        ----------
        mesh : object
            Anything with ``vertices`` and ``faces`` (trimesh) or ``triangles`` (Open3D), or a ``trimesh.Scene`` of such meshes.
        materials : Material or iterable of Material, optional
            As in :meth:`mesh`.
        material_of : array_like, optional
            As in :meth:`mesh`.
        id : str, optional
            What the column ``ObjectId`` reports.

        Returns
        -------
        Part
            The part.

        Raises
        ------
        TypeError
            The object has no vertices and faces.
        """
        if hasattr(mesh, "geometry") and hasattr(mesh, "dump"):
            # A scene of trimesh, whose meshes are placed and joined.
            mesh = mesh.to_mesh() if hasattr(mesh, "to_mesh") else mesh.dump(concatenate=True)
        faces = getattr(mesh, "faces", None)
        faces = getattr(mesh, "triangles", None) if faces is None else faces
        if faces is None or not hasattr(mesh, "vertices"):
            raise TypeError(f"{type(mesh).__name__} has no vertices and faces")
        return Part.mesh(np.asarray(mesh.vertices), np.asarray(faces), materials, material_of, id)

    @staticmethod
    def obj(path: PathLike, up: str | None = None, id: str | None = None) -> Part:
        """Make a part of a Wavefront OBJ file and the materials that it names.

        Parameters
        ----------
        path : str or path-like
            The file.
        up : str, optional
            The axis that points up, ``z`` (the default) or ``y``.
        id : str, optional
            What the column ``ObjectId`` reports.

        Returns
        -------
        Part
            The part, which is read when its scene is loaded.
        """
        return Part.mesh_file(path, up, id=id)

    @staticmethod
    def mesh_file(
        path: PathLike,
        up: str | None = None,
        unit: str | float | None = None,
        materials: PathLike | None = None,
        id: str | None = None,
    ) -> Part:
        """Make a part of a mesh file: OBJ, PLY, STL or glTF (``.gltf``, ``.glb``).

        Parameters
        ----------
        path : str or path-like
            The file.
        up : str, optional
            The axis that points up, ``z`` or ``y``; by default that of the format, y for glTF and z for the others.
        unit : str or float, optional
            Unit of its coordinates: m (the default, of which a mesh of improbable size is warned), cm, mm, km, ft, us-ft, in,
            or a number of metres.
        materials : str or path-like, optional
            A table of materials (docs/scenes.md).
        id : str, optional
            What the column ``ObjectId`` reports.

        Returns
        -------
        Part
            The part, which is read when its scene is loaded.

        Raises
        ------
        ValueError
            ``up`` is another axis.
        """
        if up not in (None, "y", "z"):
            raise ValueError(f"up is {up!r}, expected 'y' or 'z'")
        table = None if materials is None else os.fspath(materials)
        return Part("of_mesh_file", (os.fspath(path), up, None if unit is None else str(unit), table), _Place(id=id))

    @staticmethod
    def raster(
        path: PathLike | Iterable[PathLike],
        material_file: PathLike | None = None,
        material: str | None = None,
        id: str | None = None,
    ) -> Part:
        """Make a part of a terrain raster (GeoTIFF), or of many that are tiles of one grid.

        Parameters
        ----------
        path : str or path-like, or an iterable of them
            The file; a virtual raster of GDAL (``.vrt``); a folder of tiles, or a pattern such as ``dem/*.tif``; or the tiles. Where
            tiles overlap, later ones count where they have data.
        material_file : str or path-like, optional
            An MTL file.
        material : str, optional
            Name of the material in that file; the alphabetically first by default.
        id : str, optional
            What the column ``ObjectId`` reports.

        Returns
        -------
        Part
            The part, which is read when its scene is loaded.
        """
        paths = [path] if isinstance(path, (str, os.PathLike)) else list(path)
        return Part("of_raster", ([os.fspath(p) for p in paths], _choice(material_file, material)), _Place(id=id))

    @staticmethod
    @renamed(path="source")
    def points(
        source: PathLike | ArrayLike,
        voxel_size: float,
        separator: str = "",
        normal_columns: tuple[int, int, int] | None = None,
        rgb_columns: tuple[int, int, int] | None = None,
        max_color_value: float = 255.0,
        default_normal: tuple[float, float, float] | None = None,
        estimate_normals: int = 0,
        snap_neighbor_normal: bool = False,
        material_file: PathLike | None = None,
        material: str | None = None,
        id: str | None = None,
    ) -> Part:
        """Make a part of a point cloud, whose points become voxels.

        Parameters
        ----------
        source : str, path-like, array_like or object
            A file, rows of x, y, z (m) and more columns, or an object with ``xyz``, such as :class:`Points` or that of laspy.
        voxel_size : float
            Edge of the voxels, m.
        separator : str
            Characters each of which separates columns; blanks by default.
        normal_columns, rgb_columns : tuple of int, optional
            Columns of the normal and of the colour, from 0; by default 3 to 5 and 6 to 8 of arrays and text that have them.
        max_color_value : float
            Value that colours are divided by.
        default_normal : tuple of float, optional
            Normal of points that have none.
        estimate_normals : int
            0: none; 1: normals by a plane through the points of each voxel; 2 and more: in batches.
        snap_neighbor_normal : bool
            Whether a voxel has the normal of the point nearest to its centre, instead of their mean.
        material_file : str or path-like, optional
            An MTL file.
        material : str, optional
            Name of the material in that file; the alphabetically first by default.
        id : str, optional
            What the column ``ObjectId`` reports.

        Returns
        -------
        Part
            The part, which is read when its scene is loaded.

        Raises
        ------
        ValueError
            An array of another shape or with coordinates that are not finite, or voxels of no size.

        Examples
        --------
        >>> cloud = vlscan.Part.points([[0, 0, 0], [1, 0, 0], [0, 1, 2]], voxel_size=0.5)
        >>> vlscan.Scene(cloud).primitives
        3
        """
        if not 0 < float(voxel_size) < math.inf:
            raise ValueError(f"voxel_size is {voxel_size}, expected metres above 0")
        is_file = isinstance(source, (str, os.PathLike))
        path = os.fspath(source) if is_file else PointFile.of(source)  # type: ignore[arg-type]
        settings = dict(
            voxel_size=float(voxel_size),
            separator=separator,
            normal_columns=normal_columns,
            rgb_columns=rgb_columns,
            max_color_value=float(max_color_value),
            default_normal=default_normal,
            estimate_normals=operator.index(estimate_normals),
            snap_neighbor_normal=bool(snap_neighbor_normal),
        )
        return Part("of_points", (path, settings, _choice(material_file, material)), _Place(id=id))

    @staticmethod
    def voxels(
        path: PathLike,
        mode: str = "transmittive",
        exponent: float = 0.5,
        random_shift: bool = False,
        leaf_angles: PathLike | None = None,
        material_file: PathLike | None = None,
        material: str | None = None,
        id: str | None = None,
        drop_empty: bool = True,
    ) -> Part:
        """Make a part of vegetation voxels (AMAPVox).

        Parameters
        ----------
        path : str or path-like
            The file.
        mode : str
            ``transmittive`` (rays pass leaves by chance), ``fixed`` (opaque cubes) or ``scaled`` (opaque cubes, scaled by the
            density to the power of ``exponent``).
        exponent : float
            The exponent.
        random_shift : bool
            Whether scaled cubes are moved within their cells.
        leaf_angles : str or path-like, optional
            A table of leaf angles.
        material_file : str or path-like, optional
            An MTL file.
        material : str, optional
            Name of the material in that file; the alphabetically first by default.
        id : str, optional
            What the column ``ObjectId`` reports.
        drop_empty : bool
            Whether voxels without vegetation are left out.

        Returns
        -------
        Part
            The part, which is read when its scene is loaded.
        """
        settings = dict(
            mode=mode,
            exponent=float(exponent),
            drop_empty=bool(drop_empty),
            random_shift=bool(random_shift),
            lad_table=None if leaf_angles is None else os.fspath(leaf_angles),
        )
        return Part("of_voxels", (os.fspath(path), settings, _choice(material_file, material)), _Place(id=id))

    @staticmethod
    def file(path: PathLike, id: str | None = None, **settings: Any) -> Part:
        """Make a part of a file, whose extension tells the format.

        Parameters
        ----------
        path : str or path-like
            A file that ends in ``.obj``, ``.ply``, ``.stl``, ``.gltf``, ``.glb``, ``.tif``, ``.vrt`` or ``.vox``; or a folder of tiles
            of a raster.
        id : str, optional
            What the column ``ObjectId`` reports.
        **settings : Any
            Keywords of :meth:`mesh_file`, :meth:`raster` or :meth:`voxels`.

        Returns
        -------
        Part
            The part, which is read when its scene is loaded.

        Raises
        ------
        ValueError
            The extension tells no format.

        Examples
        --------
        >>> vlscan.Scene([vlscan.Part.file("fixtures/forest/beech.obj", up="y")]).primitives > 100
        True
        """
        extension = os.path.splitext(os.fspath(path))[1].lower()
        meshes = (".obj", ".ply", ".stl", ".gltf", ".glb")
        makers: dict[str, Callable[..., Part]] = dict.fromkeys(meshes, Part.mesh_file)
        makers |= {".tif": Part.raster, ".tiff": Part.raster, ".vrt": Part.raster, ".vox": Part.voxels}
        if extension not in makers and os.path.isdir(path):
            return Part.raster(path, id=id, **settings)
        if extension not in makers:
            raise ValueError(f"{os.fspath(path)}: expected a file that ends in {', '.join(makers)}")
        return makers[extension](path, id=id, **settings)

    @overload
    def translate(self, x: float, y: float, z: float = 0.0) -> Part: ...
    @overload
    def translate(self, x: Vector) -> Part: ...
    def translate(self, x: float | Vector, y: float | None = None, z: float = 0.0) -> Part:
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
        numbers = np.asarray(x if y is None and not z else (x, y, z), float)
        if numbers.shape != (3,) or not np.isfinite(numbers).all():
            raise ValueError(f"a translation is {numbers.tolist()}, expected three finite numbers: x, y and z")
        way = numbers.tolist()
        old_x, old_y, old_z = self._place.offset
        return self._placed(offset=(old_x + way[0], old_y + way[1], old_z + way[2]))

    def scale(self, factor: float) -> Part:
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
        if not (math.isfinite(factor) and factor > 0):
            raise ValueError(f"a scale is {factor}, expected a number above 0")
        x, y, z = self._place.offset
        factor = float(factor)
        return self._placed(scale=self._place.scale * factor, offset=(x * factor, y * factor, z * factor))

    def rotate(self, axis: Vector, angle_deg: float) -> Part:
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
        direction = np.asarray(axis, float)
        length = np.linalg.norm(direction)
        if direction.shape != (3,) or not 0 < length < math.inf:
            raise ValueError(f"an axis is {axis}, expected three finite numbers that are not all 0")
        if not math.isfinite(angle_deg):
            raise ValueError(f"an angle is {angle_deg}, expected a finite number of degrees")
        half = math.radians(angle_deg) / 2
        return self.turn((math.cos(half), *(direction / length * math.sin(half))))

    def turn(self, quaternion: Vector) -> Part:
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
        q = np.asarray(quaternion, float)
        if q.shape != (4,) or not 0 < np.linalg.norm(q) < math.inf:
            raise ValueError(f"a quaternion is {quaternion}, expected finite numbers w, x, y, z that are not all 0")
        w, x, y, z = (q / np.linalg.norm(q)).tolist()
        unit = (w, x, y, z)
        return self._placed(quaternion=_product(unit, self._place.quaternion), offset=_turned(unit, self._place.offset))

    def drop_to_ground(self, on_ground: bool | int = True) -> Part:
        """Return the part lowered, or lifted, to the ground below it: to surfaces whose material is ground.

        Parameters
        ----------
        on_ground : bool or int
            Whether it is; or the mode ``onGround`` of scene files, where -1 looks for the best position.

        Returns
        -------
        Part
            The part, which shares the geometry.
        """
        return self._placed(on_ground=int(on_ground))

    def with_material(self, material: Material, of: str | ArrayLike | None = None) -> Part:
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
        chosen = np.atleast_1d(np.asarray(of))
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

    def named(self, id: str) -> Part:
        """Return the part with an id.

        Parameters
        ----------
        id : str
            What the column ``ObjectId`` reports.

        Returns
        -------
        Part
            The part, which shares the geometry.
        """
        return self._placed(id=None if id is None else str(id))

    @property
    def id(self) -> str | None:
        """What the column ``ObjectId`` reports, if the part was named."""
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

        Those of arrays are as given. Material files are read: OBJ files name their own, and rasters, points and voxels have one
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
        from .scene import Scene

        plain = Part(self._kind, self._arguments, _Place())
        loaded = Scene([plain]).materials
        return {name: FileMaterial(name, reflectance=share, classification=kind) for name, (share, kind) in loaded.items()}

    @property
    def face_count(self) -> int | None:
        """Number of faces of a part of arrays; ``None`` for one of a file, which is not read yet."""
        return self._faces[0] if self._faces else None

    def _placed(self, **changes: Any) -> Part:
        part = Part(self._kind, self._arguments, replace(self._place, **changes), self._faces)
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
        if not isinstance(other, Part):
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


def _indices(name: str, values: NDArray[Any], count: int, things: str) -> NDArray[np.uint32]:
    """Return indices from 0 to ``count`` - 1 as unsigned integers of 32 bits.

    Other numbers would become one of these, so that they are refused: fractions, NaN, and those beyond.
    """
    if values.size == 0:
        return np.zeros(values.shape, np.dtype("<u4"))
    if values.dtype.kind not in "iuf" or not np.all(values == np.floor(values)):
        raise ValueError(f"{name} holds {_first(values)} of the type {values.dtype}, expected whole numbers")
    if values.min() < 0 or values.max() >= count:
        raise ValueError(f"{name} has indices from {values.min()} to {values.max()}, and there are {count} {things}")
    return values.astype(np.dtype("<u4"))


def _first(values: NDArray[Any]) -> object:
    """Return the first value that is not a whole number."""
    numeric = values.dtype.kind == "f"
    return values[values != np.floor(values)][0] if numeric else values.flat[0]


def _materials(materials: object) -> list[Material]:
    """Return materials as a list; one may stand alone."""
    if materials is None or isinstance(materials, Material):
        return [] if materials is None else [materials]
    if isinstance(materials, str) or not isinstance(materials, Iterable):
        raise TypeError(f"materials are Material, one or several, found {materials!r}")
    return list(materials)


def parts_of(scene: _vlscan.Scene) -> list[Part]:
    """Return the parts that the file of a scene describes."""
    found = []
    for kind, arguments, (id, quaternion, scale, offset, on_ground) in _vlscan.parts_of_scene(scene):
        found.append(Part(kind, arguments, _Place(quaternion, scale, offset, on_ground, id)))
    return found


def _choice(file: PathLike | None, name: str | None) -> dict[str, str | None]:
    return dict(file=None if file is None else os.fspath(file), name=name)


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
