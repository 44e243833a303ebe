//! Runs: a survey is flown, or pulses are traced, to tables in memory and to files. The interpreter is free
//! meanwhile; Ctrl-C ends a run, and a function is told the progress.

use crate::batches::BatchIterator;
use crate::errors::{Notices, exception};
use crate::options::values;
use crate::scene::Scene;
use crate::table::{Table, batches};
use crate::watch::{Interruption, watched};
use arrow_array::RecordBatch;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use vlscan::survey::{SurveySources, survey_sources};
use vlscan::tables::input::arrow::encode_stream;
use vlscan::{
    Batches, CloudFacts, Column, LegRule, OptionValues, Progress, PulseReader, Report, ResolvedRun,
    RunContext, Session, TableContent, TableRequest, TableSink,
};

/// Rows of pulses that are traced together.
const PULSE_ROWS: usize = 4096;

/// A document in memory: its name in messages, its text, and the trajectories that its legs name.
type Document<'py> = (PathBuf, String, Vec<(String, Bound<'py, PyAny>)>);

/// Input of a run: a survey or pipeline file, or such a document; a scene that replaces its own; a trajectory
/// or pulses in memory; options.
#[pyclass(frozen, module = "vlscan")]
pub struct Request {
    file: Option<PathBuf>,
    /// Name in messages and text.
    document: (PathBuf, String),
    /// Arrow streams by the names that legs of XML give as their files.
    named_trajectories: Vec<(String, Arc<[u8]>)>,
    options: OptionValues,
    scene: Option<Py<Scene>>,
    trajectory: Option<Arc<[u8]>>,
    pulses: Option<Arc<[u8]>>,
    streamed_divergence: bool,
}

#[pymethods]
impl Request {
    /// `options` are values by name. `document` is a name, a text and tables by name: files are searched in the
    /// folder of the name, too. `trajectory` and `pulses` are tables.
    #[new]
    #[pyo3(signature = (options, file=None, document=None, scene=None, trajectory=None, pulses=None))]
    fn new(
        py: Python<'_>,
        options: &Bound<'_, PyDict>,
        file: Option<PathBuf>,
        document: Option<Document<'_>>,
        scene: Option<Py<Scene>>,
        trajectory: Option<Bound<'_, PyAny>>,
        pulses: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Request> {
        let stream = |table: Bound<'_, PyAny>| {
            let (schema, batches) = batches(&table)?;
            py.detach(|| encode_stream(&schema, &batches)).map_err(|error| exception(py, error))
        };
        let trajectory = trajectory.map(stream).transpose()?.map(Arc::from);
        let pulses = pulses.map(stream).transpose()?.map(Arc::from);
        let options = values(options)?;
        let (name, text, tables) =
            document.unwrap_or_else(|| (PathBuf::from("<python>"), String::new(), Vec::new()));
        let mut named_trajectories: Vec<(String, Arc<[u8]>)> = Vec::new();
        for (name, table) in tables {
            named_trajectories.push((name, Arc::from(stream(table)?)));
        }
        Ok(Request {
            file,
            document: (name, text),
            named_trajectories,
            options,
            scene,
            trajectory,
            pulses,
            streamed_divergence: true,
        })
    }
}

impl Request {
    /// Job of the run, with every choice resolved.
    pub fn job(&self, notices: &Notices) -> vlscan::Result<ResolvedRun> {
        let mut options = vlscan::Options::of_values(self.options.clone())?;
        let has_file = !options.output.out.is_empty() || options.output.output.is_some();
        options.is_traced = self.pulses.is_some();
        options.scene = self.scene.as_ref().map(|scene| scene.get().recipe.clone());
        options.named_trajectories = self.named_trajectories.clone();
        if let Some(bytes) = &self.trajectory {
            options.trajectory.content = Some(bytes.clone());
            options.trajectory.path = Some(PathBuf::from("<trajectory>"));
        }
        let read = match &self.file {
            Some(file) => ResolvedRun::resolve(file, &options),
            None => ResolvedRun::of_text(&self.document.0, self.document.1.clone(), &options),
        };
        let (mut job, warnings) = read?;
        if !has_file {
            // Points stay in memory.
            job.output.sinks.clear();
            let has_width = job.settings.physics.echo_width;
            let cloud = &mut job.output.cloud;
            let columns = cloud
                .columns
                .get_or_insert_with(|| columns_in_memory(cloud.misses, cloud.heights, has_width));
            add_frames(columns);
        }
        notices.add(vlscan::Notice::Warnings(warnings));
        Ok(job)
    }

    /// References and templates of a survey in XML; none of a pipeline.
    pub fn sources(&self) -> vlscan::Result<Option<SurveySources>> {
        let options = vlscan::Options::of_values(self.options.clone())?.read_options();
        let (name, text) = &self.document;
        let is_pipeline = |file: &PathBuf| file.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
        let found = match &self.file {
            Some(file) if is_pipeline(file) => return Ok(None),
            Some(file) => survey_sources(file, None, &options),
            None if text.trim_start().starts_with('<') => survey_sources(name, Some(text), &options),
            None => return Ok(None),
        };
        found.map(Some)
    }

    /// A session over the scene of the request.
    pub fn session(&self, job: ResolvedRun, notices: &Notices) -> vlscan::Result<Session> {
        match &self.scene {
            Some(scene) => scene.get().session(job, notices),
            None => Session::open(job.settings, notices.observer()),
        }
    }

    /// Runs the request; `tables` take the results in memory, points with these columns, or with those of
    /// files.
    fn execute(
        &self,
        (tables, columns): (Vec<TableRequest>, Option<Vec<Column>>),
        notices: &Notices,
        progress: &Progress,
        interruption: &Interruption,
    ) -> vlscan::Result<Report> {
        let mut job = self.job(notices)?;
        interruption.watch(&mut job.settings);
        let mut outputs = job.output.clone();
        outputs.tables = tables;
        if let Some(mut columns) = columns {
            add_frames(&mut columns);
            match outputs.sinks.is_empty() {
                true => outputs.cloud.columns = Some(columns),
                false => outputs.table_columns = Some(columns),
            }
            job.settings.load.colours |= outputs.records().colours;
        }
        let control = RunContext::new(progress, &interruption.stop);
        let Some(pulses) = &self.pulses else {
            return self.session(job, notices)?.run(outputs, control);
        };
        let reader = PulseReader::of_bytes(pulses.clone(), Path::new("<pulses>"), PULSE_ROWS);
        let known = self.file.is_some();
        let legs = LegRule { known, separate_files: false, streamed_divergence: self.streamed_divergence };
        self.session(job, notices)?.trace(reader, legs, outputs, control)
    }
}

/// Adds to columns with `ScannerX` those that MCAP is written of.
pub fn add_frames(columns: &mut Vec<Column>) {
    if columns.contains(&Column::ScannerX) {
        columns.extend(Column::OF_FRAMES);
    }
}

/// The columns of points in memory if no others are chosen: those of files, and those from which files are
/// written again.
pub fn columns_in_memory(has_misses: bool, has_heights: bool, has_width: bool) -> Vec<Column> {
    let mut columns = Column::default_columns(has_misses);
    columns.extend(has_heights.then_some(Column::HeightAboveGround));
    let is_needed = |column: &&Column| {
        !Column::OF_FRAMES.contains(column) && (has_width || **column != Column::ExactEchoWidth)
    };
    columns.extend(Column::EXACT.iter().filter(is_needed));
    columns
}

/// Files that were written: path, number of records, bytes, whether it is partial.
type Files = Vec<(String, u64, u64, bool)>;

/// Result of a run.
#[pyclass(frozen, module = "vlscan")]
pub struct Outcome {
    tables: Vec<(String, Py<Table>)>,
    counts: (u64, u64, f64, bool),
    files: Files,
    directories: Vec<PathBuf>,
    notices: Py<PyList>,
}

impl Outcome {
    /// The result of a run whose tables are complete.
    pub fn new(
        py: Python<'_>,
        report: Report,
        notices: Py<PyList>,
        tables: &CollectedTables,
    ) -> PyResult<Outcome> {
        let mut found = Vec::new();
        for (name, sink) in tables {
            let mut own = sink.0.lock().unwrap_or_else(PoisonError::into_inner);
            let batch = own.batches.pop();
            let batch = batch.ok_or_else(|| PyRuntimeError::new_err(format!("no table of {name}")))?;
            let table = match own.facts.take() {
                Some(facts) => Table::of_points(batch, Some(facts))?,
                None => Table::new(batch),
            };
            found.push((name.clone(), Py::new(py, table)?));
        }
        let Report { summary, pulses, seconds, interrupted, .. } = report;
        let files = summary.files.iter().filter_map(|file| {
            let path = file.path.as_ref()?.display().to_string();
            Some((path, file.records, file.bytes, file.partial))
        });
        Ok(Outcome {
            tables: found,
            counts: (pulses, summary.points, seconds, interrupted),
            files: files.collect(),
            directories: summary.directories.clone(),
            notices,
        })
    }
}

#[pymethods]
impl Outcome {
    /// An outcome of its parts, as [`Outcome::parts`] returns them.
    #[new]
    fn of_parts(
        tables: Vec<(String, Py<Table>)>,
        counts: (u64, u64, f64, bool),
        files: Files,
        directories: Vec<PathBuf>,
        notices: Py<PyList>,
    ) -> Outcome {
        Outcome { tables, counts, files, directories, notices }
    }

    /// Tables by name, counts, files, directories and notices.
    #[allow(clippy::type_complexity, reason = "unpacked by the package")]
    fn parts(
        &self,
        py: Python<'_>,
    ) -> (Vec<(String, Py<Table>)>, (u64, u64, f64, bool), Files, Vec<PathBuf>, Py<PyList>) {
        let tables = self.tables.iter().map(|(name, table)| (name.clone(), table.clone_ref(py))).collect();
        (tables, self.counts, self.files.clone(), self.directories.clone(), self.notices.clone_ref(py))
    }

    /// A table by name: points, trajectory, pulses, waveforms; none if it was not asked for.
    fn table(&self, py: Python<'_>, name: &str) -> Option<Py<Table>> {
        self.tables.iter().find(|table| table.0 == name).map(|table| table.1.clone_ref(py))
    }

    /// Number of pulses emitted.
    #[getter]
    fn pulses(&self) -> u64 {
        self.counts.0
    }

    /// Number of points.
    #[getter]
    fn points(&self) -> u64 {
        self.counts.1
    }

    /// Time from the first pulse to the last point, s.
    #[getter]
    fn seconds(&self) -> f64 {
        self.counts.2
    }

    /// True if the run was stopped early.
    #[getter]
    fn interrupted(&self) -> bool {
        self.counts.3
    }

    /// Files that were written: path, number of records, bytes, whether it is partial.
    #[getter]
    fn files(&self) -> Files {
        self.files.clone()
    }

    /// Run directories in HELIOS++'s layout.
    #[getter]
    fn directories(&self) -> Vec<PathBuf> {
        self.directories.clone()
    }

    /// Warnings and notes as dictionaries.
    #[getter]
    fn notices(&self, py: Python<'_>) -> Py<PyList> {
        self.notices.clone_ref(py)
    }
}

/// Collects the batches of a table.
#[derive(Debug, Default)]
pub struct Collected(Mutex<Batched>);

#[derive(Debug, Default)]
struct Batched {
    batches: Vec<RecordBatch>,
    /// Of points: what is known of them beside their columns.
    facts: Option<CloudFacts>,
}

impl TableSink for Collected {
    fn begin(&self, facts: CloudFacts) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).facts = Some(facts);
    }

    fn take(&self, batch: RecordBatch) -> vlscan::Result<()> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).batches.push(batch);
        Ok(())
    }
}

fn content(name: &str) -> PyResult<TableContent> {
    match name {
        "points" => Ok(TableContent::Points),
        "trajectory" => Ok(TableContent::Trajectory),
        "pulses" => Ok(TableContent::Pulses),
        "waveforms" => Ok(TableContent::Waveforms),
        other => {
            let known = "points, trajectory, pulses and waveforms";
            Err(PyValueError::new_err(format!("there is no table {other:?}, there are {known}")))
        }
    }
}

/// Tables by name, which are complete once the run has ended.
pub type CollectedTables = Vec<(String, Arc<Collected>)>;

/// Collectors of the tables of these names.
pub fn collected(names: Vec<String>) -> PyResult<(Vec<TableRequest>, CollectedTables)> {
    let mut requests = Vec::new();
    let mut tables = Vec::new();
    for name in names {
        let sink = Arc::new(Collected::default());
        requests.push(TableRequest::new(content(&name)?, sink.clone()));
        tables.push((name, sink));
    }
    Ok((requests, tables))
}

/// Runs a request and returns the tables of these names. `progress` is called with pulses, points, leg and
/// the fraction done.
#[pyfunction]
#[pyo3(signature = (request, tables, progress=None))]
pub fn run(
    py: Python<'_>,
    request: Py<Request>,
    tables: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    let (requests, collected) = collected(tables)?;
    let notices = Notices::default();
    let (counters, interruption) = (Arc::new(Progress::default()), Arc::new(Interruption::default()));
    let (own_notices, own_counters, own) = (notices.clone(), counters.clone(), interruption.clone());
    let work = move || request.get().execute((requests, None), &own_notices, &own_counters, &own);
    let done = watched(py, &interruption, work, || tell(py, progress.as_ref(), &counters))?;
    let issued = notices.issue(py)?;
    let report = done.map_err(|error| exception(py, error))?;
    tell(py, progress.as_ref(), &counters)?;
    Outcome::new(py, report, issued.unbind(), &collected)
}

/// Lets Python handle signals, and tells the progress.
pub fn tell(py: Python<'_>, progress: Option<&Py<PyAny>>, counters: &Progress) -> PyResult<()> {
    py.check_signals()?;
    let Some(progress) = progress else { return Ok(()) };
    let now = counters.snapshot();
    let fields = PyDict::new(py);
    fields.set_item("pulses", now.pulses)?;
    fields.set_item("points", now.echoes)?;
    fields.set_item("leg", now.leg)?;
    fields.set_item("done", now.done)?;
    progress.call(py, (), Some(&fields))?;
    Ok(())
}

/// Runs a request and returns its points batch by batch; at most `waiting` batches wait for their reader. A
/// batch ends with its leg, or at a multiple of `seconds`, too. The tables of these names are in the outcome
/// of the iterator, which exists once the last batch has been taken. `columns` are those of the batches where
/// files have others.
#[pyfunction]
#[pyo3(signature = (request, rows, per_leg, seconds, waiting, tables=Vec::new(), columns=None))]
pub fn run_batches(
    request: Py<Request>,
    rows: usize,
    per_leg: bool,
    seconds: Option<f64>,
    waiting: usize,
    tables: Vec<String>,
    columns: Option<Vec<String>>,
) -> PyResult<BatchIterator> {
    let (mut requests, collected) = collected(tables)?;
    let columns = columns.map(|names| Column::list(&names.join(","))).transpose();
    let columns = columns.map_err(|error| PyValueError::new_err(error.to_string()))?;
    let notices = Notices::default();
    let interruption = Arc::new(Interruption::default());
    let (own_notices, own) = (notices.clone(), interruption.clone());
    let end = move || interruption.request();
    let batches = Batches::spawn(waiting, end, move |sink| {
        let mut points = TableRequest::new(TableContent::Points, sink);
        (points.batch_rows, points.batch_per_leg, points.batch_seconds) = (rows, per_leg, seconds);
        requests.insert(0, points);
        request.get().execute((requests, columns), &own_notices, &Progress::default(), &own)
    });
    Ok(BatchIterator::new(batches, notices, collected))
}
