//! Expiry: finished jobs are removed after --keep days of the clock of the service.

use super::{IDLE, Workshop};
use crate::records::ExpiryClock;
use crate::store::{Result, now};
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A day, ms.
pub(super) const DAY: i64 = 86_400_000;
/// Period of the search for jobs that are kept no longer.
const EXPIRY: Duration = Duration::from_secs(60);
/// File of the clock by which jobs expire.
pub(super) const CLOCK: &str = "clock";

impl Workshop {
    /// Removes finished jobs after --keep days, and forgets dismissed ones after a day, until the service
    /// ends.
    pub(super) fn expire(self: &Arc<Workshop>) {
        let keep = self.limits.keep.map(|days| (days * DAY as f64) as i64);
        let period = keep.map_or(EXPIRY, |keep| EXPIRY.min(Duration::from_millis(keep.unsigned_abs())));
        let mut checked: Option<Instant> = None;
        let path = self.store.root().join(CLOCK);
        let mut clock = self.expiry_clock(&path);
        while !self.is_ending() {
            if checked.is_none_or(|checked| checked.elapsed() > period) {
                checked = Some(Instant::now());
                let time = clock.time(now(), Instant::now());
                let done = self.remove_old(keep, time);
                if let Err(error) =
                    done.and_then(|()| self.store.write_whole(&path, clock.record().as_bytes()))
                {
                    eprintln!("vlscan serve: {error}");
                }
            }
            self.wait(IDLE);
        }
    }

    /// The clock by which jobs expire, as the file `path` records it. Without a record it begins with the
    /// newest job: the clock of the system may be wrong from the start.
    pub(super) fn expiry_clock(&self, path: &Path) -> ExpiryClock {
        let recorded = fs::read_to_string(path).ok();
        if let Some(clock) = recorded.and_then(|record| ExpiryClock::recorded(&record, Instant::now())) {
            return clock;
        }
        let newest = self.store.newest_update().unwrap_or_else(|error| {
            eprintln!("vlscan serve: {error}");
            None
        });
        let now = now();
        ExpiryClock::new(newest.map_or(now, |newest| newest.min(now)), Instant::now())
    }

    /// Removes jobs that were finished longer than `keep` before `time`, ms.
    fn remove_old(self: &Arc<Workshop>, keep: Option<i64>, time: i64) -> Result<()> {
        if let Some(keep) = keep {
            for (owner, id) in self.store.finished_before(time.saturating_sub(keep))? {
                self.dismiss(&owner, &id)?;
            }
        }
        self.store.forget_before(time - DAY)
    }
}
