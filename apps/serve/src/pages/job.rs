//! The page of a job: its progress, then its results with pictures, and the command that does the same in a
//! shell.

use super::choices::run_fields;
use super::cloud::{cloud, is_cloud, is_octree, show_form};
use super::compared::REPORT;
use super::home::encoded as in_query;
use super::layout::{bytes_text, form_token, page};
use super::new::failed_plan;
use super::plan_fields::{address, in_words_of_the_page};
use super::plan_words::plan;
use super::titles::{inputs_of, next_seed, title};
use super::trail::{path, trail_of};
use crate::answers::{Failure, encoded};
use crate::app::{App, Identity, blocking};
use crate::messages::{place_of, rounded, time_in_words};
use crate::place::Place;
use crate::processes::Process;
use crate::records::Kind;
use crate::request::Prepared;
use crate::store::{Job, Result as StoreResult, ResultFile, Status, Store};
use crate::view::{PICTURE, drawn_file};
use axum::response::Response;
use maud::{Markup, html};
use serde_json::{Map, Value};
use std::sync::Arc;
use vlscan_messages::ProblemMessage;

/// Largest document that a page shows, bytes.
const MAX_SHOWN: u64 = 64 << 10;
/// Most files that a page lists.
const MAX_LISTED: usize = 200;

/// Contents of files that the page shows.
#[derive(Debug, Default)]
struct Shown {
    has_picture: bool,
    report: Value,
    document: String,
}

impl Shown {
    fn of(job: &Job, store: &Store) -> Shown {
        let text = |name: &str| {
            let bytes = store.read(Kind::Results, &job.folder, name, MAX_SHOWN).ok()??;
            String::from_utf8(bytes).ok()
        };
        let prepared: Prepared = serde_json::from_str(&job.prepared).unwrap_or_default();
        Shown {
            has_picture: drawn_file(Process::named(&job.process), &job.result_files()).is_some(),
            report: text("report.json").and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default(),
            document: text("plan.toml")
                .or(prepared.document.or(prepared.geometries.into_iter().next()).map(|(_, text)| text))
                .unwrap_or_default(),
        }
    }
}

/// The page of a job, with the points of its file `points`.
///
/// # Errors
/// Errors of the store.
pub async fn job(
    app: &Arc<App>,
    identity: &Identity,
    job: &Job,
    points: Option<&str>,
) -> Result<Response, Failure> {
    let reads = job.clone();
    let workers = app.workshop.limits.workers;
    let (shown, title, trail, place) = blocking(app, move |workshop| -> StoreResult<_> {
        let shown = Shown::of(&reads, &workshop.store);
        let place = workshop.store.place(&reads)?;
        Ok((shown, title(workshop, &reads)?, trail_of(workshop, &reads)?, place))
    })
    .await?;
    let is_failed_plan = job.status == Status::Failed && job.process == Process::Plan.id();
    let form = if is_failed_plan { Some(failed_plan(app, identity, job).await?) } else { None };
    let content = html! {
        (path(&trail))
        h1 { (title) }
        (state(job, &place.map(|place| queued(&place, workers)).unwrap_or_default()))
        (change(job))
        @if let Some(form) = form { (form) }
        @if job.status == Status::Successful { (results(app, identity, job, &shown, points)) }
        @if job.status != Status::Dismissed {
            (command(job, &shown))
            (removal(app, identity, job))
        }
    };
    Ok(page(app, identity, &title, &content))
}

/// The place of a job in the queue, in words.
fn queued(place: &Place, workers: usize) -> String {
    let before = match place.before {
        0 => "Next in the queue".to_owned(),
        1 => "1 job before this one".to_owned(),
        many => format!("{many} jobs before this one"),
    };
    let time =
        place.seconds(workers).map(|seconds| format!(", finished in about {}", time_in_words(seconds)));
    before + &time.unwrap_or_default()
}

/// A form that gives up a job or removes it, after a question.
fn removal(app: &App, identity: &Identity, job: &Job) -> Markup {
    let (question, answer, after) = match job.status.is_final() {
        true => ("Remove", "Remove this job and its files", "The files cannot be restored."),
        false => ("Give up", "Give up this job", "What has been computed so far is lost."),
    };
    html! {
        details {
            summary { (question) }
            p { (after) }
            form method="post" action="/forms/dismiss" {
                (form_token(app, identity))
                input type="hidden" name="id" value=(job.id);
                @if !job.status.is_final() { input type="hidden" name="unfinished" value="on"; }
                button .quiet type="submit" { (answer) }
            }
        }
    }
}

/// The state of a job, which is `queued` if it waits.
fn state(job: &Job, queued: &str) -> Markup {
    html! {
        @match job.status {
            Status::Accepted | Status::Running => {
                // Without scripts the page is loaded again.
                noscript { meta http-equiv="refresh" content="2"; }
                script src="/static/follow.js" defer {}
                div #follow .card data-job=(job.id) {
                    p { span .state .(job.status.name()) #state { (job.status.name()) } }
                    p #queue { (queued) }
                    progress #progress max="100" value=(job.progress) aria-label="Progress" {}
                    p #message role="status" { (job.message) }
                }
            }
            Status::Successful => {
                @let warnings = job.problems();
                // Warnings are seen at once.
                @if !warnings.is_empty() {
                    details open { summary { "Warnings" } ul .warnings { @for warning in &warnings { (problem(job, warning)) } } }
                }
                @if !job.message.is_empty() { details { summary { "Messages" } pre { (job.message) } } }
            }
            Status::Failed => {
                p { span .state .failed { "failed" } }
                pre .message role="alert" { (in_words(job, &job.message)) }
            }
            Status::Dismissed => {
                // The dismissal of an unfinished job is its end.
                @let is_removed = job.finished != Some(job.updated);
                p { span .state .dismissed { @if is_removed { "removed" } @else { "given up" } } }
                p { a href="/" { "Back to files and jobs" } }
            }
        }
    }
}

/// A message of a job. Those of plans name inputs, which are fields of the page.
fn in_words(job: &Job, message: &str) -> String {
    match job.process == Process::Plan.id() {
        true => in_words_of_the_page(message),
        false => message.to_owned(),
    }
}

/// A warning as an entry of a list.
fn problem(job: &Job, warning: &ProblemMessage) -> Markup {
    let place = place_of(warning);
    html! {
        li {
            (in_words(job, &warning.message))
            @if !place.is_empty() { " " small { code { (place) } } }
            @if let Some(help) = &warning.help { br; "Help: " (in_words(job, help)) }
        }
    }
}

/// A link to the form that the job comes from, with what was filled in. The page of a failed plan has the
/// form itself.
fn change(job: &Job) -> Markup {
    if job.status == Status::Failed && job.process == Process::Plan.id() {
        return html! {};
    }
    let inputs: Map<String, Value> = serde_json::from_str(&job.inputs).unwrap_or_default();
    let address =
        Process::named(&job.process).filter(|_| job.status.is_final()).and_then(|of| address(of, &inputs));
    html! { @if let Some(address) = address { p { a href=(address) { "Change it" } } } }
}

fn results(app: &App, identity: &Identity, job: &Job, shown: &Shown, points: Option<&str>) -> Markup {
    let process = Process::named(&job.process);
    let files = job.result_files();
    let own = format!("/jobs/{}", job.id);
    html! {
        @match process {
            Some(Process::Plan) => {
                @if shown.has_picture { (picture(&own, "Flight lines over the scene, from above and from the side")) }
                (plan(&app.workshop.program, &inputs_of(job), &shown.document))
                form .card method="post" action="/forms/run" {
                    (form_token(app, identity))
                    input type="hidden" name="file" value=(format!("jobs/{}/plan.toml", job.id));
                    (run_fields())
                    div .row {
                        button type="submit" name="action" value="run" { "Run" }
                        button .quiet type="submit" name="action" value="dry-run" { "Forecast density and time" }
                    }
                }
            }
            Some(Process::DryRun) => {
                (forecast(&shown.report))
                @if let Some(file) = run_file(job) {
                    form .card method="post" action="/forms/run" {
                        (form_token(app, identity))
                        input type="hidden" name="file" value=(file);
                        (run_fields())
                        button type="submit" name="action" value="run" { "Run it" }
                    }
                }
            }
            Some(Process::Stand) => {
                p { a .button href=(format!("/new?kind=airborne&scene={}", in_query(&format!("jobs/{}/stand/stand.xml", job.id)))) { "Plan a scan of it" } }
            }
            Some(Process::Compare) => { (viewer(&format!("/compared/{}/{REPORT}", job.id), "Comparison")) }
            Some(Process::Preview) => {
                @for file in &files {
                    @if file.path.ends_with(".png") { img .picture src=(format!("{own}/results/{}", encoded(&file.path))) alt="The picture"; }
                    @else if file.path.ends_with(".laz") { (cloud(app, identity, job, &files, points, &html! {})) }
                    @else { (viewer(&format!("{own}/results/{}", encoded(&file.path)), "Points")) }
                }
            }
            _ => {
                @let drawn = html! { @if shown.has_picture { (picture(&own, "The points from above and from the side")) } };
                (cloud(app, identity, job, &files, points, &drawn))
                @if process == Some(Process::Run) { (again(app, identity, job)) }
            }
        }
        (downloads(job, &files, |name| show_form(app, identity, name, "show")))
    }
}

/// A form that runs a job once more with the next seed.
fn again(app: &App, identity: &Identity, job: &Job) -> Markup {
    html! {
        form .inline method="post" action="/forms/again" {
            (form_token(app, identity))
            input type="hidden" name="id" value=(job.id);
            button .quiet type="submit" { "Again with seed " (next_seed(&inputs_of(job))) }
        }
    }
}

fn picture(own: &str, about: &str) -> Markup {
    html! {
        div .drawn {
            span .waiting role="status" { "The picture is drawn …" }
            img .picture src=(format!("{own}/view/{PICTURE}")) width="1200" height="800" alt=(about);
        }
    }
}

fn viewer(address: &str, about: &str) -> Markup {
    html! {
        iframe .viewer src=(address) title=(about) sandbox="allow-scripts allow-downloads" {}
        p { a href=(address) target="_blank" rel="noopener" { "In a window of its own" } }
    }
}

/// The file that a dry run was of.
fn run_file(job: &Job) -> Option<String> {
    let inputs: Value = serde_json::from_str(&job.inputs).unwrap_or_default();
    ["pipeline", "survey"].iter().find_map(|key| inputs[*key].as_str().map(str::to_owned))
}

/// The files, to download. `show` is a form that shows the points of one.
fn downloads(job: &Job, files: &[ResultFile], show: impl Fn(&str) -> Markup) -> Markup {
    let has_points = |file: &ResultFile| is_cloud(&file.path) && job.process != Process::Stand.id();
    // The points of one file are shown already, or by a button of their own.
    let are_several = files.iter().filter(|file| has_points(file)).count() > 1;
    let name = |file: &ResultFile| format!("jobs/{}/{}", job.id, file.path);
    html! {
        section aria-labelledby="results" {
            h2 #results { "Files" }
            ul .files {
                @for file in files.iter().take(MAX_LISTED) {
                    li {
                        a download href=(format!("/jobs/{}/results/{}", job.id, encoded(&file.path))) { (file.path) }
                        " " small { (bytes_text(file.bytes)) }
                        @if has_points(file) {
                            @if are_several && is_octree(&file.path) {
                                " · " a href=(format!("/jobs/{}?points={}", job.id, in_query(&file.path))) { "show" }
                            } @else if are_several {
                                " · " (show(&name(file)))
                            }
                            " · " a href=(format!("/compare?first={}", in_query(&name(file)))) { "compare" }
                        }
                    }
                }
            }
            @if files.len() > MAX_LISTED { p { "and " (files.len() - MAX_LISTED) " more, which the results list: " a href=(format!("/jobs/{}/results", job.id)) { "JSON" } } }
        }
    }
}

/// The figures of a dry run.
fn forecast(report: &Value) -> Markup {
    let number = |value: &Value| value.as_f64().filter(|number| number.is_finite());
    let amount = |value: &Value, unit: &str| number(value).map(|number| format!("{}{unit}", rounded(number)));
    let rows = [
        ("Flight", amount(&report["duration_s"], " s")),
        ("Pulses", amount(&report["pulses"], "")),
        ("Points", amount(&report["points"]["value"], "")),
        ("Points per m²", amount(&report["points_per_m2"], "")),
        ("Pulses per m²", amount(&report["pulses_per_m2"], "")),
        ("Time of the run", amount(&report["time"]["total_s"], " s")),
        ("Memory", number(&report["memory_bytes"]).map(|bytes| bytes_text(bytes as u64))),
        (
            "Pulses without an echo",
            number(&report["missed"]["pulses"]).map(|part| format!("{:.0} %", part * 100.0)),
        ),
    ];
    html! {
        table .figures { tbody {
            @for (name, value) in rows {
                @if let Some(value) = value { tr { th scope="row" { (name) } td { (value) } } }
            }
            @for file in report["files"].as_array().into_iter().flatten() {
                tr { th scope="row" { (file["name"].as_str().unwrap_or_default()) } td { (bytes_text(file["bytes"].as_f64().unwrap_or(0.0) as u64)) } }
            }
        } }
    }
}

fn command(job: &Job, shown: &Shown) -> Markup {
    let prepared: Prepared = serde_json::from_str(&job.prepared).unwrap_or_default();
    html! {
        details {
            summary { "Show the command" }
            // Failed jobs keep their inputs only.
            @if !prepared.shown.is_empty() {
                p { "In a folder that has the uploads as folders:" }
                pre { code { (prepared.shown) } }
            }
            @if let Some((name, _)) = prepared.document.as_ref().or(prepared.geometries.first()) { p { code { (name) } ":" } }
            @if !shown.document.is_empty() { pre { code { (shown.document) } } }
            p { "As a request to this service, " code { "POST /processes/" (job.process) "/execution" } ":" }
            pre { code { "{\"inputs\": " (job.inputs) "}" } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_in_the_queue_are_told_with_the_expected_time() {
        let told = |before, mean| queued(&Place { before, mean }, 2);
        assert_eq!(told(0, None), "Next in the queue");
        assert_eq!(told(1, Some(10.0)), "1 job before this one, finished in about 15 s");
        assert_eq!(told(4, Some(100.0)), "4 jobs before this one, finished in about 5 min");
    }

    #[test]
    fn texts_of_others_are_escaped() {
        let files = [ResultFile { path: "<script>alert(1)</script>\"'.laz".to_owned(), bytes: 1 }];
        let job = Job {
            id: "a".into(),
            owner: "o".into(),
            process: "run".into(),
            inputs: "</code><script>".into(),
            prepared: "{}".into(),
            fingerprint: String::new(),
            folder: "a".into(),
            status: Status::Failed,
            message: "<img src=x onerror=alert(1)>".into(),
            progress: 0,
            results: "[]".into(),
            warnings: "[]".into(),
            created: 0,
            started: None,
            finished: None,
            updated: 0,
        };
        let page = html! { (downloads(&job, &files, |_| html! {})) (state(&job, "<b>")) (command(&job, &Shown { document: "<b>".into(), ..Shown::default() })) }.into_string();
        for unsafe_text in ["<script>", "<img", "<b>"] {
            assert!(!page.contains(unsafe_text), "{page}");
        }
    }
}
