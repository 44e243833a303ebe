//! The first page, with uploads and the newest jobs; and the list of all jobs.

use super::examples::EXAMPLES;
use super::layout::{bytes_text, form_token, local_time, page};
use super::titles::{Titled, step_title, titled};
use crate::answers::Failure;
use crate::app::{App, Identity, blocking};
use crate::store::{Job, Listed, Result as StoreResult, Status, Upload};
use axum::response::Response;
use maud::{Markup, html};
use std::sync::Arc;

/// Jobs on the first page.
const NEWEST: u32 = 10;

/// The first page.
///
/// # Errors
/// Errors of the store.
pub async fn home(app: &Arc<App>, identity: &Identity) -> Result<Response, Failure> {
    with_problem(app, identity, "").await
}

/// The first page with the problem of an upload at its form.
///
/// # Errors
/// Errors of the store.
pub async fn upload_failed(
    app: &Arc<App>,
    identity: &Identity,
    failure: &Failure,
) -> Result<Response, Failure> {
    let mut response = with_problem(app, identity, &failure.detail).await?;
    *response.status_mut() = failure.status;
    Ok(response)
}

async fn with_problem(app: &Arc<App>, identity: &Identity, problem: &str) -> Result<Response, Failure> {
    let owner = identity.owner.clone();
    let (uploads, jobs) = blocking(app, move |workshop| -> StoreResult<_> {
        let states = [Status::Accepted, Status::Running, Status::Successful, Status::Failed];
        let jobs = workshop.store.jobs(Listed::States, &owner, &states, &[], 0, NEWEST)?;
        Ok((workshop.store.uploads(&owner)?, titled(workshop, jobs)?))
    })
    .await?;
    let content = html! {
        h1 { "Virtual laser scanning" }
        @if uploads.is_empty() {
            p .lead { "Upload a scene, then choose an instrument: " a href="/new" { "New scan" } "." }
            (examples(app, identity))
        } @else {
            p .lead { a .button href="/new" { "New scan" } }
        }
        section aria-labelledby="files" {
            h2 #files { "Files" }
            (upload_form(app, identity, problem))
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

/// The form of uploads, with the problem of one that has failed. A script adds progress, and files can be
/// dropped on it.
fn upload_form(app: &App, identity: &Identity, problem: &str) -> Markup {
    let limits = &app.workshop.limits;
    html! {
        script src="/static/upload.js" defer {}
        form #upload method="post" action="/uploads" enctype="multipart/form-data" .card {
            (form_token(app, identity))
            input type="hidden" name="taken" value="number";
            p #upload-problem .problem role="alert" { (problem) }
            label {
                "Name " small { "(default: that of the file; a number is added to a name that is taken)" }
                input name="name" maxlength="60" autocomplete="off" pattern="[\\p{L}\\p{N}._+\\-]+" title="letters, digits and . _ + - without blanks";
            }
            div .drop {
                label {
                    "Files of a scene, a survey, a trajectory, or one zip archive of them"
                    input type="file" name="file" multiple;
                }
                label { "or a folder" input type="file" name="file" webkitdirectory multiple; }
                p #dropped role="status" {}
            }
            progress #uploaded max="100" value="0" hidden aria-label="Progress of the upload" {}
            button type="submit" { "Upload" }
            p { small {
                "Meshes (OBJ, PLY, STL, OFF, glTF), terrain (GeoTIFF, ESRI grids), point clouds (LAZ …), voxels, surveys, inventories, areas; at most "
                (bytes_text(limits.max_upload)) " and " (limits.max_files) " files."
            } }
        }
    }
}

/// Scans of examples, for visitors without files.
fn examples(app: &App, identity: &Identity) -> Markup {
    html! {
        section .card aria-labelledby="examples" {
            h2 #examples { "Try an example" }
            form method="post" action="/forms/example" {
                (form_token(app, identity))
                div .row {
                    @for example in &EXAMPLES {
                        div {
                            button type="submit" name="example" value=(example.id) { (example.title) }
                            p { small { (example.about) } }
                        }
                    }
                }
            }
        }
    }
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
                                (remove_form(app, identity, &upload.name))
                            }
                        }
                    }
                }
            }
        }
    }
}

/// A form that removes an upload, after a question.
pub fn remove_form(app: &App, identity: &Identity, upload: &str) -> Markup {
    html! {
        details .inline {
            summary aria-label=(format!("Remove {upload}")) { "Remove" }
            form .inline method="post" action="/forms/remove-upload" {
                (form_token(app, identity))
                input type="hidden" name="name" value=(upload);
                button .quiet type="submit" { "Remove the files of " (upload) }
            }
            p { small { "Plans and surveys that name them cannot be run any more." } }
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

/// Jobs in the order of their scans, the scan with the newest job first.
fn scans(jobs: &[Titled]) -> Vec<Vec<&Titled>> {
    let mut scans: Vec<Vec<&Titled>> = Vec::new();
    for job in jobs {
        match scans.iter_mut().find(|scan| scan.iter().any(|other| other.scan.0 == job.scan.0)) {
            Some(scan) => scan.push(job),
            None => scans.push(vec![job]),
        }
    }
    scans
}

/// Jobs as a table, those of one scan below its title.
fn job_list(jobs: &[Titled]) -> Markup {
    html! {
        @if jobs.is_empty() {
            p { "None yet." }
        } @else {
            table .jobs {
                thead { tr { th { "Job" } th { "State" } th { "Accepted" } } }
                @for scan in scans(jobs) {
                    tbody {
                        @if let [first, _, ..] = scan.as_slice() {
                            tr { th colspan="3" scope="rowgroup" { (first.scan.1) } }
                            @for one in &scan { (job_row(&one.job, &step_title(&one.job))) }
                        } @else {
                            @for one in &scan { (job_row(&one.job, &one.title)) }
                        }
                    }
                }
            }
        }
    }
}

fn job_row(job: &Job, title: &str) -> Markup {
    html! {
        tr {
            td { a href=(format!("/jobs/{}", job.id)) { (title) } }
            td {
                span .state .(job.status.name()) { (job.status.name()) }
                @if job.status == Status::Running { " " (job.progress) " %" }
            }
            td { (local_time(job.created)) }
        }
    }
}

/// The list of jobs, and a link to the address of the next page, if there is one.
pub fn jobs(app: &App, identity: &Identity, jobs: &[Titled], next: Option<&str>) -> Response {
    let content = html! {
        h1 { "Jobs" }
        (job_list(jobs))
        @if let Some(next) = next { p { a href=(next) { "Older jobs" } } }
    };
    page(app, identity, "Jobs", &content)
}
