#!/bin/sh
# A flight over a country: 100 km over 10^9 heights in 100 files, with the terrain in memory and within limits of memory, from its files
# and packed as tiles. Says how long each run took and how much memory, and whether the points are the same.
#
#   benches/country.sh [FOLDER]        default: a folder under $TMPDIR, removed at the end
#
# Needs Python with numpy and rasterio to make the files (0.5 GB; the packed terrain has 2 GB, points have 2.5 GB for each of two
# runs). Environment: VLSCAN (the program; default: built with `cargo build --release`), PYTHON (python3), TILES (10: tiles along one
# side), CELLS (3163: pixels of a tile along one side, 1 m), BLOCK (512: pixels of a block along one side; 0: strips), LENGTH (100 km),
# MEMORY ("500M 1G"), PACK_MEMORY (1G), SPEED (200 m/s), PULSES (100000 a second), THREADS (0: all).
set -eu

here=$(cd "$(dirname "$0")/.." && pwd)
. "$here/benches/program.sh"
use_folder "$@"
export TILES="${TILES:-10}" CELLS="${CELLS:-3163}" BLOCK="${BLOCK:-512}"

. "$here/benches/measured.sh"

if [ ! -e "$folder/flight.toml" ]; then
    mkdir -p "$folder/dem"
    "${PYTHON:-python3}" - "$folder" << 'PYTHON'
import os, sys
import numpy as np
import rasterio
tiles, cells, block = (int(os.environ[name]) for name in ("TILES", "CELLS", "BLOCK"))
layout = {"tiled": True, "blockxsize": block, "blockysize": block} if block else {}
noise = np.random.default_rng(1).normal(0, 0.15, (cells, cells))
for row in range(tiles):
    y = (row * cells + np.arange(cells))[:, None]
    for column in range(tiles):
        x = (column * cells + np.arange(cells))[None, :]
        z = 60 * np.sin(x / 900) * np.cos(y / 1300) + 12 * np.sin(x / 71) * np.sin(y / 93) + noise
        # Heights in decimetres, as whole numbers.
        with rasterio.open(
            f"{sys.argv[1]}/dem/{row:02}_{column:02}.tif", "w", driver="GTiff", width=cells, height=cells, count=1, dtype="int16",
            crs="EPSG:25832", transform=rasterio.Affine(1, 0, 400000 + column * cells, 0, -1, 5700000 - row * cells),
            compress="DEFLATE", predictor=2, **layout,
        ) as file:
            file.write((10 * z).round().astype("int16"), 1)
            file.scales, file.offsets = [0.1], [0.0]
side = tiles * cells
lines = -(-1000 * int(os.environ.get("LENGTH", "100")) // (side - 2000))
legs = []
for line in range(lines):
    y = 5700000 - side * (line + 0.5) / lines
    ends = [400000 + 1000, 400000 + side - 1000][:: 1 if line % 2 == 0 else -1]
    speed = float(os.environ.get("SPEED", "200"))
    legs += [f"{{ position_m = [{ends[0]}, {y:.1f}, 700], speed_m_per_s = {speed} }}"]
    legs += [f"{{ position_m = [{ends[1]}, {y:.1f}, 700], active = false }}"]
with open(f"{sys.argv[1]}/flight.toml", "w") as file:
    file.write(f"""scene = "dem"
platform = {{ catalogue = "data/platforms.xml#sr22" }}
scanner = {{ catalogue = "data/scanners_als.xml#riegl_lms-q780" }}
settings = {{ pulse_freq_hz = {os.environ.get("PULSES", "100000")}, scan_freq_hz = 80, scan_angle_deg = 30 }}
leg = [{", ".join(legs)}]
""")
PYTHON
fi
cd "$folder"
fly() {
    for memory in all ${MEMORY:-500M 1G}; do
        echo "$1, $memory:"
        option=""
        [ "$memory" = all ] || option="--scene-memory $memory"
        # shellcheck disable=SC2086
        measured "$VLSCAN" run flight.toml -v -j "${THREADS:-0}" --scene "$1" $option -o points.las --force
        [ -e expected.las ] || mv points.las expected.las
        [ ! -e points.las ] || cmp expected.las points.las
        rm -f points.las
    done
}
rm -f expected.las
fly dem
echo "packing:"
measured "$VLSCAN" scene pack dem --scene-memory "${PACK_MEMORY:-1G}" -o dem.vlscene
fly dem.vlscene
