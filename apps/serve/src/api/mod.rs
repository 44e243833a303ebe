//! The interface for programs: OGC API - Processes, Part 1: Core 1.0 (OGC 18-062r2), with uploads beside it.
//!
//! | file | what it answers |
//! |---|---|
//! | `describe` | landing page, conformance, processes |
//! | `openapi` | the definition of the interface |
//! | `request`, `execute` | requests for executions, and their answers |
//! | `results` | results: documents, outputs as they are, links |
//! | `jobs` | jobs, their list and progress |
//! | `files` | files of results and uploads, in whole or in part |
//! | `received` | uploads |

mod describe;
mod execute;
mod files;
mod jobs;
mod openapi;
mod received;
mod request;
mod results;

use crate::answers::Failure;
use crate::app::App;
use crate::config::ServeArgs;
use crate::query::Parameters;
use axum::Router;
use axum::extract::{DefaultBodyLimit, Request};
use axum::http::StatusCode;
use axum::middleware::{Next, from_fn};
use axum::response::{IntoResponse as _, Response};
use axum::routing::{get, post};
use std::sync::Arc;

/// Largest request without files, bytes.
const MAX_REQUEST: usize = 1 << 20;
/// Bytes that forms add to the files of an upload.
const FORM_OVERHEAD: u64 = 8 << 20;

/// The addresses of the interface.
pub fn router(limits: &ServeArgs) -> Router<Arc<App>> {
    let upload = usize::try_from(limits.max_upload.saturating_add(FORM_OVERHEAD)).unwrap_or(usize::MAX);
    Router::new()
        .route("/", get(describe::landing))
        .route("/conformance", get(describe::conformance))
        .route("/api", get(openapi::definition))
        .route("/processes", get(describe::processes))
        .route("/processes/{id}", get(describe::process))
        .route("/processes/{id}/execution", post(execute::execute))
        .route("/jobs", get(jobs::list))
        .route("/jobs/{id}", get(jobs::status).delete(jobs::dismiss))
        .route("/jobs/{id}/results", get(results::results))
        .route("/jobs/{id}/results/{*path}", get(files::result))
        .route("/jobs/{id}/view/{name}", get(files::view))
        .route("/jobs/{id}/events", get(jobs::events))
        .route("/uploads/{name}", get(received::show).delete(received::remove))
        .route("/uploads/{name}/files/{*path}", get(files::uploaded))
        .layer(DefaultBodyLimit::max(MAX_REQUEST))
        .merge(
            Router::new()
                .route("/uploads", get(received::list).post(received::receive))
                .layer(DefaultBodyLimit::max(upload)),
        )
        .layer(from_fn(check_parameters))
}

/// Refuses parameters that an address does not have.
async fn check_parameters(request: Request, next: Next) -> Response {
    let address = request.uri();
    match Parameters::of(address.query(), known_parameters(address.path())) {
        Ok(parameters) if matches!(parameters.get("f"), None | Some("json" | "html")) => {
            next.run(request).await
        }
        Ok(_) => Failure::new(StatusCode::BAD_REQUEST, "f: expected json or html").into_response(),
        Err(failure) => failure.into_response(),
    }
}

/// The parameters of lists of jobs.
const OF_JOBS: [&str; 9] =
    ["f", "status", "processID", "type", "datetime", "minDuration", "maxDuration", "limit", "offset"];

fn known_parameters(path: &str) -> &'static [&'static str] {
    let parts: Vec<&str> = path.trim_matches('/').split('/').collect();
    match parts.as_slice() {
        ["jobs"] => &OF_JOBS,
        ["jobs" | "uploads", _] => &["f", "points"],
        ["processes"] => &["f", "limit"],
        _ => &["f"],
    }
}

/// The answer to addresses that the service does not have.
pub async fn absent() -> Failure {
    Failure::new(StatusCode::NOT_FOUND, "the service has no such address; / lists what it has")
}
