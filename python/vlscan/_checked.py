"""Objects whose attributes are known: a typo is an error with a suggestion."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar

if TYPE_CHECKING:
    Value = TypeVar("Value")
    Given = TypeVar("Given")

    class Converted(Generic[Value, Given]):
        """The type of an attribute whose values are converted when they are set."""

        def __get__(self, owner: object, kind: type | None = None, /) -> Value: ...
        def __set__(self, owner: object, value: Given, /) -> None: ...
        def __delete__(self, owner: object, /) -> None: ...


class Checked:
    """An object that has only the attributes that its class names; their values are checked whenever they are set."""

    _ATTRIBUTES: ClassVar[tuple[str, ...]] = ()

    def _checked(self, name: str, value: object) -> object:
        """Return the value of an attribute, converted if need be; an invalid one is a ``TypeError`` or a ``ValueError``."""
        return value

    if not TYPE_CHECKING:

        def __setattr__(self, name: str, value: object) -> None:
            if name.startswith("_"):
                object.__setattr__(self, name, value)
                return
            known = type(self)._ATTRIBUTES
            if name not in known:
                close = get_close_matches(name, known, 1)
                hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(known)}"
                raise AttributeError(f"{type(self).__name__} has no attribute {name!r}; {hint}")
            object.__setattr__(self, name, self._checked(name, value))
