"""Forecasts of runs."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from ._libraries import needed

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Estimate:
    """A number with its uncertainty.

    Parameters
    ----------
    value : float
        The number.
    uncertainty : float
        Two standard errors, as a fraction of the number.
    """

    value: float
    uncertainty: float

    def __float__(self) -> float:
        return self.value


@dataclass(frozen=True)
class LegEstimate:
    """A leg of a forecast.

    Parameters
    ----------
    leg : int
        Number of the leg in the survey.
    seconds : float
        Duration, s.
    pulses : float
        Number of pulses.
    points : float or None
        Number of points; ``None`` where the sample has no pulse.
    range_m : float or None
        Mean range of first echoes, m.
    footprint_m : float or None
        Diameter of the beam there, m.
    along_m, across_m : float or None
        Distances of points along the flight, and of successive points, m.
    """

    leg: int
    seconds: float
    pulses: float
    points: float | None
    range_m: float | None
    footprint_m: float | None
    along_m: float | None
    across_m: float | None


@dataclass(frozen=True)
class FileEstimate:
    """A file that a run will write.

    Parameters
    ----------
    name : str
        Its path, or what it is.
    content : str
        Kind of its records: points, waveforms, pulses, poses.
    bytes : float
        Size, bytes.
    """

    name: str
    content: str
    bytes: float


@dataclass(frozen=True)
class Missed:
    """Pulses, area and legs that a run will miss.

    Parameters
    ----------
    pulses : float
        Fraction of the pulses without an echo.
    beside_scene, out_of_range : float
        Fractions of the pulses that pass beside the scene, and of those for which it is out of range.
    area : float
        Fraction of the scene's box, seen from above, that no swath covers.
    legs : list of int
        Legs that fire and have no point.
    """

    pulses: float
    beside_scene: float
    out_of_range: float
    area: float
    legs: list[int]


@dataclass(frozen=True)
class Duration:
    """Duration of a run on this machine.

    Parameters
    ----------
    loading_s, simulation_s, total_s : float
        Loading of the scene, from the first pulse to the last byte, and both, s.
    uncertainty : float
        Two standard errors, as a fraction of the total.
    threads : int
        Number of threads.
    """

    loading_s: float
    simulation_s: float
    total_s: float
    uncertainty: float
    threads: int


@dataclass(frozen=True)
class DryRun:
    """Estimates of the cost and the results of a run.

    Parameters
    ----------
    legs : list of LegEstimate
        Legs that take time.
    epochs : int
        Number of flights, one for each state of a scene with swapped parts.
    duration_s : float
        Time of the survey, s.
    pulses : float
        Number of pulses.
    pulses_are_counted : bool
        True if they were counted and not estimated.
    points : Estimate
        Number of points.
    covered_m2 : float
        Ground that swaths cover, m².
    points_per_m2, pulses_per_m2 : float or None
        Densities on that ground.
    files : list of FileEstimate
        Files that the run writes.
    memory_bytes : int
        Most memory that loading and sample have needed, bytes.
    time : Duration
        How long the run takes.
    missed : Missed
        Pulses, area and legs that the run misses.
    sampled_pulses : float
        Pulses of the sample.

    Examples
    --------
    >>> forecast = vlscan.dry_run("fixtures/room/survey.xml")
    >>> forecast.pulses_are_counted, forecast.time.threads > 0
    (True, True)
    """

    legs: list[LegEstimate]
    epochs: int
    duration_s: float
    pulses: float
    pulses_are_counted: bool
    points: Estimate
    covered_m2: float
    points_per_m2: float | None
    pulses_per_m2: float | None
    files: list[FileEstimate]
    memory_bytes: int
    time: Duration
    missed: Missed
    sampled_pulses: float

    @staticmethod
    def of(text: str) -> DryRun:
        """Return the forecast that the engine has written.

        Parameters
        ----------
        text : str
            JSON, as ``vlscan run --dry-run --json`` writes it.

        Returns
        -------
        DryRun
            The forecast.
        """
        fields: dict[str, Any] = json.loads(text)
        fields["legs"] = [LegEstimate(**leg) for leg in fields["legs"]]
        fields["files"] = [FileEstimate(**file) for file in fields["files"]]
        fields |= {"points": Estimate(**fields["points"]), "time": Duration(**fields["time"]), "missed": Missed(**fields["missed"])}
        return DryRun(**fields)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the legs as a table.

        Returns
        -------
        pandas.DataFrame
            A row for each leg.
        """
        frame: pandas.DataFrame = needed("pandas", "to_pandas()").DataFrame([asdict(leg) for leg in self.legs])
        return frame

    def __repr__(self) -> str:
        density = "" if self.points_per_m2 is None else f", {self.points_per_m2:.1f} points per m²"
        points = f"{self.points.value:,.0f} ± {100 * self.points.uncertainty:.1f} % points"
        legs = f"{len(self.legs)} leg{'' if len(self.legs) == 1 else 's'}"
        return f"<DryRun: {legs}, {self.pulses:,.0f} pulses, {points}{density}, {self.time.total_s:.1f} s>"
