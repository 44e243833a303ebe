//! Forms of new jobs: a flight, a plot or a drive to plan, a recorded flight, a survey, a stand to make, two
//! clouds to compare.

use super::choices::{CLOUDS, Files};
use super::fixes::{Problem, Usual, buttons};
use super::form_body::{FormBody, genuine};
use super::home::encoded;
use super::layout::{form_token, page};
use super::mesh::level;
use super::plan_fields;
use super::scan_form::{SHAPES, Values, form, height_for, shown_scene};
use super::trail::{Crumb, path};
use crate::answers::Failure;
use crate::app::{App, Identity, blocking};
use crate::processes::Process;
use crate::store::{Job, Result as StoreResult};
use axum::Extension;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::Response;
use maud::{Markup, html};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Kinds of new scans: the kind in addresses, and its name.
const KINDS: [(&str, &str); 6] = [
    ("airborne", "Flight"),
    ("terrestrial", "Tripod"),
    ("mobile", "Drive"),
    ("trajectory", "Recorded flight"),
    ("survey", "Survey file"),
    ("stand", "Trees of an inventory"),
];

pub async fn new(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Query(given): Query<BTreeMap<String, String>>,
) -> Result<Response, Failure> {
    let is_again = given.contains_key("again");
    show(&app, &identity, &Values { given, is_again, problem: None }).await
}

/// Shows a form again, with what is wrong with a field.
pub async fn again(
    app: &Arc<App>,
    identity: &Identity,
    given: BTreeMap<String, String>,
    problem: Problem,
) -> Result<Response, Failure> {
    let mut response = show(app, identity, &Values { given, is_again: true, problem: Some(problem) }).await?;
    *response.status_mut() = StatusCode::BAD_REQUEST;
    Ok(response)
}

/// Shows the form again with one corner more, where the picture of the scene was clicked.
pub async fn corner(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    form: FormBody,
) -> Result<Response, Failure> {
    let mut given = genuine(&app, &identity, form)?;
    for shape in SHAPES {
        let mut click = |axis: &str| given.remove(&format!("{}.{axis}", shape.field))?.parse::<f64>().ok();
        let (Some(x), Some(y)) = (click("x"), click("y")) else { continue };
        let text = |key: &str| given.get(key).cloned().unwrap_or_default();
        let (scene, mapped) = (text("scene"), text("mapped"));
        // Another scene was chosen since: its picture comes first.
        let is_same = scene == mapped;
        let mut corners: Vec<String> = match is_same {
            true => text("corners").split(", ").filter(|one| !one.is_empty()).map(str::to_owned).collect(),
            false => Vec::new(),
        };
        if is_same {
            let owner = identity.owner.clone();
            let map = super::map::scene_map(&app, owner, scene).await?;
            let [x, y] = map.frame.place(x, y);
            corners.push(format!("{x} {y}"));
        }
        given.insert(shape.field.to_owned(), shape.text(&corners));
        given.insert("corners".to_owned(), corners.join(", "));
    }
    show(&app, &identity, &Values { given, is_again: true, problem: None }).await
}

async fn show(app: &Arc<App>, identity: &Identity, values: &Values) -> Result<Response, Failure> {
    let owner = identity.owner.clone();
    let files = blocking(app, move |workshop| Files::of(workshop, &owner)).await?;
    let (owner, scene) = (identity.owner.clone(), shown_scene(&files, values).to_owned());
    let level = blocking(app, move |workshop| level(&workshop.store, &owner, &scene)).await?;
    let (kind, name) = kind_of(values);
    let content = html! {
        (path(&[Crumb::files(), Crumb::here(name)]))
        h1 { "New scan" }
        @if files.is_empty() {
            p .lead { "There are no files yet: " a href="/" { "upload a scene" } " first." }
        }
        nav .kinds aria-label="Kinds of scans" {
            @for (other, name) in KINDS {
                a href=(address(other, values)) aria-current=[(other == kind).then_some("page")] { (name) }
            }
        }
        script src="/static/draw.js" defer {}
        @if let Some(problem) = &values.problem { pre .message role="alert" { (problem.text) } }
        section .card aria-labelledby="kind" {
            (form(app, identity, kind, &files, values, level))
        }
    };
    Ok(page(app, identity, name, &content))
}

/// The kind of a scan, and its name.
fn kind_of(values: &Values) -> (&'static str, &'static str) {
    let kind = values.of("kind", "");
    KINDS.into_iter().find(|(known, _)| *known == kind).unwrap_or(KINDS[0])
}

/// The form of a plan that has failed: with what was filled in, the problem at its field, and buttons that
/// solve it.
pub async fn failed_plan(app: &Arc<App>, identity: &Identity, job: &Job) -> Result<Markup, Failure> {
    let inputs: Map<String, Value> = serde_json::from_str(&job.inputs).unwrap_or_default();
    let given = plan_fields::fields(Process::Plan, &inputs).unwrap_or_default();
    let (owner, scene) = (identity.owner.clone(), given.get("scene").cloned().unwrap_or_default());
    let (files, level) = blocking(app, move |workshop| -> StoreResult<_> {
        Ok((Files::of(workshop, &owner)?, level(&workshop.store, &owner, &scene)?))
    })
    .await?;
    let flight = height_for(app, given.get("scanner").map_or("", String::as_str));
    let usual = Usual { level: level.unwrap_or(0.0), flight };
    let problem = Problem::of_plan(&job.message, &given, usual);
    let solutions = buttons(app, identity, &problem, &given);
    let values = Values { given, is_again: true, problem: Some(problem) };
    Ok(html! {
        (solutions)
        script src="/static/draw.js" defer {}
        section .card aria-labelledby="kind" {
            (form(app, identity, kind_of(&values).0, &files, &values, level))
        }
    })
}

/// The address of another kind of scan, with what is chosen already.
fn address(kind: &str, values: &Values) -> String {
    let mut address = format!("/new?kind={kind}");
    for key in ["upload", "scene", "scanner"] {
        let value = values.of(key, "");
        if !value.is_empty() {
            address += &format!("&{key}={}", encoded(value));
        }
    }
    address
}

pub async fn compare(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Query(query): Query<BTreeMap<String, String>>,
) -> Result<Response, Failure> {
    let owner = identity.owner.clone();
    let files = blocking(&app, move |workshop| Files::with_results(workshop, &owner)).await?;
    let clouds = files.with(&CLOUDS);
    let asked = |key: &str| query.get(key).map(String::as_str).unwrap_or_default();
    let content = html! {
        (path(&[Crumb::files(), Crumb::here("Comparison")]))
        h1 { "Compare two clouds" }
        @if clouds.len() < 2 {
            p .lead { "This needs two clouds: " a href="/" { "upload one" } ", or run a " a href="/new" { "new scan" } "." }
        }
        form .card method="post" action="/forms/compare" {
            (form_token(&app, &identity))
            (files.choice("first", "First cloud, usually the measured one", &clouds, None, asked("first")))
            (files.choice("second", "Second cloud, usually the simulated one", &clouds, None, asked("second")))
            button type="submit" { "Compare" }
        }
    };
    Ok(page(&app, &identity, "Compare", &content))
}
