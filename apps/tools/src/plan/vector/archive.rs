//! The KML document of a KMZ archive (OGC 12-007r2, annex C).

use super::MAX_TEXT_BYTES;
use std::io::{Cursor, Read};
use zip::ZipArchive;

/// Maximum number of files of an archive: pictures of placemarks.
const MAX_FILES: usize = 10_000;

/// The text of the first KML file in the main folder, or else of the first one.
///
/// # Errors
/// An archive that is damaged, or has no KML; one that expands to more than [`MAX_TEXT_BYTES`].
pub(super) fn document(bytes: &[u8]) -> Result<String, String> {
    let damaged = |e: &dyn std::fmt::Display| format!("the archive is damaged: {e}");
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| damaged(&e))?;
    if archive.len() > MAX_FILES {
        return Err(format!("the archive has more than {MAX_FILES} files"));
    }
    // Names that cannot be decoded are those of other files.
    let names = archive.file_names().flatten().map(|name| name.into_owned());
    let names: Vec<String> = names.filter(|name| name.to_ascii_lowercase().ends_with(".kml")).collect();
    let name = names.iter().find(|name| !name.contains('/')).or(names.first());
    let name = name.ok_or("no KML document in the archive")?;
    let file = archive.by_name(name).map_err(|e| damaged(&e))?;
    let mut text = Vec::new();
    file.take(MAX_TEXT_BYTES + 1).read_to_end(&mut text).map_err(|e| damaged(&e))?;
    if text.len() as u64 > MAX_TEXT_BYTES {
        return Err(format!("its document {name} has more than {MAX_TEXT_BYTES} bytes, the maximum"));
    }
    Ok(String::from_utf8_lossy(&text).trim_start_matches('\u{feff}').to_owned())
}
