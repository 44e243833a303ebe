//! The options of a run as a `TypedDict` of the Python package, for type checkers and editors.

use super::groups::Options;
use super::values::{Bytes, ChunkSize, ColumnList, Count, Crs, Finite, GpsStart, Latency};
use super::values::{NavigationError, NotNegative, Positive, Seed, Vector, Zone};
use super::words::is_list;
use clap::Arg;
use std::any::TypeId;
use std::path::PathBuf;
use vlscan_base::error::{Error, Result};

/// Start of the module.
const HEAD: &str = r#""""The options of a run. `vlscan man --python` writes this file from the options of the command line: do not edit it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
            let message = format!("--{} has no type in Python: add it to src/options/python.rs", option.long);
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
            NAMES.iter().find(|(rust, _)| id == *rust)?.1.to_owned()
        }
    };
    Some(if is_list(option) { format!("{one} | Sequence[{one}]") } else { one })
}

/// Types of values, and their names in Python.
const NAMES: [(TypeId, &str); 19] = [
    (TypeId::of::<String>(), "str"),
    (TypeId::of::<char>(), "str"),
    (TypeId::of::<Zone>(), "str"),
    (TypeId::of::<PathBuf>(), "PathLike"),
    (TypeId::of::<usize>(), "int"),
    (TypeId::of::<ChunkSize>(), "int"),
    (TypeId::of::<Count<1>>(), "int | str"),
    (TypeId::of::<Bytes>(), "int | str"),
    (TypeId::of::<f64>(), "float"),
    (TypeId::of::<Finite>(), "float"),
    (TypeId::of::<Positive>(), "float"),
    (TypeId::of::<NotNegative>(), "float"),
    (TypeId::of::<Latency>(), "float"),
    (TypeId::of::<Seed>(), "int | float | str"),
    (TypeId::of::<GpsStart>(), "float | str | datetime"),
    (TypeId::of::<Vector>(), "str | Vector"),
    (TypeId::of::<ColumnList>(), "str | Sequence[str]"),
    (TypeId::of::<Crs>(), "int | PathLike"),
    (TypeId::of::<NavigationError>(), "Mapping[str, float | Sequence[float]]"),
];
