"""Scenes that are made: procedural ones, and stands of trees by an inventory."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _vlscan
from ._arguments import path_of, suggesting
from ._libraries import needed
from ._typing import ArrowStream, PathLike, TableLike
from .errors import temporary_folder
from .scene import Scene
from .survey import Survey

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class MadeScene:
    """A procedural scene with a survey that scans it.

    Parameters
    ----------
    folder : Path
        The folder of the files.
    survey_file : Path
        The survey.
    triangles, voxels, pulses : int
        How many there are; pulses to 1 %.
    """

    folder: Path
    survey_file: Path
    triangles: int
    voxels: int
    pulses: int

    @property
    def scene(self) -> Scene:
        """The scene."""
        return Scene(self.folder / "scene.xml", assets=[self.folder])

    @property
    def survey(self) -> Survey:
        """The survey."""
        return Survey.open(self.survey_file)


@suggesting
def make_scene(
    kind: Literal["forest", "terrain", "room"],
    folder: PathLike,
    *,
    triangles: int = 100_000,
    seed: int = 1,
    extent: float | None = None,
    pulses: int | None = None,
    separate_trees: bool = False,
    models: int | None = None,
    copies: int | None = None,
    voxels: int | None = None,
    force: bool = False,
) -> MadeScene:
    """Make a procedural scene with a survey that scans it, as ``vlscan scene make`` does.

    Parameters
    ----------
    kind : {"forest", "terrain", "room"}
        Kind of the scene.
    folder : str or path-like
        The folder that gets the files.
    triangles : int
        Number of triangles, to about 1 %.
    seed : int
        Another seed makes another scene.
    extent : float, optional
        Edge of the scene, m.
    pulses : int, optional
        About how many pulses the survey has.
    separate_trees : bool
        True if every tree of a forest is a part, so that points have the number of their tree.
    models, copies : int, optional
        Number of different trees of a forest, and how often each is placed.
    voxels : int, optional
        Number of opaque voxels that are added to the crowns of a forest.
    force : bool
        If set, existing files are replaced.

    Returns
    -------
    MadeScene
        The scene and its survey.

    Raises
    ------
    InputError
        Impossible sizes, or files that exist.

    Examples
    --------
    >>> made = vlscan.make_scene("terrain", "hills", triangles=2000, pulses=20_000)
    >>> made.survey.run(seed=1).point_count > 1000
    True
    """
    fields = dict(triangles=triangles, seed=seed, extent=extent, pulses=pulses, separate_trees=separate_trees)
    fields |= dict(models=models, copies=copies, voxels=voxels, force=force)
    survey, *counts = _vlscan.make_scene(kind, path_of("folder", folder), fields)
    return MadeScene(Path(folder), Path(survey), *counts)


@dataclass(frozen=True)
class Stand:
    """Trees that were placed by an inventory.

    Parameters
    ----------
    folder : Path
        The folder of the files.
    file : Path
        The scene, ``stand.xml``.
    trees : list of int
        Number of trees in each epoch.
    models : int
        Number of tree models to choose from.
    """

    folder: Path
    file: Path
    trees: list[int]
    models: int

    @property
    def scene(self) -> Scene:
        """The scene of the first epoch."""
        return self.epoch(0)

    def epoch(self, number: int) -> Scene:
        """Return the scene of an epoch.

        Parameters
        ----------
        number : int
            The epoch, from 0.

        Returns
        -------
        Scene
            The scene.
        """
        self._check(number)
        return Scene(f"{self.file}#stand_{number}" if len(self.trees) > 1 else self.file, assets=[self.folder])

    def labels(self, epoch: int = 0) -> list[dict[str, str]]:
        """Return what is known of each tree: number of the part in the points, id, species, model, position, height, crown, dbh,
        and the values of the inventory, ``crown_given`` and so on.

        Parameters
        ----------
        epoch : int
            The epoch, from 0.

        Returns
        -------
        list of dict
            The trees.
        """
        with open(self._labels_file(epoch), encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    def to_pandas(self, epoch: int = 0) -> pandas.DataFrame:
        """Return the labels as a table.

        Parameters
        ----------
        epoch : int
            The epoch, from 0.

        Returns
        -------
        pandas.DataFrame
            A row for each tree.
        """
        frame: pandas.DataFrame = needed("pandas", "to_pandas()").read_csv(self._labels_file(epoch))
        return frame

    def _labels_file(self, epoch: int) -> Path:
        self._check(epoch)
        return self.folder / ("labels.csv" if len(self.trees) == 1 else f"labels_{epoch}.csv")

    def _check(self, epoch: int) -> None:
        if not 0 <= epoch < len(self.trees):
            raise IndexError(f"epoch {epoch}, and there are {len(self.trees)}")


@suggesting
def make_stand(
    inventory: TableLike | PathLike,
    trees: PathLike,
    folder: PathLike,
    *,
    terrain: PathLike | Iterable[PathLike] = (),
    terrain_material: str | None = None,
    seed: int = 0,
    epochs: int = 1,
    growth: float = 0.0,
    thinning: float = 0.0,
    storm: float = 0.0,
    force: bool = False,
) -> Stand:
    """Place tree models on terrain by an inventory, as ``vlscan scene stand`` does.

    Parameters
    ----------
    inventory : table, str or path-like
        The inventory: a table of pandas, GeoPandas, polars, Arrow or a dictionary of arrays, or a file of text. x, y (or points as
        geometry) and height are required; crown (diameter), dbh, species, id and z are optional.
    trees : str or path-like
        Folder of tree models, OBJ files whose names begin with their species.
    folder : str or path-like
        The folder that gets the files.
    terrain : str, path-like or iterable of them
        Meshes or rasters on which trees are placed; without them z of the inventory counts.
    terrain_material : str, optional
        Material of the terrain, ``file.mtl#name``.
    seed : int
        Seed of the choice of models, yaw, thinning and storm.
    epochs : int
        Number of epochs; the first one is the inventory.
    growth, thinning, storm : float
        Growth, trees felled, and trees thrown by a storm from epoch to epoch, percent.
    force : bool
        If set, existing files are replaced.

    Returns
    -------
    Stand
        The scene and its trees.

    Raises
    ------
    InputError
        The inventory, the models or the terrain cannot be read, or files exist.

    Examples
    --------
    >>> inventory = {"x": [5.0, -9.0], "y": [8.0, 3.0], "height": [20.0, 14.0], "species": ["beech", "spruce"]}
    >>> stand = vlscan.make_stand(inventory, "fixtures/forest", "stand", terrain="ground.obj")
    >>> stand.trees, [tree["species"] for tree in stand.labels()]
    ([2], ['beech', 'spruce'])
    """
    files = [terrain] if isinstance(terrain, (str, os.PathLike)) else list(terrain)
    fields: dict[str, Any] = dict(terrain=[os.fspath(file) for file in files], terrain_material=terrain_material)
    fields |= dict(seed=seed, epochs=epochs, growth=float(growth), thinning=float(thinning), storm=float(storm), force=force)
    with _inventory_file(inventory) as name:
        scene, counts, models = _vlscan.make_stand(name, path_of("trees", trees), path_of("folder", folder), fields)
    return Stand(Path(folder), Path(scene), counts, models)


@contextmanager
def _inventory_file(inventory: TableLike | PathLike) -> Iterator[str]:
    """Yield the name of a file of an inventory."""
    if isinstance(inventory, (str, os.PathLike)):
        yield os.fspath(inventory)
        return
    columns = _columns(inventory)
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"columns of the inventory have different lengths: {lengths}")
    with temporary_folder() as folder:
        path = os.path.join(folder, "inventory.csv")
        with open(path, "w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))
        yield path


def _columns(inventory: Any) -> dict[str, list[object]]:
    """Return the columns of a table of any library; those of a geometry are x and y."""
    geometry = getattr(inventory, "geometry", None)
    if geometry is not None and hasattr(geometry, "x"):
        rest = {str(name): list(inventory[name]) for name in inventory.columns if name != geometry.name}
        return {"x": list(geometry.x), "y": list(geometry.y), **{name: rest[name] for name in rest if name not in ("x", "y")}}
    if isinstance(inventory, np.ndarray) and inventory.dtype.names:
        return {name: inventory[name].tolist() for name in inventory.dtype.names if name != "index"}
    if hasattr(inventory, "keys"):
        return {str(name): list(inventory[name]) for name in inventory.keys()}
    if hasattr(inventory, "columns") and hasattr(inventory, "__getitem__") and not hasattr(inventory, "column_names"):
        return {str(name): list(inventory[name]) for name in inventory.columns}
    if isinstance(inventory, ArrowStream):
        table: dict[str, list[object]] = needed("pyarrow", "an inventory of Arrow").table(inventory).to_pydict()
        return table
    raise TypeError(f"an inventory is a {type(inventory).__name__}, expected a table or a file")


def unzip(path: PathLike, to: PathLike, *, force: bool = False) -> int:
    """Expand compressed text (``.bin``) to plain text, as ``vlscan unzip`` does.

    Parameters
    ----------
    path : str or path-like
        The compressed text.
    to : str or path-like
        The file to write.
    force : bool
        If set, an existing file is replaced.

    Returns
    -------
    int
        Number of lines.

    Raises
    ------
    InputError
        The file is no compressed text, or the text exists.
    FileError
        A file cannot be read or written.

    Examples
    --------
    >>> result = vlscan.run("fixtures/room/survey.xml", to="room.bin", seed=1)
    >>> vlscan.unzip("room.bin", "room.txt") == result.point_count
    True
    """
    return _vlscan.unzip(path_of("path", path), path_of("to", to), force)
