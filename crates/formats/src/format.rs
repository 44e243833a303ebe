//! Recognises the format of a file of points by its first bytes, and names the formats that are not read.

use super::leica;
use super::point_format::build_with;
use std::path::Path;
use vlscan_base::diag::{Problem, ProblemKind};
use vlscan_base::recognise::{Expected, Family, Foreign, Kind, foreign};
use vlscan_tables::input::arrow::{ArrowDetection, detect_arrow};

/// Number of bytes by which a format is recognised, if the file has them.
pub(super) const DETECTED_BYTES: usize = 4096;

/// A format that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CloudFormat {
    /// LAS and LAZ.
    Las,
    /// Polygon File Format, of which the vertices are read.
    Ply,
    /// Point Cloud Data, the format of the Point Cloud Library.
    Pcd,
    /// ASTM E2807 (E57).
    E57,
    /// Apache Arrow IPC, stream or file.
    Arrow,
    /// Apache Parquet.
    Parquet,
    /// Leica PTS: the number of points, then one point per line.
    Pts,
    /// Leica PTX: scans with their headers and transformations.
    Ptx,
    /// MCAP with messages of ROS 2: points of a scanner, and its poses.
    Mcap,
    /// Lines of columns.
    Text,
}

/// The formats that this build reads, for messages.
fn read_formats() -> String {
    let built = CloudFormat::ALL.into_iter().filter(|format| format.built().is_ok());
    let name = |format: CloudFormat| match format {
        CloudFormat::Las => "LAS, LAZ",
        other => other.name(),
    };
    let names: Vec<&str> = built.map(name).collect();
    match names.split_last() {
        Some((last, others)) => format!("{} and {last}", others.join(", ")),
        None => String::new(),
    }
}

/// Extensions of binary formats.
const BINARY_EXTENSIONS: &[&str] = &["las", "laz", "ply", "pcd", "e57", "mcap", "parquet", "arrow"];

impl CloudFormat {
    /// All formats, in the order of messages.
    const ALL: [CloudFormat; 10] = {
        use CloudFormat::{Arrow, E57, Las, Mcap, Parquet, Pcd, Ply, Pts, Ptx, Text};
        [Las, Ply, Pcd, E57, Pts, Ptx, Mcap, Text, Arrow, Parquet]
    };

    /// The name of the format.
    pub fn name(self) -> &'static str {
        match self {
            CloudFormat::Las => "LAS",
            CloudFormat::Ply => "PLY",
            CloudFormat::Pcd => "PCD",
            CloudFormat::E57 => "E57",
            CloudFormat::Arrow => "Arrow",
            CloudFormat::Parquet => "Parquet",
            CloudFormat::Pts => "PTS",
            CloudFormat::Ptx => "PTX",
            CloudFormat::Mcap => "MCAP",
            CloudFormat::Text => "text",
        }
    }

    /// True if the format is read sequentially, so that a file may come through a pipe without being stored.
    pub(super) fn is_stream(self) -> bool {
        use CloudFormat::{Arrow, Mcap, Pts, Ptx, Text};
        matches!(self, Text | Pts | Ptx | Arrow | Mcap)
    }

    /// Recognises a format by the beginning of a file, at least 4096 bytes if it has them.
    ///
    /// # Errors
    /// The kind of file that it is instead.
    pub fn recognise(first: &[u8], path: &Path) -> Result<CloudFormat, UnreadFormat> {
        let format = if first.starts_with(b"LASF") {
            CloudFormat::Las
        } else if super::is_ply(first) {
            CloudFormat::Ply
        } else if first.starts_with(b"ASTM-E57") {
            CloudFormat::E57
        } else if first.starts_with(b"PAR1") {
            CloudFormat::Parquet
        } else if first.starts_with(b"\x89MCAP0\r\n") {
            CloudFormat::Mcap
        } else if detect_arrow(first) == ArrowDetection::Arrow {
            CloudFormat::Arrow
        } else if super::pcd::is_pcd(first) {
            CloudFormat::Pcd
        } else {
            return CloudFormat::of_text(first, path);
        };
        format.built()
    }

    /// The format, unless this build does not read it.
    fn built(self) -> Result<CloudFormat, UnreadFormat> {
        let (name, feature) = match self {
            CloudFormat::E57 if !cfg!(feature = "e57") => ("E57", "e57"),
            CloudFormat::Parquet if !cfg!(feature = "parquet") => ("Parquet", "parquet"),
            CloudFormat::Mcap if !cfg!(feature = "mcap") => ("MCAP", "mcap"),
            _ => return Ok(self),
        };
        Err(UnreadFormat::NotBuilt { name, feature })
    }

    fn of_text(first: &[u8], path: &Path) -> Result<CloudFormat, UnreadFormat> {
        let text = first.strip_prefix(b"\xef\xbb\xbf").unwrap_or(first).trim_ascii_start();
        if first.starts_with(b"\xff\xfe") || first.starts_with(b"\xfe\xff") {
            return Err(UnreadFormat::Utf16);
        }
        let found = foreign(path, first, &Expected::POINTS);
        if let Some(Foreign { kind, help, .. }) = found.filter(|found| found.kind.family != Family::Binary) {
            return Err(UnreadFormat::Other { kind, help });
        }
        let extension =
            path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let beginning = String::from_utf8_lossy(&first[..first.len().min(4)]).escape_debug().to_string();
        if BINARY_EXTENSIONS.contains(&extension.as_str()) {
            let expected = extension.to_uppercase();
            return Err(match first.is_empty() {
                true => UnreadFormat::Empty { expected },
                false => UnreadFormat::Misnamed { expected, beginning },
            });
        }
        // Text has no control characters but blanks and ends of lines.
        if first.iter().any(|b| *b < 0x20 && !matches!(b, b'\t' | b'\n' | b'\r' | 0x0b | 0x0c)) {
            return Err(UnreadFormat::Binary { beginning });
        }
        Ok(match leica::detect(text) {
            Some(true) => CloudFormat::Ptx,
            Some(false) => CloudFormat::Pts,
            None => CloudFormat::Text,
        })
    }
}

const CONVERTERS: &str = "convert it to LAS or LAZ, for example with PDAL or CloudCompare";

/// Kind of a file that is not read as a point cloud; a sentence without its subject, the file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UnreadFormat {
    /// A format that this build does not read.
    #[error("is {name}, which this build does not read; {}", build_with(.feature))]
    NotBuilt {
        /// The format.
        name: &'static str,
        /// The feature of the build that reads it.
        feature: &'static str,
    },
    /// Text in UTF-16.
    #[error("is text in UTF-16; save it as UTF-8, for example with `iconv -f UTF-16 -t UTF-8`")]
    Utf16,
    /// Another known format.
    #[error(
        "is {}{}{help}; {} are read",
        .kind.name,
        if .help.is_empty() { "" } else { "; " },
        read_formats()
    )]
    Other {
        /// The format.
        kind: &'static Kind,
        /// Advice for the file.
        help: String,
    },
    /// An empty file.
    #[error("is empty, expected {expected}")]
    Empty {
        /// The format of its name.
        expected: String,
    },
    /// A file that is not in the format of its name.
    #[error("the extension says {expected}, but the file starts with \"{beginning}\"")]
    Misnamed {
        /// The format of its name.
        expected: String,
        /// Its first bytes.
        beginning: String,
    },
    /// Binary data of an unknown format.
    #[error(
        "is binary and in no known format (it begins with \"{beginning}\"); {CONVERTERS}; {} are read",
        read_formats()
    )]
    Binary {
        /// Its first bytes.
        beginning: String,
    },
}

impl Problem for UnreadFormat {
    fn kind(&self) -> ProblemKind {
        match self {
            UnreadFormat::Empty { .. } | UnreadFormat::Misnamed { .. } => ProblemKind::Invalid,
            _ => ProblemKind::Unsupported,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, first: &[u8]) -> Result<CloudFormat, String> {
        CloudFormat::recognise(first, Path::new(name)).map_err(|e| e.to_string())
    }

    #[test]
    fn formats_are_recognised_by_their_first_bytes() {
        for (first, expected) in [
            (&b"LASF\0\0"[..], CloudFormat::Las),
            (b"ply\r\nformat", CloudFormat::Ply),
            #[cfg(feature = "e57")]
            (b"ASTM-E57\x01", CloudFormat::E57),
            #[cfg(feature = "parquet")]
            (b"PAR1\x15", CloudFormat::Parquet),
            #[cfg(feature = "mcap")]
            (b"\x89MCAP0\r\n", CloudFormat::Mcap),
            (b"\xff\xff\xff\xff\x80\0\0\0", CloudFormat::Arrow),
            (b"# .PCD v.7 - Point Cloud\nVERSION .7\n", CloudFormat::Pcd),
            (b"VERSION 0.7\nFIELDS x y z\n", CloudFormat::Pcd),
            (b"2\r\n1 2 3 -1200\r\n4 5 6 700\r\n", CloudFormat::Pts),
            (b"2\r1 2 3 -1200\r4 5 6 700\r", CloudFormat::Pts),
            (b"# a\rVERSION 0.7\rFIELDS x y z\r", CloudFormat::Pcd),
            (b"2\n1\n0 0 0\n1 0 0\n", CloudFormat::Ptx),
            (b"1 2 3\n4 5 6\n", CloudFormat::Text),
            (b"x y z\n1 2 3\n", CloudFormat::Text),
            (b"1\n2\n3\n", CloudFormat::Text),
            (b"", CloudFormat::Text),
        ] {
            assert_eq!(of("a.bin", first), Ok(expected), "{}", String::from_utf8_lossy(first));
        }
    }

    #[test]
    fn other_formats_are_named() {
        for (first, expected) in [
            (&b"RIEGL LMS RDB 2 POINTCLOUD FILE"[..], "rdbconvert"),
            (b"\x1f\x8b\x08", "gunzip"),
            (b"\xff\xfe1\x002\x00", "UTF-16"),
            (b"\xef\xbb\xbf<?xml", "an XML file"),
            (b"# Blender\nv 1 2 3\n", "an OBJ mesh"),
            (b"# Blender\rv 1 2 3\r", "an OBJ mesh"),
            (b"solid box\nfacet normal 0 0 1\n", "an STL mesh"),
            (b"SOLID\r\n  FACET NORMAL 0 0 1\r\n", "an STL mesh"),
            (b"Solid by a program\0\0\0\x02", "an STL mesh"),
            (b"off\n8 6 12\n", "an OFF mesh"),
            (b"\x01\x02\x03\x04", "binary and in no known format"),
            #[cfg(not(feature = "e57"))]
            (b"ASTM-E57\x01", "build vlscan with the feature e57"),
            #[cfg(not(feature = "parquet"))]
            (b"PAR1\x15", "build vlscan with the feature parquet"),
        ] {
            let named = of("a.xyz", first).unwrap_err();
            assert!(named.starts_with("is ") && named.contains(expected), "{named}");
            assert!(!named.contains("damaged") && !named.contains("truncated"), "{named}");
        }
        assert!(of("a.las", b"1 2 3\n").unwrap_err().contains("the extension says LAS"));
        assert!(of("a.mcap", b"").unwrap_err().contains("is empty, expected MCAP"));
    }

    #[test]
    fn messages_list_the_formats_that_the_build_reads() {
        let listed = read_formats();
        assert!(listed.starts_with("LAS, LAZ, PLY, PCD, ") && listed.contains(", text"), "{listed}");
        for format in CloudFormat::ALL {
            assert_eq!(listed.contains(format.name()), format.built().is_ok(), "{listed}: {format:?}");
        }
        assert!(of("a.xyz", b"\x01\x02\x03\x04").unwrap_err().ends_with(&format!("; {listed} are read")));
    }
}
