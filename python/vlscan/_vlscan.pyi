"""The engine of vlscan; use the package ``vlscan``."""

import os
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, final

from ._typing import ArrowStream, Progress, SceneFacts

__all__ = [
    "BatchIterator",
    "Changes",
    "Column",
    "Mesh",
    "Outcome",
    "Part",
    "Request",
    "Scene",
    "Table",
    "campaign_cells",
    "catalogue",
    "catalogue_files",
    "cloud_info",
    "columns",
    "command",
    "compare",
    "contents",
    "dry_run",
    "figures",
    "fit_flight",
    "fit_sensor",
    "fly",
    "keys",
    "make_scene",
    "make_stand",
    "materials_of_file",
    "merge_shards",
    "options",
    "page",
    "parts_of_scene",
    "picture",
    "plan",
    "platform_kind",
    "preview",
    "raster",
    "read_points",
    "reconstruct",
    "run",
    "run_batches",
    "run_campaign",
    "run_shard",
    "scanner_figures",
    "scene_geometry",
    "spectra",
    "unzip",
    "version",
    "write_frames",
    "write_lines",
]

_Table: TypeAlias = ArrowStream | dict[str, bytes] | dict[str, tuple[str, bytes]]
_Map: TypeAlias = tuple[tuple[int, int, float, list[float]], list[bytes]]

def version() -> str:
    """Version of the engine."""

def contents(
    request: Request,
) -> tuple[str, tuple[str, str], tuple[str, str], list[str | None], dict[str, Any], list[dict[str, Any]], bool, dict[str, Any] | None]:
    """Name of a survey; id and name of its scanner, id and type of its platform, ids of parts, keys of waveforms, keywords of legs;
    whether these hold all that the file has about legs; what XML refers to.
    """

def command(words: Sequence[str]) -> int:
    """Run the command line with these words, the first of which is the program's name, and return its exit status."""

def catalogue() -> tuple[list[tuple[str, str]], list[str]]:
    """Return references and names of the scanners, and references of the platforms, that ship with the program."""

def options() -> list[tuple[str, str, bool, bool, bool]]:
    """Return the options of a run: name, help, whether it takes a value, may be given more than once, only says how files are written."""

def catalogue_files() -> list[tuple[str, str]]:
    """Return the files of the catalogue that ships: the path by which surveys refer to each, and its text."""

def spectra() -> list[tuple[str, list[tuple[float, float, float]]]]:
    """Return the built-in spectra of surfaces: name; wavelength (nm), reflectance and transmittance."""

def materials_of_file(path: str | os.PathLike[str], is_obj: bool) -> list[dict[str, Any]]:
    """Return the materials of an MTL file, or those that an OBJ file uses, as dictionaries."""

def parts_of_scene(
    scene: Scene,
) -> list[
    tuple[
        str,
        tuple[Any, ...],
        tuple[str, tuple[float, float, float, float], float, tuple[float, float, float], int],
    ]
]:
    """Return the parts that a scene file names: constructor, arguments, and id, quaternion, scale, offset and mode on the ground."""

def keys() -> list[tuple[str, list[str]]]:
    """Return the tables of pipeline files with their keys."""

def columns() -> list[tuple[str, str, str]]:
    """Return the columns of points: name, unit, meaning."""

def page(table: _Table, colour: str, title: str, max_points: int) -> str:
    """Return a page that shows points in a browser, offline."""

def picture(table: _Table, colour: str, title: str, width: int, height: int, is_small: bool = False) -> bytes:
    """Return a PNG picture of points, from above and from the side."""

def plan(kind: str, fields: dict[str, Any]) -> dict[str, Any]:
    """Plan a survey: text, promises, warnings, lines, crs, platform, scanner."""

def write_lines(
    path: str,
    lines: Sequence[tuple[str, float | None, Sequence[Sequence[float]]]],
    carriers: tuple[str, str],
    crs: str | None,
    force: bool,
) -> None:
    """Write the lines of a plan to a file of GeoJSON, KML or CSV; ``carriers`` are the references to platform and scanner."""

def run_campaign(path: str, fields: dict[str, Any], notify: Callable[[str, str, str], object] | None) -> dict[str, Any]:
    """Compute the cells of a campaign and return the state of its data set."""

def campaign_cells(path: str, fields: dict[str, Any]) -> list[str]:
    """Return the cells of a campaign that are neither complete nor failed."""

def compare(first: tuple[str, object], second: tuple[str, object], fields: dict[str, object]) -> tuple[str, _Map]:
    """Compare two clouds, each a table with its name or the file of that name; the comparison as JSON, and its map of change."""

def cloud_info(clouds: Sequence[tuple[str, object]]) -> tuple[str, str]:
    """Describe clouds, each a table with its name or the file of that name, as one: the facts as JSON and as text."""

def raster(
    clouds: Sequence[tuple[str, object]], wanted: Sequence[tuple[str, str | None]], fields: dict[str, Any]
) -> tuple[tuple[int, int, float, list[float]], str | None, list[bytes]]:
    """Make rasters of clouds, by name and file: the grid, the system as WKT, the values of each."""

def write_frames(path: str, folder: str, fields: dict[str, Any]) -> tuple[int, int]:
    """Write the frames of an MCAP file to a folder: the numbers of frames and points."""

def read_points(path: str) -> Table:
    """Read the points of a file."""

def preview(
    kind: str,
    file: str | None,
    request: Request | None,
    pulse: int | None,
    colour: str,
    title: str,
    light: bool,
    width: int,
    height: int,
    max_points: int,
) -> bytes:
    """Draw points of a file, the waveform of a pulse, or the survey of a request: a picture (``png``) or a page (``html``)."""

def make_scene(kind: str, folder: str, fields: dict[str, Any]) -> tuple[str, int, int, int]:
    """Make a scene with a survey: the survey, and the numbers of triangles, voxels and pulses."""

def make_stand(inventory: str, trees: str, folder: str, fields: dict[str, Any]) -> tuple[str, list[int], int]:
    """Place tree models by an inventory: the scene, and the numbers of trees of each epoch and of models."""

def figures() -> str:
    """Return the figures of all scanners and platforms that ship as JSON."""

def platform_kind(reference: str) -> str:
    """Return how a platform moves, by the name of its type in XML."""

def scanner_figures(reference: str) -> tuple[str, str]:
    """Return the figures of a scanner, their sources and those of its first device as JSON, and its scan pattern as SVG."""

def scene_geometry(scene: Scene, part: int | None) -> tuple[Column, Column, Column, Column, Column, Column] | None:
    """Return primitives: vertices, triangles, centres and edges of voxels, and numbers and parts of all; none if not loaded."""

def unzip(path: str, out: str, force: bool) -> int:
    """Expand compressed text to a file; the number of lines."""

def dry_run(request: Request) -> str:
    """Estimate what a run will cost and give; the forecast as JSON."""

def fly(request: Request, rows: str, interval: float | None, as_flown: bool) -> Table:
    """Fly a survey without tracing and return its poses (``poses``) or pulses (``pulses``)."""

def run_shard(
    request: Request,
    folder: str,
    shard: tuple[int, int] | None,
    resume: bool,
    force: bool,
    progress: Progress | None = None,
) -> tuple[str, int]:
    """Compute a shard of a run, or without one the index of all shards: the file or the folder, and the number of pulses."""

def merge_shards(
    folder: str, options: dict[str, Any], tables: Sequence[str], check: bool, progress: Progress | None = None
) -> Outcome | None:
    """Merge shards to files or to tables of these names; or compare their checksums."""

def fit_flight(
    cloud: str, output: str, flight_line: str | None, extend: float, force: bool, max_memory: int | None
) -> tuple[list[str], str]:
    """Fit a flight and its scanner to a cloud and write them: the files, and the figures as JSON."""

def fit_sensor(revolution: str, calibration: str, output: str, odd: bool, planes: str | None, force: bool) -> str:
    """Fit noise and detection of a spinning sensor to a revolution and write the sensor: the figures as JSON."""

def reconstruct(cloud: str, folder: str, voxel: float | None, divergence: float, force: bool) -> str:
    """Reconstruct a scene from a classified point cloud; what was estimated as JSON."""

@final
class Mesh:
    """Triangles with materials."""

    def __new__(cls, vertices: bytes, triangles: bytes, materials: Sequence[dict[str, Any]], material_of: bytes) -> Mesh: ...
    def parts(self) -> tuple[bytes, bytes, list[dict[str, Any]], bytes]: ...
    def materials(self) -> list[dict[str, Any]]: ...

@final
class Changes:
    """Changes of the materials of a part, which its copies share."""

    def __new__(cls) -> Changes: ...
    def then(self, which: str | bytes | None, fields: dict[str, Any]) -> Changes: ...
    def parts(self) -> list[tuple[str | bytes | None, dict[str, Any]]]: ...

@final
class Part:
    """A part of a scene: geometry and where it stands."""

    @staticmethod
    def of_mesh(mesh: Mesh, place: dict[str, Any]) -> Part: ...
    @staticmethod
    def of_mesh_file(path: str, up: str | None, unit: str | None, materials: str | None, place: dict[str, Any]) -> Part: ...
    @staticmethod
    def of_raster(paths: list[str], material: dict[str, Any], place: dict[str, Any]) -> Part: ...
    @staticmethod
    def of_points(path: str, settings: dict[str, Any], material: dict[str, Any], place: dict[str, Any]) -> Part: ...
    @staticmethod
    def of_voxels(path: str, settings: dict[str, Any], material: dict[str, Any], place: dict[str, Any]) -> Part: ...

@final
class Scene:
    """What is scanned."""

    @staticmethod
    def read(reference: str, assets: Sequence[str]) -> Scene: ...
    @staticmethod
    def of_parts(parts: list[Part], asset_folders: Sequence[str]) -> Scene: ...
    @property
    def part_count(self) -> int: ...
    @property
    def is_loaded(self) -> bool: ...
    def load(self, document: str, options: dict[str, Any]) -> None: ...
    def pack(self, path: str, document: str, options: dict[str, Any]) -> None: ...
    def unload(self) -> None: ...
    def facts(self) -> SceneFacts | None: ...
    def report(self) -> str | None: ...
    def ground_height(self, x: float, y: float) -> float | None: ...
    def sample(self, count: int) -> Table | None: ...
    def cast(self, origins: bytes, directions: bytes) -> tuple[Column, Column, Column, Column] | None: ...

@final
class Column:
    """A column of a table, which NumPy takes without a copy."""

    def __len__(self) -> int: ...
    @property
    def __array_interface__(self) -> dict[str, Any]: ...

@final
class Table:
    """Columns of numbers in memory."""

    def __len__(self) -> int: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def units(self) -> dict[str, str]: ...
    @property
    def descriptions(self) -> dict[str, str]: ...
    @property
    def metadata(self) -> dict[str, str]: ...
    def column(self, name: str) -> Column: ...
    def lists(self, name: str) -> tuple[Column, Column]: ...
    def slice(self, start: int, stop: int) -> Table: ...
    def take(self, indices: bytes) -> Table: ...
    def to_bytes(self) -> tuple[bytes, bytes | None, bytes | None]: ...
    @staticmethod
    def of_bytes(columns: bytes, exact: bytes | None, facts: bytes | None) -> Table: ...
    @staticmethod
    def of_columns(table: _Table, crs: str | None) -> Table: ...
    @staticmethod
    def concat(tables: Sequence[Table]) -> Table: ...
    def write(self, options: dict[str, Any]) -> int: ...
    def __arrow_c_array__(self, requested_schema: object | None = None) -> tuple[object, object]: ...
    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...
    def __arrow_c_schema__(self) -> object: ...

@final
class Request:
    """What is run."""

    def __new__(
        cls,
        options: dict[str, Any],
        file: str | os.PathLike[str] | None = None,
        document: tuple[str, str, list[tuple[str, _Table]]] | None = None,
        scene: Scene | None = None,
        trajectory: _Table | None = None,
        pulses: _Table | None = None,
    ) -> Request: ...

@final
class Outcome:
    """Result of a run."""

    def __new__(
        cls,
        tables: Sequence[tuple[str, Table]],
        counts: tuple[int, int, float, bool],
        files: Sequence[tuple[str, int, int, bool]],
        directories: Sequence[str | os.PathLike[str]],
        notices: list[dict[str, Any]],
    ) -> Outcome: ...
    def parts(
        self,
    ) -> tuple[
        list[tuple[str, Table]],
        tuple[int, int, float, bool],
        list[tuple[str, int, int, bool]],
        list[os.PathLike[str]],
        list[dict[str, Any]],
    ]: ...
    def table(self, name: str) -> Table | None: ...
    @property
    def pulses(self) -> int: ...
    @property
    def points(self) -> int: ...
    @property
    def seconds(self) -> float: ...
    @property
    def interrupted(self) -> bool: ...
    @property
    def files(self) -> list[tuple[str, int, int, bool]]: ...
    @property
    def directories(self) -> list[os.PathLike[str]]: ...
    @property
    def notices(self) -> list[dict[str, Any]]: ...

@final
class BatchIterator:
    """The batches of points of a run."""

    def __iter__(self) -> BatchIterator: ...
    def __next__(self) -> Table: ...
    def outcome(self) -> Outcome | None: ...
    def close(self) -> None: ...

def run(request: Request, tables: Sequence[str], progress: Progress | None = None) -> Outcome:
    """Run a request and return the tables of these names."""

def run_batches(
    request: Request,
    rows: int,
    per_leg: bool,
    seconds: float | None,
    waiting: int,
    tables: Sequence[str] = ...,
    columns: Sequence[str] | None = None,
) -> BatchIterator:
    """Run a request and return its points batch by batch, with columns of their own; these tables are in the iterator's outcome."""
