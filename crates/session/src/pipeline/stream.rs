//! Pulses from a stream instead of a flight.

use super::moving::MovingParts;
use super::pass::Pass;
use super::worker::{Measured, Pieces, Worker};
use crate::streams::{PulseColumn, PulseReader, PulseRow, RowBlock, RowFault};
use std::collections::HashMap;
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;
use vlscan_lidar::pulse::{InstrumentTable, PhysicsOptions};
use vlscan_scene::MotionState;
use vlscan_survey::Survey;
use vlscan_warehouse::{Feed, Outcome, RunState, Tasks};

/// Mapping of the legs of a stream to legs of the outputs and of the physics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LegRule {
    /// True if the survey of the pulses is known: its legs have their own divergence.
    pub known: bool,
    /// True if each leg has its own files, so that leg numbers must ascend.
    pub separate_files: bool,
    /// True if divergences in the stream are used.
    pub streamed_divergence: bool,
}

/// Inputs of tracing a stream, in addition to those of every pass.
pub struct Tracing<'a> {
    pub survey: &'a Survey,
    pub options: PhysicsOptions,
    /// World position of the scene frame's origin, m.
    pub shift: DVec3,
    pub legs: LegRule,
}

impl Tasks for RowBlock {
    fn tasks(&self) -> u32 {
        self.rows()
    }
}

/// A stream of pulses with the rows already read from it.
#[derive(Debug)]
pub struct PulseSource {
    reader: PulseReader,
    next: Option<RowBlock>,
}

impl PulseSource {
    pub fn new(reader: PulseReader) -> PulseSource {
        PulseSource { reader, next: None }
    }

    /// Returns the epoch of the next pulse, after waiting for it; `None` at the end of the stream.
    ///
    /// # Errors
    /// As for [`PulseReader::next_block`].
    fn next_epoch(&mut self, run: &RunState<'_>) -> Result<Option<u32>> {
        if self.next.is_none() {
            self.next = self.reader.next_block(&|| run.is_stopped())?;
        }
        Ok(self.next.as_ref().map(RowBlock::first_epoch))
    }

    /// Fails if a pulse follows the last epoch.
    pub(super) fn check_end(&mut self, last: u32, run: &RunState<'_>) -> Result<()> {
        match self.next_epoch(run)? {
            Some(next) if !run.is_stopped() => Err(Error::input(format!(
                "after epoch {last} comes a pulse of epoch {next}; epochs ascend, and the scene has {}",
                last + 1
            ))),
            _ => Ok(()),
        }
    }

    /// Passes all pulses of `epoch` to `feed`.
    pub(super) fn produce<R: Outcome, W: FnMut(RowBlock) -> Result<R>>(
        &mut self,
        epoch: u32,
        feed: &mut Feed<'_, RowBlock, R, W>,
    ) -> Result<()> {
        let run = feed.state();
        while !run.is_stopped() {
            match self.take(epoch, run)? {
                Some(block) => feed.put(block)?,
                None => break,
            }
        }
        Ok(())
    }

    /// Returns the next pulses of `epoch`; `None` when another epoch begins or the stream ends.
    fn take(&mut self, epoch: u32, run: &RunState<'_>) -> Result<Option<RowBlock>> {
        if self.next_epoch(run)? != Some(epoch) {
            return Ok(None);
        }
        let Some(block) = self.next.take() else { return Ok(None) };
        let (block, rest) = block.split_at_epoch();
        self.next = rest;
        Ok(Some(block))
    }
}

/// A worker whose pulses come from rows of a stream.
pub(super) struct StreamWorker<'a> {
    worker: Worker<'a>,
    tracing: &'a Tracing<'a>,
    own: InstrumentTable,
    /// Instruments by their divergences, rad.
    others: HashMap<[u64; 2], InstrumentTable>,
    /// The moving parts, and the number of steps by which they have moved.
    motion: Option<(MotionState, u64)>,
    rows: Vec<PulseRow>,
}

/// Maximum number of cached instruments of other divergences; the cache is cleared when it is full.
const MAX_CACHED_INSTRUMENTS: usize = 256;
/// Maximum number of steps by which a scene can move: an hour at 3 MHz.
const MAX_STEP: u64 = 11_000_000_000;
/// Largest number of a leg in a stream: point source ids are one more.
const MAX_LEG: u32 = u16::MAX as u32 - 1;

impl<'a> StreamWorker<'a> {
    pub fn new(pass: &'a Pass<'a>, tracing: &'a Tracing<'a>) -> StreamWorker<'a> {
        let worker = Worker::new(pass);
        StreamWorker {
            tracing,
            own: pass.physics.instruments().clone(),
            others: HashMap::new(),
            motion: worker.moving.as_ref().map(|moving| (moving.start(), 0)),
            rows: Vec::new(),
            worker,
        }
    }

    /// Reads the rows, simulates their pulses together and encodes the echoes: one piece per run of rows of
    /// the same leg. The rows before one that is not valid are measured, too.
    pub fn measure(&mut self, block: &RowBlock) -> Result<Pieces> {
        let mut rows = std::mem::take(&mut self.rows);
        rows.clear();
        let (tracing, has_motion) = (self.tracing, self.motion.is_some());
        let read = block.pulses(tracing.shift, &mut rows, |row| tracing.check(row, has_motion));
        let alike = |a: &PulseRow, b: &PulseRow| (a.leg, a.divergence) == (b.leg, b.divergence);
        let mut measured: Vec<_> = rows.chunk_by(alike).map(|rows| self.measure_leg(rows)).collect();
        measured.extend(read.err().map(Err));
        self.rows = rows;
        Ok(Pieces(measured))
    }

    fn measure_leg(&mut self, rows: &[PulseRow]) -> Result<Measured> {
        let first = &rows[0];
        let instrument_leg = self.set_instruments(first)?;
        let worker = &mut self.worker;
        worker.pulses.clear();
        worker.pulses.extend(rows.iter().map(|r| r.pulse));
        worker.batch.clear(if self.tracing.legs.separate_files { first.leg } else { 0 });
        worker.batch.leg_number = Some(first.leg);
        if let (Some(moving), Some(motion)) = (&mut worker.moving, &mut self.motion) {
            follow(moving, motion, rows);
        }
        worker.measure(first.leg, instrument_leg, f64::NAN)
    }

    /// Selects the instruments of the row's leg. Returns the number of that leg among these instruments.
    fn set_instruments(&mut self, row: &PulseRow) -> Result<u32> {
        let rule = self.tracing.legs;
        let Some([start, leg]) = row.divergence.filter(|_| rule.streamed_divergence) else {
            self.worker.simulator.set_instruments(&self.own);
            return Ok(if rule.known { row.leg } else { 0 });
        };
        let key = [start.to_bits(), leg.to_bits()];
        if !self.others.contains_key(&key) {
            if self.others.len() >= MAX_CACHED_INSTRUMENTS {
                self.others.clear();
            }
            let instruments =
                InstrumentTable::new(&self.tracing.with_divergences(start, leg), &self.tracing.options)?;
            self.others.insert(key, instruments);
        }
        if let Some(instruments) = self.others.get(&key) {
            self.worker.simulator.set_instruments(instruments);
        }
        Ok(1)
    }
}

/// Moves the parts to the state in which the first row is traced, and collects the motions between the other
/// rows. `reached` is the state of the parts at the previous row, and the number of its step.
fn follow(moving: &mut MovingParts<'_>, reached: &mut (MotionState, u64), rows: &[PulseRow]) {
    let first = rows[0].step;
    if first < reached.1 {
        *reached = (moving.start(), 0);
    }
    let (state, step) = reached;
    while *step < first {
        moving.skip(state);
        *step += 1;
    }
    moving.begin_batch(state);
    for (before, row) in rows.iter().enumerate() {
        // Rows with a smaller step than their predecessor in a block are traced in the predecessor's scene.
        while *step < row.step {
            moving.step(state, before);
            *step += 1;
        }
    }
}

impl Tracing<'_> {
    /// Checks numbers of devices, legs and steps against survey and scene.
    fn check(&self, row: &PulseRow, has_motion: bool) -> Result<(), RowFault> {
        let devices = self.survey.scanner.devices.len();
        if row.pulse.device as usize >= devices {
            let message = format!("device {}, the scanner has {devices}", row.pulse.device);
            return Err((PulseColumn::Device, message));
        }
        let legs = self.survey.legs.len();
        if (self.legs.known || self.legs.separate_files) && row.leg as usize >= legs {
            return Err((PulseColumn::Leg, format!("leg {}, the survey has {legs}", row.leg)));
        }
        if row.leg > MAX_LEG {
            let message =
                format!("leg {}, expected at most {MAX_LEG}: records of points hold 16 bits", row.leg);
            return Err((PulseColumn::Leg, message));
        }
        if has_motion && row.step > MAX_STEP {
            return Err((PulseColumn::Step, format!("step {}, expected at most {MAX_STEP}", row.step)));
        }
        Ok(())
    }

    /// Returns the survey with two legs of these divergences.
    fn with_divergences(&self, start: f64, leg: f64) -> Survey {
        let mut survey = self.survey.clone();
        survey.legs.truncate(1);
        survey.legs.extend(survey.legs.first().cloned());
        for (l, divergence) in survey.legs.iter_mut().zip([start, leg]) {
            (l.scanner.beam_divergence, l.scanner.written_divergence) = (divergence, None);
        }
        survey
    }
}
