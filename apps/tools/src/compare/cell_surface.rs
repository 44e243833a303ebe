//! The ground in the cells of a grid: least-squares planes through the points of each cell, at its centre.

use super::cut::{CellGrid, Cut};
use super::statistic::quantile;
use super::terrain::{GROUND, fitted_plane, plane};
use rayon::prelude::*;

/// Minimum standard deviation of a point's height, m: files store coordinates in steps.
const MIN_DEVIATION: f64 = 1e-3;
/// Minimum number of points whose residuals give their standard deviation.
const MIN_RESIDUALS: usize = 6;
/// Minimum number of points of a plane.
const MIN_POINTS: usize = 3;
/// Maximum leverage of the centre of a cell in the fit of its plane.
const MAX_LEVERAGE: f64 = 0.5;
/// Number of parts along a side of a cell whose lowest points begin the search for its ground.
const PARTS: usize = 3;
/// Maximum height above the plane through the lowest points that counts as ground without classes, m.
const GROUND_DEPTH: f64 = 0.25;

/// The ground of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum CellSurface {
    /// No points.
    Missing,
    /// Too few points, or the centre is not among them, so that the plane would be extrapolated.
    Extrapolated,
    /// The height at the centre and its variance, m and m².
    Known { height: f64, variance: f64 },
}

/// The ground of each cell: of all points, or of those of class 2.
pub(super) fn cell_surfaces(grid: &CellGrid, cut: &Cut, are_classified: bool) -> Vec<CellSurface> {
    let (order, ends) = by_cell(grid, cut, are_classified);
    let fits: Vec<(usize, Option<Fit>)> = (0..grid.len())
        .into_par_iter()
        .filter_map(|cell| {
            let start = if cell == 0 { 0 } else { ends[cell - 1] };
            let points = &order[start as usize..ends[cell] as usize];
            if points.is_empty() {
                return None;
            }
            let centre = grid.centre(cell);
            let points: Vec<[f64; 3]> = points.iter().map(|i| cut.offset(*i as usize)).collect();
            let fit = match are_classified {
                true => fit(&points, centre),
                false => fit(&ground(&points, centre, grid.side), centre),
            };
            Some((cell, fit))
        })
        .collect();
    let pooled = pooled_variance(fits.iter().filter_map(|(_, fit)| fit.as_ref()?.of_points));
    let mut surfaces = vec![CellSurface::Missing; grid.len()];
    for (cell, fit) in fits {
        surfaces[cell] = fit.map_or(CellSurface::Extrapolated, |fit| {
            let of_points = fit.of_points.unwrap_or(pooled).max(MIN_DEVIATION * MIN_DEVIATION);
            CellSurface::Known { height: fit.height, variance: of_points * fit.leverage }
        });
    }
    surfaces
}

/// The numbers of all points, or of those of class 2, cell by cell, with the end of each cell.
fn by_cell(grid: &CellGrid, cut: &Cut, are_classified: bool) -> (Vec<u32>, Vec<u32>) {
    let is_chosen = |i: &usize| !are_classified || cut.class(*i) == Some(GROUND);
    let cells = || (0..cut.len()).filter(is_chosen).map(|i| (i as u32, grid.cell(&cut.offset(i))));
    // First the places of the next points of the cells, which become the ends.
    let mut ends = vec![0; grid.len()];
    cells().for_each(|(_, cell)| ends[cell] += 1);
    let mut sum = 0;
    for end in &mut ends {
        let points = *end;
        *end = sum;
        sum += points;
    }
    let mut order = vec![0; sum as usize];
    for (i, cell) in cells() {
        order[ends[cell] as usize] = i;
        ends[cell] += 1;
    }
    (order, ends)
}

/// A plane at the centre of a cell.
struct Fit {
    height: f64,
    leverage: f64,
    /// Variance of the points about the plane, m²; `None` of too few points.
    of_points: Option<f64>,
}

/// The plane through the points of a cell; `None` if it is extrapolated at the centre.
fn fit(points: &[[f64; 3]], centre: [f64; 2]) -> Option<Fit> {
    if points.len() < MIN_POINTS || !surrounds(points, centre) {
        return None;
    }
    // The points themselves have a mean leverage of 3/n, which exceeds the limit for fewer than six.
    let limit = MAX_LEVERAGE.max(3.0 / points.len() as f64) + 1e-9;
    let at = fitted_plane(points, centre).filter(|at| at.leverage <= limit)?;
    let freedom = points.len() as f64 - 3.0;
    let of_points = (points.len() >= MIN_RESIDUALS).then(|| at.squares / freedom);
    Some(Fit { height: at.height, leverage: at.leverage, of_points })
}

/// True if a place lies within the convex hull of points, or on its edge: no half-plane beyond the place is
/// without points.
pub(super) fn surrounds(points: &[[f64; 3]], [x, y]: [f64; 2]) -> bool {
    const ROUNDING: f64 = 1e-9;
    let offsets = || points.iter().map(|p| [p[0] - x, p[1] - y]);
    // A point in each quadrant suffices, as in nearly all cells with many points.
    let mut quadrants = [false; 4];
    for [dx, dy] in offsets() {
        if dx.abs().max(dy.abs()) < ROUNDING {
            return true;
        }
        quadrants[usize::from(dx > 0.0) + 2 * usize::from(dy > 0.0)] |= dx != 0.0 && dy != 0.0;
    }
    if quadrants.iter().all(|has_point| *has_point) {
        return true;
    }
    let mut angles: Vec<f64> = offsets().map(|[dx, dy]| libm::atan2(dy, dx)).collect();
    angles.sort_unstable_by(f64::total_cmp);
    let Some(first) = angles.first().copied() else { return false };
    let next = angles[1..].iter().copied().chain([first + std::f64::consts::TAU]);
    angles.iter().zip(next).all(|(angle, next)| next - angle <= std::f64::consts::PI + ROUNDING)
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

/// The median variance of the cells, m².
fn pooled_variance(of_points: impl Iterator<Item = f64>) -> f64 {
    let mut all: Vec<f64> = of_points.collect();
    all.sort_unstable_by(f64::total_cmp);
    if all.is_empty() { 0.0 } else { quantile(&all, 0.5) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_surrounded_within_the_hull_of_the_points() {
        let hull = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        for (place, expected) in [
            ([0.25, 0.25], true),
            ([0.5, 0.5], true),
            ([0.5, 0.0], true),
            ([0.0, 0.0], true),
            ([0.51, 0.51], false),
            ([-0.01, 0.5], false),
            ([2.0, 0.0], false),
        ] {
            assert_eq!(surrounds(&hull, place), expected, "{place:?}");
        }
        assert!(!surrounds(&[], [0.0; 2]));
    }

    #[test]
    fn planes_are_fitted_where_points_surround_the_centre_and_never_extrapolated() {
        let plane_at = |points: &[[f64; 2]]| {
            let points: Vec<[f64; 3]> =
                points.iter().map(|[x, y]| [*x, *y, 2.0 + 0.3 * x - 0.1 * y]).collect();
            fit(&points, [0.5, 0.5]).map(|fit| fit.height)
        };
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        assert!((plane_at(&corners).unwrap() - 2.1).abs() < 1e-12);
        // The centre is a corner of these points.
        assert!((plane_at(&corners.map(|p| p.map(|x| 0.5 * x))).unwrap() - 2.1).abs() < 1e-12);
        // Dense points in one half of the cell, and in one corner.
        let dense = |scale: [f64; 2]| -> Vec<[f64; 2]> {
            (0..100)
                .map(|i| [f64::from(i % 10) / 10.0 * scale[0], f64::from(i / 10) / 10.0 * scale[1]])
                .collect()
        };
        assert!(plane_at(&dense([1.0, 1.0])).is_some());
        assert!(plane_at(&dense([1.0, 0.4])).is_none() && plane_at(&dense([0.2, 0.2])).is_none());
        // A line, one point, none.
        assert!(plane_at(&[[0.0, 0.5], [0.4, 0.5], [1.0, 0.5]]).is_none());
        assert!(plane_at(&[[0.5, 0.5]]).is_none() && plane_at(&[]).is_none());
        // A cluster, and one point far from it beyond the centre: the plane would rest on that point.
        let mut lopsided = dense([0.1, 0.1]);
        lopsided.extend([[0.1, 0.9], [0.55, 0.53]]);
        assert!(plane_at(&lopsided).is_none());
    }
}
