//! Coordinate reference systems as PROJJSON (<https://proj.org/en/stable/specifications/projjson.html>),
//! converted from WKT 1 (OGC 01-009): the same definition in the words of ISO 19111.

use serde_json::{Value, json};

/// Element of WKT: a keyword with values in brackets.
struct Element<'t> {
    keyword: String,
    values: Vec<Item<'t>>,
}

enum Item<'t> {
    Text(&'t str),
    Number(f64),
    /// A word without quotes, as the direction of an axis.
    Word(&'t str),
    Element(Element<'t>),
}

/// The depth to which elements are read: systems have five.
const MAX_DEPTH: usize = 16;

impl<'t> Element<'t> {
    /// Reads an element from the beginning of a text and takes it off.
    fn parse(text: &mut &'t str, depth: usize) -> Option<Element<'t>> {
        let (keyword, rest) = text.split_once(['[', '('])?;
        *text = rest;
        let mut values = Vec::new();
        loop {
            *text = text.trim_start();
            let item = if let Some(rest) = text.strip_prefix('"') {
                let (quoted, rest) = rest.split_once('"')?;
                *text = rest;
                Item::Text(quoted)
            } else {
                let end = text.find([',', ']', ')', '[', '('])?;
                let word = text[..end].trim();
                match (&text[end..end + 1], word.parse()) {
                    ("[" | "(", _) if depth < MAX_DEPTH => Item::Element(Element::parse(text, depth + 1)?),
                    ("[" | "(", _) => return None,
                    (_, number) => {
                        *text = &text[end..];
                        number.map_or(Item::Word(word), Item::Number)
                    }
                }
            };
            values.push(item);
            *text = text.trim_start();
            let mut rest = text.chars();
            let separator = rest.next()?;
            *text = rest.as_str();
            match separator {
                ',' => {}
                ']' | ')' => return Some(Element { keyword: keyword.trim().to_ascii_uppercase(), values }),
                _ => return None,
            }
        }
    }

    fn elements(&self, keyword: &str) -> impl Iterator<Item = &Element<'t>> {
        self.values.iter().filter_map(move |value| match value {
            Item::Element(element) if element.keyword == keyword => Some(element),
            _ => None,
        })
    }

    fn element(&self, keyword: &str) -> Option<&Element<'t>> {
        self.elements(keyword).next()
    }

    fn name(&self) -> Option<&'t str> {
        self.values.iter().find_map(|value| if let Item::Text(text) = value { Some(*text) } else { None })
    }

    fn number(&self) -> Option<f64> {
        self.numbers().next()
    }

    fn numbers(&self) -> impl Iterator<Item = f64> {
        self.values
            .iter()
            .filter_map(|value| if let Item::Number(number) = value { Some(*number) } else { None })
    }

    fn word(&self) -> Option<&'t str> {
        self.values.iter().find_map(|value| if let Item::Word(word) = value { Some(*word) } else { None })
    }

    /// The members of an object with the name and the code of this element.
    fn object(&self, kind: &str) -> Option<Value> {
        let mut object = json!({ "type": kind, "name": self.name()? });
        if let Some(authority) = self.element("AUTHORITY") {
            let mut texts = authority.values.iter();
            if let (Some(Item::Text(authority)), Some(Item::Text(code))) = (texts.next(), texts.next()) {
                let code = code.parse::<u32>().map_or(json!(code), |code| json!(code));
                object["id"] = json!({ "authority": authority, "code": code });
            }
        }
        Some(object)
    }

    fn unit(&self, kind: &str) -> Option<Value> {
        let unit = self.element("UNIT")?;
        Some(match (unit.name()?, unit.number()?) {
            (_, 1.0) => json!("metre"),
            ("degree", _) => json!("degree"),
            (name, factor) => json!({ "type": kind, "name": name, "conversion_factor": factor }),
        })
    }

    /// The axes of a Cartesian system. WKT 1 as GDAL and PROJ write it leaves them out where northing is
    /// first in the EPSG dataset; without code and axes easting is first (OGC 01-009).
    fn axes(&self, unit: &Value) -> Option<Value> {
        let mut axes: Vec<(&str, String)> = Vec::new();
        for axis in self.elements("AXIS") {
            axes.push((axis.name()?, axis.word()?.to_ascii_lowercase()));
        }
        if axes.is_empty() {
            axes = vec![("Easting", "east".to_owned()), ("Northing", "north".to_owned())];
            if self.element("AUTHORITY").is_some() {
                axes.reverse();
            }
        }
        let abbreviation = |name: &str| name.chars().take(1).collect::<String>();
        let axes = axes.iter().map(|(name, direction)| {
            json!({ "name": name, "abbreviation": abbreviation(name), "direction": direction, "unit": unit })
        });
        Some(Value::Array(axes.collect()))
    }
}

/// Names and EPSG codes of parameters, by their names in WKT 1.
type Parameters = &'static [(&'static str, &'static str, u16)];

const NATURAL: Parameters = &[
    ("latitude_of_origin", "Latitude of natural origin", 8801),
    ("central_meridian", "Longitude of natural origin", 8802),
    ("scale_factor", "Scale factor at natural origin", 8805),
    ("false_easting", "False easting", 8806),
    ("false_northing", "False northing", 8807),
];
const AZIMUTHAL: Parameters = &[
    ("latitude_of_center", "Latitude of natural origin", 8801),
    ("longitude_of_center", "Longitude of natural origin", 8802),
    ("false_easting", "False easting", 8806),
    ("false_northing", "False northing", 8807),
];
const CONIC: Parameters = &[
    ("latitude_of_origin", "Latitude of false origin", 8821),
    ("latitude_of_center", "Latitude of false origin", 8821),
    ("central_meridian", "Longitude of false origin", 8822),
    ("longitude_of_center", "Longitude of false origin", 8822),
    ("standard_parallel_1", "Latitude of 1st standard parallel", 8823),
    ("standard_parallel_2", "Latitude of 2nd standard parallel", 8824),
    ("false_easting", "Easting at false origin", 8826),
    ("false_northing", "Northing at false origin", 8827),
];
const POLAR: Parameters = &[
    ("latitude_of_origin", "Latitude of standard parallel", 8832),
    ("central_meridian", "Longitude of origin", 8833),
    ("false_easting", "False easting", 8806),
    ("false_northing", "False northing", 8807),
];
const OBLIQUE: Parameters = &[
    ("latitude_of_center", "Latitude of projection centre", 8811),
    ("longitude_of_center", "Longitude of projection centre", 8812),
    ("azimuth", "Azimuth at projection centre", 8813),
    ("rectified_grid_angle", "Angle from Rectified to Skew Grid", 8814),
    ("scale_factor", "Scale factor at projection centre", 8815),
    ("false_easting", "False easting", 8806),
    ("false_northing", "False northing", 8807),
];
const OBLIQUE_CENTRE: Parameters = &[
    ("latitude_of_center", "Latitude of projection centre", 8811),
    ("longitude_of_center", "Longitude of projection centre", 8812),
    ("azimuth", "Azimuth at projection centre", 8813),
    ("rectified_grid_angle", "Angle from Rectified to Skew Grid", 8814),
    ("scale_factor", "Scale factor at projection centre", 8815),
    ("false_easting", "Easting at projection centre", 8816),
    ("false_northing", "Northing at projection centre", 8817),
];

/// Name and EPSG code of a projection method and its parameters, by its name in WKT 1.
const METHODS: &[(&str, &str, u16, Parameters)] = &[
    ("Transverse_Mercator", "Transverse Mercator", 9807, NATURAL),
    ("Transverse_Mercator_South_Orientated", "Transverse Mercator (South Orientated)", 9808, NATURAL),
    ("Lambert_Conformal_Conic_1SP", "Lambert Conic Conformal (1SP)", 9801, NATURAL),
    ("Lambert_Conformal_Conic_2SP", "Lambert Conic Conformal (2SP)", 9802, CONIC),
    ("Albers_Conic_Equal_Area", "Albers Equal Area", 9822, CONIC),
    ("Polar_Stereographic", "Polar Stereographic (variant A)", 9810, NATURAL),
    ("Oblique_Stereographic", "Oblique Stereographic", 9809, NATURAL),
    ("Cassini_Soldner", "Cassini-Soldner", 9806, NATURAL),
    ("Mercator_1SP", "Mercator (variant A)", 9804, NATURAL),
    ("Lambert_Azimuthal_Equal_Area", "Lambert Azimuthal Equal Area", 9820, AZIMUTHAL),
    ("Hotine_Oblique_Mercator", "Hotine Oblique Mercator (variant A)", 9812, OBLIQUE),
    ("Hotine_Oblique_Mercator_Azimuth_Center", "Hotine Oblique Mercator (variant B)", 9815, OBLIQUE_CENTRE),
    ("Polyconic", "American Polyconic", 9818, NATURAL),
];

/// Converts a system in WKT 1. `None` for other texts, and for projections that are not among those of
/// [`METHODS`].
pub(super) fn projjson(wkt: &str) -> Option<Value> {
    let mut text = wkt.trim_matches(['\0', ' ', '\n', '\r', '\t']);
    let element = Element::parse(&mut text, 0)?;
    let mut system = system(&element)?;
    system["$schema"] = json!("https://proj.org/schemas/v0.7/projjson.schema.json");
    Some(system)
}

fn system(element: &Element) -> Option<Value> {
    match element.keyword.as_str() {
        "PROJCS" => projected(element),
        "GEOGCS" => geographic(element),
        "COMPD_CS" => {
            let mut compound = element.object("CompoundCRS")?;
            let parts = element.values.iter().filter_map(|value| match value {
                Item::Element(part) if part.keyword != "AUTHORITY" => Some(system(part)),
                _ => None,
            });
            compound["components"] = Value::Array(parts.collect::<Option<_>>()?);
            Some(compound)
        }
        "VERT_CS" => {
            let mut vertical = element.object("VerticalCRS")?;
            vertical["datum"] = element.element("VERT_DATUM")?.object("VerticalReferenceFrame")?;
            let axis = element.element("AXIS").and_then(Element::word).unwrap_or("UP").to_ascii_lowercase();
            let (name, abbreviation) = match axis.as_str() {
                "down" => ("Depth", "D"),
                _ => ("Gravity-related height", "H"),
            };
            let unit = element.unit("LinearUnit")?;
            let axis = json!({ "name": name, "abbreviation": abbreviation, "direction": axis, "unit": unit });
            vertical["coordinate_system"] = json!({ "subtype": "vertical", "axis": [axis] });
            Some(vertical)
        }
        _ => None,
    }
}

fn geographic(element: &Element) -> Option<Value> {
    let mut geographic = element.object("GeographicCRS")?;
    let wkt_datum = element.element("DATUM")?;
    let mut datum = wkt_datum.object("GeodeticReferenceFrame")?;
    datum["name"] = json!(match wkt_datum.name()? {
        "WGS_1984" => "World Geodetic System 1984".to_owned(),
        name => name.replace('_', " "),
    });
    let spheroid = wkt_datum.element("SPHEROID")?;
    let mut sizes = spheroid.numbers();
    let (axis, flattening) = (sizes.next()?, sizes.next()?);
    let mut ellipsoid = spheroid.object("Ellipsoid")?;
    match flattening {
        0.0 => ellipsoid["radius"] = json!(axis),
        _ => {
            ellipsoid["semi_major_axis"] = json!(axis);
            ellipsoid["inverse_flattening"] = json!(flattening);
        }
    }
    datum["ellipsoid"] = ellipsoid;
    let unit = element.unit("AngularUnit")?;
    if let Some(meridian) = element.element("PRIMEM")
        && meridian.number()? != 0.0
    {
        datum["prime_meridian"] = meridian.object("PrimeMeridian")?;
        datum["prime_meridian"]["longitude"] = json!({ "value": meridian.number()?, "unit": unit });
    }
    geographic["datum"] = datum;
    let axis = |name: &str, abbreviation: &str, direction: &str| {
        json!({
            "name": name, "abbreviation": abbreviation, "direction": direction, "unit": unit
        })
    };
    let axes = [axis("Geodetic latitude", "Lat", "north"), axis("Geodetic longitude", "Lon", "east")];
    geographic["coordinate_system"] = json!({ "subtype": "ellipsoidal", "axis": axes });
    Some(geographic)
}

fn projected(element: &Element) -> Option<Value> {
    // Definitions in other terms, as of Web Mercator on a sphere, contradict the projection.
    if element.element("EXTENSION").is_some() {
        return None;
    }
    let mut projected = element.object("ProjectedCRS")?;
    let base = element.element("GEOGCS")?;
    projected["base_crs"] = geographic(base)?;
    let (unit, angle) = (element.unit("LinearUnit")?, base.unit("AngularUnit")?);
    let axes = element.axes(&unit)?;
    projected["coordinate_system"] = json!({ "subtype": "Cartesian", "axis": axes });
    let method = element.element("PROJECTION")?.name()?;
    let given = |name: &str| {
        let mut parameters = element.elements("PARAMETER");
        parameters.find(|parameter| parameter.name() == Some(name)).and_then(Element::number)
    };
    let (_, mut method, mut code, mut parameters) = *METHODS.iter().find(|known| known.0 == method)?;
    if code == 9810 && given("latitude_of_origin").is_some_and(|latitude| latitude.abs() != 90.0) {
        // WKT 1 has one name for both variants; the second has no scale.
        if given("scale_factor").is_some_and(|scale| scale != 1.0) {
            return None;
        }
        (method, code, parameters) = ("Polar Stereographic (variant B)", 9829, POLAR);
    }
    let values = parameters.iter().filter_map(|(wkt_name, name, id)| {
        let unit = match *id {
            8805 | 8815 => json!("unity"),
            8806 | 8807 | 8816 | 8817 | 8826 | 8827 => unit.clone(),
            _ => angle.clone(),
        };
        let id = json!({ "authority": "EPSG", "code": id });
        Some(json!({ "name": name, "value": given(wkt_name)?, "unit": unit, "id": id }))
    });
    projected["conversion"] = json!({
        "name": "unnamed",
        "method": { "name": method, "id": { "authority": "EPSG", "code": code } },
        "parameters": values.collect::<Vec<_>>(),
    });
    Some(projected)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vlscan_crs as crs;

    #[test]
    fn systems_keep_their_definitions_and_codes() {
        let json = projjson(&crs::wkt_of_epsg(25832).unwrap()).unwrap();
        assert_eq!((&json["type"], &json["id"]["code"]), (&json!("ProjectedCRS"), &json!(25832)));
        assert_eq!(json["base_crs"]["datum"]["ellipsoid"]["inverse_flattening"], json!(298.257222101));
        let parameters = json["conversion"]["parameters"].as_array().unwrap();
        let values: Vec<f64> = parameters.iter().map(|p| p["value"].as_f64().unwrap()).collect();
        assert_eq!(values, [0.0, 9.0, 0.9996, 500_000.0, 0.0]);
        let compound = projjson(&crs::wkt_of_epsg(5555).unwrap()).unwrap();
        assert_eq!(compound["components"][1]["type"], json!("VerticalCRS"));
        assert_eq!(compound["components"][0]["id"], json["id"]);
    }

    #[test]
    fn what_is_no_known_projection_is_not_converted() {
        let web = crs::wkt_of_epsg(3857);
        assert!(web.is_err() || projjson(&web.unwrap()).is_none());
        for text in ["", "[", "PROJCS[\"a\"", "PROJCRS[\"WKT 2\"]", "GEOGCS[", "A[1]]"] {
            assert!(projjson(text).is_none(), "{text}");
        }
        assert!(projjson(&"A[".repeat(100_000)).is_none());
    }

    proptest! {
        #[test]
        fn no_text_panics(cut in 0usize..900, put in "[\\[\\]\",A-Z0-9.é(]{0,5}") {
            let wkt = crs::wkt_of_epsg(25832).unwrap();
            let cut = cut.min(wkt.len());
            projjson(&format!("{}{put}{}", &wkt[..cut], &wkt[cut..]));
        }
    }
}
