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
    /// No play follows.
    pub is_last: bool,
}

/// What is left of the sinks at the end of a play.
pub enum Closed {
    /// They are complete.
    Whole(Summary),
    /// They are open for the next play.
    Play(Box<Writer>),
    /// They are open, and nothing more will come because the user ended the run.
    Cut(Box<Writer>),
}

impl Collect<Measured> for Collector<'_> {
    type Summary = Closed;

    fn take(&mut self, m: Measured, more_waiting: bool) -> Result<()> {
        self.writer.append(m.encoded)?;
        if !more_waiting {
            // A reader of a live stream gets what there is.
            self.writer.flush()?;
        }
        self.progress.add(m.pulses, m.echoes, m.leg, m.done);
        Ok(())
    }

    fn finish(mut self) -> Result<Closed> {
        if self.is_last {
            return self.writer.finish().map(Closed::Whole);
        }
        self.writer.next_play()?;
        Ok(Closed::Play(Box::new(self.writer)))
    }

    fn cut(self) -> Result<Closed> {
        Ok(Closed::Cut(Box::new(self.writer)))
    }

    fn abort(self) {
        self.writer.abort();
    }
}
