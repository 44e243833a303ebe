//! The place of a job in the queue, and when it is expected to be finished.

use crate::processes::Process;
use crate::store::{Job, Result, Status, Store};
use rusqlite::params;

/// Finished jobs whose times are averaged.
const SAMPLES: u32 = 20;

/// The place of a job that waits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Jobs that are computed before it; owners take turns.
    pub before: u64,
    /// Mean time of a job of its process, seconds; unknown before the first one.
    pub mean: Option<f64>,
}

impl Place {
    /// The time until the job is finished, seconds, with so many workers.
    pub fn seconds(&self, workers: usize) -> Option<f64> {
        let rounds = 1.0 + self.before as f64 / workers.max(1) as f64;
        self.mean.map(|mean| mean * rounds)
    }
}

impl Store {
    /// The place of a job; `None` if it does not wait.
    ///
    /// # Errors
    /// [`crate::store::StoreError`].
    pub fn place(&self, job: &Job) -> Result<Option<Place>> {
        if job.status != Status::Accepted {
            return Ok(None);
        }
        // Workers of their own compute quick jobs.
        let lane: Vec<&str> = match Process::named(&job.process).is_some_and(Process::is_quick) {
            true => Process::ALL.iter().filter(|one| one.is_quick()).map(|one| one.id()).collect(),
            false => Vec::new(),
        };
        let lane = serde_json::json!(lane).to_string();
        let database = self.database();
        // Owners take turns: no more jobs of another owner come first than of this one.
        let mut query = database.prepare_cached(
            "WITH lane AS (SELECT owner, number FROM jobs WHERE status IN ('accepted', 'running')
                AND (?3 = '[]' OR process IN (SELECT value FROM json_each(?3)))),
             own AS (SELECT count(*) AS ahead FROM lane WHERE owner = ?1 AND number < (SELECT number FROM jobs WHERE id = ?2))
             SELECT own.ahead + (SELECT coalesce(sum(min(waiting, own.ahead + 1)), 0) FROM
                (SELECT count(*) AS waiting FROM lane WHERE owner <> ?1 GROUP BY owner))
             FROM own",
        )?;
        let before = query.query_row(params![job.owner, job.id, lane], |row| row.get(0))?;
        let mut query = database.prepare_cached(
            "SELECT avg(finished - started) / 1000.0 FROM (SELECT finished, started FROM jobs
                WHERE process = ?1 AND owner = ?2 AND status = 'successful' AND started IS NOT NULL AND finished > started
                ORDER BY number DESC LIMIT ?3)",
        )?;
        let mean = query.query_row(params![job.process, job.owner, SAMPLES], |row| row.get(0))?;
        Ok(Some(Place { before, mean }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_expected_time_depends_on_jobs_before_and_workers() {
        let place = Place { before: 3, mean: Some(10.0) };
        assert_eq!(place.seconds(1), Some(40.0));
        assert_eq!(place.seconds(3), Some(20.0));
        assert_eq!(place.seconds(0), Some(40.0), "no worker is counted as one");
        assert_eq!(Place { mean: None, ..place }.seconds(1), None);
    }
}
