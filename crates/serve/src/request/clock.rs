//! Recognises results that depend on the time of computation: those with `gps_start = "now"`, in the document
//! of a request or in a pipeline file that it names. They are never given again.

use super::named::name_of;
use super::prepared::{Prepared, RequestError};
use crate::names;
use crate::queue::Use;
use crate::store::Store;
use std::collections::BTreeSet;

/// Largest pipeline file that is looked into, bytes; larger ones are taken to depend on the time.
const MAX_BYTES: u64 = 1 << 20;
/// Most files that are looked into.
const MAX_FILES: usize = 100;

/// True if the results depend on the time.
pub(super) fn depends_on_time(prepared: &Prepared, store: &Store) -> Result<bool, RequestError> {
    let Some((_, text)) = &prepared.document else { return Ok(false) };
    let Ok(table) = text.parse::<toml::Table>() else { return Ok(true) };
    let mut seen = BTreeSet::new();
    // Documents, with the folder by which they may name others.
    let mut waiting = vec![(String::new(), table)];
    while let Some((folder, table)) = waiting.pop() {
        let mut names = BTreeSet::new();
        if is_now(&toml::Value::Table(table), &mut names) {
            return Ok(true);
        }
        for (name, used) in names.iter().flat_map(|name| candidates(name, &folder, &prepared.uses)) {
            if !seen.insert(name.clone()) {
                continue;
            }
            if seen.len() > MAX_FILES {
                return Ok(true);
            }
            let (kind, id) = used.files();
            let path = name.get(name_of(used).len() + 1..).unwrap_or_default();
            if !store.listed(kind, id)?.iter().any(|file| file.path == path) {
                continue;
            }
            let Some(bytes) = store.read(kind, id, path, MAX_BYTES)? else { return Ok(true) };
            // What is no pipeline file is an error of the job.
            let table = String::from_utf8(bytes).ok().and_then(|text| text.parse().ok());
            let folder = name.rsplit_once('/').map_or("", |(folder, _)| folder).to_owned();
            waiting.extend(table.map(|table| (folder, table)));
        }
    }
    Ok(false)
}

/// The files that a name may mean, beside the file with the name or in any upload.
fn candidates<'u>(name: &str, folder: &str, uses: &'u BTreeSet<Use>) -> Vec<(String, &'u Use)> {
    let beside = (!folder.is_empty()).then(|| format!("{folder}/{name}"));
    let within = uses.iter().map(|used| format!("{}/{name}", name_of(used)));
    let all = std::iter::once(name.to_owned()).chain(beside).chain(within);
    let used = |path: &String| {
        uses.iter().find(|used| path.strip_prefix(&name_of(used)).is_some_and(|rest| rest.starts_with('/')))
    };
    all.filter_map(|path| used(&path).map(|used| (path, used))).collect()
}

/// True if a value has the time of the computation as its GPS start; collects the pipeline files that it
/// names.
fn is_now(value: &toml::Value, files: &mut BTreeSet<String>) -> bool {
    match value {
        toml::Value::Table(table) => table.iter().any(|(key, value)| {
            let is_start = key == "gps_start" && value.as_str().is_some_and(is_now_text);
            is_start || is_now(value, files)
        }),
        toml::Value::Array(list) => list.iter().any(|value| is_now(value, files)),
        toml::Value::String(text) => {
            let is_file = |word: &&str| word.split('#').next().is_some_and(|path| path.ends_with(".toml"));
            files.extend(names::words(text).filter(is_file).map(str::to_owned));
            has_option(text)
        }
        _ => false,
    }
}

/// As vlscan reads it (`GpsStart`).
fn is_now_text(text: &str) -> bool {
    matches!(text.trim(), "" | "now")
}

/// True if options of a campaign have `--gps-start now`.
fn has_option(text: &str) -> bool {
    let Some(words) = shlex::split(text) else { return text.contains("--gps-start") };
    let follows = words.windows(2).any(|pair| pair[0] == "--gps-start" && is_now_text(&pair[1]));
    let is_joined = |word: &String| word.strip_prefix("--gps-start=").is_some_and(is_now_text);
    follows || words.iter().any(is_joined)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_of_the_computation_is_found_in_what_is_parsed() {
        let found = |text: &str| is_now(&toml::Value::Table(text.parse().unwrap()), &mut BTreeSet::new());
        for text in [
            "gps_start = \"now\"",
            "gps_start = ' now '",
            "gps_start = ''",
            "'gps_start' = \"n\\u006fw\"",
            "[a]\n[[a.b]]\ngps_start = 'now'",
            "[[variant]]\nrun = \"--gps-start now\"",
            "[[variant]]\nrun = \"--gps-start='now' --seed 1\"",
            "run = \"--gps-start \\\"now\\\"\"",
        ] {
            assert!(found(text), "{text}");
        }
        for text in [
            "name = 'snow'\ngps_start = '2024-01-01 00:00:00'",
            "name = 'gps now'",
            "run = '--gps-start 2024-01-01'",
            "# gps_start = 'now'",
        ] {
            assert!(!found(text), "{text}");
        }
    }

    #[test]
    fn names_of_pipeline_files_are_found() {
        let mut files = BTreeSet::new();
        let text =
            "[[variant]]\nsurvey = 'forest/plan.toml'\nrun = '--pipeline b/c.toml#x'\nname = 'a.toml.laz'";
        is_now(&toml::Value::Table(text.parse().unwrap()), &mut files);
        assert!(files.contains("forest/plan.toml") && !files.contains("a.toml.laz"), "{files:?}");
        let uses = BTreeSet::from([Use::Upload { name: "forest".into(), id: "u".into() }]);
        let found: Vec<_> =
            candidates("plan.toml", "forest/a", &uses).into_iter().map(|(path, _)| path).collect();
        assert_eq!(found, ["forest/a/plan.toml", "forest/plan.toml"]);
    }
}
