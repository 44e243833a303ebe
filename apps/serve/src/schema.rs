//! The tables of the database, their version, and whether a database is sound.
//!
//! A database states its version (`PRAGMA user_version`). Older ones are migrated in one transaction, after a
//! copy beside them; newer ones and damaged ones are refused before anything is written.

use crate::error::{Result, StoreError};
use rusqlite::{Connection, OptionalExtension as _};
use std::collections::BTreeMap;
use std::path::Path;

// With the exclusive lock SQLite needs no memory that processes share, which network file systems do not
// have. Pages that dismissed jobs leave are given back to the disk (`Store::shrink`).
const SETTINGS: &str = "
PRAGMA auto_vacuum = INCREMENTAL;
PRAGMA locking_mode = EXCLUSIVE;
PRAGMA journal_mode = WAL;
PRAGMA journal_size_limit = 4194304;
PRAGMA synchronous = FULL;
PRAGMA busy_timeout = 10000;
PRAGMA foreign_keys = ON;
PRAGMA cache_size = -4000;
";

/// Changes of each version of the schema. Databases before version 1 have some of its tables.
const STEPS: [&str; 4] = ["
CREATE TABLE IF NOT EXISTS uploads (
    id TEXT PRIMARY KEY, owner TEXT NOT NULL, name TEXT, files INTEGER NOT NULL, bytes INTEGER NOT NULL, sha256 TEXT NOT NULL,
    created INTEGER NOT NULL, UNIQUE (owner, name)
) STRICT;
CREATE TABLE IF NOT EXISTS files (
    upload TEXT NOT NULL REFERENCES uploads (id) ON DELETE CASCADE, path TEXT NOT NULL, bytes INTEGER NOT NULL, kind TEXT NOT NULL,
    PRIMARY KEY (upload, path)
) STRICT, WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS jobs (
    number INTEGER PRIMARY KEY, id TEXT NOT NULL UNIQUE, owner TEXT NOT NULL, process TEXT NOT NULL, inputs TEXT NOT NULL,
    prepared TEXT NOT NULL, fingerprint TEXT NOT NULL, folder TEXT NOT NULL, status TEXT NOT NULL, message TEXT NOT NULL DEFAULT '',
    progress INTEGER NOT NULL DEFAULT 0, pulses INTEGER NOT NULL DEFAULT 0, results TEXT NOT NULL DEFAULT '[]',
    bytes INTEGER NOT NULL DEFAULT 0, created INTEGER NOT NULL, started INTEGER, finished INTEGER, updated INTEGER NOT NULL,
    holder TEXT, held_until INTEGER
) STRICT;
CREATE INDEX IF NOT EXISTS jobs_of_owner ON jobs (owner, number);
CREATE INDEX IF NOT EXISTS jobs_in_queue ON jobs (status, number) WHERE status IN ('accepted', 'running');
CREATE INDEX IF NOT EXISTS jobs_by_fingerprint ON jobs (owner, fingerprint) WHERE status = 'successful';
CREATE INDEX IF NOT EXISTS jobs_by_folder ON jobs (folder);
CREATE INDEX IF NOT EXISTS jobs_unfinished ON jobs (owner) WHERE status IN ('accepted', 'running');
CREATE INDEX IF NOT EXISTS jobs_stored ON jobs (owner, bytes) WHERE folder = id AND bytes > 0;
CREATE INDEX IF NOT EXISTS jobs_to_remove ON jobs (id) WHERE status = 'dismissed' AND bytes >= 0;
CREATE INDEX IF NOT EXISTS uploads_to_remove ON uploads (id) WHERE name IS NULL;
CREATE TABLE IF NOT EXISTS uses (
    job TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE, kind TEXT NOT NULL, target TEXT NOT NULL, PRIMARY KEY (job, kind, target)
) STRICT, WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS uses_of_target ON uses (target);
CREATE TABLE service (id TEXT NOT NULL) STRICT;
CREATE TABLE removed (kind TEXT NOT NULL, id TEXT NOT NULL, PRIMARY KEY (kind, id)) STRICT, WITHOUT ROWID;
", "
ALTER TABLE jobs ADD COLUMN disk INTEGER NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN texts INTEGER NOT NULL DEFAULT 0;
UPDATE jobs SET disk = CASE WHEN folder = id THEN max(bytes, 0) ELSE 0 END,
    texts = octet_length(inputs) + octet_length(prepared) + octet_length(results) + octet_length(message);
UPDATE jobs SET inputs = '{}', prepared = '{}', fingerprint = '', message = '', texts = 0 WHERE status = 'dismissed' AND bytes < 0;
DROP INDEX jobs_stored;
CREATE INDEX jobs_stored ON jobs (owner, disk, texts) WHERE bytes >= 0;
CREATE INDEX jobs_finished ON jobs (finished) WHERE status IN ('successful', 'failed');
", "
ALTER TABLE uploads ADD COLUMN folders INTEGER NOT NULL DEFAULT 0;
ALTER TABLE uploads ADD COLUMN missing TEXT;
UPDATE jobs SET prepared = '{}', texts = octet_length(inputs) + octet_length(results) + octet_length(message) + 2
WHERE status = 'failed';
CREATE INDEX jobs_dismissed ON jobs (owner, updated) WHERE bytes < 0;
", "
ALTER TABLE jobs ADD COLUMN warnings TEXT NOT NULL DEFAULT '[]';
"];

/// The version of the tables.
pub(crate) const VERSION: i64 = STEPS.len() as i64;

/// Tables and columns of a database.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum State {
    /// No tables.
    Empty,
    /// The tables of this version.
    Version(i64),
}

/// Contents of a database that a start needs before it changes anything.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Found {
    /// Its tables.
    pub state: State,
    /// Its id, since version 1.
    pub id: Option<String>,
    /// True if it lists uploads or results that have files.
    pub lists_files: bool,
}

/// True if there is a database that has something.
///
/// # Errors
/// [`StoreError::NoDatabase`] for a log without its database: SQLite would remove the log.
pub(crate) fn exists(path: &Path) -> Result<bool> {
    let has_bytes = |path: &Path| std::fs::metadata(path).is_ok_and(|about| about.len() > 0);
    match has_bytes(path) {
        false if has_bytes(&path.with_extension("db-wal")) => Err(StoreError::NoDatabase(path.to_owned())),
        exists => Ok(exists),
    }
}

/// Looks into the database at a path without changing it: its log is not written back.
///
/// # Errors
/// The errors of [`exists`] and [`check`].
pub(crate) fn look(path: &Path) -> Result<Found> {
    let nothing = Found { state: State::Empty, id: None, lists_files: false };
    if !exists(path)? {
        return Ok(nothing);
    }
    let database = Connection::open(path)?;
    database.set_db_config(rusqlite::config::DbConfig::SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, true)?;
    database.execute_batch("PRAGMA locking_mode = EXCLUSIVE")?;
    let state = check(&database, path)?;
    if state == State::Empty {
        return Ok(nothing);
    }
    let query = "SELECT EXISTS (SELECT 1 FROM uploads WHERE files > 0)
        OR EXISTS (SELECT 1 FROM jobs WHERE status = 'successful' AND results <> '[]')";
    // The oldest databases lack tables.
    let lists_files = database.query_row(query, [], |row| row.get(0)).unwrap_or(false);
    Ok(Found { state, id: id_of(&database)?, lists_files })
}

/// Checks all pages of a database, its version, and the columns of this version.
///
/// # Errors
/// [`StoreError::Damaged`] and [`StoreError::Version`].
pub(crate) fn check(database: &Connection, path: &Path) -> Result<State> {
    let damaged = |message: String| StoreError::Damaged(path.to_owned(), message);
    let found = || -> rusqlite::Result<(Vec<String>, i64, bool)> {
        let mut query = database.prepare("PRAGMA quick_check(5)")?;
        let found = query.query_map([], |row| row.get(0))?.collect::<rusqlite::Result<_>>()?;
        let version = database.query_row("PRAGMA user_version", [], |row| row.get(0))?;
        let has_tables = database.query_row("SELECT 1 FROM sqlite_schema LIMIT 1", [], |_| Ok(()));
        Ok((found, version, has_tables.optional()?.is_some()))
    };
    let (found, version, has_tables) = found().map_err(|e| damaged(e.to_string()))?;
    if found != ["ok"] {
        return Err(damaged(found.join("; ")));
    }
    match has_tables {
        _ if !(0..=VERSION).contains(&version) => {
            Err(StoreError::Version { path: path.to_owned(), found: version })
        }
        true => {
            if version == VERSION {
                compare(database, path)?;
            }
            Ok(State::Version(version))
        }
        false if version == 0 => Ok(State::Empty),
        false => Err(damaged("it has no tables".to_owned())),
    }
}

/// Opens the database that a check has found sound, or makes it, with the tables of this version. `id`
/// becomes that of a database which has none. Returns the id.
///
/// # Errors
/// Errors of the database, and columns of another version.
pub(crate) fn open(path: &Path, state: State, id: &str) -> Result<(Connection, String)> {
    let mut database = Connection::open(path)?;
    database.execute_batch(SETTINGS)?;
    let version = match state {
        State::Empty => 0,
        State::Version(version) => version,
    };
    if version < VERSION {
        if state != State::Empty {
            keep_copy(&database, path, version)?;
        }
        let transaction = database.transaction()?;
        for step in STEPS.iter().skip(version as usize) {
            transaction.execute_batch(step)?;
        }
        transaction
            .execute("INSERT INTO service (id) SELECT ? WHERE NOT EXISTS (SELECT 1 FROM service)", [id])?;
        transaction.pragma_update(None, "user_version", VERSION)?;
        // A database of other columns stays as it is.
        compare(&transaction, path)?;
        transaction.commit()?;
    }
    let shrinks: i64 = database.query_row("PRAGMA auto_vacuum", [], |row| row.get(0))?;
    if shrinks == 0 {
        database.execute_batch("VACUUM")?;
    }
    let id =
        id_of(&database)?.ok_or_else(|| StoreError::Damaged(path.to_owned(), "it has no id".to_owned()))?;
    Ok((database, id))
}

/// The id in a database; `None` before version 1.
///
/// # Errors
/// Errors of the database.
pub(crate) fn id_of(database: &Connection) -> Result<Option<String>> {
    let has_table = "SELECT 1 FROM sqlite_schema WHERE name = 'service'";
    if database.query_row(has_table, [], |_| Ok(())).optional()?.is_none() {
        return Ok(None);
    }
    Ok(database.query_row("SELECT id FROM service", [], |row| row.get(0)).optional()?)
}

/// Keeps a copy of a database before it is migrated, unless there is one.
fn keep_copy(database: &Connection, path: &Path, version: i64) -> Result<()> {
    let copy = path.with_extension(format!("db-version-{version}"));
    if !copy.exists() {
        // The copy is there as a whole or not at all, whenever the service is ended.
        let part = path.with_extension("db-part");
        match std::fs::remove_file(&part) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.into()),
            _ => {}
        }
        database.execute("VACUUM INTO ?", [part.to_string_lossy()])?;
        std::fs::File::options().write(true).open(&part)?.sync_all()?;
        std::fs::rename(&part, &copy)?;
        eprintln!(
            "vlscan serve: the database of version {version} is migrated to version {VERSION}; a copy is kept in {}",
            copy.display()
        );
    }
    Ok(())
}

/// Compares the columns with those of a new database.
fn compare(database: &Connection, path: &Path) -> Result<()> {
    let model = Connection::open_in_memory()?;
    STEPS.iter().try_for_each(|step| model.execute_batch(step))?;
    let found = columns(database)?;
    for (table, expected) in columns(&model)? {
        if found.get(&table) != Some(&expected) {
            let message = format!("the columns of the table `{table}` are not those of version {VERSION}");
            return Err(StoreError::Damaged(path.to_owned(), message));
        }
    }
    Ok(())
}

/// The names and types of the columns of all tables.
fn columns(database: &Connection) -> rusqlite::Result<BTreeMap<String, Vec<String>>> {
    let mut query = database.prepare(
        "SELECT tables.name, columns.name || ' ' || columns.type FROM sqlite_schema AS tables, pragma_table_info(tables.name) AS columns
         WHERE tables.type = 'table' ORDER BY tables.name, columns.cid",
    )?;
    let rows = query.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?;
    let mut found = BTreeMap::<String, Vec<String>>::new();
    for row in rows {
        let (table, column) = row?;
        found.entry(table).or_default().push(column);
    }
    Ok(found)
}
