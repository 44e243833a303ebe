//! Validity of the pixels of a raster: no-data values, masks within the file or next to it, alpha bands.

use super::blocks::Blocks;
use super::error::RasterError;
use super::file::{Directory, RasterFile};
use crate::builder::MAX_COORDINATE;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use tiff::decoder::Decoder;
use tiff::tags::Tag;
use vlscan_base::files::reads;
use vlscan_survey::PixelType;

/// No-data value of rasters that state none (spec input-formats §4.3).
const DEFAULT_NO_DATA: f64 = -1e10;
/// Values that often stand for missing heights.
const COMMON_NO_DATA: [f64; 5] = [-9999.0, -99_999.0, -32_768.0, -32_767.0, 65_535.0];
/// Bit of the kind of an image that is a mask.
const IS_MASK: u64 = 4;
/// Photometric interpretation of masks.
const TRANSPARENCY_MASK: u64 = 4;
/// Maximum number of images of a file that are searched for a mask.
const MAX_IMAGES: usize = 64;

/// The mask of a raster: pixels where it is 0 have no data.
#[derive(Debug)]
pub(super) struct Mask {
    pub blocks: Blocks,
    /// The file next to the raster, if the mask is not within it.
    pub file: Option<RasterFile>,
}

impl Mask {
    /// The mask of the raster `path` of this size, after its first image or in the file next to it.
    pub fn find(
        directory: &mut Directory,
        path: &Path,
        held: u64,
        of: &Blocks,
    ) -> Result<Option<Mask>, RasterError> {
        for _ in 0..MAX_IMAGES {
            if !directory.more_images() || directory.next_image().is_err() {
                break;
            }
            let tag = |directory: &mut Directory, tag| directory.find_tag_unsigned::<u64>(tag).ok().flatten();
            let is_mask = tag(directory, Tag::NewSubfileType).is_some_and(|kind| kind & IS_MASK != 0)
                || tag(directory, Tag::PhotometricInterpretation) == Some(TRANSPARENCY_MASK);
            let size = directory.dimensions()?;
            if is_mask && (size.0 as usize, size.1 as usize) == (of.columns, of.rows) {
                let blocks = Blocks::read(directory, held)
                    .map_err(|e| RasterError::Mask { file: None, source: Box::new(e) })?;
                return Ok(Some(Mask { blocks, file: None }));
            }
        }
        Mask::in_sibling(path, of)
    }

    fn in_sibling(path: &Path, of: &Blocks) -> Result<Option<Mask>, RasterError> {
        let file = mask_file(path);
        if !reads::is_file(&file) {
            return Ok(None);
        }
        let wrong = |e: RasterError| RasterError::Mask { file: Some(file.clone()), source: Box::new(e) };
        let (found, open) = RasterFile::find(&file).map_err(|e| wrong(e.into()))?;
        let mut directory = Decoder::new(open.reader()).map_err(|e| wrong(e.into()))?;
        let blocks = Blocks::read(&mut directory, open.length()).map_err(wrong)?;
        if (blocks.columns, blocks.rows) != (of.columns, of.rows) {
            let (found, expected) = ((blocks.columns, blocks.rows), (of.columns, of.rows));
            return Err(wrong(RasterError::MaskSize { found, expected }));
        }
        Ok(Some(Mask { blocks, file: Some(found) }))
    }
}

/// The file next to a raster in which GDAL keeps its mask.
fn mask_file(path: &Path) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(".msk");
    PathBuf::from(name)
}

/// The band with the opacity of the pixels, according to the kinds of the bands after the colours.
pub(super) fn alpha_band(directory: &mut Directory, bands: usize) -> Result<Option<usize>, RasterError> {
    let tag = Tag::ExtraSamples;
    let kinds = directory.find_tag_unsigned_vec::<u16>(tag);
    let kinds = kinds.map_err(|source| RasterError::Tag { tag, source })?.unwrap_or_default();
    let at = kinds.iter().position(|kind| [1, 2].contains(kind));
    let band = at.and_then(|at| (bands - kinds.len().min(bands)).checked_add(at));
    Ok(band.filter(|band| (1..bands).contains(band)))
}

/// Rule that distinguishes heights from missing values.
#[derive(Clone, Debug)]
pub(super) struct NoData {
    values: Vec<f64>,
    is_stated: bool,
}

/// Pixels that are not heights, or hardly ever, in a file without a no-data value.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Doubts {
    /// Number of pixels beyond what can be a coordinate.
    beyond: usize,
    /// Number of pixels of each of the usual no-data values.
    common: [usize; COMMON_NO_DATA.len()],
}

impl NoData {
    /// The values that files state; they are decimal text and denote the nearest value that a pixel can have.
    pub fn new(stated: impl IntoIterator<Item = f64>, pixels: PixelType) -> NoData {
        let mut values: Vec<f64> = stated.into_iter().collect();
        let is_stated = !values.is_empty();
        if !is_stated {
            values.push(DEFAULT_NO_DATA);
        }
        if pixels == PixelType::Float(32) {
            values.iter_mut().for_each(|value| *value = f64::from(*value as f32));
        }
        values.dedup();
        NoData { values, is_stated }
    }

    /// True if a number is a height, before it is scaled. Doubtful ones are counted.
    pub fn is_height(&self, number: f64, doubts: &mut Doubts) -> bool {
        if number.is_nan() || self.values.iter().any(|value| (number - value).abs() < 1e-7) {
            return false;
        }
        if number.abs() > MAX_COORDINATE {
            doubts.beyond += 1;
            return false;
        }
        if !self.is_stated
            && let Some(i) = COMMON_NO_DATA.iter().position(|common| *common == number)
        {
            doubts.common[i] += 1;
        }
        true
    }
}

impl Doubts {
    pub fn add(&mut self, other: Doubts) {
        self.beyond += other.beyond;
        self.common.iter_mut().zip(other.common).for_each(|(count, more)| *count += more);
    }

    /// The warnings about them.
    pub fn warnings(&self) -> Vec<String> {
        let mut all = Vec::new();
        if self.beyond > 0 {
            all.push(format!(
                "{} pixels are beyond ±{MAX_COORDINATE:e} and are holes, although the file does not state \
                 them as no data",
                self.beyond
            ));
        }
        for (value, count) in COMMON_NO_DATA.iter().zip(self.common).filter(|(_, count)| *count > 0) {
            all.push(format!(
                "{count} pixels are {value}, which often means no data; the file states no such value, and \
                 they are taken as heights (gdal_edit.py -a_nodata {value} in.tif makes them holes)"
            ));
        }
        all
    }
}
