//! The writer thread's part: appends encoded batches in chunk order.

use super::encode::Encoded;
use super::file::open_output;
use super::layout::{Content, OutputLocation};
use super::piece::OpenOutput;
use super::plan::{OutputPlan, create_run_directory, stamp};
use super::request::TableContent;
use super::summary::OutputSummary;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileGroup, NewFolder};
use vlscan_formats::Offload;

/// All open outputs of a run. Dropping it unfinished is equivalent to [`Writer::abort`], except that a panic
/// leaves nothing.
pub struct Writer {
    plan: Arc<OutputPlan>,
    offload: Arc<dyn Offload>,
    /// Open files by slot; `None` when complete.
    files: Vec<Option<Box<dyn OpenOutput>>>,
    /// Slots in the order in which legs complete them, and the number of complete ones.
    closing: Vec<u32>,
    closed: usize,
    /// Slots of streams that their readers have closed.
    closed_pipes: Vec<u32>,
    partial: bool,
    /// True if an output could not be written.
    failed: bool,
    leg: u32,
    epoch: u32,
    summary: OutputSummary,
    /// Run directories of the current epoch. Declared after `files`, as `folders`: a folder can be removed
    /// only when it is empty.
    runs: Vec<PathBuf>,
    /// Folders that were made for the outputs, inner ones first.
    folders: Vec<NewFolder>,
}

/// Files of a run up to which their handles stay open.
const MAX_OPEN_FILES: usize = 256;

impl OutputPlan {
    /// True if the handles of all files stay open, so that workers can write to them.
    pub(super) fn keeps_files_open(&self) -> bool {
        self.layout.files.len() <= MAX_OPEN_FILES
    }

    /// Creates run directories and opens every output. Called before the first pulse is emitted.
    ///
    /// # Errors
    /// [`Error::Io`] when something cannot be created, [`Error::Input`] when all names of run directories are
    /// taken.
    pub fn open(self: &Arc<Self>, offload: Arc<dyn Offload>) -> Result<Writer> {
        let mut closing: Vec<u32> = (0..self.layout.files.len() as u32).collect();
        closing.sort_by_key(|&slot| self.layout.files[slot as usize].last_leg);
        let mut writer = Writer {
            plan: self.clone(),
            offload,
            files: self.layout.files.iter().map(|_| None).collect(),
            closing,
            closed: 0,
            closed_pipes: Vec::new(),
            partial: false,
            failed: false,
            leg: 0,
            epoch: 1,
            summary: OutputSummary::default(),
            runs: Vec::new(),
            folders: Vec::new(),
        };
        for directory in &self.layout.directories {
            let made = NewFolder::create_all(directory).map_err(|e| Error::io("create", directory, e))?;
            writer.folders.insert(0, made);
        }
        writer.create_runs()?;
        writer.open_files(|_| true)?;
        Ok(writer)
    }
}

impl Writer {
    /// Run directories of the current epoch, for the log.
    pub fn directories(&self) -> impl Iterator<Item = &Path> {
        self.runs.iter().map(PathBuf::as_path)
    }

    /// Appends a batch. Batches must arrive in chunk order, so that a file is complete when a later leg
    /// begins.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::ClosedPipe`] when all outputs are closed pipes (one open output is enough to
    /// continue); [`Error::Internal`] when a batch is out of order. Nothing can be written after an error;
    /// drop the writer.
    pub fn append(&mut self, encoded: Encoded) -> Result<()> {
        let appended = self.try_append(encoded);
        self.note_failure(appended)
    }

    fn try_append(&mut self, encoded: Encoded) -> Result<()> {
        if encoded.leg < self.leg || encoded.leg as usize >= self.plan.layout.routes.len() {
            return Err(Error::Internal(format!("a batch of leg {} after leg {}", encoded.leg, self.leg)));
        }
        if encoded.leg > self.leg {
            self.enter(encoded.leg)?;
        }
        for (part, count) in encoded.points_of_part {
            let (part, counts) = (part as usize, &mut self.summary.points_of_part);
            if part < self.plan.settings.objects.count() {
                counts.resize(counts.len().max(part + 1), 0);
                counts[part] += count;
            }
        }
        self.summary.left_out += encoded.left_out;
        for piece in encoded.pieces {
            if self.closed_pipes.contains(&piece.slot) {
                continue;
            }
            let slot = piece.slot;
            self.open_divided(slot)?;
            let file = self.files.get_mut(piece.slot as usize).and_then(Option::as_mut);
            let file =
                file.ok_or_else(|| Error::Internal(format!("leg {} writes a closed file", encoded.leg)))?;
            let mut appended = file.append(piece, &*self.offload);
            if !self.plan.keeps_files_open() {
                appended = appended.and_then(|()| file.close_handle());
            }
            self.drop_closed_pipe(slot, appended)?;
        }
        Ok(())
    }

    /// Passes all appended bytes to the operating system, for readers of live streams.
    pub fn flush(&mut self) -> Result<()> {
        let flushed = self.try_flush();
        self.note_failure(flushed)
    }

    fn try_flush(&mut self) -> Result<()> {
        let plan = self.plan.clone();
        for slot in 0..self.files.len() as u32 {
            if let Some(file) = &mut self.files[slot as usize] {
                let flushed = file.flush(plan.request.live);
                self.drop_closed_pipe(slot, flushed)?;
            }
        }
        Ok(())
    }

    /// Begins the next epoch of a scene with swapped parts: its legs are written to new run directories,
    /// while the files of other targets are continued.
    pub fn next_epoch(&mut self) -> Result<()> {
        if self.epoch >= self.plan.request.epochs {
            return Err(Error::Internal(format!("more than {} epochs", self.plan.request.epochs)));
        }
        let next = self.close_while(|_| true).and_then(|()| self.end_leg()).and_then(|()| {
            (self.epoch, self.leg, self.closed) = (self.epoch + 1, 0, 0);
            self.keep_folders();
            self.create_runs()?;
            self.open_files(|location| matches!(location, OutputLocation::Run { .. }))
        });
        self.note_failure(next)
    }

    /// Sets the executor of compression jobs from now on.
    pub fn offload_to(&mut self, offload: Arc<dyn Offload>) {
        self.offload = offload;
    }

    /// Completes all files and renames them to their final names.
    ///
    /// # Errors
    /// [`Error::Io`]; files of earlier legs are kept, the others are removed.
    pub fn finish(mut self) -> Result<OutputSummary> {
        self.epoch = self.plan.request.epochs.max(self.epoch);
        let closed = self.close_while(|_| true);
        self.note_failure(closed)?;
        if !self.partial {
            self.keep_folders();
        }
        Ok(std::mem::take(&mut self.summary))
    }

    /// [`Writer::finish`] of an interrupted run: every output is valid and marked as partial, and files
    /// without records are left out.
    ///
    /// # Errors
    /// As for [`Writer::finish`].
    pub fn finish_partial(mut self) -> Result<OutputSummary> {
        self.partial = true;
        self.finish()
    }

    /// Closes a stream that its reader has closed. Returns an error only if no other output is left.
    fn drop_closed_pipe(&mut self, slot: u32, outcome: Result<()>) -> Result<()> {
        match outcome {
            Err(Error::ClosedPipe) => {
                self.files[slot as usize] = None;
                self.closed_pipes.push(slot);
                if self.closed_pipes.len() == self.files.len() { Err(Error::ClosedPipe) } else { Ok(()) }
            }
            other => other,
        }
    }

    /// Ends a failed run. The points until then are completed as partial files, which
    /// [`OutputPlan::partial_files`] lists. If an output could not be written, incomplete files are removed.
    pub fn abort(self) {}

    /// Ends a run whose outputs can be made again, and removes the incomplete files.
    pub fn discard(mut self) {
        self.failed = true;
    }

    /// Remembers whether an output could not be written.
    fn note_failure(&mut self, outcome: Result<()>) -> Result<()> {
        self.failed |= matches!(&outcome, Err(e) if !matches!(e, Error::ClosedPipe));
        outcome
    }

    fn create_runs(&mut self) -> Result<()> {
        let plan = self.plan.clone();
        let name = plan.request.run_stamp.clone().unwrap_or_else(stamp);
        for run in &plan.layout.runs {
            let (path, made) = create_run_directory(&run.parent, &name)?;
            self.summary.directories.push(path.clone());
            self.runs.push(path);
            self.folders.splice(0..0, made);
        }
        Ok(())
    }

    fn keep_folders(&mut self) {
        self.runs.clear();
        self.folders.drain(..).for_each(NewFolder::keep);
    }

    fn open_files(&mut self, is_opened: impl Fn(&OutputLocation) -> bool) -> Result<()> {
        let plan = self.plan.clone();
        for (slot, file) in
            plan.layout.files.iter().enumerate().filter(|(_, f)| !f.divided && is_opened(&f.location))
        {
            let mut open = open_output(&plan, file, &self.runs)?;
            open.close_handle()?;
            self.files[slot] = Some(open);
        }
        Ok(())
    }

    /// Opens a file of a division before its first point: tiles beyond the flight and objects that nothing
    /// hit have no files.
    fn open_divided(&mut self, slot: u32) -> Result<()> {
        let plan = self.plan.clone();
        let Some(file) = plan.layout.files.get(slot as usize).filter(|file| file.divided) else {
            return Ok(());
        };
        if self.files[slot as usize].is_none() {
            self.files[slot as usize] = Some(open_output(&plan, file, &self.runs)?);
        }
        Ok(())
    }

    /// Completes the files that no leg from `leg` on writes to.
    fn enter(&mut self, leg: u32) -> Result<()> {
        self.close_while(|last_leg| last_leg < leg as usize)?;
        self.end_leg()?;
        self.leg = leg;
        Ok(())
    }

    /// Ends the current leg in the files that remain open.
    fn end_leg(&mut self) -> Result<()> {
        let plan = self.plan.clone();
        let left = plan.layout.routes.get(self.leg as usize).map_or(&[][..], |r| r);
        for &slot in left.iter().flat_map(|route| route.slots.as_slice()) {
            if let Some(file) = &mut self.files[slot as usize] {
                let ended = file.end_leg();
                self.drop_closed_pipe(slot, ended)?;
            }
        }
        Ok(())
    }

    /// Completes files in the order of their last legs, as long as these are `complete`, and gives them their
    /// names together. Files outside run directories stay open until the last epoch.
    fn close_while(&mut self, complete: impl Fn(usize) -> bool) -> Result<()> {
        let plan = self.plan.clone();
        let mut group = FileGroup::default();
        while let Some(&slot) = self.closing.get(self.closed) {
            let file = &plan.layout.files[slot as usize];
            if !complete(file.last_leg) {
                break;
            }
            self.closed += 1;
            if self.epoch < plan.request.epochs && !matches!(file.location, OutputLocation::Run { .. }) {
                continue;
            }
            let Some(mut open) = self.files[slot as usize].take() else { continue };
            if self.partial && open.is_file() && !open.has_records() {
                continue;
            }
            let done = match open.finish(&plan, &*self.offload, self.partial, &mut group) {
                Err(Error::ClosedPipe) => {
                    self.drop_closed_pipe(slot, Err(Error::ClosedPipe))?;
                    continue;
                }
                done => done?,
            };
            let is_points = matches!(
                file.content,
                Content::Points(_) | Content::Shard | Content::Table(TableContent::Points)
            );
            // Points are counted in the first sink whose reader has not closed it.
            let is_closed = |sink: usize| {
                self.closed_pipes.iter().any(|&slot| plan.layout.files[slot as usize].sink == sink)
            };
            if is_points && (0..).find(|&sink| !is_closed(sink)) == Some(file.sink) {
                self.summary.points += done.iter().map(|file| file.records).sum::<u64>();
            }
            self.summary.files.extend(done);
        }
        group.commit()
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        if self.failed || std::thread::panicking() {
            return;
        }
        let plan = self.plan.clone();
        for file in self.files.iter_mut().filter_map(Option::take).filter(|file| file.has_records()) {
            // The run has failed already; an output that cannot be completed is removed, with its packets.
            let mut group = FileGroup::default();
            if let Ok(files) = file.finish(&plan, &*self.offload, true, &mut group)
                && group.commit().is_ok()
            {
                plan.partial_files.lock().unwrap_or_else(PoisonError::into_inner).extend(files);
            }
        }
    }
}

impl std::fmt::Debug for Writer {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.debug_struct("Writer").field("leg", &self.leg).field("epoch", &self.epoch).finish_non_exhaustive()
    }
}
