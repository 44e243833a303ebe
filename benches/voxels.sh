#!/bin/sh
# A hundred million voxels of foliage: makes them, flies over them, and says how long that took and how much memory.
#
#   benches/voxels.sh [FOLDER]        default: a folder under $TMPDIR, removed at the end
#
# The voxels lie in a grid of which SHARE percent (30) are occupied, with densities of two digits. Environment: VLSCAN (the program;
# default: built with `cargo build --release`), VOXELS (100000000), SHARE, MODE (transmittive), PULSES (1000000), THREADS (2). Needs awk,
# and GNU time or Python for the peak memory.
set -eu

here=$(cd "$(dirname "$0")/.." && pwd)
if [ -z "${VLSCAN:-}" ]; then
    (cd "$here" && cargo build --release --quiet)
    VLSCAN="${CARGO_TARGET_DIR:-$here/target}/release/vlscan"
fi
if [ $# -gt 0 ]; then
    folder=$1
    mkdir -p "$folder"
else
    folder=$(mktemp -d)
    trap 'rm -rf "$folder"' EXIT
fi

. "$here/benches/measured.sh"

if [ ! -e "$folder/leaves.vox" ]; then
    echo "making ${VOXELS:-100000000} voxels:"
    # Columns of 100 cells of 0.25 m; gaps along them of random length.
    awk -v wanted="${VOXELS:-100000000}" -v share="${SHARE:-30}" 'BEGIN {
        high = 100
        side = int(sqrt(wanted / (high * share / 100))) + 1
        gap = 2 * (100 / share - 1) + 1
        srand(1)
        printf "VOXEL SPACE\n#min_corner: 0 0 0\n#max_corner: %g %g %g\n", side / 4, side / 4, high / 4
        printf "#split: %d %d %d\n#res: 0.25 #max_pad: 5\ni j k PadBVTotal\n", side, side, high
        for (i = 0; i < side; i++) for (j = 0; j < side; j++)
            for (k = int(gap * rand()); k < high; k += 1 + int(gap * rand())) {
                print i, j, k, int(400 * rand()) / 100
                if (++made == wanted) exit
            }
    }' > "$folder/leaves.vox"
fi

side=$(sed -n 's/^#max_corner: \([0-9.]*\) .*/\1/p' "$folder/leaves.vox" | head -1)
cat > "$folder/scene.xml" << END
<document>
  <scene id="leaves">
    <part id="1">
      <filter type="detailedvoxels">
        <param type="string" key="filepath" value="$folder/leaves.vox"/>
        <param type="string" key="intersectionMode" value="${MODE:-transmittive}"/>
      </filter>
    </part>
  </scene>
</document>
END
cat > "$folder/flight.toml" << END
scene = "scene.xml#leaves"
seed = 1

[platform]
catalogue = "data/platforms.xml#copter_linearpath"

[scanner]
catalogue = "data/scanners_als.xml#riegl_vux-1uav"

[settings]
pulse_freq_hz = 100000
scan_freq_hz = 50
scan_angle_deg = 40

[[leg]]
position_m = [0, $(awk "BEGIN { print $side / 2 }"), 100]
speed_m_per_s = $(awk "BEGIN { print $side / (${PULSES:-1000000} / 100000) }")

[[leg]]
position_m = [$side, $(awk "BEGIN { print $side / 2 }"), 100]
active = false
END
echo "scanning:"
measured "$VLSCAN" run "$folder/flight.toml" -v -j "${THREADS:-2}" -o "$folder/points.las" --force
