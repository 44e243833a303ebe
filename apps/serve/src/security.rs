//! Admission of requests: who asks, and whether a request that changes something comes from a page of the
//! service. Headers of answers.

use crate::answers::{Failure, wants_page};
use crate::app::{App, Identity};
use crate::pages;
use crate::query::check_encoding;
use axum::extract::{Request, State};
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Redirect, Response};
use std::sync::Arc;

/// Policy of pages: they load only what the service has, and nobody shows them in frames.
const PAGE_POLICY: &str =
    "default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; object-src 'none'";
/// Policy of pages that vlscan has written: they run their own scripts, in an origin of their own and
/// without a network, in frames of ours.
pub const VIEWER_POLICY: &str = "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; \
                                 img-src data: blob:; frame-ancestors 'self'";

/// True if the browser says that a request comes from a page of another site.
fn is_foreign(headers: &HeaderMap) -> bool {
    let text = |name: HeaderName| headers.get(name).and_then(|value| value.to_str().ok());
    if let Some(site) = text(HeaderName::from_static("sec-fetch-site")) {
        return !matches!(site, "same-origin" | "none");
    }
    match (text(header::ORIGIN), text(header::HOST)) {
        (Some(origin), Some(host)) => {
            origin.split_once("://").is_none_or(|(_, from)| !from.eq_ignore_ascii_case(host))
        }
        (Some(_), None) => true,
        (None, _) => false,
    }
}

/// True if a proxy says that it passes on a request: others may reach the service through it, whatever name
/// it gives the service.
fn is_forwarded(headers: &HeaderMap) -> bool {
    ["forwarded", "x-forwarded-for", "x-real-ip"].iter().any(|name| headers.contains_key(*name))
}

/// Admits requests, and gives all answers their headers.
pub async fn guard(State(app): State<Arc<App>>, mut request: Request, next: Next) -> Response {
    let is_page = wants_page(request.headers(), request.uri().query());
    let response = match admit(&app, &request) {
        Ok(identity) => {
            request.extensions_mut().insert(identity.clone());
            let response = match check_encoding(request.uri()) {
                Ok(()) => next.run(request).await,
                Err(failure) => failure.into_response(),
            };
            let response = as_problem(response);
            match response.extensions().get::<Failure>() {
                Some(failure) if is_page => pages::failure(&app, &identity, failure),
                _ => response,
            }
        }
        Err(response) => *response,
    };
    with_headers(response)
}

/// Gives errors that are no failures of the service, but of what reads requests, the form of all others.
fn as_problem(response: Response) -> Response {
    let status = response.status();
    let is_error = status.is_client_error() || status.is_server_error();
    let media = response.headers().get(header::CONTENT_TYPE).and_then(|media| media.to_str().ok());
    let is_plain = media.is_none_or(|media| media.starts_with("text/plain"));
    if !is_error || !is_plain || response.extensions().get::<Failure>().is_some() {
        return response;
    }
    let allowed = response.headers().get(header::ALLOW).cloned();
    // The router may add the field later.
    let methods = allowed.as_ref().and_then(|methods| methods.to_str().ok()).unwrap_or("those of `Allow`");
    let detail = match status {
        StatusCode::METHOD_NOT_ALLOWED => format!("the address has no such method; it has {methods}"),
        StatusCode::PAYLOAD_TOO_LARGE => "the request is larger than the service takes".to_owned(),
        StatusCode::UNSUPPORTED_MEDIA_TYPE => {
            "the request is of another type than the service takes".to_owned()
        }
        _ => "the request cannot be read".to_owned(),
    };
    let mut response = Failure::new(status, detail).into_response();
    if let Some(methods) = allowed {
        response.headers_mut().insert(header::ALLOW, methods);
    }
    response
}

fn admit(app: &App, request: &Request) -> Result<Identity, Box<Response>> {
    let refuse = |status: StatusCode, message: &str| {
        Box::new(Failure::new(status, message.to_owned()).into_response())
    };
    let headers = request.headers();
    if !app.is_own_host(headers) {
        let message = "the service is not known by this name; its operator can add it with --host NAME";
        return Err(refuse(StatusCode::MISDIRECTED_REQUEST, message));
    }
    if app.tokens.is_empty() && !app.workshop.limits.open && is_forwarded(headers) {
        let message = "the request comes through a proxy, and the service has no tokens; its operator can give it a \
                       token file, or start it with --host NAME --open";
        return Err(refuse(StatusCode::FORBIDDEN, message));
    }
    let changes = !matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    let Some(identity) = app.identity(headers) else {
        let path = request.uri().path();
        if path == "/login" || path.starts_with("/static/") {
            if changes && is_foreign(headers) {
                return Err(refuse(StatusCode::FORBIDDEN, "the request comes from a page of another site"));
            }
            return Ok(Identity { owner: String::new(), is_ambient: true });
        }
        if !changes && wants_page(headers, request.uri().query()) {
            return Err(Box::new(Redirect::to("/login").into_response()));
        }
        let mut response =
            refuse(StatusCode::UNAUTHORIZED, "a token is needed: `Authorization: Bearer TOKEN`");
        response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        return Err(response);
    };
    if changes && identity.is_ambient && is_foreign(headers) {
        return Err(refuse(StatusCode::FORBIDDEN, "the request comes from a page of another site"));
    }
    Ok(identity)
}

fn with_headers(mut response: Response) -> Response {
    let headers = response.headers_mut();
    let is_viewer = headers.get(header::CONTENT_SECURITY_POLICY).is_some();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, PAGE_POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::X_FRAME_OPTIONS, if is_viewer { "SAMEORIGIN" } else { "DENY" }),
        (header::REFERRER_POLICY, "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (header::CACHE_CONTROL, "no-store"),
    ] {
        headers.entry(name).or_insert(HeaderValue::from_static(value));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(&'static str, &'static str)]) -> HeaderMap {
        pairs
            .iter()
            .map(|(name, value)| (HeaderName::from_static(name), HeaderValue::from_static(value)))
            .collect()
    }

    #[test]
    fn errors_of_the_framework_become_problems() {
        let bare = (StatusCode::METHOD_NOT_ALLOWED, [(header::ALLOW, "GET,HEAD")]).into_response();
        let problem = as_problem(bare);
        assert_eq!(problem.headers()[header::CONTENT_TYPE], "application/problem+json");
        assert_eq!(problem.headers()[header::ALLOW], "GET,HEAD");
        let told = problem.extensions().get::<Failure>().map(|failure| failure.detail.clone());
        assert!(told.is_some_and(|told| told.contains("GET,HEAD")));
        let text = (StatusCode::PAYLOAD_TOO_LARGE, "Failed to buffer").into_response();
        assert_eq!(as_problem(text).headers()[header::CONTENT_TYPE], "application/problem+json");
        for response in [StatusCode::NO_CONTENT.into_response(), "text".into_response()] {
            assert!(as_problem(response).extensions().get::<Failure>().is_none());
        }
        // Pages of errors stay pages.
        let page = (StatusCode::FORBIDDEN, [(header::CONTENT_TYPE, "text/html")], "<p>").into_response();
        assert_eq!(as_problem(page).headers()[header::CONTENT_TYPE], "text/html");
    }

    #[test]
    fn requests_through_proxies_are_recognised() {
        assert!(is_forwarded(&headers(&[("host", "localhost"), ("x-forwarded-for", "203.0.113.7")])));
        assert!(is_forwarded(&headers(&[("forwarded", "for=203.0.113.7")])));
        assert!(!is_forwarded(&headers(&[("host", "localhost"), ("x-forwarded-proto", "https")])));
    }

    #[test]
    fn requests_of_other_sites_are_recognised() {
        for (pairs, foreign) in [
            (vec![], false),
            (vec![("sec-fetch-site", "same-origin")], false),
            (vec![("sec-fetch-site", "none")], false),
            (vec![("sec-fetch-site", "cross-site")], true),
            (vec![("sec-fetch-site", "same-site")], true),
            (vec![("origin", "http://127.0.0.1:8080"), ("host", "127.0.0.1:8080")], false),
            (vec![("origin", "http://127.0.0.1:9090"), ("host", "127.0.0.1:8080")], true),
            (vec![("origin", "null"), ("host", "127.0.0.1:8080")], true),
            (vec![("origin", "http://localhost:8080"), ("host", "LOCALHOST:8080")], false),
        ] {
            assert_eq!(is_foreign(&headers(&pairs)), foreign, "{pairs:?}");
        }
    }
}
