"""The examples of the documentation work as they are written."""

import doctest
import re
import shutil
import warnings

import numpy as np
import pytest

import vlscan
from conftest import FIXTURES, ROOT

#: The campaign that the examples name.
CAMPAIGN = """out = "set"
[[scene]]
name = "ground"
file = "ground.obj"
[[variant]]
name = "drone"
plan = "airborne --scanner riegl_vux-1uav --height 60 --density 5"
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder to work in, with the fixtures that examples name; nothing opens a browser."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    shutil.copytree(FIXTURES, tmp_path / "fixtures")
    for file in ("ground.obj", "forest.mtl"):
        shutil.copy(FIXTURES / "forest" / file, tmp_path)
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield tmp_path


def blocks(page):
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("page", ["docs/migration.md", "docs/python.md", "README.md"])
def test_examples_run(page, folder):
    pytest.importorskip("polars")
    if page == "docs/python.md":
        # The survey and the meshes that its examples name.
        for file in [*(FIXTURES / "room").iterdir(), *(FIXTURES / "forest").glob("*.obj"), *(FIXTURES / "forest").glob("*.mtl")]:
            shutil.copy(file, folder)
    size = 50.0
    names = {
        "vertices": np.array([[-size, -size, 0], [size, -size, 0], [size, size, 0], [-size, size, 0]]),
        "faces": np.array([[0, 1, 2], [0, 2, 3]]),
        "trees": [(5.0, 8.0, 30.0), (-9.0, 3.0, 200.0)],
    }
    found = blocks(page)
    assert found
    for block in found:
        exec(compile(block.replace(".filter(...)", "").replace("range(10)", "range(1)"), page, "exec"), names)


def examples():
    """Names and docstrings of what users meet, as far as these have examples."""
    things = {f"vlscan.{name}": getattr(vlscan, name) for name in vlscan.__all__}
    for name, thing in list(things.items()):
        # Of a class with its bases that are not public.
        owners = [
            kind for kind in getattr(thing, "__mro__", ()) if kind.__module__.startswith("vlscan") and kind.__name__ not in vlscan.__all__
        ]
        parts = [part for owner in (thing, *owners) for part in vars(owner) if not part.startswith("_")]
        things |= {f"{name}.{part}": getattr(thing, part) for part in parts}
    return [(name, thing.__doc__) for name, thing in things.items() if ">>>" in (getattr(thing, "__doc__", None) or "")]


@pytest.mark.parametrize(("name", "text"), examples(), ids=[name for name, _ in examples()])
def test_examples_of_docstrings_run(name, text, folder):
    test = doctest.DocTestParser().get_doctest(text, {"np": np, "vlscan": vlscan}, name, None, None)
    seen = []
    doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test, out=seen.append)
    assert not seen, "".join(seen)
