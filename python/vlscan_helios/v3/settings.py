"""Settings: values with units, defaults, and enumerations."""

from __future__ import annotations

import contextlib
import enum
import inspect
import os
from collections.abc import Iterable, Iterator, Mapping
from copy import copy
from difflib import get_close_matches
from itertools import islice
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias, TypeVar

try:
    import pint
except ImportError as failure:  # pragma: no cover
    raise ImportError("vlscan.helios needs pint: pip install 'vlscan[helios]'") from failure

#: The units of all quantities.
units: pint.UnitRegistry[float] = pint.get_application_registry()  # type: ignore[no-untyped-call]

_T = TypeVar("_T")

#: A text with a unit, a quantity of pint, or a number in SI units.
Quantity: TypeAlias = "str | float | pint.Quantity[float]"

_asset_directories: list[str] = []
_seed: list[int | str] = []


def three(values: Iterable[_T]) -> tuple[_T, _T, _T]:
    """Return the first three values."""
    x, y, z = islice(values, 3)
    return x, y, z


def number(value: Quantity, unit: str) -> float:
    """Return a quantity as a number in ``unit``; plain numbers are in ``unit`` already."""
    if isinstance(value, str):
        value = units.parse_expression(value)
    if isinstance(value, pint.Quantity):
        return float(value.magnitude if value.dimensionless and unit == "" else value.to(unit).magnitude)
    return float(value)


_S = TypeVar("_S", bound="Settings")


class Settings:
    """Values by keyword. Unknown keywords are ``ValueError``."""

    #: Unit and default of each keyword; the unit is ``None`` for what is no quantity.
    FIELDS: ClassVar[dict[str, tuple[str | None, Any]]] = {}
    __signature__: ClassVar[inspect.Signature]

    def __init_subclass__(cls) -> None:
        # The signature and the parameters in the documentation follow from the fields.
        fields = cls.FIELDS.items()
        keywords = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default) for name, (_, default) in fields]
        cls.__signature__ = inspect.Signature(keywords)
        rows = [f"{name} : {unit or type(default).__name__}\n    Default: {default}." for name, (unit, default) in fields]
        cls.__doc__ = "\n".join([f"{cls.__doc__}\n\nParameters\n----------", *rows])

    def __init__(self, **values: Any) -> None:
        for name in values:
            self._check(name)
        for name, (_, default) in self.FIELDS.items():
            setattr(self, name, values.get(name, default))

    @classmethod
    def _check(cls, name: str) -> None:
        if name not in cls.FIELDS:
            close = get_close_matches(name, cls.FIELDS, 1)
            hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(cls.FIELDS)}"
            raise ValueError(f"{cls.__name__} has no {name!r}; {hint}")

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    def __setattr__(self, name: str, value: Any) -> None:
        self._check(name)
        unit = self.FIELDS[name][0]
        if unit is not None and value is not None:
            value = number(value, unit)
        object.__setattr__(self, name, value)

    def changed(self) -> dict[str, Any]:
        """Return the values that differ from their defaults.

        Returns
        -------
        dict
            Values by keyword.
        """
        mine = {name: getattr(self, name) for name in self.FIELDS}
        return {name: value for name, value in mine.items() if value != self.FIELDS[name][1]}

    def clone(self: _S) -> _S:
        """Return a copy.

        Returns
        -------
        Settings
            The copy.
        """
        return copy(self)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in self.changed().items())})"

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and vars(self) == vars(other)

    __hash__ = None  # type: ignore[assignment]


class ScannerSettings(Settings):
    """What the scanner does on a leg; ``None`` is the scanner's own value."""

    FIELDS: ClassVar = {
        "is_active": (None, True),
        "head_rotation": ("rad/s", None),
        "rotation_start_angle": ("rad", None),
        "rotation_stop_angle": ("rad", None),
        "pulse_frequency": ("Hz", None),
        "scan_angle": ("rad", None),
        "min_vertical_angle": ("rad", None),
        "max_vertical_angle": ("rad", None),
        "scan_frequency": ("Hz", None),
        "beam_divergence_angle": ("rad", None),
        "vertical_resolution": ("rad", None),
        "horizontal_resolution": ("rad", None),
        "trajectory_time_interval": ("s", 0.01),
        "max_duration": ("s", None),
    }


class PlatformSettings(Settings):
    """Where a leg begins."""

    FIELDS: ClassVar = {
        "x": ("m", 0.0),
        "y": ("m", 0.0),
        "z": ("m", 0.0),
        "speed_m_s": ("m/s", 70.0),
        "force_on_ground": (None, False),
    }


class StaticPlatformSettings(PlatformSettings):
    """Where a platform stands."""

    FIELDS: ClassVar = {name: field for name, field in PlatformSettings.FIELDS.items() if name != "speed_m_s"}


class DynamicPlatformSettings(PlatformSettings):
    """Where a leg begins, and how fast the platform moves to the next one."""

    FIELDS: ClassVar = dict(PlatformSettings.FIELDS)


class TrajectorySettings(Settings):
    """The part of a trajectory that a leg flies, on the trajectory's own time."""

    FIELDS: ClassVar = {"start_time": ("s", None), "end_time": ("s", None), "teleport_to_start": (None, False)}


class FullWaveformSettings(Settings):
    """Digitisation of waveforms. ``win_size`` is at least two bins, as in HELIOS++ 3: ``ValueError`` otherwise."""

    FIELDS: ClassVar = {
        "bin_size": ("ns", 0.25),
        "beam_sample_quality": (None, 3),
        "win_size": ("ns", 1.0),
        "max_fullwave_range": ("ns", 0.0),
    }

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)
        self.check()

    def check(self) -> None:
        """Check the window.

        Raises
        ------
        ValueError
            The window is shorter than two bins, so that every bin would count as an echo.
        """
        if self.win_size < 2 * self.bin_size * (1 - 1e-9):
            raise ValueError(f"win_size is {self.win_size} ns, expected at least two bins of bin_size {self.bin_size} ns")


class OutputFormat(str, enum.Enum):
    """What a run returns or writes."""

    NPY = "npy"
    LASPY = "laspy"
    LAS = "las"
    LAZ = "laz"
    XYZ = "xyz"


class LogVerbosity(enum.IntEnum):
    """What a run reports. vlscan prints nothing: its warnings are Python warnings."""

    SILENT = 0
    QUIET = 1
    TIME = 2
    DEFAULT = 3
    VERBOSE = 4
    VERY_VERBOSE = 5


class ParallelizationStrategy(enum.IntEnum):
    """How pulses are handed out to threads; the points are the same."""

    CHUNK = 0
    WAREHOUSE = 1


class ExecutionSettings(Settings):
    """Threads and chunks; the points are the same."""

    FIELDS: ClassVar = {
        "parallelization": (None, ParallelizationStrategy.WAREHOUSE),
        "num_threads": (None, 0),
        "chunk_size": (None, None),
        "warehouse_factor": (None, None),
        "verbosity": (None, LogVerbosity.DEFAULT),
    }


class OutputSettings(Settings):
    """What a run returns or writes."""

    FIELDS: ClassVar = {
        "format": (None, OutputFormat.NPY),
        "output_dir": (None, "output"),
        "las_scale": ("m", None),
        "split_by_channel": (None, False),
        "write_waveform": (None, False),
        "write_pulse": (None, False),
    }


class _AssetDirectory(contextlib.AbstractContextManager[object]):
    def __init__(self, path: str) -> None:
        self._path = path

    def __exit__(self, *_: object) -> None:
        # Of this call only: the same folder may have been added before.
        if self._path in _asset_directories:
            _asset_directories.remove(self._path)


def add_asset_directory(path: str | os.PathLike[str]) -> contextlib.AbstractContextManager[object]:
    """Add a folder in which files are searched.

    Parameters
    ----------
    path : str or path-like
        The folder.

    Returns
    -------
    contextlib.AbstractContextManager
        As a context manager the folder is searched within its block only.
    """
    name = os.fspath(path)
    _asset_directories.append(name)
    return _AssetDirectory(name)


def asset_directories() -> list[str]:
    """Return the folders in which files are searched."""
    return list(dict.fromkeys(_asset_directories))


def find_asset(path: str | os.PathLike[str]) -> str:
    """Return a file: as named, else in the folders of :func:`add_asset_directory`."""
    name = os.fspath(path)
    for folder in ["", *_asset_directories, "assets"]:
        if os.path.exists(os.path.join(folder, name)):
            return os.path.join(folder, name)
    return name


def set_rng_seed(seed: int | str) -> None:
    """Set the seed of all random draws of later runs.

    Parameters
    ----------
    seed : int or str
        The seed.
    """
    _seed[:] = [seed]


def rng_seed() -> int | str | None:
    """Return the seed that was set."""
    return _seed[0] if _seed else None


def combine_parameters(*settings: _S, **values: Any) -> _S:
    """Join settings of one kind.

    Parameters
    ----------
    *settings : Settings
        Values of later ones that differ from their defaults replace those of earlier ones.
    **values : Any
        Values by keyword, which replace all.

    Returns
    -------
    Settings
        The joined settings.

    Raises
    ------
    ValueError
        No settings, of several kinds, or unknown keywords.
    """
    if not settings:
        raise ValueError("combine_parameters() needs settings")
    if len({type(each) for each in settings}) > 1:
        raise ValueError("combine_parameters() needs settings of one kind")
    merged = settings[0].clone()
    for name, value in _all_changes(settings[1:], values):
        setattr(merged, name, value)
    return merged


def _all_changes(settings: Iterable[Settings], values: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for each in settings:
        yield from each.changed().items()
    yield from values.items()


def split(values: Mapping[str, Any], *kinds: type[Settings]) -> list[dict[str, Any]]:
    """Keywords by the kind of settings that has them; ``ValueError`` for those that none has."""
    shares: list[dict[str, Any]] = [{} for _ in kinds]
    for name, value in values.items():
        homes = [share for share, kind in zip(shares, kinds, strict=True) if name in kind.FIELDS]
        if not homes:
            known = [field for kind in kinds for field in kind.FIELDS]
            close = get_close_matches(name, known, 1)
            hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(known)}"
            raise ValueError(f"unknown keyword {name!r}; {hint}")
        homes[0][name] = value
    return shares
