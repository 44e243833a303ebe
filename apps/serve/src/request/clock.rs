//! Recognises results that depend on the time of computation: those with `gps_start = "now"`, in the document
//! of a request or in a pipeline file that it names. They are never given again.

use super::named::name_of;
use super::prepared::{Prepared, RequestError};
use crate::names;
use crate::queue::Use;
use crate::store::Store;
use std::collections::{BTreeMap, BTreeSet};

/// Largest pipeline file that is looked into, bytes; larger ones are taken to depend on the time.
const MAX_BYTES: u64 = 1 << 20;
/// Most files that are looked into.
const MAX_FILES: usize = 100;

/// Names that one mention of a pipeline file may have.
type Mention = BTreeSet<String>;

/// True if the results depend on the time, or name a pipeline file that is not found.
pub(super) fn depends_on_time(prepared: &Prepared, store: &Store) -> Result<bool, RequestError> {
    let Some((_, text)) = &prepared.document else { return Ok(false) };
    let Ok(table) = text.parse::<toml::Table>() else { return Ok(true) };
    let mut listed = BTreeMap::new();
    for used in &prepared.uses {
        let (kind, id) = used.files();
        for file in store.listed(kind, id)? {
            listed.insert(format!("{}/{}", name_of(used), file.path), (kind, id, file.path));
        }
    }
    let mut seen = BTreeSet::new();
    // Documents, with the folder by which they may name others.
    let mut waiting = vec![(String::new(), table)];
    while let Some((folder, table)) = waiting.pop() {
        let mut mentions = Vec::new();
        if is_now(&toml::Value::Table(table), &mut mentions) {
            return Ok(true);
        }
        for mention in mentions {
            let names = mention.iter().flat_map(|name| candidates(name, &folder, &prepared.uses));
            let found: BTreeSet<String> = names.filter(|name| listed.contains_key(name)).collect();
            if found.is_empty() {
                return Ok(true);
            }
            for name in found {
                let Some((kind, id, path)) = listed.get(&name).filter(|_| !seen.contains(&name)) else {
                    continue;
                };
                if seen.len() >= MAX_FILES {
                    return Ok(true);
                }
                let Some(bytes) = store.read(*kind, id, path, MAX_BYTES)? else { return Ok(true) };
                // What is no pipeline file is an error of the job.
                let table = String::from_utf8(bytes).ok().and_then(|text| text.parse().ok());
                let folder = name.rsplit_once('/').map_or("", |(folder, _)| folder).to_owned();
                waiting.extend(table.map(|table| (folder, table)));
                seen.insert(name);
            }
        }
    }
    Ok(false)
}

/// The files that a name may mean, beside the file with the name or in any upload.
fn candidates(name: &str, folder: &str, uses: &BTreeSet<Use>) -> Vec<String> {
    let within = uses.iter().map(|used| format!("{}/{name}", name_of(used)));
    let all = [name.to_owned(), format!("{folder}/{name}")].into_iter().chain(within);
    all.map(|path| normal(&path)).collect()
}

/// A path without `.`, `..` and repeated separators, as far as it stays below its start.
fn normal(path: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split(['/', '\\']) {
        match part {
            "" | "." => {}
            ".." if parts.last().is_some_and(|last| *last != "..") => drop(parts.pop()),
            part => parts.push(part),
        }
    }
    parts.join("/")
}

/// True if a value has the time of the computation as its GPS start; collects the pipeline files that it
/// names.
fn is_now(value: &toml::Value, files: &mut Vec<Mention>) -> bool {
    match value {
        toml::Value::Table(table) => table.iter().any(|(key, value)| {
            let is_start = key == "gps_start" && value.as_str().is_some_and(is_now_text);
            is_start || is_now(value, files)
        }),
        toml::Value::Array(list) => list.iter().any(|value| is_now(value, files)),
        toml::Value::String(text) => {
            files.extend(mentions(text));
            has_option(text)
        }
        _ => false,
    }
}

/// The pipeline files that a text names: the text itself, or words of options.
fn mentions(text: &str) -> Vec<Mention> {
    let path = |word: &str| {
        let path = word.split('#').next().unwrap_or_default();
        path.to_ascii_lowercase().ends_with(".toml").then(|| path.to_owned())
    };
    let words = shlex::split(text).unwrap_or_else(|| names::words(text).map(str::to_owned).collect());
    let parts = words.iter().flat_map(|word| {
        let parts = word.split(['=', ',', ';']).filter_map(path);
        parts.map(move |part| [Some(part), path(word), path(text)].into_iter().flatten().collect::<Mention>())
    });
    let parts: Vec<Mention> = parts.collect();
    // A name with quotes, which are none of options.
    let whole = path(text).filter(|_| parts.is_empty()).map(|path| Mention::from([path]));
    parts.into_iter().chain(whole).collect()
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
        let found = |text: &str| is_now(&toml::Value::Table(text.parse().unwrap()), &mut Vec::new());
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
        for (text, expected) in [
            ("forest/plan.toml", &["forest/plan.toml"][..]),
            ("forest/plan.toml#x", &["forest/plan.toml"]),
            ("forest/PLAN.TOML", &["forest/PLAN.TOML"]),
            ("--pipeline b/c.toml#x --seed 1", &["b/c.toml"]),
            ("--pipeline='b/my plan.toml'", &["b/my plan.toml"]),
            ("--pipeline=a\\ b.toml", &["a b.toml"]),
            ("my plan.toml", &["my plan.toml"]),
            ("it's a plan.toml", &["it's a plan.toml"]),
            ("-p a.toml -p b.toml", &["a.toml", "b.toml"]),
            ("a.toml.laz", &[]),
        ] {
            let found = mentions(text);
            let is_named = |name: &&str| found.iter().any(|names| names.contains(*name));
            assert!(expected.iter().all(is_named), "{text}: {found:?}");
            assert_eq!(found.is_empty(), expected.is_empty(), "{text}: {found:?}");
        }
        let uses = BTreeSet::from([Use::Upload { name: "forest".into(), id: "u".into() }]);
        assert_eq!(
            candidates("plan.toml", "forest/a", &uses),
            ["plan.toml", "forest/a/plan.toml", "forest/plan.toml"]
        );
        for name in ["./plan.toml", ".//plan.toml", "../a/plan.toml", "b\\..\\plan.toml"] {
            assert!(candidates(name, "forest/a", &uses).contains(&"forest/a/plan.toml".to_owned()), "{name}");
        }
    }

    #[test]
    fn results_of_pipeline_files_that_name_the_time_are_computed_again() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), crate::files::Files::Folder).unwrap();
        let files = [
            ("a/now.toml", "gps_start = 'now'"),
            ("a/by.toml", "survey = './now.toml'"),
            ("a/fine.toml", "seed = 1"),
        ];
        std::fs::create_dir_all(store.upload_folder("u").join("a")).unwrap();
        files
            .iter()
            .for_each(|(name, text)| std::fs::write(store.upload_folder("u").join(name), text).unwrap());
        let upload = crate::store::Upload {
            id: "u".into(),
            name: "f".into(),
            files: 3,
            folders: 2,
            bytes: 9,
            sha256: "x".into(),
            created: 1,
        };
        let listed = files.map(|(name, text)| crate::store::UploadFile {
            path: name.to_owned(),
            bytes: text.len() as u64,
            kind: crate::store::FileKind::Other,
        });
        assert!(store.add_upload("anna", &upload, &listed).unwrap());
        let depends = |survey: &str| {
            let text = toml::to_string(&serde_json::json!({ "variant": [{ "survey": survey }] })).unwrap();
            let uses = BTreeSet::from([Use::Upload { name: "f".into(), id: "u".into() }]);
            let prepared =
                Prepared { document: Some(("campaign.toml".into(), text)), uses, ..Prepared::default() };
            depends_on_time(&prepared, &store).unwrap()
        };
        for name in [
            "f/a/now.toml",
            "./f/a/now.toml",
            "f//a/now.toml",
            "f/a/./now.toml",
            "f/a/by.toml",
            "f/a/none.toml",
        ] {
            assert!(depends(name), "{name}");
        }
        assert!(!depends("f/a/fine.toml") && !depends("f/./a/fine.toml") && !depends("f/a/scene.xml"));
    }
}
