//! How to take back the names of files that a process has renamed only in part.

use super::reads::read_own;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Action that undoes the renaming of one file.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Step {
    pub temporary: Vec<u8>,
    pub target: Vec<u8>,
    /// Another name of the file that is replaced.
    pub backup: Option<Vec<u8>>,
    /// If set, a file is replaced.
    pub replaces: bool,
    pub mark: Option<FileMark>,
}

/// Number of a file on its file system, its size and the time of its last change, ns since 1970: all stay
/// when it is renamed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct FileMark(u64, u64, i128);

impl FileMark {
    pub fn of(path: &Path) -> Option<FileMark> {
        let about = fs::symlink_metadata(path).ok()?;
        let since = about.modified().ok()?.duration_since(std::time::UNIX_EPOCH).ok()?;
        #[cfg(unix)]
        let number = std::os::unix::fs::MetadataExt::ino(&about);
        #[cfg(not(unix))]
        let number = 0;
        Some(FileMark(number, about.len(), since.as_nanos() as i128))
    }
}

#[cfg(unix)]
pub(super) fn bytes_of(path: &Path) -> Vec<u8> {
    std::os::unix::ffi::OsStrExt::as_bytes(path.as_os_str()).to_vec()
}

#[cfg(unix)]
pub(super) fn path_of(bytes: &[u8]) -> PathBuf {
    PathBuf::from(<std::ffi::OsStr as std::os::unix::ffi::OsStrExt>::from_bytes(bytes))
}

#[cfg(not(unix))]
pub(super) fn bytes_of(path: &Path) -> Vec<u8> {
    path.to_string_lossy().into_owned().into_bytes()
}

#[cfg(not(unix))]
pub(super) fn path_of(bytes: &[u8]) -> PathBuf {
    PathBuf::from(String::from_utf8_lossy(bytes).into_owned())
}

/// Takes the new names back. Files that others have put there meanwhile stay.
pub(super) fn roll_back(steps: &[Step]) {
    for step in steps.iter().rev() {
        let (temporary, target) = (path_of(&step.temporary), path_of(&step.target));
        let is_new = step.mark.is_some() && FileMark::of(&target) == step.mark;
        let backup = step.backup.as_deref().map(path_of).filter(|path| path.exists());
        match &backup {
            Some(backup) if is_new => _ = fs::rename(backup, &target),
            Some(backup) => _ = fs::remove_file(backup),
            None if is_new && !step.replaces => _ = remove_any(&target),
            None => {}
        }
        let _ = remove_any(&temporary);
    }
}

/// Undoes the operations in a log, and removes the log.
pub(super) fn roll_back_log(log: &Path) {
    let Ok(bytes) = read_own(log) else { return };
    // A log that is not complete was being written before the first file got its name.
    if let Ok(steps) = postcard::from_bytes::<Vec<Step>>(&bytes) {
        roll_back(&steps);
    }
    let _ = fs::remove_file(log);
}

/// Removes a file, or a folder with its contents.
pub(super) fn remove_any(path: &Path) -> io::Result<()> {
    match path.symlink_metadata()?.is_dir() {
        true => fs::remove_dir_all(path),
        false => fs::remove_file(path),
    }
}
