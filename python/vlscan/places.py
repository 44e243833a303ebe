"""Relative paths after the working directory has changed: they stay those of the directory in which an object was made."""

from __future__ import annotations

import os
from glob import glob, has_magic


def working_folder() -> str:
    """Return the working directory.

    Returns
    -------
    str
        The directory; empty if it was removed.
    """
    try:
        return os.getcwd()
    except FileNotFoundError:
        return ""


def place_of(path: str, folder: str) -> str:
    """Return a path as it is found now, given the working directory in which it was named.

    The path stays as it is while the directory is the same, so that messages name files as the program does. It also stays if
    ``folder`` has no such file: then it is one of an asset folder, or of the program.

    Parameters
    ----------
    path : str
        The path; ``file#id`` and a pattern such as ``dem/*.tif`` are paths, too.
    folder : str
        The working directory in which it was named; empty if that is not known.

    Returns
    -------
    str
        The path.
    """
    if not folder or os.path.isabs(path) or folder == working_folder():
        return path
    joined = os.path.join(folder, path)
    is_there = os.path.exists(joined) or os.path.exists(joined.partition("#")[0])
    return joined if is_there or (has_magic(joined) and glob(joined)) else path


def asset_folders(folder: str) -> list[str]:
    """Return the folders in which files were searched while another directory was the working directory.

    Parameters
    ----------
    folder : str
        The directory.

    Returns
    -------
    list of str
        The folders; none if the directory still is the working directory.
    """
    return [] if not folder or folder == working_folder() else [folder, os.path.join(folder, "assets")]
