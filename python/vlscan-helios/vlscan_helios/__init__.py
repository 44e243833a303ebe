"""The Python interfaces of HELIOS++ over vlscan, with the names that scripts use.

:mod:`vlscan_helios.v3` is that of version 3, also named :mod:`vlscan.helios`; :mod:`vlscan_helios.v2` that of version 2, also named
:mod:`vlscan.pyhelios`. Written from the public interface; no code of HELIOS++ is contained. Built on the public names of
:mod:`vlscan` alone.
"""
