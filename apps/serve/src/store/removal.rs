//! Removal of uploads and jobs: their rows, and their files once nothing names them.

use super::rows::list;
use super::{Result, Store};
use crate::records::Kind;
use rusqlite::Connection;

/// Free pages of the database that are kept, and given back at a time.
const MAX_FREE: u64 = 512;

impl Store {
    /// Removes an upload from the list; its files stay while jobs use them. Returns whether there was one.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn remove_upload(&self, owner: &str, name: &str) -> Result<bool> {
        let removed = self
            .database()
            .execute("UPDATE uploads SET name = NULL WHERE owner = ? AND name = ?", [owner, name])?;
        self.remove_unused()?;
        Ok(removed > 0)
    }

    /// Forgets jobs that were dismissed before a time. Quotas count the pulses of the last 24 hours, of
    /// dismissed jobs, too.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
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
    /// [`crate::store::StoreError`].
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

    /// Removes the folders of uploads and jobs that nothing names any more.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
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
}

/// Notes that files are removed, until they are.
fn note_removal(database: &Connection, kind: Kind, id: &str) -> rusqlite::Result<()> {
    let mut query = database.prepare_cached("INSERT OR IGNORE INTO removed (kind, id) VALUES (?, ?)")?;
    query.execute([kind.name(), id]).map(drop)
}
