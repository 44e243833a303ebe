//! Parsed execution requests: the computation, the requested outputs, and the form of the answer.

use crate::answers::Failure;
use crate::job_folder::DATASET;
use crate::names::relative_path;
use crate::processes::{Process, Transmission};
use crate::request::{Form, Outputs, suggestion};
use axum::http::{HeaderMap, StatusCode, header};
use serde::Deserialize;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// A request for an execution.
#[derive(Clone, Debug)]
pub struct Request {
    /// The process.
    pub process: Process,
    /// Its inputs, which the queue checks.
    pub inputs: Map<String, Value>,
    /// The outputs, and the form of results.
    pub outputs: Outputs,
    /// True if the answer is to be the job, not its results.
    pub prefers_job: bool,
}

/// The body of a request, as the standard has it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Body {
    #[serde(default)]
    inputs: Map<String, Value>,
    #[serde(default)]
    outputs: BTreeMap<String, RequestedOutput>,
    #[serde(default)]
    response: Form,
    #[serde(default)]
    subscriber: Option<Value>,
    #[serde(default)]
    #[serde(rename = "mode")]
    _mode: Option<String>,
}

/// The form in which an output is requested. Its format is that of its file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
struct RequestedOutput {
    #[serde(default)]
    #[serde(rename = "format")]
    _format: Option<Value>,
    #[serde(default)]
    transmission_mode: Option<Transmission>,
}

impl Request {
    /// Parses a request for the process `id`.
    ///
    /// # Errors
    /// A failure that names what is unknown or of the wrong type.
    pub fn parse(id: &str, headers: &HeaderMap, body: &[u8]) -> Result<Request, Failure> {
        let process = Process::named(id).ok_or_else(|| Failure::no_process(id))?;
        let media =
            headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
        if !media.split(';').next().unwrap_or_default().trim().eq_ignore_ascii_case("application/json") {
            let message = "expected a request of the type application/json";
            return Err(Failure::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, message));
        }
        let wrong = |message: String| Failure::new(StatusCode::BAD_REQUEST, message);
        // The library takes a list for an object whose members have this order.
        if body.trim_ascii_start().first() == Some(&b'[') {
            return Err(wrong("expected a request such as {\"inputs\": {…}}, found a list".to_owned()));
        }
        let Body { inputs, outputs, response: form, subscriber, .. } =
            serde_json::from_slice::<Body>(body)
                .map_err(|e| wrong(format!("the request is not as the process takes it: {e}")))?;
        if subscriber.is_some() {
            let message = "subscriber: the service calls no other address; follow /jobs/JOB/events";
            return Err(wrong(message.to_owned()));
        }
        if let Some(name) = outputs.keys().find(|name| !is_output(process, &inputs, name)) {
            let advice = suggestion(name, process.outputs().iter().map(|output| output.name));
            return Err(wrong(format!(
                "outputs: the process {} has no output `{name}`; {advice}",
                process.id()
            )));
        }
        let chosen: BTreeMap<String, Option<Transmission>> =
            outputs.into_iter().map(|(name, output)| (name, output.transmission_mode)).collect();
        if process.transmission() == Transmission::Reference
            && let Some((name, _)) = chosen.iter().find(|(_, mode)| **mode == Some(Transmission::Value))
        {
            return Err(wrong(format!(
                "outputs: the process {} gives `{name}` by reference only; leave `transmissionMode` out",
                process.id()
            )));
        }
        let outputs = Outputs { form, chosen };
        Ok(Request { process, inputs, outputs, prefers_job: prefers_job(headers) })
    }
}

/// True if results may have a file of this name.
fn is_output(process: Process, inputs: &Map<String, Value>, name: &str) -> bool {
    let is_within = |folder: &str| name.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/'));
    let may_be_named = match process {
        Process::Run => {
            ["output", "pipeline", "trajectory"].iter().any(|key| inputs.contains_key(*key))
                || inputs.get("scanner").is_some_and(Value::is_array)
        }
        Process::Campaign => is_within(DATASET),
        Process::Stand => is_within("stand"),
        Process::Plan | Process::DryRun | Process::Compare | Process::Preview => false,
    };
    process.outputs().iter().any(|output| output.name == name)
        || (may_be_named && relative_path(name).is_some())
}

/// True if a header prefers a job (RFC 7240): names are of any case, and may have parameters; an empty value
/// counts as none.
fn prefers_job(headers: &HeaderMap) -> bool {
    let prefers = headers.get_all("prefer").iter().filter_map(|value| value.to_str().ok());
    let mut preferences = prefers.flat_map(|value| split(value, ',')).filter_map(|one| {
        let preference = split(one, ';').into_iter().next()?;
        let (name, value) = preference.split_once('=').unwrap_or((preference, ""));
        Some((name.trim(), value.trim()))
    });
    preferences
        .any(|(name, value)| name.eq_ignore_ascii_case("respond-async") && matches!(value, "" | "\"\""))
}

/// Splits the value of a header at a separator, but not within quotes.
fn split(text: &str, separator: char) -> Vec<&str> {
    let (mut is_quoted, mut is_escaped) = (false, false);
    text.split(move |c: char| {
        let is_separator = c == separator && !is_quoted;
        match c {
            _ if is_escaped => is_escaped = false,
            '\\' if is_quoted => is_escaped = true,
            '"' => is_quoted = !is_quoted,
            _ => {}
        }
        is_separator
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn parsed(id: &str, body: &str, prefer: &'static str) -> Result<Request, Failure> {
        let mut headers = HeaderMap::new();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("Application/JSON; charset=utf-8"));
        headers.insert("prefer", HeaderValue::from_static(prefer));
        Request::parse(id, &headers, body.as_bytes())
    }

    #[test]
    fn requests_are_parsed() {
        let body = r#"{"inputs": {"points": "a/b.laz"}, "outputs": {"preview.png": {"transmissionMode": "value"}}, "response": "raw"}"#;
        let request = parsed("preview", body, "wait=5, Respond-Async;x=1").unwrap();
        assert_eq!((request.process, request.outputs.form), (Process::Preview, Form::Raw));
        let chosen = BTreeMap::from([("preview.png".to_owned(), Some(Transmission::Value))]);
        assert!(request.prefers_job && request.outputs.chosen == chosen);
        assert_eq!(request.inputs["points"], "a/b.laz");
        assert!(!parsed("run", "{}", "wait=5").unwrap().prefers_job);
        let own = r#"{"inputs": {"output": [{"path": "a/b.las"}]}, "outputs": {"a/b.las": {}}}"#;
        assert!(parsed("run", own, "").is_ok());
        let two = r#"{"inputs": {"scanner": [{"name": "a", "output": "a.las"}]}, "outputs": {"a.las": {}}}"#;
        assert!(parsed("run", two, "").is_ok());
        assert!(parsed("campaign", r#"{"outputs": {"dataset/train/x/points.laz": {}}}"#, "").is_ok());
        assert_eq!(parsed("run", "{}", "").unwrap().outputs, Outputs::default());
        let whole = parsed("run", r#"{"response": "document"}"#, "").unwrap();
        assert_eq!(whole.outputs.form, Form::Document);
    }

    #[test]
    fn preferences_are_those_of_rfc_7240() {
        for (prefer, is_job) in [
            ("respond-async", true),
            ("RESPOND-ASYNC", true),
            ("respond-async; wait=1", true),
            ("respond-async=\"\"", true),
            ("return=minimal, respond-async", true),
            ("foo=\"a, b\", respond-async", true),
            ("foo=\"a \\\" , respond-async\"", false),
            ("foo=\"a, respond-async, b\"", false),
            ("foo; respond-async", false),
            ("respond-asynchronously", false),
            ("\"respond-async\"", false),
            ("wait=5", false),
            ("", false),
        ] {
            assert_eq!(parsed("plan", "{}", prefer).unwrap().prefers_job, is_job, "{prefer}");
        }
    }

    #[test]
    fn what_a_process_lacks_is_refused() {
        for (id, body, told) in [
            ("plan", r#"{"outputs": {"plan.tml": {}}}"#, "did you mean `plan.toml`?"),
            ("run", r#"{"outputs": {"cloud.e57": {}}}"#, "it has points.laz"),
            ("run", r#"{"inputs": {"output": []}, "outputs": {"../x": {}}}"#, "no output `../x`"),
            ("plan", r#"{"outputs": {"plan.toml": {"transmissionMode": "pigeon"}}}"#, "pigeon"),
            ("plan", r#"{"outputs": {"plan.toml": {"transmission": "value"}}}"#, "transmission"),
            (
                "campaign",
                r#"{"outputs": {"dataset/manifest.jsonl": {"transmissionMode": "value"}}}"#,
                "reference",
            ),
            ("plan", r#"{"response": "xml"}"#, "xml"),
            ("plan", " []", "found a list"),
            ("plan", r#"{"inputz": {}}"#, "inputz"),
            ("plan", r#"{"subscriber": {}}"#, "/jobs/JOB/events"),
        ] {
            let failure = parsed(id, body, "").unwrap_err();
            assert_eq!(failure.status, StatusCode::BAD_REQUEST);
            assert!(failure.detail.contains(told), "{body}: {}", failure.detail);
        }
        assert_eq!(parsed("paln", "{}", "").unwrap_err().status, StatusCode::NOT_FOUND);
    }
}
