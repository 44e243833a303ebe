//! Rasters as GeoTIFF (OGC 19-008r4): one band of 32-bit floats, compressed with Deflate, NaN for cells
//! without a value.

use std::io::Cursor;
use tiff::encoder::compression::DeflateLevel;
use tiff::encoder::{Compression, TiffEncoder, colortype::Gray32Float};
use tiff::tags::Tag;
use vlscan_base::error::{Error, Result};
use vlscan_crs::projected_epsg;

/// GeoKeys and their values.
const MODEL_TYPE: u16 = 1024;
const PROJECTED_MODEL: u16 = 1;
const RASTER_TYPE: u16 = 1025;
const PIXEL_IS_AREA: u16 = 1;
const PROJECTED_SYSTEM: u16 = 3072;
const PROJECTED_UNIT: u16 = 3076;
const METRE: u16 = 9001;

/// Square cells in rows.
#[derive(Clone, Copy, Debug)]
pub struct Raster<'a> {
    /// Number of cells from west to east.
    pub columns: usize,
    /// Number of cells from south to north.
    pub rows: usize,
    /// Side of a cell, m.
    pub side_m: f64,
    /// World coordinates of the south-western corner, m.
    pub corner: [f64; 2],
    /// Values row by row from the south west; NaN without a value.
    pub values: &'a [f64],
    /// System of the coordinates as WKT; its EPSG code is written, if it has one.
    pub crs: Option<&'a str>,
}

/// The bytes of a GeoTIFF file.
///
/// # Errors
/// [`Error::Input`] for a raster that is too large for a TIFF file.
pub fn geotiff(raster: &Raster) -> Result<Vec<u8>> {
    encoded(raster).map_err(|problem| Error::input(format!("a raster cannot be written: {problem}")))
}

fn encoded(raster: &Raster) -> tiff::TiffResult<Vec<u8>> {
    let Raster { columns, rows, side_m, corner: [west, south], .. } = *raster;
    let size = |count: usize| u32::try_from(count).map_err(|_| tiff::TiffError::IntSizeError);
    let mut file = Cursor::new(Vec::new());
    let mut encoder =
        TiffEncoder::new(&mut file)?.with_compression(Compression::Deflate(DeflateLevel::Balanced));
    let mut image = encoder.new_image::<Gray32Float>(size(columns)?, size(rows)?)?;
    let north = south + rows as f64 * side_m;
    let tags = image.encoder();
    tags.write_tag(Tag::ModelPixelScaleTag, &[side_m, side_m, 0.0][..])?;
    tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, west, north, 0.0][..])?;
    let mut keys = vec![[MODEL_TYPE, 0, 1, PROJECTED_MODEL], [RASTER_TYPE, 0, 1, PIXEL_IS_AREA]];
    if let Some(code) = raster.crs.and_then(projected_epsg) {
        keys.push([PROJECTED_SYSTEM, 0, 1, code]);
    }
    keys.push([PROJECTED_UNIT, 0, 1, METRE]);
    let head = [1, 1, 0, keys.len() as u16];
    let words: Vec<u16> = head.into_iter().chain(keys.into_iter().flatten()).collect();
    tags.write_tag(Tag::GeoKeyDirectoryTag, &words[..])?;
    tags.write_tag(Tag::GdalNodata, "nan")?;
    let mut values = Vec::with_capacity(columns * rows);
    for row in raster.values.chunks_exact(columns.max(1)).rev() {
        values.extend(row.iter().map(|value| *value as f32));
    }
    image.write_data(&values)?;
    Ok(file.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use tiff::decoder::{Decoder, DecodingResult};
    use vlscan_crs::wkt_of_epsg;

    #[test]
    fn a_raster_has_its_values_place_and_system() {
        let values: Vec<f64> = (0..6).map(|i| if i == 4 { f64::NAN } else { f64::from(i) }).collect();
        let crs = wkt_of_epsg(25832).unwrap();
        let raster = Raster {
            columns: 3,
            rows: 2,
            side_m: 0.5,
            corner: [431_000.0, 5_412_000.0],
            values: &values,
            crs: Some(&crs),
        };
        let bytes = geotiff(&raster).unwrap();
        let mut file = Decoder::new(Cursor::new(&bytes)).unwrap();
        assert_eq!(file.dimensions().unwrap(), (3, 2));
        let tie = file.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap();
        assert_eq!(tie, [0.0, 0.0, 0.0, 431_000.0, 5_412_001.0, 0.0]);
        let keys = file.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).unwrap();
        assert!(keys.chunks_exact(4).any(|key| key == [PROJECTED_SYSTEM, 0, 1, 25832]), "{keys:?}");
        let DecodingResult::F32(read) = file.read_image().unwrap() else { panic!("other numbers") };
        // The northern row is first.
        assert_eq!((read[0], read[2], &read[3..]), (3.0, 5.0, &[0.0, 1.0, 2.0][..]));
        assert!(read[1].is_nan());
    }
}
