//! Results of a job: a document that has or links its outputs, or the outputs themselves.

use super::files::{kept, no_file};
use super::jobs::find_successful;
use crate::answers::{Failure, document, encoded, link, media_type};
use crate::app::{App, Identity, blocking};
use crate::processes::{Process, Transmission};
use crate::records::Kind;
use crate::request::{Form, Outputs, Prepared};
use crate::store::{Job, Result as StoreResult, ResultFile, Store};
use crate::tokens::random_name;
use crate::worker::Workshop;
use axum::Extension;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// Largest output in a document or in an answer of several parts, bytes; larger ones are links.
const MAX_VALUE: u64 = 4 << 20;
/// Most bytes of all values of a document, or of an answer of several parts; further ones are links.
const MAX_PARTS: u64 = 16 << 20;
/// Longest header with links, bytes: clients accept no longer ones. More links are a document.
const MAX_LINKS: usize = 8 << 10;

/// An output of the results, and how it is given.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Chosen {
    file: ResultFile,
    transmission: Option<Transmission>,
}

pub async fn results(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    let job = find_successful(&app, &identity, &id).await?;
    answer(&app, &job, &headers).await
}

/// The results of a job in the form that its request asks for. `headers` may name a part of a single output.
pub async fn answer(app: &Arc<App>, job: &Job, headers: &HeaderMap) -> Result<Response, Failure> {
    let prepared: Prepared = serde_json::from_str(&job.prepared).unwrap_or_default();
    let chosen = chosen(job.result_files(), prepared.outputs.as_ref())?;
    let form = prepared.outputs.map_or(Form::Document, |outputs| outputs.form);
    let default = Process::named(&job.process).map_or(Transmission::Reference, Process::transmission);
    let given = |output: &Chosen| output.transmission.unwrap_or(default);
    let values: Vec<bool> = chosen.iter().map(|output| given(output) == Transmission::Value).collect();
    match form {
        Form::Raw if values == [true] => single(app, job, &chosen[0].file, headers).await,
        Form::Raw if values.contains(&true) => parts(app, job, chosen, values).await,
        Form::Raw => match linked(job, &chosen) {
            Some(response) => Ok(response),
            None => whole(app, job, chosen).await,
        },
        Form::Document => whole(app, job, chosen).await,
    }
}

/// An output as it is.
async fn single(
    app: &Arc<App>,
    job: &Job,
    file: &ResultFile,
    headers: &HeaderMap,
) -> Result<Response, Failure> {
    let kept = kept(app, (Kind::Results, &job.folder), &file.path, Some(file.bytes), headers).await;
    let mut response = kept?;
    set_location(&mut response, &href(job, &file.path));
    Ok(response)
}

/// Links to outputs, unless they are too many for a header.
fn linked(job: &Job, chosen: &[Chosen]) -> Option<Response> {
    let links = chosen.iter().map(|output| format!("<{}>; rel=\"item\"", href(job, &output.file.path)));
    let links = links.collect::<Vec<_>>().join(", ");
    if links.len() > MAX_LINKS {
        return None;
    }
    let mut response = StatusCode::NO_CONTENT.into_response();
    if !links.is_empty() {
        response.headers_mut().insert(header::LINK, HeaderValue::from_str(&links).ok()?);
    }
    set_location(&mut response, &format!("/jobs/{}", job.id));
    Some(response)
}

/// The outputs that a request names, or all.
fn chosen(files: Vec<ResultFile>, outputs: Option<&Outputs>) -> Result<Vec<Chosen>, Failure> {
    let Some(outputs) = outputs.filter(|outputs| !outputs.chosen.is_empty()) else {
        return Ok(files.into_iter().map(|file| Chosen { file, transmission: None }).collect());
    };
    let choose = |(name, transmission): (&String, &Option<Transmission>)| {
        let file = files.iter().find(|file| file.path == *name).cloned();
        file.map(|file| Chosen { file, transmission: *transmission }).ok_or_else(|| {
            let message =
                format!("the results have no output `{name}`; request others, or leave `outputs` out");
            Failure::new(StatusCode::NOT_FOUND, message)
        })
    };
    outputs.chosen.iter().map(choose).collect()
}

/// The address of an output.
fn href(job: &Job, path: &str) -> String {
    format!("/jobs/{}/results/{}", job.id, encoded(path))
}

fn set_location(response: &mut Response, address: &str) {
    if let Ok(address) = HeaderValue::from_str(address) {
        response.headers_mut().insert(header::CONTENT_LOCATION, address);
    }
}

/// The document of results.
async fn whole(app: &Arc<App>, job: &Job, chosen: Vec<Chosen>) -> Result<Response, Failure> {
    let found = job.clone();
    let results = blocking(app, move |workshop| results_document(&found, &chosen, &workshop.store)).await?;
    let mut response = document(&results);
    set_location(&mut response, &format!("/jobs/{}", job.id));
    Ok(response)
}

/// Outputs as values and links. Without a choice of the request, JSON is a value, and other files are links.
fn results_document(job: &Job, chosen: &[Chosen], store: &Store) -> StoreResult<Value> {
    let mut results = Map::new();
    let mut left = MAX_PARTS;
    for Chosen { file, transmission } in chosen {
        let media = media_type(&file.path);
        let is_value = match transmission {
            Some(transmission) => *transmission == Transmission::Value,
            None => media == "application/json",
        };
        let read = || store.read(Kind::Results, &job.folder, &file.path, MAX_VALUE);
        let is_value = is_value && file.bytes <= MAX_VALUE.min(left);
        let content = is_value.then(read).transpose()?.flatten();
        left = left.saturating_sub(content.as_ref().map_or(0, |content| content.len() as u64));
        let title = format!("{} bytes", file.bytes);
        let linked = || link(&href(job, &file.path), "item", media, &title);
        let value = content.and_then(|content| value_of(&content, media));
        results.insert(file.path.clone(), value.unwrap_or_else(linked));
    }
    Ok(Value::Object(results))
}

/// A file as a value of a document; nothing for JSON that is damaged.
fn value_of(content: &[u8], media: &str) -> Option<Value> {
    if media == "application/json" {
        let value: Value = serde_json::from_slice(content).ok()?;
        return Some(json!({ "value": value, "mediaType": media }));
    }
    Some(match std::str::from_utf8(content) {
        Ok(text) => json!({ "value": text, "mediaType": media }),
        Err(_) => json!({ "value": base64(content), "mediaType": media, "encoding": "base64" }),
    })
}

/// Outputs as the parts of an answer (RFC 2387), whose ids are their names.
async fn parts(
    app: &Arc<App>,
    job: &Job,
    chosen: Vec<Chosen>,
    values: Vec<bool>,
) -> Result<Response, Failure> {
    let boundary = random_name(16);
    let first = chosen.first().map_or("application/octet-stream", |output| media_type(&output.file.path));
    let media = format!("multipart/related; boundary={boundary}; type=\"{first}\"");
    let found = job.clone();
    let write = move |workshop: &Workshop| -> Result<Vec<u8>, Failure> {
        let mut body = Vec::new();
        let mut left = MAX_PARTS;
        for (Chosen { file, .. }, is_value) in chosen.iter().zip(values) {
            let head = format!(
                "--{boundary}\r\nContent-Type: {}\r\nContent-ID: {}\r\n",
                media_type(&file.path),
                encoded(&file.path)
            );
            body.extend(head.as_bytes());
            if is_value && file.bytes <= MAX_VALUE.min(left) {
                left -= file.bytes;
                let content = workshop.store.read(Kind::Results, &found.folder, &file.path, file.bytes)?;
                body.extend(b"\r\n");
                body.extend(content.ok_or_else(|| no_file(&file.path))?);
            } else {
                body.extend(format!("Content-Location: {}\r\n\r\n", href(&found, &file.path)).as_bytes());
            }
            body.extend(b"\r\n");
        }
        body.extend(format!("--{boundary}--\r\n").as_bytes());
        Ok(body)
    };
    let body = blocking(app, write).await?;
    let mut response = ([(header::CONTENT_TYPE, media)], Body::from(body)).into_response();
    set_location(&mut response, &format!("/jobs/{}", job.id));
    Ok(response)
}

/// Bytes in base64 (RFC 4648).
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let at = |index: usize| u32::from(chunk.get(index).copied().unwrap_or(0));
        let bits = (at(0) << 16) | (at(1) << 8) | at(2);
        for (number, shift) in [18, 12, 6, 0].into_iter().enumerate() {
            let digit = DIGITS[(bits >> shift) as usize & 63];
            text.push(if number <= chunk.len() { char::from(digit) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn base64_is_that_of_its_standard() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
        assert_eq!(base64(&[0xfb, 0xff, 0xfe]), "+//+");
    }

    #[test]
    fn values_are_json_text_or_base64() {
        let json = value_of(b"{\"a\": 1}", "application/json").unwrap();
        assert_eq!(json, json!({ "value": { "a": 1 }, "mediaType": "application/json" }));
        assert_eq!(value_of(b"{", "application/json"), None);
        assert_eq!(value_of(b"a = 1", "application/toml").unwrap()["value"], "a = 1");
        let picture = value_of(b"\x89PNG", "image/png").unwrap();
        assert_eq!((&picture["value"], &picture["encoding"]), (&json!("iVBORw=="), &json!("base64")));
    }

    #[test]
    fn requests_choose_outputs() {
        let file = |path: &str| ResultFile { path: path.to_owned(), bytes: 1 };
        let files = || vec![file("a.json"), file("b.png")];
        let outputs = |name: &str| Outputs {
            form: Form::Raw,
            chosen: BTreeMap::from([(name.to_owned(), Some(Transmission::Value))]),
        };
        assert_eq!(chosen(files(), None).unwrap().len(), 2);
        assert_eq!(chosen(files(), Some(&Outputs::default())).unwrap().len(), 2);
        let one = chosen(files(), Some(&outputs("b.png"))).unwrap();
        assert_eq!(one, [Chosen { file: file("b.png"), transmission: Some(Transmission::Value) }]);
        assert_eq!(chosen(files(), Some(&outputs("c.png"))).unwrap_err().status, StatusCode::NOT_FOUND);
    }
}
