//! Point clouds: files as tables, what they are, their rasters and frames.

use crate::errors::{Notices, exception};
use crate::preview::one;
use crate::read_points::ReadPoints;
use crate::table::{Table, batches, wkt, wrong};
use crate::tools::{Named, get};
use crate::watch::interruptible;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::io::BufReader;
use std::path::PathBuf;
use vlscan::base::files::{FileGroup, reads, refuse_unwritable};
use vlscan::base::machine;
use vlscan::tools::cloud::{CloudSource, cloud_facts};
use vlscan::tools::frames::{Category, ForwardAxis, FrameLayout, FrameOptions, ObjectOptions};
use vlscan::tools::raster::{CloudRasters, RasterKind, RasterOptions};
use vlscan::{Error, Notice, Observer};

/// The points of a file in any format that is read, with the columns that it has.
#[pyfunction]
pub fn read_points(py: Python<'_>, path: PathBuf) -> PyResult<Table> {
    let notices = Notices::default();
    let own = notices.clone();
    let read = interruptible(py, move |_| {
        let mut points = ReadPoints::default();
        own.add(Notice::Warnings(vlscan::formats::read_points(&path, &mut points)?));
        Ok(points)
    })?;
    notices.issue(py)?;
    let points = read.map_err(|error| exception(py, error))?;
    points.table().map(Table::new).map_err(wrong)
}

/// Sources of clouds.
fn sources(clouds: Vec<Named<'_>>) -> PyResult<Vec<CloudSource>> {
    let source = |(name, table): Named<'_>| -> PyResult<CloudSource> {
        let Some(table) = table else { return Ok(CloudSource::File(name.into())) };
        let (_, batches) = batches(&table)?;
        let batch = one(batches).map_err(|error| exception(table.py(), error))?;
        Ok(CloudSource::Table(name.into(), batch))
    };
    clouds.into_iter().map(source).collect()
}

/// Describes clouds as one. Returns the facts as JSON and as text.
#[pyfunction]
pub fn cloud_info(py: Python<'_>, clouds: Vec<Named<'_>>) -> PyResult<(String, String)> {
    let (notices, clouds) = (Notices::default(), sources(clouds)?);
    let own = notices.clone();
    let described = interruptible(py, move |_| {
        let (facts, found) = cloud_facts(&clouds)?;
        own.add(Notice::Warnings(found));
        Ok((facts.json().to_string(), facts.text()))
    })?;
    notices.issue(py)?;
    described.map_err(|error| exception(py, error))
}

/// A grid: columns, rows, side of cells (m) and south-western corner.
type Grid = (usize, usize, f64, [f64; 2]);

/// Makes rasters of clouds, by name and with the file of each that is written. Returns the grid, the system
/// as WKT, and bytes of the values (doubles) of each raster, row by row from the south west.
#[pyfunction]
pub fn raster<'py>(
    py: Python<'py>,
    clouds: Vec<Named<'py>>,
    wanted: Vec<(String, Option<PathBuf>)>,
    fields: &Bound<'py, PyDict>,
) -> PyResult<(Grid, Option<String>, Vec<Bound<'py, PyBytes>>)> {
    let (notices, clouds) = (Notices::default(), sources(clouds)?);
    let options = RasterOptions { cell: get(fields, "cell")?, fill: get(fields, "fill")? };
    let (crs, force) = (get::<Option<String>>(fields, "crs")?, get::<bool>(fields, "force")?);
    let kind = |name: &str| RasterKind::ALL.into_iter().find(|kind| kind.name() == name);
    let kind = |name: &str| kind(name).ok_or_else(|| PyValueError::new_err(format!("no raster {name}")));
    let kinds = wanted.iter().map(|(name, _)| kind(name)).collect::<PyResult<Vec<RasterKind>>>()?;
    let own = notices.clone();
    let made = interruptible(py, move |interruption| {
        let files = clouds.iter().filter_map(|cloud| match cloud {
            CloudSource::File(path) => Some(path),
            CloudSource::Table(..) => None,
        });
        let files: Vec<&PathBuf> = files.collect();
        for path in wanted.iter().filter_map(|(_, path)| path.as_ref()) {
            refuse_unwritable(path, force)?;
            reads::refuse_input_of(path, &files)?;
        }
        let crs = crs.as_deref().map(wkt).transpose()?;
        let max_bytes = machine::memory().map(|bytes| bytes / 2);
        let (rasters, found) = CloudRasters::read(&clouds, &kinds, &options, crs, max_bytes)?;
        own.add(Notice::Warnings(found));
        let values: Vec<Vec<f64>> = kinds.iter().map(|kind| rasters.values(*kind)).collect();
        let files = kinds.iter().zip(&wanted).filter_map(|(kind, (_, path))| Some((*kind, path.as_ref()?)));
        let files: Vec<(&PathBuf, Vec<u8>)> =
            files.map(|(kind, path)| Ok((path, rasters.geotiff(kind)?))).collect::<vlscan::Result<_>>()?;
        interruption.begin_writing()?;
        let mut group = FileGroup::default();
        files.into_iter().try_for_each(|(path, bytes)| group.write(path, force, &bytes))?;
        group.commit()?;
        Ok((rasters, values))
    })?;
    notices.issue(py)?;
    let (rasters, values) = made.map_err(|error| exception(py, error))?;
    let bytes = |values: Vec<f64>| {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        PyBytes::new(py, &bytes)
    };
    let [columns, rows] = rasters.size();
    let grid = (columns, rows, rasters.side(), rasters.corner());
    Ok((grid, rasters.crs().map(str::to_owned), values.into_iter().map(bytes).collect()))
}

/// Writes the frames of an MCAP file to a folder in a layout. Returns the numbers of frames and points.
#[pyfunction]
pub fn write_frames(
    py: Python<'_>,
    path: PathBuf,
    folder: PathBuf,
    fields: &Bound<'_, PyDict>,
) -> PyResult<(u64, u64)> {
    let options = FrameOptions {
        layout: match get::<String>(fields, "layout")?.as_str() {
            "kitti" => FrameLayout::Kitti,
            _ => FrameLayout::Nuscenes,
        },
        forward: match get::<String>(fields, "forward")?.as_str() {
            "x" => ForwardAxis::X,
            _ => ForwardAxis::Y,
        },
        sequence: get(fields, "sequence")?,
        intensity_factor: get(fields, "intensity_factor")?,
        objects: ObjectOptions {
            objects: get(fields, "objects")?,
            skewed_objects: get(fields, "skewed_objects")?,
            categories: get::<Vec<(u8, String)>>(fields, "categories")?
                .into_iter()
                .map(|(class, name)| Category { class, name })
                .collect(),
        },
    };
    let notices = Notices::default();
    let observer = Observer::new(false, notices.observer());
    let written = interruptible(py, move |interruption| {
        interruption.begin_writing()?;
        let file = reads::open(&path).map_err(|e| Error::open(&path, e))?;
        let mut source = BufReader::with_capacity(1 << 20, file);
        vlscan::tools::frames::write_frames(&mut source, &path, &folder, &options, &observer)
    })?;
    notices.issue(py)?;
    let counts = written.map_err(|error| exception(py, error))?;
    Ok((counts.frames, counts.points))
}
