//! Bands of a raster as maps beside each other, each with its scale.

use super::colour::{HEIGHTS, Legend, mixed};
use super::legend;
use super::ranges::inner_range;
use super::style::DARK;
use crate::chart::{Frame, Picture};
use crate::geotiff::Grid;

/// Maps in a row.
const COLUMNS: u32 = 3;
/// Room around a map, dots.
const BORDER: u32 = 16;
/// Room for the title above a map, dots.
const TITLE: u32 = 26;
/// Room for the scale at the right of a map, dots.
const SCALE: u32 = 120;
/// Size of the text, dots per unit of the font.
const TEXT: f64 = 2.0;

/// A band that is drawn.
#[derive(Clone, Copy, Debug)]
pub struct BandMap<'a> {
    /// Name and unit of its values.
    pub title: &'a str,
    /// Values row by row from the south west; NaN without a value.
    pub values: &'a [f64],
    /// Values of the first and of the last colour; those of almost all cells by default.
    pub limits: Option<[f64; 2]>,
}

/// Draws maps of bands, north at the top, into a picture of a width and a height in dots.
pub fn draw_bands(grid: &Grid, bands: &[BandMap], [width, height]: [u32; 2]) -> Picture {
    let mut picture = Picture::new(width, height, DARK.paper);
    let rows = (bands.len() as u32).div_ceil(COLUMNS).max(1);
    let (width, height) = (width / COLUMNS, height / rows);
    for (place, band) in (0u32..).zip(bands) {
        let frame = Frame { x: place % COLUMNS * width, y: place / COLUMNS * height, width, height };
        draw_band(&mut picture, grid, band, frame);
    }
    picture
}

fn draw_band(picture: &mut Picture, grid: &Grid, band: &BandMap, frame: Frame) {
    let (left, top) = (frame.x + BORDER, frame.y + BORDER);
    picture.text([f64::from(left), f64::from(top)], band.title, TEXT, DARK.ink);
    let top = top + TITLE;
    let width = frame.width.saturating_sub(SCALE + 2 * BORDER);
    let height = frame.height.saturating_sub(TITLE + 2 * BORDER);
    picture.fill(Frame { x: left, y: top, width, height }, DARK.ground);
    let [low, high] = band.limits.unwrap_or_else(|| {
        let (low, high) = inner_range(band.values.iter().map(|value| *value as f32));
        [f64::from(low), f64::from(high)]
    });
    let dots = (f64::from(width) / grid.columns as f64).min(f64::from(height) / grid.rows as f64);
    for y in 0..(dots * grid.rows as f64) as u32 {
        for x in 0..(dots * grid.columns as f64) as u32 {
            let column = ((f64::from(x) / dots) as usize).min(grid.columns - 1);
            // North is at the top.
            let row = grid.rows - 1 - ((f64::from(y) / dots) as usize).min(grid.rows - 1);
            let value = band.values.get(row * grid.columns + column).copied().unwrap_or(f64::NAN);
            if !value.is_nan() {
                let share = (value - low) / (high - low).max(f64::MIN_POSITIVE);
                picture.set(left + x, top + y, mixed(&HEIGHTS, share as f32));
            }
        }
    }
    let scale = Frame { x: left + width + BORDER / 2, y: top, width: SCALE, height };
    let bar = Legend::Bar { title: "", low: low as f32, high: high as f32, table: &HEIGHTS };
    legend::draw(picture, scale, &bar, TEXT, DARK);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_band_has_its_map_with_north_at_the_top() {
        let grid = Grid { columns: 2, rows: 2, side_m: 10.0, corner: [0.0; 2], crs: None };
        let values = [0.0, 1.0, f64::NAN, 0.5];
        let band = BandMap { title: "strips", values: &values, limits: Some([0.0, 1.0]) };
        let picture = draw_bands(&grid, &[band; 4], [1200, 800]);
        for origin in [[0, 0], [400, 0], [800, 0], [0, 400]] {
            let side = (400 - SCALE - 2 * BORDER) / 2;
            let at = |column: u32, row: u32| {
                let [x, y] = [origin[0] + BORDER, origin[1] + BORDER + TITLE];
                picture.dot(x + column * side + side / 2, y + row * side + side / 2)
            };
            assert_eq!((at(0, 1), at(1, 1)), (HEIGHTS[0], HEIGHTS[7]), "{origin:?}");
            assert_eq!(at(0, 0), DARK.ground);
        }
        // A raster without cells, and pictures without room.
        let none = Grid { columns: 0, rows: 0, ..grid };
        draw_bands(&none, &[BandMap { values: &[], limits: None, ..band }], [10, 10]);
        draw_bands(&grid, &[band], [0, 0]);
    }
}
