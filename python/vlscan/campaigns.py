"""Data sets of many runs."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from . import _vlscan
from ._arguments import path_of
from ._libraries import counting_bar, needed
from ._typing import PathLike

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class CampaignReport:
    """The state of a campaign's data set.

    Parameters
    ----------
    computed : int
        Cells that the call has computed.
    seconds : float
        How long it took, s.
    cells : int
        Cells of the campaign.
    left : int
        Cells that are neither complete nor failed.
    points : int
        Points of all cells.
    manifest : path-like or None
        The manifest, which is written when no cell is left.
    failed : list of tuple
        Names of the cells that have failed, each with the reason.
    """

    computed: int
    seconds: float
    cells: int
    left: int
    points: int
    manifest: os.PathLike[str] | None
    failed: list[tuple[str, str]]

    def records(self) -> list[dict[str, Any]]:
        """Return the lines of the manifest.

        Returns
        -------
        list of dict
            A dictionary for each cell; none until the manifest is written.
        """
        if self.manifest is None:
            return []
        with open(self.manifest, encoding="utf-8") as file:
            return [json.loads(line) for line in file]

    def to_pandas(self) -> pandas.DataFrame:
        """Return the manifest as a table.

        Returns
        -------
        pandas.DataFrame
            A row for each cell.
        """
        frame: pandas.DataFrame = needed("pandas", "to_pandas()").json_normalize(self.records())
        return frame


def run_campaign(
    path: PathLike,
    *,
    task: tuple[int, int] | None = None,
    cells: Iterable[str] = (),
    retry: bool = False,
    verify: bool = False,
    threads: int | None = None,
    strict: bool = False,
    notify: Callable[[str, str, str], object] | None = None,
    progress: bool | None = None,
) -> CampaignReport:
    """Compute the cells of a campaign that are left, as ``vlscan campaign`` does. A cell that fails stops no other.

    The campaign's folder is the working directory of the process meanwhile, so that a process computes one campaign at a time.

    Parameters
    ----------
    path : str or path-like
        The campaign's file.
    task : tuple of int, optional
        K and N: every N-th cell only, from cell K on, with K from 0 to N-1.
    cells : iterable of str
        Names of the cells; all by default.
    retry : bool
        True if cells that have failed are computed again.
    verify : bool
        True if the checksums of all files of complete cells are compared.
    threads : int, optional
        Threads of this process; all by default.
    strict : bool
        True if warnings about the input are errors.
    notify : callable, optional
        Called with the kind of an event (``warning``, ``damaged``, ``completed``, ``failed``), the name of the cell, and a text.
    progress : bool, optional
        True for a bar of tqdm that counts cells; by default there is one in notebooks where tqdm is installed.

    Returns
    -------
    CampaignReport
        The state of the data set.

    Raises
    ------
    InputError
        The campaign is invalid, or has no such cell.
    """
    fields = {"task": task, "cells": list(cells), "retry": retry, "verify": verify, "threads": threads, "strict": strict}
    name = path_of("path", path)
    if not (notify is None or callable(notify)):
        raise TypeError(f"notify is {notify!r}, expected a function")
    total = 0 if progress is False else len(_vlscan.campaign_cells(name, fields))
    with counting_bar(progress, total, "cell") as count:

        def tell(kind: str, cell: str, text: str) -> None:
            if kind in ("completed", "failed"):
                count(cell)
            if notify is not None:
                notify(kind, cell, text)

        return CampaignReport(**_vlscan.run_campaign(name, fields, tell))


def campaign_cells(path: PathLike, *, task: tuple[int, int] | None = None, retry: bool = False, strict: bool = False) -> list[str]:
    """List the cells of a campaign that are left, as ``vlscan campaign --list`` does.

    Parameters
    ----------
    path : str or path-like
        The campaign's file.
    task : tuple of int, optional
        As for :func:`run_campaign`.
    retry : bool
        True if cells that have failed are left, too.
    strict : bool
        True if warnings about the input are errors.

    Returns
    -------
    list of str
        Names of the cells that are neither complete nor failed.

    Raises
    ------
    InputError
        The campaign is invalid.

    Examples
    --------
    >>> vlscan.campaign_cells("campaign.toml")
    ['ground-drone-1']
    """
    fields: dict[str, Any] = {"task": task, "cells": [], "retry": retry, "verify": False, "threads": None, "strict": strict}
    return _vlscan.campaign_cells(path_of("path", path), fields)
