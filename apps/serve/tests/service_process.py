"""A service that scripts start, and runs that they give it."""

import contextlib
import pathlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping

import requests

# A square of 100 m.
FIELD = "v -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\nf 1 2 3 4\n"


def flight(seconds: float) -> dict:
    """Inputs of a run of so many seconds over FIELD, 100,000 pulses in each."""
    return {
        "scene": "field/field.obj",
        "scanner": {"catalogue": "riegl_vux-1uav"},
        "platform": {"catalogue": "copter_linearpath"},
        "settings": {"pulse_freq_hz": 100_000, "scan_freq_hz": 100},
        "leg": [{"position_m": [-40, 0, 50], "speed_m_per_s": 80 / seconds}, {"position_m": [40, 0, 50]}],
    }


def wait(url: str, job: dict) -> dict:
    """The state of a job at its end."""
    while job["status"] in ("accepted", "running"):
        time.sleep(0.05)
        job = requests.get(f"{url}/jobs/{job['jobID']}").json()
    return job


@contextlib.contextmanager
def started(
    program: str, vlscan: str, folder: pathlib.Path, options: list[str], environment: Mapping[str, str], end: int = signal.SIGTERM
) -> Iterator[str]:
    """A service in a folder, by its address."""
    command = [program, "--listen", "127.0.0.1:0", "--program", vlscan, "--data", str(folder), *options]
    service = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
    said = []
    try:
        for line in service.stderr:
            said.append(line)
            if "http://" in line:
                break
        address = [word for word in "".join(said).split() if word.startswith("http://")]
        assert address, said
        # What it says later is shown with the test.
        threading.Thread(target=lambda: sys.stderr.writelines(service.stderr), daemon=True).start()
        yield address[0].rstrip("/")
    finally:
        service.send_signal(end)
        status = service.wait(timeout=30)
    assert status == (0 if end == signal.SIGTERM else -end), status
