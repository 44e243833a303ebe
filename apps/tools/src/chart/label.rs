//! Numbers formatted for people.

use vlscan_base::quantity::fixed;

/// Groups digits: 1234567 becomes "1 234 567".
pub(crate) fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, d) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(d);
    }
    text
}

/// Formats metres, with fewer decimals for larger values.
pub(crate) fn metres(m: f64) -> String {
    match m.abs() {
        a if a >= 1000.0 => fixed(m, 0),
        a if a >= 100.0 => fixed(m, 1),
        _ => fixed(m, 2),
    }
}

/// Formats a value with three digits.
pub(crate) fn significant(value: f64) -> String {
    let digits = if value == 0.0 { 0 } else { libm::log10(value.abs()).floor() as i32 };
    match digits {
        -4..=5 => fixed(value, (2 - digits).max(0) as usize),
        _ => format!("{value:.2e}"),
    }
}

/// Formats a percentage.
pub(crate) fn share(percent: f64) -> String {
    match percent {
        p if p >= 9.95 => format!("{p:.0}%"),
        p if p >= 0.095 => format!("{p:.1}%"),
        _ => "<0.1%".to_owned(),
    }
}

/// The largest of 1, 2, 5 × 10ⁿ that is not above `limit`.
pub(crate) fn round_below(limit: f64) -> f64 {
    if !(limit > 1e-12 && limit.is_finite()) {
        return 1.0;
    }
    let mut decade = 1.0;
    while decade > limit {
        decade /= 10.0;
    }
    while decade * 10.0 <= limit {
        decade *= 10.0;
    }
    [5.0, 2.0, 1.0].into_iter().map(|m| m * decade).find(|m| *m <= limit).unwrap_or(decade)
}

/// Formats a multiple of `step` without unnecessary decimals.
pub(crate) fn round_number(value: f64, step: f64) -> String {
    let decimals = (0..9).find(|d| step * 10f64.powi(*d) > 0.999).unwrap_or(9);
    fixed(value, decimals as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!(grouped(0), "0");
        assert_eq!(grouped(999), "999");
        assert_eq!(grouped(7_333_333), "7 333 333");
        assert_eq!(metres(12.345), "12.35");
        assert_eq!(metres(5_474_500.25), "5474500");
        assert_eq!(share(0.01), "<0.1%");
        assert_eq!(round_below(0.07), 0.05);
        assert_eq!(round_below(49.9), 20.0);
        assert_eq!(round_below(f64::NAN), 1.0);
        assert_eq!(round_number(-0.0, 5.0), "0");
        assert_eq!(round_number(2.5, 0.5), "2.5");
        assert_eq!(round_number(120.0, 20.0), "120");
    }
}
