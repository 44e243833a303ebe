"""Errors of runs."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

from vlscan import Error, FileError, InputError, Problem, VlscanWarning


class HeliosException(RuntimeError):
    """Any error of a run: what the engine says, which is the cause of the exception, too."""


class _InputException(HeliosException, InputError):
    """Input that is invalid: an error of both packages."""


class _FileException(HeliosException, FileError):
    """A file that cannot be read or written: an error of both packages."""


class _RunException(HeliosException, Error):
    """Another error of a run."""


# A place in a file, whose attributes keep their names.
_IN_FILE = re.compile(r"\.xml:\d")


class _Names:
    """Names in messages of a survey in memory and of its settings.

    Parameters
    ----------
    fields : mapping, optional
        Fields of settings by the attributes of XML that stand for them.
    """

    def __init__(self, fields: Mapping[str, str] | None = None) -> None:
        self._fields = fields or {}
        # Quoted lines of XML keep their attributes, which a value follows.
        self._attribute = re.compile(rf"\b(?:{'|'.join(map(re.escape, self._fields))})\b(?!=)") if fields else None

    def of_text(self, text: str) -> str:
        """Return a text with these names."""
        text = text.replace("<python>", "<survey>")
        if self._attribute is None or _IN_FILE.search(text):
            return text
        return self._attribute.sub(lambda found: self._fields[found.group()], text)

    def of_problem(self, problem: Problem) -> Problem:
        """Return a problem with these names."""
        message = problem.message if (problem.file or "").endswith(".xml") else self.of_text(problem.message)
        file, advice = problem.file and self.of_text(problem.file), problem.help and self.of_text(problem.help)
        return replace(problem, message=message, file=file, help=advice)


@contextmanager
def engine_errors(fields: Mapping[str, str] | None = None) -> Iterator[None]:
    """Raise errors of the engine as :class:`HeliosException`.

    Messages name ``fields`` instead of the attributes of XML that these are values of.
    """
    names = _Names(fields)
    try:
        yield
    except HeliosException:
        raise
    except InputError as error:
        made = _InputException(names.of_text(str(error)))
        made.problems = [names.of_problem(problem) for problem in error.problems]
        raise made from error
    except FileError as error:
        raise _FileException(*error.args, *([] if error.filename is None else [error.filename])) from error
    except Error as error:
        raise _RunException(names.of_text(str(error))) from error


# Warnings that have been shown, as of a module.
_shown: dict[str | tuple[str, type[Warning], int], int] = {}


@contextmanager
def engine_warnings(is_silent: bool, fields: Mapping[str, str] | None = None) -> Iterator[None]:
    """Issue the warnings of a run at its end, none if it is silent; messages have the names of :func:`engine_errors`."""
    names = _Names(fields)
    caught: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            caught = found
            yield
    finally:
        for warning in [] if is_silent else caught:
            message = warning.message
            if isinstance(message, VlscanWarning):
                problem = message.problem and names.of_problem(message.problem)
                message = VlscanWarning(names.of_text(str(message)), problem)
            warnings.warn_explicit(message, warning.category, warning.filename, warning.lineno, registry=_shown)


class WrongTypeError(TypeError, ValueError):
    """A value of another type: models and checked functions raise ``ValueError``, plain functions ``TypeError``."""


def wrong_input(text: str) -> HeliosException:
    """Return the error of a value, which is a ``ValueError``, too.

    Parameters
    ----------
    text : str
        The message.

    Returns
    -------
    HeliosException
        The error.
    """
    return _InputException(text)
