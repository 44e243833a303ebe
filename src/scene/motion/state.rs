//! How far the moving parts have come.

use super::plan::{Movers, MovingPart};
use crate::geom::Affine;

/// Where all moving parts stand at a simulation step. Cheap to clone; steps from clones are the same bit for bit.
#[derive(Clone, Debug, PartialEq)]
pub struct MoverState {
    beat: Beat,
    parts: Vec<PartState>,
}

#[derive(Clone, Debug, PartialEq)]
struct PartState {
    beat: Beat,
    refresh: Beat,
    /// The present sequence, and how often it has been gone through; `None` when the part has stopped.
    sequence: Option<(usize, u32)>,
    /// From where the part stood at first to where it is.
    now: Affine,
    /// The same as rays see it: as it was at the last refresh.
    seen: Affine,
}

/// Fires on its first call and then on every n-th.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Beat {
    calls_left: u64,
}

impl Beat {
    /// Whether this call is the one. With `every` = 0 only the first is.
    fn fires(&mut self, every: u64) -> bool {
        if self.calls_left > 0 {
            self.calls_left -= 1;
            return false;
        }
        self.calls_left = every.checked_sub(1).unwrap_or(u64::MAX);
        true
    }
}

impl MoverState {
    /// The state before the first step.
    pub fn start(plan: &Movers) -> MoverState {
        let part = |p: &MovingPart| PartState {
            beat: Beat::default(),
            refresh: Beat::default(),
            sequence: (!p.sequences.is_empty()).then_some((0, 0)),
            now: Affine::IDENTITY,
            seen: Affine::IDENTITY,
        };
        MoverState { beat: Beat::default(), parts: plan.parts.iter().map(part).collect() }
    }

    /// The end of a simulation step, after its pulses. Calls `refreshed` with the number of every part that rays see
    /// elsewhere from now on, and with the map that takes it there.
    pub fn step(&mut self, plan: &Movers, mut refreshed: impl FnMut(usize, &Affine)) {
        if !self.beat.fires(plan.every) {
            return;
        }
        for (number, (part, state)) in plan.parts.iter().zip(&mut self.parts).enumerate() {
            if state.beat.fires(part.every) && state.advance(part) && state.refresh.fires(part.refresh_every)
            {
                state.seen = state.now;
                refreshed(number, &state.seen);
            }
        }
    }

    /// The maps that take the parts to where rays see them.
    pub(super) fn seen(&self) -> impl Iterator<Item = &Affine> {
        self.parts.iter().map(|p| &p.seen)
    }
}

impl PartState {
    /// Moves the part once; `false` if it has stopped.
    fn advance(&mut self, part: &MovingPart) -> bool {
        let Some((number, gone)) = self.sequence else { return false };
        let sequence = &part.sequences[number];
        for step in &sequence.moves {
            let map = if step.about_self { step.map.about(self.now.apply(part.centre)) } else { step.map };
            self.now = map.after(&self.now);
        }
        // Sequences without end need no count.
        let gone = if sequence.loops == 0 { 0 } else { gone + 1 };
        self.sequence = if sequence.loops > 0 && gone >= sequence.loops {
            sequence.next.map(|next| (next, 0))
        } else {
            Some((number, gone))
        };
        true
    }
}
