//! What a pass over one epoch's scene needs.

use super::aim::AimTarget;
use super::plausibility::YieldCheck;
use super::progress::Progress;
use crate::output::OutputPlan;
use crate::pulse::Physics;
use crate::scene::MotionPlan;
use crate::schedule::{Recorder, Schedule, Stop};
use crate::tree::BuildOptions;
use std::sync::Arc;

/// What the caller of a run watches and steers it by.
#[derive(Clone, Copy, Debug)]
pub struct Control<'a> {
    /// What has been done so far.
    pub progress: &'a Progress,
    /// The wish to end.
    pub stop: &'a Stop,
    /// Records what the schedule does.
    pub recorder: Option<&'a Recorder>,
}

impl<'a> Control<'a> {
    /// Without records of the schedule.
    pub fn new(progress: &'a Progress, stop: &'a Stop) -> Control<'a> {
        Control { progress, stop, recorder: None }
    }
}

/// What a pass over one epoch's scene needs, whether its pulses come from a flight or from a stream.
pub struct Pass<'a> {
    /// Scene, tree, instruments.
    pub physics: &'a Physics<'a>,
    /// Moving parts of the scene, if there are any.
    pub motion: Option<&'a MotionPlan>,
    /// How the trees over moving parts are built.
    pub trees: &'a BuildOptions,
    /// Outputs.
    pub output: Arc<OutputPlan>,
    /// Threads, and how pulses are distributed to them.
    pub schedule: Schedule,
    /// Progress, wish to stop, records.
    pub control: Control<'a>,
    /// What beams are compared with.
    pub target: AimTarget,
    /// Looks for too few points before the outputs get their names.
    pub check: Option<YieldCheck<'a>>,
    /// No epoch follows.
    pub is_last: bool,
}
