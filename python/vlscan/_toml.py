"""Writes pipelines: a dictionary as TOML, one key or one table of a list per line, so that errors have useful lines."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping


def document(keys: Mapping[str, object]) -> str:
    """Return the pipeline of these keys. ``None`` leaves a key out."""
    plain, tables = [], []
    for key, value in keys.items():
        if value is None or (isinstance(value, (list, tuple, Mapping)) and not value):
            continue
        if isinstance(value, Mapping):
            tables.append(f"[{key}]\n" + _lines(value))
        elif isinstance(value, (list, tuple)) and all(isinstance(item, Mapping) for item in value):
            tables.extend(f"[[{key}]]\n" + _lines(item) for item in value)
        else:
            plain.append(_line(key, value))
    return "".join(plain) + "\n" + "\n".join(tables)


def _lines(table: Mapping[str, object]) -> str:
    return "".join(_line(key, value) for key, value in table.items() if value is not None)


def _line(key: str, value: object) -> str:
    try:
        return f"{_key(key)} = {_value(value)}\n"
    except TypeError as problem:
        advice = "; to_numpy() has its rows" if hasattr(value, "to_numpy") else ""
        raise TypeError(f"{key}: {problem}{advice}") from None


def _key(key: str) -> str:
    return key if key.replace("_", "").isalnum() and key.isascii() else _text(key)


def _text(value: str) -> str:
    # As JSON, but without pairs of surrogates, which TOML does not know, and with DEL escaped, which TOML asks for.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: object) -> str:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        if math.isfinite(value):
            return repr(value) if any(c in repr(value) for c in ".e") else repr(value) + ".0"
        return "nan" if math.isnan(value) else ("inf" if value > 0 else "-inf")
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, os.PathLike):
        return _text(os.fspath(value))
    if isinstance(value, Mapping):
        items = ", ".join(f"{_key(key)} = {_value(item)}" for key, item in value.items() if item is not None)
        return "{ " + items + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    raise TypeError(f"expected numbers, text, lists or dictionaries, found {type(value).__name__}")
