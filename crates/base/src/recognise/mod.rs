//! Names the kind of a file by its first bytes and its ending, and says what to do with a file that a command
//! cannot use: every reader compares the [`Expected`] kind with the file's.
//!
//! | file | what it does |
//! |---|---|
//! | `kinds` | the kinds, with their first bytes, endings and converters |
//! | `contents` | roots of XML, keys of JSON, entries of archives, statements and columns of text |
//! | `expected` | what the readers want |

mod contents;
mod expected;
mod kinds;
#[cfg(test)]
mod tests;

pub use contents::{is_ascii_grid, is_off, is_sbet};
pub use expected::{Expected, Role};
pub use kinds::Kind;

use crate::diag::{Diagnostics, Place};
use crate::error::Error;
use crate::files::reads;
use std::io::Read;
use std::path::Path;

/// Number of bytes by which a kind is recognised, if the file has them.
pub const FIRST_BYTES: usize = 8192;

/// Content of the files of a kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// A point cloud.
    Points,
    /// PLY, which has points or a mesh.
    PointsOrMesh,
    /// Tables in columns: Parquet, Arrow.
    Columnar,
    /// Surfaces.
    Mesh,
    /// Materials of a mesh.
    Materials,
    /// Vegetation in cubes.
    Voxels,
    /// A raster.
    Terrain,
    /// Polygons, lines, places.
    Area,
    /// A coordinate reference system.
    System,
    /// A trajectory in a binary format.
    Flight,
    /// Messages of a robot or a sensor.
    Log,
    /// Surveys, scenes and instruments in XML.
    Document,
    /// A pipeline, or another file of TOML.
    Pipeline,
    /// A packed scene.
    Packed,
    /// A shard of a run.
    Shard,
    /// The calibration of a sensor.
    Calibration,
    /// Columns of text.
    Table,
    /// JSON or XML of an unknown kind.
    Markup,
    /// Other text.
    Text,
    /// Text in UTF-16.
    Utf16,
    /// Arrays of numbers.
    Array,
    /// A spreadsheet.
    Sheet,
    /// A compressed file or an archive.
    Archive,
    /// A picture.
    Picture,
    /// Something that has no use here.
    Other,
    /// Unknown bytes.
    Binary,
    /// Nothing.
    Empty,
}

/// A file that is of another kind than a command expects.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Foreign {
    /// The kind of the file.
    pub kind: &'static Kind,
    /// Kind of file that was expected, with an article.
    pub expected: &'static str,
    /// Command or converter to use instead; empty if none is known.
    pub help: String,
}

impl Foreign {
    /// "expected a survey, found a LAZ point cloud".
    pub fn message(&self) -> String {
        format!("expected {}, found {}", self.expected, self.kind.name)
    }

    /// Records the error at the file.
    pub fn report(self, path: &Path, problems: &mut Diagnostics) {
        let message = format!("{}: {}", self.message(), path.display());
        problems.error(Some(Place::of_file(path)), message).help(self.help);
    }

    /// The error at the file.
    pub fn error(self, path: &Path) -> Error {
        let mut problems = Diagnostics::default();
        self.report(path, &mut problems);
        Error::Input(Box::new(problems))
    }
}

/// The kind of a file that begins with `bytes`, of which [`FIRST_BYTES`] suffice. The ending of its name
/// decides where the bytes do not.
pub fn recognise(path: &Path, bytes: &[u8]) -> &'static Kind {
    let kind = contents::kind_of(&bytes[..bytes.len().min(FIRST_BYTES)]);
    by_ending(path, kind).unwrap_or(kind)
}

/// The kind of a file in the file system; `None` if it cannot be read, or is not a regular file.
pub fn recognise_file(path: &Path) -> Option<&'static Kind> {
    let bytes = first_bytes(path)?;
    Some(recognise(path, &bytes))
}

/// The first bytes of a regular file; `None` if they cannot be read.
pub fn first_bytes(path: &Path) -> Option<Vec<u8>> {
    if !reads::is_file(path) {
        return None;
    }
    let mut bytes = Vec::new();
    reads::open(path).ok()?.take(FIRST_BYTES as u64).read_to_end(&mut bytes).ok()?;
    Some(bytes)
}

/// The kind of a name's ending where the contents are of no known kind. What vlscan reads is recognised by
/// its contents alone.
fn by_ending(path: &Path, contents: &Kind) -> Option<&'static Kind> {
    let ending = path.extension()?.to_string_lossy().to_ascii_lowercase();
    let may_be = |kind: &Kind| match contents.family {
        _ if *contents == kinds::ZIP => kinds::IN_ZIP.contains(kind),
        _ if *contents == kinds::SQLITE => [kinds::GPKG, kinds::ROS2].contains(kind),
        Family::Markup if *contents == kinds::JSON && *kind == kinds::GLTF => true,
        Family::Table | Family::Text if *kind == kinds::TEXT_POINTS => true,
        Family::Table | Family::Text | Family::Markup | Family::Binary => !kind.convert.is_empty(),
        _ => false,
    };
    let mut all = kinds::BY_START.iter().chain(kinds::BY_CONTENTS);
    all.find(|kind| kind.endings.contains(&ending.as_str()) && may_be(kind))
}

/// Recognises a file that a reader cannot read; `None` if the reader may be able to. `bytes` are the first
/// bytes, see [`FIRST_BYTES`].
///
/// ```
/// use std::path::Path;
/// use vlscan_base::recognise::{Expected, foreign};
///
/// let found = foreign(Path::new("plot.npy"), b"\x93NUMPY\x01\0", &Expected::AREA).expect("no area");
/// assert!(found.message().ends_with("found a NumPy array") && found.help.contains("numpy.savetxt"));
/// assert_eq!(foreign(Path::new("plot.kml"), b"<?xml version='1.0'?><kml/>", &Expected::AREA), None);
/// ```
pub fn foreign(path: &Path, bytes: &[u8], expected: &Expected) -> Option<Foreign> {
    let contents = contents::kind_of(&bytes[..bytes.len().min(FIRST_BYTES)]);
    let named = by_ending(path, contents).unwrap_or(contents);
    let is_accepted = expected.accepts(if expected.uses_endings { named } else { contents })
        // Ambiguous contents are left to the reader if the name has a supported extension.
        || kinds::GENERAL.contains(contents) && *named == *contents && expected.accepts_name(path);
    (!is_accepted).then(|| expected.refuse(named, path))
}

/// As [`foreign`], of a file in the file system.
pub fn foreign_file(path: &Path, expected: &Expected) -> Option<Foreign> {
    foreign(path, &first_bytes(path)?, expected)
}
