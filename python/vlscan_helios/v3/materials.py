"""Materials, and the files that define them (Wavefront MTL with the keys of HELIOS++)."""

from __future__ import annotations

import os
from copy import copy
from typing import Any, overload

from vlscan._typing import PathLike
from vlscan.errors import warn
from vlscan.parts import Material as EngineMaterial

from .settings import find_asset, three


class _UncheckedMaterial(EngineMaterial):
    """A material as it is: HELIOS++ takes any reflectance, and has its own default."""

    _USUAL_REFLECTANCE = None

    def __post_init__(self) -> None:
        pass


class Material:
    """How a surface reflects.

    Parameters
    ----------
    name : str
        Name.
    is_ground : bool
        Whether legs, and parts on the ground, stand on it.
    reflectance : float, optional
        0 to 1; by default that of ``spectra``, else 50 as in HELIOS++.
    classification : int
        Class of points.
    spectra : str, optional
        Name of a spectrum.
    ambient_components, diffuse_components, specular_components : tuple of float
        Colours.
    specular_exponent : float
        Exponent of the specular lobe.
    **unknown : Any
        Refused.

    Raises
    ------
    ValueError
        Unknown keywords.
    """

    def __init__(
        self,
        name: str = "default",
        *,
        is_ground: bool = False,
        reflectance: float | None = None,
        classification: int = 0,
        spectra: str | None = None,
        ambient_components: tuple[float, float, float] = (0.0, 0.0, 0.0),
        diffuse_components: tuple[float, float, float] = (0.0, 0.0, 0.0),
        specular_components: tuple[float, float, float] = (0.0, 0.0, 0.0),
        specular_exponent: float = 10.0,
        **unknown: Any,
    ) -> None:
        if unknown:
            raise ValueError(f"Material has no {', '.join(map(repr, unknown))}")
        if reflectance is not None and not 0 <= reflectance <= 1:
            warn(f"reflectance of the material {name!r} is {reflectance}, expected 0 to 1")
        self.name, self.is_ground, self.reflectance = name, is_ground, reflectance
        self.classification, self.spectra = classification, spectra
        self.ambient_components, self.diffuse_components = ambient_components, diffuse_components
        self.specular_components, self.specular_exponent = specular_components, specular_exponent

    @overload
    @classmethod
    def from_file(cls, material_file: PathLike, material_name: None = None) -> dict[str, Material]: ...
    @overload
    @classmethod
    def from_file(cls, material_file: PathLike, material_name: str) -> Material: ...
    @classmethod
    def from_file(cls, material_file: PathLike, material_name: str | None = None) -> Material | dict[str, Material]:
        """Read materials of a file.

        Parameters
        ----------
        material_file : str or path-like
            An MTL file.
        material_name : str, optional
            Name of the one that is wanted.

        Returns
        -------
        Material or dict of Material
            The material of the name, or all materials by name.

        Raises
        ------
        ValueError
            No material has the name.
        """
        found = read_materials(find_asset(material_file))
        if material_name is None:
            return found
        if material_name not in found:
            raise ValueError(f"{os.fspath(material_file)} has no material {material_name!r}; there are {', '.join(found)}")
        return found[material_name]

    def clone(self) -> Material:
        """Return a copy.

        Returns
        -------
        Material
            The copy.
        """
        return copy(self)

    def engine(self) -> EngineMaterial:
        """Return the material for the engine.

        Returns
        -------
        vlscan.Material
            The material.
        """
        return _UncheckedMaterial(
            self.name,
            reflectance=self.reflectance,
            classification=int(self.classification),
            spectrum=self.spectra,
            is_ground=bool(self.is_ground),
            diffuse=three(self.diffuse_components),
            specular=three(self.specular_components),
            specular_exponent=float(self.specular_exponent),
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Material) and vars(self) == vars(other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"Material({self.name!r}, reflectance={self.reflectance}, classification={self.classification})"


def read_materials(path: str) -> dict[str, Material]:
    """Return the materials of an MTL file by name. Values that cannot be read are left out with a warning."""
    found: dict[str, Material] = {}
    current = None
    with open(path, encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            keyword, *words = line.split("#")[0].split() or [""]
            if keyword == "newmtl" and words:
                name = " ".join(words)
                current = found.setdefault(name, Material(name))
            elif current is not None and words:
                try:
                    _set(current, keyword, words)
                except ValueError as problem:
                    warn(f"{path}:{number}: {keyword} is left out: {problem}")
    return found


def _set(material: Material, keyword: str, words: list[str]) -> None:
    if keyword in ("Ka", "Kd", "Ks"):
        numbers = [float(word) for word in words[:3]]
        colour = tuple(numbers if len(numbers) == 3 else numbers[:1] * 3)
        name = {"Ka": "ambient", "Kd": "diffuse", "Ks": "specular"}[keyword]
        setattr(material, f"{name}_components", colour)
    elif keyword == "Ns":
        material.specular_exponent = float(words[0])
    elif keyword == "helios_reflectance":
        material.reflectance = float(words[0])
    elif keyword == "helios_classification":
        material.classification = int(words[0])
    elif keyword == "helios_spectra":
        material.spectra = words[0]
    elif keyword == "helios_isGround":
        truths = {"true": True, "1": True, "false": False, "0": False}
        if words[0].lower() not in truths:
            raise ValueError(f"expected true or false, found {words[0]!r}")
        material.is_ground = truths[words[0].lower()]
