//! Uploads and results that the inputs of a request name.

use super::prepared::{Prepared, RequestError, wrong};
use super::values::texts;
use crate::names::{self, JOBS};
use crate::program::Program;
use crate::queue::Use;
use crate::store::{Status, Store, StoreError};
use serde_json::Value;
use std::collections::BTreeSet;

/// Largest pipeline file that requests name, bytes.
const MAX_PIPELINE_BYTES: u64 = 1 << 20;
/// Deepest nesting of inputs.
const MAX_DEPTH: usize = 12;
/// Most words of the inputs that may be names of files: each is looked for.
const MAX_NAMES: usize = 10_000;

/// Refuses inputs with very many words that may be names of files.
pub(super) fn check_names(key: &str, inputs: &Value) -> Result<(), RequestError> {
    let words = texts(inputs).into_iter().flat_map(names::words);
    let number = words.filter(|word| word.contains(['/', '\\'])).take(MAX_NAMES + 1).count();
    match number > MAX_NAMES {
        true => Err(wrong(key, format!("more than {MAX_NAMES} words that may be names of files"))),
        false => Ok(()),
    }
}

/// Looks through all texts of the inputs for names of files: refuses those that lead out of the job's folder,
/// whatever key has them, and collects uploads and results of the owner that are named.
pub(super) fn find_files(
    key: &str,
    value: &Value,
    depth: usize,
    owner: &str,
    store: &Store,
    program: &Program,
    uses: &mut BTreeSet<Use>,
) -> Result<(), RequestError> {
    if depth > MAX_DEPTH {
        return Err(wrong(key, "the inputs are nested too deeply"));
    }
    match value {
        Value::String(text) => {
            if let Some(word) = names::leads_out(text) {
                return Err(wrong(
                    key,
                    format!(
                        "`{word}` leads out of the job's folder; files are named UPLOAD/FILE or jobs/JOB/FILE"
                    ),
                ));
            }
            if matches!(text.as_str(), "-" | "STDIN" | "STDOUT") {
                return Err(wrong(
                    key,
                    format!("`{text}`: the service has no standard input or output; name a file"),
                ));
            }
            if text.contains('\0') {
                return Err(wrong(key, "a text with a zero byte"));
            }
            names::words(text).try_for_each(|word| find_use(key, word, owner, store, program, uses))
        }
        Value::Array(list) => {
            list.iter().try_for_each(|item| find_files(key, item, depth + 1, owner, store, program, uses))
        }
        Value::Object(map) => map.iter().try_for_each(|(inner, value)| {
            let path = if key.is_empty() { inner.clone() } else { format!("{key}.{inner}") };
            find_files(&path, value, depth + 1, owner, store, program, uses)
        }),
        _ => Ok(()),
    }
}

fn find_use(
    key: &str,
    word: &str,
    owner: &str,
    store: &Store,
    program: &Program,
    uses: &mut BTreeSet<Use>,
) -> Result<(), RequestError> {
    // Only paths name files of uploads, and references of the catalogue are its own.
    let Some((first, rest)) = word.split_once(['/', '\\']).filter(|_| !program.is_reference(word)) else {
        return Ok(());
    };
    let mut parts = rest.split(['/', '\\', '#']);
    if first.is_empty() || first.len() > 120 {
        return Ok(());
    }
    if first == JOBS {
        let Some(id) = parts.next() else { return Ok(()) };
        let Some(job) = store.job_state(owner, id)? else {
            return Err(wrong(key, format!("there is no job `{id}`")));
        };
        if job.status != Status::Successful {
            return Err(wrong(key, format!("the job `{id}` has no results: it is {}", job.status.name())));
        }
        uses.insert(Use::Job { id: job.id, folder: job.folder });
    } else if let Some(upload) = store.upload(owner, first)? {
        uses.insert(Use::Upload { name: upload.name, id: upload.id });
    }
    Ok(())
}

/// Results may name the uploads that their jobs have used: they are readable, too.
pub(super) fn with_uses_of_jobs(store: &Store, uses: &mut BTreeSet<Use>) -> Result<(), RequestError> {
    let jobs: Vec<String> = uses
        .iter()
        .filter_map(|used| if let Use::Job { folder, .. } = used { Some(folder.clone()) } else { None })
        .collect();
    for folder in jobs {
        let prepared: Prepared = match std::fs::read(store.job_folder(&folder).join("prepared.json")) {
            // The folder was cleaned: files that its files name are not found.
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Prepared::default(),
            read => serde_json::from_slice(&read.map_err(StoreError::from)?).map_err(|error| {
                let record = format!("prepared.json in the folder of the job {folder}");
                StoreError::Record { record, error }
            })?,
        };
        for used in prepared.uses {
            // Files of an upload that was removed since are gone.
            let (kind, id) = used.files();
            let is_there = store.has(kind, id)?;
            let is_named = uses.iter().any(|other| name_of(other) == name_of(&used));
            if is_there && !is_named {
                uses.insert(used);
            }
        }
    }
    Ok(())
}

/// The name under which a job sees what it reads.
pub fn name_of(used: &Use) -> String {
    match used {
        Use::Upload { name, .. } => name.clone(),
        Use::Job { id, .. } => format!("{JOBS}/{id}"),
    }
}

/// The keys of a pipeline file among uploads and results.
pub(super) fn named_pipeline(
    name: &str,
    owner: &str,
    store: &Store,
    program: &Program,
    uses: &mut BTreeSet<Use>,
) -> Result<toml::Table, RequestError> {
    let absent = || {
        wrong("pipeline", format!("there is no file `{name}`; files are named UPLOAD/FILE or jobs/JOB/FILE"))
    };
    let named = uses.iter().find_map(|used| {
        let path = name.strip_prefix(&name_of(used))?.strip_prefix('/')?;
        let (kind, id) = used.files();
        Some((kind, id, path))
    });
    let (kind, id, path) = named.ok_or_else(absent)?;
    let files = store.listed(kind, id)?;
    let file = files.into_iter().find(|file| file.path == path).ok_or_else(absent)?;
    if file.bytes > MAX_PIPELINE_BYTES {
        return Err(wrong("pipeline", format!("`{name}` has more than {MAX_PIPELINE_BYTES} bytes")));
    }
    let bytes = store.read(kind, id, path, MAX_PIPELINE_BYTES)?.ok_or_else(absent)?;
    let text = String::from_utf8(bytes).map_err(|_| wrong("pipeline", format!("`{name}` is no text")))?;
    let table: toml::Table =
        text.parse().map_err(|e: toml::de::Error| wrong("pipeline", format!("{name}: {e}")))?;
    let keys = serde_json::to_value(&table).map_err(|e| wrong("pipeline", e.to_string()))?;
    check_names("pipeline", &keys)?;
    find_files("pipeline", &keys, 0, owner, store, program, uses)?;
    with_uses_of_jobs(store, uses)?;
    Ok(table)
}
