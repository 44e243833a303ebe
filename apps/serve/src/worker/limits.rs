//! Limits of owners while their jobs are computed: turns at quick workers, disk space and quotas.

use super::{RENEWAL, Workshop};
use crate::beneath::Beneath;
use crate::execution::{End, Setting, bytes_in};
use crate::job_folder::campaign_pulses;
use crate::processes::Process;
use crate::queue::Lane;
use crate::store::{Job, Result};
use std::cell::{Cell, RefCell};
use std::ffi::OsString;
use std::path::Path;
use std::time::{Duration, Instant};

/// Time after which a quick job is given to the other workers, if quick jobs of other owners wait: requests
/// are not answered by jobs that take longer.
pub(super) const MAX_QUICK: Duration = Duration::from_secs(30);
/// Largest forecast that is read, bytes.
const MAX_REPORT: u64 = 1 << 20;

/// Turn of a job at a worker.
pub(super) struct Turn {
    pub lane: Lane,
    pub start: Instant,
    /// True if other workers are to compute the job.
    pub is_over: Cell<bool>,
    /// Message of a limit of its owner that is exceeded.
    pub exceeded: RefCell<Option<String>>,
}

impl Turn {
    pub fn new(lane: Lane) -> Turn {
        let (is_over, exceeded) = (Cell::new(false), RefCell::new(None));
        Turn { lane, start: Instant::now(), is_over, exceeded }
    }
}

impl Workshop {
    /// Charges the owner of a campaign for the cells that are complete.
    pub(super) fn charge_cells(&self, job: &Job, folder: &Path) -> Result<()> {
        let Some(quota) = self.quota(&job.owner) else { return Ok(()) };
        if Process::named(&job.process) == Some(Process::Campaign) {
            // A data set whose cells cannot be counted costs the whole quota.
            let pulses = campaign_pulses(&folder.join("out")).unwrap_or(quota).max(1);
            self.store.charge(job, pulses, None)?.unwrap_or_default();
        }
        Ok(())
    }

    /// `goes_on` while the owner of a job is within the limits and its turn is not over.
    pub(super) fn within_limits<'a>(
        &'a self,
        job: &'a Job,
        folder: &'a Path,
        turn: &'a Turn,
        mut goes_on: impl FnMut() -> Result<bool> + 'a,
    ) -> impl FnMut() -> Result<bool> + 'a {
        let mut next = Instant::now() + RENEWAL;
        move || {
            if !goes_on()? {
                return Ok(false);
            }
            let start = Instant::now();
            if start < next {
                return Ok(true);
            }
            let message = self.exceeded(job, folder)?;
            // Folders of many files are looked into less often.
            next = Instant::now() + RENEWAL.max(20 * start.elapsed());
            let is_within = message.is_none();
            *turn.exceeded.borrow_mut() = message;
            turn.is_over.set(self.is_over(job, turn)?);
            Ok(is_within && !turn.is_over.get())
        }
    }

    /// True if a job has had its turn at a worker of quick jobs, and those of other owners wait.
    pub(super) fn is_over(&self, job: &Job, turn: &Turn) -> Result<bool> {
        let is_slow = turn.lane != Lane::Any && turn.start.elapsed() > MAX_QUICK;
        Ok(is_slow && self.store.has_waiting_others(&job.owner, turn.lane)?)
    }

    /// The message of a job whose owner exceeds a limit while it is computed. Records its disk space, and the
    /// cells of a campaign that are complete, so that jobs at the same time count each other.
    pub(super) fn exceeded(&self, job: &Job, folder: &Path) -> Result<Option<String>> {
        // Too many files are found by those who watch the process.
        if let Ok(bytes) = bytes_in(folder) {
            self.store.set_disk(&job.id, bytes)?;
        }
        if self.store.stored_bytes(&job.owner)? > self.limits.max_stored {
            let most = self.limits.max_stored;
            return Ok(Some(format!(
                "your uploads and jobs take more than {most} bytes, the limit of this service; remove some first"
            )));
        }
        let quota =
            self.quota(&job.owner).filter(|_| Process::named(&job.process) == Some(Process::Campaign));
        let Some(quota) = quota else { return Ok(None) };
        let pulses = campaign_pulses(&folder.join("out")).unwrap_or(quota).max(1);
        let charged = self.store.charge(job, pulses, Some(quota))?;
        Ok(charged.err().map(|spent| used_up(quota, spent.saturating_add(pulses))))
    }

    /// Prices a run by a dry run, and charges the owner.
    pub(super) fn charge(
        &self,
        job: &Job,
        holder: &str,
        process: Option<Process>,
        setting: &Setting,
        log: &Path,
    ) -> Result<End> {
        let Some(quota) = self.quota(&job.owner) else { return Ok(End::Success) };
        if process == Some(Process::Run) {
            let words = ["run", "../in/job.toml", "--dry-run", "--json"].map(OsString::from);
            let price = setting.folder.join("price.json");
            let mut goes_on = self.renewing(job, holder, || (0, String::new()));
            match setting.execute(&words, log, Some(&price), &mut || Ok(()), &mut goes_on)? {
                End::Success => {}
                end => return Ok(end),
            }
            let report = Beneath::of(&setting.folder)?.read("price.json", MAX_REPORT)?;
            let report: serde_json::Value = serde_json::from_slice(&report).map_err(std::io::Error::other)?;
            // A run whose pulses are unknown would cost nothing.
            let pulses = report["pulses"].as_f64();
            let pulses = pulses.ok_or_else(|| std::io::Error::other("a dry run without its pulses"))?;
            if let Err(spent) = self.store.charge(job, pulses as u64, Some(quota))? {
                return Ok(End::Failure(format!(
                    "the run has {pulses:.0} pulses; of the quota of {quota} pulses within 24 hours {} are left",
                    quota.saturating_sub(spent)
                )));
            }
        }
        if process == Some(Process::Campaign)
            && let Err(spent) = self.store.charge(job, 1, Some(quota))?
        {
            return Ok(End::Failure(used_up(quota, spent)));
        }
        Ok(End::Success)
    }
}

/// The message of a campaign beyond the quota of its owner.
fn used_up(quota: u64, spent: u64) -> String {
    format!("the quota of {quota} pulses within 24 hours is used up ({spent})")
}
