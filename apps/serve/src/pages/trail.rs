//! The path from the files to a page: Files › Plan › Forecast › Points.

use super::home::encoded;
use super::titles::{MAX_STEPS, inputs_of, of_job, step};
use crate::processes::Process;
use crate::store::{Job, Listed, Result, Status};
use crate::worker::Workshop;
use maud::{Markup, html};

/// Most forecasts among which that of a run is looked for.
const MAX_FORECASTS: u32 = 50;
/// Inputs that name the file or the results that a job is made of.
const SOURCES: [&str; 7] = ["pipeline", "survey", "points", "first", "scene", "inventory", "trajectory"];

/// A part of a path: its label, and the address of its page unless that is the present one or is gone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Crumb {
    /// Label.
    pub label: String,
    /// Address.
    pub address: Option<String>,
}

impl Crumb {
    /// The first page.
    pub fn files() -> Crumb {
        Crumb { label: "Files".to_owned(), address: Some("/".to_owned()) }
    }

    /// The present page.
    pub fn here(label: &str) -> Crumb {
        Crumb { label: label.to_owned(), address: None }
    }

    fn of(job: &Job) -> Crumb {
        let is_there = job.status != Status::Dismissed;
        Crumb { label: step(job).to_owned(), address: is_there.then(|| format!("/jobs/{}", job.id)) }
    }
}

/// The path to the page of a job.
///
/// # Errors
/// Errors of the store.
pub fn trail_of(workshop: &Workshop, job: &Job) -> Result<Vec<Crumb>> {
    let mut crumbs = vec![Crumb::here(step(job))];
    let mut last = job.clone();
    for _ in 0..MAX_STEPS {
        let inputs = inputs_of(&last);
        let Some(source) = SOURCES.iter().find_map(|key| inputs.get(*key)?.as_str()) else { break };
        if last.process == Process::Run.id()
            && let Some(forecast) = forecast_of(workshop, &last.owner, source)?
        {
            crumbs.push(Crumb::of(&forecast));
        }
        let Some((id, _)) = of_job(source) else {
            let upload = source.split('/').next().unwrap_or(source);
            let is_there = workshop.store.upload(&job.owner, upload)?.is_some();
            let address = is_there.then(|| format!("/uploads/{}", encoded(upload)));
            crumbs.push(Crumb { label: upload.to_owned(), address });
            break;
        };
        let Some(parent) = workshop.store.job(&job.owner, id)? else { break };
        crumbs.push(Crumb::of(&parent));
        last = parent;
    }
    crumbs.push(Crumb::files());
    crumbs.reverse();
    Ok(crumbs)
}

/// The newest forecast of a pipeline or survey.
fn forecast_of(workshop: &Workshop, owner: &str, source: &str) -> Result<Option<Job>> {
    let processes = [Process::DryRun.id().to_owned()];
    let jobs =
        workshop.store.jobs(Listed::States, owner, &[Status::Successful], &processes, 0, MAX_FORECASTS)?;
    let is_of_it = |job: &Job| {
        let inputs = inputs_of(job);
        ["pipeline", "survey"].iter().any(|key| inputs.get(*key).is_some_and(|name| name == source))
    };
    Ok(jobs.into_iter().find(is_of_it))
}

/// A path as links.
pub fn path(crumbs: &[Crumb]) -> Markup {
    html! {
        nav .path aria-label="Path" {
            ol {
                @for (at, crumb) in crumbs.iter().enumerate() {
                    li {
                        @if let Some(address) = &crumb.address { a href=(address) { (crumb.label) } }
                        @else { span aria-current=[(at + 1 == crumbs.len()).then_some("page")] { (crumb.label) } }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_lead_back_and_mark_the_present_page() {
        let text = path(&[Crumb::files(), Crumb::here("<Plan>")]).into_string();
        assert!(text.contains("<a href=\"/\">Files</a>"), "{text}");
        assert!(text.contains("<span aria-current=\"page\">&lt;Plan&gt;</span>"), "{text}");
    }
}
