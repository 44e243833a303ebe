//! Positions in memory: 12 bytes each if the file has them in steps, 24 bytes of others.

use vlscan_geom::DVec3;

/// Positions, each with the same bits as it was added.
#[derive(Clone, Debug)]
pub(super) enum Positions {
    /// Numbers of steps of a scale from an offset, as LAS has them, m.
    Steps { scale: DVec3, offset: DVec3, steps: Vec<[i32; 3]> },
    /// Metres.
    Metres(Vec<DVec3>),
}

impl Default for Positions {
    fn default() -> Positions {
        Positions::Metres(Vec::new())
    }
}

impl Positions {
    /// No positions yet, which will probably be in steps of a scale from an offset.
    pub fn in_steps(scale: DVec3, offset: DVec3) -> Positions {
        Positions::Steps { scale, offset, steps: Vec::new() }
    }

    /// Adds a position. The first one that is in no step ends the storage in steps.
    pub fn push(&mut self, position: DVec3) {
        if let Positions::Steps { scale, offset, steps } = self {
            // The conversion saturates, which the comparison finds.
            let step = ((position - *offset) / *scale).to_array().map(|steps| steps.round() as i32);
            if has_same_bits(position_of(step, *scale, *offset), position) {
                return steps.push(step);
            }
            *self = Positions::Metres(self.iter().collect());
        }
        if let Positions::Metres(all) = self {
            all.push(position);
        }
    }

    /// The position of an index below their number.
    pub fn get(&self, index: usize) -> DVec3 {
        match self {
            Positions::Steps { scale, offset, steps } => position_of(steps[index], *scale, *offset),
            Positions::Metres(all) => all[index],
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
        (0..self.len()).map(move |index| self.get(index))
    }

    /// Keeps every second position.
    pub fn halve(&mut self) {
        match self {
            Positions::Steps { steps, .. } => halve(steps),
            Positions::Metres(all) => halve(all),
        }
    }

    /// Keeps the positions that are marked.
    pub fn retain(&mut self, is_kept: &[bool]) {
        match self {
            Positions::Steps { steps, .. } => retain(steps, is_kept),
            Positions::Metres(all) => retain(all, is_kept),
        }
    }
}

/// The position as readers of LAS compute it.
fn position_of(step: [i32; 3], scale: DVec3, offset: DVec3) -> DVec3 {
    DVec3::from(step.map(f64::from)) * scale + offset
}

fn has_same_bits(a: DVec3, b: DVec3) -> bool {
    a.to_array().map(f64::to_bits) == b.to_array().map(f64::to_bits)
}

/// Keeps every second value.
pub(super) fn halve<T: Copy>(values: &mut Vec<T>) {
    let kept = values.len().div_ceil(2);
    (0..kept).for_each(|i| values[i] = values[2 * i]);
    values.truncate(kept);
}

/// Keeps the values that are marked, and those without a mark.
pub(super) fn retain<T: Copy>(values: &mut Vec<T>, is_kept: &[bool]) {
    let mut kept = is_kept.iter();
    values.retain(|_| kept.next().copied().unwrap_or(true));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_keep_their_bits_in_steps_and_beside_them() {
        let (scale, offset) = (DVec3::new(0.001, 0.001, 0.01), DVec3::new(431_000.0, 5_412_000.0, -0.5));
        let in_steps: Vec<DVec3> = (0..1000_i32)
            .map(|i| position_of([i * 7919, -i * 104_729, i], scale, offset))
            .chain([position_of([i32::MAX, i32::MIN, 0], scale, offset)])
            .collect();
        let others = [DVec3::new(431_000.000_5, 0.0, 0.0), DVec3::new(1e9, 1e9, 1e9), DVec3::NAN];
        let mut positions = Positions::in_steps(scale, offset);
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
        positions.retain(&(0..halves.len()).map(|i| i == 3).collect::<Vec<bool>>());
        assert!(same(&positions, &halves[3..4]));
    }
}
