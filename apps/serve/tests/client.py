"""The service as a Python program uses it: the definition is valid OpenAPI 3.0, answers are as it says and as OGC's own definition says, of
which ogc-api-processes-client is made, and a plan becomes a cloud.

    python client.py target/debug/vlscan-serve target/debug/vlscan
"""

import json
import os
import pathlib
import sys
import tempfile

import jsonschema
import laspy
import ogc_api_processes_client as ogc
import openapi_spec_validator
import requests

from service_process import started

FIXTURES = pathlib.Path(__file__).resolve().parents[3] / "fixtures"


def main() -> None:
    program, vlscan = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        with started(program, vlscan, pathlib.Path(folder) / "data", [], os.environ) as url:
            use(url, pathlib.Path(folder))


def use(url: str, folder: pathlib.Path) -> None:
    definition = requests.get(f"{url}/api").json()
    openapi_spec_validator.validate(definition)

    def check(name: str, document: dict) -> None:
        schema = {"$ref": f"#/components/schemas/{name}", "components": definition["components"]}
        jsonschema.validate(document, schema)
        check_as_ogc(name, document)

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


# What OGC's definition calls what ours does.
MODELS = {
    "landingPage": ogc.LandingPage,
    "confClasses": ogc.ConfClasses,
    "processList": ogc.ProcessList,
    "process": ogc.Process,
    "statusInfo": ogc.StatusInfo,
    "jobList": ogc.JobList,
    "exception": ogc.Exception,
}
# The keys that schemas of inputs and outputs may have.
SCHEMA_KEYS = set(ogc.SchemaOneOf.model_fields[name].alias or name for name in ogc.SchemaOneOf.model_fields) | {"$ref"}


def check_as_ogc(name: str, document: dict) -> None:
    if name == "results":
        for value in document.values():
            assert ogc.InlineOrRefData.from_dict(value) is not None
        return
    MODELS[name].model_validate(document) if name == "exception" else MODELS[name].from_dict(document)
    if name == "process":
        for key in ("inputs", "outputs"):
            for described in document[key].values():
                check_keys(described["schema"])


def check_keys(schema: object) -> None:
    assert set(schema) <= SCHEMA_KEYS, set(schema) - SCHEMA_KEYS
    for inner in [*schema.get("anyOf", []), *schema.get("oneOf", []), *schema.get("allOf", []), *schema.get("properties", {}).values()]:
        check_keys(inner)
    for key in ("items", "not", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            check_keys(schema[key])


if __name__ == "__main__":
    main()
