//! Around runs: surveys that are planned, campaigns, clouds that are compared.

use crate::errors::{Notices, exception};
use crate::preview::one;
use crate::table::batches;
use crate::watch::{Interruption, interruptible, watched};
use pyo3::conversion::FromPyObjectOwned;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use vlscan::base::files::{FileGroup, refuse_existing, refuse_unwritable, write_file};
use vlscan::fit::flight::{self, FlightFiles, FlightLineName, FlightRequest};
use vlscan::fit::scene::ReconstructOptions;
use vlscan::fit::spinning::{Half, SpinningFiles, SpinningRequest, fit_spinning};
use vlscan::tools::cloud::{Points, points_of_table, read_points};
use vlscan::tools::compare::{
    CompareOptions, changed_points, compare as compare_clouds, json, page, write_changed,
};
use vlscan::tools::plan::{
    AirborneOptions, AirborneRequest, Area, AreaSource, LineFormat, MobileOptions, MobileRequest, PlanLine,
    PlanRequest, PlanSetup, TerrestrialOptions, TerrestrialRequest, plan_lines,
};
use vlscan::{Campaign, CampaignEvent, CampaignOptions, DVec3, Diagnostics, Error, Notice, Observer, OneOf};

/// The command in the first line of plans.
const COMMAND: &str = "vlscan.plan";

/// A value of a dictionary that the package fills.
pub fn get<'py, T: FromPyObjectOwned<'py>>(fields: &Bound<'py, PyDict>, key: &str) -> PyResult<T> {
    let value = fields.get_item(key)?.ok_or_else(|| PyValueError::new_err(format!("no {key}")))?;
    value.extract::<T>().map_err(|error| {
        let error: PyErr = error.into();
        PyTypeError::new_err(format!("{key}: {}", error.value(fields.py())))
    })
}

/// A name of a file, text, or corners.
fn area(fields: &Bound<'_, PyDict>) -> PyResult<Option<AreaSource>> {
    let Some(value) = get::<Option<Bound<'_, PyAny>>>(fields, "area")? else { return Ok(None) };
    if let Ok(name) = value.extract::<String>() {
        return Ok(Some(AreaSource::Named(name)));
    }
    let area =
        Area::new(value.extract()?).map_err(|message| PyValueError::new_err(format!("area: {message}")));
    Ok(Some(AreaSource::Given(area?)))
}

/// A struct whose fields are those of a dictionary, and others.
macro_rules! of_fields {
    ($type:ident, $fields:expr, [$($name:ident),*] $(, $other:ident: $value:expr)* $(,)?) => {
        $type { $($name: get($fields, stringify!($name))?,)* $($other: $value,)* }
    };
}

fn request(kind: &str, fields: &Bound<'_, PyDict>) -> PyResult<PlanRequest> {
    let common = of_fields!(
        PlanSetup, fields, [scanner, platform, scene, ground, pulse_rate, assets, crs],
        lines: Vec::new(), out: None, overwrite: false
    );
    Ok(match kind {
        "airborne" => {
            let options = of_fields!(
                AirborneOptions,
                fields,
                [
                    height,
                    speed,
                    density,
                    min_density,
                    min_share,
                    min_cell,
                    overlap,
                    scan_angle,
                    scan_freq,
                    heading,
                    cross_lines,
                    run_in,
                    turn_radius,
                    follow_terrain,
                    climb
                ]
            );
            let (area, buffer) = (area(fields)?, get(fields, "buffer")?);
            let follow_line = get(fields, "follow_line")?;
            let request = AirborneRequest { area, buffer, follow_line, common, options };
            PlanRequest::Airborne(Box::new(request))
        }
        "terrestrial" => {
            let options = of_fields!(
                TerrestrialOptions,
                fields,
                [spacing, around, radius, positions, at_centre, at, resolution]
            );
            PlanRequest::Terrestrial(Box::new(TerrestrialRequest { area: area(fields)?, common, options }))
        }
        _ => {
            let options = of_fields!(MobileOptions, fields, [speed, scan_angle, scan_freq, step]);
            PlanRequest::Mobile(Box::new(MobileRequest { along: get(fields, "along")?, common, options }))
        }
    })
}

/// A line of a plan: its name, speed (m/s) and vertices (m).
type Line = (String, Option<f64>, Vec<[f64; 3]>);

/// Plans a survey of a kind: airborne, terrestrial or mobile. Returns the fields of a plan.
#[pyfunction]
pub fn plan<'py>(py: Python<'py>, kind: &str, fields: &Bound<'py, PyDict>) -> PyResult<Bound<'py, PyDict>> {
    let (request, notices) = (request(kind, fields)?, Notices::default());
    let interruption = Arc::new(Interruption::default());
    let (own, observer) = (interruption.clone(), Observer::new(false, notices.observer()));
    let work = move || vlscan::plan_survey(&request, COMMAND, &observer, &own.stop);
    let done = watched(py, &interruption, work, || py.check_signals())?;
    notices.issue(py)?;
    let plan = done.map_err(|error| exception(py, error))?;
    let found = PyDict::new(py);
    found.set_item("text", plan.text(COMMAND))?;
    found.set_item("promises", plan.comments)?;
    found.set_item("warnings", plan.warnings)?;
    let line = |line: PlanLine| -> Line {
        (line.name, line.speed, line.vertices.iter().map(|vertex| vertex.to_array()).collect())
    };
    found.set_item("lines", plan.lines.into_iter().map(line).collect::<Vec<Line>>())?;
    found.set_item("crs", plan.wkt)?;
    found.set_item("platform", plan.platform)?;
    found.set_item("scanner", plan.scanner)?;
    Ok(found)
}

/// Writes the lines of a plan to a file whose extension is that of a format; `carriers` are the references to
/// platform and scanner.
#[pyfunction]
pub fn write_lines(
    py: Python<'_>,
    path: PathBuf,
    lines: Vec<Line>,
    carriers: (String, String),
    crs: Option<String>,
    force: bool,
) -> PyResult<()> {
    let line = |(name, speed, vertices): Line| PlanLine {
        name,
        speed,
        vertices: vertices.into_iter().map(DVec3::from).collect(),
    };
    let lines: Vec<PlanLine> = lines.into_iter().map(line).collect();
    let written = py.detach(|| {
        let format = LineFormat::of(&path)?;
        refuse_existing(&path, force)?;
        let text = plan_lines(&lines, [&carriers.0, &carriers.1], format, crs.as_deref())?;
        write_file(&path, force, text.as_bytes())
    });
    written.map_err(|error: Error| exception(py, error))
}

/// Computes the cells of a campaign. `notify` is called with the kind of an event, the name of a cell and a
/// text. Returns the state of the data set.
#[pyfunction]
pub fn run_campaign<'py>(
    py: Python<'py>,
    path: PathBuf,
    fields: &Bound<'py, PyDict>,
    notify: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let task = get::<Option<(u32, u32)>>(fields, "task")?.map(|(number, of)| OneOf { number, of });
    let options = of_fields!(CampaignOptions, fields, [cells, retry, verify, threads, strict], task: task);
    let (notices, interruption) = (Notices::default(), Arc::new(Interruption::of_writing()));
    let events = Arc::new(Mutex::new(Vec::new()));
    let (own, own_notices, own_events) = (interruption.clone(), notices.clone(), events.clone());
    let work = move || {
        let campaign = Campaign::read(&path)?;
        own_notices.add(Notice::Warnings(campaign.warnings().clone().finish(options.strict)?));
        campaign.run(&options, &own.stop, move |event| {
            own_events.lock().unwrap_or_else(PoisonError::into_inner).push(event);
        })
    };
    let tell = || {
        py.check_signals()?;
        let all = std::mem::take(&mut *events.lock().unwrap_or_else(PoisonError::into_inner));
        for event in all {
            let (kind, cell, text) = match event {
                CampaignEvent::Notice(_) => continue,
                CampaignEvent::Warning { cell, text } => ("warning", cell, text),
                CampaignEvent::Damaged { cell, damage } => ("damaged", cell, damage),
                CampaignEvent::Completed { cell, points, .. } => {
                    ("completed", cell, format!("{points} points"))
                }
                CampaignEvent::Failed { cell, error } => ("failed", cell, error),
            };
            if let Some(notify) = &notify {
                notify.call1(py, (kind, cell, text))?;
            }
        }
        Ok(())
    };
    let done = watched(py, &interruption, work, tell)?;
    tell()?;
    notices.issue(py)?;
    let report = done.map_err(|error| exception(py, error))?;
    let found = PyDict::new(py);
    found.set_item("computed", report.computed)?;
    found.set_item("seconds", report.seconds)?;
    found.set_item("cells", report.cells)?;
    found.set_item("left", report.left)?;
    found.set_item("points", report.points)?;
    found.set_item("manifest", report.manifest)?;
    let failed = report.failed.into_iter().map(|cell| (cell.cell, cell.error));
    found.set_item("failed", PyList::new(py, failed)?)?;
    Ok(found)
}

/// The cells of a campaign that are neither complete nor failed.
#[pyfunction]
pub fn campaign_cells(py: Python<'_>, path: PathBuf, fields: &Bound<'_, PyDict>) -> PyResult<Vec<String>> {
    let task = get::<Option<(u32, u32)>>(fields, "task")?.map(|(number, of)| OneOf { number, of });
    let options = of_fields!(CampaignOptions, fields, [cells, retry, verify, threads, strict], task: task);
    let notices = Notices::default();
    let left = py.detach(|| {
        let campaign = Campaign::read(&path)?;
        notices.add(Notice::Warnings(campaign.warnings().clone().finish(options.strict)?));
        Ok(campaign.left(&options)?.into_iter().map(|cell| cell.name.clone()).collect())
    });
    notices.issue(py)?;
    left.map_err(|error: Error| exception(py, error))
}

/// A cloud: its name, and its points or the file of that name.
pub type Named<'py> = (String, Option<Bound<'py, PyAny>>);

/// A map of change: its columns, rows, side of cells (m) and south-western corner, and bytes of the
/// differences, levels of detection (doubles) and marks of change (bytes) of the cells.
type Map<'py> = ((usize, usize, f64, [f64; 2]), [Bound<'py, PyBytes>; 3]);

/// Compares two clouds. Returns the comparison as JSON and its map of change.
#[pyfunction]
pub fn compare<'py>(
    py: Python<'py>,
    first: Named<'_>,
    second: Named<'_>,
    fields: &Bound<'_, PyDict>,
) -> PyResult<(String, Map<'py>)> {
    let notices = Notices::default();
    let (own, observer) = (notices.clone(), Observer::new(false, notices.observer()));
    let options =
        of_fields!(CompareOptions, fields, [cell, voxel, max_distances, chance, terrain, registration]);
    let file = |key| get::<Option<PathBuf>>(fields, key);
    let outputs = (file("page")?, file("change")?, file("changed")?, get::<bool>(fields, "force")?);
    for path in [&outputs.0, &outputs.1, &outputs.2].into_iter().flatten() {
        refuse_unwritable(path, outputs.3).map_err(|error| exception(py, error))?;
    }
    let tables = [first, second].map(|(name, table)| {
        let table = table.map(|table| batches(&table).map(|(_, batches)| batches)).transpose();
        table.map(|table| (name, table))
    });
    let [first, second] = tables;
    let (first, second) = (first?, second?);
    let made = interruptible(py, move |interruption| {
        let [first, second] = [first, second].map(|(name, table)| -> vlscan::Result<(String, Points)> {
            let (points, found) = match table {
                Some(batches) => points_of_table(&one(batches)?)?,
                None => read_points(Path::new(&name))?,
            };
            own.add(Notice::Warnings(found));
            Ok((name, points))
        });
        let (first, second) = (first?, second?);
        let clouds = [(first.0.as_str(), &first.1), (second.0.as_str(), &second.1)];
        let comparison = compare_clouds(clouds, &options, &observer)?;
        let points = [&first.1, &second.1];
        let shown = match &outputs.0 {
            Some(path) => Some((path, page(&comparison, points)?)),
            None => None,
        };
        interruption.begin_writing()?;
        let mut group = FileGroup::default();
        if let Some((path, page)) = shown {
            group.write(path, outputs.3, page.as_bytes())?;
        }
        if let Some(path) = &outputs.1 {
            group.write(path, outputs.3, &comparison.change.map.geotiff(comparison.crs.as_deref())?)?;
        }
        if let Some(path) = &outputs.2 {
            let changed = changed_points(points, options.cell)?;
            write_changed(path, outputs.3, points, &changed, &observer, &mut group)?;
        }
        group.commit()?;
        Ok((json(&comparison)?, comparison.change.map))
    })?;
    notices.issue(py)?;
    let (text, map) = made.map_err(|error| exception(py, error))?;
    let numbers = |values: &[f64]| {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        PyBytes::new(py, &bytes)
    };
    let marks: Vec<u8> = map.is_changed.iter().map(|is_changed| u8::from(*is_changed)).collect();
    let cells = [numbers(&map.differences), numbers(&map.detection), PyBytes::new(py, &marks)];
    Ok((text, ((map.columns, map.rows, map.side_m, map.corner), cells)))
}

/// Fits a flight and its scanner to a cloud and writes them. Returns the files, and the figures as JSON.
#[pyfunction]
pub fn fit_flight(
    py: Python<'_>,
    cloud: PathBuf,
    output: PathBuf,
    flight_line: Option<String>,
    extend: f64,
    force: bool,
    max_memory: Option<u64>,
) -> PyResult<(Vec<PathBuf>, String)> {
    let notices = Notices::default();
    let own = notices.clone();
    let made = interruptible(py, move |interruption| {
        FlightFiles::check(&output, &cloud, force)?;
        let flight_line = flight_line.map(|name| {
            name.parse::<FlightLineName>()
                .map_err(|expected| Error::input(format!("flight_line {name}: {expected}")))
        });
        let flight_line = flight_line.transpose()?;
        let mut found = Diagnostics::default();
        let request = FlightRequest { flight_line, extend, max_memory };
        let fit = flight::fit_flight(&cloud, &request, &mut found);
        own.add(Notice::Warnings(found.finish(false)?));
        let fit = fit?;
        interruption.begin_writing()?;
        let files = fit.write(&output, &format!("vlscan.fit_flight {}", cloud.display()), force)?;
        Ok((files.all().cloned().collect(), flight::json(&fit.figures())?))
    })?;
    notices.issue(py)?;
    made.map_err(|error| exception(py, error))
}

/// Fits noise and detection of a spinning sensor to a revolution and writes the sensor. Returns the figures
/// as JSON.
#[pyfunction]
pub fn fit_sensor(
    py: Python<'_>,
    revolution: PathBuf,
    calibration: PathBuf,
    output: PathBuf,
    odd: bool,
    planes: Option<PathBuf>,
    force: bool,
) -> PyResult<String> {
    let notices = Notices::default();
    let own = notices.clone();
    let made = interruptible(py, move |interruption| {
        let files = SpinningFiles::new(&output, planes.as_deref());
        files.check([&revolution, &calibration], force)?;
        let mut found = Diagnostics::default();
        let half = if odd { Half::Odd } else { Half::Even };
        let fit = fit_spinning(&revolution, &calibration, &SpinningRequest { half }, &mut found);
        own.add(Notice::Warnings(found.finish(false)?));
        let fit = fit?;
        interruption.begin_writing()?;
        let command = format!("vlscan.fit_sensor {} {}", revolution.display(), calibration.display());
        fit.write(&files, (&calibration, &command), force)?;
        fit.figures().json()
    })?;
    notices.issue(py)?;
    made.map_err(|error| exception(py, error))
}

/// Reconstructs a scene from a classified point cloud. Returns what was estimated as JSON.
#[pyfunction]
pub fn reconstruct(
    py: Python<'_>,
    cloud: PathBuf,
    folder: PathBuf,
    voxel: Option<f64>,
    divergence: f64,
    force: bool,
) -> PyResult<String> {
    let notices = Notices::default();
    let observer = Observer::new(false, notices.observer());
    let made = interruptible(py, move |interruption| {
        let options =
            ReconstructOptions { voxel, divergence, overwrite: force, ..ReconstructOptions::new(cloud) };
        let found = vlscan::fit::scene::reconstruct(&options, &observer)?;
        interruption.begin_writing()?;
        found.write(&folder, force)?;
        Ok(found.report().to_string())
    })?;
    notices.issue(py)?;
    made.map_err(|error| exception(py, error))
}
