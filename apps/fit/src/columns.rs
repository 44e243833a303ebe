//! Values of very many points in little memory. Each has the bits that it was added with.

use std::collections::HashMap;
use vlscan_formats::PositionSteps;
use vlscan_geom::DVec3;

/// Positions: 12 bytes each if all are in the steps of their file, or of single precision; 24 bytes
/// otherwise.
#[derive(Clone, Debug)]
pub(crate) enum Places {
    /// Numbers of steps.
    Steps { of: PositionSteps, steps: Vec<[i32; 3]> },
    /// Single precision, m.
    Single(Vec<[f32; 3]>),
    /// m.
    Metres(Vec<DVec3>),
}

impl Default for Places {
    fn default() -> Places {
        Places::Single(Vec::new())
    }
}

impl Places {
    /// None yet, with room for some; those of a file in `steps` are probably in them.
    pub fn with_room(count: usize, steps: Option<PositionSteps>) -> Places {
        match steps {
            Some(of) => Places::Steps { of, steps: Vec::with_capacity(count) },
            None => Places::Single(Vec::with_capacity(count)),
        }
    }

    /// Adds a position, m.
    pub fn push(&mut self, position: DVec3) {
        match self {
            Places::Steps { of, steps } => match of.steps(position) {
                Some(step) => return steps.push(step),
                None => {
                    let mut all = Vec::with_capacity(steps.capacity());
                    all.extend(steps.iter().map(|step| of.position(*step)));
                    *self = Places::Metres(all);
                }
            },
            Places::Single(places) => match single(position) {
                Some(place) => return places.push(place),
                None => {
                    let mut all = Vec::with_capacity(places.capacity());
                    all.extend(places.iter().map(|place| DVec3::from(place.map(f64::from))));
                    *self = Places::Metres(all);
                }
            },
            Places::Metres(_) => {}
        }
        if let Places::Metres(all) = self {
            all.push(position);
        }
    }

    /// The position of an index, m.
    pub fn get(&self, index: usize) -> DVec3 {
        match self {
            Places::Steps { of, steps } => of.position(steps[index]),
            Places::Single(places) => places[index].map(f64::from).into(),
            Places::Metres(all) => all[index],
        }
    }

    /// Adds a copy of the position of an index.
    pub fn repeat(&mut self, index: usize) {
        match self {
            Places::Steps { steps, .. } => steps.extend(steps.get(index).copied()),
            Places::Single(places) => places.extend(places.get(index).copied()),
            Places::Metres(all) => all.extend(all.get(index).copied()),
        }
    }

    /// Copies the position of an index to another one.
    pub fn copy(&mut self, from: usize, to: usize) {
        match self {
            Places::Steps { steps, .. } => steps[to] = steps[from],
            Places::Single(places) => places[to] = places[from],
            Places::Metres(all) => all[to] = all[from],
        }
    }

    /// Keeps the first positions, and releases the memory of the others.
    pub fn truncate(&mut self, count: usize) {
        match self {
            Places::Steps { steps, .. } => shorten(steps, count),
            Places::Single(places) => shorten(places, count),
            Places::Metres(all) => shorten(all, count),
        }
    }
}

/// A position in single precision; `None` if it has other bits then.
fn single(position: DVec3) -> Option<[f32; 3]> {
    let place = position.to_array().map(|coordinate| coordinate as f32);
    let is_same = |(place, coordinate): (f32, f64)| f64::from(place).to_bits() == coordinate.to_bits();
    place.into_iter().zip(position.to_array()).all(is_same).then_some(place)
}

/// Keeps the first values, and releases the memory of the others.
pub(crate) fn shorten<T>(values: &mut Vec<T>, count: usize) {
    values.truncate(count);
    values.shrink_to_fit();
}

/// Scan angles: 2 bytes each as long as there are at most 65,536 different ones, as in LAS; 8 bytes
/// otherwise.
#[derive(Clone, Debug)]
pub(crate) enum Angles {
    /// Different angles, and their numbers by bits; the number of the angle of each index.
    Few { values: Vec<f64>, numbers: HashMap<u64, u16>, of: Vec<u16> },
    /// The angle of each index.
    Many(Vec<f64>),
}

impl Default for Angles {
    fn default() -> Angles {
        Angles::with_room(0)
    }
}

impl Angles {
    /// None yet, with room for some.
    pub fn with_room(count: usize) -> Angles {
        Angles::Few { values: Vec::new(), numbers: HashMap::new(), of: Vec::with_capacity(count) }
    }

    /// Adds an angle.
    pub fn push(&mut self, angle: f64) {
        if let Angles::Few { values, numbers, of } = self {
            let known = numbers.get(&angle.to_bits()).copied();
            if let Some(number) = known.or_else(|| u16::try_from(values.len()).ok()) {
                if known.is_none() {
                    values.push(angle);
                    numbers.insert(angle.to_bits(), number);
                }
                return of.push(number);
            }
            let mut all = Vec::with_capacity(of.capacity());
            all.extend(of.iter().map(|number| values[usize::from(*number)]));
            *self = Angles::Many(all);
        }
        if let Angles::Many(all) = self {
            all.push(angle);
        }
    }

    /// The angle of an index.
    pub fn get(&self, index: usize) -> f64 {
        match self {
            Angles::Few { values, of, .. } => values[usize::from(of[index])],
            Angles::Many(all) => all[index],
        }
    }

    /// Adds a copy of the angle of an index.
    pub fn repeat(&mut self, index: usize) {
        match self {
            Angles::Few { of, .. } => of.extend(of.get(index).copied()),
            Angles::Many(all) => all.extend(all.get(index).copied()),
        }
    }

    /// Copies the angle of an index to another one.
    pub fn copy(&mut self, from: usize, to: usize) {
        match self {
            Angles::Few { of, .. } => of[to] = of[from],
            Angles::Many(all) => all[to] = all[from],
        }
    }

    /// Keeps the first angles, and releases the memory of the others.
    pub fn truncate(&mut self, count: usize) {
        match self {
            Angles::Few { of, .. } => shorten(of, count),
            Angles::Many(all) => shorten(all, count),
        }
    }

    /// Replaces all angles.
    pub fn change(&mut self, new: impl Fn(f64) -> f64) {
        let values = match self {
            Angles::Few { values, numbers, .. } => {
                // Angles that are added later are different ones.
                numbers.clear();
                values
            }
            Angles::Many(all) => all,
        };
        values.iter_mut().for_each(|angle| *angle = new(*angle));
    }
}

/// Whole numbers that are mostly equal: no memory as long as all are, 2 bytes each otherwise.
#[derive(Clone, Debug, Default)]
pub(crate) struct Numbers {
    /// The number of all indices, if `all` is empty.
    common: u16,
    all: Vec<u16>,
    count: usize,
}

impl Numbers {
    /// Adds a number.
    pub fn push(&mut self, number: u16) {
        if self.all.is_empty() && self.count > 0 && number != self.common {
            self.all = vec![self.common; self.count];
        }
        if self.count == 0 {
            self.common = number;
        } else if !self.all.is_empty() {
            self.all.push(number);
        }
        self.count += 1;
    }

    /// The number of an index.
    pub fn get(&self, index: usize) -> u16 {
        self.all.get(index).copied().unwrap_or(self.common)
    }

    /// Adds a copy of the number of an index.
    pub fn repeat(&mut self, index: usize) {
        self.push(self.get(index));
    }

    /// Copies the number of an index to another one.
    pub fn copy(&mut self, from: usize, to: usize) {
        if !self.all.is_empty() {
            self.all[to] = self.all[from];
        }
    }

    /// Keeps the first numbers, and releases the memory of the others.
    pub fn truncate(&mut self, count: usize) {
        shorten(&mut self.all, count);
        self.count = self.count.min(count);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_keep_their_bits_in_steps_and_in_metres() {
        let scale = DVec3::splat(0.001);
        let of = PositionSteps { scale, offset: DVec3::new(4e5, 5e6, 0.0), metres: DVec3::ONE };
        let in_steps: Vec<DVec3> = (0..100).map(|i| of.position([i * 7919, -i, i % 7])).collect();
        for steps in [None, Some(of)] {
            for others in [vec![], vec![DVec3::new(0.1, 1e12, -0.0)]] {
                let all = [&in_steps[..], &others].concat();
                let mut places = Places::with_room(3, steps);
                all.iter().for_each(|p| places.push(*p));
                let is_narrow = steps.is_some() && others.is_empty();
                assert_eq!(matches!(places, Places::Steps { .. }), is_narrow);
                let bits = |p: DVec3| p.to_array().map(f64::to_bits);
                assert!((0..all.len()).all(|i| bits(places.get(i)) == bits(all[i])));
                places.repeat(5);
                places.copy(7, 0);
                assert_eq!((places.get(all.len()), places.get(0)), (all[5], all[7]));
                places.truncate(2);
                assert_eq!(places.get(1), all[1]);
            }
        }
    }

    #[test]
    fn positions_of_single_precision_are_narrow_as_long_as_all_are() {
        let mut places = Places::default();
        let narrow = [DVec3::new(0.5, -0.0, 1e10), DVec3::from([1.1_f32, -2.3, 1e-30].map(f64::from))];
        narrow.iter().for_each(|p| places.push(*p));
        assert!(matches!(places, Places::Single(_)));
        places.push(DVec3::new(0.1, 0.0, 0.0));
        assert!(matches!(places, Places::Metres(_)));
        let bits = |p: DVec3| p.to_array().map(f64::to_bits);
        let expected = [narrow[0], narrow[1], DVec3::new(0.1, 0.0, 0.0)];
        assert!((0..3).all(|i| bits(places.get(i)) == bits(expected[i])));
    }

    #[test]
    fn angles_keep_their_bits_however_many_there_are() {
        for different in [10, 70_000] {
            let angle = |i: u32| f64::from(i % different) * 0.006 - 12.0;
            let mut angles = Angles::default();
            (0..140_000).for_each(|i| angles.push(angle(i)));
            assert_eq!(matches!(angles, Angles::Few { .. }), different == 10);
            assert!((0..140_000).all(|i| angles.get(i as usize) == angle(i)));
            angles.repeat(9);
            angles.copy(3, 4);
            angles.change(|angle| -2.0 * angle);
            let found = [4, 140_000].map(|i| angles.get(i));
            assert_eq!(found, [3, 9].map(|i| -2.0 * angle(i)));
            angles.push(angle(1));
            assert_eq!((angles.get(140_001), angles.get(1)), (angle(1), -2.0 * angle(1)));
            angles.truncate(2);
            assert_eq!(angles.get(1), -2.0 * angle(1));
        }
    }

    #[test]
    fn equal_numbers_take_no_memory() {
        let mut numbers = Numbers::default();
        (0..5).for_each(|_| numbers.push(7));
        numbers.copy(0, 3);
        assert!(numbers.all.is_empty() && numbers.get(4) == 7);
        numbers.push(9);
        numbers.copy(5, 1);
        numbers.repeat(5);
        assert_eq!((0..7).map(|i| numbers.get(i)).collect::<Vec<_>>(), [7, 9, 7, 7, 7, 9, 9]);
        numbers.truncate(2);
        assert_eq!((numbers.get(0), numbers.get(1), numbers.count), (7, 9, 2));
    }
}
