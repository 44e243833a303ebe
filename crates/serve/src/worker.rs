//! Workers: threads that take jobs from the queue and have them computed, each by a process of its own.
//!
//! A worker makes the job's folder, starts vlscan under its restrictions and watches it: it renews the lease, reads the progress, and ends
//! the process when it takes too long or too much disk, when the job is dismissed, or when the service ends. What an earlier worker has begun
//! is continued (`--resume`).

use crate::config::{ConfineArgs, ServeArgs};
use crate::processes::Process;
use crate::program::{Program, confined};
use crate::queue::{Outcome, Use};
use crate::request::{Prepared, name_of};
use crate::store::{Job, Result, ResultFile, Store, StoreError};
use crate::tokens::{Owner, random_name};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How often an idle worker looks for jobs that nobody has told it of.
const IDLE: Duration = Duration::from_secs(1);
const POLL: Duration = Duration::from_millis(20);
const RENEWAL: Duration = Duration::from_secs(1);
/// Longest message of a failed job, bytes.
const MAX_MESSAGE: u64 = 8 << 10;
/// How often a process that somebody kills is started again.
const MAX_KILLS: usize = 50;
/// Most files of results that are listed.
const MAX_RESULTS: usize = 100_000;

/// The message of a job whose process is always killed.
const KILLED: &str = "the system has ended the process of the job; it may need more memory than there is";

/// What all workers share.
#[derive(Debug)]
pub struct Workshop {
    /// Uploads, jobs and queue.
    pub store: Arc<Store>,
    /// The program vlscan.
    pub program: Arc<Program>,
    /// The limits.
    pub limits: ServeArgs,
    /// The owners with quotas of their own.
    pub owners: Vec<Owner>,
    wake: Condvar,
    is_ending: AtomicBool,
    waiting: Mutex<()>,
}

/// How a process ended.
enum End {
    Success,
    Failure(String),
    /// Somebody else killed it: the system, for want of memory, or an operator.
    Killed,
    /// It was ended because the job is no longer this worker's.
    GivenUp,
}

impl Workshop {
    /// A workshop without workers.
    pub fn new(store: Arc<Store>, program: Arc<Program>, limits: ServeArgs, owners: Vec<Owner>) -> Workshop {
        Workshop {
            store,
            program,
            limits,
            owners,
            wake: Condvar::new(),
            is_ending: AtomicBool::new(false),
            waiting: Mutex::new(()),
        }
    }

    /// Starts the workers.
    ///
    /// # Errors
    /// When the system has no threads.
    pub fn start(self: &Arc<Workshop>) -> std::io::Result<Vec<JoinHandle<()>>> {
        let start = |number: usize| {
            let workshop = Arc::clone(self);
            // The processes end with the thread that starts them, which therefore lives as long as the service.
            std::thread::Builder::new().name(format!("worker {number}")).spawn(move || workshop.work())
        };
        (0..self.limits.workers).map(start).collect()
    }

    /// Tells a worker that there is a job.
    pub fn wake(&self) {
        self.wake.notify_one();
    }

    /// Ends all workers; their jobs return to the queue.
    pub fn end(&self) {
        self.is_ending.store(true, Ordering::SeqCst);
        self.wake.notify_all();
    }

    /// The quota of an owner.
    pub fn quota(&self, owner: &str) -> Option<u64> {
        let own = self.owners.iter().find(|known| known.name == owner).and_then(|known| known.quota);
        own.or(self.limits.quota)
    }

    fn work(&self) {
        let holder = random_name(8);
        while !self.is_ending.load(Ordering::SeqCst) {
            match self.store.take_job(&holder) {
                Ok(Some(job)) => self.compute(&job, &holder),
                Ok(None) => {
                    let waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
                    drop(self.wake.wait_timeout(waiting, IDLE));
                }
                Err(error) => {
                    eprintln!("vlscan serve: {error}");
                    std::thread::sleep(IDLE);
                }
            }
        }
        if let Err(error) = self.store.release(&holder) {
            eprintln!("vlscan serve: {error}");
        }
    }

    /// Computes a job and records what came of it.
    fn compute(&self, job: &Job, holder: &str) {
        let outcome = match self.try_compute(job, holder) {
            Ok(Some(outcome)) => outcome,
            // The service ends: the job is released, not finished.
            Ok(None) if self.is_ending.load(Ordering::SeqCst) => return,
            Ok(None) => Outcome::Failed(String::new()),
            Err(error) => {
                eprintln!("vlscan serve: job {}: {error}", job.id);
                Outcome::Failed(
                    "the service could not compute this job; its operator finds the reason in its log"
                        .to_owned(),
                )
            }
        };
        if let Err(error) = self.store.finish(&job.id, holder, &outcome) {
            eprintln!("vlscan serve: job {}: {error}", job.id);
        }
    }

    /// Returns `None` if the job was given up.
    fn try_compute(&self, job: &Job, holder: &str) -> Result<Option<Outcome>> {
        let folder = self.store.job_folder(&job.id);
        let prepared: Prepared = serde_json::from_str(&job.prepared).map_err(std::io::Error::other)?;
        let process = Process::named(&job.process);
        if let Some(same) = self.store.same_job(&job.owner, &job.fingerprint)? {
            // Another worker has computed it while this one waited.
            copy_results(&self.store.job_folder(&same.folder), &folder, &prepared)?;
            return Ok(Some(Outcome::Successful(results(&folder.join("out"))?)));
        }
        make_folder(&self.store, &folder, &prepared)?;
        let quota = self.quota(&job.owner);
        if quota.is_some() && process == Some(Process::Run) {
            let words = ["run", "../in/job.toml", "--dry-run", "--json"].map(OsString::from);
            let price = folder.join("tmp").join("price.json");
            match self.execute(job, holder, &folder, &prepared, &words, Some(&price))? {
                End::Success => {}
                End::Failure(message) => return Ok(Some(Outcome::Failed(message))),
                End::Killed => return Ok(Some(Outcome::Failed(KILLED.to_owned()))),
                End::GivenUp => return Ok(None),
            }
            let report: serde_json::Value = serde_json::from_slice(&fs::read(&price)?).unwrap_or_default();
            let pulses = report["pulses"].as_f64().unwrap_or(0.0);
            if let Err(spent) = self.store.charge(job, pulses as u64, quota)? {
                let quota = quota.unwrap_or(0);
                return Ok(Some(Outcome::Failed(format!(
                    "the run has {pulses:.0} pulses; of the quota of {quota} pulses within 24 hours {} are left",
                    quota.saturating_sub(spent)
                ))));
            }
        }
        if quota.is_some()
            && process == Some(Process::Campaign)
            && let Err(spent) = self.store.charge(job, 1, quota)?
        {
            let message =
                format!("the quota of {} pulses within 24 hours is used up ({spent})", quota.unwrap_or(0));
            return Ok(Some(Outcome::Failed(message)));
        }
        // Results that are complete are not computed again when an earlier worker was ended after it had them.
        let mark = folder.join("complete");
        if !mark.exists() {
            let mut kills = 0;
            let end = loop {
                match self.compute_results(job, holder, &folder, &prepared, process)? {
                    End::Killed if kills < MAX_KILLS => kills += 1,
                    end => break end,
                }
            };
            match end {
                End::GivenUp => return Ok(None),
                End::Killed => return Ok(Some(Outcome::Failed(KILLED.to_owned()))),
                End::Failure(message) => return Ok(Some(Outcome::Failed(message))),
                End::Success => fs::write(&mark, "")?,
            }
        }
        let files = results(&folder.join("out"))?;
        if process == Some(Process::Campaign) && quota.is_some() {
            self.store
                .charge(job, campaign_pulses(&folder.join("out/dataset/manifest.jsonl")), None)?
                .unwrap_or_default();
        }
        let _ = fs::remove_dir_all(folder.join("tmp"));
        Ok(Some(Outcome::Successful(files)))
    }

    fn compute_results(
        &self,
        job: &Job,
        holder: &str,
        folder: &Path,
        prepared: &Prepared,
        process: Option<Process>,
    ) -> Result<End> {
        let out = folder.join("out");
        let mut words: Vec<OsString> = prepared.words.iter().map(OsString::from).collect();
        if self.limits.threads > 0
            && matches!(process, Some(Process::Run | Process::DryRun | Process::Campaign))
        {
            words.push(format!("--threads={}", self.limits.threads).into());
        }
        let goes_on = match process {
            Some(Process::Run) => has_shards(&out)?,
            Some(Process::Campaign) => true,
            _ => false,
        };
        if !goes_on {
            fs::remove_dir_all(&out)?;
            fs::create_dir(&out)?;
        }
        if process != Some(Process::Run) {
            let stdout = prepared.stdout.as_ref().map(|name| out.join(name));
            return self.execute(job, holder, folder, prepared, &words, stdout.as_deref());
        }
        let resumable: Vec<OsString> =
            words.iter().cloned().chain(["--resume", "--progress"].map(OsString::from)).collect();
        match self.execute(job, holder, folder, prepared, &resumable, None)? {
            // Some flights cannot be divided.
            End::Failure(message) if message.contains("shard") || message.contains("--resume") => {
                fs::remove_dir_all(&out)?;
                fs::create_dir(&out)?;
                words.push("--progress".into());
                self.execute(job, holder, folder, prepared, &words, None)
            }
            end => Ok(end),
        }
    }

    /// Executes vlscan for a job and watches it.
    fn execute(
        &self,
        job: &Job,
        holder: &str,
        folder: &Path,
        prepared: &Prepared,
        words: &[OsString],
        stdout: Option<&Path>,
    ) -> Result<End> {
        let log = folder.join("log");
        let part = stdout.map(|path| path.with_extension("unfinished"));
        let mut command = confined(&self.restrictions(folder, prepared), words)?;
        command.current_dir(folder.join(if prepared.within_inputs { "in" } else { "out" }));
        command.env("TMPDIR", folder.join("tmp")).stderr(File::create(&log)?);
        command.stdout(part.as_ref().map(File::create).transpose()?.map_or(Stdio::null(), Stdio::from));
        let mut child = command.spawn()?;
        let watched = self.watch(job, holder, folder, &mut child, &log);
        if !matches!(watched, Ok(End::Success)) {
            let _ = child.kill();
            let _ = child.wait();
        }
        if let (Ok(End::Success), Some(part), Some(stdout)) = (&watched, &part, stdout) {
            fs::rename(part, stdout)?;
        } else if let Some(part) = &part {
            let _ = fs::remove_file(part);
        }
        watched
    }

    fn watch(&self, job: &Job, holder: &str, folder: &Path, child: &mut Child, log: &Path) -> Result<End> {
        let start = Instant::now();
        let mut renewed = Instant::now();
        loop {
            if let Some(status) = child.try_wait()? {
                if status.success() {
                    return Ok(End::Success);
                }
                if was_killed(status) {
                    return Ok(End::Killed);
                }
                let message = message_of(log, &self.private_paths(folder));
                let message = if message.is_empty() {
                    format!("vlscan ended with {status}; see the limits of the service")
                } else {
                    message
                };
                return Ok(End::Failure(message));
            }
            if self.is_ending.load(Ordering::SeqCst) {
                return Ok(End::GivenUp);
            }
            if renewed.elapsed() >= RENEWAL {
                renewed = Instant::now();
                let (progress, line) = progress_of(log);
                if !self.store.renew(&job.id, holder, progress, &line)? {
                    return Ok(End::GivenUp);
                }
                if start.elapsed() > Duration::from_secs(self.limits.max_time) {
                    return Ok(End::Failure(format!(
                        "it took more than {} s, the limit of this service",
                        self.limits.max_time
                    )));
                }
                if bytes_in(folder) > self.limits.max_disk {
                    return Ok(End::Failure(format!(
                        "its files have more than {} bytes, the limit of this service",
                        self.limits.max_disk
                    )));
                }
            }
            std::thread::sleep(if start.elapsed() < Duration::from_secs(1) { POLL / 4 } else { POLL });
        }
    }

    /// What the processes of a job may do.
    pub(crate) fn restrictions(&self, folder: &Path, prepared: &Prepared) -> ConfineArgs {
        let used = prepared.uses.iter().map(|used| match used {
            Use::Upload { id, .. } => self.store.upload_folder(id),
            Use::Job { folder, .. } => self.store.job_folder(folder).join("out"),
        });
        let threads = std::thread::available_parallelism().map_or(1, usize::from) as u64;
        ConfineArgs {
            read: std::iter::once(folder.join("in")).chain(used).collect(),
            write: ["out", "view", "tmp"].map(|name| folder.join(name)).to_vec(),
            memory: Some(self.limits.max_memory),
            time: Some(self.limits.max_time.saturating_mul(threads)),
            file_size: Some(self.limits.max_disk),
            no_sandbox: self.limits.no_sandbox,
            program: vec![self.program.path.clone().into()],
        }
    }

    /// What messages must not tell, and what stands there instead.
    fn private_paths(&self, folder: &Path) -> Vec<(String, String)> {
        let text = |path: &Path| path.display().to_string();
        let mut paths = vec![(format!("{}/", text(folder)), String::new())];
        paths.push((format!("{}/", text(self.store.root())), String::new()));
        paths.push(("../in/".to_owned(), String::new()));
        paths.push(("../out/".to_owned(), String::new()));
        paths
    }
}

/// Whether a process was ended from outside, not by a limit or a fault of its own.
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

/// Makes the folder of a job, or completes the one that an earlier worker has begun to make.
pub(crate) fn make_folder(store: &Store, folder: &Path, prepared: &Prepared) -> Result<()> {
    let inputs = folder.join("in");
    for name in ["in", "in/jobs", "out", "view", "tmp"] {
        fs::create_dir_all(folder.join(name))?;
    }
    if let Some((name, text)) = &prepared.document {
        fs::write(inputs.join(name), text)?;
    }
    for used in &prepared.uses {
        let target = match used {
            Use::Upload { id, .. } => store.upload_folder(id),
            Use::Job { folder, .. } => store.job_folder(folder).join("out"),
        };
        link(&target, &inputs.join(name_of(used)))?;
    }
    write_prepared(folder, prepared)
}

fn write_prepared(folder: &Path, prepared: &Prepared) -> Result<()> {
    let text = serde_json::to_string(prepared).map_err(std::io::Error::other)?;
    Ok(fs::write(folder.join("prepared.json"), text)?)
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

/// Gives a job the results of another one that is the same: the files have a second name and take no space.
fn copy_results(from: &Path, to: &Path, prepared: &Prepared) -> Result<()> {
    for part in ["out", "view"] {
        let _ = fs::remove_dir_all(to.join(part));
        let mut folders = vec![PathBuf::new()];
        while let Some(inner) = folders.pop() {
            fs::create_dir_all(to.join(part).join(&inner))?;
            for entry in fs::read_dir(from.join(part).join(&inner))? {
                let entry = entry?;
                let path = inner.join(entry.file_name());
                match entry.file_type()?.is_dir() {
                    true => folders.push(path),
                    false => fs::hard_link(entry.path(), to.join(part).join(path))?,
                }
            }
        }
    }
    write_prepared(to, prepared)
}

/// Whether an earlier worker has left shards of a run, which is then continued.
fn has_shards(out: &Path) -> Result<bool> {
    for entry in fs::read_dir(out)? {
        if entry?.file_name().to_string_lossy().ends_with(".shards") {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The files of results, sorted.
fn results(folder: &Path) -> Result<Vec<ResultFile>> {
    let mut found = Vec::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(inner) = folders.pop() {
        for entry in fs::read_dir(folder.join(&inner))? {
            let entry = entry?;
            let about = entry.metadata()?;
            let path = inner.join(entry.file_name());
            if path.to_string_lossy().starts_with('.') {
                continue;
            }
            if about.is_dir() {
                folders.push(path);
            } else if about.is_file() {
                found
                    .push(ResultFile { path: path.to_string_lossy().replace('\\', "/"), bytes: about.len() });
            }
            if found.len() > MAX_RESULTS {
                return Err(StoreError::Files(std::io::Error::other(format!(
                    "more than {MAX_RESULTS} files of results"
                ))));
            }
        }
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(found)
}

/// Bytes of all files in a folder; files that vanish meanwhile count nothing.
fn bytes_in(folder: &Path) -> u64 {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    let of = |entry: fs::DirEntry| match entry.metadata() {
        Ok(about) if about.is_dir() => bytes_in(&entry.path()),
        Ok(about) if about.is_file() => about.len(),
        _ => 0,
    };
    entries.flatten().map(of).sum()
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

/// The percentage in the last line of progress, and the line.
fn progress_of(log: &Path) -> (u8, String) {
    let text = tail(log, 4096);
    let line = text.lines().rev().find(|line| line.contains("pulses") && line.contains("leg"));
    let Some(line) = line.map(str::trim) else { return (0, String::new()) };
    let percent = line.split_once('%').and_then(|(number, _)| number.trim().parse::<f64>().ok());
    (percent.unwrap_or(0.0).clamp(0.0, 99.0) as u8, line.to_owned())
}

/// What vlscan said of its failure, without the folders of the service.
fn message_of(log: &Path, private: &[(String, String)]) -> String {
    let text = tail(log, MAX_MESSAGE);
    let start = text.find("error:").unwrap_or(0);
    let mut message = text[start..].trim().to_owned();
    for (path, instead) in private {
        message = message.replace(path, instead);
    }
    message
}

/// Pulses of all cells of a data set.
fn campaign_pulses(manifest: &Path) -> u64 {
    let text = fs::read_to_string(manifest).unwrap_or_default();
    let of = |line: &str| serde_json::from_str::<serde_json::Value>(line).ok()?["pulses"].as_u64();
    text.lines().filter_map(of).sum()
}
