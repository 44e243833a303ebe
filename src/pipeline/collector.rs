//! The last stage: what the workers encoded goes to the sinks, in chunk order.

use super::Progress;
use super::worker::Measured;
use crate::error::Result;
use crate::output::{Summary, Writer};
use crate::schedule::Collect;

/// Appends encoded chunks to the sinks and keeps the progress.
pub struct Collector<'a> {
    /// The open sinks.
    pub writer: Writer,
    /// What has been done so far.
    pub progress: &'a Progress,
}

impl Collect<Measured> for Collector<'_> {
    type Summary = Summary;

    fn take(&mut self, m: Measured, more_waiting: bool) -> Result<()> {
        self.writer.append(m.encoded)?;
        if !more_waiting {
            // A reader of a live stream gets what there is.
            self.writer.flush()?;
        }
        self.progress.add(m.pulses, m.echoes, m.leg, m.done);
        Ok(())
    }

    fn finish(self) -> Result<Summary> {
        self.writer.finish()
    }

    fn abort(self) {
        self.writer.abort();
    }
}
