"""Parts of scenes: geometry of arrays and files."""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _vlscan
from ._arguments import array_of, path_of, positive, real, reals, suggesting
from ._placed import Place, PlacedPart
from ._point_file import PointFile
from ._typing import MeshWithFaces, MeshWithTriangles, PathLike
from ._values import renamed
from .materials import Material, fields_of

# Modes of voxels.
_VOXEL_MODES = ("transmittive", "fixed", "scaled")


class Part(PlacedPart):
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
        Placement of the part.
    faces : tuple of int, optional
        Number of faces and of triangles in each, if known.

    Examples
    --------
    >>> floor = vlscan.Part.mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2, 3]])
    >>> vlscan.Scene([floor, floor.translate(0, 0, 3).named("ceiling")]).bounds[1].tolist()
    [9.0, 9.0, 3.0]
    """

    @staticmethod
    @suggesting
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
            Value of the column ``ObjectId``; a number by default.

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
        points = reals("vertices", vertices).astype("<f8", copy=False)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"vertices has the shape {points.shape}, expected n by 3")
        corners = array_of("faces", faces)
        if corners.ndim != 2 or corners.shape[1] not in (3, 4):
            raise ValueError(f"faces has the shape {corners.shape}, expected n by 3 or n by 4")
        if corners.size and corners.dtype.kind not in "iu":
            raise ValueError(f"faces has the type {corners.dtype}, expected whole numbers")
        if corners.size and (corners.min() < 0 or corners.max() >= len(points)):
            raise ValueError(f"faces has indices beyond the {len(points)} vertices")
        known = _materials(materials)
        if len(known) > 1 and material_of is None:
            raise ValueError(f"there are {len(known)} materials, expected material_of with the index of the one of each face")
        index = array_of("material_of", [] if material_of is None else material_of)
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
        return Part("of_mesh", (made,), Place(id=id), (count, per_face))

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
            Value of the column ``ObjectId``.

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
    @suggesting
    def obj(path: PathLike, up: str | None = None, id: str | None = None) -> Part:
        """Make a part of a Wavefront OBJ file and the materials that it names.

        Parameters
        ----------
        path : str or path-like
            The file.
        up : str, optional
            The axis that points up, ``z`` (the default) or ``y``.
        id : str, optional
            Value of the column ``ObjectId``.

        Returns
        -------
        Part
            The part, which is read when its scene is loaded.
        """
        return Part.mesh_file(path, up, id=id)

    @staticmethod
    @suggesting
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
            Value of the column ``ObjectId``.

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
        table = None if materials is None else path_of("materials", materials)
        return Part("of_mesh_file", (path_of("path", path), up, None if unit is None else str(unit), table), Place(id=id))

    @staticmethod
    @suggesting
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
            Value of the column ``ObjectId``.

        Returns
        -------
        Part
            The part, which is read when its scene is loaded.
        """
        paths = list(path) if isinstance(path, Iterable) and not isinstance(path, (str, bytes, os.PathLike)) else [path]
        if not paths:
            raise ValueError("path names no raster")
        return Part("of_raster", ([path_of("path", each) for each in paths], _choice(material_file, material)), Place(id=id))

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
            True if a voxel has the normal of the point nearest to its centre, instead of their mean.
        material_file : str or path-like, optional
            An MTL file.
        material : str, optional
            Name of the material in that file; the alphabetically first by default.
        id : str, optional
            Value of the column ``ObjectId``.

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
        voxel_size = positive("voxel_size", voxel_size, "metres")
        is_file = isinstance(source, (str, bytes, os.PathLike))
        path = os.fsdecode(source) if is_file else PointFile.of(source)  # type: ignore[arg-type]
        settings = dict(
            voxel_size=voxel_size,
            separator=separator,
            normal_columns=normal_columns,
            rgb_columns=rgb_columns,
            max_color_value=float(max_color_value),
            default_normal=default_normal,
            estimate_normals=operator.index(estimate_normals),
            snap_neighbor_normal=bool(snap_neighbor_normal),
        )
        return Part("of_points", (path, settings, _choice(material_file, material)), Place(id=id))

    @staticmethod
    @suggesting
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
            True if scaled cubes are moved within their cells.
        leaf_angles : str or path-like, optional
            A table of leaf angles.
        material_file : str or path-like, optional
            An MTL file.
        material : str, optional
            Name of the material in that file; the alphabetically first by default.
        id : str, optional
            Value of the column ``ObjectId``.
        drop_empty : bool
            True if voxels without vegetation are left out.

        Returns
        -------
        Part
            The part, which is read when its scene is loaded.

        Raises
        ------
        ValueError
            Another mode, or a negative exponent.
        """
        if mode not in _VOXEL_MODES:
            raise ValueError(f"mode is {mode!r}, expected {', '.join(map(repr, _VOXEL_MODES))}")
        exponent = real("exponent", exponent)
        if not 0 <= exponent < math.inf:
            raise ValueError(f"exponent is {exponent:g}, expected a number from 0: a negative one makes cubes larger than their cells")
        settings = dict(
            mode=mode,
            exponent=exponent,
            drop_empty=bool(drop_empty),
            random_shift=bool(random_shift),
            lad_table=None if leaf_angles is None else path_of("leaf_angles", leaf_angles),
        )
        return Part("of_voxels", (path_of("path", path), settings, _choice(material_file, material)), Place(id=id))

    @staticmethod
    def file(path: PathLike, id: str | None = None, **settings: Any) -> Part:
        """Make a part of a file, whose extension tells the format.

        Parameters
        ----------
        path : str or path-like
            A file that ends in ``.obj``, ``.ply``, ``.stl``, ``.gltf``, ``.glb``, ``.tif``, ``.vrt`` or ``.vox``; or a folder of tiles
            of a raster.
        id : str, optional
            Value of the column ``ObjectId``.
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
        path = path_of("path", path)
        extension = os.path.splitext(path)[1].lower()
        meshes = (".obj", ".ply", ".stl", ".gltf", ".glb")
        makers: dict[str, Callable[..., Part]] = dict.fromkeys(meshes, Part.mesh_file)
        makers |= {".tif": Part.raster, ".tiff": Part.raster, ".vrt": Part.raster, ".vox": Part.voxels}
        if extension not in makers and os.path.isdir(path):
            return Part.raster(path, id=id, **settings)
        if extension not in makers:
            raise ValueError(f"{path}: expected a file that ends in {', '.join(makers)}; Part.points() makes voxels of point clouds")
        return makers[extension](path, id=id, **settings)


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
        found.append(Part(kind, arguments, Place(quaternion, scale, offset, on_ground, id)))
    return found


def _choice(file: PathLike | None, name: str | None) -> dict[str, str | None]:
    return dict(file=None if file is None else os.fspath(file), name=name)
