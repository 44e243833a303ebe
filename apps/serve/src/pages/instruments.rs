//! The catalogue: scanners with their figures and scan patterns.

use super::layout::page;
use super::trail::{Crumb, path};
use crate::answers::Failure;
use crate::app::{App, Identity, blocking};
use crate::program::{PATTERNS, ProgramError};
use axum::Extension;
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use maud::html;
use serde_json::Value;
use std::sync::Arc;

impl From<ProgramError> for Failure {
    fn from(error: ProgramError) -> Failure {
        eprintln!("vlscan serve: {error}");
        Failure::new(StatusCode::NOT_FOUND, "there is no picture of this instrument")
    }
}

/// A figure in words: numbers as they are, lists with commas.
fn figure(value: &Value) -> String {
    match value {
        Value::Null => "–".to_owned(),
        Value::String(text) => text.clone(),
        Value::Number(number) => {
            let number = number.as_f64().unwrap_or_default();
            let rounded = (number * 1e6).round() / 1e6;
            rounded.to_string()
        }
        Value::Bool(yes) => if *yes { "yes" } else { "no" }.to_owned(),
        Value::Array(list) => list.iter().map(figure).collect::<Vec<_>>().join(", "),
        Value::Object(map) => {
            map.iter().map(|(key, value)| format!("{key} {}", figure(value))).collect::<Vec<_>>().join(", ")
        }
    }
}

/// The name of a figure in words: `range_max_m` is "range max (m)".
fn words(key: &str) -> String {
    let units = ["m", "deg", "hz", "rad", "mrad", "nm", "ns", "uj", "km", "w"];
    match key.rsplit_once('_') {
        Some((name, unit)) if units.contains(&unit) => format!("{} ({unit})", name.replace('_', " ")),
        _ => key.replace('_', " "),
    }
}

pub async fn list(State(app): State<Arc<App>>, Extension(identity): Extension<Identity>) -> Response {
    let content = html! {
        h1 { "Instruments" }
        table {
            thead { tr { th { "Name" } th { "Optics" } th { "Pulse rates" small { " kHz" } } th { "Range" small { " m" } } th { span .hidden { "Use" } } } }
            tbody {
                @for (number, (reference, scanner)) in app.workshop.program.entries("scanners").enumerate() {
                    tr {
                        td { a href=(format!("/instruments/{number}")) { (scanner["name"].as_str().filter(|name| !name.is_empty()).unwrap_or(reference)) } }
                        td { (figure(&scanner["optics"])) }
                        td { (rates(scanner)) }
                        td { (figure(&scanner["range_max_m"])) }
                        td { a href=(format!("/new?scanner={}", super::home::encoded(reference))) { "Use" } }
                    }
                }
            }
        }
    };
    page(&app, &identity, "Instruments", &content)
}

/// The pulse rates in kHz, those of each channel where there are several.
fn rates(scanner: &Value) -> String {
    let channels = match scanner["channels"].as_u64() {
        Some(channels) if channels > 1 => format!("{channels} × "),
        _ => String::new(),
    };
    let rates: Vec<f64> =
        scanner["pulse_rates_hz"].as_array().into_iter().flatten().filter_map(Value::as_f64).collect();
    match rates.as_slice() {
        [] => "–".to_owned(),
        [one] => format!("{channels}{}", one / 1e3),
        many => {
            let (low, high) = many
                .iter()
                .fold((f64::INFINITY, 0.0_f64), |(low, high), rate| (low.min(*rate), high.max(*rate)));
            format!("{channels}{} to {}", low / 1e3, high / 1e3)
        }
    }
}

fn no_instrument() -> Failure {
    Failure::new(StatusCode::NOT_FOUND, "there is no such instrument; /instruments lists them")
}

pub async fn show(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path(number): Path<usize>,
) -> Result<Response, Failure> {
    let program = &app.workshop.program;
    let Some((reference, scanner)) = program.entries("scanners").nth(number) else {
        return Err(no_instrument());
    };
    let name = scanner["name"].as_str().filter(|name| !name.is_empty()).unwrap_or(reference);
    let instruments = Crumb { label: "Instruments".to_owned(), address: Some("/instruments".to_owned()) };
    let content = html! {
        (path(&[instruments, Crumb::here(name)]))
        h1 { (name) }
        p { code { (reference) } " · " a .button href=(format!("/new?scanner={}", super::home::encoded(reference))) { "Use it" } }
        figure {
            img .pattern src=(format!("/instruments/{number}/pattern.svg")) alt=(format!("Scan pattern of {name}"));
            figcaption { "Directions of its beams during one revolution of the head, or 0.1 s if it does not turn" }
        }
        table {
            tbody {
                @for (key, value) in scanner.as_object().into_iter().flatten() {
                    @if key != "name" && key != "reference" { tr { th scope="row" { (words(key)) } td { (figure(value)) } } }
                }
            }
        }
    };
    Ok(page(&app, &identity, name, &content))
}

pub async fn pattern(State(app): State<Arc<App>>, Path(number): Path<usize>) -> Result<Response, Failure> {
    let picture = blocking(&app, move |workshop| {
        let entry = workshop.program.entries("scanners").nth(number);
        let Some((reference, _)) = entry else { return Ok(None) };
        let store = &workshop.store;
        workshop.program.pattern(reference, &store.root().join(PATTERNS), &store.incoming()).map(Some)
    })
    .await?;
    let picture = picture.ok_or_else(no_instrument)?;
    // Its styles are written in it; nothing else may be loaded, and nothing runs.
    let policy = "default-src 'none'; style-src 'unsafe-inline'; sandbox";
    let fields = [
        (header::CONTENT_TYPE, "image/svg+xml"),
        (header::CACHE_CONTROL, "max-age=86400"),
        (header::CONTENT_SECURITY_POLICY, policy),
    ];
    Ok((fields, picture).into_response())
}
