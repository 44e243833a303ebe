//! Temporary files and new folders, and their removal.

use super::fault;
use super::paths::{folder_of, is_special, with_suffix};
use super::reads::open_own;
use super::undo::{remove_any, roll_back_log};
use crate::diag::ProblemKind;
use crate::error::{Error, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

/// Text before the number in the name of a temporary file.
const MARK: &str = ".vlscan-";
const DIGITS: usize = 8;
const END_BYTES: usize = 5;
/// Maximum length of the target's name in that of its temporary file, bytes; file systems take 255
/// altogether.
const MAX_NAME_BYTES: usize = 255 - MARK.len() - DIGITS - END_BYTES;
/// How often, and at which interval, something that another process or thread holds for an instant is tried
/// again.
const ATTEMPTS: u32 = 100;
const ATTEMPT_PERIOD: Duration = Duration::from_millis(10);

/// Purpose of a temporary file, by the end of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TemporaryName {
    /// A file or folder that is not complete, or another name of a file that is being replaced.
    Part,
    /// How to undo the renaming of several files, see [`super::group`].
    Undo,
}

impl TemporaryName {
    const fn end(self) -> &'static str {
        match self {
            TemporaryName::Part => ".part",
            TemporaryName::Undo => ".undo",
        }
    }

    /// Purpose of the temporary file with this name; `None` for other names.
    fn of(name: &OsStr) -> Option<TemporaryName> {
        let name = name.as_encoded_bytes();
        [TemporaryName::Part, TemporaryName::Undo].into_iter().find(|kind| {
            let name = name.strip_suffix(kind.end().as_bytes());
            name.and_then(|name| name.split_last_chunk::<DIGITS>()).is_some_and(|(name, digits)| {
                digits.iter().all(|d| matches!(d, b'0'..=b'9' | b'a'..=b'f'))
                    && name.ends_with(MARK.as_bytes())
            })
        })
    }
}

/// The temporary files and unfinished folders of this process.
pub(super) struct Live {
    /// Files, and folders that are removed with their contents.
    pub files: BTreeSet<PathBuf>,
    /// Logs of files that are being renamed.
    pub undo_logs: BTreeSet<PathBuf>,
    /// New folders, which are removed if they are empty.
    folders: Vec<PathBuf>,
    locks: BTreeMap<PathBuf, Weak<FolderLock>>,
    /// Folders from which the files of killed processes have been removed.
    pub cleaned: BTreeSet<PathBuf>,
}

/// A shared lock on a folder, if its file system has locks: while it is held, no other process takes the
/// temporary files in the folder for those of a killed one.
type FolderLock = Option<File>;

static LIVE: Mutex<Live> = Mutex::new(Live {
    files: BTreeSet::new(),
    undo_logs: BTreeSet::new(),
    folders: Vec::new(),
    locks: BTreeMap::new(),
    cleaned: BTreeSet::new(),
});

pub(super) fn live() -> MutexGuard<'static, Live> {
    LIVE.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Live {
    /// Returns the lock on a folder. Before the first file of this process the files of killed ones are
    /// removed.
    fn lock(&mut self, folder: &Path) -> Arc<FolderLock> {
        if let Some(lock) = self.locks.get(folder).and_then(Weak::upgrade) {
            return lock;
        }
        let lock = Arc::new(lock_folder(folder, self.cleaned.insert(folder.to_path_buf())));
        self.locks.insert(folder.to_path_buf(), Arc::downgrade(&lock));
        lock
    }
}

fn lock_folder(folder: &Path, clean: bool) -> FolderLock {
    let file = File::open(folder).ok()?;
    if clean && file.try_lock().is_ok() {
        remove_parts(folder);
    }
    for _ in 0..ATTEMPTS {
        match file.try_lock_shared() {
            Ok(()) => return Some(file),
            Err(fs::TryLockError::WouldBlock) => std::thread::sleep(ATTEMPT_PERIOD),
            Err(fs::TryLockError::Error(_)) => return None,
        }
    }
    None
}

/// Removes the temporary files of killed processes from a folder, unless another process writes into it.
pub fn remove_litter(folder: &Path) {
    if File::open(folder).is_ok_and(|file| file.try_lock().is_ok() && remove_parts(folder) > 0) {
        // A folder that was made for these files; fails if it holds others.
        let _ = fs::remove_dir(folder);
    }
}

/// Refuses to overwrite a file, unless `force` is set; streams are never overwritten.
///
/// # Errors
/// [`Error::Input`] of the kind [`Exists`](crate::diag::ProblemKind::Exists).
pub fn refuse_existing(path: &Path, force: bool) -> Result<()> {
    if !force && is_taken(path) { Err(Error::exists(path)) } else { Ok(()) }
}

/// Refuses a file that cannot be written, before the work for it: one that exists, unless `force` is set, a
/// folder, and a file in a folder that does not exist. Streams can be written.
///
/// # Errors
/// [`Error::Input`], of the kind [`NotFound`](ProblemKind::NotFound) for a missing folder, else as for
/// [`refuse_existing`].
pub fn refuse_unwritable(path: &Path, force: bool) -> Result<()> {
    if is_special(path) {
        return Ok(());
    }
    let (folder, shown) = (folder_of(path), path.display());
    if path.is_dir() {
        return Err(Error::input(format!("{shown} is a directory, expected a file")));
    }
    if !folder.is_dir() {
        let kind = if folder.exists() { ProblemKind::Invalid } else { ProblemKind::NotFound };
        let message = format!("{} is not a directory, so {shown} cannot be written", folder.display());
        return Err(Error::input_of(kind, message));
    }
    // Names that are too long, and folders that may not be searched.
    if let Err(e) = path.symlink_metadata()
        && e.kind() != io::ErrorKind::NotFound
    {
        return Err(Error::input(format!("{shown} cannot be written: {e}")));
    }
    refuse_existing(path, force)
}

/// True if a file or folder of this name exists that an output must not replace without permission.
/// Unfinished renames of killed processes in the folder are undone first.
pub fn is_taken(path: &Path) -> bool {
    !is_special(path) && is_there_after_cleaning(path)
}

/// Removes the temporary files of killed processes from the folder of a file, once in a process and unless
/// another process writes into it, and undoes what they did to files that get their names together. Returns
/// whether the file is there afterwards.
fn is_there_after_cleaning(file: &Path) -> bool {
    if file.symlink_metadata().is_err() {
        return false;
    }
    let folder = folder_of(file);
    let is_first = live().cleaned.insert(folder.to_path_buf());
    // The lock is held while files are removed.
    if is_first
        && let Ok(lock) = File::open(folder)
        && lock.try_lock().is_ok()
    {
        remove_parts(folder);
    }
    file.exists()
}

/// Removes all temporary files in a folder and returns their number.
fn remove_parts(folder: &Path) -> usize {
    let list = |kind: TemporaryName| {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        let of_kind = entries.filter(move |entry| TemporaryName::of(&entry.file_name()) == Some(kind));
        of_kind.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_file() || kind.is_dir()))
    };
    let logs: Vec<PathBuf> = list(TemporaryName::Undo).map(|entry| entry.path()).collect();
    logs.iter().for_each(|log| roll_back_log(log));
    logs.len() + list(TemporaryName::Part).filter(|part| remove_any(&part.path()).is_ok()).count()
}

fn temporary_name(target: &OsStr, kind: TemporaryName) -> std::ffi::OsString {
    let mut name = match target.len() <= MAX_NAME_BYTES {
        true => target.to_os_string(),
        false => {
            let text = target.to_string_lossy();
            text[..text.floor_char_boundary(MAX_NAME_BYTES)].into()
        }
    };
    let number = RandomState::new().build_hasher().finish() as u32;
    name.push(format!("{MARK}{number:0width$x}{}", kind.end(), width = DIGITS));
    name
}

/// A path in the folder of `target` that does not exist.
pub(super) fn free_temporary_path(target: &Path, kind: TemporaryName) -> io::Result<PathBuf> {
    let name = target.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
    loop {
        let path = target.with_file_name(temporary_name(name, kind));
        if path.symlink_metadata().is_err() {
            return Ok(path);
        }
    }
}

/// True if a name belongs to a temporary file of this program; no user chooses such a name by chance.
pub fn is_temporary_name(name: &OsStr) -> bool {
    TemporaryName::of(name).is_some()
}

/// A file under a temporary name. Dropping this value removes the file unless it has been renamed.
#[derive(Debug)]
pub(super) struct TemporaryFile {
    path: PathBuf,
    is_renamed: bool,
    _lock: Arc<FolderLock>,
}

impl TemporaryFile {
    /// Creates a file in the folder of `target` that did not exist before, and opens it for reading and
    /// writing.
    pub fn create(target: &Path) -> io::Result<(TemporaryFile, File)> {
        TemporaryFile::create_by(target, |path| {
            OpenOptions::new().read(true).write(true).create_new(true).open(path)
        })
    }

    /// Creates a folder next to `target` that did not exist before. It is removed with its contents.
    pub fn create_folder(target: &Path) -> io::Result<TemporaryFile> {
        TemporaryFile::create_by(target, |path| fs::create_dir(path)).map(|(folder, ())| folder)
    }

    fn create_by<T>(target: &Path, make: impl Fn(&Path) -> io::Result<T>) -> io::Result<(TemporaryFile, T)> {
        let name = target.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
        let folder = folder_of(target);
        let mut live = live();
        let lock = live.lock(folder);
        loop {
            fault::point()?;
            let path = target.with_file_name(temporary_name(name, TemporaryName::Part));
            match make(&path) {
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(e),
                Ok(made) => {
                    live.files.insert(path.clone());
                    return Ok((TemporaryFile { path, is_renamed: false, _lock: lock }, made));
                }
            }
        }
    }

    /// Path until the folder is renamed.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Opens the file again for reading and writing.
    pub fn reopen(&self) -> io::Result<File> {
        fault::point()?;
        OpenOptions::new().read(true).write(true).open(&self.path)
    }

    /// True if another regular file holds the same bytes.
    pub fn is_equal(&self, other: &Path) -> io::Result<bool> {
        let (mut mine, mut theirs) = (BufReader::new(self.reopen()?), BufReader::new(open_own(other)?));
        loop {
            let (one, two) = (mine.fill_buf()?, theirs.fill_buf()?);
            let count = one.len().min(two.len());
            if count == 0 || one[..count] != two[..count] {
                return Ok(one.is_empty() && two.is_empty());
            }
            mine.consume(count);
            theirs.consume(count);
        }
    }

    /// Renames the file. Without `replace` an existing file is an error, after which the file can be renamed
    /// otherwise.
    pub fn rename(&mut self, to: &Path, replace: bool) -> io::Result<()> {
        fault::point()?;
        let mut live = live();
        if replace { fs::rename(&self.path, to) } else { rename_new(&self.path, to) }?;
        live.files.remove(&self.path);
        self.is_renamed = true;
        Ok(())
    }

    /// Renames a complete file to `NAME.new.EXT`, or `NAME.new-2.EXT` …, and returns that name.
    pub fn rename_to_sibling(&mut self, path: &Path) -> io::Result<PathBuf> {
        let exists = io::ErrorKind::AlreadyExists;
        for number in 1..100 {
            let suffix = if number == 1 { ".new".to_owned() } else { format!(".new-{number}") };
            let sibling = with_suffix(path, &suffix, None);
            match self.rename(&sibling, false) {
                Err(e) if e.kind() == exists => {}
                renamed => return renamed.map(|()| sibling),
            }
        }
        Err(exists.into())
    }
}

impl Drop for TemporaryFile {
    fn drop(&mut self) {
        if !self.is_renamed {
            // The run has failed already; its error is the one to report.
            let _ = remove_any(&self.path);
            live().files.remove(&self.path);
        }
    }
}

/// A folder under a temporary name. It is removed with its contents when this value is dropped, at the end of
/// the process that a signal causes, and after a kill by the next process that writes beside it.
#[derive(Debug)]
pub struct TemporaryFolder(TemporaryFile);

impl TemporaryFolder {
    /// Creates a folder beside the file or folder `target`, which need not exist.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn next_to(target: &Path) -> Result<TemporaryFolder> {
        let made = TemporaryFile::create_folder(target);
        made.map(TemporaryFolder).map_err(|e| Error::io("create a temporary folder beside", target, e))
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

/// Renames a file or folder without ever replacing another one; an empty folder may be replaced by a folder.
fn rename_new(from: &Path, to: &Path) -> io::Result<()> {
    match fs::hard_link(from, to) {
        Ok(()) => fs::remove_file(from),
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => Err(e),
        // Some file systems have no hard links, and folders have none. A folder replaces no file, and no
        // folder that holds any.
        Err(_) if to.symlink_metadata().is_ok_and(|about| !(about.is_dir() && from.is_dir())) => {
            Err(io::ErrorKind::AlreadyExists.into())
        }
        Err(_) => fs::rename(from, to).map_err(|e| match e.kind() {
            io::ErrorKind::DirectoryNotEmpty => io::ErrorKind::AlreadyExists.into(),
            _ => e,
        }),
    }
}

/// Writes a file's content to the disk. File systems without this operation are passed over.
pub(super) fn synchronise(file: &File) -> io::Result<()> {
    fault::point()?;
    match file.sync_all() {
        Err(e) if matches!(e.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => Ok(()),
        done => done,
    }
}

/// Writes the names in a file's folder to the disk. A folder that cannot be opened for reading is passed
/// over.
pub(super) fn synchronise_folder(file: &Path) -> io::Result<()> {
    if cfg!(not(unix)) {
        return Ok(());
    }
    match File::open(folder_of(file)) {
        Ok(folder) => synchronise(&folder),
        Err(_) => Ok(()),
    }
}

/// Moves a complete file or folder, which is on the disk, within its file system, and writes its name to the
/// disk. A file of the same name is replaced.
///
/// # Errors
/// [`Error::Io`].
pub fn publish(from: &Path, to: &Path) -> Result<()> {
    fault::point().and_then(|()| fs::rename(from, to)).map_err(|e| Error::io("give its name to", to, e))?;
    synchronise_folder(to).map_err(|e| Error::io("synchronise the folder of", to, e))
}

/// Folders that did not exist before. Dropping this value removes those that are empty, unless they are kept.
#[derive(Debug, Default)]
pub struct NewFolder {
    /// Outer folders first.
    created: Vec<PathBuf>,
}

impl NewFolder {
    /// Creates a folder with the folders around it, as far as they do not exist.
    pub fn create_all(path: &Path) -> io::Result<NewFolder> {
        let mut missing: Vec<&Path> =
            path.ancestors().take_while(|p| !p.as_os_str().is_empty() && !p.exists()).collect();
        missing.reverse();
        let mut made = NewFolder::default();
        for folder in missing {
            match made.add(folder) {
                // Another process was faster.
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists && folder.is_dir() => {}
                done => done?,
            }
        }
        if path.is_dir() { Ok(made) } else { Err(io::ErrorKind::NotADirectory.into()) }
    }

    /// Creates a folder that must not exist.
    pub fn create(path: &Path) -> io::Result<NewFolder> {
        let mut made = NewFolder::default();
        made.add(path).map(|()| made)
    }

    fn add(&mut self, folder: &Path) -> io::Result<()> {
        fault::point()?;
        let mut live = live();
        fs::create_dir(folder)?;
        live.folders.push(folder.to_path_buf());
        self.created.push(folder.to_path_buf());
        Ok(())
    }

    /// Keeps the folders even if they are empty.
    pub fn keep(mut self) {
        let kept = std::mem::take(&mut self.created);
        live().folders.retain(|folder| !kept.contains(folder));
    }
}

impl Drop for NewFolder {
    fn drop(&mut self) {
        for folder in self.created.iter().rev() {
            // Fails when the folder holds a file, which is intended.
            let _ = fs::remove_dir(folder);
        }
        live().folders.retain(|folder| !self.created.contains(folder));
    }
}

/// Removes the temporary files and the empty new folders of this process, which must end after it: no other
/// file can be created or renamed.
pub fn remove_temporary() {
    for _ in 0..ATTEMPTS {
        let live = match LIVE.try_lock() {
            Ok(live) => live,
            Err(std::sync::TryLockError::Poisoned(live)) => live.into_inner(),
            Err(std::sync::TryLockError::WouldBlock) => {
                std::thread::sleep(ATTEMPT_PERIOD);
                continue;
            }
        };
        live.undo_logs.iter().for_each(|log| roll_back_log(log));
        for file in &live.files {
            let _ = remove_any(file);
        }
        for folder in live.folders.iter().rev() {
            let _ = fs::remove_dir(folder);
        }
        std::mem::forget(live);
        return;
    }
}
