//! An existing engine, such as a scheduler of a cluster, that computes jobs in place of this machine: three
//! commands that hand a job in, ask for it and cancel it by a name that the service chooses. The name is on
//! disk before the job is handed in; so a service that was killed finds its jobs again.

use crate::config::ServeArgs;
use crate::execution::End;
use crate::job_folder::campaign_pulses;
use crate::program::own_program;
use crate::store::Result;
use crate::tasks::{Outcome, Submission, Tasks};
use crate::template::{Ended, Template, TemplateError, Value};
use std::path::Path;
use std::time::{Duration, Instant};

/// Period of polling the engine for a job.
const ASK: Duration = Duration::from_secs(2);
/// Period of looking into the job's folder.
const LOOK: Duration = Duration::from_millis(200);
/// Time for which an engine may not know a job that was handed in, and for which results may not be seen by
/// another machine.
const GRACE: Duration = Duration::from_secs(5);
/// Longest wait for the end of a job that was cancelled.
const MAX_WAIT: Duration = Duration::from_secs(60);
/// Maximum number of submissions in a row of a job whose tasks end without a result and without progress:
/// mostly they need more memory than they get.
const MAX_SUBMISSIONS: u32 = 5;

const OF_SUBMISSION: [&str; 7] = ["name", "tasks", "last", "folder", "command", "minutes", "megabytes"];

/// The commands of an engine.
#[derive(Clone, Debug)]
pub struct Engine {
    submit: Template,
    poll: Template,
    cancel: Template,
    /// Parts of a run or campaign.
    pub parts: u32,
    max_time: u64,
    max_memory: u64,
}

/// A command of an engine that is not a template.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("--{option}: {problem}")]
pub struct EngineError {
    /// Name of its option, without dashes.
    pub option: &'static str,
    /// Problem of the command.
    pub problem: TemplateError,
}

impl Engine {
    /// The engine that the command line names, if it does.
    ///
    /// # Errors
    /// A command that is not a template.
    pub fn of(args: &ServeArgs) -> std::result::Result<Option<Engine>, EngineError> {
        let template = |option: &'static str, line: &Option<String>, known: &[&str]| {
            let line = line.as_deref().unwrap_or_default();
            Template::new(line, known).map_err(|problem| EngineError { option, problem })
        };
        if args.submit.is_none() {
            return Ok(None);
        }
        Ok(Some(Engine {
            submit: template("submit", &args.submit, &OF_SUBMISSION)?,
            poll: template("poll", &args.poll, &["name"])?,
            cancel: template("cancel", &args.cancel, &["name"])?,
            parts: args.parts,
            max_time: args.max_time,
            max_memory: args.max_memory,
        }))
    }

    /// Checks that the engine can be asked.
    ///
    /// # Errors
    /// If the command cannot be started.
    pub fn check(&self) -> std::io::Result<()> {
        let name = [("name", Value::Text(name("none", 0)))];
        match self.poll.execute::<std::io::Error>(&name, &mut || Ok(true))? {
            Ended::Failure(message) => eprintln!("vlscan serve: --poll: {message}"),
            Ended::Success(_) | Ended::GivenUp => {}
        }
        Ok(())
    }

    /// Has a job computed, or goes on waiting for one that was handed in. Returns when the job has ended or
    /// `goes_on` returns false.
    ///
    /// # Errors
    /// Errors of files and of `goes_on`.
    pub fn compute(
        &self,
        job: &str,
        submission: &Submission,
        goes_on: &mut dyn FnMut() -> Result<bool>,
    ) -> Result<End> {
        let tasks = Tasks::of(&submission.setting.folder);
        let mut number = tasks.last_submission()?;
        // Since when the engine does not know the job.
        let mut unknown = Instant::now();
        let mut asked: Option<Instant> = None;
        let mut lost = 0;
        // The most of what was seen.
        let mut reached = [0_u64; 2];
        loop {
            if let Some(outcome) = tasks.outcome()? {
                return self.end(job, &tasks, number, outcome, goes_on);
            }
            if !goes_on()? {
                return Ok(End::GivenUp);
            }
            std::thread::sleep(LOOK);
            if asked.is_some_and(|asked| asked.elapsed() < ASK) {
                continue;
            }
            asked = Some(Instant::now());
            let is_known = match number {
                Some(number) => self.is_known(&name(job, number), goes_on)?,
                None => false,
            };
            if is_known {
                unknown = Instant::now();
                continue;
            }
            if number.is_some() && unknown.elapsed() < GRACE {
                continue;
            }
            // An outcome may have been written since the last look.
            if tasks.outcome()?.is_some() {
                continue;
            }
            let progress = progress(&tasks, submission);
            if progress.iter().zip(&reached).any(|(now, before)| now > before) {
                lost = 0;
            }
            reached = [progress[0].max(reached[0]), progress[1].max(reached[1])];
            if lost >= MAX_SUBMISSIONS {
                let message = format!(
                    "the engine has ended the job {lost} times without results; it may need more memory or time than it is given"
                );
                return Ok(End::Failure(message));
            }
            // Tasks of the last submission that come late find that they are not wanted.
            number.map_or(Ok(()), |number| tasks.withdraw(number))?;
            let next = number.map_or(1, |number| number + 1);
            tasks.record(next, submission)?;
            number = Some(next);
            let values = self.values(&name(job, next), &tasks.submission(next), submission)?;
            match self.submit.execute(&values, goes_on)? {
                Ended::Success(_) => lost += 1,
                Ended::Failure(message) => eprintln!("vlscan serve: --submit: {message}"),
                Ended::GivenUp => return Ok(End::GivenUp),
            }
            unknown = Instant::now();
        }
    }

    /// Cancels what the engine has of a job that was dismissed, and waits for its end. Returns true if it has
    /// ended.
    ///
    /// # Errors
    /// Errors of files.
    pub fn withdraw(&self, job: &str, folder: &Path) -> Result<bool> {
        let tasks = Tasks::of(folder);
        let Some(number) = tasks.last_submission()? else { return Ok(true) };
        tasks.withdraw(number)?;
        let name = name(job, number);
        let start = Instant::now();
        let mut always = || Ok(true);
        self.cancel(&name, &mut always)?;
        while self.is_known(&name, &mut always)? {
            if start.elapsed() > MAX_WAIT {
                return Ok(false);
            }
            std::thread::sleep(LOOK);
        }
        Ok(true)
    }

    fn end(
        &self,
        job: &str,
        tasks: &Tasks,
        number: Option<u32>,
        outcome: Outcome,
        goes_on: &mut dyn FnMut() -> Result<bool>,
    ) -> Result<End> {
        match outcome {
            Outcome::Successful => Ok(End::Success),
            Outcome::Failed(message) => {
                if let Some(number) = number {
                    tasks.withdraw(number)?;
                    self.cancel(&name(job, number), goes_on)?;
                }
                Ok(End::Failure(message))
            }
        }
    }

    /// True if a job waits or runs; an engine that cannot be asked is taken to have it.
    fn is_known(&self, name: &str, goes_on: &mut dyn FnMut() -> Result<bool>) -> Result<bool> {
        match self.poll.execute(&[("name", Value::Text(name.to_owned()))], goes_on)? {
            Ended::Success(output) => Ok(!output.trim().is_empty()),
            Ended::Failure(message) => {
                eprintln!("vlscan serve: --poll: {message}");
                Ok(true)
            }
            Ended::GivenUp => Ok(true),
        }
    }

    fn cancel(&self, name: &str, goes_on: &mut dyn FnMut() -> Result<bool>) -> Result<()> {
        if let Ended::Failure(message) =
            self.cancel.execute(&[("name", Value::Text(name.to_owned()))], goes_on)?
        {
            eprintln!("vlscan serve: --cancel: {message}");
        }
        Ok(())
    }

    fn values(&self, name: &str, file: &Path, submission: &Submission) -> Result<Vec<(&'static str, Value)>> {
        let parts = submission.steps.parts;
        let text = |path: &Path| path.display().to_string();
        let command = vec![text(&own_program()?), "task".to_owned(), text(file)];
        Ok(vec![
            ("name", Value::Text(name.to_owned())),
            ("tasks", Value::Text(parts.to_string())),
            ("last", Value::Text((parts - 1).to_string())),
            ("folder", Value::Text(text(&submission.setting.folder))),
            ("command", Value::Words(command)),
            // A task may compute a part, and the last step after it.
            ("minutes", Value::Text((2 * self.max_time).div_ceil(60).to_string())),
            ("megabytes", Value::Text(self.max_memory.div_ceil(1_000_000).to_string())),
        ])
    }
}

/// Percentage of the parts of a job, and pulses of the complete cells of a campaign.
fn progress(tasks: &Tasks, submission: &Submission) -> [u64; 2] {
    let (percent, _) = tasks.progress(submission.steps.parts);
    [u64::from(percent), campaign_pulses(&submission.setting.folder.join("out")).unwrap_or(0)]
}

/// The name of a submission at the engine.
fn name(job: &str, number: u32) -> String {
    format!("vlscan-{job}-{number}")
}
