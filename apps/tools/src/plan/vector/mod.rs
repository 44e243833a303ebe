//! Geometries of files that are not text: shapefiles, GeoPackages, KML in ZIP archives.
//!
//! | file | what it does |
//! |---|---|
//! | `shapefile` | polygons and lines of shapefiles, with the `.prj` file beside them |
//! | `geopackage` | tables of features, well-known binary |
//! | `sqlite` | rows of tables in a database |
//! | `archive` | the KML document of a KMZ archive |

mod archive;
mod geopackage;
mod shapefile;
mod sqlite;
#[cfg(test)]
mod tests;

use super::geometries::{Format, Geometry, GeometryError, read_geometries};
use std::path::Path;

/// Maximum size of a text of geometries, bytes.
pub(super) const MAX_TEXT_BYTES: u64 = 64 << 20;
/// Maximum size of a file of geometries, bytes.
pub(super) const MAX_FILE_BYTES: u64 = 256 << 20;

/// Problem of a file of geometries.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub(super) enum VectorError {
    /// A text that cannot be read.
    #[error(transparent)]
    Text(#[from] GeometryError),
    /// A shapefile that cannot be read.
    #[error(transparent)]
    Shapefile(#[from] shapefile::ShapefileError),
    /// A GeoPackage that cannot be read.
    #[error(transparent)]
    GeoPackage(#[from] geopackage::GeoPackageError),
    /// An archive that cannot be read.
    #[error(transparent)]
    Archive(#[from] archive::ArchiveError),
    /// The index of a shapefile in place of the shapefile.
    #[error("it is the index of a shapefile; name the .shp file beside it")]
    ShapefileIndex,
    /// A text of more than [`MAX_TEXT_BYTES`].
    #[error("it has more than {max} bytes, the maximum", max = MAX_TEXT_BYTES)]
    TooLarge,
}

/// The geometries of a file, in its order.
///
/// # Errors
/// Problem of the file.
pub(super) fn read_file_geometries(
    path: &Path,
    bytes: &[u8],
) -> Result<(Format, Vec<Geometry>), VectorError> {
    if bytes.starts_with(&[0, 0, 0x27, 0x0a]) {
        // The index begins as the shapefile does.
        if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("shx")) {
            return Err(VectorError::ShapefileIndex);
        }
        return Ok((Format::Shapefile, shapefile::read(bytes, path)?));
    }
    if bytes.starts_with(b"SQLite format 3\0") {
        return Ok((Format::GeoPackage, geopackage::read(bytes, path)?));
    }
    if bytes.starts_with(b"PK") {
        let text = archive::document(bytes)?;
        return Ok(read_geometries(&text)?);
    }
    if bytes.len() as u64 > MAX_TEXT_BYTES {
        return Err(VectorError::TooLarge);
    }
    // Names and descriptions are not used, so letters of other encodings are harmless.
    Ok(read_geometries(String::from_utf8_lossy(bytes).trim_start_matches('\u{feff}'))?)
}
