"""The command line: ``python -m vlscan.helios``."""

from __future__ import annotations

import sys
from typing import Any

from vlscan._vlscan import command
from vlscan._words import words_of


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
        return command(["vlscan", *sys.argv[1:]])
    if "survey" not in kw:
        raise TypeError("cli() needs survey, a file")
    survey, output = str(kw.pop("survey")), kw.pop("output", "output")
    return command(["vlscan", "run", survey, f"--output={output}", *words_of(kw)])


if __name__ == "__main__":
    sys.exit(cli())
