"""Pictures and pages of files and surveys."""

from __future__ import annotations

import os

from . import _vlscan
from ._arguments import path_of, suggesting
from ._notebook import show_page
from ._typing import Displayed, PathLike
from ._values import renamed
from .parts import Part
from .points import Points
from .scene import Scene
from .survey import Survey

# Points on the surfaces of a scene that are drawn at most.
_SCENE_POINTS = 200_000


@renamed(most_points="max_points")
@suggesting
def preview(
    source: Points | Survey | Scene | Part | PathLike,
    path: PathLike | None = None,
    *,
    pulse: int | None = None,
    colour: str | None = None,
    title: str | None = None,
    light: bool = False,
    width: int = 1600,
    height: int = 1000,
    max_points: int = 5_000_000,
    force: bool = False,
) -> Displayed | None:
    """Draw points, a survey over its scene, or the waveform of a pulse, as ``vlscan preview`` does.

    Parameters
    ----------
    source : Points, Survey, Scene, Part, str or path-like
        Points; a survey, of which scene, flight lines and swaths are drawn; the file of either; a scene or a part, of which points on
        the surfaces are drawn; or with ``pulse`` a file of waveforms.
    path : str or path-like, optional
        The picture (``.png``) or page (``.html``) to write. Without it a page is shown: in a notebook, otherwise in the browser.
    pulse : int, optional
        Number of the pulse whose waveform is drawn.
    colour : str, optional
        ``height``, ``class``, ``intensity``, ``object``, ``return`` or ``leg``; of points their height, of a survey the density
        of pulses in a picture and the flight line that covers the ground in a page, by default.
    title : str, optional
        A title; the name of the file by default.
    light : bool
        True for a dark drawing on white, for print.
    width, height : int
        Size of a picture, pixels.
    max_points : int
        Maximum number of points in a page, evenly sampled.
    force : bool
        If set, an existing file is replaced.

    Returns
    -------
    IPython.display.HTML or None
        The view, in a notebook without ``path``.

    Raises
    ------
    InputError
        The file cannot be read, or the survey cannot be flown.
    FileExistsError
        The file exists.
    ValueError
        Another extension, colour or size.

    Examples
    --------
    >>> vlscan.preview("fixtures/room/survey.xml", "survey.png", width=640, height=480)
    >>> vlscan.preview(vlscan.run("fixtures/room/survey.xml", seed=1).points, "room.html")
    """
    kind = "html"
    if path is not None:
        path = path_of("path", path)
        ending = os.path.splitext(path)[1].lower()
        if ending not in (".png", ".html", ".htm"):
            raise ValueError(f"{path}: expected a name that ends in .png or .html")
        kind = "png" if ending == ".png" else "html"
        if os.path.exists(path) and not force:
            raise FileExistsError(f"{path} exists already; force=True replaces it")
    content = _drawn(source, kind, pulse, colour, title, light, width, height, max_points)
    if path is None:
        return show_page(content.decode())
    with open(path, "wb") as file:
        file.write(content)
    return None


def _drawn(
    source: Points | Survey | Scene | Part | PathLike,
    kind: str,
    pulse: int | None,
    colour: str | None,
    title: str | None,
    light: bool,
    width: int,
    height: int,
    max_points: int,
) -> bytes:
    if isinstance(source, Part):
        source = Scene(source)
    if isinstance(source, Scene):
        source = source.sample(min(max_points, _SCENE_POINTS))
    if isinstance(source, Points):
        if pulse is not None:
            raise ValueError("a waveform is drawn of a file of waveforms, not of points")
        chosen, name = colour or "height", title or ""
        page = source.html(chosen, name, max_points) if kind == "html" else ""
        return page.encode() if page else source.png(chosen, name, width, height)
    file = None if isinstance(source, Survey) else path_of("source", source)
    survey = source if isinstance(source, Survey) else Survey.open(source) if file is not None and _holds_survey(file) else None
    is_survey = survey is not None and pulse is None
    request = survey._request({}) if survey is not None and is_survey else None
    usual = file or (survey.name if survey is not None else None) or ""
    chosen, name = colour or ("leg" if is_survey else "height"), usual if title is None else title
    return _vlscan.preview(kind, None if is_survey else file, request, pulse, chosen, name, light, width, height, max_points)


def _holds_survey(file: str) -> bool:
    return file.lower().endswith((".xml", ".toml"))
