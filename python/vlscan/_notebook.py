"""Pictures and pages for notebooks."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable

from ._libraries import is_notebook
from ._typing import Displayed

# Largest picture of a cell, bytes as text, and the widths that are tried.
_MAX_BYTES, _WIDTHS = 59_000, (800, 640, 520, 420, 320)


def picture_html(draw: Callable[[int, int], bytes], about: str) -> str:
    """Return a picture with a line of text below it, for notebooks; ``draw`` makes it of a width and a height.

    Notebooks keep the pictures of all cells, so it is the largest one that takes at most 60 kB, or the smallest.
    """
    data, per_area = "", 0.0
    for width in _WIDTHS:
        # Bytes are about in proportion to the area: what is expected to be far too large is not drawn.
        if per_area * width**2 > 1.3 * _MAX_BYTES and width != _WIDTHS[-1]:
            continue
        data = base64.b64encode(draw(width, width * 3 // 4)).decode()
        if len(data) <= _MAX_BYTES:
            break
        per_area = len(data) / width**2
    return f'<img src="data:image/png;base64,{data}" style="max-width:100%"><div>{about}</div>'


def show_page(page: str) -> Displayed | None:
    """Show a page in the notebook that runs the program, otherwise in a browser."""
    if is_notebook():
        from IPython.display import HTML

        frame = html.escape(page, quote=True)
        # IPython warns of a frame that is not within another element.
        shown = f'<div><iframe srcdoc="{frame}" style="width:100%;height:600px;border:0"></iframe></div>'
        view: Displayed = HTML(shown)  # type: ignore[no-untyped-call, unused-ignore]
        return view
    import tempfile
    import webbrowser

    with tempfile.NamedTemporaryFile("w", suffix=".html", delete=False, encoding="utf-8") as file:
        file.write(page)
    webbrowser.open(f"file://{file.name}")
    return None
