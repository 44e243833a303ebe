"""Files of the package: the catalogue and the spectra, which are in the program, and on disk when they are needed."""

from __future__ import annotations

import atexit
import tempfile
from functools import cache
from pathlib import Path

from vlscan import Spectrum, catalogue


def package_folders() -> list[Path]:
    """Return the three folders of the package in which files are searched."""
    root = _package_folder()
    return [root, root / "assets", root / "data"]


@cache
def _package_folder() -> Path:
    """Write the catalogue and the spectra, which are in the program, to a folder that lasts as long as the process."""
    folder = tempfile.TemporaryDirectory(prefix="vlscan-")
    atexit.register(folder.cleanup)
    root = Path(folder.name)
    (root / "assets/spectra").mkdir(parents=True)
    spectra = {f"assets/spectra/{name}.txt": _spectrum_text(name, values) for name, values in catalogue.spectra().items()}
    for name, text in {**catalogue.files(), **spectra}.items():
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    return root


# Lines before the table of a file of a spectrum.
_SPECTRUM_HEADER = 26


def _spectrum_text(name: str, spectrum: Spectrum) -> str:
    """Return the text of the file of a spectrum: a header, then wavelengths (µm) and reflectances (per cent)."""
    header = [
        f"Name: {name}",
        "Origin: built-in spectrum of vlscan",
        "X Units: Wavelength (micrometers)",
        "Y Units: Reflectance (percentage)",
    ]
    header += [""] * (_SPECTRUM_HEADER - len(header))
    values = zip(spectrum.wavelengths_nm, spectrum.reflectances, strict=True)
    return "\n".join([*header, *(f"{wavelength / 1000:.4f}\t{100 * share:.4f}" for wavelength, share in values), ""])


def on_disk(path: Path) -> Path:
    """Return a file of :func:`vlscan_helios.v3.utils.existing_file` as one on disk: those of the catalogue are in the program."""
    return path if path.exists() else _package_folder() / path


def shipped_spectra(path: Path) -> Path | None:
    """Return the spectra, or one of them, as on disk; they are in the program."""
    is_spectrum = "spectra" in path.parts
    return next((folder / path for folder in package_folders() if (folder / path).exists()), None) if is_spectrum else None


def shipped_files() -> set[str]:
    """Return the names of the files of the catalogue, which are in the program and not on disk."""
    references = [catalogue.scanner_reference(name) for name in catalogue.scanners()]
    references += [catalogue.platform_reference(name) for name in catalogue.platforms()]
    return {reference.split("#")[0] for reference in references}
