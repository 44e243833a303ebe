//! Records of uploads and jobs.

use serde::Serialize;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use vlscan_messages::ProblemMessage;

/// Kind of stored files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Files of an upload.
    Upload,
    /// The results of a job.
    Results,
}

impl Kind {
    /// The name of the folder or prefix of all of them.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Upload => "uploads",
            Kind::Results => "results",
        }
    }
}

/// An upload: files under a name of its owner.
#[derive(Clone, Debug, Serialize)]
pub struct Upload {
    /// The folder of its files.
    #[serde(skip)]
    pub id: String,
    /// Name that its owner gives it.
    pub name: String,
    /// Number of files.
    pub files: u64,
    /// Number of folders, its own included.
    #[serde(skip)]
    pub folders: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Hash over the names and contents of all files.
    pub sha256: String,
    /// When it was complete, ms since 1970.
    #[serde(serialize_with = "as_time")]
    pub created: i64,
}

/// A file of an upload.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct UploadFile {
    /// Its path within the upload.
    pub path: String,
    /// Its bytes.
    pub bytes: u64,
    /// Content of an XML file.
    pub kind: FileKind,
}

/// Content of an XML file or of a table, as far as pages offer it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FileKind {
    /// A survey.
    Survey,
    /// A scene.
    Scene,
    /// A table of trees.
    Inventory,
    /// Anything else.
    #[default]
    Other,
}

impl FileKind {
    pub(crate) fn name(self) -> &'static str {
        match self {
            FileKind::Survey => "survey",
            FileKind::Scene => "scene",
            FileKind::Inventory => "inventory",
            FileKind::Other => "other",
        }
    }

    pub(crate) fn named(name: &str) -> FileKind {
        match name {
            "survey" => FileKind::Survey,
            "scene" => FileKind::Scene,
            "inventory" => FileKind::Inventory,
            _ => FileKind::Other,
        }
    }
}

/// The state of a job, by the words of OGC API - Processes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// It waits.
    Accepted,
    /// A worker computes it.
    Running,
    /// Its results are complete.
    Successful,
    /// It ended with a message.
    Failed,
    /// Its owner gave it up.
    Dismissed,
}

impl Status {
    /// All states.
    pub const ALL: [Status; 5] =
        [Status::Accepted, Status::Running, Status::Successful, Status::Failed, Status::Dismissed];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Status::Accepted => "accepted",
            Status::Running => "running",
            Status::Successful => "successful",
            Status::Failed => "failed",
            Status::Dismissed => "dismissed",
        }
    }

    /// The state of that name.
    pub fn named(name: &str) -> Option<Status> {
        Status::ALL.into_iter().find(|status| status.name() == name)
    }

    /// True if nothing follows.
    pub fn is_final(self) -> bool {
        !matches!(self, Status::Accepted | Status::Running)
    }
}

/// A job.
#[derive(Clone, Debug)]
pub struct Job {
    /// Its name.
    pub id: String,
    /// Its owner.
    pub owner: String,
    /// The process.
    pub process: String,
    /// The inputs as requested, JSON.
    pub inputs: String,
    /// Command: a [`crate::request::Prepared`] as JSON.
    pub prepared: String,
    /// Hash of version, process, inputs and the contents of all files; empty if results may not be given
    /// again.
    pub fingerprint: String,
    /// The folder, that of the job which computed the results.
    pub folder: String,
    /// State.
    pub status: Status,
    /// Message, mostly of a failure.
    pub message: String,
    /// Percent.
    pub progress: u8,
    /// Files of the results, JSON: a list of [`ResultFile`].
    pub results: String,
    /// Warnings, JSON: a list of [`ProblemMessage`].
    pub warnings: String,
    /// Times, ms since 1970.
    pub created: i64,
    /// Start of the computation.
    pub started: Option<i64>,
    /// End.
    pub finished: Option<i64>,
    /// Last change.
    pub updated: i64,
}

/// Selection of jobs for a list.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// States; any if there are none.
    pub statuses: Vec<Status>,
    /// Processes; any if there are none.
    pub processes: Vec<String>,
    /// Earliest and latest time of acceptance, ms since 1970.
    pub created: (Option<i64>, Option<i64>),
    /// Shortest and longest time of the computation, ms; up to now if it is not finished.
    pub duration: (Option<i64>, Option<i64>),
    /// Newer jobs to leave out.
    pub skip: u32,
    /// Maximum number of jobs.
    pub limit: u32,
}

/// A file of a job's results.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, serde::Deserialize)]
pub struct ResultFile {
    /// Its path.
    pub path: String,
    /// Its bytes.
    pub bytes: u64,
}

impl Job {
    /// The files of the results; none, with a line in the log, if their record is damaged.
    pub fn result_files(&self) -> Vec<ResultFile> {
        if self.results.is_empty() {
            return Vec::new();
        }
        serde_json::from_str(&self.results).unwrap_or_else(|error| {
            eprintln!("vlscan serve: the results of the job {} cannot be read: {error}", self.id);
            Vec::new()
        })
    }

    /// The warnings on the inputs.
    pub fn problems(&self) -> Vec<ProblemMessage> {
        serde_json::from_str(&self.warnings).unwrap_or_default()
    }
}

/// Milliseconds since 1970.
pub fn now() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}

/// Clock by which jobs expire. It follows the clock of the system, one that is put forward only after a day:
/// a wrong clock would have everything removed at once.
#[derive(Debug)]
pub(crate) struct ExpiryClock {
    time: i64,
    checked: Instant,
    /// Time for which the clock of the system has been ahead.
    ahead: Option<Duration>,
}

impl ExpiryClock {
    /// Largest difference of clocks that count as equal, ms.
    const TOLERANCE: i64 = 60_000;
    /// Time after which a clock that was put forward is followed.
    const PATIENCE: Duration = Duration::from_secs(86_400);

    /// A clock that begins at the time `wall`, ms since 1970.
    pub(crate) fn new(wall: i64, at: Instant) -> ExpiryClock {
        ExpiryClock { time: wall, checked: at, ahead: None }
    }

    /// The clock of an earlier service, as [`ExpiryClock::record`] has it: a clock may have been put forward
    /// meanwhile. `None` for a text that is no record.
    pub(crate) fn recorded(record: &str, at: Instant) -> Option<ExpiryClock> {
        let (time, ahead) = record.trim().split_once(' ')?;
        let ahead = match ahead {
            "-" => None,
            seconds => Some(Duration::from_secs(seconds.parse().ok()?)),
        };
        Some(ExpiryClock { time: time.parse().ok()?, checked: at, ahead })
    }

    /// Its time, and the seconds for which the clock of the system has been ahead.
    pub(crate) fn record(&self) -> String {
        let ahead = self.ahead.map_or("-".to_owned(), |ahead| ahead.as_secs().to_string());
        format!("{} {ahead}\n", self.time)
    }

    /// The time at `at`, ms since 1970, when the clock of the system has the time `wall`.
    pub(crate) fn time(&mut self, wall: i64, at: Instant) -> i64 {
        let passed = at.saturating_duration_since(self.checked);
        let steady = self.time.saturating_add(i64::try_from(passed.as_millis()).unwrap_or(i64::MAX));
        let is_ahead = wall > steady.saturating_add(ExpiryClock::TOLERANCE);
        let longer = self.ahead.map_or(Duration::ZERO, |ahead| ahead.saturating_add(passed));
        let ahead = is_ahead.then_some(longer);
        let is_followed = ahead.is_none_or(|ahead| ahead > ExpiryClock::PATIENCE);
        let time = if is_followed { wall } else { steady };
        *self = ExpiryClock { time, checked: at, ahead: ahead.filter(|_| !is_followed) };
        time
    }
}

/// A time as RFC 3339 has it.
pub fn time_text(ms: i64) -> String {
    let time = chrono::DateTime::from_timestamp_millis(ms).unwrap_or_default();
    time.to_rfc3339_opts(chrono::SecondsFormat::Millis, true)
}

fn as_time<S: serde::Serializer>(ms: &i64, serializer: S) -> std::result::Result<S::Ok, S::Error> {
    serializer.serialize_str(&time_text(*ms))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_is_put_forward_is_followed_after_a_day() {
        let start = Instant::now();
        let at = |seconds: u64| start + Duration::from_secs(seconds);
        let year = 31_536_000_000;
        let mut clock = ExpiryClock::new(1_000_000, start);
        assert_eq!(clock.time(1_061_000, at(60)), 1_061_000, "a second of drift");
        assert_eq!(clock.time(1_121_000 + year, at(120)), 1_121_000);
        assert_eq!(clock.time(1_180_000, at(180)), 1_180_000, "the clock was corrected");
        assert_eq!(clock.time(1_240_000 + year, at(240)), 1_240_000);
        assert_eq!(clock.time(year + 90_000_000, at(240 + 86_400)), 1_240_000 + 86_400_000);
        assert_eq!(clock.time(year + 90_001_000, at(241 + 86_400)), year + 90_001_000);
        assert_eq!(clock.time(5, at(86_700)), 5, "a clock that was put back");
    }

    #[test]
    fn a_clock_that_is_put_forward_between_services_is_followed_after_a_day_of_both() {
        let start = Instant::now();
        let at = |seconds: u64| start + Duration::from_secs(seconds);
        let year = 31_536_000_000;
        let record = ExpiryClock::new(1_000_000, start).record();
        let mut clock = ExpiryClock::recorded(&record, at(100)).unwrap();
        assert_eq!(clock.time(year, at(100)), 1_000_000);
        assert_eq!(clock.time(year, at(80_100)), 81_000_000);
        let mut next = ExpiryClock::recorded(&clock.record(), at(90_000)).unwrap();
        assert_eq!(next.time(year, at(90_000)), 81_000_000);
        assert_eq!(next.time(year, at(96_401)), year, "a day altogether");
        let record = next.record();
        assert_eq!(record, format!("{year} -\n"));
        assert_eq!(ExpiryClock::recorded(&record, start).unwrap().time(5, start), 5);
        for damaged in ["", "5", "x -", "5 x", "5 -1"] {
            assert!(ExpiryClock::recorded(damaged, start).is_none(), "{damaged}");
        }
    }
}
