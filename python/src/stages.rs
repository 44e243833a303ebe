//! Around a run: what it will cost, its poses and pulses without tracing, its shares.

use crate::errors::{Notices, exception};
use crate::options::values;
use crate::run::{Outcome, Request, add_frames, collected, columns_in_memory, tell};
use crate::table::{Table, decode_stream};
use crate::watch::{Interruption, watched};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;
use vlscan::{
    Error, FlightRows, LoadedScene, Notice, OneOf, Progress, RunContext, Session, ShardSet, flight_table,
    merge, merge_warnings, schedule_of, shard_path,
};

/// Estimates what a run will cost and give, without outputs. Returns the forecast as JSON.
#[pyfunction]
pub fn dry_run(py: Python<'_>, request: Py<Request>) -> PyResult<String> {
    let (notices, interruption) = (Notices::default(), Arc::new(Interruption::default()));
    let (own_notices, own) = (notices.clone(), interruption.clone());
    let work = move || {
        let started = Instant::now();
        let request = request.get();
        let mut job = request.job(&own_notices)?;
        own.watch(&mut job.settings);
        let mut outputs = job.output.clone();
        if outputs.sinks.is_empty() {
            // Those of points in memory.
            outputs.cloud.columns = None;
        }
        let progress = Progress::default();
        let control = RunContext::new(&progress, &own.stop);
        let forecast = request.session(job, &own_notices)?.dry_run(&outputs, started, control)?;
        serde_json::to_string(&forecast).map_err(|e| Error::Internal(e.to_string()))
    };
    let done = watched(py, &interruption, work, || py.check_signals())?;
    notices.issue(py)?;
    done.map_err(|error| exception(py, error))
}

/// Flies a survey without tracing and returns its poses (`poses`) or pulses (`pulses`).
#[pyfunction]
pub fn fly(
    py: Python<'_>,
    request: Py<Request>,
    rows: &str,
    interval: Option<f64>,
    as_flown: bool,
) -> PyResult<Table> {
    let rows = match rows {
        "poses" => FlightRows::Poses,
        "pulses" => FlightRows::Pulses,
        other => return Err(PyValueError::new_err(format!("there are no rows {other:?}"))),
    };
    let (notices, interruption) = (Notices::default(), Arc::new(Interruption::default()));
    let (own_notices, own) = (notices.clone(), interruption.clone());
    let work = move || {
        let mut job = request.get().job(&own_notices)?;
        own.watch(&mut job.settings);
        let progress = Progress::default();
        let control = RunContext::new(&progress, &own.stop);
        flight_table(job.settings, rows, (interval, as_flown), own_notices.observer(), control)
    };
    let done = watched(py, &interruption, work, || py.check_signals())?;
    notices.issue(py)?;
    let bytes = done.map_err(|error| exception(py, error))?;
    decode_stream(&bytes).map(Table::new)
}

/// Computes shard `number` of `of` of a run into a folder; without a number only the index of all shards.
/// Returns the files.
#[pyfunction]
#[pyo3(signature = (request, folder, shard, resume, force, progress=None))]
pub fn run_shard(
    py: Python<'_>,
    request: Py<Request>,
    folder: PathBuf,
    shard: Option<(u32, u32)>,
    resume: bool,
    force: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<(PathBuf, u64)> {
    let (notices, interruption) = (Notices::default(), Arc::new(Interruption::of_writing()));
    let counters = Arc::new(Progress::default());
    let (own_notices, own, own_counters) = (notices.clone(), interruption.clone(), counters.clone());
    let work = move || {
        let mut job = request.get().job(&own_notices)?;
        job.settings.physics.record_scanner_axes = true;
        own.watch(&mut job.settings);
        let observer = own_notices.observer();
        // Shards that exist need no tree.
        let scene = LoadedScene::of(&job.settings, &own_notices.observer())?;
        let mut session = Session::new(job.settings, scene, observer)?;
        let control = RunContext::new(&own_counters, &own.stop);
        let mut shards = session.shards(&folder, &job.output, force, &own.stop)?;
        let Some((number, of)) = shard else {
            return Ok((folder, shards.pulses()));
        };
        let shard = OneOf { number, of };
        let path = shard_path(&folder, shard);
        if path.exists() && !force && !resume {
            let message = format!("{} exists already", path.display());
            return Err(Error::input_with_help(
                message,
                "replace it with force=True; resume=True keeps a complete one",
            ));
        }
        if resume && !force && shards.existing(shard)?.is_some() {
            return Ok((path, 0));
        }
        let report = shards.run(shard, control)?;
        if report.interrupted { Err(Error::Interrupted) } else { Ok((path, report.pulses)) }
    };
    let done = watched(py, &interruption, work, || tell(py, progress.as_ref(), &counters))?;
    notices.issue(py)?;
    done.map_err(|error| exception(py, error))
}

/// Merges the shards in a folder to files or to tables in memory of these names; without either their
/// checksums are compared.
#[pyfunction]
#[pyo3(signature = (folder, options, tables, check, progress=None))]
pub fn merge_shards(
    py: Python<'_>,
    folder: PathBuf,
    options: &Bound<'_, PyDict>,
    tables: Vec<String>,
    check: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Option<Outcome>> {
    let options = values(options)?;
    let (requests, collected) = collected(tables)?;
    let (notices, interruption) = (Notices::default(), Arc::new(Interruption::default()));
    let counters = Arc::new(Progress::default());
    let (own_notices, own, own_counters) = (notices.clone(), interruption.clone(), counters.clone());
    let work = move || {
        let shards = ShardSet::open(&folder)?;
        if check {
            shards.verify(&own.stop)?;
            return if own.stop.is_requested() { Err(Error::Interrupted) } else { Ok(None) };
        }
        let options = vlscan::Options::of_values(options)?;
        let has_file = !options.output.out.is_empty() || options.output.output.is_some();
        let mut outputs = options.output_request(shards.head.creation)?;
        outputs.tables = requests;
        if !has_file {
            // Points stay in memory.
            outputs.sinks.clear();
            let cloud = &mut outputs.cloud;
            let (misses, heights) = (cloud.misses, cloud.heights);
            add_frames(cloud.columns.get_or_insert_with(|| columns_in_memory(misses, heights, true)));
        }
        own_notices.add(Notice::Warnings(merge_warnings(&shards, &outputs)?));
        let control = RunContext::new(&own_counters, &own.stop);
        merge(&shards, outputs, schedule_of(&options), control).map(Some)
    };
    let done = watched(py, &interruption, work, || tell(py, progress.as_ref(), &counters))?;
    let issued = notices.issue(py)?;
    let Some(report) = done.map_err(|error| exception(py, error))? else { return Ok(None) };
    Outcome::new(py, report, issued.unbind(), &collected).map(Some)
}
