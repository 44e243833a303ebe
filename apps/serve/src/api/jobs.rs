//! Jobs: list, state, results, progress, dismissal.

use super::OF_JOBS;
use crate::answers::{Failure, document, link, wants_page};
use crate::app::{App, Identity, blocking};
use crate::pages;
use crate::query::{DEFAULT_LISTED, MAX_LISTED, Parameters};
use crate::store::{Job, Listed, Selection, Status, time_text};
use axum::Extension;
use axum::extract::{Path, Query, RawQuery, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse as _, Response};
use chrono::DateTime;
use futures_util::stream;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::time::{Duration, Instant};

const EVENT_PERIOD: Duration = Duration::from_millis(500);
/// Longest time of a stream of progress.
const MAX_STREAM: Duration = Duration::from_secs(3600);
/// Jobs of a page.
const PAGE_LISTED: u32 = 100;

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

/// The jobs that parameters select.
fn selection(parameters: &Parameters, default_limit: u32) -> Result<Selection, Failure> {
    let wrong = |key: &str, value: &str| {
        Failure::new(StatusCode::BAD_REQUEST, format!("{key}: `{value}` is not known"))
    };
    let list = |key: &str| parameters.get(key).into_iter().flat_map(|value| value.split(','));
    let status = |name: &str| Status::named(name).ok_or_else(|| wrong("status", name));
    let number = |key: &str, range: RangeInclusive<u32>| match parameters.get(key) {
        None => Ok(None),
        Some(value) => {
            let number = value.parse::<u32>().ok().filter(|n| range.contains(n));
            let expected = || {
                let (least, most) = (range.start(), range.end());
                let message =
                    format!("{key}: expected a whole number from {least} to {most}, found `{value}`");
                Failure::new(StatusCode::BAD_REQUEST, message)
            };
            number.map(Some).ok_or_else(expected)
        }
    };
    let duration = |key: &str| {
        let seconds = number(key, 0..=u32::MAX)?;
        Ok::<_, Failure>(seconds.map(|seconds| i64::from(seconds) * 1000))
    };
    if let Some(kind) = list("type").find(|kind| *kind != "process") {
        return Err(wrong("type", kind));
    }
    let created = parameters.get("datetime").map_or(Ok((None, None)), |text| {
        interval(text).ok_or_else(|| {
            let message = format!(
                "datetime: expected a time such as 2026-01-31T12:00:00Z, or START/END, where .. is an open \
                 end; found `{text}`"
            );
            Failure::new(StatusCode::BAD_REQUEST, message)
        })
    })?;
    Ok(Selection {
        statuses: list("status").map(status).collect::<Result<_, _>>()?,
        processes: list("processID").map(str::to_owned).collect(),
        created,
        duration: (duration("minDuration")?, duration("maxDuration")?),
        limit: number("limit", 1..=MAX_LISTED)?.unwrap_or(default_limit),
        skip: number("offset", 0..=u32::MAX)?.unwrap_or(0),
    })
}

/// Earliest and latest time, ms since 1970, of a time or an interval, as the standard writes them.
fn interval(text: &str) -> Option<(Option<i64>, Option<i64>)> {
    // A + that is not encoded stands for a blank.
    let time = |text: &str| DateTime::parse_from_rfc3339(&text.replace(' ', "+")).ok();
    let end = |text: &str| match text {
        "" | ".." => Some(None),
        text => time(text).map(|time| Some(time.timestamp_millis())),
    };
    let (start, stop) = text.split_once('/').unwrap_or((text, text));
    let ends = (end(start)?, end(stop)?);
    (ends != (None, None)).then_some(ends)
}

pub async fn list(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    let is_page = wants_page(&headers, query.as_deref());
    let parameters = Parameters::of(query.as_deref(), &OF_JOBS)?;
    let mut selection = selection(&parameters, if is_page { PAGE_LISTED } else { DEFAULT_LISTED })?;
    let (skip, limit) = (selection.skip, selection.limit);
    let listed = if is_page { Listed::States } else { Listed::Bare };
    let owner = identity.owner.clone();
    // One more tells whether there are older ones.
    selection.limit += 1;
    let mut jobs = blocking(&app, move |workshop| workshop.store.select(listed, &owner, &selection)).await?;
    let at = |offset: u32| parameters.with("offset", &offset.to_string()).address("/jobs");
    let next = (jobs.len() > limit as usize).then(|| at(skip.saturating_add(limit)));
    jobs.truncate(limit as usize);
    if is_page {
        let shown = jobs.into_iter().filter(|job| job.status != Status::Dismissed).collect();
        let jobs = blocking(&app, move |workshop| pages::titled(workshop, shown)).await?;
        return Ok(pages::jobs(&app, &identity, &jobs, next.as_deref()));
    }
    let json = "application/json";
    let mut links = vec![
        link(&parameters.address("/jobs"), "self", json, "This document"),
        link(&parameters.with("f", "html").address("/jobs"), "alternate", "text/html", "This list as a page"),
    ];
    if let Some(next) = next {
        links.push(link(&next, "next", json, "Older jobs"));
    }
    if skip > 0 {
        links.push(link(&at(skip.saturating_sub(limit)), "prev", json, "Newer jobs"));
    }
    Ok(document(&json!({ "jobs": jobs.iter().map(status_info).collect::<Vec<_>>(), "links": links })))
}

/// The job of the one who asks.
pub async fn find(app: &Arc<App>, identity: &Identity, id: &str) -> Result<Job, Failure> {
    let (owner, name) = (identity.owner.clone(), id.to_owned());
    let job = blocking(app, move |workshop| workshop.store.job(&owner, &name)).await?;
    job.ok_or_else(|| Failure::no_job(id))
}

/// The state of a job of the one who asks.
pub async fn find_state(app: &Arc<App>, identity: &Identity, id: &str) -> Result<Job, Failure> {
    let (owner, name) = (identity.owner.clone(), id.to_owned());
    let job = blocking(app, move |workshop| workshop.store.job_state(&owner, &name)).await?;
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
    if !wants_page(&headers, query.as_deref()) {
        return Ok(document(&status_info(&find_state(&app, &identity, &id).await?)));
    }
    let job = find(&app, &identity, &id).await?;
    pages::job(&app, &identity, &job, asked.get("points").map(String::as_str)).await
}

pub async fn dismiss(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path(id): Path<String>,
) -> Result<Response, Failure> {
    let job = find_state(&app, &identity, &id).await?;
    if job.status == Status::Dismissed {
        return Err(Failure::new(StatusCode::GONE, "the job was dismissed"));
    }
    let (owner, name) = (identity.owner.clone(), id.clone());
    let workshop = Arc::clone(&app.workshop);
    blocking(&app, move |_| workshop.dismiss(&owner, &name)).await?;
    Ok(document(&status_info(&find_state(&app, &identity, &id).await?)))
}

/// The state of a job whenever it changes, until it is final.
pub async fn events(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path(id): Path<String>,
) -> Result<Response, Failure> {
    find_state(&app, &identity, &id).await?;
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
        // Tokens may be revoked meanwhile.
        while start.elapsed() < MAX_STREAM && app.tokens.admits(&identity.owner) {
            let job = find_state(&app, &identity, &id).await.ok()?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_intervals_are_those_of_the_standard() {
        let (noon, evening) = (1_767_268_800_000, 1_767_290_400_000);
        for (text, expected) in [
            ("2026-01-01T12:00:00Z", Some((Some(noon), Some(noon)))),
            ("2026-01-01T13:00:00 01:00", Some((Some(noon), Some(noon)))),
            ("2026-01-01T12:00:00Z/2026-01-01T18:00:00.000Z", Some((Some(noon), Some(evening)))),
            ("../2026-01-01T12:00:00Z", Some((None, Some(noon)))),
            ("/2026-01-01T12:00:00Z", Some((None, Some(noon)))),
            ("2026-01-01T12:00:00Z/..", Some((Some(noon), None))),
            ("2026-01-01T12:00:00Z/", Some((Some(noon), None))),
            ("../..", None),
            ("/", None),
            ("", None),
            ("2026-01-01", None),
            ("2026-01-01 12:00:00Z", None),
            ("2026-01-01T12:00:00", None),
            ("yesterday/..", None),
        ] {
            assert_eq!(interval(text), expected, "{text}");
        }
    }
}
