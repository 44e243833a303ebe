//! Computes eight normal draws at a time, bit for bit equal to [`Stream::normal`].
//!
//! Logarithm, sine and cosine repeat the steps of libm for the arguments that occur here, without branches,
//! so that the compiler can vectorise them for the instruction set of the caller into which they are inlined.

#![expect(clippy::excessive_precision, reason = "coefficients stand as they were published")]
#![expect(clippy::needless_range_loop, reason = "lanes of several arrays are counted together")]

use super::{Stream, unit_interval};
use std::f64::consts::TAU;

/// Number of normal draws that [`Stream::normals`] computes at a time.
pub const NORMALS_PER_BLOCK: usize = 8;
type Block = [f64; NORMALS_PER_BLOCK];

impl Stream {
    /// [`Stream::normal`] of eight draws.
    #[inline(always)]
    pub fn normals(
        &self,
        group: &[u32; NORMALS_PER_BLOCK],
        number: &[u64; NORMALS_PER_BLOCK],
        counter: &[u32; NORMALS_PER_BLOCK],
    ) -> Block {
        let b = self.bits_of_lanes(group, number, counter);
        let (mut x, mut angle, mut is_sine) =
            ([0.0; NORMALS_PER_BLOCK], [0.0; NORMALS_PER_BLOCK], [0; NORMALS_PER_BLOCK]);
        for i in 0..NORMALS_PER_BLOCK {
            x[i] = 1.0 - unit_interval(b[0][i] as u32, b[1][i] as u32);
            angle[i] = TAU * unit_interval(b[2][i] as u32, b[3][i] as u32);
            is_sine[i] = b[3][i] & 1;
        }
        let (log, mut out) = (logs(&x), sines(&angle, &is_sine));
        for i in 0..NORMALS_PER_BLOCK {
            out[i] *= (-2.0 * log[i]).sqrt();
        }
        out
    }

    /// [`Stream::bits`] of eight draws, stored word by word.
    #[inline(always)]
    fn bits_of_lanes(
        &self,
        group: &[u32; NORMALS_PER_BLOCK],
        number: &[u64; NORMALS_PER_BLOCK],
        counter: &[u32; NORMALS_PER_BLOCK],
    ) -> [[u64; NORMALS_PER_BLOCK]; 4] {
        const LOW: u64 = 0xffff_ffff;
        let (mut c, mut k) = ([[0; NORMALS_PER_BLOCK]; 4], self.key);
        for i in 0..NORMALS_PER_BLOCK {
            c[0][i] = number[i] & LOW;
            c[1][i] = number[i] >> 32;
            c[2][i] = u64::from(counter[i]);
            c[3][i] = u64::from(group[i].wrapping_shl(8) ^ self.purpose);
        }
        for _ in 0..10 {
            for i in 0..NORMALS_PER_BLOCK {
                let p0 = (c[0][i] & LOW) * 0xD251_1F53;
                let p1 = (c[2][i] & LOW) * 0xCD9E_8D57;
                c[0][i] = (p1 >> 32) ^ c[1][i] ^ u64::from(k[0]);
                c[1][i] = p1 & LOW;
                c[2][i] = (p0 >> 32) ^ c[3][i] ^ u64::from(k[1]);
                c[3][i] = p0 & LOW;
            }
            k = [k[0].wrapping_add(0x9E37_79B9), k[1].wrapping_add(0xBB67_AE85)];
        }
        c
    }
}

/// [`libm::log`] of normal numbers.
#[inline(always)]
fn logs(x: &Block) -> Block {
    const LN2_HI: f64 = 6.93147180369123816490e-01;
    const LN2_LO: f64 = 1.90821492927058770002e-10;
    const LG: [f64; 7] = [
        6.666666666666735130e-01,
        3.999999999940941908e-01,
        2.857142874366239149e-01,
        2.222219843214978396e-01,
        1.818357216161805012e-01,
        1.531383769920937332e-01,
        1.479819860511658591e-01,
    ];
    // The upper half of √2/2: larger mantissas belong to the next lower power of two.
    const HALF_ROOT: u64 = 0x3fe6_a09e;
    let mut out = [0.0; NORMALS_PER_BLOCK];
    for i in 0..NORMALS_PER_BLOCK {
        let bits = x[i].to_bits();
        let high = (bits >> 32) + (0x3ff0_0000 - HALF_ROOT);
        let power = f64::from((high >> 20) as i32 - 0x3ff);
        let mantissa = ((high & 0x000f_ffff) + HALF_ROOT) << 32 | (bits & 0xffff_ffff);
        let f = f64::from_bits(mantissa) - 1.0;
        let half_square = 0.5 * f * f;
        let s = f / (2.0 + f);
        let z = s * s;
        let w = z * z;
        let t1 = w * (LG[1] + w * (LG[3] + w * LG[5]));
        let t2 = z * (LG[0] + w * (LG[2] + w * (LG[4] + w * LG[6])));
        let r = t2 + t1;
        out[i] = s * (half_square + r) + power * LN2_LO - half_square + f + power * LN2_HI;
    }
    out
}

/// [`libm::sin`] where `is_sine` is 1 and [`libm::cos`] where it is 0, of angles from 0 to 2π.
#[inline(always)]
fn sines(x: &Block, is_sine: &[u64; NORMALS_PER_BLOCK]) -> Block {
    /// π/2, split into its first 33 bits and the remainder.
    const QUARTER: [f64; 2] = [1.57079632673412561417e+00, 6.07710050650619224932e-11];
    // Upper halves of odd multiples of π/4, above which the next multiple of π/2 is subtracted.
    const FROM: [u64; 4] = [0x3fe9_21fb, 0x4002_d97c, 0x400f_6a7a, 0x4015_fdbc];
    let (mut out, mut rare) = ([0.0; NORMALS_PER_BLOCK], 0);
    for i in 0..NORMALS_PER_BLOCK {
        let high = x[i].to_bits() >> 32;
        let past = [high > FROM[0], high > FROM[1], high > FROM[2], high > FROM[3]];
        let quarters = u64::from(past[0]) + u64::from(past[1]) + u64::from(past[2]) + u64::from(past[3]);
        let n = f64::from(quarters as i32);
        let z = x[i] - n * QUARTER[0];
        let y = z - n * QUARTER[1];
        let rest = (z - y) - n * QUARTER[1];
        // Near multiples of π/2 libm subtracts a more precise π/2.
        let cancels = (high & 0x000f_ffff == 0x9_21fb) & (high > FROM[0]) | (high == 0x4012_d97c);
        rare |= u64::from(cancels);
        let quadrant = quarters + 3 * is_sine[i];
        let sine = if quarters == 0 { sine_alone(y) } else { sine(y, rest) };
        let value = if quadrant & 1 == 1 { sine } else { cosine(y, rest) };
        // The cosine is negative in the second and third quadrant.
        out[i] = f64::from_bits(value.to_bits() ^ ((quadrant + 1) & 2) << 62);
    }
    if rare != 0 {
        scalar_sines(x, is_sine, &mut out);
    }
    out
}

#[cold]
#[inline(never)]
fn scalar_sines(x: &Block, is_sine: &[u64; NORMALS_PER_BLOCK], out: &mut Block) {
    for i in 0..NORMALS_PER_BLOCK {
        out[i] = if is_sine[i] == 1 { libm::sin(x[i]) } else { libm::cos(x[i]) };
    }
}

/// cos(x + y) for |x| up to π/4.
#[inline(always)]
fn cosine(x: f64, y: f64) -> f64 {
    const C: [f64; 6] = [
        4.16666666666666019037e-02,
        -1.38888888888741095749e-03,
        2.48015872894767294178e-05,
        -2.75573143513906633035e-07,
        2.08757232129817482790e-09,
        -1.13596475577881948265e-11,
    ];
    let z = x * x;
    let w = z * z;
    let r = z * (C[0] + z * (C[1] + z * C[2])) + w * w * (C[3] + z * (C[4] + z * C[5]));
    let half = 0.5 * z;
    let w = 1.0 - half;
    w + (((1.0 - w) - half) + (z * r - x * y))
}

const S: [f64; 6] = [
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
];

/// sin(x + y) for |x| up to π/4.
#[inline(always)]
fn sine(x: f64, y: f64) -> f64 {
    let z = x * x;
    let w = z * z;
    let r = S[1] + z * (S[2] + z * S[3]) + z * w * (S[4] + z * S[5]);
    let v = z * x;
    x - ((z * (0.5 * y - v * r) - y) - v * S[0])
}

/// sin(x), rounded as by libm where no multiple of π/2 was subtracted.
#[inline(always)]
fn sine_alone(x: f64) -> f64 {
    let z = x * x;
    let w = z * z;
    let r = S[1] + z * (S[2] + z * S[3]) + z * w * (S[4] + z * S[5]);
    x + z * x * (S[0] + z * r)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Purpose;
    use std::array::from_fn;

    #[test]
    fn blocks_equal_single_draws() {
        for seed in [1, u64::MAX] {
            let s = Stream::new(seed, Purpose::Range);
            for block in 0..50_000u64 {
                let group = from_fn(|i| i as u32 % 3);
                let number =
                    from_fn(|i| (block * 8 + i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (block % 50));
                let counter = from_fn(|i| (i as u32).wrapping_mul(block as u32) % 5);
                let found = s.normals(&group, &number, &counter);
                let expected: Block = from_fn(|i| s.normal(group[i], number[i], counter[i]));
                assert_eq!(found.map(f64::to_bits), expected.map(f64::to_bits), "{block}");
            }
        }
    }

    /// Some numbers with their neighbours in double precision.
    fn around(x: f64) -> Block {
        from_fn(|i| f64::from_bits(x.to_bits().saturating_add(i as u64).saturating_sub(3)))
    }

    #[test]
    fn logarithms_are_those_of_libm() {
        let smallest = 1.0 / (1u64 << 53) as f64;
        for x in (0..200_000).map(|i| f64::from(i) / 200_000.0).chain([1.0 - smallest, 0.5f64.sqrt(), 0.5]) {
            let x = around(x).map(|x| x.clamp(smallest, 1.0));
            assert_eq!(logs(&x).map(f64::to_bits), x.map(|x| libm::log(x).to_bits()), "{x:?}");
        }
    }

    #[test]
    fn sines_are_those_of_libm() {
        let eighths = (0..=8).map(|i| TAU / 8.0 * f64::from(i));
        let wide = eighths.clone().flat_map(|x| (-400..400).map(move |i| x * (1.0 + f64::from(i) * 1e-8)));
        let tiny = (20..53).map(|i| TAU / (1u64 << i) as f64);
        let even = (0..300_000).map(|i| TAU * f64::from(i) / 300_000.0);
        for x in wide.chain(eighths).chain(tiny).chain(even) {
            let x = around(x).map(|x| x.min(TAU));
            let [cosines, sines] =
                [0, 1].map(|which| sines(&x, &[which; NORMALS_PER_BLOCK]).map(f64::to_bits));
            assert_eq!(cosines, x.map(|x| libm::cos(x).to_bits()), "{x:?}");
            assert_eq!(sines, x.map(|x| libm::sin(x).to_bits()), "{x:?}");
        }
    }
}
