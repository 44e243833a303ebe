#!/bin/sh
# An hour of poses, 200 a second, through a named pipe: does memory stay flat? And how long after the last pose of a writer
# that falls silent do its points arrive?
#
#   benches/live.sh
#
# Environment: VLSCAN (the program; default: built with `cargo build --release`), SECONDS_FLOWN (3600), RATE (200 poses per
# second), PULSES (5000 per second), LAYOUT (text or sbet), THREADS (2). Needs python3, mkfifo and /proc.
set -eu

here=$(cd "$(dirname "$0")/.." && pwd)
. "$here/benches/program.sh"
use_folder
mkfifo "$folder/poses"
cat > "$folder/live.toml" << TOML
scene = "$here/fixtures/terrain/scene.xml#terrain"
[trajectory]
path = "$folder/poses"
[platform]
catalogue = "data/platforms.xml#sr22"
[scanner]
catalogue = "data/scanners_als.xml#riegl_lms-q780"
[settings]
pulse_freq_hz = ${PULSES:-5000}
scan_freq_hz = 50
scan_angle_deg = 30
TOML

python3 - "$VLSCAN" "$folder" "${SECONDS_FLOWN:-3600}" "${RATE:-200}" "${LAYOUT:-text}" "${THREADS:-2}" << 'PYTHON'
import math, re, struct, subprocess, sys, threading, time

program, folder, seconds, rate, layout, threads = sys.argv[1:]
seconds, rate = float(seconds), float(rate)

def pose(i):
    """To and fro over the terrain."""
    t, w = i / rate, 2 * math.pi / 40
    x, y, z = 60 * math.sin(0.5 * w * t), 100 * math.sin(w * t), 200 + 1.5 * math.sin(0.9 * t)
    heading = math.atan2(30 * w * math.cos(0.5 * w * t), 100 * w * math.cos(w * t))
    roll, pitch = math.radians(2 * math.sin(2.3 * t)), math.radians(1.5)
    if layout == "sbet":
        # Latitude and longitude that are good enough to load the reader; the terrain lies elsewhere.
        fields = (t + 1, 0.8 + y / 6.4e6, 0.157 + x / 4.4e6, z, 0, 0, 0, roll, pitch, heading, 0, 0, 0, 0, 0, 0, 0)
        return struct.pack("<17d", *fields)
    angles = [math.degrees(a) for a in (roll, pitch, heading)]
    return ("%.4f,%.4f,%.4f,%.4f,%.5f,%.5f,%.5f\n" % (t, x, y, z, *angles)).encode()

def start(*options):
    command = [program, "run", folder + "/live.toml", "-j", threads, "--format", "xyz", "-o", "-", *options]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

def resident(run):
    try:
        return int(re.search(r"VmRSS:\s+(\d+)", open(f"/proc/{run.pid}/status").read())[1]) / 1024
    except (OSError, TypeError):
        return None

poses = int(seconds * rate)
run = start()
samples, written = [], 0
sink = threading.Thread(target=lambda: [None for _ in iter(lambda: run.stdout.read(1 << 20), b"")])
sink.start()
began = time.monotonic()
with open(folder + "/poses", "wb") as pipe:
    for i in range(poses + 1):
        pipe.write(pose(i))
        if i % 2000 == 0:
            pipe.flush()
            if (mb := resident(run)) is not None:
                samples.append((i, mb))
run.wait()
sink.join()
said = run.stderr.read().decode()
if run.returncode != 0:
    sys.exit(f"status {run.returncode}\n{said}")
print(f"{poses} poses as {layout} in {time.monotonic() - began:.0f} s; {said.strip().splitlines()[-1]}")
print(f"{'tenth':>5} {'resident MB':>12}")
for tenth in range(10):
    part = [mb for i, mb in samples if poses * tenth / 10 <= i < poses * (tenth + 1) / 10]
    print(f"{tenth + 1:>5} {max(part, default=math.nan):>12.1f}")

if layout == "text":
    waits, end = [], None
    # The first run ends with its poses and tells the time of the last point.
    for round in range(6):
        run = start("-q")
        last, arrived = [0.0], threading.Event()
        def read():
            for line in run.stdout:
                last[0] = float(line.rsplit(b" ", 1)[1])
                if end is not None and last[0] >= end:
                    arrived.set()
        reader = threading.Thread(target=read)
        reader.start()
        with open(folder + "/poses", "wb", buffering=0) as pipe:
            for i in range(int(2.0 * rate) + 1):
                time.sleep(1 / rate)
                pipe.write(pose(i))
            silent = time.monotonic()
            if end is not None:
                arrived.wait(60)
                waits.append(time.monotonic() - silent)
        run.wait()
        reader.join()
        end = end or last[0]
    waits.sort()
    print(f"silent writer: the last points came {waits[0]:.2f} to {waits[-1]:.2f} s after the last pose")
PYTHON
