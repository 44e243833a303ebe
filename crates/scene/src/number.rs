//! Parses decimal text to `f64`, correctly rounded, from bytes.
//!
//! Short decimals take Clinger's fast path ("How to read floating point numbers accurately", 1990): a
//! mantissa up to 2⁵³ and a power of ten up to 10²² are both exact, so one multiplication or division rounds
//! correctly. All others are parsed by the standard library.

pub(super) use vlscan_base::columns::is_blank;
pub(super) use vlscan_formats::text::float;

const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18,
    1e19, 1e20, 1e21, 1e22,
];

/// Parses the number that starts at `at` and ends before a blank or the end of `line`; returns it with its
/// end. `None` for a word that is not a number; `nan` and `inf` are accepted as numbers.
pub(super) fn float_at(line: &[u8], at: usize) -> (Option<f64>, usize) {
    let mut i = at;
    let negative = line.get(i) == Some(&b'-');
    if negative || line.get(i) == Some(&b'+') {
        i += 1;
    }
    let (mut mantissa, mut exponent, first_digit) = (0u64, 0i32, i);
    while let Some(d) = digit(line, i) {
        mantissa = mantissa.wrapping_mul(10).wrapping_add(d);
        i += 1;
    }
    let mut digits = i - first_digit;
    if line.get(i) == Some(&b'.') {
        i += 1;
        let fraction = i;
        while let Some(d) = digit(line, i) {
            mantissa = mantissa.wrapping_mul(10).wrapping_add(d);
            i += 1;
        }
        digits += i - fraction;
        exponent = -((i - fraction).min(1000) as i32);
    }
    if matches!(line.get(i), Some(b'e' | b'E')) {
        let (value, end) = exponent_at(line, i + 1);
        exponent = exponent.saturating_add(value);
        // An `e` without digits is invalid; the slow path rejects it.
        i = if end > i + 1 { end } else { i };
    }
    let complete = line.get(i).is_none_or(|&b| is_blank(b));
    // Nineteen digits cannot overflow 64 bits.
    if complete && (1..=19).contains(&digits) && mantissa <= 1 << 53 && exponent.unsigned_abs() <= 22 {
        let power = POWERS[exponent.unsigned_abs() as usize];
        let value = if exponent < 0 { mantissa as f64 / power } else { mantissa as f64 * power };
        return (Some(if negative { -value } else { value }), i);
    }
    let end = word_end(line, at);
    (float(&line[at..end]), end)
}

/// First position from `at` on that is blank or the end of `line`.
pub(super) fn word_end(line: &[u8], at: usize) -> usize {
    line[at..].iter().position(|&b| is_blank(b)).map_or(line.len(), |n| at + n)
}

/// First position from `at` on that is not blank.
pub(super) fn skip_blanks(line: &[u8], at: usize) -> usize {
    line[at..].iter().position(|&b| !is_blank(b)).map_or(line.len(), |n| at + n)
}

fn digit(line: &[u8], i: usize) -> Option<u64> {
    line.get(i).map(|b| b.wrapping_sub(b'0')).filter(|&d| d < 10).map(u64::from)
}

fn exponent_at(line: &[u8], at: usize) -> (i32, usize) {
    let negative = line.get(at) == Some(&b'-');
    let mut i = if negative || line.get(at) == Some(&b'+') { at + 1 } else { at };
    let first = i;
    let mut value = 0i32;
    while let Some(d) = digit(line, i) {
        value = value.saturating_mul(10).saturating_add(d as i32);
        i += 1;
    }
    if i == first {
        return (0, at);
    }
    (if negative { -value } else { value }, i)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn words_that_are_numbers_and_words_that_are_not() {
        for (text, value) in [
            ("0", 0.0),
            ("-12.5", -12.5),
            ("+.5", 0.5),
            ("5.", 5.0),
            ("4321987.123", 4321987.123),
            ("1e22", 1e22),
            ("1.7976931348623157e308", f64::MAX),
            ("5e-324", 5e-324),
            ("9007199254740993", 9007199254740992.0),
            ("0.1000000000000000055511151231257827", 0.1),
            ("00000000000000000000000000000000001", 1.0),
        ] {
            assert_eq!(float_at(text.as_bytes(), 0), (Some(value), text.len()), "{text}");
        }
        for text in ["", "-", ".", "1e", "1e+", "abc", "1.2.3", "1,5", "0x10", "1_000", "12\u{e9}"] {
            assert_eq!(float_at(text.as_bytes(), 0).0, None, "{text:?}");
        }
        assert!(float_at(b"nan", 0).0.is_some_and(f64::is_nan));
        assert_eq!(float_at(b"1e999999999999", 0).0, Some(f64::INFINITY));
        assert_eq!(float_at(b"1 2", 0), (Some(1.0), 1));
    }

    proptest! {
        #[test]
        fn every_decimal_agrees_with_the_standard_library(v in any::<f64>(), digits in 0usize..20) {
            for text in [format!("{v}"), format!("{v:e}"), format!("{:.digits$}", v % 1e9)] {
                let (ours, end) = float_at(text.as_bytes(), 0);
                let theirs: f64 = text.parse().unwrap();
                prop_assert_eq!(end, text.len());
                prop_assert_eq!(ours.map(f64::to_bits), Some(theirs.to_bits()), "{}", text);
            }
        }

        #[test]
        fn no_bytes_make_it_panic(bytes in proptest::collection::vec(any::<u8>(), 0..40)) {
            let (_, end) = float_at(&bytes, 0);
            prop_assert!(end <= bytes.len());
        }
    }
}
