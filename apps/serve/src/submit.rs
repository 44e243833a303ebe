//! From a request to a job in the queue, for programs and pages alike.

use crate::processes::Process;
use crate::request::{Outputs, RequestError, check};
use crate::store::{Job, Listed, Status, StoreError, now};
use crate::tokens::random_name;
use crate::worker::Workshop;
use serde_json::{Map, Value};

/// Most jobs among which one that does the same is looked for.
const MAX_LIKE: u32 = 200;
/// Most bytes of the database that the jobs of an owner take: each start reads all of it.
const MAX_ROWS: u64 = 4 << 30;

/// Why a job is not accepted.
#[derive(Debug, thiserror::Error)]
pub enum SubmitError {
    /// Its inputs.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// Too many jobs wait.
    #[error(
        "you have {0} jobs that are not finished, the most that this service accepts; wait for some, or dismiss them"
    )]
    Full(usize),
    /// Too much is stored.
    #[error("your uploads and jobs take {0} bytes, more than this service keeps; remove some first")]
    Stored(u64),
    /// Too much of the database is taken.
    #[error(
        "the requests and lists of results of your jobs take {0} bytes, the most that this service keeps; remove some jobs first"
    )]
    Rows(u64),
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl Workshop {
    /// The newest job of an owner that was asked for the same and has not failed: names of uploads may stand
    /// for other files since, which the fingerprint tells.
    ///
    /// # Errors
    /// [`SubmitError`].
    pub fn newest_like(
        &self,
        owner: &str,
        process: Process,
        inputs: &Map<String, Value>,
    ) -> Result<Option<Job>, SubmitError> {
        let fingerprint = check(process, inputs, owner, &self.store, &self.program)?.fingerprint;
        let states = [Status::Accepted, Status::Running, Status::Successful];
        let jobs =
            self.store.jobs(Listed::States, owner, &states, &[process.id().to_owned()], 0, MAX_LIKE)?;
        let like = jobs.into_iter().find(|job| job.fingerprint == fingerprint && !fingerprint.is_empty());
        Ok(like.map_or(Ok(None), |job| self.store.job(owner, &job.id))?)
    }

    /// Accepts a job. One that was computed before is finished at once, with the results of then.
    ///
    /// # Errors
    /// [`SubmitError`].
    pub fn submit(
        &self,
        owner: &str,
        process: Process,
        inputs: &Map<String, Value>,
    ) -> Result<Job, SubmitError> {
        self.submit_for(owner, process, inputs, None)
    }

    /// Accepts a job, as [`Workshop::submit`] does, with the outputs that a program requests.
    ///
    /// # Errors
    /// [`SubmitError`].
    pub fn submit_for(
        &self,
        owner: &str,
        process: Process,
        inputs: &Map<String, Value>,
        outputs: Option<Outputs>,
    ) -> Result<Job, SubmitError> {
        let mut checked = check(process, inputs, owner, &self.store, &self.program)?;
        checked.prepared.outputs = outputs;
        let answer = self.store.same_job(owner, &checked.fingerprint)?;
        // A repeated request takes a row.
        let stored = self.store.stored_bytes(owner)?;
        if stored > self.limits.max_stored {
            return Err(SubmitError::Stored(stored));
        }
        let rows = self.store.row_bytes(owner)?;
        if rows > MAX_ROWS {
            return Err(SubmitError::Rows(rows));
        }
        let text = |value: Result<String, serde_json::Error>| {
            value.map_err(|e| StoreError::Files(std::io::Error::other(e)))
        };
        let id = random_name(16);
        let now = now();
        let job = Job {
            folder: id.clone(),
            owner: owner.to_owned(),
            process: process.id().to_owned(),
            inputs: text(serde_json::to_string(inputs))?,
            prepared: text(serde_json::to_string(&checked.prepared))?,
            fingerprint: checked.fingerprint,
            status: Status::Accepted,
            message: String::new(),
            progress: 0,
            results: String::new(),
            warnings: String::new(),
            created: now,
            started: None,
            finished: None,
            updated: now,
            id,
        };
        if !self.store.add_job(&job, &checked.prepared.uses, answer.as_ref(), self.limits.max_queued)? {
            return Err(SubmitError::Full(self.limits.max_queued));
        }
        if answer.is_none() {
            self.wake();
        }
        Ok(self.store.job(owner, &job.id)?.unwrap_or(job))
    }
}
