"""The notebooks run, and what their cells end with can be shown."""

import ast
import json
import warnings

import pytest

from conftest import ROOT

NOTEBOOKS = sorted((ROOT / "python/notebooks").glob("*.ipynb"))

#: What notebooks import beside vlscan itself.
LIBRARIES = ("geopandas", "matplotlib.pyplot", "pandas", "rasterio", "shapely", "vlscan.helios")


def run_cell(source, names):
    """Runs a cell and returns the value of its last line, as a notebook does."""
    body = ast.parse(source).body
    last = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), "cell", "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run(path, monkeypatch):
    monkeypatch.chdir(path.parent)
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    # Pictures of cells are drawn, but small: test_surface has their sizes.
    monkeypatch.setattr("vlscan._notebook._WIDTHS", (320,))
    notebook = json.loads(path.read_text(encoding="utf-8"))
    names = {"__name__": "__main__"}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for library in LIBRARIES:
            if f"import {library}" in path.read_text(encoding="utf-8"):
                pytest.importorskip(library.split(".")[0])
        for cell in notebook["cells"]:
            if cell["cell_type"] == "code":
                assert not cell["outputs"], "notebooks are kept without outputs"
                value = run_cell("".join(cell["source"]), names)
                if hasattr(value, "_repr_html_") and type(value).__module__.startswith("vlscan"):
                    assert value._repr_html_()


def test_notebooks_are_listed():
    listed = (ROOT / "docs/python.md").read_text(encoding="utf-8")
    assert NOTEBOOKS and not [path.name for path in NOTEBOOKS if f"notebooks/{path.name}" not in listed]
