//! One open output: a file or stream, or a table in memory.

use super::codec::Piece;
use super::file::OutputFile;
use super::layout::{FilePlan, OutputLocation};
use super::memory::OpenTable;
use super::offload::Offload;
use super::plan::OutputPlan;
use super::stream::Destination;
use super::summary::{FileKind, FileSummary, Tally};
use std::path::PathBuf;
use vlscan_base::error::{Error, Result};

pub(super) enum OpenOutput {
    File(Box<OutputFile>),
    Table(Box<OpenTable>, FileKind),
}

impl OpenOutput {
    /// Opens an output; `runs` are the run directories.
    pub fn open(plan: &OutputPlan, file: &FilePlan, runs: &[PathBuf]) -> Result<OpenOutput> {
        let destination = match &file.location {
            OutputLocation::Memory(number) => {
                let request = plan.tables.get(*number);
                let request =
                    request.ok_or_else(|| Error::Internal(format!("there is no table {number}")))?;
                let table = OpenTable::new(request, (&plan.columns, plan.schema.clone()));
                return Ok(OpenOutput::Table(Box::new(table), file.content.kind()));
            }
            OutputLocation::Fixed(destination) => destination.clone(),
            OutputLocation::Run { run, name } => Destination::Path(runs[*run].join(name)),
        };
        OutputFile::open(plan, &destination, file).map(|file| OpenOutput::File(Box::new(file)))
    }

    pub fn append(&mut self, plan: &OutputPlan, piece: Piece, offload: &dyn Offload) -> Result<()> {
        match self {
            OpenOutput::File(file) => file.append(plan, piece, offload),
            OpenOutput::Table(table, _) => table.append(&piece.bytes, &piece.tally),
        }
    }

    /// Passes all bytes to the operating system. Tables pass complete batches alone.
    pub fn flush(&mut self, plan: &OutputPlan) -> Result<()> {
        match self {
            OpenOutput::File(file) => file.flush(plan),
            OpenOutput::Table(..) => Ok(()),
        }
    }

    /// Whether the output is a file, which is left out if a run ends before it has records.
    pub fn is_file(&self) -> bool {
        matches!(self, OpenOutput::File(file) if file.is_file())
    }

    pub fn has_records(&self) -> bool {
        match self {
            OpenOutput::File(file) => file.has_records(),
            OpenOutput::Table(table, _) => table.tally().records > 0,
        }
    }

    /// Closes the file handle until the next append.
    pub fn close_handle(&mut self) -> Result<()> {
        match self {
            OpenOutput::File(file) => file.close_handle(),
            OpenOutput::Table(..) => Ok(()),
        }
    }

    /// Ends a leg: closes the file handle until the next append, and passes the rows of tables whose batches end with legs.
    pub fn end_leg(&mut self) -> Result<()> {
        match self {
            OpenOutput::File(file) => file.close_handle(),
            OpenOutput::Table(table, _) => table.end_leg(),
        }
    }

    /// Completes the output, see [`OutputFile::finish`].
    pub fn finish(self, plan: &OutputPlan, offload: &dyn Offload, partial: bool) -> Result<Vec<FileSummary>> {
        let (table, kind) = match self {
            OpenOutput::File(file) => return file.finish(plan, offload, partial),
            OpenOutput::Table(table, kind) => (table, kind),
        };
        let Tally { records, left_out, by_return, bounds } = table.finish()?;
        Ok(vec![FileSummary {
            path: None,
            partial,
            beside: None,
            kind,
            records,
            bytes: 0,
            bounds,
            by_return,
            left_out,
        }])
    }
}
