"""Errors and warnings."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Problem:
    """A problem of the input, with its place in a file if it has one.

    Parameters
    ----------
    severity : str
        ``error``, ``warning`` or ``note``.
    message : str
        The problem and what was expected.
    file : str, optional
        The file; ``<python>`` for what a program describes.
    line, column : int, optional
        The place in the file, from 1.
    help : str, optional
        How to solve it.
    """

    severity: str
    message: str
    file: str | None = None
    line: int | None = None
    column: int | None = None
    help: str | None = None


class Error(Exception):
    """Any error of a run."""


class InputError(Error, ValueError):
    """Input that is invalid.

    Parameters
    ----------
    text : str
        The report of all problems.
    problems : sequence of mapping, optional
        Fields of :class:`Problem`.

    Attributes
    ----------
    problems : list of Problem
        Every problem with file, line, column and help.

    Examples
    --------
    >>> try:
    ...     vlscan.Scanner("riegl_vz40")
    ... except vlscan.InputError as error:
    ...     print(error.problems[0].help)
    did you mean 'riegl_vz400'?
    """

    def __init__(self, text: str, problems: Sequence[Mapping[str, Any]] | None = None) -> None:
        super().__init__(text)
        self.problems: list[Problem] = [Problem(**fields) for fields in problems or []]

    def __reduce__(self) -> tuple[Any, ...]:
        return InputError, (str(self), [asdict(problem) for problem in self.problems])


class FileError(Error, OSError):
    """A file that cannot be read or written."""


class VlscanWarning(UserWarning):
    """Input that is accepted although it is suspicious."""


def file_error(text: str, number: int | None, path: str) -> FileError:
    """Return the error of an operation on a file.

    Parameters
    ----------
    text : str
        The message for an error without a number.
    number : int or None
        Number of the error of the operating system.
    path : str
        The file.

    Returns
    -------
    FileError
        The error.
    """
    return FileError(text) if number is None else FileError(number, os.strerror(number), path)


# Packages of the wheel: a warning is of the line that called them.
_PACKAGES = ("vlscan", "vlscan_helios")


def warn(text: str) -> None:
    """Issue a :class:`VlscanWarning` at the line of the program that called the package.

    Parameters
    ----------
    text : str
        The message.
    """
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in _PACKAGES:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, VlscanWarning, stacklevel=level)
