//! Rasters that are tiles of one grid: which pixel of which file each pixel of the grid is.
//!
//! The grid reaches from the first to the last column and row of any tile. Its pixels lie exactly where those
//! of a single raster would that begins with the first of them. Where tiles overlap, the later one is used
//! where it has data; where there is no tile, there is no data.

use super::blocks::Window;
use super::error::RasterError;
use super::georeference::Georeference;
use super::keys::{LengthUnit, METRES};
use super::refusal::Refusal;
use super::tile::Raster;
use super::validity::{Doubts, NoData};
use crate::builder::MAX_ELEMENTS;
use std::fmt;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Place;
use vlscan_survey::RasterFiles;
use vlscan_trace::{HeightGrid, Heights};

/// Maximum distance of the pixels of a tile from those of the grid, pixels: coordinates of tiles are rounded.
const MAX_OFFSET: f64 = 0.01;
/// Maximum relative difference of lengths of pixels that round-off can explain.
const MAX_SIZE_DIFFERENCE: f64 = 1e-6;

/// Maximum number of tiles that are checked for overlaps; more tiles are all read as if they overlapped.
const MAX_COMPARED_TILES: usize = 10_000;

/// A grid of pixels and its tiles.
pub(super) struct Mosaic {
    pub columns: usize,
    pub rows: usize,
    /// In metres.
    pub georeference: Georeference,
    /// Heights are number · scale + offset, m.
    pub scale: f64,
    pub offset: f64,
    pub rasters: Vec<Raster>,
    /// In the order in which later ones cover earlier ones.
    pub tiles: Vec<Tile>,
}

/// A window of a raster in a grid.
pub(super) struct Tile {
    /// Index of the raster.
    pub raster: usize,
    /// Index of the band.
    pub band: usize,
    pub no_data: NoData,
    /// The pixels of the raster.
    pub window: Window,
    /// Column and row of the grid at which they begin.
    pub at: [usize; 2],
    /// True if it may cover pixels of an earlier one.
    pub overlaps: bool,
}

impl Tile {
    /// Its pixels in the grid.
    pub fn target(&self) -> Window {
        Window { left: self.at[0], top: self.at[1], ..self.window }
    }

    /// The pixels of its raster at a window of the grid, which must be within its own.
    pub fn pixels_at(&self, of_grid: Window) -> Window {
        let left = of_grid.left - self.at[0] + self.window.left;
        let top = of_grid.top - self.at[1] + self.window.top;
        Window { left, top, ..of_grid }
    }
}

/// Reason why there is no grid, and the place of the cause in a virtual raster.
pub(super) type Misplaced = (Option<Box<Place>>, Refusal);

impl Mosaic {
    /// The grid of these files. Warnings are for a single file, or for all if they name none.
    ///
    /// # Errors
    /// Files that cannot be read, or that are not tiles of one grid, with the place in the virtual raster
    /// that names them.
    pub fn find(files: &RasterFiles, warnings: &mut Vec<String>) -> Result<Mosaic, Misplaced> {
        match files {
            RasterFiles::Tiles(paths) => {
                let rasters = paths.iter().map(|path| Raster::find(path)).collect::<Result<Vec<_>, _>>();
                Mosaic::of_tiles(rasters.map_err(|e| (None, e))?, warnings).map_err(|e| (None, e))
            }
            RasterFiles::Virtual(raster) => Mosaic::of_virtual(raster, warnings),
        }
    }

    fn of_tiles(rasters: Vec<Raster>, warnings: &mut Vec<String>) -> Result<Mosaic, Refusal> {
        let first = &rasters[0];
        let grid = match first.georeference {
            Some(grid) => grid,
            None if rasters.len() == 1 => {
                warnings.push(UNPLACED.to_owned());
                Georeference::UNKNOWN
            }
            None => return Err(apart(first, &rasters[1], &"the first does not say where it lies", PLACE_IT)),
        };
        let mut starts = Vec::with_capacity(rasters.len());
        for raster in &rasters {
            check_same(first, raster)?;
            let Some(own) = raster.georeference.or((rasters.len() == 1).then_some(grid)) else {
                return Err(apart(first, raster, &"the second does not say where it lies", PLACE_IT));
            };
            starts.push(start_in(&grid, &own, raster).map_err(|what| apart(first, raster, &what, ALIGN))?);
        }
        let least = |axis: usize| starts.iter().map(|start| start[axis]).min().unwrap_or(0);
        let [left, top] = [least(0), least(1)];
        let placed = |at: usize| rasters[at].georeference.unwrap_or(grid).origin;
        let of = |is_chosen: &dyn Fn(&[i64; 2]) -> bool| starts.iter().position(is_chosen).map(placed);
        let origin = match of(&|start| *start == [left, top]) {
            Some(origin) => origin,
            None if grid.is_upright() => {
                let x = of(&|start| start[0] == left).map_or(grid.origin.0, |p| p.0);
                let y = of(&|start| start[1] == top).map_or(grid.origin.1, |p| p.1);
                (x, y)
            }
            None => grid.at(left as f64, top as f64),
        };
        let mut tiles = Vec::with_capacity(rasters.len());
        for (number, (raster, start)) in rasters.iter().zip(&starts).enumerate() {
            let window = whole(raster);
            let at = [(start[0] - left) as usize, (start[1] - top) as usize];
            let no_data = NoData::new(raster.no_data, raster.blocks.pixels());
            tiles.push(Tile { raster: number, band: 0, no_data, window, at, overlaps: false });
        }
        let end = |end: &dyn Fn(&Window) -> usize| tiles.iter().map(|t| end(&t.target())).max().unwrap_or(0);
        let columns = end(&|target| target.left + target.width);
        let rows = end(&|target| target.top + target.height);
        let first = &rasters[0];
        let (horizontal, vertical) = metres(&first.units, warnings);
        if (first.band.scale, first.band.offset) != (1.0, 0.0) {
            warnings.push(scaled(first.band.scale, first.band.offset));
        }
        if let Some(raster) = rasters.iter().find(|raster| raster.other_bands() > 0) {
            warnings.push(bands(raster.blocks.bands));
        }
        Mosaic {
            columns,
            rows,
            georeference: Georeference { origin, ..grid }.scaled(horizontal),
            scale: first.band.scale * vertical,
            offset: first.band.offset * vertical,
            rasters,
            tiles,
        }
        .finished(warnings)
    }

    /// Checks the whole grid.
    pub fn finished(mut self, warnings: &mut Vec<String>) -> Result<Mosaic, Refusal> {
        let first = &self.rasters[0];
        let path = self.path();
        if first.is_geographic {
            let ((x0, y0), far) = (self.georeference.origin, self.corner());
            warnings.push(format!(
                "its coordinates are degrees (longitude {x0:.4} to {:.4}, latitude {y0:.4} to {:.4}), which \
                 are taken as metres; project it first: gdalwarp -t_srs EPSG:32632 in.tif out.tif, with the \
                 code of its zone",
                far.0, far.1
            ));
        }
        if !self.georeference.is_near(self.columns, self.rows) {
            return Err(Refusal::unusable(path, RasterError::OutOfRange));
        }
        if self.triangles().max(self.pixels()) > MAX_ELEMENTS {
            let problem = RasterError::TooManyPixels { columns: self.columns, rows: self.rows };
            return Err(Refusal::unusable(path, problem));
        }
        if self.tiles.len() > MAX_COMPARED_TILES {
            self.tiles.iter_mut().for_each(|tile| tile.overlaps = true);
            return Ok(self);
        }
        // Each is compared with those in reach before it, from top to bottom.
        let targets: Vec<Window> = self.tiles.iter().map(Tile::target).collect();
        let mut order: Vec<usize> = (0..targets.len()).collect();
        order.sort_by_key(|&i| targets[i].top);
        let tallest = targets.iter().map(|target| target.height).max().unwrap_or(0);
        for (n, &later) in order.iter().enumerate() {
            let reach = |i: &&usize| targets[**i].top + tallest > targets[later].top;
            let before = order[..n].iter().rev().take_while(reach);
            for &other in before.filter(|&&other| targets[later].intersection(&targets[other]).is_some()) {
                self.tiles[later.max(other)].overlaps = true;
            }
        }
        Ok(self)
    }

    /// x and y of the centre of the last pixel.
    fn corner(&self) -> (f64, f64) {
        let far = self.georeference.centre(self.columns - 1, self.rows - 1, 0.0);
        (far.x, far.y)
    }

    /// The first file, by which memory that is short is reported.
    pub fn path(&self) -> PathBuf {
        self.rasters[0].file.path().to_path_buf()
    }

    /// All pixels.
    pub fn extent(&self) -> Window {
        Window { left: 0, top: 0, width: self.columns, height: self.rows }
    }

    pub fn pixels(&self) -> usize {
        self.columns.saturating_mul(self.rows)
    }

    /// Number of triangles if no pixel is without data.
    pub fn triangles(&self) -> usize {
        (self.columns - 1).saturating_mul(self.rows - 1).saturating_mul(2)
    }

    /// Positions of the pixels' centres as vertices.
    pub fn grid(&self) -> HeightGrid {
        let grid = self.georeference.grid(self.columns, self.rows);
        HeightGrid { scale: self.scale, offset: self.offset, ..grid }
    }

    /// The raster of a tile.
    pub fn raster_of(&self, tile: &Tile) -> &Raster {
        &self.rasters[tile.raster]
    }

    /// The least number of whole numbers that 16 bits can hold if all rasters have such numbers.
    pub fn least_short(&self) -> Option<i32> {
        let least = self.rasters[0].blocks.least_short()?;
        self.rasters.iter().all(|raster| raster.blocks.least_short() == Some(least)).then_some(least)
    }

    /// Memory for the numbers of a window without data.
    pub fn heights(&self, pixels: usize) -> Result<Heights, RasterError> {
        Ok(match self.least_short() {
            Some(least) => Heights::short(least, pixels)?,
            None => Heights::single(pixels)?,
        })
    }

    /// Reads the numbers of a part of a tile, which is a window of its raster; NaN for pixels without data.
    pub fn read(&self, tile: &Tile, part: Window) -> Result<(Vec<f64>, Doubts), Refusal> {
        let raster = self.raster_of(tile);
        let height = |number: f64| number * self.scale + self.offset;
        raster.numbers(part, tile.band, &tile.no_data, height).map_err(|problem| {
            let files =
                std::iter::once(&raster.file).chain(raster.mask.as_ref().and_then(|m| m.file.as_ref()));
            let changed =
                files.filter_map(|file| Some((file.path().to_path_buf(), file.open().err()?))).next();
            match changed {
                Some((path, e)) => Refusal::Changed(path, e),
                None => {
                    let path = raster.file.path().to_path_buf();
                    Refusal::Unusable(path, Box::new(problem), super::tile::HELP.into())
                }
            }
        })
    }

    /// Puts the numbers of a part of a tile into `heights`, which hold a window of the grid that encloses the
    /// part.
    pub fn put(
        &self,
        tile: &Tile,
        part: Window,
        numbers: &[f64],
        heights: &mut Heights,
        window: &Window,
    ) -> Result<(), RasterError> {
        let left = tile.at[0] + part.left - tile.window.left - window.left;
        let top = tile.at[1] + part.top - tile.window.top - window.top;
        for (row, numbers) in (top..).zip(numbers.chunks_exact(part.width)) {
            let mut at = row * window.width + left;
            // A tile without data keeps the data of earlier tiles.
            for run in numbers.chunk_by(|a, b| !tile.overlaps || a.is_nan() == b.is_nan()) {
                if !(tile.overlaps && run[0].is_nan()) {
                    heights.set(at, run)?;
                }
                at += run.len();
            }
        }
        Ok(())
    }
}

/// Warning about a raster without a place.
pub(super) const UNPLACED: &str = "it does not say where it lies; pixels of 1 m from the origin are assumed";
const PLACE_IT: &str = "a world file, or gdal_edit.py -a_ullr, places it";
/// Advice for tiles that are not of one grid.
pub(super) const ALIGN: &str =
    "gdalwarp -t_srs EPSG:25832 -tr 1 1 -tap in.tif out.tif brings tiles into one system and grid";

/// The message about numbers that are scaled.
pub(super) fn scaled(scale: f64, offset: f64) -> String {
    format!("its numbers are taken times {scale} plus {offset}, as its metadata says")
}

/// The message about bands that are left out.
pub(super) fn bands(count: usize) -> String {
    format!("it has {count} bands, of which the first is read as heights")
}

pub(super) fn whole(raster: &Raster) -> Window {
    Window { left: 0, top: 0, width: raster.blocks.columns, height: raster.blocks.rows }
}

/// The message about two files that are not tiles of one grid.
pub(super) fn differ(one: &Path, other: &Path, what: &dyn fmt::Display) -> String {
    format!("{} and {} are not tiles of one grid: {what}", one.display(), other.display())
}

fn apart(one: &Raster, other: &Raster, what: &dyn fmt::Display, help: &'static str) -> Refusal {
    Refusal::Apart(differ(one.file.path(), other.file.path(), what), help)
}

/// Checks that two rasters have the same system, units and scale.
pub(super) fn check_same(first: &Raster, other: &Raster) -> Result<(), Refusal> {
    if first.system != other.system {
        let what = format!("the first is in {}, the second in {}", first.system.name(), other.system.name());
        return Err(apart(first, other, &what, ALIGN));
    }
    let name = |unit: &Option<LengthUnit>| unit.as_ref().map_or(METRES.to_owned(), |unit| unit.name.clone());
    let length = |unit: &Option<LengthUnit>| unit.as_ref().map_or(1.0, |unit| unit.metres);
    for (of, (own, others)) in ["coordinates", "heights"].iter().zip(first.units.iter().zip(&other.units)) {
        if length(own) != length(others) {
            let what = format!("{of} of the first are {}, those of the second {}", name(own), name(others));
            return Err(apart(first, other, &what, ALIGN));
        }
    }
    let of = |raster: &Raster| (raster.band.scale, raster.band.offset);
    if of(first) != of(other) {
        let ((a, b), (c, d)) = (of(first), of(other));
        let what = format!(
            "heights of the first are its numbers times {a} plus {b}, those of the second times {c} plus {d}"
        );
        return Err(apart(
            first,
            other,
            &what,
            "gdal_translate -unscale in.tif out.tif writes heights as they are",
        ));
    }
    Ok(())
}

/// Difference of a raster from the grid of which it should be a tile.
#[derive(Clone, Copy, Debug, thiserror::Error)]
pub(super) enum Misalignment {
    /// Pixels of other sizes.
    #[error("pixels of the first are {}, those of the second {}", pixels_of(&.0[0]), pixels_of(&.0[1]))]
    Pixels([Georeference; 2]),
    /// Pixels that lie this number of columns and rows beside those of the grid.
    #[error("pixels of the second lie {:.3} columns and {:.3} rows beside those of the first", .0[0], .0[1])]
    Between([f64; 2]),
    /// A distance, in columns and rows, that no grid has.
    #[error("the second lies {} columns and {} rows from the first", .0[0], .0[1])]
    Far([f64; 2]),
    /// Columns and rows between the raster and its place in a virtual raster.
    #[error("the second lies {} columns and {} rows from where the first has it", .0[0], .0[1])]
    Elsewhere([i64; 2]),
}

/// The size of the pixels of a raster, for messages.
fn pixels_of(grid: &Georeference) -> String {
    let ((a, c), (b, d)) = (grid.of_column, grid.of_row);
    let turned = if (b, c) == (0.0, 0.0) { "" } else { ", turned" };
    format!("{a} x {d}{turned}")
}

/// Column and row of the first pixel of a raster, counted from that of a grid.
///
/// # Errors
/// How they differ.
pub(super) fn start_in(
    grid: &Georeference,
    own: &Georeference,
    raster: &Raster,
) -> Result<[i64; 2], Misalignment> {
    let ((a, c), (b, d)) = (own.of_column, own.of_row);
    let ((grid_a, grid_c), (grid_b, grid_d)) = (grid.of_column, grid.of_row);
    let size = grid_a.abs().max(grid_b.abs()).max(grid_c.abs()).max(grid_d.abs());
    let steps = [(a, grid_a), (b, grid_b), (c, grid_c), (d, grid_d)];
    if steps.iter().any(|(own, of_grid)| (own - of_grid).abs() > size * MAX_SIZE_DIFFERENCE) {
        return Err(Misalignment::Pixels([*grid, *own]));
    }
    let (columns, rows) = (raster.blocks.columns - 1, raster.blocks.rows - 1);
    let start = grid.index_of(own.origin);
    let nearest = start.map(f64::round);
    for (column, row) in [(0, 0), (columns, 0), (0, rows), (columns, rows)] {
        let at = grid.index_of(own.at(column as f64, row as f64));
        let off = [at[0] - nearest[0] - column as f64, at[1] - nearest[1] - row as f64];
        if off.iter().any(|off| off.abs() > MAX_OFFSET || off.is_nan()) {
            return Err(Misalignment::Between(off));
        }
    }
    // Beyond these no grid could hold both.
    if nearest.iter().any(|n| n.abs() > MAX_ELEMENTS as f64) {
        return Err(Misalignment::Far(nearest));
    }
    Ok(nearest.map(|n| n as i64))
}

/// The lengths of the units of coordinates and of heights, m. Heights without a unit have that of the
/// coordinates.
pub(super) fn metres(
    [horizontal, vertical]: &[Option<LengthUnit>; 2],
    warnings: &mut Vec<String>,
) -> (f64, f64) {
    let is_foreign = |unit: &Option<LengthUnit>| unit.as_ref().is_some_and(|unit| !unit.is_metre());
    let metres = |unit: &Option<LengthUnit>| unit.as_ref().map_or(1.0, |unit| unit.metres);
    let name = |unit: &Option<LengthUnit>| unit.as_ref().map_or(METRES.to_owned(), |unit| unit.name.clone());
    let lengths = match (is_foreign(horizontal), is_foreign(vertical)) {
        (false, false) => return (1.0, 1.0),
        (false, true) => {
            warnings.push(format!(
                "its heights are {}, which are multiplied by {} to metres",
                name(vertical),
                metres(vertical)
            ));
            return (1.0, metres(vertical));
        }
        (true, _) => (metres(horizontal), metres(if vertical.is_some() { vertical } else { horizontal })),
    };
    let heights = match vertical {
        Some(unit) => format!("its heights {}", unit.name),
        None => "so are its heights, whose unit it does not state".to_owned(),
    };
    warnings.push(format!(
        "its coordinates are {}, {heights}; x and y are multiplied by {}, z by {} to metres, so that flight \
         and meshes must be, too (gdalwarp -t_srs EPSG:... in.tif out.tif brings it into a system in metres)",
        name(horizontal),
        lengths.0,
        lengths.1
    ));
    lengths
}

/// The file by which a raster is named in messages.
pub(super) fn named(files: &RasterFiles) -> &PathBuf {
    &files.all()[0]
}
