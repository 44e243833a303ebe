//! Typed values of the attributes of an XML element, of the keys of a TOML table, and of the `<param>`
//! children of a filter (spec input-formats §1.3, §3.3). The only place that reports what was found and
//! expected.
//!
//! [`Fields::done`] reports everything that has not been read. `typed` reads values, whose types are in
//! `values`; `mounts` reads poses and rotations.

mod mounts;
mod typed;
mod values;

pub(super) use mounts::read_mount;
pub(super) use values::{Reading, parse_vector};

use super::KeyUse;
use super::context::Context;
use super::keys::{Key, WrittenKey, key_named, key_of_attribute};
use super::toml::source::Source;
use super::xml::Element;
use std::collections::HashSet;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use vlscan_base::columns::has_decimal_comma;
use vlscan_base::diag::{Place, nearest};
use vlscan_base::quantity::number;

/// Maximum number of unknown elements in an element that are reported.
const MAX_UNKNOWN_CHILDREN: usize = 1000;

/// Child elements that may occur several times.
const REPEATED: [&str; 11] =
    ["channel", "dmotion", "filter", "leg", "motion", "param", "part", "rot", "source", "stated", "swap"];
/// Settings that XML has in child elements; all others are attributes.
const IN_CHILDREN: [&str; 12] = [
    "beamOrigin",
    "channels",
    "deflectionError",
    "headError",
    "headRotateAxis",
    "incidentBeam",
    "maxRange",
    "overlap",
    "rangeError",
    "rangeNoise",
    "scannerMount",
    "snr",
];
/// The root element, whose children are distinguished by their ids.
const ROOT: &str = "document";

/// The values of one element, table or filter while they are read.
pub(super) struct Fields<'c> {
    pub context: &'c Context,
    pub reading: Reading,
    origin: Origin<'c>,
    known: Vec<&'static str>,
    known_children: Vec<&'static str>,
    /// Names and meanings of all keys of a table of a pipeline file, also of those that were not read.
    documented: &'static [(&'static str, &'static str)],
}

#[derive(Clone, Debug)]
enum Origin<'c> {
    /// The attributes of an element, and its children.
    Element(Element),
    /// A filter and its parameters, of each key the first.
    Params(Element, Vec<Element>),
    /// The keys of a table, and its range in the file.
    Table(&'c Source, &'c DeTable<'c>, Range<usize>),
}

impl<'c> Fields<'c> {
    /// The attributes of an element.
    pub fn new(context: &'c Context, element: &Element) -> Fields<'c> {
        Fields::of(context, Reading::Strict, Origin::Element(element.clone()))
    }

    /// The keys of a table of a pipeline file; `at` is its range in the file.
    pub fn of_table(
        context: &'c Context,
        source: &'c Source,
        table: &'c DeTable<'c>,
        at: Range<usize>,
    ) -> Fields<'c> {
        Fields::of(context, Reading::Required, Origin::Table(source, table, at))
    }

    /// The parameters of a filter: `<param type= key= value=>`. A declared type other than the expected one
    /// causes a warning; the value is read anyway.
    pub fn of_params(context: &'c Context, filter: &Element) -> Fields<'c> {
        let mut fields = Fields::new(context, filter);
        fields.ignore(&["type"]);
        fields.done(&["param"]);
        let mut params: Vec<Element> = Vec::new();
        let mut keys = HashSet::new();
        for param in filter.named("param") {
            let mut fields = Fields::new(context, &param);
            let key = fields.required("key");
            fields.ignore(&["type", "value"]);
            match param.value("type") == Some("rotation") {
                true => fields.ignore(&["rotations"]),
                false => fields.without_effect(&["rotations"], "on a parameter that is not a rotation"),
            }
            fields.done(&["rot"]);
            if keys.insert(key.clone()) {
                params.push(param);
            } else {
                let key = key.unwrap_or_default();
                context.warn(
                    param.place(),
                    format!("the parameter `{key}` is given twice; the first one is used"),
                );
            }
        }
        Fields::of(context, Reading::Required, Origin::Params(filter.clone(), params))
    }

    fn of(context: &'c Context, reading: Reading, origin: Origin<'c>) -> Fields<'c> {
        Fields { context, reading, origin, known: Vec::new(), known_children: Vec::new(), documented: &[] }
    }

    /// True if these are keys of a pipeline file.
    pub fn is_toml(&self) -> bool {
        matches!(self.origin, Origin::Table(..))
    }

    /// True if this is an element of the built-in catalogue.
    pub fn is_built_in(&self) -> bool {
        matches!(&self.origin, Origin::Element(element) if element.is_built_in())
    }

    /// The folder of the file, from which other files are searched.
    pub fn folder(&self) -> &Path {
        match &self.origin {
            Origin::Element(element) | Origin::Params(element, _) => element.folder(),
            Origin::Table(source, ..) => source.folder(),
        }
    }

    /// The name of a key in this file.
    pub fn name(&self, key: impl Into<Key>) -> &'static str {
        let key = key.into();
        if self.is_toml() { key.key } else { key.attribute }
    }

    /// The key as messages name it.
    fn subject(&self, name: &str) -> String {
        match self.origin {
            Origin::Params(..) => format!("the parameter `{name}`"),
            _ => format!("`{name}`"),
        }
    }

    fn entry(&self, name: &str) -> Option<&'c Spanned<DeValue<'c>>> {
        match &self.origin {
            Origin::Table(_, table, _) => table.get(name),
            _ => None,
        }
    }

    fn param(&self, name: &str) -> Option<&Element> {
        match &self.origin {
            Origin::Params(_, params) => params.iter().find(|p| p.value("key") == Some(name)),
            _ => None,
        }
    }

    /// Returns a parameter; a declared type that is not among `types` causes a warning.
    pub fn declared_param(&mut self, name: &'static str, types: &[&str]) -> Option<Element> {
        self.known.push(name);
        let param = self.param(name)?.clone();
        let declared = param.value("type").unwrap_or_default();
        if !types.contains(&declared) {
            let known = ["string", "", "double", "integer", "int", "boolean", "bool", "vec3", "rotation"];
            let expected = types.first().copied().unwrap_or_default();
            let message =
                format!("the parameter `{name}` is declared as `{declared}`, it is read as `{expected}`");
            let help = if known.contains(&declared) { String::new() } else { meant(declared, &known) };
            self.context.warn_help(param.value_place("type"), message, help);
        }
        Some(param)
    }

    /// The text of a value as written.
    fn written_text(&self, name: &str) -> Option<&str> {
        match &self.origin {
            Origin::Element(element) => element.value(name),
            Origin::Params(..) => self.param(name).map(|param| param.value("value").unwrap_or_default()),
            Origin::Table(source, table, _) => table.get(name).map(|value| source.slice(value.span())),
        }
    }

    /// True if a key is present: in XML its attribute, or its child element if it has one.
    pub fn has(&self, key: impl Into<Key>) -> bool {
        let name = self.name(key);
        match &self.origin {
            Origin::Element(element) if IN_CHILDREN.contains(&name) => element.child(name).is_some(),
            _ => self.written_text(name).is_some(),
        }
    }

    /// True if a key of a pipeline file is a table.
    pub fn has_table(&self, key: Key) -> bool {
        self.entry(key.key).is_some_and(|value| value.get_ref().as_table().is_some())
    }

    /// True if a key of a pipeline file is a list.
    pub fn has_list(&self, key: Key) -> bool {
        self.entry(key.key).is_some_and(|value| matches!(value.get_ref(), DeValue::Array(_)))
    }

    /// Marks a kind of child elements as known.
    fn know_child(&mut self, name: &'static str) {
        if !self.known_children.contains(&name) {
            self.known_children.push(name);
        }
    }

    /// The place of the value or of the name of a key; the place of the element, filter or table if the key
    /// is missing.
    fn place_of(&self, name: &str, of_name: bool) -> Place {
        match &self.origin {
            Origin::Element(element) => match element.child(name) {
                Some(child) if element.value(name).is_none() => child.place(),
                _ if of_name => element.name_place(name),
                _ => element.value_place(name),
            },
            Origin::Params(filter, _) => {
                let part = if of_name { "key" } else { "value" };
                self.param(name).map_or_else(|| filter.place(), |param| param.value_place(part))
            }
            Origin::Table(source, table, at) => {
                let span = table.iter().find(|(key, _)| *key.get_ref() == name);
                let span = span.map(|(key, value)| if of_name { key.span() } else { value.span() });
                source.place(span.unwrap_or(at.clone()))
            }
        }
    }

    /// The place of a value; the place of the element or table if the value is missing.
    pub fn place(&self, key: impl Into<Key>) -> Place {
        self.place_of(self.name(key), false)
    }

    /// The place of a value, unless the value is missing.
    pub fn place_if_written(&self, key: impl Into<Key>) -> Option<Place> {
        let key = key.into();
        self.has(key).then(|| self.place(key))
    }

    /// The place of the element, filter or table.
    pub fn own_place(&self) -> Place {
        self.place_of("", false)
    }

    /// The element, unless these are keys or parameters.
    pub fn element(&self) -> Option<&Element> {
        match &self.origin {
            Origin::Element(element) => Some(element),
            _ => None,
        }
    }

    /// Adds names of keys that may be suggested for an unknown one.
    pub fn suggest(&mut self, names: &[&'static str]) {
        self.known.extend(names);
    }

    /// Marks keys without effect as known.
    pub fn ignore<K: Into<Key> + Copy>(&mut self, keys: &[K]) {
        for key in keys {
            let name = self.name(*key);
            match &self.origin {
                Origin::Element(_) if IN_CHILDREN.contains(&name) => self.know_child(name),
                _ => self.known.push(name),
            }
        }
    }

    /// Reports everything that has not been read: unknown keys of TOML are errors; unknown attributes,
    /// parameters, and child elements other than `children` are warned of.
    pub fn done(self, children: &[&'static str]) {
        let known = &self.known;
        match &self.origin {
            Origin::Element(element) => {
                let tag = element.name();
                for name in element.attribute_names().filter(|n| !known.contains(n)) {
                    let message = format!("unknown attribute `{name}` of <{tag}> is ignored");
                    self.context.warn_help(element.name_place(name), message, meant(name, known));
                }
                let children = [&self.known_children, children].concat();
                self.report_repeated(element, &children);
                self.report_text(element);
                let unknown = element.children().filter(|c| !children.contains(&c.name()));
                for child in unknown.take(MAX_UNKNOWN_CHILDREN) {
                    let message = format!("unknown element <{}> in <{tag}> is ignored", child.name());
                    self.context.warn_help(child.place(), message, meant(child.name(), &children));
                }
            }
            Origin::Params(filter, params) => {
                for param in params {
                    let Some(key) = param.value("key").filter(|k| !known.contains(k)) else { continue };
                    let kind = filter.value("type").unwrap_or_default();
                    let message = format!("unknown parameter `{key}` of `{kind}` is ignored");
                    self.context.warn_help(param.value_place("key"), message, meant(key, known));
                }
            }
            Origin::Table(source, table, _) => {
                // A table that several devices read has its keys several times.
                let mut seen = HashSet::new();
                let documented = self.documented.iter().map(|(name, _)| *name);
                let names = known.iter().copied().chain(documented);
                let names: Vec<&str> = names.filter(|name| seen.insert(*name)).collect();
                for key in table.keys().filter(|key| !known.contains(&key.get_ref().as_ref())) {
                    source.report_unknown(key, &names, &mut self.context.problems.borrow_mut());
                }
            }
        }
    }

    /// Warns of text between the children of an element, which has none: perhaps a tag that lost its `<`.
    fn report_text(&self, element: &Element) {
        let Some((text, place)) = element.stray_text() else { return };
        let message = format!("text in <{}> is ignored: `{}`", element.name(), shortened(text));
        let help = match text.contains('=') || text.contains('>') {
            true => "did an element lose its `<`?",
            false => "values stand in attributes; a comment stands between <!-- and -->",
        };
        self.context.warn_help(place, message, help);
    }

    /// Warns of repeated children of a kind of which only the first is used.
    fn report_repeated(&self, element: &Element, children: &[&'static str]) {
        if element.name() == ROOT {
            return;
        }
        for name in children.iter().filter(|name| !REPEATED.contains(name)) {
            for second in element.named(name).skip(1).take(MAX_UNKNOWN_CHILDREN) {
                let message =
                    format!("a second <{name}> in <{}> is ignored; the first one is used", element.name());
                self.context.warn(second.place(), message);
            }
        }
    }

    /// The keys of an instrument that some physics ignores; none in the built-in catalogue, which serves all.
    pub fn written_keys(&self, channel: Option<usize>) -> Vec<WrittenKey> {
        let all: Vec<(Option<&'static Key>, Place)> = match &self.origin {
            Origin::Element(element) if !element.is_built_in() => {
                let attributes =
                    element.attribute_names().map(|n| (key_of_attribute(n), element.name_place(n)));
                let children = element.children().map(|c| (key_of_attribute(c.name()), c.place()));
                attributes.chain(children).collect()
            }
            Origin::Table(source, table, _) => {
                table.keys().map(|key| (key_named(key.get_ref()), source.place(key.span()))).collect()
            }
            _ => Vec::new(),
        };
        let written = all.into_iter().filter_map(|(key, place)| {
            let key = key.filter(|key| key.used != KeyUse::Always)?;
            Some(WrittenKey { key, name: self.name(*key), place, channel })
        });
        written.collect()
    }

    /// Warns of a value; the message follows its name.
    pub fn warn(&self, key: impl Into<Key>, message: &str) {
        let key = key.into();
        self.context.warn(self.place(key), format!("{} {message}", self.subject(self.name(key))));
    }

    /// Records an error of a value; the message follows its name.
    pub fn error(&self, key: impl Into<Key>, message: &str) {
        let key = key.into();
        self.context.error(self.place(key), format!("{} {message}", self.subject(self.name(key))));
    }

    /// Warns that keys have no effect, for the reason `why`, if they are written.
    pub fn without_effect<K: Into<Key> + Copy>(&mut self, keys: &[K], why: &str) {
        keys.iter().filter(|key| self.has(**key)).for_each(|key| self.warn_of_effect(*key, why));
        self.ignore(keys);
    }

    /// Warns that a key has no effect, for the reason `why`.
    pub fn warn_of_effect(&self, key: impl Into<Key>, why: &str) {
        let name = self.name(key);
        let message = format!("{} has no effect {why}", self.subject(name));
        self.context.warn(self.place_of(name, true), message);
    }

    /// [`Fields::without_effect`] for all `names` that have not been read.
    pub fn rest_without_effect(&mut self, names: &[&'static str], why: &str) {
        let rest: Vec<&'static str> =
            names.iter().copied().filter(|name| !self.known.contains(name)).collect();
        self.without_effect(&rest, why);
    }

    /// Rejects two mutually exclusive keys.
    pub fn either(&self, one: Key, other: Key) {
        if self.has(one) && self.has(other) {
            let (one_name, other_name) = (self.name(one), self.name(other));
            let message = format!("give either `{one_name}` or `{other_name}`, not both");
            self.context.error(self.place(one), message);
        }
    }

    /// Rejects a lower limit above the upper one, at the key of one of them; an inherited contradiction has
    /// been reported.
    pub fn in_order<K: Into<Key> + Copy>(&self, (least, most): (f64, f64), [lower, upper]: [K; 2], or: &str) {
        let (low, high) = (self.name(lower), self.name(upper));
        if least > most && self.has(upper) {
            self.refuse(upper, &format!("at least `{low}`, {}{or}", number(least)));
        } else if least > most && self.has(lower) {
            self.refuse(lower, &format!("at most `{high}`, {}", number(most)));
        }
    }

    /// Records that the value is unusable.
    pub fn refuse(&self, key: impl Into<Key>, expected: &str) {
        let key = key.into();
        let name = self.name(key);
        let found = self.written_text(name).unwrap_or_default();
        let message = format!("{} must be {expected}, found `{found}`", self.subject(name));
        self.context.error(self.place(key), message);
    }

    /// Reports a value that cannot be read; for TOML that has already been done.
    fn replaced(&self, key: Key, expected: &str, used: &str) {
        match self.reading {
            _ if self.is_toml() => {}
            Reading::Required | Reading::Exact => self.refuse(key, expected),
            _ => {
                let name = self.name(key);
                let found = self.written_text(name).unwrap_or_default();
                let message = format!("expected {expected} for `{name}`, found `{found}`; {used}");
                let hint = if has_decimal_comma(found) { DECIMAL_POINT } else { "" };
                self.context.warn_help(self.place(key), message, hint);
            }
        }
    }
}

/// Warns of tables with the id of an earlier table, which outputs cannot distinguish.
pub(super) fn warn_of_repeated_keys(tables: &[Fields], key: Key) {
    let mut ids = HashSet::new();
    for table in tables {
        let Some(text) = table.written_text(table.name(key)) else { continue };
        if !ids.insert(text) {
            table.warn(key, &format!("of {text} occurs twice: outputs cannot tell them apart"));
        }
    }
}

/// The hint for a number with a decimal comma.
const DECIMAL_POINT: &str = "numbers have a decimal point, not a comma";

/// The beginning of a text, for messages.
fn shortened(text: &str) -> String {
    const MAX_CHARACTERS: usize = 40;
    match text.char_indices().nth(MAX_CHARACTERS) {
        Some((end, _)) => format!("{} …", text[..end].trim_end()),
        None => text.to_owned(),
    }
}

/// The hint "did you mean …", or an empty text.
pub(super) fn meant(word: &str, known: &[&'static str]) -> String {
    nearest(word, known.iter().copied()).map_or(String::new(), |near| format!("did you mean `{near}`?"))
}
