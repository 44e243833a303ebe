"""Lists of what ships: scanners, platforms, options of runs, columns of points."""

from __future__ import annotations

from difflib import get_close_matches
from functools import cache
from typing import NamedTuple

from . import _vlscan
from .errors import InputError


class Option(NamedTuple):
    """An option of a run: a keyword of :meth:`vlscan.Survey.run`."""

    help: str
    #: Whether it takes a value; otherwise it is ``True`` or ``False``.
    has_value: bool
    #: Whether a list gives it more than once.
    is_list: bool


class Column(NamedTuple):
    """A column of points."""

    #: Unit; empty for plain numbers.
    unit: str
    #: What the values are.
    description: str


@cache
def _known() -> tuple[dict[str, str], dict[str, tuple[str, str]], dict[str, str]]:
    scanner_rows, platform_rows = _vlscan.catalogue()
    names = {reference.split("#")[1]: name for reference, name in scanner_rows}
    references = {reference.split("#")[1]: (reference, name) for reference, name in scanner_rows}
    carriers = {reference.split("#")[1]: reference for reference in platform_rows}
    return names, references, carriers


def scanners() -> dict[str, str]:
    """Ids and names of the scanners that ship."""
    return dict(_known()[0])


def platforms() -> list[str]:
    """Ids of the platforms that ship."""
    return list(_known()[2])


@cache
def _options() -> dict[str, Option]:
    hidden = {"out", "output", "trajectory", "scene", "schedule_log", "progress", "parts"}
    rows = _vlscan.options()
    found = {name.replace("-", "_"): Option(text, has_value, is_list) for name, text, has_value, is_list in rows}
    return {name: option for name, option in found.items() if name not in hidden}


def options() -> dict[str, Option]:
    """The options of a run, by keyword."""
    return dict(_options())


def columns() -> dict[str, Column]:
    """The columns of points, by name."""
    return {name: Column(unit, text) for name, unit, text in _vlscan.columns()}


def scanner_reference(name: str) -> str:
    """The reference of a scanner: of one that ships by its id, of others as it is (``file.xml#id``)."""
    return _reference(name, {key: value[0] for key, value in _known()[1].items()}, "scanner", "vlscan.scanners()")


def platform_reference(name: str) -> str:
    """The reference of a platform, as :func:`scanner_reference`."""
    return _reference(name, _known()[2], "platform", "vlscan.platforms()")


def _reference(name: str, known: dict[str, str], kind: str, listing: str) -> str:
    if "#" in name or "/" in name or name.endswith(".xml"):
        return name
    if name in known:
        return known[name]
    close = get_close_matches(name, known, 1)
    hint = f"did you mean {close[0]!r}?" if close else f"{listing} lists those that ship; one of your own is file.xml#id"
    message = f"no {kind} that ships has the id {name!r}"
    problem = {"severity": "error", "message": message, "help": hint}
    raise InputError(f"{message}; {hint}", [problem])
