#!/bin/sh
# A flight along a row of mesh tiles: with the scene in memory, and with the tiles loaded and dropped as the flight goes on.
# From their files, and packed. Says how long each run took and how much memory, and whether the points are the same.
#
#   benches/tiles.sh [FOLDER]        default: a folder under $TMPDIR, removed at the end
#
# Environment: VLSCAN (the program; default: built with `cargo build --release`), TILES (60), CELLS (256: cells of a tile along
# one side, of 1 m and two triangles), MEMORY (200M), PACK_MEMORY (200M), SPEED (20 m/s), PULSES (200000 a second), THREADS (0: all).
set -eu

here=$(cd "$(dirname "$0")/.." && pwd)
. "$here/benches/program.sh"
use_folder "$@"
tiles=${TILES:-60} cells=${CELLS:-256}

. "$here/benches/measured.sh"

if [ ! -e "$folder/flight.toml" ]; then
    mkdir -p "$folder/tiles"
    printf 'newmtl ground\nhelios_reflectance 0.3\nhelios_classification 2\n' > "$folder/tiles/ground.mtl"
    awk -v tiles="$tiles" -v n="$cells" -v folder="$folder" 'BEGIN {
        for (t = 0; t < tiles; t++) {
            file = sprintf("%s/tiles/tile_%05d.obj", folder, t)
            print "mtllib ground.mtl\nusemtl ground" > file
            for (j = 0; j <= n; j++) for (i = 0; i <= n; i++) { x = t * n + i
                printf "v %d %d %.3f\n", x, j - n / 2, 9 * sin(x / 37) * cos(j / 29) + sin(x * 1.7) * cos(j * 2.3) / 4 > file }
            for (j = 0; j < n; j++) for (i = 0; i < n; i++) { a = j * (n + 1) + i + 1
                print "f", a, a + 1, a + n + 2, a + n + 1 > file }
            close(file)
        }
    }'
    cat > "$folder/scene.xml" << END
<document paths="beside"><scene id="row"><part><filter type="objloader">
<param type="string" key="efilepath" value="tiles/tile_.*\\.obj"/></filter></part></scene></document>
END
    cat > "$folder/flight.toml" << END
scene = "scene.xml"
platform = { catalogue = "data/platforms.xml#copter_linearpath" }
scanner = { catalogue = "data/scanners_als.xml#riegl_vux-1uav" }
settings = { pulse_freq_hz = ${PULSES:-200000}, scan_freq_hz = 50, scan_angle_deg = 35 }
leg = [
    { position_m = [$cells, 0, 100], speed_m_per_s = ${SPEED:-20} },
    { position_m = [$((cells * (tiles - 1))), 0, 100], active = false },
]
END
fi
cd "$folder"
fly() {
    for memory in all ${MEMORY:-200M}; do
        echo "$1, $memory:"
        option=""
        [ "$memory" = all ] || option="--scene-memory $memory"
        # shellcheck disable=SC2086
        measured "$VLSCAN" run flight.toml -v -j "${THREADS:-0}" --scene "$1" $option -o points.las --force
        [ -e expected.las ] || mv points.las expected.las
        [ ! -e points.las ] || cmp expected.las points.las
    done
}
rm -f expected.las
fly scene.xml
echo "packing:"
measured "$VLSCAN" scene pack scene.xml --scene-memory "${PACK_MEMORY:-200M}" -o scene.vlscene
fly scene.vlscene
