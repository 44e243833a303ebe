//! Sums of many equal terms, rounded after every addition as a loop rounds them, without the loop.

/// Terms that are added one by one where the sum is about to leave its binade.
const MARGIN: f64 = 2.0;

/// The distance of `x` from the next number of its binade, or `None` for subnormal numbers, infinities and
/// NaN.
#[inline]
pub fn spacing(x: f64) -> Option<f64> {
    let exponent = x.to_bits() >> 52 & 0x7ff;
    (53..0x7ff).contains(&exponent).then(|| f64::from_bits((exponent - 52) << 52))
}

/// How often a term can be added to `x` such that every sum is in the binade of `x`, and what each addition
/// adds after rounding, given that `increment` is what one of them adds.
#[inline]
pub fn steps_in_binade(x: f64, increment: f64) -> f64 {
    if increment == 0.0 {
        return f64::INFINITY;
    }
    let low = f64::from_bits(x.to_bits() & 0x7ff0_0000_0000_0000);
    let outwards = (increment > 0.0) == (x > 0.0);
    let way = if outwards { 2.0 * low - x.abs() } else { x.abs() - low };
    (way / increment.abs()).floor() - MARGIN
}

/// `x` after `count` additions of `term`, each of which is rounded: bit for bit the result of a loop.
///
/// Within a binade all sums are multiples of the binade's spacing, so that rounding `x + term` adds the same
/// multiple each time, unless `term` is halfway between two multiples, where the sum's last bit decides.
pub fn add_repeatedly(mut x: f64, term: f64, mut count: u32) -> f64 {
    while count > 0 {
        let increment = (x + term) - x;
        let steps = match spacing(x) {
            Some(spacing) if (term - increment).abs() < 0.5 * spacing => steps_in_binade(x, increment),
            _ => 0.0,
        };
        if steps >= 1.0 {
            // Exact: a multiple of the spacing, in the same binade.
            let steps = steps.min(f64::from(count));
            x += steps * increment;
            count -= steps as u32;
        } else {
            x += term;
            count -= 1;
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn looped(mut x: f64, term: f64, count: u32) -> f64 {
        (0..count).for_each(|_| x += term);
        x
    }

    #[test]
    fn clocks_and_angles_advance_as_in_a_loop() {
        for (x, term) in [
            (86_391e9, 1e9 * (1.0 / 300_000.0)),
            (0.0, 1e-4),
            (-0.35, 1e-5),
            (0.0, 0.0),
            (1.0, f64::EPSILON / 2.0),
            (1.0 + f64::EPSILON, f64::EPSILON / 2.0),
            (1.0, 1.5 * f64::EPSILON),
            (-1.0, f64::MIN_POSITIVE),
            (f64::MIN_POSITIVE, -f64::MIN_POSITIVE / 8.0),
            (f64::MAX, f64::MAX / 4.0),
            (f64::NAN, 1.0),
        ] {
            for count in [0, 1, 2, 3, 100, 70_000] {
                let (found, known) = (add_repeatedly(x, term, count), looped(x, term, count));
                assert_eq!(found.to_bits(), known.to_bits(), "{count} times {term} to {x}: {found}, {known}");
            }
        }
    }

    proptest! {
        #[test]
        fn every_sum_is_that_of_a_loop(
            x in prop::num::f64::NORMAL | prop::num::f64::ZERO,
            shift in -70..10i32,
            mantissa in -2.0..2.0f64,
            short in any::<bool>(),
            count in 0..3000u32,
        ) {
            // Terms of a few bits meet ties.
            let mantissa = if short { (mantissa * 8.0).round() / 8.0 } else { mantissa };
            let term = x * mantissa * f64::powi(2.0, shift);
            prop_assert_eq!(add_repeatedly(x, term, count).to_bits(), looped(x, term, count).to_bits());
        }
    }
}
