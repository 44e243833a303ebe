//! Sources of terrain rasters: files that are tiles of one grid, and virtual rasters.

use std::path::PathBuf;
use std::sync::Arc;
use vlscan_base::diag::Place;

/// The files of a terrain raster.
#[derive(Clone, Debug)]
pub enum RasterFiles {
    /// A raster, or several that are tiles of one grid; where they overlap, later ones count where they have
    /// data.
    Tiles(Vec<PathBuf>),
    /// A virtual raster of GDAL.
    Virtual(Arc<VirtualRaster>),
}

impl RasterFiles {
    /// All files; a virtual raster comes before its sources.
    pub fn all(&self) -> &[PathBuf] {
        match self {
            RasterFiles::Tiles(files) => files,
            RasterFiles::Virtual(raster) => &raster.files,
        }
    }
}

impl From<PathBuf> for RasterFiles {
    fn from(file: PathBuf) -> RasterFiles {
        RasterFiles::Tiles(vec![file])
    }
}

/// A virtual raster of GDAL (VRT): windows of files in one grid of pixels. Only its first band is described.
#[derive(Clone, Debug)]
pub struct VirtualRaster {
    /// The file itself, then the files of its sources, each once.
    pub files: Vec<PathBuf>,
    /// Number of columns and rows of pixels.
    pub size: [usize; 2],
    /// x = c₀ + c₁·column + c₂·row, y = c₃ + c₄·column + c₅·row for the corner of a pixel.
    pub geo_transform: Option<[f64; 6]>,
    /// The system of its coordinates, as WKT or as a code such as `EPSG:25832`.
    pub crs: Option<String>,
    /// Type of its numbers.
    pub pixels: PixelType,
    /// Number that stands for no data.
    pub no_data: Option<f64>,
    /// Heights are number · scale + offset.
    pub scale: Option<f64>,
    /// Offset of heights.
    pub offset: Option<f64>,
    /// Name of the unit of heights.
    pub unit: Option<String>,
    /// Number of bands in addition to the first one and one of opacity.
    pub other_bands: usize,
    /// Its sources; where they overlap, later ones count where they have data.
    pub sources: Vec<VirtualSource>,
}

/// A window of a file in a [`VirtualRaster`].
#[derive(Clone, Debug)]
pub struct VirtualSource {
    /// Index of its file in [`VirtualRaster::files`].
    pub file: usize,
    /// Number of the band, from 1.
    pub band: usize,
    /// First column and row, and number of columns and rows of the window in the file; `None` for the whole
    /// file.
    pub window: Option<[usize; 4]>,
    /// First column and row, and number of columns and rows in the virtual raster; `None` for all of it.
    pub target: Option<[usize; 4]>,
    /// Number that stands for no data in the file.
    pub no_data: Option<f64>,
    /// Place in the virtual raster.
    pub place: Place,
}

/// Type of the numbers of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelType {
    /// Unsigned integers with this many bits.
    Unsigned(u32),
    /// Signed integers with this many bits.
    Signed(u32),
    /// Floats with this many bits.
    Float(u32),
}

impl PixelType {
    /// The types by the names that GDAL gives them.
    pub const NAMES: [(&str, PixelType); 11] = [
        ("Byte", PixelType::Unsigned(8)),
        ("Int8", PixelType::Signed(8)),
        ("UInt16", PixelType::Unsigned(16)),
        ("Int16", PixelType::Signed(16)),
        ("UInt32", PixelType::Unsigned(32)),
        ("Int32", PixelType::Signed(32)),
        ("UInt64", PixelType::Unsigned(64)),
        ("Int64", PixelType::Signed(64)),
        ("Float16", PixelType::Float(16)),
        ("Float32", PixelType::Float(32)),
        ("Float64", PixelType::Float(64)),
    ];

    /// True if this type can represent every number of `other`.
    pub fn holds(self, other: PixelType) -> bool {
        // Digits of the significand, with the hidden one (IEEE 754).
        let digits = |bits: u32| match bits {
            16 => 11,
            32 => 24,
            _ => 53,
        };
        match (self, other) {
            (PixelType::Unsigned(own), PixelType::Unsigned(bits))
            | (PixelType::Signed(own), PixelType::Signed(bits))
            | (PixelType::Float(own), PixelType::Float(bits)) => own >= bits,
            (PixelType::Signed(own), PixelType::Unsigned(bits)) => own > bits,
            (PixelType::Float(own), PixelType::Unsigned(bits)) => digits(own) >= bits,
            (PixelType::Float(own), PixelType::Signed(bits)) => digits(own) >= bits - 1,
            (PixelType::Unsigned(_), _) | (PixelType::Signed(_), PixelType::Float(_)) => false,
        }
    }
}

/// The name that GDAL gives it.
impl std::fmt::Display for PixelType {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match PixelType::NAMES.iter().find(|(_, known)| known == self) {
            Some((name, _)) => f.write_str(name),
            None => match self {
                PixelType::Unsigned(bits) => write!(f, "UInt{bits}"),
                PixelType::Signed(bits) => write!(f, "Int{bits}"),
                PixelType::Float(bits) => write!(f, "Float{bits}"),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_hold_what_they_represent_exactly() {
        use PixelType::{Float, Signed, Unsigned};
        for (one, other, holds) in [
            (Unsigned(16), Unsigned(8), true),
            (Unsigned(8), Unsigned(16), false),
            (Signed(16), Unsigned(16), false),
            (Signed(32), Unsigned(16), true),
            (Unsigned(32), Signed(8), false),
            (Float(32), Signed(16), true),
            (Float(32), Signed(32), false),
            (Float(64), Signed(32), true),
            (Float(64), Float(32), true),
            (Float(32), Float(64), false),
            (Signed(64), Float(16), false),
        ] {
            assert_eq!(one.holds(other), holds, "{one:?} {other:?}");
        }
    }
}
