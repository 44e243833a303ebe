//! Description of the service: landing page, conformance, processes.

use crate::answers::{Failure, document, link, wants_page};
use crate::app::{App, Identity};
use crate::pages;
use crate::processes::Process;
use crate::query::{DEFAULT_LISTED, MAX_LISTED, Parameters};
use axum::Extension;
use axum::extract::{Path, RawQuery, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use serde_json::json;
use std::sync::Arc;

/// The conformance classes of OGC API - Processes that the service meets.
const CLASSES: [&str; 6] = ["core", "ogc-process-description", "json", "oas30", "job-list", "dismiss"];

pub async fn landing(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    if wants_page(&headers, query.as_deref()) {
        return pages::home(&app, &identity).await;
    }
    let json = "application/json";
    Ok(document(&json!({
        "title": "vlscan",
        "description": "Virtual laser scanning as a service",
        "links": [
            link("/?f=json", "self", json, "This document"),
            link("/?f=html", "alternate", "text/html", "Pages for a browser"),
            link("/api?f=json", "service-desc", "application/vnd.oai.openapi+json;version=3.0", "Definition of the interface"),
            link("/api?f=html", "service-doc", "text/html", "Documentation of the interface"),
            link("/conformance", "http://www.opengis.net/def/rel/ogc/1.0/conformance", json, "Conformance"),
            link("/processes", "http://www.opengis.net/def/rel/ogc/1.0/processes", json, "Processes"),
            link("/jobs", "http://www.opengis.net/def/rel/ogc/1.0/job-list", json, "Jobs"),
            link("/uploads", "related", json, "Uploads"),
        ],
    })))
}

pub async fn conformance() -> Response {
    let uri = |class: &&str| format!("http://www.opengis.net/spec/ogcapi-processes-1/1.0/conf/{class}");
    document(&json!({ "conformsTo": CLASSES.iter().map(uri).collect::<Vec<_>>() }))
}

pub async fn processes(State(app): State<Arc<App>>, RawQuery(query): RawQuery) -> Result<Response, Failure> {
    let parameters = Parameters::of(query.as_deref(), &["f", "limit"])?;
    let limit = match parameters.get("limit") {
        None => DEFAULT_LISTED,
        Some(limit) => {
            let number = limit.parse::<u32>().ok().filter(|limit| (1..=MAX_LISTED).contains(limit));
            number.ok_or_else(|| {
                let message =
                    format!("limit: expected a whole number from 1 to {MAX_LISTED}, found `{limit}`");
                Failure::new(StatusCode::BAD_REQUEST, message)
            })?
        }
    };
    let shown = Process::ALL.iter().take(limit as usize);
    let summaries: Vec<_> = shown.map(|process| process.summary(&app.workshop.program)).collect();
    Ok(document(&json!({
        "processes": summaries,
        "links": [link(&parameters.address("/processes"), "self", "application/json", "This document")],
    })))
}

pub async fn process(State(app): State<Arc<App>>, Path(id): Path<String>) -> Result<Response, Failure> {
    let process = Process::named(&id).ok_or_else(|| Failure::no_process(&id))?;
    Ok(document(&process.description(&app.workshop.program)))
}
