"""Functions of the module: log level, seed, coordinates."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlscan.errors import VlscanWarning

_seed: list[int | str] = []


def _show_warnings(is_shown: bool) -> None:
    warnings.filterwarnings("default" if is_shown else "ignore", category=VlscanWarning)


def loggingSilent() -> None:
    """Hide the warnings of later simulations, which print nothing else."""
    _show_warnings(False)


def loggingQuiet() -> None:
    """Hide the warnings of later simulations, which print nothing else."""
    _show_warnings(False)


def loggingTime() -> None:
    """Show the warnings of later simulations; :attr:`Output.seconds` is their duration."""
    _show_warnings(True)


def loggingDefault() -> None:
    """Show the warnings of later simulations."""
    _show_warnings(True)


def loggingVerbose() -> None:
    """Show the warnings of later simulations."""
    _show_warnings(True)


def loggingVerbose2() -> None:
    """Show the warnings of later simulations."""
    _show_warnings(True)


def setDefaultRandomnessGeneratorSeed(seed: int | str) -> None:
    """Set the seed of later simulations whose builder has none."""
    _seed[:] = [checked_seed(seed)]


def checked_seed(seed: int | str) -> int | str:
    """Return a seed; a value that is no number and no text is a ``TypeError``."""
    if isinstance(seed, bool) or not isinstance(seed, (int, float, str, np.integer, np.floating)):
        raise TypeError(f"a seed is a whole number or a text, found {seed!r}")
    return seed.item() if isinstance(seed, np.generic) else seed


#: Another name of :func:`setDefaultRandomnessGeneratorSeed`.
default_rand_generator_seed = setDefaultRandomnessGeneratorSeed


def default_seed() -> int | str | None:
    """Return the seed of simulations whose builder has none."""
    return _seed[0] if _seed else None


def _vectors(numbers: tuple[object, ...], names: str) -> NDArray[np.float64]:
    """Return three numbers, or one sequence of them, as an array whose last axis has three values."""
    given = np.asarray(numbers[0] if len(numbers) == 1 else numbers, dtype=float)
    if given.shape[-1:] != (3,):
        raise ValueError(f"expected {names}, found the shape {given.shape}")
    return given


def cartesianToSpherical(*xyz: float | Sequence[float] | NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return radius, angle from the vertical and azimuth (rad) of x, y, z: three numbers, a sequence or rows of them."""
    x, y, z = np.moveaxis(_vectors(xyz, "x, y and z"), -1, 0)
    return np.stack([np.sqrt(x * x + y * y + z * z), np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)], axis=-1)


def sphericalToCartesian(*rtp: float | Sequence[float] | NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return x, y, z of radius, angle from the vertical and azimuth (rad), as :func:`cartesianToSpherical` returns them."""
    radius, tilt, azimuth = np.moveaxis(_vectors(rtp, "radius, angle and azimuth"), -1, 0)
    across = radius * np.sin(tilt)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), radius * np.cos(tilt)], axis=-1)
