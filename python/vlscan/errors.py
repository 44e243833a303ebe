"""Errors and warnings."""

from __future__ import annotations

import os
import sys
import warnings
from dataclasses import dataclass


@dataclass(frozen=True)
class Problem:
    """A problem of the input, with its place in a file if it has one."""

    #: ``error``, ``warning`` or ``note``.
    severity: str
    #: The problem and what was expected.
    message: str
    #: The file; ``<python>`` for what a program describes.
    file: str | None = None
    #: Line, from 1.
    line: int | None = None
    #: Column, from 1.
    column: int | None = None
    #: How to solve it.
    help: str | None = None


class Error(Exception):
    """Any error of a run."""


class InputError(Error, ValueError):
    """Input that is invalid. :attr:`problems` has every problem with file, line, column and help."""

    def __init__(self, text: str, problems: list[dict] | None = None) -> None:
        super().__init__(text)
        self.problems: list[Problem] = [Problem(**fields) for fields in problems or []]


class FileError(Error, OSError):
    """A file that cannot be read or written."""


class VlscanWarning(UserWarning):
    """Input that is accepted although it is suspicious."""


def file_error(text: str, number: int | None, path: str) -> FileError:
    """The error of an operation on a file; ``number`` is the one of the operating system."""
    if number is None:
        return FileError(text)
    error = FileError(number, os.strerror(number), path)
    return error


_PACKAGE = os.path.dirname(__file__) + os.sep


def warn(text: str) -> None:
    """Issues a warning at the line of the program that called the package."""
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, VlscanWarning, stacklevel=level)
