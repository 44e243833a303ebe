//! A worker's view of the moving parts of a scene.

use crate::scene::{DynamicScene, MotionPlan, MotionState, ObjectUpdate};
use crate::tree::BuildOptions;

/// The moving parts where a worker's pulses see them.
pub(super) struct MovingParts<'a> {
    plan: &'a MotionPlan,
    /// The parts where the first pulse of the batch sees them.
    pub scene: DynamicScene<'a>,
    /// What moves between the pulses of the batch.
    pub changes: Vec<ObjectUpdate>,
}

impl<'a> MovingParts<'a> {
    /// The parts where they stand at first. `trees` are the options of their trees.
    pub fn new(plan: &'a MotionPlan, trees: &BuildOptions) -> MovingParts<'a> {
        MovingParts { plan, scene: DynamicScene::new(plan, trees.clone()), changes: Vec::new() }
    }

    /// Begins a batch whose first pulse sees the parts as in `state`.
    pub fn begin_batch(&mut self, state: &MotionState) {
        self.scene.set_state(state);
        self.changes.clear();
    }

    /// Advances `state` by a step, after the first `pulses` pulses of the batch.
    pub fn step(&mut self, state: &mut MotionState, pulses: usize) {
        let changes = &mut self.changes;
        state.step(self.plan, |object, transform| {
            changes.push(ObjectUpdate { first_pulse: pulses, object, transform: *transform })
        });
    }

    /// The state before the first step.
    pub fn start(&self) -> MotionState {
        MotionState::start(self.plan)
    }

    /// Advances `state` by a step that no pulse of the batch sees.
    pub fn skip(&self, state: &mut MotionState) {
        state.step(self.plan, |_, _| ());
    }
}
