#!/bin/sh
# How long `vlscan info` takes to describe a cloud, beside other programs that compute the same numbers.
#
#   benches/clouds.sh [FOLDER]        default: a folder under $TMPDIR, removed at the end
#
# Writes one flight as LAZ, COPC, LAS, Parquet and text unless the files exist, and describes each of them
# with vlscan and with another program in turn: laspy with lazrs for LAS, LAZ and COPC, pyarrow for Parquet,
# polars for text; programs that are not installed are skipped. Prints the median times and the median ratio
# of neighbouring runs; below 1, vlscan is faster. Times include the start of the interpreter.
#
# Environment: VLSCAN (the program; default: built with `cargo build --release`), PULSES (20M), ROUNDS (5),
# FORMATS (laz copc las parquet xyz), PYTHON (python3; with the packages to compare with).
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
"${PYTHON:-python3}" - "$VLSCAN" "$folder" "${ROUNDS:-5}" $formats << 'PYTHON'
import importlib.util, os, statistics, subprocess, sys, time

program, folder, rounds, *formats = sys.argv[1:]

LASPY = """
import sys, laspy, numpy as np
cloud = laspy.read(sys.argv[1], laz_backend=laspy.LazBackend.LazrsParallel)
for axis in (cloud.x, cloud.y, cloud.z, cloud.intensity, cloud.gps_time, cloud.scan_angle):
    print(np.min(axis), np.max(axis))
for counted in (cloud.classification, cloud.return_number, cloud.number_of_returns, cloud.point_source_id):
    print(np.bincount(np.asarray(counted)).nonzero())
"""
PYARROW = """
import sys, pyarrow.parquet as parquet, pyarrow.compute as compute
for column in parquet.read_table(sys.argv[1], columns=["X", "Y", "Z"]).columns:
    print(compute.min_max(column))
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


def seconds(command):
    """Time of a command; None if it fails."""
    start = time.monotonic()
    run = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if run.returncode != 0:
        print(f"{command[0]} fails: {run.stderr.strip()[-300:]}", file=sys.stderr)
        return None
    return time.monotonic() - start


print(f"{'format':<8} {'MB':>7} {'info, s':>8} {'other':>8} {'s':>7} {'ratio':>6}")
for form in formats:
    path = os.path.join(folder, "cloud.copc.laz" if form == "copc" else f"cloud.{form}")
    name, modules, code = OTHERS.get(form, ("", [""], ""))
    is_there = all(module and importlib.util.find_spec(module) for module in modules)
    if is_there and form == "las":
        code = code.replace(", laz_backend=laspy.LazBackend.LazrsParallel", "")
    own, other = [program, "info", path], [sys.executable, "-c", code, path]
    times = []
    # The first round only fills the page cache.
    for round in range(int(rounds) + 1):
        pair = (seconds(own), seconds(other) if is_there else None)
        if round > 0 and pair[0] is not None:
            times.append(pair)
    line = f"{form:<8} {os.path.getsize(path) / 1e6:>7.0f}"
    if times:
        line += f" {statistics.median(pair[0] for pair in times):>8.2f}"
    both = [pair for pair in times if pair[1] is not None]
    if both:
        line += f" {name:>8} {statistics.median(pair[1] for pair in both):>7.2f}"
        line += f" {statistics.median(pair[0] / pair[1] for pair in both):>6.2f}"
    print(line)
PYTHON
