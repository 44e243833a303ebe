"""Contents of the files of surveys."""

from __future__ import annotations

from typing import NamedTuple

from .legs import Leg


class References(NamedTuple):
    """References of a survey in XML: ``file.xml#id`` with an absolute path, or with one of the catalogue that ships.

    Attributes
    ----------
    scanner : str or None
        The scanner.
    platform : str or None
        The platform; with recorded poses the base platform, if there is one.
    scene : str
        The scene.
    rotation_spec : str or None
        With recorded poses how their angles are composed: ``ARINC 705`` or ``CANONICAL``.
    has_waveform : bool
        True if the survey has settings of waveforms, instead of those of the scanner.
    """

    scanner: str | None
    platform: str | None
    scene: str
    rotation_spec: str | None
    has_waveform: bool


class SurveyContents(NamedTuple):
    """Name, instrument, scene, settings and legs of a survey.

    Attributes
    ----------
    name : str
        Its name.
    scanner : str
        Id of the scanner.
    scanner_name : str
        Name of the scanner.
    platform : str
        Id of the platform.
    platform_kind : str
        How the platform moves: ``static``, ``linearpath``, ``groundvehicle``, ``multicopter``, or ``interpolated`` and ``stream`` for
        recorded poses.
    parts : list of str
        Ids of the parts of its scene, ``None`` for those without one; none of a packed scene.
    waveform : dict
        Keys of ``[waveform]`` in a pipeline file, with the values of the first channel.
    legs : list of Leg
        The legs.
    references : References or None
        References of a survey in XML.
    """

    name: str
    scanner: str
    scanner_name: str
    platform: str
    platform_kind: str
    parts: list[str | None]
    waveform: dict[str, float]
    legs: list[Leg]
    references: References | None = None
