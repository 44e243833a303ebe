//! The last stage: what the workers encoded goes to the sinks, in chunk order.

use super::worker::Measured;
use super::{Judge, Moment, Progress};
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
    judge: Option<Judge<'a>>,
    judged_early: bool,
}

/// Pulses after which a run is looked at while it goes on.
const EARLY_PULSES: u64 = 20_000;

impl<'a> Collector<'a> {
    /// A collector that has taken nothing.
    pub fn new(
        writer: Writer,
        progress: &'a Progress,
        is_last: bool,
        judge: Option<Judge<'a>>,
    ) -> Collector<'a> {
        Collector { writer, progress, is_last, judge, judged_early: false }
    }

    fn judge(&self, moment: Moment) -> Result<()> {
        self.judge.map_or(Ok(()), |judge| judge(self.progress, moment))
    }
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
        self.progress.add_aim(&m.aim);
        if !self.judged_early && self.progress.snapshot().pulses >= EARLY_PULSES {
            self.judged_early = true;
            self.judge(Moment::Early)?;
        }
        Ok(())
    }

    fn finish(mut self) -> Result<Closed> {
        if self.is_last {
            self.judge(Moment::End)?;
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
