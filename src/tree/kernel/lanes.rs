//! A lane per pulse of a packet.

/// Pulses in a packet.
pub(crate) const PACKET_SIZE: usize = 16;

/// A number for each pulse of a packet.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct PerPulse(pub [f32; PACKET_SIZE]);

impl PerPulse {
    pub const ZERO: PerPulse = PerPulse([0.0; PACKET_SIZE]);

    /// Gives lanes from `used` on the number of the first.
    #[inline(always)]
    pub fn repeat_first(&mut self, used: usize) {
        for l in used..PACKET_SIZE {
            self.0[l] = self.0[0];
        }
    }
}

/// A number not above `x`, by a unit in the last place or two. Unlike `next_down` this is three operations.
#[inline(always)]
pub(super) fn lowered(x: f32) -> f32 {
    x - (x.abs() * f32::EPSILON + f32::MIN_POSITIVE)
}

/// A number not below `x`, by a unit in the last place or two.
#[inline(always)]
pub(super) fn raised(x: f32) -> f32 {
    x + (x.abs() * f32::EPSILON + f32::MIN_POSITIVE)
}

/// The greater of both; `b` when either is NaN. Unlike `f32::max` this is one instruction.
#[inline(always)]
pub(super) fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
