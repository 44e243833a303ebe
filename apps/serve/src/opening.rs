//! Checks at start: folder, database and bucket must belong together; files that the database does not list
//! are kept.
//!
//! Each service has a random id, in its database, in the file `DATA/id` and in its bucket. A service whose
//! ids differ, or whose database is missing, empty or damaged, does not start; so a wrong volume or a lost
//! database costs nothing. What the database does not list, as after the restoration of an older one, is
//! moved to `DATA/lost` (in a bucket: below `lost/`) and never removed, and so is what is among the
//! incomplete files under a name that the service does not give. Only what the database says was removed, or
//! never completed, is removed.

use crate::files::Files;
use crate::program::{PATTERN, PATTERNS};
use crate::records::{ExpiryClock, Kind};
use crate::schema::{self, State};
use crate::store::{INCOMING, INCOMING_BYTES, Result, Store, StoreError, make_private, remove_folder};
use crate::tokens::random_name;
use rusqlite::OptionalExtension as _;
use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// The database in the folder of a service.
pub(crate) const DATABASE: &str = "service.db";
/// The file with the id.
const ID: &str = "id";
/// Names that a message lists.
const MAX_LISTED: usize = 10;
/// Start and length of the names that `tempfile` gives.
const TEMPORARY: (&str, usize) = (".tmp", 10);
/// Most bytes of a temporary file of earlier versions in the folder of a service.
const MAX_TEMPORARY: u64 = 100;

/// Uploads and results that the database does not list, and that a start has moved.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lost {
    /// `uploads/ID` or `jobs/ID`.
    pub names: Vec<String>,
}

impl Lost {
    /// Message of a start.
    pub fn message(&self, root: &Path) -> Option<String> {
        let number = self.names.len();
        let listed = self.names.iter().take(MAX_LISTED).cloned().collect::<Vec<_>>().join(", ");
        let more = if number > MAX_LISTED { ", …" } else { "" };
        (number > 0).then(|| {
            format!(
                "the database does not list {number} uploads or results, which were moved to {}: {listed}{more}\n\
                 help: if the database is an older copy, stop the service, restore the newest one and move them back",
                root.join("lost").display()
            )
        })
    }
}

/// The folder of all uploads or all jobs.
pub(crate) fn folder_of(kind: Kind) -> &'static str {
    match kind {
        Kind::Upload => "uploads",
        Kind::Results => "jobs",
    }
}

impl Store {
    /// Opens or makes the store of a folder, with the files of uploads and results where `kept` says.
    ///
    /// # Errors
    /// [`StoreError`]; for a database that is missing, damaged, of another version or of another service,
    /// before anything is changed.
    pub fn open(root: &Path, kept: Files) -> Result<Store> {
        make_private(root)?;
        let root = root.canonicalize()?;
        let path = root.join(DATABASE);
        let of_folder = read_id(&root)?;
        let has_files = has_files(&root)?;
        let found = schema::look(&path)?;
        if found.state == State::Empty && (of_folder.is_some() || has_files) {
            return Err(StoreError::NoDatabase(path));
        }
        let known = found.id.or_else(|| of_folder.clone());
        if of_folder.is_some() && of_folder != known {
            return Err(StoreError::Foreign("the folder"));
        }
        let of_bucket = kept.id()?;
        if of_bucket.is_some() && of_bucket != known {
            return Err(StoreError::Foreign("the bucket"));
        }
        if !matches!(kept, Files::Folder) && of_bucket.is_none() {
            // Its objects are those of this service, which has had no id yet, or there are none.
            match (found.lists_files, kept.has_objects()?) {
                (true, false) => return Err(StoreError::NoObjects),
                (false, true) => return Err(StoreError::Foreign("the bucket")),
                _ => {}
            }
        }
        let (database, id) = schema::open(&path, found.state, &known.unwrap_or_else(|| random_name(16)))?;
        // The database comes first: an interrupted start is completed by the next one.
        for folder in ["uploads", "jobs", INCOMING] {
            fs::create_dir_all(root.join(folder))?;
        }
        if of_folder.is_none() {
            let text = format!("{id}\n");
            crate::job_folder::write_whole(&root.join(INCOMING), &root.join(ID), text.as_bytes())?;
        }
        if of_bucket.is_none() {
            kept.set_id(&id)?;
        }
        database.set_prepared_statement_cache_capacity(64);
        Ok(Store {
            database: Mutex::new(database),
            root,
            kept,
            fetches: crate::files::Fetches::default(),
            served: Mutex::default(),
            slow: Mutex::default(),
            receiving: Arc::default(),
        })
    }

    /// Removes what an interrupted service has left, incomplete uploads and what was to be removed, and moves
    /// what the database does not list to `lost`. To be called at the start, while nothing is received.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn tidy(&self) -> Result<Lost> {
        self.remove_incomplete()?;
        self.finish_removals()?;
        let mut lost = Lost::default();
        for kind in [Kind::Upload, Kind::Results] {
            let in_bucket = self.in_bucket(kind)?;
            let in_folder = names_in(&self.root().join(folder_of(kind)))?;
            for name in in_bucket.union(&in_folder) {
                if !self.is_known(kind, name)? {
                    self.set_aside(kind, name)?;
                    lost.names.push(format!("{}/{name}", folder_of(kind)));
                } else if in_bucket.contains(name)
                    && !self.listed(kind, name)?.is_empty()
                    && !self.is_used(name)?
                {
                    // A copy that was fetched.
                    remove_folder(&self.local(kind, name))?;
                }
            }
        }
        // Earlier versions kept what finished jobs have read.
        let unused =
            "DELETE FROM uses WHERE job NOT IN (SELECT id FROM jobs WHERE status IN ('accepted', 'running'))";
        self.database().execute(unused, [])?;
        self.remove_unused()?;
        Ok(lost)
    }

    /// Removes incomplete files. What others have put among them is moved to `lost`.
    fn remove_incomplete(&self) -> Result<()> {
        let incoming = self.incoming();
        for name in names_in(&incoming)? {
            let path = incoming.join(&name);
            if !is_incomplete(&name) {
                let moved = self.move_to_lost(INCOMING, &name);
                let moved = moved.map_or_else(
                    |error| format!("cannot be moved: {error}"),
                    |to| format!("was moved to {}", to.display()),
                );
                eprintln!(
                    "vlscan serve: warning: {} is none of the service's files and {moved}",
                    path.display()
                );
                continue;
            }
            let removed = if path.is_dir() { remove_folder(&path) } else { fs::remove_file(&path) };
            if let Err(error) = removed {
                eprintln!("vlscan serve: warning: {} cannot be removed: {error}", path.display());
            }
        }
        for path in leftovers(self.root())? {
            // A folder is removed only if it is empty.
            let removed = match path.is_dir() {
                true => fs::remove_file(path.join(PATTERN)).and_then(|()| fs::remove_dir(&path)),
                false => fs::remove_file(&path),
            };
            if let Err(error) = removed {
                eprintln!("vlscan serve: warning: {} cannot be removed: {error}", path.display());
            }
        }
        Ok(())
    }

    /// True if the database lists an upload, or a job with a folder.
    pub(crate) fn is_known(&self, kind: Kind, id: &str) -> Result<bool> {
        let query = match kind {
            Kind::Upload => "SELECT 1 FROM uploads WHERE id = ?",
            Kind::Results => "SELECT 1 FROM jobs WHERE folder = ? AND bytes >= 0",
        };
        Ok(self.database().query_row(query, [id], |_| Ok(())).optional()?.is_some())
    }

    /// Moves an upload or a job that the database does not list out of the way.
    fn set_aside(&self, kind: Kind, id: &str) -> Result<()> {
        if let Files::Bucket(bucket) = &self.kept {
            bucket.set_aside(kind, id).map_err(StoreError::Bucket)?;
        }
        let from = self.root().join(folder_of(kind)).join(id);
        match from.symlink_metadata() {
            Ok(_) => self.move_to_lost(folder_of(kind), id).map(drop),
            Err(_) => Ok(()),
        }
    }

    /// Moves something in a folder of the service to `lost`, under a name that is free. Returns its new path.
    fn move_to_lost(&self, folder: &str, name: &str) -> Result<PathBuf> {
        let lost = self.root().join("lost").join(folder);
        fs::create_dir_all(&lost)?;
        let mut to = lost.join(name);
        let mut number = 2;
        while to.symlink_metadata().is_ok() {
            to = lost.join(format!("{name}-{number}"));
            number += 1;
        }
        fs::rename(self.root().join(folder).join(name), &to)?;
        Ok(to)
    }

    /// Removes the files of what was removed before an interruption.
    fn finish_removals(&self) -> Result<()> {
        for kind in [Kind::Upload, Kind::Results] {
            for id in self.removed(kind)? {
                self.discard(kind, &id)?;
            }
        }
        Ok(())
    }

    /// Uploads or results whose removal has been noted and not completed.
    pub(crate) fn removed(&self, kind: Kind) -> Result<BTreeSet<String>> {
        let database = self.database();
        let mut query = database.prepare("SELECT id FROM removed WHERE kind = ?")?;
        let rows = query.query_map([kind.name()], |row| row.get(0))?;
        Ok(rows.collect::<rusqlite::Result<_>>()?)
    }
}

/// The id of a folder, if it has one.
///
/// # Errors
/// Errors of files.
pub(crate) fn read_id(root: &Path) -> Result<Option<String>> {
    match fs::read_to_string(root.join(ID)) {
        Ok(text) => Ok(Some(text.trim().to_owned())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// True if a folder has uploads or jobs.
fn has_files(root: &Path) -> Result<bool> {
    let all = [Kind::Upload, Kind::Results].map(|kind| names_in(&root.join(folder_of(kind))));
    Ok(all.into_iter().collect::<Result<Vec<_>>>()?.iter().any(|names| !names.is_empty()))
}

/// True if the service gives this name to files and folders that are not complete.
pub(crate) fn is_incomplete(name: &str) -> bool {
    let is_random = name.len() == 2 * INCOMING_BYTES && name.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_temporary(name) || is_random
}

fn is_temporary(name: &str) -> bool {
    let (start, length) = TEMPORARY;
    name.len() == length
        && name.strip_prefix(start).is_some_and(|rest| rest.bytes().all(|b| b.is_ascii_alphanumeric()))
}

/// Temporary files that a killed service of an earlier version has left beside the file of its clock and
/// among patterns of instruments.
///
/// # Errors
/// Errors of folders.
pub(crate) fn leftovers(root: &Path) -> Result<Vec<PathBuf>> {
    let is_record = |path: &Path| {
        let is_small =
            path.symlink_metadata().is_ok_and(|about| about.is_file() && about.len() <= MAX_TEMPORARY);
        let text = is_small.then(|| fs::read_to_string(path).ok()).flatten();
        text.is_some_and(|text| text.is_empty() || ExpiryClock::recorded(&text, Instant::now()).is_some())
    };
    let is_scratch = |path: &Path| {
        let names = names_in(path).unwrap_or_default();
        !path.is_symlink() && names.iter().eq([PATTERN])
    };
    let temporary = |folder: &Path| -> Result<Vec<PathBuf>> {
        let names = names_in(folder)?.into_iter().filter(|name| is_temporary(name));
        Ok(names.map(|name| folder.join(name)).collect())
    };
    let records = temporary(root)?.into_iter().filter(|path| is_record(path));
    let scratch = temporary(&root.join(PATTERNS))?.into_iter().filter(|path| is_scratch(path));
    Ok(records.chain(scratch).collect())
}

/// The names in a folder; none if it does not exist.
pub(crate) fn names_in(folder: &Path) -> Result<BTreeSet<String>> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(BTreeSet::new()),
        entries => entries?,
    };
    let name = |entry: io::Result<fs::DirEntry>| Ok(entry?.file_name().to_string_lossy().into_owned());
    entries.map(name).collect()
}

/// The database and its log of a folder.
pub(crate) fn database_files(root: &Path) -> [PathBuf; 2] {
    let path = root.join(DATABASE);
    [path.clone(), path.with_extension("db-wal")]
}
