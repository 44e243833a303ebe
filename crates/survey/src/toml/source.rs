//! The text of a pipeline file, and its tables, from which each reader takes its keys.

use super::super::assets::{Assets, SPELLING_HELP, slashes, spelling_message};
use super::super::context::ReadOptions;
use super::super::keys::{KeyTable, SURVEY_TABLES};
use super::super::text::{decode, line_of_bytes};
use super::words::{self, Wording};
use serde::Deserialize;
use serde::de::Visitor;
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue, Deserializer, ValueDeserializer};
use vlscan_base::diag::{Diagnostic, Diagnostics, Place, ProblemKind, nearest};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_base::recognise::{Expected, foreign};
use vlscan_tables::input::read_file;

/// A pipeline file: its path and its TOML text.
#[derive(Debug)]
pub struct Source {
    path: PathBuf,
    text: String,
    /// The keys that other crates take, by table; known once the survey is read.
    taken: OnceLock<BTreeMap<&'static str, Vec<&'static str>>>,
}

/// Maximum size of a file, bytes.
const MAX_FILE_BYTES: u64 = 1 << 24;
/// Maximum number of reported problems of one file.
const MAX_PROBLEMS: usize = 200;

/// Description of the keys above all tables.
const TOP: &str = "the file itself: write it above the first table";

/// Headers of the tables that have a key of this name.
fn headed_tables_with(key: &str) -> impl Iterator<Item = &'static str> {
    SURVEY_TABLES
        .iter()
        .filter(move |table| table.name.starts_with('[') && has_key(table, key))
        .map(|t| t.name)
}

fn has_key(table: &KeyTable, key: &str) -> bool {
    table.keys.iter().any(|(name, _)| *name == key)
}

/// The tables within others that have a key of this name, such as `weather` of `[settings]`.
fn inner_tables_with(key: &str) -> Vec<String> {
    let is_inner = |table: &&KeyTable| !table.name.is_empty() && !table.name.starts_with('[');
    let names =
        SURVEY_TABLES.iter().filter(is_inner).filter(|table| has_key(table, key)).filter_map(|table| {
            let outer: Vec<&str> = headed_tables_with(table.name).collect();
            (!outer.is_empty()).then(|| format!("`{}` of {}", table.name, outer.join(" and ")))
        });
    names.collect()
}

impl Source {
    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Input`] for bytes that are not text.
    pub fn read(path: &Path) -> Result<Source> {
        let bytes = read_file(path, MAX_FILE_BYTES).map_err(|e| Error::open(path, e))?;
        if let Some(found) = foreign(path, &bytes, &Expected::PIPELINE) {
            return Err(found.error(path));
        }
        match decode(&bytes) {
            Ok(text) => Ok(Source::of_text(path, text)),
            Err(e) => {
                let (line, excerpt) = line_of_bytes(&bytes, e.at);
                let mut problems = Diagnostics::default();
                problems.error(Some(Place::in_line(path, line, &excerpt, 0..0)), e.message);
                Err(Error::Input(Box::new(problems)))
            }
        }
    }

    /// A text in memory; `path` is its name in messages, and its folder the one that names are relative to.
    pub fn of_text(path: &Path, text: String) -> Source {
        Source { path: path.to_path_buf(), text, taken: OnceLock::new() }
    }

    /// Folder of the file, to which relative names in it refer.
    pub fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The place of a range of bytes of the text.
    pub fn place(&self, at: Range<usize>) -> Place {
        Place::in_text(&self.path, &self.text, at)
    }

    /// A range of bytes of the text.
    pub(crate) fn slice(&self, at: Range<usize>) -> &str {
        self.text.get(at).unwrap_or_default()
    }

    /// The place of a part of the string `value` in quotes at `span`; the complete value if it contains
    /// escapes.
    pub(crate) fn part_of(&self, span: Range<usize>, value: &str, part: &Range<usize>) -> Place {
        let is_verbatim = self.slice(span.start + 1..span.end.saturating_sub(1)) == value;
        let part = span.start + 1 + part.start..span.start + 1 + part.end;
        self.place(if is_verbatim { part } else { span })
    }

    /// Reads a value of which the text is the whole file.
    ///
    /// # Errors
    /// The first problem of the file.
    pub fn parse<T: serde::de::DeserializeOwned>(&self) -> Result<T> {
        self.tables()?;
        toml::from_str(&self.text).map_err(|error| {
            let mut problems = Diagnostics::default();
            self.report_value(&error, None, &mut problems);
            Error::Input(Box::new(problems))
        })
    }

    /// Records an error of serde, whose message has the names of keys and variants in backticks. `span` is
    /// its place unless the error has one.
    pub(crate) fn report_value(
        &self,
        error: &toml::de::Error,
        span: Option<Range<usize>>,
        problems: &mut Diagnostics,
    ) {
        let place = error.span().or(span).map(|at| self.place(at));
        let message = error.message();
        let names: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
        let (unknown, known) = names.split_first().map_or(("", &[][..]), |(first, rest)| (*first, rest));
        let (message, list) = if message.starts_with("unknown field") {
            (format!("unknown key `{unknown}`"), Some("the keys here are"))
        } else if message.starts_with("unknown variant") {
            (format!("expected {}, found `{unknown}`", known.join(", ")), None)
        } else if message.starts_with("missing field") {
            (format!("the key `{unknown}` is missing"), None)
        } else {
            problems.error(place, words::of_value(message));
            return;
        };
        let problem = problems.error(place, message);
        match (nearest(unknown, known.iter().copied()), list) {
            (Some(near), _) => {
                problem.help(format!("did you mean `{near}`?"));
            }
            (None, Some(list)) => {
                problem.help(format!("{list} {}", known.join(", ")));
            }
            _ => {}
        }
    }

    /// The places that have a key of this name: tables with headers, such as `[settings]`, and the file
    /// itself, else tables within others. `None` if there are none.
    fn tables_with(&self, key: &str) -> Option<String> {
        let taken = self.taken.get().into_iter().flatten().filter(|(_, keys)| keys.contains(&key));
        let of_options = taken.map(|(table, _)| format!("[{table}]")).filter(|name| name != "[]");
        let mut names: Vec<String> = headed_tables_with(key).map(str::to_owned).chain(of_options).collect();
        let of_survey = SURVEY_TABLES.iter().any(|table| table.name.is_empty() && has_key(table, key));
        let has_top =
            |taken: &BTreeMap<&str, Vec<&str>>| taken.get("").is_some_and(|keys| keys.contains(&key));
        if of_survey || self.taken.get().is_some_and(has_top) {
            names.push(TOP.to_owned());
        }
        if names.is_empty() {
            names = inner_tables_with(key);
        }
        (!names.is_empty()).then(|| names.join(" and "))
    }

    /// Records a key that is not in `known`.
    pub(crate) fn report_unknown(&self, key: &Spanned<DeString>, known: &[&str], problems: &mut Diagnostics) {
        let near = nearest(key.get_ref(), known.iter().copied());
        let help = match (self.tables_with(key.get_ref()), near) {
            (Some(tables), Some(near)) => {
                format!("`{}` is a key of {tables}; did you mean `{near}` here?", key.get_ref())
            }
            (Some(tables), None) => format!("`{}` is a key of {tables}", key.get_ref()),
            (None, Some(near)) => format!("did you mean `{near}`?"),
            (None, None) => {
                // Some keys are those of XML alone.
                let known: Vec<&str> = known.iter().copied().filter(|key| !key.is_empty()).collect();
                format!("the keys here are {}", known.join(", "))
            }
        };
        let message = format!("unknown key `{}`", key.get_ref());
        problems.error(Some(self.place(key.span())), message).help(help);
    }

    fn report_form(&self, error: &toml::de::Error, problems: &mut Diagnostics) {
        let at = error.span();
        let Wording { message, hint } =
            words::of_form(error.message(), &self.text, at.clone().map(|at| at.start));
        let problem = problems.error(at.map(|at| self.place(at)), message);
        if !hint.is_empty() {
            problem.help(hint);
        }
    }

    /// The tables of the file.
    ///
    /// # Errors
    /// A text that is not TOML.
    pub fn tables(&self) -> Result<Tables<'_>> {
        let (root, errors) = DeTable::parse_recoverable(&self.text);
        let mut problems = Diagnostics::default();
        for error in &errors {
            self.report_form(error, &mut problems);
        }
        problems.finish(false)?;
        let problems = Diagnostics::default();
        Ok(Tables { source: self, root, known: BTreeMap::new(), spans: HashMap::new(), problems })
    }
}

/// The tables of a pipeline file, from which each reader takes its keys.
#[derive(Debug)]
pub struct Tables<'t> {
    pub(super) source: &'t Source,
    /// Tables and keys that have not been taken.
    pub(super) root: Spanned<DeTable<'t>>,
    /// Names of the keys of each table; the table at the top of the file has the name "".
    known: BTreeMap<&'static str, Vec<&'static str>>,
    /// Ranges of the values that have been taken, by table and key.
    spans: HashMap<(&'static str, String), Range<usize>>,
    pub(super) problems: Diagnostics,
}

impl<'t> Tables<'t> {
    /// Takes the keys of a table that are fields of `T`. Problems are recorded; unreadable keys have their
    /// defaults.
    pub fn take<T: Deserialize<'t> + Default>(&mut self, table: &'static str) -> T {
        let fields = field_names::<T>();
        self.known.entry(table).or_default().extend(fields);
        let mut taken = DeTable::new();
        let root = self.root.get_mut();
        let entries = match table {
            "" => Some(root),
            _ => match root.get_mut(table).map(Spanned::get_mut) {
                Some(DeValue::Table(entries)) => Some(entries),
                _ => None,
            },
        };
        if let Some(entries) = entries {
            let own: Vec<_> =
                entries.keys().filter(|key| fields.contains(&key.get_ref().as_ref())).cloned().collect();
            for key in own {
                if let Some(value) = entries.remove(&key) {
                    self.spans.insert((table, key.get_ref().to_string()), value.span());
                    taken.insert(key, value);
                }
            }
        }
        self.read(Spanned::new(0..0, taken)).unwrap_or_default()
    }

    /// Takes one key of a table; `None` if it is absent or unreadable, and then the problem is recorded.
    pub fn take_key<T: Deserialize<'t>>(&mut self, table: &'static str, key: &'static str) -> Option<T> {
        self.known.entry(table).or_default().push(key);
        let Some(DeValue::Table(entries)) = self.root.get_mut().get_mut(table).map(Spanned::get_mut) else {
            return None;
        };
        let value = entries.remove(key)?;
        let span = value.span();
        self.spans.insert((table, key.to_owned()), span.clone());
        match T::deserialize(ValueDeserializer::from(value)) {
            Ok(value) => Some(value),
            Err(error) => {
                self.source.report_value(&error, Some(span), &mut self.problems);
                None
            }
        }
    }

    /// Deserialises `T` from a table. Unreadable keys are reported and removed one at a time, so that all of
    /// them are found in one run.
    fn read<T: Deserialize<'t>>(&mut self, mut table: Spanned<DeTable<'t>>) -> Option<T> {
        for _ in 0..MAX_PROBLEMS {
            match T::deserialize(Deserializer::from(table.clone())) {
                Ok(value) => return Some(value),
                Err(error) => {
                    self.source.report_value(&error, None, &mut self.problems);
                    if !error.span().is_some_and(|at| remove(table.get_mut(), &at)) {
                        return None;
                    }
                }
            }
        }
        None
    }

    /// The keys that have not been taken, at the top level, and the names of those that have. Other keys of
    /// the tables of which some have been taken are reported as unknown; the caller shows the problems.
    pub(super) fn finish(mut self) -> (DeTable<'t>, Vec<&'static str>, Diagnostics) {
        let mut root = std::mem::take(self.root.get_mut());
        // Several scanners read the same keys.
        let _ = self.source.taken.set(self.known.clone());
        let mut names = self.known.remove("").unwrap_or_default();
        for (table, known) in &self.known {
            names.push(table);
            let Some(rest) = root.remove(*table) else { continue };
            match rest.get_ref() {
                DeValue::Table(entries) => {
                    entries.keys().for_each(|key| self.source.report_unknown(key, known, &mut self.problems));
                }
                _ => {
                    let place = self.source.place(rest.span());
                    self.problems.error(Some(place), format!("expected a table [{table}]"));
                }
            }
        }
        (root, names, self.problems)
    }

    /// True if the file has an entry of this name at its top level.
    pub fn has(&self, table: &str) -> bool {
        self.root.get_ref().contains_key(table)
    }

    /// The place of a value that has been taken.
    pub fn place(&self, table: &'static str, key: &str) -> Option<Place> {
        self.spans.get(&(table, key.to_owned())).map(|span| self.source.place(span.clone()))
    }

    pub(crate) fn source(&self) -> &'t Source {
        self.source
    }

    /// Records a problem that ends the run.
    pub fn error(&mut self, place: Option<Place>, message: impl Into<String>) -> &mut Diagnostic {
        self.problems.error(place, message)
    }

    /// The existing file that a key names: next to the pipeline file, or in the search path. A missing file
    /// is recorded as a problem.
    pub fn find_file(&mut self, name: &Path, place: Option<Place>, options: &ReadOptions) -> Option<PathBuf> {
        let assets = Assets::new(&options.assets);
        let name = name.to_string_lossy();
        let Some(located) = assets.file(&near(self.source, &name), self.source.folder()) else {
            let help = assets.help_for_missing(&name, self.source.folder());
            let message = format!("cannot find the file `{name}`");
            self.problems.error(place, message).of_kind(ProblemKind::NotFound).help(help);
            return None;
        };
        if let Some(spelling) = located.respelled {
            self.problems.warn(place, spelling_message(&name, &spelling)).help(SPELLING_HELP);
        }
        Some(located.found)
    }
}

/// The names of the fields that `T` is deserialised from.
pub fn field_names<'de, T: Deserialize<'de>>() -> &'static [&'static str] {
    let mut names: &'static [&'static str] = &[];
    let _ = T::deserialize(FieldNames(&mut names));
    names
}

/// A deserialiser that records the names of a struct's fields and yields no values.
struct FieldNames<'a>(&'a mut &'static [&'static str]);

impl<'de> serde::Deserializer<'de> for FieldNames<'_> {
    type Error = serde::de::value::Error;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> std::result::Result<V::Value, Self::Error> {
        Err(serde::de::Error::custom("no struct"))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> std::result::Result<V::Value, Self::Error> {
        *self.0 = fields;
        self.deserialize_any(visitor)
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}

/// Removes the entry whose key or value has the span `at`, else the smallest entry whose value contains it.
fn remove(table: &mut DeTable, at: &Range<usize>) -> bool {
    let exact = |key: &Range<usize>, value: &Range<usize>| key == at || value == at;
    let around = |_: &Range<usize>, value: &Range<usize>| value.start <= at.start && at.end <= value.end;
    remove_where(table, &exact) || remove_where(table, &around)
}

fn remove_where(table: &mut DeTable, is_removed: &dyn Fn(&Range<usize>, &Range<usize>) -> bool) -> bool {
    let mut name = None;
    for (key, value) in table.iter_mut() {
        if remove_within(value.get_mut(), is_removed) {
            return true;
        }
        if is_removed(&key.span(), &value.span()) {
            name = Some(key.clone());
            break;
        }
    }
    name.is_some_and(|name| table.remove(&name).is_some())
}

fn remove_within(value: &mut DeValue, is_removed: &dyn Fn(&Range<usize>, &Range<usize>) -> bool) -> bool {
    match value {
        DeValue::Table(table) => remove_where(table, is_removed),
        DeValue::Array(items) => items.iter_mut().any(|item| remove_within(item.get_mut(), is_removed)),
        _ => false,
    }
}

/// Prefers a file next to the pipeline file to one in the search path; returns the reference to use.
pub(crate) fn near(source: &Source, reference: &str) -> String {
    let (file, id) = match reference.split_once('#') {
        Some((file, id)) => (file, Some(id)),
        None => (reference, None),
    };
    let sibling = source.folder().join(file);
    let is_sibling = reads::is_file(&sibling) || reads::is_file(source.folder().join(&*slashes(file)));
    match (is_sibling, id) {
        (false, _) => reference.to_owned(),
        (true, None) => sibling.to_string_lossy().into_owned(),
        (true, Some(id)) => format!("{}#{id}", sibling.to_string_lossy()),
    }
}
