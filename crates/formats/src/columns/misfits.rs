//! Values that do not fit their attributes.

use super::Attribute;

/// The attributes of a point whose values in the file do not fit their types here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Misfits(u16);

impl Misfits {
    /// The attributes, in their order.
    pub fn attributes(self) -> impl Iterator<Item = Attribute> {
        // Nearly all points have none, so that no attribute is looked at.
        let mut left = self.0;
        std::iter::from_fn(move || {
            let next = left.trailing_zeros() as usize;
            left &= left.wrapping_sub(1);
            Attribute::ALL.get(next).copied()
        })
    }

    /// True if the value of `attribute` in the file does not fit its type.
    pub fn has(self, attribute: Attribute) -> bool {
        self.0 & 1 << attribute as u16 != 0
    }

    /// These attributes without one of them.
    pub fn without(self, attribute: Attribute) -> Misfits {
        Misfits(self.0 & !(1 << attribute as u16))
    }

    /// A value of an attribute, limited to values that fit; others are noted: numbers have no fraction and
    /// are within the attribute's range; NaN becomes 0.
    pub fn fitted(&mut self, attribute: Attribute, value: f64) -> f64 {
        let whole_numbers = attribute.entry().whole_numbers;
        // Most whole numbers fit, and a conversion takes less time than to round.
        let is_in_range = whole_numbers.is_some_and(|(min, max)| (min..=max).contains(&value));
        if is_in_range && value as i64 as f64 == value {
            return value;
        }
        let fitted = match whole_numbers {
            _ if value.is_nan() => 0.0,
            Some((min, max)) => value.trunc().clamp(min, max),
            None if value.is_infinite() => 0.0,
            None => value,
        };
        if fitted != value {
            self.0 |= 1 << attribute as u16;
        }
        fitted
    }
}
