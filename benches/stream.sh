#!/bin/sh
# A hundred million pulses as LAZ through stdout to /dev/null: does memory stay flat, and is the end as quick as the start?
#
#   benches/stream.sh [SURVEY]       default: a forest of a million triangles, made in a folder under $TMPDIR
#
# Environment: VLSCAN (the program; default: built with `cargo build --release`), PULSES (100M), THREADS (2), FORMAT (laz).
# Prints bytes per second and resident memory for every tenth of what was written, and the ratios of the end to the start.
# Needs python3 and /proc.
set -eu

here=$(cd "$(dirname "$0")/.." && pwd)
. "$here/benches/program.sh"
if [ $# -gt 0 ]; then
    survey=$1
else
    use_folder
    "$VLSCAN" scene make forest -o "$folder" -n 1M --pulses "${PULSES:-100M}" -q
    survey=$folder/survey.xml
fi

python3 - "$VLSCAN" "$survey" "${THREADS:-2}" "${FORMAT:-laz}" << 'PYTHON'
import os, re, subprocess, sys, time

program, survey, threads, form = sys.argv[1:]
command = [program, "run", survey, "-j", threads, "--format", form, "-o", "-"]
run = subprocess.Popen(command, stdout=open("/dev/null", "wb"), stderr=subprocess.PIPE, text=True)
tick = os.sysconf("SC_CLK_TCK")

def sample():
    """Bytes written, time, MB of resident memory, seconds of computing; None when the run is over."""
    try:
        written = int(re.search(r"wchar: (\d+)", open(f"/proc/{run.pid}/io").read())[1])
        resident = int(re.search(r"VmRSS:\s+(\d+)", open(f"/proc/{run.pid}/status").read())[1])
        stat = open(f"/proc/{run.pid}/stat").read().rsplit(")", 1)[1].split()
        return written, time.monotonic(), resident / 1024, (int(stat[11]) + int(stat[12])) / tick
    except (OSError, TypeError):
        return None

samples = []
while run.poll() is None:
    seen = sample()
    if seen and seen[0] > 1_000_000:
        samples.append(seen)
    time.sleep(0.2)
said = run.stderr.read()
if run.returncode != 0 or len(samples) < 40:
    sys.exit(f"status {run.returncode}, {len(samples)} samples: too few to tell\n{said}")

first, last = samples[0], samples[-1]
print(said.strip())
print(f"{'part':>4} {'MB/s':>8} {'MB per CPU s':>13} {'resident MB':>12}")
rates = []
for part in range(10):
    low, high = (first[0] + (last[0] - first[0]) * p // 10 for p in (part, part + 1))
    here = [s for s in samples if low <= s[0] <= high]
    (b0, t0, _, c0), (b1, t1, _, c1) = here[0], here[-1]
    rates.append(((b1 - b0) / (t1 - t0) / 1e6, (b1 - b0) / max(c1 - c0, 1e-9) / 1e6, max(s[2] for s in here)))
    print(f"{part + 1:>4} {rates[-1][0]:>8.1f} {rates[-1][1]:>13.1f} {rates[-1][2]:>12.1f}")
start, end = rates[0], rates[-1]
print(f"last tenth to first: bytes per second {end[0] / start[0]:.3f}, per second of computing {end[1] / start[1]:.3f},"
      f" memory {end[2] / start[2]:.3f}")
PYTHON
