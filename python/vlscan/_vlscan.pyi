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
    "catalogue",
    "columns",
    "command",
    "compare",
    "fit_flight",
    "fit_sensor",
    "options",
    "page",
    "picture",
    "plan",
    "reconstruct",
    "run",
    "run_batches",
    "run_campaign",
    "version",
]

_Table: TypeAlias = ArrowStream | dict[str, bytes]

def version() -> str:
    """Version of the engine."""

def command(words: Sequence[str]) -> int:
    """Run the command line with these words, the first of which is the program's name, and return its exit status."""

def catalogue() -> tuple[list[tuple[str, str]], list[str]]:
    """Return references and names of the scanners, and references of the platforms, that ship with the program."""

def options() -> list[tuple[str, str, bool, bool, bool]]:
    """Return the options of a run: name, help, whether it takes a value, may be given more than once, only says how files are written."""

def columns() -> list[tuple[str, str, str]]:
    """Return the columns of points: name, unit, meaning."""

def page(table: _Table, colour: str, title: str, max_points: int) -> str:
    """Return a page that shows points in a browser, offline."""

def picture(table: _Table, colour: str, title: str, width: int, height: int) -> bytes:
    """Return a PNG picture of points, from above and from the side."""

def plan(kind: str, fields: dict[str, Any]) -> tuple[str, list[str], list[str]]:
    """Plan a survey: the pipeline file, what the plan promises, and its warnings."""

def run_campaign(path: str, fields: dict[str, Any], notify: Callable[[str, str, str], object] | None) -> dict[str, Any]:
    """Compute the cells of a campaign and return the state of its data set."""

def compare(first: tuple[str, object], second: tuple[str, object], fields: dict[str, object]) -> str:
    """Compare two clouds, each a table with its name or the file of that name; the comparison as JSON."""

def fit_flight(cloud: str, output: str, flight_line: int | None, extend: float, force: bool) -> tuple[list[str], str]:
    """Fit a flight and its scanner to a cloud and write them: the files, and the figures as JSON."""

def fit_sensor(revolution: str, calibration: str, output: str, odd: bool, planes: str | None, force: bool) -> str:
    """Fit noise and detection of a spinning sensor to a revolution and write the sensor: the figures as JSON."""

def reconstruct(cloud: str, folder: str, voxel: float | None, divergence: float, force: bool) -> str:
    """Reconstruct a scene from a classified point cloud; what was estimated as JSON."""

@final
class Mesh:
    """Triangles with materials."""

    def __new__(cls, vertices: bytes, triangles: bytes, materials: Sequence[dict[str, Any]], material_of: bytes) -> Mesh: ...

@final
class Changes:
    """Changes of the materials of a part, which its copies share."""

    def __new__(cls) -> Changes: ...
    def then(self, which: str | bytes | None, fields: dict[str, Any]) -> Changes: ...

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
    def load(self, document: str, words: Sequence[str]) -> None: ...
    def pack(self, path: str, document: str, words: Sequence[str]) -> None: ...
    def unload(self) -> None: ...
    def facts(self) -> SceneFacts | None: ...
    def ground_height(self, x: float, y: float) -> float | None: ...
    def sample(self, count: int) -> Table | None: ...

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
    def __arrow_c_array__(self, requested_schema: object | None = None) -> tuple[object, object]: ...
    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...
    def __arrow_c_schema__(self) -> object: ...

@final
class Request:
    """What is run."""

    def __new__(
        cls,
        words: Sequence[str],
        file: str | os.PathLike[str] | None = None,
        document: str = ...,
        scene: Scene | None = None,
        trajectory: _Table | None = None,
        pulses: _Table | None = None,
    ) -> Request: ...

@final
class Outcome:
    """Result of a run."""

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
    request: Request, rows: int, per_leg: bool, seconds: float | None, waiting: int, tables: Sequence[str] = ...
) -> BatchIterator:
    """Run a request and return its points batch by batch; the tables of these names are in the iterator's outcome."""
