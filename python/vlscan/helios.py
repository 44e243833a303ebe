"""Another name of :mod:`vlscan_helios.v3`, HELIOS++ 3 over vlscan: ``import vlscan.helios as helios``."""

try:
    from vlscan_helios.v3 import *  # noqa: F403
    from vlscan_helios.v3 import install
except ImportError as _failure:
    raise ImportError(f"vlscan.helios is a distribution of its own: pip install vlscan-helios ({_failure})") from _failure

install("vlscan.helios")

if __name__ == "__main__":
    import sys

    from vlscan_helios.v3.__main__ import cli

    sys.exit(cli())
