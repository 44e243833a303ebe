//! AVX2: two registers for sixteen `f32` or eight `f64`.
#![allow(unsafe_code, reason = "the instructions of the set")]
#![expect(
    clippy::undocumented_unsafe_blocks,
    reason = "one reason for all: only `Avx2` makes these vectors, and only detection of the features makes \
              an `Avx2`; memory is reached through references to as many numbers as an instruction reads or \
              writes"
)]

use super::{F32Ops, F64Ops, MaskOps, QuadOps, Simd, VectorOps, each_of};
use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Sub};

/// Token of the set: proof that the machine has AVX2, POPCNT, BMI1, BMI2 and LZCNT.
#[derive(Clone, Copy, Debug)]
pub struct Avx2(());

impl Avx2 {
    /// Returns the token, if the machine has the features.
    pub fn detect() -> Option<Avx2> {
        let found = is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("popcnt")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt");
        found.then_some(Avx2(()))
    }
}

/// Calls `f` with the features of the set.
#[inline(never)]
#[target_feature(enable = "avx2,popcnt,bmi1,bmi2,lzcnt")]
fn with_features<R>(f: impl FnOnce() -> R) -> R {
    f()
}

/// Sixteen `f32` in two registers.
#[derive(Clone, Copy)]
pub struct F32x16([__m256; 2]);

/// Eight `f64` in two registers.
#[derive(Clone, Copy)]
pub struct F64x8([__m256d; 2]);

/// Four `f64`, also used by AVX-512.
#[derive(Clone, Copy)]
pub struct F64x4(pub(super) __m256d);

/// All ones in the lanes that are set.
#[derive(Clone, Copy)]
pub struct Mask16([__m256; 2]);

/// All ones in the lanes that are set.
#[derive(Clone, Copy)]
pub struct Mask8([__m256d; 2]);

/// Operators with one instruction per register.
macro_rules! operators {
    ($vector:ident: $($trait:ident $name:ident $instruction:ident),+) => {$(
        impl $trait for $vector {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                let (a, b) = (self.0, other.0);
                unsafe { $vector([$instruction(a[0], b[0]), $instruction(a[1], b[1])]) }
            }
        }
    )+};
}
operators!(F32x16: Add add _mm256_add_ps, Sub sub _mm256_sub_ps);
operators!(F32x16: Mul mul _mm256_mul_ps, Div div _mm256_div_ps);
operators!(F64x8: Add add _mm256_add_pd, Sub sub _mm256_sub_pd, Mul mul _mm256_mul_pd, Div div _mm256_div_pd);
operators!(Mask16: BitAnd bitand _mm256_and_ps, BitOr bitor _mm256_or_ps);
operators!(Mask8: BitAnd bitand _mm256_and_pd, BitOr bitor _mm256_or_pd);

/// Operators of vectors of one register.
macro_rules! quad_operators {
    ($($trait:ident $name:ident $instruction:ident),+) => {$(
        impl $trait for F64x4 {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                unsafe { F64x4($instruction(self.0, other.0)) }
            }
        }
    )+};
}
quad_operators!(Add add _mm256_add_pd, Sub sub _mm256_sub_pd, Mul mul _mm256_mul_pd);

impl VectorOps for F32x16 {
    #[inline(always)]
    fn abs(self) -> Self {
        unsafe {
            let sign = _mm256_set1_ps(-0.0);
            F32x16([_mm256_andnot_ps(sign, self.0[0]), _mm256_andnot_ps(sign, self.0[1])])
        }
    }
}

impl F32Ops for F32x16 {
    type Mask = Mask16;

    #[inline(always)]
    fn store(self, to: &mut [f32; 16]) {
        let [low, high]: [&mut [f32; 8]; 2] = halves_mut(to);
        unsafe {
            _mm256_storeu_ps(low.as_mut_ptr(), self.0[0]);
            _mm256_storeu_ps(high.as_mut_ptr(), self.0[1]);
        }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        unsafe { F32x16([_mm256_min_ps(self.0[0], other.0[0]), _mm256_min_ps(self.0[1], other.0[1])]) }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        unsafe { F32x16([_mm256_max_ps(self.0[0], other.0[0]), _mm256_max_ps(self.0[1], other.0[1])]) }
    }
    #[inline(always)]
    fn min_where(self, mask: Mask16, other: Self) -> Self {
        let least = F32Ops::min(other, self);
        unsafe { F32x16(each_of!([0, 1], i => _mm256_blendv_ps(self.0[i], least.0[i], mask.0[i]))) }
    }
    #[inline(always)]
    fn max_where(self, mask: Mask16, other: Self) -> Self {
        let greatest = F32Ops::max(other, self);
        unsafe { F32x16(each_of!([0, 1], i => _mm256_blendv_ps(self.0[i], greatest.0[i], mask.0[i]))) }
    }
    #[inline(always)]
    fn le(self, other: Self) -> Mask16 {
        unsafe { Mask16(each_of!([0, 1], i => _mm256_cmp_ps::<_CMP_LE_OQ>(self.0[i], other.0[i]))) }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Mask16 {
        unsafe { Mask16(each_of!([0, 1], i => _mm256_cmp_ps::<_CMP_LT_OQ>(self.0[i], other.0[i]))) }
    }
    #[inline(always)]
    fn fold_minima(self, high: Self) -> Self {
        unsafe { F32x16([_mm256_min_ps(self.0[0], self.0[1]), _mm256_min_ps(high.0[0], high.0[1])]) }
    }
    #[inline(always)]
    fn max_lane(self) -> f32 {
        unsafe {
            let eight = _mm256_max_ps(self.0[0], self.0[1]);
            let four = _mm_max_ps(_mm256_castps256_ps128(eight), _mm256_extractf128_ps::<1>(eight));
            let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_max_ss(two, _mm_movehdup_ps(two)))
        }
    }
}

impl MaskOps for Mask16 {
    #[inline(always)]
    fn bits(self) -> u32 {
        unsafe { _mm256_movemask_ps(self.0[0]) as u32 | (_mm256_movemask_ps(self.0[1]) as u32) << 8 }
    }
}

impl VectorOps for F64x8 {
    #[inline(always)]
    fn abs(self) -> Self {
        unsafe {
            let sign = _mm256_set1_pd(-0.0);
            F64x8([_mm256_andnot_pd(sign, self.0[0]), _mm256_andnot_pd(sign, self.0[1])])
        }
    }
}

impl F64Ops for F64x8 {
    type Mask = Mask8;

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        unsafe { F64x8([_mm256_max_pd(self.0[0], other.0[0]), _mm256_max_pd(self.0[1], other.0[1])]) }
    }
    #[inline(always)]
    fn le(self, other: Self) -> Mask8 {
        unsafe { Mask8(each_of!([0, 1], i => _mm256_cmp_pd::<_CMP_LE_OQ>(self.0[i], other.0[i]))) }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Mask8 {
        unsafe { Mask8(each_of!([0, 1], i => _mm256_cmp_pd::<_CMP_LT_OQ>(self.0[i], other.0[i]))) }
    }
    #[inline(always)]
    fn max_lane(self) -> f64 {
        unsafe {
            let four = _mm256_max_pd(self.0[0], self.0[1]);
            let two = _mm_max_pd(_mm256_castpd256_pd128(four), _mm256_extractf128_pd::<1>(four));
            _mm_cvtsd_f64(_mm_max_sd(two, _mm_unpackhi_pd(two, two)))
        }
    }
}

impl MaskOps for Mask8 {
    #[inline(always)]
    fn bits(self) -> u32 {
        unsafe { _mm256_movemask_pd(self.0[0]) as u32 | (_mm256_movemask_pd(self.0[1]) as u32) << 4 }
    }
}

impl VectorOps for F64x4 {
    #[inline(always)]
    fn abs(self) -> Self {
        unsafe { F64x4(_mm256_andnot_pd(_mm256_set1_pd(-0.0), self.0)) }
    }
}

impl QuadOps for F64x4 {
    #[inline(always)]
    fn rotate(self) -> Self {
        unsafe { F64x4(_mm256_permute4x64_pd::<0b11_00_10_01>(self.0)) }
    }
    #[inline(always)]
    fn store(self, to: &mut [f64; 4]) {
        unsafe { _mm256_storeu_pd(to.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn store_f32(self, to: &mut [f32; 4]) {
        unsafe { _mm_storeu_ps(to.as_mut_ptr(), _mm256_cvtpd_ps(self.0)) }
    }
}

impl Simd for Avx2 {
    type F32x16 = F32x16;
    type F64x8 = F64x8;
    type F64x4 = F64x4;
    type Mask16 = Mask16;
    type Mask8 = Mask8;
    type Indices = [__m256i; 2];

    const HAS_WIDE_REGISTERS: bool = false;

    #[inline(always)]
    fn outlined<R>(self, f: impl FnOnce() -> R) -> R {
        unsafe { with_features(f) }
    }

    #[inline(always)]
    fn splat(self, x: f32) -> F32x16 {
        unsafe { F32x16([_mm256_set1_ps(x); 2]) }
    }
    #[inline(always)]
    fn load(self, x: &[f32; 16]) -> F32x16 {
        let [low, high]: [&[f32; 8]; 2] = halves(x);
        unsafe { F32x16([_mm256_loadu_ps(low.as_ptr()), _mm256_loadu_ps(high.as_ptr())]) }
    }
    #[inline(always)]
    fn indices(self, x: &[u32; 16]) -> [[__m256i; 2]; 2] {
        let [low, high]: [&[u32; 8]; 2] = halves(x);
        unsafe {
            let x = [_mm256_loadu_si256(low.as_ptr().cast()), _mm256_loadu_si256(high.as_ptr().cast())];
            [x, [_mm256_srli_epi32::<4>(x[0]), _mm256_srli_epi32::<4>(x[1])]]
        }
    }
    #[inline(always)]
    fn look_up(self, table: &[f32; 16], at: [__m256i; 2]) -> F32x16 {
        let [low, high] = self.load(table).0;
        unsafe {
            // A permutation uses the low three bits of an index; the fourth, as a sign, selects one of the
            // halves.
            F32x16(each_of!([0, 1], n => {
                let upper = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(at[n]));
                _mm256_blendv_ps(
                    _mm256_permutevar8x32_ps(low, at[n]),
                    _mm256_permutevar8x32_ps(high, at[n]),
                    upper,
                )
            }))
        }
    }
    #[inline(always)]
    fn row_minima(self, rows: &[[f32; 16]; 16]) -> [F32x16; 2] {
        unsafe {
            each_of!([0, 1], half => F32x16(each_of!([0, 1], n => {
                let (v, w) = (minima_of_four(rows, 8 * n, half), minima_of_four(rows, 8 * n + 4, half));
                _mm256_min_ps(_mm256_permute2f128_ps::<0x20>(v, w), _mm256_permute2f128_ps::<0x31>(v, w))
            })))
        }
    }
    #[inline(always)]
    fn write_lanes(self, mask: u32, base: u32, out: &mut [u32; 16]) {
        debug_assert!(mask < 1 << 16);
        let (low, high) = ((mask & 255) as usize, (mask >> 8 & 255) as usize);
        unsafe {
            let [lower, upper] = each_of!([0, 1], half => {
                let lanes = _mm256_loadu_si256(LANES_OF_MASK[[low, high][half]].as_ptr().cast());
                _mm256_add_epi32(lanes, _mm256_set1_epi32((base + 8 * half as u32) as i32))
            });
            let [first, _]: [&mut [u32; 8]; 2] = halves_mut(out);
            _mm256_storeu_si256(first.as_mut_ptr().cast(), lower);
            // At most eight entries precede these eight.
            let count = low.count_ones() as usize;
            _mm256_storeu_si256(out[count..count + 8].as_mut_ptr().cast(), upper);
        }
    }

    #[inline(always)]
    fn splat_f64(self, x: f64) -> F64x8 {
        unsafe { F64x8([_mm256_set1_pd(x); 2]) }
    }
    #[inline(always)]
    fn load_f64(self, x: &[f64; 8]) -> F64x8 {
        let [low, high]: [&[f64; 4]; 2] = halves(x);
        unsafe { F64x8([_mm256_loadu_pd(low.as_ptr()), _mm256_loadu_pd(high.as_ptr())]) }
    }
    #[inline(always)]
    fn mask8(self, bits: u32) -> Mask8 {
        unsafe {
            Mask8(each_of!([0, 1], half => {
                let lane = _mm256_setr_epi64x(1, 2, 4, 8);
                let chosen = _mm256_and_si256(_mm256_set1_epi64x((bits >> (4 * half)) as i64), lane);
                _mm256_castsi256_pd(_mm256_cmpeq_epi64(chosen, lane))
            }))
        }
    }
    #[inline(always)]
    fn narrow(self, low: F64x8, high: F64x8) -> F32x16 {
        unsafe {
            F32x16([
                _mm256_set_m128(_mm256_cvtpd_ps(low.0[1]), _mm256_cvtpd_ps(low.0[0])),
                _mm256_set_m128(_mm256_cvtpd_ps(high.0[1]), _mm256_cvtpd_ps(high.0[0])),
            ])
        }
    }
    #[inline(always)]
    fn keep_nearest(self, hit: Mask8, t: &mut [f64; 8], v: F64x8, ids: &mut [u32; 8], id: u32) {
        let (t, ids): ([&mut [f64; 4]; 2], [&mut [u32; 4]; 2]) = (halves_mut(t), halves_mut(ids));
        for half in 0..2 {
            let (hit, v) = (hit.0[half], v.0[half]);
            let (t, ids) = (&mut *t[half], &mut *ids[half]);
            unsafe {
                let best = _mm256_loadu_pd(t.as_ptr());
                let nearer = _mm256_and_pd(hit, _mm256_cmp_pd::<_CMP_LT_OQ>(v, best));
                let equal = _mm256_and_pd(hit, _mm256_cmp_pd::<_CMP_EQ_OQ>(v, best));
                _mm256_storeu_pd(t.as_mut_ptr(), _mm256_blendv_pd(best, v, nearer));
                let (old, new) = (_mm_loadu_si128(ids.as_ptr().cast()), _mm_set1_epi32(id as i32));
                let (nearer, equal) = (narrowed(nearer), narrowed(equal));
                let tied = _mm_blendv_epi8(old, _mm_min_epu32(old, new), equal);
                _mm_storeu_si128(ids.as_mut_ptr().cast(), _mm_blendv_epi8(tied, new, nearer));
            }
        }
    }

    #[inline(always)]
    fn splat_quad(self, x: f64) -> F64x4 {
        unsafe { F64x4(_mm256_set1_pd(x)) }
    }
    #[inline(always)]
    fn load_quad(self, x: &[f64; 4]) -> F64x4 {
        unsafe { F64x4(_mm256_loadu_pd(x.as_ptr())) }
    }
    #[inline(always)]
    fn load_triple(self, x: &[f64; 3]) -> F64x4 {
        unsafe { F64x4(_mm256_maskload_pd(x.as_ptr(), _mm256_setr_epi64x(-1, -1, -1, 0))) }
    }
}

/// Splits an array of `2·N` into halves.
#[inline(always)]
fn halves<T, const M: usize, const N: usize>(x: &[T; M]) -> [&[T; N]; 2] {
    const { assert!(M == 2 * N) };
    let (halves, _) = x.as_chunks();
    [&halves[0], &halves[1]]
}

#[inline(always)]
fn halves_mut<T, const M: usize, const N: usize>(x: &mut [T; M]) -> [&mut [T; N]; 2] {
    const { assert!(M == 2 * N) };
    let (low, high) = x.split_at_mut(N);
    [low.first_chunk_mut().expect("half of the array"), high.first_chunk_mut().expect("half of the array")]
}

/// For each mask of eight lanes, the lanes that are set, in order.
static LANES_OF_MASK: [[u32; 8]; 256] = {
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

/// Reduces eight lanes, the lower or the upper ones, of the four rows from `first` on to one register: each
/// half of it has the minima of the rows over four lanes.
///
/// # Safety
/// The machine must have AVX2.
#[inline(always)]
unsafe fn minima_of_four(rows: &[[f32; 16]; 16], first: usize, half: usize) -> __m256 {
    unsafe {
        let [a, b, c, d] = each_of!([0, 1, 2, 3], i => {
            let lanes: [&[f32; 8]; 2] = halves(&rows[first + i]);
            _mm256_loadu_ps(lanes[half].as_ptr())
        });
        let ab = _mm256_min_ps(_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
        let cd = _mm256_min_ps(_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
        let (ab, cd) = (_mm256_castps_pd(ab), _mm256_castps_pd(cd));
        let (lo, hi) = (_mm256_unpacklo_pd(ab, cd), _mm256_unpackhi_pd(ab, cd));
        _mm256_min_ps(_mm256_castpd_ps(lo), _mm256_castpd_ps(hi))
    }
}

/// Narrows a mask of four `f64` to one of four `u32`.
///
/// # Safety
/// The machine must have AVX2.
#[inline(always)]
unsafe fn narrowed(mask: __m256d) -> __m128i {
    unsafe {
        let mask = _mm256_castpd_ps(mask);
        let (low, high) = (_mm256_castps256_ps128(mask), _mm256_extractf128_ps::<1>(mask));
        _mm_castps_si128(_mm_shuffle_ps::<0b10_00_10_00>(low, high))
    }
}
