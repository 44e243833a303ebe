//! The poses of the moving parts at a simulation step.

use super::body::{BodyBox, BodyPose};
use super::plan::{MotionPlan, Move, PlannedPart};
use super::twist::Twist;
use vlscan_geom::{Affine, DVec3, Rotation, unit};

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
        MotionState {
            update: StepCounter::default(),
            parts: plan.parts.iter().map(PartState::start).collect(),
        }
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

    /// Number of steps up to and with the next one that updates the scene.
    pub fn steps_to_update(&self) -> u64 {
        self.update.calls_left.saturating_add(1)
    }

    /// The pose in which rays hit an object, by its index among the moving parts, with the box `rest` around
    /// it; the velocity is per simulation step.
    pub fn body_pose(&self, plan: &MotionPlan, object: usize, rest: &BodyBox) -> BodyPose {
        let seen = &self.parts[object].seen;
        let centre = seen.apply(rest.centre);
        // Mirrored boxes look like turned ones: only two axes count.
        let (x, z) = (unit(seen.apply_to_vector(rest.forward)), unit(seen.apply_to_vector(DVec3::Z)));
        let rotation = Rotation::of_columns([x, z.cross(x), z]);
        BodyPose { centre, rotation, velocity: self.twist(plan, object).at(centre) }
    }

    /// The transforms from the initial poses to the poses that rays hit.
    pub(super) fn seen(&self) -> impl Iterator<Item = &Affine> {
        self.parts.iter().map(|p| &p.seen)
    }
}

/// Way whose direction is that of the front of a part, m.
const FRONT_WAY: f64 = 0.1;
/// Way below which a part stays where it is, m.
const MIN_WAY: f64 = 1e-6;
/// Number of moves after which a part that went nowhere has no front.
const MAX_FRONT_MOVES: usize = 100_000;

/// The horizontal direction of the front of a part in its initial pose, a unit vector: the direction in which
/// the part begins to move; x if it does not move.
pub(super) fn front(part: &PlannedPart) -> DVec3 {
    let mut state = PartState::start(part);
    let mut way = DVec3::ZERO;
    for _ in 0..MAX_FRONT_MOVES {
        let before = state.current;
        if way.length() >= FRONT_WAY || !state.move_once(part) {
            break;
        }
        let by = state.current.apply(part.centre) - before.apply(part.centre);
        // The chord of an arc has the direction of the front midway.
        let own = before.columns.map(|axis| axis.dot(by));
        let turned = state.current.columns.map(|axis| axis.dot(by));
        let along = (DVec3::from(own) + DVec3::from(turned)) * 0.5;
        way += DVec3::new(along.x, along.y, 0.0);
    }
    if way.length() > MIN_WAY { unit(way) } else { DVec3::X }
}

impl PartState {
    /// The state before the first step.
    fn start(part: &PlannedPart) -> PartState {
        PartState {
            moves: StepCounter::default(),
            refresh: StepCounter::default(),
            sequence: (!part.sequences.is_empty()).then_some((0, 0)),
            current: Affine::IDENTITY,
            seen: Affine::IDENTITY,
        }
    }

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
