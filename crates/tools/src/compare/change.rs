//! What changed between two epochs: the ground of the second cloud minus that of the first, cell by cell, with the uncertainty of
//! each cell, and the volumes of cut and fill beyond the level of detection.
//!
//! The surface of a cell is the least-squares plane through its points at its centre. Its variance is that of the residuals times
//! the leverage of the centre; the variance of a difference is the sum of both, times a factor by which the differences of all cells
//! scatter beyond it (errors that the points of a cell share). A difference is significant beyond 1.96 standard deviations, the
//! level of detection at 95 % (Lane, Westaway & Hicks, 2003, Estimation of erosion and deposition volumes in a large, gravel-bed,
//! braided river using synoptic remote sensing). One cell in twenty is beyond it by chance, so that two of the eight neighbours of a
//! changed cell must have changed in the same sense (Wheaton et al., 2010, Accounting for uncertainty in DEMs from repeat topographic
//! surveys, on spatial coherence). The uncertainty of a volume has the random errors of its cells and, as a common
//! one, the offset of both clouds where nothing changed (Anderson, 2019, Uncertainty in quantitative analyses of topographic
//! change: error propagation and the role of thresholding).

use super::cut::{CellGrid, Cut};
use super::statistic::{Statistic, quantile};
use super::terrain::{GROUND, plane};
use crate::geotiff::{Raster, geotiff};
use serde::Serialize;
use vlscan_base::error::Result;

/// Standard deviations of the level of detection: 95 % of normal errors lie within them.
const DETECTION: f64 = 1.96;
/// Least standard deviation of a point's height, m: coordinates are stored in steps.
const MIN_DEVIATION: f64 = 1e-3;
/// Least number of points whose residuals tell their standard deviation.
const MIN_RESIDUALS: usize = 6;
/// Number of parts along a side of a cell whose lowest points begin the search for its ground.
const PARTS: usize = 3;
/// Largest height above the plane through the lowest points that counts as ground without classes, m.
const GROUND_DEPTH: f64 = 0.25;

/// What changed between the clouds: second minus first, where both have a surface.
#[derive(Clone, Debug, Serialize)]
pub struct Change {
    /// The points that the surfaces are made of.
    pub surface: &'static str,
    /// Number of cells with a surface of both.
    pub cells: usize,
    /// Number of cells with a surface of the first, and of the second cloud alone.
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
    /// Median difference of the cells whose difference is within their level of detection, m.
    pub offset_m: f64,
    /// Where the second cloud is significantly higher.
    pub fill: Volume,
    /// Where the second cloud is significantly lower.
    pub cut: Volume,
    /// Volume between both surfaces over all cells, significant or not, m³.
    pub net_m3: f64,
    /// The differences of the cells.
    #[serde(skip)]
    pub map: ChangeMap,
}

/// A volume of change.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Volume {
    /// m³.
    pub volume_m3: f64,
    /// Its standard uncertainty, m³.
    pub uncertainty_m3: f64,
    /// Its cells, m².
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
    /// Whether the difference is beyond the level of detection, and that of at least two of the eight neighbours in the same sense.
    pub is_changed: Vec<bool>,
}

impl ChangeMap {
    /// The differences as a GeoTIFF file in a system, NaN where a surface is missing.
    ///
    /// # Errors
    /// [`Error::Input`](vlscan_base::Error::Input) for a map that is too large for the format.
    pub fn geotiff(&self, crs: Option<&str>) -> Result<Vec<u8>> {
        let ChangeMap { columns, rows, side_m, corner, .. } = *self;
        geotiff(&Raster { columns, rows, side_m, corner, values: &self.differences, crs })
    }
}

/// The surface of a cell: its height at the centre and the variance of it.
#[derive(Clone, Copy)]
struct Surface {
    height: f64,
    /// Variance of the points about the surface, m²; `None` of too few points.
    of_points: Option<f64>,
    leverage: f64,
}

/// The change in the cells of a grid over the common box, whose corner is at `corner`.
pub(super) fn change(grid: &CellGrid, cuts: [&Cut; 2], corner: [f64; 2]) -> Change {
    let are_classified = cuts.iter().all(|cut| (0..cut.len()).any(|i| cut.class(i) == Some(GROUND)));
    let surfaces = cuts.map(|cut| surfaces(grid, cut, are_classified));
    let cells: Vec<usize> = (0..grid.len()).filter(|i| surfaces.iter().all(|s| s[*i].is_some())).collect();
    let of_one = [0, 1].map(|cloud: usize| {
        (0..grid.len()).filter(|i| surfaces[cloud][*i].is_some() && surfaces[1 - cloud][*i].is_none()).count()
    });
    let pooled = [0, 1].map(|cloud: usize| pooled_variance(&surfaces[cloud]));
    let variance = |cell: usize| -> f64 {
        let of_cloud = |cloud: usize| {
            let Some(surface) = surfaces[cloud][cell] else { return 0.0 };
            surface.of_points.unwrap_or(pooled[cloud]).max(MIN_DEVIATION * MIN_DEVIATION) * surface.leverage
        };
        of_cloud(0) + of_cloud(1)
    };
    let difference = |cell: usize| match (surfaces[0][cell], surfaces[1][cell]) {
        (Some(first), Some(second)) => second.height - first.height,
        _ => f64::NAN,
    };
    let sorted = |mut values: Vec<f64>| {
        values.sort_unstable_by(f64::total_cmp);
        values
    };
    let normalised = sorted(cells.iter().map(|cell| difference(*cell) / variance(*cell).sqrt()).collect());
    let excess = excess(normalised);
    let detection_of = |cell: usize| DETECTION * excess * variance(cell).sqrt();
    let all = sorted(cells.iter().map(|cell| difference(*cell)).collect());
    let within = sorted(
        cells
            .iter()
            .map(|cell| difference(*cell))
            .zip(cells.iter().map(|cell| detection_of(*cell)))
            .filter(|(d, limit)| d.abs() <= *limit)
            .map(|(d, _)| d)
            .collect(),
    );
    let median = |values: &[f64]| if values.is_empty() { 0.0 } else { quantile(values, 0.5) };
    let offset = median(&within);
    let area = grid.side * grid.side;
    let sign_of = |cell: usize| match difference(cell) {
        d if d.abs() > detection_of(cell) => d.signum(),
        _ => 0.0,
    };
    let signs: Vec<f64> = (0..grid.len()).map(sign_of).collect();
    let is_changed: Vec<bool> = (0..grid.len()).map(|cell| has_like_neighbours(grid, &signs, cell)).collect();
    let volume = |sign: f64| {
        let is_part = |cell: &&usize| is_changed[**cell] && sign * difference(**cell) > 0.0;
        let part: Vec<usize> = cells.iter().filter(is_part).copied().collect();
        let covered = area * part.len() as f64;
        let random = area * excess * part.iter().map(|cell| variance(*cell)).sum::<f64>().sqrt();
        Volume {
            volume_m3: area * part.iter().map(|cell| difference(*cell).abs()).sum::<f64>(),
            uncertainty_m3: libm::hypot(random, covered * offset),
            area_m2: covered,
        }
    };
    let count = (cells.len() as f64).max(1.0);
    let mean = all.iter().sum::<f64>() / count;
    let is_cell = |cell: usize| !difference(cell).is_nan();
    Change {
        surface: match are_classified {
            true => "ground points (class 2)",
            false => {
                "points within 0.25 m above the lowest ones, since a cloud has no ground points (class 2)"
            }
        },
        cells: cells.len(),
        cells_of_one: of_one,
        mean_m: mean,
        median_m: median(&all),
        spread_m: if all.is_empty() { 0.0 } else { Statistic::Spread.of(&all) },
        rms_m: (all.iter().map(|d| d * d).sum::<f64>() / count).sqrt(),
        detection_m: median(&sorted(cells.iter().map(|cell| detection_of(*cell)).collect())),
        offset_m: offset,
        fill: volume(1.0),
        cut: volume(-1.0),
        net_m3: area * all.iter().sum::<f64>(),
        map: ChangeMap {
            side_m: grid.side,
            columns: grid.columns,
            rows: grid.rows,
            corner,
            differences: (0..grid.len()).map(difference).collect(),
            is_changed,
            detection: (0..grid.len())
                .map(|cell| if is_cell(cell) { detection_of(cell) } else { f64::NAN })
                .collect(),
        },
    }
}

/// The factor, at least 1, by which normalised differences, ascending, scatter beyond one standard deviation where nothing changed: by
/// the middle 38 % of those within three of the present deviations about their median.
fn excess(mut normalised: Vec<f64>) -> f64 {
    const ROUNDS: usize = 8;
    let mut excess = 1.0;
    for _ in 0..ROUNDS {
        if normalised.is_empty() {
            return excess;
        }
        let middle = quantile(&normalised, 0.5);
        excess = (quantile(&normalised, 0.6915) - quantile(&normalised, 0.3085)).max(1.0);
        normalised.retain(|value| (value - middle).abs() <= 3.0 * excess);
    }
    excess
}

/// Whether a cell has a sign, and at least two of its eight neighbours the same.
fn has_like_neighbours(grid: &CellGrid, signs: &[f64], cell: usize) -> bool {
    const LEAST: usize = 2;
    let (column, row) = (cell % grid.columns, cell / grid.columns);
    let rows = row.saturating_sub(1)..(row + 2).min(grid.rows);
    let columns = column.saturating_sub(1)..(column + 2).min(grid.columns);
    let around = rows.flat_map(|row| columns.clone().map(move |column| row * grid.columns + column));
    // Itself is among them.
    signs[cell] != 0.0 && around.filter(|other| signs[*other] == signs[cell]).count() > LEAST
}

/// The surface of each cell.
fn surfaces(grid: &CellGrid, cut: &Cut, are_classified: bool) -> Vec<Option<Surface>> {
    let is_chosen = |i: &usize| !are_classified || cut.class(*i) == Some(GROUND);
    let mut order: Vec<(u32, u32)> =
        (0..cut.len()).filter(is_chosen).map(|i| (grid.cell(&cut.offsets[i]) as u32, i as u32)).collect();
    order.sort_unstable();
    let mut surfaces = vec![None; grid.len()];
    for points in order.chunk_by(|a, b| a.0 == b.0) {
        let cell = points[0].0 as usize;
        let centre = grid.centre(cell);
        let points: Vec<[f64; 3]> = points.iter().map(|(_, i)| cut.offsets[*i as usize]).collect();
        surfaces[cell] = match are_classified {
            true => surface(&points, centre),
            false => surface(&ground(&points, centre, grid.side), centre),
        };
    }
    surfaces
}

/// The points of a cell near the plane through its lowest ones, those of the ninths of the cell.
fn ground(points: &[[f64; 3]], centre: [f64; 2], side: f64) -> Vec<[f64; 3]> {
    let part = |p: &[f64; 3]| {
        let index = |axis: usize| {
            let share = (p[axis] - centre[axis]) / side + 0.5;
            ((share * PARTS as f64) as usize).min(PARTS - 1)
        };
        index(1) * PARTS + index(0)
    };
    let mut lowest: [Option<[f64; 3]>; PARTS * PARTS] = [None; PARTS * PARTS];
    for p in points {
        let place = &mut lowest[part(p)];
        if place.is_none_or(|q| p[2] < q[2]) {
            *place = Some(*p);
        }
    }
    let lowest: Vec<[f64; 3]> = lowest.into_iter().flatten().collect();
    let is_ground =
        |p: &&[f64; 3]| plane(&lowest, [p[0], p[1]]).is_some_and(|at| p[2] - at.height <= GROUND_DEPTH);
    points.iter().filter(is_ground).copied().collect()
}

fn surface(points: &[[f64; 3]], centre: [f64; 2]) -> Option<Surface> {
    let at = plane(points, centre)?;
    let freedom = points.len() as f64 - if at.is_supported { 3.0 } else { 1.0 };
    let of_points = (points.len() >= MIN_RESIDUALS).then(|| at.squares / freedom);
    Some(Surface { height: at.height, of_points, leverage: at.leverage })
}

/// The median variance of the cells, m².
fn pooled_variance(surfaces: &[Option<Surface>]) -> f64 {
    let mut all: Vec<f64> = surfaces.iter().flatten().filter_map(|surface| surface.of_points).collect();
    all.sort_unstable_by(f64::total_cmp);
    if all.is_empty() { 0.0 } else { quantile(&all, 0.5) }
}
