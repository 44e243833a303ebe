//! Plots within an area.

use crate::plan::{Area, AreaError};
use vlscan_base::rng::{Purpose, Stream};

/// Maximum number of squares of the grid.
const MAX_SQUARES: f64 = 1e7;
/// Maximum number of squares times corners of the area.
const MAX_TESTS: f64 = 5e8;
/// Part of a square's size by which the area may cut off its edges.
const MAX_EDGE_CUT: f64 = 5e-7;

/// Plots that cannot be drawn.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlotsError {
    /// Squares that are too small for the area.
    #[error("plots of {size} m are too small for an area of {area} m²")]
    Small {
        /// Side of the plots, m.
        size: f64,
        /// Size of the area, m².
        area: f64,
    },
    /// More squares and corners than can be compared.
    #[error(
        "{squares} squares of {size} m and an area of {corners} corners take too long; make the plots \
         larger, or give the area fewer corners"
    )]
    Slow {
        /// Number of squares.
        squares: f64,
        /// Side of the plots, m.
        size: f64,
        /// Number of corners of the area.
        corners: usize,
    },
    /// Fewer plots within the area than requested.
    #[error("only {found} plots of {size} m fit into the area, expected {expected}")]
    Few {
        /// Number of plots that fit.
        found: usize,
        /// Side of the plots, m.
        size: f64,
        /// The requested number.
        expected: usize,
    },
    /// A plot that is not an area.
    #[error(transparent)]
    Area(#[from] AreaError),
}

/// Squares of a grid that lie within the area: those of the grid are drawn at random, without repetition.
/// They are returned from south to north and from west to east.
///
/// # Errors
/// Fewer plots that fit, plots that are too small for the area, and areas of too many corners.
pub fn draw(area: &Area, count: usize, size: f64, seed: u64) -> Result<Vec<Area>, PlotsError> {
    let (low, high) = area.bounds();
    let number = |axis: usize| ((high[axis] - low[axis]) / size).floor();
    let squares = number(0) * number(1);
    if squares > MAX_SQUARES {
        return Err(PlotsError::Small { size, area: area.square_metres() });
    }
    if squares * area.corners().len() as f64 > MAX_TESTS {
        return Err(PlotsError::Slow { squares, size, corners: area.corners().len() });
    }
    let (columns, rows) = (number(0) as u32, number(1) as u32);
    // The grid is centred in the area's box.
    let origin = [0, 1].map(|axis| low[axis] + (high[axis] - low[axis] - number(axis) * size) / 2.0);
    let mut fitting: Vec<(u32, Area)> = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let from = [origin[0] + f64::from(column) * size, origin[1] + f64::from(row) * size];
            let to = from.map(|v| v + size);
            // A side on the edge of the square does not cut it.
            let within = [from.map(|v| v + MAX_EDGE_CUT * size), to.map(|v| v - MAX_EDGE_CUT * size)];
            let centre = [0, 1].map(|axis| (from[axis] + to[axis]) / 2.0);
            if area.contains(centre) && !area.sides().any(|side| crosses(side, within)) {
                fitting.push((row * columns + column, Area::rectangle(from, to)?));
            }
        }
    }
    if fitting.len() < count {
        return Err(PlotsError::Few { found: fitting.len(), size, expected: count });
    }
    let stream = Stream::new(seed, Purpose::SceneMaking);
    let key = |cell: u32| (stream.uniform(cell, 0, 0), cell);
    fitting.sort_by(|a, b| key(a.0).0.total_cmp(&key(b.0).0).then(a.0.cmp(&b.0)));
    fitting.truncate(count);
    fitting.sort_by_key(|(cell, _)| *cell);
    Ok(fitting.into_iter().map(|(_, area)| area).collect())
}

/// True if a line from `a` to `b` has a part within the rectangle (Liang and Barsky 1984).
fn crosses([a, b]: [[f64; 2]; 2], [low, high]: [[f64; 2]; 2]) -> bool {
    // The fractions of the line between which it is within.
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for axis in 0..2 {
        let way = b[axis] - a[axis];
        if way == 0.0 {
            if a[axis] < low[axis] || a[axis] > high[axis] {
                return false;
            }
            continue;
        }
        let ends = [low[axis], high[axis]].map(|limit| (limit - a[axis]) / way);
        from = from.max(ends[0].min(ends[1]));
        to = to.min(ends[0].max(ends[1]));
    }
    from <= to
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plots_lie_within_the_area_and_apart() {
        let area =
            Area::new(vec![[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [50.0, 60.0], [0.0, 100.0]]).unwrap();
        let plots = draw(&area, 10, 20.0, 1).unwrap();
        assert_eq!(plots.len(), 10);
        for (i, plot) in plots.iter().enumerate() {
            assert!((plot.square_metres() - 400.0).abs() < 1e-6);
            let (low, high) = plot.bounds();
            let centre = [(low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0];
            assert!(area.contains(centre));
            assert!(plots[..i].iter().all(|other| !other.contains(centre)));
        }
        assert_ne!(draw(&area, 10, 20.0, 2).unwrap(), plots);
        assert!(draw(&area, 26, 20.0, 1).unwrap_err().to_string().contains("expected 26"));
        assert!(draw(&area, 1, 1e-3, 1).is_err());
    }

    #[test]
    fn sides_through_a_square_count_without_a_corner_in_it() {
        // A slit from the top to the bottom whose corners lie on the area's edges.
        let slit = vec![
            [0.0, 0.0],
            [100.0, 0.0],
            [100.0, 20.0],
            [51.0, 20.0],
            [50.0, 0.1],
            [49.0, 20.0],
            [0.0, 20.0],
        ];
        let area = Area::new(slit).unwrap();
        let plots = draw(&area, 4, 20.0, 1).unwrap();
        let middles: Vec<f64> =
            plots.iter().map(|plot| (plot.bounds().0[0] + plot.bounds().1[0]) / 2.0).collect();
        assert_eq!(middles, [10.0, 30.0, 70.0, 90.0]);
        assert!(crosses([[0.0, 5.0], [10.0, 5.0]], [[4.0, 4.0], [6.0, 6.0]]));
        assert!(crosses([[3.0, 5.0], [5.0, 3.0]], [[3.5, 3.5], [6.0, 6.0]]));
        assert!(!crosses([[3.0, 5.0], [5.0, 3.0]], [[4.5, 4.5], [6.0, 6.0]]));
    }

    #[test]
    fn areas_of_too_many_corners_for_their_plots_are_refused() {
        let circle = (0..100_000).map(|i| {
            let (s, c) = libm::sincos(f64::from(i) * std::f64::consts::TAU / 1e5);
            [1000.0 * c, 1000.0 * s]
        });
        let area = Area::new(circle.collect()).unwrap();
        assert!(draw(&area, 10, 1.0, 1).unwrap_err().to_string().contains("100000 corners"));
    }
}
