"""The command line: ``vlscan`` and ``python -m vlscan``."""

from __future__ import annotations

import sys


def main() -> int:
    """Run the command line of this process.

    Returns
    -------
    int
        The exit status.
    """
    from ._vlscan import command

    return command(["vlscan", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
