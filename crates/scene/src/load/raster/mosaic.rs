//! Rasters that are tiles of one grid: which pixel of which file each pixel of the grid is.
//!
//! The grid reaches from the first to the last column and row of any tile. Its pixels lie exactly where those
//! of a single raster would that begins with the first of them. Where tiles overlap, the later one counts
//! where it has data; where there is no tile, there is no data.

use super::blocks::Window;
use super::error::RasterError;
use super::georeference::Georeference;
use super::keys::{LengthUnit, METRES, System};
use super::refusal::Refusal;
use super::tile::Raster;
use super::validity::{Doubts, NoData};
use crate::builder::MAX_ELEMENTS;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Place;
use vlscan_survey::{RasterFiles, VirtualRaster};
use vlscan_trace::{HeightGrid, Heights};

/// Advice for a virtual raster that cannot be read.
const ONE_RASTER: &str = "gdal_translate in.vrt out.tif makes one raster of it";
/// Advice for a virtual raster whose type differs from that of a source.
const OTHER_TYPE: &str = "write dataType=\"Float64\" in its <VRTRasterBand>, or give all files one type with \
                          gdal_translate -ot Float32 in.tif out.tif and make it anew with gdalbuildvrt";

/// Maximum distance of the pixels of a tile from those of the grid, pixels: coordinates of tiles are rounded.
const MAX_OFFSET: f64 = 0.01;
/// Maximum relative difference of lengths of pixels that round-off can explain.
const MAX_SIZE_DIFFERENCE: f64 = 1e-6;

/// Maximum number of tiles among which those that overlap are looked for; of more, all are read as if they
/// did.
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
    band: usize,
    no_data: NoData,
    /// The pixels of the raster.
    pub window: Window,
    /// Column and row of the grid at which they begin.
    pub at: [usize; 2],
    /// True if it may cover pixels of an earlier one.
    overlaps: bool,
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

/// Why there is no grid, and where a virtual raster names the cause.
type Misplaced = (Option<Box<Place>>, Refusal);

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
            None => return Err(apart(first, &rasters[1], "the first does not say where it lies", PLACE_IT)),
        };
        let mut starts = Vec::with_capacity(rasters.len());
        for raster in &rasters {
            check_same(first, raster)?;
            let Some(own) = raster.georeference.or((rasters.len() == 1).then_some(grid)) else {
                return Err(apart(first, raster, "the second does not say where it lies", PLACE_IT));
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

    fn of_virtual(raster: &VirtualRaster, warnings: &mut Vec<String>) -> Result<Mosaic, Misplaced> {
        let own = &raster.files[0];
        let place_of =
            |file: usize| raster.sources.iter().find(|s| s.file == file).map(|s| Box::new(s.place.clone()));
        let mut rasters: Vec<Raster> = Vec::new();
        for (number, path) in raster.files.iter().enumerate().skip(1) {
            let found = Raster::find(path).and_then(|found| {
                rasters.first().map_or(Ok(()), |first| check_same(first, &found)).map(|()| found)
            });
            rasters.push(found.map_err(|refusal| (place_of(number), refusal))?);
        }
        let first = &rasters[0];
        let system = raster.crs.as_deref().map_or(System::Unknown, System::of_wkt);
        if system != first.system && system != System::Unknown && first.system != System::Unknown {
            warnings.push(format!(
                "its coordinates are taken to be in {}, but {} is in {}",
                system.name(),
                first.file.path().display(),
                first.system.name()
            ));
        }
        let grid = raster.geo_transform.map(|c| Georeference::from_affine(c, false)).transpose();
        let grid = grid.map_err(|problem| (None, Refusal::unusable(own.clone(), problem)))?;
        if grid.is_none() {
            warnings.push(UNPLACED.to_owned());
        }
        let extent = Window { left: 0, top: 0, width: raster.size[0], height: raster.size[1] };
        let mut tiles = Vec::with_capacity(raster.sources.len());
        for source in &raster.sources {
            let found = &rasters[source.file - 1];
            let refuse =
                |message: String| (Some(Box::new(source.place.clone())), Refusal::Apart(message, ONE_RASTER));
            let shown = found.file.path().display();
            let of = |[left, top, width, height]: [usize; 4]| Window { left, top, width, height };
            let image = whole(found);
            let window = source.window.map_or(image, of);
            let target = source.target.map_or(extent, of);
            for (part, of, what) in [(window, image, "<SrcRect>"), (target, extent, "<DstRect>")] {
                if part.pixels() == 0 || part.intersection(&of) != Some(part) {
                    return Err(refuse(format!(
                        "{what} of {shown} reaches from column {} and row {} over {} x {} pixels, beyond the \
                         {} x {} that there are",
                        part.left, part.top, part.width, part.height, of.width, of.height
                    )));
                }
            }
            if (window.width, window.height) != (target.width, target.height) {
                return Err(refuse(format!(
                    "{} x {} pixels of {shown} would be resampled to {} x {}, which is not supported",
                    window.width, window.height, target.width, target.height
                )));
            }
            let pixels = found.blocks.pixels();
            if !raster.pixels.holds(pixels) {
                let message = format!(
                    "{} has the type {}, which does not hold every number of {shown}, {pixels}",
                    own.display(),
                    raster.pixels
                );
                let place = Some(Box::new(source.place.clone()));
                return Err((place, Refusal::Apart(message, OTHER_TYPE)));
            }
            if source.band > found.blocks.bands {
                let (band, bands) = (source.band, found.blocks.bands);
                return Err(refuse(format!("band {band} of {shown} is named, which has {bands}")));
            }
            if let (Some(grid), Some(placed)) = (&grid, &found.georeference) {
                let start = start_in(grid, placed, found).and_then(|start| {
                    let there = [0, 1]
                        .map(|a| [target.left, target.top][a] as i64 - [window.left, window.top][a] as i64);
                    let apart = [start[0] - there[0], start[1] - there[1]];
                    if apart == [0, 0] {
                        return Ok(());
                    }
                    Err(format!(
                        "the second lies {} columns and {} rows from where the first has it",
                        apart[0], apart[1]
                    ))
                });
                if let Err(what) = start {
                    let message = differ(own, found.file.path(), &what);
                    return Err((Some(Box::new(source.place.clone())), Refusal::Apart(message, ALIGN)));
                }
            }
            let stated = [found.no_data, source.no_data, raster.no_data];
            tiles.push(Tile {
                raster: source.file - 1,
                band: source.band - 1,
                no_data: NoData::new(stated.into_iter().flatten(), pixels),
                window,
                at: [target.left, target.top],
                overlaps: false,
            });
        }
        let units = virtual_units(raster, first, warnings);
        let (horizontal, vertical) = metres(&units, warnings);
        let (scale, offset) =
            (raster.scale.unwrap_or(first.band.scale), raster.offset.unwrap_or(first.band.offset));
        if (scale, offset) != (1.0, 0.0) {
            warnings.push(scaled(scale, offset));
        }
        if raster.other_bands > 0 {
            warnings.push(bands(raster.other_bands + 1));
        }
        let mosaic = Mosaic {
            columns: extent.width,
            rows: extent.height,
            georeference: grid.unwrap_or(Georeference::UNKNOWN).scaled(horizontal),
            scale: scale * vertical,
            offset: offset * vertical,
            rasters,
            tiles,
        };
        mosaic.finished(warnings).map_err(|refusal| (None, refusal))
    }

    /// Checks the whole grid.
    fn finished(mut self, warnings: &mut Vec<String>) -> Result<Mosaic, Refusal> {
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

const UNPLACED: &str = "it does not say where it lies; pixels of 1 m from the origin are assumed";
const PLACE_IT: &str = "a world file, or gdal_edit.py -a_ullr, places it";
const ALIGN: &str =
    "gdalwarp -t_srs EPSG:25832 -tr 1 1 -tap in.tif out.tif brings tiles into one system and grid";

/// The message about numbers that are scaled.
fn scaled(scale: f64, offset: f64) -> String {
    format!("its numbers are taken times {scale} plus {offset}, as its metadata says")
}

/// The message about bands that are left out.
fn bands(count: usize) -> String {
    format!("it has {count} bands, of which the first is read as heights")
}

fn whole(raster: &Raster) -> Window {
    Window { left: 0, top: 0, width: raster.blocks.columns, height: raster.blocks.rows }
}

fn differ(one: &Path, other: &Path, what: &str) -> String {
    format!("{} and {} are not tiles of one grid: {what}", one.display(), other.display())
}

fn apart(one: &Raster, other: &Raster, what: &str, help: &'static str) -> Refusal {
    Refusal::Apart(differ(one.file.path(), other.file.path(), what), help)
}

/// Checks that two rasters have the same system, units and scale.
fn check_same(first: &Raster, other: &Raster) -> Result<(), Refusal> {
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

/// Column and row of the first pixel of a raster, counted from that of a grid; the error is how they differ.
fn start_in(grid: &Georeference, own: &Georeference, raster: &Raster) -> Result<[i64; 2], String> {
    let ((a, c), (b, d)) = (own.of_column, own.of_row);
    let ((grid_a, grid_c), (grid_b, grid_d)) = (grid.of_column, grid.of_row);
    let size = grid_a.abs().max(grid_b.abs()).max(grid_c.abs()).max(grid_d.abs());
    let steps = [(a, grid_a), (b, grid_b), (c, grid_c), (d, grid_d)];
    if steps.iter().any(|(own, of_grid)| (own - of_grid).abs() > size * MAX_SIZE_DIFFERENCE) {
        let turned = |b: f64, c: f64| if (b, c) == (0.0, 0.0) { "" } else { ", turned" };
        return Err(format!(
            "pixels of the first are {grid_a} x {grid_d}{}, those of the second {a} x {d}{}",
            turned(grid_b, grid_c),
            turned(b, c)
        ));
    }
    let (columns, rows) = (raster.blocks.columns - 1, raster.blocks.rows - 1);
    let start = grid.index_of(own.origin);
    let nearest = start.map(f64::round);
    for (column, row) in [(0, 0), (columns, 0), (0, rows), (columns, rows)] {
        let at = grid.index_of(own.at(column as f64, row as f64));
        let off = [at[0] - nearest[0] - column as f64, at[1] - nearest[1] - row as f64];
        if off.iter().any(|off| off.abs() > MAX_OFFSET || off.is_nan()) {
            return Err(format!(
                "pixels of the second lie {:.3} columns and {:.3} rows beside those of the first",
                off[0], off[1]
            ));
        }
    }
    // Beyond these no grid could hold both.
    if nearest.iter().any(|n| n.abs() > MAX_ELEMENTS as f64) {
        return Err(format!("the second lies {} columns and {} rows from the first", nearest[0], nearest[1]));
    }
    Ok(nearest.map(|n| n as i64))
}

/// The units of a virtual raster: its own as far as it states them, else those of its sources.
fn virtual_units(
    raster: &VirtualRaster,
    first: &Raster,
    warnings: &mut Vec<String>,
) -> [Option<LengthUnit>; 2] {
    let [horizontal, vertical] = first.units.clone();
    let horizontal = horizontal.or_else(|| match System::of_wkt(raster.crs.as_deref()?) {
        System::Epsg(code) => vlscan_crs::length_unit(code.into()),
        System::Defined(text, _) => vlscan_crs::length_unit_in(&text),
        System::Unknown => None,
    });
    let Some(name) = &raster.unit else { return [horizontal, vertical] };
    let own = LengthUnit::of_name(name);
    if own.is_none() {
        warnings.push(format!(
            "the unit \"{name}\" of its heights is not known; it is taken as that of its sources"
        ));
    }
    [horizontal, own.or(vertical)]
}

/// The lengths of the units of coordinates and of heights, m. Heights without a unit have that of the
/// coordinates.
fn metres([horizontal, vertical]: &[Option<LengthUnit>; 2], warnings: &mut Vec<String>) -> (f64, f64) {
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
