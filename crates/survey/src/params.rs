//! Parameters of a filter: `<param type= key= value=>` (spec input-formats §3.3).

use super::context::Context;
use super::fields::{Fields, is_local, meant, parse_vector, read_rotations};
use super::xml::Element;
use std::collections::HashSet;
use vlscan_base::diag::nearest;
use vlscan_base::quantity::NUMBER as NUMBER_BOUNDS;
use vlscan_geom::{DVec3, Rotation};

/// The parameters of a filter while they are read. A declared type other than the expected one causes a warning; the
/// value is read anyway.
pub(super) struct Params<'c> {
    pub context: &'c Context,
    pub filter: &'c Element,
    params: Vec<Element>,
    known: Vec<&'static str>,
}

const TEXT: &[&str] = &["string", ""];
const NUMBER: &[&str] = &["double"];
const WHOLE: &[&str] = &["integer", "int"];
const FLAG: &[&str] = &["boolean", "bool"];
const VECTOR: &[&str] = &["vec3"];
const ROTATION: &[&str] = &["rotation"];

impl<'c> Params<'c> {
    pub fn new(context: &'c Context, filter: &'c Element) -> Params<'c> {
        let mut fields = Fields::new(context, filter);
        fields.ignore(&["type"]);
        fields.done(&["param"]);
        let mut params: Vec<Element> = Vec::new();
        let mut keys = HashSet::new();
        for param in filter.named("param") {
            let mut fields = Fields::new(context, &param);
            let key = fields.required("key");
            let is_rotation = fields.text("type").is_some_and(|t| ROTATION.contains(&t));
            match is_rotation {
                true => fields.ignore(&["value", "rotations"]),
                false => {
                    fields.ignore(&["value"]);
                    fields.without_effect(&["rotations"], "on a parameter that is no rotation");
                }
            }
            fields.done(&["rot"]);
            if !keys.insert(key.map(str::to_owned)) {
                let message = format!(
                    "the parameter `{}` is given twice; the first one counts",
                    key.unwrap_or_default()
                );
                context.warn(param.place(), message);
            } else {
                params.push(param);
            }
        }
        Params { context, filter, params, known: Vec::new() }
    }

    pub fn done(self) {
        for param in &self.params {
            let Some(key) = param.value("key").filter(|k| !self.known.contains(k)) else { continue };
            let kind = self.filter.value("type").unwrap_or_default();
            let message = format!("unknown parameter `{key}` of `{kind}` is ignored");
            self.context.warn_help(param.value_place("key"), message, meant(key, &self.known));
        }
    }

    /// Marks parameters without effect as known.
    pub fn ignore(&mut self, keys: &[&'static str]) {
        self.known.extend(keys);
    }

    /// Warns that parameters have no effect, as `why` says, if they are present.
    pub fn without_effect(&mut self, keys: &[&'static str], why: &str) {
        for param in self.params.iter().filter(|p| p.value("key").is_some_and(|key| keys.contains(&key))) {
            let key = param.value("key").unwrap_or_default();
            self.context.warn(param.value_place("key"), format!("the parameter `{key}` has no effect {why}"));
        }
        self.ignore(keys);
    }

    /// The element of a parameter, if it is present; warns when its declared type is not in `types`.
    fn find(&mut self, key: &'static str, types: &[&str]) -> Option<Element> {
        self.known.push(key);
        let param = self.params.iter().find(|p| p.value("key") == Some(key))?.clone();
        let declared = param.value("type").unwrap_or_default();
        if !types.contains(&declared) {
            let expected = types[0];
            let message =
                format!("the parameter `{key}` is declared as `{declared}`, it is read as `{expected}`");
            let place = if param.value("type").is_some() { param.value_place("type") } else { param.place() };
            let known = [TEXT, NUMBER, WHOLE, FLAG, VECTOR, ROTATION].concat();
            let help = match known.contains(&declared) {
                true => String::new(),
                false => nearest(declared, known).map_or(String::new(), |n| format!("did you mean `{n}`?")),
            };
            self.context.warn_help(place, message, help);
        }
        Some(param)
    }

    pub fn has(&self, key: &str) -> bool {
        self.params.iter().any(|p| p.value("key") == Some(key))
    }

    /// The text of a parameter and its element.
    pub fn text(&mut self, key: &'static str) -> Option<(String, Element)> {
        self.find(key, TEXT).map(|p| (p.value("value").unwrap_or_default().to_owned(), p))
    }

    pub fn number(&mut self, key: &'static str) -> Option<f64> {
        self.parsed(key, NUMBER, "a number", |t| t.parse::<f64>().ok().filter(|v| NUMBER_BOUNDS.contains(*v)))
    }

    /// An integer. Decimals such as 2.0 are accepted.
    pub fn whole(&mut self, key: &'static str) -> Option<i64> {
        let whole = |t: &str| {
            let decimal =
                || t.parse::<f64>().ok().filter(|v| v.fract() == 0.0 && v.abs() < 1e15).map(|v| v as i64);
            t.parse::<i64>().ok().or_else(decimal)
        };
        self.parsed(key, WHOLE, "a whole number", whole)
    }

    /// An integer of at least 0.
    pub fn count(&mut self, key: &'static str, default: u32) -> u32 {
        let value = self.parsed(key, WHOLE, "a whole number of at least 0", |t| t.parse::<u32>().ok());
        value.unwrap_or(default)
    }

    /// A boolean; false when it is missing or unreadable.
    pub fn flag(&mut self, key: &'static str) -> bool {
        let flag = |t: &str| match t.to_ascii_lowercase().as_str() {
            "true" | "1" => Some(true),
            "false" | "0" => Some(false),
            _ => None,
        };
        self.parsed(key, FLAG, "true or false", flag).unwrap_or(false)
    }

    /// A vector of the form `x;y;z`.
    pub fn vector(&mut self, key: &'static str) -> Option<DVec3> {
        self.parsed(key, VECTOR, "three numbers with semicolons, such as 0;0;1", parse_vector)
    }

    pub fn rotation(&mut self, key: &'static str) -> Option<Rotation> {
        let param = self.find(key, ROTATION)?;
        let local = param.value("rotations").is_some_and(|text| is_local(self.context, &param, text));
        Some(read_rotations(self.context, &param, local))
    }

    pub fn missing(&self, key: &str) {
        let kind = self.filter.value("type").unwrap_or_default();
        self.context.error(self.filter.place(), format!("the filter `{kind}` needs the parameter `{key}`"));
    }

    /// Records that the value of a parameter is unusable.
    pub fn refuse(&self, key: &str, expected: &str) {
        let Some(param) = self.params.iter().find(|p| p.value("key") == Some(key)) else { return };
        let found = param.value("value").unwrap_or_default();
        let message = format!("the parameter `{key}` must be {expected}, found `{found}`");
        self.context.error(param.value_place("value"), message);
    }

    /// Warns of the value of a parameter; the message follows its name.
    pub fn warn(&self, key: &str, message: &str) {
        if let Some(param) = self.params.iter().find(|p| p.value("key") == Some(key)) {
            self.context.warn(param.value_place("value"), format!("the parameter `{key}` {message}"));
        }
    }

    fn parsed<T>(
        &mut self,
        key: &'static str,
        types: &[&str],
        expected: &str,
        parse: impl Fn(&str) -> Option<T>,
    ) -> Option<T> {
        let param = self.find(key, types)?;
        let value = parse(param.value("value").unwrap_or_default().trim());
        if value.is_none() {
            self.refuse(key, expected);
        }
        value
    }
}
