//! Files that are written under a temporary name and renamed when they are complete.

use crate::error::{Error, Result};
use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

/// The temporary file `NAME.part` beside its target. Dropping this value removes the file.
#[derive(Debug)]
pub struct TemporaryFile {
    path: PathBuf,
    target: PathBuf,
    overwrite: bool,
    keep: bool,
}

impl TemporaryFile {
    /// Creates `NAME.part` for `target` and opens it for reading and writing. A symbolic link is followed: the link
    /// stays and its target is replaced. With `overwrite` both the temporary file of an earlier run and an existing
    /// target are replaced; without it either one is an error.
    pub fn create(target: &Path, overwrite: bool) -> Result<(TemporaryFile, File)> {
        let target = match fs::canonicalize(target) {
            Ok(real) if target.is_symlink() => real,
            _ => target.to_path_buf(),
        };
        let path = TemporaryFile::name_for(&target);
        if overwrite {
            match fs::remove_file(&path) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(Error::io("replace", &path, e)),
                _ => {}
            }
        }
        let file = OpenOptions::new().read(true).write(true).create_new(true).open(&path);
        let file = file.map_err(|e| Error::io("create", &path, e))?;
        Ok((TemporaryFile { path, target, overwrite, keep: false }, file))
    }

    /// The temporary name for a target.
    pub fn name_for(target: &Path) -> PathBuf {
        let mut name = target.as_os_str().to_os_string();
        name.push(".part");
        PathBuf::from(name)
    }

    pub fn target(&self) -> &Path {
        &self.target
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Renames the complete file to its target and returns that path.
    pub fn commit(mut self) -> Result<PathBuf> {
        let target = std::mem::take(&mut self.target);
        self.commit_as(&target).map(|()| target)
    }

    /// Renames the complete file to `name`. If a file of that name has appeared meanwhile and must not be replaced,
    /// the complete file keeps its temporary name.
    pub fn commit_as(mut self, name: &Path) -> Result<()> {
        let renamed =
            if self.overwrite { fs::rename(&self.path, name) } else { rename_new(&self.path, name) };
        self.keep = match &renamed {
            Ok(()) => true,
            Err(e) => e.kind() == io::ErrorKind::AlreadyExists,
        };
        renamed.map_err(|e| Error::io("give its name to", &self.path, e))
    }
}

impl Drop for TemporaryFile {
    fn drop(&mut self) {
        if !self.keep {
            // The run has failed already; its error is the one to report.
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Renames a file without ever replacing another one.
fn rename_new(from: &Path, to: &Path) -> io::Result<()> {
    match fs::hard_link(from, to) {
        Ok(()) => fs::remove_file(from),
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => Err(e),
        // Some file systems have no hard links.
        Err(_) if to.exists() => Err(io::ErrorKind::AlreadyExists.into()),
        Err(_) => fs::rename(from, to),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn files_appear_when_they_are_complete_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a");
        drop(TemporaryFile::create(&target, false).unwrap());
        assert!(names(folder.path()).is_empty());
        let (temporary, mut file) = TemporaryFile::create(&target, false).unwrap();
        file.write_all(b"new").unwrap();
        assert_eq!(names(folder.path()), ["a.part"]);
        assert!(TemporaryFile::create(&target, false).is_err(), "another run is writing it");
        assert_eq!(temporary.commit().unwrap(), target);
        assert_eq!(
            (names(folder.path()), fs::read(&target).unwrap()),
            (vec!["a".to_owned()], b"new".to_vec())
        );
    }

    #[test]
    fn an_existing_file_is_replaced_only_on_demand() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a");
        for (overwrite, expected) in [(false, &["a", "a.part"][..]), (true, &["a"][..])] {
            let (temporary, _) = TemporaryFile::create(&target, overwrite).unwrap();
            fs::write(&target, b"appeared meanwhile").unwrap();
            assert_eq!(temporary.commit().is_ok(), overwrite);
            assert_eq!(names(folder.path()), expected);
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link() {
        let folder = tempfile::tempdir().unwrap();
        let [link, target] = ["link", "target"].map(|name| folder.path().join(name));
        fs::write(&target, "old").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        let (temporary, mut file) = TemporaryFile::create(&link, true).unwrap();
        file.write_all(b"new").unwrap();
        temporary.commit().unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read_to_string(target).unwrap(), "new");
    }
}
