//! A worker: replays a chunk, fires its pulses, encodes what they measured.

use super::{Batch, Chunk};
use crate::error::Result;
use crate::flight::{FlightPlan, FlightSink, PoseSample, Pulse};
use crate::output::{Encoded, OutputPlan};
use crate::pulse::{Physics, Shooter};

/// What a chunk became.
pub struct Measured {
    /// Bytes for every sink.
    pub encoded: Encoded,
    /// Pulses fired.
    pub pulses: u64,
    /// Echoes detected.
    pub echoes: u64,
    /// Number of the leg in the survey.
    pub leg: u32,
    /// Done part of the survey, see [`Chunk::done`].
    pub done: f64,
}

/// One thread's computing stage with its scratch memory.
pub struct Worker<'a> {
    flight: &'a FlightPlan,
    output: &'a OutputPlan,
    shooter: Shooter<'a>,
    pulses: Vec<Pulse>,
    batch: Batch,
}

/// Keeps what the replayed steps yield.
struct Replay<'w> {
    pulses: &'w mut Vec<Pulse>,
    poses: &'w mut Vec<PoseSample>,
}

impl FlightSink for Replay<'_> {
    fn pulse(&mut self, pulse: impl FnOnce() -> Pulse) {
        self.pulses.push(pulse());
    }

    fn pose(&mut self, pose: impl FnOnce() -> PoseSample) {
        self.poses.push(pose());
    }
}

impl<'a> Worker<'a> {
    /// A worker with empty scratch memory.
    pub fn new(flight: &'a FlightPlan, physics: &'a Physics<'a>, output: &'a OutputPlan) -> Worker<'a> {
        Worker { flight, output, shooter: physics.shooter(), pulses: Vec::new(), batch: Batch::default() }
    }

    /// Replays the chunk's steps, fires the pulses together and encodes the echoes.
    pub fn measure(&mut self, chunk: Chunk) -> Result<Measured> {
        let Chunk { start: mut state, steps, pulses, leg, done } = chunk;
        self.pulses.clear();
        self.batch.clear(leg);
        let mut replay = Replay { pulses: &mut self.pulses, poses: &mut self.batch.poses };
        for _ in 0..steps {
            state.step(self.flight, &mut replay)?;
        }
        self.shooter.fire_all(leg, &self.pulses, &mut self.batch)?;
        Ok(Measured {
            encoded: self.output.encode(&self.batch),
            pulses: u64::from(pulses),
            echoes: self.batch.echoes.len() as u64,
            leg,
            done,
        })
    }
}
