//! The last stage: appends the encoded results of the workers to the outputs, in pulse order.

use super::plausibility::YieldCheck;
use super::progress::Progress;
use super::worker::{Measured, Pieces};
use crate::output::{OutputSummary, Writer};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_warehouse::{Collect, OpenOutputs};

/// End of a pass.
#[derive(Clone, Copy)]
pub(super) struct PassEnd<'a> {
    /// Check for too few points, run before the outputs get their names.
    pub check: Option<&'a YieldCheck<'a>>,
    /// True if no epoch follows.
    pub is_last: bool,
    /// True if the outputs are worth keeping when the run fails.
    pub keeps_partial: bool,
    /// The outputs of the run, which stay open from pass to pass.
    pub open_outputs: &'a OpenOutputs<'a>,
}

pub(super) struct Collector<'a> {
    progress: &'a Progress,
    end: PassEnd<'a>,
    writer: Box<Writer>,
    leg: u32,
}

/// Outcome of a pass over one epoch.
pub enum Ended {
    /// The last epoch: the outputs are complete and have their names.
    Complete(OutputSummary),
    /// Another epoch follows; the outputs are open.
    NextEpoch(Box<Writer>),
    /// The user stopped the run. The outputs are open and contain everything measured until then.
    Interrupted(Box<Writer>),
}

impl<'a> Collector<'a> {
    pub fn new(progress: &'a Progress, end: PassEnd<'a>, writer: Box<Writer>) -> Collector<'a> {
        Collector { progress, end, writer, leg: 0 }
    }

    fn append(&mut self, m: Measured, more_waiting: bool) -> Result<()> {
        let leg = m.encoded.leg();
        if leg < self.leg {
            let mut problems = Diagnostics::default();
            problems.error(None, format!("a pulse of leg {leg} comes after one of leg {}", self.leg)).help(
                "with one file per leg the legs must ascend; sort the pulses by leg, or name a single file",
            );
            return Err(Error::Input(Box::new(problems)));
        }
        self.leg = leg;
        self.writer.append(m.encoded)?;
        if !more_waiting {
            // No further result is ready, so readers of a live stream receive everything so far.
            self.writer.flush()?;
        }
        let progress = self.progress;
        progress.add(m.pulses, m.echoes, m.leg, m.done);
        progress.add_beam_counts(&m.beam_counts);
        Ok(())
    }
}

impl Collect<Pieces> for Collector<'_> {
    type Summary = Ended;
    type Error = Error;

    fn take(&mut self, pieces: Pieces, more_waiting: bool) -> Result<()> {
        let last = pieces.0.len().saturating_sub(1);
        let mut pieces = pieces.0.into_iter().enumerate();
        pieces.try_for_each(|(i, piece)| self.append(piece?, more_waiting || i < last))
    }

    fn finish(mut self) -> Result<Ended> {
        if self.end.is_last {
            // Check only at the end: a flight may start outside the scene.
            self.end.check.map_or(Ok(()), |check| check.run(self.progress))?;
            return self.writer.finish().map(Ended::Complete);
        }
        self.writer.next_epoch()?;
        Ok(Ended::NextEpoch(self.writer))
    }

    fn cut(self) -> Result<Ended> {
        Ok(Ended::Interrupted(self.writer))
    }

    fn abort(self) {
        if self.end.keeps_partial { self.writer.abort() } else { self.writer.discard() }
    }
}
