//! Values on axes.

use super::drawing::{Anchor, Drawing, Role};
use super::label::{round_below, round_number};

/// A range of values that an axis shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// The value at its beginning.
    pub low: f64,
    /// The value at its end.
    pub high: f64,
    /// True if distances show ratios.
    pub is_log: bool,
}

impl Axis {
    /// A linear axis; one without extent gets one.
    pub fn new(low: f64, high: f64) -> Axis {
        Axis { low, high: if high > low { high } else { low + 1.0 }, is_log: false }
    }

    /// A logarithmic axis of positive values with room at both ends, or a linear one from 0; of nothing, an
    /// axis to 2.
    pub fn around(values: impl Iterator<Item = f64>, is_log: bool) -> Axis {
        let shown = values.filter(|v| v.is_finite() && (!is_log || *v > 0.0));
        let (low, high) =
            shown.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (1.0, 2.0) };
        match is_log {
            true => Axis { low: low / 1.15, high: high * 1.15, is_log },
            false => Axis::new(0.0, high * 1.05),
        }
    }

    /// Position of a value on the axis: 0 at its beginning, 1 at its end.
    pub fn place(&self, value: f64) -> f64 {
        let scaled = |v: f64| if self.is_log { libm::log(v.max(1e-300)) } else { v };
        (scaled(value) - scaled(self.low)) / (scaled(self.high) - scaled(self.low))
    }

    /// About `count` round values on the axis with their names; powers of two where they show ratios.
    pub fn ticks(&self, count: f64) -> Vec<(f64, String)> {
        let step = round_below((self.high - self.low) / count);
        if self.is_log {
            let [first, last] = [self.low, self.high].map(|v| libm::floor(libm::log2(v)) as i32);
            let every = ((last - first) / 8).max(1) as usize;
            let powers = (first..=last).step_by(every).map(|e| libm::ldexp(1.0, e));
            let powers: Vec<f64> = powers.filter(|t| *t >= self.low).collect();
            // Within two doublings there are too few of them.
            if powers.len() > 2 {
                return powers.into_iter().map(|t| (t, t.to_string())).collect();
            }
        }
        labelled(steps(self.low, self.high, step), step)
    }
}

/// The multiples of `step` from `low` to `high`, at most 64.
pub fn steps(low: f64, high: f64, step: f64) -> impl Iterator<Item = f64> {
    let first = (low / step).ceil();
    (0..64).map(move |i| (first + f64::from(i)) * step).take_while(move |v| *v <= high)
}

/// Multiples of `step` with their names.
pub fn labelled(values: impl Iterator<Item = f64>, step: f64) -> Vec<(f64, String)> {
    values.map(|value| (value, round_number(value, step))).collect()
}

/// The field of a chart on a drawing, in dots, and the values at its sides.
#[derive(Clone, Copy, Debug)]
pub struct Plot {
    /// The left side.
    pub left: f64,
    /// The right side.
    pub right: f64,
    /// The upper side.
    pub top: f64,
    /// The lower side.
    pub bottom: f64,
    /// Values from left to right.
    pub x: Axis,
    /// Values from the lower to the upper side.
    pub y: Axis,
}

impl Plot {
    /// Position of a point in the drawing.
    pub fn at(&self, x: f64, y: f64) -> [f64; 2] {
        [
            self.left + self.x.place(x) * (self.right - self.left),
            self.bottom - self.y.place(y) * (self.bottom - self.top),
        ]
    }

    /// Draws lines at the ticks of both axes, with their names at the left and below.
    pub fn grid(&self, drawing: &mut Drawing, x: Vec<(f64, String)>, y: Vec<(f64, String)>) {
        let t = drawing.text;
        for (value, name) in y {
            let [_, y] = self.at(self.x.low, value);
            drawing.line([self.left, y], [self.right, y], Role::Grid);
            drawing.write([self.left - 8.0 * t, y - 3.0 * t], name, Role::Faint, Anchor::End);
        }
        for (value, name) in x {
            let [x, _] = self.at(value, self.y.low);
            drawing.line([x, self.top], [x, self.bottom + 4.0 * t], Role::Grid);
            drawing.write([x, self.bottom + 10.0 * t], name, Role::Ink, Anchor::Middle);
        }
        drawing.line([self.left, self.bottom], [self.right, self.bottom], Role::Faint);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_hold_all_values_and_have_round_ticks() {
        for (values, is_log) in
            [(vec![0.13, 7.9], false), (vec![1.0, 512.0], true), (vec![3.0], true), (vec![], false)]
        {
            let axis = Axis::around(values.iter().copied(), is_log);
            assert!(values.iter().all(|v| (0.0..=1.0).contains(&axis.place(*v))), "{values:?}");
            let ticks = axis.ticks(5.0);
            assert!((1..=12).contains(&ticks.len()), "{values:?}: {ticks:?}");
            let is_named =
                |(value, name): &(f64, String)| (name.parse::<f64>().unwrap() - value).abs() < 1e-9;
            assert!(ticks.iter().all(is_named), "{ticks:?}");
        }
        let names: Vec<String> = Axis::new(-1.0, 1.0).ticks(4.0).into_iter().map(|tick| tick.1).collect();
        assert_eq!(names, ["-1.0", "-0.5", "0.0", "0.5", "1.0"]);
    }
}
