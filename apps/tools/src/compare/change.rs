//! The change between two epochs: the ground of the second cloud minus that of the first, cell by cell, with
//! the uncertainty of each cell, and the volumes of cut and fill beyond the level of detection.
//!
//! The surface of a cell is the least-squares plane through its points at its centre
//! ([`super::cell_surface`]). Its random variance is that of the residuals times the leverage of the centre.
//! Errors that cells share, of registration and along strips, come from the cells that did not change
//! ([`super::registration`]). The level of detection at 95 % is 1.96 √(σ₁² + σ₂² + s² + o²), with the random
//! deviations σ of both surfaces, the scatter s and the offset o of shared errors (Lane, Westaway & Hicks,
//! 2003, Estimation of erosion and deposition volumes in a large, gravel-bed, braided river using synoptic
//! remote sensing; Lague, Brodu & Leroux, 2013, Accurate 3D comparison of complex topography with terrestrial
//! laser scanner, on the error of registration). One cell in twenty is beyond the level by chance, so that
//! two of the eight neighbours of a changed cell must have changed in the same sense (Wheaton et al., 2010,
//! Accounting for uncertainty in DEMs from repeat topographic surveys, on spatial coherence).
//!
//! The variance of a volume has three parts (Anderson, 2019, Uncertainty in quantitative analyses of
//! topographic change: error propagation and the role of thresholding): the random errors of its cells;
//! shared errors, which are those of blocks of as many cells, and the offset; and the volume that the level
//! of detection cuts off. Cells that are filled from their neighbours ([`super::gaps`]) share errors, which
//! add up within blocks. Cells that are left out add the volume that they would have if they changed like the
//! measured cells around them.

use super::cell_surface::{CellSurface, cell_surfaces};
use super::cut::{CellGrid, Cut};
use super::gaps::{Gaps, MeasuredCells};
use super::registration::{CellDifference, Registration, sorted};
use super::statistic::{Statistic, quantile};
use super::terrain::GROUND;
use crate::geotiff::{Grid, geotiff};
use serde::Serialize;
use vlscan_base::error::Result;
use vlscan_base::quantity::signed;

/// Standard deviations of the level of detection: 95 % of normal errors lie within them.
const DETECTION: f64 = 1.96;
/// Side of the blocks in which change below the level of detection and errors of filled cells add up, in
/// cells.
const BLOCK: usize = 8;

/// Change between the clouds: second minus first, where both have a surface.
#[derive(Clone, Debug, Serialize)]
pub struct Change {
    /// The points that the surfaces are made of.
    pub surface: &'static str,
    /// Number of cells with a difference.
    pub cells: usize,
    /// Number of these cells whose difference is the mean of measured cells around them, since a surface
    /// would be extrapolated.
    pub cells_interpolated: usize,
    /// Number of cells with points of both that are left out, since their surface would be extrapolated in
    /// the first or in the second cloud and too few cells around them have a difference.
    pub cells_extrapolated: [usize; 2],
    /// Number of cells with points of both that are left out, each counted once.
    pub cells_left_out: usize,
    /// Number of these cells, and of cells without points of both between cells with a difference.
    pub cells_unmeasured: usize,
    /// Number of cells with points of only the first, and of only the second cloud.
    pub cells_of_one: [usize; 2],
    /// Mean difference, m.
    pub mean_m: f64,
    /// Median difference, m.
    pub median_m: f64,
    /// Robust spread of the differences, m: half the distance of the quantiles at 15.87 and 84.13 %.
    pub spread_m: f64,
    /// Root mean square of the differences, m.
    pub rms_m: f64,
    /// Median of the cells' levels of detection at 95 %, m.
    pub detection_m: f64,
    /// Median difference where nothing changed, m: the error of registration.
    pub offset_m: f64,
    /// Standard deviation of the errors that neighbouring cells share about the offset, m.
    pub shared_m: f64,
    /// Volume where the second cloud is significantly higher.
    pub fill: Volume,
    /// Volume where the second cloud is significantly lower.
    pub cut: Volume,
    /// Volume between both surfaces over all cells, significant or not, m³.
    pub net_m3: f64,
    /// Standard uncertainty of the net volume, m³; NaN without cells.
    pub net_uncertainty_m3: f64,
    /// Median standard deviation of the random errors of the cells, m.
    pub random_m: f64,
    /// The differences of the cells.
    #[serde(skip)]
    pub map: ChangeMap,
}

impl Change {
    /// A sentence about the cells without a surface, if they are many or dominate an uncertainty.
    pub(super) fn doubts(&self, side: f64) -> Option<String> {
        /// Minimum share of cells left out that is mentioned.
        const LEFT_OUT: f64 = 0.1;
        /// Minimum share of cells left out or filled that is mentioned.
        const WITHOUT_SURFACE: f64 = 0.25;
        /// Minimum share of a volume, added by cells left out, that is reported.
        const UNMEASURED: f64 = 0.05;
        let [left_out, filled] = [self.cells_unmeasured, self.cells_interpolated];
        let all = self.cells + left_out;
        let dominates = |volume: &Volume| {
            volume.unmeasured_m3 > 0.5 * volume.uncertainty_m3
                && volume.unmeasured_m3 > UNMEASURED * volume.volume_m3
        };
        let is_mentioned = left_out as f64 > LEFT_OUT * all as f64
            || (left_out + filled) as f64 > WITHOUT_SURFACE * all as f64
            || [&self.fill, &self.cut].into_iter().any(dominates);
        is_mentioned.then(|| {
            format!(
                "change in {left_out} of {all} cells, {filled} more are filled from cells around them: the \
                 points of a cloud do not surround their centres; larger cells have more points (--cell {})",
                2.0 * side
            )
        })
    }

    /// A sentence about the offset, if it is more than chance.
    pub(super) fn registration_note(&self) -> Option<String> {
        (self.offset_m.abs() > self.random_m).then(|| {
            format!(
                "most cells differ by about {} m, which is counted as an error of registration and raises \
                 the level of detection; --registration M states its standard deviation",
                signed(self.offset_m, 3)
            )
        })
    }
}

/// A volume of change.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Volume {
    /// m³.
    pub volume_m3: f64,
    /// Its standard uncertainty, m³, which contains the volumes below the level of detection and of cells
    /// left out; NaN without cells.
    pub uncertainty_m3: f64,
    /// Volume of the same sense below the level of detection, m³: cells that did not change significantly,
    /// summed in blocks, relative to the offset, or to 0 if the registration is stated.
    pub undetected_m3: f64,
    /// Volume of the same sense that cells left out would have if they changed like the measured cells around
    /// them, m³.
    pub unmeasured_m3: f64,
    /// Area of its cells, m².
    pub area_m2: f64,
}

/// Differences of the cells, row by row from the south west.
#[derive(Clone, Debug)]
pub struct ChangeMap {
    /// Side of a cell, m.
    pub side_m: f64,
    /// Number of cells from west to east.
    pub columns: usize,
    /// Number of cells from south to north.
    pub rows: usize,
    /// World coordinates of the south-western corner, m.
    pub corner: [f64; 2],
    /// Second minus first, m; NaN where a surface is missing.
    pub differences: Vec<f64>,
    /// Level of detection at 95 %, m; NaN where a surface is missing.
    pub detection: Vec<f64>,
    /// True if the difference is beyond the level of detection, and that of at least two of the eight
    /// neighbours in the same sense.
    pub is_changed: Vec<bool>,
}

impl ChangeMap {
    /// The differences as a GeoTIFF file in a system, NaN where a surface is missing.
    ///
    /// # Errors
    /// [`Error::Input`](vlscan_base::Error::Input) for a map that is too large for the format.
    pub fn geotiff(&self, crs: Option<&str>) -> Result<Vec<u8>> {
        let ChangeMap { columns, rows, side_m, corner, .. } = *self;
        geotiff(&Grid { columns, rows, side_m, corner, crs }, &self.differences)
    }
}

/// The change in the cells of a grid over the common box, whose corner is at `corner`. `registration` is the
/// standard deviation of the registration of the clouds, m; `None` to estimate it.
pub(super) fn change(
    grid: &CellGrid,
    cuts: [&Cut; 2],
    corner: [f64; 2],
    registration: Option<f64>,
) -> Change {
    let are_classified = cuts.iter().all(|cut| (0..cut.len()).any(|i| cut.class(i) == Some(GROUND)));
    let surfaces = cuts.map(|cut| cell_surfaces(grid, cut, are_classified));
    let measured = Measured::new(grid, &surfaces, registration);
    let count_of = |is_counted: &dyn Fn(usize, CellSurface, CellSurface) -> bool| {
        let count = |cloud: usize| {
            let is_cell = |i: &usize| is_counted(*i, surfaces[cloud][*i], surfaces[1 - cloud][*i]);
            (0..grid.len()).filter(is_cell).count()
        };
        [count(0), count(1)]
    };
    let all = sorted(measured.cells.iter().map(|cell| cell.difference));
    let has_both = |cell: &usize| surfaces.iter().all(|of_cloud| of_cloud[*cell] != CellSurface::Missing);
    let is_left_out = |cell: &usize| has_both(cell) && !measured.has_difference[*cell];
    let total: f64 = positive_zero(all.iter().sum());
    let count = (all.len() as f64).max(1.0);
    let [fill, cut] = [1.0, -1.0].map(|sign| measured.volume(sign));
    Change {
        surface: match are_classified {
            true => "ground points (class 2)",
            false => {
                "points within 0.25 m above the lowest ones, since a cloud has no ground points (class 2)"
            }
        },
        cells: all.len(),
        cells_interpolated: measured.interpolated,
        cells_extrapolated: count_of(&|cell, surface, other| {
            surface == CellSurface::Extrapolated
                && other != CellSurface::Missing
                && !measured.has_difference[cell]
        }),
        cells_left_out: (0..grid.len()).filter(is_left_out).count(),
        cells_unmeasured: measured.left_out.len(),
        cells_of_one: count_of(&|_, surface, other| {
            surface != CellSurface::Missing && other == CellSurface::Missing
        }),
        mean_m: total / count,
        median_m: median(&all),
        spread_m: if all.is_empty() { 0.0 } else { Statistic::Spread.of(&all) },
        rms_m: positive_zero(all.iter().map(|d| d * d).sum::<f64>() / count).sqrt(),
        detection_m: median(&sorted(measured.cells.iter().map(|cell| measured.detection(cell)))),
        offset_m: measured.shared.offset,
        shared_m: measured.shared.deviation,
        fill,
        cut,
        net_m3: grid.side * grid.side * total,
        net_uncertainty_m3: measured
            .uncertainty(measured.cells.iter(), fill.unmeasured_m3 + cut.unmeasured_m3),
        random_m: median(&sorted(measured.cells.iter().map(|cell| cell.variance.sqrt()))),
        map: measured.map(corner),
    }
}

/// The differences of the cells and what is known of their errors.
struct Measured<'g> {
    grid: &'g CellGrid,
    cells: Vec<CellDifference>,
    shared: Registration,
    /// Standard deviation of the registration, m.
    offset: f64,
    /// Difference of cells that did not change, m: the measured offset, or 0 with a stated registration.
    unchanged: f64,
    /// Number of cells, the last of `cells`, whose difference is that of cells around them.
    interpolated: usize,
    /// Cells of the grid that may have changed and have no difference.
    left_out: Vec<usize>,
    /// By cell of the grid.
    is_interpolated: Vec<bool>,
    /// By cell of the grid.
    has_difference: Vec<bool>,
    /// By cell of the grid.
    is_changed: Vec<bool>,
}

impl<'g> Measured<'g> {
    fn new(grid: &'g CellGrid, surfaces: &[Vec<CellSurface>; 2], registration: Option<f64>) -> Measured<'g> {
        let difference = |cell: usize| match (surfaces[0][cell], surfaces[1][cell]) {
            (
                CellSurface::Known { height: first, variance: a },
                CellSurface::Known { height: second, variance: b },
            ) => Some(CellDifference { cell, difference: second - first, variance: a + b }),
            _ => None,
        };
        let mut cells: Vec<CellDifference> = (0..grid.len()).filter_map(difference).collect();
        let shared = Registration::of(grid, &cells);
        let (offset, unchanged) = match registration {
            Some(deviation) => (deviation, 0.0),
            None => (shared.offset.abs(), shared.offset),
        };
        let Gaps { filled, left_out } = Gaps::of(grid, surfaces, &MeasuredCells::new(grid, &cells));
        let interpolated = filled.len();
        let mut is_interpolated = vec![false; grid.len()];
        filled.iter().for_each(|cell| is_interpolated[cell.cell] = true);
        cells.extend(filled);
        let mut has_difference = vec![false; grid.len()];
        cells.iter().for_each(|cell| has_difference[cell.cell] = true);
        let mut measured = Measured {
            grid,
            cells,
            shared,
            offset,
            unchanged,
            interpolated,
            left_out,
            is_interpolated,
            has_difference,
            is_changed: vec![false; grid.len()],
        };
        let mut signs = vec![0.0; grid.len()];
        for cell in &measured.cells {
            if cell.difference.abs() > measured.detection(cell) {
                signs[cell.cell] = cell.difference.signum();
            }
        }
        for cell in &measured.cells {
            measured.is_changed[cell.cell] = has_like_neighbours(grid, &signs, cell.cell);
        }
        measured
    }

    /// The level of detection of a cell at 95 %, m.
    fn detection(&self, cell: &CellDifference) -> f64 {
        let [offset, shared] = [self.offset, self.shared.deviation];
        DETECTION * (cell.variance + shared * shared + offset * offset).sqrt()
    }

    /// The volume of the changed cells of a sign.
    fn volume(&self, sign: f64) -> Volume {
        let is_part = |cell: &&CellDifference| self.is_changed[cell.cell] && sign * cell.difference > 0.0;
        let part = || self.cells.iter().filter(is_part);
        let area = self.grid.side * self.grid.side;
        let [undetected, unmeasured] = [self.undetected(sign), self.unmeasured(sign)];
        Volume {
            volume_m3: positive_zero(area * part().map(|cell| cell.difference.abs()).sum::<f64>()),
            uncertainty_m3: self.uncertainty(part(), libm::hypot(undetected, unmeasured)),
            undetected_m3: undetected,
            unmeasured_m3: unmeasured,
            area_m2: area * part().count() as f64,
        }
    }

    /// The standard uncertainty of the volume of some cells and of a part that is missing, m³.
    fn uncertainty<'c>(&self, part: impl Iterator<Item = &'c CellDifference>, missing: f64) -> f64 {
        if self.cells.is_empty() {
            return f64::NAN;
        }
        let (mut count, mut variance) = (0, 0.0);
        // Filled cells of a block are means of about the same cells.
        let mut of_filled = self.blocks();
        for cell in part {
            count += 1;
            match self.is_interpolated[cell.cell] {
                true => of_filled[self.block(cell.cell)] += cell.variance.sqrt(),
                false => variance += cell.variance,
            }
        }
        variance += of_filled.iter().map(|deviation| deviation * deviation).sum::<f64>();
        let shared = libm::hypot(self.shared.deviation_of_mean(count), self.offset) * count as f64;
        let of_cells = self.grid.side * self.grid.side * libm::hypot(variance.sqrt(), shared);
        libm::hypot(of_cells, missing)
    }

    /// A sum of 0 for each block.
    fn blocks(&self) -> Vec<f64> {
        vec![0.0; self.grid.columns.div_ceil(BLOCK) * self.grid.rows.div_ceil(BLOCK)]
    }

    /// The block of a cell of the grid.
    fn block(&self, cell: usize) -> usize {
        let [column, row] = [cell % self.grid.columns, cell / self.grid.columns];
        row / BLOCK * self.grid.columns.div_ceil(BLOCK) + column / BLOCK
    }

    /// The volume of a sign that cells left out have if they changed like the measured cells around them, m³.
    fn unmeasured(&self, sign: f64) -> f64 {
        let measured = &self.cells[..self.cells.len() - self.interpolated];
        let change = |cell: &CellDifference| {
            let is_significant = sign * cell.difference > self.detection(cell);
            if is_significant { cell.difference.abs() } else { 0.0 }
        };
        let sum = MeasuredCells::new(self.grid, measured).sum_in(&self.left_out, change);
        positive_zero(self.grid.side * self.grid.side * sum)
    }

    /// The volume of a sign in the cells that did not change significantly, m³: the sum of the blocks in
    /// which it prevails, so that random errors cancel. Errors that blocks share do not, since they hide as
    /// much change.
    fn undetected(&self, sign: f64) -> f64 {
        let mut sums = self.blocks();
        for cell in self.cells.iter().filter(|cell| !self.is_changed[cell.cell]) {
            sums[self.block(cell.cell)] += sign * (cell.difference - self.unchanged);
        }
        let prevailing = sums.into_iter().map(|sum| f64::max(sum, 0.0)).sum::<f64>();
        positive_zero(self.grid.side * self.grid.side * prevailing)
    }

    fn map(&self, corner: [f64; 2]) -> ChangeMap {
        let mut differences = vec![f64::NAN; self.grid.len()];
        let mut detection = differences.clone();
        for cell in &self.cells {
            differences[cell.cell] = cell.difference;
            detection[cell.cell] = self.detection(cell);
        }
        ChangeMap {
            side_m: self.grid.side,
            columns: self.grid.columns,
            rows: self.grid.rows,
            corner,
            differences,
            detection,
            is_changed: self.is_changed.clone(),
        }
    }
}

/// True if a cell has a sign, and at least two of its eight neighbours the same.
fn has_like_neighbours(grid: &CellGrid, signs: &[f64], cell: usize) -> bool {
    const LEAST: usize = 2;
    let is_alike = |other: &usize| signs[*other] == signs[cell];
    signs[cell] != 0.0 && grid.around(cell, 1).filter(is_alike).count() >= LEAST
}

/// The median of ascending values; 0 without any.
fn median(sorted: &[f64]) -> f64 {
    if sorted.is_empty() { 0.0 } else { quantile(sorted, 0.5) }
}

/// Sums of no values are −0.
fn positive_zero(value: f64) -> f64 {
    value + 0.0
}
