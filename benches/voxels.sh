#!/bin/sh
# A hundred million voxels of foliage, and with CLOUD=yes as many cells of a point cloud: makes them, flies over them, and says how
# long that took and how much memory.
#
#   benches/voxels.sh [FOLDER]        default: a folder under $TMPDIR, removed at the end
#
# The voxels lie in a grid of which SHARE percent (30) are occupied, with densities of two digits. Environment: VLSCAN (the program;
# default: built with `cargo build --release`), VOXELS (100000000), SHARE, MODE (transmittive), PULSES (1000000), THREADS (2), CLOUD,
# PYTHON (python3). Needs awk, and GNU time or Python for the peak memory; the cloud, a LAS file of 2 GB, needs Python with numpy.
set -eu

here=$(cd "$(dirname "$0")/.." && pwd)
. "$here/benches/program.sh"
use_folder "$@"

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

[ -n "${CLOUD:-}" ] || exit 0
if [ ! -e "$folder/cloud.las" ]; then
    echo "making a cloud of ${VOXELS:-100000000} points:"
    "${PYTHON:-python3}" - "$folder/cloud.las" "${VOXELS:-100000000}" "${SHARE:-30}" << 'PYTHON'
import struct, sys
import numpy as np
path, wanted, share, high = sys.argv[1], int(sys.argv[2]), float(sys.argv[3]) / 100, 100
side = int((wanted / (high * share)) ** 0.5) + 1
rng = np.random.default_rng(1)
record = np.dtype([("xyz", "<i4", 3), ("intensity", "<u2"), ("returns", "u1"), ("class", "u1"), ("rest", "V4")])
made = 0
with open(path, "wb") as file:
    file.write(bytes(227))
    # A point in the middle of each occupied cell of 0.25 m, at most a hundred above each other.
    for i in range(side):
        j, k = np.nonzero(rng.random((side, high)) < share)
        j, k = j[: wanted - made], k[: wanted - made]
        points = np.zeros(len(j), record)
        points["xyz"] = np.stack([np.full(len(j), i), j, k], axis=1) * 250 + 125
        points["returns"], points["class"] = 9, 5
        points.tofile(file)
        made += len(j)
    file.seek(0)
    file.write(struct.pack(
        "<4sHH16sBB32s32sHHHIIBHI5I3d3d6d", b"LASF", 0, 0, bytes(16), 1, 2, b"", b"", 1, 2026, 227, 227, 0, 0, 20, made,
        made, 0, 0, 0, 0, 0.001, 0.001, 0.001, 0, 0, 0, side / 4, 0, side / 4, 0, high / 4, 0,
    ))
PYTHON
fi
cat > "$folder/cloud.xml" << END
<document paths="beside">
  <scene id="cloud">
    <part id="1">
      <filter type="xyzloader">
        <param type="string" key="filepath" value="cloud.las"/>
        <param type="double" key="voxelSize" value="0.25"/>
      </filter>
    </part>
  </scene>
</document>
END
echo "scanning the cloud:"
measured "$VLSCAN" run "$folder/flight.toml" --scene "$folder/cloud.xml" -v -j "${THREADS:-2}" -o "$folder/cloud_points.las" --force
