"""Files and asset directories, the seed, grids of parameters, types of records."""

from __future__ import annotations

import html
import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from datetime import datetime, timezone
from difflib import get_close_matches
from glob import glob, has_magic
from itertools import product
from pathlib import Path
from string import Formatter
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import WrongTypeError
from .package_files import on_disk, package_folders, shipped_files, shipped_spectra

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self

    from .settings import ExecutionSettings
    from .survey import Survey


class _OfClassError(TypeError, AttributeError):
    """A method of a class that is called on an instance, which has no such attribute."""


if TYPE_CHECKING:
    classonlymethod = classmethod
else:

    class classonlymethod(classmethod):
        """A class method that instances do not have."""

        def __get__(self, instance: object, owner: type | None = None) -> Any:
            if instance is not None:
                raise _OfClassError(f"{self.__func__.__name__}() belongs to the class, not to its instances")
            return super().__get__(instance, owner)


#: A point, packed.
meas_dtype: np.dtype[np.void] = np.dtype(
    [
        ("channel_id", "<u8"),
        ("hit_object_id", "<i4"),
        ("position", "<f8", (3,)),
        ("beam_direction", "<f8", (3,)),
        ("beam_origin", "<f8", (3,)),
        ("distance", "<f8"),
        ("intensity", "<f8"),
        ("echo_width", "<f8"),
        ("return_number", "<i4"),
        ("number_of_returns", "<i4"),
        ("fullwave_index", "<i4"),
        ("classification", "<i4"),
        ("gps_time", "<f8"),
        ("point_source_id", "<u2"),
    ]
)

#: A pose: time (s), position (m), angles (rad).
traj_dtype: np.dtype[np.void] = np.dtype(
    [("gps_time", "<f8"), ("position", "<f8", (3,)), ("roll", "<f8"), ("pitch", "<f8"), ("yaw", "<f8")]
)

_asset_directories: list[Path] = []
_seed: list[int | float | str] = []


class _AssetDirectoryRegistration:
    """An asset directory; as a context manager it is one within its block only."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        _asset_directories.append(directory)

    def __repr__(self) -> str:
        # Notebooks show the value of their last line.
        return ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        # Of this registration only: the same folder may have been added before.
        if self.directory in _asset_directories:
            _asset_directories.remove(self.directory)


def add_asset_directory(directory: str | os.PathLike[str]) -> _AssetDirectoryRegistration:
    """Add a folder in which files are searched.

    Parameters
    ----------
    directory : str or path-like
        The folder.

    Returns
    -------
    contextlib.AbstractContextManager
        As a context manager the folder is searched within its block only.
    """
    return _AssetDirectoryRegistration(Path(directory))


def own_directories() -> list[Path]:
    """Return the folders that were added, in their order."""
    return list(dict.fromkeys(_asset_directories))


def engine_directories() -> list[Path]:
    """Return the folders that were added, each followed by its folder ``assets``, which has the spectra of HELIOS++."""
    return [path for folder in own_directories() for path in (folder, folder / "assets") if path == folder or path.is_dir()]


def get_asset_directories() -> list[Path]:
    """Return the folders in which files are searched after the working directory.

    Returns
    -------
    list of pathlib.Path
        The folders that were added, in their order; then three of the package. The last one has the files of its catalogue:
        ``scanners_als.xml``, ``scanners_tls.xml`` and ``platforms.xml``; the one before has the built-in ``spectra``.
    """
    return [*own_directories(), *package_folders()]


def search_folders() -> list[Path]:
    """Return the folders in which files are searched, in their order."""
    return [Path(), *own_directories(), Path("assets")]


def find_file(filename: str | os.PathLike[str], fatal: bool = True) -> Path | None:
    """Find a file on disk: as named, else in the asset directories, else in the catalogue and the spectra that ship.

    Parameters
    ----------
    filename : str or path-like
        The name.
    fatal : bool
        True if a missing file is an error.

    Returns
    -------
    pathlib.Path or None
        The file; ``None`` for a missing one that is no error.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    """
    found = named_file(filename, fatal=False)
    if found is not None:
        return on_disk(found)
    shipped = shipped_spectra(Path(filename))
    return named_file(filename, fatal) if shipped is None else shipped


def named_file(filename: str | os.PathLike[str], fatal: bool = True, *, by_bare_name: bool = True) -> Path | None:
    """Return a file of :func:`find_file` by the name that surveys use: one of the catalogue keeps its name.

    ``by_bare_name`` is whether the folders of the package are searched, too, so that ``platforms.xml`` is ``data/platforms.xml``.
    """
    if not isinstance(filename, (str, os.PathLike)):
        raise WrongTypeError(f"expected the name of a file, found {type(filename).__name__}")
    path = Path(filename)
    for folder in search_folders():
        if (folder / path).exists():
            return folder / path
    for shipped in (path, "data" / path) if by_bare_name else (path,):
        if shipped.as_posix() in shipped_files():
            return shipped
    if not fatal:
        return None
    searched = ", ".join(str(folder) for folder in search_folders())
    raise FileNotFoundError(f"{path} is not in {searched}; add_asset_directory() adds a folder to search in")


def existing_file(filename: str | os.PathLike[str]) -> Path:
    """Return a file of :func:`named_file`, which must exist."""
    found = named_file(filename)
    assert found is not None
    return found


def find_files(filename: str | os.PathLike[str], fatal: bool = True) -> list[Path]:
    """Find files by a pattern: as it stands, else in the asset directories.

    Parameters
    ----------
    filename : str or path-like
        A name or a pattern (``trees/*.obj``).
    fatal : bool
        True if no match is an error.

    Returns
    -------
    list of pathlib.Path
        The files, by name.

    Raises
    ------
    FileNotFoundError
        Nothing matches.
    """
    pattern = os.fspath(filename)
    if not has_magic(pattern):
        found = named_file(filename, fatal)
        return [] if found is None else [found]
    for folder in search_folders():
        names = sorted(glob(os.path.join(folder, pattern), recursive=True))
        if names:
            return [Path(name) for name in names]
    if not fatal:
        return []
    raise FileNotFoundError(f"no file matches {pattern} in {', '.join(str(folder) for folder in search_folders())}")


def set_rng_seed(seed: int | float | str | datetime | None = None) -> None:
    """Set the seed of all random draws of later runs; without a call it is that of the survey, else 0.

    Parameters
    ----------
    seed : int, float, str or datetime, optional
        The seed; by default the current time.

    Raises
    ------
    TypeError
        A value of another type.
    """
    if seed is None:
        seed = datetime.now(timezone.utc)
    if isinstance(seed, bool) or not isinstance(seed, (int, float, str, datetime, np.integer, np.floating)):
        raise WrongTypeError(f"a seed is a whole number, a text or a time, found {seed!r}")
    _seed[:] = [int(seed.timestamp()) if isinstance(seed, datetime) else seed.item() if isinstance(seed, np.generic) else seed]


def rng_seed() -> int | float | str | None:
    """Return the seed that was set."""
    return _seed[0] if _seed else None


def is_real_iterable(value: object) -> bool:
    """Return whether a value is a collection of values; texts, mappings and settings are single ones.

    Parameters
    ----------
    value : object
        The value.

    Returns
    -------
    bool
        True if it is.
    """
    if isinstance(value, (str, bytes, Mapping)) or hasattr(type(value), "model_fields"):
        return False
    try:
        iter(value)  # type: ignore[call-overload]
    except TypeError:
        return False
    return True


def combine_parameters(groups: list[list[str]] | None = None, **parameters: Any) -> list[dict[str, Any]]:
    """Return every combination of parameters, as keywords of :meth:`Survey.add_leg` for example.

    Parameters
    ----------
    groups : list of list of str, optional
        Names of parameters that vary together: the first values of all, then the second ones. Collections outside of groups are
        values then; without groups each collection varies for itself.
    **parameters : Any
        Values by name: a collection, or one value for all combinations. Texts are templates over the other parameters:
        ``"x={x}"``.

    Returns
    -------
    list of dict
        The combinations; the parameter that was named last varies fastest.

    Raises
    ------
    ValueError
        A group names an unknown parameter or one of another group, or its parameters have different numbers of values.
    TypeError
        The groups are no lists of names, such as ``["x", "y"]`` instead of ``[["x", "y"]]``.

    Examples
    --------
    >>> vlscan.helios.combine_parameters(groups=[["x", "y"]], x=[0, 5], y=[1, 6], z=2)
    [{'x': 0, 'y': 1, 'z': 2}, {'x': 5, 'y': 6, 'z': 2}]
    """
    wrong = groups if isinstance(groups, str) else next((group for group in groups or () if not is_real_iterable(group)), None)
    if wrong is not None:
        raise WrongTypeError(f"groups is {groups!r}, expected lists of names, such as groups=[['x', 'y']]")
    grouped = None if groups is None else {name for group in groups for name in group}
    columns = {
        name: list(value) if is_real_iterable(value) and (grouped is None or name in grouped) else [value]
        for name, value in parameters.items()
    }
    group_of: dict[str, tuple[str, ...]] = {}
    for group in groups or []:
        for name in group:
            if name not in columns:
                raise ValueError(f"groups name {name!r}; the parameters are {', '.join(columns) or 'none'}")
            if name in group_of:
                raise ValueError(f"groups name {name!r} twice")
            group_of[name] = tuple(group)
        lengths = {name: len(columns[name]) for name in group}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"parameters of a group need equally many values, found {lengths}")
    blocks = dict.fromkeys(group_of.get(name, (name,)) for name in columns)
    rows = {names: zip(*(columns[name] for name in names), strict=True) for names in blocks}
    choices = [[dict(zip(names, values, strict=True)) for values in rows[names]] for names in blocks]
    combined = ({name: value for part in parts for name, value in part.items()} for parts in product(*choices))
    return [{name: _filled(values[name], values) for name in columns} for values in combined]


def _filled(value: Any, values: Mapping[str, Any]) -> Any:
    """Return a text whose fields name parameters with their values; all else as it is."""
    if not isinstance(value, str) or "{" not in value:
        return value
    try:
        fields = [re.split(r"[.\[]", field)[0] for _, field, _, _ in Formatter().parse(value) if field is not None]
    except ValueError:
        # Braces that are no fields.
        return value
    return value.format(**values) if fields and all(field in values for field in fields) else value


class XmlText(str):
    """XML as text, which notebooks show as it is."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self)}</pre>"


def display_xml(path: str | os.PathLike[str] | Survey, item: str | None = None) -> XmlText:
    """Return an XML file, or one of its elements, as text.

    Parameters
    ----------
    path : str, path-like or Survey
        The file, or a survey, of which the XML that would be run is returned.
    item : str, optional
        Id (or tag) of the element; the whole file by default.

    Returns
    -------
    str
        The text, which notebooks show.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    ValueError
        No element has the id.
    """
    if not isinstance(path, (str, os.PathLike)):
        if not hasattr(path, "to_xml"):
            raise WrongTypeError(f"expected a file or a survey, found {path!r}")
        return XmlText(path.to_xml())
    found = on_disk(existing_file(path))
    text = found.read_text(encoding="utf-8", errors="replace")
    if item is None:
        return XmlText(text)
    names: dict[str, None] = {}
    for element in ElementTree.fromstring(text.lstrip()).iter():
        if item in (element.get("id"), element.tag):
            ElementTree.indent(element)
            return XmlText(ElementTree.tostring(element, encoding="unicode").strip())
        names |= dict.fromkeys(filter(None, (element.get("id"), element.tag)))
    close = get_close_matches(item, names, 1)
    hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(names)}"
    raise ValueError(f"{found} has no element with the id or tag {item!r}; {hint}")


def detect_separator(file_path: str | os.PathLike[str]) -> str:
    """Return the character between the columns of a text file.

    Parameters
    ----------
    file_path : str or path-like
        The file.

    Returns
    -------
    str
        A comma, a semicolon, a tab or a blank.

    Raises
    ------
    ValueError
        No line of the file has several columns.
    """
    path = existing_file(file_path)
    with open(path, encoding="utf-8", errors="replace") as file:
        for line in file:
            text = line.strip()
            if not text or text.startswith(("#", "//")):
                continue
            for separator in (",", ";", "\t", " "):
                if len([word for word in text.split(separator) if word.strip()]) > 1:
                    return separator
            break
    raise ValueError(f"{path} has no line of columns that a comma, a semicolon, a tab or a blank separates")


def is_finalized(obj: object) -> bool:
    """Return whether the scene of a survey, or a scene itself, is loaded and ready to be traced.

    Parameters
    ----------
    obj : object
        A survey, a scene, or anything else, which never is.

    Returns
    -------
    bool
        True if it is.
    """
    return bool(getattr(obj, "is_loaded", False))


def is_xml_loaded(obj: object) -> bool:
    """Return whether an object was read from an XML file.

    Parameters
    ----------
    obj : object
        A survey, a scene, a part, a scanner or a platform.

    Returns
    -------
    bool
        True if it was.
    """
    return bool(getattr(obj, "is_of_file", False))


def check_integrate_survey_and_legs(survey: Survey) -> None:
    """Check that the legs of a survey fit its platform.

    Parameters
    ----------
    survey : Survey
        The survey.

    Raises
    ------
    ValueError
        A leg has a part of a trajectory, and the platform has no trajectory.
    """
    survey.check_legs()


def apply_scene_shift(survey: Survey, execution_settings: ExecutionSettings) -> None:
    """Load the scene of a survey. Coordinates stay those of the world: the engine shifts them by itself.

    Parameters
    ----------
    survey : Survey
        The survey.
    execution_settings : ExecutionSettings
        Threads that load it.
    """
    survey.scene.engine().load(threads=execution_settings.num_threads)
