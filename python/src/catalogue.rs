//! Lists of instruments, options and columns.

use crate::errors::exception;
use pyo3::prelude::*;
use vlscan::Options;
use vlscan::scene::SURFACE_SPECTRA;
use vlscan::survey::{KeyTable, SURVEY_TABLES, catalogue as shipped, catalogue_files as files};

/// References and names.
type Named = Vec<(String, String)>;

/// References and names of the scanners, and references of the platforms, that ship with the program.
#[pyfunction]
pub fn catalogue(py: Python<'_>) -> PyResult<(Named, Vec<String>)> {
    let (known, _) = shipped().map_err(|error| exception(py, error))?;
    let scanners = known.scanners.into_iter().map(|(reference, scanner)| (reference, scanner.name));
    let platforms = known.platforms.into_iter().map(|(reference, _)| reference);
    Ok((scanners.collect(), platforms.collect()))
}

/// Name, help, whether it takes a value, whether it may be given more than once, whether it only says how
/// files are written.
type Listed = (String, String, bool, bool, bool);

/// The options of a run.
#[pyfunction]
pub fn options() -> Vec<Listed> {
    let names = Options::names().into_iter();
    names.map(|o| (o.long, o.help, o.has_value, o.is_list, o.is_of_files)).collect()
}

/// The columns of points: name, unit, meaning.
#[pyfunction]
pub fn columns() -> Vec<(&'static str, &'static str, &'static str)> {
    let columns = vlscan::Column::ALL.iter();
    columns.map(|column| (column.name(), column.unit(), column.meaning())).collect()
}

/// The tables of pipeline files with their keys.
#[pyfunction]
pub fn keys() -> Vec<(&'static str, Vec<&'static str>)> {
    let names =
        |table: &KeyTable| -> Vec<&'static str> { table.keys.iter().map(|(name, _)| *name).collect() };
    SURVEY_TABLES.iter().map(|table| (table.name, names(table))).collect()
}

/// Wavelength, nm, reflectance and transmittance.
type SpectrumValues = Vec<(f64, f64, f64)>;

/// The built-in spectra of surfaces: names and values.
#[pyfunction]
pub fn spectra() -> Vec<(&'static str, SpectrumValues)> {
    SURFACE_SPECTRA.iter().map(|surface| (surface.name, surface.values.to_vec())).collect()
}

/// The files of the catalogue that ships: the path by which surveys refer to each, and its text.
#[pyfunction]
pub fn catalogue_files() -> Vec<(&'static str, &'static str)> {
    files().collect()
}
