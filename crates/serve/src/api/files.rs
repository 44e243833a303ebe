//! Files of results, in whole or in part.

use super::jobs::find_successful;
use crate::answers::{Failure, media_type};
use crate::app::{App, Identity, blocking};
use crate::names::file_within;
use crate::security::VIEWER_POLICY;
use crate::store::StoreError;
use axum::Extension;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use std::io::SeekFrom;
use std::sync::Arc;
use tokio::io::{AsyncReadExt as _, AsyncSeekExt as _};
use tokio_util::io::ReaderStream;

pub async fn result(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path((id, path)): Path<(String, String)>,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    let job = find_successful(&app, &identity, &id).await?;
    let folder = app.workshop.store.job_folder(&job.folder).join("out");
    send(&folder, &path, &headers).await
}

/// Pictures of results.
pub async fn view(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path((id, name)): Path<(String, String)>,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    let job = find_successful(&app, &identity, &id).await?;
    let folder = app.workshop.store.job_folder(&job.folder).join("view");
    let absent = || Failure::new(StatusCode::NOT_FOUND, "there is no picture of these results");
    // One is drawn at a time.
    let permit = Arc::clone(&app.pictures).acquire_owned().await.map_err(|_| absent())?;
    let wanted = name.clone();
    let drawn = blocking(&app, move |workshop| workshop.view(&job, &wanted)).await?;
    drop(permit);
    drawn.ok_or_else(absent)?;
    send(&folder, &name, &headers).await
}

async fn send(folder: &std::path::Path, name: &str, headers: &HeaderMap) -> Result<Response, Failure> {
    let absent = || Failure::new(StatusCode::NOT_FOUND, format!("the results have no file `{name}`"));
    let path = file_within(folder, name).ok_or_else(absent)?;
    let mut file = tokio::fs::File::open(&path).await.map_err(|_| absent())?;
    let length = file.metadata().await.map_err(StoreError::from)?.len();
    let media = media_type(name);
    let range = headers
        .get(header::RANGE)
        .and_then(|value| value.to_str().ok())
        .and_then(|text| parse_range(text, length));
    let (status, start, end) = match range {
        Some(Some((start, end))) => (StatusCode::PARTIAL_CONTENT, start, end),
        Some(None) => {
            let text = format!("bytes */{length}");
            return Ok((StatusCode::RANGE_NOT_SATISFIABLE, [(header::CONTENT_RANGE, text)]).into_response());
        }
        None => (StatusCode::OK, 0, length),
    };
    if start > 0 {
        file.seek(SeekFrom::Start(start)).await.map_err(StoreError::from)?;
    }
    let body = Body::from_stream(ReaderStream::with_capacity(file.take(end - start), 64 << 10));
    let mut response = (status, body).into_response();
    let fields = response.headers_mut();
    fields.insert(header::CONTENT_TYPE, HeaderValue::from_static(media));
    fields.insert(header::CONTENT_LENGTH, HeaderValue::from(end - start));
    fields.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
    if status == StatusCode::PARTIAL_CONTENT {
        let text = format!("bytes {start}-{}/{length}", end - 1);
        fields.insert(
            header::CONTENT_RANGE,
            HeaderValue::from_str(&text).unwrap_or(HeaderValue::from_static("bytes")),
        );
    }
    match media {
        "text/html" => {
            fields.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(VIEWER_POLICY));
        }
        "image/png" | "application/json" => {}
        _ => {
            fields.insert(header::CONTENT_DISPOSITION, HeaderValue::from_static("attachment"));
        }
    }
    Ok(response)
}

/// A single range of bytes, its end exclusive: `None` for what is no such range, `Some(None)` for one beyond the file.
fn parse_range(text: &str, length: u64) -> Option<Option<(u64, u64)>> {
    let (start, end) = text.strip_prefix("bytes=")?.split_once('-')?;
    let (start, end) = match (start.trim(), end.trim()) {
        ("", last) => (length.saturating_sub(last.parse().ok()?), length),
        (start, "") => (start.parse().ok()?, length),
        (start, end) => (start.parse().ok()?, end.parse::<u64>().ok()?.saturating_add(1).min(length)),
    };
    Some((start < end).then_some((start, end)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_those_of_http() {
        for (text, expected) in [
            ("bytes=0-9", Some(Some((0, 10)))),
            ("bytes=90-", Some(Some((90, 100)))),
            ("bytes=-10", Some(Some((90, 100)))),
            ("bytes=-1000", Some(Some((0, 100)))),
            ("bytes=50-18446744073709551615", Some(Some((50, 100)))),
            ("bytes=100-", Some(None)),
            ("bytes=9-3", Some(None)),
            ("bytes=-0", Some(None)),
            ("bytes=0-1,5-6", None),
            ("lines=0-9", None),
            ("bytes=a-b", None),
        ] {
            assert_eq!(parse_range(text, 100), expected, "{text}");
        }
    }
}
