"""Scanners: by name, from files, and a function for each that ships (``riegl_vz_400()``)."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from copy import copy
from difflib import get_close_matches
from typing import TYPE_CHECKING, TypeVar

from vlscan import catalogue
from vlscan._typing import PathLike

from .settings import FullWaveformSettings, find_asset

if TYPE_CHECKING:
    from typing_extensions import Self

_T = TypeVar("_T")


class Named:
    """A scanner or a platform.

    Parameters
    ----------
    reference : str
        ``file.xml#id``.
    name : str
        Name.
    """

    def __init__(self, reference: str, name: str) -> None:
        self.reference, self.name = reference, name

    @classmethod
    def _of_file(cls, name: PathLike, id: str | None) -> Self:
        file = find_asset(name)
        return cls(file if id is None else f"{file}#{id}", id or os.path.basename(file))

    def clone(self) -> Self:
        """Return a copy.

        Returns
        -------
        Scanner or Platform
            The copy.
        """
        return copy(self)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r})"


class Scanner(Named):
    """An instrument.

    Parameters
    ----------
    reference : str
        ``file.xml#id``.
    name : str
        Name.
    """

    @classmethod
    def from_xml(cls, scanner_file: PathLike, scanner_id: str | None = None) -> Scanner:
        """Return a scanner of a file.

        Parameters
        ----------
        scanner_file : str or path-like
            The file.
        scanner_id : str, optional
            Its id; the first by default.

        Returns
        -------
        Scanner
            The scanner.
        """
        return cls._of_file(scanner_file, scanner_id)


def _plain(name: str) -> str:
    return re.sub("[^a-z0-9]", "", name.lower())


def find(name: str, known: Iterable[str], kind: str) -> str:
    """Return the key of a name, whatever its hyphens, underscores and capitals."""
    for key in known:
        if _plain(key) == _plain(name):
            return key
    close = get_close_matches(_plain(name), [_plain(key) for key in known], 1)
    near = next((key for key in known if close and _plain(key) == close[0]), None)
    hint = f"did you mean {near!r}?" if near else f"there are {', '.join(known)}"
    raise ValueError(f"no {kind} is called {name!r}; {hint}")


def scanner_from_name(scanner_name: str) -> Scanner:
    """Return a scanner that ships.

    Parameters
    ----------
    scanner_name : str
        Its name, whatever its hyphens, underscores and capitals.

    Returns
    -------
    Scanner
        The scanner.

    Raises
    ------
    ValueError
        No scanner has the name.
    """
    known = catalogue.scanners()
    key = find(scanner_name, known, "scanner")
    return Scanner(catalogue.scanner_reference(key), known[key])


def list_scanners() -> list[str]:
    """List the scanners of the catalogue.

    Returns
    -------
    list of str
        Their ids.
    """
    return list(catalogue.scanners())


def by_attribute(from_name: Callable[[str], _T]) -> Callable[[str], Callable[[], _T]]:
    """``__getattr__`` of a module with a function for each instrument that ships."""

    def get(name: str) -> Callable[[], _T]:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            found = from_name(name)
        except ValueError as failure:
            raise AttributeError(str(failure)) from None
        return lambda: copy(found)

    return get


__getattr__ = by_attribute(scanner_from_name)


__all__ = ["FullWaveformSettings", "Scanner", "list_scanners", "scanner_from_name"]
