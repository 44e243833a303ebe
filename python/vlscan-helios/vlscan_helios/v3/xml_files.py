"""XML files of HELIOS++: their elements, and the files that they name."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from .utils import existing_file, named_file


class Document(NamedTuple):
    """A file.

    Attributes
    ----------
    path : pathlib.Path
        Where it is.
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

    def locate(self, name: str) -> str:
        """Return a file that the document names, as the engine finds it: absolute where it is beside the document."""
        beside = (self.path.parent / name.replace("\\", "/")).resolve()
        found = None if self.root.get("paths") == "beside" and beside.exists() else named_file(name, False, by_bare_name=False)
        if found is None and (other := name.replace("\\", "/")) != name:
            found = named_file(other, False, by_bare_name=False)
        if found is None and beside.exists():
            found = beside
        return os.fspath(found) if found is not None else name

    def reference(self, reference: str) -> str:
        """Return ``file.xml#id`` of a reference within the document."""
        file, mark, id = reference.partition("#")
        if not mark and not file.lower().endswith(".xml") and not Path(self.locate(file)).is_file():
            file, id = "", reference
        located = Path(self.locate(file)).as_posix() if file else self.path.resolve().as_posix()
        return f"{located}#{id}" if id else located


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
