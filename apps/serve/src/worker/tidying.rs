//! The end of jobs: their files that are not needed any more go.

use super::Workshop;
use crate::beneath::BLOCK;
use crate::execution::bytes_in;
use crate::messages::MAX_LOG;
use crate::queue::Outcome;
use crate::store::{Job, Result, Status, StoreError, remove_folder};
use std::fs;
use std::path::Path;

/// Files and folders of a job that a finished one does not need: of a successful job the first four, of a
/// failed one all. Failed jobs keep their messages.
const UNUSED: [&str; 9] =
    ["tmp", "tasks", "stdout", "price.json", "in", "out", "view", "complete", "prepared.json"];

impl Workshop {
    /// Finishes a job if its holder still has the lease. After another worker has taken the job, its folder
    /// belongs to that worker.
    pub(super) fn conclude(&self, job: &Job, holder: &str, outcome: &Outcome) {
        let report = |error: StoreError| eprintln!("vlscan serve: job {}: {error}", job.id);
        // Large folders are moved at once and removed after the lease.
        let removed = self.store.new_incoming();
        if self.store.renew(&job.id, holder, 0, "").unwrap_or(false) {
            self.tidy_folder(job, outcome, &removed).unwrap_or_else(report);
        }
        self.store.finish(&job.id, holder, outcome).map(drop).unwrap_or_else(report);
        remove_folder(&removed).map_err(StoreError::from).unwrap_or_else(report);
    }

    /// Moves what a finished job does not need to the folder `removed`, and records the disk space of the
    /// rest.
    fn tidy_folder(&self, job: &Job, outcome: &Outcome, removed: &Path) -> Result<()> {
        let folder = self.store.job_folder(&job.id);
        if !folder.is_dir() {
            return Ok(());
        }
        if matches!(outcome, Outcome::Same(_)) {
            fs::rename(&folder, removed)?;
            // An earlier worker may have recorded the space of its files.
            return self.store.set_disk(&job.id, 0);
        }
        let unused = match outcome {
            Outcome::Successful(..) => &UNUSED[..4],
            Outcome::Same(_) | Outcome::Failed(_) => &UNUSED[..],
        };
        let moved = move_away(&folder, unused, removed);
        if fs::metadata(folder.join("log")).is_ok_and(|log| log.len() > MAX_LOG) {
            fs::File::options().write(true).open(folder.join("log"))?.set_len(MAX_LOG)?;
        }
        let in_bucket = match outcome {
            Outcome::Successful(files, _) if self.store.has_bucket() => {
                files.iter().map(|file| file.bytes.saturating_add(BLOCK)).sum()
            }
            _ => 0,
        };
        let on_disk = bytes_in(&folder).unwrap_or(self.limits.max_disk);
        self.store.set_disk(&job.id, on_disk.saturating_add(in_bucket))?;
        moved.map(drop)
    }

    /// Removes what earlier versions have left of failed jobs.
    pub(super) fn tidy_failed(&self) -> Result<()> {
        for id in self.store.ids(&[Status::Failed])? {
            let folder = self.store.job_folder(&id);
            let removed = self.store.new_incoming();
            if move_away(&folder, &UNUSED, &removed)? {
                remove_folder(&removed)?;
                self.store.set_disk(&id, bytes_in(&folder)?)?;
            }
        }
        Ok(())
    }
}

/// Moves files and folders of a job to the folder `removed`. Returns true if there were any.
fn move_away(folder: &Path, names: &[&str], removed: &Path) -> Result<bool> {
    let mut is_moved = false;
    for name in names.iter().filter(|name| folder.join(name).symlink_metadata().is_ok()) {
        fs::create_dir_all(removed)?;
        fs::rename(folder.join(name), removed.join(name)).or_else(is_absent)?;
        is_moved = true;
    }
    Ok(is_moved)
}

/// Success for what does not exist.
fn is_absent(error: std::io::Error) -> std::io::Result<()> {
    if error.kind() == std::io::ErrorKind::NotFound { Ok(()) } else { Err(error) }
}
