"""The command line: ``vlscan`` and ``python -m vlscan``."""

from __future__ import annotations

import sys
from collections.abc import Sequence


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    words : sequence of str, optional
        Its arguments; those of this process by default.

    Returns
    -------
    int
        The exit status.
    """
    from ._vlscan import command

    return command(["vlscan", *(sys.argv[1:] if words is None else words)])


if __name__ == "__main__":
    sys.exit(main())
