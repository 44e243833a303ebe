//! Pictures and pages of points.

use crate::errors::{Notices, exception};
use crate::run::Request;
use crate::table::batches;
use crate::watch::{Interruption, interruptible, watched};
use arrow_array::RecordBatch;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan::base::files::reads;
use vlscan::output::expand;
use vlscan::tools::cloud::{Points, Wave, points_of_table, read_packet, read_points, read_wave};
use vlscan::tools::preview::{Chart, ColourBy, PreviewOptions, draw, write_page};
use vlscan::{Error, Notice, Observer, SurveySketch};

fn colour_of(name: &str) -> PyResult<ColourBy> {
    let known = ColourBy::ALL.into_iter().find(|colour| colour.name() == name);
    let names = ColourBy::ALL.map(ColourBy::name).join(", ");
    known.ok_or_else(|| PyValueError::new_err(format!("colour is {name:?}; expected one of {names}")))
}

/// A picture (`png`) or a page (`html`) of a file of points, of the waveform of a pulse in a file, or of the
/// survey of a request.
#[pyfunction]
#[pyo3(signature = (kind, file, request, pulse, colour, title, light, width, height, max_points))]
#[allow(clippy::too_many_arguments, reason = "called by the package")]
pub fn preview<'py>(
    py: Python<'py>,
    kind: &str,
    file: Option<PathBuf>,
    request: Option<Py<Request>>,
    pulse: Option<u64>,
    colour: &str,
    title: String,
    light: bool,
    width: u32,
    height: u32,
    max_points: usize,
) -> PyResult<Bound<'py, PyBytes>> {
    let (colour, notices) = (colour_of(colour)?, Notices::default());
    if !(320..=16384).contains(&width) || !(240..=16384).contains(&height) {
        return Err(PyValueError::new_err("width must be 320 to 16384 and height 240 to 16384 pixels"));
    }
    let is_page = kind == "html";
    let (own, interruption) = (notices.clone(), Arc::new(Interruption::default()));
    let stop = interruption.clone();
    let work = move || {
        if let (Some(path), Some(pulse)) = (&file, pulse) {
            let chart = Chart::new(&waveform(path, pulse)?, &title, width, height);
            return if is_page { Ok(chart.page().into_bytes()) } else { chart.picture().png() };
        }
        let observer = Observer::new(false, own.observer());
        let options =
            PreviewOptions { colour, width, height, light, title, max_points, ..PreviewOptions::default() };
        let (points, name) = match (&file, &request) {
            (Some(path), _) => {
                let (points, found) = read_points(path)?;
                observer.warnings(found)?;
                (points, path.clone())
            }
            (None, Some(request)) => {
                let (request, name) = (request.get(), PathBuf::from("<python>"));
                let mut session = request.session(request.job(&own)?, &own)?;
                let sketch = SurveySketch::of_session(&mut session, &name, &observer, &stop.stop)?;
                if !is_page {
                    // Instead of legs, pictures show the density of pulses.
                    if colour != ColourBy::Leg {
                        observer.warnings(colour.doubts(sketch.points(), &name))?;
                    }
                    return sketch.picture(&options).png();
                }
                (sketch.into_points(), name)
            }
            (None, None) => return Err(Error::input("expected points or a survey")),
        };
        observer.warnings(colour.doubts(&points, &name))?;
        if !is_page {
            return draw(&points, &options).png();
        }
        let mut bytes = Vec::new();
        write_page(&points, &options, &mut bytes).map_err(|e| Error::io("write", "the page", e))?;
        Ok(bytes)
    };
    let done = watched(py, &interruption, work, || py.check_signals())?;
    notices.issue(py)?;
    let bytes = done.map_err(|error| exception(py, error))?;
    Ok(PyBytes::new(py, &bytes))
}

/// The waveform of a pulse in a file of waveforms or in a LAS file with waveform packets.
fn waveform(path: &Path, pulse: u64) -> vlscan::Result<Wave> {
    let ends_in = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    if ends_in("las") || ends_in("laz") {
        return read_packet(path, pulse);
    }
    let file = BufReader::new(reads::open(path).map_err(|e| Error::open(path, e))?);
    if !ends_in("bin") {
        return read_wave(file, path, pulse);
    }
    let mut text = Vec::new();
    expand(path, file, |bytes| {
        text.extend_from_slice(bytes);
        Ok(())
    })?;
    read_wave(&text[..], path, pulse)
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
    let own = notices.clone();
    let made = interruptible(py, move |_| {
        let points = points(batches, colour, &own)?;
        let mut bytes = Vec::new();
        let options = PreviewOptions { colour, title, max_points, ..PreviewOptions::default() };
        write_page(&points, &options, &mut bytes).map_err(|e| Error::io("write", "the page", e))?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    })?;
    let made = made.map_err(|error| exception(py, error))?;
    notices.issue(py)?;
    Ok(made)
}

/// A PNG picture of points, from above and from the side; a small one has sixteen colours. `table` has the
/// columns X, Y, Z.
#[pyfunction]
#[pyo3(signature = (table, colour, title, width, height, is_small=false))]
pub fn picture<'py>(
    py: Python<'py>,
    table: &Bound<'py, PyAny>,
    colour: &str,
    title: String,
    width: u32,
    height: u32,
    is_small: bool,
) -> PyResult<Bound<'py, PyBytes>> {
    let (colour, (_, batches), notices) = (colour_of(colour)?, batches(table)?, Notices::default());
    if !(320..=16384).contains(&width) || !(240..=16384).contains(&height) {
        return Err(PyValueError::new_err("width must be 320 to 16384 and height 240 to 16384 pixels"));
    }
    let own = notices.clone();
    let made = interruptible(py, move |_| {
        let options = PreviewOptions { colour, width, height, title, ..PreviewOptions::default() };
        let picture = draw(&points(batches, colour, &own)?, &options);
        if is_small { picture.indexed_png() } else { picture.png() }
    })?;
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
