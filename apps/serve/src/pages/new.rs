//! Forms of new jobs: a flight, a plot or a drive to plan, a recorded flight, a survey, a stand to make, two
//! clouds to compare.

use super::choices::{CLOUDS, Files};
use super::form_body::{FormBody, genuine};
use super::home::encoded;
use super::layout::{form_token, page};
use super::scan_form::{SHAPES, Values, form};
use crate::answers::Failure;
use crate::app::{App, Identity, blocking};
use axum::Extension;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::Response;
use maud::html;
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
    show(&app, &identity, &Values { given, is_again, wrong: String::new() }).await
}

/// Shows a form again, with what is wrong with a field.
pub async fn again(
    app: &Arc<App>,
    identity: &Identity,
    given: BTreeMap<String, String>,
    wrong: &str,
) -> Result<Response, Failure> {
    let mut response =
        show(app, identity, &Values { given, is_again: true, wrong: wrong.to_owned() }).await?;
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
        let mut corners: Vec<String> = match is_same && shape.kind != "point" {
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
    show(&app, &identity, &Values { given, is_again: true, wrong: String::new() }).await
}

async fn show(app: &Arc<App>, identity: &Identity, values: &Values) -> Result<Response, Failure> {
    let owner = identity.owner.clone();
    let files = blocking(app, move |workshop| Files::of(&workshop.store, &owner)).await?;
    let kind = KINDS.iter().find(|(kind, _)| *kind == values.of("kind", "")).unwrap_or(&KINDS[0]);
    let content = html! {
        h1 { "New scan" }
        @if files.is_empty() {
            p .lead { "There are no files yet: " a href="/" { "upload a scene" } " first." }
        }
        nav .kinds aria-label="Kinds of scans" {
            @for (other, name) in KINDS {
                a href=(address(other, values)) aria-current=[(other == kind.0).then_some("page")] { (name) }
            }
        }
        script src="/static/draw.js" defer {}
        @if !values.wrong.is_empty() { pre .message role="alert" { (values.wrong) } }
        section .card aria-labelledby="kind" {
            (form(app, identity, kind.0, &files, values))
        }
    };
    Ok(page(app, identity, kind.1, &content))
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
    let files = blocking(&app, move |workshop| Files::with_results(&workshop.store, &owner)).await?;
    let clouds = files.with(&CLOUDS);
    let asked = |key: &str| query.get(key).map(String::as_str).unwrap_or_default();
    let content = html! {
        h1 { "Compare two clouds" }
        @if clouds.len() < 2 { p .lead { "This needs two clouds: upload one, or run a scan." } }
        form .card method="post" action="/forms/compare" {
            (form_token(&app, &identity))
            (files.choice("first", "First cloud, usually the measured one", &clouds, None, asked("first")))
            (files.choice("second", "Second cloud, usually the simulated one", &clouds, None, asked("second")))
            button type="submit" { "Compare" }
        }
    };
    Ok(page(&app, &identity, "Compare", &content))
}
