//! Rows of the database as jobs and uploads, and columns as lists show them.

use crate::records::{Job, Status, Upload};
use rusqlite::{Connection, Row};

/// Time of the computation of a job, ms; null for a job that waits. The time now is parameter 8.
pub(super) const DURATION: &str = "CASE status WHEN 'running' THEN ?8 - started ELSE finished - started END";
/// Messages as lists show them: the start of long ones.
pub(super) const SHORT_MESSAGE: &str =
    "CASE WHEN length(message) <= 1000 THEN message ELSE substr(message, 1, 1000) || ' …' END";
/// Inputs as titles and lists show them: without the long ones.
pub(super) const SHORT_INPUTS: &str = "CASE WHEN octet_length(inputs) <= 8192 THEN inputs ELSE (
    SELECT CASE WHEN octet_length(short) <= 8192 THEN short ELSE '{}' END
    FROM (SELECT json_remove(inputs, '$.area', '$.along', '$.part', '$.leg') AS short)) END";

/// The columns of a job.
pub(crate) const COLUMNS: &str = "id, owner, process, inputs, prepared, fingerprint, folder, status, message, progress, results, \
                                  created, started, finished, updated, warnings";

/// A job of [`COLUMNS`].
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

/// An upload of the columns `id, name, files, folders, bytes, sha256, created`.
pub(super) fn upload_of(row: &Row<'_>) -> rusqlite::Result<Upload> {
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

/// The texts of a query with one column.
pub(super) fn list(database: &Connection, query: &str) -> rusqlite::Result<Vec<String>> {
    let mut query = database.prepare_cached(query)?;
    let rows = query.query_map([], |row| row.get(0))?;
    rows.collect()
}
