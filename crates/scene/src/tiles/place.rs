//! Tiles that are parts of one raster.

use std::sync::Arc;
use vlscan_trace::HeightField;

/// The place of a tile's triangles among those of the raster that it is a part of, which are counted row by
/// row without the missing ones.
#[derive(Clone, Debug)]
pub struct PlaceInRaster {
    /// Number of triangles before each row of the raster, and of all.
    pub(crate) rows: Arc<[u32]>,
    /// The tile's first row in the raster.
    pub(crate) first_row: usize,
    /// Number of cells per row of the tile.
    pub(crate) columns: usize,
    /// For each row of the tile, the number of triangles of the same row of the raster before the tile.
    pub(crate) before: Vec<u32>,
    /// Number of triangles of the tile that are missing.
    pub(crate) missing: u32,
}

impl PlaceInRaster {
    /// Number of triangles of the raster before triangle `local` of the tile, whose `field` counts if some
    /// are missing.
    pub(crate) fn number(&self, local: u32, field: Option<&HeightField>) -> u32 {
        let local = local as usize;
        let row = local / (2 * self.columns);
        let start = 2 * self.columns * row;
        let missing = match field.filter(|_| self.missing > 0) {
            Some(field) => field.missing_before(local) - field.missing_before(start),
            None => 0,
        };
        self.rows[self.first_row + row] + self.before[row] + (local - start - missing) as u32
    }

    /// Number of triangles of the raster.
    pub(crate) fn all(&self) -> u32 {
        self.rows.last().copied().unwrap_or(0)
    }
}
