//! Rasters as GeoTIFF (OGC 19-008r4): bands of 32-bit floats, compressed with Deflate, NaN for cells without
//! a value.

use std::fmt::Write as _;
use std::io::Cursor;
use tiff::encoder::compression::DeflateLevel;
use tiff::encoder::{Compression, TiffEncoder, colortype::Gray32Float};
use tiff::tags::{ExtraSamples, Tag};
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
/// Tag of the metadata of GDAL, where the names of bands are.
const GDAL_METADATA: Tag = Tag::Unknown(42112);

/// Size, place and system of a raster of square cells.
#[derive(Clone, Copy, Debug)]
pub struct Grid<'a> {
    /// Number of cells from west to east.
    pub columns: usize,
    /// Number of cells from south to north.
    pub rows: usize,
    /// Side of a cell, m.
    pub side_m: f64,
    /// World coordinates of the south-western corner, m.
    pub corner: [f64; 2],
    /// System of the coordinates as WKT; its EPSG code is written, if it has one.
    pub crs: Option<&'a str>,
}

/// A band of a raster with several.
#[derive(Clone, Copy, Debug)]
pub struct Band<'a> {
    /// Name, of letters, digits and underscores.
    pub name: &'a str,
    /// Values row by row from the south west; NaN without a value.
    pub values: &'a [f64],
}

/// The bytes of a GeoTIFF file with one band: values row by row from the south west, NaN without a value.
///
/// # Errors
/// [`Error::Input`] for a raster that is too large for a TIFF file.
pub fn geotiff(grid: &Grid, values: &[f64]) -> Result<Vec<u8>> {
    geotiff_of_bands(grid, &[Band { name: "", values }])
}

/// The bytes of a GeoTIFF file with several bands, whose names GDAL reads.
///
/// # Errors
/// [`Error::Input`] for a raster that is too large for a TIFF file.
pub fn geotiff_of_bands(grid: &Grid, bands: &[Band]) -> Result<Vec<u8>> {
    encoded(grid, bands).map_err(|problem| Error::input(format!("a raster cannot be written: {problem}")))
}

/// The names of bands as GDAL reads them.
fn metadata(bands: &[Band]) -> String {
    let mut text = String::from("<GDALMetadata>\n");
    for (i, band) in bands.iter().enumerate() {
        let name = band.name;
        let _ =
            writeln!(text, "<Item name=\"DESCRIPTION\" sample=\"{i}\" role=\"description\">{name}</Item>");
    }
    text + "</GDALMetadata>"
}

fn encoded(grid: &Grid, bands: &[Band]) -> tiff::TiffResult<Vec<u8>> {
    let Grid { columns, rows, side_m, corner: [west, south], .. } = *grid;
    let size = |count: usize| u32::try_from(count).map_err(|_| tiff::TiffError::IntSizeError);
    let mut file = Cursor::new(Vec::new());
    let mut encoder =
        TiffEncoder::new(&mut file)?.with_compression(Compression::Deflate(DeflateLevel::Balanced));
    let mut image = encoder.new_image::<Gray32Float>(size(columns)?, size(rows)?)?;
    if bands.len() > 1 {
        image.extra_samples(&vec![ExtraSamples::Unspecified; bands.len() - 1])?;
        image.encoder().write_tag(GDAL_METADATA, metadata(bands).as_str())?;
    }
    let north = south + rows as f64 * side_m;
    let tags = image.encoder();
    tags.write_tag(Tag::ModelPixelScaleTag, &[side_m, side_m, 0.0][..])?;
    tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, west, north, 0.0][..])?;
    let mut keys = vec![[MODEL_TYPE, 0, 1, PROJECTED_MODEL], [RASTER_TYPE, 0, 1, PIXEL_IS_AREA]];
    if let Some(code) = grid.crs.and_then(projected_epsg) {
        keys.push([PROJECTED_SYSTEM, 0, 1, code]);
    }
    keys.push([PROJECTED_UNIT, 0, 1, METRE]);
    let head = [1, 1, 0, keys.len() as u16];
    let words: Vec<u16> = head.into_iter().chain(keys.into_iter().flatten()).collect();
    tags.write_tag(Tag::GeoKeyDirectoryTag, &words[..])?;
    tags.write_tag(Tag::GdalNodata, "nan")?;
    let mut values = Vec::with_capacity(columns * rows * bands.len());
    for row in (0..rows).rev() {
        for cell in row * columns..(row + 1) * columns {
            let value = |band: &Band| band.values.get(cell).map_or(f32::NAN, |value| *value as f32);
            values.extend(bands.iter().map(value));
        }
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
        let corner = [431_000.0, 5_412_000.0];
        let grid = Grid { columns: 3, rows: 2, side_m: 0.5, corner, crs: Some(&crs) };
        let bytes = geotiff(&grid, &values).unwrap();
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

    #[test]
    fn bands_have_their_names_and_alternate() {
        let (first, second) = ([1.0, 2.0, 3.0, 4.0], [10.0, 20.0, f64::NAN, 40.0]);
        let grid = Grid { columns: 2, rows: 2, side_m: 10.0, corner: [0.0, 0.0], crs: None };
        let bands = [Band { name: "pulse_density", values: &first }, Band { name: "gaps", values: &second }];
        let bytes = geotiff_of_bands(&grid, &bands).unwrap();
        let mut file = Decoder::new(Cursor::new(&bytes)).unwrap();
        assert_eq!(file.dimensions().unwrap(), (2, 2));
        assert_eq!(file.get_tag_u32(Tag::SamplesPerPixel).unwrap(), 2);
        let names = file.get_tag_ascii_string(GDAL_METADATA).unwrap();
        assert!(names.contains("sample=\"1\" role=\"description\">gaps</Item>"), "{names}");
        let DecodingResult::F32(read) = file.read_image().unwrap() else { panic!("other numbers") };
        // The northern row is first.
        assert_eq!((read[0], &read[4..]), (3.0, &[1.0, 10.0, 2.0, 20.0][..]));
        assert!(read[1].is_nan() && (read[2], read[3]) == (4.0, 40.0), "{read:?}");
    }
}
