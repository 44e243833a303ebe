"""Runs that are divided among processes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from . import _vlscan
from ._arguments import path_of, whole
from ._libraries import shown_progress
from ._typing import PathLike, Progress
from ._values import recorded, values_of
from .results import Result
from .survey import Survey, opened

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import RunOptions


def run_shard(
    survey: Survey | PathLike,
    folder: PathLike,
    number: int,
    of: int,
    *,
    resume: bool = False,
    waveforms: bool | None = None,
    pulses: bool | None = None,
    progress: Progress | bool | None = None,
    **options: Unpack[RunOptions],
) -> Path:
    """Compute a shard of a run, as ``vlscan run --shard`` does.

    Parameters
    ----------
    survey : Survey, str or path-like
        A survey, or its file; the same for all shards.
    folder : str or path-like
        The folder of the shards.
    number, of : int
        The shard, from 0 to ``of`` - 1, and how many there are.
    resume : bool
        True if a shard that is complete is kept.
    waveforms, pulses : bool, optional
        True if the shard contains them.
    progress : callable or bool, optional
        As for :meth:`Survey.run`.
    **options : RunOptions
        As for :meth:`Survey.run`; the same for all shards.

    Returns
    -------
    Path
        The file of the shard.

    Raises
    ------
    InputError
        Input is invalid, the shard exists, or the folder is that of another run.

    Examples
    --------
    >>> files = [vlscan.run_shard("fixtures/room/survey.xml", "shards", number, 2, seed=1) for number in range(2)]
    >>> vlscan.merge_shards("shards", to="merged.laz").files
    ['merged.laz']
    """
    number, of = whole("number", number, 0), whole("of", of, 1)
    if number >= of:
        raise ValueError(f"shard {number} of {of}, expected a number from 0 to {of - 1}")
    request, force = _divided(survey, options, waveforms, pulses, run_shard)
    with shown_progress(progress) as tell:
        path, _ = _vlscan.run_shard(request, path_of("folder", folder), (number, of), resume, force, tell)
    return Path(path)


def index_shards(survey: Survey | PathLike, folder: PathLike, **options: Unpack[RunOptions]) -> int:
    """Index where the shards of a run begin, once for all shards, as ``vlscan index-shards`` does.

    Parameters
    ----------
    survey : Survey, str or path-like
        A survey, or its file.
    folder : str or path-like
        The folder of the shards.
    **options : RunOptions
        As for :func:`run_shard`.

    Returns
    -------
    int
        Number of pulses of the run.

    Raises
    ------
    InputError
        Input is invalid, or the folder is that of another run.

    Examples
    --------
    >>> vlscan.index_shards("fixtures/room/survey.xml", "indexed") > 10_000
    True
    """
    request, force = _divided(survey, options, None, None, index_shards)
    _, pulses = _vlscan.run_shard(request, path_of("folder", folder), None, False, force)
    return pulses


def merge_shards(
    folder: PathLike,
    to: PathLike | Iterable[PathLike] | None = None,
    *,
    waveforms: bool | None = None,
    pulses: bool | None = None,
    progress: Progress | bool | None = None,
    **options: Unpack[RunOptions],
) -> Result:
    """Merge the shards of a run to the points or the files of one run, bit for bit, as ``vlscan merge`` does.

    Parameters
    ----------
    folder : str or path-like
        The folder of the shards.
    to, waveforms, pulses, progress : object
        As for :meth:`Survey.run`.
    **options : RunOptions
        Options of outputs, and ``threads``; what was measured is in the shards.

    Returns
    -------
    Result
        The points, or the names of the files.

    Raises
    ------
    InputError
        Shards are missing, damaged, or of another run.

    Examples
    --------
    >>> path = vlscan.run_shard("fixtures/room/survey.xml", "whole", 0, 1, seed=1)
    >>> vlscan.merge_shards("whole").point_count == vlscan.run("fixtures/room/survey.xml", seed=1).point_count
    True
    """
    values, tables = recorded(to, waveforms, pulses, options, merge_shards)
    with shown_progress(progress) as tell:
        outcome = _vlscan.merge_shards(path_of("folder", folder), values, tables, False, tell)
    if outcome is None:
        raise RuntimeError("the shards were checked instead of merged")
    return Result(outcome)


def check_shards(folder: PathLike) -> None:
    """Compare the checksums of all shards, as ``vlscan merge --check`` does.

    Parameters
    ----------
    folder : str or path-like
        The folder of the shards.

    Raises
    ------
    InputError
        Shards are missing, damaged, or of another run; all of them are named.
    """
    _vlscan.merge_shards(path_of("folder", folder), {}, [], True)


def _divided(
    survey: Survey | PathLike, options: RunOptions, waveforms: bool | None, pulses: bool | None, call: Callable[..., object]
) -> tuple[_vlscan.Request, bool]:
    """Return the request of a shard, and whether files are replaced."""
    recorded_too = {name: True for name, is_wanted in (("waveforms", waveforms), ("pulses", pulses)) if is_wanted}
    return opened(survey)._request({**values_of(options, call), **recorded_too}), bool(options.get("force"))
