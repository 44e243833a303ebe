//! Errors and warnings of the engine as Python exceptions. The classes are defined in `vlscan/errors.py`.

use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use std::sync::{Arc, Mutex, PoisonError};
use vlscan::base::diag::{Diagnostic, ProblemKind, Severity};
use vlscan::base::error::MissingFile;
use vlscan::render::Render as _;
use vlscan::{Diagnostics, Error, Notice};

/// The exception for an error of the engine.
pub fn exception(py: Python<'_>, error: Error) -> PyErr {
    match &error {
        Error::Interrupted => return PyKeyboardInterrupt::new_err("the run was interrupted"),
        Error::Internal(message) => return PyRuntimeError::new_err(message.clone()),
        _ => {}
    }
    make(py, &error).unwrap_or_else(|failure| failure)
}

fn make(py: Python<'_>, error: &Error) -> PyResult<PyErr> {
    let module = py.import("vlscan.errors")?;
    let missing = match error {
        Error::Input(problems) => problems.cause::<MissingFile>(),
        _ => None,
    };
    if let Some(MissingFile { path }) = missing {
        let value = module.getattr("missing_file")?.call1((path.display().to_string(),))?;
        return Ok(PyErr::from_value(value));
    }
    let value = match error {
        Error::Input(problems) | Error::Limits(problems) => {
            let text = problems.render(false);
            module.getattr("InputError")?.call1((text.trim_end(), records(py, problems)?))?
        }
        Error::Io { path, source, .. } => {
            let (number, path) = (source.raw_os_error(), path.display().to_string());
            module.getattr("file_error")?.call1((error.to_string(), number, path))?
        }
        other => module.getattr("Error")?.call1((other.to_string(),))?,
    };
    Ok(PyErr::from_value(value))
}

fn records<'py>(py: Python<'py>, problems: &Diagnostics) -> PyResult<Bound<'py, PyList>> {
    let records = PyList::empty(py);
    for problem in problems.items() {
        records.append(record(py, problem)?)?;
    }
    Ok(records)
}

fn record<'py>(py: Python<'py>, problem: &Diagnostic) -> PyResult<Bound<'py, PyDict>> {
    let fields = PyDict::new(py);
    let severity = match problem.severity {
        Severity::Error => "error",
        Severity::Warning => "warning",
        Severity::Note => "note",
    };
    fields.set_item("severity", severity)?;
    fields.set_item("message", &problem.message)?;
    let place = problem.place.as_ref();
    fields.set_item("file", place.map(|place| place.path.display().to_string()))?;
    fields.set_item("line", place.map(|place| place.line).filter(|line| *line > 0))?;
    fields.set_item("column", place.filter(|place| place.line > 0).map(|place| place.column))?;
    fields.set_item("help", problem.help.as_deref())?;
    fields.set_item("kind", kind(problem.kind))?;
    Ok(fields)
}

/// The name of a kind of problems, of `vlscan.errors.ProblemKind`.
fn kind(kind: ProblemKind) -> &'static str {
    match kind {
        ProblemKind::NotFound => "not_found",
        ProblemKind::Exists => "exists",
        ProblemKind::TooLarge => "too_large",
        ProblemKind::MissingEntry => "missing_entry",
        ProblemKind::Truncated => "truncated",
        ProblemKind::Unsupported => "unsupported",
        ProblemKind::NotDivisible => "not_divisible",
        ProblemKind::InUse => "in_use",
        _ => "invalid",
    }
}

/// Collects what the engine reports during a run.
#[derive(Clone, Default)]
pub struct Notices(Arc<Mutex<(Diagnostics, Vec<String>)>>);

impl Notices {
    /// Receiver of the notices of a session.
    pub fn observer(&self) -> impl Fn(Notice) + Send + Sync + 'static {
        let own = self.clone();
        move |notice| own.add(notice)
    }

    /// Adds a notice; details and timings are left out.
    pub fn add(&self, notice: Notice) {
        let mut own = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match notice {
            Notice::Warnings(found) => own.0.extend(found),
            Notice::Note(text) => own.1.push(text),
            Notice::Detail(_) | Notice::Timing(_) | Notice::Step(_) => {}
        }
    }

    /// Issues each warning by Python's `warnings`, logs notes, and returns both as dictionaries.
    pub fn issue<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let (found, notes) = std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner));
        let list = records(py, &found)?;
        for text in notes {
            let fields = PyDict::new(py);
            fields.set_item("severity", "note")?;
            fields.set_item("message", text)?;
            for absent in ["file", "line", "column", "help"] {
                fields.set_item(absent, py.None())?;
            }
            list.append(fields)?;
        }
        if !list.is_empty() {
            py.import("vlscan.errors")?.getattr("report")?.call1((&list,))?;
        }
        Ok(list)
    }
}
