//! The words of a command and the file that it reads.

use super::named::named_pipeline;
use super::prepared::{Prepared, RequestError, wrong};
use super::values::texts;
use crate::job_folder::DATASET;
use crate::names;
use crate::processes::Process;
use crate::program::{CATALOGUE, Program};
use crate::queue::Use;
use crate::store::Store;
use serde_json::{Map, Value};
use std::collections::BTreeSet;

/// Longest value of an option, bytes: Linux takes words of at most 128 KiB.
const MAX_WORD: usize = 100_000;

/// The pipeline of a run: the keys of the file that is named, replaced by those of the request.
pub(super) fn pipeline(
    process: Process,
    inputs: Value,
    owner: &str,
    store: &Store,
    program: &Program,
    uses: &mut BTreeSet<Use>,
) -> Result<Prepared, RequestError> {
    let Value::Object(mut inputs) = inputs else { return Err(wrong("inputs", "expected an object")) };
    let mut table = match inputs.remove("pipeline").as_ref().and_then(Value::as_str) {
        Some(name) => named_pipeline(name, owner, store, program, uses)?,
        None => toml::Table::new(),
    };
    for (key, value) in inputs {
        let value = toml_value(&key, value)?;
        table.insert(key, value);
    }
    for key in ["force", "assets", "schedule"] {
        table.remove(key);
    }
    let named = serde_json::to_value(&table).map_err(|e| wrong("inputs", e.to_string()))?;
    let assets: Vec<toml::Value> = asset_folders(&named, uses).into_iter().map(toml::Value::from).collect();
    if !assets.is_empty() {
        table.insert("assets".to_owned(), toml::Value::Array(assets));
    }
    check_outputs(&table)?;
    table.iter_mut().for_each(|(key, value)| prefer_catalogue(key, value, program));
    // Several scanners have an output each.
    let has_several = table.get("scanner").is_some_and(toml::Value::is_array);
    if process == Process::Run && !table.contains_key("output") && !has_several {
        let output = toml::Table::from_iter([("path".to_owned(), toml::Value::from("points.laz"))]);
        table.insert("output".to_owned(), toml::Value::Array(vec![toml::Value::Table(output)]));
    }
    let text = toml::to_string(&table).map_err(|e| wrong("inputs", e.to_string()))?;
    let (words, stdout): (&[&str], _) = match process {
        Process::DryRun => {
            (&["run", "../in/job.toml", "--dry-run", "--json"], Some("report.json".to_owned()))
        }
        _ => (&["run", "../in/job.toml"], None),
    };
    Ok(Prepared {
        document: Some(("job.toml".to_owned(), text)),
        words: words.iter().map(|word| (*word).to_owned()).collect(),
        stdout,
        ..Prepared::default()
    })
}

pub(super) fn campaign(inputs: Value) -> Result<Prepared, RequestError> {
    let Value::Object(inputs) = inputs else { return Err(wrong("inputs", "expected an object")) };
    let mut table = toml::Table::new();
    table.insert("out".to_owned(), format!("../out/{DATASET}").into());
    for (key, value) in inputs {
        let value = toml_value(&key, value)?;
        table.insert(key, value);
    }
    let text = toml::to_string(&table).map_err(|e| wrong("inputs", e.to_string()))?;
    Ok(Prepared {
        document: Some(("campaign.toml".to_owned(), text)),
        words: ["campaign", "../in/campaign.toml"].map(str::to_owned).to_vec(),
        ..Prepared::default()
    })
}

/// Has instruments of the catalogue read from there: uploads whose folders are searched may have files of the
/// same names.
fn prefer_catalogue(key: &str, value: &mut toml::Value, program: &Program) {
    match value {
        toml::Value::String(text) if matches!(key, "catalogue" | "platform") => {
            *text = program.in_catalogue(text).unwrap_or_else(|| text.clone());
        }
        toml::Value::Array(list) => {
            list.iter_mut().for_each(|value| prefer_catalogue(key, value, program));
        }
        toml::Value::Table(table) => {
            table.iter_mut().for_each(|(key, value)| prefer_catalogue(key, value, program));
        }
        _ => {}
    }
}

/// Refuses outputs whose names results could not have: they would be computed, and nobody could fetch them.
fn check_outputs(table: &toml::Table) -> Result<(), RequestError> {
    let scanners = table.get("scanner").and_then(toml::Value::as_array).into_iter().flatten();
    let outputs = table.get("output").into_iter().chain(scanners.filter_map(|scanner| scanner.get("output")));
    for path in outputs.flat_map(paths_of) {
        if names::relative_path(path).is_none() {
            return Err(wrong(
                "output.path",
                format!(
                    "`{}` cannot be the name of a result: expected names without : * ? \" < > | that begin with none of . - ~ and a blank, joined \
                     by /",
                    path.escape_debug()
                ),
            ));
        }
    }
    Ok(())
}

/// The paths of outputs: a path, a table with one, or a list of both.
fn paths_of(outputs: &toml::Value) -> Vec<&str> {
    match outputs {
        toml::Value::Array(list) => list.iter().flat_map(paths_of).collect(),
        one => one.as_str().or_else(|| one.get("path")?.as_str()).into_iter().collect(),
    }
}

fn toml_value(key: &str, value: Value) -> Result<toml::Value, RequestError> {
    toml::Value::try_from(value)
        .map_err(|_| wrong(key, "has a null, which pipeline files do not have; leave the key out"))
}

/// The folders in which files are looked for besides that of the file which names them: for each file of an
/// upload that the inputs name its parents within the upload, nearest first, then all uploads.
pub(super) fn asset_folders(inputs: &Value, uses: &BTreeSet<Use>) -> Vec<String> {
    let uploads: Vec<String> = uses
        .iter()
        .filter_map(|used| if let Use::Upload { name, .. } = used { Some(name.clone()) } else { None })
        .collect();
    let mut folders: Vec<String> = Vec::new();
    for text in texts(inputs) {
        let path = text.split('#').next().unwrap_or_default().replace('\\', "/");
        let is_of_upload =
            uploads.iter().any(|name| path.strip_prefix(name).is_some_and(|rest| rest.starts_with('/')));
        if !is_of_upload || path.bytes().filter(|byte| *byte == b'/').count() > names::MAX_DEPTH {
            continue;
        }
        let parents = path.match_indices('/').rev().map(|(at, _)| path[..at].to_owned());
        folders.extend(parents.filter(|folder| !folder.is_empty()));
    }
    folders.extend(uploads);
    let mut seen = BTreeSet::new();
    folders.retain(|folder| seen.insert(folder.clone()));
    folders
}

/// The folders of [`asset_folders`] as options of a command.
pub(super) fn assets(inputs: &Map<String, Value>, uses: &BTreeSet<Use>) -> Vec<String> {
    let folders = asset_folders(&Value::Object(inputs.clone()), uses);
    let all = std::iter::once(".".to_owned()).chain(folders);
    all.map(|folder| format!("--assets={folder}")).collect()
}

pub(super) fn plan(
    inputs: &Map<String, Value>,
    assets: &[String],
    program: &Program,
) -> Result<Prepared, RequestError> {
    let mut inputs = inputs.clone();
    let kind = inputs.remove("kind").and_then(|kind| kind.as_str().map(str::to_owned)).unwrap_or_default();
    let schema = &program.commands[format!("plan {kind}")];
    for key in inputs.keys() {
        if schema["properties"].get(key).is_none() {
            return Err(wrong(key, format!("plans of the kind {kind} have no such input")));
        }
    }
    for key in ["scanner", "platform"] {
        let Some(Value::String(text)) = inputs.get_mut(key) else { continue };
        *text = program.in_catalogue(text).unwrap_or_else(|| text.clone());
    }
    let words = [vec!["plan".to_owned(), kind], assets.to_vec(), options(&inputs, schema)?].concat();
    Ok(Prepared { words, within_inputs: true, stdout: Some("plan.toml".to_owned()), ..Prepared::default() })
}

/// Inputs as words of a command line: `--name=value`, so that no value is taken for an option, and operands
/// behind `--`.
pub(super) fn options(inputs: &Map<String, Value>, schema: &Value) -> Result<Vec<String>, RequestError> {
    let mut words = Vec::new();
    let mut operands = Vec::new();
    for (key, value) in inputs {
        // The system takes no longer words.
        if value.to_string().len() > MAX_WORD {
            return Err(wrong(
                key,
                format!("a value of more than {MAX_WORD} bytes; upload it as a file and name that"),
            ));
        }
        let about = &schema["properties"][key];
        if let Some(place) = about["x-operand"].as_u64() {
            operands.push((place, text_of(key, value)?));
            continue;
        }
        let option = about["x-option"].as_str().unwrap_or_default();
        match value {
            Value::Bool(true) => words.push(option.to_owned()),
            Value::Bool(false) => {}
            Value::Array(list)
                if about["anyOf"].as_array().is_some_and(|any| {
                    any.iter().any(|one| one["items"]["anyOf"].is_null() && one["type"] == "array")
                }) =>
            {
                for item in list {
                    words.push(format!("{option}={}", text_of(key, item)?));
                }
            }
            value => words.push(format!("{option}={}", text_of(key, value)?)),
        }
    }
    operands.sort();
    if !operands.is_empty() {
        words.push("--".to_owned());
    }
    words.extend(operands.into_iter().map(|(_, text)| text));
    Ok(words)
}

fn text_of(key: &str, value: &Value) -> Result<String, RequestError> {
    match value {
        Value::String(text) => Ok(text.clone()),
        Value::Number(number) => Ok(match number.as_f64() {
            // 20.0 is 20 on a command line.
            Some(decimal) if number.is_f64() => decimal.to_string(),
            _ => number.to_string(),
        }),
        Value::Array(list) => {
            let texts: Result<Vec<String>, RequestError> =
                list.iter().map(|item| text_of(key, item)).collect();
            Ok(texts?.join(","))
        }
        _ => Err(wrong(key, "expected a number, a text or a list of them")),
    }
}

/// The command as a user would type it in a folder that has the uploads as folders.
pub(super) fn shown(process: Process, prepared: &Prepared) -> String {
    let is_ours =
        |word: &&String| *word == "--" || word.starts_with("--assets=") || word.starts_with("--max-points");
    let words = prepared.words.iter().filter(|word| !is_ours(word));
    let words = words.map(|word| {
        let word = word.replace("../in/", "").replace("../out/", "").replace(&format!("={CATALOGUE}"), "=");
        let is_plain = word.chars().all(|c| c.is_alphanumeric() || "-_./=,:#+%".contains(c));
        if is_plain && !word.is_empty() { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
    });
    let line = std::iter::once("vlscan".to_owned()).chain(words).collect::<Vec<_>>().join(" ");
    match (&prepared.stdout, process) {
        (Some(_), Process::DryRun) | (None, _) => line,
        (Some(file), _) => format!("{line} > {file}"),
    }
}
