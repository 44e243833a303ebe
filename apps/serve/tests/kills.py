"""A thousand kills of a service and of its workers while runs are computed. Now and then its database is emptied, truncated, removed or
restored from an older copy. Nothing may be lost or deleted: at the end each run has the bytes of an undisturbed one.

    python kills.py target/debug/vlscan-serve target/debug/vlscan [KILLS]

Takes about half an hour.
"""

import contextlib
import itertools
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

import requests
from service_process import FIELD, flight, wait

# Kills between two new runs, and between two accidents of the database.
RUN = 10
ACCIDENT = 40
SECONDS = 4


class Service:
    def __init__(self, program: str, vlscan: str, data: pathlib.Path):
        self.program, self.vlscan, self.data = program, vlscan, data
        self.process = None

    def begin(self, *options: str) -> subprocess.Popen:
        command = [self.program, "--listen", "127.0.0.1:0", "--program", self.vlscan, "--data", str(self.data), *options]
        return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)

    def start(self, *options: str) -> None:
        self.process = self.begin(*options)
        said = []
        for line in self.process.stderr:
            said.append(line)
            if "http://" in line:
                break
        address = [word for word in said[-1].split() if word.startswith("http://")] if said else []
        assert address, said
        self.url = address[0].rstrip("/")
        threading.Thread(target=self.process.stderr.read, daemon=True).start()

    def end(self, number: int) -> None:
        self.process.send_signal(number)
        self.process.wait(timeout=60)

    def kill_worker(self) -> None:
        """Kills the processes of jobs, not the service."""
        for tasks in pathlib.Path(f"/proc/{self.process.pid}/task").glob("*/children"):
            with contextlib.suppress(OSError):
                for child in tasks.read_text().split():
                    subprocess.run(["kill", "-9", child], check=False, stderr=subprocess.DEVNULL)

    def submit(self, seed: int) -> str:
        request = {"inputs": {**flight(SECONDS), "seed": seed}, "response": "document"}
        answer = requests.post(f"{self.url}/processes/run/execution", json=request, headers={"Prefer": "respond-async"})
        answer.raise_for_status()
        return answer.json()["jobID"]

    def points(self, job: str) -> bytes:
        state = wait(self.url, requests.get(f"{self.url}/jobs/{job}").json())
        assert state["status"] == "successful", state
        answer = requests.get(f"{self.url}/jobs/{job}/results/points.laz")
        answer.raise_for_status()
        return answer.content


def database(data: pathlib.Path) -> dict[pathlib.Path, bytes]:
    return {path: path.read_bytes() for path in [data / "service.db", data / "service.db-wal"] if path.exists()}


def put(data: pathlib.Path, files: dict[pathlib.Path, bytes]) -> None:
    for path in database(data):
        path.unlink()
    for path, content in files.items():
        path.write_bytes(content)


def contents(data: pathlib.Path) -> dict[str, bytes]:
    """All files of uploads and jobs, and the database. SQLite makes an empty log of a database that it reads."""
    files = [path for path in sorted(data.rglob("*")) if path.is_file() and not path.is_symlink()]
    return {str(path.relative_to(data)): path.read_bytes() for path in files if path.name != "service.db-wal" or path.stat().st_size}


def is_refused(service: Service, word: str) -> None:
    """The service does not start, and changes nothing."""
    # The processes of jobs end after the service.
    time.sleep(0.5)
    before = contents(service.data)
    process = service.begin()
    _, said = process.communicate(timeout=120)
    assert process.returncode != 0 and word in said, said
    after = contents(service.data)
    assert after == before, [name for name in {*before, *after} if before.get(name) != after.get(name)]


def restored(service: Service, yesterday: dict[pathlib.Path, bytes], newest: dict[pathlib.Path, bytes]) -> int:
    """An older database sets newer files aside, from where they are moved back. Returns their number."""
    data = service.data
    names = {path.relative_to(data) for kind in ("uploads", "jobs") for path in (data / kind).iterdir()}
    put(data, yesterday)
    service.start("--workers", "0")
    service.end(signal.SIGTERM)
    moved = 0
    for path in list((data / "lost").glob("*/*")):
        shutil.move(path, data / path.relative_to(data / "lost"))
        moved += 1
    assert {path.relative_to(data) for kind in ("uploads", "jobs") for path in (data / kind).iterdir()} == names
    put(data, newest)
    return moved


def accident(service: Service, kind: int, yesterday: dict[pathlib.Path, bytes]) -> int:
    data = service.data
    newest = database(data)
    file = data / "service.db"
    if kind == 0:
        put(data, {file: b""})
        is_refused(service, "missing or empty")
    elif kind == 1:
        put(data, {file: newest[file][: len(newest[file]) // 2]})
        is_refused(service, "damaged")
    elif kind == 2:
        put(data, {})
        is_refused(service, "missing or empty")
    else:
        return restored(service, yesterday, newest)
    put(data, newest)
    return 0


def main() -> None:
    program, vlscan, *rest = sys.argv[1:]
    kills = int(rest[0]) if rest else 1000
    choose = random.Random(88)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        service = Service(program, vlscan, pathlib.Path(folder) / "data")
        service.start()
        files = {"name": (None, "field"), "file": ("field.obj", FIELD)}
        requests.post(f"{service.url}/uploads", files=files).raise_for_status()
        jobs = {}
        # The first copy has no run, each later one those of then.
        service.end(signal.SIGTERM)
        yesterday = database(service.data)
        service.start()
        accidents = itertools.cycle(range(4))
        moved = 0
        for kill in range(kills):
            if kill % RUN == 0:
                jobs[len(jobs)] = service.submit(len(jobs))
            time.sleep(choose.random() * 0.4)
            if kill % 3 == 0:
                service.kill_worker()
                continue
            service.end(signal.SIGKILL)
            if kill % ACCIDENT >= ACCIDENT - 2:
                moved += accident(service, next(accidents), yesterday)
            if kill % (4 * ACCIDENT) == 1:
                yesterday = database(service.data)
            service.start()
        print(f"{kills} kills, {len(jobs)} runs; {moved} folders were set aside and moved back", flush=True)
        found = {seed: service.points(job) for seed, job in jobs.items()}
        listed = requests.get(f"{service.url}/jobs?limit=10000").json()["jobs"]
        assert len(listed) == len(jobs), "no job is lost, and none is doubled"
        service.end(signal.SIGTERM)
        # A service that runs writes its clock now and then, first to a file there.
        assert not list((service.data / "incoming").iterdir())

        calm = Service(program, vlscan, pathlib.Path(folder) / "calm")
        calm.start()
        requests.post(f"{calm.url}/uploads", files=files).raise_for_status()
        different = [seed for seed in jobs if calm.points(calm.submit(seed)) != found[seed]]
        calm.end(signal.SIGTERM)
        assert not different, f"the runs {different} have other bytes"
        assert moved > 0 or kills < 200
        print("all runs have the bytes of undisturbed ones")


if __name__ == "__main__":
    main()
