//! The definition of the interface, OpenAPI 3.0.

use crate::answers::{document, wants_page};
use crate::app::{App, Identity};
use crate::pages;
use crate::processes::Process;
use crate::query::{DEFAULT_LISTED, MAX_LISTED};
use axum::Extension;
use axum::extract::{RawQuery, State};
use axum::http::HeaderMap;
use axum::response::Response;
use serde_json::{Map, Value, json};
use std::sync::Arc;

pub async fn definition(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    match wants_page(&headers, query.as_deref()) {
        true => pages::interface(&app, &identity, &definition_of(&app)),
        false => document(&definition_of(&app)),
    }
}

fn reference(name: &str) -> Value {
    json!({ "$ref": format!("#/components/schemas/{name}") })
}

fn answer(about: &str, media: &str, schema: &Value) -> Value {
    json!({ "description": about, "content": { media: { "schema": schema } } })
}

fn failure(about: &str) -> Value {
    answer(about, "application/problem+json", &reference("exception"))
}

fn in_path(name: &str) -> Value {
    json!({ "name": name, "in": "path", "required": true, "schema": { "type": "string" } })
}

fn in_query(name: &str, about: &str, schema: &Value) -> Value {
    json!({ "name": name, "in": "query", "required": false, "description": about, "schema": schema })
}

/// An operation: summary, answers by status, and what else it has.
fn operation(id: &str, summary: &str, answers: &[(&str, Value)], more: Value) -> Value {
    let mut operation = json!({ "operationId": id, "summary": summary });
    let answers = answers.iter().map(|(status, answer)| ((*status).to_owned(), answer.clone()));
    let others = ("default".to_owned(), failure("Any other error"));
    operation["responses"] = Value::Object(answers.chain([others]).collect());
    if let Value::Object(more) = more {
        more.into_iter().for_each(|(key, value)| operation[key] = value);
    }
    operation
}

/// Media type of JSON.
const JSON: &str = "application/json";

/// An answer in JSON by a schema of the definition.
fn as_json(about: &str, schema: &str) -> Value {
    answer(about, JSON, &reference(schema))
}

fn no_job() -> (&'static str, Value) {
    ("404", failure("There is no such job"))
}

/// The schema of the length of a list.
fn limit() -> Value {
    json!({ "type": "integer", "minimum": 1, "maximum": MAX_LISTED, "default": DEFAULT_LISTED })
}

/// Results in all their forms.
fn results() -> Value {
    json!({ "description": "Results", "content": {
        JSON: { "schema": {} },
        "multipart/related": { "schema": bytes() },
        "*/*": { "schema": bytes() },
    } })
}

/// Raw results that are given by reference.
fn linked() -> (&'static str, Value) {
    ("204", json!({ "description": "Results by reference: fields `Link` with the relation `item`" }))
}

/// The answer to `If-None-Match`.
fn unchanged() -> (&'static str, Value) {
    ("304", json!({ "description": "The sender has the file already" }))
}

/// The schema of the content of a file.
fn bytes() -> Value {
    json!({ "type": "string", "format": "binary" })
}

/// The paths of the service and its processes.
fn process_paths() -> Value {
    json!({
        "/": { "get": operation("getLandingPage", "What the service offers", &[("200", as_json("Landing page", "landingPage"))], Value::Null) },
        "/conformance": { "get": operation("getConformance", "Conformance classes", &[("200", as_json("Classes", "confClasses"))], Value::Null) },
        "/api": { "get": operation("getApi", "This definition", &[("200", answer("Definition", "application/vnd.oai.openapi+json;version=3.0", &json!({ "type": "object" })))], Value::Null) },
        "/processes": { "get": operation("getProcesses", "All processes", &[("200", as_json("Processes", "processList"))], json!({ "parameters": [
            in_query("limit", "Most processes", &limit()),
        ] })) },
        "/processes/{processID}": { "get": operation(
            "getProcessDescription", "Inputs and outputs of a process",
            &[("200", as_json("Description", "process")), ("404", failure("There is no such process"))],
            json!({ "parameters": [in_path("processID")] }),
        ) },
    })
}

/// The paths of jobs.
fn job_paths() -> Value {
    json!({
        "/jobs": { "get": operation("getJobs", "Jobs, newest first", &[("200", as_json("Jobs", "jobList"))], json!({ "parameters": [
            in_query("status", "States, separated by commas", &json!({ "type": "array", "items": reference("statusCode") })),
            in_query("processID", "Processes, separated by commas", &json!({ "type": "array", "items": { "type": "string" } })),
            in_query("type", "Types of jobs", &json!({ "type": "array", "items": { "type": "string", "enum": ["process"] } })),
            in_query("datetime", "Time of acceptance, or START/END, where .. is an open end", &json!({ "type": "string" })),
            in_query("minDuration", "Shortest duration, seconds", &json!({ "type": "integer", "minimum": 0 })),
            in_query("maxDuration", "Longest duration, seconds", &json!({ "type": "integer", "minimum": 0 })),
            in_query("limit", "Most jobs", &limit()),
            in_query("offset", "Jobs to leave out", &json!({ "type": "integer", "minimum": 0, "default": 0 })),
        ] })) },
        "/jobs/{jobId}": {
            "get": operation("getStatus", "State of a job", &[("200", as_json("State", "statusInfo")), no_job()], json!({ "parameters": [in_path("jobId")] })),
            "delete": operation(
                "dismiss", "Give a job up, and remove its results",
                &[("200", as_json("State", "statusInfo")), no_job(), ("410", failure("It was dismissed already"))],
                json!({ "parameters": [in_path("jobId")] }),
            ),
        },
        "/jobs/{jobId}/results": { "get": operation(
            "getResult", "Results of a job in the form that its request names: the output itself, several as parts, or a document",
            &[("200", results()), linked(), ("404", failure("No such job, or no results yet")), ("422", failure("The job has failed"))],
            json!({ "parameters": [in_path("jobId")] }),
        ) },
        "/jobs/{jobId}/results/{path}": { "get": operation(
            "getResultFile", "A file of results; ranges of bytes are understood",
            &[("200", answer("File", "application/octet-stream", &bytes())), ("206", answer("Part", "application/octet-stream", &bytes())), unchanged(), no_job()],
            json!({ "parameters": [in_path("jobId"), in_path("path")] }),
        ) },
        "/jobs/{jobId}/events": { "get": operation(
            "getEvents", "State of a job whenever it changes, as server-sent events",
            &[("200", answer("Events named after the state, with the data of statusInfo", "text/event-stream", &json!({ "type": "string" }))), no_job()],
            json!({ "parameters": [in_path("jobId")] }),
        ) },
    })
}

/// The paths of uploads.
fn upload_paths() -> Value {
    json!({
        "/uploads": {
            "get": operation("getUploads", "Uploads", &[("200", answer("Uploads", JSON, &json!({ "type": "object" })))], Value::Null),
            "post": operation(
                "upload", "Upload files under a name; a single zip archive is expanded",
                &[("201", answer("Upload", JSON, &json!({ "type": "object" }))), ("409", failure("The name is taken")), ("413", failure("Too large"))],
                json!({ "requestBody": { "required": true, "content": { "multipart/form-data": { "schema": {
                    "type": "object",
                    "properties": { "name": { "type": "string" }, "file": { "type": "array", "items": bytes() },
                        "taken": { "type": "string", "enum": ["number"], "description": "Adds a number to a name that is taken" } },
                } } } } }),
            ),
        },
        "/uploads/{name}": {
            "get": operation("getUpload", "An upload and its files", &[("200", answer("Upload", JSON, &json!({ "type": "object" }))), ("404", failure("There is none"))], json!({ "parameters": [in_path("name")] })),
            "delete": operation("removeUpload", "Remove an upload", &[("204", json!({ "description": "Removed" })), ("404", failure("There is none"))], json!({ "parameters": [in_path("name")] })),
        },
        "/uploads/{name}/files/{path}": { "get": operation(
            "getUploadedFile", "A file of an upload; ranges of bytes are understood",
            &[("200", answer("File", "application/octet-stream", &bytes())), ("206", answer("Part", "application/octet-stream", &bytes())), unchanged(), ("404", failure("There is none"))],
            json!({ "parameters": [in_path("name"), in_path("path")] }),
        ) },
    })
}

/// The path of the execution of a process, and its operation.
fn execution(process: Process, app: &App) -> (String, Value) {
    let path = format!("/processes/{}/execution", process.id());
    let mut answers = vec![
        (
            "201",
            as_json("The job, where `Prefer: respond-async` is given or results take long", "statusInfo"),
        ),
        ("400", failure("The inputs are not as the process takes them")),
        ("415", failure("The request is not JSON")),
        ("429", failure("Too many jobs wait")),
    ];
    if process.is_quick() {
        answers.extend([("200", results()), linked()]);
        answers.push(("422", failure("The computation failed")));
    }
    let inputs = process.description(&app.workshop.program)["inputs"].clone();
    let properties: Map<String, Value> = inputs
        .as_object()
        .into_iter()
        .flatten()
        .map(|(key, input)| (key.clone(), described(input)))
        .collect();
    let mut schema = reference("execute");
    schema = json!({ "allOf": [schema, { "type": "object", "properties": { "inputs": { "type": "object", "properties": properties } } }] });
    let prefer = json!({ "name": "Prefer", "in": "header", "required": false, "description": "`respond-async` for a job", "schema": { "type": "string" } });
    let more = json!({ "parameters": [prefer], "requestBody": { "required": true, "content": { JSON: { "schema": schema } } } });
    (
        path,
        json!({ "post": operation(&format!("execute-{}", process.id()), process.title(), &answers, more) }),
    )
}

/// The whole definition.
pub fn definition_of(app: &App) -> Value {
    let parts = [process_paths(), job_paths(), upload_paths()];
    let objects = parts.into_iter().filter_map(|part| match part {
        Value::Object(part) => Some(part),
        _ => None,
    });
    let mut paths: Map<String, Value> = objects.flatten().collect();
    paths.extend(Process::ALL.map(|process| execution(process, app)));
    json!({
        "openapi": "3.0.3",
        "info": {
            "title": "vlscan",
            "version": app.workshop.program.version,
            "description": "Virtual laser scanning by OGC API - Processes, Part 1: Core 1.0",
            "license": { "name": "MIT OR Apache-2.0" },
        },
        "servers": [{ "url": "/" }],
        "security": if app.tokens.is_empty() { json!([]) } else { json!([{ "token": [] }]) },
        "paths": paths,
        "components": { "securitySchemes": { "token": { "type": "http", "scheme": "bearer" } }, "schemas": schemas() },
    })
}

fn described(input: &Value) -> Value {
    let mut schema = input["schema"].clone();
    if schema.get("description").is_none() {
        schema["description"] = input["description"].clone();
    }
    schema
}

/// The documents of the standard.
fn schemas() -> Value {
    let text = json!({ "type": "string" });
    let time = json!({ "type": "string", "format": "date-time" });
    let list = |name: &str| json!({ "type": "array", "items": reference(name) });
    json!({
        "link": { "type": "object", "required": ["href"], "properties": { "href": text, "rel": text, "type": text, "hreflang": text, "title": text } },
        "landingPage": { "type": "object", "required": ["links"], "properties": { "title": text, "description": text, "links": list("link") } },
        "confClasses": { "type": "object", "required": ["conformsTo"], "properties": { "conformsTo": { "type": "array", "items": text } } },
        "processSummary": { "type": "object", "required": ["id", "version"], "properties": {
            "id": text, "version": text, "title": text, "description": text,
            "jobControlOptions": { "type": "array", "items": { "type": "string", "enum": ["sync-execute", "async-execute", "dismiss"] } },
            "outputTransmission": { "type": "array", "items": { "type": "string", "enum": ["value", "reference"] } },
            "links": list("link"),
        } },
        "processList": { "type": "object", "required": ["processes", "links"], "properties": { "processes": list("processSummary"), "links": list("link") } },
        "process": { "allOf": [reference("processSummary"), { "type": "object", "properties": {
            "inputs": { "type": "object", "additionalProperties": { "type": "object", "required": ["schema"] } },
            "outputs": { "type": "object", "additionalProperties": { "type": "object", "required": ["schema"] } },
        } }] },
        "execute": { "type": "object", "properties": {
            "inputs": { "type": "object" },
            "outputs": { "type": "object", "additionalProperties": { "type": "object", "properties": {
                "format": { "type": "object" },
                "transmissionMode": { "type": "string", "enum": ["value", "reference"] },
            } } },
            "response": { "type": "string", "enum": ["raw", "document"], "default": "raw" },
        } },
        "statusCode": { "type": "string", "enum": ["accepted", "running", "successful", "failed", "dismissed"] },
        "statusInfo": { "type": "object", "required": ["jobID", "status", "type"], "properties": {
            "processID": text, "type": { "type": "string", "enum": ["process"] }, "jobID": text, "status": reference("statusCode"), "message": text,
            "warnings": { "type": "array", "items": { "type": "object" } },
            "created": time, "started": time, "finished": time, "updated": time,
            "progress": { "type": "integer", "minimum": 0, "maximum": 100 }, "links": list("link"),
        } },
        "jobList": { "type": "object", "required": ["jobs", "links"], "properties": { "jobs": list("statusInfo"), "links": list("link") } },
        "results": { "type": "object", "additionalProperties": { "type": "object" } },
        "exception": { "type": "object", "required": ["type"], "properties": {
            "type": text, "title": text, "status": { "type": "integer" }, "detail": text, "instance": text,
        } },
    })
}
