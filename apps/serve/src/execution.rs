//! A process of vlscan: started under its restrictions, watched, and how it ended. Workers of the service use
//! it, and tasks of an engine on its nodes.

use crate::beneath::{BLOCK, Beneath, EntryKind};
use crate::config::ConfineArgs;
use crate::program::confined;
use crate::store::Result;
use serde::{Deserialize, Serialize};
#[cfg(target_os = "linux")]
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, Read, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

const POLL: Duration = Duration::from_millis(20);
/// Period in which time and disk are checked.
const CHECK: Duration = Duration::from_secs(1);
/// Most files and folders in the folder of a job.
const MAX_ENTRIES: usize = 200_000;
/// Maximum size of the messages that are kept of a job, and read, bytes.
pub(crate) const MAX_LOG: u64 = 1 << 20;
/// Longest message of a failed job, bytes.
const MAX_MESSAGE: u64 = 8 << 10;
/// Maximum number of restarts of a process that somebody kills: the system may have needed the memory for
/// something else.
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
        let message = match self.message_of(log) {
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

    /// Message of vlscan on its failure, without the folders of the service.
    fn message_of(&self, log: &Path) -> String {
        let text = tail(log, MAX_MESSAGE);
        let start = text.find("error:").unwrap_or(0);
        self.without_folders(text[start..].trim())
    }

    /// Messages of vlscan in the last existing log, without progress and the names of outputs.
    pub(crate) fn said(&self, logs: &[PathBuf]) -> String {
        let log = logs.iter().rev().find_map(|log| File::open(log).ok());
        log.map_or_else(String::new, |log| self.without_folders(&said_in(log)))
    }

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

/// Disk space of a job folder, bytes: the content of its files, and a block for each file and folder.
///
/// # Errors
/// Errors of files, and too many files.
pub(crate) fn bytes_in(folder: &Path) -> std::io::Result<u64> {
    let of = |bytes: u64| bytes.saturating_add(BLOCK);
    let entries = Beneath::of(folder)?.entries(MAX_ENTRIES)?;
    Ok(entries.iter().map(|entry| of(if entry.kind == EntryKind::File { entry.bytes } else { 0 })).sum())
}

/// Bytes of the regular files that a process has open and whose names are gone.
#[cfg(target_os = "linux")]
fn deleted_bytes(process: u32) -> u64 {
    use std::os::unix::fs::MetadataExt as _;
    let open = fs::read_dir(format!("/proc/{process}/fd")).into_iter().flatten().flatten();
    let files = open.filter_map(|entry| fs::metadata(entry.path()).ok());
    let deleted = files.filter(|about| about.is_file() && about.nlink() == 0);
    let sizes: BTreeMap<(u64, u64), u64> =
        deleted.map(|about| ((about.dev(), about.ino()), about.len())).collect();
    sizes.values().fold(0, |sum, bytes| sum.saturating_add(*bytes))
}

#[cfg(not(target_os = "linux"))]
fn deleted_bytes(_: u32) -> u64 {
    0
}

/// The last lines of a log, at most `most` bytes.
fn tail(log: &Path, most: u64) -> String {
    let read = || -> std::io::Result<Vec<u8>> {
        let mut file = File::open(log)?;
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(most)))?;
        let mut bytes = Vec::new();
        file.take(most).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    String::from_utf8_lossy(&read().unwrap_or_default()).into_owned()
}

/// The lines of a log without progress and the names of outputs, at most [`MAX_MESSAGE`] bytes of the first
/// [`MAX_LOG`] bytes: warnings come first, and the progress of hours may follow them.
fn said_in(log: impl Read) -> String {
    let mut log = BufReader::new(log.take(MAX_LOG));
    let lines = log.by_ref().split(b'\n').map_while(std::io::Result::ok);
    let lines = lines.map(|line| String::from_utf8_lossy(&line).into_owned());
    let mut said = String::new();
    let mut omitted = 0;
    for line in lines.filter(|line| !is_progress(line) && !line.starts_with("../out/")) {
        if omitted == 0 && said.len() + line.len() < MAX_MESSAGE as usize {
            said += &line;
            said.push('\n');
        } else {
            omitted += 1;
        }
    }
    if omitted > 0 {
        said += &format!("… and {omitted} more lines");
    }
    if log.get_ref().limit() == 0 {
        said += &format!("\n… (only the first {MAX_LOG} bytes of the messages are read)");
    }
    said.trim().to_owned()
}

/// True if a line tells progress, as `vlscan run` writes it to what is no terminal.
fn is_progress(line: &str) -> bool {
    let text = line.split_once(" %  ").map_or(line, |(_, text)| text);
    text.starts_with("leg ") && text.contains(" pulses (")
}

/// The percentage in the last line of progress, and the line.
pub(crate) fn progress_of(log: &Path) -> (u8, String) {
    let text = tail(log, 4096);
    let line = text.lines().rev().find(|line| is_progress(line));
    let Some(line) = line.map(str::trim) else { return (0, String::new()) };
    let percent = line.split_once('%').and_then(|(number, _)| number.trim().parse::<f64>().ok());
    (percent.unwrap_or(0.0).clamp(0.0, 99.0) as u8, line.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn warnings_are_kept_whatever_follows_them() {
        let warning = "warning: leg 2 has no pulses (it is not active)";
        let progress =
            " 20.7 %  leg 1/4  2.58 M pulses (1.29 M/s)  1.80 M echoes  7.65 s left\n".repeat(10_000);
        let end = "10 pulses, 2 points (0.20 per pulse) in 1 s";
        let log = format!(
            "{warning}\n{progress}leg 1/1  2.00 k pulses (1.00 k/s)\n../out/a.laz  2 points, 9 bytes\n{end}\n"
        );
        assert_eq!(said_in(log.as_bytes()), format!("{warning}\n{end}"));
        let long = said_in(format!("{warning}\n{}", "x\n".repeat(10_000)).as_bytes());
        assert!(long.starts_with(warning) && long.ends_with(" more lines"), "{long}");
        assert!(long.len() < MAX_MESSAGE as usize + 40);
        assert_eq!(said_in(&b"a \xff b\nc"[..]), "a \u{fffd} b\nc");
    }

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
    fn a_line_without_end_is_not_read_to_its_end() {
        let said = said_in((&b"warning: w\n"[..]).chain(std::io::repeat(b'x')));
        assert!(said.starts_with("warning: w\n… and 1 more lines"), "{said}");
        assert!(said.ends_with("the first 1048576 bytes of the messages are read)"), "{said}");
    }
}
