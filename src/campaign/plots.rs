//! Plots within an area.

use crate::plan::Area;
use crate::rng::{Purpose, Stream};

/// Squares of a grid that lie within the area: those of the grid are drawn at random, without repetition. They are returned
/// from south to north and from west to east.
///
/// # Errors
/// A sentence if fewer fit.
pub fn draw(area: &Area, count: usize, size: f64, seed: u64) -> Result<Vec<Area>, String> {
    let (low, high) = area.bounds();
    let number = |axis: usize| ((high[axis] - low[axis]) / size).floor();
    if number(0) * number(1) > 1e7 {
        return Err(format!("plots of {size} m are too small for an area of {} m²", area.square_metres()));
    }
    let (columns, rows) = (number(0) as u32, number(1) as u32);
    // The grid is centred in the area's box.
    let origin = [0, 1].map(|axis| low[axis] + (high[axis] - low[axis] - number(axis) * size) / 2.0);
    let mut fitting: Vec<(u32, Area)> = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let from = [origin[0] + f64::from(column) * size, origin[1] + f64::from(row) * size];
            let to = from.map(|v| v + size);
            let is_within = |x: f64, y: f64| {
                // A corner on the edge of the area counts.
                let towards = |v: f64, centre: f64| v + (centre - v) * 1e-6;
                let centre = [from[0] + size / 2.0, from[1] + size / 2.0];
                area.contains([towards(x, centre[0]), towards(y, centre[1])])
            };
            let corners = [(from[0], from[1]), (to[0], from[1]), (to[0], to[1]), (from[0], to[1])];
            let has_notch = area
                .corners()
                .iter()
                .any(|c| c[0] > from[0] && c[0] < to[0] && c[1] > from[1] && c[1] < to[1]);
            if corners.iter().all(|(x, y)| is_within(*x, *y)) && !has_notch {
                fitting.push((row * columns + column, Area::rectangle(from, to)?));
            }
        }
    }
    if fitting.len() < count {
        return Err(format!("only {} plots of {size} m fit into the area, expected {count}", fitting.len()));
    }
    let stream = Stream::new(seed, Purpose::SceneMaking);
    let key = |cell: u32| (stream.uniform(cell, 0, 0), cell);
    fitting.sort_by(|a, b| key(a.0).0.total_cmp(&key(b.0).0).then(a.0.cmp(&b.0)));
    fitting.truncate(count);
    fitting.sort_by_key(|(cell, _)| *cell);
    Ok(fitting.into_iter().map(|(_, area)| area).collect())
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
        assert!(draw(&area, 26, 20.0, 1).unwrap_err().contains("expected 26"));
        assert!(draw(&area, 1, 1e-3, 1).is_err());
    }
}
