//! What two clouds have in common, and what not.

use super::neighbours::{Distances, distances};
use crate::args;
use crate::cloud::Points;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::HashSet;
use vlscan_base::quantity::POSITIVE;
use vlscan_geom::DVec3;

/// Percentiles of heights and intensities that are reported.
pub(super) const PERCENTILES: [f64; 7] = [1.0, 5.0, 25.0, 50.0, 75.0, 95.0, 99.0];
/// Bins of histograms.
const BINS: usize = 40;
/// Side of the squares whose lowest point counts as ground, m.
const GROUND_CELL: f64 = 5.0;
/// Most cells of a raster.
const MAX_CELLS: f64 = 1e8;
/// Return numbers that are counted by themselves.
const RETURNS: usize = 7;

/// How clouds are compared.
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct CompareOptions {
    /// Side of the cells of density and canopy height, m.
    #[arg(long, value_name = "M", default_value = "1", value_parser = args::positive)]
    pub cell: f64,
    /// Side of the voxels whose occupancy is compared, m.
    #[arg(long, value_name = "M", default_value = "0.5", value_parser = args::positive)]
    pub voxel: f64,
    /// Most points of each cloud whose distance to the other is measured, evenly chosen.
    #[arg(long, value_name = "N", default_value = "200k", value_parser = args::number_of_points)]
    pub most_distances: usize,
}

impl Default for CompareOptions {
    fn default() -> CompareOptions {
        CompareOptions { cell: 1.0, voxel: 0.5, most_distances: 200_000 }
    }
}

/// Properties of one cloud.
#[derive(Clone, Debug, Serialize)]
pub struct Cloud {
    /// Name of its file.
    pub name: String,
    /// Points of the file.
    pub points: usize,
    /// Lower corner of its box, world coordinates, m.
    pub min: [f64; 3],
    /// Upper corner of its box, world coordinates, m.
    pub max: [f64; 3],
    /// Points within the box that both clouds share. If the file has more points than are kept in memory, its own number is
    /// estimated from them.
    pub points_in_box: f64,
    /// Points per m² of the cells that hold points of either cloud.
    pub density_per_m2: f64,
    /// Heights above the ground at 1, 5, 25, 50, 75, 95, 99 percent of the points, m.
    pub height_percentiles_m: [f64; 7],
    /// Intensities at the same percentages, in the unit of the file; `None` without intensities.
    pub intensity_percentiles: Option<[f64; 7]>,
    /// Fractions of the points that are first, second … seventh and later returns; `None` if unknown.
    pub returns: Option<[f64; RETURNS]>,
}

/// A histogram of both clouds with the same bins.
#[derive(Clone, Debug, Serialize)]
pub struct Histogram {
    /// Lower end of the first bin.
    pub from: f64,
    /// Upper end of the last bin.
    pub to: f64,
    /// Fractions of the points of each cloud.
    pub fractions: [Vec<f64>; 2],
    /// The common area of both histograms, 0 to 1.
    pub overlap: f64,
}

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
    /// Both heights, m.
    pub heights: Histogram,
}

/// What changed between the clouds: the lowest point of each cell, which is the ground wherever a cell sees it, of the second cloud
/// against that of the first, where both have points.
#[derive(Clone, Debug, Serialize)]
pub struct Change {
    /// Number of such cells.
    pub cells: usize,
    /// Second minus first, m.
    pub mean_m: f64,
    /// Root mean square of the differences, m.
    pub rms_m: f64,
    /// Volume between both surfaces where the second is higher, m³.
    pub raised_m3: f64,
    /// Volume between both surfaces where the second is lower, m³.
    pub lowered_m3: f64,
    /// Centres of the cells, world coordinates, and differences, m.
    #[serde(skip)]
    pub map: Vec<[f64; 3]>,
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

/// The result.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The first cloud.
    pub first: Cloud,
    /// The second cloud.
    pub second: Cloud,
    /// Side of the cells, m.
    pub cell_m: f64,
    /// Area of the cells of the common box that hold points of either cloud, m².
    pub area_m2: f64,
    /// Correlation of the numbers of points per cell.
    pub density_correlation: f64,
    /// Heights above the ground, m.
    pub heights: Histogram,
    /// The highest points of the cells.
    pub canopy: Canopy,
    /// The lowest points of the cells.
    pub change: Change,
    /// Of intensities in units of each cloud's median.
    pub intensity: Option<Histogram>,
    /// From points of the first cloud to the nearest of the second.
    pub first_to_second: Distances,
    /// From points of the second cloud to the nearest of the first.
    pub second_to_first: Distances,
    /// Occupied voxels.
    pub voxels: Voxels,
}

/// The points of a cloud within the common box, relative to one origin.
pub(super) struct Cut {
    pub offsets: Vec<[f64; 3]>,
    /// Without points that have none.
    intensity: Vec<f64>,
    returns: Vec<u8>,
    /// Points of the file per point kept.
    weight: f64,
}

/// Compares `second` with `first` within the box that both share horizontally.
///
/// # Errors
/// A sentence: clouds that do not overlap, cells that are too small.
pub fn compare(
    [first, second]: [(&str, &Points); 2],
    options: &CompareOptions,
) -> Result<Comparison, String> {
    args::check([("cell", Some(options.cell), POSITIVE), ("voxel", Some(options.voxel), POSITIVE)])?;
    let (a, b) = (first.1.bounds(), second.1.bounds());
    let low = DVec3::new(a.min.x.max(b.min.x), a.min.y.max(b.min.y), a.min.z.min(b.min.z));
    let high = DVec3::new(a.max.x.min(b.max.x), a.max.y.min(b.max.y), a.max.z.max(b.max.z));
    if low.x > high.x || low.y > high.y {
        let gap = (low - high).max_element();
        return Err(format!(
            "the clouds do not overlap: {gap:.1} m lie between their boxes ({:.1} {:.1} and {:.1} {:.1} are their lower corners)",
            a.min.x, a.min.y, b.min.x, b.min.y
        ));
    }
    let grid = Grid::new(low, high, options.cell)?;
    let ground_grid = Grid::new(low, high, GROUND_CELL.max(options.cell))?;
    let cuts = [first.1, second.1].map(|points| Cut::of(points, low, high));
    if cuts.iter().any(|cut| cut.offsets.is_empty()) {
        return Err("one of the clouds has no point in the box that both share".to_owned());
    }
    let ground = lowest(&ground_grid, cuts.iter());
    let heights = [0, 1].map(|i| heights(&ground_grid, &ground, &cuts[i]));
    let counts = [0, 1].map(|i| counts(&grid, &cuts[i]));
    let occupied = counts[0].iter().zip(&counts[1]).filter(|(a, b)| **a + **b > 0.0).count();
    let area = occupied as f64 * options.cell * options.cell;
    let cloud = |i: usize, (name, points): (&str, &Points)| {
        let cut = &cuts[i];
        let count = cut.offsets.len() as f64 * cut.weight;
        let bounds = points.bounds();
        Cloud {
            name: name.to_owned(),
            points: points.total(),
            min: bounds.min.to_array(),
            max: bounds.max.to_array(),
            points_in_box: count,
            density_per_m2: count / area,
            height_percentiles_m: percentiles(&heights[i]),
            intensity_percentiles: (!cut.intensity.is_empty()).then(|| percentiles(&cut.intensity)),
            returns: cut.return_fractions(),
        }
    };
    let (first, second) = (cloud(0, first), cloud(1, second));
    let intensity = match (&first.intensity_percentiles, &second.intensity_percentiles) {
        (Some(a), Some(b)) if a[3] > 0.0 && b[3] > 0.0 => {
            let scaled = |i: usize, median: f64| -> Vec<f64> {
                cuts[i].intensity.iter().map(|v| v / median).collect()
            };
            Some(Histogram::of([&scaled(0, a[3]), &scaled(1, b[3])], 0.0, 4.0))
        }
        _ => None,
    };
    let top = heights.iter().flatten().fold(1.0_f64, |top, h| top.max(*h));
    Ok(Comparison {
        cell_m: options.cell,
        area_m2: area,
        density_correlation: correlation(
            counts[0].iter().zip(&counts[1]).filter(|(a, b)| **a + **b > 0.0).map(|(a, b)| (*a, *b)),
        ),
        heights: Histogram::of([&heights[0], &heights[1]], 0.0, top),
        canopy: canopy(&grid, &cuts, &heights),
        change: change(&grid, &cuts, low),
        intensity,
        first_to_second: distances(&cuts[0].offsets, &cuts[1].offsets, options.most_distances),
        second_to_first: distances(&cuts[1].offsets, &cuts[0].offsets, options.most_distances),
        voxels: voxels(&cuts, options.voxel),
        first,
        second,
    })
}

impl Cut {
    fn of(points: &Points, low: DVec3, high: DVec3) -> Cut {
        let mut cut = Cut {
            offsets: Vec::new(),
            intensity: Vec::new(),
            returns: Vec::new(),
            weight: points.total() as f64 / points.len().max(1) as f64,
        };
        for i in 0..points.len() {
            let p = points.position(i);
            if p.x < low.x || p.y < low.y || p.x > high.x || p.y > high.y {
                continue;
            }
            let offset = p - low;
            cut.offsets.push(offset.to_array());
            cut.intensity.extend(points.intensity_of(i).filter(|value| !value.is_nan()).map(f64::from));
            cut.returns.extend(points.return_number_of(i));
        }
        cut
    }

    fn return_fractions(&self) -> Option<[f64; RETURNS]> {
        if self.returns.iter().all(|number| *number == 0) {
            return None;
        }
        let mut fractions = [0.0; RETURNS];
        for number in self.returns.iter().filter(|number| **number > 0) {
            fractions[usize::from(*number).min(RETURNS) - 1] += 1.0;
        }
        let all: f64 = fractions.iter().sum();
        Some(fractions.map(|count| count / all))
    }
}

/// Square cells over the common box.
struct Grid {
    side: f64,
    columns: usize,
    rows: usize,
}

impl Grid {
    fn new(low: DVec3, high: DVec3, side: f64) -> Result<Grid, String> {
        let count = |extent: f64| (extent / side).floor() + 1.0;
        let (columns, rows) = (count(high.x - low.x), count(high.y - low.y));
        if columns * rows > MAX_CELLS {
            return Err(format!(
                "{columns:.0} by {rows:.0} cells of {side} m, expected at most {MAX_CELLS}; --cell"
            ));
        }
        Ok(Grid { side, columns: columns as usize, rows: rows as usize })
    }

    fn len(&self) -> usize {
        self.columns * self.rows
    }

    fn cell(&self, offset: &[f64; 3]) -> usize {
        let index = |v: f64, count: usize| ((v / self.side) as usize).min(count - 1);
        index(offset[1], self.rows) * self.columns + index(offset[0], self.columns)
    }
}

/// The lowest point of some clouds in each cell.
fn lowest<'c>(grid: &Grid, cuts: impl Iterator<Item = &'c Cut>) -> Vec<f64> {
    let mut lowest = vec![f64::INFINITY; grid.len()];
    for offset in cuts.flat_map(|cut| &cut.offsets) {
        let cell = &mut lowest[grid.cell(offset)];
        *cell = cell.min(offset[2]);
    }
    lowest
}

fn heights(grid: &Grid, ground: &[f64], cut: &Cut) -> Vec<f64> {
    cut.offsets.par_iter().map(|offset| offset[2] - ground[grid.cell(offset)]).collect()
}

fn counts(grid: &Grid, cut: &Cut) -> Vec<f64> {
    let mut counts = vec![0.0; grid.len()];
    cut.offsets.iter().for_each(|offset| counts[grid.cell(offset)] += cut.weight);
    counts
}

fn canopy(grid: &Grid, cuts: &[Cut; 2], heights: &[Vec<f64>; 2]) -> Canopy {
    let tops = [0, 1].map(|i| {
        let mut tops = vec![f64::NEG_INFINITY; grid.len()];
        for (offset, height) in cuts[i].offsets.iter().zip(&heights[i]) {
            let cell = &mut tops[grid.cell(offset)];
            *cell = cell.max(*height);
        }
        tops
    });
    let both = || {
        let pairs = tops[0].iter().zip(&tops[1]).filter(|(a, b)| a.is_finite() && b.is_finite());
        pairs.map(|(a, b)| (*a, *b))
    };
    let cells = both().count();
    let mean_of =
        |of: &dyn Fn(f64, f64) -> f64| both().map(|(a, b)| of(a, b)).sum::<f64>() / (cells as f64).max(1.0);
    let present =
        [0, 1].map(|i| -> Vec<f64> { tops[i].iter().copied().filter(|top| top.is_finite()).collect() });
    let highest = present.iter().flatten().fold(1.0_f64, |most, top| most.max(*top));
    Canopy {
        cells,
        mean_difference_m: mean_of(&|a, b| b - a),
        rms_difference_m: mean_of(&|a, b| (b - a) * (b - a)).sqrt(),
        correlation: correlation(both()),
        heights: Histogram::of([&present[0], &present[1]], 0.0, highest),
    }
}

fn change(grid: &Grid, cuts: &[Cut; 2], low: DVec3) -> Change {
    let [first, second] = [0, 1].map(|i| lowest(grid, std::iter::once(&cuts[i])));
    let cells = first.iter().zip(&second).enumerate().filter(|(_, (a, b))| a.is_finite() && b.is_finite());
    let map: Vec<[f64; 3]> = cells
        .map(|(cell, (a, b))| {
            let centre = [cell % grid.columns, cell / grid.columns].map(|i| (i as f64 + 0.5) * grid.side);
            [low.x + centre[0], low.y + centre[1], b - a]
        })
        .collect();
    let mean = |of: &dyn Fn(f64) -> f64| {
        map.iter().map(|cell| of(cell[2])).sum::<f64>() / (map.len() as f64).max(1.0)
    };
    let area = map.len() as f64 * grid.side * grid.side;
    Change {
        cells: map.len(),
        mean_m: mean(&|d| d),
        rms_m: mean(&|d| d * d).sqrt(),
        raised_m3: mean(&|d| d.max(0.0)) * area,
        lowered_m3: mean(&|d| (-d).max(0.0)) * area,
        map,
    }
}

fn voxels(cuts: &[Cut; 2], side: f64) -> Voxels {
    let occupied = |cut: &Cut| -> HashSet<[i32; 3]> {
        cut.offsets.iter().map(|offset| offset.map(|v| (v / side).floor() as i32)).collect()
    };
    let [a, b] = [occupied(&cuts[0]), occupied(&cuts[1])];
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

impl Histogram {
    fn of(values: [&[f64]; 2], from: f64, to: f64) -> Histogram {
        let width = (to - from) / BINS as f64;
        let fractions = values.map(|values| {
            let mut counts = vec![0.0; BINS];
            for value in values {
                let bin = ((value - from) / width).floor().clamp(0.0, (BINS - 1) as f64);
                counts[bin as usize] += 1.0;
            }
            counts.iter().map(|count| count / (values.len() as f64).max(1.0)).collect::<Vec<f64>>()
        });
        let overlap = fractions[0].iter().zip(&fractions[1]).map(|(a, b)| a.min(*b)).sum();
        Histogram { from, to, fractions, overlap }
    }
}

/// Values at [`PERCENTILES`] percent of the sorted values.
fn percentiles(values: &[f64]) -> [f64; 7] {
    let mut sorted: Vec<f64> = values.to_vec();
    sorted.par_sort_unstable_by(f64::total_cmp);
    PERCENTILES.map(|percent| {
        let place = percent / 100.0 * (sorted.len().saturating_sub(1)) as f64;
        let (low, high) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
        low + place.fract() * (high - low)
    })
}

/// Pearson's correlation; NaN, which JSON writes as null, where one side does not vary.
fn correlation(pairs: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_formats::{AttributeSet, PointRow};

    fn cloud(points: impl IntoIterator<Item = [f64; 3]>) -> Points {
        let mut cloud = Points::new(AttributeSet::of(|_| true));
        for (i, p) in points.into_iter().enumerate() {
            let position = DVec3::from(p) + DVec3::new(431_000.0, 5_412_000.0, 100.0);
            let intensity = (i % 10) as f32 + 1.0;
            let return_number = 1 + (i % 2) as u8;
            cloud.push(&PointRow { position, intensity, return_number, ..PointRow::default() }, None);
        }
        cloud
    }

    fn square(step: f64, z: f64) -> Vec<[f64; 3]> {
        let n = (20.0 / step).round() as usize;
        (0..n * n).map(|i| [(i % n) as f64 * step, (i / n) as f64 * step, z]).collect()
    }

    const OPTIONS: CompareOptions = CompareOptions { cell: 1.0, voxel: 0.5, most_distances: 1000 };

    #[test]
    fn a_cloud_is_like_itself() {
        let a = cloud(square(0.25, 0.0).into_iter().chain(square(2.0, 8.0)));
        let c = compare([("a", &a), ("b", &a)], &OPTIONS).unwrap();
        assert_eq!((c.voxels.agreement, c.heights.overlap, c.canopy.rms_difference_m), (1.0, 1.0, 0.0));
        assert_eq!((c.first_to_second.mean_m, c.second_to_first.max_m), (0.0, 0.0));
        assert!((c.first.density_per_m2 - 16.25).abs() < 1e-9, "{}", c.first.density_per_m2);
        assert_eq!(c.first.returns.unwrap()[..3], [0.5, 0.5, 0.0]);
        assert!((c.density_correlation - 1.0).abs() < 1e-9);
        assert_eq!(c.first.height_percentiles_m[6], 8.0);
    }

    #[test]
    fn a_raised_canopy_and_a_thinned_cloud_are_seen() {
        let a = cloud(square(0.25, 0.0).into_iter().chain(square(0.5, 8.0)));
        let b = cloud(square(0.5, 0.0).into_iter().chain(square(0.5, 8.5)));
        let c = compare([("a", &a), ("b", &b)], &OPTIONS).unwrap();
        assert!((c.canopy.mean_difference_m - 0.5).abs() < 1e-6);
        // 16 + 4 to 4 + 4 points per m², but for the margin of the common box.
        let ratio = c.second.density_per_m2 / c.first.density_per_m2;
        assert!((ratio - 3200.0 / 7841.0).abs() < 1e-9, "{ratio}");
        // A raised point is half a metre from the next one.
        assert!((c.second_to_first.max_m - 0.5).abs() < 1e-6, "{:?}", c.second_to_first);
    }

    #[test]
    fn a_dam_and_a_pit_are_told_as_volumes() {
        let ground = || square(0.5, 0.0);
        let a = cloud(ground());
        // A dam of 4 by 20 m, 1.5 m high, and a pit of 6 by 5 m, 3 m deep.
        let b = cloud(ground().into_iter().map(|[x, y, z]| match (x, y) {
            (x, _) if x < 4.0 => [x, y, z + 1.5],
            (x, y) if (10.0..16.0).contains(&x) && (10.0..15.0).contains(&y) => [x, y, z - 3.0],
            _ => [x, y, z],
        }));
        let change = compare([("a", &a), ("b", &b)], &OPTIONS).unwrap().change;
        assert!(
            (change.raised_m3 - 120.0).abs() < 1e-6 && (change.lowered_m3 - 90.0).abs() < 1e-6,
            "{change:?}"
        );
        let nothing = compare([("a", &a), ("b", &a)], &OPTIONS).unwrap().change;
        assert_eq!((nothing.raised_m3, nothing.lowered_m3, nothing.rms_m), (0.0, 0.0, 0.0));
        let pit = change.map.iter().find(|cell| cell[2] < -2.9).unwrap();
        assert_eq!(pit[..2], [431_010.5, 5_412_010.5]);
    }

    #[test]
    fn clouds_apart_are_refused_with_their_distance() {
        let (a, b) = (cloud([[0.0; 3], [10.0, 10.0, 0.0]]), cloud([[500.0, 0.0, 0.0], [510.0, 10.0, 0.0]]));
        assert!(compare([("a", &a), ("b", &b)], &OPTIONS).unwrap_err().contains("490.0 m"));
        let wide = cloud([[0.0; 3], [1e6, 1e6, 0.0]]);
        assert!(compare([("a", &wide), ("b", &wide)], &OPTIONS).unwrap_err().contains("--cell"));
    }
}
