//! Properties that cells and voxels of both clouds share: highest and lowest points, occupied voxels.

use super::cut::{CellGrid, Cut, of_both};
use serde::Serialize;
use std::collections::HashSet;
use std::hash::{BuildHasherDefault, Hasher};

/// Canopy height, the highest point of each cell above the ground, where both clouds have points.
#[derive(Clone, Debug, Serialize)]
pub struct Canopy {
    /// Number of such cells.
    pub cells: usize,
    /// Second minus first, m.
    pub mean_difference_m: f64,
    /// Root mean square of the differences, m.
    pub rms_difference_m: f64,
    /// Pearson's correlation of both heights.
    pub correlation: f64,
}

/// Voxels that hold points.
#[derive(Clone, Debug, Serialize)]
pub struct Voxels {
    /// Side of a voxel, m.
    pub side_m: f64,
    /// Voxels with points of both clouds.
    pub both: usize,
    /// Voxels with points of the first cloud only.
    pub only_first: usize,
    /// Voxels with points of the second cloud only.
    pub only_second: usize,
    /// Both over all (Jaccard).
    pub agreement: f64,
}

/// The highest points of both clouds in the cells of `grid`, above the lowest ones in the cells of
/// `wide_grid`.
pub(super) fn canopy(grid: &CellGrid, wide_grid: &CellGrid, lowest: &[f64], cuts: [&Cut; 2]) -> Canopy {
    let tops = of_both(cuts, |cut| {
        let extremes = grid.extremes(cut.offsets());
        let top = |(cell, [_, high]): (usize, [f64; 2])| {
            let [x, y] = grid.centre(cell);
            high - lowest[wide_grid.cell(&[x, y, 0.0])]
        };
        extremes.into_iter().enumerate().map(top).collect::<Vec<f64>>()
    });
    let both = || {
        let pairs = tops[0].iter().zip(&tops[1]).filter(|(a, b)| a.is_finite() && b.is_finite());
        pairs.map(|(a, b)| (*a, *b))
    };
    let cells = both().count();
    let mean_of =
        |of: &dyn Fn(f64, f64) -> f64| both().map(|(a, b)| of(a, b)).sum::<f64>() / (cells as f64).max(1.0);
    Canopy {
        cells,
        mean_difference_m: mean_of(&|a, b| b - a),
        rms_difference_m: mean_of(&|a, b| (b - a) * (b - a)).sqrt(),
        correlation: correlation(both()),
    }
}

/// The voxels of a side that points of one cloud or the other occupy.
pub(super) fn voxels(cuts: [&Cut; 2], side: f64) -> Voxels {
    let [a, b] = of_both(cuts, |cut| occupied(cut, side));
    let both = a.intersection(&b).count();
    let all = a.len() + b.len() - both;
    Voxels {
        side_m: side,
        both,
        only_first: a.len() - both,
        only_second: b.len() - both,
        agreement: both as f64 / all.max(1) as f64,
    }
}

/// The voxels of a side that hold points of a cloud: three indices of 32 bits in one number.
fn occupied(cut: &Cut, side: f64) -> HashSet<u128, BuildHasherDefault<VoxelHasher>> {
    let mut voxels = HashSet::default();
    let mut last = None;
    cut.offsets().for_each(|offset| {
        let [x, y, z] = offset.map(|v| u128::from((v / side).floor() as i32 as u32));
        let voxel = x << 64 | y << 32 | z;
        // Many neighbours in the file are in one voxel.
        if last != Some(voxel) {
            voxels.insert(voxel);
            last = Some(voxel);
        }
    });
    voxels
}

/// Mixes the bits of numbers. Collisions cost time, and no one gains by them.
#[derive(Default)]
struct VoxelHasher(u64);

impl Hasher for VoxelHasher {
    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u128(u128::from(*byte)));
    }

    fn write_u128(&mut self, number: u128) {
        const ODD: [u64; 2] = [0x9E37_79B9_7F4A_7C15, 0xD6E8_FEB8_6659_FD93];
        let folded =
            (number as u64 ^ self.0).wrapping_mul(ODD[0]) ^ ((number >> 64) as u64).wrapping_mul(ODD[1]);
        self.0 = (folded ^ folded >> 32).wrapping_mul(ODD[0]);
    }

    fn finish(&self) -> u64 {
        self.0 ^ self.0 >> 29
    }
}

/// Pearson's correlation; NaN, which JSON writes as null, where one side does not vary.
pub(super) fn correlation(pairs: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let n = pairs.clone().count() as f64;
    let mean = |pick: fn((f64, f64)) -> f64| pairs.clone().map(pick).sum::<f64>() / n;
    let (ma, mb) = (mean(|p| p.0), mean(|p| p.1));
    let (mut sab, mut saa, mut sbb) = (0.0, 0.0, 0.0);
    for (a, b) in pairs {
        sab += (a - ma) * (b - mb);
        saa += (a - ma) * (a - ma);
        sbb += (b - mb) * (b - mb);
    }
    sab / (saa * sbb).sqrt()
}
