"""The service as a Python program uses it: the definition is valid OpenAPI 3.0, answers are as it says and as OGC's own definition says, of
which ogc-api-processes-client is made, and a plan becomes a cloud.

    python client.py target/debug/vlscan-serve target/debug/vlscan
"""

import json
import os
import pathlib
import sys
import tempfile
from collections.abc import Callable

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
    plan = requests.post(f"{url}/processes/plan/execution", json={"inputs": inputs, "response": "document"})
    assert plan.status_code == 200, plan.text
    check("results", plan.json())
    file = plan.json()["plan.toml"]["href"].removeprefix("/").replace("/results/", "/")
    job = requests.post(f"{url}/processes/run/execution", json={"inputs": {"pipeline": file, "seed": 1}, "response": "document"})
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
    check_forms(url, inputs, plan.json()["plan.toml"]["href"])
    check_list(url, check)
    points = laspy.read(folder / "points.laz")
    assert len(points) > 10_000, len(points)
    print(f"{len(points)} points")


def check_forms(url: str, inputs: dict, href: str) -> None:
    """Without `response` an output is the answer itself; several are parts, and references are links."""
    execution = f"{url}/processes/plan/execution"
    raw = requests.post(execution, json={"inputs": inputs})
    assert raw.status_code == 200 and raw.headers["Content-Type"] == "application/toml", raw.headers
    assert raw.content == requests.get(url + href).content
    reference = {"plan.toml": {"transmissionMode": "reference"}}
    linked = requests.post(execution, json={"inputs": inputs, "outputs": reference})
    assert linked.status_code == 204 and linked.links["item"]["url"].endswith("/results/plan.toml"), linked.headers
    value = {"inputs": inputs, "outputs": {"plan.toml": {"transmissionMode": "value"}}, "response": "document"}
    assert requests.post(execution, json=value).json()["plan.toml"]["value"] == raw.content.decode()


def check_list(url: str, check: Callable[[str, dict], None]) -> None:
    """Filters of jobs, and links that keep them."""
    jobs = requests.get(f"{url}/jobs", params={"processID": "plan,run", "status": "successful"}).json()["jobs"]
    ids, created = [job["jobID"] for job in jobs], [job["created"] for job in jobs]
    assert len(ids) > 2, ids
    page = requests.get(f"{url}/jobs", params={"datetime": f"{created[-1]}/..", "processID": "plan", "limit": 1}).json()
    check("jobList", page)
    following = {link["rel"]: link["href"] for link in page["links"]}["next"]
    other = requests.get(url + following).json()["jobs"]
    assert {page["jobs"][0]["processID"], other[0]["processID"]} == {"plan"} and page["jobs"] != other
    assert requests.get(f"{url}/jobs", params={"datetime": "../2020-01-01T00:00:00Z"}).json()["jobs"] == []
    refused = requests.put(f"{url}/jobs")
    assert refused.status_code == 405 and refused.headers["Content-Type"] == "application/problem+json", refused.headers
    check("exception", refused.json())


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
