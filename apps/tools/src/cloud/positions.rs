//! Positions: 12 bytes each if the file has them in steps, 24 bytes of others.

use super::column::{Column, HeldValues};
use vlscan_formats::PositionSteps;
use vlscan_geom::DVec3;

/// Positions, each with the same bits as it was added.
#[derive(Clone, Debug)]
pub(super) enum Positions {
    /// Numbers of steps, as LAS has them.
    Steps { of: PositionSteps, steps: Column<[i32; 3]> },
    /// Metres.
    Metres(Column<[f64; 3]>),
}

impl Positions {
    /// No positions yet.
    pub fn in_metres(max_held: HeldValues) -> Positions {
        Positions::Metres(Column::new(max_held))
    }

    /// No positions yet, which will probably be in these steps.
    pub fn in_steps(of: PositionSteps, max_held: HeldValues) -> Positions {
        Positions::Steps { of, steps: Column::new(max_held) }
    }

    /// Adds a position. The first one that is in no step ends the storage in steps.
    pub fn push(&mut self, position: DVec3) {
        if let Positions::Steps { of, steps } = self {
            if let Some(step) = of.steps(position) {
                return steps.push(step);
            }
            let mut all = Column::new(steps.max_held());
            steps.iter().for_each(|step| all.push(of.position(step).to_array()));
            *self = Positions::Metres(all);
        }
        if let Positions::Metres(all) = self {
            all.push(position.to_array());
        }
    }

    /// Adds positions.
    pub fn extend(&mut self, positions: &[DVec3]) {
        let mut rest = positions;
        if let Positions::Steps { of, steps } = self {
            let in_steps = rest.iter().map(|p| of.steps(*p)).take_while(Option::is_some);
            let before = steps.len();
            steps.extend(in_steps.flatten());
            rest = &rest[steps.len() - before..];
        }
        match self {
            // From the first position on that is in no step.
            Positions::Steps { .. } => rest.iter().for_each(|p| self.push(*p)),
            Positions::Metres(all) => all.extend(rest.iter().map(DVec3::to_array)),
        }
    }

    /// The position of an index below their number.
    pub fn get(&self, index: usize) -> DVec3 {
        match self {
            Positions::Steps { of, steps } => of.position(steps.at(index)),
            Positions::Metres(all) => all.at(index).into(),
        }
    }

    /// Maximum number of positions in memory.
    pub fn max_held(&self) -> HeldValues {
        match self {
            Positions::Steps { steps, .. } => steps.max_held(),
            Positions::Metres(all) => all.max_held(),
        }
    }

    /// Number of positions.
    pub fn len(&self) -> usize {
        match self {
            Positions::Steps { steps, .. } => steps.len(),
            Positions::Metres(all) => all.len(),
        }
    }

    /// All positions in their order.
    pub fn iter(&self) -> impl Iterator<Item = DVec3> + Clone + '_ {
        let (in_steps, in_metres) = match self {
            Positions::Steps { of, steps } => (Some(steps.iter().map(move |step| of.position(step))), None),
            Positions::Metres(all) => (None, Some(all.iter().map(DVec3::from))),
        };
        in_steps.into_iter().flatten().chain(in_metres.into_iter().flatten())
    }

    /// Keeps every second position.
    pub fn halve(&mut self) {
        match self {
            Positions::Steps { steps, .. } => steps.halve(),
            Positions::Metres(all) => all.halve(),
        }
    }

    /// Keeps the positions whose index is chosen.
    pub fn retain(&mut self, is_kept: impl FnMut(usize) -> bool) {
        match self {
            Positions::Steps { steps, .. } => steps.retain(is_kept),
            Positions::Metres(all) => all.retain(is_kept),
        }
    }

    /// Releases the memory of positions in temporary files.
    pub fn release(&self) {
        match self {
            Positions::Steps { steps, .. } => steps.release(),
            Positions::Metres(all) => all.release(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn has_same_bits(a: DVec3, b: DVec3) -> bool {
        a.to_array().map(f64::to_bits) == b.to_array().map(f64::to_bits)
    }

    #[test]
    fn positions_keep_their_bits_in_steps_and_beside_them() {
        let (scale, offset) = (DVec3::new(0.001, 0.001, 0.01), DVec3::new(431_000.0, 5_412_000.0, -0.5));
        let of = PositionSteps { scale, offset, metres: DVec3::ONE };
        let in_steps: Vec<DVec3> = (0..1000_i32)
            .map(|i| of.position([i * 7919, -i * 104_729, i]))
            .chain([of.position([i32::MAX, i32::MIN, 0])])
            .collect();
        let others = [DVec3::new(431_000.000_5, 0.0, 0.0), DVec3::new(1e9, 1e9, 1e9), DVec3::NAN];
        let mut positions = Positions::in_steps(of, HeldValues::at_most(300));
        in_steps.iter().for_each(|p| positions.push(*p));
        assert!(matches!(positions, Positions::Steps { .. }));
        let same = |positions: &Positions, expected: &[DVec3]| {
            positions.len() == expected.len()
                && positions.iter().zip(expected).all(|(a, b)| has_same_bits(a, *b))
        };
        assert!(same(&positions, &in_steps));
        for other in others {
            let mut positions = positions.clone();
            positions.push(other);
            assert!(matches!(positions, Positions::Metres(_)));
            assert!(same(&positions, &[&in_steps[..], &[other]].concat()));
        }
        let halves: Vec<DVec3> = in_steps.iter().copied().step_by(2).collect();
        positions.halve();
        assert!(same(&positions, &halves));
        positions.retain(|i| i == 3);
        assert!(same(&positions, &halves[3..4]));
    }
}
