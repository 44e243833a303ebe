"""Errors of runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from vlscan.errors import Error, FileError, InputError


class HeliosException(RuntimeError):
    """Any error of a run: what the engine says, which is the cause of the exception, too."""


class _InputException(HeliosException, InputError):
    """Input that is invalid: an error of both packages."""


class _FileException(HeliosException, FileError):
    """A file that cannot be read or written: an error of both packages."""


class _RunException(HeliosException, Error):
    """Another error of a run."""


@contextmanager
def engine_errors() -> Iterator[None]:
    """Raise errors of the engine as :class:`HeliosException`."""
    try:
        yield
    except HeliosException:
        raise
    except InputError as error:
        made = _InputException(str(error))
        made.problems = error.problems
        raise made from error
    except FileError as error:
        raise _FileException(*error.args) from error
    except Error as error:
        raise _RunException(str(error)) from error


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
