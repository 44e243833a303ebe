//! Errors that neighbouring cells share, as errors of registration, of navigation along a strip and of
//! calibration: their mean and their scatter where the clouds agree, alone and in blocks of cells.
//!
//! Differences of surfaces that did not change have random errors, which the residuals of the planes give,
//! and errors with a correlation over many cells, which they do not: those of a flight line tilt or lift a
//! whole strip. Their mean is the error of registration (Lague, Brodu & Leroux, 2013, Accurate 3D comparison
//! of complex topography with terrestrial laser scanner, whose level of detection contains it). How fast they
//! average out is read from the differences themselves, as the scatter of the means of square blocks of
//! cells: a variogram integrated over a block, without a model (Rolstad, Haug & Denby, 2009, Spatially
//! integrated geodetic glacier mass balance and its uncertainty based on geostatistical analysis; Anderson,
//! 2019, Uncertainty in quantitative analyses of topographic change: error propagation and the role of
//! thresholding).

use super::cut::CellGrid;
use super::statistic::{Statistic, quantile};

/// Rounds after which the stable cells are taken as they are.
const ROUNDS: usize = 16;
/// Standard deviations within which a cell counts as stable.
const STABLE: f64 = 3.0;
/// Minimum number of blocks whose means give a standard deviation.
const MIN_BLOCKS: usize = 8;

/// The difference of a cell and its random variance, m and m².
#[derive(Clone, Copy, Debug)]
pub(super) struct CellDifference {
    pub cell: usize,
    pub difference: f64,
    pub variance: f64,
}

/// Errors that cells share.
#[derive(Clone, Debug)]
pub(super) struct Registration {
    /// Median difference of the stable cells, m.
    pub offset: f64,
    /// Standard deviation of the stable cells about the offset beyond their random errors, m.
    pub deviation: f64,
    /// The same of the means of square blocks, by the side of a block in cells, ascending.
    of_blocks: Vec<(usize, f64)>,
}

impl Registration {
    /// The errors that cells share, by the largest group of cells with like differences.
    pub fn of(grid: &CellGrid, cells: &[CellDifference]) -> Registration {
        let (mut offset, mut deviation) = densest_half(cells.iter().map(|cell| cell.difference));
        let mut stable: Vec<CellDifference> = Vec::new();
        for _ in 0..ROUNDS {
            let is_stable = |cell: &&CellDifference| {
                (cell.difference - offset).abs() <= STABLE * (deviation * deviation + cell.variance).sqrt()
            };
            let next: Vec<CellDifference> = cells.iter().filter(is_stable).copied().collect();
            if next.is_empty() || next.len() == stable.len() {
                break;
            }
            stable = next;
            let differences = sorted(stable.iter().map(|cell| cell.difference));
            offset = quantile(&differences, 0.5);
            let variances = sorted(stable.iter().map(|cell| cell.variance));
            deviation = beyond(Statistic::Spread.of(&differences), quantile(&variances, 0.5));
        }
        let of_blocks = blocks(grid, &stable, offset);
        Registration { offset, deviation, of_blocks }
    }

    /// Standard deviation of the mean error that a number of cells share, m: that of blocks of about as many
    /// cells, or of the largest blocks whose scatter is known.
    pub fn deviation_of_mean(&self, cells: usize) -> f64 {
        let known = self.of_blocks.iter().take_while(|(side, _)| side * side <= cells);
        known.last().map_or(self.deviation, |(_, deviation)| *deviation)
    }
}

/// The middle of the shortest interval with half of the values, and half its length in standard deviations
/// (Rousseeuw, 1984, Least median of squares regression): up to half of the cells may have changed. 0 without
/// values.
fn densest_half(values: impl Iterator<Item = f64>) -> (f64, f64) {
    /// Half of a normal distribution lies within this many standard deviations.
    const QUARTILE: f64 = 0.6745;
    let sorted = sorted(values);
    let reach = sorted.len() / 2;
    let intervals = sorted.iter().zip(sorted.iter().skip(reach));
    let shortest = intervals.min_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0)));
    shortest.map_or((0.0, 0.0), |(low, high)| (0.5 * (low + high), 0.5 * (high - low) / QUARTILE))
}

/// Scatter of the means of square blocks beyond random errors, by the side of the blocks: each power of 2 of
/// which there are enough blocks with at least half of their cells.
fn blocks(grid: &CellGrid, stable: &[CellDifference], offset: f64) -> Vec<(usize, f64)> {
    let mut found = Vec::new();
    let mut side = 2;
    while side <= grid.columns.max(grid.rows) {
        let columns = grid.columns.div_ceil(side);
        let mut sums = vec![(0usize, 0.0, 0.0); columns * grid.rows.div_ceil(side)];
        for cell in stable {
            let block = (cell.cell / grid.columns / side) * columns + cell.cell % grid.columns / side;
            let (count, difference, variance) = &mut sums[block];
            (*count, *difference) = (*count + 1, *difference + cell.difference - offset);
            *variance += cell.variance;
        }
        let full: Vec<&(usize, f64, f64)> = sums.iter().filter(|sum| 2 * sum.0 >= side * side).collect();
        if full.len() < MIN_BLOCKS {
            break;
        }
        let means = sorted(full.iter().map(|(count, difference, _)| difference / *count as f64));
        let variances = sorted(full.iter().map(|(count, _, variance)| variance / (count * count) as f64));
        found.push((side, beyond(Statistic::Spread.of(&means), quantile(&variances, 0.5))));
        side *= 2;
    }
    found
}

/// The part of a standard deviation beyond a variance.
fn beyond(deviation: f64, variance: f64) -> f64 {
    (deviation * deviation - variance).max(0.0).sqrt()
}

pub(super) fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_base::rng::{Purpose, Stream};

    const SIDE: usize = 64;

    /// Cells with random errors of 1 cm, errors that squares of `shared` cells have in common, and a change
    /// of 1 m in every third.
    fn cells(offset: f64, common: f64, shared: usize) -> (CellGrid, Vec<CellDifference>) {
        let stream = Stream::new(3, Purpose::SceneMaking);
        let grid = CellGrid { side: 1.0, columns: SIDE, rows: SIDE };
        let cell = |cell: usize| {
            let block = (cell / SIDE / shared) * SIDE + cell % SIDE / shared;
            let error = 0.01 * stream.normal(1, cell as u64, 0) + common * stream.normal(2, block as u64, 0);
            let change = if cell.is_multiple_of(3) { 1.0 } else { 0.0 };
            CellDifference { cell, difference: offset + error + change, variance: 1e-4 }
        };
        (grid, (0..SIDE * SIDE).map(cell).collect())
    }

    #[test]
    fn offset_and_scatter_are_those_of_the_cells_that_did_not_change() {
        let (grid, differences) = cells(0.04, 0.0, 1);
        let random = Registration::of(&grid, &differences);
        assert!((random.offset - 0.04).abs() < 0.002 && random.deviation < 0.003, "{random:?}");
        let (grid, differences) = cells(-0.1, 0.03, 8);
        let shared = Registration::of(&grid, &differences);
        // 64 blocks give their standard deviation within a tenth, and their mean within 4 mm.
        assert!((shared.offset + 0.1).abs() < 0.012 && (shared.deviation - 0.03).abs() < 0.008, "{shared:?}");
    }

    #[test]
    fn shared_errors_average_out_beyond_their_reach_and_not_within() {
        let (grid, differences) = cells(0.0, 0.03, 8);
        let shared = Registration::of(&grid, &differences);
        let of = |count: usize| shared.deviation_of_mean(count);
        assert!((of(16) / of(4) - 1.0).abs() < 0.2 && (of(64) / of(4) - 1.0).abs() < 0.3, "{shared:?}");
        assert!(of(256) < 0.75 * of(4), "{shared:?}");
        // Larger blocks are too few.
        assert_eq!(of(256), of(1_000_000));
        assert_eq!(of(1), shared.deviation);
        assert_eq!(Registration::of(&grid, &[]).deviation_of_mean(10), 0.0);
    }
}
