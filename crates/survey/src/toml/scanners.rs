//! `[[scanner]]` tables: a file with several scanners is read once for each, with that scanner's table in the
//! place of all of them.

use super::super::keys::{InstrumentKeys, Key, PlatformKeys, RigKeys, SurveyKeys};
use super::source::Tables;
use serde::Deserialize;
use std::ops::Range;
use std::path::PathBuf;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue, ValueDeserializer};
use vlscan_base::diag::nearest;

const K: RigKeys = RigKeys::KEYS;
const TOP: SurveyKeys = SurveyKeys::KEYS;

/// A scanner chosen from the `[[scanner]]` tables of a file.
#[derive(Clone, Debug)]
pub struct ChosenScanner<O> {
    /// Its name; empty if the table has none that can be used, which is recorded as a problem.
    pub name: String,
    /// Its outputs.
    pub outputs: Vec<O>,
}

/// Name of a scanner and its place in the file.
type Named = (String, Range<usize>);

impl<'t> Tables<'t> {
    /// Number of `[[scanner]]` tables; 0 for a file with a single `[scanner]` table or none.
    pub fn scanners(&self) -> usize {
        match self.root.get_ref().get(TOP.scanner.key).map(Spanned::get_ref) {
            Some(DeValue::Array(tables)) => tables.len(),
            _ => 0,
        }
    }

    /// Replaces all `[[scanner]]` tables by the one with this index, as a `[scanner]` table. Its `mount`
    /// becomes that of `[platform]`, its `settings` override those of `[settings]`, and its outputs are
    /// returned: `of_path` makes an output from a path. Problems are recorded.
    pub fn choose_scanner<O: Deserialize<'t>>(
        &mut self,
        index: usize,
        of_path: impl Fn(PathBuf) -> O,
    ) -> ChosenScanner<O> {
        let mut chosen = ChosenScanner { name: String::new(), outputs: Vec::new() };
        let names = self.scanner_names();
        let Some(entry) = self.root.get_mut().get_mut(TOP.scanner.key) else { return chosen };
        let DeValue::Array(tables) = entry.get_ref() else { return chosen };
        let Some(table) = tables.get(index).cloned() else { return chosen };
        let at = table.span();
        *entry = table;
        // The reader of the survey reports an entry that is not a table.
        let DeValue::Table(own) = entry.get_mut() else { return chosen };
        let has_name = own.contains_key(K.name.key);
        let [mount, settings, output] = [K.mount, K.settings, K.output].map(|key| own.remove_entry(key.key));
        // The reader of the instrument does not know these keys, so it cannot suggest them.
        let known = InstrumentKeys::TABLE.keys.iter().chain(RigKeys::TABLE.keys);
        let known: Vec<&str> = known.map(|(name, _)| *name).collect();
        for misspelt in misspelt_keys(own, &known) {
            if let Some((key, _)) = own.remove_entry(misspelt.as_str()) {
                self.source.report_unknown(&key, &known, &mut self.problems);
            }
        }
        if let Some(name) = self.checked_name(&names, index, has_name, &at) {
            chosen.name = name;
        }
        if let Some((key, mount)) = mount {
            self.put(TOP.platform, (PlatformKeys::KEYS.mount, key.span()), mount);
        }
        if let Some((_, settings)) = settings {
            self.override_settings(settings);
        }
        match output {
            Some((_, output)) => chosen.outputs = self.read_outputs(output, &of_path),
            None => {
                let problem = self.problems.error(
                    Some(self.source.place(at)),
                    format!("a [[scanner]] needs the key `{}`", K.output.key),
                );
                problem.help("output = \"front.laz\", the file of the points of this scanner");
            }
        }
        chosen
    }

    /// The name of each `[[scanner]]` table that has one.
    fn scanner_names(&self) -> Vec<Option<Named>> {
        let Some(DeValue::Array(tables)) = self.root.get_ref().get(TOP.scanner.key).map(Spanned::get_ref)
        else {
            return Vec::new();
        };
        let name_of = |table: &Spanned<DeValue>| {
            let value = table.get_ref().as_table()?.get(K.name.key)?;
            Some((value.get_ref().as_str()?.to_owned(), value.span()))
        };
        tables.iter().map(name_of).collect()
    }

    /// The name of a scanner, unless it is missing, unusable or that of an earlier scanner. `at` is the place
    /// of the table.
    fn checked_name(
        &mut self,
        names: &[Option<Named>],
        index: usize,
        has_name: bool,
        at: &Range<usize>,
    ) -> Option<String> {
        let Some((name, place)) = names.get(index).cloned().flatten() else {
            // The reader of the instrument reports a name that is not a text.
            if !has_name {
                let place = Some(self.source.place(at.clone()));
                let message = format!("a [[scanner]] needs the key `{}`", K.name.key);
                self.problems.error(place, message).help("name = \"front\"");
            }
            return None;
        };
        let place = Some(self.source.place(place));
        let is_usable = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if name.is_empty() || name.starts_with('.') || !name.chars().all(is_usable) {
            let message = format!("invalid name of a scanner `{name}`");
            let help = "use letters, digits, `-`, `_` and `.`, the latter not in front";
            self.problems.error(place, message).help(help);
            return None;
        }
        // Names become folders of shards, whose case some file systems ignore.
        let is_same = |(earlier, _): &Named| earlier.eq_ignore_ascii_case(&name);
        if names[..index].iter().flatten().any(is_same) {
            let message = format!("two [[scanner]] tables have the name `{name}`");
            self.problems.error(place, message).help("each scanner needs a name of its own");
            return None;
        }
        Some(name)
    }

    /// Puts the settings of a scanner over those of all.
    fn override_settings(&mut self, settings: Spanned<DeValue<'t>>) {
        let span = settings.span();
        let DeValue::Table(entries) = settings.into_inner() else {
            let found = self.source.slice(span.clone());
            let message = format!("`{}` must be a table, found `{found}`", K.settings.key);
            self.problems.error(Some(self.source.place(span)), message);
            return;
        };
        for (key, value) in entries {
            let Some(table) = self.table_for(TOP.settings, &span) else { return };
            // The place of a key is that of the value which counts.
            table.remove(&**key.get_ref());
            table.insert(key, value);
        }
    }

    /// Sets a key of a table at the top of the file.
    fn put(&mut self, table: Key, (key, at): (Key, Range<usize>), value: Spanned<DeValue<'t>>) {
        let Some(entries) = self.table_for(table, &at) else { return };
        entries.remove(key.key);
        entries.insert(Spanned::new(at, DeString::Borrowed(key.key)), value);
    }

    /// A table at the top of the file, which is added if it is missing; `None` if the entry is not a table,
    /// which its reader reports. `at` is the place of an added table.
    fn table_for(&mut self, table: Key, at: &Range<usize>) -> Option<&mut DeTable<'t>> {
        let root = self.root.get_mut();
        if !root.contains_key(table.key) {
            let name = Spanned::new(at.clone(), DeString::Borrowed(table.key));
            root.insert(name, Spanned::new(at.clone(), DeValue::Table(DeTable::new())));
        }
        match root.get_mut(table.key).map(Spanned::get_mut) {
            Some(DeValue::Table(entries)) => Some(entries),
            _ => None,
        }
    }

    /// Reads the outputs of a scanner.
    fn read_outputs<O: Deserialize<'t>>(
        &mut self,
        output: Spanned<DeValue<'t>>,
        of_path: &impl Fn(PathBuf) -> O,
    ) -> Vec<O> {
        let span = output.span();
        let items: Vec<Spanned<DeValue>> = match output.into_inner() {
            DeValue::Array(items) => items.into_iter().collect(),
            one => vec![Spanned::new(span.clone(), one)],
        };
        if items.is_empty() {
            self.refuse_output(span);
        }
        items.into_iter().filter_map(|item| self.read_output(item, of_path)).collect()
    }

    fn read_output<O: Deserialize<'t>>(
        &mut self,
        item: Spanned<DeValue<'t>>,
        of_path: &impl Fn(PathBuf) -> O,
    ) -> Option<O> {
        if let Some(path) = item.get_ref().as_str() {
            return Some(of_path(PathBuf::from(path)));
        }
        let span = item.span();
        if !item.get_ref().is_table() {
            self.refuse_output(span);
            return None;
        }
        match O::deserialize(ValueDeserializer::from(item)) {
            Ok(output) => Some(output),
            Err(error) => {
                self.source.report_value(&error, Some(span), &mut self.problems);
                None
            }
        }
    }

    fn refuse_output(&mut self, span: Range<usize>) {
        let message = format!(
            "`{}` must be a path, a list of paths or [[scanner.output]] tables, found `{}`",
            K.output.key,
            self.source.slice(span.clone())
        );
        self.problems.error(Some(self.source.place(span)), message);
    }
}

/// The unknown keys of a `[[scanner]]` table that are nearest to a key that only these tables have. `known`
/// are the names of all their keys.
fn misspelt_keys(table: &DeTable<'_>, known: &[&str]) -> Vec<String> {
    let of_rig = [K.mount, K.settings, K.output].map(|key| key.key);
    let is_misspelt = |key: &&str| {
        !known.contains(key) && nearest(key, known.iter().copied()).is_some_and(|near| of_rig.contains(&near))
    };
    table.keys().map(|key| &**key.get_ref()).filter(is_misspelt).map(str::to_owned).collect()
}
