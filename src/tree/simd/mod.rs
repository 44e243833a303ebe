//! Sixteen single-precision or eight double-precision numbers at a time, on three instruction sets.
//!
//! The kernel is written once, generic over [`Simd`]. Every operation gives the same bits on every set (nothing is fused),
//! so the portable one is the twin that the others are tested against. All functions are inlined into one entry per set
//! that carries the target features; called from anywhere else they would be undefined.

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512;
pub(crate) mod portable;

/// The array of `$e` for `$i` in 0, 1, 2 (or as many as given). Closures, and with them `map` and `fold`, do not carry the
/// target features of the function that they are inlined into until it is too late; this needs none.
macro_rules! each_of {
    ([$($n:literal),+], $i:ident => $e:expr) => {
        [$({
            let $i: usize = $n;
            $e
        }),+]
    };
}
pub(crate) use each_of;

/// An instruction set that the kernel is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Level {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Level {
    /// All sets that this machine has, the best last.
    pub fn available() -> impl DoubleEndedIterator<Item = Level> {
        #[cfg(target_arch = "x86_64")]
        let sets = [
            Some(Level::Portable),
            is_x86_feature_detected!("avx2").then_some(Level::Avx2),
            (is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq"))
            .then_some(Level::Avx512),
        ];
        #[cfg(not(target_arch = "x86_64"))]
        let sets = [Some(Level::Portable)];
        sets.into_iter().flatten()
    }

    /// The best set of this machine.
    pub fn best() -> Level {
        Level::available().next_back().unwrap_or(Level::Portable)
    }
}

/// Asks for the memory of `x` ahead of its use.
#[inline(always)]
pub(crate) fn prefetch<T>(x: &T) {
    #[cfg(target_arch = "x86_64")]
    for line in (0..size_of::<T>()).step_by(64) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch reads nothing, and the address lies within `x`.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(x).cast::<i8>().add(line)) }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = x;
}

/// Operations of an instruction set. `F` are sixteen `f32`, `D` eight `f64`; `M` and `N` are their masks. `Q` are four
/// `f64`.
///
/// # Safety
/// Every function may only run where the set's target features are available.
pub(crate) trait Simd: Copy {
    type F: Copy;
    type M: Copy;
    type D: Copy;
    type N: Copy;
    type Q: Copy;

    unsafe fn splat(x: f32) -> Self::F;
    unsafe fn load(x: &[f32; 16]) -> Self::F;
    unsafe fn store(x: &mut [f32; 16], v: Self::F);
    unsafe fn add(a: Self::F, b: Self::F) -> Self::F;
    unsafe fn sub(a: Self::F, b: Self::F) -> Self::F;
    unsafe fn mul(a: Self::F, b: Self::F) -> Self::F;
    unsafe fn div(a: Self::F, b: Self::F) -> Self::F;
    /// `a < b ? a : b`, so `b` when either is no number.
    unsafe fn min(a: Self::F, b: Self::F) -> Self::F;
    /// `a > b ? a : b`.
    unsafe fn max(a: Self::F, b: Self::F) -> Self::F;
    /// `a <= b`, false when either is no number.
    unsafe fn le(a: Self::F, b: Self::F) -> Self::M;
    unsafe fn and(a: Self::M, b: Self::M) -> Self::M;
    unsafe fn or(a: Self::M, b: Self::M) -> Self::M;
    /// One bit per lane.
    unsafe fn bits(m: Self::M) -> u32;
    /// `m ? min(b, a) : a` by lane.
    unsafe fn min_where(m: Self::M, a: Self::F, b: Self::F) -> Self::F;
    /// `m ? max(b, a) : a` by lane.
    unsafe fn max_where(m: Self::M, a: Self::F, b: Self::F) -> Self::F;
    /// `a < b`, false when either is no number.
    unsafe fn lt(a: Self::F, b: Self::F) -> Self::M;
    /// One row of [`Simd::row_minima`]: eight minima over the lanes of `low`, eight over those of `high`.
    unsafe fn fold_minima(low: Self::F, high: Self::F) -> Self::F;
    /// Minima within the lower and the upper eight lanes of sixteen rows, by row.
    unsafe fn row_minima(rows: &[[f32; 16]; 16]) -> [Self::F; 2];
    /// Writes `base + lane` for the lanes in `mask` to consecutive places; all sixteen places may be written.
    unsafe fn compress(mask: u32, base: u32, out: &mut [u32; 16]);

    /// The greatest lane.
    unsafe fn greatest(v: Self::F) -> f32;

    unsafe fn dsplat(x: f64) -> Self::D;
    unsafe fn dload(x: &[f64; 8]) -> Self::D;
    unsafe fn dadd(a: Self::D, b: Self::D) -> Self::D;
    unsafe fn dsub(a: Self::D, b: Self::D) -> Self::D;
    unsafe fn dmul(a: Self::D, b: Self::D) -> Self::D;
    unsafe fn ddiv(a: Self::D, b: Self::D) -> Self::D;
    unsafe fn dmax(a: Self::D, b: Self::D) -> Self::D;
    unsafe fn dabs(a: Self::D) -> Self::D;
    unsafe fn dlt(a: Self::D, b: Self::D) -> Self::N;
    unsafe fn dle(a: Self::D, b: Self::D) -> Self::N;
    unsafe fn dand(a: Self::N, b: Self::N) -> Self::N;
    unsafe fn dbits(m: Self::N) -> u32;
    /// Both vectors as one of `f32`, rounded to nearest.
    unsafe fn narrow(low: Self::D, high: Self::D) -> Self::F;
    /// Stores the lanes of `v`, and `id`, where `bits` has a one.
    unsafe fn put(bits: u32, t: &mut [f64; 8], v: Self::D, ids: &mut [u32; 8], id: u32);
    /// The lanes where `ids` has a number greater than `id`.
    unsafe fn greater_ids(ids: &[u32; 8], id: u32) -> u32;
    /// The greatest lane.
    unsafe fn dgreatest(v: Self::D) -> f64;

    unsafe fn qsplat(x: f64) -> Self::Q;
    unsafe fn qload(x: &[f64; 4]) -> Self::Q;
    unsafe fn qadd(a: Self::Q, b: Self::Q) -> Self::Q;
    unsafe fn qsub(a: Self::Q, b: Self::Q) -> Self::Q;
    unsafe fn qmul(a: Self::Q, b: Self::Q) -> Self::Q;
    unsafe fn qabs(a: Self::Q) -> Self::Q;
    /// Lanes 1, 2, 0, 3.
    unsafe fn qturn(a: Self::Q) -> Self::Q;
    /// One bit per lane where `a < b`.
    unsafe fn qlt(a: Self::Q, b: Self::Q) -> u32;
    /// Rounded to nearest.
    unsafe fn qstore(x: &mut [f32; 4], v: Self::Q);
}
