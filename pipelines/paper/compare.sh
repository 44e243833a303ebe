#!/usr/bin/env bash
# Measures the five surveys that make.sh has made in FOLDER and prints the tables of docs/experiment.md:
#
#     pipelines/paper/compare.sh [FOLDER] [REPETITIONS]
#
# Trees are compared under the warehouse, schedules over FSAH. Every survey's full tables, JSON and pictures are left in FOLDER
# as NAME-trees and NAME-schedules. Leave the machine alone meanwhile: ten minutes per repetition on two cores.
# Needs python3; VLSCAN names the program.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
folder=${1:-$here}
repetitions=${2:-1}
vlscan=${VLSCAN:-vlscan}

for survey in FIXED_250 HAMMERLE SCALED_COG DIWANG ARBORETUM; do
  echo "$survey" >&2
  measure() {
    "$vlscan" bench "$folder/$survey.toml" --tree-strict --leg-barrier on --warm-up 0 --repetitions "$repetitions" \
      --json "$folder/$survey-$1.json" --svg "$folder/$survey-$1.svg" --force "${@:2}" > "$folder/$survey-$1.txt"
  }
  measure trees --tree median,sah,fsah,bvh --schedule warehouse --chunk-size 256
  measure schedules --tree fsah --schedule static,dynamic,warehouse --chunk-size 32,256 --simulate-threads 2,24
done

python3 - "$folder" <<'PYTHON'
import json, statistics, sys

SURVEYS = ["FIXED_250", "HAMMERLE", "SCALED_COG", "DIWANG", "ARBORETUM"]
TREES = ["median", "sah", "fsah", "bvh"]
SCHEDULES = ["static", "dynamic", "warehouse"]

def load(kind):
    return {s: json.load(open(f"{sys.argv[1]}/{s}-{kind}.json")) for s in SURVEYS}

trees, schedules = load("trees"), load("schedules")

def row(*cells):
    print("| " + " | ".join(str(c) for c in cells) + " |")

def head(*cells):
    row(*cells)
    row(*["---"] * len(cells))

def ms(seconds):
    return f"{1000 * seconds:.1f}"

def label(cell):
    factor = f"×{cell['warehouse_factor']}" if cell["warehouse_factor"] else ""
    return f"{cell['schedule']} {cell['chunk_size']}{factor}"

def alone(cells, tree):
    found = [c for c in cells if c["threads"] == 1 and c["tree"] == tree]
    return min(found, key=lambda c: c["simulation_s"])

print("Trees on one thread: build + simulation, ms\n")
head("survey", "pulses", "echoes", *TREES)
for s, report in trees.items():
    of = [alone(report["cells"], t) for t in TREES]
    row(s, of[0]["pulses"], of[0]["echoes"], *(f"{ms(c['build_s'])} + {ms(c['simulation_s'])}" for c in of))

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

print("\nReplay by measured time on two threads, median of the surveys (and the range)\n")
head("schedule", "32", "256")
for x in SCHEDULES:
    texts = []
    for n in (32, 256):
        off = [100 * (f["simulation_s"] / f["measured_s"] - 1) for r in schedules.values() for f in r["simulated"]
               if (f["schedule"], f["chunk_size"], f["threads"]) == (x, n, 2)]
        texts.append(f"{statistics.median(off):+.0f} % ({min(off):+.0f} to {max(off):+.0f})")
    row(x, *texts)
PYTHON
