//! `vlscan serve check`: the state of a service's folder, database and bucket, of which nothing is changed.

use crate::config::CheckArgs;
use crate::files::Files;
use crate::opening::{DATABASE, database_files, folder_of, is_incomplete, leftovers, names_in, read_id};
use crate::records::Kind;
use crate::schema::{self, State};
use crate::store::{INCOMING, Result, Store, StoreError};
use rusqlite::Connection;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::{fs, io};

/// Names that a line lists.
const MAX_LISTED: usize = 20;

/// Result of the check.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Lines to print.
    pub text: String,
    /// Problems that a start would refuse or report.
    pub problems: usize,
}

impl Report {
    fn line(&mut self, name: &str, text: &str) {
        let _ = writeln!(self.text, "{name:<10}{text}");
    }

    fn problem(&mut self, name: &str, text: &str) {
        self.problems += 1;
        self.line(name, &format!("PROBLEM: {text}"));
    }

    fn names(&mut self, name: &str, names: &[String], about: &str) {
        if !names.is_empty() {
            let listed = names.iter().take(MAX_LISTED).cloned().collect::<Vec<_>>().join(", ");
            let more = if names.len() > MAX_LISTED { ", …" } else { "" };
            self.problem(name, &format!("{} {about}: {listed}{more}", names.len()));
        }
    }
}

/// A folder that cannot be inspected.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum InspectError {
    /// A folder that cannot be opened.
    #[error("--data {}: {error}", .path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The error of the operating system.
        error: io::Error,
    },
    /// A folder that a running service uses.
    #[error("a service uses the folder {}; stop it first", .0.display())]
    InUse(PathBuf),
    /// A file of the database that cannot be copied.
    #[error("{}: {error}", .path.display())]
    Copy {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        error: io::Error,
    },
    /// Database, files and bucket.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The system.
    #[error("{0}")]
    System(#[from] io::Error),
}

/// Inspects the folder of a service that does not run.
///
/// # Errors
/// If a service uses the folder, and if files or the bucket cannot be read.
pub fn inspect(args: &CheckArgs) -> std::result::Result<Report, InspectError> {
    let root = args.data.canonicalize();
    let root = root.map_err(|error| InspectError::Folder { path: args.data.clone(), error })?;
    if let Ok(lock) = fs::File::open(root.join("lock"))
        && lock.try_lock_shared().is_err()
    {
        return Err(InspectError::InUse(root));
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let kept = Files::of(args.store.as_deref(), runtime.handle())?;
    let mut report = Report::default();
    let of_folder = read_id(&root)?;
    report.line("folder", &format!("{}, {}", root.display(), id_text(of_folder.as_deref())));
    // SQLite may write to what it opens.
    let copy = tempfile::tempdir()?;
    for path in database_files(&root).iter().filter(|path| path.exists()) {
        let name = path.file_name().unwrap_or_default();
        let copied = fs::copy(path, copy.path().join(name));
        copied.map_err(|error| InspectError::Copy { path: path.clone(), error })?;
    }
    match database(&copy.path().join(DATABASE)) {
        Ok(Some((database, version, id))) => {
            report.line("database", &format!("version {version}, sound, {}", id_text(id.as_deref())));
            if version < schema::VERSION {
                report.line("", &format!("a start migrates it to version {}", schema::VERSION));
            }
            let of_bucket = kept.id()?;
            if args.store.is_some() {
                report.line("bucket", &id_text(of_bucket.as_deref()));
            }
            for (place, known) in [("folder", &of_folder), ("bucket", &of_bucket)] {
                if known.is_some() && *known != id {
                    report
                        .problem("ids", &format!("the {place} belongs to another service than the database"));
                }
            }
            let store = Store {
                database: Mutex::new(database),
                root,
                kept,
                fetches: crate::files::Fetches::default(),
                served: Mutex::default(),
                slow: Mutex::default(),
                receiving: Arc::default(),
            };
            contents(&store, &mut report)?;
            incomplete(&store, &mut report)?;
        }
        Ok(None) => {
            report.problem("database", "it is missing or empty");
            for kind in [Kind::Upload, Kind::Results] {
                let names = names_in(&root.join(folder_of(kind)))?;
                report.line(folder_of(kind), &names.len().to_string());
            }
        }
        Err(error) => report.problem(
            "database",
            &error.to_string().replace(&copy.path().display().to_string(), &root.display().to_string()),
        ),
    }
    Ok(report)
}

fn id_text(id: Option<&str>) -> String {
    id.map_or("no id".to_owned(), |id| format!("id {id}"))
}

/// A sound database, its version and its id.
fn database(path: &Path) -> Result<Option<(Connection, i64, Option<String>)>> {
    if !schema::exists(path)? {
        return Ok(None);
    }
    let database = Connection::open(path)?;
    match schema::check(&database, path)? {
        State::Empty => Ok(None),
        State::Version(version) => {
            let id = schema::id_of(&database)?;
            Ok(Some((database, version, id)))
        }
    }
}

/// Compares what the database lists with what there is.
fn contents(store: &Store, report: &mut Report) -> Result<()> {
    for kind in [Kind::Upload, Kind::Results] {
        let in_folder = names_in(&store.root().join(folder_of(kind)))?;
        let in_bucket = store.in_bucket(kind)?;
        let listed = listed(store, kind)?;
        report.line(folder_of(kind), &format!("{} with files, as the database lists them", listed.len()));
        let has =
            |id: &String| if store.has_bucket() { in_bucket.contains(id) } else { in_folder.contains(id) };
        let absent: Vec<String> = listed.into_iter().filter(|id| !has(id)).collect();
        report.names("", &absent, "have no files");
        let removed = store.removed(kind)?;
        if !removed.is_empty() {
            report.line("", &format!("a start completes {} interrupted removals", removed.len()));
        }
        let mut unknown = Vec::new();
        for id in in_folder.union(&in_bucket).filter(|id| !removed.contains(*id)) {
            if !store.is_known(kind, id)? {
                unknown.push(id.clone());
            }
        }
        report.names("", &unknown, "are not listed by the database; a start moves them to lost/");
        let lost = names_in(&store.root().join("lost").join(folder_of(kind)))?;
        if !lost.is_empty() {
            report.line("", &format!("{} in lost/{}", lost.len(), folder_of(kind)));
        }
    }
    Ok(())
}

/// Lists files that are not complete, and what others have put among them.
fn incomplete(store: &Store, report: &mut Report) -> Result<()> {
    let names = names_in(&store.incoming())?;
    let (own, others): (Vec<String>, Vec<String>) = names.into_iter().partition(|name| is_incomplete(name));
    let own = own.len() + leftovers(store.root())?.len();
    if own > 0 || !others.is_empty() {
        report.line(INCOMING, &format!("a start removes {own} incomplete files"));
    }
    report.names("", &others, "are none of the service's files; a start moves them to lost/");
    let lost = names_in(&store.root().join("lost").join(INCOMING))?;
    if !lost.is_empty() {
        report.line("", &format!("{} in lost/{INCOMING}", lost.len()));
    }
    Ok(())
}

/// The uploads, or the folders of results, that have files.
fn listed(store: &Store, kind: Kind) -> Result<BTreeSet<String>> {
    let query = match kind {
        Kind::Upload => "SELECT id FROM uploads WHERE files > 0",
        Kind::Results => "SELECT DISTINCT folder FROM jobs WHERE status = 'successful' AND results <> '[]'",
    };
    let database = store.database();
    let mut query = database.prepare(query)?;
    let rows = query.query_map([], |row| row.get(0))?;
    Ok(rows.collect::<rusqlite::Result<_>>()?)
}
