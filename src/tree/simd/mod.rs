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
        let avx2 = is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("popcnt")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt");
        #[cfg(target_arch = "x86_64")]
        let sets = [
            Some(Level::Portable),
            avx2.then_some(Level::Avx2),
            (avx2
                && is_x86_feature_detected!("avx512f")
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

/// Asks for the memory of what `x` points to ahead of its use.
#[inline(always)]
pub(crate) fn prefetch<T>(x: *const T) {
    #[cfg(target_arch = "x86_64")]
    for line in (0..size_of::<T>()).step_by(64) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch reads nothing, wherever it points to.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(x.cast::<i8>().wrapping_add(line)) }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = x;
}

/// A step of the kernel.
pub(crate) trait Step<S: Simd> {
    /// What comes out.
    type Out;
    /// Takes the step; always inlined, so that the compiler may use the set's features.
    ///
    /// # Safety
    /// As for [`Simd`].
    unsafe fn run(self) -> Self::Out;
}

/// Operations of an instruction set. `F` are sixteen `f32`, `D` eight `f64`; `M` and `N` are their masks. `Q` are four
/// `f64`. `I` are sixteen places in a table of sixteen.
///
/// # Safety
/// Every function may only run where the set's target features are available.
pub(crate) trait Simd: Copy {
    type F: Copy;
    type M: Copy;
    type D: Copy;
    type N: Copy;
    type Q: Copy;
    type I: Copy;

    /// Takes a step in a function of its own, which has all registers to itself.
    unsafe fn apart<T: Step<Self>>(step: T) -> T::Out;

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
    unsafe fn abs(a: Self::F) -> Self::F;
    /// Places `x mod 16`, and `x / 16 mod 16`.
    unsafe fn places(x: &[u32; 16]) -> [Self::I; 2];
    /// What stands at each of the places.
    unsafe fn pick(table: &[f32; 16], at: Self::I) -> Self::F;
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
    unsafe fn dle(a: Self::D, b: Self::D) -> Self::N;
    unsafe fn dand(a: Self::N, b: Self::N) -> Self::N;
    unsafe fn dbits(m: Self::N) -> u32;
    /// The mask of the low eight bits.
    unsafe fn dmask(bits: u32) -> Self::N;
    /// Both vectors as one of `f32`, rounded to nearest.
    unsafe fn narrow(low: Self::D, high: Self::D) -> Self::F;
    /// Takes over `v` and `id` in the lanes of `hit` where `v` is less than `t`, or as much and `id` less than what is in
    /// `ids`.
    unsafe fn offer(hit: Self::N, t: &mut [f64; 8], v: Self::D, ids: &mut [u32; 8], id: u32);
    /// The greatest lane.
    unsafe fn dgreatest(v: Self::D) -> f64;

    unsafe fn qsplat(x: f64) -> Self::Q;
    unsafe fn qload(x: &[f64; 4]) -> Self::Q;
    /// The fourth lane is 0.
    unsafe fn qload3(x: &[f64; 3]) -> Self::Q;
    unsafe fn qkeep(x: &mut [f64; 4], v: Self::Q);
    unsafe fn qadd(a: Self::Q, b: Self::Q) -> Self::Q;
    unsafe fn qsub(a: Self::Q, b: Self::Q) -> Self::Q;
    unsafe fn qmul(a: Self::Q, b: Self::Q) -> Self::Q;
    unsafe fn qabs(a: Self::Q) -> Self::Q;
    /// Lanes 1, 2, 0, 3.
    unsafe fn qturn(a: Self::Q) -> Self::Q;
    /// Rounded to nearest.
    unsafe fn qstore(x: &mut [f32; 4], v: Self::Q);
}

#[cfg(test)]
mod tests {
    use super::portable::Portable;
    use super::*;
    use crate::rng::{Purpose, Stream};

    /// Results of every operation on the same inputs, as bits.
    ///
    /// # Safety
    /// As for [`Simd`].
    unsafe fn trial<S: Simd>(round: u64) -> Vec<u64> {
        let draw = Stream::new(3, Purpose::SceneMaking);
        let number = |which: u32, n: usize| -> f64 {
            let x = draw.uniform(which, round, n as u32) - 0.5;
            // Equal, infinite and undefined numbers must be frequent.
            match draw.bits(which, round, n as u32 + 1000)[0] % 12 {
                0 => 0.25,
                1 => f64::INFINITY,
                2 => f64::NAN,
                3 => -0.0,
                _ => x,
            }
        };
        let mut out = Vec::new();
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let singles = |which: u32| -> [f32; 16] { std::array::from_fn(|n| number(which, n) as f32) };
            let (a, b) = (S::load(&singles(0)), S::load(&singles(1)));
            let m = S::and(S::le(a, b), S::or(S::lt(b, a), S::le(a, a)));
            let mut keep = |v: S::F| {
                let mut x = [0.0; 16];
                S::store(&mut x, v);
                out.extend(x.map(|x| if x.is_nan() { 1 } else { u64::from(x.to_bits()) }));
            };
            for v in [S::add(a, b), S::sub(a, b), S::mul(a, b), S::div(a, b), S::min(a, b), S::max(a, b)] {
                keep(v);
            }
            keep(S::abs(a));
            let numbers: [u32; 16] = std::array::from_fn(|n| draw.bits(12, round, n as u32)[0] & 255);
            for at in S::places(&numbers) {
                keep(S::pick(&singles(1), at));
            }
            keep(S::min_where(m, a, b));
            keep(S::max_where(m, a, b));
            keep(S::splat(singles(0)[3]));
            let whole =
                |which: u32| S::load(&std::array::from_fn(|n| draw.uniform(which, round, n as u32) as f32));
            keep(S::fold_minima(whole(2), whole(3)));
            let rows = std::array::from_fn(|r| {
                std::array::from_fn(|n| draw.uniform(4, round, (16 * r + n) as u32) as f32)
            });
            let [low, high] = S::row_minima(&rows);
            keep(low);
            keep(high);
            out.push(u64::from(S::greatest(whole(2)).to_bits()));
            out.extend([S::bits(m), S::bits(S::lt(a, b)), S::bits(S::le(b, a))].map(u64::from));
            let mask = draw.bits(5, round, 0)[0] & 0xffff;
            let mut places = [0; 16];
            S::compress(mask, 160, &mut places);
            out.extend(places[..mask.count_ones() as usize].iter().map(|&x| u64::from(x)));

            let doubles = |which: u32| -> [f64; 8] { std::array::from_fn(|n| number(which, n)) };
            let (a, b) = (S::dload(&doubles(6)), S::dload(&doubles(7)));
            let ids: [u32; 8] = std::array::from_fn(|n| draw.bits(8, round, n as u32)[0] & 3);
            for v in [
                S::dadd(a, b),
                S::dsub(a, b),
                S::dmul(a, b),
                S::ddiv(a, b),
                S::dmax(a, b),
                S::dabs(a),
                S::dsplat(0.1),
            ] {
                let (mut t, mut id) = ([0.5; 8], ids);
                S::offer(S::dmask(mask), &mut t, v, &mut id, 1);
                out.extend(t.map(|x| if x.is_nan() { 1 } else { x.to_bits() }));
                out.extend(id.map(u64::from));
            }
            out.extend([S::dbits(S::dand(S::dle(a, b), S::dle(b, a)))].map(u64::from));
            let fine = S::dload(&std::array::from_fn(|n| draw.uniform(9, round, n as u32)));
            out.push(S::dgreatest(fine).to_bits());
            let mut x = [0.0; 16];
            S::store(&mut x, S::narrow(fine, S::dabs(a)));
            out.extend(x.map(|x| if x.is_nan() { 1 } else { u64::from(x.to_bits()) }));

            let four = |which: u32| S::qload(&std::array::from_fn(|n| number(which, n)));
            let (a, b) = (four(10), four(11));
            for v in [S::qadd(a, b), S::qsub(a, b), S::qmul(a, b), S::qabs(a), S::qturn(b), S::qsplat(0.7)] {
                let mut x = [0.0; 4];
                S::qstore(&mut x, v);
                out.extend(x.map(|x| if x.is_nan() { 1 } else { u64::from(x.to_bits()) }));
            }
            let mut x = [0.0; 4];
            S::qkeep(&mut x, S::qload3(&[number(10, 0), number(10, 1), number(10, 2)]));
            out.extend(x.map(|x| if x.is_nan() { 1 } else { x.to_bits() }));
        }
        out
    }

    #[test]
    fn all_sets_compute_the_same() {
        for level in Level::available() {
            for round in 0..500 {
                // SAFETY: available means that the features are there.
                let (expected, found) = unsafe {
                    let found = match level {
                        Level::Portable => trial::<Portable>(round),
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx2 => trial::<avx2::Avx2>(round),
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx512 => trial::<avx512::Avx512>(round),
                    };
                    (trial::<Portable>(round), found)
                };
                assert_eq!(expected, found, "{level:?}, round {round}");
            }
        }
    }
}
