//! The river's second half by itself: [`trace`] takes pulses from a stream instead of a flight.

use super::collector::{Closed, Collector};
use super::worker::Measured;
use super::{Aim, AimTarget, Judge, Progress};
use crate::diag::Diagnostics;
use crate::error::{Error, Result};
use crate::flight::Pulse;
use crate::geom::DVec3;
use crate::output::{OutputPlan, Writer};
use crate::pulse::{Batch, Equipment, Physics, PhysicsOptions, Shooter};
use crate::scene::{DynamicScene, MotionPlan, MotionState, ObjectUpdate};
use crate::schedule::{self, Collect, JobQueue, Outcome, Stop, Tasks};
use crate::streams::{Block, Column, PulseReader, PulseRow};
use crate::survey::Survey;
use crate::tree::BuildOptions;
use std::collections::HashMap;
use std::sync::Arc;

/// How the legs of a stream become legs of the outputs and of the physics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LegRule {
    /// The survey that the pulses come from is known: its legs have their own divergence.
    pub known: bool,
    /// Each leg has its own files, so that legs must ascend.
    pub apart: bool,
    /// Divergences in the stream count.
    pub streamed_divergence: bool,
}

/// Everything that a play of a stream needs.
pub struct Tracing<'a> {
    /// Instruments, legs.
    pub survey: &'a Survey,
    /// Scene, tree, instruments.
    pub physics: &'a Physics<'a>,
    /// What `physics` was made with.
    pub options: PhysicsOptions,
    /// World position of the scene frame's origin.
    pub shift: DVec3,
    /// Parts of the scene that move, if any do, and how their trees are built.
    pub movers: Option<(&'a MotionPlan, &'a BuildOptions)>,
    /// What the legs are.
    pub legs: LegRule,
    /// Sinks.
    pub output: Arc<OutputPlan>,
    /// Threads and the warehouse's size.
    pub schedule: schedule::Settings,
    /// The user's wish to end.
    pub stop: &'a Stop,
    /// What has been done so far, for whoever watches.
    pub progress: &'a Progress,
    /// What beams are compared with.
    pub target: AimTarget,
    /// Looks at what was measured before the outputs get their names.
    pub judge: Option<Judge<'a>>,
}

impl Tasks for Block {
    fn tasks(&self) -> u32 {
        self.rows()
    }
}

/// A stream of pulses and what has been read of it already.
#[derive(Debug)]
pub struct PulseSource {
    reader: PulseReader,
    next: Option<Block>,
}

impl PulseSource {
    /// A stream from its beginning.
    pub fn new(reader: PulseReader) -> PulseSource {
        PulseSource { reader, next: None }
    }

    /// The play of the next pulse; nothing at the end of the stream. Waits for it.
    ///
    /// # Errors
    /// As [`PulseReader::next_block`].
    pub fn next_play(&mut self, stop: &Stop) -> Result<Option<u32>> {
        if self.next.is_none() {
            self.next = self.reader.next_block(stop)?;
        }
        Ok(self.next.as_ref().map(Block::first_play))
    }

    /// The next pulses of that play; nothing when another one begins or the stream ends.
    fn take(&mut self, play: u32, stop: &Stop) -> Result<Option<Block>> {
        if self.next_play(stop)? != Some(play) {
            return Ok(None);
        }
        let Some(block) = self.next.take() else { return Ok(None) };
        let (block, rest) = block.split_at_play();
        self.next = rest;
        Ok(Some(block))
    }
}

/// Traces the pulses of one play: blocks of rows → warehouse → workers (parse, trace, detect, encode) → sinks in the order
/// of the stream. `sinks` are those of the play before; `is_last` says that none follows.
///
/// # Errors
/// [`Error::Input`] for pulses that are none, with their line; otherwise as [`fly`](super::fly).
pub fn trace(
    tracing: Tracing<'_>,
    source: &mut PulseSource,
    play: u32,
    sinks: Option<Sinks>,
    is_last: bool,
) -> Result<TraceEnded> {
    let jobs = Arc::new(JobQueue::new(2 * tracing.schedule.threads));
    let writer = match sinks {
        None => tracing.output.open(jobs.clone())?,
        Some(Sinks(mut writer)) => {
            writer.offload_to(jobs.clone());
            *writer
        }
    };
    let (stop, shared) = (tracing.stop, &tracing);
    let collector =
        Ordered { inner: Collector::new(writer, tracing.progress, is_last, tracing.judge), leg: 0 };
    let closed = schedule::run(
        tracing.schedule,
        &jobs,
        stop,
        None,
        || {
            let mut worker = Tracer::new(shared);
            move |block: Block| worker.measure(&block)
        },
        |feed| {
            while !stop.asked() {
                match source.take(play, stop)? {
                    Some(block) => feed.put(block)?,
                    None => break,
                }
            }
            Ok(())
        },
        collector,
    )?;
    Ok(match closed {
        Closed::Whole(summary) => TraceEnded::Whole(summary),
        Closed::Play(writer) => TraceEnded::Play(Sinks(writer)),
        Closed::Cut(writer) => TraceEnded::Cut(writer.finish_partial()?),
    })
}

/// Open sinks between two plays.
#[derive(Debug)]
pub struct Sinks(Box<Writer>);

/// How a play of a stream ended.
pub enum TraceEnded {
    /// It was the last.
    Whole(crate::output::Summary),
    /// Another one follows.
    Play(Sinks),
    /// The user ended the run: the outputs hold what was measured until then, and say so.
    Cut(crate::output::Summary),
}

/// One thread's computing stage.
struct Tracer<'a> {
    tracing: &'a Tracing<'a>,
    shooter: Shooter<'a>,
    own: Equipment,
    /// Instruments by their divergences.
    others: HashMap<[u64; 2], Equipment>,
    scenery: Option<Scenery<'a>>,
    rows: Vec<PulseRow>,
    pulses: Vec<Pulse>,
    batch: Batch,
}

/// What moves in the scene, and how far this worker has followed it.
struct Scenery<'a> {
    plan: &'a MotionPlan,
    stage: DynamicScene<'a>,
    state: MotionState,
    step: u64,
    changes: Vec<ObjectUpdate>,
}

/// More instruments than that are computed anew.
const MOST_INSTRUMENTS: usize = 256;
/// A scene is not moved on by more steps: an hour at 3 MHz.
const FARTHEST_STEP: u64 = 11_000_000_000;

impl<'a> Tracer<'a> {
    fn new(tracing: &'a Tracing<'a>) -> Tracer<'a> {
        let scenery = tracing.movers.map(|(plan, trees)| Scenery {
            plan,
            stage: DynamicScene::new(plan, trees.clone()),
            state: MotionState::start(plan),
            step: 0,
            changes: Vec::new(),
        });
        Tracer {
            tracing,
            shooter: tracing.physics.shooter(),
            own: tracing.physics.equipment(),
            others: HashMap::new(),
            scenery,
            rows: Vec::new(),
            pulses: Vec::new(),
            batch: Batch::default(),
        }
    }

    /// Reads the rows, fires the pulses together and encodes the echoes: one batch for every leg in a row.
    fn measure(&mut self, block: &Block) -> Result<Vec<Measured>> {
        let mut rows = std::mem::take(&mut self.rows);
        rows.clear();
        let tracing = self.tracing;
        block.pulses(tracing.shift, &mut rows, |row| tracing.check(row))?;
        let alike = |a: &PulseRow, b: &PulseRow| (a.leg, a.divergence) == (b.leg, b.divergence);
        let measured = rows.chunk_by(alike).map(|rows| self.measure_leg(rows)).collect();
        self.rows = rows;
        measured
    }

    fn measure_leg(&mut self, rows: &[PulseRow]) -> Result<Measured> {
        let first = &rows[0];
        let rule = self.tracing.legs;
        self.pulses.clear();
        self.pulses.extend(rows.iter().map(|r| r.pulse));
        self.batch.clear(if rule.apart { first.leg } else { 0 });
        self.batch.leg_number = Some(first.leg);
        let leg = self.equip(first)?;
        let Tracer { shooter, scenery, pulses, batch, .. } = self;
        match scenery {
            Some(scenery) => {
                scenery.follow(rows);
                shooter.fire_moving(leg, pulses, &mut scenery.stage, &scenery.changes, batch)?;
            }
            None => shooter.fire_all(leg, pulses, batch)?,
        }
        Ok(Measured {
            encoded: self.tracing.output.encode(&self.batch),
            pulses: rows.len() as u64,
            echoes: self.batch.echoes.len() as u64,
            leg: first.leg,
            done: f64::NAN,
            aim: Aim::of(&self.tracing.target, &self.pulses),
        })
    }

    /// Takes up the instruments of the row's leg; returns the number of that leg for them.
    fn equip(&mut self, row: &PulseRow) -> Result<u32> {
        let rule = self.tracing.legs;
        let Some([start, leg]) = row.divergence.filter(|_| rule.streamed_divergence) else {
            self.shooter.take_up(&self.own);
            return Ok(if rule.known { row.leg } else { 0 });
        };
        let key = [start.to_bits(), leg.to_bits()];
        if !self.others.contains_key(&key) {
            if self.others.len() >= MOST_INSTRUMENTS {
                self.others.clear();
            }
            let equipment =
                Equipment::new(&self.tracing.with_divergences(start, leg), &self.tracing.options)?;
            self.others.insert(key, equipment);
        }
        if let Some(equipment) = self.others.get(&key) {
            self.shooter.take_up(equipment);
        }
        Ok(1)
    }
}

impl Scenery<'_> {
    /// Shows the scene as the first row sees it, and gathers what changes before the others.
    fn follow(&mut self, rows: &[PulseRow]) {
        self.changes.clear();
        let first = rows[0].step;
        if first < self.step {
            (self.state, self.step) = (MotionState::start(self.plan), 0);
        }
        while self.step < first {
            self.state.step(self.plan, |_, _| ());
            self.step += 1;
        }
        self.stage.set_state(&self.state);
        for (before, row) in rows.iter().enumerate() {
            // Rows that go back within a block see the scene as the one before them.
            while self.step < row.step {
                let changes = &mut self.changes;
                self.state.step(self.plan, |object, transform| {
                    changes.push(ObjectUpdate { first_pulse: before, object, transform: *transform })
                });
                self.step += 1;
            }
        }
    }
}

impl Tracing<'_> {
    /// What a pulse must keep to beyond being one.
    fn check(&self, row: &PulseRow) -> Result<(), (Column, String)> {
        let devices = self.survey.scanner.devices.len();
        if row.pulse.device as usize >= devices {
            let message = format!("device {}, the scanner has {devices}", row.pulse.device);
            return Err((Column::Device, message));
        }
        let legs = self.survey.legs.len();
        if (self.legs.known || self.legs.apart) && row.leg as usize >= legs {
            return Err((Column::Leg, format!("leg {}, the survey has {legs}", row.leg)));
        }
        if self.movers.is_some() && row.step > FARTHEST_STEP {
            return Err((Column::Step, format!("step {}, expected at most {FARTHEST_STEP}", row.step)));
        }
        Ok(())
    }

    /// The survey as one whose first leg has the one divergence and whose second leg the other.
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

/// Takes the batches of a block one by one.
struct Ordered<'a> {
    inner: Collector<'a>,
    leg: u32,
}

impl Outcome for Vec<Measured> {}

impl Collect<Vec<Measured>> for Ordered<'_> {
    type Summary = Closed;

    fn take(&mut self, batches: Vec<Measured>, more_waiting: bool) -> Result<()> {
        let last = batches.len().saturating_sub(1);
        for (i, measured) in batches.into_iter().enumerate() {
            let leg = measured.encoded.leg();
            if leg < self.leg {
                let mut problems = Diagnostics::default();
                let message = format!("a pulse of leg {leg} comes after one of leg {}", self.leg);
                problems
                    .error(None, message)
                    .help("with one file per leg the legs must ascend; sort the pulses by leg, or name a single file");
                return Err(Error::Input(Box::new(problems)));
            }
            self.leg = leg;
            self.inner.take(measured, more_waiting || i < last)?;
        }
        Ok(())
    }

    fn finish(self) -> Result<Closed> {
        self.inner.finish()
    }

    fn cut(self) -> Result<Closed> {
        self.inner.cut()
    }

    fn abort(self) {
        self.inner.abort();
    }
}
