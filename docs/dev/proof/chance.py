"""Counts what `vlscan compare --chance` marks in halves of recordings: python chance.py VLSCAN RECORDING... [--seed N]

Each recording is divided into halves by halves.py, by whole pulses and by whole scan lines, and the halves are compared: what is
beyond the bound of chance is marked wrongly. Prints a table. Needs what halves.py needs.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from recordings import run_script


def compared(program: str, recording: Path, options: list[str], folder: Path) -> dict:
    halves = [folder / "a.laz", folder / "b.laz"]
    script = Path(__file__).with_name("halves.py")
    subprocess.run([sys.executable, script, recording, *halves, *options], check=True)
    command = [program, "compare", *halves, "--chance", "--json"]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("vlscan")
    parser.add_argument("recording", type=Path, nargs="+")
    parser.add_argument("--seed", default="1")
    args = parser.parse_args()
    print("| recording | halves of | figures | beyond chance | distributions | beyond chance |\n|---|---|---|---|---|---|")
    totals = [0] * 4
    with tempfile.TemporaryDirectory() as folder:
        for recording in args.recording:
            for name, options in (("pulses", []), ("lines", ["--lines"])):
                quantities = compared(args.vlscan, recording, [*options, "--seed", args.seed], Path(folder))["quantities"]
                figures = [f for q in quantities for f in q["figures"] if f.get("chance") is not None]
                largest = [q["distribution"] for q in quantities if (q.get("distribution") or {}).get("chance") is not None]
                row = [len(figures), sum(f["is_within_chance"] is False for f in figures)]
                row += [len(largest), sum(d["largest"] > d["chance"] for d in largest)]
                totals = [a + b for a, b in zip(totals, row)]
                print(f"| {recording.stem} | {name} | " + " | ".join(map(str, row)) + " |")
    print("| all | | " + " | ".join(map(str, totals)) + " |")


if __name__ == "__main__":
    run_script(main)
