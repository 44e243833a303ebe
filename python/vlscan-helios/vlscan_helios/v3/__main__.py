"""The command line: ``python -m vlscan.helios``."""

from __future__ import annotations

import sys
from typing import Any

import vlscan
from vlscan.__main__ import main


def cli(**kw: Any) -> int:
    """Run a survey, or the command line of this process.

    Parameters
    ----------
    **kw : Any
        ``survey``, a file, and options of :meth:`vlscan.Survey.run`, with ``output`` as the folder of results; without keywords the
        arguments of the process are those of ``vlscan``, which takes the ones of HELIOS++.

    Returns
    -------
    int
        The exit status.

    Raises
    ------
    TypeError
        Keywords without ``survey``, or unknown ones.
    """
    if not kw:
        return main()
    if "survey" not in kw:
        raise TypeError("cli() needs survey, a file")
    survey, output = str(kw.pop("survey")), kw.pop("output", "output")
    unknown = kw.keys() - vlscan.options().keys()
    if unknown:
        raise TypeError(f"no option of a run is called {', '.join(sorted(unknown))}; vlscan.options() lists them")
    return main(["run", survey, f"--output={output}", *(word for name, value in kw.items() for word in _words(name, value))])


def _words(name: str, value: Any) -> list[str]:
    """Return the words of an option on the command line."""
    option = name.replace("_", "-")
    if value is None:
        return []
    if isinstance(value, bool):
        return [f"--{option}" if value else f"--no-{option}"]
    return [f"--{option}={item}" for item in (value if isinstance(value, (list, tuple)) else [value])]


if __name__ == "__main__":
    sys.exit(cli())
