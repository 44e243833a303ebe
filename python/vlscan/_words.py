"""Options of a run as words of a command line."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from datetime import datetime, timezone
from difflib import get_close_matches
from functools import wraps
from typing import TypeVar, cast

import numpy as np

from . import catalogue

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


def words_of(options: Mapping[str, object], *, writes_files: bool = True) -> list[str]:
    """Return the words of options; ``writes_files`` is whether options of files have a meaning."""
    known = catalogue.options()
    words = []
    for name, value in options.items():
        if name not in known:
            close = get_close_matches(name, known, 1)
            hint = f"did you mean {close[0]!r}?" if close else "vlscan.options() lists them"
            raise TypeError(f"no option of a run is called {name!r}; {hint}")
        value = _plain(name, value, known[name].has_value)
        if value is None or (value is False and known[name].has_value):
            continue
        if known[name].is_of_files and not writes_files and value is not False:
            raise ValueError(f"{name} is an option of files, but this run writes none; name them with run(to=...)")
        word = "--" + name.replace("_", "-")
        if isinstance(value, bool):
            words.append(switch(name, value))
        elif isinstance(value, Mapping) and name == "columns":
            # The columns that `vlscan.columns()` lists.
            words.append(f"{word}={_text(list(value))}")
        elif isinstance(value, Mapping):
            words += [f"{word}={key}={_text(item)}" for key, item in value.items()]
        elif isinstance(value, (list, tuple)) and known[name].is_list:
            words += [f"{word}={_text(item)}" for item in value]
        else:
            words.append(f"{word}={_text(value)}")
    return words


def _plain(name: str, value: object, has_value: bool) -> object:
    """Return a value of NumPy as one of Python; a switch is a truth value, and nothing else is one."""
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
    return value


def switch(name: str, is_on: bool) -> str:
    """Return the word that turns a switch on, or the one that turns it off: ``--misses``, ``--no-misses``."""
    name = name.replace("_", "-")
    if is_on:
        return f"--{name}"
    return f"--{name.removeprefix('no-')}" if name.startswith("no-") else f"--no-{name}"


def _text(value: object) -> str:
    if isinstance(value, (os.PathLike, bytes)):
        return os.fsdecode(value)
    if isinstance(value, datetime) and value.tzinfo is not None:
        return str(value.astimezone(timezone.utc).replace(tzinfo=None))
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return ",".join(_text(item) for item in value)
    return str(value)
