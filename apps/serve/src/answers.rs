//! Answers: failures, documents, links, and whether a page is wanted.

use crate::store::StoreError;
use crate::submit::SubmitError;
use crate::uploads::UploadError;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

/// A failure, as the standard has exceptions (RFC 7807).
#[derive(Clone, Debug)]
pub struct Failure {
    /// The status.
    pub status: StatusCode,
    kind: &'static str,
    /// Problem, and what to do instead.
    pub detail: String,
}

impl Failure {
    /// A failure without a name in the standard.
    pub fn new(status: StatusCode, detail: impl Into<String>) -> Failure {
        Failure { status, kind: "about:blank", detail: detail.into() }
    }

    /// There is no such process.
    pub fn no_process(id: &str) -> Failure {
        let kind = "http://www.opengis.net/def/exceptions/ogcapi-processes-1/1.0/no-such-process";
        Failure {
            status: StatusCode::NOT_FOUND,
            kind,
            detail: format!("there is no process `{id}`; /processes lists them"),
        }
    }

    /// There is no such job.
    pub fn no_job(id: &str) -> Failure {
        let kind = "http://www.opengis.net/def/exceptions/ogcapi-processes-1/1.0/no-such-job";
        Failure {
            status: StatusCode::NOT_FOUND,
            kind,
            detail: format!("there is no job `{id}`; /jobs lists them"),
        }
    }

    /// The job has no results yet.
    pub fn not_ready(detail: String) -> Failure {
        let kind = "http://www.opengis.net/def/exceptions/ogcapi-processes-1/1.0/result-not-ready";
        Failure { status: StatusCode::NOT_FOUND, kind, detail }
    }
}

impl IntoResponse for Failure {
    fn into_response(self) -> Response {
        let title = self.status.canonical_reason().unwrap_or_default();
        let body = json!({ "type": self.kind, "title": title, "status": self.status.as_u16(), "detail": self.detail });
        let fields = [(header::CONTENT_TYPE, "application/problem+json")];
        let mut response = (self.status, fields, body.to_string()).into_response();
        // For browsers it becomes a page.
        response.extensions_mut().insert(self);
        response
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Failure {
        eprintln!("vlscan serve: {error}");
        if error.is_full_disk() {
            let message = "the disk of the service is full; try again when its operator has made room";
            return Failure::new(StatusCode::INSUFFICIENT_STORAGE, message);
        }
        Failure::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "the service has a fault; its operator finds the reason in its log",
        )
    }
}

impl From<SubmitError> for Failure {
    fn from(error: SubmitError) -> Failure {
        use crate::request::RequestError;
        let status = match error {
            SubmitError::Store(error) | SubmitError::Request(RequestError::Store(error)) => {
                return error.into();
            }
            SubmitError::Request(_) => StatusCode::BAD_REQUEST,
            SubmitError::Full(_) => StatusCode::TOO_MANY_REQUESTS,
            SubmitError::Stored(_) | SubmitError::Rows(_) => StatusCode::FORBIDDEN,
        };
        Failure::new(status, error.to_string())
    }
}

impl From<UploadError> for Failure {
    fn from(error: UploadError) -> Failure {
        let status = match error {
            UploadError::Store(error) => return error.into(),
            UploadError::TooLarge(_) => StatusCode::PAYLOAD_TOO_LARGE,
            UploadError::Taken(_) => StatusCode::CONFLICT,
            UploadError::Forged => StatusCode::FORBIDDEN,
            UploadError::Form(ref e) => e.status(),
            UploadError::Wrong(_) => StatusCode::BAD_REQUEST,
        };
        Failure::new(status, error.to_string())
    }
}

/// True if a page is wanted, by `?f=html` or by what the browser accepts; programs get JSON.
pub fn wants_page(headers: &HeaderMap, query: Option<&str>) -> bool {
    let asked = query.unwrap_or_default().split('&').find_map(|pair| pair.strip_prefix("f="));
    match asked {
        Some(format) => format == "html",
        None => {
            let accepted =
                headers.get(header::ACCEPT).and_then(|value| value.to_str().ok()).unwrap_or_default();
            accepted.contains("text/html")
        }
    }
}

/// A link of a document.
pub fn link(href: &str, rel: &str, media: &str, title: &str) -> Value {
    json!({ "href": href, "rel": rel, "type": media, "title": title })
}

/// JSON as an answer.
pub fn document(value: &Value) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

/// The media type of a file, by its ending.
pub fn media_type(path: &str) -> &'static str {
    match path.rsplit('.').next().unwrap_or_default().to_ascii_lowercase().as_str() {
        "laz" => "application/vnd.laszip",
        "las" => "application/vnd.las",
        "json" => "application/json",
        "jsonl" => "application/jsonl",
        "toml" => "application/toml",
        "html" => "text/html",
        "xml" => "application/xml",
        "png" => "image/png",
        "tif" => "image/tiff",
        "csv" => "text/csv",
        "xyz" | "txt" => "text/plain",
        "parquet" => "application/vnd.apache.parquet",
        "arrow" => "application/vnd.apache.arrow.file",
        _ => "application/octet-stream",
    }
}

/// A path as part of an address.
pub fn encoded(path: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~/".contains(&byte);
    path.bytes()
        .map(|byte| if plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_insufficient_storage() {
        for (error, status) in [
            (std::io::ErrorKind::StorageFull, 507),
            (std::io::ErrorKind::QuotaExceeded, 507),
            (std::io::ErrorKind::PermissionDenied, 500),
        ] {
            let failure = Failure::from(UploadError::from(std::io::Error::from(error)));
            assert_eq!(failure.status.as_u16(), status, "{error}");
        }
        let full = rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_FULL);
        let full = StoreError::Database(rusqlite::Error::SqliteFailure(full, None));
        assert_eq!(Failure::from(full).status, StatusCode::INSUFFICIENT_STORAGE);
    }

    #[test]
    fn addresses_are_encoded() {
        assert_eq!(encoded("a b/ä\"<.laz"), "a%20b/%C3%A4%22%3C.laz");
    }
}
