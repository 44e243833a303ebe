//! The options of a run as a `TypedDict` of the Python package, for type checkers and editors.

use super::groups::Options;
use super::values::{Bytes, ChunkSize, ColumnList, Count, Crs, Finite, GpsStart, Latency, MaxOrder};
use super::values::{NavigationError, NotNegative, Positive, Seed, Vector, WarehouseFactor, Zone};
use super::words::is_list;
use clap::Arg;
use clap::builder::ValueParser;
use std::any::TypeId;
use std::path::PathBuf;
use vlscan_base::error::{Error, Result};

/// Start of the module.
const HEAD: &str = r#""""The options of a run. `vlscan man --python` writes this file from the options of the command line: do not edit it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import Literal, TypedDict

from ._typing import PathLike, Vector


class RunOptions(TypedDict, total=False):
    """Options of :meth:`vlscan.Survey.run`: those of the command line with underscores. ``None`` is an option not given."""
"#;

/// Returns the text of `python/vlscan/_options.py`.
///
/// # Errors
/// [`Error::Internal`] for an option whose values have no type in Python.
pub fn python_module() -> Result<String> {
    let mut module = HEAD.to_owned();
    for option in Options::names() {
        let Some(kind) = option.python_type else {
            let message =
                format!("--{} has no type in Python: add it to apps/options/src/python.rs", option.long);
            return Err(Error::Internal(message));
        };
        let about = option.help.split("\n\n").next().unwrap_or_default();
        let stop = if about.ends_with(['.', ']']) { "" } else { "." };
        let about = about.replace('\\', "\\\\").replace('"', "\\\"");
        module += &format!("\n    {}: {kind} | None\n", option.long.replace('-', "_"));
        module += &format!("    \"\"\"{about}{stop}\"\"\"\n");
    }
    Ok(module)
}

/// Returns the type that the values of an option have in Python.
pub(super) fn python_type(option: &Arg) -> Option<String> {
    if !option.get_action().takes_values() {
        return Some("bool".to_owned());
    }
    let parser = option.get_value_parser();
    let one = match parser.possible_values() {
        Some(values) => {
            let names: Vec<String> = values.map(|value| format!("{:?}", value.get_name())).collect();
            format!("Literal[{}]", names.join(", "))
        }
        None => {
            let id = parser.type_id();
            NAMES.iter().find(|(rust, ..)| id == *rust)?.1.to_owned()
        }
    };
    Some(if is_list(option) { format!("{one} | Sequence[{one}]") } else { one })
}

/// The types that values of this type have in JSON. Values of other types are numbers where Rust has them as
/// numbers, else text.
pub(super) fn value_types(parser: &ValueParser) -> &'static [&'static str] {
    let id = parser.type_id();
    match NAMES.iter().find(|(rust, ..)| id == *rust) {
        Some((.., json)) => json,
        None if id == TypeId::of::<u32>() || id == TypeId::of::<u64>() => &["integer"],
        None => &["string"],
    }
}

/// Types of values, their names in Python, and their types in JSON.
const NAMES: [(TypeId, &str, &[&str]); 21] = [
    (TypeId::of::<String>(), "str", &["string"]),
    (TypeId::of::<char>(), "str", &["string"]),
    (TypeId::of::<Zone>(), "str", &["string"]),
    (TypeId::of::<PathBuf>(), "PathLike", &["string"]),
    (TypeId::of::<usize>(), "int", &["integer"]),
    (TypeId::of::<ChunkSize>(), "int", &["integer"]),
    (TypeId::of::<WarehouseFactor>(), "int", &["integer"]),
    (TypeId::of::<MaxOrder>(), "int", &["integer"]),
    (TypeId::of::<Count<1>>(), "int | str", &["integer", "string"]),
    (TypeId::of::<Bytes>(), "int | str", &["integer", "string"]),
    (TypeId::of::<f64>(), "float", &["number"]),
    (TypeId::of::<Finite>(), "float", &["number"]),
    (TypeId::of::<Positive>(), "float", &["number"]),
    (TypeId::of::<NotNegative>(), "float", &["number"]),
    (TypeId::of::<Latency>(), "float", &["number"]),
    (TypeId::of::<Seed>(), "int | float | str", &["integer", "number", "string"]),
    (TypeId::of::<GpsStart>(), "float | str | datetime", &["number", "string"]),
    (TypeId::of::<Vector>(), "str | Vector", &["string", "array"]),
    (TypeId::of::<ColumnList>(), "str | Iterable[str]", &["string", "array"]),
    (TypeId::of::<Crs>(), "int | PathLike", &["integer", "string"]),
    (TypeId::of::<NavigationError>(), "Mapping[str, float | Sequence[float]]", &["object"]),
];
