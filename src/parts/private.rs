//! Folders of a single process within a folder that the processes of many machines share.

use crate::error::{Error, Result};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder for the unfinished files of this process. Processes on other machines leave it alone: unlike locks, names are
/// shared on every file system. Dropping it removes it.
pub struct PrivateFolder {
    folder: TempDir,
    shared: PathBuf,
}

impl PrivateFolder {
    /// Creates a folder within `shared`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn new(shared: &Path) -> Result<PrivateFolder> {
        let folder = tempfile::Builder::new().prefix("unfinished-").tempdir_in(shared);
        let folder = folder.map_err(|e| Error::io("create a folder in", shared, e))?;
        Ok(PrivateFolder { folder, shared: shared.to_path_buf() })
    }

    /// The path of a file of this process.
    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Moves a complete file to the shared folder, where it replaces the file of its name, and returns its path.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn publish(self, name: impl AsRef<Path>) -> Result<PathBuf> {
        let path = self.shared.join(&name);
        fs::rename(self.path(&name), &path).map_err(|e| Error::io("give its name to", &path, e))?;
        if let Ok(folder) = File::open(&self.shared) {
            // Some file systems refuse it; the file itself is on the disk.
            let _ = folder.sync_all();
        }
        Ok(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
