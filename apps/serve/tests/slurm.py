"""A service whose jobs a Slurm cluster computes; called by .ci/slurm, which has the cluster. A task and the service are killed on the way, and
the points must be those of a service that computes by itself.

    python slurm.py path/to/vlscan-serve path/to/vlscan
"""

import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

import requests

from service_process import FIELD, flight, started, wait

PARTS = 4


def main() -> None:
    program, vlscan = sys.argv[1:]
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        submit = f"sbatch --job-name={{name}} --array=0-{{last}} --requeue --time={{minutes}} --output={folder}/%x_%a.log --wrap={{command}}"
        options = ["--submit", submit, "--poll", "squeue --noheader --name={name}", "--cancel", "scancel --name={name}", "--parts", str(PARTS)]
        with started(program, vlscan, folder / "alone", [], os.environ) as url:
            expected = points(url, run(url))
        with started(program, vlscan, folder / "data", options, os.environ, end=signal.SIGKILL) as url:
            job = run(url)
            tasks = folder / "data/jobs" / job["jobID"] / "tasks"
            kill_task(tasks / "1.json", 1)
        with started(program, vlscan, folder / "data", options, os.environ) as url:
            assert points(url, job) == expected
            # A job that is dismissed leaves the queue.
            job = requests.post(f"{url}/processes/run/execution", json={"inputs": flight(4000)}).json()
            await_output(["squeue", "--noheader", "--state=RUNNING", f"--name=vlscan-{job['jobID']}-1"], is_empty=False)
            requests.delete(f"{url}/jobs/{job['jobID']}").raise_for_status()
            await_output(["squeue", "--noheader", f"--name=vlscan-{job['jobID']}-1"], is_empty=True)
        print(f"{len(expected)} bytes of a service whose jobs Slurm computes, a task and the service killed: those of one process")


def run(url: str) -> dict:
    requests.post(f"{url}/uploads", data={"name": "field"}, files={"file": ("field.obj", FIELD)}).raise_for_status()
    return requests.post(f"{url}/processes/run/execution", json={"inputs": flight(8)}).json()


def points(url: str, job: dict) -> bytes:
    state = wait(url, requests.get(f"{url}/jobs/{job['jobID']}").json())
    assert state["status"] == "successful", state
    return requests.get(f"{url}/jobs/{job['jobID']}/results/points.laz").content


def kill_task(submission: pathlib.Path, number: int) -> None:
    """Kills a task while it computes."""
    while True:
        for process in pathlib.Path("/proc").glob("[0-9]*"):
            try:
                words = (process / "cmdline").read_bytes().split(b"\0")
                variables = (process / "environ").read_bytes().split(b"\0")
            except (FileNotFoundError, PermissionError, ProcessLookupError):
                continue
            if words[1:3] == [b"task", str(submission).encode()] and f"SLURM_ARRAY_TASK_ID={number}".encode() in variables:
                os.kill(int(process.name), signal.SIGKILL)
                return
        time.sleep(0.01)


def await_output(command: list[str], *, is_empty: bool) -> None:
    start = time.monotonic()
    while (subprocess.run(command, capture_output=True, check=True).stdout.strip() == b"") != is_empty:
        assert time.monotonic() - start < 60, command
        time.sleep(0.1)


if __name__ == "__main__":
    main()
