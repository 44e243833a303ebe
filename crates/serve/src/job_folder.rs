//! The folder of a job: what it reads, and the files of its results.

use crate::beneath::{Beneath, EntryKind};
use crate::request::{Prepared, name_of};
use crate::store::{Result, ResultFile, Store};
use std::fs;
use std::path::Path;

/// Most files and folders of results.
const MAX_RESULTS: usize = 100_000;

/// Makes the folder of a job, or completes the one that an earlier worker has begun to make.
///
/// # Errors
/// Those of files.
pub(crate) fn make(store: &Store, folder: &Path, prepared: &Prepared) -> Result<()> {
    let inputs = folder.join("in");
    for name in ["in", "in/jobs", "out", "view", "tmp"] {
        fs::create_dir_all(folder.join(name))?;
    }
    // Tasks of an engine may be reading it.
    if let Some((name, text)) = &prepared.document {
        write_whole(&inputs.join(name), text.as_bytes())?;
    }
    for used in &prepared.uses {
        let (kind, id) = used.files();
        link(&store.local(kind, id), &inputs.join(name_of(used)))?;
    }
    let text = serde_json::to_string(prepared).map_err(std::io::Error::other)?;
    write_whole(&folder.join("prepared.json"), text.as_bytes())
}

#[cfg(unix)]
fn link(target: &Path, name: &Path) -> std::io::Result<()> {
    match std::os::unix::fs::symlink(target, name) {
        Err(error) if error.kind() != std::io::ErrorKind::AlreadyExists => Err(error),
        _ => Ok(()),
    }
}

#[cfg(windows)]
fn link(target: &Path, name: &Path) -> std::io::Result<()> {
    match std::os::windows::fs::symlink_dir(target, name) {
        Err(error) if error.kind() != std::io::ErrorKind::AlreadyExists => Err(error),
        _ => Ok(()),
    }
}

/// The files of results, sorted.
///
/// # Errors
/// Those of files, and for very many files.
pub(crate) fn results(folder: &Path) -> Result<Vec<ResultFile>> {
    let mut found = Vec::new();
    for entry in Beneath::of(folder)?.entries(MAX_RESULTS)? {
        let path = entry.path.to_string_lossy().replace('\\', "/");
        if entry.kind == EntryKind::File && !path.starts_with('.') {
            found.push(ResultFile { path, bytes: entry.bytes });
        }
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(found)
}

/// Results that are complete: their files, as an earlier worker has recorded them, which was ended before the database had them.
///
/// # Errors
/// Those of files.
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
/// Those of files.
pub(crate) fn record_complete(folder: &Path, files: &[ResultFile]) -> Result<()> {
    let text = serde_json::to_vec(files).map_err(std::io::Error::other)?;
    write_whole(&folder.join(COMPLETE), &text)
}

const COMPLETE: &str = "complete";

/// Writes a file that is there as a whole or not at all.
///
/// # Errors
/// Those of files.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    use std::io::Write as _;
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut part = tempfile::NamedTempFile::new_in(folder)?;
    part.write_all(bytes)?;
    part.as_file().sync_all()?;
    part.persist(path).map_err(|e| e.error)?;
    Ok(())
}

/// Pulses of all cells of a data set.
pub(crate) fn campaign_pulses(manifest: &[u8]) -> u64 {
    let of = |line: &str| serde_json::from_str::<serde_json::Value>(line).ok()?["pulses"].as_u64();
    String::from_utf8_lossy(manifest).lines().filter_map(of).sum()
}
