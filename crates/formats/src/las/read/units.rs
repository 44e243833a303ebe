//! Units of positions, by the coordinate reference system that a file names: WKT, or GeoTIFF keys.

use super::error::LasError;
use super::header::{Fields, Header};
use vlscan_crs::{LengthUnit, Unit, Units, length_unit_in, wkt_of_epsg};
use vlscan_geom::DVec3;

const USER: &str = "LASF_Projection";
/// Numbers of the variable records with WKT, GeoTIFF keys, and their numbers and texts.
const WKT_RECORD: u16 = 2112;
const KEYS_RECORD: u16 = 34_735;
const DOUBLES_RECORD: u16 = 34_736;
const TEXTS_RECORD: u16 = 34_737;

/// GeoTIFF keys.
const MODEL_TYPE: u16 = 1024;
const PROJECTED_SYSTEM: u16 = 3072;
const PROJECTED_UNIT: u16 = 3076;
const PROJECTED_UNIT_METRES: u16 = 3077;
const VERTICAL_SYSTEM: u16 = 4096;
const VERTICAL_UNIT: u16 = 4099;
/// Values of [`MODEL_TYPE`] for longitude and latitude, and for distances from the centre of the Earth.
const GEOGRAPHIC: u16 = 2;
const GEOCENTRIC: u16 = 3;
/// Value of a key whose meaning other keys define.
const USER_DEFINED: u16 = 32_767;

/// Distances from the centre of the Earth that geocentric coordinates have, m.
const EARTH_RADII: std::ops::Range<f64> = 6_300_000.0..6_500_000.0;

/// A form of coordinates without easting, northing and height.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unprojected {
    /// Longitude and latitude.
    Geographic,
    /// Distances from the centre of the Earth.
    Geocentric,
}

impl Unprojected {
    /// Its name after "a system that is".
    pub fn name(self) -> &'static str {
        match self {
            Unprojected::Geographic => "in degrees",
            Unprojected::Geocentric => "geocentric",
        }
    }

    /// True if a position can have this form: some files name a system that their coordinates are not in.
    pub fn fits(self, position: DVec3) -> bool {
        match self {
            Unprojected::Geographic => position.x.abs() <= 360.0 && position.y.abs() <= 90.0,
            Unprojected::Geocentric => EARTH_RADII.contains(&position.length()),
        }
    }

    /// The error of a file whose coordinates have this form.
    pub fn error(self) -> LasError {
        match self {
            Unprojected::Geographic => LasError::Geographic,
            Unprojected::Geocentric => LasError::Geocentric,
        }
    }
}

/// The units of positions, and remarks about them.
#[derive(Debug, Default)]
pub(super) struct PositionUnits {
    /// Metres in a unit of x, y and z.
    pub metres: Option<DVec3>,
    /// The form of coordinates that cannot be read, by the system.
    pub unprojected: Option<Unprojected>,
    /// The system of the coordinates as WKT, if the file names one.
    pub crs: Option<String>,
    /// How the units were taken.
    pub note: Option<String>,
    /// Assumptions.
    pub warnings: Vec<String>,
}

/// The units of a file.
pub(super) fn position_units(file: Fields, header: &Header) -> Result<PositionUnits, LasError> {
    let record = |id| header.variable_record(file, USER, id);
    let wkt = record(WKT_RECORD)?;
    let keys = record(KEYS_RECORD)?;
    let is_wkt = header.states_wkt() || keys.is_none();
    let text = |record: &[u8]| String::from_utf8_lossy(record).trim_end_matches('\0').to_owned();
    Ok(match wkt.filter(|_| is_wkt) {
        Some(wkt) => {
            let wkt = text(wkt);
            let units = Units::of_wkt(&wkt);
            PositionUnits { crs: Some(wkt), ..PositionUnits::of(units) }
        }
        None => {
            let keys = Keys {
                words: keys
                    .unwrap_or_default()
                    .chunks_exact(2)
                    .map(|b| u16::from_le_bytes([b[0], b[1]]))
                    .collect(),
                doubles: record(DOUBLES_RECORD)?.unwrap_or_default(),
                texts: record(TEXTS_RECORD)?.map(text).unwrap_or_default(),
            };
            let (units, unknown) = keys.units();
            let mut found = PositionUnits::of(units);
            found.crs = keys.code(PROJECTED_SYSTEM).and_then(|code| wkt_of_epsg(code.into()).ok());
            found.warnings.extend(unknown);
            found
        }
    })
}

/// GeoTIFF keys, and the numbers and texts that they refer to.
struct Keys<'a> {
    words: Vec<u16>,
    doubles: &'a [u8],
    texts: String,
}

impl Keys<'_> {
    /// The entry of a key: key, place of the value (0 = here), count, value.
    fn entry(&self, key: u16) -> Option<&[u16]> {
        // A header of four numbers, then entries of four.
        self.words.chunks_exact(4).skip(1).find(|entry| entry[0] == key)
    }

    /// The code that is the value of a key; `None` for codes that mean "none".
    fn code(&self, key: u16) -> Option<u16> {
        let code = self.entry(key).filter(|entry| entry[1] == 0).map(|entry| entry[3]);
        code.filter(|code| !matches!(*code, 0 | USER_DEFINED))
    }

    fn double(&self, key: u16) -> Option<f64> {
        let entry = self.entry(key).filter(|entry| entry[1] == DOUBLES_RECORD)?;
        let at = 8 * usize::from(entry[3]);
        Some(f64::from_le_bytes(self.doubles.get(at..at + 8)?.try_into().ok()?))
    }

    /// The units, and remarks about unknown ones.
    fn units(&self) -> (Units, Vec<String>) {
        let unprojected = match self.code(MODEL_TYPE) {
            Some(GEOGRAPHIC) => Some(Unit::Angle),
            Some(GEOCENTRIC) => Some(Unit::Geocentric),
            _ => None,
        };
        if unprojected.is_some() {
            return (Units { horizontal: unprojected, vertical: None }, Vec::new());
        }
        let stated = |key: u16| self.code(key).map(|code| (code, LengthUnit::of_epsg(code)));
        let unit = |stated: &Option<(u16, Option<LengthUnit>)>| stated.clone().and_then(|(_, unit)| unit);
        let (across, up) = (stated(PROJECTED_UNIT), stated(VERTICAL_UNIT));
        let own = self.double(PROJECTED_UNIT_METRES).filter(|metres| metres.is_finite() && *metres > 0.0);
        let own = own.map(|metres| LengthUnit::defined("custom units", metres));
        let system = self.code(PROJECTED_SYSTEM);
        let wkt = system.and_then(|code| wkt_of_epsg(code.into()).ok());
        let of_system = wkt.as_deref().map(Units::of_wkt).unwrap_or_default();
        let own = unit(&across).or(own).map(Unit::Length).or(of_system.horizontal);
        let horizontal = own.or_else(|| length_unit_in(&self.texts).map(Unit::Length));
        let of_heights = || self.code(VERTICAL_SYSTEM).and_then(LengthUnit::of_heights);
        let vertical = unit(&up).or_else(of_heights).map(Unit::Length).or(of_system.vertical);
        let mut unknown = Vec::new();
        let name = |unit: Option<&Unit>| {
            unit.and_then(Unit::length).map_or_else(|| "metres".to_owned(), |unit| unit.name.clone())
        };
        let instead = [name(horizontal.as_ref()), name(vertical.as_ref().or(horizontal.as_ref()))];
        for (stated, (what, instead)) in
            [across, up].into_iter().zip(["x and y", "heights"].into_iter().zip(instead))
        {
            if let Some((code, None)) = stated {
                unknown.push(format!(
                    "the unit of its {what} (EPSG code {code}) is not known; {instead} are assumed"
                ));
            }
        }
        if let (Some(code), None, None) = (system, wkt, &horizontal) {
            unknown.push(format!(
                "its system EPSG:{code} is not built in, so its unit is unknown; metres are assumed"
            ));
        }
        (Units { horizontal, vertical }, unknown)
    }
}

impl PositionUnits {
    fn of(Units { horizontal, vertical }: Units) -> PositionUnits {
        let unprojected = match &horizontal {
            Some(Unit::Angle) => Some(Unprojected::Geographic),
            Some(Unit::Geocentric) => Some(Unprojected::Geocentric),
            _ => None,
        };
        if unprojected.is_some() {
            return PositionUnits { unprojected, ..PositionUnits::default() };
        }
        let across = horizontal.as_ref().and_then(Unit::length);
        let up = vertical.as_ref().and_then(Unit::length);
        if [across, up].into_iter().flatten().all(LengthUnit::is_metre) {
            return PositionUnits::default();
        }
        let metre = LengthUnit::defined("m", 1.0);
        let (x, z) = (across.unwrap_or(&metre), up.or(across).unwrap_or(&metre));
        let assumed = match (across, up) {
            (None, _) => Some("the unit of x and y is not stated; metres are assumed".to_owned()),
            (_, None) => {
                Some(format!("the unit of its heights is not stated; that of x and y is assumed: {}", x.name))
            }
            _ => None,
        };
        PositionUnits {
            metres: Some(DVec3::new(x.metres, x.metres, z.metres)),
            unprojected: None,
            crs: None,
            note: Some(format!(
                "according to its coordinate reference system x and y are in {} ({} m), heights in {} ({} \
                 m); all are converted to metres",
                x.name, x.metres, z.name, z.metres
            )),
            warnings: assumed.into_iter().collect(),
        }
    }
}
