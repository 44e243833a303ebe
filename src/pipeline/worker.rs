//! A worker: replays a chunk, fires its pulses, encodes what they measured.

use super::{Aim, AimTarget, Chunk};
use crate::error::Result;
use crate::flight::{FlightPlan, FlightSink, PoseSample, Pulse};
use crate::output::{Encoded, OutputPlan};
use crate::pulse::{Batch, Physics, Shooter};
use crate::scene::{DynamicScene, MotionPlan, ObjectUpdate};
use crate::schedule::Outcome;
use crate::tree::BuildOptions;

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
    /// Where its beams point.
    pub aim: Aim,
}

impl Outcome for Measured {
    fn join(&mut self, next: Measured) -> Option<Measured> {
        let Measured { encoded, pulses, echoes, leg, done, aim } = next;
        if leg != self.leg {
            return Some(Measured { encoded, pulses, echoes, leg, done, aim });
        }
        match self.encoded.join(encoded) {
            None => {
                (self.pulses, self.echoes, self.done) = (self.pulses + pulses, self.echoes + echoes, done);
                self.aim.add(&aim);
                None
            }
            Some(encoded) => Some(Measured { encoded, pulses, echoes, leg, done, aim }),
        }
    }
}

/// One thread's computing stage with its scratch memory.
pub struct Worker<'a> {
    flight: &'a FlightPlan,
    output: &'a OutputPlan,
    target: AimTarget,
    shooter: Shooter<'a>,
    scenery: Option<Scenery<'a>>,
    pulses: Vec<Pulse>,
    batch: Batch,
}

/// What moves in the scene.
struct Scenery<'a> {
    plan: &'a MotionPlan,
    stage: DynamicScene<'a>,
    changes: Vec<ObjectUpdate>,
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
    pub fn new(
        flight: &'a FlightPlan,
        physics: &'a Physics<'a>,
        movers: Option<(&'a MotionPlan, &'a BuildOptions)>,
        output: &'a OutputPlan,
        target: AimTarget,
    ) -> Worker<'a> {
        let scenery = movers.map(|(plan, trees)| Scenery {
            plan,
            stage: DynamicScene::new(plan, trees.clone()),
            changes: Vec::new(),
        });
        Worker {
            flight,
            output,
            target,
            shooter: physics.shooter(),
            scenery,
            pulses: Vec::new(),
            batch: Batch::default(),
        }
    }

    /// Replays the chunk's steps, fires the pulses together and encodes the echoes.
    pub fn measure(&mut self, chunk: Chunk) -> Result<Measured> {
        let (leg, pulses, done) = (chunk.leg, u64::from(chunk.pulses), chunk.done);
        self.pulses.clear();
        self.batch.clear(leg);
        self.replay(chunk)?;
        match &mut self.scenery {
            Some(s) => {
                self.shooter.fire_moving(leg, &self.pulses, &mut s.stage, &s.changes, &mut self.batch)?;
            }
            None => self.shooter.fire_all(leg, &self.pulses, &mut self.batch)?,
        }
        Ok(Measured {
            encoded: self.output.encode(&self.batch),
            pulses,
            echoes: self.batch.echoes.len() as u64,
            leg,
            done,
            aim: Aim::of(&self.target, &self.pulses),
        })
    }

    /// Repeats the chunk's steps, with the motions of the scene between them.
    fn replay(&mut self, chunk: Chunk) -> Result<()> {
        let Chunk { start: mut state, movers, steps, .. } = chunk;
        let mut replay = Replay { pulses: &mut self.pulses, poses: &mut self.batch.poses };
        let (Some(s), Some(mut movers)) = (&mut self.scenery, movers) else {
            return (0..steps).try_for_each(|_| state.step(self.flight, &mut replay).map(drop));
        };
        s.stage.set_state(&movers);
        s.changes.clear();
        for _ in 0..steps {
            state.step(self.flight, &mut replay)?;
            let before = replay.pulses.len();
            movers.step(s.plan, |object, transform| {
                s.changes.push(ObjectUpdate { first_pulse: before, object, transform: *transform })
            });
        }
        Ok(())
    }
}
