//! Plain Rust: the reference for the other sets, and the fallback for machines without them.

use super::{F32Ops, F64Ops, MaskOps, QuadOps, Simd, VectorOps};
use std::array::from_fn;
use std::ops::{Add, Div, Mul, Sub};

/// Token of the portable set, which every machine has.
#[derive(Clone, Copy, Debug)]
pub struct Portable;

/// `N` numbers in an array, one per lane.
#[derive(Clone, Copy)]
pub struct Vector<T, const N: usize>([T; N]);

macro_rules! operator {
    ($trait:ident, $name:ident, $number:ty) => {
        impl<const N: usize> $trait for Vector<$number, N> {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Vector(from_fn(|i| self.0[i].$name(other.0[i])))
            }
        }
    };
}

macro_rules! operators {
    ($number:ty) => {
        operator!(Add, add, $number);
        operator!(Sub, sub, $number);
        operator!(Mul, mul, $number);
        operator!(Div, div, $number);
        impl<const N: usize> VectorOps for Vector<$number, N> {
            #[inline(always)]
            fn abs(self) -> Self {
                Vector(self.0.map(<$number>::abs))
            }
        }
    };
}
operators!(f32);
operators!(f64);

#[inline(always)]
fn lesser<T: PartialOrd>(a: T, b: T) -> T {
    if a < b { a } else { b }
}

#[inline(always)]
fn greater<T: PartialOrd>(a: T, b: T) -> T {
    if a > b { a } else { b }
}

impl<T: Copy, const N: usize> Vector<T, N> {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(T, T) -> T) -> Self {
        Vector(from_fn(|i| f(self.0[i], other.0[i])))
    }

    #[inline(always)]
    fn mask(self, other: Self, f: impl Fn(T, T) -> bool) -> u32 {
        (0..N).fold(0, |m, i| m | u32::from(f(self.0[i], other.0[i])) << i)
    }
}

impl MaskOps for u32 {
    #[inline(always)]
    fn bits(self) -> u32 {
        self
    }
}

impl F32Ops for Vector<f32, 16> {
    type Mask = u32;

    #[inline(always)]
    fn store(self, to: &mut [f32; 16]) {
        *to = self.0;
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, lesser)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, greater)
    }
    #[inline(always)]
    fn min_where(self, mask: u32, other: Self) -> Self {
        Vector(from_fn(|i| if mask >> i & 1 != 0 { lesser(other.0[i], self.0[i]) } else { self.0[i] }))
    }
    #[inline(always)]
    fn max_where(self, mask: u32, other: Self) -> Self {
        Vector(from_fn(|i| if mask >> i & 1 != 0 { greater(other.0[i], self.0[i]) } else { self.0[i] }))
    }
    #[inline(always)]
    fn le(self, other: Self) -> u32 {
        self.mask(other, |a, b| a <= b)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> u32 {
        self.mask(other, |a, b| a < b)
    }
    #[inline(always)]
    fn fold_minima(self, high: Self) -> Self {
        let (low, high) = (self.0, high.0);
        Vector(from_fn(|i| if i < 8 { lesser(low[i], low[i + 8]) } else { lesser(high[i - 8], high[i]) }))
    }
    #[inline(always)]
    fn max_lane(self) -> f32 {
        self.0.into_iter().fold(f32::NEG_INFINITY, |m, x| greater(x, m))
    }
}

impl F64Ops for Vector<f64, 8> {
    type Mask = u32;

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, greater)
    }
    #[inline(always)]
    fn le(self, other: Self) -> u32 {
        self.mask(other, |a, b| a <= b)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> u32 {
        self.mask(other, |a, b| a < b)
    }
    #[inline(always)]
    fn max_lane(self) -> f64 {
        self.0.into_iter().fold(f64::NEG_INFINITY, |m, x| greater(x, m))
    }
}

impl QuadOps for Vector<f64, 4> {
    #[inline(always)]
    fn rotate(self) -> Self {
        let [x, y, z, w] = self.0;
        Vector([y, z, x, w])
    }
    #[inline(always)]
    fn store(self, to: &mut [f64; 4]) {
        *to = self.0;
    }
    #[inline(always)]
    fn store_f32(self, to: &mut [f32; 4]) {
        *to = self.0.map(|x| x as f32);
    }
}

impl Simd for Portable {
    type F32x16 = Vector<f32, 16>;
    type F64x8 = Vector<f64, 8>;
    type F64x4 = Vector<f64, 4>;
    type Mask16 = u32;
    type Mask8 = u32;
    type Indices = [u32; 16];

    const HAS_WIDE_REGISTERS: bool = false;

    #[inline(never)]
    fn outlined<R>(self, f: impl FnOnce() -> R) -> R {
        f()
    }

    #[inline(always)]
    fn splat(self, x: f32) -> Self::F32x16 {
        Vector([x; 16])
    }
    #[inline(always)]
    fn load(self, x: &[f32; 16]) -> Self::F32x16 {
        Vector(*x)
    }
    #[inline(always)]
    fn indices(self, x: &[u32; 16]) -> [[u32; 16]; 2] {
        [x.map(|x| x & 15), x.map(|x| x >> 4 & 15)]
    }
    #[inline(always)]
    fn look_up(self, table: &[f32; 16], at: [u32; 16]) -> Self::F32x16 {
        Vector(at.map(|n| table[n as usize & 15]))
    }
    #[inline(always)]
    fn row_minima(self, rows: &[[f32; 16]; 16]) -> [Self::F32x16; 2] {
        let least = |half: &[f32]| half.iter().fold(f32::INFINITY, |m, &x| lesser(x, m));
        [Vector(from_fn(|r| least(&rows[r][..8]))), Vector(from_fn(|r| least(&rows[r][8..])))]
    }
    #[inline(always)]
    fn write_lanes(self, mut mask: u32, base: u32, out: &mut [u32; 16]) {
        debug_assert!(mask < 1 << 16);
        let mut n = 0;
        while mask != 0 {
            out[n & 15] = base + mask.trailing_zeros();
            mask &= mask - 1;
            n += 1;
        }
    }

    #[inline(always)]
    fn splat_f64(self, x: f64) -> Self::F64x8 {
        Vector([x; 8])
    }
    #[inline(always)]
    fn load_f64(self, x: &[f64; 8]) -> Self::F64x8 {
        Vector(*x)
    }
    #[inline(always)]
    fn mask8(self, bits: u32) -> u32 {
        bits & 255
    }
    #[inline(always)]
    fn narrow(self, low: Self::F64x8, high: Self::F64x8) -> Self::F32x16 {
        Vector(from_fn(|i| if i < 8 { low.0[i] as f32 } else { high.0[i - 8] as f32 }))
    }
    #[inline(always)]
    fn keep_nearest(self, hit: u32, t: &mut [f64; 8], v: Self::F64x8, ids: &mut [u32; 8], id: u32) {
        for (n, v) in v.0.into_iter().enumerate() {
            if hit >> n & 1 != 0 && (v < t[n] || (v == t[n] && id < ids[n])) {
                (t[n], ids[n]) = (v, id);
            }
        }
    }

    #[inline(always)]
    fn splat_quad(self, x: f64) -> Self::F64x4 {
        Vector([x; 4])
    }
    #[inline(always)]
    fn load_quad(self, x: &[f64; 4]) -> Self::F64x4 {
        Vector(*x)
    }
    #[inline(always)]
    fn load_triple(self, [x, y, z]: &[f64; 3]) -> Self::F64x4 {
        Vector([*x, *y, *z, 0.0])
    }
}
