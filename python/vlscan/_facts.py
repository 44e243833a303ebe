"""Mappings of values by name that results are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import Generic, TypeVar

Value = TypeVar("Value")


class Facts(Mapping[str, Value], Generic[Value]):
    """A mapping that cannot be changed, with suggestions for unknown names.

    Parameters
    ----------
    facts : dict
        The values by name.
    """

    def __init__(self, facts: dict[str, Value]) -> None:
        self._facts = facts

    def __getitem__(self, key: str) -> Value:
        if key not in self._facts:
            close = get_close_matches(str(key), self._facts, 1)
            hint = f"did you mean {close[0]!r}? There" if close else "there"
            raise KeyError(f"nothing is known of {key!r}; {hint} are {', '.join(self._facts)}")
        return self._facts[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._facts)

    def __len__(self) -> int:
        return len(self._facts)
