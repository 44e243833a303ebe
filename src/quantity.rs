//! Formats quantities for people: counts with unit prefixes, durations, lengths.

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
        assert_eq!([0.1234, 9.994, 9.996, 42.4].map(duration), ["0.12 s", "9.99 s", "10 s", "42 s"]);
        assert_eq!(duration(3725.0), "1:02:05");
        assert_eq!([9.94, 123.4, 1234.0, 12_345.0].map(metres), ["9.9 m", "123 m", "1.2 km", "12 km"]);
    }
}
