"""Errors and warnings."""

from __future__ import annotations

import os
import re
import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ._options import RunOptions

# An option of the command line in a message, with the name of its value.
_OPTION = re.compile(r"(?<![\w-])--([a-z][a-z0-9-]*)(?![\w-])(?: [A-Z][A-Z0-9_]*\b)?")


def _keyword(option: re.Match[str]) -> str:
    """Return the keyword of an option: ``force=True`` of ``--force``, ``las_scale=`` of ``--las-scale METRES``."""
    name = option[1].replace("-", "_")
    kind = RunOptions.__annotations__.get(name)
    if kind is None:
        return option[0]
    is_switch = getattr(kind, "__forward_arg__", kind) == "bool | None"
    return f"{name}=True" if is_switch else f"{name}="


def in_python(text: str) -> str:
    """Return a message of the engine with the options of a run as keywords; commands in backticks stay.

    Parameters
    ----------
    text : str
        The message.

    Returns
    -------
    str
        The message for a program.
    """
    parts = text.split("`")
    is_command = [part.startswith("vlscan ") for part in parts]
    return "`".join(part if kept else _OPTION.sub(_keyword, part) for part, kept in zip(parts, is_command))


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

    def __post_init__(self) -> None:
        for name in ("message", "help"):
            text = getattr(self, name)
            object.__setattr__(self, name, text and in_python(text))


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
        super().__init__(in_python(text))
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
    warnings.warn(in_python(text), VlscanWarning, stacklevel=level)
