//! From the inputs of a request to the command that is executed: keys are checked, names of files resolved to
//! uploads and results of the same owner, and everything that determines the result is hashed.
//!
//! | file | what it does |
//! |---|---|
//! | `prepared` | what is executed, and why a request is refused |
//! | `values` | values and their types |
//! | `named` | uploads and results that inputs name |
//! | `clock` | whether results depend on the time |
//! | `commands` | the words and the pipeline file of a command |

mod clock;
mod commands;
mod named;
mod prepared;
mod values;

pub use named::name_of;
pub use prepared::{Form, Outputs, Prepared, RequestError};
pub(crate) use values::suggestion;

use crate::processes::Process;
use crate::program::Program;
use crate::queue::Use;
use crate::store::Store;
use crate::tokens::hex;
use clock::depends_on_time;
use commands::{assets, campaign, options, pipeline, plan, shown};
use named::{check_names, find_files, with_uses_of_jobs};
use prepared::wrong;
use serde_json::{Map, Value, json};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeSet;
use values::{check_type, geometry, unqualified};

/// Points in pages that show a cloud.
pub const PAGE_POINTS: &str = "500k";

/// A request that can be executed, and the hash of all that determines its result; empty if that depends on
/// the time.
#[derive(Clone, Debug)]
pub struct Checked {
    /// Command.
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
    let (inputs, geometries) = checked_inputs(process, inputs, &schema)?;
    let mut uses = BTreeSet::new();
    let tree = Value::Object(inputs.clone());
    check_names("inputs", &tree)?;
    find_files("", &tree, 0, owner, store, program, &mut uses)?;
    let mut prepared = match process {
        Process::Run | Process::DryRun => pipeline(process, tree, owner, store, program, &mut uses)?,
        Process::Campaign => campaign(tree)?,
        Process::Plan => Prepared { geometries, ..plan(&inputs, &assets(&inputs, &uses), program)? },
        Process::Compare => comparison(&inputs, &schema)?,
        Process::Stand => stand(&inputs, &schema)?,
        Process::Preview => preview(inputs, &schema, &uses)?,
    };
    with_uses_of_jobs(store, &mut uses)?;
    prepared.shown = shown(process, &prepared);
    prepared.uses = uses;
    let fingerprint = fingerprint(process, &prepared, owner, store, program)?;
    Ok(Checked { prepared, fingerprint })
}

/// Name and content of a file with an area or a line of a request.
type GeometryFile = (String, String);

/// The inputs by the schema of a process, and the areas and lines among them that become files.
fn checked_inputs(
    process: Process,
    inputs: &Map<String, Value>,
    schema: &Value,
) -> Result<(Map<String, Value>, Vec<GeometryFile>), RequestError> {
    let mut inputs = inputs.clone();
    let mut geometries = Vec::new();
    for (key, value) in &mut inputs {
        *value = unqualified(key, value.take())?;
        if let ("area" | "along", Process::Plan, Some((ending, text))) =
            (key.as_str(), process, geometry(value))
        {
            let name = format!("{key}.{ending}");
            *value = json!(name);
            geometries.push((name, text));
        }
        let Some(schema) = schema["properties"].get(key) else {
            let known = schema["properties"].as_object().into_iter().flatten().map(|(name, _)| name.as_str());
            return Err(wrong(
                key,
                format!("the process {} has no such input; {}", process.id(), suggestion(key, known)),
            ));
        };
        check_type(key, value, schema)?;
    }
    for key in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        if !inputs.contains_key(key) {
            return Err(wrong(key, format!("the process {} needs this input", process.id())));
        }
    }
    Ok((inputs, geometries))
}

/// The command of a comparison.
fn comparison(inputs: &Map<String, Value>, schema: &Value) -> Result<Prepared, RequestError> {
    let start = ["compare", "--json", "--page=../out/report.html"].map(str::to_owned).to_vec();
    Ok(Prepared {
        words: [start, options(inputs, schema)?].concat(),
        within_inputs: true,
        stdout: Some("report.json".to_owned()),
        ..Prepared::default()
    })
}

/// The command that makes a stand.
fn stand(inputs: &Map<String, Value>, schema: &Value) -> Result<Prepared, RequestError> {
    let start = ["scene", "stand", "--copy", "--out=../out/stand"].map(str::to_owned).to_vec();
    let words = [start, options(inputs, schema)?].concat();
    Ok(Prepared { words, within_inputs: true, ..Prepared::default() })
}

/// The command of a preview.
fn preview(
    mut inputs: Map<String, Value>,
    schema: &Value,
    uses: &BTreeSet<Use>,
) -> Result<Prepared, RequestError> {
    let format = inputs.get("format").and_then(Value::as_str).unwrap_or("png").to_owned();
    inputs.remove("format");
    let out = format!("--out=../out/preview.{format}");
    let start = vec!["preview".to_owned(), out, format!("--max-points={PAGE_POINTS}")];
    let words = [start, assets(&inputs, uses), options(&inputs, schema)?].concat();
    Ok(Prepared { words, within_inputs: true, ..Prepared::default() })
}

/// The hash of everything that determines the result.
fn fingerprint(
    process: Process,
    prepared: &Prepared,
    owner: &str,
    store: &Store,
    program: &Program,
) -> Result<String, RequestError> {
    if depends_on_time(prepared, store)? {
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
        prepared.geometries,
        prepared.words,
        inputs
    ]);
    Ok(hex(&Sha256::digest(all.to_string().as_bytes())))
}
