//! The computing stage of a thread: pulses become echoes, and echoes become the bytes of every output.

use super::beam_counts::BeamCounts;
use super::chunk::Chunk;
use super::moving::MovingParts;
use super::pass::Pass;
use super::prefetch::Sighting;
use crate::output::Encoded;
use vlscan_base::error::Result;
use vlscan_lidar::flight::{FlightPlan, FlightSink, PoseSample, Pulse};
use vlscan_lidar::pulse::{Batch, Echo, PulseSimulator};
use vlscan_warehouse::Outcome;

/// Result of consecutive pulses of a leg.
pub(super) struct Measured {
    pub encoded: Encoded,
    pub pulses: u64,
    pub echoes: u64,
    pub leg: u32,
    /// Fraction of the survey done, see [`Chunk::done`].
    pub done: f64,
    pub beam_counts: BeamCounts,
}

impl Measured {
    /// Appends the result of the next pulses, or returns it if it belongs to another leg or file.
    fn join(&mut self, next: Measured) -> Option<Measured> {
        if next.leg != self.leg {
            return Some(next);
        }
        let Measured { encoded, pulses, echoes, leg, done, beam_counts } = next;
        match self.encoded.join(encoded) {
            None => {
                (self.pulses, self.echoes, self.done) = (self.pulses + pulses, self.echoes + echoes, done);
                self.beam_counts.add(&beam_counts);
                None
            }
            Some(encoded) => Some(Measured { encoded, pulses, echoes, leg, done, beam_counts }),
        }
    }
}

/// The pieces of a chunk in pulse order, one per run of pulses of the same leg. The last one is the failure
/// that ended the chunk, if there is one.
pub(super) struct Pieces(pub Vec<Result<Measured>>);

impl Outcome for Pieces {
    fn join(&mut self, mut next: Pieces) -> Option<Pieces> {
        if next.0.len() == 1
            && let Some(Ok(last)) = self.0.last_mut()
            && let Some(piece) = next.0.pop()
        {
            let rest = piece.map(|piece| last.join(piece)).transpose();
            self.0.extend(rest);
            return None;
        }
        Some(next)
    }
}

/// Simulates and encodes the pulses in `pulses`, which its owner fills. Memory is reused from batch to batch.
pub(super) struct Worker<'a> {
    pass: &'a Pass<'a>,
    pub simulator: PulseSimulator<'a>,
    /// The moving parts of the scene, if there are any.
    pub moving: Option<MovingParts<'a>>,
    pub pulses: Vec<Pulse>,
    pub batch: Batch,
}

impl<'a> Worker<'a> {
    pub fn new(pass: &'a Pass<'a>) -> Worker<'a> {
        Worker {
            pass,
            simulator: PulseSimulator::new(pass.physics),
            moving: pass.motion.map(|plan| MovingParts::new(plan, pass.trees)),
            pulses: Vec::new(),
            batch: Batch { epoch: pass.epoch, ..Batch::default() },
        }
    }

    /// Simulates `pulses` and encodes the echoes. `leg` is the number of the leg in the survey,
    /// `instrument_leg` the number of the leg whose instruments are used.
    pub fn measure(&mut self, leg: u32, instrument_leg: u32, done: f64) -> Result<Measured> {
        let Worker { pass, simulator, moving, pulses, batch } = self;
        match moving {
            Some(MovingParts { scene, changes, .. }) => {
                simulator.simulate_dynamic(instrument_leg, pulses, scene, changes, batch)?;
            }
            None => simulator.simulate(instrument_leg, pulses, batch)?,
        }
        batch.emitted = pulses.len() as u32;
        let encoded = pass.output.encode(batch, pass.ground.as_ref());
        if let Some((tiles, prefetcher)) = pass.tiles {
            // Heights above the ground cannot report it.
            tiles.check()?;
            let place = pulses.first().map(|pulse| pulse.origin).zip(simulator.take_area());
            place.into_iter().for_each(|(position, area)| prefetcher.tell(Sighting { position, area }));
        }
        Ok(Measured {
            encoded,
            pulses: pulses.len() as u64,
            echoes: batch.echoes.len() as u64,
            leg,
            done,
            beam_counts: BeamCounts {
                weak: batch.weak,
                near: batch.near,
                ..BeamCounts::of(&pass.target, pulses)
            },
        })
    }
}

/// A worker whose pulses come from replayed chunks of a flight.
pub(super) struct FlightWorker<'a> {
    worker: Worker<'a>,
    flight: &'a FlightPlan,
}

/// Collects the pulses of replayed steps.
struct Replay<'w> {
    pulses: &'w mut Vec<Pulse>,
    poses: &'w mut Vec<PoseSample>,
    has_velocities: bool,
}

impl FlightSink for Replay<'_> {
    fn pulse(&mut self, pulse: impl FnOnce() -> Pulse) {
        self.pulses.push(pulse());
    }

    fn records_velocities(&self) -> bool {
        self.has_velocities
    }

    fn pose(&mut self, pose: impl FnOnce() -> PoseSample) {
        self.poses.push(pose());
    }
}

impl<'a> FlightWorker<'a> {
    pub fn new(pass: &'a Pass<'a>, flight: &'a FlightPlan) -> FlightWorker<'a> {
        FlightWorker { worker: Worker::new(pass), flight }
    }

    /// Replays the chunk's steps, simulates their pulses together and encodes the echoes.
    pub fn measure(&mut self, chunk: Chunk) -> Result<Pieces> {
        let (leg, done) = (chunk.leg, chunk.done);
        self.worker.pulses.clear();
        self.worker.batch.clear(leg);
        self.replay(chunk)?;
        Ok(Pieces(vec![self.worker.measure(leg, leg, done)]))
    }

    /// Measures a chunk in any order of the legs, for outputs with one file for all legs.
    pub fn measure_in_any_order(&mut self, chunk: Chunk) -> Result<Pieces> {
        self.measure_some(chunk, |_| ())
    }

    /// Measures those pulses of a chunk that `select` leaves, in any order of the legs. In scenes with moving
    /// parts it has to leave all of them.
    pub fn measure_some(&mut self, chunk: Chunk, select: impl FnOnce(&mut Vec<Pulse>)) -> Result<Pieces> {
        let (leg, done) = (chunk.leg, chunk.done);
        self.worker.pulses.clear();
        self.worker.batch.clear(0);
        self.worker.batch.leg_number = Some(leg);
        self.replay(chunk)?;
        select(&mut self.worker.pulses);
        Ok(Pieces(vec![self.worker.measure(leg, leg, done)]))
    }

    /// Measures pulses of a leg that need not be all of a chunk, in any order of the legs, in scenes without
    /// moving parts. `done` is that of their chunk.
    pub fn measure_pulses(
        &mut self,
        (leg, done): (u32, f64),
        pulses: impl Iterator<Item = Pulse>,
    ) -> Result<Measured> {
        self.worker.pulses.clear();
        self.worker.pulses.extend(pulses);
        self.worker.batch.clear(0);
        self.worker.batch.leg_number = Some(leg);
        self.worker.measure(leg, leg, done)
    }

    /// Pulses and echoes of the last chunk.
    pub fn measured(&self) -> (&[Pulse], &[Echo]) {
        (&self.worker.pulses, &self.worker.batch.echoes)
    }

    /// Replays the chunk's steps, with the motions of the scene between them.
    fn replay(&mut self, chunk: Chunk) -> Result<()> {
        let Chunk { start: mut state, motion, steps, .. } = chunk;
        let Worker { pass, moving, pulses, batch, .. } = &mut self.worker;
        let has_velocities = pass.physics.records_velocities();
        let mut replay = Replay { pulses, poses: &mut batch.poses, has_velocities };
        let (Some(moving), Some(mut motion)) = (moving, motion) else {
            return (0..steps).try_for_each(|_| state.step(self.flight, &mut replay).map(drop));
        };
        moving.begin_batch(&motion);
        for _ in 0..steps {
            state.step(self.flight, &mut replay)?;
            moving.step(&mut motion, replay.pulses.len());
        }
        Ok(())
    }
}
