"""Pictures and pages of points."""

from __future__ import annotations

import html

from . import _vlscan
from ._arguments import path_of, text, whole
from ._libraries import refuse_existing, save
from ._notebook import picture_html, show_page
from ._typing import Displayed, PathLike
from .tables import Table


class DrawnTable(Table):
    """The methods of :class:`vlscan.Points` that draw."""

    def png(self, colour: str = "height", title: str = "", width: int = 1600, height: int = 1200) -> bytes:
        """Draw the points from above and from the side.

        Parameters
        ----------
        colour : str
            ``height``, ``class``, ``intensity``, ``object`` or ``return``.
        title : str
            A title.
        width, height : int
            Size of the picture, pixels.

        Returns
        -------
        bytes
            A PNG file.

        Raises
        ------
        ValueError
            Another colour, or another size than 320 to 16384 by 240 to 16384.
        """
        size = (whole("width", width, 1), whole("height", height, 1))
        return _vlscan.picture(self._table, text("colour", colour), text("title", title), *size)

    def html(self, colour: str = "height", title: str = "", max_points: int = 1_000_000) -> str:
        """Make a page to turn the points around in a browser, offline.

        Parameters
        ----------
        colour : str
            ``height``, ``class``, ``intensity``, ``object`` or ``return``.
        title : str
            A title.
        max_points : int
            Of more points evenly chosen ones are shown.

        Returns
        -------
        str
            The page.
        """
        return _vlscan.page(self._table, text("colour", colour), text("title", title), whole("max_points", max_points, 1))

    def show(self, colour: str = "height", title: str = "", max_points: int = 200_000) -> Displayed | None:
        """Show the points: in a notebook as a view to turn around, otherwise as a page in the browser.

        Parameters
        ----------
        colour : str
            ``height``, ``class``, ``intensity``, ``object`` or ``return``.
        title : str
            A title.
        max_points : int
            Of more points evenly chosen ones are shown.

        Returns
        -------
        IPython.display.HTML or None
            The view, in a notebook.
        """
        return show_page(self.html(colour, title, max_points))

    def save_preview(
        self, path: PathLike, colour: str = "height", title: str = "", *, width: int = 1600, height: int = 1200, force: bool = False
    ) -> None:
        """Write a picture or a page.

        Parameters
        ----------
        path : str or path-like
            The file, ``.png`` or ``.html``.
        colour : str
            ``height``, ``class``, ``intensity``, ``object`` or ``return``.
        title : str
            A title.
        width, height : int
            Size of a picture, pixels.
        force : bool
            If set, an existing file is replaced.

        Raises
        ------
        ValueError
            Another extension or colour, or another size than that of :meth:`png`.
        InputError
            The file exists.

        Examples
        --------
        >>> vlscan.run("fixtures/room/survey.xml", seed=1).points.save_preview("room.png", "intensity", width=800, height=600)
        """
        name = path_of("path", path)
        refuse_existing(name, force)
        if name.lower().endswith((".html", ".htm")):
            content = self.html(colour, title).encode()
        elif name.lower().endswith(".png"):
            content = self.png(colour, title, width, height)
        else:
            raise ValueError(f"{name}: expected a name that ends in .png or .html")
        save(name, content, force)

    def _small_png(self, width: int, height: int) -> bytes:
        """Draw the points with sixteen colours."""
        return _vlscan.picture(self._table, "height", "", width, height, True)

    def _repr_html_(self) -> str:
        about = html.escape(f"{len(self):,} points: {', '.join(self.columns)}")
        if not len(self) or not {"X", "Y", "Z"} <= set(self.columns):
            return f"<div>{about}</div>"
        return picture_html(self._small_png, about)
