use super::portable::Portable;
use super::*;
use vlscan_base::rng::{Purpose, Stream};

/// Returns the bits of a number; all NaN are equal.
fn bits(x: impl Into<f64>) -> u64 {
    let x = x.into();
    if x.is_nan() { 1 } else { x.to_bits() }
}

/// Returns the results of every operation on random numbers, as bits.
#[inline(always)]
fn results<S: Simd>(simd: S, round: u64) -> Vec<u64> {
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
    let singles = |which: u32| -> [f32; 16] { std::array::from_fn(|n| number(which, n) as f32) };
    let (a, b) = (simd.load(&singles(0)), simd.load(&singles(1)));
    let m = a.le(b) & (b.lt(a) | a.le(a));
    let numbers: [u32; 16] = std::array::from_fn(|n| draw.bits(12, round, n as u32)[0] & 255);
    let finite = |which: u32, row: usize| -> [f32; 16] {
        std::array::from_fn(|n| draw.uniform(which, round, (16 * row + n) as u32) as f32)
    };
    let [low, high] = simd.row_minima(&std::array::from_fn(|r| finite(4, r)));
    let [at, of] = simd.indices(&numbers).map(|at| simd.look_up(&singles(1), at));
    let fine = simd.load_f64(&std::array::from_fn(|n| draw.uniform(9, round, n as u32)));
    let doubles = |which: u32| -> [f64; 8] { std::array::from_fn(|n| number(which, n)) };
    let (c, d) = (simd.load_f64(&doubles(6)), simd.load_f64(&doubles(7)));
    for v in [
        a + b,
        a - b,
        a * b,
        a / b,
        a.min(b),
        a.max(b),
        a.abs(),
        at,
        of,
        a.min_where(m, b),
        a.max_where(m, b),
        simd.splat(singles(0)[3]),
        simd.load(&finite(2, 0)).fold_minima(simd.load(&finite(3, 0))),
        low,
        high,
        simd.narrow(fine, c.abs()),
    ] {
        let mut x = [0.0; 16];
        v.store(&mut x);
        out.extend(x.map(bits));
    }
    out.push(bits(simd.load(&finite(2, 0)).max_lane()));
    out.extend([m.bits(), a.lt(b).bits(), b.le(a).bits()].map(u64::from));
    let mask = draw.bits(5, round, 0)[0] & 0xffff;
    let mut lanes = [0; 16];
    simd.write_lanes(mask, 160, &mut lanes);
    out.extend(lanes[..mask.count_ones() as usize].iter().map(|&x| u64::from(x)));

    let ids: [u32; 8] = std::array::from_fn(|n| draw.bits(8, round, n as u32)[0] & 3);
    for v in [c + d, c - d, c * d, c / d, c.max(d), c.abs(), simd.splat_f64(0.1)] {
        let (mut t, mut ids) = ([0.5; 8], ids);
        simd.keep_nearest(simd.mask8(mask), &mut t, v, &mut ids, 1);
        out.extend(t.map(bits));
        out.extend(ids.map(u64::from));
    }
    out.extend([c.le(d) & d.le(c), c.lt(d) | d.lt(c)].map(|m| u64::from(m.bits())));
    out.push(bits(fine.max_lane()));
    out.extend(simd.count_smaller(&doubles(6), &[doubles(7), doubles(6)]).into_iter().flatten());

    let quad = |which: u32| simd.load_quad(&std::array::from_fn(|n| number(which, n)));
    let (a, b) = (quad(10), quad(11));
    let triple = simd.load_triple(&[number(10, 0), number(10, 1), number(10, 2)]);
    for v in [a + b, a - b, a * b, a.abs(), b.rotate(), simd.splat_quad(0.7), triple] {
        let (mut single, mut double) = ([0.0; 4], [0.0; 4]);
        v.store_f32(&mut single);
        v.store(&mut double);
        out.extend(single.map(bits));
        out.extend(double.map(bits));
    }
    out
}

#[test]
fn all_sets_compute_the_same() {
    for level in Level::available() {
        for round in 0..500 {
            let found = dispatch!(level, simd => results(simd, round));
            assert_eq!(results(Portable, round), found, "{level:?}, round {round}");
        }
    }
}
