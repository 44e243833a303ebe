"""The service as a Python program uses it: the definition is valid OpenAPI 3.0, answers are as it says, and a plan becomes a cloud.

    python client.py target/debug/vlscan-serve target/debug/vlscan
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import jsonschema
import laspy
import openapi_spec_validator
import requests

FIXTURES = pathlib.Path(__file__).resolve().parents[3] / "fixtures"


def main() -> None:
    program, vlscan = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        command = [program, "--listen", "127.0.0.1:0", "--program", vlscan, "--data", f"{folder}/data"]
        service = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        try:
            url = next(word for line in service.stderr for word in line.split() if word.startswith("http://")).rstrip("/")
            use(url, pathlib.Path(folder))
        finally:
            service.terminate()
        assert service.wait(timeout=30) == 0


def use(url: str, folder: pathlib.Path) -> None:
    definition = requests.get(f"{url}/api").json()
    openapi_spec_validator.validate(definition)

    def check(name: str, document: object) -> None:
        schema = {"$ref": f"#/components/schemas/{name}", "components": definition["components"]}
        jsonschema.validate(document, schema)

    for path, name in [("/?f=json", "landingPage"), ("/conformance", "confClasses"), ("/processes", "processList"), ("/jobs", "jobList")]:
        check(name, requests.get(url + path).json())
    for process in requests.get(f"{url}/processes").json()["processes"]:
        check("process", requests.get(f"{url}/processes/{process['id']}").json())
    check("exception", requests.get(f"{url}/jobs/none").json())

    files = [("file", open(path, "rb")) for path in sorted((FIXTURES / "forest").iterdir())]
    upload = requests.post(f"{url}/uploads", data={"name": "forest"}, files=files)
    assert upload.status_code == 201, upload.text
    inputs = {"kind": "airborne", "scene": "forest/scene.xml", "scanner": "riegl_vux-1uav", "height": 60, "density": 10, "overlap": 30}
    plan = requests.post(f"{url}/processes/plan/execution", json={"inputs": inputs})
    assert plan.status_code == 200, plan.text
    check("results", plan.json())
    file = plan.json()["plan.toml"]["href"].removeprefix("/").replace("/results/", "/")
    job = requests.post(f"{url}/processes/run/execution", json={"inputs": {"pipeline": file, "seed": 1}})
    assert job.status_code == 201 and job.headers["Location"] == f"/jobs/{job.json()['jobID']}", job.text
    check("statusInfo", job.json())
    with requests.get(f"{url}/jobs/{job.json()['jobID']}/events", stream=True) as events:
        states = [json.loads(line[5:]) for line in events.iter_lines(decode_unicode=True) if line.startswith("data:")]
    for state in states:
        check("statusInfo", state)
    assert states[-1]["status"] == "successful", states[-1]
    results = requests.get(f"{url}/jobs/{job.json()['jobID']}/results").json()
    check("results", results)
    (folder / "points.laz").write_bytes(requests.get(url + results["points.laz"]["href"]).content)
    points = laspy.read(folder / "points.laz")
    assert len(points) > 10_000, len(points)
    print(f"{len(points)} points")


if __name__ == "__main__":
    main()
