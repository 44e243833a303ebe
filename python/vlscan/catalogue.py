"""Lists of what ships: scanners, platforms, options of runs, columns of points."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from typing import NamedTuple

from . import _vlscan
from .errors import InputError


class Option(NamedTuple):
    """An option of a run: a keyword of :meth:`vlscan.Survey.run`.

    Attributes
    ----------
    help : str
        What it does.
    has_value : bool
        Whether it takes a value; otherwise it is ``True`` or ``False``.
    is_list : bool
        Whether a list gives it more than once.
    is_of_files : bool
        Whether it says how files of points are written, so that a run to memory refuses it.
    """

    help: str
    has_value: bool
    is_list: bool
    is_of_files: bool


class Column(NamedTuple):
    """A column of points.

    Attributes
    ----------
    unit : str
        Unit; empty for plain numbers.
    description : str
        What the values are.
    """

    unit: str
    description: str


@cache
def _instruments() -> tuple[dict[str, str], dict[str, str], dict[str, str]]:
    """Names of the scanners, references of the scanners and of the platforms, by id."""
    scanner_rows, platform_rows = _vlscan.catalogue()
    names = {_id(reference): name for reference, name in scanner_rows}
    return names, {_id(reference): reference for reference, _ in scanner_rows}, {_id(row): row for row in platform_rows}


def _id(reference: str) -> str:
    return reference.split("#")[1]


def scanners() -> dict[str, str]:
    """List the scanners of the catalogue.

    Returns
    -------
    dict of str to str
        Names by id.

    Examples
    --------
    >>> vlscan.scanners()["riegl_vz400"]
    'RIEGL VZ-400'
    """
    return dict(_instruments()[0])


def platforms() -> list[str]:
    """List the platforms that ship.

    Returns
    -------
    list of str
        Ids.

    Examples
    --------
    >>> "sr22" in vlscan.platforms()
    True
    """
    return list(_instruments()[2])


@cache
def _options() -> dict[str, Option]:
    rows = _vlscan.options()
    return {name.replace("-", "_"): Option(text, has_value, is_list, files) for name, text, has_value, is_list, files in rows}


def options() -> dict[str, Option]:
    """List the options of a run.

    Returns
    -------
    dict of str to Option
        Options by keyword.

    Examples
    --------
    >>> vlscan.options()["seed"].has_value
    True
    """
    return dict(_options())


def columns() -> dict[str, Column]:
    """List the columns of points.

    Returns
    -------
    dict of str to Column
        Columns by name.

    Examples
    --------
    >>> vlscan.columns()["X"].unit
    'm'
    """
    return {name: Column(unit, text) for name, unit, text in _vlscan.columns()}


def scanner_reference(name: str) -> str:
    """Return the reference of a scanner.

    Parameters
    ----------
    name : str
        The id of one that ships, or ``file.xml#id``.

    Returns
    -------
    str
        ``file.xml#id``.

    Raises
    ------
    InputError
        No scanner that ships has the id.
    """
    return _reference(name, _instruments()[1], "scanner", "vlscan.scanners()")


def platform_reference(name: str) -> str:
    """Return the reference of a platform.

    Parameters
    ----------
    name : str
        The id of one that ships, or ``file.xml#id``.

    Returns
    -------
    str
        ``file.xml#id``.

    Raises
    ------
    InputError
        No platform that ships has the id.
    """
    return _reference(name, _instruments()[2], "platform", "vlscan.platforms()")


def _reference(name: str, known: Mapping[str, str], kind: str, listing: str) -> str:
    if "#" in name or "/" in name or name.endswith(".xml"):
        return name
    if name in known:
        return known[name]
    close = get_close_matches(name, known, 1)
    hint = f"did you mean {close[0]!r}?" if close else f"{listing} lists those that ship; one of your own is file.xml#id"
    message = f"no {kind} that ships has the id {name!r}"
    problem = {"severity": "error", "message": message, "help": hint}
    raise InputError(f"{message}; {hint}", [problem])
