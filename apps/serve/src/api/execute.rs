//! Execution of processes.

use super::jobs::{find_state, find_successful, status_info};
use super::request::Request;
use super::results::answer;
use crate::answers::Failure;
use crate::app::{App, Identity, submitting};
use crate::store::{Job, Status};
use crate::worker::Workshop;
use axum::Extension;
use axum::body::Bytes;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time for which a request waits for results before it is answered with the job.
const MAX_WAIT: Duration = Duration::from_secs(30);
const POLL: Duration = Duration::from_millis(20);

pub async fn execute(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path(id): Path<String>,
    headers: HeaderMap,
    body: Bytes,
) -> Result<Response, Failure> {
    let Request { process, inputs, outputs, prefers_job } = Request::parse(&id, &headers, &body)?;
    let owner = identity.owner.clone();
    let submit = move |workshop: &Workshop| workshop.submit_for(&owner, process, &inputs, Some(outputs));
    let job = submitting(&app, &identity.owner, submit).await?;
    if prefers_job || !process.is_quick() {
        let mut response = created(&job);
        if prefers_job {
            response.headers_mut().insert("preference-applied", HeaderValue::from_static("respond-async"));
        }
        return Ok(response);
    }
    let start = Instant::now();
    let mut job = job;
    while !job.status.is_final() && start.elapsed() < MAX_WAIT {
        tokio::time::sleep(POLL).await;
        job = find_state(&app, &identity, &job.id).await?;
    }
    match job.status {
        // Fields of the request are about its execution, not about a file.
        Status::Successful => {
            let job = find_successful(&app, &identity, &job.id).await?;
            answer(&app, &job, &HeaderMap::new()).await
        }
        Status::Failed => Err(Failure::new(StatusCode::UNPROCESSABLE_ENTITY, job.message)),
        Status::Dismissed => Err(Failure::new(StatusCode::GONE, "the job was dismissed")),
        Status::Accepted | Status::Running => Ok(created(&job)),
    }
}

/// The answer that names a job.
fn created(job: &Job) -> Response {
    let location = format!("/jobs/{}", job.id);
    let body = status_info(job).to_string();
    (
        StatusCode::CREATED,
        [(header::LOCATION, location), (header::CONTENT_TYPE, "application/json".to_owned())],
        body,
    )
        .into_response()
}
