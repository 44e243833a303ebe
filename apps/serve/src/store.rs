//! State of the service in SQLite, and the folders beside it.
//!
//! ```text
//! DATA/service.db            uploads, jobs, queue (write-ahead log)
//! DATA/id                    the id of the service, which is also in the database and in the bucket
//! DATA/clock                 the clock by which jobs expire
//! DATA/uploads/ID/…          files of an upload; never changed once they are listed
//! DATA/jobs/ID/in/           what a job reads: links to uploads and results, its pipeline file
//! DATA/jobs/ID/out/          its results
//! DATA/jobs/ID/tasks/        what an engine was given, and what came of it
//! DATA/jobs/ID/view/         pictures of its results for pages
//! DATA/jobs/ID/log           messages of vlscan
//! DATA/incoming/…            uploads and other files that are not complete
//! DATA/lost/…                uploads and jobs that the database does not list, files of others
//! ```
//!
//! With a bucket, uploads and `out` are there only while they are used (`files`).
//!
//! A row is written when its files are complete. Files are removed when no row names them, after a note of
//! their removal; so the next start completes what is interrupted, and removes nothing without a note
//! (`opening`).
//!
//! | file | what it does |
//! |---|---|
//! | `rows` | rows of the database as jobs and uploads |
//! | `removal` | removal of uploads and jobs |
//! | `folders` | folders of the service |

mod folders;
mod removal;
mod rows;

pub(crate) use folders::{INCOMING, INCOMING_BYTES, make_private, remove_folder};
pub(crate) use rows::{COLUMNS, job_of};

use crate::beneath::BLOCK;
pub use crate::error::{Result, StoreError};
use crate::files::{Fetches, Files};
use crate::records::Kind;
pub use crate::records::{FileKind, Job, ResultFile, Selection, Status, Upload, UploadFile, now, time_text};
use crate::reservations::Reservations;
use crate::tokens::random_name;
use rows::{DURATION, SHORT_INPUTS, SHORT_MESSAGE, upload_of};
use rusqlite::{Connection, OptionalExtension as _, params};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Uploads, jobs and their folders.
#[derive(Debug)]
pub struct Store {
    pub(crate) database: Mutex<Connection>,
    pub(crate) root: PathBuf,
    pub(crate) kept: Files,
    pub(crate) fetches: Fetches,
    /// Owners whose jobs were taken, the last one at the end.
    pub(crate) served: Mutex<Vec<String>>,
    /// Jobs that took too long for workers of quick jobs, and wait for another worker or have one.
    pub(crate) slow: Mutex<BTreeSet<String>>,
    /// Uploads that are being received.
    pub(crate) receiving: Arc<Reservations>,
}

impl Store {
    /// The folder of the service.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The folder of a job.
    pub fn job_folder(&self, folder: &str) -> PathBuf {
        self.root.join("jobs").join(folder)
    }

    /// The folder of files that are not complete.
    pub(crate) fn incoming(&self) -> PathBuf {
        self.root.join(INCOMING)
    }

    /// A new path of a file or folder that is not complete.
    pub(crate) fn new_incoming(&self) -> PathBuf {
        self.incoming().join(random_name(INCOMING_BYTES))
    }

    /// The folder of an upload's files.
    pub fn upload_folder(&self, id: &str) -> PathBuf {
        self.root.join("uploads").join(id)
    }

    pub(crate) fn database(&self) -> MutexGuard<'_, Connection> {
        self.database.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lists an upload whose files are in their folder. Returns `false`, and lists nothing, if its owner has
    /// one of that name.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn add_upload(&self, owner: &str, upload: &Upload, files: &[UploadFile]) -> Result<bool> {
        let mut database = self.database();
        let transaction = database.transaction()?;
        let added = transaction
            .prepare_cached(
                "INSERT OR IGNORE INTO uploads (id, owner, name, files, folders, bytes, sha256, created)
                 VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            )?
            .execute(params![
                upload.id,
                owner,
                upload.name,
                upload.files,
                upload.folders,
                upload.bytes,
                upload.sha256,
                upload.created
            ])?;
        if added == 0 {
            return Ok(false);
        }
        for file in files {
            transaction
                .prepare_cached("INSERT INTO files (upload, path, bytes, kind) VALUES (?, ?, ?, ?)")?
                .execute(params![upload.id, file.path, file.bytes, file.kind.name()])?;
        }
        transaction.commit()?;
        Ok(true)
    }

    /// The newest uploads of an owner, newest first.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn uploads(&self, owner: &str) -> Result<Vec<Upload>> {
        let database = self.database();
        let mut query = database.prepare_cached(
            "SELECT id, name, files, folders, bytes, sha256, created FROM uploads
             WHERE owner = ?1 AND name IS NOT NULL ORDER BY created DESC, id LIMIT ?2",
        )?;
        let rows = query.query_map(params![owner, MAX_UPLOADS], upload_of)?;
        Ok(rows.collect::<rusqlite::Result<_>>()?)
    }

    /// The upload of that name.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn upload(&self, owner: &str, name: &str) -> Result<Option<Upload>> {
        let database = self.database();
        let mut query = database.prepare_cached(
            "SELECT id, name, files, folders, bytes, sha256, created FROM uploads WHERE owner = ? AND name = ?",
        )?;
        Ok(query.query_row([owner, name], upload_of).optional()?)
    }

    /// The files of an upload, by path.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn files(&self, upload: &str) -> Result<Vec<UploadFile>> {
        let database = self.database();
        let mut query =
            database.prepare_cached("SELECT path, bytes, kind FROM files WHERE upload = ? ORDER BY path")?;
        let rows = query.query_map([upload], |row| {
            let kind = FileKind::named(&row.get::<_, String>(2)?);
            Ok(UploadFile { path: row.get(0)?, bytes: row.get(1)?, kind })
        })?;
        Ok(rows.collect::<rusqlite::Result<_>>()?)
    }

    /// Names of files that an upload lacks, if they have been looked for.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn missing(&self, upload: &str) -> Result<Option<Vec<String>>> {
        let query = "SELECT missing FROM uploads WHERE id = ?";
        let text: Option<Option<String>> =
            self.database().query_row(query, [upload], |row| row.get(0)).optional()?;
        Ok(text.flatten().and_then(|text| serde_json::from_str(&text).ok()))
    }

    /// Records the names of files that an upload lacks.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn set_missing(&self, upload: &str, names: &[String]) -> Result<()> {
        let text = serde_json::json!(names).to_string();
        self.database().execute("UPDATE uploads SET missing = ? WHERE id = ?", [text.as_str(), upload])?;
        Ok(())
    }

    /// Disk space of an owner, bytes: files of uploads and jobs in any state, a block for each file and
    /// folder, the rows of the database, those of dismissed jobs until they are forgotten, and uploads that
    /// are being received.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn stored_bytes(&self, owner: &str) -> Result<u64> {
        Ok(self.listed_bytes(owner)?.saturating_add(self.receiving.of(owner)))
    }

    /// Disk space of an owner, bytes, without uploads that are being received.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn listed_bytes(&self, owner: &str) -> Result<u64> {
        let database = self.database();
        let mut query = database.prepare_cached(
            "SELECT (SELECT coalesce(sum(bytes + (files + folders) * ?2), 0) FROM uploads WHERE owner = ?1)
                  + (SELECT coalesce(sum(disk + texts + ?3), 0) FROM jobs WHERE owner = ?1 AND bytes >= 0)
                  + (SELECT count(*) * ?3 FROM jobs WHERE owner = ?1 AND bytes < 0)",
        )?;
        Ok(query.query_row(params![owner, BLOCK, ROW], |row| row.get(0))?)
    }

    /// Bytes of the database that the jobs of an owner take.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn row_bytes(&self, owner: &str) -> Result<u64> {
        let database = self.database();
        let mut query = database.prepare_cached(
            "SELECT coalesce(sum(texts + ?2), 0) FROM jobs WHERE owner = ?1 AND bytes >= 0",
        )?;
        Ok(query.query_row(params![owner, ROW], |row| row.get(0))?)
    }

    /// Adds what was drawn for a job to what its owner takes on the disk.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn set_disk(&self, id: &str, bytes: u64) -> Result<()> {
        self.database()
            .execute("UPDATE jobs SET disk = ? WHERE id = ? AND bytes >= 0", params![bytes, id])?;
        Ok(())
    }

    /// Jobs that were finished before a time, with their owners.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn finished_before(&self, time: i64) -> Result<Vec<(String, String)>> {
        let database = self.database();
        let mut query = database.prepare_cached(
            "SELECT owner, id FROM jobs WHERE status IN ('successful', 'failed') AND finished < ? LIMIT 1000",
        )?;
        let rows = query.query_map([time], |row| Ok((row.get(0)?, row.get(1)?)))?;
        Ok(rows.collect::<rusqlite::Result<_>>()?)
    }

    /// Time of the newest change of a job, if there are jobs.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn newest_update(&self) -> Result<Option<i64>> {
        Ok(self.database().query_row("SELECT max(updated) FROM jobs", [], |row| row.get(0))?)
    }

    /// A job of an owner.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn job(&self, owner: &str, id: &str) -> Result<Option<Job>> {
        let database = self.database();
        let mut query =
            database.prepare_cached(&format!("SELECT {COLUMNS} FROM jobs WHERE owner = ? AND id = ?"))?;
        Ok(query.query_row([owner, id], job_of).optional()?)
    }

    /// The state of a job of an owner: the job without its inputs, what is executed, and results. Those who
    /// wait for a job ask for its state again and again.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn job_state(&self, owner: &str, id: &str) -> Result<Option<Job>> {
        let columns = [("inputs,", "'{}',"), ("prepared,", "'{}',"), ("results,", "'[]',")]
            .iter()
            .fold(COLUMNS.to_owned(), |columns, (column, empty)| columns.replace(column, empty));
        let database = self.database();
        let mut query =
            database.prepare_cached(&format!("SELECT {columns} FROM jobs WHERE owner = ? AND id = ?"))?;
        Ok(query.query_row([owner, id], job_of).optional()?)
    }

    /// The newest jobs of an owner, of these states and processes if any are named, after the first `skip`.
    /// Lists have no long texts: neither what is executed nor warnings, long inputs and messages in part, and
    /// results only in lists of `Listed::Results`, unless they are very many.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn jobs(
        &self,
        listed: Listed,
        owner: &str,
        statuses: &[Status],
        processes: &[String],
        skip: u32,
        limit: u32,
    ) -> Result<Vec<Job>> {
        let (statuses, processes) = (statuses.to_vec(), processes.to_vec());
        self.select(listed, owner, &Selection { statuses, processes, skip, limit, ..Selection::default() })
    }

    /// The newest jobs of an owner among those of a selection, as [`Store::jobs`] lists them.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn select(&self, listed: Listed, owner: &str, selection: &Selection) -> Result<Vec<Job>> {
        let statuses: Vec<&str> = selection.statuses.iter().map(|status| status.name()).collect();
        let database = self.database();
        let results = match listed {
            Listed::States | Listed::Bare => "'[]'",
            Listed::Results => "CASE WHEN octet_length(results) <= 65536 THEN results ELSE '[]' END",
        };
        let inputs = match listed {
            Listed::Bare => "'{}'",
            Listed::States | Listed::Results => SHORT_INPUTS,
        };
        let columns = COLUMNS
            .replace("prepared,", "'{}',")
            .replace("message,", &format!("{SHORT_MESSAGE},"))
            .replace("inputs,", &format!("{inputs},"))
            .replace("results,", &format!("{results},"))
            .replace("updated, warnings", "updated, '[]'");
        let mut query = database.prepare_cached(&format!(
            "SELECT {columns} FROM jobs WHERE owner = ?1
             AND (?2 = '[]' OR status IN (SELECT value FROM json_each(?2))) AND (?3 = '[]' OR process IN (SELECT value FROM json_each(?3)))
             AND (?4 IS NULL OR created >= ?4) AND (?5 IS NULL OR created <= ?5)
             AND (?6 IS NULL OR {DURATION} >= ?6) AND (?7 IS NULL OR {DURATION} <= ?7)
             ORDER BY number DESC LIMIT ?9 OFFSET ?10"
        ))?;
        let rows = query.query_map(
            params![
                owner,
                serde_json::json!(statuses).to_string(),
                serde_json::json!(selection.processes).to_string(),
                selection.created.0,
                selection.created.1,
                selection.duration.0,
                selection.duration.1,
                now(),
                selection.limit,
                selection.skip
            ],
            job_of,
        )?;
        Ok(rows.collect::<rusqlite::Result<_>>()?)
    }

    /// The files of results that are in the folder of a job.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn results_in(&self, folder: &str) -> Result<Vec<ResultFile>> {
        let query = "SELECT results FROM jobs WHERE folder = ? AND status = 'successful' LIMIT 1";
        let text: Option<String> = self.database().query_row(query, [folder], |row| row.get(0)).optional()?;
        let Some(text) = text else { return Ok(Vec::new()) };
        serde_json::from_str(&text).map_err(|error| {
            let record = format!("the list of results in the folder {folder}");
            StoreError::Record { record, error }
        })
    }

    /// True if an unfinished job reads an upload or results.
    pub(crate) fn is_used(&self, id: &str) -> Result<bool> {
        let query = "SELECT 1 FROM uses JOIN jobs ON jobs.id = uses.job WHERE target = ? AND status IN ('accepted', 'running')";
        Ok(self.database().query_row(query, [id], |_| Ok(())).optional()?.is_some())
    }

    /// True if the files of an upload, or results, are kept.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn has(&self, kind: Kind, id: &str) -> Result<bool> {
        let query = match kind {
            Kind::Upload => "SELECT 1 FROM uploads WHERE id = ?",
            Kind::Results => "SELECT 1 FROM jobs WHERE folder = ? AND status = 'successful'",
        };
        Ok(self.database().query_row(query, [id], |_| Ok(())).optional()?.is_some())
    }
}

/// Fields of job lists besides the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Listed {
    /// Nothing.
    Bare,
    /// The inputs, as titles show them.
    States,
    /// The inputs, and the files of results.
    Results,
}

/// Most uploads in a list.
const MAX_UPLOADS: u32 = 10_000;
/// Bytes that a row takes besides its texts.
const ROW: u64 = 1024;
