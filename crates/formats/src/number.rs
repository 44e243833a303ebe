//! Formatting of numbers with a fixed number of decimals: the digits of `format!` in a fraction of its time.
//! Writing text is bound by this conversion (docs/dev/speed.md).

use std::io::Write as _;

const PAIRS: [[u8; 2]; 100] = {
    let mut pairs = [[0; 2]; 100];
    let mut i = 0;
    while i < 100 {
        pairs[i] = [b'0' + (i / 10) as u8, b'0' + (i % 10) as u8];
        i += 1;
    }
    pairs
};

/// Appends `value` with `DECIMALS` decimals (1 to 9) like C's `printf("%.nf")`: the exact binary value is
/// rounded to the nearest decimal, ties to even, and a negative value that rounds to zero keeps its sign.
/// Values that are not finite become `nan`, `inf` and `-inf`.
pub fn push_fixed<const DECIMALS: u32>(out: &mut Vec<u8>, value: f64) {
    match scaled::<DECIMALS>(value) {
        Some(scaled) => push_scaled::<DECIMALS>(out, value.is_sign_negative(), scaled),
        None => push_slowly(out, value, DECIMALS as usize),
    }
}

/// Appends an integer.
pub fn push_integer(out: &mut Vec<u8>, value: impl itoa::Integer) {
    out.extend_from_slice(itoa::Buffer::new().format(value).as_bytes());
}

/// Returns `|value|·10^DECIMALS` rounded to the nearest integer, ties to even; `None` when it exceeds 63
/// bits.
fn scaled<const DECIMALS: u32>(value: f64) -> Option<u64> {
    let bits = value.to_bits();
    let exponent = (bits >> 52) & 0x7ff;
    // |value| = mantissa / 2^shift
    let shift = 1075u64.checked_sub(exponent).filter(|&s| s > 0)?;
    if shift >= 128 {
        return Some(0);
    }
    let mantissa = (bits & ((1 << 52) - 1)) | (1 << 52);
    let product = u128::from(mantissa) * u128::from(10u64.pow(DECIMALS));
    let whole = u64::try_from(product >> shift).ok().filter(|w| w >> 63 == 0)?;
    let rest = product & ((1u128 << shift) - 1);
    let half = 1u128 << (shift - 1);
    Some(whole + u64::from(rest > half || (rest == half && whole & 1 == 1)))
}

fn push_scaled<const DECIMALS: u32>(out: &mut Vec<u8>, negative: bool, scaled: u64) {
    let mut text = [0u8; 24];
    let mut at = text.len();
    let unit = const { 10u64.pow(DECIMALS) };
    let (mut whole, mut fraction) = (scaled / unit, scaled % unit);
    for _ in 0..DECIMALS / 2 {
        at -= 2;
        text[at..at + 2].copy_from_slice(&PAIRS[(fraction % 100) as usize]);
        fraction /= 100;
    }
    if DECIMALS % 2 == 1 {
        at -= 1;
        text[at] = b'0' + fraction as u8;
    }
    at -= 1;
    text[at] = b'.';
    while whole >= 10 {
        at -= 2;
        text[at..at + 2].copy_from_slice(&PAIRS[(whole % 100) as usize]);
        whole /= 100;
    }
    if whole > 0 || text[at] == b'.' {
        at -= 1;
        text[at] = b'0' + whole as u8;
    }
    if negative {
        at -= 1;
        text[at] = b'-';
    }
    out.extend_from_slice(&text[at..]);
}

#[cold]
fn push_slowly(out: &mut Vec<u8>, value: f64, decimals: usize) {
    if value.is_nan() {
        out.extend_from_slice(b"nan");
    } else {
        // Writing to a vector cannot fail.
        let _ = write!(out, "{value:.decimals$}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fixed<const DECIMALS: u32>(value: f64) -> String {
        let mut out = Vec::new();
        push_fixed::<DECIMALS>(&mut out, value);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn reads_as_printf_writes() {
        for (value, four, nine) in [
            (0.0, "0.0000", "0.000000000"),
            (-0.0, "-0.0000", "-0.000000000"),
            (-0.00004, "-0.0000", "-0.000040000"),
            (1.0, "1.0000", "1.000000000"),
            (9.99995, "10.0000", "9.999950000"),
            (9.99994, "9.9999", "9.999940000"),
            (0.03125, "0.0312", "0.031250000"),
            (0.09375, "0.0938", "0.093750000"),
            (-2.83804, "-2.8380", "-2.838040000"),
            (5474500.12345, "5474500.1234", "5474500.123450000"),
            (86391.0, "86391.0000", "86391.000000000"),
            (100.5, "100.5000", "100.500000000"),
            (1234.0, "1234.0000", "1234.000000000"),
            (12345.0, "12345.0000", "12345.000000000"),
        ] {
            assert_eq!((fixed::<4>(value).as_str(), fixed::<9>(value).as_str()), (four, nine));
        }
    }

    #[test]
    fn halves_go_to_the_even_neighbour() {
        for i in 0..4000i32 {
            let value = f64::from(i - 2000) / 32.0;
            assert_eq!(fixed::<4>(value), format!("{value:.4}"));
        }
    }

    #[test]
    fn extremes_and_what_is_no_number() {
        for value in [
            f64::MAX,
            f64::MIN,
            f64::MIN_POSITIVE,
            5e-324,
            1e15,
            2f64.powi(52),
            2f64.powi(53),
            9.3e14,
            9.2e14,
        ] {
            assert_eq!(fixed::<4>(value), format!("{value:.4}"));
            assert_eq!(fixed::<9>(-value), format!("{:.9}", -value));
        }
        assert_eq!([fixed::<4>(f64::NAN), fixed::<4>(-f64::NAN)], ["nan", "nan"]);
        assert_eq!([fixed::<4>(f64::INFINITY), fixed::<4>(f64::NEG_INFINITY)], ["inf", "-inf"]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        #[test]
        fn any_bit_pattern(bits: u64) {
            let value = f64::from_bits(bits);
            prop_assume!(!value.is_nan());
            prop_assert_eq!(fixed::<4>(value), format!("{value:.4}"));
            prop_assert_eq!(fixed::<9>(value), format!("{value:.9}"));
        }

        #[test]
        fn usual_magnitudes(value in -1e7f64..1e7, small in -1e-3f64..1e-3, week in 0f64..604_800.0) {
            for v in [value, small, week] {
                prop_assert_eq!(fixed::<4>(v), format!("{v:.4}"));
                prop_assert_eq!(fixed::<9>(v), format!("{v:.9}"));
                prop_assert_eq!(fixed::<6>(v), format!("{v:.6}"));
            }
        }
    }
}
