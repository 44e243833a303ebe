//! AVX-512 (F, VL, BW, DQ): one register for sixteen `f32` or eight `f64`, and masks of a bit per lane.
#![allow(unsafe_code, reason = "the instructions of the set")]
#![expect(
    clippy::undocumented_unsafe_blocks,
    reason = "one reason for all: only `Avx512` makes these vectors, and only detection of the features \
              makes an `Avx512`; memory is reached through references to as many numbers as an instruction \
              reads or writes"
)]

use super::avx2::{Avx2, F64x4};
use super::{F32Ops, F64Ops, MaskOps, Simd, VectorOps, each_of};
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

/// Token of the set: proof that the machine has AVX-512 F, VL, BW and DQ, and the features of [`Avx2`].
#[derive(Clone, Copy, Debug)]
pub struct Avx512(Avx2);

impl Avx512 {
    /// Returns the token, if the machine has the features.
    pub fn detect() -> Option<Avx512> {
        let found = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq");
        Avx2::detect().filter(|_| found).map(Avx512)
    }
}

/// Calls `f` with the features of the set.
#[inline(never)]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,avx2,popcnt,bmi1,bmi2,lzcnt")]
fn with_features<R>(f: impl FnOnce() -> R) -> R {
    f()
}

/// Sixteen `f32` in one register.
#[derive(Clone, Copy)]
pub struct F32x16(__m512);

/// Eight `f64` in one register.
#[derive(Clone, Copy)]
pub struct F64x8(__m512d);

/// Operators with one instruction.
macro_rules! operators {
    ($vector:ident: $($trait:ident $name:ident $instruction:ident),+) => {$(
        impl $trait for $vector {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                unsafe { $vector($instruction(self.0, other.0)) }
            }
        }
    )+};
}
operators!(F32x16: Add add _mm512_add_ps, Sub sub _mm512_sub_ps);
operators!(F32x16: Mul mul _mm512_mul_ps, Div div _mm512_div_ps);
operators!(F64x8: Add add _mm512_add_pd, Sub sub _mm512_sub_pd, Mul mul _mm512_mul_pd, Div div _mm512_div_pd);

impl MaskOps for __mmask16 {
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self)
    }
}

impl MaskOps for __mmask8 {
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self)
    }
}

impl VectorOps for F32x16 {
    #[inline(always)]
    fn abs(self) -> Self {
        unsafe { F32x16(_mm512_abs_ps(self.0)) }
    }
}

impl F32Ops for F32x16 {
    type Mask = __mmask16;

    #[inline(always)]
    fn store(self, to: &mut [f32; 16]) {
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        unsafe { F32x16(_mm512_min_ps(self.0, other.0)) }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        unsafe { F32x16(_mm512_max_ps(self.0, other.0)) }
    }
    #[inline(always)]
    fn min_where(self, mask: __mmask16, other: Self) -> Self {
        unsafe { F32x16(_mm512_mask_min_ps(self.0, mask, other.0, self.0)) }
    }
    #[inline(always)]
    fn max_where(self, mask: __mmask16, other: Self) -> Self {
        unsafe { F32x16(_mm512_mask_max_ps(self.0, mask, other.0, self.0)) }
    }
    #[inline(always)]
    fn le(self, other: Self) -> __mmask16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0) }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> __mmask16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) }
    }
    #[inline(always)]
    fn fold_minima(self, high: Self) -> Self {
        unsafe {
            F32x16(_mm512_min_ps(
                _mm512_shuffle_f32x4::<0b01_00_01_00>(self.0, high.0),
                _mm512_shuffle_f32x4::<0b11_10_11_10>(self.0, high.0),
            ))
        }
    }
    #[inline(always)]
    fn max_lane(self) -> f32 {
        unsafe { _mm512_reduce_max_ps(self.0) }
    }
}

impl VectorOps for F64x8 {
    #[inline(always)]
    fn abs(self) -> Self {
        unsafe { F64x8(_mm512_abs_pd(self.0)) }
    }
}

impl F64Ops for F64x8 {
    type Mask = __mmask8;

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        unsafe { F64x8(_mm512_max_pd(self.0, other.0)) }
    }
    #[inline(always)]
    fn le(self, other: Self) -> __mmask8 {
        unsafe { _mm512_cmp_pd_mask::<_CMP_LE_OQ>(self.0, other.0) }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> __mmask8 {
        unsafe { _mm512_cmp_pd_mask::<_CMP_LT_OQ>(self.0, other.0) }
    }
    #[inline(always)]
    fn max_lane(self) -> f64 {
        unsafe { _mm512_reduce_max_pd(self.0) }
    }
}

impl Simd for Avx512 {
    type F32x16 = F32x16;
    type F64x8 = F64x8;
    type F64x4 = F64x4;
    type Mask16 = __mmask16;
    type Mask8 = __mmask8;
    type Indices = __m512i;

    const HAS_WIDE_REGISTERS: bool = true;

    #[inline(always)]
    fn outlined<R>(self, f: impl FnOnce() -> R) -> R {
        unsafe { with_features(f) }
    }

    #[inline(always)]
    fn splat(self, x: f32) -> F32x16 {
        unsafe { F32x16(_mm512_set1_ps(x)) }
    }
    #[inline(always)]
    fn load(self, x: &[f32; 16]) -> F32x16 {
        unsafe { F32x16(_mm512_loadu_ps(x.as_ptr())) }
    }
    #[inline(always)]
    fn indices(self, x: &[u32; 16]) -> [__m512i; 2] {
        unsafe {
            let x = _mm512_loadu_si512(x.as_ptr().cast());
            [x, _mm512_srli_epi32::<4>(x)]
        }
    }
    #[inline(always)]
    fn look_up(self, table: &[f32; 16], at: __m512i) -> F32x16 {
        // The instruction uses only the low four bits of an index.
        unsafe { F32x16(_mm512_permutexvar_ps(at, _mm512_loadu_ps(table.as_ptr()))) }
    }
    #[inline(always)]
    fn row_minima(self, rows: &[[f32; 16]; 16]) -> [F32x16; 2] {
        unsafe {
            // Quarters 0 and 2, which begin the halves, against 1 and 3.
            let fours = each_of!([0, 1, 2, 3], n => minima_of_four(rows, 4 * n));
            let eights = each_of!([0, 1], n => {
                let (v, w) = (fours[2 * n], fours[2 * n + 1]);
                _mm512_min_ps(
                    _mm512_shuffle_f32x4::<0b10_00_10_00>(v, w),
                    _mm512_shuffle_f32x4::<0b11_01_11_01>(v, w),
                )
            });
            [
                F32x16(_mm512_shuffle_f32x4::<0b10_00_10_00>(eights[0], eights[1])),
                F32x16(_mm512_shuffle_f32x4::<0b11_01_11_01>(eights[0], eights[1])),
            ]
        }
    }
    #[inline(always)]
    fn write_lanes(self, mask: u32, base: u32, out: &mut [u32; 16]) {
        debug_assert!(mask < 1 << 16);
        unsafe {
            let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
            let numbers = _mm512_add_epi32(lanes, _mm512_set1_epi32(base as i32));
            _mm512_storeu_si512(out.as_mut_ptr().cast(), _mm512_maskz_compress_epi32(mask as u16, numbers));
        }
    }

    #[inline(always)]
    fn splat_f64(self, x: f64) -> F64x8 {
        unsafe { F64x8(_mm512_set1_pd(x)) }
    }
    #[inline(always)]
    fn load_f64(self, x: &[f64; 8]) -> F64x8 {
        unsafe { F64x8(_mm512_loadu_pd(x.as_ptr())) }
    }
    #[inline(always)]
    fn mask8(self, bits: u32) -> __mmask8 {
        bits as u8
    }
    #[inline(always)]
    fn narrow(self, low: F64x8, high: F64x8) -> F32x16 {
        unsafe {
            let (low, high) = (_mm512_cvtpd_ps(low.0), _mm512_cvtpd_ps(high.0));
            F32x16(_mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high))
        }
    }
    #[inline(always)]
    fn keep_nearest(self, hit: __mmask8, t: &mut [f64; 8], v: F64x8, ids: &mut [u32; 8], id: u32) {
        unsafe {
            // Minima of complete registers rather than masked stores, which would delay the next load.
            let best = _mm512_loadu_pd(t.as_ptr());
            let offered = _mm512_mask_mov_pd(_mm512_set1_pd(f64::INFINITY), hit, v.0);
            let nearer = _mm512_cmp_pd_mask::<_CMP_LT_OQ>(offered, best);
            let not_farther = _mm512_mask_cmp_pd_mask::<_CMP_LE_OQ>(hit, v.0, best);
            _mm512_storeu_pd(t.as_mut_ptr(), _mm512_min_pd(offered, best));
            let (old, new) = (_mm256_loadu_si256(ids.as_ptr().cast()), _mm256_set1_epi32(id as i32));
            let offered = _mm256_mask_mov_epi32(_mm256_set1_epi32(-1), not_farther, new);
            let least = _mm256_min_epu32(_mm256_mask_mov_epi32(old, nearer, new), offered);
            _mm256_storeu_si256(ids.as_mut_ptr().cast(), least);
        }
    }
    #[inline(always)]
    fn count_smaller<const BLOCKS: usize>(
        self,
        keys: &[f64],
        blocks: &[[f64; 8]; BLOCKS],
    ) -> [[u64; 8]; BLOCKS] {
        let mut counts = [[0; 8]; BLOCKS];
        unsafe {
            let one = _mm512_set1_epi64(1);
            let mut block = [_mm512_setzero_pd(); BLOCKS];
            let mut count = [_mm512_setzero_si512(); BLOCKS];
            for i in 0..BLOCKS {
                block[i] = _mm512_loadu_pd(blocks[i].as_ptr());
            }
            for key in keys {
                let key = _mm512_set1_pd(*key);
                for i in 0..BLOCKS {
                    let smaller = _mm512_cmp_pd_mask::<_CMP_LT_OQ>(key, block[i]);
                    count[i] = _mm512_mask_add_epi64(count[i], smaller, count[i], one);
                }
            }
            for i in 0..BLOCKS {
                _mm512_storeu_si512(counts[i].as_mut_ptr().cast(), count[i]);
            }
        }
        counts
    }

    #[inline(always)]
    fn splat_quad(self, x: f64) -> F64x4 {
        self.0.splat_quad(x)
    }
    #[inline(always)]
    fn load_quad(self, x: &[f64; 4]) -> F64x4 {
        self.0.load_quad(x)
    }
    #[inline(always)]
    fn load_triple(self, x: &[f64; 3]) -> F64x4 {
        unsafe { F64x4(_mm256_maskz_loadu_pd(7, x.as_ptr())) }
    }
}

/// Reduces four rows from `first` on to one register: each quarter of it has the minima of the rows over that
/// quarter.
///
/// # Safety
/// The machine must have AVX-512 F.
#[inline(always)]
unsafe fn minima_of_four(rows: &[[f32; 16]; 16], first: usize) -> __m512 {
    unsafe {
        let [a, b, c, d] = each_of!([0, 1, 2, 3], i => _mm512_loadu_ps(rows[first + i].as_ptr()));
        let ab = _mm512_min_ps(_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
        let cd = _mm512_min_ps(_mm512_unpacklo_ps(c, d), _mm512_unpackhi_ps(c, d));
        let (ab, cd) = (_mm512_castps_pd(ab), _mm512_castps_pd(cd));
        let (lo, hi) = (_mm512_unpacklo_pd(ab, cd), _mm512_unpackhi_pd(ab, cd));
        _mm512_min_ps(_mm512_castpd_ps(lo), _mm512_castpd_ps(hi))
    }
}
