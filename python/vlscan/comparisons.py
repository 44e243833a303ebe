"""Point clouds that are compared."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _vlscan
from ._arguments import path_of, suggesting
from ._columns import named_cloud
from ._facts import Facts
from ._libraries import needed
from ._typing import PathLike, TableLike
from ._values import renamed

if TYPE_CHECKING:
    import pandas
    import xarray


@dataclass(frozen=True, eq=False)
class ChangeMap:
    """The change of the ground between two clouds, on a grid from south to north and from west to east.

    Parameters
    ----------
    differences : numpy.ndarray
        Second minus first, m, by row and column; NaN where a surface is missing.
    detection : numpy.ndarray
        Level of detection at 95 %, m.
    is_changed : numpy.ndarray
        True if the difference is beyond it, and that of at least two neighbours.
    side_m : float
        Side of a cell, m.
    corner : tuple of float
        South-western corner, x and y, world frame, m.
    """

    differences: NDArray[np.float64]
    detection: NDArray[np.float64]
    is_changed: NDArray[np.bool_]
    side_m: float
    corner: tuple[float, float]

    def to_xarray(self) -> xarray.Dataset:
        """Return the map for xarray, with the centres of the cells as coordinates.

        Returns
        -------
        xarray.Dataset
            The map, with the dimensions y and x.
        """
        rows, columns = self.differences.shape
        centres = {
            "y": self.corner[1] + self.side_m * (np.arange(rows) + 0.5),
            "x": self.corner[0] + self.side_m * (np.arange(columns) + 0.5),
        }
        cells = {"difference": self.differences, "detection": self.detection, "is_changed": self.is_changed}
        library = needed("xarray", "to_xarray()")
        data: xarray.Dataset = library.Dataset({name: (("y", "x"), values) for name, values in cells.items()}, centres)
        return data


class Comparison(Facts[Any]):
    """Similarities and differences of two point clouds: a mapping with the keys of ``vlscan compare --json``.

    Parameters
    ----------
    figures : dict
        The figures by name.
    change_map : ChangeMap
        The change of the ground.

    Attributes
    ----------
    change_map : ChangeMap
        The change of the ground.
    """

    def __init__(self, figures: dict[str, Any], change_map: ChangeMap) -> None:
        super().__init__(figures)
        self.change_map = change_map

    def to_pandas(self) -> pandas.DataFrame:
        """Return the quantities of both clouds as a table.

        Returns
        -------
        pandas.DataFrame
            A row for each figure of each quantity.
        """
        rows = [
            {"quantity": quantity["name"], "unit": quantity.get("unit"), **figure}
            for quantity in self["quantities"]
            for figure in quantity["figures"]
        ]
        frame: pandas.DataFrame = needed("pandas", "to_pandas()").DataFrame(rows)
        return frame

    def __repr__(self) -> str:
        first, second = (f"{self[name]['name']} ({self[name]['points']:,} points)" for name in ("first", "second"))
        return f"<Comparison of {first} and {second}: {', '.join(self)}>"


@renamed(most_distances="max_distances")
@suggesting
def compare(
    first: TableLike | PathLike,
    second: TableLike | PathLike,
    *,
    cell: float = 1.0,
    voxel: float = 0.5,
    max_distances: int = 200_000,
    chance: bool = False,
    terrain: PathLike | None = None,
    registration: float | None = None,
    page: PathLike | None = None,
    change: PathLike | None = None,
    changed: PathLike | None = None,
    force: bool = False,
) -> Comparison:
    """Compare two point clouds of one place: heights, returns, pulses, scan lines, residuals to a terrain, change of the ground and more.

    Parameters
    ----------
    first, second : Points, table, str or path-like
        The clouds: the points of a run, or a file.
    cell : float
        Side of the cells of density, canopy height and change, m.
    voxel : float
        Side of the voxels whose occupancy is compared, m.
    max_distances : int
        Maximum number of points of each cloud whose distance to the other and height above the terrain are measured.
    chance : bool
        True if each figure comes with what chance alone gives: the largest difference between random halves of the first cloud.
    terrain : str or path-like, optional
        A raster or mesh that heights and residuals refer to; by default the ground points of the first cloud.
    registration : float, optional
        Standard deviation of the registration of the clouds to each other, m; by default the median difference of the cells that
        did not change.
    page : str or path-like, optional
        A page to write, with tables, charts and pictures, ``.html``.
    change : str or path-like, optional
        A raster of change to write, ``.tif``.
    changed : str or path-like, optional
        A cloud to write of the points that are new (class 64) or gone (class 65).
    force : bool
        If set, existing files are replaced.

    Returns
    -------
    Comparison
        The figures of ``vlscan compare --json``, and the map of change.

    Raises
    ------
    InputError
        A cloud cannot be compared, or a file exists.

    Examples
    --------
    >>> first, second = (vlscan.run("fixtures/room/survey.xml", seed=seed).points for seed in (1, 2))
    >>> found = vlscan.compare(first, second, voxel=1)
    >>> found["first_to_second"]["mean_m"] < 0.1, found.change_map.differences.shape == found.change_map.detection.shape
    (True, True)
    """
    fields: dict[str, object] = {
        "cell": cell,
        "voxel": voxel,
        "max_distances": max_distances,
        "chance": chance,
        "registration": registration,
        "force": force,
    }
    files = {"terrain": terrain, "page": page, "change": change, "changed": changed}
    fields |= {name: None if file is None else path_of(name, file) for name, file in files.items()}
    text, ((columns, rows, side, corner), cells) = _vlscan.compare(named_cloud(first, "first"), named_cloud(second, "second"), fields)
    differences, detection = (np.frombuffer(values, "<f8").reshape(rows, columns) for values in cells[:2])
    is_changed = np.frombuffer(cells[2], bool).reshape(rows, columns)
    return Comparison(json.loads(text), ChangeMap(differences, detection, is_changed, side, (corner[0], corner[1])))
