//! Opening of files for reading. Every file that the user names, or that such a file refers to, is opened and
//! looked for through this module, so that two questions have one answer each:
//!
//! * What did a result depend on? A [`FileLog`] holds the files that were opened, those that were looked for
//!   and not found, and the folders whose names were listed, by the work that it records.
//! * Would an output replace an input? [`ReadGuard`] holds the identities of the files that a command has
//!   read; [`refuse_input`] rejects them as outputs, under any name. The command starts it, for its process;
//!   it is never started by a library.

use super::paths::{identity, is_special};
use crate::error::{Error, Result};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, Metadata};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Files that were read or searched for, by the paths that were used.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reads {
    /// Files that were opened, with their state at that time.
    pub files: BTreeMap<PathBuf, Option<Stamp>>,
    /// Files that were looked for and not found.
    pub absent: BTreeSet<PathBuf>,
    /// Folders whose names were listed.
    pub folders: BTreeSet<PathBuf>,
}

impl Reads {
    /// True if sizes and times of all opened files are unchanged.
    pub fn are_unchanged(&self) -> bool {
        let is_same = |(path, then): (&PathBuf, &Option<Stamp>)| {
            let now = fs::metadata(path).ok().and_then(|about| Stamp::of(&about));
            match (now, then) {
                (Some(now), Some(then)) => now.is_same_content(then),
                (now, then) => now.is_none() && then.is_none(),
            }
        };
        self.files.iter().all(is_same)
    }

    /// Adds what another recording holds.
    pub fn extend(&mut self, other: Reads) {
        self.files.extend(other.files);
        self.absent.extend(other.absent);
        self.folders.extend(other.folders);
    }
}

/// Size and times of a file: as long as they stay the same, so do its contents, but for damage of the medium
/// and programs that set times back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
pub struct Stamp {
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Time of the last change of the contents, ns since 1970.
    modified_ns: i128,
    /// Time of the last change of contents, name or permissions, ns since 1970; 0 where a system has none.
    changed_ns: i128,
}

impl Stamp {
    /// The stamp of a regular file.
    pub fn of(about: &Metadata) -> Option<Stamp> {
        if !about.is_file() {
            return None;
        }
        let modified = about.modified().ok()?;
        let modified_ns = match modified.duration_since(std::time::UNIX_EPOCH) {
            Ok(since) => since.as_nanos() as i128,
            Err(before) => -(before.duration().as_nanos() as i128),
        };
        #[cfg(unix)]
        let changed_ns = {
            use std::os::unix::fs::MetadataExt as _;
            i128::from(about.ctime()) * 1_000_000_000 + i128::from(about.ctime_nsec())
        };
        #[cfg(not(unix))]
        let changed_ns = 0;
        Some(Stamp { bytes: about.len(), modified_ns, changed_ns })
    }

    /// True if size and time of the last change of the contents are the same.
    pub fn is_same_content(&self, other: &Stamp) -> bool {
        (self.bytes, self.modified_ns) == (other.bytes, other.modified_ns)
    }
}

/// Files by identity: all names of a file count, those of symbolic and of hard links, too.
#[derive(Clone, Debug, Default)]
pub struct FileSet {
    paths: BTreeSet<PathBuf>,
    numbers: BTreeSet<(u64, u64)>,
}

impl FileSet {
    /// The files of these names.
    pub fn of<P: AsRef<Path>>(paths: impl IntoIterator<Item = P>) -> FileSet {
        let mut set = FileSet::default();
        paths.into_iter().for_each(|path| set.insert(path.as_ref()));
        set
    }

    /// Adds a file.
    pub fn insert(&mut self, path: &Path) {
        let Ok(about) = fs::metadata(path) else { return };
        if about.is_file() {
            self.paths.insert(identity(path));
            self.numbers.extend(number(&about));
        }
    }

    /// True if a path is a name of one of the files.
    pub fn contains(&self, path: &Path) -> bool {
        if self.paths.is_empty() {
            return false;
        }
        match fs::metadata(path) {
            Ok(about) if about.is_file() => {
                self.has(&about) || !is_special(path) && self.paths.contains(&identity(path))
            }
            _ => false,
        }
    }

    fn has(&self, about: &Metadata) -> bool {
        about.is_file() && number(about).is_some_and(|number| self.numbers.contains(&number))
    }
}

/// Device and inode of a file, on systems that have them.
fn number(about: &Metadata) -> Option<(u64, u64)> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        Some((about.dev(), about.ino()))
    }
    #[cfg(not(unix))]
    {
        let _ = about;
        None
    }
}

static GUARDED: Mutex<Option<FileSet>> = Mutex::new(None);
/// True while there is a guard.
static IS_GUARDED: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// The logs that record this thread, outer ones first.
    static LOGS: RefCell<Vec<FileLog>> = const { RefCell::new(Vec::new()) };
}

fn locked<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Log of the files that some work reads. Clones are the same log.
#[derive(Clone, Debug, Default)]
pub struct FileLog(Arc<Mutex<Reads>>);

impl FileLog {
    /// Does `work` and records what it reads: this thread, and the threads that [`crate::machine`] starts for
    /// it. Logs that already record the thread continue.
    pub fn record<T>(&self, work: impl FnOnce() -> T) -> T {
        ThreadLogs(vec![self.clone()]).record(work)
    }

    /// Everything read so far.
    pub fn reads(&self) -> Reads {
        locked(&self.0).clone()
    }
}

/// The logs that record a thread, for another one that works for it.
#[derive(Clone, Debug, Default)]
pub struct ThreadLogs(Vec<FileLog>);

impl ThreadLogs {
    /// The logs of the present thread.
    pub fn of_this_thread() -> ThreadLogs {
        ThreadLogs(LOGS.try_with(|logs| logs.borrow().clone()).unwrap_or_default())
    }

    /// Does `work`, which the logs record.
    pub fn record<T>(&self, work: impl FnOnce() -> T) -> T {
        /// Removes the logs, after a panic, too.
        struct Leave(usize);
        impl Drop for Leave {
            fn drop(&mut self) {
                let _ = LOGS.try_with(|logs| logs.borrow_mut().truncate(self.0));
            }
        }
        let before = LOGS.try_with(|logs| {
            let mut logs = logs.borrow_mut();
            let before = logs.len();
            logs.extend(self.0.iter().cloned());
            before
        });
        let _leave = before.ok().map(Leave);
        work()
    }
}

/// While it exists, no file that the process has read since it was created is replaced by
/// [`super::FileWriter`]. For processes that execute one command.
#[derive(Debug)]
pub struct ReadGuard(());

impl ReadGuard {
    /// Guards the files that are read from now on, and the one that is standard input.
    pub fn start() -> ReadGuard {
        *locked(&GUARDED) = Some(FileSet::of(["/dev/stdin"]));
        IS_GUARDED.store(true, Ordering::SeqCst);
        ReadGuard(())
    }
}

impl Drop for ReadGuard {
    fn drop(&mut self) {
        IS_GUARDED.store(false, Ordering::SeqCst);
        *locked(&GUARDED) = None;
    }
}

/// True if a path is a name of a file that this command has read.
pub fn is_input(path: &Path) -> bool {
    locked(&GUARDED).as_ref().is_some_and(|set| set.contains(path))
}

/// Refuses an output that would replace a file which the same command has read.
///
/// # Errors
/// [`Error::Input`].
pub fn refuse_input(path: &Path) -> Result<()> {
    if is_input(path) {
        return Err(Error::input(is_read(path)));
    }
    Ok(())
}

/// Refuses an output that would replace one of the `inputs`, or a file that this command has read: for
/// commands that can check this before they read.
///
/// # Errors
/// [`Error::Input`].
pub fn refuse_input_of<P: AsRef<Path>>(path: &Path, inputs: impl IntoIterator<Item = P>) -> Result<()> {
    match FileSet::of(inputs).contains(path) {
        true => Err(Error::input(is_read(path))),
        false => refuse_input(path),
    }
}

/// Refuses standard output if it goes to a file that this command has read.
pub(super) fn refuse_input_at(name: &Path, file: &File) -> Result<()> {
    let is_input = locked(&GUARDED).as_ref().is_some_and(|set| file.metadata().is_ok_and(|m| set.has(&m)));
    if is_input {
        return Err(Error::input(format!(
            "{} goes to a file that this command reads; redirect it to another one",
            name.display()
        )));
    }
    Ok(())
}

/// The message about an output that is an input.
pub fn is_read(path: &Path) -> String {
    format!("{} is read by this command, so it cannot be replaced; choose another name", path.display())
}

fn is_recorded() -> bool {
    LOGS.try_with(|logs| !logs.borrow().is_empty()).unwrap_or(false)
}

fn note(path: &Path, add: impl Fn(&mut Reads)) {
    if !path.as_os_str().is_empty() {
        // A thread that ends reads nothing.
        let _ = LOGS.try_with(|logs| logs.borrow().iter().for_each(|log| add(&mut locked(&log.0))));
    }
}

fn note_absent(path: &Path) {
    note(path, |reads| {
        reads.absent.insert(path.to_path_buf());
    });
}

/// Notes that a file was opened, or why it could not be. To be called for files that are opened otherwise
/// than by this module.
pub fn note_opened<T>(path: &Path, opened: &io::Result<T>) {
    let (is_recorded, is_guarded) = (is_recorded(), IS_GUARDED.load(Ordering::SeqCst));
    match opened {
        Ok(_) if is_recorded || is_guarded => {
            if is_recorded {
                let stamp = fs::metadata(path).ok().and_then(|about| Stamp::of(&about));
                note(path, |reads| {
                    reads.files.entry(path.to_path_buf()).or_insert(stamp);
                });
            }
            if let Some(set) = &mut *locked(&GUARDED) {
                set.insert(path);
            }
        }
        Err(e) if matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
            note_absent(path);
        }
        _ => {}
    }
}

/// Opens a file.
///
/// # Errors
/// The errors of [`File::open`].
pub fn open(path: impl AsRef<Path>) -> io::Result<File> {
    let path = path.as_ref();
    let opened = File::open(path);
    note_opened(path, &opened);
    opened
}

/// Opens a regular file without noting it: for files that the program has made for itself. A pipe in its
/// place is an error and is not waited for.
///
/// # Errors
/// The errors of [`File::open`], and for anything but a regular file.
pub fn open_own(path: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.read(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt as _;
        options.custom_flags(rustix::fs::OFlags::NONBLOCK.bits() as i32);
    }
    let file = options.open(path)?;
    if file.metadata()?.is_file() {
        return Ok(file);
    }
    Err(io::Error::new(io::ErrorKind::InvalidInput, "it is not a regular file"))
}

/// Reads a complete file of the program's own, see [`open_own`].
///
/// # Errors
/// The errors of [`open_own`] and of reading.
pub fn read_own(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_own(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads a complete file.
///
/// # Errors
/// The errors of [`fs::read`].
pub fn read(path: impl AsRef<Path>) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads a complete text in UTF-8.
///
/// # Errors
/// The errors of [`fs::read_to_string`].
pub fn read_to_string(path: impl AsRef<Path>) -> io::Result<String> {
    let mut text = String::new();
    open(path)?.read_to_string(&mut text)?;
    Ok(text)
}

/// True if a file of this name exists. The absence of a file is recorded, too.
pub fn is_file(path: impl AsRef<Path>) -> bool {
    let path = path.as_ref();
    let found = path.is_file();
    if !found {
        note_absent(path);
    }
    found
}

/// True if a named pipe of this name exists.
#[cfg(unix)]
pub fn is_pipe(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt as _;
    path.metadata().is_ok_and(|m| m.file_type().is_fifo())
}

#[cfg(not(unix))]
pub fn is_pipe(_: &Path) -> bool {
    false
}

/// The paths in a folder, sorted.
///
/// # Errors
/// The errors of [`fs::read_dir`].
pub fn list(folder: impl AsRef<Path>) -> io::Result<Vec<PathBuf>> {
    let folder = folder.as_ref();
    let shown = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    note(shown, |reads| {
        reads.folders.insert(shown.to_path_buf());
    });
    let mut paths = fs::read_dir(shown)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
    paths.sort();
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logs_hold_what_was_read_and_what_was_missing() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("a"), "text").unwrap();
        let log = FileLog::default();
        log.record(|| {
            assert_eq!(read_to_string(at("a")).unwrap(), "text");
            assert!(read(at("b")).is_err() && !is_file(at("c")) && is_file(at("a")));
            assert_eq!(list(folder.path()).unwrap(), [at("a")]);
        });
        assert!(!is_file(at("d")));
        let reads = log.reads();
        assert_eq!(reads.files.keys().collect::<Vec<_>>(), [&at("a")]);
        assert_eq!(reads.files[&at("a")].unwrap().bytes, 4);
        assert_eq!(reads.absent.iter().collect::<Vec<_>>(), [&at("b"), &at("c")]);
        assert_eq!(reads.folders.iter().collect::<Vec<_>>(), [folder.path()]);
    }

    #[test]
    fn logs_record_their_own_work_with_the_threads_that_are_started_for_it() {
        let absent =
            |log: &FileLog| log.reads().absent.iter().map(|p| p.display().to_string()).collect::<Vec<_>>();
        let (outer, inner) = (FileLog::default(), FileLog::default());
        let other = std::thread::spawn(|| {
            let log = FileLog::default();
            log.record(|| is_file("of another thread"));
            log
        });
        outer.record(|| {
            is_file("a");
            inner.record(|| {
                crate::machine::with_pool(2, || is_file("b")).unwrap();
                std::thread::scope(|scope| {
                    let started = crate::machine::spawn_scoped(scope, "reader", || is_file("c")).unwrap();
                    started.join().unwrap();
                });
            });
            let fail = || FileLog::default().record(|| assert!(std::hint::black_box(false), "on purpose"));
            let failed = std::panic::catch_unwind(fail);
            assert!(failed.is_err());
            is_file("d");
        });
        assert_eq!(absent(&outer), ["a", "b", "c", "d"]);
        assert_eq!(absent(&inner), ["b", "c"]);
        assert_eq!(absent(&other.join().unwrap()), ["of another thread"]);
        assert!(!is_recorded());
    }

    #[cfg(unix)]
    #[test]
    fn all_names_of_a_file_are_one_file() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("a"), "").unwrap();
        fs::write(at("other"), "").unwrap();
        fs::hard_link(at("a"), at("hard")).unwrap();
        std::os::unix::fs::symlink("a", at("soft")).unwrap();
        let set = FileSet::of([at("a")]);
        for name in ["a", "hard", "soft", "../a"] {
            let path = if name == "../a" { at("x/..").join("a") } else { at(name) };
            fs::create_dir_all(at("x")).unwrap();
            assert!(set.contains(&path), "{name}");
        }
        assert!(!set.contains(&at("other")) && !set.contains(&at("missing")) && !set.contains(folder.path()));
    }
}
