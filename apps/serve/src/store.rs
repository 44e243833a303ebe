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

use crate::beneath::BLOCK;
pub use crate::error::{Result, StoreError};
use crate::files::{Fetches, Files};
use crate::records::Kind;
pub use crate::records::{FileKind, Job, ResultFile, Selection, Status, Upload, UploadFile, now, time_text};
use crate::reservations::Reservations;
use crate::tokens::random_name;
use rusqlite::{Connection, OptionalExtension as _, Row, params};
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

    /// Removes an upload from the list; its files stay while jobs use them. Returns whether there was one.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn remove_upload(&self, owner: &str, name: &str) -> Result<bool> {
        let removed = self
            .database()
            .execute("UPDATE uploads SET name = NULL WHERE owner = ? AND name = ?", [owner, name])?;
        self.remove_unused()?;
        Ok(removed > 0)
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

    /// Forgets jobs that were dismissed before a time. Quotas count the pulses of the last 24 hours, of
    /// dismissed jobs, too.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn forget_before(&self, time: i64) -> Result<()> {
        let forget =
            "DELETE FROM jobs WHERE status = 'dismissed' AND bytes < 0 AND holder IS NULL AND updated < ?
                      AND NOT EXISTS (SELECT 1 FROM removed WHERE removed.id = jobs.id)";
        self.database().execute(forget, [time])?;
        self.shrink()
    }

    /// Gives pages of the database that rows have left back to the disk, some at a time.
    ///
    /// # Errors
    /// [`StoreError`].
    pub(crate) fn shrink(&self) -> Result<()> {
        let database = self.database();
        let free: u64 = database.query_row("PRAGMA freelist_count", [], |row| row.get(0))?;
        if free > MAX_FREE {
            // A row for each page.
            let mut vacuum = database.prepare(&format!("PRAGMA incremental_vacuum({MAX_FREE})"))?;
            let mut rows = vacuum.query([])?;
            while rows.next()?.is_some() {}
        }
        Ok(())
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

    /// Removes the folders of uploads and jobs that nothing names any more.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn remove_unused(&self) -> Result<()> {
        let (uploads, jobs) = {
            let mut database = self.database();
            let transaction = database.transaction()?;
            // Unfinished jobs hold what they use, and so does everything that is named.
            let uploads = list(
                &transaction,
                "SELECT id FROM uploads WHERE name IS NULL AND NOT EXISTS (
                    SELECT 1 FROM uses JOIN jobs ON jobs.id = uses.job
                    WHERE target = uploads.id AND kind = 'upload' AND status IN ('accepted', 'running'))",
            )?;
            let jobs = list(
                &transaction,
                "SELECT id FROM jobs WHERE status = 'dismissed' AND bytes >= 0
                 AND holder IS NULL AND NOT EXISTS (
                    SELECT 1 FROM jobs AS other WHERE other.folder = jobs.id AND other.status IN ('successful', 'failed'))
                 AND NOT EXISTS (SELECT 1 FROM uses JOIN jobs AS user ON user.id = uses.job
                    WHERE target = jobs.id AND kind = 'job' AND user.status IN ('accepted', 'running'))",
            )?;
            for id in &uploads {
                transaction.execute("DELETE FROM uploads WHERE id = ?", [id])?;
                note_removal(&transaction, Kind::Upload, id)?;
            }
            for id in &jobs {
                note_removal(&transaction, Kind::Results, id)?;
                transaction.execute(
                    "UPDATE jobs SET bytes = -1, results = '[]', disk = 0, texts = 0 WHERE id = ?",
                    [id],
                )?;
            }
            transaction.commit()?;
            (uploads, jobs)
        };
        let uploads = uploads.iter().map(|id| (Kind::Upload, id));
        for (kind, id) in uploads.chain(jobs.iter().map(|id| (Kind::Results, id))) {
            // The note of the removal stays: the next start tries again.
            if let Err(error) = self.discard(kind, id) {
                eprintln!("vlscan serve: {}/{id} cannot be removed: {error}", kind.name());
            }
        }
        self.shrink()
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

/// Time of the computation of a job, ms; null for a job that waits. The time now is parameter 8.
const DURATION: &str = "CASE status WHEN 'running' THEN ?8 - started ELSE finished - started END";

/// The folder of files that are not complete, in that of the service.
pub(crate) const INCOMING: &str = "incoming";
/// Random bytes of the names in it that `tempfile` does not give.
pub(crate) const INCOMING_BYTES: usize = 8;
/// Most uploads in a list.
const MAX_UPLOADS: u32 = 10_000;
/// Bytes that a row takes besides its texts.
const ROW: u64 = 1024;
/// Free pages of the database that are kept, and given back at a time.
const MAX_FREE: u64 = 512;
/// Messages as lists show them: the start of long ones.
const SHORT_MESSAGE: &str =
    "CASE WHEN length(message) <= 1000 THEN message ELSE substr(message, 1, 1000) || ' …' END";
/// Inputs as titles and lists show them: without the long ones.
const SHORT_INPUTS: &str = "CASE WHEN octet_length(inputs) <= 8192 THEN inputs ELSE (
    SELECT CASE WHEN octet_length(short) <= 8192 THEN short ELSE '{}' END
    FROM (SELECT json_remove(inputs, '$.area', '$.along', '$.part', '$.leg') AS short)) END";

pub(crate) const COLUMNS: &str = "id, owner, process, inputs, prepared, fingerprint, folder, status, message, progress, results, \
                                  created, started, finished, updated, warnings";

pub(crate) fn job_of(row: &Row<'_>) -> rusqlite::Result<Job> {
    Ok(Job {
        id: row.get(0)?,
        owner: row.get(1)?,
        process: row.get(2)?,
        inputs: row.get(3)?,
        prepared: row.get(4)?,
        fingerprint: row.get(5)?,
        folder: row.get(6)?,
        status: Status::named(&row.get::<_, String>(7)?).unwrap_or(Status::Failed),
        message: row.get(8)?,
        progress: row.get(9)?,
        results: row.get(10)?,
        created: row.get(11)?,
        started: row.get(12)?,
        finished: row.get(13)?,
        updated: row.get(14)?,
        warnings: row.get(15)?,
    })
}

fn upload_of(row: &Row<'_>) -> rusqlite::Result<Upload> {
    Ok(Upload {
        id: row.get(0)?,
        name: row.get(1)?,
        files: row.get(2)?,
        folders: row.get(3)?,
        bytes: row.get(4)?,
        sha256: row.get(5)?,
        created: row.get(6)?,
    })
}

/// Notes that files are removed, until they are.
fn note_removal(database: &Connection, kind: Kind, id: &str) -> rusqlite::Result<()> {
    let mut query = database.prepare_cached("INSERT OR IGNORE INTO removed (kind, id) VALUES (?, ?)")?;
    query.execute([kind.name(), id]).map(drop)
}

fn list(database: &Connection, query: &str) -> rusqlite::Result<Vec<String>> {
    let mut query = database.prepare_cached(query)?;
    let rows = query.query_map([], |row| row.get(0))?;
    rows.collect()
}

/// Makes a folder that only its owner can open, if it does not exist.
pub(crate) fn make_private(folder: &Path) -> std::io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::DirBuilderExt as _;
        builder.mode(0o700);
    }
    builder.create(folder)
}

/// Removes a folder with everything in it, also folders that their owner cannot read or change.
pub(crate) fn remove_folder(folder: &Path) -> std::io::Result<()> {
    use std::io::ErrorKind;
    match std::fs::remove_dir_all(folder) {
        Err(error) if error.kind() == ErrorKind::PermissionDenied => {
            open_folders(folder)?;
            std::fs::remove_dir_all(folder)
        }
        Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// Gives the owner of a folder, and of all folders in it, all rights to them.
fn open_folders(folder: &Path) -> std::io::Result<()> {
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            std::fs::set_permissions(&folder, std::fs::Permissions::from_mode(0o700))?;
        }
        for entry in std::fs::read_dir(&folder)? {
            let entry = entry?;
            // Links are not followed.
            if entry.file_type()?.is_dir() {
                folders.push(entry.path());
            }
        }
    }
    Ok(())
}
