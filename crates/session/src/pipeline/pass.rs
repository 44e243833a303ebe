//! Inputs of a pass over one epoch.

use super::beam_counts::BeamTarget;
use super::plausibility::YieldCheck;
use super::prefetch::Prefetcher;
use super::progress::Progress;
use crate::output::OutputPlan;
use std::sync::Arc;
use vlscan_geom::HeightModel;
use vlscan_lidar::pulse::Physics;
use vlscan_scene::{MotionPlan, Tiles};
use vlscan_trace::BuildOptions;
use vlscan_warehouse::{OpenOutputs, Recorder, Schedule, Stop};

/// Progress, stop request and recorder that the caller of a run shares with it.
#[derive(Clone, Copy, Debug)]
pub struct RunContext<'a> {
    /// Counters of the work done so far.
    pub progress: &'a Progress,
    /// Request to stop the run.
    pub stop: &'a Stop,
    /// Recorder of the schedule, if its activity is to be recorded.
    pub recorder: Option<&'a Recorder>,
}

impl<'a> RunContext<'a> {
    /// A context without a recorder.
    pub fn new(progress: &'a Progress, stop: &'a Stop) -> RunContext<'a> {
        RunContext { progress, stop, recorder: None }
    }
}

/// Inputs of a pass over one epoch, whether its pulses come from a flight or from a stream.
pub struct Pass<'a> {
    pub physics: &'a Physics<'a>,
    pub motion: Option<&'a MotionPlan>,
    /// Parts of the scene that are loaded when rays need them.
    pub tiles: Option<(&'a Tiles, &'a Prefetcher)>,
    /// Build options of the trees over moving parts.
    pub trees: &'a BuildOptions,
    pub output: Arc<OutputPlan>,
    /// The ground of this epoch in the scene frame, if points have heights above it.
    pub ground: Option<Arc<dyn HeightModel>>,
    pub schedule: Schedule,
    pub control: RunContext<'a>,
    /// The outputs of the run, which stay open from pass to pass.
    pub open_outputs: &'a OpenOutputs<'a>,
    pub target: BeamTarget,
    /// Check for too few points, run before the outputs get their names.
    pub check: Option<YieldCheck<'a>>,
    /// Epoch of the scene, from 0.
    pub epoch: u32,
    /// True if no epoch follows.
    pub is_last: bool,
}
