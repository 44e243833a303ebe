"""What all tests share."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FIXTURES = ROOT / "fixtures"


def _fail_if_skipped(report: pytest.TestReport | pytest.CollectReport) -> None:
    """In the continuous integration, which sets `VLSCAN_TEST_MAY_LACK`, a test that skips itself has failed."""
    if report.skipped and "VLSCAN_TEST_MAY_LACK" in os.environ and not hasattr(report, "wasxfail"):
        report.outcome = "failed"
        report.longrepr = f"skipped, and must not be here: {report.longrepr}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    """See `_fail_if_skipped`."""
    report = yield
    _fail_if_skipped(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report():
    """See `_fail_if_skipped`."""
    report = yield
    _fail_if_skipped(report)
    return report


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
