//! Titles of jobs: what they compute, of what, and with what. Jobs of one scan have a title in common.

use super::layout::short_time;
use crate::processes::Process;
use crate::program::{CATALOGUE, Program};
use crate::store::{Job, Result};
use crate::worker::Workshop;
use serde_json::{Map, Value};

/// Jobs that are followed from the results of one to the results that it was made of.
pub(super) const MAX_STEPS: usize = 4;

/// A job with what it is called.
#[derive(Debug)]
pub struct Titled {
    pub job: Job,
    pub title: String,
    /// The job or file that the jobs of one scan begin with, and its title.
    pub scan: (String, String),
}

/// Jobs with what they are called.
///
/// # Errors
/// Errors of the store.
pub fn titled(workshop: &Workshop, jobs: Vec<Job>) -> Result<Vec<Titled>> {
    let titled = |job: Job| -> Result<Titled> {
        Ok(Titled { title: title(workshop, &job)?, scan: scan(workshop, &job)?, job })
    };
    jobs.into_iter().map(titled).collect()
}

/// Title of a job, in words.
///
/// # Errors
/// Errors of the store.
pub fn title(workshop: &Workshop, job: &Job) -> Result<String> {
    let inputs = inputs_of(job);
    let process = match Process::named(&job.process) {
        Some(Process::Preview) if inputs.get("format").is_some_and(|format| format == "copc.laz") => {
            "Show points"
        }
        process => process.map_or("", Process::title),
    };
    Ok(match subject(workshop, job, MAX_STEPS)? {
        subject if subject.is_empty() => process.to_owned(),
        subject => format!("{process}: {subject}"),
    })
}

/// The step of a scan that a job is: Plan, Forecast, Points …
pub fn step(job: &Job) -> &'static str {
    match Process::named(&job.process) {
        Some(Process::Run) => "Points",
        Some(Process::Plan) => "Plan",
        Some(Process::DryRun) => "Forecast",
        Some(Process::Campaign) => "Data set",
        Some(Process::Compare) => "Comparison",
        Some(Process::Stand) => "Stand",
        Some(Process::Preview) => "Points to show",
        None => "Job",
    }
}

/// A step of a scan with its seed.
pub fn step_title(job: &Job) -> String {
    match inputs_of(job).get("seed").and_then(Value::as_u64) {
        Some(seed) => format!("{}, seed {seed}", step(job)),
        None => step(job).to_owned(),
    }
}

/// A file of results, with what it was made of and when.
///
/// # Errors
/// Errors of the store.
pub fn file_title(workshop: &Workshop, job: &Job, path: &str) -> Result<String> {
    Ok(format!("{path} of {} ({})", subject(workshop, job, MAX_STEPS)?, short_time(job.created)))
}

/// Title of a file that a request names: that of results is their subject, with their path and time.
///
/// # Errors
/// Errors of the store.
pub fn name_title(workshop: &Workshop, owner: &str, name: &str) -> Result<String> {
    let Some((id, path)) = of_job(name) else { return Ok(name.to_owned()) };
    match workshop.store.job(owner, id)? {
        Some(job) => file_title(workshop, &job, path),
        None => Ok(name.to_owned()),
    }
}

/// The id and the path of a file of results, `jobs/ID/PATH`.
pub(super) fn of_job(name: &str) -> Option<(&str, &str)> {
    name.strip_prefix("jobs/").and_then(|rest| rest.split_once('/'))
}

/// Inputs of a job.
pub(super) fn inputs_of(job: &Job) -> Map<String, Value> {
    serde_json::from_str(&job.inputs).unwrap_or_default()
}

/// The seed after that of a run.
pub(super) fn next_seed(inputs: &Map<String, Value>) -> u64 {
    inputs.get("seed").and_then(Value::as_u64).and_then(|seed| seed.checked_add(1)).unwrap_or(1)
}

/// The job or file that the jobs of the scan of a job begin with, and its title.
fn scan(workshop: &Workshop, job: &Job) -> Result<(String, String)> {
    let mut first = job.clone();
    for _ in 0..MAX_STEPS {
        let inputs = inputs_of(&first);
        let source = ["pipeline", "survey", "points"].iter().find_map(|key| inputs.get(*key)?.as_str());
        let Some(source) = source else { break };
        let parent = match of_job(source) {
            Some((id, _)) => workshop.store.job(&job.owner, id)?,
            None => return Ok((source.to_owned(), source.to_owned())),
        };
        let Some(parent) = parent else { break };
        first = parent;
    }
    // A job that was removed has no inputs any more.
    let title = match subject(workshop, &first, MAX_STEPS)? {
        title if title.is_empty() => step(&first).to_owned(),
        title => title,
    };
    Ok((first.id, title))
}

/// Subject of a job: scene, instrument, seed.
fn subject(workshop: &Workshop, job: &Job, steps: usize) -> Result<String> {
    let inputs = inputs_of(job);
    let mut parts = Vec::new();
    for key in ["pipeline", "survey", "inventory", "scene", "points", "first", "second"] {
        if let Some(name) = inputs.get(key).and_then(Value::as_str) {
            parts.push(origin(workshop, &job.owner, name, steps)?);
        }
    }
    let scanner = inputs.get("scanner").map(|scanner| scanner.get("catalogue").unwrap_or(scanner));
    if let Some(scanner) = scanner.and_then(Value::as_str) {
        parts.push(instrument(&workshop.program, scanner).to_owned());
    }
    if let Some(height) = inputs.get("height").and_then(Value::as_f64) {
        parts.push(format!("{height} m"));
    }
    if let Some(seed) = inputs.get("seed").and_then(Value::as_u64) {
        parts.push(format!("seed {seed}"));
    }
    Ok(parts.join(", "))
}

/// The name of an instrument of the catalogue, by its reference or id; the id of another one.
pub(super) fn instrument<'t>(program: &'t Program, scanner: &'t str) -> &'t str {
    let scanner = scanner.trim_start_matches(CATALOGUE);
    let id = |reference: &'t str| reference.rsplit('#').next().unwrap_or(reference);
    let mut entries = program.entries("scanners");
    let known = entries.find(|&(reference, _)| reference == scanner || id(reference) == scanner);
    let name = known.and_then(|(_, figures)| figures["name"].as_str()).filter(|name| !name.is_empty());
    name.unwrap_or(id(scanner))
}

/// Title of a file: that of an upload is its name, that of results their subject.
fn origin(workshop: &Workshop, owner: &str, name: &str, steps: usize) -> Result<String> {
    let Some((id, file)) = of_job(name) else { return Ok(name.to_owned()) };
    match workshop.store.job(owner, id)?.filter(|_| steps > 0) {
        Some(job) => subject(workshop, &job, steps - 1),
        None => Ok(format!("{file} of {}", id.get(..6).unwrap_or(id))),
    }
}
