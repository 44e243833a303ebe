//! Plain Rust: the twin of the other sets, and the fallback.

use super::{Simd, Step};

/// See the module.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

#[inline(always)]
fn map<T: Copy, U, const N: usize>(a: [T; N], b: [T; N], f: impl Fn(T, T) -> U) -> [U; N] {
    std::array::from_fn(|i| f(a[i], b[i]))
}

#[inline(always)]
fn mask<T: Copy, const N: usize>(a: [T; N], b: [T; N], f: impl Fn(T, T) -> bool) -> u32 {
    (0..N).fold(0, |m, i| m | u32::from(f(a[i], b[i])) << i)
}

/// # Safety
/// As for [`Simd`].
#[inline(never)]
unsafe fn apart<T: Step<Portable>>(step: T) -> T::Out {
    // SAFETY: the caller vouches for the instruction set.
    unsafe { step.run() }
}

impl Simd for Portable {
    type F = [f32; 16];
    type M = u32;
    type D = [f64; 8];
    type N = u32;
    type Q = [f64; 4];
    type I = [u32; 16];

    #[inline(always)]
    unsafe fn apart<T: Step<Portable>>(step: T) -> T::Out {
        // SAFETY: the caller vouches for the instruction set.
        unsafe { apart(step) }
    }
    #[inline(always)]
    unsafe fn splat(x: f32) -> Self::F {
        [x; 16]
    }
    #[inline(always)]
    unsafe fn load(x: &[f32; 16]) -> Self::F {
        *x
    }
    #[inline(always)]
    unsafe fn store(x: &mut [f32; 16], v: Self::F) {
        *x = v;
    }
    #[inline(always)]
    unsafe fn add(a: Self::F, b: Self::F) -> Self::F {
        map(a, b, |a, b| a + b)
    }
    #[inline(always)]
    unsafe fn sub(a: Self::F, b: Self::F) -> Self::F {
        map(a, b, |a, b| a - b)
    }
    #[inline(always)]
    unsafe fn mul(a: Self::F, b: Self::F) -> Self::F {
        map(a, b, |a, b| a * b)
    }
    #[inline(always)]
    unsafe fn abs(a: Self::F) -> Self::F {
        a.map(f32::abs)
    }
    #[inline(always)]
    unsafe fn places(x: &[u32; 16]) -> [Self::I; 2] {
        [x.map(|x| x & 15), x.map(|x| x >> 4 & 15)]
    }
    #[inline(always)]
    unsafe fn pick(table: &[f32; 16], at: Self::I) -> Self::F {
        at.map(|n| table[n as usize & 15])
    }
    #[inline(always)]
    unsafe fn div(a: Self::F, b: Self::F) -> Self::F {
        map(a, b, |a, b| a / b)
    }
    #[inline(always)]
    unsafe fn min(a: Self::F, b: Self::F) -> Self::F {
        map(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    unsafe fn max(a: Self::F, b: Self::F) -> Self::F {
        map(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    unsafe fn le(a: Self::F, b: Self::F) -> u32 {
        mask(a, b, |a, b| a <= b)
    }
    #[inline(always)]
    unsafe fn and(a: u32, b: u32) -> u32 {
        a & b
    }
    #[inline(always)]
    unsafe fn or(a: u32, b: u32) -> u32 {
        a | b
    }
    #[inline(always)]
    unsafe fn bits(m: u32) -> u32 {
        m
    }
    #[inline(always)]
    unsafe fn min_where(m: u32, a: Self::F, b: Self::F) -> Self::F {
        std::array::from_fn(|i| if m >> i & 1 != 0 && b[i] < a[i] { b[i] } else { a[i] })
    }
    #[inline(always)]
    unsafe fn max_where(m: u32, a: Self::F, b: Self::F) -> Self::F {
        std::array::from_fn(|i| if m >> i & 1 != 0 && b[i] > a[i] { b[i] } else { a[i] })
    }
    #[inline(always)]
    unsafe fn lt(a: Self::F, b: Self::F) -> u32 {
        mask(a, b, |a, b| a < b)
    }
    #[inline(always)]
    unsafe fn fold_minima(low: Self::F, high: Self::F) -> Self::F {
        let least = |a: f32, b: f32| if a < b { a } else { b };
        std::array::from_fn(|i| if i < 8 { least(low[i], low[i + 8]) } else { least(high[i - 8], high[i]) })
    }
    #[inline(always)]
    unsafe fn row_minima(rows: &[[f32; 16]; 16]) -> [Self::F; 2] {
        let least = |half: &[f32]| half.iter().fold(f32::INFINITY, |m, &x| if x < m { x } else { m });
        [std::array::from_fn(|r| least(&rows[r][..8])), std::array::from_fn(|r| least(&rows[r][8..]))]
    }
    #[inline(always)]
    unsafe fn compress(mut mask: u32, base: u32, out: &mut [u32; 16]) {
        let mut n = 0;
        while mask != 0 {
            out[n & 15] = base + mask.trailing_zeros();
            mask &= mask - 1;
            n += 1;
        }
    }

    #[inline(always)]
    unsafe fn greatest(v: Self::F) -> f32 {
        v.into_iter().fold(f32::NEG_INFINITY, |m, x| if x > m { x } else { m })
    }

    #[inline(always)]
    unsafe fn dsplat(x: f64) -> Self::D {
        [x; 8]
    }
    #[inline(always)]
    unsafe fn dload(x: &[f64; 8]) -> Self::D {
        *x
    }
    #[inline(always)]
    unsafe fn dadd(a: Self::D, b: Self::D) -> Self::D {
        map(a, b, |a, b| a + b)
    }
    #[inline(always)]
    unsafe fn dsub(a: Self::D, b: Self::D) -> Self::D {
        map(a, b, |a, b| a - b)
    }
    #[inline(always)]
    unsafe fn dmul(a: Self::D, b: Self::D) -> Self::D {
        map(a, b, |a, b| a * b)
    }
    #[inline(always)]
    unsafe fn ddiv(a: Self::D, b: Self::D) -> Self::D {
        map(a, b, |a, b| a / b)
    }
    #[inline(always)]
    unsafe fn dmax(a: Self::D, b: Self::D) -> Self::D {
        map(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    unsafe fn dabs(a: Self::D) -> Self::D {
        a.map(f64::abs)
    }
    #[inline(always)]
    unsafe fn dle(a: Self::D, b: Self::D) -> u32 {
        mask(a, b, |a, b| a <= b)
    }
    #[inline(always)]
    unsafe fn dand(a: u32, b: u32) -> u32 {
        a & b
    }
    #[inline(always)]
    unsafe fn dbits(m: u32) -> u32 {
        m
    }
    #[inline(always)]
    unsafe fn narrow(low: Self::D, high: Self::D) -> Self::F {
        std::array::from_fn(|i| if i < 8 { low[i] as f32 } else { high[i - 8] as f32 })
    }
    #[inline(always)]
    unsafe fn dmask(bits: u32) -> Self::N {
        bits & 255
    }
    #[inline(always)]
    unsafe fn offer(hit: Self::N, t: &mut [f64; 8], v: Self::D, ids: &mut [u32; 8], id: u32) {
        for n in 0..8 {
            if hit >> n & 1 != 0 && (v[n] < t[n] || (v[n] == t[n] && id < ids[n])) {
                (t[n], ids[n]) = (v[n], id);
            }
        }
    }
    #[inline(always)]
    unsafe fn dgreatest(v: Self::D) -> f64 {
        v.into_iter().fold(f64::NEG_INFINITY, |m, x| if x > m { x } else { m })
    }

    #[inline(always)]
    unsafe fn qsplat(x: f64) -> Self::Q {
        [x; 4]
    }
    #[inline(always)]
    unsafe fn qload(x: &[f64; 4]) -> Self::Q {
        *x
    }
    #[inline(always)]
    unsafe fn qload3(x: &[f64; 3]) -> Self::Q {
        [x[0], x[1], x[2], 0.0]
    }
    #[inline(always)]
    unsafe fn qkeep(x: &mut [f64; 4], v: Self::Q) {
        *x = v;
    }
    #[inline(always)]
    unsafe fn qadd(a: Self::Q, b: Self::Q) -> Self::Q {
        map(a, b, |a, b| a + b)
    }
    #[inline(always)]
    unsafe fn qsub(a: Self::Q, b: Self::Q) -> Self::Q {
        map(a, b, |a, b| a - b)
    }
    #[inline(always)]
    unsafe fn qmul(a: Self::Q, b: Self::Q) -> Self::Q {
        map(a, b, |a, b| a * b)
    }
    #[inline(always)]
    unsafe fn qabs(a: Self::Q) -> Self::Q {
        a.map(f64::abs)
    }
    #[inline(always)]
    unsafe fn qturn(a: Self::Q) -> Self::Q {
        [a[1], a[2], a[0], a[3]]
    }
    #[inline(always)]
    unsafe fn qstore(x: &mut [f32; 4], v: Self::Q) {
        *x = v.map(|v| v as f32);
    }
}
