#!/bin/sh
# What physics costs, as ratios of processor time per pulse: a scan pattern of 800 000 rows from a file beside
# the polygon mirror that it repeats, and a room with a mirror and a window beside the same room with opaque
# surfaces.
#
#   benches/physics.sh [FOLDER]        default: a folder under $TMPDIR, removed at the end
#
# Runs alternate; prints the median of the ratios of neighbouring runs. Environment: VLSCAN (the program;
# default: built with `cargo build --release`), ROUNDS (5), PYTHON (python3, with numpy).
set -eu

here=$(cd "$(dirname "$0")/.." && pwd)
. "$here/benches/program.sh"
use_folder "$@"

[ -e "$folder/forest/survey.xml" ] || "$VLSCAN" scene make forest -o "$folder/forest" -n 1M --pulses 4M -q

"${PYTHON:-python3}" - "$VLSCAN" "$folder" "${ROUNDS:-5}" << 'PYTHON'
import json, os, statistics, subprocess, sys

import numpy

program, folder, rounds = sys.argv[1:]
os.chdir(folder)

# A pattern with the angles of the polygon mirror: 800 000 pulses, and again from the start.
SWEEPS, ANGLE, RATE, ROWS = 1007.0, 9.34, 1_720_000, 800_000
phase = numpy.arange(ROWS) * SWEEPS / RATE % 1.0
numpy.save("pattern.npy", numpy.column_stack([numpy.zeros(ROWS), ANGLE * (2 * phase - 1)]))

FLIGHT = """scene = "forest/scene.xml#forest"
seed = 1
[platform]
catalogue = "forest/platforms.xml#plane"
[scanner]
catalogue = "forest/scanners.xml#als_polygon"
{keys}
[[leg]]
position_m = [15, -70, 300]
speed_m_per_s = 60
[[leg]]
position_m = [15, 70, 300]
"""
ROOM = """newmtl wall
helios_reflectance 0.5
newmtl mirror
helios_reflectance 0.5
{mirror}
newmtl window
helios_reflectance 0.5
{window}
"""
SCAN = """scene = "{name}.obj"
seed = 1
[scanner]
catalogue = "data/scanners_tls.xml#vlp16"
[settings]
head_rate_deg_per_s = 3600
head_stop_deg = 72000
[[leg]]
position_m = [0, 0, 1.5]
"""


def quad(*corners):
    """A rectangle in the words of OBJ."""
    return "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "f -4 -3 -2 -1\n"


def wall(x0, y0, x1, y1, low=0, high=3):
    return quad((x0, y0, low), (x1, y1, low), (x1, y1, high), (x0, y0, high))


def room(name, mirror, window):
    """A room of 6 by 8 m with a mirror of 2 by 2 m and a window of 2 by 3 m."""
    floor = quad((-3, -4, 0), (3, -4, 0), (3, 4, 0), (-3, 4, 0))
    walls = [wall(-3, -4, 3, -4), wall(-3, 4, 3, 4), wall(-3, -4, -3, 4), wall(3, -4, 3, -1), wall(3, 1, 3, 4), wall(10, -8, 10, 8)]
    with open(f"{name}.obj", "w") as file:
        file.write(f"mtllib {name}.mtl\nusemtl wall\n{floor}{''.join(walls)}")
        file.write(f"usemtl mirror\n{wall(-1, 3.99, 1, 3.99, 0.5, 2.5)}usemtl window\n{wall(3, -1, 3, 1)}")
    with open(f"{name}.mtl", "w") as file:
        file.write(ROOM.format(mirror=mirror, window=window))


room("opaque", "", "")
room("optical", "vlscan_mirror 0.9", "vlscan_pane_index 1.52\nvlscan_pane_sheets 2")
polygon = f'[settings]\npulse_freq_hz = 3693500\nscan_angle_deg = {ANGLE}\nscan_freq_hz = {SWEEPS}'
pattern = f'optics = "pattern"\npattern = "pattern.npy"\npulse_freqs_hz = [{RATE}]\n[settings]\npulse_freq_hz = {RATE}'
texts = {
    "polygon": FLIGHT.format(keys=polygon),
    "pattern": FLIGHT.format(keys=pattern),
    "opaque": SCAN.format(name="opaque"),
    "optical": SCAN.format(name="optical"),
}
for name, text in texts.items():
    with open(f"{name}.toml", "w") as file:
        file.write(text)


def cost(name):
    """Processor time of a run per pulse, µs."""
    command = [program, "run", f"{name}.toml", "-o", os.devnull, "--format", "las", "--force", "--message-format", "json"]
    with open("messages", "w+") as messages:
        process = subprocess.Popen(command, stderr=messages)
        _, status, used = os.wait4(process.pid, 0)
        messages.seek(0)
        result = json.loads(messages.readlines()[-1])
    if status:
        sys.exit(f"{name}.toml fails: {result}")
    return 1e6 * (used.ru_utime + used.ru_stime) / result["pulses"]


for plain, other in (("polygon", "pattern"), ("opaque", "optical")):
    pairs = [(cost(plain), cost(other)) for _ in range(int(rounds))]
    plain_us, other_us = (statistics.median(values) for values in zip(*pairs))
    rate = statistics.median(first / second for first, second in pairs)
    print(f"{plain} {plain_us:.2f} µs, {other} {other_us:.2f} µs per pulse: {rate:.2f} of the pulses per second")
PYTHON
