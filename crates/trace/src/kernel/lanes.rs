//! Arrays with one lane per pulse of a packet.

pub(crate) const PACKET_SIZE: usize = 16;

#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct PerPulse(pub [f32; PACKET_SIZE]);

impl PerPulse {
    pub const ZERO: PerPulse = PerPulse([0.0; PACKET_SIZE]);

    /// Sets the lanes from `used` on to the number of the first.
    #[inline(always)]
    pub fn repeat_first(&mut self, used: usize) {
        for l in used..PACKET_SIZE {
            self.0[l] = self.0[0];
        }
    }
}

/// Returns a number not above `x`, lower by a unit in the last place or two. Unlike `next_down` this is three
/// operations.
#[inline(always)]
pub(super) fn lowered(x: f32) -> f32 {
    x - (x.abs() * f32::EPSILON + f32::MIN_POSITIVE)
}

/// Returns a number not below `x`, higher by a unit in the last place or two.
#[inline(always)]
pub(super) fn raised(x: f32) -> f32 {
    x + (x.abs() * f32::EPSILON + f32::MIN_POSITIVE)
}

/// Maximum of both; `b` when either is NaN. Unlike `f32::max` this is one instruction.
#[inline(always)]
pub(super) fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
