"""Another name of :mod:`vlscan_helios.v2`, the Python interface of HELIOS++ 2: ``import vlscan.pyhelios as pyhelios``."""

from __future__ import annotations

import sys
from difflib import get_close_matches
from importlib import import_module
from types import ModuleType

try:
    from vlscan_helios import v2
    from vlscan_helios.v2 import *  # noqa: F403
    from vlscan_helios.v2 import __version__ as __version__
except ImportError as _failure:
    raise ImportError(f"vlscan.pyhelios is a distribution of its own: pip install vlscan-helios ({_failure})") from _failure

from . import util as util

__all__ = [*v2.__all__, "install", "util"]


def install(name: str = "pyhelios") -> ModuleType:
    """Make this package importable by another name in this process, submodules included.

    Parameters
    ----------
    name : str
        The name.

    Returns
    -------
    module
        The package.
    """
    own = [__name__, f"{__name__}.__main__", f"{__name__}.util", f"{__name__}.util.xmldisplayer"]
    sys.modules.update({name + key.removeprefix(__name__): import_module(key) for key in own})
    return sys.modules[__name__]


def __getattr__(name: str) -> object:
    if name == "live":
        raise AttributeError("pyhelios.live is not part of vlscan; SimulationBuilder.setCallback() gets points while they are measured")
    close = get_close_matches(name, __all__, 1)
    hint = f"did you mean {close[0]!r}? There" if close else "there"
    raise AttributeError(f"pyhelios has no {name!r}; {hint} are {', '.join(__all__)}")
