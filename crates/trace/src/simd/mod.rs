//! Instruction sets as values: sixteen single-precision or eight double-precision numbers at a time.
//!
//! A set is a zero-sized token ([`Portable`](portable::Portable), [`Avx2`](avx2::Avx2),
//! [`Avx512`](avx512::Avx512)) that only the detection of its features creates, and its vectors are types
//! that only the token creates. So every operation is safe: a token or a vector is the proof that the machine
//! has the instructions. `unsafe` is confined to the files of the sets.
//!
//! Code is written once, generic over [`Simd`], and computes the same bits on every set, because nothing is
//! fused or reordered; the portable set is the reference that the others are tested against. Speed depends on
//! inlining: a function that takes a token or vectors is `#[inline(always)]` up to a call of
//! [`Simd::outlined`], which is compiled with the features of the set.

#[cfg(target_arch = "x86_64")]
pub mod avx2;
#[cfg(target_arch = "x86_64")]
pub mod avx512;
pub mod portable;
mod prefetch;

pub use prefetch::prefetch;

use std::fmt::Debug;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Sub};
use std::sync::OnceLock;

/// The array of `$e` for `$i` in 0, 1, 2 (or as many as listed). `array::map` and `array::from_fn` are not
/// always inlined, and a closure that is not inlined lacks the target features; this macro needs no closure.
#[doc(hidden)]
#[macro_export]
macro_rules! each_of {
    ([$($n:literal),+], $i:ident => $e:expr) => {
        [$({
            let $i: usize = $n;
            $e
        }),+]
    };
}
pub use each_of;

/// Evaluates `$body` in a function compiled for the instruction set of `$level`, with `$simd` as the token of
/// the set.
#[doc(hidden)]
#[macro_export]
macro_rules! dispatch {
    ($level:expr, $simd:ident => $body:expr) => {
        match $level {
            $crate::simd::Level::Portable($simd) => $crate::simd::Simd::outlined(
                $simd,
                #[inline(always)]
                || $body,
            ),
            #[cfg(target_arch = "x86_64")]
            $crate::simd::Level::Avx2($simd) => $crate::simd::Simd::outlined(
                $simd,
                #[inline(always)]
                || $body,
            ),
            #[cfg(target_arch = "x86_64")]
            $crate::simd::Level::Avx512($simd) => $crate::simd::Simd::outlined(
                $simd,
                #[inline(always)]
                || $body,
            ),
        }
    };
}
pub use dispatch;

/// An instruction set that this machine has, as the token of the set.
#[derive(Clone, Copy, Debug)]
pub enum Level {
    /// Plain Rust, available on every machine.
    Portable(portable::Portable),
    /// AVX2 with POPCNT, BMI1, BMI2 and LZCNT.
    #[cfg(target_arch = "x86_64")]
    Avx2(avx2::Avx2),
    /// AVX-512 F, VL, BW and DQ, with AVX2, POPCNT, BMI1, BMI2 and LZCNT.
    #[cfg(target_arch = "x86_64")]
    Avx512(avx512::Avx512),
}

impl Level {
    /// Returns all sets that this machine has, the fastest last.
    pub fn available() -> impl DoubleEndedIterator<Item = Level> {
        let sets = [
            Some(Level::Portable(portable::Portable)),
            #[cfg(target_arch = "x86_64")]
            avx2::Avx2::detect().map(Level::Avx2),
            #[cfg(target_arch = "x86_64")]
            avx512::Avx512::detect().map(Level::Avx512),
        ];
        sets.into_iter().flatten()
    }

    /// The fastest set, or the one that the environment variable `VLSCAN_SIMD` names: portable, avx2 or
    /// avx512. Sets that the machine does not have are portable.
    pub fn best() -> Level {
        static BEST: OnceLock<Level> = OnceLock::new();
        *BEST.get_or_init(|| {
            let requested = std::env::var("VLSCAN_SIMD").ok();
            let is_requested = |level: &Level| requested.as_deref().is_none_or(|name| name == level.name());
            Level::available().rfind(is_requested).unwrap_or(Level::Portable(portable::Portable))
        })
    }

    fn name(&self) -> &'static str {
        match self {
            Level::Portable(_) => "portable",
            #[cfg(target_arch = "x86_64")]
            Level::Avx2(_) => "avx2",
            #[cfg(target_arch = "x86_64")]
            Level::Avx512(_) => "avx512",
        }
    }
}

/// The token of an instruction set: creates its vectors and runs code compiled for it.
pub trait Simd: Copy + Debug + 'static {
    /// Sixteen `f32`.
    type F32x16: F32Ops<Mask = Self::Mask16>;
    /// Eight `f64`.
    type F64x8: F64Ops<Mask = Self::Mask8>;
    /// Four `f64`.
    type F64x4: QuadOps;
    /// Mask of sixteen lanes.
    type Mask16: MaskOps;
    /// Mask of eight lanes.
    type Mask8: MaskOps;
    /// Sixteen indices into a table of sixteen.
    type Indices: Copy;

    /// True if one register holds eight `f64`; then replacing branches by work on complete registers pays.
    const HAS_WIDE_REGISTERS: bool;

    /// Calls `f` in a separate function, which has all registers available and is compiled with the features
    /// of the set. `f` must be `#[inline(always)]`, as in `simd.outlined(#[inline(always)] || …)`.
    fn outlined<R>(self, f: impl FnOnce() -> R) -> R;

    /// Sixteen lanes equal to `x`.
    fn splat(self, x: f32) -> Self::F32x16;
    /// Loads sixteen `f32`; no alignment is required.
    fn load(self, x: &[f32; 16]) -> Self::F32x16;
    /// The indices `x mod 16` and `x / 16 mod 16`.
    fn indices(self, x: &[u32; 16]) -> [Self::Indices; 2];
    /// The entries of a table at the indices.
    fn look_up(self, table: &[f32; 16], at: Self::Indices) -> Self::F32x16;
    /// The minima within the lower and within the upper eight lanes of sixteen rows, by row.
    fn row_minima(self, rows: &[[f32; 16]; 16]) -> [Self::F32x16; 2];
    /// Writes `base + lane` for each lane in the 16-bit `mask` to consecutive entries of `out`; later entries
    /// are overwritten with unspecified values.
    fn write_lanes(self, mask: u32, base: u32, out: &mut [u32; 16]);

    /// Eight lanes equal to `x`.
    fn splat_f64(self, x: f64) -> Self::F64x8;
    /// Loads eight `f64`; no alignment is required.
    fn load_f64(self, x: &[f64; 8]) -> Self::F64x8;
    /// The lanes of an 8-bit mask.
    fn mask8(self, bits: u32) -> Self::Mask8;
    /// Narrows both vectors to one of `f32`, rounded to nearest.
    fn narrow(self, low: Self::F64x8, high: Self::F64x8) -> Self::F32x16;
    /// Replaces `t` in the lanes of `hit` by the candidates `v` that are less, and `ids` by `id` there; where
    /// a candidate equals `t`, the smaller of both ids is kept.
    fn keep_nearest(self, hit: Self::Mask8, t: &mut [f64; 8], v: Self::F64x8, ids: &mut [u32; 8], id: u32);
    /// Counts, for each number of the blocks, the `keys` that are smaller.
    fn count_smaller<const BLOCKS: usize>(
        self,
        keys: &[f64],
        blocks: &[[f64; 8]; BLOCKS],
    ) -> [[u64; 8]; BLOCKS] {
        blocks.map(|block| block.map(|x| keys.iter().filter(|key| **key < x).count() as u64))
    }

    /// Four lanes equal to `x`.
    fn splat_quad(self, x: f64) -> Self::F64x4;
    /// Loads four `f64`; no alignment is required.
    fn load_quad(self, x: &[f64; 4]) -> Self::F64x4;
    /// Loads the numbers of an array, and 0.
    fn load_triple(self, x: &[f64; 3]) -> Self::F64x4;
}

/// Operations of all vectors, by lane.
pub trait VectorOps: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Absolute value: clears the sign bit.
    fn abs(self) -> Self;
}

/// Sixteen `f32`; operations are by lane unless stated otherwise.
pub trait F32Ops: VectorOps + Div<Output = Self> {
    /// Mask of sixteen lanes, the result of comparisons.
    type Mask;
    /// Writes the numbers to an array; no alignment is required.
    fn store(self, to: &mut [f32; 16]);
    /// `self < other ? self : other`, so `other` when either is NaN.
    fn min(self, other: Self) -> Self;
    /// `self > other ? self : other`, so `other` when either is NaN.
    fn max(self, other: Self) -> Self;
    /// `min(other, self)` in the lanes of `mask`, `self` in the others.
    fn min_where(self, mask: Self::Mask, other: Self) -> Self;
    /// `max(other, self)` in the lanes of `mask`, `self` in the others.
    fn max_where(self, mask: Self::Mask, other: Self) -> Self;
    /// `self <= other`, false when either is NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `self < other`, false when either is NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// Lane `i` becomes the minimum of lanes `i` and `i + 8` of `self` in the lower half, of `high` in the
    /// upper half: one row of [`Simd::row_minima`].
    fn fold_minima(self, high: Self) -> Self;
    /// Returns the maximum of all lanes.
    fn max_lane(self) -> f32;
}

/// Eight `f64`; operations are by lane unless stated otherwise.
pub trait F64Ops: VectorOps + Div<Output = Self> {
    /// Mask of eight lanes, the result of comparisons.
    type Mask;
    /// `self > other ? self : other`, so `other` when either is NaN.
    fn max(self, other: Self) -> Self;
    /// `self <= other`, false when either is NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `self < other`, false when either is NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// Returns the maximum of all lanes.
    fn max_lane(self) -> f64;
}

/// Four `f64`.
pub trait QuadOps: VectorOps {
    /// Lanes 1, 2, 0, 3.
    fn rotate(self) -> Self;
    /// Writes the numbers to an array; no alignment is required.
    fn store(self, to: &mut [f64; 4]);
    /// Writes the numbers to an array, rounded to nearest.
    fn store_f32(self, to: &mut [f32; 4]);
}

/// Lane masks, which `&` and `|` combine.
pub trait MaskOps: Copy + BitAnd<Output = Self> + BitOr<Output = Self> {
    /// Returns one bit per lane, the first lane lowest.
    fn bits(self) -> u32;
}

#[cfg(test)]
mod tests;
