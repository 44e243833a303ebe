"""What all tests share."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FIXTURES = ROOT / "fixtures"


@pytest.fixture
def room() -> Path:
    """A survey of two tripod positions in a room."""
    return FIXTURES / "room/survey.xml"


@pytest.fixture
def forest() -> Path:
    """A survey over a small forest."""
    return FIXTURES / "forest/survey.xml"


@pytest.fixture
def command() -> Callable[..., subprocess.CompletedProcess]:
    """Runs the command line."""

    def run(*words: object, **options: object) -> subprocess.CompletedProcess:
        line = [sys.executable, "-m", "vlscan", *map(str, words)]
        return subprocess.run(line, capture_output=True, check=False, **options)

    return run
