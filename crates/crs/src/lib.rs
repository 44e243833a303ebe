//! Coordinate reference systems as well-known text (WKT): by EPSG code, by UTM zone, and the codes in a text.

#![deny(unsafe_code)]

mod area;
mod units;

pub use area::{Place, Wgs84, Wgs84Error, distortion, misfit, place_of};
pub use units::{LengthUnit, Unit, Units};

use vlscan_geom::UtmZone;

/// Kind of system that an EPSG code denotes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EpsgKind {
    /// Easting and northing.
    Projected,
    /// Longitude and latitude.
    Geographic,
    /// A horizontal system and one of heights.
    Compound,
}

/// Returns the code of a system in WKT 1 or 2. The code of the system as such is its last element.
pub fn epsg(wkt: &str) -> Option<(EpsgKind, u16)> {
    let kind = match keyword(wkt).as_str() {
        "PROJCS" | "PROJCRS" | "PROJECTEDCRS" => EpsgKind::Projected,
        "GEOGCS" | "GEOGCRS" | "GEOGRAPHICCRS" => EpsgKind::Geographic,
        "COMPD_CS" | "COMPOUNDCRS" => EpsgKind::Compound,
        _ => return None,
    };
    let compact: String = wkt.chars().filter(|c| !c.is_whitespace() && *c != '\0').collect();
    let body = compact.strip_suffix("]]").or(compact.strip_suffix("))"))?;
    let last = body.rsplit(['[', '(']).next()?;
    let (authority, code) = last.split_once(',')?;
    let code = code.trim_matches('"').parse().ok()?;
    authority.eq_ignore_ascii_case("\"EPSG\"").then_some((kind, code))
}

fn keyword(wkt: &str) -> String {
    wkt.trim_start().split(['[', '(']).next().unwrap_or_default().trim().to_ascii_uppercase()
}

/// True if a text looks like WKT.
pub fn is_wkt(text: &str) -> bool {
    text.trim_start().starts_with(|c: char| c.is_ascii_alphabetic()) && text.contains('[')
}

/// Why an EPSG code names no system of points.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EpsgError {
    /// The code is not known.
    #[error("EPSG:{0} is not built in; give its WKT instead")]
    Unknown(u32),
    /// The system has heights alone, or is geocentric.
    #[error("EPSG:{code} ({name}) has no easting and northing; name a projected or compound system")]
    NotHorizontal {
        /// The code.
        code: u32,
        /// Name of the system.
        name: String,
    },
}

/// Returns the WKT 1 of an EPSG code.
///
/// # Errors
/// An unknown code, or one of a system without easting and northing.
pub fn wkt_of_epsg(code: u32) -> Result<String, EpsgError> {
    let known = u16::try_from(code).ok().and_then(crs_definitions::from_code);
    // The definitions of some codes have no WKT.
    let definition = known.filter(|definition| !definition.wkt.is_empty()).ok_or(EpsgError::Unknown(code))?;
    match keyword(definition.wkt).as_str() {
        "PROJCS" | "GEOGCS" | "COMPD_CS" => Ok(without_shifts(definition.wkt)),
        _ => Err(EpsgError::NotHorizontal { code, name: name(definition.wkt) }),
    }
}

/// Returns the WKT of a UTM zone on WGS 84.
pub fn wkt_of_zone(zone: UtmZone) -> Option<String> {
    wkt_of_epsg(zone.epsg()).ok()
}

/// Removes the TOWGS84 elements, which are not part of a system's definition: readers that compare
/// definitions do not find the code of a system with them.
fn without_shifts(wkt: &str) -> String {
    const SHIFT: &str = ",TOWGS84[";
    let mut text = String::with_capacity(wkt.len());
    let mut rest = wkt;
    while let Some((before, after)) = rest.split_once(SHIFT) {
        text.push_str(before);
        rest = after.split_once(']').map_or("", |(_, rest)| rest);
    }
    text + rest
}

/// Returns the parsed form of `EPSG:25832`, or of the number alone; `None` for all other texts.
pub fn parse_epsg(text: &str) -> Option<u32> {
    let text = text.trim();
    let code = match text.split_once(':') {
        Some((authority, code)) => authority.eq_ignore_ascii_case("EPSG").then_some(code.trim())?,
        None => text,
    };
    (code.len() <= 6).then(|| code.parse().ok()).flatten()
}

/// Returns the name of a system, with its EPSG code.
pub fn name(wkt: &str) -> String {
    let name = wkt.split('"').nth(1).filter(|name| !name.is_empty()).unwrap_or("unnamed");
    match epsg(wkt) {
        Some((_, code)) => format!("{name} (EPSG:{code})"),
        None => name.to_owned(),
    }
}

/// Returns the EPSG code of a system as text, or its name if it has none.
pub fn short_name(wkt: &str) -> String {
    epsg(wkt).map_or_else(|| name(wkt), |(_, code)| format!("EPSG:{code}"))
}

/// True if two systems are known to differ in easting and northing: by their codes, else by their UTM zones.
pub fn differ(one: &str, other: &str) -> bool {
    let (one, other) = (horizontal(one), horizontal(other));
    if let (Some((_, a)), Some((_, b))) = (epsg(one), epsg(other)) {
        return a != b;
    }
    matches!((UtmZone::of_wkt(one), UtmZone::of_wkt(other)), (Some(a), Some(b)) if a != b)
}

/// The projected system of a compound one in WKT 1; other texts unchanged.
fn horizontal(wkt: &str) -> &str {
    if !matches!(epsg(wkt), Some((EpsgKind::Compound, _))) {
        return wkt;
    }
    let range = wkt.find("PROJCS[").zip(wkt.find(",VERT_CS["));
    range.and_then(|(from, to)| wkt.get(from..to)).unwrap_or(wkt)
}

/// Returns the EPSG code of a projected system, or of the one in a compound system, in WKT 1 or 2.
pub fn projected_epsg(wkt: &str) -> Option<u16> {
    let start = ["PROJCS", "PROJCRS", "PROJECTEDCRS"].iter().find_map(|name| wkt.find(name))?;
    let text = &wkt[start..];
    let mut depth = 0;
    let end = text.char_indices().find_map(|(at, c)| {
        depth += match c {
            '[' | '(' => 1,
            ']' | ')' => -1,
            _ => 0,
        };
        (depth == 0 && matches!(c, ']' | ')')).then_some(at + 1)
    });
    epsg(&text[..end?]).map(|(_, code)| code)
}

/// Returns the unit of easting and northing of a projected or compound system by its EPSG code. `None` for
/// other systems and unknown codes.
pub fn length_unit(code: u32) -> Option<LengthUnit> {
    let wkt = u16::try_from(code).ok().and_then(crs_definitions::from_code)?.wkt;
    length_unit_in(horizontal(wkt))
}

/// Returns the unit of easting and northing of the first projected system in a text that holds WKT 1, as
/// [`length_unit`] does.
pub fn length_unit_in(text: &str) -> Option<LengthUnit> {
    let wkt = &text[text.find("PROJCS[")?..];
    let wkt = wkt.find("VERT_CS[").or(wkt.find("VERTCS[")).map_or(wkt, |end| &wkt[..end]);
    // The unit of the system itself comes after those of the systems that it is made of.
    let unit = &wkt[wkt.rfind("UNIT[\"")? + "UNIT[\"".len()..];
    let (name, rest) = unit.split_once("\",")?;
    let length = rest.split([',', ']']).next()?.trim().parse().ok()?;
    Some(LengthUnit::defined(name, length))
}

/// Returns why horizontal coordinates in metres cannot be in this system.
pub fn unit_problem(wkt: &str) -> Option<String> {
    describe_unit("coordinates", &Units::of_wkt(wkt).horizontal?)
}

/// Returns why heights in metres cannot be in this system.
pub fn height_problem(wkt: &str) -> Option<String> {
    describe_unit("heights", &Units::of_wkt(wkt).vertical?)
}

/// Describes a unit of `what` other than the metre.
fn describe_unit(what: &str, unit: &Unit) -> Option<String> {
    let name = match unit {
        Unit::Angle => "degrees",
        Unit::Geocentric => {
            return Some(format!("its {what} are geocentric, but z is up in scene and points"));
        }
        Unit::Length(unit) if unit.is_metre() => return None,
        Unit::Length(unit) => unit.name.as_str(),
    };
    Some(format!("its {what} are {name}, but scene and points are in metres"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_code_of_the_whole_system_counts() {
        let one = r#"PROJCS["ETRS89 / UTM 32N",GEOGCS["ETRS89",AUTHORITY["EPSG","4258"]],AUTHORITY["EPSG","25832"]]"#;
        assert_eq!(epsg(one), Some((EpsgKind::Projected, 25832)));
        let two = "GEOGCRS[\"WGS 84\",\n  DATUM[\"World\"],\n  ID[\"EPSG\",4326]]\0";
        assert_eq!(epsg(two), Some((EpsgKind::Geographic, 4326)));
        let inner = r#"PROJCS["mine",GEOGCS["ETRS89",AUTHORITY["EPSG","4258"]],UNIT["metre",1]]"#;
        assert_eq!(epsg(inner), None);
        let compound = format!(r#"COMPD_CS["both",{one},VERT_CS["DHHN2016",AUTHORITY["EPSG","7837"]]]"#);
        assert_eq!(
            [one, compound.as_str(), inner, two].map(projected_epsg),
            [Some(25832), Some(25832), None, None]
        );
        assert_eq!(epsg(r#"COMPD_CS["both",AUTHORITY["EPSG","5555"]]"#), Some((EpsgKind::Compound, 5555)));
        assert_eq!(epsg(r#"LOCAL_CS["mine",AUTHORITY["EPSG","5555"]]"#), None);
        assert_eq!(epsg(""), None);
    }

    #[test]
    fn codes_have_their_definitions() {
        for (code, named) in
            [(25832, "ETRS89 / UTM zone 32N"), (2193, "NZGD2000 / New Zealand"), (5555, "DHHN92")]
        {
            let wkt = wkt_of_epsg(code).unwrap();
            assert!(wkt.contains(named) && !wkt.contains("TOWGS84"), "{wkt}");
            assert_eq!(wkt.matches('[').count(), wkt.matches(']').count());
            assert_eq!(epsg(&wkt).map(|(_, code)| u32::from(code)), Some(code));
        }
        for code in [1, 3993] {
            assert_eq!(wkt_of_epsg(code), Err(EpsgError::Unknown(code)));
        }
        assert!(wkt_of_epsg(4978).unwrap_err().to_string().contains("no easting"));
        for (text, zone) in [("32N", 32632), ("7S", 32707)] {
            let zone_wkt = wkt_of_zone(UtmZone::parse(text).unwrap()).unwrap();
            assert_eq!(epsg(&zone_wkt), Some((EpsgKind::Projected, zone)));
            assert_eq!(UtmZone::of_wkt(&zone_wkt), UtmZone::parse(text));
        }
        assert_eq!(
            ["EPSG:25832", " epsg: 25832", "25832", "EPSG:25832+7837", "25832x", "IGNF:25832"]
                .map(parse_epsg),
            [Some(25832), Some(25832), Some(25832), None, None, None]
        );
    }

    #[test]
    fn systems_differ_by_code_or_by_zone() {
        let wkt = |code| wkt_of_epsg(code).unwrap();
        assert!(differ(&wkt(25832), &wkt(25833)) && differ(&wkt(25832), &wkt(2193)));
        assert!(!differ(&wkt(25832), &wkt(5555)), "the same with heights");
        let esri = r#"PROJCS["ETRS_1989_UTM_Zone_32N",GEOGCS["GCS_ETRS_1989",DATUM["D_ETRS_1989"]]]"#;
        let esri = esri.replace("ETRS_1989\"", "ETRS89\"");
        assert!(!differ(&wkt(25832), &esri) && differ(&wkt(25833), &esri));
        assert!(!differ(&wkt(2193), r#"PROJCS["mine",UNIT["metre",1]]"#), "nothing is known of it");
        assert_eq!(name(&wkt(25832)), "ETRS89 / UTM zone 32N (EPSG:25832)");
    }

    #[test]
    fn projected_systems_have_their_units() {
        for (code, metres) in [(2227, 1200.0 / 3937.0), (25832, 1.0), (2222, 0.3048), (5555, 1.0)] {
            let found = length_unit(code).unwrap().metres;
            assert!((found - metres).abs() < 1e-12, "{code}: {found}");
        }
        assert_eq!(length_unit(4326), None);
    }

    #[test]
    fn units_other_than_metres_are_found() {
        let problem = |code| unit_problem(&wkt_of_epsg(code).unwrap());
        // Geographic, with heights, in US survey feet, and in kilometres.
        for (code, unit) in [
            (4326, "degrees"),
            (5498, "degrees"),
            (2263, "US survey feet"),
            (2314, "Clarke's feet"),
            (22_300, "kilometres"),
        ] {
            let found = problem(code).unwrap();
            assert!(found.starts_with(&format!("its coordinates are {unit}, but")), "{code}: {found}");
        }
        assert_eq!((problem(25832), problem(5555)), (None, None));
        let wkt = wkt_of_epsg(5555).unwrap();
        assert_eq!(height_problem(&wkt), None);
        let (horizontal, heights) = wkt.split_at(wkt.find("VERT_CS[").unwrap());
        let in_feet = horizontal.to_owned() + &heights.replace("UNIT[\"metre\",1", "UNIT[\"foot\",0.3048");
        assert_eq!(unit_problem(&in_feet), None);
        assert!(height_problem(&in_feet).unwrap().starts_with("its heights are feet, but"), "{in_feet}");
    }
}
