"""Materials of surfaces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, ClassVar, SupportsFloat

import numpy as np

from . import _vlscan
from ._arguments import path_of, real, reals, suggesting
from ._typing import PathLike


@dataclass(frozen=True)
class Material:
    """Reflection of a surface, and the class of its points.

    Parameters
    ----------
    name : str
        Name, by which :meth:`Part.with_material` finds it.
    reflectance : float, optional
        Reflectance, 0 to 1. By default that of ``spectrum``, else 0.5; a mirror or pane is clean by default.
    classification : int
        Class of the points, 0 to 255.
    spectrum : str, optional
        Name of a spectrum, which gives the reflectance at the scanner's wavelength: of a file in a ``spectra`` folder of the assets,
        or built in (:func:`vlscan.spectra`).
    is_ground : bool
        True if legs, and parts on the ground, stand on it.
    diffuse : tuple of float
        Diffuse colour; all 0 with no specular colour is a surface that reflects alike in all directions.
    specular : tuple of float
        Specular colour.
    specular_exponent : float
        Exponent of the specular lobe.
    roughness_deg : float
        Roughness of the surface, 0 to 90 degrees; refined physics.
    element_size_m : float
        Size of the elements of foliage (shoots, clusters of leaves) that intercept light as a whole, 0 to 100 m; refined physics.
    is_leaf : bool, optional
        True for leaves, whose area counts as leaf area. By default the name tells: it contains leaf, leaves, needle, foliage,
        or their German names.
    mirror : float, optional
        Share of the light that the surface mirrors, 0 to 1. By default it is not a mirror.
    pane_index : float, optional
        Refractive index of a pane, 1 to 5; 1.5 if another property of a pane is given.
    pane_thickness_m : float, optional
        Thickness of each sheet of a pane, 0 to 1 m; 0.004 m if another property of a pane is given.
    pane_absorption : float, optional
        Absorption within a pane, 0 to 1e6 per metre.
    pane_sheets : int, optional
        Number of sheets of a pane, 1 or 2.
    retro : float, optional
        Coefficient R_A of a retro-reflector, 0 to 1e5 cd/(lx m²).
    water_index : float, optional
        Refractive index of water, 1 to 5; 1.335 if another property of water is given, else the surface is not water.
    water_group_index : float, optional
        Group index of water, 1 to 5; 0.022 above the refractive index by default.
    water_attenuation : float, optional
        Diffuse attenuation K of light in water, per metre; 0.1 by default.
    water_secchi_m : float, optional
        Secchi depth, m, instead of ``water_attenuation``, which is 1.7 over it.
    water_beam_attenuation : float, optional
        Attenuation c of a narrow beam, per metre, at least K; K by default.
    water_backscatter : float, optional
        Light that water scatters straight back, per metre and sr; that of pure water by default.
    water_wind_m_s : float, optional
        Wind speed, 0 to 50 m/s, which makes waves; 0 for flat water, 5 by default.
    water_wind_deg : float, optional
        Direction of the wind, degrees clockwise from north; by default waves are alike in all directions.

    Raises
    ------
    ValueError
        A value is beyond its bounds.

    Examples
    --------
    >>> vlscan.Material("soil", reflectance=0.3, classification=2, is_ground=True).classification
    2
    """

    name: str = "material"
    reflectance: float | None = None
    classification: int = 0
    spectrum: str | None = None
    is_ground: bool = False
    diffuse: tuple[float, float, float] = (1.0, 1.0, 1.0)
    specular: tuple[float, float, float] = (0.0, 0.0, 0.0)
    specular_exponent: float = 10.0
    roughness_deg: float = 0.0
    element_size_m: float = 0.0
    is_leaf: bool | None = None
    mirror: float | None = None
    pane_index: float | None = None
    pane_thickness_m: float | None = None
    pane_absorption: float | None = None
    pane_sheets: int | None = None
    retro: float | None = None
    water_index: float | None = None
    water_group_index: float | None = None
    water_attenuation: float | None = None
    water_secchi_m: float | None = None
    water_beam_attenuation: float | None = None
    water_backscatter: float | None = None
    water_wind_m_s: float | None = None
    water_wind_deg: float | None = None

    _USUAL_REFLECTANCE: ClassVar[float | None] = 0.5

    def __post_init__(self) -> None:
        self._check_types()
        self._check("reflectance", 1)
        self._check("roughness_deg", 90)
        self._check("element_size_m", 100)
        self._check("classification", 255)
        self._check("mirror", 1)
        self._check("pane_index", 5, 1)
        self._check("pane_thickness_m", 1)
        self._check("pane_absorption", 1e6)
        self._check("pane_sheets", 2, 1)
        self._check("retro", 1e5)
        self._check("water_index", 5, 1)
        self._check("water_group_index", 5, 1)
        self._check("water_attenuation", 1e4)
        self._check("water_secchi_m", 100, 0.01)
        self._check("water_beam_attenuation", 1e4)
        self._check("water_backscatter", 10)
        self._check("water_wind_m_s", 50)
        self._check("water_wind_deg", 360, -360)

    @staticmethod
    def read(path: PathLike) -> dict[str, Material]:
        """Read the materials of a file.

        Parameters
        ----------
        path : str or path-like
            An MTL file, or an OBJ file (``.obj``), of which only the materials that it uses are returned.

        Returns
        -------
        dict of str to Material
            Materials by name in the order of the file; the first one of a name counts. Their values are those of the file, even
            beyond the bounds of other materials, and a material without reflectance has that of the physics: 0.5, or 50 with
            ``physics="helios"``.

        Raises
        ------
        InputError
            A value of the file is invalid.
        FileError
            The file cannot be read.

        Examples
        --------
        >>> materials = vlscan.Material.read("fixtures/forest/forest.mtl")
        >>> materials["beech_leaves"].classification
        5
        """
        name = path_of("path", path)
        found: dict[str, Material] = {}
        for fields in _vlscan.materials_of_file(name, name.lower().endswith(".obj")):
            found.setdefault(fields["name"], FileMaterial.of_fields(fields))
        return found

    def _check_types(self) -> None:
        for name, kind, expected in (("name", str, "a text"), ("spectrum", str, "a text"), ("is_ground", bool, "True or False")):
            value = getattr(self, name)
            if not (isinstance(value, (kind, np.bool_) if kind is bool else kind) or name == "spectrum" and value is None):
                raise TypeError(f"{name} of the material {self.name!r} is {value!r}, expected {expected}")
        for name in ("classification", "pane_sheets"):
            value = getattr(self, name)
            if isinstance(value, (float, np.floating)) and value != math.floor(value):
                raise TypeError(f"{name} of the material {self.name!r} is {value!r}, expected a whole number")
        for name in ("diffuse", "specular"):
            colour = reals(f"{name} of the material {self.name!r}", getattr(self, name))
            if colour.shape != (3,) or not np.isfinite(colour).all():
                raise ValueError(f"{name} of the material {self.name!r} is {getattr(self, name)}, expected three finite numbers")
        exponent = real(f"specular_exponent of the material {self.name!r}", self.specular_exponent)
        if not 0 <= exponent < math.inf:
            raise ValueError(f"specular_exponent of the material {self.name!r} is {exponent}, expected a number from 0")

    def _check(self, name: str, highest: float, lowest: float = 0) -> None:
        value = getattr(self, name)
        if value is None:
            return
        if not isinstance(value, SupportsFloat) or isinstance(value, (bool, np.bool_, np.ndarray)):
            hint = "; classes are numbers, as in LAS: 2 is ground, 5 high vegetation, 6 building" if name == "classification" else ""
            raise TypeError(f"{name} of the material {self.name!r} is {value!r}, expected a number from {lowest} to {highest}{hint}")
        if not lowest <= float(value) <= highest:
            raise ValueError(f"{name} of the material {self.name!r} is {value}, expected {lowest} to {highest}")


if not TYPE_CHECKING:
    Material.__init__ = suggesting(Material.__init__)


class FileMaterial(Material):
    """A material as a file defines it: its values are not checked, and without a reflectance it has that of the physics.

    Parameters
    ----------
    *values, **fields : Any
        Values of :class:`Material`.
    """

    _USUAL_REFLECTANCE = None

    def __post_init__(self) -> None:
        pass

    @classmethod
    def of_fields(cls, fields: Mapping[str, Any]) -> FileMaterial:
        """Return the material of values of the engine.

        Parameters
        ----------
        fields : mapping
            Values by name.

        Returns
        -------
        FileMaterial
            The material.
        """
        values = dict(fields)
        # Without the last digits, which the conversion may have changed.
        values["roughness_deg"] = float(f"{math.degrees(values.pop('roughness')):.12e}")
        values |= {name: tuple(values[name]) for name in ("diffuse", "specular")}
        return cls(**values)


def fields_of(material: Material) -> dict[str, Any]:
    """Return the values of a material for the engine.

    Parameters
    ----------
    material : Material
        The material.

    Returns
    -------
    dict
        Values by name.

    Raises
    ------
    TypeError
        Something else than a material.
    """
    if not isinstance(material, Material):
        raise TypeError(f"expected a Material, found {material!r}; vlscan.Material({str(material)!r}) makes one")
    fields = asdict(material)
    optics = ("mirror", "pane_index", "pane_thickness_m", "pane_absorption", "pane_sheets")
    is_optical = any(value is not None and (name in optics or name.startswith("water_")) for name, value in fields.items())
    if material.reflectance is None and material.spectrum is None and not is_optical:
        fields["reflectance"] = material._USUAL_REFLECTANCE
    for key in ("diffuse", "specular"):
        fields[key] = [float(v) for v in fields[key]]
    for key in ("specular_exponent", "roughness_deg"):
        fields[key] = float(fields[key])
    for key in ("classification", "pane_sheets"):
        fields[key] = None if fields[key] is None else int(fields[key])
    fields["is_ground"] = bool(fields["is_ground"])
    return fields
