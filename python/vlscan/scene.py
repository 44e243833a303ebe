"""Scenes: what is scanned."""

from __future__ import annotations

import html
import json
import operator
import os
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _toml, _vlscan
from ._arguments import real, reals, whole
from ._libraries import refuse_existing
from ._notebook import picture_html, show_page
from ._typing import Displayed, PathLike, SceneFacts
from ._values import values_of
from .instruments import Scanner
from .parts import Part, parts_of
from .places import asset_folders, place_of, working_folder
from .points import Points

if TYPE_CHECKING:
    from collections.abc import Mapping

    from typing_extensions import Unpack

    from ._options import RunOptions

Loaded = TypeVar("Loaded")

# A scanner, for loading a scene before any survey is known: its wavelength matters where materials have spectra.
_DEFAULT_SCANNER = "data/scanners_tls.xml#riegl_vz400"


class RayHits(NamedTuple):
    """First hits of rays, one row per ray.

    Parameters
    ----------
    distance : numpy.ndarray
        Distance from the origin, m; NaN without a hit.
    part : numpy.ndarray
        Index in :attr:`Scene.parts`; -1 without a hit.
    primitive : numpy.ndarray
        Number of the triangle or voxel, in the order of the parts; voxels follow the triangles; -1 without a hit.
    normal : numpy.ndarray
        Unit normals of the surfaces towards the origins, n by 3; NaN without a hit.
    """

    distance: NDArray[np.float64]
    part: NDArray[np.int32]
    primitive: NDArray[np.int64]
    normal: NDArray[np.float64]


class SceneGeometry(NamedTuple):
    """Primitives of a scene in the world frame, m: triangles, then voxels, each in the order of their numbers.

    Parameters
    ----------
    vertices : numpy.ndarray
        Vertices of the triangles, n by 3.
    triangles : numpy.ndarray
        Rows in ``vertices`` of the three corners of each triangle.
    voxel_centres : numpy.ndarray
        Centres of the voxels, n by 3.
    voxel_edges : numpy.ndarray
        Edge lengths of the voxels.
    primitive : numpy.ndarray
        Number of each triangle, then of each voxel, as in :attr:`RayHits.primitive` and the column ``Primitive``.
    part : numpy.ndarray
        Index in :attr:`Scene.parts` of each triangle, then of each voxel.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.uint32]
    voxel_centres: NDArray[np.float64]
    voxel_edges: NDArray[np.float64]
    primitive: NDArray[np.int64]
    part: NDArray[np.int32]


class Scene:
    """The geometry that is scanned.

    The scene and the tree over it are loaded by the first run, or by :meth:`load`, and shared by all later ones. Scenes pickle
    without what is loaded: a process that gets one loads it again.

    Parameters
    ----------
    source : str, path-like, Part or iterable of Part
        Parts, or a file: a scene of HELIOS++ (``scene.xml#id``), an OBJ file, a GeoTIFF, AMAPVox voxels, a table of instances
        (``.csv``) or a packed scene (``.vlscene``).
    assets : iterable of str or path-like
        Folders in which files are searched.

    Raises
    ------
    InputError
        A file that is missing or no scene.
    TypeError
        Anything but a file or parts.

    Examples
    --------
    >>> scene = vlscan.Scene("fixtures/room/scene.xml")
    >>> scene.is_loaded, len(scene.parts) > 1, scene.is_loaded
    (False, True, True)
    """

    def __init__(self, source: PathLike | Part | Iterable[Part], assets: Iterable[PathLike] = ()) -> None:
        self._assets = [os.fspath(folder) for folder in assets]
        self._source: str | list[Part] = os.fspath(source) if isinstance(source, (str, os.PathLike)) else _parts(source)
        self._name = self._source if isinstance(self._source, str) else f"{len(self._source)} parts"
        # Working directories: in which files were named, and for which the engine has the scene.
        self._folder = self._engine_folder = working_folder()
        self._engine = self._made()

    def _made(self) -> _vlscan.Scene:
        folders = [*(place_of(folder, self._folder) for folder in self._assets), *asset_folders(self._folder)]
        if isinstance(self._source, str):
            return _vlscan.Scene.read(place_of(self._source, self._folder), folders)
        return _vlscan.Scene.of_parts([part._made() for part in self._source], [*folders, ".", "assets"])

    @property
    def _scene(self) -> _vlscan.Scene:
        """The scene of the engine, which reads the files that were named even if the working directory has changed."""
        if self._engine_folder != working_folder() and not self._engine.is_loaded:
            self._engine, self._engine_folder = self._made(), working_folder()
        return self._engine

    def load(self, scanner: str | None = None, **options: Unpack[RunOptions]) -> Scene:
        """Load scene and tree now.

        Parameters
        ----------
        scanner : str, optional
            Name of the scanner; materials with spectra depend on its wavelength.
        **options : RunOptions
            Options of :meth:`vlscan.Survey.run`, of which those of input files and of the tree matter.

        Returns
        -------
        Scene
            The scene itself.

        Raises
        ------
        InputError
            A file of the scene is invalid.
        FileError
            A file of the scene cannot be read.
        """
        self._scene.load(*_loading(scanner, options, Scene.load))
        return self

    def pack(self, path: PathLike, scanner: str | None = None, **options: Unpack[RunOptions]) -> None:
        """Write scene and tree to a packed scene, which :class:`Scene` opens without loading.

        Parameters
        ----------
        path : str or path-like
            The file, ``.vlscene``.
        scanner : str, optional
            As for :meth:`load`.
        **options : RunOptions
            As for :meth:`load`; ``force`` replaces a file that exists. With columns of colours
            (``columns=["Red", "Green", "Blue"]``) the colours of surfaces are packed, too.

        Raises
        ------
        InputError
            The file exists, or a file of the scene is invalid.
        FileError
            A file cannot be read or written.
        """
        refuse_existing(os.fspath(path), bool(options.get("force")))
        self._scene.pack(os.fspath(path), *_loading(scanner, options, Scene.pack))

    def unload(self) -> None:
        """Free the memory of scene and tree; the next run loads them again."""
        self._scene.unload()

    def read_parts(self) -> list[Part]:
        """Return the parts as they were given, or as the scene's file describes them: other scenes can have them, moved and changed.

        Returns
        -------
        list of Part
            The parts, one for each file that is loaded; none of a packed scene. Parts that move or are swapped, with random
            materials, and instances of tables cannot be in other scenes, see :attr:`Part.only_in_scene`.

        Examples
        --------
        >>> parts = vlscan.Scene("fixtures/room/scene.xml").read_parts()
        >>> shelf = next(part for part in parts if part.id == "1")
        >>> vlscan.Scene([shelf.translate(0, 0, 1)]).primitives > 0
        True
        """
        return parts_of(self._scene) if isinstance(self._source, str) else list(self._source)

    @property
    def is_loaded(self) -> bool:
        """True if scene and tree are in memory."""
        return self._scene.is_loaded

    def _facts(self) -> SceneFacts:
        facts = self._scene.facts()
        return _present(self.load()._scene.facts() if facts is None else facts)

    @property
    def bounds(self) -> NDArray[np.float64]:
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

    def info(self) -> dict[str, Any]:
        """Return all facts of the scene, as ``vlscan scene info --json`` writes them. Loads the scene.

        Returns
        -------
        dict
            Primitives, bounds, memory, faults, and lists of the parts (with class, materials, position and height) and of the materials.

        Examples
        --------
        >>> facts = vlscan.Scene("fixtures/room/scene.xml").info()
        >>> facts["triangles"] > 100, {"id", "materials", "height_m"} <= set(facts["parts"][0])
        (True, True)
        """
        self._facts()
        facts: dict[str, Any] = json.loads(_present(self._scene.report()))
        del facts["seconds"]
        return facts

    @property
    def memory(self) -> int:
        """Memory of scene and tree, bytes. Loads the scene."""
        return self._facts()[4]

    def ground_height(self, x: float, y: float) -> float | None:
        """Return the height of the ground. Loads the scene.

        Parameters
        ----------
        x, y : float
            The place, world frame, m.

        Returns
        -------
        float or None
            The height, world frame, m; ``None`` where there is no ground.

        Examples
        --------
        >>> soil = vlscan.Material("soil", is_ground=True)
        >>> field = vlscan.Part.mesh([[-9, -9, 2], [9, -9, 2], [9, 9, 2], [-9, 9, 2]], [[0, 1, 2, 3]], soil)
        >>> vlscan.Scene(field).ground_height(1, 1)
        2.0
        """
        self._facts()
        return self._scene.ground_height(real("x", x), real("y", y))

    def cast(self, origins: ArrayLike, directions: ArrayLike) -> RayHits:
        """Return the first hits of rays, without an instrument. Loads the scene. :func:`vlscan.trace` measures with one.

        Parameters
        ----------
        origins : array_like
            Origins of the rays, n by 3, world frame, m, or one for all.
        directions : array_like
            Directions of the rays, n by 3, of any length, or one for all. Rays without a direction, and those that are not finite,
            hit nothing.

        Returns
        -------
        RayHits
            Arrays ``distance``, ``part``, ``primitive`` and ``normal``, read-only.

        Raises
        ------
        ValueError
            Origins or directions have another shape.
        InputError
            A part of the scene moves, or the scene is not in memory as a whole.

        Examples
        --------
        >>> floor = vlscan.Part.mesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2, 3]], id="floor")
        >>> scene = vlscan.Scene(floor)
        >>> hits = scene.cast([[0, 1, 5], [99, 0, 5]], (0, 0, -1))
        >>> hits.distance.tolist(), [scene.parts[part] for part in hits.part if part >= 0]
        ([5.0, nan], ['floor'])
        """
        starts, ways = rays_of(origins, directions)
        self._facts()
        found = _present(self._scene.cast(*(rays.astype("<f8", copy=False).tobytes() for rays in (starts, ways))))
        distance, part, primitive, normal = (np.asarray(column) for column in found)
        return RayHits(distance, part, primitive, normal.reshape(-1, 3))

    def geometry(self, part: int | str | None = None) -> SceneGeometry:
        """Return the triangles and voxels of the scene, or of one part. Loads the scene.

        Parameters
        ----------
        part : int or str, optional
            Index or id of a part, as in :attr:`parts`; the first one of an id. All parts by default.

        Returns
        -------
        SceneGeometry
            Arrays, read-only. Moving parts are in their initial pose.

        Raises
        ------
        IndexError
            There is no part with the index.
        ValueError
            There is no part with the id.
        InputError
            The scene is not in memory as a whole.

        Examples
        --------
        >>> wall = vlscan.Part.mesh([[-9, 5, 0], [9, 5, 0], [9, 5, 4], [-9, 5, 4]], [[0, 1, 2, 3]], id="wall")
        >>> scene = vlscan.Scene(wall.translate(0, 1, 0))
        >>> geometry = scene.geometry("wall")
        >>> geometry.vertices[geometry.triangles].mean(axis=1).round(3).tolist()
        [[3.0, 6.0, 1.333], [-3.0, 6.0, 2.667]]
        """
        self._facts()
        found = _present(_vlscan.scene_geometry(self._scene, None if part is None else self._index_of(part)))
        vertices, triangles, centres, edges, primitive, of_part = (np.asarray(column) for column in found)
        return SceneGeometry(vertices.reshape(-1, 3), triangles.reshape(-1, 3), centres.reshape(-1, 3), edges, primitive, of_part)

    def _index_of(self, part: int | str) -> int:
        """Return the index of a part."""
        parts = self.parts
        if not isinstance(part, str):
            index = operator.index(part)
            if not -len(parts) <= index < len(parts):
                raise IndexError(f"index of a part is {index}, and there are {len(parts)} parts")
            return index % len(parts)
        if part in parts:
            return parts.index(part)
        shown = ", ".join(parts[:8]) + (" …" if len(parts) > 8 else "")
        raise ValueError(f"no part has the id {part!r}; there are {shown}")

    def sample(self, count: int = 200_000) -> Points:
        """Return points on the surfaces, evenly by area. Loads the scene.

        Parameters
        ----------
        count : int
            About how many.

        Returns
        -------
        Points
            The points.
        """
        self._facts()
        return Points(_present(self._scene.sample(whole("count", count, 0))))

    def show(self, colour: str = "height", max_points: int = 200_000) -> Displayed | None:
        """Show the scene as points on its surfaces: in a notebook as a view to turn around, otherwise in the browser.

        Parameters
        ----------
        colour : str
            ``height``, ``class``, ``intensity``, ``object`` or ``return``.
        max_points : int
            Number of points.

        Returns
        -------
        IPython.display.HTML or None
            The view, in a notebook.
        """
        return show_page(self.sample(max_points).html(colour, self._name, max_points))

    def __reduce__(self) -> tuple[Any, ...]:
        return Scene, (self._source, self._assets)

    def _repr_html_(self) -> str:
        about = f"{self._name}: {self.primitives:,} primitives, {len(self.parts)} parts"
        return picture_html(self.sample()._small_png, html.escape(about))

    def __repr__(self) -> str:
        return f"<Scene {self._name}>"


def _present(value: Loaded | None) -> Loaded:
    """Return what the engine has of a loaded scene."""
    if value is None:
        raise RuntimeError("the scene was unloaded by another thread")
    return value


def rays_of(origins: ArrayLike, directions: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return origins and directions of rays as arrays of n rows, where one of either may be for all.

    Parameters
    ----------
    origins, directions : array_like
        N by 3 numbers each, or three.

    Returns
    -------
    origins, directions : numpy.ndarray
        N by 3 numbers.

    Raises
    ------
    ValueError
        Arrays of another shape, or masked values.
    """
    starts, ways = (np.atleast_2d(reals(name, rays)) for name, rays in (("origins", origins), ("directions", directions)))
    try:
        starts, ways = np.broadcast_arrays(starts, ways)
        fits = ways.ndim == 2 and ways.shape[1] == 3
    except ValueError:
        fits = False
    if not fits:
        shapes = " and ".join(f"{name} of shape {np.shape(array)}" for name, array in (("origins", origins), ("directions", directions)))
        raise ValueError(f"expected origins and directions of n by 3 numbers each, or one of either for all; found {shapes}")
    return starts, ways


def _parts(source: object) -> list[Part]:
    """Return parts as a list."""
    advice = "Part.of() makes a part of a mesh of another library"
    if isinstance(source, Part):
        return [source]
    if not isinstance(source, Iterable) or hasattr(source, "vertices"):
        raise TypeError(f"a scene is a file or made of parts, found {type(source).__name__}; {advice}")
    parts = list(source)
    wrong = next((part for part in parts if not isinstance(part, Part)), None)
    if isinstance(wrong, (str, os.PathLike)):
        raise TypeError(f"a scene of several parts has {wrong!r}, expected Part; Part.file() makes one of a file")
    if wrong is not None:
        raise TypeError(f"a scene is made of parts, found {type(wrong).__name__}; {advice}")
    return parts


def _loading(scanner: str | None, options: Mapping[str, object], call: Callable[..., object]) -> tuple[str, dict[str, object]]:
    """Return the pipeline and the options with which a scene is loaded; ``call`` as for :func:`values_of`."""
    keys = Scanner(scanner or _DEFAULT_SCANNER).keys
    return _toml.document({"scanner": keys}), values_of(options, call)
