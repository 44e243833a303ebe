//! The readers of values by their types.

use super::values::{Number, Reading, Value};
use super::{Fields, Origin, meant};
use crate::keys::{Key, KeyTable, PoseKeys};
use crate::toml::source::{Source, near};
use crate::toml::words;
use crate::{Formula, RasterFiles};
use serde::Deserialize;
use std::ops::Range;
use std::path::PathBuf;
use toml::Spanned;
use toml::de::{DeValue, ValueDeserializer};
use vlscan_base::quantity::{self, NUMBER, number};
use vlscan_geom::{DVec3, degrees, radians};

impl<'c> Fields<'c> {
    /// The value of a key, unless it is missing; `Some(None)` if it cannot be read, which TOML has then
    /// reported.
    fn parsed<T: Value>(&mut self, key: Key) -> Option<Option<T>> {
        let name = self.name(key);
        self.known.push(name);
        if let Origin::Table(source, ..) = self.origin {
            let value = self.entry(name)?;
            let read = T::deserialize(ValueDeserializer::from(value.clone()));
            return Some(read.map_err(|e| self.report_type(source, &e, value.span())).ok());
        }
        let _ = self.declared_param(name, T::DECLARED);
        Some(T::parse(self.written_text(name)?, self.reading))
    }

    fn report_type(&self, source: &Source, error: &toml::de::Error, span: Range<usize>) {
        source.report_value(error, Some(span), &mut self.context.problems.borrow_mut());
    }

    /// The number of a key, in the unit of its name; `None` if it is missing or unusable. Then `default` is
    /// used, unless it is NaN.
    fn number_or<T: Number>(&mut self, key: Key, default: f64) -> Option<f64> {
        match self.parsed::<T>(key)?.map(T::to_f64) {
            Some(value) if key.bounds.contains(value) => {
                if let Some((doubt, hint)) = key.bounds.doubt(value) {
                    let message = format!("`{}` {doubt}", self.name(key));
                    self.context.warn_help(self.place(key), message, hint);
                }
                Some(value)
            }
            Some(_) => {
                self.refuse(key, key.bounds.expected);
                None
            }
            None => {
                let text = self.written_text(self.name(key)).unwrap_or_default();
                let is_lenient = self.reading == Reading::Lenient;
                let beginning = is_lenient.then(|| T::beginning(text)).flatten();
                if beginning.is_some_and(|value| !key.bounds.contains(value)) {
                    self.refuse(key, key.bounds.expected);
                    return None;
                }
                let used = match beginning.unwrap_or(default) {
                    used if used.is_nan() => "it is ignored".to_owned(),
                    used => format!("{} is used", number(used)),
                };
                self.replaced(key, T::expected(self.reading), &used);
                beginning
            }
        }
    }

    /// The number of a key, else `default`.
    pub fn number(&mut self, key: impl Into<Key>, default: f64) -> f64 {
        self.number_or::<f64>(key.into(), default).unwrap_or(default)
    }

    /// The number of a key, unless it is missing or unusable.
    pub fn optional(&mut self, key: impl Into<Key>) -> Option<f64> {
        self.number_or::<f64>(key.into(), f64::NAN)
    }

    /// A number without which the meaning would be wrong: a missing or unreadable one is an error.
    pub fn required_number(&mut self, key: impl Into<Key>) -> Option<f64> {
        self.needed_number(key.into(), Reading::Required)
    }

    /// Like [`Fields::required_number`], but surrounding blanks are an error.
    pub fn exact_number(&mut self, key: impl Into<Key>) -> Option<f64> {
        self.needed_number(key.into(), Reading::Exact)
    }

    fn needed_number(&mut self, key: Key, reading: Reading) -> Option<f64> {
        let reading = std::mem::replace(&mut self.reading, reading);
        if !self.has(key) {
            self.missing(key);
        }
        let number = self.optional(key);
        self.reading = reading;
        number
    }

    /// True if an attribute is infinite, which some programs write for "unlimited".
    pub fn is_infinite(&mut self, key: Key) -> bool {
        let text = self.written_text(self.name(key)).filter(|_| !self.is_toml());
        let is_infinite = matches!(text, Some("inf" | "Inf" | "INF" | "infinity"));
        if is_infinite {
            self.ignore(&[key]);
        }
        is_infinite
    }

    /// Sets `target` to the number of a key, if there is one.
    pub fn set(&mut self, key: impl Into<Key>, target: &mut f64) {
        *target = self.number(key, *target);
    }

    /// Sets `target` (rad) to the number of a key (degrees), if there is one.
    pub fn set_angle(&mut self, key: impl Into<Key>, target: &mut f64) {
        if let Some(angle) = self.number_or::<f64>(key.into(), degrees(*target)) {
            *target = radians(angle);
        }
    }

    /// A whole number, else `default`.
    pub fn count(&mut self, key: impl Into<Key>, default: u32) -> u32 {
        let key = key.into();
        let bounds = if *key.bounds == NUMBER { &quantity::COUNT } else { key.bounds };
        let name = self.name(key);
        // Counts of parameters have no decimals, which their other integers may have.
        if matches!(self.origin, Origin::Params(..))
            && self.written_text(name).is_some_and(|text| text.trim().parse::<u32>().is_err())
        {
            let _ = self.declared_param(name, i64::DECLARED);
            self.refuse(key, bounds.expected);
            return default;
        }
        self.number_or::<i64>(Key { bounds, ..key }, f64::from(default)).map_or(default, |value| value as u32)
    }

    /// A whole number of either sign.
    pub fn integer(&mut self, key: impl Into<Key>) -> Option<i64> {
        self.number_or::<i64>(key.into(), f64::NAN).map(|value| value as i64)
    }

    /// A boolean, else `default`.
    pub fn flag(&mut self, key: impl Into<Key>, default: bool) -> bool {
        let key = key.into();
        let Some(value) = self.parsed::<bool>(key) else { return default };
        value.unwrap_or_else(|| {
            let expected =
                if self.reading == Reading::Strict { "true, false, 1 or 0" } else { "true or false" };
            self.replaced(key, expected, &format!("{default} is used"));
            default
        })
    }

    /// The text of a key.
    pub fn text(&mut self, key: impl Into<Key>) -> Option<String> {
        self.parsed::<String>(key.into()).flatten()
    }

    /// The text of a key; a missing one is an error.
    pub fn required(&mut self, key: impl Into<Key>) -> Option<String> {
        let key = key.into();
        if !self.has(key) {
            self.missing(key);
        }
        self.text(key)
    }

    /// Records that a key is missing.
    pub fn missing(&self, key: impl Into<Key>) {
        let name = self.name(key);
        let message = match &self.origin {
            Origin::Element(element) => format!("<{}> needs the attribute `{name}`", element.name()),
            Origin::Params(filter, _) => {
                let kind = filter.value("type").unwrap_or_default();
                format!("the filter `{kind}` needs the parameter `{name}`")
            }
            Origin::Table(..) => format!("the key `{name}` is missing"),
        };
        self.context.error(self.own_place(), message);
    }

    /// One of a few names. Another one is an error, or a warning if there is a `default`.
    pub fn choice<T: Clone>(
        &mut self,
        key: impl Into<Key>,
        names: &[(&'static str, T)],
        default: Option<&str>,
    ) -> Option<T> {
        let key = key.into();
        let text = self.text(key)?;
        let is_named = |name: &str| match self.reading {
            Reading::Lenient => name.eq_ignore_ascii_case(&text),
            _ => name == text,
        };
        if let Some((_, value)) = names.iter().find(|(name, _)| is_named(name)) {
            return Some(value.clone());
        }
        let known: Vec<&'static str> = names.iter().map(|(name, _)| *name).collect();
        let expected = match known.split_last() {
            Some((last, [])) => (*last).to_owned(),
            Some((last, rest)) => format!("{} or {last}", rest.join(", ")),
            None => String::new(),
        };
        let (subject, help) = (self.subject(self.name(key)), meant(&text, &known));
        match default {
            Some(default) => {
                let message = format!("expected {expected} for {subject}, found `{text}`; {default} is used");
                self.context.warn_help(self.place(key), message, help);
            }
            None => {
                let message = format!("{subject} must be {expected}, found `{text}`");
                self.context.error_help(self.place(key), message, help);
            }
        }
        None
    }

    /// Three numbers: in XML separated by semicolons.
    pub fn vector(&mut self, key: impl Into<Key>) -> Option<DVec3> {
        let expected = match self.is_toml() {
            true => "three finite numbers within ±1e12, such as [0, 0, 1]",
            false => "three numbers with semicolons within ±1e12, such as 0;0;1",
        };
        let are_usable = |list: &[f64]| list.len() == 3 && list.iter().all(|number| NUMBER.contains(*number));
        self.numbers(key.into(), are_usable, expected).map(|list| DVec3::from_slice(&list))
    }

    /// Three numbers, which XML has in a child element with the attributes x, y, z.
    pub fn xyz(&mut self, key: Key) -> Option<DVec3> {
        if self.is_toml() {
            return self.vector(key);
        }
        let mut child = self.child(key, &PoseKeys::TABLE)?;
        let vector = DVec3::from(["x", "y", "z"].map(|name| child.number(name, 0.0)));
        child.done(&[]);
        Some(vector)
    }

    /// Numbers, in XML separated by semicolons.
    pub fn numbers(
        &mut self,
        key: Key,
        is_usable: impl Fn(&[f64]) -> bool,
        expected: &str,
    ) -> Option<Vec<f64>> {
        let numbers = self.parsed::<Vec<f64>>(key)?;
        if !numbers.as_deref().is_some_and(&is_usable) && (numbers.is_some() || !self.is_toml()) {
            self.refuse(key, expected);
        }
        numbers.filter(|numbers| is_usable(numbers))
    }

    /// Lists of numbers within a list of a pipeline file.
    pub fn rows(&mut self, key: Key, expected: &str) -> Option<Vec<Vec<f64>>> {
        self.known.push(key.key);
        let number =
            |value: &Spanned<DeValue<'c>>| f64::deserialize(ValueDeserializer::from(value.clone())).ok();
        let list = |row: &Spanned<DeValue<'c>>| match row.get_ref() {
            DeValue::Array(items) => items.iter().map(number).collect::<Option<Vec<f64>>>(),
            _ => None,
        };
        let read: Option<Vec<Vec<f64>>> = match self.entry(key.key)?.get_ref() {
            DeValue::Array(rows) => rows.iter().map(list).collect(),
            _ => None,
        };
        if read.is_none() {
            self.refuse(key, expected);
        }
        read
    }

    /// Whole numbers within bounds, in a pipeline file in brackets.
    pub fn counts(&mut self, key: Key, bounds: &quantity::Bounds, expected: &str) -> Option<Vec<u32>> {
        let numbers = self.parsed::<Vec<i64>>(key)??;
        if !numbers.iter().all(|number| bounds.contains(*number as f64)) {
            self.refuse(key, expected);
            return None;
        }
        Some(numbers.into_iter().map(|number| number as u32).collect())
    }

    /// A formula, in XML in the attribute `expr` of an element.
    pub fn formula(&mut self, key: impl Into<Key>) -> Option<Formula> {
        let key = key.into();
        let text = self.text(key)?;
        match Formula::parse(&text) {
            Ok(formula) => Some(formula),
            Err(e) => {
                let place = match &self.origin {
                    Origin::Element(element) => element.value_part_place(key.attribute, &e.at),
                    Origin::Table(source, table, _) => table
                        .get(key.key)
                        .map_or_else(|| self.place(key), |value| source.part_of(value.span(), &text, &e.at)),
                    Origin::Params(..) => self.place(key),
                };
                self.context.error(place, e.message);
                None
            }
        }
    }

    /// The name of a file or asset; in TOML the name of a file next to this one, if it exists.
    pub fn near_name(&mut self, key: Key) -> Option<String> {
        let name = self.text(key)?;
        match self.origin {
            Origin::Table(source, ..) => Some(near(source, &name)),
            _ => Some(name),
        }
    }

    /// The existing file that a key names.
    pub fn file(&mut self, key: impl Into<Key>) -> Option<PathBuf> {
        let key = key.into();
        let name = self.near_name(key)?;
        self.context.file(&name, self.folder(), self.place(key))
    }

    /// The files of the raster that a key names.
    pub fn raster(&mut self, key: impl Into<Key>) -> Option<RasterFiles> {
        let key = key.into();
        let name = self.near_scene(key)?;
        self.context.raster(&name, self.folder(), Some(self.place(key)))
    }

    /// As [`Fields::near_name`] for a scene, which can be a folder of rasters or a pattern of names.
    pub fn near_scene(&mut self, key: impl Into<Key>) -> Option<String> {
        let key = key.into();
        if let Origin::Table(source, ..) = self.origin {
            let name = self.text(key)?;
            let sibling = source.folder().join(&name).to_string_lossy().into_owned();
            return Some(if self.context.are_tiles(&sibling) { sibling } else { near(source, &name) });
        }
        self.near_name(key)
    }

    /// The fields of a child element.
    pub fn element_child(&mut self, name: impl Into<Key>) -> Option<Fields<'c>> {
        let name = name.into().attribute;
        self.know_child(name);
        let Origin::Element(element) = &self.origin else { return None };
        element.child(name).map(|child| Fields::new(self.context, &child))
    }

    /// The fields of a child element or of a table within this one, whose keys `about` documents.
    pub fn child(&mut self, key: impl Into<Key>, about: &KeyTable) -> Option<Fields<'c>> {
        let key = key.into();
        let Origin::Table(source, ..) = self.origin else { return self.element_child(key) };
        self.known.push(key.key);
        let value = self.entry(key.key)?;
        let child = self.table(source, value, about);
        if child.is_none() {
            self.refuse(key, &words::table(about));
        }
        child
    }

    /// The tables of a list, whose keys `about` documents.
    pub fn children(&mut self, key: Key, about: &KeyTable) -> Vec<Fields<'c>> {
        self.known.push(key.key);
        let Origin::Table(source, ..) = self.origin else { return Vec::new() };
        let Some(value) = self.entry(key.key) else { return Vec::new() };
        let DeValue::Array(items) = value.get_ref() else {
            self.refuse(key, "a list in brackets");
            return Vec::new();
        };
        let tables: Option<Vec<Fields>> = items.iter().map(|item| self.table(source, item, about)).collect();
        if tables.is_none() {
            self.refuse(key, &format!("a list, each {}", words::table(about)));
        }
        tables.unwrap_or_default()
    }

    fn table(
        &self,
        source: &'c Source,
        value: &'c Spanned<DeValue<'c>>,
        about: &KeyTable,
    ) -> Option<Fields<'c>> {
        let table = value.get_ref().as_table()?;
        let fields = Fields::of_table(self.context, source, table, value.span());
        Some(Fields { documented: about.keys, ..fields })
    }
}
