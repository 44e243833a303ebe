#!/bin/sh
# Time and memory of the commands that read clouds, beside other programs that do the same.
#
#   benches/clouds.sh [FOLDER]        default: a folder under $TMPDIR, removed at the end
#
# Writes one flight as LAZ, COPC, LAS, Parquet and text unless the files exist, and describes each of them
# with vlscan and with another program in turn: laspy with lazrs for LAS, LAZ and COPC, pyarrow for Parquet,
# polars for text; programs that are not installed are skipped. Then makes rasters and pictures of the LAZ
# file, which have the ratio to `info`, which only reads it, and compares it and the text with themselves;
# CloudCompare (Debian: cloudcompare) measures the distances between the points of the text, one way. Prints
# median times, processor times and peaks of memory, and the median ratio of neighbouring runs; below 1,
# vlscan is faster. Times include the start of the interpreter.
#
# Environment: VLSCAN (the program; default: built with `cargo build --release`), PULSES (20M), ROUNDS (5),
# FORMATS (laz copc las parquet xyz), COMMANDS (1; 0 leaves out the second table), PYTHON (python3; with the
# packages to compare with).
set -eu

here=$(cd "$(dirname "$0")/.." && pwd)
. "$here/benches/program.sh"
use_folder "$@"
formats=${FORMATS:-laz copc las parquet xyz}

for format in $formats; do
    if [ "$format" = copc ]; then file="$folder/cloud.copc.laz"; else file="$folder/cloud.$format"; fi
    if [ ! -e "$file" ]; then
        if [ ! -e "$folder/forest/survey.xml" ]; then
            "$VLSCAN" scene make forest -o "$folder/forest" -n 100k --pulses "${PULSES:-20M}" -q
        fi
        "$VLSCAN" run "$folder/forest/survey.xml" -o "$file" -q
    fi
done

# shellcheck disable=SC2086
"${PYTHON:-python3}" - "$VLSCAN" "$folder" "${ROUNDS:-5}" "${COMMANDS:-1}" $formats << 'PYTHON'
import importlib.util, os, shutil, statistics, subprocess, sys, time

program, folder, rounds, commands, *formats = sys.argv[1:]
# CloudCompare needs no display.
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

LASPY = """
import sys, laspy, numpy as np
cloud = laspy.read(sys.argv[1], laz_backend=laspy.LazBackend.LazrsParallel)
for axis in (cloud.x, cloud.y, cloud.z, cloud.intensity, cloud.gps_time, cloud.scan_angle):
    print(np.min(axis), np.max(axis))
for counted in (cloud.classification, cloud.return_number, cloud.number_of_returns, cloud.point_source_id):
    print(np.bincount(np.asarray(counted)).nonzero())
"""
PYARROW = """
import sys, pyarrow.parquet as parquet, pyarrow.compute as compute, pyarrow.types as types
for column in parquet.read_table(sys.argv[1]).columns:
    if types.is_integer(column.type) or types.is_floating(column.type):
        print(compute.min_max(column))
    if types.is_dictionary(column.type) or types.is_integer(column.type) and column.type.bit_width <= 16:
        print(compute.value_counts(column))
"""
POLARS = """
import sys, polars
cloud = polars.scan_csv(sys.argv[1], separator=" ", has_header=False)
print(cloud.select(polars.all().min().name.suffix("_min"), polars.all().max().name.suffix("_max")).collect())
"""
OTHERS = {
    "laz": ("laspy", ["laspy", "lazrs"], LASPY),
    "copc": ("laspy", ["laspy", "lazrs"], LASPY),
    "las": ("laspy", ["laspy"], LASPY),
    "parquet": ("pyarrow", ["pyarrow"], PYARROW),
    "xyz": ("polars", ["polars"], POLARS),
}


def run(command):
    """Time and processor time of a command, s, and its peak of memory, MB; None if it fails."""
    start = time.monotonic()
    with open(os.path.join(folder, "messages"), "w+") as messages:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=messages)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            messages.seek(0)
            print(f"{command[0]} fails: {messages.read().strip()[-300:]}", file=sys.stderr)
            return None
    return time.monotonic() - start, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3


def compared(name, own, other, unit=""):
    """Runs two commands in turn, the second of which may be None, and prints a line."""
    runs = []
    # The first round only fills the page cache.
    for round in range(int(rounds) + 1):
        pair = (run(own), run(other[1]) if other else None)
        if round > 0 and pair[0] is not None:
            runs.append(pair)
    line = f"{name:<18} {unit:>7}"
    median = lambda values: statistics.median(list(values))
    if runs:
        line += "".join(f" {median(pair[0][i] for pair in runs):>8.{1 if i < 2 else 0}f}" for i in range(3))
    both = [pair for pair in runs if pair[1] is not None]
    if both:
        line += f" {other[0]:>14}"
        line += "".join(f" {median(pair[1][i] for pair in both):>8.{1 if i < 2 else 0}f}" for i in range(3))
        line += f" {median(pair[0][0] / pair[1][0] for pair in both):>6.2f}"
    print(line, flush=True)


columns = f"{'s':>8} {'cpu, s':>8} {'MB':>8} {'other':>14} {'s':>8} {'cpu, s':>8} {'MB':>8} {'ratio':>6}"
print(f"{'info':<18} {'file MB':>7} {columns}")
for form in formats:
    path = os.path.join(folder, "cloud.copc.laz" if form == "copc" else f"cloud.{form}")
    name, modules, code = OTHERS.get(form, ("", [""], ""))
    is_there = all(module and importlib.util.find_spec(module) for module in modules)
    if is_there and form == "las":
        code = code.replace(", laz_backend=laspy.LazBackend.LazrsParallel", "")
    other = (name, [sys.executable, "-c", code, path]) if is_there else None
    compared(form, [program, "info", path], other, f"{os.path.getsize(path) / 1e6:.0f}")

cloud, out = os.path.join(folder, "cloud.laz"), lambda name: os.path.join(folder, name)
if commands != "0" and os.path.exists(cloud):
    print(f"{'command':<18} {'':>7} {columns}")
    reading = ("info", [program, "info", cloud])
    dsm, dtm = ["--dsm", out("dsm.tif")], ["--dtm", out("dtm.tif")]
    compared("raster --dsm", [program, "raster", cloud, *dsm, "--force"], reading)
    compared("raster --dtm --dsm", [program, "raster", cloud, *dsm, *dtm, "--force"], reading)
    compared("preview", [program, "preview", cloud, "-o", out("cloud.png"), "--force"], reading)
    compared("compare", [program, "compare", cloud, cloud], ("twice info", [*reading[1], cloud]))
    # Debian's CloudCompare reads no LAS.
    peer, text = shutil.which("CloudCompare"), out("cloud.xyz")
    if peer and os.path.exists(text):
        quiet = ["-SILENT", "-NO_TIMESTAMP", "-AUTO_SAVE", "OFF"]
        distances = [peer, *quiet, "-O", text, "-O", text, "-C2C_DIST"]
        compared("compare text", [program, "compare", text, text], ("CloudCompare", distances))
PYTHON
