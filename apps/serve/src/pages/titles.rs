//! Titles of jobs: what they compute, of what, and with what.

use super::layout::short_time;
use crate::processes::Process;
use crate::store::{Job, Result, Store};
use serde_json::{Map, Value};

/// Jobs that are followed from the results of one to the results that it was made of.
const MAX_STEPS: usize = 4;

/// A job with what it is called.
#[derive(Debug)]
pub struct Titled {
    pub job: Job,
    pub title: String,
}

/// Jobs with what they are called.
///
/// # Errors
/// Errors of the store.
pub fn titled(store: &Store, jobs: Vec<Job>) -> Result<Vec<Titled>> {
    jobs.into_iter().map(|job| Ok(Titled { title: title(store, &job)?, job })).collect()
}

/// Title of a job, in words.
///
/// # Errors
/// Errors of the store.
pub fn title(store: &Store, job: &Job) -> Result<String> {
    let inputs: Value = serde_json::from_str(&job.inputs).unwrap_or_default();
    let process = match Process::named(&job.process) {
        Some(Process::Preview) if inputs["format"] == "copc.laz" => "Show points",
        process => process.map_or("", Process::title),
    };
    Ok(match subject(store, job, MAX_STEPS)? {
        subject if subject.is_empty() => process.to_owned(),
        subject => format!("{process}: {subject}"),
    })
}

/// A file of results, with what it was made of and when.
///
/// # Errors
/// Errors of the store.
pub fn file_title(store: &Store, job: &Job, path: &str) -> Result<String> {
    Ok(format!("{path} of {} ({})", subject(store, job, MAX_STEPS)?, short_time(job.created)))
}

/// Subject of a job: scene, instrument, seed.
fn subject(store: &Store, job: &Job, steps: usize) -> Result<String> {
    let inputs: Map<String, Value> = serde_json::from_str(&job.inputs).unwrap_or_default();
    let mut parts = Vec::new();
    for key in ["pipeline", "survey", "inventory", "scene", "points", "first", "second"] {
        if let Some(name) = inputs.get(key).and_then(Value::as_str) {
            parts.push(origin(store, &job.owner, name, steps)?);
        }
    }
    let scanner = inputs.get("scanner").map(|scanner| scanner.get("catalogue").unwrap_or(scanner));
    if let Some(scanner) = scanner.and_then(Value::as_str) {
        parts.push(scanner.rsplit('#').next().unwrap_or(scanner).to_owned());
    }
    if let Some(height) = inputs.get("height").and_then(Value::as_f64) {
        parts.push(format!("{height} m"));
    }
    if let Some(seed) = inputs.get("seed").and_then(Value::as_u64) {
        parts.push(format!("seed {seed}"));
    }
    Ok(parts.join(", "))
}

/// Title of a file: that of an upload is its name, that of results their subject.
fn origin(store: &Store, owner: &str, name: &str, steps: usize) -> Result<String> {
    let Some((id, file)) = name.strip_prefix("jobs/").and_then(|rest| rest.split_once('/')) else {
        return Ok(name.to_owned());
    };
    match store.job(owner, id)?.filter(|_| steps > 0) {
        Some(job) => subject(store, &job, steps - 1),
        None => Ok(format!("{file} of {}", id.get(..6).unwrap_or(id))),
    }
}
