//! Position of the pixels of a raster (OGC GeoTIFF 1.1, §7.1 and annex B.6; world files of ESRI).

use super::error::RasterError;
use super::file::Directory;
use super::keys;
use crate::builder::MAX_COORDINATE;
use std::path::{Path, PathBuf};
use tiff::tags::Tag;
use vlscan_base::files::reads;
use vlscan_geom::DVec3;
use vlscan_trace::HeightGrid;

/// Maximum pixel size that, in a raster supposedly in metres, indicates degrees: 1 km is 0.009°.
const MAX_DEGREE_STEP: f64 = 0.01;
/// Maximum size of a world file, bytes.
const MAX_WORLD_FILE_BYTES: u64 = 1 << 12;

/// Position of the pixel centres: (x, y) = origin + column · of_column + row · of_row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Georeference {
    /// Centre of the first pixel.
    pub origin: (f64, f64),
    /// Step from a pixel to the next one of its row.
    pub of_column: (f64, f64),
    /// Step from a row to the next one; (0, −size) if north is up.
    pub of_row: (f64, f64),
}

impl Georeference {
    /// Pixels of 1 m from the origin.
    pub const UNKNOWN: Georeference =
        Georeference { origin: (0.5, 0.5), of_column: (1.0, 0.0), of_row: (0.0, 1.0) };

    /// Position of a pixel's centre at height `z`.
    pub fn centre(&self, column: usize, row: usize, z: f64) -> DVec3 {
        let [x, y] = self.grid(0, 0).place(column, row);
        DVec3::new(x, y, z)
    }

    /// The grid of the centres of this many columns and rows of pixels.
    pub fn grid(&self, columns: usize, rows: usize) -> HeightGrid {
        HeightGrid {
            origin: self.origin.into(),
            of_column: self.of_column.into(),
            of_row: self.of_row.into(),
            ..HeightGrid::new(columns, rows)
        }
    }

    /// True if all pixels of an image of this size have representable coordinates.
    pub fn is_near(&self, columns: usize, rows: usize) -> bool {
        let corners = [(0, 0), (columns, 0), (0, rows), (columns, rows)];
        corners.iter().all(|&(column, row)| {
            let p = self.centre(column, row, 0.0);
            p.x.abs() <= MAX_COORDINATE && p.y.abs() <= MAX_COORDINATE
        })
    }

    /// x and y of a place between the pixels' centres.
    pub fn at(&self, column: f64, row: f64) -> (f64, f64) {
        let ((x, y), (a, c), (b, d)) = (self.origin, self.of_column, self.of_row);
        (x + column * a + row * b, y + column * c + row * d)
    }

    /// Column and row of a place, between the pixels' centres.
    pub fn index_of(&self, (x, y): (f64, f64)) -> [f64; 2] {
        let ((a, c), (b, d)) = (self.of_column, self.of_row);
        let (x, y) = (x - self.origin.0, y - self.origin.1);
        let determinant = a * d - b * c;
        [(x * d - y * b) / determinant, (y * a - x * c) / determinant]
    }

    /// True if x depends on the column only and y on the row only.
    pub fn is_upright(&self) -> bool {
        self.of_column.1 == 0.0 && self.of_row.0 == 0.0
    }

    /// The georeference in another unit.
    pub fn scaled(&self, unit: f64) -> Georeference {
        let scale = |(x, y): (f64, f64)| (x * unit, y * unit);
        Georeference {
            origin: scale(self.origin),
            of_column: scale(self.of_column),
            of_row: scale(self.of_row),
        }
    }

    /// Converts the coefficients x = c₀ + c₁·column + c₂·row, y = c₃ + c₄·column + c₅·row, where (column,
    /// row) is the corner of a pixel, or its centre if `is_point`.
    pub fn from_affine(c: [f64; 6], is_point: bool) -> Result<Georeference, RasterError> {
        if c.iter().any(|v| !v.is_finite()) || c[1] * c[5] == c[2] * c[4] {
            return Err(RasterError::PixelSize(c[1], c[5]));
        }
        let half = if is_point { 0.0 } else { 0.5 };
        let origin = (c[0] + half * (c[1] + c[2]), c[3] + half * (c[4] + c[5]));
        Ok(Georeference { origin, of_column: (c[1], c[4]), of_row: (c[2], c[5]) })
    }

    /// True if the coordinates are degrees of longitude and latitude: according to the raster's keys, or,
    /// without such keys, because its pixel size and its distance from the origin are plausible for degrees
    /// only.
    pub fn is_geographic(&self, directory: &mut Directory) -> bool {
        keys::is_geographic(directory).unwrap_or_else(|| {
            let (x, y) = self.origin;
            let small = |step: (f64, f64)| step.0.abs().max(step.1.abs()) < MAX_DEGREE_STEP;
            small(self.of_column) && small(self.of_row) && x.abs() <= 180.0 && y.abs() <= 90.0
        })
    }
}

/// The georeference of the current image: from its tags, otherwise from the world file next to it, otherwise
/// `None`.
pub(super) fn read(directory: &mut Directory, path: &Path) -> Result<Option<Georeference>, RasterError> {
    let is_point = keys::is_point(directory)?;
    if let Some(m) = doubles(directory, Tag::ModelTransformationTag)?.filter(|m| m.len() >= 8) {
        return Georeference::from_affine([m[3], m[0], m[1], m[7], m[4], m[5]], is_point).map(Some);
    }
    match (doubles(directory, Tag::ModelPixelScaleTag)?, doubles(directory, Tag::ModelTiepointTag)?) {
        (Some(s), Some(t)) if s.len() >= 2 && t.len() >= 6 => {
            let affine = [t[3] - t[0] * s[0], s[0], 0.0, t[4] + t[1] * s[1], 0.0, -s[1]];
            Georeference::from_affine(affine, is_point).map(Some)
        }
        (None, Some(t)) if t.len() > 6 => Err(RasterError::ControlPoints),
        _ => world_file(path)?.map(|c| Georeference::from_affine(c, false)).transpose(),
    }
}

/// The numbers of a tag; `None` if the tag is absent.
pub(super) fn doubles(directory: &mut Directory, tag: Tag) -> Result<Option<Vec<f64>>, RasterError> {
    let found = directory.find_tag(tag).and_then(|value| value.map(|v| v.into_f64_vec()).transpose());
    found.map_err(|source| RasterError::Tag { tag, source })
}

/// The world file of a raster: `dem.tfw`, `dem.tifw`, `dem.wld`, also in capitals.
pub(super) fn world_file_of(path: &Path) -> Option<PathBuf> {
    let own = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let endings = ["tfw".to_owned(), format!("{own}w"), "tifw".to_owned(), "wld".to_owned()];
    let spelled = endings.iter().flat_map(|ending| [ending.clone(), ending.to_uppercase()]);
    spelled.map(|ending| path.with_extension(ending)).find(|file| reads::is_file(file))
}

/// The six lines of an ESRI world file, which refer to pixel centres.
fn world_file(path: &Path) -> Result<Option<[f64; 6]>, RasterError> {
    let Some(file) = world_file_of(path) else { return Ok(None) };
    let bytes = vlscan_tables::input::read_file(&file, MAX_WORLD_FILE_BYTES);
    let bytes = match bytes {
        Ok(bytes) => bytes,
        Err(source) => return Err(RasterError::WorldFileUnread { file, source }),
    };
    let text = String::from_utf8_lossy(&bytes);
    let mut numbers = [0.0; 6];
    let mut words = text.trim_start_matches('\u{feff}').split_whitespace();
    for number in &mut numbers {
        let word = words.next().unwrap_or_default();
        *number =
            word.parse().map_err(|_| RasterError::WorldFile { file: file.clone(), word: word.to_owned() })?;
    }
    if let Some(word) = words.next() {
        return Err(RasterError::LongWorldFile { word: word.to_owned(), file });
    }
    let [a, d, b, e, x, y] = numbers;
    Ok(Some([x - 0.5 * a - 0.5 * b, a, b, y - 0.5 * d - 0.5 * e, d, e]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centres_of_area_and_point_pixels() {
        let area = Georeference::from_affine([100.0, 2.0, 0.0, 50.0, 0.0, -4.0], false).unwrap();
        assert_eq!(area.centre(3, 1, 7.0), DVec3::new(107.0, 44.0, 7.0));
        let point = Georeference::from_affine([100.0, 2.0, 0.0, 50.0, 0.0, -4.0], true).unwrap();
        assert_eq!(point.centre(3, 1, 7.0), DVec3::new(106.0, 46.0, 7.0));
        let turned = Georeference::from_affine([100.0, 0.0, 2.0, 50.0, 3.0, 0.0], false).unwrap();
        assert_eq!(turned.centre(1, 2, 7.0), DVec3::new(105.0, 54.5, 7.0));
        for singular in [[0.0, 0.0, 0.0, 0.0, 0.0, 1.0], [0.0, 1.0, 2.0, 0.0, 2.0, 4.0]] {
            assert!(
                Georeference::from_affine(singular, false).unwrap_err().to_string().contains("pixel size")
            );
        }
    }

    #[test]
    fn a_world_file_names_the_centre_of_the_first_pixel() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("dem.TFW"), "2.0\n0.0\n0.0\n-4.0\n101.0\n48.0\n").unwrap();
        let read = || world_file(&folder.path().join("dem.tif"));
        let c = read().unwrap().unwrap();
        assert_eq!(Georeference::from_affine(c, false).unwrap().origin, (101.0, 48.0));
        std::fs::write(folder.path().join("dem.tfw"), "2,0\n0,0\n0,0\n-4,0\n101,0\n48,0\n").unwrap();
        assert!(read().unwrap_err().to_string().contains("a decimal comma"));
        std::fs::write(folder.path().join("dem.tfw"), "2.0\n0.0\n0.0\n-4.0\n101.0\n48.0\n7\n").unwrap();
        assert!(read().unwrap_err().to_string().contains("\"7\" after six numbers"));
    }
}
