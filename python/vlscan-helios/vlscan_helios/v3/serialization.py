"""YAML and bundles of HELIOS++ 3, which vlscan does not offer: names can be imported, and calls say what to do instead."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn

from .validation import NO_YAML


def __getattr__(name: str) -> Callable[..., NoReturn]:
    if name.startswith("_"):
        raise AttributeError(name)

    def not_offered(*args: Any, **values: Any) -> NoReturn:
        raise NotImplementedError(NO_YAML)

    not_offered.__name__ = not_offered.__qualname__ = name
    return not_offered
