//! Coordinate reference systems and zones as options name them.

use super::values::ValueError;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use vlscan_base::error::Error;
use vlscan_base::files::reads;
use vlscan_base::recognise::{Expected, foreign};
use vlscan_crs as crs;
use vlscan_geom::{UnknownZone, UtmZone};
use vlscan_tables::input::read_file;

/// Maximum size of a file of well-known text, bytes.
const MAX_WKT_BYTES: u64 = 1 << 20;

/// A coordinate reference system.
#[derive(Clone, Debug, PartialEq)]
pub enum Crs {
    /// An EPSG code.
    Epsg(u32),
    /// Well-known text.
    Wkt(String),
    /// A file that holds it.
    File(PathBuf),
}

impl Crs {
    /// The well-known text, read from the file or looked up if need be.
    ///
    /// # Errors
    /// An unknown code; a file that cannot be read or holds something else.
    pub fn wkt(&self) -> Result<String, Error> {
        let path = match self {
            Crs::Epsg(code) => {
                return crs::wkt_of_epsg(*code).map_err(|e| Error::input(format!("--crs: {e}")));
            }
            Crs::Wkt(text) => return Ok(text.clone()),
            Crs::File(path) => path,
        };
        let bytes = read_file(path, MAX_WKT_BYTES).map_err(|e| Error::open(path, e))?;
        if let Some(found) = foreign(path, &bytes, &Expected::SYSTEM) {
            return Err(found.error(path));
        }
        let text = String::from_utf8_lossy(&bytes);
        if let Some(code) = crs::parse_epsg(&text) {
            return Crs::Epsg(code).wkt();
        }
        if crs::is_wkt(&text) {
            return Ok(text.trim().to_owned());
        }
        Err(Error::input(format!(
            "{} contains neither WKT such as PROJCRS[...] nor an EPSG code",
            path.display()
        )))
    }
}

impl FromStr for Crs {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Crs, ValueError> {
        let path = Path::new(text.trim());
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        if let Some(code) = crs::parse_epsg(text) {
            crs::wkt_of_epsg(code)?;
            Ok(Crs::Epsg(code))
        } else if crs::is_wkt(text) {
            Ok(Crs::Wkt(text.trim().to_owned()))
        } else if reads::is_file(path) || matches!(extension, "wkt" | "prj") {
            Ok(Crs::File(path.to_path_buf()))
        } else {
            Err(ValueError::Crs { found: text.to_owned(), hint: hint(text) })
        }
    }
}

/// Replacement for a form that is not read.
fn hint(text: &str) -> String {
    if text.contains('+') && !text.contains("+proj") {
        return "; name a compound system by its own code (EPSG:5555) or as WKT".to_owned();
    }
    UtmZone::parse(text.trim().trim_start_matches("UTM").trim_start_matches("utm"))
        .map_or_else(String::new, |zone| format!("; UTM zone {zone} on WGS 84 is EPSG:{}", zone.epsg()))
}

/// A UTM zone, such as 32N.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Zone(pub UtmZone);

impl FromStr for Zone {
    type Err = UnknownZone;

    fn from_str(text: &str) -> Result<Zone, UnknownZone> {
        text.parse().map(Zone)
    }
}
