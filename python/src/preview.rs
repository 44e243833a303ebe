//! Pictures and pages of points.

use crate::errors::{Notices, exception};
use crate::table::batches;
use arrow_array::RecordBatch;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::Path;
use vlscan::tools::cloud::{Points, points_of_table};
use vlscan::tools::preview::{ColourBy, PreviewOptions, draw, write_page};
use vlscan::{Error, Notice};

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
    let (colour, (_, batches), notices) = (colour_of(colour)?, batches(table)?, Notices::default());
    let made = py.detach(|| {
        let points = points(batches, colour, &notices)?;
        let mut bytes = Vec::new();
        let options = PreviewOptions { colour, title, max_points, ..PreviewOptions::default() };
        write_page(&points, &options, &mut bytes).map_err(|e| Error::io("write", "the page", e))?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    });
    let made = made.map_err(|error| exception(py, error))?;
    notices.issue(py)?;
    Ok(made)
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
    let (colour, (_, batches), notices) = (colour_of(colour)?, batches(table)?, Notices::default());
    if !(320..=16384).contains(&width) || !(240..=16384).contains(&height) {
        return Err(PyValueError::new_err("width must be 320 to 16384 and height 240 to 16384 pixels"));
    }
    let made = py.detach(|| {
        let options = PreviewOptions { colour, width, height, title, ..PreviewOptions::default() };
        draw(&points(batches, colour, &notices)?, &options).png()
    });
    let made = made.map_err(|error| exception(py, error))?;
    notices.issue(py)?;
    Ok(PyBytes::new(py, &made))
}

/// The points of a table; what is to be said of them is added to `notices`.
fn points(batches: Vec<RecordBatch>, colour: ColourBy, notices: &Notices) -> vlscan::Result<Points> {
    let (points, mut found) = points_of_table(&one(batches)?)?;
    found.extend(colour.doubts(&points, Path::new("the table")));
    notices.add(Notice::Warnings(found));
    Ok(points)
}

/// The only batch of a table.
pub(super) fn one(mut batches: Vec<RecordBatch>) -> vlscan::Result<RecordBatch> {
    match (batches.pop(), batches.is_empty()) {
        (Some(batch), true) => Ok(batch),
        _ => Err(Error::input("expected a table without chunks; combine its chunks first")),
    }
}
