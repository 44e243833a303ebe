"""Libraries that users may have: imported when they are needed, named when they are missing; and files of the package."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from .errors import InputError

if TYPE_CHECKING:
    from ._typing import Progress


def needed(name: str, by: str) -> ModuleType:
    """Import a library that is no dependency of the package.

    Parameters
    ----------
    name : str
        Name of the library, which is that of its package.
    by : str
        Name of the function that needs the library.

    Returns
    -------
    module
        The library.

    Raises
    ------
    ImportError
        It is not installed.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != name:
            raise
        raise ImportError(f"{by} needs {name}: pip install {name}", name=name) from None


def refuse_existing(path: str, force: bool) -> None:
    """Refuse a file that exists, before its content is made.

    Parameters
    ----------
    path : str
        The file.
    force : bool
        If set, an existing file is replaced.

    Raises
    ------
    InputError
        The file exists.
    """
    if not force and os.path.lexists(path):
        raise InputError(f"{path} exists already; replace it with force=True")


def save(path: str, content: bytes, force: bool) -> None:
    """Write a file.

    Parameters
    ----------
    path : str
        The file.
    content : bytes
        Its content.
    force : bool
        If set, an existing file is replaced.

    Raises
    ------
    InputError
        The file exists.
    """
    try:
        with open(path, "wb" if force else "xb") as file:
            file.write(content)
    except FileExistsError:
        raise InputError(f"{path} exists already; replace it with force=True") from None


def is_notebook() -> bool:
    """Return whether a notebook runs the program.

    Returns
    -------
    bool
        True if it does.
    """
    ipython = sys.modules.get("IPython")
    return ipython is not None and hasattr(ipython.get_ipython(), "kernel")


def _bar_maker(is_wanted: bool | None) -> Callable[..., Any] | None:
    """Return what makes a bar: of a notebook, or if one is asked for; none without tqdm."""
    if is_wanted is False or (is_wanted is None and not is_notebook()):
        return None
    try:
        with warnings.catch_warnings():
            # Of notebooks without widgets, which get bars of text.
            warnings.simplefilter("ignore")
            from tqdm.auto import tqdm
    except ImportError:
        if is_wanted:
            raise ImportError("progress=True needs tqdm: pip install tqdm", name="tqdm") from None
        return None
    made: Callable[..., Any] = tqdm
    return made


@contextmanager
def shown_progress(progress: Progress | bool | None) -> Iterator[Progress | None]:
    """Yield what is told the progress of a run: the function that is given, or a bar.

    Parameters
    ----------
    progress : callable, bool or None
        A function; whether to show a bar; by default in notebooks where tqdm is installed.

    Yields
    ------
    callable or None
        The function.
    """
    if callable(progress):
        yield progress
        return
    if not (progress is None or isinstance(progress, bool)):
        raise TypeError(f"progress is a function, True or False, found {progress!r}")
    tqdm = _bar_maker(progress)
    if tqdm is None:
        yield None
        return
    # Short runs show nothing.
    bar = tqdm(total=100.0, delay=0.5, leave=False, bar_format="{desc}{percentage:3.0f}%|{bar}| {postfix} [{elapsed}<{remaining}]")

    def tell(*, pulses: int, points: int, leg: int, done: float) -> None:
        bar.set_postfix_str(f"leg {leg}, {pulses:,} pulses, {points:,} points", refresh=False)
        if done == done:
            bar.update(100.0 * done - bar.n)

    try:
        yield tell
    finally:
        bar.close()


@contextmanager
def counting_bar(is_wanted: bool | None, total: int, unit: str) -> Iterator[Callable[[str], None]]:
    """Yield a function that counts one more, with what it was.

    Parameters
    ----------
    is_wanted : bool or None
        True for a bar; by default there is one in notebooks where tqdm is installed.
    total : int
        Number of things.
    unit : str
        Noun for a thing, such as ``cell``.

    Yields
    ------
    callable
        The function.
    """
    tqdm = _bar_maker(is_wanted)
    if tqdm is None:
        yield lambda name: None
        return
    bar = tqdm(total=total, unit=unit)

    def count(name: str) -> None:
        bar.set_postfix_str(name, refresh=False)
        bar.update(1)

    try:
        yield count
    finally:
        bar.close()
