"""Scanners: by name, from files, and a function for each that ships (``riegl_vz_400()``)."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from copy import copy
from difflib import get_close_matches
from typing import Any

from .. import catalogue
from .settings import FullWaveformSettings, find_asset


class Scanner:
    """An instrument."""

    def __init__(self, reference: str, name: str) -> None:
        self.reference, self.name = reference, name

    @classmethod
    def from_xml(cls, scanner_file: str | os.PathLike[str], scanner_id: str | None = None) -> Scanner:
        """A scanner of a file: the one with the id, else the first."""
        file = find_asset(scanner_file)
        return cls(file if scanner_id is None else f"{file}#{scanner_id}", scanner_id or os.path.basename(file))

    def clone(self) -> Scanner:
        """A copy."""
        return copy(self)

    def __repr__(self) -> str:
        return f"Scanner({self.name!r})"


def _plain(name: str) -> str:
    return re.sub("[^a-z0-9]", "", name.lower())


def find(name: str, known: dict[str, Any], kind: str) -> str:
    """The key of a name, whatever its hyphens, underscores and capitals."""
    for key in known:
        if _plain(key) == _plain(name):
            return key
    close = get_close_matches(_plain(name), [_plain(key) for key in known], 1)
    near = next((key for key in known if close and _plain(key) == close[0]), None)
    hint = f"did you mean {near!r}?" if near else f"there are {', '.join(known)}"
    raise ValueError(f"no {kind} is called {name!r}; {hint}")


def scanner_from_name(scanner_name: str) -> Scanner:
    """A scanner that ships."""
    known = catalogue.scanners()
    key = find(scanner_name, known, "scanner")
    return Scanner(catalogue.scanner_reference(key), known[key])


def list_scanners() -> list[str]:
    """Names of the scanners that ship."""
    return list(catalogue.scanners())


def by_attribute(from_name: Callable[[str], Any]) -> Callable[[str], Callable[[], Any]]:
    """``__getattr__`` of a module with a function for each instrument that ships."""

    def get(name: str) -> Callable[[], Any]:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            found = from_name(name)
        except ValueError as failure:
            raise AttributeError(str(failure)) from None
        return lambda: found.clone()

    return get


__getattr__ = by_attribute(scanner_from_name)


__all__ = ["FullWaveformSettings", "Scanner", "list_scanners", "scanner_from_name"]
