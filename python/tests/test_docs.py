"""The examples of the documentation work as they are written."""

import re
import shutil
import warnings

import numpy as np
import pytest
from conftest import FIXTURES, ROOT


def blocks(page):
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("page", ["docs/python.md", "README.md"])
def test_examples_run(page, tmp_path, monkeypatch):
    pytest.importorskip("polars")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    shutil.copytree(FIXTURES, tmp_path / "fixtures")
    if page == "docs/python.md":
        # The survey and the meshes that its examples name.
        for file in [*(FIXTURES / "room").iterdir(), *(FIXTURES / "forest").glob("*.obj"), *(FIXTURES / "forest").glob("*.mtl")]:
            shutil.copy(file, tmp_path)
    size = 50.0
    names = {
        "vertices": np.array([[-size, -size, 0], [size, -size, 0], [size, size, 0], [-size, size, 0]]),
        "faces": np.array([[0, 1, 2], [0, 2, 3]]),
        "trees": [(5.0, 8.0, 30.0), (-9.0, 3.0, 200.0)],
    }
    found = blocks(page)
    assert found
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for block in found:
            exec(compile(block.replace(".filter(...)", "").replace("range(10)", "range(1)"), page, "exec"), names)
