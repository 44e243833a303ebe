//! Rasters that are in memory only where rays need them: they are divided into pages, height fields over a
//! part of the grid each.
//!
//! All heights are read once when the scene is loaded, page by page, to determine the facts needed about
//! pages that are not in memory: their boxes, and the number of missing triangles before each row.

use super::blocks::Window;
use super::error::RasterError;
use super::mosaic::{Mosaic, named};
use super::read_window;
use super::refusal::Refusal;
use super::validity::Doubts;
use crate::builder::{LoadOptions, PartSource, SceneBuilder};
use crate::heights::add_heights;
use crate::tiles::PlaceInRaster;
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::store::Checksum;
use vlscan_geom::{Aabb, DVec3};
use vlscan_survey::RasterFiles;
use vlscan_trace::{HeightField, HeightGrid, Similarity};

/// Number of cells in a page, approximately; few in tests.
const PAGE_CELLS: usize = if cfg!(test) { 1 << 5 } else { 1 << 22 };
/// Maximum number of columns of cells in a page of a raster whose blocks are narrower.
const MAX_PAGE_COLUMNS: usize = if cfg!(test) { 1 << 3 } else { 1 << 11 };
/// Memory of heights and pyramid, bytes per cell, rounded up.
const CELL_BYTES: u64 = 6;

/// A raster whose heights are read page by page.
pub(crate) struct PagedRaster {
    mosaic: Mosaic,
    transform: Option<Similarity>,
    /// The cells of each page.
    pages: Vec<Window>,
}

/// Facts about a page that is not in memory.
pub(crate) struct PageFacts {
    /// Box around its triangles, world frame, m.
    pub bounds: Aabb,
    /// Number of its triangles, with those that are missing.
    pub numbers: u32,
    /// Checksum of its heights.
    pub checksum: u64,
    pub place: PlaceInRaster,
}

impl PagedRaster {
    /// Reads all heights of a raster once. The box of every page with triangles is where a part with this
    /// transform has them. Problems of the files are errors of the part; then there is no raster.
    pub fn index(
        scene: &mut SceneBuilder,
        part: &PartSource,
        files: &RasterFiles,
        transform: Option<Similarity>,
    ) -> Result<Option<(PagedRaster, Vec<PageFacts>)>> {
        let Some(mosaic) = super::find(scene, part, files)? else { return Ok(None) };
        let (columns, rows) = mosaic.cuts();
        let mut raster = PagedRaster { mosaic, transform, pages: Vec::new() };
        let (mut facts, mut doubts) = (Vec::new(), Doubts::default());
        let mut of_rows = vec![0u32; raster.mosaic.rows];
        for row in rows.windows(2) {
            let in_rows = &mut of_rows[row[0]..row[1]];
            for column in columns.windows(2) {
                let (width, height) = (column[1] - column[0], row[1] - row[0]);
                let cells = Window { left: column[0], top: row[0], width, height };
                let (field, doubtful) = match raster.read(scene.options, cells)? {
                    Ok(found) => found,
                    Err(refusal) => {
                        refusal.report(scene, part, None)?;
                        return Ok(None);
                    }
                };
                doubts.add(doubtful);
                let before = in_rows.to_vec();
                for (row, count) in in_rows.iter_mut().enumerate() {
                    let missing = |row: usize| field.missing_before(2 * width * row);
                    *count += (2 * width - (missing(row + 1) - missing(row))) as u32;
                }
                let numbers = field.len() as u32;
                let missing = numbers - field.triangles() as u32;
                if missing == numbers {
                    continue;
                }
                let place = PlaceInRaster {
                    rows: Arc::default(),
                    first_row: cells.top,
                    columns: width,
                    before,
                    missing,
                };
                let checksum = checksum(&field);
                facts.push(PageFacts { bounds: field.bounds(), numbers, checksum, place });
                raster.pages.push(cells);
            }
        }
        let mut all = 0;
        for count in &mut of_rows {
            (*count, all) = (all, all + *count);
        }
        // The last row of pixels has no cells: before it are all.
        let all: Arc<[u32]> = of_rows.into();
        facts.iter_mut().for_each(|page| page.place.rows = all.clone());
        super::warn_of(scene, part, named(files), doubts.warnings());
        Ok(Some((raster, facts)))
    }

    /// Memory of a page, bytes, approximately.
    pub fn bytes(&self, page: usize) -> u64 {
        self.pages[page].pixels() as u64 * CELL_BYTES
    }

    /// Reads a page, in the frame with its origin at `shift`.
    ///
    /// # Errors
    /// [`Error::Input`] and [`Error::Io`] with the file that cannot be read.
    pub fn load(&self, options: &LoadOptions, page: usize, shift: DVec3) -> Result<HeightField> {
        match self.read(options, self.pages[page])? {
            Ok((mut field, _)) => {
                field.shift(shift);
                Ok(field)
            }
            Err(Refusal::Unread(path, e) | Refusal::Changed(path, e)) => Err(Error::io("read", &path, e)),
            Err(Refusal::Unusable(path, problem, help)) => {
                let message = format!("cannot read the raster {}: {problem}", path.display());
                let mut problems = Diagnostics::default();
                problems.error(None, message).because_of(*problem).help(help);
                Err(Error::Input(Box::new(problems)))
            }
            Err(Refusal::Apart(message, help)) => Err(Error::input_with_help(message, help)),
        }
    }

    /// Reads the heights of some cells.
    fn read(
        &self,
        options: &LoadOptions,
        cells: Window,
    ) -> Result<std::result::Result<(HeightField, Doubts), Refusal>> {
        let mosaic = &self.mosaic;
        let vertices = Window { width: cells.width + 1, height: cells.height + 1, ..cells };
        // Pixels that pages share count for the first of them.
        let is_last =
            [vertices.left + vertices.width == mosaic.columns, vertices.top + vertices.height == mosaic.rows];
        let own = Window {
            width: cells.width + usize::from(is_last[0]),
            height: cells.height + usize::from(is_last[1]),
            ..cells
        };
        let (heights, doubts) = match read_window(options, mosaic, vertices, own)? {
            Ok(found) => found,
            Err(refusal) => return Ok(Err(refusal)),
        };
        let grid = HeightGrid {
            columns: vertices.width,
            rows: vertices.height,
            first: [cells.left, cells.top],
            transform: self.transform,
            ..mosaic.grid()
        };
        let field = HeightField::new(grid, heights, 0);
        Ok(field
            .map(|field| (field, doubts))
            .ok_or_else(|| Refusal::unusable(mosaic.path(), RasterError::TooLarge)))
    }
}

/// Checksum of the heights of a page.
fn checksum(field: &HeightField) -> u64 {
    let mut sum = Checksum::default();
    sum.debug(&(field.grid().first, field.grid().columns, field.grid().rows));
    add_heights(&mut sum, field.heights());
    sum.finish()
}

impl Mosaic {
    /// The columns and rows of cells at which pages begin, and the ends: where tiles begin, and where blocks
    /// of tiles do.
    fn cuts(&self) -> (Vec<usize>, Vec<usize>) {
        let block = |of: &dyn Fn(&[usize; 2]) -> usize| {
            let sizes = self.rasters.iter().map(|raster| [raster.blocks.size.0, raster.blocks.size.1]);
            sizes.map(|size| of(&size)).max().unwrap_or(1)
        };
        let (block_columns, block_rows) = (block(&|size| size[0]), block(&|size| size[1]));
        let widest = self.tiles.iter().map(|tile| tile.window.width).max().unwrap_or(1);
        let columns = match block_columns >= widest {
            true => usize::MAX,
            false => MAX_PAGE_COLUMNS.next_multiple_of(block_columns),
        };
        let starts = |axis: usize| self.tiles.iter().map(|tile| tile.at[axis]).collect::<Vec<_>>();
        let columns = cuts(starts(0), self.columns - 1, columns);
        let width = columns.windows(2).map(|cut| cut[1] - cut[0]).max().unwrap_or(1);
        let rows = (PAGE_CELLS / width).max(1).next_multiple_of(block_rows);
        (columns, cuts(starts(1), self.rows - 1, rows))
    }
}

/// Starts of parts of at most `most` cells that do not extend over a start, and the end.
fn cuts(mut starts: Vec<usize>, end: usize, most: usize) -> Vec<usize> {
    if end == 0 {
        return Vec::new();
    }
    starts.push(0);
    starts.retain(|start| *start < end);
    starts.sort_unstable();
    starts.dedup();
    // Tiles of any sizes would make many small pages.
    if starts.len() > MAX_STARTS * (end / most.min(end) + 1) {
        starts.truncate(1);
    }
    starts.push(end);
    let parts = starts.windows(2).flat_map(|part| (part[0]..part[1]).step_by(most.min(part[1] - part[0])));
    parts.chain([end]).collect()
}

/// Maximum number of starts of tiles per part of the greatest size for which pages begin where tiles do.
const MAX_STARTS: usize = 8;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_begin_where_tiles_begin_and_are_not_too_large() {
        assert_eq!(cuts(vec![0, 100, 100, 200], 299, 60), [0, 60, 100, 160, 200, 260, 299]);
        assert_eq!(cuts(vec![0], 5, usize::MAX), [0, 5]);
        assert_eq!(cuts((0..100).collect(), 100, 50), [0, 50, 100]);
        assert_eq!(cuts(vec![0, 1], 1, 4), [0, 1]);
        assert!(cuts(vec![0], 0, 4).is_empty());
    }
}
