"""Checks of arguments, whose errors name the argument and what was given for it."""

from __future__ import annotations

import inspect
import math
import numbers
import operator
import os
from collections.abc import Callable
from difflib import get_close_matches
from functools import wraps
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from ._conversions import unmasked

Function = TypeVar("Function", bound=Callable[..., object])

# Kinds of arrays that are no numbers, and how their values become some.
_ADVICE = {
    "c": "real numbers",
    "M": "numbers; (times - times[0]) / numpy.timedelta64(1, 's') are seconds",
    "m": "numbers; durations / numpy.timedelta64(1, 's') are seconds",
}


def array_of(name: str, values: object) -> NDArray[Any]:
    """Return an argument as an array; iterators, texts and sets, rows of different lengths and masked values are errors."""
    if isinstance(values, (str, bytes, set, frozenset, dict)) or (hasattr(values, "__next__") and not hasattr(values, "__array__")):
        advice = "; list() makes a list" if hasattr(values, "__next__") else ""
        raise TypeError(f"{name} is {_shown(values)}, expected numbers in order{advice}")
    try:
        return unmasked(name, values)
    except ValueError as problem:
        if "inhomogeneous" not in str(problem):
            raise
        raise ValueError(f"{name} has rows of different lengths") from None


def reals(name: str, values: object) -> NDArray[np.float64]:
    """Return an argument as an array of doubles.

    Parameters
    ----------
    name : str
        The argument.
    values : array_like
        Its value.

    Returns
    -------
    numpy.ndarray
        The numbers.

    Raises
    ------
    TypeError
        Values that are no real numbers: complex ones, times, texts, objects.
    ValueError
        Rows of different lengths, or masked values.
    """
    array = array_of(name, values)
    if array.dtype.kind in _ADVICE:
        raise TypeError(f"{name} is of {array.dtype}, expected {_ADVICE[array.dtype.kind]}")
    try:
        return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"{name} holds {_shown(_first_wrong(array))}, expected numbers") from None


def _first_wrong(array: NDArray[Any]) -> object:
    """Return the first value that is no number."""
    for value in array.flat:
        try:
            float(value)
        except (TypeError, ValueError):
            return value.item() if isinstance(value, np.generic) else value
    return array


def real(name: str, value: object, unit: str = "") -> float:
    """Return an argument as a number; anything else is a ``TypeError``, whose message has the unit."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    is_number = isinstance(value, (numbers.Real, np.floating, np.integer)) or hasattr(value, "as_tuple")
    if not is_number or isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} is {_shown(value)}, expected a number{unit and f' of {unit}'}")
    return float(value)  # type: ignore[arg-type]


def positive(name: str, value: object, unit: str) -> float:
    """Return an argument as a finite number above 0."""
    number = real(name, value, unit)
    if not 0 < number < math.inf:
        raise ValueError(f"{name} is {number:g}, expected {unit} above 0")
    return number


def whole(name: str, value: object, lowest: int) -> int:
    """Return an argument as a whole number."""
    if isinstance(value, (bool, np.bool_)) or not hasattr(value, "__index__"):
        raise TypeError(f"{name} is {_shown(value)}, expected a whole number")
    number = operator.index(value)
    if number < lowest:
        raise ValueError(f"{name} is {number}, expected at least {lowest}")
    return number


def truth(name: str, value: object) -> bool:
    """Return an argument as a truth value: True, False, 1 or 0."""
    if not isinstance(value, (bool, np.bool_)) and not (isinstance(value, (int, np.integer)) and value in (0, 1)):
        raise TypeError(f"{name} is True or False, found {_shown(value)}")
    return bool(value)


def text(name: str, value: object) -> str:
    """Return an argument as a text."""
    if not isinstance(value, str):
        raise TypeError(f"{name} is {_shown(value)}, expected a text")
    return value


def path_of(name: str, value: object) -> str:
    """Return an argument as the name of a file."""
    if not isinstance(value, (str, bytes, os.PathLike)):
        raise TypeError(f"{name} is {_shown(value)}, expected the name of a file")
    return os.fsdecode(value)


def _shown(value: object) -> str:
    """Return a value for a message: itself, or its type if it is long."""
    shown = repr(value)
    return shown if len(shown) <= 60 and not shown.startswith("<") else f"of the type {type(value).__name__}"


def suggesting(function: Function) -> Function:
    """Make an unknown keyword of a function an error that names the nearest one."""
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    parameters = inspect.signature(function).parameters.values()
    known = [parameter.name for parameter in parameters if parameter.kind in kinds and parameter.name != "self"]

    @wraps(function)
    def call(*args: object, **arguments: object) -> object:
        for name in arguments:
            if name not in known:
                what = type(args[0]).__name__ if function.__name__ == "__init__" else function.__qualname__
                close = get_close_matches(name, known, 1)
                hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(known)}"
                raise TypeError(f"{what}() has no keyword {name!r}; {hint}")
        return function(*args, **arguments)

    return cast(Function, call)
