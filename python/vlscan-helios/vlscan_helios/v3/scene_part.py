"""Parts of scenes: geometry of files and arrays."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import NonNegativeFloat, NonNegativeInt, PositiveFloat, validate_call
from typing_extensions import Self

from vlscan.parts import Part
from vlscan.scene import Scene

from .materials import Material
from .placed_part import ARBITRARY, BoundingBox, PlacedPart
from .utils import classonlymethod, detect_separator, engine_directories, existing_file
from .validation import AssetPath, MultiAssetPath, R3Vector, existing_files

__all__ = ["BoundingBox", "ScenePart"]

# What points have by default: no normal, normals and colours behind the coordinates.
_NO_NORMAL: Any = np.full(3, np.finfo(np.float64).max)
_NORMALS, _COLOURS = (3, 4, 5), (6, 7, 8)


class ScenePart(PlacedPart):
    """Geometry, its materials, and where it stands: see the methods ``from_…``. Transforms change the part and return it."""

    @classonlymethod
    @validate_call
    def from_obj(cls, obj_file: AssetPath, up_axis: Literal["y", "z"] = "z") -> Self:
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

        Raises
        ------
        FileNotFoundError
            There is no such file.
        """
        path = os.fspath(obj_file)
        return cls.of_part(Part.obj(path, up_axis))

    @classonlymethod
    @validate_call
    def from_objs(cls, obj_files: MultiAssetPath, up_axis: Literal["y", "z"] = "z") -> list[Self]:
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
        FileNotFoundError
            No file matches.
        """
        return [cls.from_obj(path, up_axis) for path in obj_files]

    @classonlymethod
    @validate_call
    def from_tiff(cls, tiff_file: AssetPath) -> Self:
        """Make a part of a terrain raster.

        Parameters
        ----------
        tiff_file : str or path-like
            The file.

        Returns
        -------
        ScenePart
            The part.

        Raises
        ------
        FileNotFoundError
            There is no such file.
        """
        return cls.of_part(Part.raster(tiff_file))

    @classonlymethod
    @validate_call
    def from_tiffs(cls, tiff_files: MultiAssetPath) -> list[Self]:
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
        FileNotFoundError
            No file matches.
        """
        return [cls.from_tiff(path) for path in tiff_files]

    @classonlymethod
    @validate_call(config=ARBITRARY)
    def from_xyz(
        cls,
        xyz_file: AssetPath,
        voxel_size: PositiveFloat,
        separator: str | None = None,
        max_color_value: NonNegativeFloat = 0.0,
        default_normal: R3Vector = _NO_NORMAL,
        sparse: bool = True,
        estimate_normals: bool = False,
        normals_file_columns: Sequence[NonNegativeInt] = _NORMALS,
        rgb_file_columns: Sequence[NonNegativeInt] = _COLOURS,
        snap_neighbor_normal: bool = False,
    ) -> Self:
        """Make a part of a point cloud, whose points become voxels.

        Parameters
        ----------
        xyz_file : str or path-like
            The file.
        voxel_size : float
            Edge of the voxels, m.
        separator : str, optional
            Character between columns; detected by default.
        max_color_value : float
            Value that colours are divided by; 0 is 255.
        default_normal : array_like
            Normal of points that have none; the largest numbers mean no normal.
        sparse : bool
            Without effect: only voxels with points are stored.
        estimate_normals : bool
            True if normals are those of a plane through the points of each voxel.
        normals_file_columns, rgb_file_columns : sequence of int
            Columns of the normal and of the colour, from 0, where the file has so many.
        snap_neighbor_normal : bool
            True if a voxel has the normal of the point nearest to its centre.

        Returns
        -------
        ScenePart
            The part.

        Raises
        ------
        ValueError
            Columns that the file does not have.
        FileNotFoundError
            There is no such file.
        """
        xyz_file = Path(xyz_file)
        if separator is None:
            separator = "" if xyz_file.suffix.lower() in _BINARY_CLOUDS else detect_separator(xyz_file)
        count = 9 if separator == "" else _column_count(xyz_file, separator)
        if count < 3 and xyz_file.suffix.lower() not in _BINARY_CLOUDS:
            raise ValueError(f"{xyz_file} has no three columns between {separator!r}; its separator is {detect_separator(xyz_file)!r}")
        normals = _columns("normals_file_columns", normals_file_columns, normals_file_columns is _NORMALS, count)
        colours = _columns("rgb_file_columns", rgb_file_columns, rgb_file_columns is _COLOURS, count)
        settings = (max_color_value, default_normal, estimate_normals, snap_neighbor_normal)
        return cls.of_part(_cloud(xyz_file, voxel_size, separator, normals, colours, *settings))

    @classonlymethod
    def from_xyzs(
        cls,
        xyz_files: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
        voxel_size: float,
        separator: str | None = None,
        max_color_value: float = 0.0,
        default_normal: ArrayLike = _NO_NORMAL,
        sparse: bool = False,
        estimate_normals: bool = False,
        normals_file_columns: Sequence[int] = _NORMALS,
        rgb_file_columns: Sequence[int] = _COLOURS,
        snap_neighbor_normal: bool = False,
    ) -> list[Self]:
        """Make parts of point clouds.

        Parameters
        ----------
        xyz_files : str or iterable
            A pattern, or the files.
        voxel_size, separator, max_color_value, default_normal, sparse, estimate_normals : object
            As for :meth:`from_xyz`.
        normals_file_columns, rgb_file_columns, snap_neighbor_normal : object
            As for :meth:`from_xyz`.

        Returns
        -------
        list of ScenePart
            The parts.

        Raises
        ------
        FileNotFoundError
            No file matches.
        """
        columns: dict[str, Any] = {} if normals_file_columns is _NORMALS else {"normals_file_columns": normals_file_columns}
        columns |= {} if rgb_file_columns is _COLOURS else {"rgb_file_columns": rgb_file_columns}
        settings = (voxel_size, separator, max_color_value, default_normal, sparse, estimate_normals)
        return [cls.from_xyz(path, *settings, snap_neighbor_normal=snap_neighbor_normal, **columns) for path in existing_files(xyz_files)]

    @classonlymethod
    @validate_call
    def from_vox(
        cls,
        vox_file: AssetPath,
        intersection_mode: Literal["scaled", "fixed", "transmittive"] = "transmittive",
        intersection_argument: float | None = None,
        random_shift: bool = False,
        ladlut_path: AssetPath | None = None,
    ) -> Self:
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
            True if scaled cubes are moved within their cells.
        ladlut_path : str or path-like, optional
            A table of leaf angles.

        Returns
        -------
        ScenePart
            The part.

        Raises
        ------
        FileNotFoundError
            There is no such file.
        """
        exponent = 0.5 if intersection_argument is None else intersection_argument
        return cls.of_part(Part.voxels(vox_file, intersection_mode, exponent, random_shift, ladlut_path))

    @classonlymethod
    @validate_call(config=ARBITRARY)
    def from_numpy_array(
        cls,
        points: Any,
        voxel_size: PositiveFloat,
        *,
        normals_file_columns: Sequence[NonNegativeInt] | None = None,
        rgb_file_columns: Sequence[NonNegativeInt] | None = None,
        max_color_value: NonNegativeFloat = 0.0,
        default_normal: R3Vector = _NO_NORMAL,
        sparse: bool = True,
        estimate_normals: bool = False,
        snap_neighbor_normal: bool = False,
    ) -> Self:
        """Make a part of an array of points, which become voxels. :meth:`from_mesh` takes triangles.

        Parameters
        ----------
        points : array_like
            A row of x, y, z (m) for each point, and more columns.
        voxel_size : float
            Edge of the voxels, m.
        normals_file_columns, rgb_file_columns : sequence of int, optional
            Columns of the normal and of the colour, from 0; none by default.
        max_color_value, default_normal, sparse, estimate_normals, snap_neighbor_normal : object
            As for :meth:`from_xyz`.

        Returns
        -------
        ScenePart
            The part.

        Raises
        ------
        ValueError
            An array of another shape, or columns that it does not have.

        Examples
        --------
        >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
        >>> vlscan.helios.ScenePart.from_numpy_array(corners, 0.5).bbox.bounds[0].tolist()
        [0.0, 0.0, 0.0]
        """
        if np.ma.is_masked(points):
            raise ValueError("points has masked values; leave these rows out")
        rows = np.asarray(points)
        if rows.ndim != 2 or rows.shape[1] < 3 or not len(rows):
            raise ValueError(f"points has the shape {rows.shape}, expected n by 3 or more")
        normals = _columns("normals_file_columns", normals_file_columns, False, rows.shape[1])
        colours = _columns("rgb_file_columns", rgb_file_columns, False, rows.shape[1])
        settings = (max_color_value, default_normal, estimate_normals, snap_neighbor_normal)
        return cls.of_part(_cloud(rows, voxel_size, " ", normals, colours, *settings))

    @classonlymethod
    def from_mesh(cls, vertices: ArrayLike, faces: ArrayLike, material: Material | None = None) -> Self:
        """Make a part of triangles or quadrilaterals in memory; of vlscan.

        Parameters
        ----------
        vertices : array_like
            Coordinates, n by 3, m.
        faces : array_like
            Indices of vertices, m by 3 or m by 4.
        material : Material, optional
            The material.

        Returns
        -------
        ScenePart
            The part.

        Raises
        ------
        ValueError
            Arrays of another shape, or indices beyond.

        Examples
        --------
        >>> part = vlscan.helios.ScenePart.from_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> part.scale(2).bbox.bounds[1].tolist()
        [2.0, 2.0, 0.0]
        """
        own = (material or Material(name="default")).clone()
        return cls.of_part(Part.mesh(vertices, faces, own.engine()), {own.name or "default": own})

    @classonlymethod
    def from_open3d(cls, geometry: Any, **kwargs: Any) -> Self:
        """Make a part of a mesh or a point cloud of Open3D.

        Parameters
        ----------
        geometry : open3d.geometry.TriangleMesh or open3d.geometry.PointCloud
            The mesh, or the cloud, whose points become voxels.
        **kwargs : Any
            Of a mesh ``up_axis`` (``z`` or ``y``) and ``material``; of a cloud the keywords of :meth:`from_numpy_array`, such as
            ``voxel_size``.

        Returns
        -------
        ScenePart
            The part.

        Raises
        ------
        TypeError
            Another geometry, or unknown keywords.
        """
        if hasattr(geometry, "triangles") and hasattr(geometry, "vertices"):
            return cls._from_open3d_mesh(geometry, **kwargs)
        if not hasattr(geometry, "points"):
            raise TypeError(f"{type(geometry).__name__} is neither a triangle mesh nor a point cloud")
        rows, columns = np.asarray(geometry.points, float), {}
        normals = np.asarray(getattr(geometry, "normals", ()), float)
        if normals.shape == rows.shape:
            rows, columns = np.hstack([rows, normals]), {"normals_file_columns": [3, 4, 5]}
        return cls.from_numpy_array(rows, **{**columns, **kwargs})

    @classmethod
    def _from_open3d_mesh(cls, mesh: Any, up_axis: str = "z", material: Material | None = None) -> Self:
        if up_axis not in ("y", "z"):
            raise ValueError(f"up_axis is {up_axis!r}, expected 'y' or 'z'")
        if not len(mesh.triangles):
            raise ValueError("the mesh has no triangles")
        corners = np.asarray(mesh.vertices, float)
        if up_axis == "y":
            corners = np.column_stack([corners[:, 0], -corners[:, 2], corners[:, 1]])
        return cls.from_mesh(corners, np.asarray(mesh.triangles), material)

    @classonlymethod
    def from_xml(cls, scene_part_file: str | os.PathLike[str], id: int) -> ScenePart:
        """Return a part of a scene file.

        Parameters
        ----------
        scene_part_file : str or path-like
            The file.
        id : int
            Id of the part.

        Returns
        -------
        ScenePart
            The part.

        Raises
        ------
        ValueError
            No part has the id, or it is several files.
        NotImplementedError
            The part moves, is swapped, or has random materials.
        FileNotFoundError
            There is no such file.
        """
        file, mark, scene_id = os.fspath(scene_part_file).partition("#")
        scene = Scene(f"{existing_file(file)}{mark}{scene_id}", engine_directories())
        parts = scene.read_parts()
        found = [cls.of_scene(part, file) for part in parts if part.id == str(id)]
        if len(found) != 1:
            known = ", ".join(str(part.id) for part in parts)
            raise ValueError(f"{os.fspath(scene_part_file)} has {len(found)} parts with the id {id}, expected one; there are {known}")
        found[0].known_part()
        return found[0]


# Formats that tell their columns.
_BINARY_CLOUDS = (".las", ".laz", ".ply", ".pcd", ".e57", ".pts", ".ptx", ".arrow", ".parquet")


def _cloud(
    source: Path | NDArray[np.float64],
    voxel_size: float,
    separator: str,
    normals: tuple[int, int, int] | None,
    colours: tuple[int, int, int] | None,
    max_color_value: float,
    default_normal: Any,
    estimate_normals: bool,
    snap_neighbor_normal: bool,
) -> Part:
    return Part.points(
        source,
        voxel_size,
        separator="" if separator == " " else separator,
        normal_columns=normals,
        rgb_columns=colours,
        max_color_value=max_color_value or 255.0,
        default_normal=None if (default_normal == _NO_NORMAL).all() else tuple(default_normal.tolist()),
        estimate_normals=int(estimate_normals),
        snap_neighbor_normal=snap_neighbor_normal,
    )


def _column_count(path: Path, separator: str) -> int:
    with open(path, encoding="utf-8", errors="replace") as file:
        lines = (line.strip() for line in file)
        first = next((line for line in lines if line and not line.startswith(("#", "//"))), "")
    return len(first.split() if separator == " " else first.split(separator))


def _columns(name: str, columns: Sequence[int] | None, is_default: bool, count: int) -> tuple[int, int, int] | None:
    """Return three columns, or none for the default ones of a file that has fewer."""
    if columns is None or is_default and max(columns) >= count:
        return None
    if len(columns) != 3 or max(columns) >= count:
        raise ValueError(f"{name} is {list(columns)}, expected three of the columns 0 to {count - 1}")
    x, y, z = columns
    return x, y, z
