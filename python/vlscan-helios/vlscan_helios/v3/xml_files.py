"""XML files of HELIOS++, whose elements changed surveys keep."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from .utils import existing_file


class Document(NamedTuple):
    """A file.

    Attributes
    ----------
    path : pathlib.Path
        Path of the file.
    root : xml.etree.ElementTree.Element
        Its root.
    """

    path: Path
    root: Element

    def asset(self, kind: str, id: str = "") -> Element:
        """Return the asset of an id, or the first one, of a kind such as ``scene``."""
        found = [element for element in self.root.iter(kind) if not id or element.get("id") == id]
        if not found:
            name = f"no {kind} with the id {id!r}" if id else f"no {kind}"
            raise ValueError(f"{self.path} has {name}")
        return found[0]


def read(name: str | os.PathLike[str]) -> Document:
    """Read a document.

    Parameters
    ----------
    name : str or path-like
        The file.

    Returns
    -------
    Document
        The document.

    Raises
    ------
    ValueError
        The file is no XML.
    FileNotFoundError
        There is no such file.
    """
    path = existing_file(name)
    if not path.exists():
        raise FileNotFoundError(f"{os.fspath(name)} is part of the program, and not on disk")
    data = path.read_bytes().lstrip(b"\xef\xbb\xbf \t\r\n")
    try:
        try:
            return Document(path, ElementTree.fromstring(data))
        except ElementTree.ParseError:
            if _is_utf8(data):
                raise
            # Latin-1 that does not say so, as the engine reads it.
            text = data.decode("latin-1")
            return Document(path, ElementTree.fromstring(text.partition("?>")[2] if text.startswith("<?xml") else text))
    except ElementTree.ParseError as problem:
        raise ValueError(f"{path}: {problem}") from None


def _is_utf8(data: bytes) -> bool:
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True
