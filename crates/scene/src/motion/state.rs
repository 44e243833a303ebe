//! The poses of the moving parts at a simulation step.

use super::plan::{MotionPlan, Move, PlannedPart};
use super::twist::Twist;
use vlscan_geom::Affine;

/// Poses of all moving parts at a simulation step. Cheap to clone; stepping a clone results in the same bits.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionState {
    update: StepCounter,
    parts: Vec<PartState>,
}

#[derive(Clone, Debug, PartialEq)]
struct PartState {
    moves: StepCounter,
    refresh: StepCounter,
    /// The current sequence and how many times it has been completed; `None` once the part has stopped.
    sequence: Option<(usize, u32)>,
    /// From the initial pose to the current one.
    current: Affine,
    /// The value of `current` at the last refresh, which rays hit.
    seen: Affine,
}

/// Fires on its first call and then on every n-th call.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct StepCounter {
    calls_left: u64,
}

impl StepCounter {
    /// Counts a call; true if it is the first one or the n-th since the last that fired. An `interval` of 0
    /// fires only once.
    fn advance(&mut self, interval: u64) -> bool {
        if self.calls_left > 0 {
            self.calls_left -= 1;
            return false;
        }
        self.calls_left = interval.checked_sub(1).unwrap_or(u64::MAX);
        true
    }
}

impl MotionState {
    /// The state before the first step.
    pub fn start(plan: &MotionPlan) -> MotionState {
        let part = |p: &PlannedPart| PartState {
            moves: StepCounter::default(),
            refresh: StepCounter::default(),
            sequence: (!p.sequences.is_empty()).then_some((0, 0)),
            current: Affine::IDENTITY,
            seen: Affine::IDENTITY,
        };
        MotionState { update: StepCounter::default(), parts: plan.parts.iter().map(part).collect() }
    }

    /// The state after `steps` steps.
    pub fn after_steps(plan: &MotionPlan, steps: u64) -> MotionState {
        let mut state = MotionState::start(plan);
        (0..steps).for_each(|_| state.step(plan, |_, _| ()));
        state
    }

    /// Ends a simulation step, after its pulses. Calls `on_refresh` for every part whose pose for rays
    /// changes now, with its index and the transform from its initial pose.
    pub fn step(&mut self, plan: &MotionPlan, mut on_refresh: impl FnMut(usize, &Affine)) {
        if !self.update.advance(plan.update_interval) {
            return;
        }
        for (number, (part, state)) in plan.parts.iter().zip(&mut self.parts).enumerate() {
            if state.moves.advance(part.move_interval)
                && state.move_once(part)
                && state.refresh.advance(part.refresh_interval)
            {
                state.seen = state.current;
                on_refresh(number, &state.seen);
            }
        }
    }

    /// Velocity of a part, per simulation step: its next moves, spread evenly over the steps up to them.
    pub fn twist(&self, plan: &MotionPlan, object: usize) -> Twist {
        let (part, state) = (&plan.parts[object], &self.parts[object]);
        let steps = plan.update_interval.saturating_mul(part.move_interval);
        match state.sequence {
            Some((number, _)) if steps > 0 => {
                let moves = part.sequences[number].moves.iter();
                let all = moves.map(|step| Twist::of(&state.map_of(part, step)));
                all.fold(Twist::ZERO, Twist::with).scaled(1.0 / steps as f64)
            }
            _ => Twist::ZERO,
        }
    }

    /// The transforms from the initial poses to the poses that rays hit.
    pub(super) fn seen(&self) -> impl Iterator<Item = &Affine> {
        self.parts.iter().map(|p| &p.seen)
    }
}

impl PartState {
    /// The map of a motion in the current pose.
    fn map_of(&self, part: &PlannedPart, step: &Move) -> Affine {
        if step.about_self { step.map.about(self.current.apply(part.centre)) } else { step.map }
    }

    /// Applies the current sequence once; `false` if the part has stopped.
    fn move_once(&mut self, part: &PlannedPart) -> bool {
        let Some((number, completed)) = self.sequence else { return false };
        let sequence = &part.sequences[number];
        for step in &sequence.moves {
            self.current = self.map_of(part, step).after(&self.current);
        }
        // Endless sequences need no count.
        let completed = if sequence.loops == 0 { 0 } else { completed + 1 };
        self.sequence = if sequence.loops > 0 && completed >= sequence.loops {
            sequence.next.map(|next| (next, 0))
        } else {
            Some((number, completed))
        };
        true
    }
}
