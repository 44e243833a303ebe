//! Files beside the points of a run: the log of its schedule and the table of the scene's parts.

use super::interrupt;
use crate::output::OutputRequest;
use crate::pipeline::{Control, PartTable, Progress, Report};
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched};
use vlscan_scene::Scene;
use vlscan_warehouse::Recorder;

/// The files that are asked for, and what is collected for them while the run lasts.
pub struct Companions {
    schedule_log: Option<PathBuf>,
    part_table: Option<PathBuf>,
    force: bool,
    recorder: Option<Recorder>,
    parts: Option<PartTable>,
}

impl Companions {
    /// The files of a job, which its output then knows of: none of them replaces another, or what the run reads.
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
    pub fn describe(&mut self, scene: &Scene) {
        self.parts = self.part_table.is_some().then(|| PartTable::new(scene));
    }

    /// The control of a run that is recorded if its log is asked for.
    pub fn control<'a>(&'a self, progress: &'a Progress) -> Control<'a> {
        Control { recorder: self.recorder.as_ref(), ..Control::new(progress, &interrupt::STOP) }
    }

    /// Writes the files, unless the run was interrupted.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] if a file exists and is not to be replaced.
    pub fn write(self, report: &Report) -> Result<()> {
        if report.interrupted {
            return Ok(());
        }
        if let (Some(path), Some(recorder)) = (&self.schedule_log, self.recorder) {
            let text =
                serde_json::to_string(&recorder.finish()).map_err(|e| Error::Internal(e.to_string()))?;
            write_file(path, self.force, &(text + "\n"))?;
        }
        if let (Some(path), Some(parts), false) =
            (&self.part_table, self.parts, report.summary.files.is_empty())
        {
            write_file(path, self.force, &parts.csv(&report.summary.points_of_part))?;
        }
        Ok(())
    }
}

fn write_file(path: &Path, force: bool, text: &str) -> Result<()> {
    let mut file = FileWriter::create(path, force, Patched::Never)?;
    file.append(text.as_bytes())?;
    file.finish().map(drop)
}
