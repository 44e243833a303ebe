//! The keys of GeoTIFF files (OGC GeoTIFF 1.1): what coordinates are, and in which unit; GDAL's metadata of
//! the first band.

use super::error::RasterError;
use super::file::Directory;
use super::georeference::doubles;
use super::prj::prj_text;
use std::path::Path;
use tiff::tags::Tag;
use vlscan_crs as crs;
pub(super) use vlscan_crs::LengthUnit;

/// The unit of values that state none.
pub(super) const METRES: &str = "metres";
const MODEL_TYPE_KEY: u16 = 1024;
const MODEL_IS_GEOGRAPHIC: u16 = 2;
const RASTER_TYPE_KEY: u16 = 1025;
const PIXEL_IS_POINT: u16 = 2;
const GEOGRAPHIC_SYSTEM_KEY: u16 = 2048;
const PROJECTED_SYSTEM_KEY: u16 = 3072;
const PROJECTED_UNIT_KEY: u16 = 3076;
const PROJECTED_UNIT_SIZE_KEY: u16 = 3077;
const VERTICAL_SYSTEM_KEY: u16 = 4096;
const VERTICAL_UNIT_KEY: u16 = 4099;
/// Value of a key whose meaning other keys define.
const USER_DEFINED: u16 = 32_767;
/// Place of values that are in the tag of numbers.
const DOUBLE_PARAMETERS: u16 = 34_736;
/// Systems of EPSG (version 12.029) whose axis points downwards.
const DEPTHS: &[u16] = &[
    5336, 5612, 5614, 5706, 5715, 5734, 5739, 5789, 5831, 5861, 5862, 5863, 5864, 5865, 5866, 5867, 5873,
    6357, 6358, 6359, 7976, 8051, 8053, 8358, 8378, 8897, 9287, 9288, 9672, 10_150, 10_151, 10_349, 10_364,
    10_370, 10_371, 10_372, 10_373, 10_374, 10_375, 10_376, 10_377, 10_378, 10_379, 10_547, 10_548, 10_549,
    10_550, 10_551, 10_552, 10_649, 10_650, 10_678,
];
const GDAL_METADATA_TAG: Tag = Tag::Unknown(42_112);

/// The value of a GeoKey that is a number in the directory itself.
fn key(directory: &mut Directory, key: u16) -> Result<Option<u16>, RasterError> {
    Ok(find(directory, key)?.filter(|entry| entry[1] == 0).map(|entry| entry[3]))
}

/// The entry of a GeoKey: key, location (0 = here), count, value.
fn find(directory: &mut Directory, key: u16) -> Result<Option<[u16; 4]>, RasterError> {
    let tag = Tag::GeoKeyDirectoryTag;
    let keys = directory.find_tag(tag).and_then(|value| value.map(|v| v.into_u16_vec()).transpose());
    let keys = keys.map_err(|source| RasterError::Tag { tag, source })?.unwrap_or_default();
    // A header of four numbers, then entries of four.
    let entry = keys.chunks_exact(4).skip(1).find(|k| k[0] == key);
    Ok(entry.and_then(|entry| entry.try_into().ok()))
}

pub(super) fn is_point(directory: &mut Directory) -> Result<bool, RasterError> {
    Ok(key(directory, RASTER_TYPE_KEY)? == Some(PIXEL_IS_POINT))
}

/// Coordinate reference system that a raster states.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum System {
    /// Nothing.
    Unknown,
    /// A code of EPSG.
    Epsg(u16),
    /// A definition, in the text and numbers of its keys or as WKT.
    Defined(String, Vec<f64>),
}

impl System {
    /// The system that the keys of a raster name, or the `.prj` file next to it.
    pub fn of(directory: &mut Directory, path: &Path) -> Result<System, RasterError> {
        let code = epsg(directory, PROJECTED_SYSTEM_KEY).or_else(|| epsg(directory, GEOGRAPHIC_SYSTEM_KEY));
        if let Some(code) = code {
            return Ok(System::Epsg(code));
        }
        if key(directory, MODEL_TYPE_KEY)?.is_some() {
            let numbers = doubles(directory, Tag::GeoDoubleParamsTag)?.unwrap_or_default();
            return Ok(System::Defined(citation(directory).unwrap_or_default(), numbers));
        }
        Ok(prj_text(path).map_or(System::Unknown, |text| System::of_wkt(&text)))
    }

    /// The system of a text: WKT or a code such as `EPSG:25832`.
    pub fn of_wkt(text: &str) -> System {
        let code = match crs::is_wkt(text) {
            true => crs::projected_epsg(text).or_else(|| crs::epsg(text).map(|(_, code)| code)),
            false => crs::parse_epsg(text).and_then(|code| u16::try_from(code).ok()),
        };
        code.map_or_else(|| System::Defined(text.trim().to_owned(), Vec::new()), System::Epsg)
    }

    /// Its name in messages.
    pub fn name(&self) -> String {
        match self {
            System::Unknown => "no system that it names".to_owned(),
            System::Epsg(code) => format!("EPSG:{code}"),
            System::Defined(text, _) if crs::is_wkt(text) => crs::name(text),
            System::Defined(text, _) => {
                format!("a system of its own ({})", text.trim_end_matches(['|', '\0']))
            }
        }
    }
}

/// True if the system is one of longitude and latitude; `None` if the keys do not state it.
pub(super) fn is_geographic(directory: &mut Directory) -> Option<bool> {
    key(directory, MODEL_TYPE_KEY).ok().flatten().map(|kind| kind == MODEL_IS_GEOGRAPHIC)
}

/// EPSG code of the projected system; `None` for one that the user defined.
pub(super) fn projected_epsg(directory: &mut Directory) -> Option<u16> {
    epsg(directory, PROJECTED_SYSTEM_KEY)
}

fn epsg(directory: &mut Directory, system: u16) -> Option<u16> {
    key(directory, system).ok().flatten().filter(|&code| code > 0 && code < USER_DEFINED)
}

/// The unit of easting and northing: that of its key, else that of the system, else that of WKT in the
/// citation or beside the raster at `path`. `None` if nothing names a projected system; the error is a unit
/// that is not known.
pub(super) fn horizontal_unit(
    directory: &mut Directory,
    path: &Path,
) -> Result<Option<LengthUnit>, RasterError> {
    let code = key(directory, PROJECTED_UNIT_KEY)?.filter(|&code| code > 0);
    if let Some(code) = code.filter(|&code| code != USER_DEFINED) {
        let unit = LengthUnit::of_epsg(code);
        return unit
            .map(Some)
            .ok_or_else(|| no_unit(format!("the unit of its coordinates (EPSG code {code}) is not known")));
    }
    let system = key(directory, PROJECTED_SYSTEM_KEY)?.filter(|&code| code > 0);
    let of_system = |code: u16| crs::length_unit(code.into());
    let unit = match own_unit(directory)? {
        Some(unit) => Some(unit),
        None => system.and_then(of_system).or_else(|| length_in(&text_of_system(directory, path)?)),
    };
    match (unit, code, system) {
        (Some(unit), ..) => Ok(Some(unit)),
        (None, Some(_), _) => Err(no_unit(
            "the unit of its coordinates is user-defined (key 3076 is 32767), but its length (key 3077) \
                 is missing",
        )),
        (None, None, Some(USER_DEFINED)) => Err(no_unit(
            "the unit of its coordinates (key 3076) is missing, and their system is user-defined",
        )),
        (None, None, Some(code)) => Err(no_unit(format!(
            "the unit of its coordinates (key 3076) is missing, and their system, EPSG:{code}, is not a \
             built-in projected system"
        ))),
        (None, None, None) => Ok(None),
    }
}

fn no_unit(what: impl Into<String>) -> RasterError {
    RasterError::Unit { what: what.into() }
}

/// The unit whose length the keys have.
fn own_unit(directory: &mut Directory) -> Result<Option<LengthUnit>, RasterError> {
    let entry = find(directory, PROJECTED_UNIT_SIZE_KEY)?.filter(|entry| entry[1] == DOUBLE_PARAMETERS);
    let numbers = doubles(directory, Tag::GeoDoubleParamsTag)?.unwrap_or_default();
    let metres = entry.and_then(|entry| numbers.get(entry[3] as usize).copied());
    let metres = metres.filter(|m| m.is_finite() && *m > 0.0);
    Ok(metres.map(|metres| LengthUnit { metres, name: format!("units of {metres} m") }))
}

/// The text of the keys, which is WKT if programs of ESRI wrote the file.
fn citation(directory: &mut Directory) -> Option<String> {
    directory.get_tag_ascii_string(Tag::GeoAsciiParamsTag).ok()
}

/// The text that may have WKT: the citation, else that of the `.prj` file, if no keys state a system.
fn text_of_system(directory: &mut Directory, path: &Path) -> Option<String> {
    citation(directory).or_else(|| match key(directory, MODEL_TYPE_KEY) {
        Ok(None) => prj_text(path),
        _ => None,
    })
}

/// The unit of easting and northing of a text: WKT, a citation with WKT in it, or a code such as
/// `EPSG:25832`.
pub(super) fn length_in(text: &str) -> Option<LengthUnit> {
    if let Some(code) = crs::parse_epsg(text) {
        return crs::length_unit(code);
    }
    let of_wkt = crs::Units::of_wkt(text).horizontal.and_then(|unit| unit.length().cloned());
    of_wkt.or_else(|| crs::length_unit_in(text))
}

/// The unit of heights of a text with a system of heights in WKT.
pub(super) fn height_unit_in(text: &str) -> Option<LengthUnit> {
    crs::Units::of_wkt(heights_in(text)?).vertical?.length().cloned()
}

/// The part of a text that begins with a system of heights in WKT.
fn heights_in(text: &str) -> Option<&str> {
    let starts = ["VERTCS[", "VERT_CS[", "VERTCRS[", "VERTICALCRS["];
    starts.iter().find_map(|start| text.find(start)).map(|at| &text[at..])
}

/// The unit of heights: that of the metadata, else that of its key, else that of the system, else that of WKT
/// in the citation or beside the raster at `path`. `None` if nothing is said about heights; the error is a
/// unit that is not known.
pub(super) fn vertical_unit(
    directory: &mut Directory,
    path: &Path,
    band: &BandMetadata,
) -> Result<Option<LengthUnit>, RasterError> {
    if let Some(name) = band.unit.as_deref().map(str::trim).filter(|name| !name.is_empty()) {
        let unit = LengthUnit::of_name(name);
        return unit
            .map(Some)
            .ok_or_else(|| no_unit(format!("the unit \"{name}\" of its heights is not known")));
    }
    let code = key(directory, VERTICAL_UNIT_KEY)?.filter(|&code| code > 0);
    if let Some(code) = code.filter(|&code| code != USER_DEFINED) {
        let unit = LengthUnit::of_epsg(code);
        return unit
            .map(Some)
            .ok_or_else(|| no_unit(format!("the unit of its heights (EPSG code {code}) is not known")));
    }
    let system = key(directory, VERTICAL_SYSTEM_KEY)?;
    let unit = system.and_then(LengthUnit::of_heights);
    let unit = unit.or_else(|| height_unit_in(&text_of_system(directory, path)?));
    if unit.is_none() && (code.is_some() || system == Some(USER_DEFINED)) {
        return Err(no_unit(
            "the unit of its heights (key 4099) is user-defined or missing, and so is their system",
        ));
    }
    Ok(unit)
}

/// The name of the system of heights if it is one of depths: its numbers grow downwards.
pub(super) fn system_of_depths(directory: &mut Directory, path: &Path) -> Option<String> {
    if let Some(code) = epsg(directory, VERTICAL_SYSTEM_KEY) {
        return DEPTHS.contains(&code).then(|| format!("EPSG:{code}"));
    }
    let text = text_of_system(directory, path)?;
    let system = heights_in(&text)?;
    let plain = system.to_ascii_uppercase().replace(' ', "");
    let is_down = [",DOWN]", ",DOWN,", "\"DIRECTION\",-1"].iter().any(|sign| plain.contains(sign));
    is_down.then(|| crs::name(system))
}

/// GDAL's metadata of the first band.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BandMetadata {
    /// Heights are number · scale + offset.
    pub scale: f64,
    pub offset: f64,
    /// The unit of heights.
    pub unit: Option<String>,
}

impl Default for BandMetadata {
    fn default() -> BandMetadata {
        BandMetadata { scale: 1.0, offset: 0.0, unit: None }
    }
}

/// Reads GDAL's metadata; the error is a value that cannot be read.
pub(super) fn band_metadata(directory: &mut Directory) -> Result<BandMetadata, RasterError> {
    let mut found = BandMetadata::default();
    if directory.find_tag(GDAL_METADATA_TAG)?.is_none() {
        return Ok(found);
    }
    let text = directory.get_tag_ascii_string(GDAL_METADATA_TAG)?;
    let document = roxmltree::Document::parse(text.trim_end_matches('\0')).map_err(RasterError::Metadata)?;
    let items = document.descendants().filter(|node| node.has_tag_name("Item"));
    for item in items.filter(|item| item.attribute("sample").is_none_or(|band| band == "0")) {
        let text = item.text().unwrap_or_default().trim();
        let number = || text.parse::<f64>().ok().filter(|v| v.is_finite());
        let wrong = |what| RasterError::MetadataValue { what, found: text.to_owned() };
        match item.attribute("role") {
            Some("scale") => found.scale = number().filter(|s| *s != 0.0).ok_or_else(|| wrong("scale"))?,
            Some("offset") => found.offset = number().ok_or_else(|| wrong("offset"))?,
            Some("unittype") => found.unit = Some(text.to_owned()),
            _ => {}
        }
    }
    Ok(found)
}

/// The no-data value of pixels; `None` without its tag, an error if the tag is not text or not a number.
pub(super) fn no_data(directory: &mut Directory) -> Result<Option<f64>, RasterError> {
    let tag = Tag::GdalNodata;
    let unread = |source| RasterError::Tag { tag, source };
    if directory.find_tag(tag).map_err(unread)?.is_none() {
        return Ok(None);
    }
    let text = directory.get_tag_ascii_string(tag).map_err(unread)?;
    let text = text.trim_matches(|c: char| c.is_whitespace() || c == '\0');
    // As the libraries of other systems write numbers that are none.
    let is_nan = ["#qnan", "#ind", "#snan"].iter().any(|end| text.to_lowercase().ends_with(end));
    if is_nan {
        return Ok(Some(f64::NAN));
    }
    text.parse().map(Some).map_err(|_| RasterError::NoData(text.to_owned()))
}
