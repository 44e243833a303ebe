//! From the inputs of a request to the command that is executed: keys are checked, names of files resolved to uploads and results of the
//! same owner, and everything that determines the result is hashed.

use crate::names::{self, JOBS};
use crate::processes::Process;
use crate::program::Program;
use crate::queue::Use;
use crate::store::{Status, Store, StoreError};
use crate::tokens::hex;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeSet;

/// Largest pipeline file that requests name, bytes.
const MAX_PIPELINE_BYTES: u64 = 1 << 20;
/// Points in pages that show a cloud.
pub const PAGE_POINTS: &str = "500k";
/// Deepest nesting of inputs.
const MAX_DEPTH: usize = 12;

/// Why a request is refused.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// An input, and what is wrong with it.
    #[error("{key}: {message}")]
    Input {
        /// The input.
        key: String,
        /// What is wrong and what to give instead.
        message: String,
    },
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
}

fn wrong(key: &str, message: impl Into<String>) -> RequestError {
    RequestError::Input { key: key.to_owned(), message: message.into() }
}

/// What is executed for a job.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Prepared {
    /// Name and text of the file in the folder of inputs.
    pub document: Option<(String, String)>,
    /// The words behind `vlscan`.
    pub words: Vec<String>,
    /// Whether it works in the folder of inputs, else in that of results.
    pub within_inputs: bool,
    /// The file of results that standard output becomes.
    pub stdout: Option<String>,
    /// The same command as a user would type it in the folder of the uploads.
    pub shown: String,
    /// What it reads.
    pub uses: BTreeSet<Use>,
}

/// A request that can be executed, and the hash of all that determines its result; empty if that depends on the time.
#[derive(Clone, Debug)]
pub struct Checked {
    /// What is executed.
    pub prepared: Prepared,
    /// The hash.
    pub fingerprint: String,
}

/// Checks the inputs of a process.
///
/// # Errors
/// [`RequestError`].
pub fn check(
    process: Process,
    inputs: &Map<String, Value>,
    owner: &str,
    store: &Store,
    program: &Program,
) -> Result<Checked, RequestError> {
    let schema = process.inputs(program);
    let mut inputs = inputs.clone();
    let mut area = None;
    for (key, value) in &mut inputs {
        *value = unqualified(key, value.take())?;
        if let ("area" | "along", Process::Plan, Some(text)) = (key.as_str(), process, geojson(value)) {
            let name = format!("{key}.geojson");
            *value = json!(name);
            area = Some((name, text));
        }
        let Some(schema) = schema["properties"].get(key) else {
            let known = schema["properties"].as_object().into_iter().flatten().map(|(name, _)| name.as_str());
            return Err(wrong(
                key,
                format!("the process {} has no such input; {}", process.id(), nearest(key, known)),
            ));
        };
        check_type(key, value, schema)?;
    }
    for key in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        if !inputs.contains_key(key) {
            return Err(wrong(key, format!("the process {} needs this input", process.id())));
        }
    }
    let mut uses = BTreeSet::new();
    let mut tree = Value::Object(inputs.clone());
    find_files("", &tree, 0, owner, store, &mut uses)?;
    let mut prepared = match process {
        Process::Run | Process::DryRun => pipeline(process, tree.take(), owner, store, &mut uses)?,
        Process::Campaign => campaign(tree.take())?,
        Process::Plan => Prepared { document: area, ..plan(&inputs, &assets(&uses), program)? },
        Process::Compare => {
            let words = options(&inputs, &schema)?;
            let words = [
                vec!["compare".to_owned(), "--json".to_owned(), "--page=../out/report.html".to_owned()],
                words,
            ]
            .concat();
            Prepared {
                words,
                within_inputs: true,
                stdout: Some("report.json".to_owned()),
                ..Prepared::default()
            }
        }
        Process::Stand => {
            let start = ["scene", "stand", "--copy", "--out=../out/stand"].map(str::to_owned).to_vec();
            let words = [start, options(&inputs, &schema)?].concat();
            Prepared { words, within_inputs: true, ..Prepared::default() }
        }
        Process::Preview => {
            let format = inputs.get("format").and_then(Value::as_str).unwrap_or("png").to_owned();
            inputs.remove("format");
            let out = format!("--out=../out/preview.{format}");
            let start = vec!["preview".to_owned(), out, format!("--most-points={PAGE_POINTS}")];
            let words = [start, assets(&uses), options(&inputs, &schema)?].concat();
            Prepared { words, within_inputs: true, ..Prepared::default() }
        }
    };
    with_uses_of_jobs(store, &mut uses)?;
    prepared.shown = shown(process, &prepared);
    prepared.uses = uses;
    let fingerprint = fingerprint(process, &prepared, owner, store, program)?;
    Ok(Checked { prepared, fingerprint })
}

/// A value given as `{"value": …}`, as OGC API - Processes has objects, or as it stands.
fn unqualified(key: &str, value: Value) -> Result<Value, RequestError> {
    match value {
        Value::Object(map) if map.contains_key("href") => Err(wrong(
            key,
            "inputs by reference are not fetched; upload the file and give its name, UPLOAD/FILE",
        )),
        Value::Object(mut map)
            if map
                .keys()
                .all(|key| matches!(key.as_str(), "value" | "mediaType" | "encoding" | "schema")) =>
        {
            map.remove("value").ok_or_else(|| wrong(key, "expected a value"))
        }
        value => Ok(value),
    }
}

/// The text of an area given as GeoJSON, as an object or as text. It becomes a file, because vlscan reads GeoJSON from files.
fn geojson(value: &Value) -> Option<String> {
    match value {
        Value::Object(_) => Some(value.to_string()),
        Value::String(text) if text.trim_start().starts_with('{') => Some(text.clone()),
        _ => None,
    }
}

/// Checks the type of a value as far as the schema tells it.
fn check_type(key: &str, value: &Value, schema: &Value) -> Result<(), RequestError> {
    let is = |kind: &str| match kind {
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_u64() || value.is_i64(),
        "number" => value.is_number(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        _ => true,
    };
    let alternatives: Vec<&Value> = match schema["anyOf"].as_array() {
        Some(list) => list.iter().collect(),
        None => vec![schema],
    };
    let kinds: Vec<&str> = alternatives.iter().filter_map(|one| one["type"].as_str()).collect();
    if kinds.len() == alternatives.len() && !kinds.iter().any(|kind| is(kind)) {
        return Err(wrong(key, format!("expected {}", kinds.join(" or "))));
    }
    if let (Some(names), Some(text)) = (schema["enum"].as_array(), value.as_str())
        && !names.iter().any(|name| name == text)
    {
        let names: Vec<&str> = names.iter().filter_map(Value::as_str).collect();
        return Err(wrong(key, format!("`{text}`: expected one of {}", names.join(", "))));
    }
    Ok(())
}

/// Looks through all texts of the inputs for names of files: refuses those that lead out of the job's folder, whatever key has them, and
/// collects uploads and results of the owner that are named.
fn find_files(
    key: &str,
    value: &Value,
    depth: usize,
    owner: &str,
    store: &Store,
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
            names::words(text).try_for_each(|word| find_use(key, word, owner, store, uses))
        }
        Value::Array(list) => {
            list.iter().try_for_each(|item| find_files(key, item, depth + 1, owner, store, uses))
        }
        Value::Object(map) => map.iter().try_for_each(|(inner, value)| {
            let path = if key.is_empty() { inner.clone() } else { format!("{key}.{inner}") };
            find_files(&path, value, depth + 1, owner, store, uses)
        }),
        _ => Ok(()),
    }
}

fn find_use(
    key: &str,
    word: &str,
    owner: &str,
    store: &Store,
    uses: &mut BTreeSet<Use>,
) -> Result<(), RequestError> {
    let mut parts = word.split(['/', '\\', '#']);
    let Some(first) = parts.next().filter(|first| !first.is_empty() && first.len() <= 120) else {
        return Ok(());
    };
    if first == JOBS {
        let Some(id) = parts.next() else { return Ok(()) };
        let Some(job) = store.job(owner, id)? else {
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
fn with_uses_of_jobs(store: &Store, uses: &mut BTreeSet<Use>) -> Result<(), RequestError> {
    let jobs: Vec<String> = uses
        .iter()
        .filter_map(|used| if let Use::Job { folder, .. } = used { Some(folder.clone()) } else { None })
        .collect();
    for folder in jobs {
        let prepared =
            std::fs::read(store.job_folder(&folder).join("prepared.json")).map_err(StoreError::from)?;
        let prepared: Prepared = serde_json::from_slice(&prepared).unwrap_or_default();
        for used in prepared.uses {
            // Files of an upload that was removed since are gone.
            let is_there = match &used {
                Use::Upload { id, .. } => store.upload_folder(id).is_dir(),
                Use::Job { folder, .. } => store.job_folder(folder).is_dir(),
            };
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

/// The pipeline of a run: the keys of the file that is named, replaced by those of the request.
fn pipeline(
    process: Process,
    inputs: Value,
    owner: &str,
    store: &Store,
    uses: &mut BTreeSet<Use>,
) -> Result<Prepared, RequestError> {
    let Value::Object(mut inputs) = inputs else { return Err(wrong("inputs", "expected an object")) };
    let mut table = match inputs.remove("pipeline").as_ref().and_then(Value::as_str) {
        Some(name) => named_pipeline(name, owner, store, uses)?,
        None => toml::Table::new(),
    };
    for (key, value) in inputs {
        let value = toml_value(&key, value)?;
        table.insert(key, value);
    }
    for key in ["force", "assets", "schedule"] {
        table.remove(key);
    }
    let uploads = uses.iter().filter_map(|used| {
        if let Use::Upload { name, .. } = used { Some(toml::Value::from(name.as_str())) } else { None }
    });
    let assets: Vec<toml::Value> = uploads.collect();
    if !assets.is_empty() {
        table.insert("assets".to_owned(), toml::Value::Array(assets));
    }
    if process == Process::Run && !table.contains_key("output") {
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

/// The keys of a pipeline file among uploads and results.
fn named_pipeline(
    name: &str,
    owner: &str,
    store: &Store,
    uses: &mut BTreeSet<Use>,
) -> Result<toml::Table, RequestError> {
    let absent = || {
        wrong("pipeline", format!("there is no file `{name}`; files are named UPLOAD/FILE or jobs/JOB/FILE"))
    };
    let named = uses.iter().find_map(|used| {
        let (folder, own) = match used {
            Use::Upload { id, .. } => (store.upload_folder(id), name_of(used)),
            Use::Job { folder, .. } => (store.job_folder(folder).join("out"), name_of(used)),
        };
        names::file_within(&folder, name.strip_prefix(&own)?.strip_prefix('/')?)
    });
    let path = named.ok_or_else(absent)?;
    if std::fs::metadata(&path).map_err(StoreError::from)?.len() > MAX_PIPELINE_BYTES {
        return Err(wrong("pipeline", format!("`{name}` has more than {MAX_PIPELINE_BYTES} bytes")));
    }
    let text =
        std::fs::read_to_string(&path).map_err(|_| wrong("pipeline", format!("`{name}` is no text")))?;
    let table: toml::Table =
        text.parse().map_err(|e: toml::de::Error| wrong("pipeline", format!("{name}: {e}")))?;
    let keys = serde_json::to_value(&table).map_err(|e| wrong("pipeline", e.to_string()))?;
    find_files("pipeline", &keys, 0, owner, store, uses)?;
    with_uses_of_jobs(store, uses)?;
    Ok(table)
}

fn campaign(inputs: Value) -> Result<Prepared, RequestError> {
    let Value::Object(inputs) = inputs else { return Err(wrong("inputs", "expected an object")) };
    let mut table = toml::Table::new();
    table.insert("out".to_owned(), "../out/dataset".into());
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

fn toml_value(key: &str, value: Value) -> Result<toml::Value, RequestError> {
    toml::Value::try_from(value)
        .map_err(|_| wrong(key, "has a null, which pipeline files do not have; leave the key out"))
}

/// The folders in which commands look for files besides that of the file which names them.
fn assets(uses: &BTreeSet<Use>) -> Vec<String> {
    let uploads = uses
        .iter()
        .filter_map(|used| if let Use::Upload { name, .. } = used { Some(name.as_str()) } else { None });
    std::iter::once(".").chain(uploads).map(|folder| format!("--assets={folder}")).collect()
}

fn plan(inputs: &Map<String, Value>, assets: &[String], program: &Program) -> Result<Prepared, RequestError> {
    let mut inputs = inputs.clone();
    let kind = inputs.remove("kind").and_then(|kind| kind.as_str().map(str::to_owned)).unwrap_or_default();
    let schema = &program.commands[format!("plan {kind}")];
    for key in inputs.keys() {
        if schema["properties"].get(key).is_none() {
            return Err(wrong(key, format!("plans of the kind {kind} have no such input")));
        }
    }
    let words = [vec!["plan".to_owned(), kind], assets.to_vec(), options(&inputs, schema)?].concat();
    Ok(Prepared { words, within_inputs: true, stdout: Some("plan.toml".to_owned()), ..Prepared::default() })
}

/// Inputs as words of a command line: `--name=value`, so that no value is taken for an option, and operands behind `--`.
fn options(inputs: &Map<String, Value>, schema: &Value) -> Result<Vec<String>, RequestError> {
    let mut words = Vec::new();
    let mut operands = Vec::new();
    for (key, value) in inputs {
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
fn shown(process: Process, prepared: &Prepared) -> String {
    let is_ours =
        |word: &&String| *word == "--" || word.starts_with("--assets=") || word.starts_with("--most-points");
    let words = prepared.words.iter().filter(|word| !is_ours(word));
    let words = words.map(|word| {
        let word = word.replace("../in/", "").replace("../out/", "");
        let is_plain = word.chars().all(|c| c.is_alphanumeric() || "-_./=,:#+%".contains(c));
        if is_plain && !word.is_empty() { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
    });
    let line = std::iter::once("vlscan".to_owned()).chain(words).collect::<Vec<_>>().join(" ");
    match (&prepared.stdout, process) {
        (Some(_), Process::DryRun) | (None, _) => line,
        (Some(file), _) => format!("{line} > {file}"),
    }
}

/// The hash of everything that determines the result.
fn fingerprint(
    process: Process,
    prepared: &Prepared,
    owner: &str,
    store: &Store,
    program: &Program,
) -> Result<String, RequestError> {
    // `gps_start = "now"` and `--gps-start now`.
    if prepared.document.as_ref().is_some_and(|(_, text)| text.contains("gps") && text.contains("now")) {
        return Ok(String::new());
    }
    let mut inputs = Vec::new();
    for used in &prepared.uses {
        let content = match used {
            Use::Upload { name, id } => {
                let upload = store.upload(owner, name)?.filter(|upload| upload.id == *id);
                upload.map_or(id.clone(), |upload| upload.sha256)
            }
            Use::Job { folder, .. } => folder.clone(),
        };
        inputs.push((name_of(used), content));
    }
    let all = json!([
        env!("CARGO_PKG_VERSION"),
        program.version,
        process.id(),
        prepared.document,
        prepared.words,
        inputs
    ]);
    Ok(hex(&Sha256::digest(all.to_string().as_bytes())))
}

/// The known name that is most like a misspelt one.
fn nearest<'n>(typed: &str, known: impl Iterator<Item = &'n str>) -> String {
    let letters =
        |name: &str| name.chars().filter(|c| c.is_alphanumeric()).collect::<String>().to_lowercase();
    let typed = letters(typed);
    let mut known: Vec<&str> = known.collect();
    known.sort_unstable();
    match known.iter().find(|name| letters(name).contains(&typed) || typed.contains(&letters(name))) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("it has {}", known.join(", ")),
    }
}
