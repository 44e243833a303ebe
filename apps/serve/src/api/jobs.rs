//! Jobs: list, state, results, progress, dismissal.

use super::OF_JOBS;
use crate::answers::{Failure, document, encoded, link, media_type, wants_page};
use crate::app::{App, Identity, blocking};
use crate::pages;
use crate::query::Parameters;
use crate::records::Kind;
use crate::store::{Job, Listed, Result as StoreResult, Status, Store, time_text};
use axum::Extension;
use axum::extract::{Path, Query, RawQuery, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse as _, Response};
use futures_util::stream;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Largest JSON output that results contain as a value, bytes.
const MAX_VALUE: u64 = 4 << 20;
const EVENT_PERIOD: Duration = Duration::from_millis(500);
/// Longest time of a stream of progress.
const MAX_STREAM: Duration = Duration::from_secs(3600);
const MAX_LISTED: u32 = 1000;

/// The state of a job, as the standard has it.
pub fn status_info(job: &Job) -> Value {
    let own = format!("/jobs/{}", job.id);
    let mut links = vec![
        link(&own, "self", "application/json", "This job"),
        link(&format!("{own}/events"), "monitor", "text/event-stream", "Progress"),
    ];
    if job.status == Status::Successful {
        links.push(link(
            &format!("{own}/results"),
            "http://www.opengis.net/def/rel/ogc/1.0/results",
            "application/json",
            "Results",
        ));
    }
    let mut info = json!({
        "jobID": job.id,
        "processID": job.process,
        "type": "process",
        "status": job.status.name(),
        "progress": job.progress,
        "created": time_text(job.created),
        "updated": time_text(job.updated),
        "links": links,
    });
    if !job.message.is_empty() {
        info["message"] = json!(job.message);
    }
    let warnings = job.problems();
    if !warnings.is_empty() {
        info["warnings"] = json!(warnings);
    }
    for (key, time) in [("started", job.started), ("finished", job.finished)] {
        if let Some(time) = time {
            info[key] = json!(time_text(time));
        }
    }
    info
}

/// The results of a job: JSON as values, other files as links. With the job's id.
///
/// # Errors
/// Errors of reading.
pub fn results_document(job: &Job, store: &Store) -> StoreResult<(String, Value)> {
    let mut results = Map::new();
    for file in job.result_files() {
        let is_value = file.path.ends_with(".json") && file.bytes <= MAX_VALUE;
        let read = || store.read(Kind::Results, &job.folder, &file.path, MAX_VALUE);
        let value = match is_value.then(read).transpose()?.flatten() {
            Some(bytes) => {
                let value: Option<Value> = serde_json::from_slice(&bytes).ok();
                value.map(|value| json!({ "value": value, "mediaType": "application/json" }))
            }
            None => None,
        };
        let href = format!("/jobs/{}/results/{}", job.id, encoded(&file.path));
        let linked = || json!({ "href": href, "rel": "item", "type": media_type(&file.path), "title": format!("{} bytes", file.bytes) });
        results.insert(file.path.clone(), value.unwrap_or_else(linked));
    }
    Ok((job.id.clone(), Value::Object(results)))
}

/// Parameters of a query.
#[derive(Debug)]
struct Filter {
    statuses: Vec<Status>,
    processes: Vec<String>,
    limit: u32,
    offset: u32,
}

impl Filter {
    fn of(parameters: &Parameters) -> Result<Filter, Failure> {
        let wrong = |key: &str, value: &str| {
            Failure::new(StatusCode::BAD_REQUEST, format!("{key}: `{value}` is not known"))
        };
        let list = |key: &str| parameters.get(key).into_iter().flat_map(|value| value.split(','));
        let status = |name: &str| Status::named(name).ok_or_else(|| wrong("status", name));
        let number = |key: &str, default: u32, range: RangeInclusive<u32>| match parameters.get(key) {
            None => Ok(default),
            Some(value) => {
                value.parse::<u32>().ok().filter(|n| range.contains(n)).ok_or_else(|| wrong(key, value))
            }
        };
        if let Some(kind) = parameters.get("type").filter(|kind| *kind != "process") {
            return Err(wrong("type", kind));
        }
        Ok(Filter {
            statuses: list("status").map(status).collect::<Result<_, _>>()?,
            processes: list("processID").map(str::to_owned).collect(),
            limit: number("limit", 100, 1..=MAX_LISTED)?,
            offset: number("offset", 0, 0..=u32::MAX)?,
        })
    }
}

pub async fn list(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    let is_page = wants_page(&headers, query.as_deref());
    let parameters = Parameters::of(query.as_deref(), &OF_JOBS)?;
    let filter = Filter::of(&parameters)?;
    let owner = identity.owner.clone();
    let limit = filter.limit;
    let next = filter.offset.saturating_add(limit).to_string();
    let next = format!("/jobs?{}", parameters.with("offset", &next));
    let jobs = blocking(&app, move |workshop| {
        workshop.store.jobs(
            Listed::States,
            &owner,
            &filter.statuses,
            &filter.processes,
            filter.offset,
            filter.limit,
        )
    })
    .await?;
    if is_page {
        let next = (jobs.len() == limit as usize).then_some(next.as_str());
        let shown = jobs.into_iter().filter(|job| job.status != Status::Dismissed).collect();
        let jobs = blocking(&app, move |workshop| pages::titled(workshop, shown)).await?;
        return Ok(pages::jobs(&app, &identity, &jobs, next));
    }
    let mut links = vec![link("/jobs", "self", "application/json", "This document")];
    if jobs.len() == limit as usize {
        links.push(link(&next, "next", "application/json", "Older jobs"));
    }
    Ok(document(&json!({ "jobs": jobs.iter().map(status_info).collect::<Vec<_>>(), "links": links })))
}

/// The job of the one who asks.
pub async fn find(app: &Arc<App>, identity: &Identity, id: &str) -> Result<Job, Failure> {
    let (owner, name) = (identity.owner.clone(), id.to_owned());
    let job = blocking(app, move |workshop| workshop.store.job(&owner, &name)).await?;
    job.ok_or_else(|| Failure::no_job(id))
}

/// The job of the one who asks, if it has results.
pub async fn find_successful(app: &Arc<App>, identity: &Identity, id: &str) -> Result<Job, Failure> {
    let job = find(app, identity, id).await?;
    match job.status {
        Status::Successful => Ok(job),
        Status::Failed => Err(Failure::new(StatusCode::UNPROCESSABLE_ENTITY, job.message)),
        Status::Dismissed => Err(Failure::new(StatusCode::GONE, "the job was dismissed")),
        Status::Accepted | Status::Running => {
            Err(Failure::not_ready(format!("the job is {}", job.status.name())))
        }
    }
}

pub async fn status(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path(id): Path<String>,
    RawQuery(query): RawQuery,
    Query(asked): Query<BTreeMap<String, String>>,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    let job = find(&app, &identity, &id).await?;
    match wants_page(&headers, query.as_deref()) {
        true => pages::job(&app, &identity, &job, asked.get("points").map(String::as_str)).await,
        false => Ok(document(&status_info(&job))),
    }
}

pub async fn dismiss(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path(id): Path<String>,
) -> Result<Response, Failure> {
    let job = find(&app, &identity, &id).await?;
    if job.status == Status::Dismissed {
        return Err(Failure::new(StatusCode::GONE, "the job was dismissed"));
    }
    let (owner, name) = (identity.owner.clone(), id.clone());
    let workshop = Arc::clone(&app.workshop);
    blocking(&app, move |_| workshop.dismiss(&owner, &name)).await?;
    Ok(document(&status_info(&find(&app, &identity, &id).await?)))
}

pub async fn results(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path(id): Path<String>,
) -> Result<Response, Failure> {
    let job = find_successful(&app, &identity, &id).await?;
    let (_, results) = blocking(&app, move |workshop| results_document(&job, &workshop.store)).await?;
    Ok(document(&results))
}

/// The state of a job whenever it changes, until it is final.
pub async fn events(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path(id): Path<String>,
) -> Result<Response, Failure> {
    find(&app, &identity, &id).await?;
    let Some(share) = app.streams.try_take(&identity.owner) else {
        return Err(Failure::new(
            StatusCode::TOO_MANY_REQUESTS,
            "too many streams are open; ask for /jobs/JOB now and then instead",
        ));
    };
    // State between events: what was sent last, and whether that was the end. Browsers open a stream that
    // ends again.
    let start = Instant::now();
    let begin = (app, identity, id, String::new(), false, share);
    let events = stream::unfold(begin, move |(app, identity, id, mut last, is_over, share)| async move {
        if is_over {
            return None;
        }
        while start.elapsed() < MAX_STREAM {
            let job = find(&app, &identity, &id).await.ok()?;
            let info = status_info(&job).to_string();
            if info != last {
                let event = Event::default().event(job.status.name()).data(&info);
                last = info;
                let is_over = job.status.is_final();
                return Some((Ok::<_, Infallible>(event), (app, identity, id, last, is_over, share)));
            }
            tokio::time::sleep(EVENT_PERIOD).await;
        }
        None
    });
    Ok(Sse::new(events).keep_alive(KeepAlive::default()).into_response())
}
