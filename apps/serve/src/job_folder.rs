//! The folder of a job: what it reads, and the files of its results.

use crate::beneath::{Beneath, Entry, EntryKind};
use crate::names::relative_path;
use crate::request::{Prepared, name_of};
use crate::store::{Result, ResultFile, Store};
use std::fs;
use std::path::Path;

/// Most files and folders of results.
const MAX_RESULTS: usize = 100_000;

/// Makes the folder of a job, or completes the one that an earlier worker has begun to make.
///
/// # Errors
/// Errors of files.
pub(crate) fn make(store: &Store, folder: &Path, prepared: &Prepared) -> Result<()> {
    let inputs = folder.join("in");
    for name in ["in", "in/jobs", "out", "view", "tmp"] {
        fs::create_dir_all(folder.join(name))?;
    }
    // Tasks of an engine may be reading it.
    for (name, text) in prepared.document.iter().chain(&prepared.geometries) {
        store.write_whole(&inputs.join(name), text.as_bytes())?;
    }
    for used in &prepared.uses {
        let (kind, id) = used.files();
        link(&store.local(kind, id), &inputs.join(name_of(used)))?;
    }
    let text = serde_json::to_string(prepared).map_err(std::io::Error::other)?;
    store.write_whole(&folder.join("prepared.json"), text.as_bytes())
}

/// Links a file or folder; does nothing if the name exists.
///
/// # Errors
/// Errors of files.
#[cfg(unix)]
pub(crate) fn link(target: &Path, name: &Path) -> std::io::Result<()> {
    match std::os::unix::fs::symlink(target, name) {
        Err(error) if error.kind() != std::io::ErrorKind::AlreadyExists => Err(error),
        _ => Ok(()),
    }
}

#[cfg(windows)]
pub(crate) fn link(target: &Path, name: &Path) -> std::io::Result<()> {
    match std::os::windows::fs::symlink_dir(target, name) {
        Err(error) if error.kind() != std::io::ErrorKind::AlreadyExists => Err(error),
        _ => Ok(()),
    }
}

/// Folder of the data set of a campaign, among its results.
pub(crate) const DATASET: &str = "dataset";
/// Folder of the records of campaigns.
const NOTES: &str = ".campaign";

/// A result that requests cannot fetch under its name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the output `{}` cannot be fetched under this name; give it another one", .0.escape_debug())]
pub(crate) struct UnservableName(pub String);

/// The files of results, sorted, or the name of one that cannot be served.
///
/// # Errors
/// Errors of files, and very many files.
pub(crate) fn results(folder: &Path) -> Result<std::result::Result<Vec<ResultFile>, UnservableName>> {
    let mut found = Vec::new();
    for entry in Beneath::of(folder)?.entries(MAX_RESULTS)? {
        let is_note = entry.path.components().any(|part| part.as_os_str() == NOTES);
        if entry.kind == EntryKind::Folder || is_note {
            continue;
        }
        let name = entry.path.to_string_lossy();
        let path = if cfg!(windows) { name.replace('\\', "/") } else { name.into_owned() };
        // What requests could not fetch under its name is no result: their backslashes separate parts.
        let is_exact = entry.path.to_str().is_some() && !path.contains('\\');
        if entry.kind == EntryKind::Other || !is_exact || relative_path(&path).is_none() {
            return Ok(Err(UnservableName(path)));
        }
        found.push(ResultFile { path, bytes: entry.bytes });
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(Ok(found))
}

/// Results that are complete: their files, as an earlier worker has recorded them, which was ended before the
/// database had them.
///
/// # Errors
/// Errors of files.
pub(crate) fn complete_results(folder: &Path) -> Result<Option<Vec<ResultFile>>> {
    match fs::read(folder.join(COMPLETE)) {
        Ok(text) => Ok(serde_json::from_slice(&text).ok()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Records that results are complete.
///
/// # Errors
/// Errors of files.
pub(crate) fn record_complete(store: &Store, folder: &Path, files: &[ResultFile]) -> Result<()> {
    let text = serde_json::to_vec(files).map_err(std::io::Error::other)?;
    store.write_whole(&folder.join(COMPLETE), &text)
}

const COMPLETE: &str = "complete";

impl Store {
    /// Writes a file that is there as a whole or not at all. What an interruption leaves is among the
    /// incomplete files, which the next start removes.
    ///
    /// # Errors
    /// Errors of files.
    pub(crate) fn write_whole(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        write_whole(&self.incoming(), path, bytes)
    }
}

/// Writes a file that is there as a whole or not at all, first into the folder `scratch` of the same file
/// system.
///
/// # Errors
/// Errors of files.
pub(crate) fn write_whole(scratch: &Path, path: &Path, bytes: &[u8]) -> Result<()> {
    use std::io::Write as _;
    let mut part = tempfile::NamedTempFile::new_in(scratch)?;
    part.write_all(bytes)?;
    part.as_file().sync_all()?;
    part.persist(path).map_err(|e| e.error)?;
    Ok(())
}

/// Largest record of a cell that is read, bytes.
const MAX_RECORD: u64 = 16 << 20;

/// Pulses of all cells of a data set that are complete, of a campaign that has ended in any way. `out` is the
/// folder of its results.
///
/// # Errors
/// Errors of files, and very many cells.
pub(crate) fn campaign_pulses(out: &Path) -> std::io::Result<u64> {
    let notes = match Beneath::of(out).and_then(|out| out.folder(Path::new(DATASET).join(NOTES))) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(0),
        notes => notes?,
    };
    let made = |entry: &&Entry| {
        let is_inner = entry.path.parent() == Some(Path::new(""));
        is_inner && entry.path.extension().is_some_and(|ending| ending == "made")
    };
    // Its first line is the record of the cell.
    let pulses = |entry: &Entry| {
        let bytes = notes.read(&entry.path, MAX_RECORD).ok()?;
        let line = bytes.split(|byte| *byte == b'\n').next()?;
        serde_json::from_slice::<serde_json::Value>(line).ok()?["pulses"].as_u64()
    };
    let entries = notes.entries(MAX_RESULTS)?;
    Ok(entries.iter().filter(made).filter_map(pulses).fold(0, u64::saturating_add))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_count_however_many_files_they_have() {
        let folder = tempfile::tempdir().unwrap();
        let (notes, other) = (folder.path().join("dataset/.campaign"), folder.path().join("dataset/cells"));
        fs::create_dir_all(&notes).unwrap();
        fs::create_dir_all(&other).unwrap();
        fs::write(notes.join("a.made"), "{\"pulses\": 40}\n").unwrap();
        (0..=MAX_RESULTS).for_each(|number| fs::write(other.join(number.to_string()), "").unwrap());
        assert_eq!(campaign_pulses(folder.path()).unwrap(), 40);
        fs::remove_dir_all(&notes).unwrap();
        fs::write(&notes, "not a folder").unwrap();
        assert!(campaign_pulses(folder.path()).is_err());
    }

    #[test]
    fn cells_that_are_complete_count_and_notes_are_no_results() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        assert_eq!(campaign_pulses(out).unwrap(), 0);
        let write = |name: &str, text: &str| {
            fs::create_dir_all(out.join(name).parent().unwrap()).unwrap();
            fs::write(out.join(name), text).unwrap();
        };
        write("dataset/.campaign/a.made", "{\"cell\": \"a\", \"pulses\": 40}\n{}\n");
        write("dataset/.campaign/b.made", "{\"cell\": \"b\", \"pulses\": 2}\n");
        write("dataset/.campaign/c.made", "damaged");
        write("dataset/.campaign/d.lock", "{\"pulses\": 5}");
        write("dataset/cells/a/record.json", "{\"pulses\": 40}");
        write("points.laz", "");
        assert_eq!(campaign_pulses(out).unwrap(), 42);
        let names =
            || results(out).unwrap().map(|files| files.into_iter().map(|file| file.path).collect::<Vec<_>>());
        assert_eq!(names(), Ok(vec!["dataset/cells/a/record.json".to_owned(), "points.laz".to_owned()]));
        for name in [".hidden.xyz", "-o.laz", "dataset/a:b", "a\\b.laz"] {
            write(name, "");
            assert_eq!(names(), Err(UnservableName(name.to_owned())));
            fs::remove_file(out.join(name)).unwrap();
        }
    }
}
