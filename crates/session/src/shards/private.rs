//! Folders of a single process within a folder that the processes of many machines share.

use std::ffi::OsStr;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io;
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{NewFolder, publish};

/// Text before the number in the name of a private folder.
const PREFIX: &str = "unfinished-";

/// A folder for the unfinished files of this process. Processes on other machines leave it alone: unlike
/// locks, names are shared on every file system. The folder is removed when it is dropped, and when a signal
/// ends the process.
pub struct PrivateFolder {
    path: PathBuf,
    shared: PathBuf,
    /// Declared after the paths: removes the folder when it is empty.
    _folder: NewFolder,
}

impl PrivateFolder {
    /// Creates a folder within `shared`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn new(shared: &Path) -> Result<PrivateFolder> {
        loop {
            let number = RandomState::new().build_hasher().finish();
            let path = shared.join(format!("{PREFIX}{number:016x}"));
            match NewFolder::create(&path) {
                Ok(folder) => {
                    return Ok(PrivateFolder { path, shared: shared.to_path_buf(), _folder: folder });
                }
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(Error::io("create a folder in", shared, e)),
            }
        }
    }

    /// True if a folder of this name is a private one, of this or of another process.
    pub fn is_name(name: &OsStr) -> bool {
        let number = name.to_str().and_then(|name| name.strip_prefix(PREFIX));
        number.is_some_and(|n| n.len() == 16 && n.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f')))
    }

    /// The path of a file of this process.
    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.path.join(name)
    }

    /// Moves a complete file to the shared folder, where it replaces the file of its name, and returns its
    /// path.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn publish(self, name: impl AsRef<Path>) -> Result<PathBuf> {
        self.publish_as(&name, &name)
    }

    /// As [`PrivateFolder::publish`], under another name.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn publish_as(self, name: impl AsRef<Path>, shared_name: impl AsRef<Path>) -> Result<PathBuf> {
        let path = self.shared.join(&shared_name);
        publish(&self.path(&name), &path)?;
        Ok(path)
    }
}

impl Drop for PrivateFolder {
    fn drop(&mut self) {
        // A file that was complete, but could not be moved.
        for entry in std::fs::read_dir(&self.path).into_iter().flatten().flatten() {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn files_move_when_they_are_complete_and_vanish_otherwise() {
        let shared = tempfile::tempdir().unwrap();
        let names =
            || fs::read_dir(shared.path()).unwrap().map(|e| e.unwrap().file_name()).collect::<Vec<_>>();
        let folder = PrivateFolder::new(shared.path()).unwrap();
        fs::write(folder.path("a"), "begun").unwrap();
        drop(folder);
        assert!(names().is_empty());
        for text in ["one", "two"] {
            let folder = PrivateFolder::new(shared.path()).unwrap();
            fs::write(folder.path("a"), text).unwrap();
            let path = folder.publish("a").unwrap();
            assert_eq!(fs::read_to_string(path).unwrap(), text);
            assert_eq!(names(), ["a"]);
        }
    }
}
