"""The service with its files in a bucket, against a server of the S3 protocol (moto): uploads, runs, results in parts, pictures, removal, and
a service that is killed again and again.

    python bucket.py path/to/vlscan-serve path/to/vlscan
"""

import logging
import os
import pathlib
import random
import signal
import subprocess
import sys
import tempfile
import time

import boto3
import requests
from moto.server import ThreadedMotoServer

from service_process import FIELD, flight, started, wait

KEYS = {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_REGION": "us-east-1"}

# Seconds of runs: the text of the long one is sent in several parts.
LONG, SHORT = 6.5, 1.5


def main() -> None:
    program, vlscan = sys.argv[1:]
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    endpoint = "http://{}:{}".format(*server.get_host_and_port())
    os.environ |= KEYS | {"AWS_ENDPOINT": endpoint, "AWS_ALLOW_HTTP": "true"}
    s3 = boto3.client("s3", endpoint_url=endpoint, region_name="us-east-1")
    s3.create_bucket(Bucket="scans")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        long, short = alone(program, vlscan, folder / "alone")
        use(program, vlscan, folder / "data", s3, long)
        interrupted(program, vlscan, folder / "killed", s3, short)
    server.stop()


def keys(s3: object) -> list[str]:
    """The names of all objects but those with the ids of services."""
    pages = s3.get_paginator("list_objects_v2").paginate(Bucket="scans")
    names = [found["Key"] for page in pages for found in page.get("Contents", [])]
    return sorted(name for name in names if not name.endswith("/service-id"))


def refused(program: str, vlscan: str, folder: pathlib.Path, prefix: str) -> str:
    """What a service says that does not start with a prefix."""
    command = [program, "--listen", "127.0.0.1:0", "--program", vlscan, "--data", str(folder), "--store", f"s3://scans/{prefix}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode != 0, done.stderr
    return done.stderr


def files(folder: pathlib.Path) -> list[str]:
    """The files of uploads and results that are on this machine."""
    # The service writes its clock now and then, first to a file of its own there.
    incomplete = [path for path in folder.glob("incoming/*") if path.is_dir()]
    found = [*folder.glob("uploads/*/**/*"), *folder.glob("jobs/*/out/**/*"), *incomplete]
    return sorted(str(path.relative_to(folder)) for path in found)


def upload(url: str) -> None:
    requests.post(f"{url}/uploads", data={"name": "field"}, files={"file": ("field.obj", FIELD)}).raise_for_status()


def submit(url: str, seconds: float, seed: int = 0) -> dict:
    inputs = flight(seconds) | {"seed": seed, "output": [{"path": "points.laz"}, {"path": "points.xyz"}]}
    return requests.post(f"{url}/processes/run/execution", json={"inputs": inputs}).json()


def alone(program: str, vlscan: str, folder: pathlib.Path) -> list[bytes]:
    """The points of a long and a short run of a service with its own folder."""
    with started(program, vlscan, folder, [], os.environ) as url:
        upload(url)
        jobs = [wait(url, submit(url, seconds))["jobID"] for seconds in (LONG, SHORT)]
        return [requests.get(f"{url}/jobs/{job}/results/points.laz").content for job in jobs]


def use(program: str, vlscan: str, folder: pathlib.Path, s3: object, expected: bytes) -> None:
    # Objects that no row names are not removed, and a new service does not take a prefix that has some.
    orphan = "a/b/uploads/orphan/x.obj"
    s3.put_object(Bucket="scans", Key=orphan, Body=b"x")
    assert "another service" in refused(program, vlscan, folder.with_name("new"), "a/b")
    assert keys(s3) == [orphan]
    s3.delete_object(Bucket="scans", Key=orphan)
    with started(program, vlscan, folder, ["--store", "s3://scans/a/b"], os.environ):
        pass
    s3.put_object(Bucket="scans", Key=orphan, Body=b"x")
    with started(program, vlscan, folder, ["--store", "s3://scans/a/b"], os.environ):
        assert keys(s3) == ["a/b/lost/uploads/orphan/x.obj"], keys(s3)
    assert "another service" in refused(program, vlscan, folder.with_name("other"), "a/b")
    of_folder(program, vlscan, folder.with_name("of-folder"), s3)
    check = [program, "check", "--data", str(folder), "--store", "s3://scans/a/b"]
    report = subprocess.run(check, capture_output=True, text=True)
    assert report.returncode == 0 and "bucket" in report.stdout, report
    s3.delete_object(Bucket="scans", Key="a/b/lost/uploads/orphan/x.obj")
    with started(program, vlscan, folder, ["--store", "s3://scans/a/b"], os.environ) as url:
        assert keys(s3) == []
        upload(url)
        assert len(keys(s3)) == 1 and keys(s3)[0].startswith("a/b/uploads/") and files(folder) == [], (keys(s3), files(folder))
        job = wait(url, submit(url, LONG))
        assert job["status"] == "successful", job
        assert len(keys(s3)) == 3 and files(folder) == [], (keys(s3), files(folder))
        own = f"{url}/jobs/{job['jobID']}"
        assert requests.get(f"{own}/results/points.laz").content == expected
        # More than the parts in which files are sent.
        text = requests.get(f"{own}/results/points.xyz").content
        assert len(text) > 10 << 20, len(text)
        part = requests.get(f"{own}/results/points.xyz", headers={"Range": "bytes=10485000-10486999"})
        assert part.status_code == 206 and part.content == text[10485000:10487000]
        assert part.headers["Content-Range"] == f"bytes 10485000-10486999/{len(text)}"
        assert requests.get(f"{own}/results/points.xyz", headers={"Range": f"bytes={len(text)}-"}).status_code == 416
        for path in ("absent.laz", "../points.laz", "..%2Fpoints.laz"):
            assert requests.get(f"{own}/results/{path}").status_code == 404, path
        uploaded = requests.get(f"{url}/uploads/field/files/field.obj", headers={"Range": "bytes=2-4"})
        assert uploaded.status_code == 206 and uploaded.text == "-50", uploaded.text
        # Pictures, a comparison and a plan read what is fetched.
        scene = requests.get(f"{url}/map.png", params={"scene": "field/field.obj"})
        assert scene.content.startswith(b"\x89PNG"), scene.text
        job = wait(url, submit(url, SHORT))
        assert requests.get(f"{url}/jobs/{job['jobID']}/view/view.png").content.startswith(b"\x89PNG")
        cloud = f"jobs/{job['jobID']}/points.laz"
        inputs = {"inputs": {"first": cloud, "second": cloud}, "response": "document"}
        job = wait(url, requests.post(f"{url}/processes/compare/execution", json=inputs, headers={"Prefer": "respond-async"}).json())
        assert job["status"] == "successful", job
        report = requests.get(f"{url}/jobs/{job['jobID']}/results").json()
        assert "value" in report["report.json"] and "href" in report["report.html"], report
        plan = {"kind": "airborne", "scene": "field/field.obj", "scanner": "riegl_vux-1uav", "height": 50, "density": 5}
        plan = {"inputs": plan, "response": "document"}
        plan = requests.post(f"{url}/processes/plan/execution", json=plan).json()["plan.toml"]["href"]
        again = {"pipeline": plan.removeprefix("/").replace("/results/", "/")}
        forecast = requests.post(f"{url}/processes/dry-run/execution", json={"inputs": again})
        assert forecast.status_code == 200, forecast.text
        assert files(folder) == [], files(folder)
        # The same run is answered with the results of then.
        assert submit(url, LONG)["status"] == "successful"
        for job in requests.get(f"{url}/jobs", params={"limit": 1000}).json()["jobs"]:
            requests.delete(f"{url}/jobs/{job['jobID']}").raise_for_status()
        requests.delete(f"{url}/uploads/field").raise_for_status()
        assert keys(s3) == [], keys(s3)


def of_folder(program: str, vlscan: str, folder: pathlib.Path, s3: object) -> None:
    """A service that keeps its files in its folder does not start with a bucket that lacks them, and loses nothing."""
    with started(program, vlscan, folder, [], os.environ) as url:
        upload(url)
        job = wait(url, submit(url, SHORT))["jobID"]
    before = files(folder)
    assert len(before) > 2, before
    assert "bucket is empty" in refused(program, vlscan, folder, "empty")
    s3.put_object(Bucket="scans", Key="empty/service-id", Body=(folder / "id").read_bytes())
    # Even where its id is in the bucket.
    with started(program, vlscan, folder, ["--store", "s3://scans/empty"], os.environ):
        pass
    assert files(folder) == before, files(folder)
    s3.delete_object(Bucket="scans", Key="empty/service-id")
    with started(program, vlscan, folder, [], os.environ) as url:
        assert requests.get(f"{url}/jobs/{job}/results/points.laz").status_code == 200


def interrupted(program: str, vlscan: str, folder: pathlib.Path, s3: object, expected: bytes) -> None:
    """A service that is killed at random moments loses no job and no byte, and leaves no object."""
    moments = random.Random(7)
    options = ["--store", "s3://scans/killed"]
    with started(program, vlscan, folder, options, os.environ) as url:
        upload(url)
        jobs = [submit(url, SHORT, seed)["jobID"] for seed in range(3)]
    for _ in range(6):
        with started(program, vlscan, folder, options, os.environ, end=signal.SIGKILL):
            time.sleep(moments.uniform(0.1, 1.2))
    with started(program, vlscan, folder, options, os.environ) as url:
        for job in jobs:
            state = wait(url, requests.get(f"{url}/jobs/{job}").json())
            assert state["status"] == "successful", state
        assert requests.get(f"{url}/jobs/{jobs[0]}/results/points.laz").content == expected
    with started(program, vlscan, folder, options, os.environ) as url:
        assert len(keys(s3)) == 1 + 2 * len(jobs) and files(folder) == [], (keys(s3), files(folder))


if __name__ == "__main__":
    main()
    print("a bucket holds what the service serves")
