"""Memory of a process that runs a survey again and again: `python python/benches/memory.py [RUNS] [SURVEY]`.

Prints VmRSS after the second and after the last run, MB, and their quotient.
"""

import gc
import sys
from pathlib import Path

import vlscan

ROOM = Path(__file__).resolve().parents[2] / "fixtures/room/survey.xml"


def resident_mb() -> float:
    gc.collect()
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1000


def main(runs: int = 50, survey: str = str(ROOM)) -> None:
    seen = []
    for seed in range(runs):
        points = vlscan.run(survey, seed=seed, columns=["X", "Y", "Z", "Intensity"], progress=lambda **now: None).points
        points["X"].sum()
        del points
        seen.append(resident_mb())
    print(f"{seen[1]:.1f} {seen[-1]:.1f} {seen[-1] / seen[1]:.3f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]), *sys.argv[2:3])
