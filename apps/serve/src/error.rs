//! Errors of the store.

use std::io::ErrorKind;
use std::path::PathBuf;

/// Why the store fails.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The database.
    #[error("the database of the service: {0}")]
    Database(#[from] rusqlite::Error),
    /// Files.
    #[error("the files of the service: {0}")]
    Files(#[from] std::io::Error),
    /// The bucket.
    #[error("the bucket of the service: {0}")]
    Bucket(std::io::Error),
    /// A record that is not as the service writes it.
    #[error("{record} cannot be read: {error}")]
    Record {
        /// The record and the job that it belongs to.
        record: String,
        /// Problem of its text.
        error: serde_json::Error,
    },
    /// The database cannot be used.
    #[error(
        "the database {0} is damaged: {1}\nhelp: restore it from a backup, after you have moved \
         service.db-wal away, which belongs to the damaged one; nothing was changed, and `vlscan serve check` shows the state"
    )]
    Damaged(PathBuf, String),
    /// The database is of another version.
    #[error(
        "the database {path} has the version {found}, and this program has version {}\n\
         help: use the version of vlscan-serve that made it",
        crate::schema::VERSION
    )]
    Version {
        /// The database.
        path: PathBuf,
        /// Its version.
        found: i64,
    },
    /// The database is missing or empty, but its folder is in use.
    #[error(
        "the database {0} is missing or empty, but its folder has been used by a service\n\
         help: restore it from a backup, after you have moved service.db-wal away, or move `id`, `uploads`, \
         `jobs` and `service.db-wal` elsewhere to begin anew; nothing was changed"
    )]
    NoDatabase(PathBuf),
    /// Folder or bucket belong to another service than the database.
    #[error(
        "{0} belongs to another service than the database\n\
         help: check --data and --store; `vlscan serve check` shows the ids; nothing was changed"
    )]
    Foreign(&'static str),
    /// The bucket is empty, but the database lists files.
    #[error(
        "the bucket is empty, but the database lists uploads or results\n\
         help: start the service with the --store that has their files, or without --store if they are in the folder --data; nothing was changed"
    )]
    NoObjects,
}

impl StoreError {
    /// True if there is no room on the disk, or in the share of the service's user.
    pub fn is_full_disk(&self) -> bool {
        match self {
            StoreError::Database(error) => error.sqlite_error_code() == Some(rusqlite::ErrorCode::DiskFull),
            StoreError::Files(error) | StoreError::Bucket(error) => {
                matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded)
            }
            _ => false,
        }
    }
}

/// A result of the store.
pub type Result<T> = std::result::Result<T, StoreError>;
