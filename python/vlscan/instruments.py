"""Scanners, and what carries them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from . import catalogue
from ._checked import Checked
from ._keys import check_keys

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._checked import Converted
    from ._keys import ScannerKeys


class Scanner(Checked):
    """An instrument: one that ships, changed by keys, or one of your own.

    Parameters
    ----------
    name : str, optional
        Id of a scanner that ships, see :func:`vlscan.scanners`, or ``file.xml#id``.
    **keys : ScannerKeys
        Keys of ``[scanner]`` in a pipeline file (docs/instruments.md); ``channel`` is a list of dictionaries of them.

    Attributes
    ----------
    keys : dict
        The keys; ``catalogue`` is the reference of the name.

    Raises
    ------
    InputError
        No scanner that ships has the name, or several have it.
    TypeError
        A keyword is no key.

    Examples
    --------
    >>> vlscan.Scanner("riegl_vz400", accuracy_m=0.002).keys["accuracy_m"]
    0.002
    >>> vlscan.Scanner(optics="rotating", pulse_freqs_hz=[100_000], scan_angle_max_deg=50)
    Scanner(optics='rotating', pulse_freqs_hz=[100000], scan_angle_max_deg=50)
    """

    _ATTRIBUTES: ClassVar[tuple[str, ...]] = ("keys",)

    if TYPE_CHECKING:
        keys: Converted[dict[str, object], Mapping[str, object]] = Converted()

    def __init__(self, name: str | None = None, **keys: Unpack[ScannerKeys]) -> None:
        check_keys("Scanner", keys, "[scanner]")
        self.keys = dict(keys)
        if name is not None:
            self.keys = {"catalogue": catalogue.scanner_reference(name), **keys}

    def _checked(self, name: str, value: object) -> object:
        if not isinstance(value, Mapping):
            raise TypeError(f"keys of a scanner are a mapping, found {type(value).__name__}")
        check_keys("Scanner", value, "[scanner]")
        return dict(value)

    @staticmethod
    def of(scanner: Scanner | str | Mapping[str, object]) -> Scanner:
        """Return the scanner of a name, of keys, or itself.

        Parameters
        ----------
        scanner : Scanner, str or mapping
            A scanner, its name, or its keys.

        Returns
        -------
        Scanner
            The scanner.

        Raises
        ------
        TypeError
            Anything else, or an unknown key.
        """
        if isinstance(scanner, Scanner):
            return scanner
        if isinstance(scanner, str):
            return Scanner(scanner)
        if not isinstance(scanner, Mapping):
            raise TypeError(f"expected a Scanner, a name or a mapping of keys, found {type(scanner).__name__}")
        made = Scanner()
        made.keys = dict(scanner)
        return made

    def __repr__(self) -> str:
        return f"Scanner({', '.join(f'{key}={value!r}' for key, value in self.keys.items())})"


class Platform(Checked):
    """The carrier of a scanner.

    Parameters
    ----------
    name : str, optional
        Id of a platform that ships, see :func:`vlscan.platforms`, or ``file.xml#id``.
    kind : str, optional
        ``static``, or ``linear_path``, which moves from leg to leg.
    mount : mapping, optional
        Pose of the scanner on the platform: ``{"offset_m": [x, y, z], "rotate_deg": [{"x": -90}]}``.

    Attributes
    ----------
    keys : dict
        Keys of ``[platform]`` in a pipeline file.

    Raises
    ------
    InputError
        No platform that ships has the name.

    Examples
    --------
    >>> vlscan.Platform(kind="linear_path", mount={"offset_m": [0, 0, 0.3]})
    Platform(kind='linear_path', mount={'offset_m': [0, 0, 0.3]})
    """

    _ATTRIBUTES: ClassVar[tuple[str, ...]] = ("keys",)

    def __init__(self, name: str | None = None, kind: str | None = None, mount: Mapping[str, object] | None = None) -> None:
        self.keys: dict[str, object] = {}
        if name is not None:
            self.keys["catalogue"] = catalogue.platform_reference(name)
        if kind is not None:
            self.keys["kind"] = kind
        if mount is not None:
            self.keys["mount"] = dict(mount)

    @staticmethod
    def of(platform: Platform | str) -> Platform:
        """Return the platform of a name or a kind, or itself.

        Parameters
        ----------
        platform : Platform or str
            A platform, its name, ``static`` or ``linear_path``.

        Returns
        -------
        Platform
            The platform.
        """
        if isinstance(platform, Platform):
            return platform
        if not isinstance(platform, str):
            raise TypeError(f"expected a Platform, a name, 'static' or 'linear_path', found {type(platform).__name__}")
        return Platform(kind=platform) if platform in ("static", "linear_path") else Platform(platform)

    def __repr__(self) -> str:
        return f"Platform({', '.join(f'{key}={value!r}' for key, value in self.keys.items())})"
