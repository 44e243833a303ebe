//! A worker's copy of the moving parts of a scene.

use vlscan_scene::{DynamicScene, MotionPlan, MotionState, ObjectUpdate, Twist};
use vlscan_trace::BuildOptions;

/// Moving parts in the positions at which a worker's pulses are traced.
pub(super) struct MovingParts<'a> {
    plan: &'a MotionPlan,
    /// The parts at the time of the first pulse of the batch.
    pub scene: DynamicScene<'a>,
    /// Motions between the pulses of the batch.
    pub changes: Vec<ObjectUpdate>,
}

impl<'a> MovingParts<'a> {
    /// Creates the parts in their initial positions. `trees` are the options of their trees.
    pub fn new(plan: &'a MotionPlan, trees: &BuildOptions) -> MovingParts<'a> {
        MovingParts { plan, scene: DynamicScene::new(plan, trees.clone()), changes: Vec::new() }
    }

    /// Begins a batch whose first pulse is traced with the parts as in `state`.
    pub fn begin_batch(&mut self, state: &MotionState) {
        self.scene.set_state(state);
        self.changes.clear();
    }

    /// Advances `state` by a step, after the first `pulses` pulses of the batch.
    pub fn step(&mut self, state: &mut MotionState, pulses: usize) {
        let changes = &mut self.changes;
        let first = changes.len();
        state.step(self.plan, |object, transform| {
            changes.push(ObjectUpdate {
                first_pulse: pulses,
                object,
                transform: *transform,
                twist: Twist::ZERO,
            })
        });
        changes[first..].iter_mut().for_each(|change| change.twist = state.twist(self.plan, change.object));
    }

    pub fn start(&self) -> MotionState {
        MotionState::start(self.plan)
    }

    /// Advances `state` by a step before the first pulse of the batch.
    pub fn skip(&self, state: &mut MotionState) {
        state.step(self.plan, |_, _| ());
    }
}
