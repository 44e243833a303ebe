//! Parsed execution requests: the computation, the requested outputs, and the form of the answer.

use crate::answers::Failure;
use crate::job_folder::DATASET;
use crate::names::relative_path;
use crate::processes::Process;
use crate::request::suggestion;
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
    /// Form of results.
    pub form: Form,
    /// True if the answer is to be the job, not its results.
    pub prefers_job: bool,
}

/// The form of results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Form {
    /// A document that lists all.
    #[default]
    Document,
    /// A single output as it is.
    Raw,
}

/// The body of a request, as the standard has it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Body {
    #[serde(default)]
    inputs: Map<String, Value>,
    /// Outputs that are wanted; results list all.
    #[serde(default)]
    outputs: BTreeMap<String, WantedOutput>,
    #[serde(default)]
    response: Form,
    #[serde(default)]
    subscriber: Option<Value>,
    #[serde(default)]
    #[serde(rename = "mode")]
    _mode: Option<String>,
}

/// The form in which an output is wanted. The service chooses: JSON is a value, other files are links.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
struct WantedOutput {
    #[serde(default)]
    #[serde(rename = "format")]
    _format: Option<Value>,
    #[serde(default)]
    #[serde(rename = "transmissionMode")]
    _transmission_mode: Option<TransmissionMode>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum TransmissionMode {
    Value,
    Reference,
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
        Ok(Request { process, inputs, form, prefers_job: prefers_job(headers) })
    }
}

/// True if results may have a file of this name.
fn is_output(process: Process, inputs: &Map<String, Value>, name: &str) -> bool {
    let is_within = |folder: &str| name.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/'));
    let may_be_named = match process {
        Process::Run => ["output", "pipeline", "trajectory"].iter().any(|key| inputs.contains_key(*key)),
        Process::Campaign => is_within(DATASET),
        Process::Stand => is_within("stand"),
        Process::Plan | Process::DryRun | Process::Compare | Process::Preview => false,
    };
    process.outputs().iter().any(|output| output.name == name)
        || (may_be_named && relative_path(name).is_some())
}

/// True if a header prefers a job (RFC 7240): names are of any case, and may have parameters.
fn prefers_job(headers: &HeaderMap) -> bool {
    let prefers = headers.get_all("prefer").iter().filter_map(|value| value.to_str().ok());
    let mut names = prefers.flat_map(|value| value.split(',')).filter_map(|one| one.split(';').next());
    names.any(|name| name.trim().eq_ignore_ascii_case("respond-async"))
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
        assert_eq!((request.process, request.form, request.prefers_job), (Process::Preview, Form::Raw, true));
        assert_eq!(request.inputs["points"], "a/b.laz");
        assert!(!parsed("run", "{}", "wait=5").unwrap().prefers_job);
        let own = r#"{"inputs": {"output": [{"path": "a/b.las"}]}, "outputs": {"a/b.las": {}}}"#;
        assert!(parsed("run", own, "").is_ok());
        assert!(parsed("campaign", r#"{"outputs": {"dataset/train/x/points.laz": {}}}"#, "").is_ok());
    }

    #[test]
    fn what_a_process_lacks_is_refused() {
        for (id, body, told) in [
            ("plan", r#"{"outputs": {"plan.tml": {}}}"#, "did you mean `plan.toml`?"),
            ("run", r#"{"outputs": {"cloud.e57": {}}}"#, "it has points.laz"),
            ("run", r#"{"inputs": {"output": []}, "outputs": {"../x": {}}}"#, "no output `../x`"),
            ("plan", r#"{"outputs": {"plan.toml": {"transmissionMode": "pigeon"}}}"#, "pigeon"),
            ("plan", r#"{"outputs": {"plan.toml": {"transmission": "value"}}}"#, "transmission"),
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
