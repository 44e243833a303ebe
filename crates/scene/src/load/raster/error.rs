//! Errors of rasters.

use crate::builder::MAX_COORDINATE;
use std::collections::TryReserveError;
use std::io;
use std::path::PathBuf;
use tiff::TiffError;
use tiff::tags::Tag;
use vlscan_base::columns::comma_note;
use vlscan_base::diag::{Problem, ProblemKind};
use vlscan_base::quantity;

/// A raster that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RasterError {
    /// An empty file.
    #[error("the file is empty")]
    Empty,
    /// A file of another format.
    #[error("expected a GeoTIFF file or an ESRI ASCII grid, found {found}")]
    Foreign {
        /// The format.
        found: &'static str,
    },
    /// A grid of text.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// A part of the file that the system cannot read.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// A directory that the library cannot read.
    #[error(transparent)]
    Tiff(#[from] TiffError),
    /// A tag that the library cannot read.
    #[error("its {tag:?} cannot be read: {source}")]
    Tag {
        /// The tag.
        tag: Tag,
        /// The reason.
        source: TiffError,
    },
    /// A compression that is not read.
    #[error("it is compressed by {0}, which is not read")]
    Compression(&'static str),
    /// An unknown compression.
    #[error("its compression (code {0}) is unknown")]
    UnknownCompression(u16),
    /// Pixels that are complex numbers.
    #[error("its pixels are complex numbers, expected heights")]
    Complex,
    /// Pixels of an unknown format.
    #[error("its pixels have the unknown number format {0}")]
    NumberFormat(u64),
    /// Pixels of an odd number of bits.
    #[error("its pixels are numbers of {0} bits, expected 1, 2, 4, 8, 16, 32 or 64")]
    NumberBits(u64),
    /// A predictor that is not defined for the numbers of the raster.
    #[error("its predictor {0} does not go with its numbers")]
    Predictor(u16),
    /// More pixels than the file can hold.
    #[error("its {width} x {height} pixels ({}) do not fit into a file of {}", shown(.bytes), shown(.held))]
    Size {
        /// Number of columns.
        width: u64,
        /// Number of rows.
        height: u64,
        /// Size of the pixels, bytes.
        bytes: u64,
        /// Size of the file, bytes.
        held: u64,
    },
    /// Blocks without pixels.
    #[error("its strips or tiles have no pixels")]
    EmptyBlocks,
    /// Blocks that are much larger than the raster.
    #[error("its strips or tiles of {width} x {height} pixels are larger than itself")]
    LargeBlocks {
        /// Number of columns of a block.
        width: usize,
        /// Number of rows of a block.
        height: usize,
    },
    /// Too few blocks.
    #[error("it has fewer strips or tiles than its size requires")]
    MissingBlocks,
    /// A block of too few bytes.
    #[error("its block {block} of {bytes} bytes is shorter than its pixels")]
    ShortBlock {
        /// Number of the block.
        block: usize,
        /// Its size, bytes.
        bytes: u64,
    },
    /// A block behind the end of the file.
    #[error("its block {block} lies beyond the end of the file; is it truncated?")]
    BlockBehindEnd {
        /// Number of the block.
        block: usize,
    },
    /// A block that the system cannot read.
    #[error("its block {block} cannot be read: {source}")]
    Block {
        /// Number of the block.
        block: usize,
        /// The reason.
        source: io::Error,
    },
    /// A block that cannot be unpacked.
    #[error("its block {block} cannot be unpacked: {source}")]
    Packed {
        /// Number of the block.
        block: usize,
        /// The reason.
        source: UnpackError,
    },
    /// A block of LERC that cannot be decoded.
    #[error("its block {block} of LERC: {source}")]
    Lerc {
        /// Number of the block.
        block: usize,
        /// The reason.
        source: UnpackError,
    },
    /// A block that ends before its pixels.
    #[error("its block {block} is shorter than its {width} x {height} pixels; is the file truncated?")]
    BlockEnds {
        /// Number of the block.
        block: usize,
        /// Number of columns of the block.
        width: usize,
        /// Number of rows of the block.
        height: usize,
    },
    /// A mask that cannot be used.
    #[error("its mask{}: {source}", of_file(.file))]
    Mask {
        /// The file of the mask, if it has one.
        file: Option<PathBuf>,
        /// The reason.
        source: Box<RasterError>,
    },
    /// A mask whose size differs from the raster's.
    #[error("it has {} x {} pixels, the raster {} x {}", .found.0, .found.1, .expected.0, .expected.1)]
    MaskSize {
        /// Numbers of columns and rows of the mask.
        found: (usize, usize),
        /// Numbers of columns and rows of the raster.
        expected: (usize, usize),
    },
    /// A unit of coordinates or heights that is not known.
    #[error("{what}")]
    Unit {
        /// The unit and where the file states it.
        what: String,
    },
    /// Metadata that are not XML.
    #[error("its GDAL metadata is no XML: {0}")]
    Metadata(#[source] roxmltree::Error),
    /// Metadata without a number.
    #[error("the {what} of its heights is \"{found}\", expected a number")]
    MetadataValue {
        /// Scale or offset.
        what: &'static str,
        /// The text of the value.
        found: String,
    },
    /// A no-data value that is not a number.
    #[error("expected a number as no-data value, found \"{0}\"")]
    NoData(String),
    /// Pixels without a size.
    #[error("expected a pixel size other than 0, found {0} by {1}")]
    PixelSize(f64, f64),
    /// Ground control points instead of a georeference.
    #[error(
        "expected a pixel size and one tie point, found ground control points; gdalwarp in.tif out.tif \
         places the pixels by them"
    )]
    ControlPoints,
    /// A world file that the system cannot read.
    #[error("its world file {} cannot be read: {source}", file.display())]
    WorldFileUnread {
        /// The file.
        file: PathBuf,
        /// The reason.
        source: io::Error,
    },
    /// A world file with another word than a number.
    #[error(
        "its world file {} has \"{word}\", expected six numbers{note}", file.display(),
        note = comma_note(.word)
    )]
    WorldFile {
        /// The file.
        file: PathBuf,
        /// The word.
        word: String,
    },
    /// A world file of more than six numbers.
    #[error("its world file {} has \"{word}\" after six numbers", file.display())]
    LongWorldFile {
        /// The file.
        file: PathBuf,
        /// The seventh word.
        word: String,
    },
    /// Pixels at places that have no coordinates.
    #[error("it reaches beyond {MAX_COORDINATE:e} m, where coordinates cannot be computed")]
    OutOfRange,
    /// Too many pixels.
    #[error("it has more pixels than can be numbered")]
    TooLarge,
    /// Too many pixels of several files.
    #[error("it has more pixels than can be numbered: {columns} x {rows}")]
    TooManyPixels {
        /// Number of columns.
        columns: usize,
        /// Number of rows.
        rows: usize,
    },
    /// Heights that do not fit into the memory.
    #[error(transparent)]
    Memory(#[from] TryReserveError),
}

/// A block of a raster that cannot be unpacked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UnpackError {
    /// Bytes that a decoder cannot read.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// Bytes that another decoder does not accept.
    #[error("{what}")]
    Decoder {
        /// The message of the decoder.
        what: String,
    },
    /// Bytes on which a decoder fails.
    #[error("it is damaged")]
    Damaged,
    /// A block of LERC of another size.
    #[error("it has {width} x {height} pixels of {depth} numbers")]
    Size {
        /// Number of columns.
        width: usize,
        /// Number of rows.
        height: usize,
        /// Numbers per pixel.
        depth: usize,
    },
    /// A block of LERC with too few numbers.
    #[error("it has fewer numbers than pixels")]
    MissingNumbers,
    /// A block of LERC, which holds no bytes of pixels.
    #[error("LERC holds numbers")]
    NoBytes,
}

impl UnpackError {
    /// The error of a decoder.
    pub(super) fn of_decoder(error: impl ToString) -> UnpackError {
        UnpackError::Decoder { what: error.to_string() }
    }
}

/// An ESRI ASCII grid that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GridError {
    /// Bytes that are not text.
    #[error("it has bytes that are not text")]
    NotText,
    /// An unknown key in the header.
    #[error("line {line}: unknown key `{key}`; expected one of {known}")]
    UnknownKey {
        /// Number of the line.
        line: usize,
        /// The key.
        key: String,
        /// The known keys.
        known: String,
    },
    /// A key without a value, or with several.
    #[error("line {line}: expected {key} and one value, found \"{found}\"")]
    Value {
        /// Number of the line.
        line: usize,
        /// The key.
        key: String,
        /// The text of the line.
        found: String,
    },
    /// A repeated key.
    #[error("line {line}: a second {key}")]
    SecondKey {
        /// Number of the line.
        line: usize,
        /// The key.
        key: String,
    },
    /// A key with another value than a number.
    #[error("line {line}: expected a number as {key}, found \"{found}\"{note}", note = comma_note(.found))]
    NotANumber {
        /// Number of the line.
        line: usize,
        /// The key.
        key: String,
        /// The value.
        found: String,
    },
    /// A missing key.
    #[error("expected {key} in its header, found none")]
    MissingKey {
        /// The key or its alternatives.
        key: String,
    },
    /// Two keys that exclude each other.
    #[error("expected {one} or {other}, found both")]
    BothKeys {
        /// The first key.
        one: String,
        /// The second key.
        other: String,
    },
    /// A count that is not a whole number above 0.
    #[error("expected a whole number above 0 as {key}, found {found}")]
    NotACount {
        /// The key.
        key: String,
        /// The value.
        found: f64,
    },
    /// A cell size that is not above 0.
    #[error("expected a cell size above 0, found {0}")]
    CellSize(f64),
    /// Too many cells.
    #[error("{columns} by {rows} cells are too many")]
    TooLarge {
        /// Number of columns.
        columns: usize,
        /// Number of rows.
        rows: usize,
    },
    /// More cells than the file can hold.
    #[error("its header states {columns} by {rows} heights, more than it holds; is it truncated?")]
    Truncated {
        /// Number of columns.
        columns: usize,
        /// Number of rows.
        rows: usize,
    },
    /// A word that is not a height.
    #[error("line {line}: expected a height, found \"{found}\"{note}")]
    Height {
        /// Number of the line.
        line: usize,
        /// The beginning of the word.
        found: String,
        /// A note about a decimal comma.
        note: &'static str,
    },
    /// A row with more or fewer heights than there are columns.
    #[error("line {line}: expected {columns} heights (ncols), found {found}")]
    Row {
        /// Number of the line.
        line: usize,
        /// Number of columns.
        columns: usize,
        /// Number of heights in the line.
        found: usize,
    },
    /// More or fewer heights than there are cells.
    #[error("line {line}: expected {cells} heights ({rows} rows of {columns}), found {found}")]
    Count {
        /// Number of the last line.
        line: usize,
        /// Number of cells.
        cells: usize,
        /// Number of rows.
        rows: usize,
        /// Number of columns.
        columns: usize,
        /// Number of heights.
        found: usize,
    },
    /// Heights that cannot be stored.
    #[error("it cannot be used: {0}")]
    Encoding(#[source] TiffError),
}

fn shown(bytes: &u64) -> String {
    quantity::bytes(*bytes)
}

fn of_file(file: &Option<PathBuf>) -> String {
    file.as_ref().map_or_else(String::new, |file| format!(" {}", file.display()))
}

impl Problem for RasterError {
    fn kind(&self) -> ProblemKind {
        match self {
            RasterError::Grid(error) => error.kind(),
            RasterError::Mask { source, .. } => source.kind(),
            RasterError::Io(e)
            | RasterError::Tiff(TiffError::IoError(e))
            | RasterError::Block { source: e, .. }
                if e.kind() == io::ErrorKind::UnexpectedEof =>
            {
                ProblemKind::Truncated
            }
            RasterError::BlockBehindEnd { .. } | RasterError::BlockEnds { .. } => ProblemKind::Truncated,
            RasterError::Foreign { .. }
            | RasterError::Tiff(TiffError::UnsupportedError(_))
            | RasterError::Compression(_)
            | RasterError::UnknownCompression(_)
            | RasterError::Complex
            | RasterError::NumberFormat(_)
            | RasterError::NumberBits(_)
            | RasterError::Predictor(_)
            | RasterError::ControlPoints => ProblemKind::Unsupported,
            RasterError::TooLarge | RasterError::TooManyPixels { .. } | RasterError::Memory(_) => {
                ProblemKind::TooLarge
            }
            _ => ProblemKind::Invalid,
        }
    }
}

impl Problem for GridError {
    fn kind(&self) -> ProblemKind {
        match self {
            GridError::Truncated { .. } => ProblemKind::Truncated,
            GridError::TooLarge { .. } => ProblemKind::TooLarge,
            _ => ProblemKind::Invalid,
        }
    }
}
