//! Position of the pixels of a raster (OGC GeoTIFF 1.1, §7.1 and annex B.6; GDAL's no-data tag).

use crate::geom::DVec3;
use crate::scene::builder::MAX_COORDINATE;
use std::io::{Read, Seek};
use std::path::Path;
use tiff::decoder::Decoder;
use tiff::tags::Tag;

const RASTER_TYPE_KEY: u16 = 1025;
const PIXEL_IS_POINT: u16 = 2;
const MODEL_TYPE_KEY: u16 = 1024;
const MODEL_IS_GEOGRAPHIC: u16 = 2;
const PROJECTED_SYSTEM_KEY: u16 = 3072;
/// Value of a key whose meaning other keys define.
const USER_DEFINED: u16 = 32_767;
/// Maximum pixel size that, in a raster supposedly in metres, indicates degrees: 1 km is 0.009°.
const MAX_DEGREE_STEP: f64 = 0.01;

/// Position of the pixel centres: x = origin.0 + column·step.0, y = origin.1 + row·step.1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Georeference {
    /// Centre of the first pixel.
    pub origin: (f64, f64),
    /// Step between pixels and between rows; the second is negative if north is up.
    pub step: (f64, f64),
}

impl Georeference {
    /// Position of a pixel's centre at height `z`.
    pub fn centre(&self, column: usize, row: usize, z: f64) -> DVec3 {
        DVec3::new(self.origin.0 + column as f64 * self.step.0, self.origin.1 + row as f64 * self.step.1, z)
    }

    /// Whether all pixels up to this one have representable coordinates.
    pub fn is_near(&self, column: usize, row: usize) -> bool {
        let far = self.centre(column, row, 0.0);
        let near = |x: f64| x.abs() <= MAX_COORDINATE;
        [far.x, far.y, self.origin.0, self.origin.1].into_iter().all(near)
    }

    /// Converts the coefficients x = c₀ + c₁·column + c₂·row, y = c₃ + c₄·column + c₅·row, where (column, row) is the
    /// corner of a pixel, or its centre if `is_point`.
    fn from_affine(c: [f64; 6], is_point: bool) -> Result<Georeference, String> {
        if c.iter().any(|v| !v.is_finite()) || c[1] == 0.0 || c[5] == 0.0 {
            return Err(format!("expected a pixel size other than 0, found {} by {}", c[1], c[5]));
        }
        if c[2] != 0.0 || c[4] != 0.0 {
            return Err("expected a raster whose rows run along the x axis, found a rotated one".to_owned());
        }
        let half = if is_point { 0.0 } else { 0.5 };
        Ok(Georeference { origin: (c[0] + half * c[1], c[3] + half * c[5]), step: (c[1], c[5]) })
    }
}

/// The georeference of the current image: from its tags, otherwise from the world file beside it, otherwise `None`.
pub(super) fn read<R: Read + Seek>(
    decoder: &mut Decoder<R>,
    path: &Path,
) -> Result<Option<Georeference>, String> {
    let is_point = raster_type(decoder)? == Some(PIXEL_IS_POINT);
    if let Some(m) = doubles(decoder, Tag::ModelTransformationTag)?.filter(|m| m.len() >= 8) {
        return Georeference::from_affine([m[3], m[0], m[1], m[7], m[4], m[5]], is_point).map(Some);
    }
    match (doubles(decoder, Tag::ModelPixelScaleTag)?, doubles(decoder, Tag::ModelTiepointTag)?) {
        (Some(s), Some(t)) if s.len() >= 2 && t.len() >= 6 => {
            let affine = [t[3] - t[0] * s[0], s[0], 0.0, t[4] + t[1] * s[1], 0.0, -s[1]];
            Georeference::from_affine(affine, is_point).map(Some)
        }
        (None, Some(t)) if t.len() > 6 => {
            Err("expected a pixel size and one tie point, found ground control points".to_owned())
        }
        _ => world_file(path).map(|c| Georeference::from_affine(c, false)).transpose(),
    }
}

/// The numbers of a tag; `None` if the tag is absent.
fn doubles<R: Read + Seek>(decoder: &mut Decoder<R>, tag: Tag) -> Result<Option<Vec<f64>>, String> {
    let found = decoder.find_tag(tag).and_then(|value| value.map(|v| v.into_f64_vec()).transpose());
    found.map_err(|e| format!("its {tag:?} cannot be read: {e}"))
}

fn raster_type<R: Read + Seek>(decoder: &mut Decoder<R>) -> Result<Option<u16>, String> {
    geo_key(decoder, RASTER_TYPE_KEY)
}

/// Whether the raster's coordinates are degrees of longitude and latitude: according to its keys (OGC GeoTIFF 1.1,
/// §7.1.2), or, without such keys, because its pixel size and its distance from the origin are plausible for degrees
/// only.
pub(super) fn is_geographic<R: Read + Seek>(decoder: &mut Decoder<R>, at: &Georeference) -> bool {
    match geo_key(decoder, MODEL_TYPE_KEY) {
        Ok(Some(kind)) => kind == MODEL_IS_GEOGRAPHIC,
        _ => {
            let (x, y) = at.origin;
            let small = |step: f64| step.abs() < MAX_DEGREE_STEP;
            small(at.step.0) && small(at.step.1) && x.abs() <= 180.0 && y.abs() <= 90.0
        }
    }
}

/// EPSG code of the projected system; `None` for one that the user defined.
pub(super) fn projected_epsg<R: Read + Seek>(decoder: &mut Decoder<R>) -> Option<u16> {
    geo_key(decoder, PROJECTED_SYSTEM_KEY).ok().flatten().filter(|&code| code > 0 && code < USER_DEFINED)
}

/// The value of a GeoKey that is stored in the directory itself.
fn geo_key<R: Read + Seek>(decoder: &mut Decoder<R>, key: u16) -> Result<Option<u16>, String> {
    let tag = Tag::GeoKeyDirectoryTag;
    let keys = decoder.find_tag(tag).and_then(|value| value.map(|v| v.into_u16_vec()).transpose());
    let keys = keys.map_err(|e| format!("its {tag:?} cannot be read: {e}"))?.unwrap_or_default();
    // A header of four numbers, then entries of four: key, location (0 = here), count, value.
    Ok(keys.chunks_exact(4).skip(1).find(|k| k[0] == key && k[1] == 0).map(|k| k[3]))
}

/// The six lines of an ESRI world file, which refer to pixel centres.
fn world_file(path: &Path) -> Option<[f64; 6]> {
    let text =
        ["tfw", "tifw", "wld"].iter().find_map(|e| std::fs::read_to_string(path.with_extension(e)).ok())?;
    let v: Vec<f64> = text.split_whitespace().map_while(|w| w.parse().ok()).collect();
    let [a, d, b, e, x, y] = v.get(..6)?.try_into().ok()?;
    Some([x - 0.5 * a - 0.5 * b, a, b, y - 0.5 * d - 0.5 * e, d, e])
}

/// The no-data value of pixels; `None` without its tag, an error if the tag is not a number.
pub(super) fn no_data<R: Read + Seek>(decoder: &mut Decoder<R>) -> Result<Option<f64>, String> {
    let Ok(text) = decoder.get_tag_ascii_string(Tag::GdalNodata) else { return Ok(None) };
    let text = text.trim_matches(|c: char| c.is_whitespace() || c == '\0');
    text.parse().map(Some).map_err(|_| format!("expected a number as no-data value, found \"{text}\""))
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
        assert!(
            Georeference::from_affine([0.0, 1.0, 0.1, 0.0, 0.0, 1.0], false).unwrap_err().contains("rotated")
        );
        assert!(Georeference::from_affine([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], false).is_err());
    }

    #[test]
    fn a_world_file_names_the_centre_of_the_first_pixel() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("dem.tfw"), "2.0\n0.0\n0.0\n-4.0\n101.0\n48.0\n").unwrap();
        let c = world_file(&folder.path().join("dem.tif")).unwrap();
        assert_eq!(Georeference::from_affine(c, false).unwrap().origin, (101.0, 48.0));
    }
}
