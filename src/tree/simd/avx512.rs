//! AVX-512 (F, VL, BW, DQ): one register for sixteen lanes.
#![expect(
    clippy::undocumented_unsafe_blocks,
    reason = "one reason for all: callers of the trait vouch for the target features, and memory is reached through references"
)]

use super::{Simd, Step, each_of};
use std::arch::x86_64::*;

/// See the module.
#[derive(Clone, Copy)]
pub(crate) struct Avx512;

/// Four rows as one register: in each quarter the rows' minima over that quarter.
///
/// # Safety
/// As for [`Simd`].
#[inline(always)]
unsafe fn four_rows(rows: &[[f32; 16]; 16], first: usize) -> __m512 {
    unsafe {
        let [a, b, c, d] = each_of!([0, 1, 2, 3], i => _mm512_loadu_ps(rows[first + i].as_ptr()));
        let ab = _mm512_min_ps(_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
        let cd = _mm512_min_ps(_mm512_unpacklo_ps(c, d), _mm512_unpackhi_ps(c, d));
        let (ab, cd) = (_mm512_castps_pd(ab), _mm512_castps_pd(cd));
        let (lo, hi) = (_mm512_unpacklo_pd(ab, cd), _mm512_unpackhi_pd(ab, cd));
        _mm512_min_ps(_mm512_castpd_ps(lo), _mm512_castpd_ps(hi))
    }
}

/// # Safety
/// As for [`Simd`].
#[inline(never)]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,avx2,popcnt,bmi1,bmi2,lzcnt")]
unsafe fn apart<T: Step<Avx512>>(step: T) -> T::Out {
    // SAFETY: the caller vouches for the instruction set.
    unsafe { step.run() }
}

impl Simd for Avx512 {
    type F = __m512;
    type M = __mmask16;
    type D = __m512d;
    type N = __mmask8;
    type Q = __m256d;
    type I = __m512i;

    #[inline(always)]
    unsafe fn apart<T: Step<Avx512>>(step: T) -> T::Out {
        // SAFETY: the caller vouches for the instruction set.
        unsafe { apart(step) }
    }
    #[inline(always)]
    unsafe fn splat(x: f32) -> __m512 {
        unsafe { _mm512_set1_ps(x) }
    }
    #[inline(always)]
    unsafe fn load(x: &[f32; 16]) -> __m512 {
        unsafe { _mm512_loadu_ps(x.as_ptr()) }
    }
    #[inline(always)]
    unsafe fn store(x: &mut [f32; 16], v: __m512) {
        unsafe { _mm512_storeu_ps(x.as_mut_ptr(), v) }
    }
    #[inline(always)]
    unsafe fn add(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_add_ps(a, b) }
    }
    #[inline(always)]
    unsafe fn sub(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_sub_ps(a, b) }
    }
    #[inline(always)]
    unsafe fn mul(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_mul_ps(a, b) }
    }
    #[inline(always)]
    unsafe fn div(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_div_ps(a, b) }
    }
    #[inline(always)]
    unsafe fn min(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_min_ps(a, b) }
    }
    #[inline(always)]
    unsafe fn max(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_max_ps(a, b) }
    }
    #[inline(always)]
    unsafe fn abs(a: __m512) -> __m512 {
        unsafe { _mm512_abs_ps(a) }
    }
    #[inline(always)]
    unsafe fn places(x: &[u32; 16]) -> [__m512i; 2] {
        unsafe {
            let x = _mm512_loadu_si512(x.as_ptr().cast());
            [x, _mm512_srli_epi32::<4>(x)]
        }
    }
    #[inline(always)]
    unsafe fn pick(table: &[f32; 16], at: __m512i) -> __m512 {
        // The instruction looks at the low four bits of a place only.
        unsafe { _mm512_permutexvar_ps(at, _mm512_loadu_ps(table.as_ptr())) }
    }
    #[inline(always)]
    unsafe fn le(a: __m512, b: __m512) -> __mmask16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b) }
    }
    #[inline(always)]
    unsafe fn and(a: __mmask16, b: __mmask16) -> __mmask16 {
        a & b
    }
    #[inline(always)]
    unsafe fn or(a: __mmask16, b: __mmask16) -> __mmask16 {
        a | b
    }
    #[inline(always)]
    unsafe fn bits(m: __mmask16) -> u32 {
        u32::from(m)
    }
    #[inline(always)]
    unsafe fn min_where(m: __mmask16, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_mask_min_ps(a, m, b, a) }
    }
    #[inline(always)]
    unsafe fn max_where(m: __mmask16, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_mask_max_ps(a, m, b, a) }
    }
    #[inline(always)]
    unsafe fn lt(a: __m512, b: __m512) -> __mmask16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b) }
    }
    #[inline(always)]
    unsafe fn fold_minima(low: __m512, high: __m512) -> __m512 {
        unsafe {
            _mm512_min_ps(
                _mm512_shuffle_f32x4::<0b01_00_01_00>(low, high),
                _mm512_shuffle_f32x4::<0b11_10_11_10>(low, high),
            )
        }
    }
    #[inline(always)]
    unsafe fn row_minima(rows: &[[f32; 16]; 16]) -> [__m512; 2] {
        unsafe {
            // Quarters 0, 2 (the halves' first parts) against 1, 3.
            let fours = each_of!([0, 1, 2, 3], n => four_rows(rows, 4 * n));
            let eights = each_of!([0, 1], n => {
                let (v, w) = (fours[2 * n], fours[2 * n + 1]);
                _mm512_min_ps(
                    _mm512_shuffle_f32x4::<0b10_00_10_00>(v, w),
                    _mm512_shuffle_f32x4::<0b11_01_11_01>(v, w),
                )
            });
            [
                _mm512_shuffle_f32x4::<0b10_00_10_00>(eights[0], eights[1]),
                _mm512_shuffle_f32x4::<0b11_01_11_01>(eights[0], eights[1]),
            ]
        }
    }
    #[inline(always)]
    unsafe fn compress(mask: u32, base: u32, out: &mut [u32; 16]) {
        unsafe {
            let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
            let numbers = _mm512_add_epi32(lanes, _mm512_set1_epi32(base as i32));
            _mm512_storeu_si512(out.as_mut_ptr().cast(), _mm512_maskz_compress_epi32(mask as u16, numbers));
        }
    }

    #[inline(always)]
    unsafe fn greatest(v: __m512) -> f32 {
        unsafe { _mm512_reduce_max_ps(v) }
    }

    #[inline(always)]
    unsafe fn dsplat(x: f64) -> __m512d {
        unsafe { _mm512_set1_pd(x) }
    }
    #[inline(always)]
    unsafe fn dload(x: &[f64; 8]) -> __m512d {
        unsafe { _mm512_loadu_pd(x.as_ptr()) }
    }
    #[inline(always)]
    unsafe fn dadd(a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_add_pd(a, b) }
    }
    #[inline(always)]
    unsafe fn dsub(a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_sub_pd(a, b) }
    }
    #[inline(always)]
    unsafe fn dmul(a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_mul_pd(a, b) }
    }
    #[inline(always)]
    unsafe fn ddiv(a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_div_pd(a, b) }
    }
    #[inline(always)]
    unsafe fn dmax(a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_max_pd(a, b) }
    }
    #[inline(always)]
    unsafe fn dabs(a: __m512d) -> __m512d {
        unsafe { _mm512_abs_pd(a) }
    }
    #[inline(always)]
    unsafe fn dle(a: __m512d, b: __m512d) -> __mmask8 {
        unsafe { _mm512_cmp_pd_mask::<_CMP_LE_OQ>(a, b) }
    }
    #[inline(always)]
    unsafe fn dand(a: __mmask8, b: __mmask8) -> __mmask8 {
        a & b
    }
    #[inline(always)]
    unsafe fn dbits(m: __mmask8) -> u32 {
        u32::from(m)
    }
    #[inline(always)]
    unsafe fn narrow(low: __m512d, high: __m512d) -> __m512 {
        unsafe {
            let (low, high) = (_mm512_cvtpd_ps(low), _mm512_cvtpd_ps(high));
            _mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)
        }
    }
    #[inline(always)]
    unsafe fn dmask(bits: u32) -> __mmask8 {
        bits as u8
    }
    #[inline(always)]
    unsafe fn offer(hit: __mmask8, t: &mut [f64; 8], v: __m512d, ids: &mut [u32; 8], id: u32) {
        unsafe {
            // Minima of whole registers rather than masked stores, which would keep the next load waiting.
            let best = _mm512_loadu_pd(t.as_ptr());
            let offered = _mm512_mask_mov_pd(_mm512_set1_pd(f64::INFINITY), hit, v);
            let nearer = _mm512_cmp_pd_mask::<_CMP_LT_OQ>(offered, best);
            let not_farther = _mm512_mask_cmp_pd_mask::<_CMP_LE_OQ>(hit, v, best);
            _mm512_storeu_pd(t.as_mut_ptr(), _mm512_min_pd(offered, best));
            let (old, new) = (_mm256_loadu_si256(ids.as_ptr().cast()), _mm256_set1_epi32(id as i32));
            let offered = _mm256_mask_mov_epi32(_mm256_set1_epi32(-1), not_farther, new);
            let least = _mm256_min_epu32(_mm256_mask_mov_epi32(old, nearer, new), offered);
            _mm256_storeu_si256(ids.as_mut_ptr().cast(), least);
        }
    }
    #[inline(always)]
    unsafe fn dgreatest(v: __m512d) -> f64 {
        unsafe { _mm512_reduce_max_pd(v) }
    }

    #[inline(always)]
    unsafe fn qsplat(x: f64) -> __m256d {
        unsafe { _mm256_set1_pd(x) }
    }
    #[inline(always)]
    unsafe fn qload(x: &[f64; 4]) -> __m256d {
        unsafe { _mm256_loadu_pd(x.as_ptr()) }
    }
    #[inline(always)]
    unsafe fn qload3(x: &[f64; 3]) -> __m256d {
        unsafe { _mm256_maskz_loadu_pd(7, x.as_ptr()) }
    }
    #[inline(always)]
    unsafe fn qkeep(x: &mut [f64; 4], v: __m256d) {
        unsafe { _mm256_storeu_pd(x.as_mut_ptr(), v) }
    }
    #[inline(always)]
    unsafe fn qadd(a: __m256d, b: __m256d) -> __m256d {
        unsafe { _mm256_add_pd(a, b) }
    }
    #[inline(always)]
    unsafe fn qsub(a: __m256d, b: __m256d) -> __m256d {
        unsafe { _mm256_sub_pd(a, b) }
    }
    #[inline(always)]
    unsafe fn qmul(a: __m256d, b: __m256d) -> __m256d {
        unsafe { _mm256_mul_pd(a, b) }
    }
    #[inline(always)]
    unsafe fn qabs(a: __m256d) -> __m256d {
        unsafe { _mm256_andnot_pd(_mm256_set1_pd(-0.0), a) }
    }
    #[inline(always)]
    unsafe fn qturn(a: __m256d) -> __m256d {
        unsafe { _mm256_permute4x64_pd::<0b11_00_10_01>(a) }
    }
    #[inline(always)]
    unsafe fn qstore(x: &mut [f32; 4], v: __m256d) {
        unsafe { _mm_storeu_ps(x.as_mut_ptr(), _mm256_cvtpd_ps(v)) }
    }
}
