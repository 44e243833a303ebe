//! Terrain from a raster (spec input-formats §4.3): one vertex at the centre of each pixel, two triangles between each
//! four pixels.

mod georeference;
#[cfg(test)]
mod tests;

use super::builder::{MAX_COORDINATE, MAX_ELEMENTS, PartSource, SceneBuilder, format_bytes, memory_of};
use super::text::Source;
use crate::error::Result;
use crate::geom::DVec3;
use crate::survey::{Loader, SceneRecipe};
use georeference::Georeference;
use rayon::prelude::*;
use std::io::Cursor;
use std::path::PathBuf;
use tiff::TiffError;
use tiff::decoder::{ChunkType, Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

/// Maximum compression ratio of LZW, whose codes of 12 bits stand for at most 3840 bytes, and of Deflate. A raster or
/// block that states more pixels is damaged.
const MAX_COMPRESSION_RATIO: u64 = 3000;
const MAX_DEFLATE_RATIO: u64 = 1040;

/// Maximum number of pixels of a block that is larger than four times its raster.
const MAX_BLOCK_PIXELS: u64 = 1 << 22;

/// No-data value of rasters that state none (spec input-formats §4.3).
const DEFAULT_NO_DATA: f64 = -1e10;

/// Blocks or rows per thread that are decoded before they are appended; limits the memory held twice.
const BLOCKS_PER_THREAD: usize = 8;

/// The size of a raster and the memory of its triangles without their tree.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RasterNeed {
    pub path: PathBuf,
    /// Number of pixels from west to east.
    pub columns: usize,
    /// Number of pixels from north to south.
    pub rows: usize,
    /// Number of triangles if no pixel is without data.
    pub triangles: u64,
    /// Memory of the triangles in the scene, or of decoding if that is more, if no pixel is without data.
    pub bytes: u64,
}

/// The sizes of the rasters of a scene, from their headers. Damaged rasters are omitted; the loader reports them.
pub fn raster_needs(recipe: &SceneRecipe) -> Vec<RasterNeed> {
    let parts = recipe.parts.iter().filter(|_| recipe.packed.is_none());
    let files = parts.filter_map(|part| match &part.loader {
        Loader::GeoTiff { file, .. } => Some(file),
        _ => None,
    });
    let need = |path: &PathBuf| {
        let raster = describe(&Source::open(path).ok()?, &mut Vec::new()).ok()?;
        Some(RasterNeed {
            path: path.clone(),
            columns: raster.columns,
            rows: raster.rows,
            triangles: raster.triangles() as u64,
            bytes: raster.memory(),
        })
    };
    files.filter_map(need).collect()
}

/// EPSG code of a raster's projected system, if its keys name one.
pub(super) fn projected_epsg(source: &Source) -> Option<u16> {
    let mut decoder = Decoder::new(Cursor::new(source.bytes())).ok()?;
    georeference::projected_epsg(&mut decoder)
}

/// The validated description of a raster.
struct Raster {
    columns: usize,
    rows: usize,
    /// Columns and rows of a strip or tile.
    block: (usize, usize),
    /// Bytes of a pixel with all bands.
    pixel_bytes: u64,
    /// Size of each block in the file, bytes; 0 for a sparse block.
    block_bytes: Vec<u64>,
    georeference: Georeference,
    no_data: f64,
    limits: Limits,
}

/// Appends a raster's triangles, all with one material. Problems of the file are errors of the part.
pub(super) fn load(
    scene: &mut SceneBuilder,
    part: &PartSource,
    source: &Source,
    material: u32,
) -> Result<()> {
    let mut warnings = Vec::new();
    let raster = match describe(source, &mut warnings) {
        Ok(raster) => raster,
        Err(problem) => return refuse(scene, part, source, &problem),
    };
    for warning in warnings {
        scene.diagnostics.warn(part.place.cloned(), format!("{}: {warning}", source.path().display()));
    }
    if raster.triangles().max(raster.pixels()) > MAX_ELEMENTS {
        return refuse(scene, part, source, "it has more pixels than can be numbered");
    }
    scene.check_memory(raster.memory(), source.path())?;
    let start = scene.end();
    if let Err(problem) = append_vertices(scene, source, &raster) {
        scene.geometry.vertices.truncate(start.vertices.start);
        return refuse(scene, part, source, &problem);
    }
    append_triangles(scene, &raster, start.vertices.start);
    let surface = scene.surface(part.index, material);
    scene.triangle_surfaces.resize(scene.geometry.triangles.len(), surface);
    scene.finish_mesh(&start)
}

fn refuse(scene: &mut SceneBuilder, part: &PartSource, source: &Source, problem: &str) -> Result<()> {
    let message = format!("cannot read the raster {}: {problem}", source.path().display());
    scene.diagnostics.error(part.place.cloned(), message).help(
        "strips or tiles of any number type, not compressed or with Deflate or LZW, are read; \
         \"gdal_translate -co COMPRESS=DEFLATE\" makes such a file",
    );
    Ok(())
}

impl Raster {
    fn pixels(&self) -> usize {
        self.columns.saturating_mul(self.rows)
    }

    /// Memory, bytes: of vertices and triangles, or of vertices and the blocks that are decoded at a time, with their
    /// samples and their heights.
    fn memory(&self) -> u64 {
        let block = self.block.0.saturating_mul(self.block.1) as u64;
        let at_a_time = (BLOCKS_PER_THREAD * rayon::current_num_threads()).min(self.block_bytes.len()) as u64;
        let decoding =
            block.saturating_mul(self.pixel_bytes + size_of::<f64>() as u64).saturating_mul(at_a_time);
        let vertices = memory_of(self.pixels(), 0, 0);
        memory_of(self.pixels(), self.triangles(), 0).max(vertices.saturating_add(decoding))
    }

    fn triangles(&self) -> usize {
        (self.columns - 1).saturating_mul(self.rows - 1).saturating_mul(2)
    }
}

fn describe(source: &Source, warnings: &mut Vec<String>) -> Result<Raster, String> {
    let mut decoder = Decoder::new(Cursor::new(source.bytes())).map_err(readable)?;
    let mut limits = Limits::default();
    limits.ifd_value_size = limits.ifd_value_size.max(source.bytes().len());
    decoder = decoder.with_limits(limits.clone());
    let (width, height) = decoder.dimensions().map_err(readable)?;
    let (columns, rows) = (width as usize, height as usize);
    if columns == 0 || rows == 0 {
        return Err(format!("it has {width} x {height} pixels"));
    }
    let bits =
        decoder.find_tag_unsigned_vec::<u64>(Tag::BitsPerSample).map_err(readable)?.unwrap_or_default();
    let per_pixel = bits.iter().sum::<u64>().max(1).div_ceil(8);
    let pixels = u64::from(width).saturating_mul(u64::from(height));
    let bytes = pixels.saturating_mul(per_pixel);
    let held = source.bytes().len() as u64;
    if bytes > held.saturating_mul(MAX_COMPRESSION_RATIO) {
        let (stated, held) = (format_bytes(bytes), format_bytes(held));
        return Err(format!("its {width} x {height} pixels ({stated}) cannot be in a file of {held}"));
    }
    let (block_width, block_height) = decoder.chunk_dimensions();
    let block_pixels = u64::from(block_width).saturating_mul(u64::from(block_height));
    if block_pixels > MAX_BLOCK_PIXELS.max(pixels.saturating_mul(4)) {
        return Err(format!(
            "its strips or tiles of {block_width} x {block_height} pixels are larger than itself"
        ));
    }
    let bytes = usize::try_from(bytes).unwrap_or(usize::MAX);
    limits.decoding_buffer_size = limits.decoding_buffer_size.max(bytes);
    limits.intermediate_buffer_size = limits.intermediate_buffer_size.max(bytes);
    let block = ((block_width as usize).min(columns), (block_height as usize).min(rows));
    if block.0 == 0 || block.1 == 0 {
        return Err("its strips or tiles have no pixels".to_owned());
    }
    let tag = match decoder.get_chunk_type() {
        ChunkType::Strip => Tag::StripByteCounts,
        ChunkType::Tile => Tag::TileByteCounts,
    };
    let block_bytes: Vec<u64> = decoder.find_tag_unsigned_vec(tag).map_err(readable)?.unwrap_or_default();
    let blocks = columns.div_ceil(block.0).saturating_mul(rows.div_ceil(block.1));
    if block_bytes.len() < blocks {
        return Err("it has fewer strips or tiles than its size asks for".to_owned());
    }
    let (whole, rest) = (block.0.saturating_mul(block.1), rows % block.1);
    let last = if rest > 0 && tag == Tag::StripByteCounts { block.0.saturating_mul(rest) } else { whole };
    let compression = decoder.find_tag_unsigned::<u16>(Tag::Compression).map_err(readable)?.unwrap_or(1);
    let ratio = match compression {
        1 => 1,
        8 | 32_946 => MAX_DEFLATE_RATIO,
        _ => MAX_COMPRESSION_RATIO,
    };
    // Each band can have its own blocks, so a block holds at least one band.
    let least = |pixels: usize| (pixels as u64).saturating_mul(bits.first().copied().unwrap_or(1)) / 8;
    let is_short = |(i, &bytes): (usize, &u64)| {
        bytes > 0 && bytes.saturating_mul(ratio) < least(if (i + 1) % blocks == 0 { last } else { whole })
    };
    if let Some(i) = block_bytes.iter().enumerate().position(is_short) {
        return Err(format!("its block {i} of {} bytes is shorter than its pixels", block_bytes[i]));
    }
    let georeference = georeference::read(&mut decoder, source.path())?.unwrap_or_else(|| {
        warnings.push("it does not say where it lies; pixels of 1 m from the origin are assumed".to_owned());
        Georeference { origin: (0.5, 0.5), step: (1.0, 1.0) }
    });
    if georeference::is_geographic(&mut decoder, &georeference) {
        let ((x0, y0), far) = (georeference.origin, georeference.centre(columns - 1, rows - 1, 0.0));
        warnings.push(format!(
            "its coordinates are degrees (longitude {x0:.4} to {:.4}, latitude {y0:.4} to {:.4}), which are taken as metres; \
             project it first: gdalwarp -t_srs EPSG:32632 in.tif out.tif, with the code of its zone",
            far.x, far.y
        ));
    }
    if !georeference.is_near(columns, rows) {
        return Err(format!("it reaches beyond {MAX_COORDINATE:e} m, where coordinates cannot be computed"));
    }
    let no_data = georeference::no_data(&mut decoder).unwrap_or_else(|problem| {
        warnings.push(problem);
        None
    });
    let no_data = no_data.unwrap_or(DEFAULT_NO_DATA);
    Ok(Raster { columns, rows, block, pixel_bytes: per_pixel, block_bytes, georeference, no_data, limits })
}

fn readable(e: TiffError) -> String {
    e.to_string()
}

/// Appends one vertex per pixel, row by row; the height of a pixel without data is NaN.
fn append_vertices(scene: &mut SceneBuilder, source: &Source, raster: &Raster) -> Result<(), String> {
    let first = scene.geometry.vertices.len();
    let vertices = scene.geometry.vertices.to_mut();
    vertices.try_reserve_exact(raster.pixels()).map_err(|e| e.to_string())?;
    vertices.resize(first + raster.pixels(), DVec3::NAN);
    let across = raster.columns.div_ceil(raster.block.0);
    let blocks: Vec<usize> = (0..across * raster.rows.div_ceil(raster.block.1)).collect();
    for wave in blocks.chunks(BLOCKS_PER_THREAD * rayon::current_num_threads()) {
        let decoded: Vec<Result<Vec<f64>, String>> = wave
            .par_iter()
            .map_init(|| open(source, raster), |decoder, &b| heights(decoder, raster, b))
            .collect();
        for (block, heights) in wave.iter().zip(decoded) {
            let heights = heights?;
            let (left, top) = (block % across * raster.block.0, block / across * raster.block.1);
            let width = raster.block.0.min(raster.columns - left);
            for (row, heights) in (top..).zip(heights.chunks_exact(width)) {
                let at = first + row * raster.columns + left;
                for ((column, vertex), &z) in (left..).zip(&mut vertices[at..at + width]).zip(heights) {
                    *vertex = raster.georeference.centre(column, row, z);
                }
            }
        }
    }
    Ok(())
}

type BlockDecoder<'a> = Result<Decoder<Cursor<&'a [u8]>>, String>;

fn open<'a>(source: &'a Source, raster: &Raster) -> BlockDecoder<'a> {
    let decoder = Decoder::new(Cursor::new(source.bytes())).map_err(readable)?;
    Ok(decoder.with_limits(raster.limits.clone()))
}

/// The first band of a block, row by row; pixels without data become NaN.
fn heights(decoder: &mut BlockDecoder, raster: &Raster, block: usize) -> Result<Vec<f64>, String> {
    let decoder = decoder.as_mut().map_err(|e| e.clone())?;
    let across = raster.columns.div_ceil(raster.block.0);
    let width = raster.block.0.min(raster.columns - block % across * raster.block.0);
    let height = raster.block.1.min(raster.rows - block / across * raster.block.1);
    if raster.block_bytes[block] == 0 {
        return Ok(vec![f64::NAN; width * height]);
    }
    let data = decoder.read_chunk(block as u32).map_err(readable)?;
    let mut no_data = raster.no_data;
    let values: Vec<f64> = match data {
        DecodingResult::U8(v) => v.into_iter().map(f64::from).collect(),
        DecodingResult::U16(v) => v.into_iter().map(f64::from).collect(),
        DecodingResult::U32(v) => v.into_iter().map(f64::from).collect(),
        DecodingResult::U64(v) => v.into_iter().map(|v| v as f64).collect(),
        DecodingResult::I8(v) => v.into_iter().map(f64::from).collect(),
        DecodingResult::I16(v) => v.into_iter().map(f64::from).collect(),
        DecodingResult::I32(v) => v.into_iter().map(f64::from).collect(),
        DecodingResult::I64(v) => v.into_iter().map(|v| v as f64).collect(),
        DecodingResult::F16(v) => v.into_iter().map(|v| v.to_f64()).collect(),
        DecodingResult::F32(v) => {
            // The tag is decimal text; it denotes the nearest value that a pixel can have.
            no_data = f64::from(no_data as f32);
            v.into_iter().map(f64::from).collect()
        }
        DecodingResult::F64(v) => v,
    };
    let bands = values.len() / (width * height);
    if bands == 0 {
        return Err(format!("block {block} is shorter than its {width} x {height} pixels"));
    }
    let is_height = |z: f64| z.abs() <= MAX_COORDINATE && (no_data.is_nan() || (z - no_data).abs() >= 1e-7);
    Ok(values.into_iter().step_by(bands).map(|z| if is_height(z) { z } else { f64::NAN }).collect())
}

/// Appends two triangles between each four pixels; triangles with a missing corner are omitted. Vertex indices count
/// from the raster's first vertex.
fn append_triangles(scene: &mut SceneBuilder, raster: &Raster, first_vertex: usize) {
    let columns = raster.columns;
    // Growth by doubling would exceed the stated memory. If the reservation fails, growth may still succeed.
    let _ = scene.geometry.triangles.to_mut().try_reserve_exact(raster.triangles());
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
    let rows: Vec<usize> = (0..raster.rows - 1).collect();
    for wave in rows.chunks(BLOCKS_PER_THREAD * rayon::current_num_threads()) {
        let made: Vec<Vec<[u32; 3]>> = wave.par_iter().map(|&row| between(row)).collect();
        made.into_iter().for_each(|mut t| scene.geometry.triangles.append(&mut t));
    }
}
