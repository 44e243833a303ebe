//! Requirements of OGC API - Processes, Part 1: Core 1.0 (OGC 18-062r2) for the declared classes, with their
//! ids where sources agree on them.

use crate::client::{Answer, Service};
use serde_json::{Value, json};

/// A plan over level ground, which is computed at once.
fn plan() -> Value {
    json!({
        "kind": "airborne", "scanner": "riegl_vux-1uav", "scene": "terrain/scene.xml", "height": 60, "density": 4, "overlap": 20,
        "area": { "type": "Polygon", "crs": null, "coordinates": [[[-20, -20], [20, -20], [20, 20], [-20, 20], [-20, -20]]] },
    })
}

fn with_terrain() -> Service {
    let service = Service::start(&[]);
    service.upload_fixture("terrain");
    service
}

/// Executes a process by a whole request.
fn execute(service: &Service, process: &str, request: &Value) -> Answer {
    service.post_json(&format!("/processes/{process}/execution"), request, &[])
}

/// Asserts that an answer is a problem of this status.
fn assert_problem(answer: &Answer, status: u16, about: &str) {
    assert_eq!(
        (answer.status, answer.header("content-type")),
        (status, "application/problem+json"),
        "{about}"
    );
    let problem = answer.json();
    assert_eq!(problem["status"], status, "{about}");
    for key in ["type", "title", "detail"] {
        assert!(problem[key].as_str().is_some_and(|text| !text.is_empty()), "{about}: {problem}");
    }
}

/// The address of a link of a document, if it has one of this relation.
fn link(document: &Value, rel: &str) -> Option<String> {
    let links = document["links"].as_array().unwrap();
    links.iter().find(|link| link["rel"] == rel).map(|link| link["href"].as_str().unwrap().to_owned())
}

// /req/core/landingpage-success, /req/core/conformance-success, /req/core/api-definition-success
#[test]
fn the_landing_page_links_what_the_service_declares() {
    let service = Service::start(&["--workers", "0"]);
    let landing = service.json("/");
    for (rel, key) in [
        ("service-desc", "openapi"),
        ("http://www.opengis.net/def/rel/ogc/1.0/conformance", "conformsTo"),
        ("http://www.opengis.net/def/rel/ogc/1.0/processes", "processes"),
        ("http://www.opengis.net/def/rel/ogc/1.0/job-list", "jobs"),
    ] {
        let linked = service.json(&link(&landing, rel).unwrap());
        assert!(!linked[key].is_null(), "{rel}: {linked}");
    }
    let declared = service.json("/conformance")["conformsTo"].clone();
    for class in ["core", "ogc-process-description", "json", "oas30", "job-list", "dismiss"] {
        let uri = format!("http://www.opengis.net/spec/ogcapi-processes-1/1.0/conf/{class}");
        assert!(declared.as_array().unwrap().contains(&json!(uri)), "{class}: {declared}");
    }
}

// /req/core/pl-limit-definition, /req/core/pl-limit-response, /req/core/pl-links
#[test]
fn the_list_of_processes_has_at_most_as_many_as_its_limit() {
    let service = Service::start(&["--workers", "0"]);
    let all = service.json("/processes");
    assert_eq!(
        (all["processes"].as_array().unwrap().len(), link(&all, "self").unwrap().as_str()),
        (7, "/processes")
    );
    let some = service.json("/processes?limit=3");
    assert_eq!(some["processes"].as_array().unwrap().len(), 3);
    assert_eq!(link(&some, "self").unwrap(), "/processes?limit=3");
    assert_eq!(service.json("/processes?limit=10000")["processes"].as_array().unwrap().len(), 7);
    for limit in ["0", "10001", "-1", "x", ""] {
        assert_problem(&service.get(&format!("/processes?limit={limit}")), 400, limit);
    }
}

// /req/core/process-exception/no-such-process, /req/core/job-exception-no-such-job,
// /req/core/job-results-exception/no-such-job, /req/core/job-results-exception/results-not-ready
#[test]
fn exceptions_have_the_types_of_the_standard() {
    let service = Service::start(&["--workers", "0"]);
    service.upload_fixture("room");
    let id = service.submit("run", &json!({ "survey": "room/survey.xml" }));
    let waiting = format!("/jobs/{id}/results");
    for (method, path, kind) in [
        ("GET", "/processes/nothing", "no-such-process"),
        ("POST", "/processes/nothing/execution", "no-such-process"),
        ("GET", "/jobs/nothing", "no-such-job"),
        ("DELETE", "/jobs/nothing", "no-such-job"),
        ("GET", "/jobs/nothing/results", "no-such-job"),
        ("GET", waiting.as_str(), "result-not-ready"),
    ] {
        let answer = service.ask(method, path, &[("Content-Type", "application/json")], b"{}");
        assert_problem(&answer, 404, path);
        let expected = format!("http://www.opengis.net/def/exceptions/ogcapi-processes-1/1.0/{kind}");
        assert_eq!(answer.json()["type"], expected, "{method} {path}");
    }
}

// /req/core/http: an error of any origin is a document that programs read.
#[test]
fn every_error_is_a_problem() {
    let service = Service::start(&["--workers", "0"]);
    assert_eq!(service.upload("a", &[("a.obj", b"v 0 0 0\n".to_vec())]).status, 201);
    let json_type = ("Content-Type", "application/json");
    let large = " ".repeat(2 << 20);
    for (method, path, headers, body, status) in [
        ("GET", "/nothing", vec![], "", 404),
        ("PUT", "/jobs", vec![], "", 405),
        ("DELETE", "/processes", vec![], "", 405),
        ("GET", "/processes/plan/execution", vec![], "", 405),
        ("POST", "/processes/plan/execution", vec![json_type], large.as_str(), 413),
        ("POST", "/processes/plan/execution", vec![("Content-Type", "text/plain")], "{}", 415),
        ("POST", "/processes/plan/execution", vec![json_type], "{", 400),
        ("POST", "/processes/plan/execution", vec![json_type], "[]", 400),
        ("POST", "/uploads", vec![json_type], "{}", 415),
        ("GET", "/jobs/%ff", vec![], "", 400),
        ("GET", "/jobs?limit=1&unknown=2", vec![], "", 400),
        ("GET", "/uploads/a/files/a.obj", vec![("Range", "bytes=99-")], "", 416),
    ] {
        let answer = service.ask(method, path, &headers, body.as_bytes());
        assert_problem(&answer, status, &format!("{method} {path}"));
        if status == 405 {
            assert!(!answer.header("allow").is_empty(), "{method} {path}");
        }
    }
    assert_problem(
        &service.ask_stranger("GET", "/jobs", &[("Host", "example.org")], b""),
        421,
        "a foreign name",
    );
}

// Core: the execution mode, and the answer to an asynchronous request.
#[test]
fn preferences_choose_between_results_and_a_job() {
    let service = with_terrain();
    let request = json!({ "inputs": plan() });
    for (prefer, is_job) in [
        ("", false),
        ("wait=10", false),
        ("note=\"x, respond-async\"", false),
        ("respond-async", true),
        ("Respond-Async; wait=1", true),
        ("wait=1, respond-async", true),
    ] {
        let headers = [("Prefer", prefer)];
        let answer = service.post_json("/processes/plan/execution", &request, &headers);
        assert_eq!(answer.status, if is_job { 201 } else { 200 }, "{prefer}: {}", answer.text());
        if is_job {
            let id = answer.json()["jobID"].as_str().unwrap().to_owned();
            assert_eq!(answer.header("location"), format!("/jobs/{id}"), "{prefer}");
            assert_eq!(answer.header("preference-applied"), "respond-async", "{prefer}");
            service.wait(&id);
        }
    }
}

// Core: answers to synchronous requests for one output, raw or in a document, by value or by reference.
#[test]
fn an_output_is_the_answer_a_link_or_in_a_document() {
    let service = with_terrain();
    let of = |response: Value, mode: Value| {
        let mut request = json!({ "inputs": plan() });
        if !response.is_null() {
            request["response"] = response;
        }
        if !mode.is_null() {
            request["outputs"] = json!({ "plan.toml": { "transmissionMode": mode } });
        }
        execute(&service, "plan", &request)
    };
    let document = of(json!("document"), Value::Null);
    let text = service.get(document.json()["plan.toml"]["href"].as_str().unwrap()).text();
    assert!(text.contains("scene = "), "{text}");
    // The value of one output, which is the default of everything.
    for (response, mode) in [
        (Value::Null, Value::Null),
        (json!("raw"), Value::Null),
        (json!("raw"), json!("value")),
        (Value::Null, json!("value")),
    ] {
        let raw = of(response, mode);
        assert_eq!((raw.status, raw.header("content-type")), (200, "application/toml"));
        assert_eq!(raw.text(), text);
    }
    let linked = of(json!("raw"), json!("reference"));
    assert_eq!((linked.status, linked.text().as_str()), (204, ""));
    let field = linked.header("link");
    let address = field.strip_prefix('<').and_then(|rest| rest.split_once('>')).unwrap().0;
    assert!(field.ends_with("; rel=\"item\"") && service.get(address).text() == text, "{field}");
    let value = of(json!("document"), json!("value")).json();
    assert_eq!(value, json!({ "plan.toml": { "value": text, "mediaType": "application/toml" } }));
    let reference = of(json!("document"), json!("reference")).json();
    assert!(reference["plan.toml"]["href"].is_string(), "{reference}");
}

// Core: raw answers of several outputs; /req/core/job-results-async-raw-value-one,
// /req/core/job-results-async-raw-ref, /req/core/job-results-async-document
#[test]
fn several_outputs_are_parts_and_jobs_answer_in_the_form_of_their_request() {
    let service = with_terrain();
    let planned = service.execute("plan", &plan()).json();
    let file =
        planned["plan.toml"]["href"].as_str().unwrap().trim_start_matches('/').replace("/results/", "/");
    let job = |request: &Value| {
        let answer = execute(&service, "run", request);
        assert_eq!(answer.status, 201, "{}", answer.text());
        let id = answer.json()["jobID"].as_str().unwrap().to_owned();
        assert_eq!(service.wait(&id)["status"], "successful");
        id
    };
    let inputs = json!({ "pipeline": file, "seed": 7 });
    let id = job(&json!({ "inputs": inputs }));
    let raw = service.get(&format!("/jobs/{id}/results"));
    assert_eq!((raw.status, raw.header("content-type")), (200, "application/vnd.laszip"));
    assert!(raw.body.starts_with(b"LASF"));
    let by_reference = json!({ "points.laz": { "transmissionMode": "reference" } });
    let other = job(&json!({ "inputs": inputs, "outputs": by_reference }));
    let linked = service.get(&format!("/jobs/{other}/results"));
    assert_eq!(
        (linked.status, linked.header("link")),
        (204, format!("</jobs/{other}/results/points.laz>; rel=\"item\"").as_str())
    );
    let other = job(&json!({ "inputs": inputs, "response": "document" }));
    assert!(service.json(&format!("/jobs/{other}/results"))["points.laz"]["href"].is_string());

    let cloud = format!("jobs/{id}/points.laz");
    let compare = |outputs: Value| {
        execute(
            &service,
            "compare",
            &json!({ "inputs": { "first": cloud, "second": cloud }, "outputs": outputs }),
        )
    };
    let parts = compare(json!({}));
    let media = parts.header("content-type");
    assert!(parts.status == 200 && media.starts_with("multipart/related; boundary="), "{media}");
    let boundary = media.split(['=', ';']).nth(2).unwrap();
    let text = parts.text();
    assert_eq!(text.matches(&format!("--{boundary}\r\n")).count(), 2);
    assert!(text.ends_with(&format!("--{boundary}--\r\n")));
    for name in ["report.json", "report.html"] {
        assert!(text.contains(&format!("\r\nContent-ID: {name}\r\n")), "{name}");
    }
    let mixed =
        compare(json!({ "report.json": {}, "report.html": { "transmissionMode": "reference" } })).text();
    let address = mixed.split_once("\r\nContent-Location: ").unwrap().1.split_once("\r\n").unwrap().0;
    assert_eq!((mixed.matches("Content-Location").count(), service.get(address).status), (1, 200));
    let one = compare(json!({ "report.json": {} }));
    assert_eq!((one.status, one.header("content-type")), (200, "application/json"));
    let links = compare(json!({
        "report.json": { "transmissionMode": "reference" }, "report.html": { "transmissionMode": "reference" },
    }));
    assert_eq!((links.status, links.header("link").matches("rel=\"item\"").count()), (204, 2));
}

// The limit of lists; /req/job-list/links, /req/job-list/processID-definition,
// /req/job-list/status-definition, /req/job-list/type-definition
#[test]
fn lists_of_jobs_are_pages_whose_links_keep_their_filters() {
    let service = Service::start(&["--workers", "0"]);
    service.upload_fixture("room");
    for seed in 0..12 {
        service.submit("run", &json!({ "survey": "room/survey.xml", "seed": seed }));
    }
    let count = |list: &Value| list["jobs"].as_array().unwrap().len();
    let first = service.json("/jobs");
    assert_eq!((count(&first), link(&first, "prev")), (10, None));
    let second = service.json(&link(&first, "next").unwrap());
    assert_eq!((count(&second), link(&second, "next")), (2, None));
    assert_eq!(service.json(&link(&second, "prev").unwrap())["jobs"], first["jobs"]);
    let all = service.json("/jobs?limit=10000");
    assert_eq!((count(&all), link(&all, "next")), (12, None));
    // A page that ends with the last job has no next one.
    assert_eq!(link(&service.json("/jobs?limit=12"), "next"), None);
    let some = service.json("/jobs?type=process&processID=plan%2Crun&status=accepted,running&limit=5");
    let query = "processID=plan%2Crun&status=accepted%2Crunning&type=process";
    assert_eq!(count(&some), 5);
    assert_eq!(link(&some, "self").unwrap(), format!("/jobs?limit=5&{query}"));
    assert_eq!(link(&some, "next").unwrap(), format!("/jobs?limit=5&offset=5&{query}"));
    assert_eq!(link(&some, "alternate").unwrap(), format!("/jobs?f=html&limit=5&{query}"));
    for query in ["processID=plan", "status=failed", "status=running,successful"] {
        assert_eq!(count(&service.json(&format!("/jobs?{query}"))), 0, "{query}");
    }
    for query in ["limit=0", "limit=10001", "limit=ten", "status=lost", "type=provider", "offset=-1"] {
        assert_problem(&service.get(&format!("/jobs?{query}")), 400, query);
    }
}

// /req/job-list/datetime-definition, /req/job-list/datetime-response
#[test]
fn jobs_are_listed_by_the_time_of_their_acceptance() {
    let service = Service::start(&["--workers", "0"]);
    service.upload_fixture("room");
    let id = service.submit("run", &json!({ "survey": "room/survey.xml" }));
    let created = service.json(&format!("/jobs/{id}"))["created"].as_str().unwrap().to_owned();
    for (datetime, is_listed) in [
        (created.clone(), true),
        (format!("{created}/.."), true),
        (format!("{created}/"), true),
        (format!("../{created}"), true),
        (format!("..%2F{created}"), true),
        (format!("2020-01-01T00:00:00Z/{created}"), true),
        ("2020-01-01T00:00:00+01:00/..".to_owned(), true),
        ("2020-01-01T00:00:00Z".to_owned(), false),
        ("../2020-01-01T00:00:00Z".to_owned(), false),
        ("2020-01-01T00:00:00Z/2021-01-01T00:00:00Z".to_owned(), false),
        ("2999-01-01T00:00:00Z/..".to_owned(), false),
    ] {
        let list = service.json(&format!("/jobs?datetime={datetime}"));
        assert_eq!(list["jobs"].as_array().unwrap().len(), usize::from(is_listed), "{datetime}");
    }
    for datetime in ["", "..", "../..", "2020-01-01", "now", "2020-13-01T00:00:00Z", "a/b/c"] {
        assert_problem(&service.get(&format!("/jobs?datetime={datetime}")), 400, datetime);
    }
}

// /req/job-list/duration-definition, /req/job-list/duration-response
#[test]
fn jobs_are_listed_by_their_duration() {
    let service = Service::start(&[]);
    service.upload_fixture("room");
    let count = |query: &str| service.json(&format!("/jobs?{query}"))["jobs"].as_array().unwrap().len();
    let job = service.run("run", &json!({ "survey": "room/survey.xml" }));
    assert_eq!(job["status"], "successful", "{job}");
    for (query, expected) in [
        ("minDuration=0", 1),
        ("maxDuration=1000", 1),
        ("minDuration=0&maxDuration=1000", 1),
        ("minDuration=1000", 0),
        ("minDuration=0&maxDuration=1000&status=failed", 0),
    ] {
        assert_eq!(count(query), expected, "{query}");
    }
    for query in ["minDuration=-1", "maxDuration=1.5", "minDuration=PT1S"] {
        assert_problem(&service.get(&format!("/jobs?{query}")), 400, query);
    }
    // A job that waits has no duration.
    let waiting = Service::start(&["--workers", "0"]);
    waiting.upload_fixture("room");
    waiting.submit("run", &json!({ "survey": "room/survey.xml" }));
    assert_eq!(waiting.json("/jobs?minDuration=0")["jobs"], json!([]));
}

// /req/dismiss/job-dismiss-op, /req/dismiss/job-dismiss-success
#[test]
fn a_dismissed_job_says_so_and_has_no_results() {
    let service = Service::start(&["--workers", "0"]);
    service.upload_fixture("room");
    let id = service.submit("run", &json!({ "survey": "room/survey.xml" }));
    let dismissed = service.ask("DELETE", &format!("/jobs/{id}"), &[], b"");
    assert_eq!((dismissed.status, dismissed.json()["status"].as_str()), (200, Some("dismissed")));
    assert_eq!(dismissed.json()["jobID"], id.as_str());
    assert_problem(&service.get(&format!("/jobs/{id}/results")), 410, "results");
    assert_problem(&service.ask("DELETE", &format!("/jobs/{id}"), &[], b""), 410, "again");
}

// /req/oas30/oas-definition-1, /req/oas30/oas-impl, /req/ogc-process-description/json-encoding
#[test]
fn the_definition_has_what_the_service_takes() {
    let service = Service::start(&["--workers", "0"]);
    let definition = service.json("/api?f=json");
    let parameters = definition["paths"]["/jobs"]["get"]["parameters"].as_array().unwrap().clone();
    let named = |name: &str| parameters.iter().find(|parameter| parameter["name"] == name).cloned().unwrap();
    for name in ["type", "processID", "status", "datetime", "minDuration", "maxDuration", "limit", "offset"] {
        assert_eq!(named(name)["in"], "query", "{name}");
    }
    let limit = json!({ "type": "integer", "minimum": 1, "maximum": 10_000, "default": 10 });
    assert_eq!(named("limit")["schema"], limit);
    let response = &definition["components"]["schemas"]["execute"]["properties"]["response"];
    assert_eq!(response["default"], "raw");
    for (id, modes) in [("plan", json!(["value", "reference"])), ("campaign", json!(["reference"]))] {
        assert_eq!(service.json(&format!("/processes/{id}"))["outputTransmission"], modes, "{id}");
    }
    let refused = json!({ "outputs": { "dataset/manifest.jsonl": { "transmissionMode": "value" } } });
    assert_problem(&execute(&service, "campaign", &refused), 400, "a value of a process that has none");
}
