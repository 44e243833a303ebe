//! AVX2: two registers for sixteen lanes.
#![expect(
    clippy::undocumented_unsafe_blocks,
    reason = "one reason for all: callers of the trait vouch for the target features, and memory is reached through references"
)]

use super::{Simd, Step, each_of};
use std::arch::x86_64::*;

/// See the module.
#[derive(Clone, Copy)]
pub(crate) struct Avx2;

/// For each mask of eight lanes the lanes in it, in order.
static LANES_OF: [[u32; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut n) = (0, 0);
        while lane < 8 {
            if mask >> lane & 1 != 0 {
                table[mask][n] = lane;
                n += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    table
};

macro_rules! pairwise {
    ($name:ident, $op:ident, $v:ty) => {
        #[inline(always)]
        unsafe fn $name(a: [$v; 2], b: [$v; 2]) -> [$v; 2] {
            unsafe { [$op(a[0], b[0]), $op(a[1], b[1])] }
        }
    };
}

/// Eight lanes of four rows as one register: in each half the rows' minima over four lanes.
///
/// # Safety
/// As for [`Simd`].
#[inline(always)]
unsafe fn four_rows(rows: &[[f32; 16]; 16], first: usize, lane: usize) -> __m256 {
    unsafe {
        let [a, b, c, d] =
            each_of!([0, 1, 2, 3], i => _mm256_loadu_ps(rows[first + i][lane..lane + 8].as_ptr()));
        let ab = _mm256_min_ps(_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
        let cd = _mm256_min_ps(_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
        let (ab, cd) = (_mm256_castps_pd(ab), _mm256_castps_pd(cd));
        let (lo, hi) = (_mm256_unpacklo_pd(ab, cd), _mm256_unpackhi_pd(ab, cd));
        _mm256_min_ps(_mm256_castpd_ps(lo), _mm256_castpd_ps(hi))
    }
}

/// A mask of four `f64` as one of four `u32`.
///
/// # Safety
/// As for [`Simd`].
#[inline(always)]
unsafe fn narrowed(mask: __m256d) -> __m128i {
    unsafe {
        let mask = _mm256_castpd_ps(mask);
        let (low, high) = (_mm256_castps256_ps128(mask), _mm256_extractf128_ps::<1>(mask));
        _mm_castps_si128(_mm_shuffle_ps::<0b10_00_10_00>(low, high))
    }
}

/// # Safety
/// As for [`Simd`].
#[inline(never)]
#[target_feature(enable = "avx2,popcnt,bmi1,bmi2,lzcnt")]
unsafe fn apart<T: Step<Avx2>>(step: T) -> T::Out {
    // SAFETY: the caller vouches for the instruction set.
    unsafe { step.run() }
}

impl Simd for Avx2 {
    type F = [__m256; 2];
    type M = [__m256; 2];
    type D = [__m256d; 2];
    type N = [__m256d; 2];
    type Q = __m256d;
    type I = [__m256i; 2];

    pairwise!(add, _mm256_add_ps, __m256);
    pairwise!(sub, _mm256_sub_ps, __m256);
    pairwise!(mul, _mm256_mul_ps, __m256);
    pairwise!(div, _mm256_div_ps, __m256);
    pairwise!(min, _mm256_min_ps, __m256);
    pairwise!(max, _mm256_max_ps, __m256);
    pairwise!(and, _mm256_and_ps, __m256);
    pairwise!(or, _mm256_or_ps, __m256);
    pairwise!(dadd, _mm256_add_pd, __m256d);
    pairwise!(dsub, _mm256_sub_pd, __m256d);
    pairwise!(dmul, _mm256_mul_pd, __m256d);
    pairwise!(ddiv, _mm256_div_pd, __m256d);
    pairwise!(dmax, _mm256_max_pd, __m256d);
    pairwise!(dand, _mm256_and_pd, __m256d);

    #[inline(always)]
    unsafe fn apart<T: Step<Avx2>>(step: T) -> T::Out {
        // SAFETY: the caller vouches for the instruction set.
        unsafe { apart(step) }
    }
    #[inline(always)]
    unsafe fn splat(x: f32) -> [__m256; 2] {
        unsafe { [_mm256_set1_ps(x); 2] }
    }
    #[inline(always)]
    unsafe fn load(x: &[f32; 16]) -> [__m256; 2] {
        unsafe { [_mm256_loadu_ps(x.as_ptr()), _mm256_loadu_ps(x[8..].as_ptr())] }
    }
    #[inline(always)]
    unsafe fn store(x: &mut [f32; 16], v: [__m256; 2]) {
        unsafe {
            _mm256_storeu_ps(x.as_mut_ptr(), v[0]);
            _mm256_storeu_ps(x[8..].as_mut_ptr(), v[1]);
        }
    }
    #[inline(always)]
    unsafe fn abs(a: [__m256; 2]) -> [__m256; 2] {
        unsafe {
            let sign = _mm256_set1_ps(-0.0);
            [_mm256_andnot_ps(sign, a[0]), _mm256_andnot_ps(sign, a[1])]
        }
    }
    #[inline(always)]
    unsafe fn places(x: &[u32; 16]) -> [[__m256i; 2]; 2] {
        unsafe {
            let x = each_of!([0, 1], n => _mm256_loadu_si256(x[8 * n..].as_ptr().cast()));
            [x, [_mm256_srli_epi32::<4>(x[0]), _mm256_srli_epi32::<4>(x[1])]]
        }
    }
    #[inline(always)]
    unsafe fn pick(table: &[f32; 16], at: [__m256i; 2]) -> [__m256; 2] {
        unsafe {
            let [low, high] = Self::load(table);
            each_of!([0, 1], n => {
                let upper = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(at[n]));
                _mm256_blendv_ps(
                    _mm256_permutevar8x32_ps(low, at[n]),
                    _mm256_permutevar8x32_ps(high, at[n]),
                    upper,
                )
            })
        }
    }
    #[inline(always)]
    unsafe fn le(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        unsafe { [_mm256_cmp_ps::<_CMP_LE_OQ>(a[0], b[0]), _mm256_cmp_ps::<_CMP_LE_OQ>(a[1], b[1])] }
    }
    #[inline(always)]
    unsafe fn bits(m: [__m256; 2]) -> u32 {
        unsafe { _mm256_movemask_ps(m[0]) as u32 | (_mm256_movemask_ps(m[1]) as u32) << 8 }
    }
    #[inline(always)]
    unsafe fn min_where(m: [__m256; 2], a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        unsafe { each_of!([0, 1], i => _mm256_blendv_ps(a[i], _mm256_min_ps(b[i], a[i]), m[i])) }
    }
    #[inline(always)]
    unsafe fn max_where(m: [__m256; 2], a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        unsafe { each_of!([0, 1], i => _mm256_blendv_ps(a[i], _mm256_max_ps(b[i], a[i]), m[i])) }
    }
    #[inline(always)]
    unsafe fn lt(a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        unsafe { [_mm256_cmp_ps::<_CMP_LT_OQ>(a[0], b[0]), _mm256_cmp_ps::<_CMP_LT_OQ>(a[1], b[1])] }
    }
    #[inline(always)]
    unsafe fn fold_minima(low: [__m256; 2], high: [__m256; 2]) -> [__m256; 2] {
        unsafe { [_mm256_min_ps(low[0], low[1]), _mm256_min_ps(high[0], high[1])] }
    }
    #[inline(always)]
    unsafe fn row_minima(rows: &[[f32; 16]; 16]) -> [[__m256; 2]; 2] {
        unsafe {
            each_of!([0, 1], half => each_of!([0, 1], n => {
                let (v, w) = (four_rows(rows, 8 * n, 8 * half), four_rows(rows, 8 * n + 4, 8 * half));
                _mm256_min_ps(_mm256_permute2f128_ps::<0x20>(v, w), _mm256_permute2f128_ps::<0x31>(v, w))
            }))
        }
    }
    #[inline(always)]
    unsafe fn compress(mask: u32, base: u32, out: &mut [u32; 16]) {
        unsafe {
            let (low, high) = ((mask & 255) as usize, (mask >> 8 & 255) as usize);
            let [lower, upper] = each_of!([0, 1], half => {
                let lanes = _mm256_loadu_si256(LANES_OF[[low, high][half]].as_ptr().cast());
                _mm256_add_epi32(lanes, _mm256_set1_epi32((base + 8 * half as u32) as i32))
            });
            let places = low.count_ones() as usize;
            _mm256_storeu_si256(out.as_mut_ptr().cast(), lower);
            // At most eight places come before these eight.
            _mm256_storeu_si256(out.as_mut_ptr().add(places).cast(), upper);
        }
    }

    #[inline(always)]
    unsafe fn greatest(v: [__m256; 2]) -> f32 {
        unsafe {
            let eight = _mm256_max_ps(v[0], v[1]);
            let four = _mm_max_ps(_mm256_castps256_ps128(eight), _mm256_extractf128_ps::<1>(eight));
            let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_max_ss(two, _mm_movehdup_ps(two)))
        }
    }

    #[inline(always)]
    unsafe fn dsplat(x: f64) -> [__m256d; 2] {
        unsafe { [_mm256_set1_pd(x); 2] }
    }
    #[inline(always)]
    unsafe fn dload(x: &[f64; 8]) -> [__m256d; 2] {
        unsafe { [_mm256_loadu_pd(x.as_ptr()), _mm256_loadu_pd(x[4..].as_ptr())] }
    }
    #[inline(always)]
    unsafe fn dabs(a: [__m256d; 2]) -> [__m256d; 2] {
        unsafe {
            let sign = _mm256_set1_pd(-0.0);
            [_mm256_andnot_pd(sign, a[0]), _mm256_andnot_pd(sign, a[1])]
        }
    }
    #[inline(always)]
    unsafe fn dle(a: [__m256d; 2], b: [__m256d; 2]) -> [__m256d; 2] {
        unsafe { [_mm256_cmp_pd::<_CMP_LE_OQ>(a[0], b[0]), _mm256_cmp_pd::<_CMP_LE_OQ>(a[1], b[1])] }
    }
    #[inline(always)]
    unsafe fn dbits(m: [__m256d; 2]) -> u32 {
        unsafe { _mm256_movemask_pd(m[0]) as u32 | (_mm256_movemask_pd(m[1]) as u32) << 4 }
    }
    #[inline(always)]
    unsafe fn narrow(low: [__m256d; 2], high: [__m256d; 2]) -> [__m256; 2] {
        unsafe {
            [
                _mm256_set_m128(_mm256_cvtpd_ps(low[1]), _mm256_cvtpd_ps(low[0])),
                _mm256_set_m128(_mm256_cvtpd_ps(high[1]), _mm256_cvtpd_ps(high[0])),
            ]
        }
    }
    #[inline(always)]
    unsafe fn dmask(bits: u32) -> [__m256d; 2] {
        unsafe {
            each_of!([0, 1], half => {
                let lane = _mm256_setr_epi64x(1, 2, 4, 8);
                let chosen = _mm256_and_si256(_mm256_set1_epi64x((bits >> (4 * half)) as i64), lane);
                _mm256_castsi256_pd(_mm256_cmpeq_epi64(chosen, lane))
            })
        }
    }
    #[inline(always)]
    unsafe fn offer(hit: [__m256d; 2], t: &mut [f64; 8], v: [__m256d; 2], ids: &mut [u32; 8], id: u32) {
        unsafe {
            for half in 0..2 {
                let hit = hit[half];
                let (t, ids) = (t[4 * half..].as_mut_ptr(), ids[4 * half..].as_mut_ptr().cast());
                let (best, v) = (_mm256_loadu_pd(t), v[half]);
                let nearer = _mm256_and_pd(hit, _mm256_cmp_pd::<_CMP_LT_OQ>(v, best));
                let equal = _mm256_and_pd(hit, _mm256_cmp_pd::<_CMP_EQ_OQ>(v, best));
                _mm256_storeu_pd(t, _mm256_blendv_pd(best, v, nearer));
                let (old, new) = (_mm_loadu_si128(ids), _mm_set1_epi32(id as i32));
                let (nearer, equal) = (narrowed(nearer), narrowed(equal));
                let tied = _mm_blendv_epi8(old, _mm_min_epu32(old, new), equal);
                _mm_storeu_si128(ids, _mm_blendv_epi8(tied, new, nearer));
            }
        }
    }
    #[inline(always)]
    unsafe fn dgreatest(v: [__m256d; 2]) -> f64 {
        unsafe {
            let four = _mm256_max_pd(v[0], v[1]);
            let two = _mm_max_pd(_mm256_castpd256_pd128(four), _mm256_extractf128_pd::<1>(four));
            _mm_cvtsd_f64(_mm_max_sd(two, _mm_unpackhi_pd(two, two)))
        }
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
        unsafe { _mm256_maskload_pd(x.as_ptr(), _mm256_setr_epi64x(-1, -1, -1, 0)) }
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
