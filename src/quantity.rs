//! Quantities: bounds of numbers that are read, and counts with unit prefixes, durations and lengths as text.
//!
//! Numbers within the bounds neither overflow nor lose all digits in what is computed from them, so that points are
//! numbers.

/// Bounds of a number that is read, both included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    pub low: f64,
    pub high: f64,
    /// The expected number, in words.
    pub expected: &'static str,
}

impl Bounds {
    const fn new(low: f64, high: f64, expected: &'static str) -> Bounds {
        Bounds { low, high, expected }
    }

    /// Whether `value` is within the bounds; NaN is not.
    #[inline]
    pub fn contains(&self, value: f64) -> bool {
        self.low <= value && value <= self.high
    }
}

/// Any finite number.
pub const ANY: Bounds = Bounds::new(f64::MIN, f64::MAX, "a number");
pub const NUMBER: Bounds = Bounds::new(-1e12, 1e12, "a finite number from -1e12 to 1e12");
pub const POSITIVE: Bounds = Bounds::new(1e-15, 1e15, "a number above 0, from 1e-15 to 1e15");
pub const NOT_NEGATIVE: Bounds = Bounds::new(0.0, 1e15, "a number of at least 0, at most 1e15");
/// Time of a channel's pulse within its cycle, µs.
pub const FIRING_OFFSET_US: Bounds = Bounds::new(0.0, 1e6, "a number from 0 to 1e6 µs");
/// Full beam divergence, rad.
pub const DIVERGENCE: Bounds = Bounds::new(1e-9, 1.5, "a number above 0, from 1e-9 to 1.5 rad");
/// Full beam divergence of a pulse in a stream, rad.
pub const STREAMED_DIVERGENCE: Bounds = Bounds::new(0.0, 1.5, "a number of at least 0, at most 1.5 rad");
/// Maximum range of a scanner, m; any large number means none.
pub const MAX_RANGE: Bounds = Bounds::new(1e-15, f64::MAX, "a number above 0");
/// Atmospheric visibility, km; any large number means air without extinction.
pub const VISIBILITY: Bounds = Bounds::new(1e-15, f64::MAX, "a number above 0");
pub const FRACTION: Bounds = Bounds::new(1e-15, 1.0, "a fraction above 0, at most 1");
/// Coordinates and differences of them, m: also of places on Earth that were written in millimetres.
pub const COORDINATE: Bounds = Bounds::new(-1e10, 1e10, "metres from -1e10 to 1e10");
/// Times in any scale, s and ns.
pub const TIME: Bounds = Bounds::new(-1e11, 1e11, "seconds from -1e11 to 1e11");
pub const TIME_NS: Bounds = Bounds::new(-1e20, 1e20, "seconds from -1e11 to 1e11");
/// Maximum duration of a leg or a trajectory, s: 31 days.
pub const MAX_DURATION: f64 = 31.0 * 86_400.0;

/// Formats a number with a unit prefix and three digits: 1.23 M.
pub fn amount(n: f64) -> String {
    for (limit, unit) in [(1e9, " G"), (1e6, " M"), (1e3, " k")] {
        if n >= limit {
            return format!("{:.2}{unit}", n / limit);
        }
    }
    format!("{n:.0}")
}

/// Formats a duration as h:mm:ss, or as seconds below a minute, with two decimals below ten.
pub fn duration(seconds: f64) -> String {
    if !seconds.is_finite() || seconds > 1e7 {
        return "?".to_owned();
    }
    if seconds < 0.1 {
        return format!("{:.1} ms", seconds * 1e3);
    }
    if seconds < 9.995 {
        return format!("{seconds:.2} s");
    }
    let s = seconds.round() as u64;
    if s < 60 { format!("{s} s") } else { format!("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60) }
}

/// Formats a length (m) in m or km with up to three digits.
pub fn metres(length: f64) -> String {
    match length.abs() {
        m if m >= 10_000.0 => format!("{:.0} km", length / 1000.0),
        m if m >= 1000.0 => format!("{:.1} km", length / 1000.0),
        m if m >= 10.0 => format!("{length:.0} m"),
        _ => format!("{length:.1} m"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_are_short() {
        assert_eq!(amount(950.0), "950");
        assert_eq!(amount(1_234_567.0), "1.23 M");
        assert_eq!(
            [0.002_34, 0.1234, 9.994, 9.996, 42.4].map(duration),
            ["2.3 ms", "0.12 s", "9.99 s", "10 s", "42 s"]
        );
        assert_eq!(duration(3725.0), "1:02:05");
        assert_eq!([9.94, 123.4, 1234.0, 12_345.0].map(metres), ["9.9 m", "123 m", "1.2 km", "12 km"]);
    }
}
