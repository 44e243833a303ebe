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
    gun: Gun<'a>,
}

/// Fires every pulse of the replayed steps.
struct Gun<'a> {
    shooter: Shooter<'a>,
    batch: Batch,
    outcome: Result<()>,
}

impl FlightSink for Gun<'_> {
    fn pulse(&mut self, pulse: impl FnOnce() -> Pulse) {
        if self.outcome.is_ok() {
            self.outcome = self.shooter.fire(self.batch.leg, &pulse(), &mut self.batch);
        }
    }

    fn pose(&mut self, pose: impl FnOnce() -> PoseSample) {
        self.batch.poses.push(pose());
    }
}

impl<'a> Worker<'a> {
    /// A worker with empty scratch memory.
    pub fn new(flight: &'a FlightPlan, physics: &'a Physics<'a>, output: &'a OutputPlan) -> Worker<'a> {
        let gun = Gun { shooter: physics.shooter(), batch: Batch::default(), outcome: Ok(()) };
        Worker { flight, output, gun }
    }

    /// Replays the chunk's steps, fires the pulses and encodes the echoes.
    pub fn measure(&mut self, chunk: Chunk) -> Result<Measured> {
        let Chunk { start: mut state, steps, pulses, leg, done } = chunk;
        self.gun.batch.clear(leg);
        for _ in 0..steps {
            state.step(self.flight, &mut self.gun)?;
        }
        std::mem::replace(&mut self.gun.outcome, Ok(()))?;
        let batch = &self.gun.batch;
        Ok(Measured {
            encoded: self.output.encode(batch),
            pulses: u64::from(pulses),
            echoes: batch.echoes.len() as u64,
            leg,
            done,
        })
    }
}
