#!/usr/bin/env bash
# Measures the forest fixture and the five surveys that make.sh has made in FOLDER, and prints the tables of
# docs/dev/experiment.md:
#
#     pipelines/paper/compare.sh [FOLDER] [REPETITIONS] [SURVEY…]
#
# Trees are compared under the warehouse, schedules over FSAH. Every survey's full tables, JSON and pictures are left in FOLDER
# as NAME-trees and NAME-schedules, those of the fixture as forest-replay. Tables are printed of what is there when it ends, also
# when it is interrupted. Leave the machine alone meanwhile. Needs cargo and python3; SCHEDULES names the program that is built already.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
folder=${1:-$here}
repetitions=${2:-1}
if [ -n "${SCHEDULES:-}" ]; then
  program=("$SCHEDULES")
else
  program=(cargo run --release --quiet --manifest-path "$here/../../Cargo.toml" -p vlscan-schedules --)
fi
# The quick ones first.
surveys=("${@:3}")
[ ${#surveys[@]} -gt 0 ] || surveys=(FIXED_250 HAMMERLE ARBORETUM DIWANG SCALED_COG)

# name of the files, survey, repetitions, other options
measure() {
  local began=$SECONDS
  printf '%s ' "$1" >&2
  rm -f "$folder/$1.json"
  "${program[@]}" "$2" --repetitions "$3" --json "$folder/$1.json" --svg "$folder/$1.svg" --force "${@:4}" \
    > "$folder/$1.txt"
  printf '%d s\n' $((SECONDS - began)) >&2
}

tables() {
  python3 - "$folder" <<'PYTHON'
import json, os, statistics, sys

SURVEYS = ["FIXED_250", "HAMMERLE", "SCALED_COG", "DIWANG", "ARBORETUM"]
TREES = ["median", "sah", "fsah", "bvh"]
SCHEDULES = ["static", "dynamic", "warehouse"]

def read(name):
    path = f"{sys.argv[1]}/{name}.json"
    return json.load(open(path)) if os.path.exists(path) else None

def load(kind):
    return {s: r for s in SURVEYS if (r := read(f"{s}-{kind}"))}

trees, schedules, forest = load("trees"), load("schedules"), read("forest-replay")

def row(*cells):
    print("| " + " | ".join(str(c) for c in cells) + " |")

def head(*cells):
    row(*cells)
    row(*["---"] * len(cells))

def ms(seconds):
    return f"{1000 * seconds:.1f}"

def label(cell):
    factor = f"×{cell['warehouse_factor']}" if cell["warehouse_factor"] else ""
    size = "" if cell["schedule"] == "single" else f" {cell['chunk_size']}"
    return f"{cell['schedule']}{size}{factor}" + (" + barrier" if cell["leg_barrier"] else "")

def alone(cells, tree):
    found = [c for c in cells if c["threads"] == 1 and c["tree"] == tree]
    return min(found, key=lambda c: c["simulation_s"])

def off(forecast, replayed, measured):
    return 100 * (forecast[replayed] / forecast[measured] - 1)

if forest:
    simulated = forest["simulated"]
    threads = sorted({f["threads"] for f in simulated})
    names = list(dict.fromkeys(map(label, simulated)))
    pick = lambda name, n: next(f for f in simulated if (label(f), f["threads"]) == (name, n))
    print("Replay of the forest fixture, bvh: simulation, ms\n")
    head("schedule", *(f"{n} threads" for n in threads))
    for name in names:
        row(name, *(ms(pick(name, n)["simulation_s"]) for n in threads))
    print("\nForest fixture, bvh, two threads: replayed and measured, ms\n")
    head("schedule", "replayed", "measured", "off", "processor time replayed", "measured", "off")
    for f in map(lambda name: pick(name, 2), names):
        row(label(f), ms(f["simulation_s"]), ms(f["measured_s"]), f"{off(f, 'simulation_s', 'measured_s'):+.0f} %",
            ms(f["cpu_s"]), ms(f["measured_cpu_s"]), f"{off(f, 'cpu_s', 'measured_cpu_s'):+.0f} %")

print("\nTrees on one thread: build + simulation, ms\n")
head("survey", "pulses", "echoes", *TREES)
for s, report in trees.items():
    of = [alone(report["cells"], t) for t in TREES]
    row(s, of[0]["pulses"], of[0]["echoes"], *(f"{ms(c['build_s'])} + {ms(c['simulation_s'])}" for c in of))

print("\nTheir size: nodes, references per primitive, depth, MB\n")
head("survey", "primitives", *TREES)
for s, report in trees.items():
    count = report["primitives"]
    of = [alone(report["cells"], t) for t in TREES]
    row(s, count, *(f"{c['tree_nodes']}, {c['tree_references'] / count:.1f}, {c['tree_depth']}, {c['tree_bytes'] / 1e6:.1f}"
                    for c in of))

print("\nSimulation on two threads, FSAH, leg barrier: wall / processor time, ms\n")
head("survey", "one thread", *(f"{x} {n}" for x in SCHEDULES for n in (32, 256)))
for s, report in schedules.items():
    cells = [c for c in report["cells"] if c["tree"] == "fsah"]
    both = lambda c: f"{ms(c['simulation_s'])} / {ms(c['cpu_s'])}"
    pick = lambda x, n: next(c for c in cells if (c["schedule"], c["chunk_size"], c["threads"]) == (x, n, 2))
    row(s, both(alone(cells, "fsah")), *(both(pick(x, n)) for x in SCHEDULES for n in (32, 256)))

print("\nBest kd-tree by total time, against the simple tree on one thread\n")
head("survey", "tree", "schedule", "threads", "build ms", "simulation ms", "total ms", "global speedup", "reduction")
for s, report in trees.items():
    kd = [c for c in report["cells"] if c["tree"] != "bvh"]
    c = min(kd, key=lambda c: c["total_s"])
    row(s, c["tree"], label(c), c["threads"], ms(c["build_s"]), ms(c["simulation_s"]), ms(c["total_s"]),
        f"{c['global_speedup']:.2f}", f"{100 * c['time_reduction']:.1f} %")

if schedules:
    print("\nReplay by measured time on two threads, median of the surveys (and the range)\n")
    head("schedule", "32", "256")
    for x in SCHEDULES:
        texts = []
        for n in (32, 256):
            all_off = [off(f, "simulation_s", "measured_s") for r in schedules.values() for f in r["simulated"]
                       if (f["schedule"], f["chunk_size"], f["threads"]) == (x, n, 2)]
            texts.append(f"{statistics.median(all_off):+.0f} % ({min(all_off):+.0f} to {max(all_off):+.0f})")
        row(x, *texts)
PYTHON
}
trap tables EXIT

measure forest-replay "$here/../../fixtures/forest/survey.xml" $((10 * repetitions)) --tree bvh -j 1,2 \
  --chunk-size 32,256 --leg-barrier both --simulate-threads 2,8,64,512
paper=(--tree-strict --leg-barrier on --warm-up 0 -j 1,2)
for survey in "${surveys[@]}"; do
  measure "$survey-trees" "$folder/$survey.toml" "$repetitions" "${paper[@]}" \
    --tree median,sah,fsah,bvh --schedule warehouse --chunk-size 256
  measure "$survey-schedules" "$folder/$survey.toml" "$repetitions" "${paper[@]}" \
    --tree fsah --schedule static,dynamic,warehouse --chunk-size 32,256 --simulate-threads 2
done
