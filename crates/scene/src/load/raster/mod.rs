//! Terrain from a raster (spec input-formats §4.3): one vertex at the centre of each pixel, two triangles
//! between each four pixels. They are a height field unless the part moves or has materials by face; then
//! they are stored.
//!
//! | file | what it does |
//! |---|---|
//! | `mosaic`, `virtual_mosaic` | files, and virtual rasters of GDAL, as tiles of one grid |
//! | `pages` | rasters that are in memory only where rays need them |
//! | `tile` | one file: the description of its pixels, and the numbers in a window |
//! | `file` | files of which parts are read |
//! | `ascii_grid` | ESRI ASCII grids, read as the GeoTIFF of the same heights |
//! | `blocks`, `unpack` | strips and tiles: predictors and types of numbers; compressions |
//! | `georeference` | where the pixels are, from tags or a world file |
//! | `prj` | the text of the `.prj` file beside a raster |
//! | `keys` | GeoKeys and GDAL's metadata: systems, units, scales |
//! | `validity` | no-data values, masks, alpha bands |
//! | `error`, `refusal` | errors; why a raster cannot be used |

mod ascii_grid;
mod blocks;
#[cfg(test)]
mod colour_tests;
mod error;
#[cfg(test)]
mod field_tests;
mod file;
mod georeference;
mod keys;
mod mosaic;
#[cfg(test)]
mod page_tests;
mod pages;
mod prj;
mod refusal;
#[cfg(test)]
mod tests;
mod tile;
mod unpack;
mod validity;
mod virtual_mosaic;

use crate::builder::{LoadOptions, PartSource, SceneBuilder, memory_of};
use crate::colours::raster_texel;
use blocks::Window;
pub use error::{GridError, RasterError, UnpackError};
use keys::System;
use mosaic::{Mosaic, Tile, named};
pub(crate) use pages::{PageFacts, PagedRaster};
use rayon::prelude::*;
use refusal::Refusal;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use validity::Doubts;
use vlscan_base::diag::Place;
use vlscan_base::error::Result;
use vlscan_crs as crs;
use vlscan_geom::DVec3;
use vlscan_survey::{Loader, MeshColours, PartRecipe, RasterFiles, Replaced, SceneRecipe, Transform};
use vlscan_trace::{HeightField, HeightGrid, Heights};

/// Parts or rows per thread that are read before they are appended; limits the memory held twice.
const PARTS_PER_THREAD: usize = 8;
/// Memory of the pyramid over a height field, bytes per pixel, rounded up.
const PYRAMID_BYTES: u64 = 2;

/// The size of a raster, or of the grid of several, and its memory without a tree.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RasterNeed {
    /// The file, or the first one.
    pub path: PathBuf,
    /// Number of files.
    pub files: usize,
    /// Number of pixels from west to east.
    pub columns: usize,
    /// Number of pixels from north to south.
    pub rows: usize,
    /// Number of triangles if no pixel is without data.
    pub triangles: u64,
    /// True if it is a height field: its triangles are not stored, and need no tree.
    pub is_field: bool,
    /// Memory in the scene, or of decoding if that is more, if no pixel is without data.
    pub bytes: u64,
}

/// The sizes of the rasters of a scene that are in memory as a whole, from their headers. Damaged rasters are
/// omitted; the loader reports them.
pub fn raster_needs(recipe: &SceneRecipe, options: &LoadOptions) -> Vec<RasterNeed> {
    let parts = recipe.parts.iter().filter(|part| recipe.packed.is_none() && !is_paged(options, part));
    let rasters = parts.filter_map(|part| match &part.loader {
        Loader::GeoTiff { files, .. } => Some((files, keeps_grid(part))),
        _ => None,
    });
    let need = |(files, is_field): (&RasterFiles, bool)| {
        let mosaic = Mosaic::find(files, &mut Vec::new()).ok()?;
        Some(RasterNeed {
            path: named(files).clone(),
            files: mosaic.rasters.len(),
            columns: mosaic.columns,
            rows: mosaic.rows,
            triangles: mosaic.triangles() as u64,
            is_field,
            bytes: mosaic.memory(is_field),
        })
    };
    rasters.filter_map(need).collect()
}

/// True if a raster can remain a height field: its triangles do not move, and have one material.
pub(crate) fn keeps_grid(part: &PartRecipe) -> bool {
    let Transform { rotation, scale, .. } = part.transform;
    // Other factors and angles leave nothing to see or to compute.
    let is_similar = scale != 0.0 && scale.is_finite() && rotation.apply(DVec3::ONE).is_finite();
    part.motions.is_empty()
        && is_similar
        && !part.changes.iter().any(|change| matches!(change.replaced, Replaced::Faces(_)))
}

/// True if a raster is in memory only where rays need it.
pub(crate) fn is_paged(options: &LoadOptions, part: &PartRecipe) -> bool {
    let is_raster = matches!(part.loader, Loader::GeoTiff { .. });
    let can_be_paged = keeps_grid(part) && part.transform.on_ground == 0 && part.swaps.is_empty();
    is_raster && options.tiles.is_some() && !options.triangulate_rasters && can_be_paged
}

/// The system of a raster's coordinates as WKT, with the file that names it: if it has a code that is built
/// in, and coordinates are those of the scene, metres.
pub(crate) fn crs_of(files: &RasterFiles) -> Option<(String, PathBuf)> {
    if let RasterFiles::Virtual(raster) = files
        && let Some(text) = &raster.crs
    {
        let wkt = match System::of_wkt(text) {
            System::Epsg(code) => crs::wkt_of_epsg(code.into()).ok()?,
            _ => text.clone(),
        };
        let is_metric = keys::length_in(&wkt).is_none_or(|unit| unit.is_metre());
        return (is_metric && crs::is_wkt(&wkt)).then(|| (wkt, named(files).clone()));
    }
    let first = files.all().get(usize::from(matches!(files, RasterFiles::Virtual(_))))?;
    let code = tile::projected_epsg(first)?;
    Some((crs::wkt_of_epsg(code.into()).ok()?, first.clone()))
}

/// Appends a raster with one material: as a height field if it `keeps_grid`, else as triangles, which are the
/// same. Problems of the files are errors of the part.
pub(crate) fn load(
    scene: &mut SceneBuilder,
    part: &PartSource,
    files: &RasterFiles,
    material: u32,
    keeps_grid: bool,
) -> Result<()> {
    let Some(mosaic) = find(scene, part, files)? else { return Ok(()) };
    let path = named(files);
    scene.check_memory(mosaic.memory(keeps_grid), path)?;
    let unusable = |problem| Refusal::unusable(path.clone(), problem);
    let whole = mosaic.extent();
    let (heights, doubts) = match read_window(scene.options, &mosaic, whole, whole)? {
        Ok(found) => found,
        Err(refusal) => return refusal.report(scene, part, None),
    };
    warn_of(scene, part, path, doubts.warnings());
    let grid = mosaic.grid();
    if keeps_grid {
        let Some(field) = HeightField::new(grid, heights, scene.geometry.triangle_count()) else {
            return unusable(RasterError::TooLarge).report(scene, part, None);
        };
        if field.triangles() > 0 {
            let surface = scene.surface(part.index, material);
            scene.geometry.fields.push(field);
            scene.field_surfaces.push(surface);
            scene.add_field_colour(material, [mosaic.columns, mosaic.rows]);
        }
        return scene.check_counts();
    }
    let start = scene.end();
    if let Err(problem) = append_vertices(scene, &grid, &heights) {
        return unusable(problem).report(scene, part, None);
    }
    drop(heights);
    append_triangles(scene, &mosaic, start.vertices.start);
    let surface = scene.surface(part.index, material);
    scene.triangle_surfaces.resize(scene.geometry.triangles.len(), surface);
    let mut colours = MeshColours::default();
    if scene.has_texture(material) {
        let texel = |v: u32| {
            let (column, row) = (v as usize % mosaic.columns, v as usize / mosaic.columns);
            raster_texel([column, row], [mosaic.columns, mosaic.rows])
        };
        let triangles = &scene.geometry.triangles[start.triangles.start..];
        colours.texels = triangles.iter().map(|corners| corners.map(texel)).collect();
    }
    scene.finish_mesh(&start)?;
    scene.add_colours(start.triangles.start, colours);
    Ok(())
}

/// Finds the grid of a raster, and reports values that are read in an unexpected way. `None` if its files
/// cannot be used, which is an error of the part.
fn find(scene: &mut SceneBuilder, part: &PartSource, files: &RasterFiles) -> Result<Option<Mosaic>> {
    let mut warnings = Vec::new();
    scene.sources.extend_from_slice(files.all());
    let mosaic = match Mosaic::find(files, &mut warnings) {
        Ok(mosaic) => mosaic,
        Err((place, refusal)) => {
            refusal.report(scene, part, place.map(|place| *place))?;
            return Ok(None);
        }
    };
    for raster in &mosaic.rasters {
        let masks = raster.mask.iter().filter_map(|mask| Some(mask.file.as_ref()?.path().to_path_buf()));
        scene.sources.extend(masks);
        scene.sources.extend(georeference::world_file_of(raster.file.path()));
    }
    warn_of_files(scene, part, &mosaic);
    warn_of(scene, part, named(files), warnings);
    Ok(Some(mosaic))
}

/// Reports warnings about a raster.
fn warn_of(scene: &mut SceneBuilder, part: &PartSource, path: &Path, warnings: Vec<String>) {
    for warning in warnings {
        let place = part.place.cloned().unwrap_or_else(|| Place::of_file(path));
        scene.diagnostics.warn(Some(place), format!("{}: {warning}", path.display()));
    }
}

/// Reports the warnings about single files, of each kind the first one.
fn warn_of_files(scene: &mut SceneBuilder, part: &PartSource, mosaic: &Mosaic) {
    let mut all: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    let mut order = Vec::new();
    for (number, raster) in mosaic.rasters.iter().enumerate() {
        for warning in &raster.warnings {
            let of_kind = all.entry(warning).or_default();
            if of_kind.is_empty() {
                order.push(warning.as_str());
            }
            of_kind.push(number);
        }
    }
    for warning in order {
        let path = mosaic.rasters[all[warning][0]].file.path();
        let others = match all[warning].len() - 1 {
            0 => String::new(),
            1 => " (and of another file)".to_owned(),
            n => format!(" (and of {n} other files)"),
        };
        let place = part.place.cloned().unwrap_or_else(|| Place::of_file(path));
        scene.diagnostics.warn(Some(place), format!("{}: {warning}{others}", path.display()));
    }
}

impl Mosaic {
    /// Memory, bytes: of a height field, or of vertices and triangles; or of heights and the parts that are
    /// read at a time, if that is more.
    fn memory(&self, keeps_grid: bool) -> u64 {
        let parts = |tile: &Tile| self.raster_of(tile).parts(tile.window).len();
        let at_a_time = PARTS_PER_THREAD * rayon::current_num_threads();
        let of_tile = |tile: &Tile| {
            let parts = parts(tile).min(at_a_time) as u64;
            self.raster_of(tile).part_bytes().saturating_mul(parts)
        };
        let reading = self.tiles.iter().map(of_tile).max().unwrap_or(0);
        let each = if self.least_short().is_some() { size_of::<u16>() } else { size_of::<f32>() };
        let heights = (self.pixels() as u64).saturating_mul(each as u64);
        let kept = match keeps_grid {
            true => heights.saturating_add((self.pixels() as u64).saturating_mul(PYRAMID_BYTES)),
            false => memory_of(self.pixels(), self.triangles(), 0),
        };
        kept.max(heights.saturating_add(reading))
    }
}

/// Reads the numbers of a window of the grid; NaN for a pixel without data. Doubts about pixels beyond `own`
/// are not counted.
fn read_window(
    options: &LoadOptions,
    mosaic: &Mosaic,
    window: Window,
    own: Window,
) -> Result<std::result::Result<(Heights, Doubts), Refusal>> {
    let unusable = |problem| Refusal::unusable(mosaic.path(), problem);
    let mut heights = match mosaic.heights(window.pixels()) {
        Ok(heights) => heights,
        Err(problem) => return Ok(Err(unusable(problem))),
    };
    let mut doubts = Doubts::default();
    let (columns, rows) = (window.width - own.width, window.height - own.height);
    let right = Window { left: own.left + own.width, width: columns, ..window };
    let below = Window { top: own.top + own.height, height: rows, ..own };
    for tile in &mosaic.tiles {
        options.check_stop()?;
        for (area, is_own) in [(own, true), (right, false), (below, false)] {
            let Some(common) = area.intersection(&tile.target()) else { continue };
            let parts = mosaic.raster_of(tile).parts(tile.pixels_at(common));
            for wave in parts.chunks(PARTS_PER_THREAD * rayon::current_num_threads()) {
                let read: Vec<_> = wave.par_iter().map(|part| mosaic.read(tile, *part)).collect();
                for (part, found) in wave.iter().zip(read) {
                    let put = found.and_then(|(numbers, doubtful)| {
                        if is_own {
                            doubts.add(doubtful);
                        }
                        mosaic.put(tile, *part, &numbers, &mut heights, &window).map_err(unusable)
                    });
                    if let Err(refusal) = put {
                        return Ok(Err(refusal));
                    }
                }
            }
        }
    }
    Ok(Ok((heights, doubts)))
}

/// Appends one vertex per pixel, row by row.
fn append_vertices(
    scene: &mut SceneBuilder,
    grid: &HeightGrid,
    heights: &Heights,
) -> Result<(), RasterError> {
    let vertices = &mut scene.geometry.vertices;
    vertices.try_reserve_exact(heights.len())?;
    let vertex = |i: usize| grid.vertex(i % grid.columns, i / grid.columns, heights.get(i));
    vertices.par_extend((0..heights.len()).into_par_iter().map(vertex));
    Ok(())
}

/// Appends two triangles between each four pixels; triangles with a missing corner are omitted. Vertex
/// indices count from the raster's first vertex.
fn append_triangles(scene: &mut SceneBuilder, mosaic: &Mosaic, first_vertex: usize) {
    let columns = mosaic.columns;
    // Growth by doubling would exceed the stated memory. If the reservation fails, growth may still succeed.
    let _ = scene.geometry.triangles.try_reserve_exact(mosaic.triangles());
    let vertices = &scene.geometry.vertices[first_vertex..];
    let exists = |v: usize| !vertices[v].z.is_nan();
    let between = |row: usize| {
        let mut triangles = Vec::with_capacity(2 * (columns - 1));
        for a in row * columns..row * columns + columns - 1 {
            let (b, c, d) = (a + columns, a + columns + 1, a + 1);
            for corners in [[a, b, d], [b, c, d]] {
                if corners.iter().all(|&v| exists(v)) {
                    triangles.push(corners.map(|v| v as u32));
                }
            }
        }
        triangles
    };
    let rows: Vec<usize> = (0..mosaic.rows - 1).collect();
    for wave in rows.chunks(PARTS_PER_THREAD * rayon::current_num_threads()) {
        let made: Vec<Vec<[u32; 3]>> = wave.par_iter().map(|&row| between(row)).collect();
        made.into_iter().for_each(|mut t| scene.geometry.triangles.append(&mut t));
    }
}
