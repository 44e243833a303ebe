//! The interface for programs: OGC API - Processes, Part 1: Core 1.0 (OGC 18-062r2), with uploads beside it.
//!
//! | file | what it answers |
//! |---|---|
//! | `describe` | landing page, conformance, processes |
//! | `openapi` | the definition of the interface |
//! | `execute` | execution of processes |
//! | `jobs` | jobs, their results and progress |
//! | `files` | files of results and uploads, in whole or in part |
//! | `received` | uploads |

mod describe;
mod execute;
mod files;
mod jobs;
mod openapi;
mod received;

use crate::answers::Failure;
use crate::app::App;
use crate::config::ServeArgs;
use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::StatusCode;
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
        .route("/jobs/{id}/results", get(jobs::results))
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
}

/// The answer to addresses that the service does not have.
pub async fn absent() -> Failure {
    Failure::new(StatusCode::NOT_FOUND, "the service has no such address; / lists what it has")
}
