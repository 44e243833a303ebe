//! Exponentials of small arguments.

/// Bound of the arguments for which the series is used.
pub const MAX_SERIES_ARGUMENT: f64 = 1.0 / 16.0;

/// e^x. Near 0, where most arguments of the energy models lie, a series of 10 terms is exact to the last
/// digit.
pub fn exponential(x: f64) -> f64 {
    if x.abs() < MAX_SERIES_ARGUMENT { 1.0 + x * series(x) } else { libm::exp(x) }
}

/// e^x − 1.
pub fn exponential_minus_one(x: f64) -> f64 {
    if x.abs() < MAX_SERIES_ARGUMENT { x * series(x) } else { libm::expm1(x) }
}

/// (e^x − 1)/x for small x: Σ x^k/(k+1)!.
#[inline(always)]
pub fn series(x: f64) -> f64 {
    const C: [f64; 10] = [
        1.0,
        1.0 / 2.0,
        1.0 / 6.0,
        1.0 / 24.0,
        1.0 / 120.0,
        1.0 / 720.0,
        1.0 / 5040.0,
        1.0 / 40320.0,
        1.0 / 362880.0,
        1.0 / 3628800.0,
    ];
    let square = x * x;
    let fourth = square * square;
    let low = (C[0] + C[1] * x) + square * (C[2] + C[3] * x);
    let middle = (C[4] + C[5] * x) + square * (C[6] + C[7] * x);
    let high = C[8] + C[9] * x;
    low + fourth * (middle + fourth * high)
}
