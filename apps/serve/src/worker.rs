//! Workers: threads that take jobs from the queue and have them computed, each by a process of its own, or by
//! an engine.
//!
//! A worker makes the job's folder, has the results computed under restrictions, and renews the lease
//! meanwhile. It gives the job up when the job is dismissed, or when the service ends. What an earlier worker
//! has begun is continued.
//!
//! | file | what it does |
//! |---|---|
//! | `limits` | limits of owners while their jobs are computed |
//! | `tidying` | files that finished jobs do not need |
//! | `expiry` | jobs that are kept no longer |

mod expiry;
mod limits;
mod tidying;

use crate::config::{ConfineArgs, ServeArgs};
use crate::engine::Engine;
use crate::execution::{End, Setting};
use crate::files::Fetched;
use crate::job_folder::{complete_results, make, record_complete, results};
use crate::messages::progress_of;
use crate::processes::Process;
use crate::program::{MESSAGES, Program};
use crate::queue::{Lane, Outcome, Use};
use crate::records::Kind;
use crate::request::Prepared;
use crate::steps::Steps;
use crate::store::{Job, Result, Status, Store, StoreError};
use crate::tasks::{Submission, Tasks};
use crate::terms::Terms;
use crate::tokens::{Owner, random_name};
use limits::Turn;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError, RwLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Period in which an idle worker looks for jobs that nobody has told it of.
const IDLE: Duration = Duration::from_secs(1);
const RENEWAL: Duration = Duration::from_secs(1);
/// Wait before a job is taken again whose files a bucket did not give or take.
const BUCKET: Duration = Duration::from_secs(5);
/// Workers of jobs that answer requests, besides those of --workers.
const QUICK_WORKERS: usize = 2;
/// The message of a job whose files are gone.
const REMOVED: &str = "files that it needs have been removed";
/// Lease owner of cancelled jobs still queued in an engine.
const WITHDRAWAL: &str = "withdrawal";

/// State that all workers share.
#[derive(Debug)]
pub struct Workshop {
    /// Uploads, jobs and queue.
    pub store: Arc<Store>,
    /// The program vlscan.
    pub program: Arc<Program>,
    /// The limits.
    pub limits: ServeArgs,
    /// The owners with quotas of their own.
    owners: RwLock<Vec<Owner>>,
    /// Engine that computes runs and campaigns in place of this machine.
    engine: Option<Engine>,
    wake: Condvar,
    is_ending: AtomicBool,
    waiting: Mutex<()>,
}

impl Workshop {
    /// A workshop without workers.
    pub fn new(
        store: Arc<Store>,
        program: Arc<Program>,
        limits: ServeArgs,
        owners: Vec<Owner>,
        engine: Option<Engine>,
    ) -> Workshop {
        Workshop {
            store,
            program,
            limits,
            owners: RwLock::new(owners),
            engine,
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
        let start = |name: String, work: fn(&Workshop)| {
            let workshop = Arc::clone(self);
            // The processes end with the thread that starts them, which therefore lives as long as the
            // service.
            std::thread::Builder::new().name(name).spawn(move || work(&workshop))
        };
        let any = (0..self.limits.workers)
            .map(|number| start(format!("worker {number}"), |workshop| workshop.work(Lane::Any)));
        // Plans and forecasts do not wait for runs.
        let quick = if self.limits.workers > 0 { QUICK_WORKERS } else { 0 };
        let quick = (0..quick).map(|number| {
            start(format!("quick {number}"), |workshop| {
                workshop.work(Lane::Quick { share: QUICK_WORKERS - 1 })
            })
        });
        let mut all = any.chain(quick).collect::<std::io::Result<Vec<_>>>()?;
        let workshop = Arc::clone(self);
        all.push(std::thread::Builder::new().name("expiry".to_owned()).spawn(move || workshop.expire())?);
        Ok(all)
    }

    /// Tells workers that there is a job.
    pub fn wake(&self) {
        // Not each of them takes every job.
        self.wake.notify_all();
    }

    /// True if the service ends.
    pub(crate) fn is_ending(&self) -> bool {
        self.is_ending.load(Ordering::SeqCst)
    }

    /// Ends all workers; their jobs return to the queue.
    pub fn end(&self) {
        self.is_ending.store(true, Ordering::SeqCst);
        self.wake.notify_all();
    }

    /// The quota of an owner.
    pub fn quota(&self, owner: &str) -> Option<u64> {
        let owners = self.owners.read().unwrap_or_else(PoisonError::into_inner);
        let own = owners.iter().find(|known| known.name == owner).and_then(|known| known.quota);
        own.or(self.limits.quota)
    }

    /// Replaces the owners with quotas of their own.
    pub fn set_owners(&self, owners: Vec<Owner>) {
        *self.owners.write().unwrap_or_else(PoisonError::into_inner) = owners;
    }

    fn work(&self, lane: Lane) {
        let holder = random_name(8);
        while !self.is_ending() {
            match self.store.take_job(&holder, lane) {
                Ok(Some(job)) => self.compute(&job, &holder, lane),
                Ok(None) => self.wait(IDLE),
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

    /// Waits until there is something to do, at most so long.
    fn wait(&self, time: Duration) {
        let waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        drop(self.wake.wait_timeout(waiting, time));
    }

    /// Computes a job and records what came of it.
    fn compute(&self, job: &Job, holder: &str, lane: Lane) {
        let turn = Turn::new(lane);
        let outcome = match self.try_compute(job, holder, &turn) {
            Ok(Some(outcome)) => outcome,
            // The service ends: the job is released, not finished.
            Ok(None) if self.is_ending() => return,
            Ok(None) if turn.is_over.get() => {
                if let Err(error) = self.store.release_slow(&job.id, holder) {
                    eprintln!("vlscan serve: job {}: {error}", job.id);
                }
                self.wake();
                return;
            }
            Ok(None) => Outcome::Failed(String::new()),
            // Objects that somebody has removed do not come back, unless the whole bucket is away.
            Err(StoreError::Bucket(error))
                if error.kind() == std::io::ErrorKind::NotFound
                    && self.store.kept.id().is_ok_and(|id| id.is_some()) =>
            {
                eprintln!("vlscan serve: job {}: the bucket of the service: {error}", job.id);
                Outcome::Failed(REMOVED.to_owned())
            }
            Err(StoreError::Bucket(error)) => {
                eprintln!(
                    "vlscan serve: job {}: the bucket of the service: {error}; it is tried again",
                    job.id
                );
                self.wait(BUCKET);
                if let Err(error) = self.store.release(holder) {
                    eprintln!("vlscan serve: job {}: {error}", job.id);
                }
                return;
            }
            Err(error) => {
                eprintln!("vlscan serve: job {}: {error}", job.id);
                Outcome::Failed(
                    "the service could not compute this job; its operator finds the reason in its log"
                        .to_owned(),
                )
            }
        };
        self.conclude(job, holder, &outcome);
        let prepared: Prepared = serde_json::from_str(&job.prepared).unwrap_or_default();
        for used in &prepared.uses {
            let (kind, id) = used.files();
            self.store.release_copy(kind, id);
        }
    }

    /// Returns `None` if the job was given up.
    fn try_compute(&self, job: &Job, holder: &str, turn: &Turn) -> Result<Option<Outcome>> {
        if let Some(same) = self.store.same_job(&job.owner, &job.fingerprint)? {
            // Another worker has computed it while this one waited.
            return Ok(Some(Outcome::Same(same.folder)));
        }
        let stored = self.store.stored_bytes(&job.owner)?;
        if stored > self.limits.max_stored {
            let message = format!(
                "your uploads and jobs take {stored} bytes, more than this service keeps; remove some first"
            );
            return Ok(Some(Outcome::Failed(message)));
        }
        let folder = self.store.job_folder(&job.id);
        let prepared: Prepared = serde_json::from_str(&job.prepared).map_err(std::io::Error::other)?;
        let files = match complete_results(&folder)? {
            Some(files) => files,
            None => {
                if self.lacks_inputs(&prepared) {
                    return Ok(Some(Outcome::Failed(REMOVED.to_owned())));
                }
                make(&self.store, &folder, &prepared)?;
                let fetched = self.while_renewing(job, holder, || self.fetch(&prepared))?;
                let end = self.compute_files(job, holder, &folder, &prepared, turn)?;
                drop(fetched);
                // Cells that are complete have cost what they cost, whatever came of the campaign.
                self.charge_cells(job, &folder)?;
                match end {
                    End::Success => {}
                    End::Failure(message) | End::NotDivisible(message) => {
                        return Ok(Some(Outcome::Failed(message)));
                    }
                    End::GivenUp => return Ok(None),
                }
                let files = match results(&folder.join("out"))? {
                    Ok(files) => files,
                    Err(name) => return Ok(Some(Outcome::Failed(name.to_string()))),
                };
                record_complete(&self.store, &folder, &files)?;
                files
            }
        };
        if folder.join("out").exists() {
            let paths: Vec<String> = files.iter().map(|file| file.path.clone()).collect();
            self.while_renewing(job, holder, || self.store.keep(Kind::Results, &job.id, &paths))?;
        }
        let said =
            self.setting(&folder, &prepared).said(&[folder.join("log"), Tasks::of(&folder).last_log()]);
        Ok(Some(Outcome::Successful(files, said)))
    }

    /// True if uploads or results that a job reads have been removed, as between the check of a request and
    /// its entry in the queue.
    fn lacks_inputs(&self, prepared: &Prepared) -> bool {
        let is_absent = |used: &Use| {
            let (kind, id) = used.files();
            !self.store.local(kind, id).is_dir()
        };
        !self.store.has_bucket() && prepared.uses.iter().any(is_absent)
    }

    /// Everything that a job reads.
    pub(crate) fn fetch(&self, prepared: &Prepared) -> Result<Vec<Fetched<'_>>> {
        let mut fetched = Vec::new();
        for used in &prepared.uses {
            let (kind, id) = used.files();
            fetched.extend(self.store.fetch(kind, id)?);
        }
        Ok(fetched)
    }

    /// Computes the files of a job's results, if the quota of its owner allows it.
    fn compute_files(
        &self,
        job: &Job,
        holder: &str,
        folder: &Path,
        prepared: &Prepared,
        turn: &Turn,
    ) -> Result<End> {
        let process = Process::named(&job.process);
        let setting = self.setting(folder, prepared);
        let log = folder.join("log");
        match self.charge(job, holder, process, &setting, &log)? {
            End::Success => {}
            end => return Ok(end),
        }
        let end = self.compute_steps(job, holder, setting, prepared, turn)?;
        Ok(match turn.exceeded.take() {
            Some(message) if end == End::GivenUp => End::Failure(message),
            _ => end,
        })
    }

    /// Computes the files of a job's results. Returns [`End::GivenUp`] if a limit of the owner is exceeded,
    /// or its turn is over.
    fn compute_steps(
        &self,
        job: &Job,
        holder: &str,
        setting: Setting,
        prepared: &Prepared,
        turn: &Turn,
    ) -> Result<End> {
        let process = Process::named(&job.process);
        let folder = setting.folder.clone();
        let log = folder.join("log");
        let engine = self.engine.as_ref().filter(|_| process.is_some_and(|process| !process.is_quick()));
        let parts = engine.map_or(1, |engine| engine.parts);
        let steps = Steps::of(process, prepared, self.limits.threads, parts);
        let Some(engine) = engine else {
            let stdout = prepared.stdout.as_ref().map(|name| folder.join("out").join(name));
            let goes_on = self.renewing(job, holder, || progress_of(&log));
            let mut goes_on = self.within_limits(job, &folder, turn, goes_on);
            return steps.compute_last(&setting, &log, stdout.as_deref(), &mut goes_on);
        };
        let tasks = Tasks::of(&folder);
        let goes_on = self.renewing(job, holder, || tasks.progress(parts));
        let mut goes_on = self.within_limits(job, &folder, turn, goes_on);
        let end = engine.compute(&job.id, &Submission { setting, steps }, &mut goes_on)?;
        drop(goes_on);
        let is_over = || {
            let is_dismissed = self.store.status(&job.id)? == Some(Status::Dismissed);
            Ok::<_, StoreError>(is_dismissed || turn.exceeded.borrow().is_some())
        };
        if end == End::GivenUp && is_over()? && !engine.withdraw(&job.id, &folder)? {
            eprintln!("vlscan serve: job {}: it was cancelled, but the engine still has it", job.id);
        }
        Ok(end)
    }

    /// True if a job is still to be computed by its holder; records its progress, at first and then now and
    /// then.
    fn renewing<'a>(
        &'a self,
        job: &'a Job,
        holder: &'a str,
        progress: impl Fn() -> (u8, String) + 'a,
    ) -> impl FnMut() -> Result<bool> + 'a {
        let mut renewed: Option<Instant> = None;
        move || {
            if self.is_ending() {
                return Ok(false);
            }
            if renewed.is_some_and(|renewed| renewed.elapsed() < RENEWAL) {
                return Ok(true);
            }
            renewed = Some(Instant::now());
            let (percent, message) = progress();
            self.store.renew(&job.id, holder, percent, &message)
        }
    }

    /// Does work that may take longer than a lease.
    fn while_renewing<T: Send>(
        &self,
        job: &Job,
        holder: &str,
        work: impl FnOnce() -> Result<T> + Send,
    ) -> Result<T> {
        if !self.store.has_bucket() {
            return work();
        }
        let is_done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let renewer = scope.spawn(|| {
                while !is_done.load(Ordering::SeqCst) {
                    if let Err(error) = self.store.renew(&job.id, holder, 0, "") {
                        eprintln!("vlscan serve: job {}: {error}", job.id);
                    }
                    std::thread::park_timeout(RENEWAL);
                }
            });
            let done = work();
            is_done.store(true, Ordering::SeqCst);
            renewer.thread().unpark();
            done
        })
    }

    /// Dismisses a job of an owner: what waits or runs is given up, results are removed. Returns whether
    /// there was one.
    ///
    /// # Errors
    /// Errors of the store.
    pub fn dismiss(self: &Arc<Workshop>, owner: &str, id: &str) -> Result<bool> {
        let tasks = Tasks::of(&self.store.job_folder(id));
        if self.engine.is_none() || tasks.last_submission()?.is_none() {
            return self.store.dismiss(owner, id, None);
        }
        // The engine may have a job that no worker holds; its folder stays until the tasks have ended.
        let is_known = self.store.dismiss(owner, id, Some(WITHDRAWAL))?;
        if is_known {
            let (workshop, id) = (Arc::clone(self), id.to_owned());
            std::thread::Builder::new()
                .name("withdrawal".to_owned())
                .spawn(move || workshop.withdraw(&id))?;
        }
        Ok(is_known)
    }

    /// Cancels a dismissed job at the engine, then lets its folder go.
    fn withdraw(&self, id: &str) {
        let Some(engine) = &self.engine else { return };
        let done = engine.withdraw(id, &self.store.job_folder(id)).and_then(|has_ended| match has_ended {
            true => self.store.let_go(id, WITHDRAWAL),
            false => {
                eprintln!("vlscan serve: job {id}: it was cancelled, but the engine still has it");
                Ok(())
            }
        });
        if let Err(error) = done {
            eprintln!("vlscan serve: job {id}: {error}");
        }
    }

    /// Goes on with what an earlier service has left: cancels dismissed jobs that an engine has, gives what
    /// was held back to the queue, removes what was to be removed and moves what the database does not list
    /// to `lost`. To be called before the workers start. Returns an unfinished job that an engine has, if
    /// this service has no engine.
    ///
    /// # Errors
    /// Errors of the store.
    pub fn resume(&self) -> Result<Option<String>> {
        for id in self.store.ids(&[Status::Accepted, Status::Running])? {
            let tasks = Tasks::of(&self.store.job_folder(&id));
            if self.engine.is_none() && tasks.last_submission()?.is_some() {
                return Ok(Some(id));
            }
        }
        for id in self.store.held(Status::Dismissed)? {
            self.store.hold_as(&id, WITHDRAWAL)?;
            match &self.engine {
                Some(_) => self.withdraw(&id),
                None => self.store.let_go(&id, WITHDRAWAL)?,
            }
        }
        for holder in self.store.holders()?.iter().filter(|holder| *holder != WITHDRAWAL) {
            self.store.release(holder)?;
        }
        if let Some(message) = self.store.tidy()?.message(self.store.root()) {
            eprintln!("vlscan serve: warning: {message}");
        }
        self.tidy_failed()?;
        Ok(None)
    }

    /// Folder and limits of the processes of a job.
    pub(crate) fn setting(&self, folder: &Path, prepared: &Prepared) -> Setting {
        let used = prepared.uses.iter().map(|used| {
            let (kind, id) = used.files();
            self.store.local(kind, id)
        });
        let threads = std::thread::available_parallelism().map_or(1, usize::from) as u64;
        let restrictions = ConfineArgs {
            read: std::iter::once(folder.join("in")).chain(used).collect(),
            write: ["out", "view", "tmp"].map(|name| folder.join(name)).to_vec(),
            memory: Some(self.limits.max_memory),
            time: Some(self.limits.max_time.saturating_mul(threads)),
            file_size: Some(self.limits.max_disk),
            no_sandbox: self.limits.no_sandbox,
            program: vec![self.program.path.clone().into(), MESSAGES.into()],
        };
        Setting {
            root: self.store.root().to_owned(),
            folder: folder.to_owned(),
            restrictions,
            within_inputs: prepared.within_inputs,
            max_time: self.limits.max_time,
            max_disk: self.limits.max_disk,
            terms: Terms::of(&prepared.words),
        }
    }
}

#[cfg(test)]
mod tests;
