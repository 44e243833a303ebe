//! Terrain from a raster (spec input-formats §4.3): one vertex at the centre of each pixel, two triangles between each
//! four pixels. They are a height field unless the part moves, turns, changes its size or has materials by face; then they are
//! stored.
//!
//! | file | what it does |
//! |---|---|
//! | `blocks`, `unpack` | strips and tiles: predictors and types of numbers; compressions |
//! | `georeference` | where the pixels are, from tags or a world file |
//! | `keys` | GeoKeys and GDAL's metadata: systems, units, scales |
//! | `validity` | no-data values, masks, alpha bands |

mod blocks;
#[cfg(test)]
mod field_tests;
mod georeference;
mod keys;
#[cfg(test)]
mod tests;
mod unpack;
mod validity;

use crate::builder::{MAX_COORDINATE, MAX_ELEMENTS, PartSource, SceneBuilder, memory_of};
use crate::text::Source;
use blocks::{Blocks, Directory, readable};
use georeference::Georeference;
use keys::{BandMetadata, LengthUnit};
use rayon::prelude::*;
use std::io::Cursor;
use std::path::PathBuf;
use tiff::decoder::{Decoder, Limits};
use tiff::tags::Tag;
use validity::{Doubts, Mask, NoData};
use vlscan_base::diag::Place;
use vlscan_base::error::Result;
use vlscan_geom::Rotation;
use vlscan_survey::{Loader, PartRecipe, Replaced, SceneRecipe, Transform, foreign_format};
use vlscan_trace::{HeightField, HeightGrid, Heights};

/// Blocks or rows per thread that are decoded before they are appended; limits the memory held twice.
const BLOCKS_PER_THREAD: usize = 8;
/// The unit of what states none.
const METRES: &str = "metres";
/// Memory of the pyramid over a height field, bytes per pixel, rounded up.
const PYRAMID_BYTES: u64 = 2;
/// What is wrong with a raster that is too large.
const TOO_MANY: &str = "it has more pixels than can be numbered";
/// Photometric interpretation of images whose numbers are those of colours.
const PALETTE: u64 = 3;

/// The size of a raster and its memory without a tree.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RasterNeed {
    pub path: PathBuf,
    /// Number of pixels from west to east.
    pub columns: usize,
    /// Number of pixels from north to south.
    pub rows: usize,
    /// Number of triangles if no pixel is without data.
    pub triangles: u64,
    /// Whether it is a height field: its triangles are not stored, and need no tree.
    pub is_field: bool,
    /// Memory in the scene, or of decoding if that is more, if no pixel is without data.
    pub bytes: u64,
}

/// The sizes of the rasters of a scene, from their headers. Damaged rasters are omitted; the loader reports them.
pub fn raster_needs(recipe: &SceneRecipe) -> Vec<RasterNeed> {
    let parts = recipe.parts.iter().filter(|_| recipe.packed.is_none());
    let files = parts.filter_map(|part| match &part.loader {
        Loader::GeoTiff { file, .. } => Some((file, keeps_grid(part))),
        _ => None,
    });
    let need = |(path, is_field): (&PathBuf, bool)| {
        let raster = describe(&Source::open(path).ok()?, &mut Vec::new()).ok()?;
        Some(RasterNeed {
            path: path.clone(),
            columns: raster.blocks.columns,
            rows: raster.blocks.rows,
            triangles: raster.triangles() as u64,
            is_field,
            bytes: raster.memory(is_field),
        })
    };
    files.filter_map(need).collect()
}

/// Whether a raster can remain a height field: its triangles neither move nor turn nor change their size, and have one
/// material.
pub(crate) fn keeps_grid(part: &PartRecipe) -> bool {
    let Transform { rotation, scale, .. } = part.transform;
    part.motions.is_empty()
        && (rotation, scale) == (Rotation::IDENTITY, 1.0)
        && !part.changes.iter().any(|change| matches!(change.replaced, Replaced::Faces(_)))
}

/// EPSG code of a raster's projected system, if its keys name one and its coordinates are those of the scene: metres.
pub(crate) fn projected_epsg(source: &Source) -> Option<u16> {
    let mut directory = open(source).ok()?;
    let unit = keys::horizontal_unit(&mut directory).ok().flatten();
    keys::projected_epsg(&mut directory).filter(|_| unit.is_none_or(|unit| unit.is_metre()))
}

/// The validated description of a raster.
struct Raster {
    blocks: Blocks,
    /// In metres.
    georeference: Georeference,
    no_data: NoData,
    /// The band that says how opaque a pixel is.
    alpha: Option<usize>,
    mask: Option<Mask>,
    /// Heights are number · scale + offset, m.
    scale: f64,
    offset: f64,
}

/// Appends a raster with one material: as a height field if it `keeps_grid`, else as triangles, which are the same. Problems of
/// the file are errors of the part.
pub(crate) fn load(
    scene: &mut SceneBuilder,
    part: &PartSource,
    source: &Source,
    material: u32,
    keeps_grid: bool,
) -> Result<()> {
    let mut warnings = Vec::new();
    let raster = match describe(source, &mut warnings) {
        Ok(raster) => raster,
        Err(problem) => return refuse(scene, part, source, &problem),
    };
    scene
        .sources
        .extend(raster.mask.iter().filter_map(|mask| Some(mask.file.as_ref()?.path().to_path_buf())));
    scene.sources.extend(georeference::world_file_of(source.path()));
    let warn = |scene: &mut SceneBuilder, warning: String| {
        let place = part.place.cloned().unwrap_or_else(|| Place::of_file(source.path()));
        scene.diagnostics.warn(Some(place), format!("{}: {warning}", source.path().display()));
    };
    warnings.into_iter().for_each(|warning| warn(scene, warning));
    if raster.triangles().max(raster.pixels()) > MAX_ELEMENTS {
        return refuse(scene, part, source, TOO_MANY);
    }
    scene.check_memory(raster.memory(keeps_grid), source.path())?;
    let (heights, doubts) = match read_heights(source, &raster) {
        Ok(found) => found,
        Err(problem) => return refuse(scene, part, source, &problem),
    };
    doubts.warnings().into_iter().for_each(|warning| warn(scene, warning));
    let grid = raster.grid();
    if keeps_grid {
        let Some(field) = HeightField::new(grid, heights, scene.geometry.triangle_count()) else {
            return refuse(scene, part, source, TOO_MANY);
        };
        if field.triangles() > 0 {
            let surface = scene.surface(part.index, material);
            scene.geometry.fields.push(field);
            scene.field_surfaces.push(surface);
        }
        return scene.check_counts();
    }
    let start = scene.end();
    if let Err(problem) = append_vertices(scene, &grid, &heights) {
        return refuse(scene, part, source, &problem);
    }
    drop(heights);
    append_triangles(scene, &raster, start.vertices.start);
    let surface = scene.surface(part.index, material);
    scene.triangle_surfaces.resize(scene.geometry.triangles.len(), surface);
    scene.finish_mesh(&start)
}

fn refuse(scene: &mut SceneBuilder, part: &PartSource, source: &Source, problem: &str) -> Result<()> {
    let message = format!("cannot read the raster {}: {problem}", source.path().display());
    let help = match other_format(source) {
        Some((_, help)) => help,
        None => {
            "strips or tiles of any number type, not compressed or with Deflate, LZW, ZSTD, LERC or PackBits, are read; \
             gdal_translate -co COMPRESS=DEFLATE in.tif out.tif makes such a file"
        }
    };
    scene.diagnostics.error(part.place.cloned(), message).help(help);
    Ok(())
}

impl Raster {
    fn pixels(&self) -> usize {
        self.blocks.columns.saturating_mul(self.blocks.rows)
    }

    /// Memory, bytes: of a height field, or of vertices and triangles; or of heights and the blocks that are decoded at a time,
    /// with their samples and their numbers, if that is more.
    fn memory(&self, keeps_grid: bool) -> u64 {
        let at_a_time = (BLOCKS_PER_THREAD * rayon::current_num_threads()).min(self.blocks.count()) as u64;
        let decoding = self.blocks.decoding_bytes().saturating_mul(at_a_time);
        let each = if self.blocks.least_short().is_some() { size_of::<u16>() } else { size_of::<f32>() };
        let heights = (self.pixels() as u64).saturating_mul(each as u64);
        let kept = match keeps_grid {
            true => heights.saturating_add((self.pixels() as u64).saturating_mul(PYRAMID_BYTES)),
            false => memory_of(self.pixels(), self.triangles(), 0),
        };
        kept.max(heights.saturating_add(decoding))
    }

    /// Positions of the pixels' centres as vertices.
    fn grid(&self) -> HeightGrid {
        let grid = self.georeference.grid(self.blocks.columns, self.blocks.rows);
        HeightGrid { scale: self.scale, offset: self.offset, ..grid }
    }

    fn triangles(&self) -> usize {
        (self.blocks.columns - 1).saturating_mul(self.blocks.rows - 1).saturating_mul(2)
    }
}

/// The format of a file that is not TIFF, and what to do with it.
fn other_format(source: &Source) -> Option<(&'static str, &'static str)> {
    let found = foreign_format(source.path(), source.bytes()).filter(|_| !is_tiff(source.bytes()));
    found.filter(|(name, _)| *name != "a TIFF raster")
}

fn is_tiff(bytes: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|start| bytes.starts_with(*start))
}

/// The directories of a file, at its first image.
fn open(source: &Source) -> Result<Directory<'_>, String> {
    let bytes = source.bytes();
    if bytes.is_empty() {
        return Err("the file is empty".to_owned());
    }
    if !is_tiff(bytes) {
        let found = other_format(source).map_or("bytes of another kind", |found| found.0);
        return Err(format!("expected a TIFF file, found {found}"));
    }
    let mut limits = Limits::default();
    limits.ifd_value_size = limits.ifd_value_size.max(bytes.len());
    Ok(Decoder::new(Cursor::new(bytes)).map_err(readable)?.with_limits(limits))
}

fn describe(source: &Source, warnings: &mut Vec<String>) -> Result<Raster, String> {
    let mut directory = open(source)?;
    let held = source.bytes().len();
    let blocks = Blocks::read(&mut directory, held)?;
    let georeference = georeference::read(&mut directory, source.path())?.unwrap_or_else(|| {
        warnings.push("it does not say where it lies; pixels of 1 m from the origin are assumed".to_owned());
        Georeference::UNKNOWN
    });
    let is_geographic = georeference.is_geographic(&mut directory);
    if is_geographic {
        let ((x0, y0), far) =
            (georeference.origin, georeference.centre(blocks.columns - 1, blocks.rows - 1, 0.0));
        warnings.push(format!(
            "its coordinates are degrees (longitude {x0:.4} to {:.4}, latitude {y0:.4} to {:.4}), which are taken as metres; \
             project it first: gdalwarp -t_srs EPSG:32632 in.tif out.tif, with the code of its zone",
            far.x, far.y
        ));
    }
    let mut accept = |found: Result<Option<LengthUnit>, String>, used: &str| {
        found.unwrap_or_else(|problem| {
            warnings.push(format!("{problem}; it is taken as {used}"));
            None
        })
    };
    let band = keys::band_metadata(&mut directory)?;
    let horizontal = match is_geographic {
        true => None,
        false => accept(keys::horizontal_unit(&mut directory), METRES),
    };
    let used = horizontal.as_ref().map_or(METRES, |unit| &unit.name);
    let vertical = accept(keys::vertical_unit(&mut directory, &band), used);
    if let Some(system) = keys::system_of_depths(&mut directory) {
        warnings.push(format!(
            "its heights are in a system of depths ({system}), whose numbers grow downwards, and are taken as heights, which \
             grow upwards; if they are depths, `gdal_calc.py -A in.tif --calc=-A --outfile=out.tif` makes heights of them, and \
             `gdal_edit.py -a_srs EPSG:25832 out.tif`, with the code of its system, names a system without depths"
        ));
    }
    let (horizontal, vertical) = units(horizontal, vertical, warnings);
    let georeference = georeference.scaled(horizontal);
    if !georeference.is_near(blocks.columns, blocks.rows) {
        return Err(format!("it reaches beyond {MAX_COORDINATE:e} m, where coordinates cannot be computed"));
    }
    let stated = keys::no_data(&mut directory).unwrap_or_else(|problem| {
        warnings.push(problem);
        None
    });
    let no_data = NoData::new(stated, blocks.are_single_precision());
    let alpha = validity::alpha_band(&mut directory, blocks.bands);
    warn_of_bands(&mut directory, &blocks, alpha, &band, warnings);
    let mask = Mask::find(&mut directory, source.path(), held, &blocks)?;
    let (scale, offset) = (band.scale * vertical, band.offset * vertical);
    Ok(Raster { blocks, georeference, no_data, alpha, mask, scale, offset })
}

/// The lengths of the units of coordinates and of heights, m. Heights without a unit have that of the coordinates.
fn units(
    horizontal: Option<LengthUnit>,
    vertical: Option<LengthUnit>,
    warnings: &mut Vec<String>,
) -> (f64, f64) {
    let is_foreign = |unit: &Option<LengthUnit>| unit.as_ref().is_some_and(|unit| !unit.is_metre());
    let metres = |unit: &Option<LengthUnit>| unit.as_ref().map_or(1.0, |unit| unit.metres);
    let name = |unit: &Option<LengthUnit>| unit.as_ref().map_or(METRES.to_owned(), |unit| unit.name.clone());
    let lengths = match (is_foreign(&horizontal), is_foreign(&vertical)) {
        (false, false) => return (1.0, 1.0),
        (false, true) => {
            warnings.push(format!(
                "its heights are {}, which are multiplied by {} to metres",
                name(&vertical),
                metres(&vertical)
            ));
            return (1.0, metres(&vertical));
        }
        (true, _) => (metres(&horizontal), metres(if vertical.is_some() { &vertical } else { &horizontal })),
    };
    let heights = match &vertical {
        Some(unit) => format!("its heights {}", unit.name),
        None => "so are its heights, whose unit it does not state".to_owned(),
    };
    warnings.push(format!(
        "its coordinates are {}, {heights}; x and y are multiplied by {}, z by {} to metres, so that flight and meshes must \
         be, too (gdalwarp -t_srs EPSG:... in.tif out.tif brings it into a system in metres)",
        name(&horizontal),
        lengths.0,
        lengths.1
    ));
    lengths
}

/// Warns of bands that are left out, of colours, and of numbers that are scaled.
fn warn_of_bands(
    directory: &mut Directory,
    blocks: &Blocks,
    alpha: Option<usize>,
    band: &BandMetadata,
    warnings: &mut Vec<String>,
) {
    let photometric = directory.find_tag_unsigned::<u64>(Tag::PhotometricInterpretation).ok().flatten();
    if photometric == Some(PALETTE) {
        warnings.push("its pixels are numbers of colours, which are taken as heights".to_owned());
    }
    let others = blocks.bands - 1 - usize::from(alpha.is_some());
    if others > 0 {
        warnings.push(format!("it has {} bands, of which the first is read as heights", blocks.bands));
    }
    if (band.scale, band.offset) != (1.0, 0.0) {
        let BandMetadata { scale, offset, .. } = band;
        warnings.push(format!("its numbers are taken times {scale} plus {offset}, as its metadata says"));
    }
}

/// Reads the numbers of all pixels; NaN for a pixel without data.
fn read_heights(source: &Source, raster: &Raster) -> Result<(Heights, Doubts), String> {
    let columns = raster.blocks.columns;
    let all = match raster.blocks.least_short() {
        Some(least) => Heights::short(least, raster.pixels()),
        None => Heights::single(raster.pixels()),
    };
    let mut all = all.map_err(|e| e.to_string())?;
    let bands: Vec<usize> = [Some(0), raster.alpha].into_iter().flatten().collect();
    let mut doubts = Doubts::default();
    for_each_block(
        &raster.blocks,
        |block| numbers(source, raster, &bands, block),
        |block, found| {
            let Some((numbers, doubtful)) = found else { return Ok(()) };
            doubts.add(doubtful);
            let (left, top, width, _) = raster.blocks.extent(block);
            let mut rows = (top..).zip(numbers.chunks_exact(width));
            rows.try_for_each(|(row, numbers)| {
                all.set(row * columns + left, numbers).map_err(|e| e.to_string())
            })
        },
    )?;
    let Some(mask) = &raster.mask else { return Ok((all, doubts)) };
    let file = mask.file.as_ref().unwrap_or(source).bytes();
    for_each_block(
        &mask.blocks,
        |block| mask.blocks.decode(file, block, &[0]).map_err(|e| format!("its mask: {e}")),
        |block, found| {
            let (left, top, width, height) = mask.blocks.extent(block);
            let has_data = found.map(|mut bands| bands.remove(0));
            for i in 0..width * height {
                if has_data.as_ref().is_none_or(|values| values[i] == 0.0) {
                    all.remove((top + i / width) * columns + left + i % width);
                }
            }
            Ok(())
        },
    )?;
    Ok((all, doubts))
}

/// Decodes the blocks of an image in parallel and passes them on in their order.
fn for_each_block<T: Send>(
    blocks: &Blocks,
    decode: impl Fn(usize) -> Result<T, String> + Sync,
    mut each: impl FnMut(usize, T) -> Result<(), String>,
) -> Result<(), String> {
    let all: Vec<usize> = (0..blocks.count()).collect();
    for wave in all.chunks(BLOCKS_PER_THREAD * rayon::current_num_threads()) {
        let decoded: Vec<_> = wave.par_iter().map(|&block| decode(block)).collect();
        for (&block, found) in wave.iter().zip(decoded) {
            each(block, found?)?;
        }
    }
    Ok(())
}

/// Numbers of a block, row by row, with NaN for pixels without data; `None` for a block that is left out.
type Numbers = Option<(Vec<f64>, Doubts)>;

fn numbers(source: &Source, raster: &Raster, bands: &[usize], block: usize) -> Result<Numbers, String> {
    let Some(mut bands) = raster.blocks.decode(source.bytes(), block, bands)? else { return Ok(None) };
    let alpha = (bands.len() > 1).then(|| bands.remove(1));
    let mut numbers = bands.remove(0);
    let mut doubts = Doubts::default();
    for (i, number) in numbers.iter_mut().enumerate() {
        let is_visible = alpha.as_ref().is_none_or(|alpha| alpha[i] != 0.0);
        let height = *number * raster.scale + raster.offset;
        let is_height = is_visible && raster.no_data.is_height(*number, &mut doubts);
        if !is_height || height.is_nan() || height.abs() > MAX_COORDINATE {
            *number = f64::NAN;
        }
    }
    Ok(Some((numbers, doubts)))
}

/// Appends one vertex per pixel, row by row.
fn append_vertices(scene: &mut SceneBuilder, grid: &HeightGrid, heights: &Heights) -> Result<(), String> {
    let vertices = &mut scene.geometry.vertices;
    vertices.try_reserve_exact(heights.len()).map_err(|e| e.to_string())?;
    let vertex = |i: usize| grid.vertex(i % grid.columns, i / grid.columns, heights.get(i));
    vertices.par_extend((0..heights.len()).into_par_iter().map(vertex));
    Ok(())
}

/// Appends two triangles between each four pixels; triangles with a missing corner are omitted. Vertex indices count
/// from the raster's first vertex.
fn append_triangles(scene: &mut SceneBuilder, raster: &Raster, first_vertex: usize) {
    let columns = raster.blocks.columns;
    // Growth by doubling would exceed the stated memory. If the reservation fails, growth may still succeed.
    let _ = scene.geometry.triangles.try_reserve_exact(raster.triangles());
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
    let rows: Vec<usize> = (0..raster.blocks.rows - 1).collect();
    for wave in rows.chunks(BLOCKS_PER_THREAD * rayon::current_num_threads()) {
        let made: Vec<Vec<[u32; 3]>> = wave.par_iter().map(|&row| between(row)).collect();
        made.into_iter().for_each(|mut t| scene.geometry.triangles.append(&mut t));
    }
}
