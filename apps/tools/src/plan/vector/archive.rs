//! The KML document of a KMZ archive (OGC 12-007r2, annex C).

use super::MAX_TEXT_BYTES;
use std::io::{Cursor, Read};
use zip::ZipArchive;
use zip::result::ZipError;

/// Maximum number of files of an archive: pictures of placemarks.
const MAX_FILES: usize = 10_000;

/// Problem of an archive.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    /// An archive whose directory cannot be read.
    #[error("the archive is damaged: {0}")]
    Damaged(ZipError),
    /// A file in the archive that cannot be expanded.
    #[error("the archive is damaged: {0}")]
    DamagedFile(std::io::Error),
    /// More files than are searched.
    #[error("the archive has more than {max} files", max = MAX_FILES)]
    TooManyFiles,
    /// No file that ends in .kml.
    #[error("no KML document in the archive")]
    NoDocument,
    /// A document, by its name, that expands to more than [`MAX_TEXT_BYTES`].
    #[error("its document {0} has more than {max} bytes, the maximum", max = MAX_TEXT_BYTES)]
    TooLarge(String),
}

/// The text of the first KML file in the main folder, or else of the first one.
///
/// # Errors
/// An archive that is damaged, or has no KML; one that expands to more than [`MAX_TEXT_BYTES`].
pub(super) fn document(bytes: &[u8]) -> Result<String, ArchiveError> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(ArchiveError::Damaged)?;
    if archive.len() > MAX_FILES {
        return Err(ArchiveError::TooManyFiles);
    }
    // Names that cannot be decoded are those of other files.
    let names = archive.file_names().flatten().map(|name| name.into_owned());
    let names: Vec<String> = names.filter(|name| name.to_ascii_lowercase().ends_with(".kml")).collect();
    let name = names.iter().find(|name| !name.contains('/')).or(names.first());
    let name = name.ok_or(ArchiveError::NoDocument)?;
    let file = archive.by_name(name).map_err(ArchiveError::Damaged)?;
    let mut text = Vec::new();
    file.take(MAX_TEXT_BYTES + 1).read_to_end(&mut text).map_err(ArchiveError::DamagedFile)?;
    if text.len() as u64 > MAX_TEXT_BYTES {
        return Err(ArchiveError::TooLarge(name.clone()));
    }
    Ok(String::from_utf8_lossy(&text).trim_start_matches('\u{feff}').to_owned())
}
