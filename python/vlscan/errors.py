"""Errors and warnings."""

from __future__ import annotations

import errno
import inspect
import logging
import os
import re
import shutil
import sys
import warnings
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache, partial
from importlib import import_module
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any, Literal, TypeAlias

from ._options import RunOptions

# Methods that do what an option of another name does.
_METHODS = {"lines": "write_lines()"}

# Text in double quotes, or an option of the command line with the word, or the path of a file, after it.
_OPTION = re.compile(
    r'"[^"\n]*"|(?<![\w-])--([a-z][a-z0-9-]*)(?![\w-])(?: ([^\s"]*/[^\s"]*\.\w+(?:#\w+)?|-?\w(?:[\w.:#+-]*\w)?)(?![\w/]))?'
)
_FILE = re.compile(r".*[^\W\d]\w*\.[a-z]\w*(?:#\w+)?")
_PLACEHOLDER = re.compile(r"[A-Z][A-Z0-9_]*(?:\.[a-z]+)?(?:#[A-Z]+)?")
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


@cache
def _keywords() -> dict[str, str]:
    """Return the annotations of all keywords of runs and of public functions."""
    package = import_module(__package__)
    kinds = {name: str(getattr(kind, "__forward_arg__", kind)) for name, kind in RunOptions.__annotations__.items()}
    for function in filter(inspect.isfunction, (getattr(package, name) for name in package.__all__)):
        for parameter in inspect.signature(function).parameters.values():
            kinds.setdefault(parameter.name, str(parameter.annotation))
    return kinds


def _keyword(option: re.Match[str]) -> str:
    """Return the keyword of an option: ``force=True`` of ``--force``, ``cell=2`` of ``--cell 2``, ``crs=`` of ``--crs CODE``."""
    name = option[1] and option[1].replace("-", "_")
    kind = name and _keywords().get(name)
    if not kind:
        return _METHODS.get(name or "", option[0])
    word = option[2] or ""
    rest = word and f" {word}"
    if kind in ("bool", "bool | None"):
        return f"{name}=True{rest}"
    if _PLACEHOLDER.fullmatch(word):
        return f"{name}="
    if _NUMBER.fullmatch(word):
        return f"{name}={word}"
    if word.startswith("EPSG:") or _FILE.fullmatch(word) or f"'{word}'" in kind:
        return f'{name}="{word}"'
    return f"{name}={rest}"


# Folders of files that the package makes of objects for the engine, and names of their files in messages.
_folders: dict[str, str] = {}


@contextmanager
def temporary_folder() -> Iterator[str]:
    """Yield a folder for files of objects in memory, which messages name as ``<points>`` instead of ``/tmp/…/points.laz``."""
    with TemporaryDirectory(prefix="vlscan-") as folder:
        _folders[folder] = ""
        try:
            yield folder
        finally:
            del _folders[folder]


def kept_folder(owner: object, name: str = "") -> str:
    """Return a folder for files of an object, which lives as long as the object.

    Parameters
    ----------
    owner : object
        The object.
    name : str
        Name of the files in messages; ``<points>`` for a file ``points.xyz`` by default.

    Returns
    -------
    str
        The folder.
    """
    folder = mkdtemp(prefix="vlscan-")
    _folders[folder] = name
    weakref.finalize(owner, _remove_folder, folder)
    return folder


def _remove_folder(folder: str) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    _folders.pop(folder, None)


def without_folders(text: str) -> str:
    """Return a text with the names of objects instead of those of their files.

    Parameters
    ----------
    text : str
        The text.

    Returns
    -------
    str
        The text without names of :func:`temporary_folder`.
    """
    for folder, name in tuple(_folders.items()):
        text = re.sub(re.escape(os.path.join(folder, "")) + r"(\w+)(?:\.\w+)*", partial(_name_of_file, name), text)
    return text


def _name_of_file(name: str, found: re.Match[str]) -> str:
    return name or f"<{found[1]}>"


def in_python(text: str) -> str:
    """Return a message of the engine with options as keywords; commands in backticks and quoted text stay.

    Parameters
    ----------
    text : str
        The message.

    Returns
    -------
    str
        The message for a program.
    """
    parts = without_folders(text).split("`")
    is_command = [part.startswith("vlscan ") for part in parts]
    return "`".join(part if kept else _OPTION.sub(_keyword, part) for part, kept in zip(parts, is_command, strict=True))


#: Kinds of problems, for programs that handle some of them.
ProblemKind: TypeAlias = Literal[
    "invalid", "not_found", "exists", "too_large", "missing_entry", "truncated", "unsupported", "not_divisible", "in_use"
]


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
    kind : str
        ``not_found`` (a file), ``exists`` (an output), ``too_large`` (more memory than allowed), ``missing_entry`` (an id, an index),
        ``truncated`` (a file), ``unsupported`` (a feature), ``not_divisible`` (a run into shards), ``in_use`` (a folder of another
        process); ``invalid`` for all others.
    """

    severity: str
    message: str
    file: str | None = None
    line: int | None = None
    column: int | None = None
    help: str | None = None
    kind: ProblemKind = "invalid"

    def __post_init__(self) -> None:
        for name in ("message", "help"):
            text = getattr(self, name)
            object.__setattr__(self, name, text and in_python(text))
        object.__setattr__(self, "file", self.file and without_folders(self.file))


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
    """Input that is accepted although it is suspicious.

    Parameters
    ----------
    text : str
        The message, with its place.
    problem : Problem, optional
        The problem.

    Attributes
    ----------
    problem : Problem or None
        The problem with file, line, column and help; ``None`` for warnings of the package itself.
    """

    def __init__(self, text: str, problem: Problem | None = None) -> None:
        super().__init__(text)
        self.problem = problem


# What runs note; programs choose what is shown.
_log = logging.getLogger("vlscan")
_log.addHandler(logging.NullHandler())


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


def missing_file(path: str) -> FileError:
    """Return the error of a file that does not exist.

    Parameters
    ----------
    path : str
        The file.

    Returns
    -------
    FileError
        The error.
    """
    return FileError(errno.ENOENT, os.strerror(errno.ENOENT), path)


# Packages of the wheel, and what runs between their functions: a warning is of the line that called them.
_PACKAGES = ("vlscan", "vlscan_helios", "contextlib", "pydantic")


def report(problems: Sequence[Mapping[str, Any]]) -> None:
    """Issue each warning of the engine as a :class:`VlscanWarning`, and log notes.

    Parameters
    ----------
    problems : sequence of mapping
        Fields of :class:`Problem`.
    """
    for problem in (Problem(**fields) for fields in problems):
        if problem.severity == "warning":
            place = [str(part) for part in (problem.file, problem.line, problem.column) if part is not None]
            lines = [f"{':'.join(place)}: {problem.message}" if place else problem.message]
            lines += [f"help: {problem.help}"] if problem.help else []
            warn("\n".join(lines), problem)
        elif problem.severity == "note":
            _log.info("%s", problem.message)


def warn(text: str, problem: Problem | None = None) -> None:
    """Issue a :class:`VlscanWarning` at the line of the program that called the package.

    Parameters
    ----------
    text : str
        The message.
    problem : Problem, optional
        The problem of the engine.
    """
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in _PACKAGES:
        frame, level = frame.f_back, level + 1
    warnings.warn(VlscanWarning(in_python(text), problem), stacklevel=level)
