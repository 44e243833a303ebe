//! Files that are one output: all of them get their names, or none does. There are two exceptions: a name
//! that another program has taken meanwhile, whose file is `NAME.new.EXT`, and replaced files where the file
//! system has no hard links, which cannot be restored.
//!
//! Their content is on the disk before the first one is renamed. If a process is killed while it renames
//! several, a log next to them lets the next process that writes into the folder undo the changes: new files
//! are removed, replaced ones restored.

use super::fault;
use super::paths::folder_of;
use super::reads::{is_input, is_read};
use super::temporary::{NewFolder, TemporaryFile, TemporaryName, free_temporary_path, live};
use super::temporary::{synchronise, synchronise_folder};
use super::undo::{FileMark, Step, bytes_of, path_of, roll_back};
use super::writer::{FileWriter, Patched};
use crate::error::{Error, Result};
use std::collections::BTreeSet;
use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Files and folders that get their names together, in the order in which they are added. Dropping it removes
/// them.
#[derive(Debug, Default)]
pub struct FileGroup {
    writers: Vec<(FileWriter, Option<PathBuf>)>,
    staged: Vec<Member>,
    /// Files of an earlier output of the same kind.
    old: Vec<PathBuf>,
    /// Inner ones first. Dropped after the files, since only empty folders are removed.
    folders: Vec<NewFolder>,
}

/// A complete file, or a folder of complete files, under its temporary name.
#[derive(Debug)]
pub(super) struct Member {
    pub temporary: TemporaryFile,
    /// The name that it gets.
    pub target: PathBuf,
    /// If set, an existing file is replaced.
    pub replace: bool,
    /// If set, the file belongs to the state of the program, and may be one that was read.
    pub is_own: bool,
    /// If set, an existing file with the same bytes stays.
    pub keeps_equal: bool,
}

impl FileGroup {
    /// A group of files whose content is on the disk.
    pub(super) fn of(staged: impl IntoIterator<Item = Member>) -> FileGroup {
        FileGroup { staged: staged.into_iter().collect(), ..FileGroup::default() }
    }

    /// Adds a file whose content is complete. A stream receives the rest of its bytes before any file gets
    /// its name.
    pub fn add(&mut self, file: FileWriter) {
        self.add_under(file, None);
    }

    /// [`FileGroup::add`] under another name than that of [`FileWriter::target`].
    pub fn add_as(&mut self, file: FileWriter, path: &Path) {
        self.add_under(file, Some(path.to_path_buf()));
    }

    fn add_under(&mut self, mut file: FileWriter, path: Option<PathBuf>) {
        file.close_handle();
        self.writers.push((file, path));
    }

    /// Writes a file, or stdout if that is what `path` names; `replace` as for [`FileWriter::create`].
    ///
    /// # Errors
    /// As for [`FileWriter::create`] and [`FileWriter::append`].
    pub fn write(&mut self, path: &Path, replace: bool, bytes: &[u8]) -> Result<()> {
        let mut file = FileWriter::create(path, replace, Patched::Never)?;
        file.append(bytes)?;
        self.add(file);
        Ok(())
    }

    /// Removes a file of an earlier output, which is not one of the new ones, when these have their names. To
    /// be called with the permission to replace files only.
    pub fn remove(&mut self, path: &Path) {
        self.old.push(path.to_path_buf());
    }

    /// Creates a folder for files of the group, with the folders around it. Those that are new are removed if
    /// the group is dropped and they are empty.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create_folder(&mut self, path: &Path) -> Result<()> {
        let made = NewFolder::create_all(path).map_err(|e| Error::io("create", path, e))?;
        self.folders.insert(0, made);
        Ok(())
    }

    /// Adds a new folder with its contents at the time of the commit, and returns the path under which to
    /// fill it until then. An empty folder of the name is replaced.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn stage_folder(&mut self, path: &Path) -> Result<PathBuf> {
        let temporary = TemporaryFile::create_folder(path).map_err(|e| Error::io("create", path, e))?;
        let staged = temporary.path().to_path_buf();
        self.staged.push(Member {
            temporary,
            target: path.to_path_buf(),
            replace: false,
            is_own: false,
            keeps_equal: false,
        });
        Ok(staged)
    }

    /// Gives all files and folders their names.
    ///
    /// # Errors
    /// [`Error::Io`], after which no file has its name, unless only a folder could not be synchronised.
    /// [`Error::Io`] or [`Error::Input`] if a file of a name has appeared meanwhile, or has been read: it is
    /// kept, and the complete output is `NAME.new.EXT`.
    pub fn commit(self) -> Result<()> {
        let FileGroup { writers, staged, old, folders } = self;
        let mut members = staged;
        for (writer, path) in writers {
            members.extend(writer.complete(path.as_deref())?);
        }
        let failed = |path: &Path, e| Error::io("give its name to", path, e);
        let undo = match members.len() {
            0 | 1 => None,
            _ => Some(Undo::begin(&members).map_err(|e| failed(&members[0].target, e))?),
        };
        let mut taken = None;
        for member in &mut members {
            let outcome = member.publish()?;
            taken = taken.or(outcome);
        }
        if let Some(undo) = undo {
            undo.end();
        }
        for path in old.iter().filter(|path| path.is_file() && !is_input(path)) {
            fs::remove_file(path).map_err(|e| Error::io("remove", path, e))?;
        }
        folders.into_iter().for_each(NewFolder::keep);
        let folders: BTreeSet<&Path> = members.iter().map(|member| folder_of(&member.target)).collect();
        for folder in folders {
            let target = members.iter().map(|m| &m.target).find(|target| folder_of(target) == folder);
            let target = target.map_or(folder, |target| target);
            synchronise_folder(target).map_err(|e| Error::io("synchronise the folder of", target, e))?;
        }
        taken.map_or(Ok(()), Err)
    }
}

impl Member {
    /// Renames the file. Returns the error for a name that cannot be taken; the file is then next to it.
    fn publish(&mut self) -> Result<Option<Error>> {
        let path = self.target.clone();
        let failed = |e| Error::io("give its name to", &path, e);
        if !self.is_own && is_input(&path) {
            // It was read after this file was created.
            let sibling = self.temporary.rename_to_sibling(&path).map_err(failed)?;
            let message = format!("{}; the complete output is {}", is_read(&path), sibling.display());
            return Ok(Some(Error::input(message)));
        }
        match self.temporary.rename(&path, self.replace) {
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {
                if self.keeps_equal && self.temporary.is_equal(&path).unwrap_or(false) {
                    return Ok(None);
                }
                let sibling = self.temporary.rename_to_sibling(&path).map_err(failed)?;
                let message = format!(
                    "a file of this name has appeared meanwhile and is kept; the complete output is {}",
                    sibling.display()
                );
                Ok(Some(failed(io::Error::new(io::ErrorKind::AlreadyExists, message))))
            }
            renamed => renamed.map(|()| None).map_err(failed),
        }
    }
}

/// Undoes the renaming of several files, unless it is ended.
#[derive(Debug)]
struct Undo {
    steps: Vec<Step>,
    /// A copy of the steps in each folder of the files.
    logs: Vec<PathBuf>,
    is_ended: bool,
}

impl Undo {
    /// Writes the logs, before the first file is renamed.
    fn begin(members: &[Member]) -> io::Result<Undo> {
        let mut undo = Undo { steps: Vec::with_capacity(members.len()), logs: Vec::new(), is_ended: false };
        for Member { temporary, target, replace, .. } in members {
            let replaces = *replace && fs::symlink_metadata(target).is_ok();
            let backup = if replaces { backup(target) } else { None };
            let absolute = |path: &Path| std::path::absolute(path).map(|path| bytes_of(&path));
            undo.steps.push(Step {
                temporary: absolute(temporary.path())?,
                target: absolute(target)?,
                backup: backup.as_deref().map(absolute).transpose()?,
                replaces,
                mark: FileMark::of(temporary.path()),
            });
        }
        let bytes = postcard::to_stdvec(&undo.steps).map_err(io::Error::other)?;
        let mut folders = BTreeSet::new();
        for Member { target, .. } in members {
            if folders.insert(folder_of(target)) {
                let path = free_temporary_path(target, TemporaryName::Undo)?;
                undo.logs.push(path.clone());
                live().undo_logs.insert(path.clone());
                fault::point()?;
                let mut file = OpenOptions::new().write(true).create_new(true).open(path)?;
                file.write_all(&bytes)?;
                synchronise(&file)?;
            }
        }
        Ok(undo)
    }

    /// Keeps the new names.
    fn end(mut self) {
        self.is_ended = true;
    }
}

impl Drop for Undo {
    fn drop(&mut self) {
        let mut live = live();
        if !self.is_ended {
            roll_back(&self.steps);
        }
        for log in &self.logs {
            let _ = fs::remove_file(log);
            live.undo_logs.remove(log);
        }
        for backup in self.steps.iter().filter_map(|step| step.backup.as_deref()).map(path_of) {
            let _ = fs::remove_file(&backup);
            live.files.remove(&backup);
        }
    }
}

/// Another name for a file that is about to be replaced; `None` on file systems without hard links.
fn backup(target: &Path) -> Option<PathBuf> {
    let path = free_temporary_path(target, TemporaryName::Part).ok()?;
    fs::hard_link(target, &path).ok()?;
    // Under the path by which it is removed.
    live().files.insert(std::path::absolute(&path).unwrap_or_else(|_| path.clone()));
    Some(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::is_taken;
    use crate::files::testkit::names;

    /// Two new files, one that replaces another, and a folder.
    fn group(folder: &Path) -> FileGroup {
        let mut group = FileGroup::default();
        group.create_folder(&folder.join("inner")).unwrap();
        group.write(&folder.join("a"), false, b"new").unwrap();
        group.write(&folder.join("inner/b"), false, b"new").unwrap();
        group.write(&folder.join("c"), true, b"new").unwrap();
        let staged = group.stage_folder(&folder.join("d")).unwrap();
        fs::write(staged.join("e"), "new").unwrap();
        group
    }

    #[test]
    fn files_of_a_group_get_their_names_together_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("c"), "old").unwrap();
        drop(group(folder.path()));
        assert_eq!(names(folder.path()), ["c"]);
        group(folder.path()).commit().unwrap();
        assert_eq!(names(folder.path()), ["a", "c", "d", "inner"]);
        for name in ["a", "inner/b", "c", "d/e"] {
            assert_eq!(fs::read_to_string(at(name)).unwrap(), "new");
        }
    }

    #[test]
    fn a_group_that_cannot_be_completed_leaves_everything_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("c"), "old").unwrap();
        let mut broken = group(folder.path());
        broken.write(&folder.path().join("z"), true, b"new").unwrap();
        // A folder in the place of the last file.
        fs::create_dir_all(folder.path().join("z/full")).unwrap();
        assert!(broken.commit().is_err());
        assert_eq!(names(folder.path()), ["c", "z"]);
        assert_eq!(fs::read_to_string(folder.path().join("c")).unwrap(), "old");
    }

    #[test]
    fn files_that_appear_meanwhile_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let group = group(folder.path());
        fs::write(folder.path().join("a"), "mine").unwrap();
        let message = group.commit().unwrap_err().to_string();
        assert!(message.contains("the complete output is") && message.contains("a.new"), "{message}");
        assert_eq!(fs::read_to_string(folder.path().join("a")).unwrap(), "mine");
        assert_eq!(names(folder.path()), ["a", "a.new", "c", "d", "inner"]);
    }

    #[test]
    fn what_a_killed_process_has_renamed_is_undone() {
        for renamed in 0..=4 {
            let folder = tempfile::tempdir().unwrap();
            fs::write(folder.path().join("c"), "old").unwrap();
            let FileGroup { writers, staged, folders, .. } = group(folder.path());
            let mut members = staged;
            members.extend(writers.into_iter().filter_map(|(file, _)| file.complete(None).unwrap()));
            let undo = Undo::begin(&members).unwrap();
            for member in &mut members[..renamed] {
                assert!(member.publish().unwrap().is_none());
            }
            std::mem::forget(undo);
            drop(members);
            drop(folders);
            let is_new = FileMark::of(&folder.path().join("d")).is_some();
            assert_eq!(is_new, renamed > 0, "{renamed}");
            live().cleaned.clear();
            assert!(is_taken(&folder.path().join("c")));
            // Each folder has a log.
            assert!(!is_taken(&folder.path().join("inner/b")));
            assert_eq!(fs::read_to_string(folder.path().join("c")).unwrap(), "old", "{renamed}");
            let mut left = names(folder.path());
            left.retain(|name| name != "inner");
            assert_eq!(left, ["c"], "{renamed}");
            group(folder.path()).commit().unwrap();
            assert_eq!(names(&folder.path().join("inner")), ["b"]);
        }
    }

    #[test]
    fn files_that_a_user_has_put_in_their_place_are_not_undone() {
        let folder = tempfile::tempdir().unwrap();
        let FileGroup { writers, staged, .. } = group(folder.path());
        let mut members = staged;
        members.extend(writers.into_iter().filter_map(|(file, _)| file.complete(None).unwrap()));
        let undo = Undo::begin(&members).unwrap();
        members.iter_mut().for_each(|member| _ = member.publish().unwrap());
        std::mem::forget(undo);
        drop(members);
        fs::remove_file(folder.path().join("a")).unwrap();
        fs::write(folder.path().join("a"), "mine").unwrap();
        live().cleaned.clear();
        assert!(is_taken(&folder.path().join("a")));
        assert_eq!(fs::read_to_string(folder.path().join("a")).unwrap(), "mine");
    }
}
