//! Errors of LAS and LAZ files.

use laz::LasZipError;
use std::io;
use vlscan_base::diag::{Problem, ProblemKind};
use vlscan_geom::DVec3;

/// Maximum length of a compressed record, bytes: the decompressor takes up to 16 kB of memory per byte of it.
pub(super) const MAX_COMPRESSED_RECORD_BYTES: u16 = 4096;

/// Advice for points with an unsupported compression.
const CONVERT: &str = "convert it to LAS, with the program that wrote it, `laszip -i in.laz -o out.las` or \
                       `pdal translate in.laz out.las`";

/// A LAS or LAZ file that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LasError {
    /// A file that ends within its header or its variable length records.
    #[error("the file ends within its header")]
    HeaderEnds,
    /// A version or a point format that is not read.
    #[error(
        "is LAS {major}.{minor} with points of format {format}; LAS 1.0 to 1.5 with formats 0 to 10 are \
         read, convert it for example with PDAL"
    )]
    Version {
        /// Major version.
        major: u8,
        /// Minor version.
        minor: u8,
        /// Point format.
        format: u8,
    },
    /// Records that are too short for their format.
    #[error("expected at least {shortest} bytes per point of format {format}, found {found}")]
    RecordTooShort {
        /// Point format.
        format: u8,
        /// Length of a record of the format, bytes.
        shortest: u16,
        /// Length of a record by the header, bytes.
        found: u16,
    },
    /// Points that begin behind the end of the file.
    #[error("the points begin at byte {at}, the file ends at {end}")]
    PointsBehindEnd {
        /// Offset of the points.
        at: usize,
        /// Length of the file.
        end: usize,
    },
    /// Scales or offsets that are not finite, or a scale of 0.
    #[error("expected finite scales and offsets, found {scale} and {offset}")]
    Scales {
        /// Scales of x, y and z.
        scale: DVec3,
        /// Offsets of x, y and z.
        offset: DVec3,
    },
    /// Coordinates that are longitude and latitude.
    #[error(
        "its coordinates are longitude and latitude; project them, for example with PDAL's \
         filters.reprojection"
    )]
    Geographic,
    /// Coordinates that are distances from the centre of the Earth.
    #[error(
        "its coordinates are geocentric, so z is not the height; project them, for example with PDAL's \
         filters.reprojection"
    )]
    Geocentric,
    /// Points that cannot be read to the last one.
    #[error("{source} after {at} of {count} points; is the file truncated?")]
    Points {
        /// Number of points before.
        at: u64,
        /// Number of points of the file.
        count: u64,
        /// The reason.
        source: PointsError,
    },
    /// A compressed file without the record that describes its compression.
    #[error("its points are compressed, but the LASzip record that describes how is missing; {CONVERT}")]
    NoCompression,
    /// A description of the compression that ends early.
    #[error("the record that describes its compression is too short; is the file truncated?")]
    CompressionEnds,
    /// A coder that is not read.
    #[error("its points are compressed by the LAZ coder {0}; coder 0 is read; {CONVERT}")]
    Coder(u16),
    /// A compressor that is not read.
    #[error("its points are compressed by the LAZ compressor {0}; compressors 0 to 3 are read; {CONVERT}")]
    Compressor(u16),
    /// A kind of values that is not read.
    #[error("its compressed points have values of the LAZ kind {0}; kinds 0 and 6 to 14 are read; {CONVERT}")]
    ItemKind(u16),
    /// A version of values that is not read.
    #[error("its compressed points have values in version {0} of LAZ, which is not read; {CONVERT}")]
    ItemVersion(u16),
    /// Another compression that is not read.
    #[error("its compressed points are not read ({0}); {CONVERT}")]
    Compression(#[source] LasZipError),
    /// Compressed records that are too long.
    #[error(
        "its compressed points have {length} bytes; at most {MAX_COMPRESSED_RECORD_BYTES} can be read; \
         {CONVERT}"
    )]
    RecordTooLong {
        /// Length of a record, bytes.
        length: u16,
    },
    /// A compression whose record length differs from the file's.
    #[error("expected {length} bytes per point, the compression is for {items}")]
    RecordLength {
        /// Length of a record by the header, bytes.
        length: u16,
        /// Length of a record by the compression, bytes.
        items: u32,
    },
    /// A file that ends within its compressed points.
    #[error("the file ends within its compressed points; is it truncated?")]
    CompressedPointsEnd,
    /// A file without its table of chunks.
    #[error("its table of chunks is missing; is the file truncated?")]
    NoChunkTable,
    /// A compressed file that ends before its points.
    #[error("the file ends before its points")]
    PointsMissing,
    /// More chunks than points or bytes.
    #[error("a table of {chunks} chunks for {points} points")]
    ChunkTable {
        /// Number of chunks.
        chunks: u32,
        /// Number of points.
        points: u64,
    },
    /// Damaged compressed points.
    #[error("its compressed points are damaged; is the file truncated?")]
    Damaged,
}

/// The reason why a point cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PointsError {
    /// The file ends.
    #[error("the file ends")]
    Ends,
    /// The file ends where the lengths of the layers of a chunk are expected.
    #[error("the file ends within its header")]
    ChunkHeaderEnds,
    /// A chunk behind the end of the file.
    #[error("a chunk begins beyond the file's end")]
    ChunkBehindEnd,
    /// A chunk whose layers are longer than the file.
    #[error("a chunk is longer than the file")]
    ChunkTooLong,
    /// Bytes that are not a compressed point.
    #[error("the points cannot be decompressed ({0})")]
    Decompression(#[source] io::Error),
    /// The position in the file is not known.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl LasError {
    /// The error of the library for points that cannot be decompressed.
    pub(super) fn of_library(error: LasZipError) -> LasError {
        match error {
            LasZipError::IoError(_) => LasError::CompressedPointsEnd,
            LasZipError::MissingChunkTable => LasError::NoChunkTable,
            LasZipError::UnknownCompressorType(number) => LasError::Compressor(number),
            LasZipError::UnknownLazItem(number) => LasError::ItemKind(number),
            LasZipError::UnsupportedLazItemVersion(_, version) => LasError::ItemVersion(version),
            other => LasError::Compression(other),
        }
    }
}

impl Problem for LasError {
    fn kind(&self) -> ProblemKind {
        match self {
            LasError::HeaderEnds
            | LasError::PointsBehindEnd { .. }
            | LasError::CompressionEnds
            | LasError::CompressedPointsEnd
            | LasError::NoChunkTable
            | LasError::PointsMissing
            | LasError::Points { source: PointsError::Ends | PointsError::ChunkHeaderEnds, .. } => {
                ProblemKind::Truncated
            }
            LasError::Version { .. }
            | LasError::Geographic
            | LasError::Geocentric
            | LasError::Coder(_)
            | LasError::Compressor(_)
            | LasError::ItemKind(_)
            | LasError::ItemVersion(_)
            | LasError::Compression(_)
            | LasError::RecordTooLong { .. } => ProblemKind::Unsupported,
            _ => ProblemKind::Invalid,
        }
    }
}
