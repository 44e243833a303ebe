//! Actions of forms: each form is checked to come from a page of the service, and leads to another page.

use super::fixes::Problem;
use super::form_body::{Fields, FormBody, genuine};
use super::layout::{bad, page};
use super::titles::{inputs_of, next_seed};
use super::{new, plan_fields};
use crate::answers::Failure;
use crate::app::{App, Identity, blocking, submitting};
use crate::processes::Process;
use crate::store::{Result as StoreResult, Status};
use crate::worker::Workshop;
use axum::Extension;
use axum::extract::{Form, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Redirect, Response};
use maud::html;
use serde_json::{Map, Value, json};
use std::sync::Arc;

type Answer = Result<Response, Failure>;

/// Adds a job and leads to its page.
async fn submit(app: &Arc<App>, identity: &Identity, process: Process, inputs: Map<String, Value>) -> Answer {
    let owner = identity.owner.clone();
    let submit = move |workshop: &Workshop| workshop.submit(&owner, process, &inputs);
    let job = submitting(app, &identity.owner, submit).await?;
    Ok(Redirect::to(&format!("/jobs/{}", job.id)).into_response())
}

pub async fn run(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    form: FormBody,
) -> Answer {
    let mut fields = genuine(&app, &identity, form)?;
    let file = fields.remove("file").ok_or_else(|| bad("choose a file"))?;
    let key = if file.to_ascii_lowercase().ends_with(".toml") { "pipeline" } else { "survey" };
    let inputs = Map::from_iter([(key.to_owned(), json!(file))]);
    run_or_forecast(&app, &identity, fields, inputs).await
}

/// A run along a trajectory.
pub async fn trajectory(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    form: FormBody,
) -> Answer {
    let mut fields = genuine(&app, &identity, form)?;
    let mut wanted = |key: &str| fields.remove(key).ok_or_else(|| bad(&format!("choose a {key}")));
    let (path, scene) = (wanted("trajectory")?, wanted("scene")?);
    let (scanner, platform) = (wanted("scanner")?, wanted("platform")?);
    let mut trajectory = json!({ "path": path });
    if let Some(zone) = fields.remove("utm_zone") {
        trajectory["utm_zone"] = json!(zone.trim());
    }
    let mut settings = Map::new();
    for key in ["pulse_freq_hz", "scan_freq_hz"] {
        if let Some(value) = fields.remove(key) {
            // Pulse rates are whole numbers.
            let number = decimal(key, &value)?;
            let is_whole = number.fract() == 0.0 && number.abs() < 1e15;
            settings.insert(key.to_owned(), if is_whole { json!(number as i64) } else { json!(number) });
        }
    }
    let mut inputs = Map::new();
    inputs.insert("trajectory".to_owned(), trajectory);
    inputs.insert("scene".to_owned(), json!(scene));
    inputs.insert("scanner".to_owned(), json!({ "catalogue": scanner }));
    inputs.insert("platform".to_owned(), json!({ "catalogue": platform }));
    if !settings.is_empty() {
        inputs.insert("settings".to_owned(), Value::Object(settings));
    }
    run_or_forecast(&app, &identity, fields, inputs).await
}

fn decimal(key: &str, value: &str) -> Result<f64, Failure> {
    value.trim().replace(',', ".").parse().map_err(|_| bad(&format!("{key}: expected a number")))
}

/// Adds a run or its forecast, with the seed and the format of a form.
async fn run_or_forecast(
    app: &Arc<App>,
    identity: &Identity,
    mut fields: Fields,
    mut inputs: Map<String, Value>,
) -> Answer {
    if let Some(seed) = fields.remove("seed") {
        let seed: u64 = seed.trim().parse().map_err(|_| bad("Seed: expected a whole number"))?;
        inputs.insert("seed".to_owned(), json!(seed));
    }
    let process = match fields.remove("action").as_deref() {
        Some("dry-run") => Process::DryRun,
        _ => Process::Run,
    };
    if let Some(format) = fields.remove("format") {
        if !super::choices::FORMATS.iter().any(|(known, _)| *known == format) {
            return Err(bad("choose a format of the list"));
        }
        inputs.insert("output".to_owned(), json!([{ "path": format!("points.{format}") }]));
    }
    submit(app, identity, process, inputs).await
}

/// A run once more, with the next seed.
pub async fn again(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    form: FormBody,
) -> Answer {
    let id = genuine(&app, &identity, form)?.remove("id").unwrap_or_default();
    let (owner, name) = (identity.owner.clone(), id.clone());
    let job = blocking(&app, move |workshop| workshop.store.job(&owner, &name)).await?;
    let job = job.filter(|job| job.process == Process::Run.id() && job.status == Status::Successful);
    let mut inputs = inputs_of(&job.ok_or_else(|| Failure::no_job(&id))?);
    inputs.insert("seed".to_owned(), json!(next_seed(&inputs)));
    submit(&app, &identity, Process::Run, inputs).await
}

/// A scene of the trees of an inventory.
pub async fn stand(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    form: FormBody,
) -> Answer {
    let fields = genuine(&app, &identity, form)?;
    let inventory = fields.get("inventory").ok_or_else(|| bad("choose an inventory"))?;
    let mut inputs = Map::from_iter([("inventory".to_owned(), json!(inventory))]);
    if let Some(trees) = fields.get("trees") {
        inputs.insert("trees".to_owned(), json!(trees));
    }
    match fields.get("terrain") {
        Some(terrain) => drop(inputs.insert("terrain".to_owned(), json!([terrain]))),
        None if fields.contains_key("flat") => drop(inputs.insert("flat".to_owned(), json!(true))),
        None => {}
    }
    submit(&app, &identity, Process::Stand, inputs).await
}

pub async fn plan(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    form: FormBody,
) -> Answer {
    let fields = genuine(&app, &identity, form)?;
    let inputs = match plan_fields::inputs(&fields) {
        Ok(inputs) => inputs,
        Err(error) => return new::again(&app, &identity, fields, Problem::of_fields(&error)).await,
    };
    match submit(&app, &identity, Process::Plan, inputs).await {
        Err(failure) if failure.status == StatusCode::BAD_REQUEST => {
            new::again(&app, &identity, fields, Problem::of_request(&failure.detail)).await
        }
        answer => answer,
    }
}

pub async fn compare(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    form: FormBody,
) -> Answer {
    let fields = genuine(&app, &identity, form)?;
    let mut inputs = Map::new();
    for key in ["first", "second"] {
        let name = fields.get(key).ok_or_else(|| bad("choose two clouds"))?;
        inputs.insert(key.to_owned(), json!(name));
    }
    submit(&app, &identity, Process::Compare, inputs).await
}

/// Has points copied for the viewer, or leads to the copy that there is.
pub async fn view(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    form: FormBody,
) -> Answer {
    let fields = genuine(&app, &identity, form)?;
    let points = fields.get("points").ok_or_else(|| bad("choose a cloud"))?;
    let inputs = json!({ "points": points, "format": "copc.laz" });
    let inputs = inputs.as_object().cloned().unwrap_or_default();
    let (owner, wanted) = (identity.owner.clone(), inputs.clone());
    let find = move |workshop: &Workshop| workshop.newest_like(&owner, Process::Preview, &wanted);
    let made = submitting(&app, &identity.owner, find).await?;
    match made {
        Some(job) => Ok(Redirect::to(&format!("/jobs/{}", job.id)).into_response()),
        None => submit(&app, &identity, Process::Preview, inputs).await,
    }
}

pub async fn dismiss(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    form: FormBody,
) -> Answer {
    let mut fields = genuine(&app, &identity, form)?;
    let id = fields.remove("id").unwrap_or_default();
    let is_giving_up = fields.contains_key("unfinished");
    let owner = identity.owner.clone();
    let name = id.clone();
    let workshop = Arc::clone(&app.workshop);
    let dismiss = move |_: &Workshop| -> StoreResult<bool> {
        // A job that has finished since its page was shown keeps its results.
        let job = workshop.store.job_state(&owner, &name)?;
        if is_giving_up && job.is_some_and(|job| job.status.is_final()) {
            return Ok(true);
        }
        workshop.dismiss(&owner, &name)
    };
    match blocking(&app, dismiss).await? {
        // The page of the job says that it is removed, given up, or finished.
        true => Ok(Redirect::to(&format!("/jobs/{id}")).into_response()),
        false => Err(Failure::no_job(&id)),
    }
}

pub async fn remove_upload(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    form: FormBody,
) -> Answer {
    let name = genuine(&app, &identity, form)?.remove("name").unwrap_or_default();
    let owner = identity.owner.clone();
    blocking(&app, move |workshop| workshop.store.remove_upload(&owner, &name)).await?;
    Ok(Redirect::to("/").into_response())
}

pub async fn login_page(State(app): State<Arc<App>>, Extension(identity): Extension<Identity>) -> Response {
    login_form(&app, &identity, "")
}

fn login_form(app: &App, identity: &Identity, message: &str) -> Response {
    let content = html! {
        h1 { "Log in" }
        @if !message.is_empty() { p .message role="alert" { (message) } }
        form .card method="post" action="/login" {
            label { "Token" input type="password" name="token" required autocomplete="current-password"; }
            button type="submit" { "Log in" }
            p { small { "The operator of this service gives you a token." } }
        }
    };
    page(app, identity, "Log in", &content)
}

pub async fn login(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    headers: HeaderMap,
    form: FormBody,
) -> Response {
    let fields = form.map(|Form(fields)| fields).unwrap_or_default();
    let Some(owner) = fields.get("token").and_then(|token| app.tokens.owner_of(token.trim())) else {
        let mut response = login_form(&app, &identity, "This token is not known.");
        *response.status_mut() = StatusCode::FORBIDDEN;
        return response;
    };
    let is_encrypted = headers.get("x-forwarded-proto").is_some_and(|value| value == "https");
    let cookie = app.sessions.begin(&owner.name, is_encrypted);
    ([(header::SET_COOKIE, cookie)], Redirect::to("/")).into_response()
}

pub async fn logout(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    headers: HeaderMap,
    form: FormBody,
) -> Answer {
    genuine(&app, &identity, form)?;
    Ok(([(header::SET_COOKIE, app.sessions.end(&headers))], Redirect::to("/login")).into_response())
}
