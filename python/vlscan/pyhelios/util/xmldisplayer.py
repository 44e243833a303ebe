"""XML files as text, and the folders of results."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vlscan_helios.v3.utils import XmlText


def display_xml(path: str | os.PathLike[str], item: str | None = None) -> XmlText:
    """Return an XML file, or one of its elements, as text that notebooks show.

    Parameters
    ----------
    path : str or path-like
        The file.
    item : str, optional
        Id of the element; the whole file by default.

    Returns
    -------
    str
        The text.
    """
    from vlscan_helios.v3.utils import display_xml as display

    return display(path, item or None)


def find_playback_dir(survey_path: str | os.PathLike[str], output_dir: str | os.PathLike[str] = "output") -> str:
    """Return the folder of the last results of a survey.

    Parameters
    ----------
    survey_path : str or path-like
        The survey.
    output_dir : str or path-like
        The folder of all results.

    Returns
    -------
    str
        The folder.

    Raises
    ------
    FileNotFoundError
        The survey has no results.
    """
    survey = ElementTree.parse(survey_path).getroot().find("survey")
    name = (survey.get("name") if survey is not None else None) or Path(survey_path).stem
    runs = sorted((folder for folder in Path(output_dir).glob(f"{name}/*") if folder.is_dir()), key=_order)
    if not runs:
        raise FileNotFoundError(f"{os.fspath(output_dir)} has no results of the survey {name!r}")
    return os.fspath(runs[-1])


def _order(folder: Path) -> tuple[str, int]:
    """Return the time of a folder of results and its number among those of the same second, which is missing for the first."""
    stamp, _, number = folder.name.rpartition("_")
    return (stamp, int(number)) if "_" in stamp and number.isdigit() else (folder.name, 1)
