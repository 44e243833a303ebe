//! The report of a comparison, with names of its clouds in place of the ids of their jobs.

use super::titles::{inputs_of, name_title};
use crate::answers::Failure;
use crate::app::{App, Identity, blocking};
use crate::processes::Process;
use crate::records::Kind;
use crate::security::VIEWER_POLICY;
use crate::store::{Job, Result as StoreResult, Status};
use crate::worker::Workshop;
use axum::Extension;
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use maud::html;
use serde_json::Value;
use std::sync::Arc;

/// The page that a comparison writes.
pub const REPORT: &str = "report.html";
/// Largest report that is shown, bytes.
const MAX_REPORT: u64 = 64 << 20;

/// The report of a comparison.
pub async fn report(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path(id): Path<String>,
) -> Result<Response, Failure> {
    let owner = identity.owner;
    let report = blocking(&app, move |workshop| -> StoreResult<_> {
        let job = workshop.store.job(&owner, &id)?;
        let is_compared =
            |job: &Job| job.status == Status::Successful && job.process == Process::Compare.id();
        let Some(job) = job.filter(is_compared) else { return Ok(None) };
        let bytes = workshop.store.read(Kind::Results, &job.folder, REPORT, MAX_REPORT)?;
        bytes.map(|bytes| named(workshop, &job, &String::from_utf8_lossy(&bytes))).transpose()
    })
    .await?;
    let report = report.ok_or_else(|| {
        Failure::new(StatusCode::NOT_FOUND, "there is no such comparison; /jobs lists them")
    })?;
    let fields = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8"),
        (header::CONTENT_SECURITY_POLICY, VIEWER_POLICY),
    ];
    Ok((fields, report).into_response())
}

/// The report with the titles of the clouds that are results of jobs.
fn named(workshop: &Workshop, job: &Job, report: &str) -> StoreResult<String> {
    let inputs = inputs_of(job);
    let mut report = report.to_owned();
    for key in ["first", "second"] {
        let Some(name) = inputs.get(key).and_then(Value::as_str) else { continue };
        let title = name_title(workshop, &job.owner, name)?;
        report = with_title(&report, name, &title);
    }
    Ok(report)
}

fn with_title(report: &str, name: &str, title: &str) -> String {
    let escaped = |text: &str| html! { (text) }.into_string();
    report.replace(&escaped(name), &escaped(title))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn titles_are_escaped() {
        let report = "<h1>jobs/1/a&amp;b.laz</h1><img alt=\"jobs/1/a&amp;b.laz\">";
        let named = with_title(report, "jobs/1/a&b.laz", "a <b> \"c\"");
        let title = "a &lt;b&gt; &quot;c&quot;";
        assert_eq!(named, format!("<h1>{title}</h1><img alt=\"{title}\">"));
    }
}
