"""Checks by numpydoc that what users meet is documented: a summary, parameters, results. Prints what is missing."""

import sys
from collections.abc import Iterator
from enum import EnumMeta
from functools import cached_property
from types import FunctionType

from numpydoc.validate import validate

import vlscan
from vlscan_helios import v3

CHECKS = {"GL06", "GL07", "GL08", "PR01", "PR02", "PR03", "PR04", "PR05", "PR07", "RT01", "RT03", "SS01", "SS03", "SS05"}


def documented() -> Iterator[str]:
    """Names of functions and classes, and of functions and properties of classes."""
    for package in (vlscan, v3):
        for name in package.__all__:
            thing = getattr(package, name)
            # The signature of an enumeration is that of a function that makes others.
            if isinstance(thing, (FunctionType, type)) and not isinstance(thing, EnumMeta):
                yield f"{package.__name__}.{name}"
            if isinstance(thing, type):
                # Of its bases those that are not public have no check of their own.
                bases = [
                    base for base in thing.__mro__[1:] if base.__module__.startswith("vlscan") and base.__name__ not in package.__all__
                ]
                found = {part: value for owner in (*reversed(bases), thing) for part, value in vars(owner).items()}
                # Names that begin with "model_" are those of pydantic.
                parts = (FunctionType, staticmethod, classmethod, property, cached_property)
                names = [part for part, value in found.items() if isinstance(value, parts) and not part.startswith(("_", "model_"))]
                yield from (f"{package.__name__}.{name}.{part}" for part in names)


problems = [f"{name}: {code} {text}" for name in documented() for code, text in validate(name)["errors"] if code in CHECKS]
print("\n".join(problems), end="\n" if problems else "")
sys.exit(bool(problems))
