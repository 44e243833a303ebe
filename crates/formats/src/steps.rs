//! Positions as whole numbers of steps, as LAS stores them: 12 bytes in place of 24.

use vlscan_geom::DVec3;

/// Steps of positions. A position is the number of steps times the scale, plus the offset, in the unit of its
/// file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionSteps {
    /// Length of a step.
    pub scale: DVec3,
    /// Coordinates of step 0.
    pub offset: DVec3,
    /// Metres in a unit.
    pub metres: DVec3,
}

impl PositionSteps {
    /// Position of these numbers of steps, m, with the bits that a reader of LAS computes.
    #[inline]
    pub fn position(&self, steps: [i32; 3]) -> DVec3 {
        (DVec3::from(steps.map(f64::from)) * self.scale + self.offset) * self.metres
    }

    /// Numbers of steps whose position has the bits of this one, m; `None` if it is between steps.
    #[inline]
    pub fn steps(&self, position: DVec3) -> Option<[i32; 3]> {
        let steps = (position / self.metres - self.offset) / self.scale;
        // The conversion saturates, which the comparison finds.
        let steps = steps.to_array().map(|steps| steps.round() as i32);
        let bits = |position: DVec3| position.to_array().map(f64::to_bits);
        (bits(self.position(steps)) == bits(position)).then_some(steps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_in_steps_keep_their_bits_and_others_are_none() {
        for metres in [DVec3::ONE, DVec3::splat(1200.0 / 3937.0), DVec3::new(0.3048, 0.3048, 1.0)] {
            let scale = DVec3::new(0.001, 0.001, 0.01);
            let offset = DVec3::new(431_000.0, 5_412_000.0, -0.5);
            let of = PositionSteps { scale, offset, metres };
            for i in 0..1000_i32 {
                let steps = [i * 7919, -i * 104_729, i];
                assert_eq!(of.steps(of.position(steps)), Some(steps), "{metres} {i}");
            }
            let ends = [i32::MAX, i32::MIN, 0];
            assert_eq!(of.steps(of.position(ends)), Some(ends));
            for other in [DVec3::new(0.4, 0.0, 0.0), DVec3::splat(1e10), DVec3::NAN] {
                assert_eq!(of.steps(of.position([0; 3]) + other * scale * metres), None, "{other}");
            }
        }
    }
}
