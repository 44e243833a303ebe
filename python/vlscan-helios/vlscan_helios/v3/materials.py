"""Materials, and those that files define."""

from __future__ import annotations

import math
import os
from collections.abc import ItemsView, Iterator, KeysView, MutableMapping, ValuesView
from dataclasses import fields
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PrivateAttr

from vlscan.errors import warn
from vlscan.materials import FileMaterial
from vlscan.materials import Material as EngineMaterial

from .utils import existing_file
from .validation import Components, Model, UpdateableMixin


def _none() -> Any:
    return np.zeros(4)


class Material(Model, UpdateableMixin):
    """Reflection of a surface.

    Parameters
    ----------
    name : str
        Name.
    is_ground : bool
        True if legs, and parts on the ground, stand on it.
    spectra : str
        Name of a spectrum, whose reflectance at the scanner's wavelength counts.
    reflectance : float
        0 to 1; NaN is that of ``spectra``, else 50 as in HELIOS++.
    specularity : float
        Share of the specular lobe, 0 to 1, where no colours are given.
    specular_exponent : float
        Exponent of the specular lobe.
    classification : int
        Class of points.
    ambient_components, diffuse_components, specular_components : array_like
        Colours, four numbers; a diffuse and a specular colour tell the share of the specular lobe.
    """

    name: str = ""
    is_ground: bool = False
    spectra: str = ""
    reflectance: float = np.nan
    specularity: Annotated[float, Field(ge=0, le=1)] = 0
    specular_exponent: float = 10
    classification: int = 0
    ambient_components: Components = Field(default_factory=_none)
    diffuse_components: Components = Field(default_factory=_none)
    specular_components: Components = Field(default_factory=_none)
    # What a file says of it, also beyond the fields: roughness, mirrors, panes.
    _defined: EngineMaterial = PrivateAttr(default_factory=FileMaterial)

    def model_post_init(self, context: Any, /) -> None:
        """Warn of a reflectance that no surface has.

        Parameters
        ----------
        context : object
            Without effect.
        """
        if not math.isnan(self.reflectance) and not 0 <= self.reflectance <= 1:
            warn(f"reflectance of the material {self.name!r} is {self.reflectance}, expected 0 to 1")

    @classmethod
    def from_file(cls, material_file: str | os.PathLike[str], material_id: str = "") -> Material:
        """Read a material of a file.

        Parameters
        ----------
        material_file : str or path-like
            An MTL file.
        material_id : str
            Name of the material; the alphabetically first by default.

        Returns
        -------
        Material
            The material.

        Raises
        ------
        ValueError
            No material has the name.
        FileNotFoundError
            There is no such file.
        """
        found = {name: cls.of_engine(material) for name, material in EngineMaterial.read(existing_file(material_file)).items()}
        if not found or material_id and material_id not in found:
            raise ValueError(f"{os.fspath(material_file)} has no material {material_id!r}; there are {', '.join(found) or 'none'}")
        return found[material_id or min(found)]

    @classmethod
    def of_engine(cls, material: EngineMaterial) -> Material:
        """Return a material of the engine.

        Parameters
        ----------
        material : vlscan.Material
            The material.

        Returns
        -------
        Material
            The material.
        """
        made = cls(name=material.name, is_ground=material.is_ground, spectra=material.spectrum or "")
        # Behind the warning: the engine tells of a reflectance that no surface has.
        made.reflectance = math.nan if material.reflectance is None else material.reflectance
        made.specular_exponent, made.classification = material.specular_exponent, material.classification
        made.diffuse_components, made.specular_components = [*material.diffuse, 0.0], [*material.specular, 0.0]
        made._defined = material
        return made

    def engine(self) -> EngineMaterial:
        """Return the material for the engine.

        Returns
        -------
        vlscan.Material
            The material.
        """
        diffuse, specular = self.diffuse_components[:3], self.specular_components[:3]
        if self.specularity > 0 and not diffuse.any() and not specular.any():
            diffuse, specular = np.full(3, 1 - self.specularity), np.full(3, self.specularity)
        values = {field.name: getattr(self._defined, field.name) for field in fields(self._defined)}
        values |= {
            "name": self.name or "default",
            "reflectance": None if math.isnan(self.reflectance) else self.reflectance,
            "classification": self.classification,
            "spectrum": self.spectra or None,
            "is_ground": self.is_ground,
            "diffuse": tuple(diffuse.tolist()),
            "specular": tuple(specular.tolist()),
            "specular_exponent": self.specular_exponent,
        }
        return FileMaterial(**values)


class MaterialDict(MutableMapping[str, Material]):
    """Materials by name.

    Parameters
    ----------
    materials : dict, optional
        The materials.
    """

    def __init__(self, materials: dict[str, Material] | None = None) -> None:
        self._materials = dict(materials or {})
        self._renamed: dict[str, str] = {}

    def __getitem__(self, name: str) -> Material:
        if name not in self._materials:
            raise KeyError(f"there is no material {name!r}; there are {', '.join(self._materials) or 'none'}")
        return self._materials[name]

    def __setitem__(self, name: str, material: Material) -> None:
        """Set a material; one that replaces another takes its place under its own name."""
        if not isinstance(material, Material):
            raise ValueError(f"expected a Material, found {type(material).__name__}")
        new = material.name or name
        if name not in self._materials or new == name:
            self._materials[name] = material
            return
        self._materials = {new if key == name else key: material if key == name else old for key, old in self._materials.items()}
        first = next((key for key, current in self._renamed.items() if current == name), name)
        self._renamed[first] = new

    def current(self, name: str) -> str:
        """Return the name of a material now.

        Parameters
        ----------
        name : str
            Its name at first.

        Returns
        -------
        str
            The name.
        """
        return self._renamed.get(name, name)

    def clone(self) -> MaterialDict:
        """Return a copy with copies of the materials.

        Returns
        -------
        MaterialDict
            The copy.
        """
        twin = MaterialDict({name: material.clone() for name, material in self._materials.items()})
        twin._renamed = dict(self._renamed)
        return twin

    def __delitem__(self, name: str) -> None:
        del self._materials[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._materials)

    def __len__(self) -> int:
        return len(self._materials)

    def items(self) -> ItemsView[str, Material]:
        """Return names and materials.

        Returns
        -------
        ItemsView
            Names and materials.
        """
        return self._materials.items()

    def keys(self) -> KeysView[str]:
        """Return the names.

        Returns
        -------
        KeysView
            The names.
        """
        return self._materials.keys()

    def values(self) -> ValuesView[Material]:
        """Return the materials.

        Returns
        -------
        ValuesView
            The materials.
        """
        return self._materials.values()

    def __repr__(self) -> str:
        return f"MaterialDict({self._materials!r})"
