//! The queue: jobs that wait, and leases of those that are computed.
//!
//! A worker holds a job for some seconds and renews this lease while it computes. A service that ends takes its workers along, and a lease
//! that is not renewed runs out; so the job is given to another worker, which continues it. Only who holds a job can finish it.

use crate::records::Kind;
use crate::store::{COLUMNS, Job, Result, ResultFile, Status, Store, job_of, now};
use rusqlite::{OptionalExtension as _, TransactionBehavior, params};
use std::collections::BTreeSet;
use std::time::Duration;

/// How long a job is held without a renewal.
pub const LEASE: Duration = Duration::from_secs(10);

/// What a job reads besides its own document.
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
    /// Whose files they are, and under which id they are kept.
    pub fn files(&self) -> (Kind, &str) {
        match self {
            Use::Upload { id, .. } => (Kind::Upload, id),
            Use::Job { folder, .. } => (Kind::Results, folder),
        }
    }
}

/// What came of a computation.
#[derive(Clone, Debug)]
pub enum Outcome {
    /// Results, and what vlscan said.
    Successful(Vec<ResultFile>, String),
    /// The results in the folder of another job, which are the same.
    Same(String),
    /// A message.
    Failed(String),
}

impl Store {
    /// Adds a job to the queue, or, with `answer`, as successful with the results of that earlier job. Returns `false` and adds nothing if
    /// the owner has `max_queued` jobs that are not finished.
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
                 finished, updated, message) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?12, ?11, ?13)",
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
            "SELECT {COLUMNS} FROM jobs WHERE owner = ? AND fingerprint = ? AND status = 'successful' LIMIT 1"
        ))?;
        let found = query.query_row([owner, fingerprint], job_of).optional()?;
        Ok(found)
    }

    /// Takes the job that has waited longest, or one whose lease has run out, for `holder`.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn take_job(&self, holder: &str) -> Result<Option<Job>> {
        let mut database = self.database();
        let transaction = database.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let now = now();
        let taken = transaction
            .prepare_cached(&format!(
                "UPDATE jobs SET status = 'running', holder = ?1, held_until = ?2, started = coalesce(started, ?3), updated = ?3
                 WHERE number = (SELECT number FROM jobs WHERE status IN ('accepted', 'running')
                    AND (holder IS NULL OR held_until < ?3) ORDER BY number LIMIT 1)
                 RETURNING {COLUMNS}"
            ))?
            .query_row(params![holder, now + LEASE.as_millis() as i64, now], job_of)
            .optional()?;
        transaction.commit()?;
        Ok(taken)
    }

    /// Renews a lease and records the progress, in percent. Returns whether the job is still to be computed by this holder.
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
        let (status, message, files): (_, &str, &[ResultFile]) = match outcome {
            Outcome::Successful(files, said) => (Status::Successful, said, files),
            Outcome::Failed(message) => (Status::Failed, message, &[]),
            Outcome::Same(folder) => return self.finish_as(id, holder, folder),
        };
        let bytes: u64 = files.iter().map(|file| file.bytes).sum();
        let results = serde_json::to_string(files).unwrap_or_default();
        let changed = {
            let database = self.database();
            let mut update = database.prepare_cached(
                "UPDATE jobs SET status = ?1, message = ?2, progress = CASE ?1 WHEN 'successful' THEN 100 ELSE progress END, results = ?3,
                 bytes = ?4, finished = ?5, updated = ?5, holder = NULL, held_until = NULL
                 WHERE id = ?6 AND holder = ?7 AND status = 'running'",
            )?;
            update.execute(params![status.name(), message, results, bytes, now, id, holder])?
        };
        if changed == 0 {
            // It was dismissed: only now may its folder go.
            self.database()
                .execute("UPDATE jobs SET holder = NULL WHERE id = ? AND holder = ?", [id, holder])?;
        }
        self.remove_unused()?;
        Ok(changed > 0)
    }

    /// Gives a job that is held the results in the folder of another one. If these have been removed since, the job returns to the queue.
    fn finish_as(&self, id: &str, holder: &str, folder: &str) -> Result<bool> {
        let changed = self.database().execute(
            "UPDATE jobs SET status = 'successful', message = found.message, progress = 100, folder = ?1, results = found.results, finished = ?2,
             updated = ?2, holder = NULL, held_until = NULL
             FROM (SELECT results, message FROM jobs WHERE folder = ?1 AND status = 'successful' LIMIT 1) AS found
             WHERE id = ?3 AND holder = ?4 AND status = 'running'",
            params![folder, now(), id, holder],
        )?;
        if changed == 0 {
            self.release(holder)?;
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

    /// Jobs of a state that somebody holds.
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

    /// Dismisses a job of an owner: what waits or runs is given up, results are removed, unless `holder` is to hold the job until it lets
    /// go. Returns whether there was one.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn dismiss(&self, owner: &str, id: &str, holder: Option<&str>) -> Result<bool> {
        let now = now();
        let changed = self.database().execute(
            "UPDATE jobs SET status = 'dismissed', updated = ?1, finished = coalesce(finished, ?1), message = '', holder = coalesce(holder, ?4)
             WHERE owner = ?2 AND id = ?3",
            params![now, owner, id, holder],
        )?;
        self.remove_unused()?;
        Ok(changed > 0)
    }

    /// Charges a job's pulses to its owner, unless this exceeds `quota` within 24 hours. Returns what the others in that time have cost
    /// if it does. A job that is continued is charged once.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn charge(&self, job: &Job, pulses: u64, quota: Option<u64>) -> Result<std::result::Result<(), u64>> {
        let mut database = self.database();
        let transaction = database.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let day = now() - 24 * 3_600_000;
        let spent: u64 = transaction
            .prepare_cached(
                "SELECT coalesce(sum(pulses), 0) FROM jobs WHERE owner = ? AND started > ? AND id <> ?",
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::Files;
    use crate::store::{FileKind, Upload, UploadFile};

    fn job(owner: &str, id: &str) -> Job {
        Job {
            id: id.to_owned(),
            owner: owner.to_owned(),
            process: "run".to_owned(),
            inputs: "{}".to_owned(),
            prepared: "{}".to_owned(),
            fingerprint: "same".to_owned(),
            folder: id.to_owned(),
            status: Status::Accepted,
            message: String::new(),
            progress: 0,
            results: String::new(),
            created: now(),
            started: None,
            finished: None,
            updated: now(),
        }
    }

    fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), Files::Folder).unwrap();
        (folder, store)
    }

    #[test]
    fn a_job_is_taken_once_and_finished_by_its_holder() {
        let (_folder, store) = store();
        for id in ["a", "b"] {
            assert!(store.add_job(&job("anna", id), &BTreeSet::new(), None, 2).unwrap());
        }
        assert!(!store.add_job(&job("anna", "c"), &BTreeSet::new(), None, 2).unwrap(), "two jobs wait");
        assert!(store.add_job(&job("ben", "d"), &BTreeSet::new(), None, 2).unwrap());
        assert_eq!(store.take_job("w1").unwrap().unwrap().id, "a");
        assert_eq!(store.take_job("w2").unwrap().unwrap().id, "b");
        assert_eq!(store.take_job("w3").unwrap().unwrap().id, "d");
        assert!(store.take_job("w4").unwrap().is_none());
        assert!(!store.finish("a", "w2", &Outcome::Successful(Vec::new(), String::new())).unwrap());
        assert!(store.finish("a", "w1", &Outcome::Failed("no".to_owned())).unwrap());
        let found = store.job("anna", "a").unwrap().unwrap();
        assert_eq!((found.status, found.message.as_str()), (Status::Failed, "no"));
        assert!(store.job("ben", "a").unwrap().is_none(), "jobs of others are not seen");
        // A holder that has ended gives its job back.
        store.release("w2").unwrap();
        assert_eq!(store.take_job("w5").unwrap().unwrap().id, "b");
        assert!(!store.renew("b", "w2", 10, "").unwrap() && store.renew("b", "w5", 10, "").unwrap());
        // A lease runs out.
        store.database().execute("UPDATE jobs SET held_until = 1 WHERE id = 'b'", []).unwrap();
        assert_eq!(store.take_job("w6").unwrap().unwrap().id, "b");
    }

    #[test]
    fn results_are_given_again_and_kept_while_a_job_names_them() {
        let (_folder, store) = store();
        store.add_job(&job("anna", "a"), &BTreeSet::new(), None, 9).unwrap();
        store.take_job("w").unwrap();
        std::fs::create_dir_all(store.job_folder("a").join("out")).unwrap();
        let files = vec![ResultFile { path: "points.laz".to_owned(), bytes: 7 }];
        store.finish("a", "w", &Outcome::Successful(files.clone(), "warning: w".to_owned())).unwrap();
        let first = store.same_job("anna", "same").unwrap().unwrap();
        assert!(store.same_job("ben", "same").unwrap().is_none());
        store.add_job(&job("anna", "b"), &BTreeSet::new(), Some(&first), 0).unwrap();
        let again = store.job("anna", "b").unwrap().unwrap();
        assert_eq!((again.status, again.folder.as_str()), (Status::Successful, "a"));
        assert_eq!((again.result_files(), again.message.as_str()), (files, "warning: w"));
        assert_eq!(store.stored_bytes("anna").unwrap(), 7);
        store.dismiss("anna", "a", None).unwrap();
        assert!(store.job_folder("a").is_dir(), "the second job has its results there");
        store.dismiss("anna", "b", None).unwrap();
        assert!(!store.job_folder("a").exists());
    }

    #[test]
    fn uploads_stay_while_unfinished_jobs_use_them() {
        let (_folder, store) = store();
        let upload = Upload {
            id: "u".into(),
            name: "forest".into(),
            files: 1,
            bytes: 5,
            sha256: "x".into(),
            created: 1,
        };
        let files = [UploadFile { path: "a.obj".into(), bytes: 5, kind: FileKind::Other }];
        std::fs::create_dir_all(store.upload_folder("u")).unwrap();
        assert!(store.add_upload("anna", &upload, &files).unwrap());
        assert!(!store.add_upload("anna", &Upload { id: "v".into(), ..upload.clone() }, &files).unwrap());
        let uses = BTreeSet::from([Use::Upload { name: "forest".into(), id: "u".into() }]);
        store.add_job(&job("anna", "a"), &uses, None, 9).unwrap();
        assert!(!store.remove_upload("ben", "forest").unwrap());
        assert!(store.remove_upload("anna", "forest").unwrap());
        assert!(store.uploads("anna").unwrap().is_empty() && store.upload_folder("u").is_dir());
        store.dismiss("anna", "a", None).unwrap();
        assert!(!store.upload_folder("u").exists());
    }

    #[test]
    fn a_job_is_finished_with_the_results_of_another_one_while_these_are_there() {
        let (_folder, store) = store();
        let files = vec![ResultFile { path: "points.laz".to_owned(), bytes: 7 }];
        for id in ["a", "b", "c"] {
            store.add_job(&job("anna", id), &BTreeSet::new(), None, 9).unwrap();
        }
        store.take_job("w1").unwrap();
        store.finish("a", "w1", &Outcome::Successful(files.clone(), "warning: w".to_owned())).unwrap();
        store.take_job("w2").unwrap();
        assert!(store.finish("b", "w2", &Outcome::Same("a".to_owned())).unwrap());
        let found = store.job("anna", "b").unwrap().unwrap();
        assert_eq!(
            (found.status, found.folder.as_str(), found.result_files()),
            (Status::Successful, "a", files)
        );
        assert_eq!(found.message, "warning: w");
        store.dismiss("anna", "a", None).unwrap();
        assert!(store.has(Kind::Results, "a").unwrap(), "another job names them");
        store.dismiss("anna", "b", None).unwrap();
        assert_eq!(store.take_job("w3").unwrap().unwrap().id, "c");
        assert!(!store.finish("c", "w3", &Outcome::Same("a".to_owned())).unwrap());
        assert_eq!(store.take_job("w4").unwrap().unwrap().id, "c", "it is computed after all");
    }

    #[test]
    fn the_folder_of_a_dismissed_job_stays_while_somebody_holds_it() {
        let (_folder, store) = store();
        store.add_job(&job("anna", "a"), &BTreeSet::new(), None, 9).unwrap();
        std::fs::create_dir_all(store.job_folder("a")).unwrap();
        store.dismiss("anna", "a", Some("engine")).unwrap();
        assert!(store.job_folder("a").is_dir() && store.take_job("w").unwrap().is_none());
        assert_eq!(store.held(Status::Dismissed).unwrap(), ["a"]);
        store.let_go("a", "another").unwrap();
        assert!(store.job_folder("a").is_dir());
        store.let_go("a", "engine").unwrap();
        assert!(!store.job_folder("a").exists());
    }

    #[test]
    fn quotas_count_what_has_started_within_a_day() {
        let (_folder, store) = store();
        for id in ["a", "b"] {
            store.add_job(&job("anna", id), &BTreeSet::new(), None, 9).unwrap();
        }
        let first = store.take_job("w").unwrap().unwrap();
        let second = store.take_job("w").unwrap().unwrap();
        assert_eq!(store.charge(&first, 60, Some(100)).unwrap(), Ok(()));
        assert_eq!(store.charge(&first, 60, Some(100)).unwrap(), Ok(()), "it is continued");
        assert_eq!(store.charge(&second, 60, Some(100)).unwrap(), Err(60));
        assert_eq!(store.charge(&second, u64::MAX, None).unwrap(), Ok(()));
    }
}
