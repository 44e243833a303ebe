"""Options of a run as values of the engine."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable, Mapping
from datetime import date, datetime, timezone
from difflib import get_close_matches
from functools import wraps
from typing import TypeVar, cast

import numpy as np

from . import catalogue
from ._arguments import path_of, truth
from ._typing import PathLike

Function = TypeVar("Function", bound=Callable[..., object])


def renamed(**names: str) -> Callable[[Function], Function]:
    """Accept earlier names of arguments, which a function's signature no longer has: ``renamed(earlier="now")``."""

    def decorate(function: Function) -> Function:
        @wraps(function)
        def call(*args: object, **arguments: object) -> object:
            for earlier, now in names.items():
                if earlier in arguments:
                    if now in arguments:
                        raise TypeError(f"{earlier} is the earlier name of {now}; give {now} only")
                    arguments[now] = arguments.pop(earlier)
            return function(*args, **arguments)

        return cast(Function, call)

    return decorate


def values_of(options: Mapping[str, object], call: Callable[..., object] | None = None, *, writes_files: bool = True) -> dict[str, object]:
    """Return the values of options for the engine.

    Parameters
    ----------
    options : mapping
        Values by name, as the caller gave them.
    call : callable, optional
        The public function that takes the options; its arguments are suggested for an unknown one.
    writes_files : bool
        True if options of files have an effect.

    Returns
    -------
    dict
        Numbers, texts, lists and dictionaries by name; options that are ``None`` are left out.

    Raises
    ------
    TypeError
        No option has such a name, or a value is of another kind.
    ValueError
        An option of files where none are written.
    """
    known = catalogue.options()
    values: dict[str, object] = {}
    for name, value in options.items():
        if name not in known:
            close = get_close_matches(name, _arguments(call, writes_files), 1)
            hint = f"did you mean {close[0]!r}?" if close else "vlscan.options() lists them"
            raise TypeError(f"no option of a run is called {name!r}; {hint}")
        value = _plain(name, value, known[name].has_value)
        if value is None or (value is False and known[name].has_value):
            continue
        if known[name].is_of_files and not writes_files and value is not False:
            raise ValueError(f"{name} is an option of files, but this run writes none; name them with run(to=...)")
        if name == "columns" and isinstance(value, Iterable) and not isinstance(value, str):
            # Of a dictionary, such as that of `vlscan.columns()`, its keys.
            value = list(value)
        if name == "columns" and value == []:
            raise ValueError("columns names no column; leave it out for those of a run by default")
        values[name] = [value] if known[name].is_list and not isinstance(value, (dict, list)) else value
    return values


def recorded(
    to: PathLike | Iterable[PathLike] | None,
    waveforms: bool | None,
    pulses: bool | None,
    options: Mapping[str, object],
    call: Callable[..., object],
) -> tuple[dict[str, object], list[str]]:
    """Return the values of the options of a run, and what it leaves in memory.

    Parameters
    ----------
    to : str, path-like or iterable of them, optional
        The files of points.
    waveforms, pulses : bool, optional
        True if they are recorded, too.
    options : mapping
        Other options.
    call : callable
        As for :func:`values_of`.

    Returns
    -------
    values : dict
        The values for the engine.
    tables : list of str
        Names of the tables in memory.

    Raises
    ------
    TypeError, ValueError
        As for :func:`values_of`; ``to`` names no file, or there is another folder of outputs.
    """
    given = {"waveforms": waveforms, "pulses": pulses}
    switches = {name: None if value is None else truth(name, value) for name, value in given.items()}
    if to is None and options.get("output") is None:
        # The run counts the points of its first table.
        tables = ["points", *(name for name, is_wanted in switches.items() if is_wanted), "trajectory"]
        return values_of(options, call, writes_files=False), tables
    values = values_of(options, call) | {name: is_wanted for name, is_wanted in switches.items() if is_wanted is not None}
    if hasattr(to, "write"):
        raise TypeError("to is the name of a file, or several, found a file object; run().points.write(file, format=...) writes to one")
    if to is None:
        return values, ["trajectory"]
    if "output" in values:
        raise ValueError("give either to, the names of files, or output, a folder in the layout of HELIOS++")
    if not isinstance(to, (str, bytes, os.PathLike, Iterable)):
        raise TypeError(f"to is the name of a file, or several, found {type(to).__name__}")
    files = [to] if isinstance(to, (str, bytes, os.PathLike)) else list(to)
    if not files:
        raise ValueError("to names no file; without it the points stay in memory")
    return {**values, "out": [path_of("to", file) for file in files]}, ["trajectory"]


def _arguments(call: Callable[..., object] | None, writes_files: bool) -> list[str]:
    """Return the names of the arguments of a function, options included; without those of files if it never writes any."""
    parameters = [] if call is None else inspect.signature(call).parameters.values()
    own = [parameter.name for parameter in parameters if parameter.kind != parameter.VAR_KEYWORD and parameter.name != "self"]
    takes_files = writes_files or "to" in own
    return own + [name for name, option in catalogue.options().items() if takes_files or not option.is_of_files]


def _plain(name: str, value: object, has_value: bool) -> object:
    """Return a value of an option as the engine takes it; a switch is a truth value, and nothing else is one."""
    if isinstance(value, np.bool_):
        value = bool(value)
    if not has_value and isinstance(value, (int, np.integer)):
        if value not in (0, 1):
            raise TypeError(f"{name} is True or False, found {value!r}")
        return bool(value)
    if not has_value and value is not None:
        raise TypeError(f"{name} is True or False, found {value!r}")
    if value is True:
        raise TypeError(f"{name} needs a value, found True")
    if isinstance(value, np.datetime64) and np.isnat(value):
        raise ValueError(f"{name} is NaT, expected a time")
    return _value(value)


def _value(value: object) -> object:
    """Return a value with the types of Python: numbers, texts, lists and dictionaries."""
    if isinstance(value, (os.PathLike, bytes)):
        return os.fsdecode(value)
    if hasattr(value, "to_wkt"):
        # A coordinate reference system of pyproj.
        return str(value.to_wkt("WKT1_GDAL"))
    if isinstance(value, np.datetime64):
        # The finest step of times in Python.
        value = value.astype("datetime64[us]").tolist()
    if isinstance(value, date) and not isinstance(value, datetime):
        value = datetime(value.year, value.month, value.day)
    if isinstance(value, datetime):
        return str(value if value.tzinfo is None else value.astimezone(timezone.utc).replace(tzinfo=None))
    if hasattr(value, "tolist"):
        # Scalars and arrays of NumPy and of libraries like it.
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _value(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_value(item) for item in value]
    return value
