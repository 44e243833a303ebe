//! Contribution of a batch to an output, and the writer that takes it.

use super::plan::OutputPlan;
use super::summary::FileSummary;
use vlscan_base::error::Result;
use vlscan_base::files::FileGroup;
use vlscan_formats::{EncodedPoints, Offload};
use vlscan_lidar::pulse::{Batch, WaveformRecord};

/// The contribution of one batch to one file.
#[derive(Debug)]
pub(super) struct Piece {
    pub slot: u32,
    pub points: EncodedPoints,
}

impl Piece {
    pub fn new(slot: u32, capacity: usize) -> Piece {
        Piece { slot, points: EncodedPoints::with_capacity(capacity) }
    }
}

/// An output that takes pieces.
pub(super) trait OpenOutput: Send {
    fn append(&mut self, piece: Piece, offload: &dyn Offload) -> Result<()>;

    /// Passes all bytes to the operating system. Tables pass only complete batches.
    fn flush(&mut self, _is_live: bool) -> Result<()> {
        Ok(())
    }

    /// True if the output is a file, which is left out if a run ends before it has records.
    fn is_file(&mut self) -> bool {
        false
    }

    fn has_records(&self) -> bool;

    /// Closes the file handle until the next append.
    fn close_handle(&mut self) -> Result<()> {
        Ok(())
    }

    /// Ends a leg: closes the file handle until the next append, and passes the rows of tables whose batches
    /// end with legs.
    fn end_leg(&mut self) -> Result<()> {
        self.close_handle()
    }

    /// Completes the output. A `partial` file is marked in its metadata, if its format has any, and in its
    /// name: it never has the name of a complete one. A shard of a run is complete or absent. Files get their
    /// names with the others of `group`.
    fn finish(
        self: Box<Self>,
        plan: &OutputPlan,
        offload: &dyn Offload,
        partial: bool,
        group: &mut FileGroup,
    ) -> Result<Vec<FileSummary>>;
}

/// The samples of a waveform of a batch.
pub(super) fn samples_of<'b>(batch: &'b Batch, wave: &WaveformRecord) -> &'b [f64] {
    let from = batch.samples.get(wave.first_sample..).unwrap_or_default();
    &from[..wave.samples.min(from.len())]
}
