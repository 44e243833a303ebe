//! Options of runs as values.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString};
use serde_json::{Number, Value};
use vlscan::OptionValues;

/// The values of a dictionary of options.
pub fn values(options: &Bound<'_, PyDict>) -> PyResult<OptionValues> {
    options.iter().map(|(name, given)| Ok((name.extract()?, value(&given)?))).collect()
}

/// A value of Python as one of an option.
fn value(object: &Bound<'_, PyAny>) -> PyResult<Value> {
    if object.is_none() {
        return Ok(Value::Null);
    }
    if let Ok(switch) = object.cast::<PyBool>() {
        return Ok(Value::Bool(switch.is_true()));
    }
    if object.is_instance_of::<PyInt>() {
        // Seeds may be wider.
        let number = object.extract::<i64>().map(Value::from);
        return number.or_else(|_| Ok(Value::String(object.str()?.to_cow()?.into_owned())));
    }
    if let Ok(number) = object.cast::<PyFloat>() {
        let number = number.value();
        return Ok(Number::from_f64(number).map_or_else(|| Value::String(number.to_string()), Value::Number));
    }
    if let Ok(text) = object.cast::<PyString>() {
        return Ok(Value::String(text.to_cow()?.into_owned()));
    }
    if let Ok(items) = object.cast::<PyList>() {
        return items.iter().map(|item| value(&item)).collect::<PyResult<Vec<_>>>().map(Value::Array);
    }
    if let Ok(keys) = object.cast::<PyDict>() {
        return values(keys).map(Value::Object);
    }
    let kind = object.get_type().qualname()?;
    Err(PyTypeError::new_err(format!("expected a number, a text, a list or a mapping, found {kind}")))
}
