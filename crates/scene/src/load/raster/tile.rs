//! One raster: the file's description of its pixels, and the numbers in a window.

use super::blocks::{Blocks, Window};
use super::error::{GridError, RasterError};
use super::file::{Directory, OpenFile, RasterFile};
use super::georeference::{self, Georeference};
use super::keys::{self, BandMetadata, LengthUnit, METRES, System};
use super::refusal::Refusal;
use super::validity::{self, Doubts, Mask, NoData};
use crate::builder::MAX_COORDINATE;
use std::path::Path;
use tiff::decoder::{Decoder, Limits};
use tiff::tags::Tag;
use vlscan_base::recognise::{Expected, foreign, recognise};

/// Photometric interpretation of images whose numbers are colours.
const PALETTE: u64 = 3;
/// Number of bytes of a file by which formats are distinguished.
const START_BYTES: usize = 1 << 10;
/// How to convert a raster that cannot be read.
pub(super) const HELP: &str = "strips or tiles of any number type, not compressed or with Deflate, LZW, \
                               ZSTD, LERC or PackBits, are read; gdal_translate -co COMPRESS=DEFLATE in.tif \
                               out.tif makes such a file";

/// A raster as its file describes it.
#[derive(Debug)]
pub(super) struct Raster {
    pub file: RasterFile,
    pub blocks: Blocks,
    /// Placement of its pixels, in the unit of its coordinates; `None` without one.
    pub georeference: Option<Georeference>,
    pub system: System,
    /// True if its coordinates are longitudes and latitudes.
    pub is_geographic: bool,
    /// Units of coordinates and of heights.
    pub units: [Option<LengthUnit>; 2],
    pub band: BandMetadata,
    /// Number that stands for no data.
    pub no_data: Option<f64>,
    /// The band with the opacity of the pixels.
    alpha: Option<usize>,
    pub mask: Option<Mask>,
    /// Values that are read in an unexpected way.
    pub warnings: Vec<String>,
}

impl Raster {
    /// Reads the description of a raster.
    pub fn find(path: &Path) -> Result<Raster, Refusal> {
        let (file, open) = RasterFile::find(path).map_err(|e| refused(path, e))?;
        describe(file, &open).map_err(|problem| {
            let start = open.start(START_BYTES).unwrap_or_default();
            let help = foreign(path, &start, &Expected::RASTER).map_or_else(String::new, |found| found.help);
            let help = if help.is_empty() { HELP.to_owned() } else { help };
            Refusal::Unusable(path.to_path_buf(), Box::new(problem), help.into())
        })
    }

    /// The numbers of a window of one band, row by row, with NaN for pixels without data. Sources of doubt
    /// are counted. `scaled` computes the height of a number.
    pub fn numbers(
        &self,
        window: Window,
        band: usize,
        no_data: &NoData,
        scaled: impl Fn(f64) -> f64,
    ) -> Result<(Vec<f64>, Doubts), RasterError> {
        let open = self.file.open()?;
        let bands: Vec<usize> = [Some(band), self.alpha].into_iter().flatten().collect();
        let (mut all, mut doubts) = (vec![f64::NAN; window.pixels()], Doubts::default());
        for block in self.blocks.within(window) {
            let Some(found) = self.blocks.decode(&open, block, &bands)? else { continue };
            each_common(&window, &self.blocks.extent(block), |to, from| {
                let number = found[0][from];
                let is_visible = found.get(1).is_none_or(|alpha| alpha[from] != 0.0);
                if is_visible && no_data.is_height(number, &mut doubts) {
                    let height = scaled(number);
                    if height.abs() <= MAX_COORDINATE {
                        all[to] = number;
                    }
                }
            });
        }
        let Some(mask) = &self.mask else { return Ok((all, doubts)) };
        let mask_file = mask.file.as_ref().map(RasterFile::open).transpose()?;
        for block in mask.blocks.within(window) {
            let found = mask.blocks.decode(mask_file.as_ref().unwrap_or(&open), block, &[0]);
            let found = found.map_err(|e| RasterError::Mask { file: None, source: Box::new(e) })?;
            each_common(&window, &mask.blocks.extent(block), |to, from| {
                if found.as_ref().is_none_or(|bands| bands[0][from] == 0.0) {
                    all[to] = f64::NAN;
                }
            });
        }
        Ok((all, doubts))
    }

    /// Divides a window into parts to be read one by one, so that blocks of few pixels are read together and
    /// few blocks are read more than once.
    pub fn parts(&self, window: Window) -> Vec<Window> {
        let (mut width, mut height) = self.blocks.size;
        if self.mask.as_ref().is_some_and(|mask| mask.blocks.size != self.blocks.size) {
            // Blocks of the mask may reach beyond those of the heights.
            width = self.blocks.columns;
            height = height.max(self.mask.as_ref().map_or(0, |mask| mask.blocks.size.1));
        }
        height *= (MIN_PART_PIXELS / width.saturating_mul(height).max(1)).max(1);
        let columns = (window.left / width..(window.left + window.width).div_ceil(width)).map(|n| n * width);
        let rows = (window.top / height..(window.top + window.height).div_ceil(height)).map(|n| n * height);
        rows.flat_map(|top| columns.clone().map(move |left| Window { left, top, width, height }))
            .filter_map(|part| part.intersection(&window))
            .collect()
    }

    /// Number of bands in addition to heights and opacity.
    pub fn other_bands(&self) -> usize {
        self.blocks.bands - 1 - usize::from(self.alpha.is_some())
    }

    /// Memory for reading one of the [`Raster::parts`], bytes.
    pub fn part_bytes(&self) -> u64 {
        let (width, height) = self.blocks.size;
        let pixels = (width as u64).saturating_mul(height as u64).max(MIN_PART_PIXELS as u64);
        let pixels = pixels.min((self.blocks.columns as u64).saturating_mul(self.blocks.rows as u64).max(1));
        self.blocks.decoding_bytes().saturating_add(pixels.saturating_mul(size_of::<f64>() as u64))
    }
}

/// Minimum number of pixels that are read together, if the raster has that many.
const MIN_PART_PIXELS: usize = 1 << 17;

/// Visits the pixels that two windows have in common with their indices in both.
fn each_common(one: &Window, other: &Window, mut visit: impl FnMut(usize, usize)) {
    let Some(common) = one.intersection(other) else { return };
    for row in common.top..common.top + common.height {
        let start = |of: &Window| (row - of.top) * of.width + common.left - of.left;
        let (to, from) = (start(one), start(other));
        (0..common.width).for_each(|n| visit(to + n, from + n));
    }
}

/// Why a file was not opened: a mistake in a grid of text, or the error of the system.
fn refused(path: &Path, error: std::io::Error) -> Refusal {
    match error.downcast::<GridError>() {
        Ok(problem) => Refusal::unusable(path.to_path_buf(), problem.into()),
        Err(error) => Refusal::Unread(path.to_path_buf(), error),
    }
}

fn is_tiff(bytes: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|start| bytes.starts_with(*start))
}

/// The directories of a file, at its first image.
fn directory<'a>(path: &Path, open: &'a OpenFile) -> Result<Directory<'a>, RasterError> {
    let start = open.start(START_BYTES)?;
    if start.is_empty() {
        return Err(RasterError::Empty);
    }
    if !is_tiff(&start) {
        return Err(RasterError::Foreign { found: recognise(path, &start).name });
    }
    let mut limits = Limits::default();
    limits.ifd_value_size = limits.ifd_value_size.max(usize::try_from(open.length()).unwrap_or(usize::MAX));
    Ok(Decoder::new(open.reader())?.with_limits(limits))
}

/// EPSG code of a raster's projected system, if its keys name one and its coordinates are those of the scene:
/// metres.
pub(super) fn projected_epsg(path: &Path) -> Option<u16> {
    let (_, open) = RasterFile::find(path).ok()?;
    let mut directory = directory(path, &open).ok()?;
    let unit = keys::horizontal_unit(&mut directory, path).ok().flatten();
    keys::projected_epsg(&mut directory).filter(|_| unit.is_none_or(|unit| unit.is_metre()))
}

fn describe(file: RasterFile, open: &OpenFile) -> Result<Raster, RasterError> {
    let mut warnings = Vec::new();
    let mut directory = directory(file.path(), open)?;
    let held = open.length();
    let blocks = Blocks::read(&mut directory, held)?;
    let georeference = georeference::read(&mut directory, file.path())?;
    let is_geographic = georeference.unwrap_or(Georeference::UNKNOWN).is_geographic(&mut directory);
    let mut accept = |found: Result<Option<LengthUnit>, RasterError>, used: &str| {
        found.unwrap_or_else(|problem| {
            warnings.push(format!("{problem}; it is taken as {used}"));
            None
        })
    };
    let band = keys::band_metadata(&mut directory)?;
    let horizontal = match is_geographic {
        true => None,
        false => accept(keys::horizontal_unit(&mut directory, file.path()), METRES),
    };
    let used = horizontal.as_ref().map_or(METRES, |unit| &unit.name);
    let vertical = accept(keys::vertical_unit(&mut directory, file.path(), &band), used);
    if let Some(system) = keys::system_of_depths(&mut directory, file.path()) {
        warnings.push(format!(
            "its heights are in a system of depths ({system}), whose numbers grow downwards, and are taken \
             as heights, which grow upwards; if they are depths, `gdal_calc.py -A in.tif --calc=-A \
             --outfile=out.tif` makes heights of them, and `gdal_edit.py -a_srs EPSG:25832 out.tif`, with \
             the code of its system, names a system without depths"
        ));
    }
    let no_data = keys::no_data(&mut directory).unwrap_or_else(|problem| {
        warnings.push(problem.to_string());
        None
    });
    let alpha = validity::alpha_band(&mut directory, blocks.bands).unwrap_or_else(|problem| {
        warnings.push(format!("{problem}; all its pixels are taken as opaque"));
        None
    });
    let photometric = directory.find_tag_unsigned::<u64>(Tag::PhotometricInterpretation).ok().flatten();
    if photometric == Some(PALETTE) {
        warnings.push("its pixels are numbers of colours, which are taken as heights".to_owned());
    }
    let system = System::of(&mut directory, file.path())?;
    let mask = Mask::find(&mut directory, file.path(), held, &blocks)?;
    let units = [horizontal, vertical];
    Ok(Raster {
        file,
        blocks,
        georeference,
        system,
        is_geographic,
        units,
        band,
        no_data,
        alpha,
        mask,
        warnings,
    })
}
