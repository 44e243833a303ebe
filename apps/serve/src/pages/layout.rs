//! Parts of all pages, and pages without data of their own.

use crate::answers::Failure;
use crate::app::{App, Identity};
use crate::store::time_text;
use crate::tokens::LOCAL;
use axum::http::StatusCode;
use axum::response::{Html, IntoResponse as _, Response};
use maud::{DOCTYPE, Markup, html};
use serde_json::Value;

/// A page.
pub fn page(app: &App, identity: &Identity, title: &str, content: &Markup) -> Response {
    let is_known = !identity.owner.is_empty();
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) " · vlscan" }
                link rel="stylesheet" href="/static/style.css";
                link rel="icon" href="/static/icon.svg";
                script src="/static/page.js" defer {}
            }
            body {
                a .skip href="#content" { "To the content" }
                header {
                    a .brand href="/" { "vlscan" }
                    @if is_known {
                        nav aria-label="Pages" {
                            a href="/new" { "New scan" }
                            a href="/jobs" { "Jobs" }
                            a href="/compare" { "Compare" }
                            a href="/instruments" { "Instruments" }
                            a href="/api" { "Interface" }
                        }
                    }
                    @if is_known && identity.owner != LOCAL {
                        form .inline method="post" action="/forms/logout" {
                            (form_token(app, identity))
                            button .quiet type="submit" { "Log out " (identity.owner) }
                        }
                    }
                }
                main #content { (content) }
            }
        }
    };
    Html(page.into_string()).into_response()
}

/// The hidden field by which forms are recognised.
pub fn form_token(app: &App, identity: &Identity) -> Markup {
    html! { input type="hidden" name="csrf" value=(app.form_token(&identity.owner)); }
}

/// The page of a failure.
pub fn failure(app: &App, identity: &Identity, failure: &Failure) -> Response {
    let content = html! {
        h1 { "That did not work" }
        pre .message { (failure.detail) }
        p { a href="/" { "Back to files and jobs" } }
    };
    let mut response = page(app, identity, "Error", &content);
    *response.status_mut() = failure.status;
    response
}

/// The documentation of the interface for programs.
pub fn interface(app: &App, identity: &Identity, definition: &Value) -> Response {
    let paths = definition["paths"].as_object();
    let content = html! {
        h1 { "Interface for programs" }
        p {
            "OGC API - Processes, Part 1: Core 1.0. "
            a href="/api?f=json" { "Definition (OpenAPI 3.0)" } " · " a href="/conformance" { "Conformance" } " · "
            a href="/processes" { "Processes" }
        }
        table {
            thead { tr { th { "Address" } th { "Method" } th { "What it does" } } }
            tbody {
                @for (path, methods) in paths.into_iter().flatten() {
                    @for (method, operation) in methods.as_object().into_iter().flatten() {
                        tr { td { code { (path) } } td { (method.to_uppercase()) } td { (operation["summary"].as_str().unwrap_or_default()) } }
                    }
                }
            }
        }
        h2 { "Inputs of processes" }
        @for process in crate::processes::Process::ALL {
            @let description = process.description(&app.workshop.program);
            details {
                summary { (process.title()) ": " code { (process.id()) } }
                p { (description["description"].as_str().unwrap_or_default()) }
                table {
                    tbody {
                        @for (key, input) in description["inputs"].as_object().into_iter().flatten() {
                            tr { td { code { (key) } } td { (input["description"].as_str().unwrap_or_default()) } }
                        }
                    }
                }
            }
        }
    };
    page(app, identity, "Interface", &content)
}

/// A number of bytes in words.
pub fn bytes_text(bytes: u64) -> String {
    let mut amount = bytes as f64;
    for unit in ["bytes", "kB", "MB", "GB"] {
        if amount < 1000.0 {
            return if unit == "bytes" { format!("{bytes} bytes") } else { format!("{amount:.1} {unit}") };
        }
        amount /= 1000.0;
    }
    format!("{amount:.1} TB")
}

/// A time to the minute.
pub fn short_time(ms: i64) -> String {
    time_text(ms).get(..16).unwrap_or_default().replace('T', " ") + " UTC"
}

/// A time, which a script shows in the zone of the browser.
pub fn local_time(ms: i64) -> Markup {
    html! { time datetime=(time_text(ms)) { (short_time(ms)) } }
}

/// A failure of a form's field.
pub fn bad(message: &str) -> Failure {
    Failure::new(StatusCode::BAD_REQUEST, message)
}
