//! The text of a pipeline file with its places.

use super::super::text::{decode, line_of_bytes};
use super::PipelineKeys;
use crate::diag::{Diagnostics, Place, nearest};
use serde::Deserialize;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeTable, DeValue, Deserializer};

/// A pipeline file's text.
pub(super) struct Source {
    path: PathBuf,
    text: String,
}

/// No file is asked to give more answers than that.
const MAX_PROBLEMS: usize = 200;

impl Source {
    pub fn new(path: &Path, bytes: &[u8], problems: &mut Diagnostics) -> Option<Source> {
        match decode(bytes) {
            Ok(text) => Some(Source { path: path.to_path_buf(), text }),
            Err(e) => {
                let (line, excerpt) = line_of_bytes(bytes, e.at);
                problems.error(Some(Place::in_line(path, line, &excerpt, 0..0)), e.message);
                None
            }
        }
    }

    /// The folder of the file.
    pub fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The place of some bytes of the text.
    pub fn place(&self, at: Range<usize>) -> Place {
        Place::in_text(&self.path, &self.text, at)
    }

    /// The place of a part of a text value; the whole value if it is written with escapes.
    pub fn part_of(&self, value: &Spanned<String>, part: &Range<usize>) -> Place {
        let span = value.span();
        let verbatim =
            self.text.get(span.start + 1..span.end.saturating_sub(1)) == Some(value.get_ref().as_str());
        if verbatim {
            self.place(span.start + 1 + part.start..span.start + 1 + part.end)
        } else {
            self.place(span)
        }
    }

    /// All keys. Every key that cannot be read is reported and left out, so that all of them are found at once; nothing
    /// only if the text is no TOML at all.
    pub fn keys(&self, problems: &mut Diagnostics) -> Option<PipelineKeys> {
        let (mut tree, errors) = DeTable::parse_recoverable(&self.text);
        for error in &errors {
            let place = error.span().map(|at| self.place(at));
            problems.error(place, format!("not well-formed TOML: {}", error.message()));
        }
        if !errors.is_empty() {
            return None;
        }
        for _ in 0..MAX_PROBLEMS {
            match PipelineKeys::deserialize(Deserializer::from(tree.clone())) {
                Ok(keys) => return Some(keys),
                Err(error) => {
                    self.report(&error, problems);
                    if !error.span().is_some_and(|at| remove(tree.get_mut(), &at)) {
                        return None;
                    }
                }
            }
        }
        None
    }

    fn report(&self, error: &toml::de::Error, problems: &mut Diagnostics) {
        let place = error.span().map(|at| self.place(at));
        let message = error.message();
        let names: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
        let (Some(unknown), Some(known)) = (names.first(), names.get(1..)) else {
            problems.error(place, in_plain_words(message));
            return;
        };
        if !message.starts_with("unknown field") {
            problems.error(place, in_plain_words(message));
            return;
        }
        let help = match nearest(unknown, known.iter().copied()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("the keys here are {}", known.join(", ")),
        };
        problems.error(place, format!("unknown key `{unknown}`")).help(help);
    }
}

/// The names of Rust's types are not for users.
fn in_plain_words(message: &str) -> String {
    let words = [
        ("f64", "a number"),
        ("u32", "a whole number of at least 0"),
        ("usize", "a whole number of at least 0"),
        ("bool", "true or false"),
        ("a boolean", "true or false"),
        ("path string", "a path"),
        ("an array of length 3", "three numbers"),
    ];
    match message.rsplit_once("expected ") {
        Some((found, expected)) => {
            let expected = words.iter().find(|w| w.0 == expected.trim()).map_or(expected, |w| w.1);
            format!("{found}expected {expected}")
        }
        None => message.to_owned(),
    }
}

/// Removes the entry whose key or value has that span, else the smallest one whose value contains it.
fn remove(table: &mut DeTable, at: &Range<usize>) -> bool {
    let exact = |key: &Range<usize>, value: &Range<usize>| key == at || value == at;
    let around = |_: &Range<usize>, value: &Range<usize>| value.start <= at.start && at.end <= value.end;
    remove_where(table, &exact) || remove_where(table, &around)
}

fn remove_where(table: &mut DeTable, wanted: &dyn Fn(&Range<usize>, &Range<usize>) -> bool) -> bool {
    let mut name = None;
    for (key, value) in table.iter_mut() {
        if remove_within(value.get_mut(), wanted) {
            return true;
        }
        if wanted(&key.span(), &value.span()) {
            name = Some(key.clone());
            break;
        }
    }
    name.is_some_and(|name| table.remove(&name).is_some())
}

fn remove_within(value: &mut DeValue, wanted: &dyn Fn(&Range<usize>, &Range<usize>) -> bool) -> bool {
    match value {
        DeValue::Table(table) => remove_where(table, wanted),
        DeValue::Array(items) => items.iter_mut().any(|item| remove_within(item.get_mut(), wanted)),
        _ => false,
    }
}
