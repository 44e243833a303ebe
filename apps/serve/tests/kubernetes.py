"""Jobs of the service on Kubernetes, by the script that the project offers, with a program in place of kubectl: it checks what it is given
against the schemas of Kubernetes, and runs the commands of pods on this machine.

    python kubernetes.py path/to/vlscan-serve path/to/vlscan
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile

import kubernetes_validate
import requests
import yaml

from service_process import FIELD, flight, started, wait

SCRIPT = pathlib.Path(__file__).resolve().parents[3] / "pipelines/cluster/kubernetes-engine.sh"


def kubectl(words: list[str]) -> None:
    """What stands in for kubectl: `create -f -`, `get job NAME … -o jsonpath=…`, `delete job NAME …`."""
    folder = pathlib.Path(os.environ["VLSCAN_FAKE"])
    if words[:3] == ["create", "-f", "-"]:
        text = sys.stdin.read()
        job = yaml.safe_load(text)
        kubernetes_validate.validate(job, kubernetes_validate.latest_version(), strict=True)
        spec = job["spec"]["template"]["spec"]
        container = spec["containers"][0]
        assert container["volumeMounts"][0]["mountPath"] == os.environ["VLSCAN_DATA"]
        pods = []
        for index in range(job["spec"]["completions"]):
            environment = {"PATH": os.environ["PATH"], "JOB_COMPLETION_INDEX": str(index)}
            log = open(folder / f"{job['metadata']['name']}-{index}.log", "wb")
            pod = subprocess.Popen(container["command"], env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True)
            pods.append(pod.pid)
        (folder / job["metadata"]["name"]).write_text(json.dumps(pods))
        return
    verb, kind, name = words[:3]
    assert (verb, kind) in (("get", "job"), ("delete", "job")), words
    assert "--ignore-not-found" in words
    file = folder / name
    if not file.exists():
        return
    alive = [pid for pid in json.loads(file.read_text()) if state(pid) not in ("", "Z")]
    if verb == "get":
        print(name, "" if alive else "Complete ", end="")
        return
    assert "--cascade=foreground" in words
    for pid in alive:
        os.killpg(pid, 9)
    file.unlink()


def state(pid: int) -> str:
    """The state of a process, empty if there is none."""
    try:
        return pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return ""


def main() -> None:
    program, vlscan = sys.argv[1:]
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        fake = folder / "kubectl"
        fake.write_text(f"#!/bin/sh\nexec '{sys.executable}' '{__file__}' kubectl \"$@\"\n")
        fake.chmod(0o755)
        environment = os.environ | {
            "KUBECTL": str(fake),
            "VLSCAN_FAKE": name,
            "VLSCAN_IMAGE": "registry.example.org/vlscan",
            "VLSCAN_CLAIM": "vlscan",
            "VLSCAN_DATA": f"{name}/data",
        }
        options = [
            *("--submit", f"{SCRIPT} submit {{name}} {{tasks}} {{megabytes}} {{command}}"),
            *("--poll", f"{SCRIPT} poll {{name}}", "--cancel", f"{SCRIPT} cancel {{name}}", "--parts", "3"),
        ]
        found = {}
        for where, more in (("alone", []), ("data", options)):
            with started(program, vlscan, folder / where, more, environment) as url:
                requests.post(f"{url}/uploads", data={"name": "field"}, files={"file": ("field.obj", FIELD)}).raise_for_status()
                job = wait(url, requests.post(f"{url}/processes/run/execution", json={"inputs": flight(2)}).json())
                assert job["status"] == "successful", job
                found[where] = requests.get(f"{url}/jobs/{job['jobID']}/results/points.laz").content
                if more:
                    # A job that is dismissed is deleted.
                    job = requests.post(f"{url}/processes/run/execution", json={"inputs": flight(4000)}).json()
                    submitted = folder / f"vlscan-{job['jobID']}-1"
                    while not submitted.exists():
                        assert requests.get(f"{url}/jobs/{job['jobID']}").json()["status"] in ("accepted", "running")
                    requests.delete(f"{url}/jobs/{job['jobID']}").raise_for_status()
                    while submitted.exists():
                        pass
        assert found["alone"] == found["data"]
        print(f"{len(found['data'])} bytes from three pods, those of one process")


if __name__ == "__main__":
    if sys.argv[1] == "kubectl":
        kubectl(sys.argv[2:])
    else:
        main()
