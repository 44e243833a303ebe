"""Surveys that are planned: flight lines over an area, positions of a tripod, drives."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from . import _vlscan
from ._arguments import path_of, reals, suggesting
from ._libraries import needed, save
from ._typing import Geometry, PathLike, Progress
from .errors import temporary_folder, without_folders
from .forecast import DryRun
from .parts import Part
from .places import working_folder
from .results import Result
from .scene import Scene
from .survey import Survey

if TYPE_CHECKING:
    import geopandas
    from typing_extensions import Unpack

    from ._options import RunOptions

#: The corners of a polygon, x and y in m; a geometry of shapely or GeoPandas; a file of GeoJSON, KML, KMZ, GPX
#: or well-known text, a shapefile, a GeoPackage; or well-known text itself.
Area: TypeAlias = PathLike | Sequence[Sequence[float]] | NDArray[np.floating[Any]] | Geometry


class PlanLine(NamedTuple):
    """A line of a plan along which the scanner fires, or a position of a tripod.

    Parameters
    ----------
    name : str
        The name of its strip.
    speed_m_per_s : float or None
        The speed, m/s.
    vertices : list of list of float
        Its vertices, x, y and z, m; one of a position.
    """

    name: str
    speed_m_per_s: float | None
    vertices: list[list[float]]


@dataclass(frozen=True)
class Plan:
    """A planned survey.

    Parameters
    ----------
    text : str
        The pipeline file, which ``vlscan run`` flies.
    promises : list of str
        Promises of the plan: duration, pulses, density, spacing, footprint.
    warnings : list of str
        Warnings about the plan.
    scene : Scene, optional
        The scene in memory that it was planned for; the text names one of a file.
    lines : list of PlanLine
        The flight lines, the drive, or the positions.
    crs : str, optional
        Coordinate reference system of the plan as WKT.
    platform, scanner : str
        References to platform and scanner.

    Examples
    --------
    >>> square = [(0, 0), (60, 0), (60, 60), (0, 60)]
    >>> plan = vlscan.plan_airborne("riegl_vux-1uav", height=60, density=5, area=square, scene="ground.obj")
    >>> plan.run(seed=1).point_count > 1000
    True
    >>> plan.write_lines("lines.csv")
    >>> plan.lines[0].speed_m_per_s > 1
    True
    """

    text: str
    promises: list[str]
    warnings: list[str]
    scene: Scene | None = field(default=None, repr=False)
    lines: list[PlanLine] = field(default_factory=list, repr=False)
    crs: str | None = field(default=None, repr=False)
    platform: str = ""
    scanner: str = ""
    _folder: str = field(default_factory=working_folder, init=False, repr=False, compare=False)

    def survey(self) -> Survey:
        """Return the planned survey.

        Returns
        -------
        Survey
            The survey, over the scene that it was planned for.
        """
        survey = Survey.from_document(self.text, self.scene)
        # Files of the plan are relative to the working directory in which it was made.
        survey._folder = self._folder
        return survey

    def run(
        self, to: PathLike | Iterable[PathLike] | None = None, *, progress: Progress | bool | None = None, **options: Unpack[RunOptions]
    ) -> Result:
        """Fly and measure the planned survey.

        Parameters
        ----------
        to, progress : object
            As for :meth:`Survey.run`.
        **options : RunOptions
            As for :meth:`Survey.run`.

        Returns
        -------
        Result
            The points, or the names of the files.
        """
        return self.survey().run(to, progress=progress, **options)

    def dry_run(self, to: PathLike | Iterable[PathLike] | None = None, **options: Unpack[RunOptions]) -> DryRun:
        """Estimate what the planned survey will cost and give.

        Parameters
        ----------
        to : object
            As for :meth:`Survey.dry_run`.
        **options : RunOptions
            As for :meth:`Survey.run`.

        Returns
        -------
        DryRun
            The estimates.
        """
        return self.survey().dry_run(to, **options)

    def save(self, path: PathLike, *, force: bool = False) -> None:
        """Write the pipeline file.

        Parameters
        ----------
        path : str or path-like
            The file, ``.toml``.
        force : bool
            If set, an existing file is replaced.

        Raises
        ------
        InputError
            The file exists.
        """
        save(path_of("path", path), self.text.encode(), force)

    def __repr__(self) -> str:
        carriers = " on ".join(name.rpartition("#")[2] for name in (self.scanner, self.platform) if name)
        return f"<Plan: {carriers}, {len(self.lines)} lines; {'; '.join(self.promises[:1])}>"

    def write_lines(self, path: PathLike, *, force: bool = False) -> None:
        """Write the flight lines, the drive or the positions, as ``vlscan plan --lines`` does.

        Parameters
        ----------
        path : str or path-like
            The file: ``.geojson`` or ``.kml`` in longitude and latitude, ``.csv`` in the coordinates of the plan, too.
        force : bool
            If set, an existing file is replaced.

        Raises
        ------
        InputError
            The coordinate reference system is unknown, which GeoJSON and KML need, or another extension.
        FileError
            The file cannot be written.
        """
        _vlscan.write_lines(path_of("path", path), self.lines, (self.platform, self.scanner), self.crs, force)

    def to_geopandas(self) -> geopandas.GeoDataFrame:
        """Return the flight lines, the drive or the positions as a table of geometries.

        Returns
        -------
        geopandas.GeoDataFrame
            A row for each line, with name, speed and length; points for positions.
        """
        shapely, library = needed("shapely", "to_geopandas()"), needed("geopandas", "to_geopandas()")
        shapes = [shapely.Point(v[0]) if len(v) == 1 else shapely.LineString(v) for v in (line.vertices for line in self.lines)]
        steps = [np.diff(np.array(line.vertices), axis=0) for line in self.lines]
        columns = {
            "name": [line.name for line in self.lines],
            "speed_m_per_s": [line.speed_m_per_s for line in self.lines],
            "length_m": [float(np.linalg.norm(step, axis=1).sum()) for step in steps],
        }
        frame: geopandas.GeoDataFrame = library.GeoDataFrame(columns, geometry=shapes, crs=self.crs)
        return frame


@suggesting
def plan_airborne(
    scanner: str,
    height: float,
    *,
    area: Area | None = None,
    buffer: float | None = None,
    follow_line: bool = False,
    speed: float | None = None,
    density: float | None = None,
    min_density: float | None = None,
    min_share: float | None = None,
    min_cell: float | None = None,
    overlap: float | None = None,
    scan_angle: float | None = None,
    scan_freq: float | None = None,
    heading: float | None = None,
    cross_lines: int = 0,
    run_in: float | None = None,
    turn_radius: float | None = None,
    follow_terrain: bool = False,
    climb: float | None = None,
    platform: str | None = None,
    scene: Scene | Part | PathLike | None = None,
    ground: float | None = None,
    pulse_rate: int | None = None,
    assets: Iterable[PathLike] = (),
    crs: str | None = None,
) -> Plan:
    """Plan parallel flight lines over an area, with the options of ``vlscan plan airborne``.

    Parameters
    ----------
    scanner : str
        Id of the scanner.
    height : float
        Height above the ground, m.
    area : sequence, geometry, str or path-like, optional
        Corners of a polygon; a polygon of shapely or GeoPandas; a file, or well-known text. The scene by default.
    buffer : float, optional
        Make the area a corridor: everything within this distance of the line, m.
    follow_line : bool
        True if flight lines follow the bends of the corridor's line instead of being straight.
    speed, density : float, optional
        Speed, m/s, and mean pulses per m²; one of them or ``min_density`` is needed.
    min_density : float, optional
        Pulses with a return per m² that ``min_share`` of the cells of the area have at least; in place of ``density``.
    min_share, min_cell : float, optional
        Share of the cells that have ``min_density``, percent (95 by default), and the side of a cell, m (10 by default).
    overlap : float, optional
        Overlap of neighbouring strips, percent of the swath.
    scan_angle, scan_freq : float, optional
        Half opening angle, degrees, and scan frequency, Hz.
    heading : float, optional
        Direction of the lines, degrees clockwise from +y; by default the one with the fewest lines.
    cross_lines : int
        Number of cross lines, perpendicular to the others and evenly spread.
    run_in : float, optional
        Length by which lines begin before the area and end behind it, m.
    turn_radius : float, optional
        Radius of turns between lines, m; by default the flight is straight to the next line.
    follow_terrain : bool
        True if the height is above the scene's ground instead of above its mean.
    climb : float, optional
        Steepest climb with ``follow_terrain``, degrees.
    platform : str, optional
        Id of the platform; the usual one of the scanner by default.
    scene : Scene, Part, str or path-like, optional
        The scene, for the heights of its ground.
    ground : float, optional
        Height of the ground where no scene tells it, m; tripods and vehicles stand on it even if a scene does.
    pulse_rate : int, optional
        Pulses per second; the scanner's first by default.
    assets : iterable of str or path-like
        Folders in which files are searched.
    crs : str, optional
        Coordinate reference system of the plan if no file of its scene names it: ``EPSG:25832``, WKT, or a file with either.

    Returns
    -------
    Plan
        The plan.

    Raises
    ------
    InputError
        The options are missing, invalid, or beyond what the instrument can do.
    """
    return _plan("airborne", dict(locals()))


@suggesting
def plan_terrestrial(
    scanner: str,
    *,
    area: Area | None = None,
    spacing: float | None = None,
    around: tuple[float, float] | None = None,
    radius: float | None = None,
    positions: int | None = None,
    at_centre: bool = False,
    at: Iterable[tuple[float, float]] = (),
    resolution: float = 0.04,
    platform: str | None = None,
    scene: Scene | Part | PathLike | None = None,
    ground: float | None = None,
    pulse_rate: int | None = None,
    assets: Iterable[PathLike] = (),
    crs: str | None = None,
) -> Plan:
    """Plan positions of a tripod over an area or around a plot, with the options of ``vlscan plan terrestrial``.

    Parameters
    ----------
    scanner : str
        Id of the scanner.
    area : sequence, geometry, str or path-like, optional
        Corners of a polygon; a polygon of shapely or GeoPandas; a file, or well-known text. The scene by default.
    spacing : float, optional
        Distance of the positions on a grid, m.
    around : tuple of float, optional
        Centre of a plot, m.
    radius : float, optional
        Its radius, m.
    positions : int, optional
        Number of positions around it.
    at_centre : bool
        True if there is one at its centre, too.
    at : iterable of tuple of float
        Places of the tripod, m, instead of an area with a grid, or a plot.
    resolution : float
        Angle between points, degrees.
    platform : str, optional
        Id of the platform; the usual one of the scanner by default.
    scene : Scene, Part, str or path-like, optional
        The scene, for the heights of its ground.
    ground : float, optional
        Height of the ground where no scene tells it, m; tripods and vehicles stand on it even if a scene does.
    pulse_rate : int, optional
        Pulses per second; the scanner's first by default.
    assets : iterable of str or path-like
        Folders in which files are searched.
    crs : str, optional
        Coordinate reference system of the plan if no file of its scene names it: ``EPSG:25832``, WKT, or a file with either.

    Returns
    -------
    Plan
        The plan.

    Raises
    ------
    InputError
        The options are missing, invalid, or beyond what the instrument can do.
    ValueError
        ``at`` is combined with an area, a grid or a plot.
    """
    return _plan("terrestrial", dict(locals()))


@suggesting
def plan_mobile(
    scanner: str,
    along: Area,
    *,
    speed: float = 10.0,
    scan_angle: float | None = None,
    scan_freq: float | None = None,
    step: float = 20.0,
    platform: str | None = None,
    scene: Scene | Part | PathLike | None = None,
    ground: float | None = None,
    pulse_rate: int | None = None,
    assets: Iterable[PathLike] = (),
    crs: str | None = None,
) -> Plan:
    """Plan a drive along a line, with the options of ``vlscan plan mobile``.

    Parameters
    ----------
    scanner : str
        Id of the scanner.
    along : sequence, geometry, str or path-like
        The line: corners, a geometry of shapely or GeoPandas, a file, or well-known text.
    speed : float
        Speed, m/s.
    scan_angle, scan_freq : float, optional
        Half opening angle, degrees, and scan frequency, Hz.
    step : float
        Maximum distance between waypoints, where the vehicle is placed on the scene's ground, m.
    platform : str, optional
        Id of the platform; the usual one of the scanner by default.
    scene : Scene, Part, str or path-like, optional
        The scene, for the heights of its ground.
    ground : float, optional
        Height of the ground where no scene tells it, m; tripods and vehicles stand on it even if a scene does.
    pulse_rate : int, optional
        Pulses per second; the scanner's first by default.
    assets : iterable of str or path-like
        Folders in which files are searched.
    crs : str, optional
        Coordinate reference system of the plan if no file of its scene names it: ``EPSG:25832``, WKT, or a file with either.

    Returns
    -------
    Plan
        The plan.

    Raises
    ------
    InputError
        The options are missing, invalid, or beyond what the instrument can do.
    """
    return _plan("mobile", dict(locals()))


def _plan(kind: str, fields: dict[str, Any]) -> Plan:
    fields["assets"] = [os.fspath(folder) for folder in fields["assets"]]
    if fields.get("area") is not None:
        fields["area"] = area_of(fields["area"])
    if "at" in fields:
        fields["at"] = [tuple(place) for place in fields["at"]]
        others = (name for name in ("area", "spacing", "around", "radius", "positions") if fields[name] is not None)
        other = next(others, "at_centre" if fields["at_centre"] else None)
        if fields["at"] and other is not None:
            raise ValueError(f"at={fields['at']} names the positions, so {other} has no meaning; give one of them")
    if "along" in fields:
        along = area_of(fields["along"])
        fields["along"] = along if isinstance(along, str) else f"LINESTRING ({', '.join(f'{x} {y}' for x, y in along)})"
    scene = fields["scene"]
    if isinstance(scene, Part):
        scene = Scene(scene)
    if not isinstance(scene, Scene):
        fields["scene"] = None if scene is None else path_of("scene", scene)
        return _made(_vlscan.plan(kind, fields), None)
    with temporary_folder() as folder:
        # Planned over a packed copy.
        fields["scene"] = os.path.join(folder, "scene.vlscene")
        scene.pack(fields["scene"], fields["scanner"])
        found = _vlscan.plan(kind, fields)
        found["warnings"] = [without_folders(text) for text in found["warnings"]]
    found["text"] = found["text"].replace(fields["scene"], "scene.vlscene")
    return _made(found, scene)


def _made(found: dict[str, Any], scene: Scene | None) -> Plan:
    lines = [PlanLine(*line) for line in found.pop("lines")]
    return Plan(**found, scene=scene, lines=lines)


def area_of(area: object) -> str | list[list[float]]:
    """Return an area or a line as the engine takes it.

    Parameters
    ----------
    area : sequence, geometry, str or path-like
        Corners; a geometry of shapely or GeoPandas; a file, or well-known text.

    Returns
    -------
    str or list
        The name of a file, well-known text, or corners.

    Raises
    ------
    ValueError
        Coordinates are degrees.
    """
    if isinstance(area, (str, os.PathLike)):
        return os.fspath(area)
    system = getattr(area, "crs", None)
    if getattr(system, "is_geographic", False):
        raise ValueError(
            f"the area is in degrees ({getattr(system, 'name', system)}), expected metres; "
            "project it, for example with area.to_crs(area.estimate_utm_crs())"
        )
    if hasattr(area, "union_all") or hasattr(area, "unary_union"):
        # All geometries of a table or a column.
        area = area.union_all() if hasattr(area, "union_all") else getattr(area, "unary_union")  # noqa: B009
    text = getattr(area, "wkt", None)
    if isinstance(text, str):
        return text
    corners = reals("area", area)
    if corners.ndim != 2 or corners.shape[1] < 2:
        raise ValueError(f"an area has the shape {corners.shape}, expected corners of x and y")
    made: list[list[float]] = corners[:, :2].tolist()
    return made
