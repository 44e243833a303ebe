//! A process of vlscan: started under its restrictions, watched, and how it ended. Workers of the service use
//! it, and tasks of an engine on its nodes.

use crate::beneath::Beneath;
use crate::config::ConfineArgs;
use crate::messages::{Said, failure, said};
use crate::program::confined;
use crate::store::Result;
use crate::terms::Terms;
use serde::{Deserialize, Serialize};
#[cfg(target_os = "linux")]
use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

const POLL: Duration = Duration::from_millis(20);
/// Period in which time and disk are checked.
const CHECK: Duration = Duration::from_secs(1);
/// Most files and folders in the folder of a job.
const MAX_ENTRIES: usize = 200_000;
/// Maximum number of restarts after SIGKILL: the system may have needed the memory for something else.
const MAX_KILLS: usize = 2;
/// Wait for a process that works in the same folder: one that an earlier service has started and that is
/// about to end.
const IN_USE: Duration = Duration::from_millis(200);

/// Exit statuses of vlscan (docs/outputs.md): the run cannot be divided or continued; another process works
/// in the folder.
const NOT_DIVISIBLE: i32 = 4;
const FOLDER_IN_USE: i32 = 5;

/// The message of a job whose process is always killed.
const KILLED: &str = "the system has ended the process of the job; it may need more memory than there is";

/// The message of a job that maps deleted files, whose space on the disk nothing tells.
const HIDDEN_MAPS: &str = "it maps deleted files, which are beyond the limits of this service";

/// End of a process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum End {
    /// It has done its work.
    Success,
    /// It has failed, with this message.
    Failure(String),
    /// The run cannot be divided into shards, or not continued with those that exist.
    NotDivisible(String),
    /// It was ended because its results are not wanted any more, or not by this process.
    GivenUp,
}

/// Folder and limits of the processes of a job.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Setting {
    /// The folder of the service, which messages do not tell.
    pub root: PathBuf,
    /// The folder of the job.
    pub folder: PathBuf,
    /// Restrictions of the processes.
    pub restrictions: ConfineArgs,
    /// True if they work in the folder of inputs, else in that of results.
    pub within_inputs: bool,
    /// Time of a process, seconds.
    pub max_time: u64,
    /// Bytes of all files of the job.
    pub max_disk: u64,
    /// Terms of the messages. Submissions of earlier versions have none.
    #[serde(default)]
    pub terms: Terms,
}

impl Setting {
    /// Executes vlscan with `words`; again if somebody kills it, each time after `prepare`. Messages go to
    /// the file `log`, standard output to `stdout` when it is complete. `goes_on` is asked again and again
    /// whether the results are still wanted.
    ///
    /// # Errors
    /// Errors of files, of `prepare` and of `goes_on`.
    pub fn execute(
        &self,
        words: &[OsString],
        log: &Path,
        stdout: Option<&Path>,
        prepare: &mut dyn FnMut() -> Result<()>,
        goes_on: &mut dyn FnMut() -> Result<bool>,
    ) -> Result<End> {
        let mut kills = 0;
        let start = Instant::now();
        loop {
            prepare()?;
            match self.start(words, log, stdout, goes_on)? {
                Ended::Killed if kills < MAX_KILLS => kills += 1,
                Ended::Killed => return Ok(End::Failure(KILLED.to_owned())),
                Ended::InUse(message) if start.elapsed().as_secs() > self.max_time => {
                    return Ok(End::Failure(message));
                }
                Ended::InUse(_) => {
                    if !goes_on()? {
                        return Ok(End::GivenUp);
                    }
                    std::thread::sleep(IN_USE);
                }
                Ended::By(end) => return Ok(end),
            }
        }
    }

    fn start(
        &self,
        words: &[OsString],
        log: &Path,
        stdout: Option<&Path>,
        goes_on: &mut dyn FnMut() -> Result<bool>,
    ) -> Result<Ended> {
        // No process of the job can put a link in its place.
        let part = stdout.map(|_| self.folder.join("stdout"));
        let mut command = alone(confined(&self.restrictions, words)?);
        command.current_dir(self.folder.join(if self.within_inputs { "in" } else { "out" }));
        command.env("TMPDIR", self.folder.join("tmp")).stderr(File::create(log)?);
        command.stdout(part.as_ref().map(File::create).transpose()?.map_or(Stdio::null(), Stdio::from));
        let mut child = command.spawn()?;
        let watched = self.watch(&mut child, log, goes_on);
        end(&mut child, !self.restrictions.no_sandbox);
        if let (Ok(Ended::By(End::Success)), Some(part), Some(stdout)) = (&watched, &part, stdout) {
            fs::rename(part, stdout)?;
        } else if let Some(part) = &part {
            let _ = fs::remove_file(part);
        }
        watched
    }

    fn watch(
        &self,
        child: &mut Child,
        log: &Path,
        goes_on: &mut dyn FnMut() -> Result<bool>,
    ) -> Result<Ended> {
        let start = Instant::now();
        let mut checked = Instant::now();
        let mut hidden = BTreeSet::new();
        loop {
            if let Some(status) = child.try_wait()? {
                return Ok(self.ended(status, log));
            }
            if !goes_on()? {
                return Ok(Ended::By(End::GivenUp));
            }
            if checked.elapsed() >= CHECK {
                if start.elapsed() > Duration::from_secs(self.max_time) {
                    let message = format!("it took more than {} s, the limit of this service", self.max_time);
                    return Ok(Ended::By(End::Failure(message)));
                }
                let maps = hidden_maps(child.id(), &self.restrictions.write);
                // A file that is being closed may be seen once.
                if !maps.is_disjoint(&hidden) {
                    return Ok(Ended::By(End::Failure(HIDDEN_MAPS.to_owned())));
                }
                hidden = maps;
                match bytes_in(&self.folder).map(|bytes| bytes.saturating_add(deleted_bytes(child.id()))) {
                    Ok(bytes) if bytes <= self.max_disk => {}
                    Ok(_) => {
                        let most = self.max_disk;
                        let message =
                            format!("its files have more than {most} bytes, the limit of this service");
                        return Ok(Ended::By(End::Failure(message)));
                    }
                    Err(error) => {
                        let message = format!("its files are beyond the limits of this service: {error}");
                        return Ok(Ended::By(End::Failure(message)));
                    }
                }
                checked = Instant::now();
            }
            std::thread::sleep(if start.elapsed() < Duration::from_secs(1) { POLL / 4 } else { POLL });
        }
    }

    fn ended(&self, status: ExitStatus, log: &Path) -> Ended {
        if status.success() {
            return Ended::By(End::Success);
        }
        if was_killed(status) {
            return Ended::Killed;
        }
        let message = match failure(log, self.terms, |text| self.without_folders(text)) {
            message if message.is_empty() => {
                format!("vlscan ended with {status}; see the limits of the service")
            }
            message => message,
        };
        match status.code() {
            Some(NOT_DIVISIBLE) => Ended::By(End::NotDivisible(message)),
            Some(FOLDER_IN_USE) => Ended::InUse(message),
            _ => Ended::By(End::Failure(message)),
        }
    }

    /// Messages of vlscan in the last existing log, without progress and the names of outputs.
    pub(crate) fn said(&self, logs: &[PathBuf]) -> Said {
        let log = logs.iter().rev().find_map(|log| File::open(log).ok());
        log.map_or_else(Said::default, |log| said(log, self.terms, |text| self.without_folders(text)))
    }

    /// A text without the folders of the service and of the job.
    fn without_folders(&self, text: &str) -> String {
        let mut message = text.to_owned();
        for folder in [&self.folder, &self.root] {
            message = message.replace(&format!("{}/", folder.display()), "");
        }
        ["in/../out/", "../in/", "../out/", "../tmp/"]
            .iter()
            .fold(message, |text, path| text.replace(path, ""))
    }
}

/// End of a process that may be started again.
enum Ended {
    By(End),
    /// Somebody else killed it: the system, for want of memory, or an operator.
    Killed,
    /// Another process works in the folder.
    InUse(String),
}

/// True if a process was ended from outside, not by a limit or a fault of its own.
#[cfg(unix)]
fn was_killed(status: ExitStatus) -> bool {
    use std::os::unix::process::ExitStatusExt as _;
    let signals = [nix::sys::signal::Signal::SIGKILL, nix::sys::signal::Signal::SIGTERM];
    status.signal().is_some_and(|number| signals.iter().any(|signal| *signal as i32 == number))
}

#[cfg(not(unix))]
fn was_killed(_: ExitStatus) -> bool {
    false
}

/// Starts a process in a group of its own, by which all its processes are ended where no sandbox keeps it to
/// one.
pub(crate) fn alone(command: std::process::Command) -> std::process::Command {
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt as _;
        let mut command = command;
        command.process_group(0);
        command
    }
    #[cfg(not(unix))]
    command
}

/// Ends a process, whether it has ended or not, and without a sandbox, which keeps it to one, all processes
/// of its group.
pub(crate) fn end(child: &mut Child, has_sandbox: bool) {
    #[cfg(unix)]
    if let (false, Ok(group)) = (has_sandbox, i32::try_from(child.id())) {
        let _ =
            nix::sys::signal::killpg(nix::unistd::Pid::from_raw(group), nix::sys::signal::Signal::SIGKILL);
    }
    #[cfg(not(unix))]
    let _ = has_sandbox;
    let _ = child.kill();
    let _ = child.wait();
}

/// Disk space of a job folder, bytes.
///
/// # Errors
/// Errors of files, and too many files.
pub(crate) fn bytes_in(folder: &Path) -> std::io::Result<u64> {
    let entries = Beneath::of(folder)?.entries(MAX_ENTRIES)?;
    Ok(entries.iter().fold(0, |sum, entry| sum.saturating_add(entry.space)))
}

/// The folders of the threads of a process, in /proc. All threads share memory and open files, but the first
/// one shows nothing after its own end.
#[cfg(target_os = "linux")]
fn threads(process: u32) -> impl Iterator<Item = PathBuf> {
    let threads = fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten();
    threads.map(|entry| entry.path())
}

/// Disk space, bytes, of each regular file that a process has open and whose name is gone, by device and
/// inode.
#[cfg(target_os = "linux")]
fn deleted_files(process: u32) -> BTreeMap<(u64, u64), u64> {
    use std::os::unix::fs::MetadataExt as _;
    let open = |thread: PathBuf| fs::read_dir(thread.join("fd")).into_iter().flatten().flatten().peekable();
    let first = threads(process).map(open).find_map(|mut open| open.peek().is_some().then_some(open));
    let files = first.into_iter().flatten().filter_map(|entry| fs::metadata(entry.path()).ok());
    let deleted = files.filter(|about| about.is_file() && about.nlink() == 0);
    let space = |about: &fs::Metadata| about.len().max(about.blocks().saturating_mul(512));
    deleted.map(|about| ((about.dev(), about.ino()), space(&about))).collect()
}

/// Disk space, bytes, of the regular files that a process has open and whose names are gone.
#[cfg(target_os = "linux")]
fn deleted_bytes(process: u32) -> u64 {
    deleted_files(process).values().fold(0, |sum, bytes| sum.saturating_add(*bytes))
}

/// Files of these folders, by their inodes, that a process maps, that it does not have open, and whose names
/// are gone: they keep their space, and only the system knows how much that is.
#[cfg(target_os = "linux")]
fn hidden_maps(process: u32, folders: &[PathBuf]) -> BTreeSet<u64> {
    let mut maps = threads(process).filter_map(|thread| fs::read(thread.join("maps")).ok());
    let maps = maps.find(|maps| !maps.is_empty()).unwrap_or_default();
    let maps = String::from_utf8_lossy(&maps);
    let mut mapped = BTreeSet::new();
    for line in maps.lines().filter_map(|line| line.strip_suffix(DELETED)) {
        let Some(at) = line.find('/') else { continue };
        let inode = line[..at].split_whitespace().nth(4).and_then(|inode| inode.parse::<u64>().ok());
        if folders.iter().any(|folder| Path::new(&line[at..]).starts_with(folder)) {
            mapped.extend(inode);
        }
    }
    if !mapped.is_empty() {
        for (_, inode) in deleted_files(process).keys() {
            mapped.remove(inode);
        }
    }
    mapped
}

/// End of the names of deleted files in /proc.
#[cfg(target_os = "linux")]
const DELETED: &str = " (deleted)";

#[cfg(not(target_os = "linux"))]
fn hidden_maps(_: u32, _: &[PathBuf]) -> BTreeSet<u64> {
    BTreeSet::new()
}

#[cfg(not(target_os = "linux"))]
fn deleted_bytes(_: u32) -> u64 {
    0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn open_files_without_a_name_count() {
        let own = std::process::id();
        let before = deleted_bytes(own);
        let file = tempfile::tempfile().unwrap();
        file.set_len(1 << 40).unwrap();
        let again = file.try_clone().unwrap();
        assert!((1 << 40..2 << 40).contains(&deleted_bytes(own)), "once, however often it is open");
        drop((file, again));
        assert!(deleted_bytes(own) <= before.max(1 << 30));
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn maps_of_deleted_files_are_found_unless_they_are_open() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().canonicalize().unwrap();
        let hidden = |script: &str| {
            let start = "import mmap, os\nf = open('f', 'w+b'); f.truncate(9000); m = mmap.mmap(os.dup(f.fileno()), 4096)\n";
            let script = format!("{start}{script}\nos.unlink('f'); print(flush=True); input()");
            let mut command = std::process::Command::new("python3");
            command.args(["-c", &script]).current_dir(&inner).stdin(Stdio::piped()).stdout(Stdio::piped());
            let mut child = command.spawn().unwrap();
            std::io::Read::read_exact(child.stdout.as_mut().unwrap(), &mut [0]).unwrap();
            let found =
                [inner.clone(), inner.join("other")].map(|folder| hidden_maps(child.id(), &[folder]).len());
            child.kill().unwrap();
            child.wait().unwrap();
            found
        };
        assert_eq!(hidden("os.closerange(3, 100)"), [1, 0]);
        assert_eq!(hidden(""), [0, 0], "its size is known");
        let another = "os.closerange(3, 100); os.unlink('f'); g = open('f', 'w+b')";
        assert_eq!(hidden(another), [1, 0], "another file of that name is open");
    }
}
