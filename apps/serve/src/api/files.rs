//! Files of results and uploads, in whole or in part.

use super::jobs::find_successful;
use super::received::find;
use crate::answers::{Failure, media_type};
use crate::app::{App, Identity, blocking};
use crate::beneath::Beneath;
use crate::files::Files;
use crate::names::relative_path;
use crate::records::Kind;
use crate::security::VIEWER_POLICY;
use crate::store::StoreError;
use crate::tokens::hex;
use crate::worker::Workshop;
use axum::Extension;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use sha2::{Digest as _, Sha256};
use std::io::SeekFrom;
use std::ops::Range;
use std::sync::Arc;
use tokio::io::{AsyncReadExt as _, AsyncSeekExt as _};
use tokio_util::io::ReaderStream;

/// The media type of files of uploads, whatever they are.
const UPLOADED: &str = "application/octet-stream";

pub async fn result(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path((id, path)): Path<(String, String)>,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    let job = find_successful(&app, &identity, &id).await?;
    let bytes = job.result_files().into_iter().find(|file| file.path == path).map(|file| file.bytes);
    kept(&app, (Kind::Results, &job.folder), &path, bytes, &headers).await
}

pub async fn uploaded(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path((name, path)): Path<(String, String)>,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    let (upload, files) = find(&app, &identity, &name).await?;
    let bytes = files.into_iter().find(|file| file.path == path).map(|file| file.bytes);
    kept(&app, (Kind::Upload, &upload.id), &path, bytes, &headers).await
}

/// A file of an upload or of results, of so many bytes if it is listed.
pub(super) async fn kept(
    app: &App,
    (kind, id): (Kind, &str),
    path: &str,
    bytes: Option<u64>,
    headers: &HeaderMap,
) -> Result<Response, Failure> {
    let bytes = bytes.ok_or_else(|| no_file(path))?;
    // Browsers open nothing of what was uploaded.
    let media = match kind {
        Kind::Upload => UPLOADED,
        Kind::Results => media_type(path),
    };
    let tag = tag_of(kind, id, path);
    match &app.workshop.store.kept {
        Files::Folder => send(&app.workshop.store.local(kind, id), path, media, headers, &tag).await,
        Files::Bucket(bucket) => {
            let part = Part::of(headers, bytes, &tag);
            if part.range.is_none() {
                return Ok(part.answer(media, Body::empty()));
            }
            let range = part.range.clone().unwrap_or(0..0);
            let body = bucket.body(kind, id, path, range).await;
            Ok(part.answer(media, body.map_err(StoreError::Bucket)?))
        }
    }
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
    let (known, wanted) = (job.clone(), name.clone());
    let tag = tag_of(Kind::Results, &job.folder, &format!("view/{name}"));
    let is_there = blocking(&app, move |workshop| Ok::<_, StoreError>(workshop.has_view(&known, &wanted)));
    if !is_there.await? {
        let turn = app.turn_to_draw(&identity.owner).await?;
        let wanted = name.clone();
        // The turn ends with the drawing, not with the connection.
        let draw = move |workshop: &Workshop| {
            let drawn = workshop.view(&job, &wanted);
            drop(turn);
            drawn
        };
        if !blocking(&app, draw).await? {
            return Err(absent());
        }
    }
    send(&folder, &name, media_type(&name), &headers, &tag).await
}

/// The entity tag of a file. Files never change once they are listed, and the ids of uploads and results are
/// random: an upload that is removed and made anew has other tags.
fn tag_of(kind: Kind, id: &str, path: &str) -> String {
    let digest: [u8; 32] = Sha256::digest(format!("{}/{id}/{path}", kind.name()).as_bytes()).into();
    format!("\"{}\"", hex(&digest[..16]))
}

async fn send(
    folder: &std::path::Path,
    name: &str,
    media: &'static str,
    headers: &HeaderMap,
    tag: &str,
) -> Result<Response, Failure> {
    let path = relative_path(name).ok_or_else(|| no_file(name))?;
    let file = Beneath::of(folder).and_then(|folder| folder.file(path)).map_err(|_| no_file(name))?;
    let mut file = tokio::fs::File::from_std(file);
    let length = file.metadata().await.map_err(StoreError::from)?.len();
    let part = Part::of(headers, length, tag);
    let range = part.range.clone().unwrap_or(0..0);
    if range.start > 0 {
        file.seek(SeekFrom::Start(range.start)).await.map_err(StoreError::from)?;
    }
    let bytes = ReaderStream::with_capacity(file.take(range.end - range.start), 64 << 10);
    Ok(part.answer(media, Body::from_stream(bytes)))
}

/// The failure for a file that does not exist.
pub(super) fn no_file(name: &str) -> Failure {
    Failure::new(StatusCode::NOT_FOUND, format!("there is no file `{name}`"))
}

/// The part of a file that a request asks for.
#[derive(Clone, Debug)]
struct Part {
    status: StatusCode,
    /// Its bytes; `None` if the file does not have them, or the sender has them.
    range: Option<Range<u64>>,
    length: u64,
    tag: HeaderValue,
}

impl Part {
    fn of(headers: &HeaderMap, length: u64, tag: &str) -> Part {
        let value = HeaderValue::from_str(tag).unwrap_or(HeaderValue::from_static("\"\""));
        if has_current(headers, tag) {
            return Part { status: StatusCode::NOT_MODIFIED, range: None, length, tag: value };
        }
        let text = headers.get(header::RANGE).and_then(|value| value.to_str().ok());
        // Parts of another version are of no use: the whole file is sent.
        let is_current = headers.get(header::IF_RANGE).is_none_or(|known| known.as_bytes() == tag.as_bytes());
        let text = text.filter(|_| is_current);
        let (status, range) = match text.and_then(|text| parse_range(text, length)) {
            Some(Some((start, end))) => (StatusCode::PARTIAL_CONTENT, Some(start..end)),
            Some(None) => (StatusCode::RANGE_NOT_SATISFIABLE, None),
            None => (StatusCode::OK, Some(0..length)),
        };
        Part { status, range, length, tag: value }
    }

    /// The answer with the part of a file of this media type as its body.
    fn answer(self, media: &'static str, body: Body) -> Response {
        let length = self.length;
        let Some(range) = self.range else {
            if self.status == StatusCode::NOT_MODIFIED {
                return (self.status, [(header::ETAG, self.tag)]).into_response();
            }
            let failure = Failure::new(self.status, format!("the file has {length} bytes"));
            return ([(header::CONTENT_RANGE, format!("bytes */{length}"))], failure).into_response();
        };
        let mut response = (self.status, body).into_response();
        let fields = response.headers_mut();
        fields.insert(header::CONTENT_TYPE, HeaderValue::from_static(media));
        fields.insert(header::CONTENT_LENGTH, HeaderValue::from(range.end - range.start));
        fields.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
        fields.insert(header::ETAG, self.tag);
        if self.status == StatusCode::PARTIAL_CONTENT {
            let text = format!("bytes {}-{}/{length}", range.start, range.end - 1);
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
        response
    }
}

/// True if the sender has the file of this tag already (`If-None-Match`).
fn has_current(headers: &HeaderMap, tag: &str) -> bool {
    let known = headers.get_all(header::IF_NONE_MATCH).iter().filter_map(|value| value.to_str().ok());
    let mut known = known.flat_map(|value| value.split(',')).map(str::trim);
    known.any(|known| known == "*" || known.strip_prefix("W/").unwrap_or(known) == tag)
}

/// A single range of bytes, its end exclusive: `None` for what is no such range, `Some(None)` for one beyond
/// the file.
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
    fn tags_tell_versions_apart() {
        let tag = tag_of(Kind::Upload, "first", "a.obj");
        assert_ne!(tag, tag_of(Kind::Upload, "second", "a.obj"));
        assert_ne!(tag, tag_of(Kind::Results, "first", "a.obj"));
        let part = |fields: &[(header::HeaderName, &str)]| {
            let fields =
                fields.iter().map(|(name, value)| (name.clone(), value.parse::<HeaderValue>().unwrap()));
            let part = Part::of(&fields.collect::<HeaderMap>(), 100, &tag);
            (part.status.as_u16(), part.range)
        };
        let range = (header::RANGE, "bytes=10-19");
        let other = tag_of(Kind::Upload, "second", "a.obj");
        let weak = format!("W/{tag}");
        for (name, value, expected) in [
            (header::IF_RANGE, tag.as_str(), (206, Some(10..20))),
            (header::IF_RANGE, other.as_str(), (200, Some(0..100))),
            // Weak tags and times do not tell bytes apart.
            (header::IF_RANGE, weak.as_str(), (200, Some(0..100))),
            (header::IF_RANGE, "Sat, 28 Nov 2026 00:00:00 GMT", (200, Some(0..100))),
            (header::IF_NONE_MATCH, tag.as_str(), (304, None)),
            (header::IF_NONE_MATCH, weak.as_str(), (304, None)),
            (header::IF_NONE_MATCH, "*", (304, None)),
            (header::IF_NONE_MATCH, other.as_str(), (206, Some(10..20))),
        ] {
            assert_eq!(part(&[range.clone(), (name.clone(), value)]), expected, "{name}: {value}");
        }
        let both = format!("{other}, {tag}");
        assert_eq!(part(&[(header::IF_NONE_MATCH, both.as_str())]), (304, None));
    }

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
