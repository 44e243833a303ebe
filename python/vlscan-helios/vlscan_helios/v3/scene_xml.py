"""Parts of scene files."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from functools import partial
from xml.etree.ElementTree import Element

import numpy as np

from vlscan.parts import Part

from .materials import Material, read_materials
from .scene_part import ScenePart, default_material, materials_of_obj
from .utils import search_folders
from .xml_files import Document, float_of, read, truth_of


def parts_of(scene: str | os.PathLike[str]) -> list[tuple[str, ScenePart]]:
    """Return the parts of a scene file with their ids.

    Parameters
    ----------
    scene : str or path-like
        ``file.xml``, or ``file.xml#id``.

    Returns
    -------
    list of tuple
        Id and part; those that cannot be used alone say so when they are.

    Raises
    ------
    ValueError
        The file is no scene.
    """
    file, _, id = os.fspath(scene).partition("#")
    document = read(file)
    found: list[tuple[str, ScenePart]] = []
    number = 0
    for element in document.asset("scene", id).findall("part"):
        name = element.get("id") or ""
        try:
            parts = _parts(document, element)
        except (NotImplementedError, ValueError, OSError) as obstacle:
            parts = [ScenePart().become(None, obstacle=f"part {name or number} of {file}: {obstacle}")]
        for index, part in enumerate(parts):
            # A part without an id is numbered, and is one for each of its files.
            own = name or str(number + index)
            found.append((own, part.of_file(own)))
        number += 1 if name else max(len(parts), 1)
    return found


def _parts(document: Document, element: Element) -> list[ScenePart]:
    for kind in ("swap", "dmotion"):
        if element.find(kind) is not None:
            raise NotImplementedError(f"a part with <{kind}> belongs to its scene")
    loader: tuple[str, dict[str, Element]] | None = None
    quaternion = (1.0, 0.0, 0.0, 0.0)
    scale, offset, on_ground = 1.0, [0.0, 0.0, 0.0], 0
    for step in element.findall("filter"):
        kind, params = (step.get("type") or "").lower(), {param.get("key", ""): param for param in step.findall("param")}
        if kind == "rotate" and "rotation" in params:
            quaternion = _product(_rotation(params["rotation"]), quaternion)
        elif kind == "scale":
            scale = float_of(_text(params, "scale"), scale) or scale
        elif kind == "translate":
            offset = [float_of(number, 0.0) for number in _text(params, "offset", "0;0;0").split(";")]
            on_ground = int(float_of(_text(params, "onGround"), 0))
        elif kind.endswith("loader") or kind == "detailedvoxels":
            # A loader starts afresh.
            loader, quaternion, scale, offset, on_ground = (kind, params), (1.0, 0.0, 0.0, 0.0), 1.0, [0.0, 0.0, 0.0], 0
    if loader is None:
        raise NotImplementedError("it has no loader")
    made = []
    for path in _files(document, loader[1]):
        part = _loaded(document, *loader, path).placed(quaternion, scale, offset)
        if on_ground:
            part.force_on_ground = on_ground
        made.append(part)
    return made


def _text(params: Mapping[str, Element], key: str, default: str = "") -> str:
    return params[key].get("value", default) if key in params else default


def _files(document: Document, params: Mapping[str, Element]) -> list[str]:
    expression = _text(params, "efilepath")
    if not expression:
        return [document.locate(_text(params, "filepath"))]
    folder, _, pattern = expression.rpartition("/")
    found: dict[str, str] = {}
    for base in [*search_folders(), document.path.parent]:
        if (base / folder).is_dir():
            names = sorted(name for name in os.listdir(base / folder) if re.fullmatch(pattern, name))
            found = {**{name: os.fspath(base / folder / name) for name in names}, **found}
    return [found[name] for name in sorted(found)]


def _materials(matfile: str | None, matname: str | None) -> dict[str, Material]:
    """Return the material of a part that has one: that of the name, else the alphabetically first."""
    found = read_materials(matfile) if matfile else default_material()
    name = matname or min(found, default="")
    return {name: found[name]} if name in found else found


def _loaded(document: Document, kind: str, params: Mapping[str, Element], path: str) -> ScenePart:
    if kind == "objloader":
        return ScenePart.of_part(Part.obj(path, _text(params, "up", "z")), partial(materials_of_obj, path))
    if float_of(_text(params, "randomMaterials"), 0) > 0:
        raise NotImplementedError("random materials belong to the loader of a scene file")
    matfile = document.locate(_text(params, "matfile")) if "matfile" in params else None
    matname = _text(params, "matname") or None
    materials = partial(_materials, matfile, matname)

    if kind == "geotiffloader":
        return ScenePart.of_part(Part.raster(path, matfile, matname), materials)
    if kind == "xyzloader":
        return ScenePart.of_part(_cloud(params, path, matfile, matname), materials)
    if kind == "detailedvoxels":
        table = document.locate(_text(params, "ladlut")) if "ladlut" in params else None
        shift = truth_of(_text(params, "randomShift"), False)
        exponent = float_of(_text(params, "intersectionArgument"), 0.5)
        mode = _text(params, "intersectionMode", "transmittive").lower()
        drop_empty = "intersectionMode" not in params
        return ScenePart.of_part(Part.voxels(path, mode, exponent, shift, table, matfile, matname, drop_empty=drop_empty), materials)
    raise NotImplementedError(f"it has the loader {kind}")


def _cloud(params: Mapping[str, Element], path: str, matfile: str | None, matname: str | None) -> Part:
    def columns(keys: tuple[str, str, str], first: int) -> tuple[int, int, int] | None:
        if keys[0] not in params:
            return None
        x, y, z = (int(float_of(_text(params, key), first + index)) for index, key in enumerate(keys))
        return x, y, z

    normal = [float_of(number, 0.0) for number in _text(params, "defaultNormal").split(";")] if "defaultNormal" in params else None
    return Part.points(
        path,
        float_of(_text(params, "voxelSize"), 1.0) or 1.0,
        separator=_text(params, "separator").replace("\\t", "\t"),
        normal_columns=columns(("normalXIndex", "normalYIndex", "normalZIndex"), 3),
        rgb_columns=columns(("rgbRIndex", "rgbGIndex", "rgbBIndex"), 6),
        max_color_value=float_of(_text(params, "maxColorValue"), 0.0) or 255.0,
        default_normal=None if normal is None else (normal[0], normal[1], normal[2]),
        estimate_normals=int(float_of(_text(params, "estimateNormals"), 0)),
        snap_neighbor_normal=truth_of(_text(params, "snapNeighborNormal"), False),
        material_file=matfile,
        material=matname,
    )


def _rotation(param: Element) -> tuple[float, float, float, float]:
    """Return the quaternion of a group of rotations: about fixed axes one after the other, or each in the frame of those before."""
    total = (1.0, 0.0, 0.0, 0.0)
    for turn in param.findall("rot"):
        axis = (turn.get("axis") or "").lower()
        if axis not in ("x", "y", "z"):
            raise NotImplementedError(f"it has a rotation about {axis!r}")
        half = math.radians(float_of(turn.get("angle_deg"), 0.0)) / 2
        vector = np.eye(3)["xyz".index(axis)] * math.sin(half)
        one = (math.cos(half), *vector.tolist())
        total = _product(total, one) if param.get("rotations") == "local" else _product(one, total)
    return total


def _product(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, float, float, float]:
    """Return the quaternion of the rotation ``b``, then ``a``."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )
