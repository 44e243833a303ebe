//! The fields of the forms of plans: what they are called on the page, checked, and as inputs of the process.

use super::form_body::Fields;
use super::home::encoded;
use crate::processes::Process;
use crate::terms::Terms;
use serde_json::{Map, Value, json};

/// A number of a form.
struct Number {
    /// The option of `vlscan plan` with underscores, also the name of the field.
    name: &'static str,
    /// Label.
    label: &'static str,
    /// Least and largest value; the least itself is allowed if `from` is set.
    range: [f64; 2],
    from: bool,
    is_whole: bool,
}

const fn above(name: &'static str, label: &'static str, range: [f64; 2]) -> Number {
    Number { name, label, range, from: false, is_whole: false }
}

static NUMBERS: [Number; 10] = [
    above("height", "Height above ground", [0.0, 100_000.0]),
    above("density", "Density", [0.0, 1e6]),
    Number { name: "overlap", label: "Overlap", range: [-1000.0, 99.0], from: true, is_whole: false },
    above("speed", "Speed", [0.0, 1000.0]),
    above("radius", "Radius", [0.0, 100_000.0]),
    Number { name: "positions", label: "Positions", range: [1.0, 100_000.0], from: true, is_whole: true },
    above("spacing", "Spacing of a grid", [0.0, 100_000.0]),
    above("resolution", "Resolution", [0.0, 45.0]),
    above("pulse_rate", "Pulse rate", [0.0, 1e9]),
    Number {
        name: "ground",
        label: "Height of level ground",
        range: [-20_000.0, 20_000.0],
        from: true,
        is_whole: false,
    },
];

/// Fields that make no inputs, by their labels.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FieldError {
    /// A choice that is missing.
    #[error("{0}: choose one")]
    Choose(&'static str),
    /// A text that is not a number of the field.
    #[error("{label}: expected {expected}, found `{found}`")]
    Number {
        /// Label of the field.
        label: &'static str,
        /// The numbers that are accepted.
        expected: String,
        /// The text.
        found: String,
    },
    /// A number that is missing.
    #[error("{0}: expected a number")]
    NoNumber(&'static str),
    /// Density, overlap and speed together.
    #[error("Density, Overlap and Speed follow from each other: leave one of them empty")]
    Overdetermined,
    /// Neither density nor speed.
    #[error("Density: expected a number here, or a Speed instead")]
    NoSpeed,
    /// Positions in several ways.
    #[error("Places of the tripod, Centre, Spacing of a grid: fill in only one of them")]
    SeveralWays,
    /// Positions without a place.
    #[error(
        "Places of the tripod: click on the scene, or type x and y in each line; or give a Centre or the Spacing of a grid instead"
    )]
    NoPositions,
    /// A shape as text and as a file.
    #[error("{0}: choose a file or give a text, not both")]
    TwoShapes(&'static str),
    /// A shape that is missing or not drawn to its end.
    #[error("{0}: draw it on the scene to its end, give it as text, or choose a file")]
    NoShape(&'static str),
    /// A text that is not a place.
    #[error("Centre: expected x and y, for example `500000 5400000`, found `{0}`")]
    Place(String),
    /// A line that is not a place.
    #[error("Places of the tripod: expected x and y in each line, for example `500000 5400000`, found `{0}`")]
    Places(String),
}

impl FieldError {
    /// The name of the field that is wrong.
    pub fn field(&self) -> Option<&'static str> {
        let named = |wanted: &str| labels().find(|(_, label)| *label == wanted).map(|(name, _)| name);
        match self {
            FieldError::Choose(label)
            | FieldError::Number { label, .. }
            | FieldError::NoNumber(label)
            | FieldError::TwoShapes(label)
            | FieldError::NoShape(label) => named(label),
            FieldError::Overdetermined => Some("speed"),
            FieldError::NoSpeed => Some("density"),
            FieldError::SeveralWays => Some("spacing"),
            FieldError::Place(_) => Some("around"),
            FieldError::NoPositions | FieldError::Places(_) => Some("at"),
        }
    }
}

impl Number {
    fn value(&self, text: &str) -> Result<Value, FieldError> {
        let [low, high] = self.range;
        let expected = || match (self.is_whole, self.from) {
            (true, _) => format!("a whole number from {low} to {high}"),
            (false, true) => format!("a number from {low} to {high}"),
            (false, false) => format!("a number above {low}, at most {high}"),
        };
        let wrong = || FieldError::Number { label: self.label, expected: expected(), found: text.to_owned() };
        let number: f64 = text.replace(',', ".").parse().map_err(|_| wrong())?;
        let is_within = if self.from { number >= low } else { number > low } && number <= high;
        match is_within && (!self.is_whole || number.fract() == 0.0) {
            true if number.fract() == 0.0 => Ok(json!(number as i64)),
            true => Ok(json!(number)),
            false => Err(wrong()),
        }
    }
}

/// Inputs of the process of the fields of a form that are not empty, or what is wrong with one of them, by
/// its label.
pub fn inputs(fields: &Fields) -> Result<Map<String, Value>, FieldError> {
    let has = |key: &str| fields.contains_key(key);
    for (key, label) in [("scene", "Scene"), ("scanner", "Instrument")] {
        if !has(key) {
            return Err(FieldError::Choose(label));
        }
    }
    match fields.get("kind").map(String::as_str) {
        Some("terrestrial") => check_positions(fields)?,
        Some("mobile") => check_shape(fields, ["along", "along_file"], "Line", true)?,
        _ => check_flight(fields)?,
    }
    let mut inputs = Map::new();
    for (key, value) in fields {
        let value = value.trim();
        // A grid needs no circle, and neither do places.
        let is_of_circle = matches!(key.as_str(), "radius" | "positions");
        if is_of_circle && (has("spacing") || has("at")) {
            continue;
        }
        match key.as_str() {
            "area_file" => drop(inputs.insert("area".to_owned(), json!(value))),
            "along_file" => drop(inputs.insert("along".to_owned(), json!(value))),
            "follow_terrain" => drop(inputs.insert(key.clone(), json!(true))),
            "at" => drop(inputs.insert(key.clone(), json!(places(value)?))),
            "around" => drop(inputs.insert(key.clone(), json!(place(value)?))),
            "kind" | "scene" | "scanner" | "area" | "along" => {
                drop(inputs.insert(key.clone(), json!(value)));
            }
            _ => {
                // What else there is belongs to the picture.
                if let Some(number) = NUMBERS.iter().find(|number| number.name == key) {
                    inputs.insert(key.clone(), number.value(value)?);
                }
            }
        }
    }
    Ok(inputs)
}

fn check_flight(fields: &Fields) -> Result<(), FieldError> {
    let has = |key: &str| fields.contains_key(key);
    if !has("height") {
        return Err(FieldError::NoNumber("Height above ground"));
    }
    if has("density") && has("overlap") && has("speed") {
        return Err(FieldError::Overdetermined);
    }
    if !has("density") && !has("speed") {
        return Err(FieldError::NoSpeed);
    }
    check_shape(fields, ["area", "area_file"], "Area", false)
}

fn check_positions(fields: &Fields) -> Result<(), FieldError> {
    let has = |key: &str| fields.contains_key(key);
    let ways = ["at", "around", "spacing"].into_iter().filter(|way| has(way)).collect::<Vec<_>>();
    match ways.as_slice() {
        [] => Err(FieldError::NoPositions),
        ["around"] if !has("radius") => Err(FieldError::NoNumber("Radius")),
        [_] => Ok(()),
        _ => Err(FieldError::SeveralWays),
    }
}

/// Checks that a shape is given once, and drawn to its end.
fn check_shape(
    fields: &Fields,
    [text, file]: [&str; 2],
    label: &'static str,
    is_needed: bool,
) -> Result<(), FieldError> {
    let has = |key: &str| fields.contains_key(key);
    if has(text) && has(file) {
        return Err(FieldError::TwoShapes(label));
    }
    let is_given = has(text) || has(file);
    if !is_given && (is_needed || has("corners")) {
        return Err(FieldError::NoShape(label));
    }
    Ok(())
}

/// A place as `vlscan plan` reads it, `x,y`, of two numbers that a comma, a semicolon or blanks separate;
/// with semicolon or blanks they may have decimal commas.
fn place(text: &str) -> Result<String, FieldError> {
    let wrong = || FieldError::Place(text.to_owned());
    let separators: &[char] = if text.contains(';') { &[';'] } else { &[' ', '\t'] };
    let mut parts: Vec<&str> =
        text.split(separators).map(str::trim).filter(|part| !part.is_empty()).collect();
    if let [one] = parts.as_slice() {
        parts = one.split(',').collect();
    }
    let number = |part: &str| {
        let part = part.trim().trim_end_matches(',').replace(',', ".");
        part.parse::<f64>().ok().filter(|number| number.is_finite()).map(|_| part)
    };
    match parts.as_slice() {
        [x, y] => match (number(x), number(y)) {
            (Some(x), Some(y)) => Ok(format!("{x},{y}")),
            _ => Err(wrong()),
        },
        _ => Err(wrong()),
    }
}

/// Places, one in each line.
fn places(text: &str) -> Result<Vec<String>, FieldError> {
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    lines.map(|line| place(line).map_err(|_| FieldError::Places(line.to_owned()))).collect()
}

/// The address of the form of a plan or a stand with these inputs in its fields.
pub fn address(process: Process, inputs: &Map<String, Value>) -> Option<String> {
    let fields = fields(process, inputs)?;
    let pairs = fields.iter().map(|(field, text)| format!("&{field}={}", encoded(text)));
    Some(format!("/new?again=1{}", pairs.collect::<String>()))
}

/// The fields of the form of a plan or a stand with these inputs.
pub fn fields(process: Process, inputs: &Map<String, Value>) -> Option<Fields> {
    let mut fields = match process {
        Process::Plan => Fields::new(),
        Process::Stand => Fields::from([("kind".to_owned(), "stand".to_owned())]),
        _ => return None,
    };
    for (key, value) in inputs {
        let text = match value {
            Value::String(text) => text.clone(),
            Value::Array(several) if key == "at" => {
                several.iter().filter_map(Value::as_str).collect::<Vec<_>>().join("\n")
            }
            Value::Array(several) => several.first().and_then(Value::as_str).unwrap_or_default().to_owned(),
            Value::Bool(true) => "on".to_owned(),
            Value::Number(number) => number.to_string(),
            _ => continue,
        };
        // Texts of shapes have brackets.
        let is_file = matches!(key.as_str(), "area" | "along") && !text.contains(['(', '{']);
        fields.insert(if is_file { format!("{key}_file") } else { key.clone() }, text);
    }
    Some(fields)
}

/// Fields that are not numbers: the option of `vlscan plan` with underscores, and the label.
const OTHERS: [(&str, &str); 7] = [
    ("scene", "Scene"),
    ("scanner", "Instrument"),
    ("area", "Area"),
    ("along", "Line"),
    ("around", "Centre"),
    ("at", "Places of the tripod"),
    ("follow_terrain", "Follow the terrain"),
];

/// Names and labels of all fields.
fn labels() -> impl Iterator<Item = (&'static str, &'static str)> {
    NUMBERS.iter().map(|number| (number.name, number.label)).chain(OTHERS)
}

/// The field whose input a message of a plan names first.
pub fn field_of_message(message: &str) -> Option<&'static str> {
    let named = |input: &str| labels().map(|(name, _)| name).find(|name| *name == input);
    message.split('`').skip(1).step_by(2).find_map(named)
}

/// A message of a plan with the fields in place of inputs. Figures of plans, and messages of earlier
/// versions, name options.
pub fn in_words_of_the_page(message: &str) -> String {
    let message = Terms::Inputs.message(message);
    labels().fold(message, |text, (name, label)| text.replace(&format!("`{name}`"), label))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(given: &[(&str, &str)]) -> Fields {
        let scene = [("scene", "a/b.obj"), ("scanner", "vlp16")];
        given.iter().chain(&scene).map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect()
    }

    #[test]
    fn slips_are_told_by_the_labels_of_the_page() {
        let flight = [("kind", "airborne"), ("height", "80"), ("density", "10")];
        for (given, expected) in [
            (
                &[("height", "-5")][..],
                "Height above ground: expected a number above 0, at most 100000, found `-5`",
            ),
            (&[("height", "abc")], "found `abc`"),
            (&[("overlap", "150")], "Overlap: expected a number from -1000 to 99"),
            (&[("overlap", "30"), ("speed", "5")], "leave one of them empty"),
            (&[("area", "POLYGON ((0 0, 1 0, 1 1, 0 0))"), ("area_file", "a.kml")], "not both"),
            (&[("corners", "0 0, 1 1")], "Area: draw it on the scene to its end"),
            (
                &[("kind", "terrestrial"), ("around", "0 0"), ("radius", "5"), ("positions", "2,5")],
                "Positions: expected a whole number",
            ),
            (&[("kind", "terrestrial"), ("radius", "5")], "Places of the tripod: click on the scene"),
            (&[("kind", "terrestrial"), ("around", "0 0"), ("spacing", "5")], "fill in only one of them"),
            (
                &[("kind", "terrestrial"), ("at", "1,2\n3"), ("radius", "5")],
                "in each line, for example `500000 5400000`, found `3`",
            ),
            (&[("kind", "mobile")], "Line: draw it"),
        ] {
            let message = inputs(&fields(&[&flight[..], given].concat())).unwrap_err().to_string();
            assert!(message.contains(expected), "{given:?}: {message}");
        }
        let refused = inputs(&fields(&flight[..1])).unwrap_err();
        assert_eq!(refused, FieldError::NoNumber("Height above ground"));
        let inputs = inputs(&fields(
            &[&flight[..], &[("speed", "7,5"), ("overlap.x", "1"), ("mapped", "a")]].concat(),
        ))
        .unwrap();
        assert_eq!(inputs["speed"], 7.5);
        assert!(!inputs.contains_key("mapped"));
    }

    #[test]
    fn a_grid_needs_no_circle() {
        let given = [("kind", "terrestrial"), ("spacing", "15"), ("radius", "10"), ("positions", "4")];
        let inputs = inputs(&fields(&given)).unwrap();
        assert!(
            !inputs.contains_key("radius") && !inputs.contains_key("positions") && inputs["spacing"] == 15.0
        );
    }

    #[test]
    fn places_are_two_numbers() {
        for (text, expected) in [
            ("5,4", "5,4"),
            ("5;4", "5,4"),
            (" 500000  5400000 ", "500000,5400000"),
            ("500000,25; 5400000,5", "500000.25,5400000.5"),
            ("500000.5, 5400000.25", "500000.5,5400000.25"),
        ] {
            assert_eq!(place(text).unwrap(), expected, "{text}");
        }
        for text in ["5", "5,4,3", "a b", "1 2 3", ";", "nan,1"] {
            assert!(place(text).is_err(), "{text}");
        }
    }

    #[test]
    fn inputs_lead_back_to_the_form() {
        let given = [
            ("kind", "airborne"),
            ("height", "80,5"),
            ("density", "10"),
            ("area", "POLYGON ((0 0, 1 0, 1 1, 0 0))"),
        ];
        let address = address(Process::Plan, &inputs(&fields(&given)).unwrap()).unwrap();
        for part in [
            "again=1",
            "&kind=airborne",
            "&height=80.5",
            "&density=10",
            "&area=POLYGON%20%28%280",
            "&scene=a%2Fb.obj",
        ] {
            assert!(address.contains(part), "{address}");
        }
    }

    #[test]
    fn places_are_lines() {
        let given =
            [("kind", "terrestrial"), ("at", "1,2\r\n\r\n3,5; -4"), ("radius", "10"), ("positions", "4")];
        let inputs = inputs(&fields(&given)).unwrap();
        assert_eq!(inputs["at"], json!(["1,2", "3.5,-4"]));
        assert!(!inputs.contains_key("radius") && !inputs.contains_key("positions"), "{inputs:?}");
        assert!(address(Process::Plan, &inputs).unwrap().contains("&at=1%2C2%0A3.5%2C-4"));
    }

    #[test]
    fn options_become_labels() {
        let message = "error: --density, --speed and --overlap determine each other; --scene-memory";
        assert_eq!(
            in_words_of_the_page(message),
            "error: Density, Speed and Overlap determine each other; `scene_memory`"
        );
        let message = "error: `density`, `speed` and `overlap` determine each other; `scene_memory`";
        assert_eq!(
            in_words_of_the_page(message),
            "error: Density, Speed and Overlap determine each other; `scene_memory`"
        );
        assert_eq!(field_of_message(message), Some("density"));
        assert_eq!(field_of_message("error: `a`: `scene_memory` and `speed`"), Some("speed"));
    }
}
