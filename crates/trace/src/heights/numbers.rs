//! The stored heights of a field.

use crate::memory::vec_bytes;
use std::collections::TryReserveError;

/// The number of a vertex without data among those of 16 bits.
const HOLE: u16 = u16::MAX;

/// The numbers of a height field's vertices, row by row, in the narrowest form that keeps all of them
/// exactly. NaN stands for no data.
#[derive(Clone, Debug)]
pub enum Heights {
    /// Whole numbers less `base`; 65 535 stands for no data.
    Short {
        /// Least number that can be stored.
        base: i32,
        /// Numbers less `base`.
        values: Vec<u16>,
    },
    /// Numbers in single precision.
    Single(Vec<f32>),
    /// Numbers in double precision.
    Double(Vec<f64>),
}

impl Heights {
    /// `count` vertices without data, for whole numbers from `base` up to `base` + 65 534.
    ///
    /// # Errors
    /// When there is not enough memory.
    pub fn short(base: i32, count: usize) -> Result<Heights, TryReserveError> {
        Ok(Heights::Short { base, values: filled(HOLE, count)? })
    }

    /// `count` vertices without data, for numbers in single precision.
    ///
    /// # Errors
    /// When there is not enough memory.
    pub fn single(count: usize) -> Result<Heights, TryReserveError> {
        Ok(Heights::Single(filled(f32::NAN, count)?))
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        match self {
            Heights::Short { values, .. } => values.len(),
            Heights::Single(values) => values.len(),
            Heights::Double(values) => values.len(),
        }
    }

    /// True if there are no vertices.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The number of vertex `i`; NaN without data.
    #[inline(always)]
    pub fn get(&self, i: usize) -> f64 {
        match self {
            Heights::Short { base, values } => widen(*base, values[i]),
            Heights::Single(values) => f64::from(values[i]),
            Heights::Double(values) => values[i],
        }
    }

    /// Copies the numbers from vertex `first` on.
    #[inline(always)]
    pub(super) fn read(&self, first: usize, to: &mut [f64]) {
        let range = first..first + to.len();
        match self {
            Heights::Short { base, values } => {
                to.iter_mut().zip(&values[range]).for_each(|(to, v)| *to = widen(*base, *v));
            }
            Heights::Single(values) => {
                to.iter_mut().zip(&values[range]).for_each(|(to, v)| *to = f64::from(*v));
            }
            Heights::Double(values) => to.copy_from_slice(&values[range]),
        }
    }

    /// Replaces the numbers from vertex `first` on; those that are not finite are no data. All numbers become
    /// wider if one of these needs it.
    ///
    /// # Errors
    /// When there is not enough memory for wider numbers.
    pub fn set(&mut self, first: usize, numbers: &[f64]) -> Result<(), TryReserveError> {
        while !self.try_set(first, numbers) {
            *self = self.wider()?;
        }
        Ok(())
    }

    /// Leaves vertex `i` without data.
    pub fn remove(&mut self, i: usize) {
        match self {
            Heights::Short { values, .. } => values[i] = HOLE,
            Heights::Single(values) => values[i] = f32::NAN,
            Heights::Double(values) => values[i] = f64::NAN,
        }
    }

    /// Replaces numbers as far as they can be kept exactly; returns false at the first that cannot.
    fn try_set(&mut self, first: usize, numbers: &[f64]) -> bool {
        let range = first..first + numbers.len();
        match self {
            Heights::Short { base, values } => values[range].iter_mut().zip(numbers).all(|(to, number)| {
                let above = number - f64::from(*base);
                *to = if number.is_finite() { above as u16 } else { HOLE };
                !number.is_finite() || (*to < HOLE && f64::from(*to) == above)
            }),
            Heights::Single(values) => values[range].iter_mut().zip(numbers).all(|(to, number)| {
                *to = if number.is_finite() { *number as f32 } else { f32::NAN };
                !number.is_finite() || f64::from(*to) == *number
            }),
            Heights::Double(values) => {
                let finite = |number: &f64| if number.is_finite() { *number } else { f64::NAN };
                values[range].iter_mut().zip(numbers).for_each(|(to, number)| *to = finite(number));
                true
            }
        }
    }

    fn wider(&self) -> Result<Heights, TryReserveError> {
        let count = self.len();
        Ok(match self {
            Heights::Short { base, values } => {
                let mut all = Vec::new();
                all.try_reserve_exact(count)?;
                all.extend(values.iter().map(|v| widen(*base, *v) as f32));
                Heights::Single(all)
            }
            _ => {
                let mut all = Vec::new();
                all.try_reserve_exact(count)?;
                all.extend((0..count).map(|i| self.get(i)));
                Heights::Double(all)
            }
        })
    }

    /// Memory, bytes.
    pub fn memory(&self) -> usize {
        match self {
            Heights::Short { values, .. } => vec_bytes(values),
            Heights::Single(values) => vec_bytes(values),
            Heights::Double(values) => vec_bytes(values),
        }
    }
}

fn filled<T: Clone>(value: T, count: usize) -> Result<Vec<T>, TryReserveError> {
    let mut all = Vec::new();
    all.try_reserve_exact(count)?;
    all.resize(count, value);
    Ok(all)
}

#[inline(always)]
fn widen(base: i32, value: u16) -> f64 {
    if value == HOLE { f64::NAN } else { f64::from(base) + f64::from(value) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_wide_as_they_must_be_and_exact() {
        let mut all = Heights::short(-32_768, 6).unwrap();
        all.set(0, &[-32_768.0, 32_766.0, f64::NAN]).unwrap();
        assert!(matches!(all, Heights::Short { .. }));
        assert_eq!((all.get(0), all.get(1)), (-32_768.0, 32_766.0));
        assert!(all.get(2).is_nan() && all.get(5).is_nan());
        all.set(3, &[32_767.0]).unwrap();
        assert!(matches!(all, Heights::Single(_)), "the number of holes is no height");
        all.set(4, &[0.1]).unwrap();
        assert!(matches!(all, Heights::Double(_)));
        all.remove(1);
        let mut found = [0.0; 6];
        all.read(0, &mut found);
        assert_eq!((found[0], found[3], found[4]), (-32_768.0, 32_767.0, 0.1));
        assert!(found[1].is_nan() && found[2].is_nan() && found[5].is_nan());
        let mut fractions = Heights::short(0, 1).unwrap();
        fractions.set(0, &[2.5]).unwrap();
        assert!(matches!(fractions, Heights::Single(_)) && fractions.get(0) == 2.5);
        for beyond in [-1.0, 65_535.0, 1e9] {
            let mut all = Heights::short(0, 1).unwrap();
            all.set(0, &[beyond]).unwrap();
            assert_eq!(all.get(0), beyond);
        }
    }
}
