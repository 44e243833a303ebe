"""Scenes and their parts."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterable
from copy import copy
from pathlib import Path
from typing import Annotated, Any

from pydantic import PrivateAttr, validate_call
from typing_extensions import Self

from vlscan.errors import kept_folder
from vlscan.places import asset_folders, place_of, working_folder
from vlscan.scene import Scene

from .errors import engine_errors
from .materials import Material, MaterialDict
from .scene_part import BoundingBox, ScenePart
from .utils import classonlymethod, engine_directories, existing_file
from .validation import SEVERAL, CompressionLevel, Model


class StaticScene(Model):
    """Parts that do not move."""

    scene_parts: Annotated[tuple[ScenePart, ...], SEVERAL] = ()
    _scene: Scene | None = PrivateAttr(None)
    _state: list[tuple[object, ...]] = PrivateAttr(default_factory=list)
    # The file, and its parts as read.
    _file: str | None = PrivateAttr(None)
    _as_read: list[tuple[object, ...]] = PrivateAttr(default_factory=list)
    # Working directory in which the file was named.
    _folder: str = PrivateAttr("")
    _is_packed: bool = PrivateAttr(False)

    @classonlymethod
    def from_xml(cls, scene_file: str | os.PathLike[str]) -> StaticScene:
        """Return the scene of a file.

        Parameters
        ----------
        scene_file : str or path-like
            The file, or ``file.xml#id``; without an id its first scene.

        Returns
        -------
        StaticScene
            The scene.

        Raises
        ------
        FileNotFoundError
            There is no such file.
        """
        name, mark, id = os.fspath(scene_file).partition("#")
        path = existing_file(name)
        file = f"{path}{mark}{id}"
        # A survey can name a packed scene or a mesh, too, whose parts are not listed.
        is_xml = path.suffix.lower() == ".xml"
        parts = Scene(file, engine_directories()).read_parts() if is_xml else []
        scene = cls(scene_parts=tuple(ScenePart.of_scene(part, name) for part in parts))
        return scene.read_from(file)

    @classonlymethod
    def from_binary(cls, binary_file: str | os.PathLike[str]) -> StaticScene:
        """Return the scene of a file of :meth:`to_binary`, whose parts are not listed.

        Parameters
        ----------
        binary_file : str or path-like
            The file.

        Returns
        -------
        StaticScene
            The scene.

        Raises
        ------
        FileNotFoundError
            There is no such file.
        HeliosException
            The file is no packed scene.
        """
        scene = cls().read_from(os.fspath(existing_file(binary_file)), is_packed=True)
        with engine_errors():
            scene.engine().load()
        return scene

    def read_from(self, file: str, is_packed: bool = False) -> Self:
        """Become the scene of a file, with the parts that it has now.

        Parameters
        ----------
        file : str
            The file, or ``file.xml#id``.
        is_packed : bool
            True if it is a packed scene, whatever its extension.

        Returns
        -------
        StaticScene
            Itself.
        """
        self._is_packed = is_packed
        self._file, self._folder, self._as_read = file, working_folder(), [part.state() for part in self.scene_parts]
        return self

    @property
    def source_file(self) -> str | None:
        """File that it was read from."""
        return self._file

    @validate_call
    def to_binary(self, binary_file: Path, compression_level: CompressionLevel = 6) -> None:
        """Write the scene, ready to be used, as a packed scene of vlscan.

        Parameters
        ----------
        binary_file : str or path-like
            The file; ``.vlscene`` is the extension that the command line knows.
        compression_level : int
            Without effect: packed scenes are mapped into memory as they are.
        """
        if binary_file.suffix == _PACKED:
            with engine_errors():
                self.engine().pack(binary_file, physics="helios", force=True)
            return
        if not binary_file.parent.is_dir():
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), os.fspath(binary_file))
        with tempfile.TemporaryDirectory(prefix=".vlscan-", dir=binary_file.parent) as folder, engine_errors():
            packed = Path(folder) / f"scene{_PACKED}"
            self.engine().pack(packed, physics="helios")
            os.replace(packed, binary_file)

    def add_scene_part(self, scene_part: ScenePart) -> None:
        """Add a part.

        Parameters
        ----------
        scene_part : ScenePart
            The part.

        Raises
        ------
        NotImplementedError
            The scene is packed, so that its parts are not known.
        """
        self._check_extensible()
        self.scene_parts = (*self.scene_parts, scene_part)

    @property
    def bbox(self) -> BoundingBox:
        """The box around all parts."""
        with engine_errors():
            return BoundingBox.of_bounds(self.engine().bounds)

    @property
    def is_loaded(self) -> bool:
        """True if the scene is in memory, ready to be traced."""
        return self._scene is not None and self._scene.is_loaded

    @property
    def is_of_file(self) -> bool:
        """True if it was read from a file."""
        return self._file is not None

    @property
    def is_as_read(self) -> bool:
        """True if it is that of a file, and no part was changed."""
        return self._file is not None and [part.state() for part in self.scene_parts] == self._as_read

    def engine(self) -> Scene:
        """Return the scene for the engine; it is loaded once unless its parts change.

        Returns
        -------
        vlscan.Scene
            The scene.

        Raises
        ------
        NotImplementedError
            Parts were added to a packed scene, or to a file with parts that move or are swapped.
        """
        state = [part.state() for part in self.scene_parts]
        if self._scene is not None and state == self._state:
            return self._scene
        if self._file is not None and state == self._as_read:
            scene = self._of_file(self._file)
        else:
            self._check_extensible()
            scene = Scene([part.engine() for part in self.scene_parts], engine_directories())
        self._scene, self._state = scene, state
        return scene

    def _check_extensible(self) -> None:
        """Refuse parts beside a scene whose own parts are not known."""
        if self._file is not None and not self._as_read:
            raise NotImplementedError(f"{self._file} cannot be extended; build the scene of parts, and write it anew by to_binary()")

    def _of_file(self, file: str) -> Scene:
        path = place_of(file, self._folder)
        folders: list[str | Path] = [*engine_directories(), *asset_folders(self._folder)]
        return _PackedScene(path, folders) if self._is_packed and not path.endswith(_PACKED) else Scene(path, folders)

    def _identity(self) -> object:
        return self._file

    def __copy__(self) -> Self:
        return self.__deepcopy__()

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Self:
        # The loaded scene is shared until a part changes.
        twin = self.twin()
        twin.scene_parts = tuple(copy(part) for part in self.scene_parts)
        return twin

    def __repr__(self) -> str:
        return f"<StaticScene {self._file or f'{len(self.scene_parts)} parts'}>"


_PACKED = ".vlscene"


class _PackedScene(Scene):
    """A packed scene by a name with an extension by which the engine does not know it.

    Parameters
    ----------
    path : str
        The file.
    assets : iterable of str or path-like
        Folders in which files are searched.
    """

    def __init__(self, path: str, assets: Iterable[str | os.PathLike[str]] = ()) -> None:
        link = Path(kept_folder(self, path)) / f"scene{_PACKED}"
        self._path = os.path.abspath(path)
        try:
            link.symlink_to(self._path)
        except OSError:
            # Windows allows links to some users only.
            shutil.copy(path, link)
        super().__init__(link, assets)

    def __reduce__(self) -> tuple[Any, ...]:
        return _PackedScene, (self._path, self._assets)


__all__ = ["BoundingBox", "Material", "MaterialDict", "ScenePart", "StaticScene"]
