//! Noise of ranges, by the heights of points about the curved ground around them.

use super::pulses::Pulse;
use super::recording::Recording;
use super::solution::Solution;
use crate::marks::Marks;
use libm::cos;
use std::collections::{BTreeMap, HashMap};
use std::ops::RangeInclusive;
use vlscan_geom::{DVec2, DVec3, LeastSquares, median, radians};

/// Width of the cells in which the ground counts as a smooth surface, in mean distances between points.
const CELL_SPACINGS: f64 = 4.0;
/// Unknowns of the surfaces of a cell, in the order in which they are tried: of second degree, plane.
const SURFACES: [usize; 2] = [6, 3];
/// Minimum number of pulses in a cell beyond the unknowns of its surface.
const MIN_FREEDOM: usize = 5;
/// Pivot, over its diagonal element, below which the pulses of a cell do not determine its surface.
const MIN_PIVOT: f64 = 1e-9;
/// Maximum angle of beams from the vertical, degrees: of a more slanted beam, the rounding of heights hides
/// the noise of its range.
const MAX_SLANT: f64 = 60.0;
/// Minimum number of cells.
const MIN_CELLS: usize = 20;
/// ASPRS class of ground.
const GROUND: u8 = 2;
/// Number of pulses, about, whose cells are in memory together.
const STRIP_PULSES: usize = if cfg!(test) { 1000 } else { 1 << 21 };
/// Plausible noise of ranges with the roughness of the ground, m.
const NOISES: RangeInclusive<f64> = 0.0002..=0.1;
/// Maximum plausible standard deviation of the noise, over the noise.
const MAX_DEVIATION: f64 = 0.25;
/// A tenth of the cells scatters less than the median cell by this factor where cells lie on surfaces of
/// different roughness, such as bare ground and crowns.
const MIXED: f64 = 2.0;

/// Standard deviation of ranges to smooth ground, including its roughness.
#[derive(Clone, Copy, Debug)]
pub struct RangeScatter {
    /// m.
    pub value: f64,
    /// Its standard deviation, m.
    pub deviation: f64,
    /// True if the points have no classes, and lie on surfaces of different roughness.
    pub is_mixed: bool,
}

impl RangeScatter {
    /// The reason why this is not the noise of an instrument; `None` if it may be.
    pub(super) fn doubt(&self) -> Option<String> {
        let (low, high) = (NOISES.start(), NOISES.end());
        // Written so that NaN is doubtful.
        if !NOISES.contains(&self.value) {
            return Some(format!("points scatter by {:.4} m, expected {low} to {high} m", self.value));
        }
        if !(0.0..=MAX_DEVIATION * self.value).contains(&self.deviation) {
            return Some(format!(
                "the scatter of {:.4} m is uncertain by {:.4} m",
                self.value, self.deviation
            ));
        }
        self.is_mixed.then(|| {
            "points without class 2 (ground) lie on surfaces of different roughness, such as crowns"
                .to_owned()
        })
    }
}

/// Standard deviation of ranges to smooth ground, including its roughness; `None` without enough points.
///
/// Surfaces of second degree are fitted to the single returns of small cells, of class ground where there are
/// any, or planes where the returns are too few. The median of their residuals counts, corrected for the
/// degrees of freedom, so that cells with bushes have no effect.
pub fn range_noise(recording: &Recording, solution: &Solution) -> Option<RangeScatter> {
    let pulses = &recording.pulses;
    let has_ground = pulses.iter().filter(|pulse| pulse.class == GROUND).count() > pulses.len() / 10;
    let is_used = |pulse: Pulse| {
        pulse.returns == 1
            && (!has_ground || pulse.class == GROUND)
            && -beam(&pulse, solution).z >= cos(radians(MAX_SLANT))
    };
    let is_used: Marks = pulses.iter().map(is_used).collect();
    let used = || recording.lines.iter().flat_map(|line| line.clone()).filter(|i| is_used.has(*i));
    let width = CELL_SPACINGS * spacing(used().map(|i| pulses.position(i)));
    let row = |i: usize| (pulses.position(i).y / width).floor() as i64;
    let mut spreads = Vec::new();
    // The cells of a strip at a time, since those of all pulses take as much memory as these.
    for rows in strips(used().map(row)) {
        let mut cells: HashMap<(i64, i64), Vec<usize>> = HashMap::new();
        for i in used().filter(|i| rows.contains(&row(*i))) {
            let column = (pulses.position(i).x / width).floor() as i64;
            cells.entry((column, row(i))).or_default().push(i);
        }
        for cell in cells.values() {
            if let Some(surface) = Surface::of(recording, cell) {
                let beam = beam(&pulses.get(cell[0]), solution);
                spreads.push(surface.spread / surface.height_by_range(beam));
            }
        }
    }
    scatter_of_cells(spreads, has_ground)
}

/// Strips of successive rows of cells, each with at most [`STRIP_PULSES`] of the pulses whose rows these are,
/// or one row.
fn strips(rows: impl Iterator<Item = i64>) -> Vec<RangeInclusive<i64>> {
    let mut counts: BTreeMap<i64, usize> = BTreeMap::new();
    rows.for_each(|row| *counts.entry(row).or_default() += 1);
    let mut strips: Vec<RangeInclusive<i64>> = Vec::new();
    let mut count = 0;
    for (row, of_row) in counts {
        match strips.last_mut().filter(|_| count + of_row <= STRIP_PULSES) {
            Some(strip) => *strip = *strip.start()..=row,
            None => {
                strips.push(row..=row);
                count = 0;
            }
        }
        count += of_row;
    }
    strips
}

/// The scatter of the median cell; `None` for few cells.
fn scatter_of_cells(mut spreads: Vec<f64>, has_ground: bool) -> Option<RangeScatter> {
    /// Standard deviation of a normal distribution over its median absolute deviation, and that of the
    /// median over that of the mean.
    const OF_MEDIAN_DEVIATION: f64 = 1.4826;
    const OF_MEDIAN: f64 = 1.2533;
    if spreads.len() < MIN_CELLS {
        return None;
    }
    let count = spreads.len() as f64;
    spreads.sort_by(f64::total_cmp);
    let smooth = spreads[spreads.len() / 10];
    let value = median(spreads.iter().copied())?;
    let spread = median(spreads.iter().map(|spread| (spread - value).abs()))?;
    Some(RangeScatter {
        value,
        deviation: OF_MEDIAN * OF_MEDIAN_DEVIATION * spread / count.sqrt(),
        is_mixed: !has_ground && value > MIXED * smooth,
    })
}

/// Direction of the beam of a pulse, unit vector.
fn beam(pulse: &Pulse, solution: &Solution) -> DVec3 {
    (pulse.position - solution.model.position(pulse.time)).normalize()
}

/// Mean distance between points, m, by the cells of a coarse grid that hold any.
fn spacing(places: impl Iterator<Item = DVec3>) -> f64 {
    const COARSE: f64 = 5.0;
    let mut cells: HashMap<(i64, i64), u32> = HashMap::new();
    for place in places {
        *cells.entry(((place.x / COARSE).floor() as i64, (place.y / COARSE).floor() as i64)).or_default() +=
            1;
    }
    let counts: Vec<f64> = cells.values().map(|count| f64::from(*count)).collect();
    COARSE / median(counts).unwrap_or(1.0).max(1.0).sqrt()
}

/// A smooth surface through the pulses of a cell.
#[derive(Clone, Copy, Debug)]
struct Surface {
    /// Standard deviation of heights from it, m, such that its median over many cells is that of the heights.
    spread: f64,
    /// Its gradient at the first pulse.
    slope: DVec2,
}

impl Surface {
    /// The surface through the pulses of a cell; `None` for too few pulses.
    fn of(recording: &Recording, cell: &[usize]) -> Option<Surface> {
        let origin = recording.pulses.position(*cell.first()?);
        let offset = |i: &usize| recording.pulses.position(*i) - origin;
        let terms = |d: DVec3| [1.0, d.x, d.y, d.x * d.x, d.x * d.y, d.y * d.y];
        SURFACES.iter().filter(|unknowns| cell.len() >= *unknowns + MIN_FREEDOM).find_map(|unknowns| {
            let mut sums = LeastSquares::new(*unknowns);
            for d in cell.iter().map(offset) {
                sums.add(&terms(d)[..*unknowns], d.z, 1.0);
            }
            let surface = sums.matrix.scaled_cholesky(0.0, MIN_PIVOT)?.solve(&sums.right);
            let height = |d: DVec3| surface.iter().zip(terms(d)).map(|(a, b)| a * b).sum::<f64>();
            let squares: f64 = cell.iter().map(offset).map(|d| (d.z - height(d)).powi(2)).sum();
            let freedom = (cell.len() - unknowns) as f64;
            Some(Surface {
                spread: (squares / (freedom * median_of_chi_square(freedom))).sqrt(),
                slope: DVec2::new(surface[1], surface[2]),
            })
        })
    }

    /// Height over the surface of a point that is recorded 1 m too far along the beam, m.
    fn height_by_range(&self, beam: DVec3) -> f64 {
        (beam.z - self.slope.dot(beam.truncate())).abs().max(cos(1.5))
    }
}

/// Median of χ² over its degrees of freedom (Wilson & Hilferty 1931).
fn median_of_chi_square(freedom: f64) -> f64 {
    (1.0 - 2.0 / (9.0 * freedom)).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scatter_of_crowns_is_no_range_noise() {
        let cells =
            |share: usize| (0..200).map(|k| if k % 10 < share { 4.0 } else { 0.02 }).collect::<Vec<f64>>();
        let crowns = scatter_of_cells(cells(8), false).unwrap();
        assert!(crowns.doubt().unwrap().contains("4.0000 m"), "{crowns:?}");
        // Low plants: the value is one of instruments, but cells differ.
        let plants = (0..200).map(|k| if k % 5 < 3 { 0.1 } else { 0.02 }).collect::<Vec<f64>>();
        let plants_without_classes = scatter_of_cells(plants.clone(), false).unwrap();
        assert!(plants_without_classes.doubt().unwrap().contains("different roughness"));
        assert!(scatter_of_cells(plants, true).unwrap().doubt().is_none());
        let ground = scatter_of_cells((0..200).map(|k| 0.02 + 1e-4 * f64::from(k % 20)).collect(), false);
        assert!(ground.unwrap().doubt().is_none() && ground.unwrap().deviation > 0.0);
        assert!(scatter_of_cells(vec![0.02; 5], true).is_none());
    }

    /// A cell of these pulses on a bowl, with residuals of these heights, m.
    fn cell(places: &[(f64, f64)], residual: impl Fn(usize) -> f64) -> Recording {
        // Enough pulses for a recording; the others are not in the cell.
        let place = |k: usize| places.get(k).copied().unwrap_or((1e3 + k as f64, 0.0));
        let pulse = |k: usize| {
            let (x, y) = place(k);
            let height = 0.05 * x * x - 0.03 * x * y + 0.2 * y + residual(k);
            Pulse {
                time: 1e-5 * k as f64,
                position: DVec3::new(x, y, height),
                angle: 0.0,
                returns: 1,
                class: GROUND,
                last: None,
                file_channel: 0,
                channel: 0,
            }
        };
        Recording::new((0..500).map(pulse).collect()).unwrap()
    }

    #[test]
    fn curved_ground_is_no_noise() {
        let spread = |of: &Recording, cell: &[usize]| Surface::of(of, cell).map(|surface| surface.spread);
        let grid: Vec<(f64, f64)> = (0..16).map(|k| (f64::from(k % 4), f64::from(k / 4))).collect();
        let all: Vec<usize> = (0..16).collect();
        assert!(spread(&cell(&grid, |_| 0.0), &all).unwrap() < 1e-9);
        // Heights that no surface of second degree follows: signs of a chequerboard.
        let noise = |k: usize| if (k % 4 + k / 4).is_multiple_of(2) { 0.01 } else { -0.01 };
        let found = spread(&cell(&grid, noise), &all).unwrap();
        // The sum of x·y·sign and so on is not 0, so that the surface follows some of them.
        assert!((0.010..0.0135).contains(&found), "{found}");
        // Planes of fewer pulses, of which the bowl is a part of the noise.
        let eight: Vec<usize> = (0..8).collect();
        assert!(spread(&cell(&grid, |_| 0.0), &eight).unwrap() > 0.005);
        assert!(spread(&cell(&grid, |_| 0.0), &eight[..7]).is_none());
        assert!(spread(&cell(&grid, |_| 0.0), &[]).is_none());
        // Two lines determine a plane, but no curvature across.
        let lines: Vec<(f64, f64)> = (0..16).map(|k| (f64::from(k % 8), f64::from(k / 8))).collect();
        assert!(spread(&cell(&lines, |_| 0.0), &all).is_some());
    }

    #[test]
    fn strips_have_all_rows_and_few_pulses() {
        // Rows of 1 to 7 hundreds of pulses, and one of many.
        let count = |row: i64| if row == 5 { 5000 } else { 100 * (1 + row.rem_euclid(7)) as usize };
        let strips = strips((-20..30).flat_map(|row| std::iter::repeat_n(row, count(row))));
        let rows: Vec<i64> = strips.iter().cloned().flatten().collect();
        assert_eq!(rows, (-20..30).collect::<Vec<_>>());
        let pulses = |strip: &RangeInclusive<i64>| strip.clone().map(count).sum::<usize>();
        assert!(strips.iter().all(|strip| pulses(strip) <= STRIP_PULSES || *strip == (5..=5)), "{strips:?}");
        assert!(strips.len() > 15 && super::strips(std::iter::empty()).is_empty());
    }

    #[test]
    fn heights_over_slopes_change_with_the_range_of_beams_from_either_side() {
        let rising = Surface { spread: 0.0, slope: DVec2::new(0.5, 0.0) };
        let to_the_right = DVec3::new(0.6, 0.0, -0.8);
        // 0.8 m down and 0.6 m to the right, where the surface is 0.3 m higher.
        assert!((rising.height_by_range(to_the_right) - 1.1).abs() < 1e-12);
        assert!((rising.height_by_range(DVec3::new(-0.6, 0.0, -0.8)) - 0.5).abs() < 1e-12);
        assert_eq!(rising.height_by_range(-DVec3::Z), 1.0);
    }

    #[test]
    fn the_median_of_few_residuals_is_that_of_many() {
        // Medians of χ² of 5, 10 and 13 degrees of freedom.
        for (freedom, expected) in [(5.0, 4.351), (10.0, 9.342), (13.0, 12.340)] {
            assert!((median_of_chi_square(freedom) - expected / freedom).abs() < 3e-3, "{freedom}");
        }
    }
}
