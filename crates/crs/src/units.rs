//! Units of coordinates, as the WKT of a system or a code of EPSG names them.

/// Maximum depth of elements in a text.
const MAX_DEPTH: usize = 32;

/// Lengths nearer to a metre than this, as a fraction, are metres.
const METRE_TOLERANCE: f64 = 1e-9;

/// Metres in a US survey foot, and in the feet that Sears (1922) and Benoit (1895) measured.
const US_FOOT_M: f64 = 1200.0 / 3937.0;
const SEARS_FOOT_M: f64 = 12.0 / 39.370_147;
const BENOIT_FOOT_M: f64 = 12.0 / 39.370_113;
const CLARKE_FOOT_M: f64 = 0.304_797_265_4;

/// A unit in the table below.
struct Known {
    /// Its code of EPSG; 0 for those that have none.
    code: u16,
    metres: f64,
    name: &'static str,
    /// Other names, in small letters and without anything but letters and digits.
    spellings: &'static [&'static str],
}

const fn unit(code: u16, metres: f64, name: &'static str, spellings: &'static [&'static str]) -> Known {
    Known { code, metres, name, spellings }
}

/// The units of length of EPSG (version 12.029), and those without a code that headings have.
const KNOWN: &[Known] = &[
    unit(9001, 1.0, "metres", &["m", "metre", "meter", "meters", "masl"]),
    unit(9036, 1000.0, "kilometres", &["km", "kilometre", "kilometer", "kilometers"]),
    unit(0, 0.1, "decimetres", &["dm", "decimetre", "decimeter", "decimeters"]),
    unit(1033, 0.01, "centimetres", &["cm", "centimetre", "centimeter", "centimeters"]),
    unit(1025, 0.001, "millimetres", &["mm", "millimetre", "millimeter", "millimeters"]),
    unit(
        9002,
        0.3048,
        "feet",
        &[
            "ft",
            "foot",
            "ift",
            "ftint",
            "footintl",
            "footinternational",
            "internationalfoot",
            "internationalfeet",
        ],
    ),
    unit(
        9003,
        US_FOOT_M,
        "US survey feet",
        &["usft", "ftus", "usfoot", "usfeet", "footus", "feetus", "ussurveyfoot", "surveyfoot", "surveyfeet"],
    ),
    unit(0, 0.0254, "inches", &["in", "inch"]),
    unit(9096, 0.9144, "yards", &["yd", "yard"]),
    unit(9093, 1609.344, "miles", &["mi", "mile", "statutemile"]),
    unit(9030, 1852.0, "nautical miles", &["nmi", "nauticalmile"]),
    unit(9014, 1.8288, "fathoms", &["fathom"]),
    unit(9097, 20.1168, "chains", &["chain"]),
    unit(9098, 0.201_168, "links", &["link"]),
    unit(9031, 1.000_013_596_5, "German legal metres", &["germanlegalmetre"]),
    unit(9033, 66.0 * US_FOOT_M, "US survey chains", &["ussurveychain"]),
    unit(9034, 0.66 * US_FOOT_M, "US survey links", &["ussurveylink"]),
    unit(9035, 5280.0 * US_FOOT_M, "US survey miles", &["ussurveymile"]),
    unit(9005, CLARKE_FOOT_M, "Clarke's feet", &["clarkesfoot"]),
    unit(9037, 3.0 * CLARKE_FOOT_M, "Clarke's yards", &["clarkesyard"]),
    unit(9038, 66.0 * CLARKE_FOOT_M, "Clarke's chains", &["clarkeschain"]),
    unit(9039, 0.66 * CLARKE_FOOT_M, "Clarke's links", &["clarkeslink"]),
    unit(9040, 3.0 * SEARS_FOOT_M, "British yards (Sears 1922)", &["britishyardsears1922"]),
    unit(9041, SEARS_FOOT_M, "British feet (Sears 1922)", &["britishfootsears1922"]),
    unit(9042, 66.0 * SEARS_FOOT_M, "British chains (Sears 1922)", &["britishchainsears1922"]),
    unit(9043, 0.66 * SEARS_FOOT_M, "British links (Sears 1922)", &["britishlinksears1922"]),
    unit(9050, 0.914_399_2, "British yards (Benoit 1895 A)", &["britishyardbenoit1895a"]),
    unit(9051, 0.914_399_2 / 3.0, "British feet (Benoit 1895 A)", &["britishfootbenoit1895a"]),
    unit(9052, 20.116_782_4, "British chains (Benoit 1895 A)", &["britishchainbenoit1895a"]),
    unit(9053, 0.201_167_824, "British links (Benoit 1895 A)", &["britishlinkbenoit1895a"]),
    unit(9060, 3.0 * BENOIT_FOOT_M, "British yards (Benoit 1895 B)", &["britishyardbenoit1895b"]),
    unit(9061, BENOIT_FOOT_M, "British feet (Benoit 1895 B)", &["britishfootbenoit1895b"]),
    unit(9062, 66.0 * BENOIT_FOOT_M, "British chains (Benoit 1895 B)", &["britishchainbenoit1895b"]),
    unit(9063, 0.66 * BENOIT_FOOT_M, "British links (Benoit 1895 B)", &["britishlinkbenoit1895b"]),
    unit(9070, 0.914_402_5 / 3.0, "British feet (1865)", &["britishfoot1865"]),
    unit(9080, 12.0 / 39.370_142, "Indian feet", &["indianfoot"]),
    unit(9081, 0.304_798_41, "Indian feet (1937)", &["indianfoot1937"]),
    unit(9082, 0.304_799_6, "Indian feet (1962)", &["indianfoot1962"]),
    unit(9083, 0.304_799_5, "Indian feet (1975)", &["indianfoot1975"]),
    unit(9084, 36.0 / 39.370_142, "Indian yards", &["indianyard"]),
    unit(9085, 0.914_395_23, "Indian yards (1937)", &["indianyard1937"]),
    unit(9086, 0.914_398_8, "Indian yards (1962)", &["indianyard1962"]),
    unit(9087, 0.914_398_5, "Indian yards (1975)", &["indianyard1975"]),
    unit(9094, 6_378_300.0 / 20_926_201.0, "Gold Coast feet", &["goldcoastfoot"]),
    unit(9095, 0.304_800_749_1, "British feet (1936)", &["britishfoot1936"]),
    unit(9099, 0.914_398, "British yards (Sears 1922 truncated)", &["britishyardsears1922truncated"]),
    unit(9300, 0.914_398 / 3.0, "British feet (Sears 1922 truncated)", &["britishfootsears1922truncated"]),
    unit(9301, 20.116_756, "British chains (Sears 1922 truncated)", &["britishchainsears1922truncated"]),
    unit(9302, 0.201_167_56, "British links (Sears 1922 truncated)", &["britishlinksears1922truncated"]),
];

/// The systems of heights and depths of EPSG (version 12.029) that are not in metres, with the codes of their
/// units.
const HEIGHTS: &[(u16, u16)] = &[
    (5614, 9002),
    (5702, 9003),
    (5754, 9095),
    (6130, 9002),
    (6131, 9002),
    (6132, 9002),
    (6358, 9003),
    (6359, 9003),
    (6360, 9003),
    (8050, 9002),
    (8051, 9002),
    (8052, 9003),
    (8053, 9003),
    (8228, 9002),
    (8897, 9002),
    (10_919, 9003),
];

/// A unit of length.
#[derive(Clone, Debug, PartialEq)]
pub struct LengthUnit {
    /// Its name, in the plural where it is known.
    pub name: String,
    /// Its length, m.
    pub metres: f64,
}

impl LengthUnit {
    /// The units that headings and files are likely to name, for messages.
    pub const USUAL: &str = "m, dm, cm, mm, km, in, ft, us-ft or yd";

    /// A unit that a file defines: the name counts for messages alone.
    pub fn defined(name: &str, metres: f64) -> LengthUnit {
        let name = LengthUnit::of_name(name).map_or_else(|| name.to_owned(), |known| known.name);
        LengthUnit { name, metres }
    }

    /// Returns the unit of an EPSG code.
    pub fn of_epsg(code: u16) -> Option<LengthUnit> {
        KNOWN.iter().find(|known| known.code == code && code != 0).map(LengthUnit::from)
    }

    /// Returns the unit of a name or an abbreviation, without regard to case, blanks and punctuation.
    pub fn of_name(name: &str) -> Option<LengthUnit> {
        let plain = |name: &str| -> String {
            name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
        };
        let name = plain(name);
        let is_named = |known: &&Known| known.spellings.contains(&name.as_str()) || plain(known.name) == name;
        KNOWN.iter().find(is_named).map(LengthUnit::from)
    }

    /// Returns the unit of a system of heights by its EPSG code; `None` for codes that are no such system,
    /// which include those that GeoTIFF 1.0 gave to ellipsoids and to mean sea levels without a unit.
    pub fn of_heights(system: u16) -> Option<LengthUnit> {
        if matches!(system, 0 | 5001..=5033 | 5101..=5106 | 32_767..) {
            return None;
        }
        const METRE: u16 = 9001;
        LengthUnit::of_epsg(HEIGHTS.iter().find(|(code, _)| *code == system).map_or(METRE, |(_, unit)| *unit))
    }

    /// True if the unit is the metre.
    pub fn is_metre(&self) -> bool {
        (self.metres - 1.0).abs() < METRE_TOLERANCE
    }
}

impl From<&Known> for LengthUnit {
    fn from(known: &Known) -> LengthUnit {
        LengthUnit { name: known.name.to_owned(), metres: known.metres }
    }
}

/// Unit of a coordinate.
#[derive(Clone, Debug, PartialEq)]
pub enum Unit {
    /// A unit of length, with its name and its length in metres.
    Length(LengthUnit),
    /// Degrees or another angle.
    Angle,
    /// None of its own: x, y and z are distances from the centre of the Earth.
    Geocentric,
}

impl Unit {
    /// The unit of length; `None` for angles and geocentric coordinates.
    pub fn length(&self) -> Option<&LengthUnit> {
        match self {
            Unit::Length(unit) => Some(unit),
            Unit::Angle | Unit::Geocentric => None,
        }
    }
}

/// Units of the horizontal coordinates and of heights; `None` where a text does not say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Units {
    /// Unit of the two horizontal coordinates.
    pub horizontal: Option<Unit>,
    /// Unit of heights.
    pub vertical: Option<Unit>,
}

impl Units {
    /// The units that WKT 1 or 2 names. Files of ESRI have the system of heights behind the horizontal one,
    /// with a comma between them.
    pub fn of_wkt(wkt: &str) -> Units {
        let mut units = Units::default();
        let mut rest = Some(wkt);
        while let Some((root, behind)) = rest.and_then(|rest| Element::parse(rest, MAX_DEPTH)) {
            units.take(&root);
            rest = behind.trim_start().strip_prefix(',');
        }
        units
    }

    fn take(&mut self, element: &Element) {
        match element.keyword.to_ascii_uppercase().as_str() {
            "COMPD_CS" | "COMPOUNDCRS" | "BOUNDCRS" | "SOURCECRS" => {
                element.children.iter().for_each(|child| self.take(child));
            }
            "PROJCS" | "PROJCRS" | "PROJECTEDCRS" | "LOCAL_CS" | "ENGCRS" | "ENGINEERINGCRS" => {
                self.horizontal = element.length();
            }
            "VERT_CS" | "VERTCS" | "VERTCRS" | "VERTICALCRS" => self.vertical = element.length(),
            "GEOGCS" | "GEOGCRS" | "GEOGRAPHICCRS" => self.horizontal = Some(Unit::Angle),
            "GEOCCS" => self.horizontal = Some(Unit::Geocentric),
            "GEODCRS" | "GEODETICCRS" => {
                let is_geocentric = element.children.iter().any(|child| {
                    child.keyword.eq_ignore_ascii_case("CS") && child.text.eq_ignore_ascii_case("Cartesian")
                });
                self.horizontal = Some(if is_geocentric { Unit::Geocentric } else { Unit::Angle });
            }
            _ => {}
        }
    }
}

/// An element of WKT: `KEYWORD["text",1.0,CHILD[...]]`.
struct Element<'t> {
    keyword: &'t str,
    /// Its first value: a quoted text without the quotes, or a word.
    text: &'t str,
    number: Option<f64>,
    children: Vec<Element<'t>>,
}

impl<'t> Element<'t> {
    /// Parses the element at the start of `text`; returns it and the rest.
    fn parse(text: &'t str, depth: usize) -> Option<(Element<'t>, &'t str)> {
        let text = text.trim_start();
        let open = text.find(['[', '('])?;
        let mut element =
            Element { keyword: text[..open].trim(), text: "", number: None, children: Vec::new() };
        if depth == 0 || !element.keyword.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_') {
            return None;
        }
        let mut rest = &text[open + 1..];
        loop {
            rest = rest.trim_start();
            if let Some(quoted) = rest.strip_prefix('"') {
                let end = quoted.find('"')?;
                if element.text.is_empty() {
                    element.text = &quoted[..end];
                }
                rest = &quoted[end + 1..];
            } else {
                let end = rest.find([',', '[', '(', ']', ')'])?;
                if matches!(rest.as_bytes()[end], b'[' | b'(') {
                    let (child, behind) = Element::parse(rest, depth - 1)?;
                    element.children.push(child);
                    rest = behind;
                } else {
                    let word = rest[..end].trim();
                    element.number = element.number.or(word.parse().ok());
                    if element.text.is_empty() {
                        element.text = word;
                    }
                    rest = &rest[end..];
                }
            }
            rest = rest.trim_start();
            match rest.as_bytes().first()? {
                b',' => rest = &rest[1..],
                b']' | b')' => return Some((element, &rest[1..])),
                _ => return None,
            }
        }
    }

    /// The unit of length of a system: its own, or that of one of its axes.
    fn length(&self) -> Option<Unit> {
        let own = |element: &Element| {
            element.children.iter().find_map(|child| {
                let is_unit = child.keyword.eq_ignore_ascii_case("UNIT")
                    || child.keyword.eq_ignore_ascii_case("LENGTHUNIT");
                let metres = child.number.filter(|metres| is_unit && *metres > 0.0 && metres.is_finite());
                metres.map(|metres| Unit::Length(LengthUnit::defined(child.text, metres)))
            })
        };
        own(self).or_else(|| {
            self.children.iter().filter(|child| child.keyword.eq_ignore_ascii_case("AXIS")).find_map(own)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wkt_of_epsg;

    fn metres(wkt: &str) -> [Option<f64>; 2] {
        let units = Units::of_wkt(wkt);
        [units.horizontal, units.vertical].map(|unit| unit?.length().map(|unit| unit.metres))
    }

    #[test]
    fn both_versions_of_wkt_name_the_units() {
        assert_eq!(metres(&wkt_of_epsg(25832).unwrap()), [Some(1.0), None]);
        assert_eq!(metres(&wkt_of_epsg(5555).unwrap()), [Some(1.0), Some(1.0)]);
        let feet = metres(&wkt_of_epsg(2263).unwrap())[0].unwrap();
        assert!((feet - US_FOOT_M).abs() < 1e-9, "{feet}");
        assert_eq!(Units::of_wkt(&wkt_of_epsg(4326).unwrap()).horizontal, Some(Unit::Angle));
        let wkt2 = r#"COMPOUNDCRS["both",
            PROJCRS["p",BASEGEOGCRS["b",DATUM["d",ELLIPSOID["e",6378137,298.25,LENGTHUNIT["metre",1]]]],
            CONVERSION["c",METHOD["m"],PARAMETER["False easting",100,LENGTHUNIT["foot",0.3048]]],
            CS[Cartesian,2],AXIS["(E)",east,ORDER[1],LENGTHUNIT["US survey foot",0.304800609601219]],
            AXIS["(N)",north,ORDER[2],LENGTHUNIT["US survey foot",0.304800609601219]]],
            VERTCRS["v",VDATUM["d"],CS[vertical,1],AXIS["up",up],LENGTHUNIT["foot",0.3048]]]"#;
        assert_eq!(metres(wkt2), [Some(0.304800609601219), Some(0.3048)]);
        let esri = format!("{}, VERTCS[\"v\",UNIT[\"Foot\",0.3048]]", wkt_of_epsg(25832).unwrap());
        assert_eq!(metres(&esri), [Some(1.0), Some(0.3048)]);
        let Some(Unit::Length(feet)) = Units::of_wkt(&wkt_of_epsg(2263).unwrap()).horizontal else {
            panic!("none")
        };
        assert_eq!(feet.name, "US survey feet");
    }

    #[test]
    fn geocentric_systems_have_no_unit_of_easting_and_northing() {
        let one =
            r#"GEOCCS["WGS 84",DATUM["d",SPHEROID["s",6378137,298.25]],UNIT["metre",1],AXIS["X",OTHER]]"#;
        let axes = r#"AXIS["(X)",geocentricX],AXIS["(Y)",geocentricY],AXIS["(Z)",geocentricZ]"#;
        let two =
            |system| format!(r#"GEODCRS["WGS 84",DATUM["d"],CS[{system}],{axes},LENGTHUNIT["metre",1]]"#);
        let unit = |wkt: &str| Units::of_wkt(wkt).horizontal;
        assert_eq!(unit(one), Some(Unit::Geocentric));
        assert_eq!(unit(&two("Cartesian,3")), Some(Unit::Geocentric));
        assert_eq!(unit(&two("ellipsoidal,3")), Some(Unit::Angle));
        assert!(crate::unit_problem(one).unwrap().contains("z is up"));
    }

    #[test]
    fn codes_and_names_have_the_lengths_of_their_units() {
        let code = |code| LengthUnit::of_epsg(code).map(|unit| unit.metres);
        assert_eq!(
            [9001, 9002, 9003, 9096, 9036, 0, 9999, 9102].map(code),
            [Some(1.0), Some(0.3048), Some(US_FOOT_M), Some(0.9144), Some(1000.0), None, None, None]
        );
        // Of the registry, with 15 digits.
        for (unit, metres) in [
            (9033, 20.116_840_233_680_5),
            (9035, 1_609.347_218_694_44),
            (9037, 0.914_391_796_2),
            (9041, 0.304_799_471_538_676),
            (9043, 0.201_167_651_215_526),
            (9061, 0.304_799_734_763_271),
            (9070, 0.304_800_833_333_333),
            (9080, 0.304_799_510_248_147),
            (9084, 0.914_398_530_744_441),
            (9094, 0.304_799_710_181_509),
            (9300, 0.304_799_333_333_333),
        ] {
            let found = code(unit).unwrap();
            assert!((found / metres - 1.0).abs() < 1e-14, "{unit}: {found}");
        }
        let mut codes: Vec<u16> = KNOWN.iter().map(|known| known.code).filter(|code| *code > 0).collect();
        let count = codes.len();
        codes.sort_unstable();
        codes.dedup();
        assert_eq!(codes.len(), count, "every code stands once");
        let name = |name| LengthUnit::of_name(name).map(|unit| unit.metres);
        for us in ["US survey foot", "us-ft", "ftUS", "US_survey_foot", "US ft"] {
            assert_eq!(name(us), Some(US_FOOT_M), "{us}");
        }
        assert_eq!(
            ["m", "inch", "IN", "yd", "Clarke's foot", "German legal metre", "furlong", ""].map(name),
            [
                Some(1.0),
                Some(0.0254),
                Some(0.0254),
                Some(0.9144),
                Some(CLARKE_FOOT_M),
                Some(1.000_013_596_5),
                None,
                None
            ]
        );
        assert!(
            LengthUnit::of_epsg(9001).unwrap().is_metre() && !LengthUnit::of_epsg(9002).unwrap().is_metre()
        );
    }

    #[test]
    fn systems_of_heights_have_their_units() {
        let metres = |system| LengthUnit::of_heights(system).map(|unit| unit.metres);
        assert_eq!(
            [5703, 7837, 5702, 6360, 8228, 6132, 5754].map(metres),
            [
                Some(1.0),
                Some(1.0),
                Some(US_FOOT_M),
                Some(US_FOOT_M),
                Some(0.3048),
                Some(0.3048),
                Some(0.304_800_749_1)
            ]
        );
        assert_eq!([0, 5030, 5103, 32_767].map(metres), [None; 4]);
    }

    #[test]
    fn texts_that_are_no_wkt_name_nothing() {
        let deep = format!("{}\"x\"{}", "A[".repeat(10_000), "]".repeat(10_000));
        for text in
            ["", "PROJCS", "PROJCS[", "PROJCS[\"a", "PROJCS[\"a\",UNIT[", "é[ü", "PROJCS[\"a\"]]]", &deep]
        {
            assert_eq!(Units::of_wkt(text), Units::default(), "{text:.20}");
        }
    }
}
