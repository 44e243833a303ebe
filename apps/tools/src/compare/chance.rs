//! Differences by chance alone: those between random halves of the first cloud.
//!
//! Neighbouring points are alike, since they share terrain, attitude errors and atmosphere, so that single
//! points must not be drawn: halves of single points would be alike beyond what another measurement is. The
//! cloud is divided into blocks, which are its scan lines or, where there are none, square cells (a block
//! bootstrap: Künsch, 1989, The jackknife and the bootstrap for general stationary observations). Of two
//! neighbouring blocks one goes to each half, by a coin, so that both halves see the same place and differ by
//! what changes from one line to the next. In [`SPLITS`] splits the largest difference is a bound: one more
//! of its kind exceeds it with a probability of 1 in 40.
//!
//! Halves have half the points, so that the bound is wide for clouds as large as the first one: it errs on
//! the side of chance.

use serde::Serialize;
use vlscan_base::rng::{Purpose, Stream};

/// Number of splits whose largest difference is the bound.
pub(super) const SPLITS: u64 = 39;
/// Minimum number of blocks for an estimate of chance.
pub(super) const MIN_BLOCKS: u32 = 16;
const SEED: u64 = 0;

/// Blocks of which the halves consist.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "blocks")]
pub enum BlockKind {
    /// Scan lines by GPS time and scan angle.
    ScanLines,
    /// Square cells.
    Cells {
        /// Side of a cell, m.
        side_m: f64,
    },
}

/// Basis of the bounds by chance.
#[derive(Clone, Debug, Serialize)]
pub struct Chance {
    /// Blocks that go to one half or the other as a whole.
    #[serde(flatten)]
    pub kind: BlockKind,
    /// Number of blocks.
    pub count: u32,
    /// Number of random splits, whose largest difference is the bound.
    pub splits: u64,
}

/// The halves of a cloud whose points belong to numbered blocks, neighbours having neighbouring numbers.
pub(super) struct Halves {
    /// Of each split, whether a block is in the second half.
    is_second: Vec<Vec<bool>>,
}

impl Halves {
    pub fn new(blocks: u32) -> Halves {
        let stream = Stream::new(SEED, Purpose::Halves);
        let split = |number: u64| {
            let coin = |pair: u32| stream.bits(0, number, pair)[0] & 1;
            // Every other split pairs a block with the one before, so that the first and the last may make
            // one half larger.
            let shift = (number % 2) as u32;
            (0..blocks).map(|block| (coin((block + shift) / 2) ^ (block + shift) & 1) == 1).collect()
        };
        Halves { is_second: (0..SPLITS).map(split).collect() }
    }

    /// The half of a block in a split: 0 or 1.
    pub fn half(&self, split: usize, block: u32) -> usize {
        usize::from(self.is_second[split][block as usize])
    }

    /// Values of both halves in their order.
    pub fn of_values(&self, split: usize, values: &[(f64, u32)]) -> [Vec<f64>; 2] {
        let mut halves = [Vec::with_capacity(values.len() / 2), Vec::with_capacity(values.len() / 2)];
        values.iter().for_each(|(value, block)| halves[self.half(split, *block)].push(*value));
        halves
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_blocks_are_in_different_halves_and_splits_differ() {
        let halves = Halves::new(1001);
        for split in 0..SPLITS as usize {
            let shift = split as u32 % 2;
            let half = |block: u32| halves.half(split, block + shift);
            assert!((0..500).all(|pair| half(2 * pair) != half(2 * pair + 1)));
            let ones = (0..500).filter(|pair| half(2 * pair) == 1).count();
            // 500 coins: within six standard deviations.
            assert!((183..=317).contains(&ones), "{ones}");
        }
        assert!((0..1001).any(|block| halves.half(0, block) != halves.half(1, block)));
    }
}
