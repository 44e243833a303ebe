//! A job in the hands of an engine: what its tasks are given, what each of them does on its node, and what
//! comes of it. All of it is in the folder `tasks` of the job, which nodes and service share.
//!
//! ```text
//! N.json                     the N-th submission; tasks end when it is withdrawn
//! N.withdrawn                the same, withdrawn
//! part-K-of-P                part K is complete
//! lock-…                     held by the task that computes a part, or the last step
//! outcome.json               what came of the job
//! log-K, log-last            messages of vlscan
//! ```
//!
//! A task computes its part. The task that completes the last missing part computes the last step, which
//! writes the results. So it does not matter in which order tasks run, how often, or how many are lost: what
//! is complete is not computed again.

use crate::config::TaskArgs;
use crate::execution::{End, Setting};
use crate::job_folder::write_whole;
use crate::messages::progress_of;
use crate::steps::Steps;
use crate::store::{Result, StoreError};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Period in which a task checks that it is still wanted.
const CHECK: Duration = Duration::from_secs(1);
/// Period in which a task tries a lock.
const LOCK: Duration = Duration::from_millis(500);
/// Variables in which engines tell a task its number.
const NUMBERS: [&str; 4] =
    ["SLURM_ARRAY_TASK_ID", "JOB_COMPLETION_INDEX", "PBS_ARRAY_INDEX", "AWS_BATCH_JOB_ARRAY_INDEX"];

/// Submission to an engine.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Submission {
    /// Folder and limits.
    pub setting: Setting,
    /// Steps.
    pub steps: Steps,
}

/// Outcome of a job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// The results are complete.
    Successful,
    /// A message.
    Failed(String),
}

/// The folder of a job's tasks.
#[derive(Clone, Debug)]
pub struct Tasks {
    folder: PathBuf,
}

impl Tasks {
    /// Tasks of the job in this folder.
    pub fn of(job: &Path) -> Tasks {
        Tasks { folder: job.join("tasks") }
    }

    /// The file of a submission.
    pub fn submission(&self, number: u32) -> PathBuf {
        self.folder.join(format!("{number}.json"))
    }

    /// The number of the last submission, if any, also of one that was withdrawn: its name is not given
    /// again.
    ///
    /// # Errors
    /// Errors of files.
    pub fn last_submission(&self) -> Result<Option<u32>> {
        let entries = match fs::read_dir(&self.folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            entries => entries?,
        };
        let mut last = None;
        for entry in entries {
            let name = entry?.file_name();
            let name = name.to_string_lossy();
            let number = name.strip_suffix(".json").or(name.strip_suffix(".withdrawn"));
            last = last.max(number.and_then(|number| number.parse().ok()));
        }
        Ok(last)
    }

    /// Records a submission before it is given to the engine.
    ///
    /// # Errors
    /// Errors of files.
    pub fn record(&self, number: u32, submission: &Submission) -> Result<()> {
        fs::create_dir_all(&self.folder)?;
        write_json(&self.submission(number), submission)
    }

    /// Has the tasks of a submission end, those that have not begun, too.
    ///
    /// # Errors
    /// Errors of files.
    pub fn withdraw(&self, number: u32) -> Result<()> {
        let withdrawn = self.folder.join(format!("{number}.withdrawn"));
        match fs::rename(self.submission(number), withdrawn) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error.into()),
            _ => Ok(()),
        }
    }

    /// Outcome of the job, if it has ended.
    ///
    /// # Errors
    /// Errors of files.
    pub fn outcome(&self) -> Result<Option<Outcome>> {
        read_json(&self.folder.join("outcome.json"))
    }

    /// Progress of the parts, in percent, and in words.
    pub fn progress(&self, parts: u32) -> (u8, String) {
        if parts < 2 {
            return progress_of(&self.log("last"));
        }
        let complete = (0..parts).filter(|part| self.is_complete(*part, parts)).count();
        let of_part = |part: u32| match self.is_complete(part, parts) {
            true => 100,
            false => u32::from(progress_of(&self.log(&part.to_string())).0),
        };
        let percent = (0..parts).map(of_part).sum::<u32>() / parts;
        (percent.min(99) as u8, format!("{complete} of {parts} parts"))
    }

    /// Messages of the last step.
    pub fn last_log(&self) -> PathBuf {
        self.log("last")
    }

    fn log(&self, name: &str) -> PathBuf {
        self.folder.join(format!("log-{name}"))
    }

    fn mark(&self, part: u32, parts: u32) -> PathBuf {
        self.folder.join(format!("part-{part}-of-{parts}"))
    }

    fn is_complete(&self, part: u32, parts: u32) -> bool {
        self.mark(part, parts).exists()
    }

    /// Waits for a lock; `None` if the task is not wanted any more. File systems without locks have none, and
    /// there parts that are computed twice give the same bytes.
    fn lock(&self, name: &str, goes_on: &mut dyn FnMut() -> Result<bool>) -> Result<Option<File>> {
        let path = self.folder.join(format!("lock-{name}"));
        let file = File::options().create(true).truncate(false).write(true).open(path)?;
        while let Err(TryLockError::WouldBlock) = file.try_lock() {
            if !goes_on()? {
                return Ok(None);
            }
            std::thread::sleep(LOCK);
        }
        Ok(Some(file))
    }

    /// Does the work of task `number`. Returns what came of the job if that is decided now.
    fn compute(&self, path: &Path, number: u32) -> Result<Option<Outcome>> {
        let mut checked: Option<Instant> = None;
        let mut goes_on = || -> Result<bool> {
            if checked.is_some_and(|checked| checked.elapsed() < CHECK) {
                return Ok(true);
            }
            checked = Some(Instant::now());
            Ok(path.exists() && self.outcome()?.is_none())
        };
        let Some(Submission { setting, steps }) = read_json::<Submission>(path)? else { return Ok(None) };
        if !goes_on()? {
            return Ok(None);
        }
        let parts = steps.parts;
        if parts > 1 && number >= parts {
            let message = format!("there is no task {number}: the job has {parts} parts");
            return Err(io::Error::new(io::ErrorKind::InvalidInput, message).into());
        }
        if parts > 1 {
            let Some(_lock) = self.lock(&format!("{number}-of-{parts}"), &mut goes_on)? else {
                return Ok(None);
            };
            if !self.is_complete(number, parts) {
                let log = self.log(&number.to_string());
                match steps.compute_part(number, &setting, &log, &mut goes_on)? {
                    End::Success => write_whole(&self.folder, &self.mark(number, parts), b"")?,
                    // One task computes the whole run.
                    End::NotDivisible(_) if number > 0 => return Ok(None),
                    End::NotDivisible(_) => {
                        let end = steps.compute_whole(&setting, &self.log("last"), &mut goes_on)?;
                        return self.decide(end);
                    }
                    end => return self.decide(end),
                }
            }
        }
        let is_missing = |part: u32| !self.is_complete(part, parts);
        if parts > 1 && (0..parts).any(is_missing) {
            return Ok(None);
        }
        let Some(_lock) = self.lock("last", &mut goes_on)? else { return Ok(None) };
        // Another task may have had the lock.
        if self.outcome()?.is_some() {
            return Ok(None);
        }
        let end = steps.compute_last(&setting, &self.log("last"), None, &mut goes_on)?;
        self.decide(end)
    }

    /// Records what came of the job, unless the task was ended.
    fn decide(&self, end: End) -> Result<Option<Outcome>> {
        let outcome = match end {
            End::Success => Outcome::Successful,
            End::Failure(message) | End::NotDivisible(message) => Outcome::Failed(message),
            End::GivenUp => return Ok(None),
        };
        write_json(&self.folder.join("outcome.json"), &outcome)?;
        Ok(Some(outcome))
    }
}

fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    write_whole(folder, path, &serde_json::to_vec(value).map_err(io::Error::other)?)
}

/// The content of a file; `None` if there is none.
fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    match fs::read(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        bytes => Ok(Some(serde_json::from_slice(&bytes?).map_err(io::Error::other)?)),
    }
}

/// End of a task without success.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum TaskError {
    /// A path that is not that of a submission.
    #[error("expected the file of a submission")]
    NoSubmission,
    /// The files of the job.
    #[error(transparent)]
    Files(#[from] StoreError),
    /// A job that failed, with its message.
    #[error("{0}")]
    Failed(String),
}

/// The command of a task, on its node.
///
/// # Errors
/// [`TaskError`].
pub fn run(args: &TaskArgs) -> std::result::Result<(), TaskError> {
    let told = || NUMBERS.iter().find_map(|name| std::env::var(name).ok()?.parse().ok());
    let number = args.number.or_else(told).unwrap_or(0);
    let folder = args.submission.parent().ok_or(TaskError::NoSubmission)?;
    let tasks = Tasks { folder: folder.to_owned() };
    match tasks.compute(&args.submission, number)? {
        Some(Outcome::Failed(message)) => Err(TaskError::Failed(message)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_withdrawn_submission_is_not_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let tasks = Tasks::of(folder.path());
        assert_eq!(tasks.last_submission().unwrap(), None);
        tasks.withdraw(1).unwrap();
        for number in [1, 2, 10] {
            fs::create_dir_all(&tasks.folder).unwrap();
            fs::write(tasks.submission(number), "").unwrap();
            assert_eq!(tasks.last_submission().unwrap(), Some(number));
            tasks.withdraw(number).unwrap();
            assert!(!tasks.submission(number).exists(), "its tasks end");
            assert_eq!(tasks.last_submission().unwrap(), Some(number));
        }
    }
}
