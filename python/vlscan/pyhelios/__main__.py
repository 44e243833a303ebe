"""The command line with the options of HELIOS++: ``python -m vlscan.pyhelios survey.xml --lasOutput``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from vlscan.__main__ import main


def helios_exec(args: Sequence[str]) -> int:
    """Run the command line.

    Parameters
    ----------
    args : sequence of str
        The arguments: a survey and options, as ``helios`` takes them.

    Returns
    -------
    int
        The exit status.

    Raises
    ------
    TypeError
        The arguments are one text.
    """
    if isinstance(args, str):
        raise TypeError(f"args is {args!r}, expected a list of arguments; shlex.split() makes one of a command line")
    return main([str(word) for word in args])


if __name__ == "__main__":
    sys.exit(helios_exec(sys.argv[1:]))
