//! Pictures and pages of points.

use crate::errors::exception;
use crate::table::batches;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use vlscan::Error;
use vlscan::internals::{ColourBy, PageOptions, PreviewOptions, draw, points_of_table, write_page};

fn colour_of(name: &str) -> PyResult<ColourBy> {
    let known = ColourBy::ALL.into_iter().find(|colour| colour.name() == name);
    let names = ColourBy::ALL.map(ColourBy::name).join(", ");
    known.ok_or_else(|| PyValueError::new_err(format!("colour is {name:?}; expected one of {names}")))
}

/// A page that shows points in a browser, offline. `table` has the columns X, Y, Z.
#[pyfunction]
pub fn page(
    py: Python<'_>,
    table: &Bound<'_, PyAny>,
    colour: &str,
    title: String,
    max_points: usize,
) -> PyResult<String> {
    let (colour, (_, batches)) = (colour_of(colour)?, batches(table)?);
    let made = py.detach(|| {
        let points = points_of_table(&one(batches)?)?;
        let mut bytes = Vec::new();
        let options = PageOptions { colour, title, max_points };
        write_page(&points, &options, &mut bytes).map_err(|e| Error::io("write", "the page", e))?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    });
    made.map_err(|error| exception(py, error))
}

/// A PNG picture of points, from above and from the side. `table` has the columns X, Y, Z.
#[pyfunction]
pub fn picture<'py>(
    py: Python<'py>,
    table: &Bound<'py, PyAny>,
    colour: &str,
    title: String,
    width: u32,
    height: u32,
) -> PyResult<Bound<'py, PyBytes>> {
    let (colour, (_, batches)) = (colour_of(colour)?, batches(table)?);
    if !(320..=16384).contains(&width) || !(240..=16384).contains(&height) {
        return Err(PyValueError::new_err("a picture has 320 to 16384 by 240 to 16384 dots"));
    }
    let made = py.detach(|| {
        let options = PreviewOptions { colour, width, height, title, ..PreviewOptions::default() };
        draw(&points_of_table(&one(batches)?)?, &options).png()
    });
    made.map(|bytes| PyBytes::new(py, &bytes)).map_err(|error| exception(py, error))
}

/// The only batch of a table.
fn one(mut batches: Vec<arrow_array::RecordBatch>) -> Result<arrow_array::RecordBatch, Error> {
    match (batches.pop(), batches.is_empty()) {
        (Some(batch), true) => Ok(batch),
        _ => Err(Error::input("expected a table in one piece; combine its chunks first")),
    }
}
