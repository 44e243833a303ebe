//! The first page, with uploads and the newest jobs; and the list of all jobs.

use super::layout::{bytes_text, form_token, page};
use crate::answers::Failure;
use crate::app::{App, Identity, blocking};
use crate::processes::Process;
use crate::store::{Job, Result as StoreResult, Status, Upload, time_text};
use axum::response::Response;
use maud::{Markup, html};
use std::sync::Arc;

/// Jobs on the first page.
const NEWEST: u32 = 10;

/// The first page.
///
/// # Errors
/// Those of the store.
pub async fn home(app: &Arc<App>, identity: &Identity) -> Result<Response, Failure> {
    let owner = identity.owner.clone();
    let (uploads, jobs) = blocking(app, move |workshop| -> StoreResult<_> {
        let states = [Status::Accepted, Status::Running, Status::Successful, Status::Failed];
        Ok((workshop.store.uploads(&owner)?, workshop.store.jobs(&owner, &states, &[], 0, NEWEST)?))
    })
    .await?;
    let limits = &app.workshop.limits;
    let content = html! {
        h1 { "Virtual laser scanning" }
        @if uploads.is_empty() {
            p .lead { "Upload a scene, then choose an instrument: " a href="/new" { "New scan" } "." }
        } @else {
            p .lead { a .button href="/new" { "New scan" } }
        }
        section aria-labelledby="files" {
            h2 #files { "Files" }
            form method="post" action="/uploads" enctype="multipart/form-data" .card {
                (form_token(app, identity))
                label { "Name " small { "(default: that of the file)" } input name="name" maxlength="60" autocomplete="off"; }
                label {
                    "Files of a scene, a survey, a trajectory, or one zip archive of them"
                    input type="file" name="file" multiple;
                }
                label { "or a folder" input type="file" name="file" webkitdirectory multiple; }
                button type="submit" { "Upload" }
                p { small {
                    "Meshes (OBJ, PLY, STL, glTF), terrain (GeoTIFF), point clouds (LAZ …), voxels, surveys, inventories, areas; at most "
                    (bytes_text(limits.max_upload)) " and " (limits.max_files) " files."
                } }
            }
            (upload_list(app, identity, &uploads))
        }
        section aria-labelledby="jobs" {
            h2 #jobs { "Newest jobs" }
            (job_list(&jobs))
            @if jobs.len() == NEWEST as usize { p { a href="/jobs" { "All jobs" } } }
        }
    };
    Ok(page(app, identity, "Files and jobs", &content))
}

fn upload_list(app: &App, identity: &Identity, uploads: &[Upload]) -> Markup {
    html! {
        @if !uploads.is_empty() {
            table {
                thead { tr { th { "Name" } th { "Files" } th { "Size" } th { span .hidden { "Remove" } } } }
                tbody {
                    @for upload in uploads {
                        tr {
                            td { a href=(format!("/uploads/{}", encoded(&upload.name))) { (upload.name) } }
                            td { (upload.files) }
                            td { (bytes_text(upload.bytes)) }
                            td {
                                form .inline method="post" action="/forms/remove-upload" {
                                    (form_token(app, identity))
                                    input type="hidden" name="name" value=(upload.name);
                                    button .quiet type="submit" aria-label=(format!("Remove {}", upload.name)) { "Remove" }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// A text as part of a query.
pub fn encoded(text: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
    text.bytes()
        .map(|byte| if plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") })
        .collect()
}

fn job_list(jobs: &[Job]) -> Markup {
    html! {
        @if jobs.is_empty() {
            p { "None yet." }
        } @else {
            table {
                thead { tr { th { "Job" } th { "State" } th { "Accepted" } } }
                tbody {
                    @for job in jobs {
                        tr {
                            td { a href=(format!("/jobs/{}", job.id)) { (title(job)) } }
                            td {
                                span .state .(job.status.name()) { (job.status.name()) }
                                @if job.status == Status::Running { " " (job.progress) " %" }
                            }
                            td { time datetime=(time_text(job.created)) { (short_time(job.created)) } }
                        }
                    }
                }
            }
        }
    }
}

/// What a job does, in words.
pub fn title(job: &Job) -> String {
    let inputs: serde_json::Value = serde_json::from_str(&job.inputs).unwrap_or_default();
    let text = |key: &str| inputs[key].as_str().map(str::to_owned);
    let what =
        ["pipeline", "survey", "inventory", "scene", "first", "points"].iter().find_map(|key| text(key));
    let process = Process::named(&job.process).map_or("", Process::title);
    match what {
        Some(what) => format!("{process}: {}", short(&what)),
        None => process.to_owned(),
    }
}

/// A name without the id of a job in it.
fn short(name: &str) -> String {
    match name.strip_prefix("jobs/").and_then(|rest| rest.split_once('/')) {
        Some((id, file)) => format!("{file} of {}", id.get(..6).unwrap_or(id)),
        None => name.to_owned(),
    }
}

fn short_time(ms: i64) -> String {
    time_text(ms).get(..16).unwrap_or_default().replace('T', " ") + " UTC"
}

/// The list of jobs, `next` being the number of those that are listed before the next page.
pub fn jobs(app: &App, identity: &Identity, jobs: &[Job], next: u32) -> Response {
    let jobs: Vec<Job> = jobs.iter().filter(|job| job.status != Status::Dismissed).cloned().collect();
    let content = html! {
        h1 { "Jobs" }
        (job_list(&jobs))
        @if !jobs.is_empty() { p { a href=(format!("/jobs?offset={next}")) { "Older jobs" } } }
    };
    page(app, identity, "Jobs", &content)
}
