//! Surroundings of a command that writes points: its progress, the files next to the points, its summary.

use super::console::Console;
use super::interrupt;
use super::watch::{during, watched};
use std::path::PathBuf;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::write_file;
use vlscan_scene::Scene;
use vlscan_session::output::OutputRequest;
use vlscan_session::{PartTable, Progress, Report, RunContext, Session, Settings};
use vlscan_warehouse::Recorder;

/// Opens the session of a run: loads the scene and builds its tree.
///
/// # Errors
/// The errors of [`Session::open`].
pub fn open(settings: Settings, console: &Console) -> Result<Session> {
    during(console, "reading the survey", || Session::open(settings, console.observer()))
}

/// The requested files besides the points, and the data collected for them during the run.
#[derive(Default)]
pub struct Companions {
    schedule_log: Option<PathBuf>,
    part_table: Option<PathBuf>,
    force: bool,
    recorder: Option<Recorder>,
    parts: Option<PartTable>,
}

impl Companions {
    /// The files of a job, which its output then knows of: none of them replaces another, or what the run
    /// reads.
    pub fn of(
        schedule_log: Option<PathBuf>,
        part_table: Option<PathBuf>,
        output: &mut OutputRequest,
    ) -> Companions {
        output.companions.extend(schedule_log.iter().chain(&part_table).cloned());
        output.counts_parts = part_table.is_some();
        let recorder = schedule_log.is_some().then(Recorder::new);
        Companions { schedule_log, part_table, force: output.force, recorder, parts: None }
    }

    /// Keeps the facts of the parts of the first epoch's scene.
    ///
    /// # Errors
    /// The errors of [`PartTable::new`].
    pub fn describe(&mut self, scene: &Scene) -> Result<()> {
        self.parts = self.part_table.is_some().then(|| PartTable::new(scene)).transpose()?;
        Ok(())
    }

    /// Runs `work` while its progress is shown, and writes the files, unless the run was interrupted. The log
    /// of its schedule is recorded if it is asked for; `legs` is the number of legs of the survey.
    ///
    /// # Errors
    /// The errors of the work; [`Error::Io`]; [`Error::Input`] if a file exists and is not to be replaced.
    pub fn run(
        self,
        console: &Console,
        progress_lines: bool,
        legs: usize,
        work: impl FnOnce(RunContext<'_>) -> Result<Report>,
    ) -> Result<Report> {
        let progress = Progress::default();
        let control =
            RunContext { recorder: self.recorder.as_ref(), ..RunContext::new(&progress, &interrupt::STOP) };
        let is_complete = |report: &Result<Report>| report.as_ref().is_ok_and(|report| !report.interrupted);
        let report = watched(console, progress_lines, legs, &progress, || work(control), is_complete)?;
        console.record(|result| result.legs = Some(legs as u64));
        if !report.interrupted {
            self.write(&report)?;
        }
        Ok(report)
    }

    fn write(self, report: &Report) -> Result<()> {
        if let (Some(path), Some(recorder)) = (&self.schedule_log, self.recorder) {
            let text =
                serde_json::to_string(&recorder.finish()).map_err(|e| Error::Internal(e.to_string()))?;
            write_file(path, self.force, (text + "\n").as_bytes())?;
        }
        if let (Some(path), Some(parts), false) =
            (&self.part_table, self.parts, report.summary.files.is_empty())
        {
            write_file(path, self.force, parts.csv(&report.summary.points_of_part).as_bytes())?;
        }
        Ok(())
    }
}
