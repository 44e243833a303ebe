//! Runs that go on where they were ended: a run is divided into parts, of which those that exist are not computed again.

use super::merge::{merge, records_of_las_suffice};
use super::part::Part;
use super::pass::Control;
use super::progress::Progress;
use super::session::{Report, Session};
use crate::diag::Notice;
use crate::error::{Error, Result};
use crate::files::{NewFolder, fault, publish};
use crate::output::{OutputContext, OutputPlan, OutputRequest, Summary, Target};
use crate::parts::{PartFile, PartSet, part_path};
use crate::store::catch_loss;
use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};

/// Maximum number of parts.
const MAX_PARTS: u64 = 100_000;

/// How a run is divided so that it can go on later.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Resumption {
    /// Folder of the parts, removed when the outputs are complete.
    pub folder: PathBuf,
    /// Pulses per part; a folder with parts keeps their number.
    pub pulses_per_part: u64,
}

impl Resumption {
    /// Parts beside the first output that is a file or a folder: `out.laz.parts`.
    ///
    /// # Errors
    /// [`Error::Input`] when all outputs are streams.
    pub fn beside(outputs: &OutputRequest, pulses_per_part: u64) -> Result<Resumption> {
        let path = |(target, _): &(Target, _)| match target {
            Target::Stdout => None,
            Target::File(path) | Target::Directory(path) | Target::Helios(path) => Some(path.clone()),
        };
        let path = outputs.sinks.iter().find_map(path).ok_or_else(|| {
            Error::input("a run that can be resumed needs an output with a name: -o, a file or a folder")
        })?;
        let mut name = path.file_name().unwrap_or_default().to_os_string();
        name.push(".parts");
        Ok(Resumption { folder: path.with_file_name(name), pulses_per_part })
    }

    /// Name of the folder while it is removed: the outputs are complete.
    fn done_folder(&self) -> PathBuf {
        let mut name = self.folder.file_name().unwrap_or_default().to_os_string();
        name.push(".done");
        self.folder.with_file_name(name)
    }
}

impl Session {
    /// [`Session::run`] in parts: those that an earlier run has completed are not computed again. The outputs are written
    /// when all parts are complete, and are those of [`Session::run`], byte for byte.
    ///
    /// # Errors
    /// As for [`Session::run`]; [`Error::Input`] for flights that cannot be divided, and when the parts are of another run,
    /// unless outputs may be replaced.
    pub fn run_resumable(
        &mut self,
        outputs: OutputRequest,
        how: &Resumption,
        control: Control<'_>,
    ) -> Result<Report> {
        catch_loss(|| self.resume(outputs, how, control))
    }

    fn resume(&mut self, outputs: OutputRequest, how: &Resumption, control: Control<'_>) -> Result<Report> {
        let folder = how.folder.as_path();
        let done = how.done_folder();
        if done.exists() {
            self.notify(Notice::Note("an earlier run has completed the outputs".to_owned()));
            remove(&done)?;
            return Ok(Report { summary: Summary::default(), pulses: 0, seconds: 0.0, interrupted: false });
        }
        let has_begun = !PartSet::list_if_exists(folder)?.is_empty();
        // What an earlier attempt has left under the names of the outputs is its own.
        let request = OutputRequest { force: outputs.force || has_begun, ..outputs.clone() };
        let context = OutputContext::new(self.survey(), self.scene());
        OutputPlan::new(OutputRequest { epochs: self.epochs(), ..request.clone() }, &context)?;
        self.record_for(&outputs);
        NewFolder::create_all(folder).map_err(|e| Error::io("create", folder, e))?.keep();
        let lock = lock(folder)?;
        let computed = match self.complete_parts(&outputs, how, control) {
            Err(Error::Input(found)) if outputs.force && has_begun => {
                self.notify(Notice::Note(format!(
                    "the parts in {} are replaced: {}",
                    folder.display(),
                    found.headline()
                )));
                remove_files(folder)?;
                self.complete_parts(&outputs, how, control)
            }
            computed => computed,
        };
        let seconds = match computed {
            Ok(seconds) => seconds,
            Err(Error::Interrupted) => {
                self.notify(Notice::Note(format!(
                    "complete parts are kept in {}; the same command goes on from there",
                    folder.display()
                )));
                let pulses = control.progress.snapshot().pulses;
                return Ok(Report { summary: Summary::default(), pulses, seconds: 0.0, interrupted: true });
            }
            Err(error) => return Err(error),
        };
        self.drop_tree();
        let progress = Progress::default();
        let parts = PartSet::open(folder)?;
        let schedule = self.settings().schedule;
        let report = merge(&parts, request, schedule, Control { progress: &progress, ..control })?;
        if !report.interrupted {
            // A run that is ended while it removes the parts must not compute them again.
            publish(folder, &done)?;
            drop(lock);
            remove(&done)?;
        }
        Ok(Report { seconds: seconds + report.seconds, ..report })
    }

    /// Computes all parts that do not exist. Returns the time that it took, s.
    fn complete_parts(
        &mut self,
        outputs: &OutputRequest,
        how: &Resumption,
        control: Control<'_>,
    ) -> Result<f64> {
        let known = PartSet::list(&how.folder)?;
        let mut runner = self.parts(&how.folder, outputs.creation, false, control.stop)?;
        let wanted = runner.pulses().div_ceil(how.pulses_per_part.max(1)).clamp(1, MAX_PARTS) as u32;
        let of = known.keys().next().copied().unwrap_or(wanted);
        // Parts that exist may hold echoes, for an output that was wanted then.
        let first =
            known.get(&of).and_then(BTreeSet::first).map(|&number| part_path(&how.folder, number, of));
        let holds_echoes =
            first.is_some_and(|path| PartFile::open(&path).is_ok_and(|part| part.head.las.is_none()));
        if !holds_echoes && records_of_las_suffice(outputs) {
            runner.hold_las(outputs)?;
        }
        let mut seconds = 0.0;
        for number in 0..of {
            let part = Part { number, of };
            if let Some(file) = runner.existing(part)? {
                let leg = file.block(file.blocks().saturating_sub(1)).map_or(0, |block| block.leg);
                let done = f64::from(number + 1) / f64::from(of);
                control.progress.add(file.pulses, file.echoes, leg, done);
                continue;
            }
            let report = runner.run(part, control)?;
            seconds += report.seconds;
            if report.interrupted {
                return Err(Error::Interrupted);
            }
        }
        Ok(seconds)
    }
}

fn remove(folder: &Path) -> Result<()> {
    fs::remove_dir_all(folder).map_err(|e| Error::io("remove", folder, e))
}

/// Makes sure that no other run works in the folder until the file is dropped.
fn lock(folder: &Path) -> Result<File> {
    let path = folder.join("lock");
    let file =
        fault::point().and_then(|()| File::create(&path)).map_err(|e| Error::io("create", &path, e))?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => {
            Err(Error::input(format!("another run is at work in {}", folder.display())))
        }
        // Some file systems have no locks.
        Err(TryLockError::Error(_)) | Ok(()) => Ok(file),
    }
}

/// Removes the files of parts and of the flight's borders, but not the lock.
fn remove_files(folder: &Path) -> Result<()> {
    let failed = |e| Error::io("remove", folder, e);
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.file_name().is_some_and(|name| name != "lock") {
            let removed = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
            removed.map_err(|e| Error::io("remove", &path, e))?;
        }
    }
    Ok(())
}
