//! Scan patterns of tables: a beam, or none, for each step.

use super::pulse_times::fold_words;
use vlscan_geom::{DVec3, Rotation};

/// A beam of a scan pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatternBeam {
    /// Step at which it is emitted, from 0.
    pub step: u32,
    /// Angle from the emitter's y axis, clockwise seen from above, rad.
    pub azimuth: f64,
    /// Angle above the emitter's xy plane, rad.
    pub elevation: f64,
    /// Origin of the beam in the frame of the emitter, m.
    pub origin: DVec3,
}

/// The beams of one device in the order of their steps. A flight stores the number of the next step; each
/// lookup takes the same time, wherever it is.
#[derive(Clone, Default, PartialEq)]
pub struct PatternTable {
    /// Rotations from the emitter's y axis to the beams.
    attitudes: Vec<Rotation>,
    /// Empty if all beams leave from the origin of the emitter.
    origins: Vec<DVec3>,
    /// Number of beams before each step, and that of all; empty if every step has one.
    before: Vec<u32>,
    steps: u32,
    repeats: bool,
}

impl PatternTable {
    /// The table of a pattern of `steps` steps, which starts again after the last one if `repeats` is set.
    /// Beams must be in ascending order of their steps; those of another beam's step, or of steps outside the
    /// pattern, are left out.
    pub fn new(beams: &[PatternBeam], steps: u32, repeats: bool) -> PatternTable {
        let mut table = PatternTable { steps, repeats, ..PatternTable::default() };
        let mut next = 0;
        let mut used = Vec::with_capacity(beams.len());
        for beam in beams.iter().filter(|beam| beam.step < steps) {
            if beam.step >= next {
                used.push(*beam);
                next = beam.step + 1;
            }
        }
        table.attitudes = used.iter().map(|beam| attitude(beam.azimuth, beam.elevation)).collect();
        if used.iter().any(|beam| beam.origin != DVec3::ZERO) {
            table.origins = used.iter().map(|beam| beam.origin).collect();
        }
        if used.len() < steps as usize {
            table.before = Vec::with_capacity(steps as usize + 1);
            let mut count = 0;
            for step in 0..steps {
                table.before.push(count);
                count += u32::from(used.get(count as usize).is_some_and(|beam| beam.step == step));
            }
            table.before.push(count);
        }
        table
    }

    /// Number of beams.
    pub fn len(&self) -> usize {
        self.attitudes.len()
    }

    /// True if no step has a beam.
    pub fn is_empty(&self) -> bool {
        self.attitudes.is_empty()
    }

    /// Number of steps.
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// True if the pattern starts again after its last step.
    pub fn repeats(&self) -> bool {
        self.repeats
    }

    /// The row of the beam of a step; `None` if the step has none or is after the end.
    #[inline]
    pub fn row(&self, step: u32) -> Option<u32> {
        if self.before.is_empty() {
            return (step < self.steps).then_some(step);
        }
        let first = *self.before.get(step as usize)?;
        let next = *self.before.get(step as usize + 1)?;
        (next > first).then_some(first)
    }

    /// The step that is `count` after `step`: of a pattern that does not repeat at most the one after the
    /// last, which has no beam.
    #[inline]
    pub fn step_after(&self, step: u32, count: u32) -> u32 {
        let (sum, steps) = (u64::from(step) + u64::from(count), u64::from(self.steps));
        match sum < steps {
            true => sum as u32,
            false if self.repeats && steps > 0 => (sum % steps) as u32,
            false => self.steps,
        }
    }

    /// Number of beams of the `count` steps from `step` on.
    pub fn beams_within(&self, step: u32, count: u32) -> u32 {
        let (sum, steps) = (u64::from(step) + u64::from(count), u64::from(self.steps));
        let (cycles, end) = match self.repeats && steps > 0 {
            true => (sum / steps, (sum % steps) as u32),
            false => (0, sum.min(steps) as u32),
        };
        let until = cycles * self.attitudes.len() as u64 + u64::from(self.beams_before(end));
        (until - u64::from(self.beams_before(step))) as u32
    }

    fn beams_before(&self, step: u32) -> u32 {
        let step = step.min(self.steps);
        self.before.get(step as usize).copied().unwrap_or(step)
    }

    /// The rotation from the emitter's y axis to the beam of a row: about x by the elevation, then about z.
    #[inline]
    pub fn attitude(&self, row: u32) -> Rotation {
        self.attitudes.get(row as usize).copied().unwrap_or(Rotation::IDENTITY)
    }

    /// True if some beams have an individual origin.
    #[inline]
    pub fn has_origins(&self) -> bool {
        !self.origins.is_empty()
    }

    /// Origin of the beam of a row in the frame of the emitter, m.
    pub fn origin(&self, row: u32) -> DVec3 {
        self.origins.get(row as usize).copied().unwrap_or(DVec3::ZERO)
    }

    /// A beam straight ahead with the mean elevation of all.
    pub fn mean_beam(&self) -> DVec3 {
        let up = |attitude: &Rotation| libm::asin(attitude.forward().z.clamp(-1.0, 1.0));
        let mean = self.attitudes.iter().map(up).sum::<f64>() / self.attitudes.len().max(1) as f64;
        Rotation::about_x(mean).forward()
    }
}

/// The rotation from the y axis to a direction.
fn attitude(azimuth: f64, elevation: f64) -> Rotation {
    Rotation::about_z(-azimuth).after(Rotation::about_x(elevation))
}

/// Counts and a checksum, which distinguish different patterns without storing all of them.
impl std::fmt::Debug for PatternTable {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let vector = |v: DVec3| v.to_array().map(f64::to_bits);
        let beams = self.attitudes.iter().flat_map(|a| std::iter::once(a.w.to_bits()).chain(vector(a.u)));
        let origins = self.origins.iter().flat_map(|origin| vector(*origin));
        let sum = fold_words(beams.chain(origins).chain(self.before.iter().map(|count| u64::from(*count))));
        let again = if self.repeats { "again and again" } else { "once" };
        write!(f, "{} beams in {} steps {again}, {sum:016x}", self.attitudes.len(), self.steps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, TAU};

    fn beam(step: u32, azimuth: f64, elevation: f64) -> PatternBeam {
        PatternBeam { step, azimuth, elevation, origin: DVec3::ZERO }
    }

    #[test]
    fn steps_without_a_beam_have_no_row() {
        let table = PatternTable::new(&[beam(1, 0.1, 0.0), beam(2, 0.2, 0.0), beam(4, 0.3, 0.0)], 6, true);
        let rows: Vec<Option<u32>> = (0..7).map(|step| table.row(step)).collect();
        assert_eq!(rows, [None, Some(0), Some(1), None, Some(2), None, None]);
        assert_eq!((table.step_after(4, 1), table.step_after(4, 2), table.step_after(5, 13)), (5, 0, 0));
        assert_eq!(
            (table.beams_within(0, 6), table.beams_within(2, 3), table.beams_within(4, 10)),
            (3, 2, 5)
        );
    }

    #[test]
    fn a_pattern_that_does_not_repeat_ends() {
        let table = PatternTable::new(&[beam(0, 0.0, 0.0), beam(1, 0.0, 0.1)], 2, false);
        assert_eq!((table.step_after(0, 9), table.row(2), table.beams_within(0, 9)), (2, None, 2));
        assert_eq!((table.step_after(2, 1), table.beams_within(2, 5)), (2, 0));
        let empty = PatternTable::default();
        assert_eq!((empty.row(0), empty.step_after(0, 3), empty.beams_within(0, 3)), (None, 0, 0));
    }

    #[test]
    fn beams_out_of_order_are_left_out() {
        let table = PatternTable::new(&[beam(2, 0.0, 0.0), beam(1, 0.0, 0.0), beam(9, 0.0, 0.0)], 4, false);
        assert_eq!((table.len(), table.row(2)), (1, Some(0)));
    }

    #[test]
    fn different_patterns_have_different_debug_texts() {
        let of =
            |azimuth: f64, repeats| format!("{:?}", PatternTable::new(&[beam(0, azimuth, 0.0)], 1, repeats));
        assert_ne!(of(0.1, true), of(0.1 + 1e-15, true));
        assert_ne!(of(0.1, true), of(0.1, false));
    }

    proptest! {
        #[test]
        fn directions_are_those_of_the_angles(azimuth in -TAU..TAU, elevation in -FRAC_PI_2..FRAC_PI_2) {
            let table = PatternTable::new(&[beam(0, azimuth, elevation)], 1, true);
            let (sin, cos) = libm::sincos(azimuth);
            let (up, level) = libm::sincos(elevation);
            let off = table.attitude(0).forward() - DVec3::new(level * sin, level * cos, up);
            prop_assert!(off.length() < 4e-15, "{off}");
        }

        #[test]
        fn many_steps_at_once_are_single_steps(
            fires in prop::collection::vec(any::<bool>(), 1..20),
            repeats in any::<bool>(),
            start in 0..20u32,
            count in 0..70u32,
        ) {
            let steps = fires.len() as u32;
            let beams: Vec<PatternBeam> =
                (0..steps).filter(|step| fires[*step as usize]).map(|step| beam(step, 0.0, 0.0)).collect();
            let table = PatternTable::new(&beams, steps, repeats);
            let start = start % steps;
            let (mut step, mut fired) = (start, 0);
            for _ in 0..count {
                fired += u32::from(table.row(step).is_some());
                step = table.step_after(step, 1);
            }
            prop_assert_eq!((table.step_after(start, count), table.beams_within(start, count)), (step, fired));
        }
    }
}
