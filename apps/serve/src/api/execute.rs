//! Execution of processes.

use super::files::no_file;
use super::jobs::{results_document, status_info};
use super::request::{Form, Request};
use crate::answers::{Failure, encoded};
use crate::app::{App, Identity, blocking};
use crate::records::Kind;
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
    let Request { process, inputs, form, prefers_job } = Request::parse(&id, &headers, &body)?;
    let owner = identity.owner.clone();
    let job = blocking(&app, move |workshop| workshop.submit(&owner, process, &inputs)).await?;
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
        let (owner, id) = (identity.owner.clone(), job.id.clone());
        let found = blocking(&app, move |workshop| workshop.store.job(&owner, &id)).await?;
        job = found.ok_or_else(|| Failure::no_job(&job.id))?;
    }
    match job.status {
        Status::Successful => answer(&app, &job, form).await,
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

/// Results as a document, or, raw: a single JSON output as it is, others as links.
async fn answer(app: &Arc<App>, job: &Job, form: Form) -> Result<Response, Failure> {
    let files = job.result_files();
    if form == Form::Raw {
        if let [file] = files.as_slice()
            && file.path.ends_with(".json")
        {
            let (folder, path, most) = (job.folder.clone(), file.path.clone(), file.bytes);
            let read = move |workshop: &Workshop| workshop.store.read(Kind::Results, &folder, &path, most);
            let text = blocking(app, read).await?.ok_or_else(|| no_file(&file.path))?;
            return Ok(([(header::CONTENT_TYPE, "application/json")], text).into_response());
        }
        let links: Vec<String> = files
            .iter()
            .map(|file| format!("</jobs/{}/results/{}>; rel=\"item\"", job.id, encoded(&file.path)))
            .collect();
        return Ok((StatusCode::NO_CONTENT, [(header::LINK, links.join(", "))]).into_response());
    }
    let job = job.clone();
    let document = blocking(app, move |workshop| results_document(&job, &workshop.store)).await?;
    let location = format!("/jobs/{}", document.0);
    Ok((
        [(header::CONTENT_TYPE, "application/json".to_owned()), (header::CONTENT_LOCATION, location)],
        document.1.to_string(),
    )
        .into_response())
}
