"""Scenes: what is scanned."""

from __future__ import annotations

import html
import math
import operator
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

import numpy as np

from . import _toml, _vlscan
from .tables import Points, picture_html, show_page

#: A file name.
PathLike = str | os.PathLike[str]

# A scanner, for loading a scene before any survey is known: its wavelength matters where materials have spectra.
_DEFAULT_SCANNER = {"catalogue": "data/scanners_tls.xml#riegl_vz400"}


@dataclass(frozen=True)
class Material:
    """How a surface reflects, and which class its points get."""

    name: str = "material"
    #: Reflectance, 0 to 1. ``None``: that of ``spectrum``, else 0.5.
    reflectance: float | None = None
    #: Class of the points, 0 to 255.
    classification: int = 0
    #: Name of a spectrum in a ``spectra`` folder of the assets; its reflectance at the scanner's wavelength.
    spectrum: str | None = None
    #: Whether legs, and parts on the ground, stand on it.
    is_ground: bool = False
    #: Diffuse colour; all 0 with no specular colour is a surface that reflects alike in all directions.
    diffuse: tuple[float, float, float] = (1.0, 1.0, 1.0)
    #: Specular colour.
    specular: tuple[float, float, float] = (0.0, 0.0, 0.0)
    #: Exponent of the specular lobe.
    specular_exponent: float = 10.0
    #: Roughness of the surface, 0 to 90 degrees; refined physics.
    roughness_deg: float = 0.0

    _USUAL_REFLECTANCE: ClassVar[float | None] = 0.5

    def __post_init__(self) -> None:
        self._check("reflectance", 1)
        self._check("roughness_deg", 90)
        self._check("classification", 255)

    def _check(self, name: str, highest: float) -> None:
        value = getattr(self, name)
        if value is not None and not 0 <= value <= highest:
            raise ValueError(f"{name} of the material {self.name!r} is {value}, expected 0 to {highest}")


@dataclass(frozen=True)
class _Place:
    """Where a part stands: ``p' = scale * rotation(p) + offset``."""

    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    scale: float = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    on_ground: int = 0
    id: str | None = None
    changes: _vlscan.Changes = _vlscan.Changes()

    def fields(self) -> dict[str, Any]:
        w, *vector = self.quaternion
        length = math.hypot(*vector)
        axis = [v / length for v in vector] if length > 0 else [0.0, 0.0, 1.0]
        angle = 2 * math.atan2(length, w)
        scale, offset = float(self.scale), [float(v) for v in self.offset]
        return dict(axis=axis, angle=angle, scale=scale, offset=offset, on_ground=int(self.on_ground), id=self.id, changes=self.changes)


def _product(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float, float]:
    """The quaternion of the rotation ``b``, then ``a``."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def _turned(q: Sequence[float], v: Sequence[float]) -> np.ndarray:
    w, axis, vector = q[0], np.asarray(q[1:], float), np.asarray(v, float)
    return vector + 2 * np.cross(axis, np.cross(axis, vector) + w * vector)


class Part:
    """A part of a scene: geometry and where it stands. Parts do not change; :meth:`translate` and the others return new ones,
    which share the geometry, so a thousand copies of a tree take the memory of one."""

    def __init__(self, kind: str, arguments: tuple[Any, ...], place: _Place, faces: tuple[int, int] | None = None) -> None:
        self._kind, self._arguments, self._place = kind, arguments, place
        # Number of faces and of triangles in each, if known.
        self._faces = faces

    @staticmethod
    def mesh(
        vertices: Any,
        faces: Any,
        materials: Material | Iterable[Material] | None = None,
        material_of: Any = None,
        id: str | None = None,
    ) -> Part:
        """A part of triangles (or quadrilaterals) in memory.

        ``vertices``: n by 3, m. ``faces``: indices of vertices, m by 3 or m by 4. ``materials``: one for all faces, or several,
        and ``material_of`` then is the index of the one of each face. ``id``: what the column ``ObjectId`` reports; a number by
        default.
        """
        points = np.asarray(vertices, dtype="<f8")
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"vertices has the shape {points.shape}, expected n by 3")
        corners = np.asarray(faces)
        if corners.ndim != 2 or corners.shape[1] not in (3, 4):
            raise ValueError(f"faces has the shape {corners.shape}, expected n by 3 or n by 4")
        if corners.size and corners.dtype.kind not in "iu":
            raise ValueError(f"faces has the type {corners.dtype}, expected whole numbers")
        if corners.size and (corners.min() < 0 or corners.max() >= len(points)):
            raise ValueError(f"faces has indices beyond the {len(points)} vertices")
        known = [materials] if isinstance(materials, Material) else list(materials or [])
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
            [_fields(material) for material in known],
            index.tobytes(),
        )
        return Part("of_mesh", (made,), _Place(id=id), (count, per_face))

    @staticmethod
    def of(
        mesh: Any, materials: Material | Iterable[Material] | None = None, material_of: Any = None, id: str | None = None
    ) -> Part:
        """A part of a mesh of another library: of anything with ``vertices`` and ``faces`` (trimesh) or ``triangles``
        (Open3D). ``materials`` and ``material_of``: as in :meth:`mesh`."""
        faces = getattr(mesh, "faces", None)
        faces = getattr(mesh, "triangles", None) if faces is None else faces
        if faces is None or not hasattr(mesh, "vertices"):
            raise TypeError(f"{type(mesh).__name__} has no vertices and faces")
        return Part.mesh(np.asarray(mesh.vertices), np.asarray(faces), materials, material_of, id)

    @staticmethod
    def obj(path: PathLike, up: str | None = None, id: str | None = None) -> Part:
        """A part of a Wavefront OBJ file and the materials that it names. ``up``: the axis that points up, ``z`` (the default) or ``y``."""
        return Part.mesh_file(path, up, id=id)

    @staticmethod
    def mesh_file(
        path: PathLike,
        up: str | None = None,
        unit: str | float | None = None,
        materials: PathLike | None = None,
        id: str | None = None,
    ) -> Part:
        """A part of a mesh file: OBJ, PLY, STL or glTF (``.gltf``, ``.glb``).

        ``up``: the axis that points up, ``z`` or ``y``; by default that of the format, y for glTF and z for the others. ``unit``
        of its coordinates: m (the default, of which a mesh of improbable size is warned), cm, mm, km, ft, us-ft, in, or a number of
        metres. ``materials``: a table of materials
        (docs/scenes.md).
        """
        if up not in (None, "y", "z"):
            raise ValueError(f"up is {up!r}, expected 'y' or 'z'")
        table = None if materials is None else os.fspath(materials)
        return Part("of_mesh_file", (os.fspath(path), up, None if unit is None else str(unit), table), _Place(id=id))

    @staticmethod
    def raster(
        path: PathLike, material_file: PathLike | None = None, material: str | None = None, id: str | None = None
    ) -> Part:
        """A part of a terrain raster (GeoTIFF); its material is one of an MTL file."""
        return Part("of_raster", (os.fspath(path), _choice(material_file, material)), _Place(id=id))

    @staticmethod
    def points(
        path: PathLike,
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
        """A part of a point cloud as text, whose points become voxels with edges of ``voxel_size`` (m). Columns count from 0."""
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
        return Part("of_points", (os.fspath(path), settings, _choice(material_file, material)), _Place(id=id))

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
    ) -> Part:
        """A part of vegetation voxels (AMAPVox).

        ``mode``: ``transmittive`` (rays pass leaves by chance), ``fixed`` (opaque cubes) or ``scaled`` (opaque cubes, scaled by
        the density to the power of ``exponent``; ``random_shift`` moves them within their cells).
        """
        settings = dict(
            mode=mode,
            exponent=float(exponent),
            drop_empty=True,
            random_shift=bool(random_shift),
            lad_table=None if leaf_angles is None else os.fspath(leaf_angles),
        )
        return Part("of_voxels", (os.fspath(path), settings, _choice(material_file, material)), _Place(id=id))

    @staticmethod
    def file(path: PathLike, id: str | None = None, **settings: Any) -> Part:
        """A part of a file; its extension tells the format: ``.obj``, ``.ply``, ``.stl``, ``.gltf``, ``.glb``, ``.tif``,
        ``.vox``. ``settings``: keywords of :meth:`mesh_file`, :meth:`raster` or :meth:`voxels`."""
        extension = os.path.splitext(os.fspath(path))[1].lower()
        meshes = (".obj", ".ply", ".stl", ".gltf", ".glb")
        makers: dict[str, Callable[..., Part]] = dict.fromkeys(meshes, Part.mesh_file)
        makers |= {".tif": Part.raster, ".tiff": Part.raster, ".vox": Part.voxels}
        if extension not in makers:
            raise ValueError(f"{os.fspath(path)}: expected a file that ends in {', '.join(makers)}")
        return makers[extension](path, id=id, **settings)

    def translate(self, x: float, y: float, z: float = 0.0) -> Part:
        """The part moved by metres."""
        return self._placed(offset=tuple(np.asarray(self._place.offset) + (x, y, z)))

    def scale(self, factor: float) -> Part:
        """The part scaled about the origin."""
        if not (math.isfinite(factor) and factor > 0):
            raise ValueError(f"a scale is {factor}, expected a number above 0")
        return self._placed(scale=self._place.scale * factor, offset=tuple(np.asarray(self._place.offset) * factor))

    def rotate(self, axis: Sequence[float], angle_deg: float) -> Part:
        """The part turned about an axis through the origin, right-handed."""
        direction = np.asarray(axis, float)
        length = np.linalg.norm(direction)
        if direction.shape != (3,) or not 0 < length < math.inf:
            raise ValueError(f"an axis is {axis}, expected three finite numbers that are not all 0")
        if not math.isfinite(angle_deg):
            raise ValueError(f"an angle is {angle_deg}, expected a finite number of degrees")
        half = math.radians(angle_deg) / 2
        return self.turn((math.cos(half), *(direction / length * math.sin(half))))

    def turn(self, quaternion: Sequence[float]) -> Part:
        """The part turned about the origin by a quaternion w, x, y, z."""
        q = np.asarray(quaternion, float)
        if q.shape != (4,) or not 0 < np.linalg.norm(q) < math.inf:
            raise ValueError(f"a quaternion is {quaternion}, expected finite numbers w, x, y, z that are not all 0")
        q = q / np.linalg.norm(q)
        offset = tuple(_turned(q, self._place.offset))
        return self._placed(quaternion=_product(q, self._place.quaternion), offset=offset)

    def drop_to_ground(self, on_ground: bool = True) -> Part:
        """The part lowered (or lifted) to the ground below it: to surfaces whose material is ground."""
        return self._placed(on_ground=1 if on_ground else 0)

    def with_material(self, material: Material, of: str | Any = None) -> Part:
        """The part with another material: of all faces, of those whose material has the name ``of``, or of those with the
        indices ``of``. Indices count the faces as they were given or as the file has them, from 0; a polygon is one, and voxels
        follow them. For a part of :meth:`mesh` ``of`` may be a mask, too. An index beyond is an error: of a mesh a ``ValueError``,
        of a file when the scene is loaded."""
        which = of
        if of is not None and not isinstance(of, str):
            indices, per_face = self._face_numbers(of), self._faces[1] if self._faces else 1
            # A quadrilateral is two triangles.
            triangles = (indices[:, None] * per_face + np.arange(per_face)).ravel()
            which = triangles.astype("<u4").tobytes()
        return self._placed(changes=self._place.changes.then(which, _fields(material)))

    def _face_numbers(self, of: Any) -> np.ndarray:
        """Indices of faces, which a mask or indices choose."""
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
        """The part with an id, which the column ``ObjectId`` reports."""
        return self._placed(id=id)

    def _placed(self, **changes: Any) -> Part:
        return Part(self._kind, self._arguments, replace(self._place, **changes), self._faces)

    def _made(self) -> _vlscan.Part:
        return getattr(_vlscan.Part, self._kind)(*self._arguments, self._place.fields())

    def __repr__(self) -> str:
        return f"<Part {self._kind.removeprefix('of_')} {self._place}>"


def _indices(name: str, values: np.ndarray, count: int, things: str) -> np.ndarray:
    """Indices from 0 to ``count`` - 1 as unsigned integers of 32 bits. Other numbers would become one of these, so that they are
    refused: fractions, NaN, and those beyond."""
    if values.size == 0:
        return np.zeros(values.shape, "<u4")
    if values.dtype.kind not in "iuf" or not np.all(values == np.floor(values)):
        raise ValueError(f"{name} holds {_first(values)} of the type {values.dtype}, expected whole numbers")
    if values.min() < 0 or values.max() >= count:
        raise ValueError(f"{name} has indices from {values.min()} to {values.max()}, and there are {count} {things}")
    return values.astype("<u4")


def _first(values: np.ndarray) -> Any:
    """The first value that is not a whole number."""
    numeric = values.dtype.kind == "f"
    return values[values != np.floor(values)][0] if numeric else values.flat[0]


def _fields(material: Material) -> dict[str, Any]:
    fields = asdict(material)
    if material.reflectance is None and material.spectrum is None:
        fields["reflectance"] = material._USUAL_REFLECTANCE
    for key in ("diffuse", "specular"):
        fields[key] = [float(v) for v in fields[key]]
    for key in ("specular_exponent", "roughness_deg"):
        fields[key] = float(fields[key])
    return fields


def _choice(file: PathLike | None, name: str | None) -> dict[str, Any]:
    return dict(file=None if file is None else os.fspath(file), name=name)


class Scene:
    """What is scanned.

    ``Scene("scene.xml#id")`` reads a scene of HELIOS++, an OBJ file, a GeoTIFF, AMAPVox voxels, a table of instances (``.csv``)
    or a packed scene (``.vlscene``); ``Scene([part, part])`` joins parts. The scene and the tree over it are loaded by the first
    run, or by :meth:`load`, and shared by all later ones.
    """

    def __init__(self, source: PathLike | Part | Iterable[Part], assets: Iterable[PathLike] = ()) -> None:
        folders = [os.fspath(folder) for folder in assets]
        if isinstance(source, (str, os.PathLike)):
            self._name = os.fspath(source)
            self._scene = _vlscan.Scene.read(self._name, folders)
        else:
            parts = [source] if isinstance(source, Part) else list(source)
            self._name = f"{len(parts)} parts"
            self._scene = _vlscan.Scene.of_parts([part._made() for part in parts], [*folders, ".", "assets"])

    def load(self, scanner: str | None = None, **options: Any) -> Scene:
        """Loads scene and tree now. Materials with spectra depend on the wavelength of the ``scanner``; ``options`` are those of
        :meth:`vlscan.Survey.run`."""
        self._scene.load(*self._loading(scanner, options))
        return self

    def _loading(self, scanner: str | None, options: dict[str, Any]) -> tuple[str, list[str]]:
        from .survey import Scanner, words_of

        keys = _DEFAULT_SCANNER if scanner is None else Scanner.of(scanner).keys
        return _toml.document({"scanner": keys}), words_of(options)

    def pack(self, path: PathLike, scanner: str | None = None, **options: Any) -> None:
        """Writes scene and tree to a packed scene (``.vlscene``), which is used without loading: :class:`Scene` opens it. The
        arguments are those of :meth:`load`."""
        self._scene.pack(os.fspath(path), *self._loading(scanner, options))

    def unload(self) -> None:
        """Frees the memory of scene and tree; the next run loads them again."""
        self._scene.unload()

    @property
    def is_loaded(self) -> bool:
        """Whether scene and tree are in memory."""
        return self._scene.is_loaded

    def _facts(self) -> tuple[Any, int, list[str], list[tuple[str, float, int]], int]:
        if not self.is_loaded:
            self.load()
        facts = self._scene.facts()
        assert facts is not None
        return facts

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest coordinates, world frame, m, as an array of two rows. Loads the scene."""
        return np.array(self._facts()[0])

    @property
    def primitives(self) -> int:
        """Number of triangles and voxels, those of instances included. Loads the scene."""
        return self._facts()[1]

    @property
    def parts(self) -> list[str]:
        """Ids of the parts, in the order of the column ``Part``. Loads the scene."""
        return self._facts()[2]

    @property
    def materials(self) -> dict[str, tuple[float, int]]:
        """Reflectance and class of the materials, by name. Loads the scene."""
        return {name: (reflectance, kind) for name, reflectance, kind in self._facts()[3]}

    @property
    def memory(self) -> int:
        """Memory of scene and tree, bytes. Loads the scene."""
        return self._facts()[4]

    def ground_height(self, x: float, y: float) -> float | None:
        """Height of the ground at (x, y), world frame, m; ``None`` where there is none. Loads the scene."""
        self._facts()
        return self._scene.ground_height(float(x), float(y))

    def sample(self, count: int = 200_000) -> Points:
        """About ``count`` points on the surfaces, evenly by area. Loads the scene."""
        self._facts()
        table = self._scene.sample(count)
        assert table is not None
        return Points(table)

    def show(self, colour: str = "height", max_points: int = 200_000) -> Any:
        """Shows the scene as points on its surfaces: in a notebook as a view to turn around, otherwise in the browser."""
        return show_page(self.sample(max_points).html(colour, self._name, max_points))

    def _repr_html_(self) -> str:
        about = f"{self._name}: {self.primitives:,} primitives, {len(self.parts)} parts"
        return picture_html(self.sample().png(width=1000, height=750), html.escape(about))

    def __repr__(self) -> str:
        return f"<Scene {self._name}>"
