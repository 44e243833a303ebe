//! The queue: jobs that wait, and leases of those that are computed.
//!
//! A worker holds a job for some seconds and renews this lease while it computes. A service that ends takes
//! its workers along, and a lease that is not renewed runs out; so the job is given to another worker, which
//! continues it. Only who holds a job can finish it.

use crate::messages::Said;
use crate::processes::Process;
use crate::records::Kind;
use crate::store::{COLUMNS, Job, Result, ResultFile, Status, Store, job_of, now};
use rusqlite::{Connection, OptionalExtension as _, TransactionBehavior, params};
use std::collections::BTreeSet;
use std::sync::{MutexGuard, PoisonError};
use std::time::Duration;

/// Most files of results that are looked for before they answer another request.
const MAX_LOOKED: usize = 100;
/// Bytes of the database for an upload or results that a job reads.
const USE: u64 = 256;
/// Time for which a job is held without a renewal.
pub const LEASE: Duration = Duration::from_secs(10);

/// Upload or results that a job reads besides its own document.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Use {
    /// The files of an upload.
    Upload {
        /// Its name in the request.
        name: String,
        /// Its folder.
        id: String,
    },
    /// The results of a job.
    Job {
        /// Its name.
        id: String,
        /// Its folder.
        folder: String,
    },
}

impl Use {
    /// Kind of the files, and the id under which they are kept.
    pub fn files(&self) -> (Kind, &str) {
        match self {
            Use::Upload { id, .. } => (Kind::Upload, id),
            Use::Job { folder, .. } => (Kind::Results, folder),
        }
    }
}

/// Outcome of a computation.
#[derive(Clone, Debug)]
pub enum Outcome {
    /// Results, and the messages of vlscan.
    Successful(Vec<ResultFile>, Said),
    /// The results in the folder of another job, which are the same.
    Same(String),
    /// A message.
    Failed(String),
}

/// Jobs that a worker takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lane {
    /// All.
    Any,
    /// Jobs that answer requests, but for slow ones: at most this many of an owner at a time, so that no
    /// owner can take all workers of the lane.
    Quick {
        /// Jobs of an owner.
        share: usize,
    },
}

impl Lane {
    /// Most jobs of an owner at a time.
    fn share(self) -> usize {
        match self {
            Lane::Any => usize::MAX,
            Lane::Quick { share } => share,
        }
    }
}

/// An owner whose jobs wait.
struct Waiting {
    owner: String,
    /// The job that has waited longest.
    number: i64,
    /// Jobs that are computed in the lane.
    running: usize,
}

impl Store {
    /// Adds a job to the queue, or, with `answer`, as successful with the results of that earlier job, unless
    /// that was dismissed meanwhile. Returns `false` and adds nothing if the owner has `max_queued` jobs that
    /// are not finished.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn add_job(
        &self,
        job: &Job,
        uses: &BTreeSet<Use>,
        answer: Option<&Job>,
        max_queued: usize,
    ) -> Result<bool> {
        let mut database = self.database();
        let transaction = database.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let answer = match answer {
            Some(answer) if is_successful(&transaction, &answer.id)? => Some(answer),
            _ => None,
        };
        // Finished jobs read nothing more.
        let none = BTreeSet::new();
        let uses = if answer.is_some() { &none } else { uses };
        if answer.is_none() {
            let waiting: usize = transaction
                .prepare_cached(
                    "SELECT count(*) FROM jobs WHERE owner = ? AND status IN ('accepted', 'running')",
                )?
                .query_row([&job.owner], |row| row.get(0))?;
            if waiting >= max_queued {
                return Ok(false);
            }
        }
        let status = if answer.is_some() { Status::Successful } else { Status::Accepted };
        let done = answer.map(|_| job.created);
        let folder = answer.map_or(&job.id, |answer| &answer.folder);
        transaction
            .prepare_cached(
                "INSERT INTO jobs (id, owner, process, inputs, prepared, fingerprint, folder, status, progress, results, created, started,
                 finished, updated, message, warnings, texts) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?12, ?11, ?13,
                 ?14, octet_length(?4) + octet_length(?5) + octet_length(?10) + octet_length(?13) + octet_length(?14) + ?15)",
            )?
            .execute(params![
                job.id,
                job.owner,
                job.process,
                job.inputs,
                job.prepared,
                job.fingerprint,
                folder,
                status.name(),
                if answer.is_some() { 100 } else { 0 },
                answer.map_or("[]", |answer| &answer.results),
                job.created,
                done,
                answer.map_or("", |answer| &answer.message),
                answer.map_or("[]", |answer| &answer.warnings),
                uses.len() as u64 * USE,
            ])?;
        for used in uses {
            let (kind, target) = match used {
                Use::Upload { id, .. } => ("upload", id),
                Use::Job { folder, .. } => ("job", folder),
            };
            transaction
                .prepare_cached("INSERT OR IGNORE INTO uses (job, kind, target) VALUES (?, ?, ?)")?
                .execute(params![job.id, kind, target])?;
        }
        transaction.commit()?;
        Ok(true)
    }

    /// A job of the owner that has computed the same already.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn same_job(&self, owner: &str, fingerprint: &str) -> Result<Option<Job>> {
        if fingerprint.is_empty() {
            return Ok(None);
        }
        let database = self.database();
        let mut query = database.prepare_cached(&format!(
            "SELECT {COLUMNS} FROM jobs WHERE owner = ? AND fingerprint = ? AND status = 'successful' ORDER BY number DESC LIMIT 1"
        ))?;
        let found = query.query_row([owner, fingerprint], job_of).optional()?;
        Ok(found.filter(|job| self.has_results(job)))
    }

    /// True if the list of a job's results can be read and their files are there, as far as they are in the
    /// folder of the service: what is damaged, or somebody has removed, is computed again.
    fn has_results(&self, job: &Job) -> bool {
        let Ok(files) = serde_json::from_str::<Vec<ResultFile>>(&job.results) else { return false };
        let folder = self.local(Kind::Results, &job.folder);
        let is_there = |file: &ResultFile| {
            folder.join(&file.path).symlink_metadata().is_ok_and(|about| about.len() == file.bytes)
        };
        self.has_bucket() || files.iter().take(MAX_LOOKED).all(is_there)
    }

    /// Takes a job for `holder`, one that waits or whose lease has run out: of the owner of whom the fewest
    /// are computed, of several the one who was served longest ago, and of that owner the one that has waited
    /// longest.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn take_job(&self, holder: &str, lane: Lane) -> Result<Option<Job>> {
        let mut served = self.served.lock().unwrap_or_else(PoisonError::into_inner);
        let slow = self.slow_jobs().clone();
        let mut database = self.database();
        let transaction = database.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let now = now();
        let waiting = waiting(&transaction, lane, &slow, now)?.into_iter();
        let waiting = waiting.filter(|one| one.running < lane.share());
        let turn = |owner: &str| served.iter().position(|known| known == owner).map_or(0, |at| at + 1);
        let next = waiting.min_by_key(|one| (one.running, turn(&one.owner), one.number));
        let Some(next) = next else { return Ok(None) };
        let taken = transaction
            .prepare_cached(&format!(
                "UPDATE jobs SET status = 'running', holder = ?1, held_until = ?2, started = coalesce(started, ?3), updated = ?3
                 WHERE number = ?4 RETURNING {COLUMNS}"
            ))?
            .query_row(params![holder, now + LEASE.as_millis() as i64, now, next.number], job_of)
            .optional()?;
        transaction.commit()?;
        served.retain(|owner| *owner != next.owner);
        served.push(next.owner);
        Ok(taken)
    }

    /// True if a job of another owner waits for a worker of a lane.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub(crate) fn has_waiting_others(&self, owner: &str, lane: Lane) -> Result<bool> {
        let slow = self.slow_jobs().clone();
        let waiting = waiting(&self.database(), lane, &slow, now())?;
        Ok(waiting.iter().any(|one| one.owner != owner && one.running < lane.share()))
    }

    /// Gives a job that took too long for the workers of quick jobs back to the queue, for the other workers.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub(crate) fn release_slow(&self, id: &str, holder: &str) -> Result<()> {
        self.slow_jobs().insert(id.to_owned());
        self.release(holder)
    }

    fn slow_jobs(&self) -> MutexGuard<'_, BTreeSet<String>> {
        self.slow.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Renews a lease and records the progress, in percent. Returns whether the job is still to be computed
    /// by this holder.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn renew(&self, id: &str, holder: &str, progress: u8, message: &str) -> Result<bool> {
        let now = now();
        let database = self.database();
        let mut update = database.prepare_cached(
            "UPDATE jobs SET held_until = ?, progress = max(progress, ?), message = ?, updated = ?
             WHERE id = ? AND holder = ? AND status = 'running'",
        )?;
        let changed =
            update.execute(params![now + LEASE.as_millis() as i64, progress, message, now, id, holder])?;
        Ok(changed > 0)
    }

    /// Gives all jobs of a holder back to the queue.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn release(&self, holder: &str) -> Result<()> {
        let released = "UPDATE jobs SET status = CASE status WHEN 'running' THEN 'accepted' ELSE status END, holder = NULL, held_until = NULL
                        WHERE holder = ?";
        self.database().execute(released, [holder])?;
        Ok(())
    }

    /// All holders of jobs.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn holders(&self) -> Result<Vec<String>> {
        let database = self.database();
        let mut query =
            database.prepare_cached("SELECT DISTINCT holder FROM jobs WHERE holder IS NOT NULL")?;
        let rows = query.query_map([], |row| row.get(0))?;
        Ok(rows.collect::<rusqlite::Result<_>>()?)
    }

    /// Ends a job that is held. Returns whether it was.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn finish(&self, id: &str, holder: &str, outcome: &Outcome) -> Result<bool> {
        let now = now();
        self.slow_jobs().remove(id);
        let none = Said::default();
        let (status, message, said, files): (_, &str, &Said, &[ResultFile]) = match outcome {
            Outcome::Successful(files, said) => (Status::Successful, &said.text, said, files),
            Outcome::Failed(message) => (Status::Failed, message, &none, &[]),
            Outcome::Same(folder) => return self.finish_as(id, holder, folder),
        };
        let warnings = serde_json::to_string(&said.warnings).unwrap_or_else(|_| "[]".to_owned());
        let bytes: u64 = files.iter().map(|file| file.bytes).sum();
        let results = serde_json::to_string(files).map_err(std::io::Error::other)?;
        let changed = {
            let database = self.database();
            let mut update = database.prepare_cached(
                "UPDATE jobs SET status = ?1, message = ?2, progress = CASE ?1 WHEN 'successful' THEN 100 ELSE progress END, results = ?3,
                 prepared = CASE ?1 WHEN 'failed' THEN '{}' ELSE prepared END,
                 texts = octet_length(inputs) + CASE ?1 WHEN 'failed' THEN 2 ELSE octet_length(prepared) END
                    + octet_length(?3) + octet_length(?2) + octet_length(?8),
                 warnings = ?8, bytes = ?4, finished = ?5, updated = ?5, holder = NULL, held_until = NULL
                 WHERE id = ?6 AND holder = ?7 AND status = 'running'",
            )?;
            update.execute(params![status.name(), message, results, bytes, now, id, holder, warnings])?
        };
        if changed > 0 {
            self.database().execute("DELETE FROM uses WHERE job = ?", [id])?;
        } else {
            // It was dismissed: only now may its folder go.
            self.database()
                .execute("UPDATE jobs SET holder = NULL WHERE id = ? AND holder = ?", [id, holder])?;
        }
        self.remove_unused()?;
        Ok(changed > 0)
    }

    /// Gives a job that is held the results in the folder of another one. If these have been removed since,
    /// the job returns to the queue.
    fn finish_as(&self, id: &str, holder: &str, folder: &str) -> Result<bool> {
        let changed = self.database().execute(
            "UPDATE jobs SET status = 'successful', message = found.message, warnings = found.warnings, progress = 100, folder = ?1,
             results = found.results, finished = ?2, updated = ?2, holder = NULL, held_until = NULL
             FROM (SELECT results, message, warnings FROM jobs WHERE folder = ?1 AND status = 'successful' LIMIT 1) AS found
             WHERE id = ?3 AND holder = ?4 AND status = 'running'",
            params![folder, now(), id, holder],
        )?;
        match changed {
            0 => self.release(holder)?,
            _ => drop(self.database().execute("DELETE FROM uses WHERE job = ?", [id])?),
        }
        self.remove_unused()?;
        Ok(changed > 0)
    }

    /// Jobs of these states, oldest first.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn ids(&self, statuses: &[Status]) -> Result<Vec<String>> {
        let names: Vec<&str> = statuses.iter().map(|status| status.name()).collect();
        self.list_ids(
            "SELECT id FROM jobs WHERE status IN (SELECT value FROM json_each(?)) ORDER BY number",
            &serde_json::json!(names).to_string(),
        )
    }

    /// Leased jobs in a state.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn held(&self, status: Status) -> Result<Vec<String>> {
        self.list_ids("SELECT id FROM jobs WHERE status = ? AND holder IS NOT NULL", status.name())
    }

    fn list_ids(&self, query: &str, value: &str) -> Result<Vec<String>> {
        let database = self.database();
        let mut query = database.prepare_cached(query)?;
        let rows = query.query_map([value], |row| row.get(0))?;
        Ok(rows.collect::<rusqlite::Result<_>>()?)
    }

    /// The state of a job.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn status(&self, id: &str) -> Result<Option<Status>> {
        let query = "SELECT status FROM jobs WHERE id = ?";
        let name: Option<String> = self.database().query_row(query, [id], |row| row.get(0)).optional()?;
        Ok(name.as_deref().and_then(Status::named))
    }

    /// Holds a job that nobody else can take, since it is dismissed, so that its folder stays.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn hold_as(&self, id: &str, holder: &str) -> Result<()> {
        self.database().execute("UPDATE jobs SET holder = ? WHERE id = ?", [holder, id])?;
        Ok(())
    }

    /// Lets go of a dismissed job, whose folder is then removed.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn let_go(&self, id: &str, holder: &str) -> Result<()> {
        self.database().execute("UPDATE jobs SET holder = NULL WHERE id = ? AND holder = ?", [id, holder])?;
        self.remove_unused()
    }

    /// Dismisses a job of an owner: what waits or runs is given up, results are removed, unless `holder` is
    /// to hold the job until it lets go. Returns whether there was one.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn dismiss(&self, owner: &str, id: &str, holder: Option<&str>) -> Result<bool> {
        let now = now();
        self.slow_jobs().remove(id);
        let changed = self.database().execute(
            "UPDATE jobs SET status = 'dismissed', updated = ?1, finished = coalesce(finished, ?1), message = '', warnings = '[]', holder = coalesce(holder, ?4),
             inputs = '{}', prepared = '{}', fingerprint = '', texts = octet_length(results)
             WHERE owner = ?2 AND id = ?3",
            params![now, owner, id, holder],
        )?;
        if changed > 0 {
            let database = self.database();
            database.execute("DELETE FROM uses WHERE job = ?", [id])?;
            // Updates leave a page to each row that was long; SQLite merges pages only after deletions.
            database.execute("INSERT OR REPLACE INTO jobs SELECT * FROM jobs WHERE id = ?", [id])?;
        }
        self.remove_unused()?;
        Ok(changed > 0)
    }

    /// Charges a job's pulses to its owner, unless this exceeds `quota` within 24 hours. Returns what the
    /// others in that time have cost if it does. A job that is continued is charged once.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn charge(&self, job: &Job, pulses: u64, quota: Option<u64>) -> Result<std::result::Result<(), u64>> {
        let mut database = self.database();
        let transaction = database.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let day = now() - 24 * 3_600_000;
        let spent: u64 = transaction
            .prepare_cached(
                // A job may have waited for an engine longer than a day after its start.
                "SELECT coalesce(sum(pulses), 0) FROM jobs
                 WHERE owner = ? AND max(coalesce(started, 0), coalesce(finished, updated)) > ? AND id <> ?",
            )?
            .query_row(params![job.owner, day, job.id], |row| row.get(0))?;
        if quota.is_some_and(|quota| spent.saturating_add(pulses) > quota) {
            return Ok(Err(spent));
        }
        // SQLite has signed numbers.
        let pulses = pulses.min(i64::MAX as u64 / 1_000_000);
        transaction.execute("UPDATE jobs SET pulses = ? WHERE id = ?", params![pulses, job.id])?;
        transaction.commit()?;
        Ok(Ok(()))
    }
}

/// True if a job has results.
fn is_successful(database: &Connection, id: &str) -> rusqlite::Result<bool> {
    let mut query = database
        .prepare_cached("SELECT 1 FROM jobs WHERE id = ? AND status = 'successful' AND bytes >= 0")?;
    Ok(query.query_row([id], |_| Ok(())).optional()?.is_some())
}

/// The owners whose jobs wait for a worker of a lane.
fn waiting(
    database: &Connection,
    lane: Lane,
    slow: &BTreeSet<String>,
    now: i64,
) -> rusqlite::Result<Vec<Waiting>> {
    let processes: Vec<&str> = match lane {
        Lane::Any => Vec::new(),
        Lane::Quick { .. } => Process::ALL.iter().filter(|one| one.is_quick()).map(|one| one.id()).collect(),
    };
    let mut query = database.prepare_cached(
        "WITH lane AS (SELECT owner, number, status = 'running' AND holder IS NOT NULL AND held_until >= ?1 AS is_held FROM jobs
            WHERE status IN ('accepted', 'running')
            AND (?2 = '[]' OR process IN (SELECT value FROM json_each(?2)) AND id NOT IN (SELECT value FROM json_each(?3))))
         SELECT owner, min(number) FILTER (WHERE NOT is_held) AS first, count(*) FILTER (WHERE is_held) FROM lane
         GROUP BY owner HAVING first IS NOT NULL",
    )?;
    let texts = [serde_json::json!(processes).to_string(), serde_json::json!(slow).to_string()];
    let rows = query.query_map(params![now, texts[0], texts[1]], |row| {
        Ok(Waiting { owner: row.get(0)?, number: row.get(1)?, running: row.get(2)? })
    })?;
    rows.collect()
}

#[cfg(test)]
pub(crate) mod tests;
