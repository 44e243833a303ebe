"""Reads recordings for the scripts of this folder, and ends a script with a message where a recording was not made for it."""

import json
import subprocess
import sys
import tomllib
import traceback
from pathlib import Path


def run_script(main):
    """Runs a script. What a recording lacks shows in many ways: each ends with a message and status 1, not with a traceback."""
    try:
        main()
    except subprocess.CalledProcessError as error:
        output = error.stderr or b""
        text = output if isinstance(output, str) else output.decode()
        command = " ".join(map(str, error.cmd[:3]))
        sys.exit(f"{text}`{command}` ended with status {error.returncode}: this recording cannot be compared")
    except Exception as error:
        places = [frame for frame in traceback.extract_tb(error.__traceback__) if Path(frame.filename).parent == Path(__file__).parent]
        place = f"{Path(places[-1].filename).name}, line {places[-1].lineno}"
        sys.exit(f"this recording cannot be compared: {type(error).__name__}: {error} ({place})")


def read_table(path, columns):
    """The Parquet table of a path, which has these columns."""
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.read_table(path)
    except (OSError, pyarrow.ArrowException) as error:
        sys.exit(f"{path} cannot be read as Parquet: {str(error).splitlines()[0]}")
    missing = [name for name in columns if name not in table.column_names]
    if missing:
        sys.exit(f"{path} has no column {', '.join(missing)}: it is no recording for this script")
    return table


def read_cloud(path):
    """The LAS or LAZ file of a path, which has points at different GPS times."""
    import laspy
    import numpy as np

    try:
        las = laspy.read(path)
    except (OSError, laspy.errors.LaspyException) as error:
        sys.exit(f"{path} cannot be read as LAS or LAZ: {error}")
    if "gps_time" not in las.point_format.dimension_names:
        sys.exit(f"{path} has no GPS times, which tell its pulses")
    if len(np.unique(las.gps_time)) < 2:
        sys.exit(f"{path}: points {len(las.points)}, different GPS times {len(np.unique(las.gps_time))}: pulses cannot be told")
    return las


def check_pulses(path, las, pulse):
    """Ends the script if many of these pulses, which are times of a flight line, have several first returns."""
    import numpy as np

    firsts = np.bincount(pulse, np.asarray(las.return_number) == 1)
    if (firsts > 1).mean() > 0.01:
        sys.exit(
            f"{path}: {(firsts > 1).mean():.0%} of its GPS times have several first returns: the times are too coarse to tell pulses, "
            "and this comparison needs the pulses"
        )


def toml_of(value):
    """A number, a text, or a table of them as TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml_of(inner)}" for key, inner in value.items()) + " }"
    return json.dumps(value)


def with_receiver(flight, scene):
    """Gives the fitted scanner of a pipeline file the receiver of a reconstructed scene: a flight does not show its own."""
    keys = ("beam_divergence_rad", "pulse_shape", "pulse_energy_uj", "max_range")
    receiver = tomllib.loads((scene / "scene.toml").read_text())["scanner"]
    if "pulse_shape" in receiver:
        receiver["pulse_shape"] = str((scene / receiver["pulse_shape"]).absolute())
    # A target at the rate of the flight.
    receiver["max_range"].pop("pulse_freq_hz", None)
    own = [f"{key} = {toml_of(receiver[key])}" for key in keys if key in receiver]
    lines = [line for line in flight.read_text().splitlines() if not line.startswith("max_range ")]
    at = lines.index("[scanner]") + 1
    flight.write_text("\n".join([*lines[:at], *own, *lines[at:]]) + "\n")


def fitted_scanner(path, optics, channels=0):
    """The scanner of a fitted pipeline file, which has these optics and number of channels."""
    scanner = tomllib.loads(Path(path).read_text())["scanner"]
    shape = "elliptic" if "scan_angle_along_max_deg" in scanner else scanner["optics"]
    found = shape, len(scanner.get("channel", []))
    if found != (optics, channels):
        sys.exit(f"fitted: {found[0]} optics, channels {found[1] or 1}; this script compares {optics} optics, channels {channels or 1}")
    return scanner
